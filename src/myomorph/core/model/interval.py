"""A number and the interval that holds it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from myomorph.core.model.arrays import Array


@dataclass(frozen=True)
class Interval:
    """A value and the interval that holds it.

    Attributes
    ----------
    value : the estimate
    low, high : ends of the interval; what makes it says how often it holds the value: 90 % from
        `Posterior.interval` and 95 % from `of_draws`, unless another level is given
    """

    value: float
    low: float
    high: float

    @classmethod
    def of_draws(cls, value: float, draws: Array, level: float = 0.95) -> Interval:
        """Take the percentile interval of bootstrap draws.

        Parameters
        ----------
        value : the estimate
        draws : (draws,) of it; those that are not finite do not count
        level : share of the draws in the interval

        Returns
        -------
        the interval, NaN where no draw is finite
        """
        if not np.isfinite(draws).any():
            return cls(value=float(value), low=float("nan"), high=float("nan"))
        low, high = np.nanquantile(draws, [0.5 - 0.5 * level, 0.5 + 0.5 * level])
        return cls(value=float(value), low=float(low), high=float(high))

    def holds(self, truth: float) -> bool:
        """Whether the interval holds a value."""
        return self.low <= truth <= self.high
