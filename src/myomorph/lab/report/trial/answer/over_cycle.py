"""Curves of the first screen over the strides of both sides."""

from __future__ import annotations

from typing import cast

import numpy as np

from myomorph.lab.analysis.gait_curves import KEYS, SIDES, VARIABLES, GaitCurves
from myomorph.lab.report.trial.answer.answer_curve import FEW, AnswerCurve, SideCurve
from myomorph.lab.report.trial.answer.sentence import Side

PERCENT = "% of stride"


def stride_curve(
    gait: GaitCurves, key: str, title: str = "", unit: str = "", digits: int = 0
) -> AnswerCurve | None:
    """Return a curve of `VARIABLES` over the strides of each side; None where no side is known."""
    index = KEYS.index(key)
    variable = VARIABLES[index]
    sides = []
    for side in SIDES:
        cycles = gait.of(side)[:, :, index]
        known = cycles[np.isfinite(cycles).any(axis=1)]
        if not len(known):
            continue
        curve = SideCurve(side=cast(Side, side), label=side, cycles=known)
        marked = SideCurve(side=curve.side, label=side, cycles=known, mark=curve.highest)
        sides.append(marked)
    if not sides:
        return None
    return AnswerCurve(
        title=title or variable.title,
        unit=unit or variable.unit,
        sides=tuple(sides),
        at=np.linspace(0.0, 100.0, gait.right.values.shape[1]),
        digits=digits,
    )


def counted_strides(gait: GaitCurves) -> str:
    """How many strides there are, as "2 right strides and 1 left"."""
    counts = [(side, len(gait.strides[side])) for side in SIDES if gait.strides[side]]
    words = [f"{count} {side}" for side, count in counts]
    if not words:
        return "no whole stride"
    first, *others = words
    plural = "stride" if counts[0][1] == 1 else "strides"
    return f"{first} {plural}" + "".join(f" and {other}" for other in others)


def few_strides_note(gait: GaitCurves) -> str:
    """Say on how many strides a difference of the sides stands; "" for many, or for one side."""
    least = min(len(gait.strides[side]) for side in SIDES)
    if least >= FEW or least == 0:
        return ""
    return f"{counted_strides(gait)}: too few to conclude on a difference between the sides."


def mean_lift(gait: GaitCurves) -> float | None:
    """Where feet leave the ground in the mean of all strides [%], None where it was not seen."""
    duties = [
        stride.duty for side in SIDES for stride in gait.strides[side] if np.isfinite(stride.duty)
    ]
    return 100.0 * float(np.mean(duties)) if duties else None
