"""Differences of two sessions, and which are larger than what strides differ by anyway."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from myomorph.lab.analysis.gait_curves import SIDES, GaitVariable
from myomorph.lab.analysis.gait_extremes import EXTREMES, gait_extremes
from myomorph.lab.analysis.gait_parameters import UNITS
from myomorph.lab.analysis.stride_spread import MIN_STRIDES, StrideSpread
from myomorph.lab.report.trial.comparison.walk_session import WalkSession

DEGREES = 5.0
"""Angles that differ by less are not said to differ, whatever their spread."""
SHARE = 0.1
"""The same of moments, powers and forces, as a share of the larger value."""


@dataclass(frozen=True, kw_only=True)
class SessionDifference:
    """One number in two sessions.

    Attributes
    ----------
    quantity, unit, side : of the number
    first, second : over the strides of each session
    limit : that a difference must exceed beside the spread, in the unit
    """

    quantity: str
    unit: str
    side: str
    first: StrideSpread
    second: StrideSpread
    limit: float

    @property
    def difference(self) -> float:
        """Second session less the first."""
        return self.second.mean - self.first.mean

    @property
    def spread(self) -> float:
        """Larger standard deviation between strides; nan where a session has a single stride."""
        return float(np.maximum(self.first.sd, self.second.sd))

    @property
    def is_larger(self) -> bool | None:
        """Whether the difference exceeds spread and limit; None where strides are few."""
        if min(self.first.count, self.second.count) < MIN_STRIDES:
            return None
        return abs(self.difference) > max(self.spread, self.limit)


def session_differences(
    first: WalkSession, second: WalkSession, variables: Sequence[GaitVariable]
) -> list[SessionDifference]:
    """Return what is known of both sessions: parameters, then extremes of curves.

    Parameters
    ----------
    first, second : sessions
    variables : curves that both verdicts allow; where there are none, nothing is compared
    """
    if not variables:
        return []
    return [*_of_parameters(first, second), *_of_curves(first, second, variables)]


def _of_parameters(first: WalkSession, second: WalkSession) -> Iterator[SessionDifference]:
    """Yield spatio-temporal parameters, for which the spread alone counts."""
    for name, unit in UNITS.items():
        for side in SIDES:
            one = first.parameters[name].get(side)
            other = second.parameters[name].get(side)
            if one is not None and other is not None:
                yield SessionDifference(
                    quantity=name, unit=unit, side=side, first=one, second=other, limit=0.0
                )


def _of_curves(
    first: WalkSession, second: WalkSession, variables: Sequence[GaitVariable]
) -> Iterator[SessionDifference]:
    """Yield largest and smallest values and ranges of curves."""
    before = {side: gait_extremes(first.curves, side) for side in SIDES}
    after = {side: gait_extremes(second.curves, side) for side in SIDES}
    keys = [(variable, extreme) for variable in variables for extreme in EXTREMES]
    for variable, extreme in keys:
        for side in SIDES:
            one = before[side].get((variable.key, extreme))
            other = after[side].get((variable.key, extreme))
            if one is not None and other is not None:
                yield SessionDifference(
                    quantity=f"{variable.title}, {extreme}",
                    unit=variable.unit,
                    side=side,
                    first=one,
                    second=other,
                    limit=_limit(variable, one, other),
                )


def _limit(variable: GaitVariable, first: StrideSpread, second: StrideSpread) -> float:
    """Return what a difference must exceed to be said, in the variable's unit."""
    if variable.kind == "angle":
        return DEGREES
    return SHARE * max(abs(first.mean), abs(second.mean))
