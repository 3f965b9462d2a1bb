"""Work of fibers and tendons by stride: what is done, taken up, stored and given back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from myomorph.analysis.joint_loads import own_strides
from myomorph.analysis.strides import Strides
from myomorph.model.arrays import Array
from myomorph.tension.fibers import Fibers


@dataclass(frozen=True)
class FiberWork:
    """What fibers and tendon of one muscle do in one stride.

    Attributes
    ----------
    stride : 1, 2, ... of the muscle's own leg; 0 for the whole recording, where it has no strides
    start, stop : of the stride [s]
    fiber_done, fiber_absorbed : positive work of the fibers, and negative, as a positive number [J]
    tendon_returned, tendon_stored : likewise of the tendon [J]
    fiber_peak, tendon_peak : greatest power [W]
    max_strain : of the tendon
    shortest, longest : fiber length over optimal fiber length
    """

    muscle: str
    stride: int
    start: float
    stop: float
    fiber_done: float
    fiber_absorbed: float
    tendon_returned: float
    tendon_stored: float
    fiber_peak: float
    tendon_peak: float
    max_strain: float
    shortest: float
    longest: float


def fiber_work(
    time: Array, muscles: tuple[str, ...], fibers: Fibers, optimal: Mapping[str, float], strides: Strides | None
) -> tuple[FiberWork, ...]:
    """Work, powers, strains and lengths of every muscle in every stride of its own leg, or in the whole recording.

    Frames near an end of the recording (`Fibers.transient`) and unsolved ones are left out; a stride with less than
    two others is left out itself.

    Parameters
    ----------
    time : (frames,) [s]
    muscles : of the columns of `fibers`
    optimal : optimal fiber length of every muscle [m]
    strides : of the recording; None where it has none
    """
    found = []
    for m, name in enumerate(muscles):
        own = [(k, one.start, one.stop) for k, one in enumerate(own_strides(name, strides), 1)]
        for number, start, stop in own or [(0, float(time[0]), float(time[-1]))]:
            inside = (time >= start - 1e-9) & (time <= stop + 1e-9) & ~fibers.transient
            known = np.flatnonzero(inside & np.isfinite(fibers.fiber_powers[:, m]))
            if len(known) < 2:
                continue
            fiber, tendon = fibers.fiber_powers[known, m], fibers.tendon_powers[known, m]
            lengths = fibers.lengths[known, m] / optimal[name]
            found.append(
                FiberWork(
                    *(name, number, start, stop),
                    *_work(time[known], fiber),
                    *_work(time[known], tendon),
                    *(float(fiber.max()), float(tendon.max()), float(fibers.tendon_strains[known, m].max())),
                    *(float(lengths.min()), float(lengths.max())),
                )
            )
    return tuple(found)


def _work(time: Array, power: Array) -> tuple[float, float]:
    """Positive and negative work [J], the latter as a positive number."""
    each = (np.maximum(power, 0.0), np.maximum(-power, 0.0))
    done, absorbed = (float(0.5 * (one[1:] + one[:-1]) @ np.diff(time)) for one in each)
    return done, absorbed
