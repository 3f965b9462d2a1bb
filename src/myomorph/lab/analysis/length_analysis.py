"""Muscle-length analysis: lengths of every muscle-tendon unit over the strides of its limb.

Lengths are reported in millimetres, against the length on the standing animal (the model's default
pose) and in optimal fiber lengths. Velocities are reported in optimal fiber lengths a second,
positive while the unit lengthens. [D] ch. 6.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.model import Model
from myomorph.core.model.series import Series
from myomorph.core.muscles.kinematics import default_path_lengths
from myomorph.lab.analysis.cycles import Cycles, over_cycles
from myomorph.lab.analysis.strides import Stride, Strides
from myomorph.lab.analysis.walking import chains, walking_limbs


@dataclass(frozen=True)
class MuscleRange:
    """What a muscle-tendon unit does in a stride, means over the strides."""

    muscle: str
    limb: str
    strides: int  # that show it whole
    # shortest, longest: [m]
    shortest: float
    longest: float
    # shortest_at, longest_at: where the mean curve is so [% of the stride]
    shortest_at: float
    longest_at: float
    standing: float  # length on the standing animal [m]
    fiber: float  # optimal fiber length [m]
    # shortening, lengthening: fastest [optimal fiber lengths/s]; nan where velocities are not known
    shortening: float
    lengthening: float

    @property
    def excursion(self) -> float:
        """Longest less shortest [optimal fiber lengths]."""
        return (self.longest - self.shortest) / self.fiber if self.fiber > 0.0 else float("nan")


@read_only
class LengthAnalysis:
    """Lengths of all muscle-tendon units over the strides of their limbs."""

    muscles: tuple[str, ...]
    limbs: tuple[str, ...]  # of each muscle
    strides: Mapping[str, tuple[Stride, ...]]  # by limb, those analysed
    # lengths, rates: by limb, over its strides [m], [m/s]; `rates` is empty where velocities are
    # not known
    lengths: Mapping[str, Cycles]
    rates: Mapping[str, Cycles]
    # standing, fiber: (muscles,) length in the model's default pose, optimal fiber length [m]
    standing: Array
    fiber: Array

    def curves(self, muscle: str) -> Array:
        """Return the lengths of one muscle over the strides of its limb.

        Parameters
        ----------
        muscle : name

        Returns
        -------
        (strides, samples) [m], NaN where not known
        """
        limb = self.limbs[self.muscles.index(muscle)]
        cycles = self.lengths[limb]
        return cycles.values[:, :, cycles.names.index(muscle)]

    @property
    def ranges(self) -> tuple[MuscleRange, ...]:
        """What each muscle does in a stride; those without a whole stride are left out."""
        known_ranges = (self._range(index) for index in range(len(self.muscles)))
        return tuple(muscle_range for muscle_range in known_ranges if muscle_range is not None)

    def _range(self, column: int) -> MuscleRange | None:
        muscle = self.muscles[column]
        limb = self.limbs[column]
        curves = self.curves(muscle)
        whole = np.isfinite(curves).all(axis=1)
        if not whole.any():
            return None
        mean = curves[whole].mean(axis=0)
        percent = self.lengths[limb].percent
        shortening = lengthening = float("nan")
        if limb in self.rates and self.fiber[column] > 0.0:
            rates = (
                self.rates[limb].values[whole, :, self.rates[limb].names.index(muscle)]
                / self.fiber[column]
            )
            if np.isfinite(rates).all():
                shortening = float(-rates.min(axis=1).mean())
                lengthening = float(rates.max(axis=1).mean())
        return MuscleRange(
            muscle=muscle,
            limb=limb,
            strides=int(whole.sum()),
            shortest=float(np.min(curves[whole], axis=1).mean()),
            longest=float(np.max(curves[whole], axis=1).mean()),
            shortest_at=float(percent[int(np.argmin(mean))]),
            longest_at=float(percent[int(np.argmax(mean))]),
            standing=float(self.standing[column]),
            fiber=float(self.fiber[column]),
            shortening=shortening,
            lengthening=lengthening,
        )


def length_analysis(
    model: Model, lengths: Series, strides: Strides, rates: Series | None = None
) -> LengthAnalysis:
    """Compute muscle-tendon lengths over every stride of the limb that each muscle moves.

    A muscle belongs to the limb that any of its points or surfaces is on. One that is on none (of
    the trunk) goes with the first limb's strides.

    Parameters
    ----------
    model : with the muscles
    lengths : (frames, muscles) [m], NaN where not known
    strides : of the limbs
    rates : (frames, muscles) velocities of the lengths [m/s]
    """
    owners = _owners(model, tuple(lengths.names))
    by_limb = {name: strides.of(name) for name in strides.strikes}
    if not any(by_limb.values()):
        raise BadData("there is no whole stride to analyse muscle lengths over")
    every = {}
    speeds = {}
    for limb, limb_strides in by_limb.items():
        names = tuple(
            muscle for muscle, owner in zip(lengths.names, owners, strict=True) if owner == limb
        )
        spans = [(stride.start, stride.stop) for stride in limb_strides]
        every[limb] = over_cycles(_columns(lengths, names), spans)
        if rates is not None:
            speeds[limb] = over_cycles(_columns(rates, names), spans)
    standing = dict(zip(model.muscle_names, default_path_lengths(model), strict=True))
    fibers = {muscle.name: muscle.optimal_fiber_length for muscle in model.muscles}
    return LengthAnalysis(
        muscles=tuple(lengths.names),
        limbs=owners,
        strides=by_limb,
        lengths=every,
        rates=speeds,
        standing=np.array([standing[name] for name in lengths.names]),
        fiber=np.array([fibers[name] for name in lengths.names]),
    )


def _owners(model: Model, muscles: tuple[str, ...]) -> tuple[str, ...]:
    """Find the limb of each muscle."""
    limbs = walking_limbs(model)
    if not limbs:
        raise BadData(f"no body of model '{model.name}' is a foot by its name")
    reach = chains(model, limbs)
    result = []
    for name in muscles:
        on = {point.body for point in model.muscle(name).path.points}
        result.append(next((limb for limb, bodies in reach.items() if on & bodies), limbs[0].name))
    return tuple(result)


def _columns(series: Series, names: tuple[str, ...]) -> Series:
    return Series(
        series.time, names, series.values[:, [series.names.index(name) for name in names]]
    )


def curve_rows(analysis: LengthAnalysis) -> Iterator[tuple[str, ...]]:
    """Yield the rows of a table of every stride of every muscle.

    A row has limb, start, end, muscle, and the length at each percent [mm].
    """
    percents = next(iter(analysis.lengths.values())).percent
    yield "limb", "start [s]", "end [s]", "muscle", *(f"{percent:g} %" for percent in percents)
    for limb, cycles in analysis.lengths.items():
        for stride, curves in zip(analysis.strides[limb], cycles.values, strict=True):
            for j, muscle in enumerate(cycles.names):
                values = ("" if np.isnan(curve) else f"{1e3 * curve:.5g}" for curve in curves[:, j])
                yield limb, f"{stride.start:.4f}", f"{stride.stop:.4f}", muscle, *values


RANGE_HEAD = (
    "muscle",
    "limb",
    "strides",
    "minimum [mm]",
    "minimum at [% of stride]",
    "maximum [mm]",
    "maximum at [% of stride]",
    "standing [mm]",
    "excursion [fiber lengths]",
    "shortening [fiber lengths/s]",
    "lengthening [fiber lengths/s]",
)


def range_row(muscle_range: MuscleRange) -> tuple[str, ...]:
    """Write the row of a muscle, under `RANGE_HEAD`."""
    ends = (
        1e3 * muscle_range.shortest,
        muscle_range.shortest_at,
        1e3 * muscle_range.longest,
        muscle_range.longest_at,
    )
    shares = muscle_range.excursion, muscle_range.shortening, muscle_range.lengthening
    values = (f"{value:.4g}" for value in (*ends, 1e3 * muscle_range.standing, *shares))
    return muscle_range.muscle, muscle_range.limb, str(muscle_range.strides), *values
