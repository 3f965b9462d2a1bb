"""The main result of a run."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import numpy as np

from myomorph.core.model.cycle_samples import SAMPLES
from myomorph.core.model.series import Series
from myomorph.lab.analysis.cycles import over_cycles
from myomorph.lab.analysis.gait_curves import SIDES, GaitCurves, WalkLoads, gait_curves
from myomorph.lab.movements.part import MovementNumbers
from myomorph.lab.movements.quantities import PEAK_VERTICAL_FORCE
from myomorph.lab.movements.recorded_movement import NEAR, support_force
from myomorph.lab.movements.support_force import SupportForce
from myomorph.lab.report.trial.answer.answer_curve import AnswerCurve, SideCurve
from myomorph.lab.report.trial.answer.judgement import Use
from myomorph.lab.report.trial.answer.main_result import MainResult
from myomorph.lab.report.trial.answer.over_cycle import (
    PERCENT,
    counted_strides,
    few_strides_note,
    mean_lift,
    stride_curve,
)
from myomorph.lab.report.trial.answer.sentence import Phrase, Sentence, Side, degrees
from myomorph.lab.report.trial.answer.stride_poses import stance_poses
from myomorph.lab.report.trial.prepared import Prepared


def run(prepared: Prepared, use: Use) -> MainResult | None:
    """Force on each foot, and the knee; None where strides of two legs were not seen."""
    results = prepared.results
    motion = results.kinematics.motion or results.dynamics.motion
    strides = prepared.strides
    if results.model is None or motion is None or strides is None:
        return None
    dynamics = results.dynamics
    loads = WalkLoads(
        torques=dynamics.torques,
        filtered=dynamics.motion,
        wrenches=dynamics.wrenches,
        measured=dynamics.measured,
    )
    gait = gait_curves(results.model, motion, strides, loads)
    if gait is None:
        return None
    knee = stride_curve(gait, "knee_flexion")
    hip = stride_curve(gait, "hip_flexion")
    ankle = stride_curve(gait, "ankle_dorsiflexion")
    force = _force_curve(prepared, gait)
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


def _force_curve(prepared: Prepared, gait: GaitCurves) -> AnswerCurve | None:
    """Return the vertical force on each foot as measured, over the strides that plates carried."""
    recorded = prepared.recorded_movement
    numbers = prepared.movement_numbers
    force = None if recorded is None else support_force(recorded)
    if force is None or numbers is None:
        return stride_curve(gait, "vertical_force", digits=1)
    found = (_measured_side(force, numbers, gait, side) for side in SIDES)
    sides = tuple(side for side in found if side is not None)
    if not sides:
        return None
    return AnswerCurve(
        title="Vertical force",
        unit="body weights",
        sides=sides,
        at=np.linspace(0.0, 100.0, SAMPLES),
        digits=1,
    )


def _measured_side(
    force: SupportForce, numbers: MovementNumbers, gait: GaitCurves, side: str
) -> SideCurve | None:
    """Return the force on one foot over the strides whose stance plates measured whole."""
    own = force.of_side(side)
    parts = [part for part in numbers.parts if part.side == side]
    peaks = {part.start: part.number(PEAK_VERTICAL_FORCE) for part in parts}
    starts = [start for start, peak in peaks.items() if np.isfinite(peak)]
    spans = [
        (stride.start, stride.stop)
        for stride in gait.strides[side]
        if any(abs(stride.start - start) < NEAR for start in starts)
    ]
    if own is None or not spans:
        return None
    series = Series(force.time, (side,), own[:, None] / force.weight)
    cycles = over_cycles(series, spans, SAMPLES).values[:, :, 0]
    peak = float(np.nanmean(list(peaks.values())))
    curve = SideCurve(side=cast(Side, side), label=side, cycles=cycles, peak=peak)
    return replace(curve, mark=curve.highest)


def _of_force(force: AnswerCurve) -> Sentence:
    """With how many body weights each foot meets the ground."""
    first, *second = force.sides
    peak = f"{first.highest_value:.1f}"
    begin = Phrase(f"The {first.label} foot lands with {peak} body weights", first.side)
    if not second:
        return Sentence.of(begin, " at most.")
    other = second[0]
    return Sentence.of(
        begin,
        " at most, ",
        Phrase(f"the {other.label} with {other.highest_value:.1f}", other.side),
        ".",
    )


def _of_knees(knee: AnswerCurve) -> Sentence:
    """How far the knees bend in swing."""
    parts: list[Phrase | str] = []
    for side in knee.sides:
        words = f"the {side.label} knee bends {degrees(side.value(side.highest))}"
        parts += [", " if parts else "", Phrase(words if parts else words.capitalize(), side.side)]
    return Sentence.of(*parts, " in swing.")
