"""One of the three curves beside the body: both sides, over a cycle or over time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.lab.analysis.stride_spread import MIN_STRIDES
from myomorph.lab.report.trial.answer.sentence import Side

FEW = MIN_STRIDES
"""From so many cycles on their spread is drawn as a band; below, each is drawn by itself."""


@read_only
class SideCurve:
    """What one side shows.

    Attributes
    ----------
    side : "right", "left", or "" of the trunk and of a single limb
    label : word at the end of the line
    cycles : (cycles, samples) values in the curve's unit, NaN where unknown
    mark : sample whose value is printed, None for none
    peak : mean of the largest values of the cycles, which lie between samples and at other times
        in each; where it is known it is printed in the place of the mean curve's own largest value
    """

    side: Side
    label: str
    cycles: Array
    mark: int | None = None
    peak: float | None = None

    @property
    def mean(self) -> Array:
        """(samples,) over the cycles that are known, NaN where none is."""
        known = np.isfinite(self.cycles)
        count = known.sum(axis=0)
        total = np.where(known, self.cycles, 0.0).sum(axis=0)
        return np.where(count > 0, total / np.maximum(count, 1), np.nan)

    @property
    def spread(self) -> Array | None:
        """(samples,) standard deviation between cycles; None for fewer than `FEW`."""
        if len(self.cycles) < FEW:
            return None
        with np.errstate(invalid="ignore"):
            return np.asarray(np.nanstd(self.cycles, axis=0, ddof=1))

    @property
    def highest(self) -> int:
        """Sample where the mean is largest."""
        return int(np.nanargmax(self.mean))

    @property
    def highest_value(self) -> float:
        """Largest value: the mean of the cycles' own where these are known, else of the mean."""
        return self.value(self.highest) if self.peak is None else self.peak

    def value(self, sample: int) -> float:
        """Mean at a sample."""
        return float(self.mean[sample])

    def printed(self, sample: int) -> float:
        """Return what is printed: the largest value at the highest sample, else the mean."""
        return self.highest_value if sample == self.highest else self.value(sample)


@read_only
@dataclass(frozen=True, kw_only=True, eq=False)
class AnswerCurve:
    """A chart of the first screen.

    Attributes
    ----------
    title : of what, as "Knee flexion"
    unit : of its values in print
    sides : one or both sides, or the trunk alone
    at : (samples,) percent of the cycle, or time [s]
    digits : after the point of printed values
    """

    title: str
    unit: str
    sides: tuple[SideCurve, ...]
    at: Array
    digits: int = 0
