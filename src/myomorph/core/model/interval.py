"""A number and the interval that holds it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Interval:
    """A value and the interval that holds it.

    Attributes
    ----------
    value : the estimate
    low, high : ends of the interval; what makes it (`core.fit.interval_rule`) says how often it
        holds the value
    """

    value: float
    low: float
    high: float

    def holds(self, truth: float) -> bool:
        """Whether the interval holds a value."""
        return self.low <= truth <= self.high
