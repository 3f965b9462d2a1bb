"""Intervals beside the truth: how many hold it, and how wide they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import betaincinv
from scipy.stats import norm

from myomorph.core.model.arrays import Array

Row = dict[str, object]

SURE = 0.95
"""Level of the binomial range of a share."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Covered:
    """Intervals of one unknown over simulated truths.

    Attributes
    ----------
    held : (intervals,) whether each holds the truth
    width : (intervals,) of the intervals
    prior_width : (intervals,) of those at the same level before anything was measured, NaN where
        there is no prior
    """

    held: np.ndarray
    width: Array
    prior_width: Array

    @classmethod
    def of_limits(
        cls, truth: Array, low: Array, high: Array, prior_width: Array | None = None
    ) -> Covered:
        """Compare limits with the truth.

        Parameters
        ----------
        truth, low, high : (intervals,)
        prior_width : (intervals,) of the interval before anything was measured

        Returns
        -------
        which hold the truth, and their widths
        """
        width = np.asarray(high - low)
        before = np.full(len(width), np.nan) if prior_width is None else prior_width
        held = np.asarray((low <= truth) & (truth <= high))
        return cls(held=held, width=width, prior_width=before)

    @classmethod
    def of_sd(
        cls, error: Array, sd: Array, prior_sd: Array | None = None, level: float = 0.9
    ) -> Covered:
        """Make normal intervals of standard deviations and compare them with the errors.

        Parameters
        ----------
        error : (intervals,) estimate less truth
        sd, prior_sd : (intervals,) after and before the measurement
        level : that the intervals promise

        Returns
        -------
        which hold the truth, and their widths
        """
        half = float(norm.ppf(0.5 + 0.5 * level))
        before = None if prior_sd is None else 2.0 * half * prior_sd
        return cls.of_limits(np.zeros(len(error)), error - half * sd, error + half * sd, before)

    def row(self) -> Row:
        """Numbers for a table: count, share held with its binomial range, median width."""
        count = len(self.held)
        held = int(self.held.sum())
        low, high = binomial_range(held, count)
        known = np.isfinite(self.prior_width) & (self.prior_width > 0.0)
        ratio = np.median(self.width[known] / self.prior_width[known]) if known.any() else ""
        return {
            "intervals": count,
            "hold the truth [%]": 100.0 * held / max(count, 1),
            "binomial range [%]": f"{100.0 * low:.0f} to {100.0 * high:.0f}",
            "median width, of the prior's": ratio if ratio == "" else float(ratio),
        }


def joined(parts: Sequence[Covered]) -> Covered:
    """Put intervals of all truths one behind the other."""
    return Covered(
        held=np.concatenate([part.held for part in parts]),
        width=np.concatenate([part.width for part in parts]),
        prior_width=np.concatenate([part.prior_width for part in parts]),
    )


def binomial_range(held: int, count: int) -> tuple[float, float]:
    """Find shares that as many of so many intervals are compatible with (Clopper and Pearson 1934).

    Intervals are counted as independent, so the range is too narrow where those of one truth err
    together.

    Examples
    --------
    >>> from benchmarks.accuracy.intervals.covered import binomial_range
    >>> low, high = binomial_range(9, 10)
    >>> round(low, 3), round(high, 3)
    (0.555, 0.997)
    """
    tail = 0.5 - 0.5 * SURE
    low = float(betaincinv(held, count - held + 1, tail)) if held > 0 else 0.0
    high = float(betaincinv(held + 1, count - held, 1.0 - tail)) if held < count else 1.0
    return low, high
