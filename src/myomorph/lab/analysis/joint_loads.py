"""Loads of joints by stride: peak, its time, and impulse."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from myomorph.core.model.series import Series
from myomorph.core.model.sides import split_side
from myomorph.lab.analysis.strides import Stride, Strides


@dataclass(frozen=True)
class StrideLoad:
    """What one stride does to a joint or to one of its contact points."""

    load: str  # name of the force
    # 1, 2, ... of the joint's own leg; 0 for the whole recording, where it has no strides
    stride: int
    # start, stop: of the stride [s]
    start: float
    stop: float
    peak: float  # [N]
    peak_time: float  # [s]
    impulse: float  # force added up over the time [N s]; NaN where it is not known all the time

    @property
    def peak_percent(self) -> float:
        """When the peak is, in percent of the stride."""
        return 100.0 * (self.peak_time - self.start) / (self.stop - self.start)


def own_strides(name: str, strides: Strides | None) -> tuple[Stride, ...]:
    """Strides of the leg on whose side a name is; those of the first leg where it has no side."""
    if strides is None or not strides.strides:
        return ()
    limbs = tuple(strides.strikes)
    side = split_side(name)[1]
    leg = next((limb for limb in limbs if split_side(limb)[1] == side), None) if side else limbs[0]
    return () if leg is None else strides.of(leg)


def stride_loads(loads: Series, strides: Strides | None) -> tuple[StrideLoad, ...]:
    """Measure peak and impulse of every load in every stride of its own leg.

    Without strides they are those of the whole recording. Strides in which a force is known in less
    than two frames are left out.

    Parameters
    ----------
    loads : forces over time (frames, loads) [N]
    strides : of the recording; None where it has none
    """
    if len(loads) < 2:
        return ()
    result = []
    for name, force in zip(loads.names, loads.values.T, strict=True):
        spans = [
            (index, stride.start, stride.stop)
            for index, stride in enumerate(own_strides(name, strides), 1)
        ]
        for number, start, stop in spans or [(0, float(loads.time[0]), float(loads.time[-1]))]:
            of_stride = (loads.time >= start - 1e-9) & (loads.time <= stop + 1e-9)
            inside = of_stride & np.isfinite(force)
            if inside.sum() > 1:
                clock = loads.time[inside]
                values = force[inside]
                top = int(np.argmax(values))
                impulse = float(0.5 * (values[1:] + values[:-1]) @ np.diff(clock))
                if inside.sum() < of_stride.sum():
                    impulse = np.nan
                result.append(
                    StrideLoad(
                        load=name,
                        stride=number,
                        start=start,
                        stop=stop,
                        peak=float(values[top]),
                        peak_time=float(clock[top]),
                        impulse=impulse,
                    )
                )
    return tuple(result)
