"""The main result of a jump."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.lab.analysis.gait_curves import SIDES
from myomorph.lab.report.answer.answer_curve import AnswerCurve
from myomorph.lab.report.answer.joints import extension_moment, joint_angle
from myomorph.lab.report.answer.judgement import Use
from myomorph.lab.report.answer.main_result import KeyPose, MainResult
from myomorph.lab.report.answer.over_time import SECONDS, time_curve
from myomorph.lab.report.answer.sentence import Sentence, degrees, with_unit
from myomorph.lab.report.trial.prepared import Prepared

HEIGHT = "Jump height from take-off velocity"
LANDING = "Peak force of landing"
STANDING = "Body weight on the plates"
EVENTS = ("Lowest point", "Take-off", "Landing")


def jump(prepared: Prepared, use: Use) -> MainResult | None:
    """Height and landing; None where forces show no jump."""
    results = prepared.results
    motion = results.dynamics.motion or results.kinematics.motion
    measures = {measure.name: measure.value for measure in prepared.ground.measures}
    times = {event.label: event.time for event in prepared.ground.events}
    needed = {"Take-off", "Landing"} <= set(times) and HEIGHT in measures
    if not needed or results.model is None or motion is None:
        return None
    torques = results.dynamics.torques if use in ("everything", "angles and torques") else None
    angles = {side: joint_angle(results.model, motion, "knee_flexion", side) for side in SIDES}
    hips = {side: joint_angle(results.model, motion, "hip_flexion", side) for side in SIDES}
    moments = {
        side: extension_moment(results.model, torques, "knee_flexion", side) for side in SIDES
    }
    clock = motion.time if torques is None else torques.time
    times |= _deepest(angles, motion.time, times["Take-off"])
    start = max(times.get("Onset", times["Lowest point"] - 1.0) - 0.1, prepared.span[0])
    span = (start, min(times["Landing"] + 0.5, prepared.span[1]))
    curves = (
        _force_curve(prepared, measures[STANDING], span),
        time_curve("Knee extension torque", "N·m", clock, moments, span),
        time_curve("Knee flexion", "°", motion.time, angles, span, times["Lowest point"]),
        time_curve("Hip flexion", "°", motion.time, hips, span, times["Lowest point"]),
    )
    return MainResult(
        movement="Countermovement jump",
        sentence=_sentence(measures, angles, motion.time, times["Take-off"]),
        caveat="The height is that of the take-off velocity, by the impulse on the plates.",
        curves=tuple(curve for curve in curves if curve is not None)[:3],
        poses=tuple(
            KeyPose(times[event], event.lower(), times[event]) for event in EVENTS if event in times
        ),
        axis=SECONDS,
        amount=f"flies {with_unit(measures['Flight time'], 's', 2)}",
    )


def _force_curve(
    prepared: Prepared, weight: float, span: tuple[float, float]
) -> AnswerCurve | None:
    """Vertical force on the ground in body weights."""
    wrenches = prepared.results.dynamics.wrenches
    if wrenches is None:
        return None
    total = np.nan_to_num(wrenches.forces @ prepared.up).sum(axis=1) / weight
    return time_curve(
        "Vertical force",
        "body weights",
        wrenches.time,
        {"": total},
        span,
        digits=1,
        middle="plates",
    )


def _deepest(angles: Mapping[str, Array | None], time: Array, off: float) -> dict[str, float]:
    """When the knees are bent most before take-off, by the name of its event [s]."""
    known = [angle for angle in angles.values() if angle is not None]
    before = np.flatnonzero(time <= off)
    if not known or not len(before):
        return {}
    bend = np.mean(known, axis=0)[before]
    return {"Lowest point": float(time[before[int(np.nanargmax(bend))]])}


def _sentence(
    measures: Mapping[str, float], angles: Mapping[str, Array | None], time: Array, off: float
) -> Sentence:
    """How high, how hard, and how deep before."""
    high = with_unit(100.0 * measures[HEIGHT], "cm")
    land = measures[LANDING] / measures[STANDING]
    begin = f"Jumps {high} high and lands with {land:.1f} body weights"
    before = [angle[time <= off] for angle in angles.values() if angle is not None]
    if not before or not before[0].size:
        return Sentence.of(f"{begin}.")
    bends = degrees(float(np.nanmax(np.mean(before, axis=0))))
    return Sentence.of(f"{begin}; the knee bends {bends} before take-off.")
