"""The main result of a run."""

from __future__ import annotations

from myomorph.lab.analysis.gait_curves import gait_curves
from myomorph.lab.report.trial.answer.answer_curve import AnswerCurve
from myomorph.lab.report.trial.answer.judgement import Use
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


def run(prepared: Prepared, use: Use) -> MainResult | None:
    """Force on each foot, and the knee; None where strides of two legs were not seen."""
    results = prepared.results
    motion = results.dynamics.motion or results.kinematics.motion
    strides = prepared.strides
    if results.model is None or motion is None or strides is None:
        return None
    dynamics = results.dynamics
    gait = gait_curves(results.model, motion, strides, dynamics.torques, dynamics.wrenches)
    if gait is None:
        return None
    knee = stride_curve(gait, "knee_flexion")
    hip = stride_curve(gait, "hip_flexion")
    ankle = stride_curve(gait, "ankle_dorsiflexion")
    force = stride_curve(gait, "vertical_force", digits=1)
    if knee is None:
        return None
    measured = force is not None and use != "nothing"
    curves = (force, knee, ankle) if measured else (knee, ankle, hip)
    sentence = _of_force(force) if force is not None and measured else _of_knees(knee)
    speed = sum(stride.speed for stride in strides.strides) / len(strides.strides)
    return MainResult(
        movement="Running",
        sentence=sentence,
        caveat=few_strides_note(gait),
        curves=tuple(curve for curve in curves if curve is not None),
        poses=stance_poses(gait, strides, "toe off"),
        axis=PERCENT,
        amount=f"{speed:.2f}\u00a0m/s, {counted_strides(gait)}",
        lift=mean_lift(gait),
    )


def _of_force(force: AnswerCurve) -> Sentence:
    """With how many body weights each foot meets the ground."""
    first, *second = force.sides
    peak = f"{first.value(first.highest):.1f}"
    begin = Phrase(f"The {first.label} foot lands with {peak} body weights", first.side)
    if not second:
        return Sentence.of(begin, " at most.")
    other = second[0]
    return Sentence.of(
        begin,
        " at most, ",
        Phrase(f"the {other.label} with {other.value(other.highest):.1f}", other.side),
        ".",
    )


def _of_knees(knee: AnswerCurve) -> Sentence:
    """How far the knees bend in swing."""
    parts: list[Phrase | str] = []
    for side in knee.sides:
        words = f"the {side.label} knee bends {degrees(side.value(side.highest))}"
        parts += [", " if parts else "", Phrase(words if parts else words.capitalize(), side.side)]
    return Sentence.of(*parts, " in swing.")
