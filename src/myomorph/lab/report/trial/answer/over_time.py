"""Curves of the first screen over time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import cast

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.lab.report.trial.answer.answer_curve import AnswerCurve, SideCurve
from myomorph.lab.report.trial.answer.sentence import Side

SAMPLES = 241
SECONDS = "s"


@dataclass(frozen=True)
class Heading:
    """What a curve is of.

    Attributes
    ----------
    title : as "Knee flexion"
    unit : of its values
    digits : after the point of printed values
    middle : what the line of no side is called
    """

    title: str
    unit: str
    digits: int = 0
    middle: str = "trunk"


def time_curve(
    heading: Heading,
    time: Array,
    values: Mapping[str, Array | None],
    span: tuple[float, float],
    marked: float | None = None,
) -> AnswerCurve | None:
    """Draw both sides, or the trunk, over a span of time.

    Parameters
    ----------
    heading : title and unit
    time : (frames,) [s]
    values : (frames,) in the unit, by side; "" of the trunk
    span : first and last time [s]
    marked : instant whose value is printed, by default that of the largest one [s]

    Returns
    -------
    the curve, NaN where a value is not known; None where none is
    """
    at = np.linspace(*span, SAMPLES)
    sides = []
    for side, column in values.items():
        if column is None or not np.isfinite(column).any():
            continue
        sampled = np.interp(at, time, column)
        if not np.isfinite(sampled).any():
            continue
        mark = _marked(sampled, at, marked)
        label = side or heading.middle
        sides.append(SideCurve(side=cast(Side, side), label=label, cycles=sampled[None], mark=mark))
    if not sides:
        return None
    return AnswerCurve(
        title=heading.title, unit=heading.unit, sides=tuple(sides), at=at, digits=heading.digits
    )


def _marked(sampled: Array, at: Array, marked: float | None) -> int | None:
    """Return the sample whose value is printed, None where it is not known."""
    if marked is None:
        return int(np.nanargmax(sampled))
    nearest = int(np.abs(at - marked).argmin())
    return nearest if np.isfinite(sampled[nearest]) else None
