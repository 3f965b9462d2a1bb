"""Curves of the first screen over time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import cast

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.lab.report.answer.answer_curve import AnswerCurve, SideCurve
from myomorph.lab.report.answer.sentence import Side

SAMPLES = 241
SECONDS = "s"


def time_curve(
    title: str,
    unit: str,
    time: Array,
    values: Mapping[str, Array | None],
    span: tuple[float, float],
    marked: float | None = None,
    digits: int = 0,
    middle: str = "trunk",
) -> AnswerCurve | None:
    """A curve of both sides, or of the trunk, over a span of time; None where no value is known.

    Parameters
    ----------
    title, unit, digits : in print
    time : (frames,) [s]
    values : (frames,) in the unit, by side; "" of the trunk
    span : first and last time [s]
    marked : instant whose value is printed, by default that of the largest one [s]
    middle : what the line of no side is called
    """
    at = np.linspace(*span, SAMPLES)
    sides = []
    for side, column in values.items():
        if column is None or not np.isfinite(column).any():
            continue
        sampled = np.interp(at, time, column)[None]
        curve = SideCurve(side=cast(Side, side), label=side or middle, cycles=sampled)
        mark = curve.highest if marked is None else int(np.argmin(np.abs(at - marked)))
        sides.append(SideCurve(side=curve.side, label=curve.label, cycles=sampled, mark=mark))
    if not sides:
        return None
    return AnswerCurve(title=title, unit=unit, sides=tuple(sides), at=at, digits=digits)
