"""The main result of a squat, or of rising from a seat."""

from __future__ import annotations

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.lab.analysis.gait_curves import SIDES
from myomorph.lab.report.answer.joints import extension_moment, joint_angle, low_back_moment
from myomorph.lab.report.answer.judgement import Use
from myomorph.lab.report.answer.main_result import KeyPose, MainResult
from myomorph.lab.report.answer.over_time import SECONDS, time_curve
from myomorph.lab.report.answer.sentence import Sentence, degrees, with_unit
from myomorph.lab.report.trial.prepared import Prepared

MOVED = 0.02
"""A squat has begun where the knees bend by so large a share of their deepest bend."""


ALIKE = 1.0
"""Torques of both knees that differ by less are not said to differ [N m]."""


def squat(prepared: Prepared, use: Use) -> MainResult | None:
    """Knees and low back at the deepest point; None for a model without knees."""
    results = prepared.results
    motion = results.dynamics.motion or results.kinematics.motion
    model = results.model
    if model is None or motion is None:
        return None
    angles = {side: joint_angle(model, motion, "knee_flexion", side) for side in SIDES}
    known = [angle for angle in angles.values() if angle is not None]
    if not known or not np.isfinite(known[0]).any():
        return None
    bend = np.mean(known, axis=0)
    deepest = int(np.nanargmax(bend))
    time = motion.time
    torques = results.dynamics.torques if use in ("everything", "angles and torques") else None
    moments = {side: extension_moment(model, torques, "knee_flexion", side) for side in SIDES}
    back = low_back_moment(torques)
    clock = time if torques is None else torques.time
    at = float(time[deepest])
    hips = {side: joint_angle(model, motion, "hip_flexion", side) for side in SIDES}
    curves = [time_curve("Knee flexion", "°", time, angles, prepared.span, at)]
    if torques is None:
        curves.append(time_curve("Hip flexion", "°", time, hips, prepared.span, at))
    curves.append(time_curve("Knee extension torque", "N·m", clock, moments, prepared.span, at))
    curves.append(
        time_curve("Low-back extension torque", "N·m", clock, {"": back}, prepared.span, at)
    )
    carried = [_value(clock, moment, at) for moment in moments.values() if moment is not None]
    rising = results.recorded.movement.value == "rising"
    return MainResult(
        movement="Rising from a seat" if rising else "Squat",
        sentence=_sentence(float(bend[deepest]), carried, back, clock, at),
        caveat=_caveat(carried, model.mass),
        curves=tuple(curve for curve in curves if curve is not None)[:3],
        poses=_poses(time, bend, deepest),
        axis=SECONDS,
        amount=with_unit(prepared.span[1] - prepared.span[0], "s", 1),
    )


def _sentence(
    bend: float, carried: list[float], back: Array | None, clock: Array, at: float
) -> Sentence:
    """What knees and low back do at the deepest point."""
    begin = f"At the deepest point the knees bend {degrees(bend)}"
    if not carried:
        return Sentence.of(f"{begin}.")
    loads = f"; each carries {with_unit(float(np.mean(carried)), 'N·m')}"
    if back is None:
        return Sentence.of(f"{begin}{loads}.")
    trunk = with_unit(_value(clock, back, at), "N·m")
    return Sentence.of(f"{begin}{loads}, the low back {trunk}.")


def _caveat(carried: list[float], mass: float) -> str:
    """The knees' torque per body mass, and how far both sides agree."""
    if not carried or mass <= 0.0:
        return ""
    share = with_unit(float(np.mean(carried)) / mass, "N·m", 2)
    apart = float(np.ptp(carried))
    if apart < ALIKE:
        return f"{share} per kg of body."
    return f"{share} per kg of body; the knees differ by {with_unit(apart, 'N·m')}."


def _poses(time: Array, bend: Array, deepest: int) -> tuple[KeyPose, ...]:
    """Before it begins, half way and deepest."""
    low = float(np.nanmin(bend[: deepest + 1]))
    high = float(bend[deepest])
    before = bend[: deepest + 1]
    upright = np.flatnonzero(before <= low + MOVED * (high - low))
    half = np.flatnonzero(before <= low + 0.5 * (high - low))
    frames = (int(upright[-1]), int(half[-1]), deepest)
    words = ("standing", "half way", "deepest")
    return tuple(
        KeyPose(float(time[frame]), word, float(time[frame]))
        for frame, word in zip(frames, words, strict=True)
    )


def _value(clock: Array, values: Array, at: float) -> float:
    """The value at a time."""
    return float(np.interp(at, clock, values))
