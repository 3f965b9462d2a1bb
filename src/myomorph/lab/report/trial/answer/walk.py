"""The main result of a walk."""

from __future__ import annotations

import numpy as np

from myomorph.lab.report.trial.answer.answer_curve import AnswerCurve
from myomorph.lab.report.trial.answer.judgement import Use
from myomorph.lab.report.trial.answer.knee_load import knee_load_curve
from myomorph.lab.report.trial.answer.main_result import MainResult
from myomorph.lab.report.trial.answer.over_cycle import (
    PERCENT,
    counted_strides,
    few_strides_note,
    mean_lift,
    stride_curve,
)
from myomorph.lab.report.trial.answer.sentence import Phrase, Sentence, degrees
from myomorph.lab.report.trial.answer.stride_poses import stance_poses
from myomorph.lab.report.trial.prepared import Prepared


def walk(prepared: Prepared, use: Use) -> MainResult | None:
    """Knee, hip and ankle of both sides; None where strides of two legs were not seen."""
    gait = prepared.gait
    strides = prepared.strides
    if gait is None or strides is None:
        return None
    knee = stride_curve(gait, "knee_flexion")
    hip = stride_curve(gait, "hip_flexion")
    ankle = stride_curve(gait, "ankle_dorsiflexion")
    push = stride_curve(gait, "ankle_moment", "Ankle push-off moment", "N·m/kg", digits=1)
    if knee is None or hip is None:
        return None
    load = knee_load_curve(prepared, gait) if use == "everything" else None
    if load is not None:
        sentence = _of_load(load)
        curves = [load, knee, hip]
    elif push is not None and use in ("everything", "angles and torques"):
        sentence = _of_push(knee, push)
        curves = [push, knee, hip]
    else:
        others = [curve for curve in (hip, ankle) if curve is not None]
        sentence = _of_angles(knee, others)
        curves = [knee, *others]
    speed = sum(stride.speed for stride in strides.strides) / len(strides.strides)
    return MainResult(
        movement="Walking",
        sentence=sentence,
        caveat=few_strides_note(gait),
        curves=tuple(curves),
        poses=stance_poses(gait, strides, "push-off"),
        axis=PERCENT,
        amount=f"{speed:.2f}\u00a0m/s, {counted_strides(gait)}",
        lift=mean_lift(gait),
    )


def _of_load(load: AnswerCurve) -> Sentence:
    """How hard each knee is pressed, and when the first one most."""
    first, *second = load.sides
    peak = f"{first.value(first.highest):.1f} body weights at most"
    when = f"at {load.at[first.highest]:.0f}\u00a0% of the stride"
    begin = Phrase(f"{first.label.capitalize()} knee: {peak}", first.side)
    if not second:
        return Sentence.of(begin, f", {when}.")
    other = second[0]
    value = f"{other.label} {other.value(other.highest):.1f}"
    return Sentence.of(begin, f", {when}; ", Phrase(value, other.side), ".")


def _of_angles(knee: AnswerCurve, others: list[AnswerCurve]) -> Sentence:
    """How far the knees bend, and by how much the other joints differ between the sides."""
    first, *second = knee.sides
    peak = degrees(first.value(first.highest))
    begin = (Phrase("The "), Phrase(f"{first.label} knee bends {peak}", first.side))
    if not second:
        return Sentence.of(*begin, " in swing.")
    other = second[0]
    both = Phrase(f"{other.label} {degrees(other.value(other.highest))}", other.side)
    gap = max((_largest_gap(curve) for curve in others), default=0.0)
    names = "hips and ankles" if len(others) > 1 else "the hips"
    end = f"; peaks of {names} differ by {degrees(gap)} at most."
    return Sentence.of(*begin, " in swing, the ", both, end)


def _of_push(knee: AnswerCurve, push: AnswerCurve) -> Sentence:
    """How strongly the ankles push off, and how far the knees bend."""
    first, *second = push.sides
    strongest = f"{first.value(first.highest):.1f}\u00a0N·m/kg"
    begin = (Phrase("The "), Phrase(f"{first.label} ankle pushes off with {strongest}", first.side))
    middle: tuple[Phrase | str, ...] = ()
    if second:
        value = f"{second[0].value(second[0].highest):.1f}"
        middle = (", the ", Phrase(f"{second[0].label} with {value}", second[0].side))
    bends = [degrees(side.value(side.highest)) for side in knee.sides]
    bent = (
        f"the knees bend {' and '.join(bends)}" if len(bends) > 1 else f"the knee bends {bends[0]}"
    )
    return Sentence.of(*begin, *middle, f"; {bent} in swing.")


def _largest_gap(curve: AnswerCurve) -> float:
    """By how much highest and lowest values of both sides differ at most; 0 for one side."""
    if len(curve.sides) < 2:
        return 0.0
    right = curve.sides[0].mean
    left = curve.sides[1].mean
    highest = abs(float(np.nanmax(right)) - float(np.nanmax(left)))
    lowest = abs(float(np.nanmin(right)) - float(np.nanmin(left)))
    return max(highest, lowest)
