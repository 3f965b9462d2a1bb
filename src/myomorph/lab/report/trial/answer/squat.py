"""The main result of a squat."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion, Series
from myomorph.lab.analysis.gait_curves import SIDES
from myomorph.lab.analysis.sagittal_joints import extension_moment, joint_angle, low_back_moment
from myomorph.lab.report.trial.answer.answer_curve import AnswerCurve
from myomorph.lab.report.trial.answer.judgement import Use
from myomorph.lab.report.trial.answer.main_result import KeyPose, MainResult
from myomorph.lab.report.trial.answer.over_time import SECONDS, Heading, time_curve
from myomorph.lab.report.trial.answer.sentence import Sentence, degrees, with_unit
from myomorph.lab.report.trial.prepared import Prepared

WITH_TORQUES: tuple[Use, ...] = ("everything", "angles and torques")
MOVED = 0.02
"""A squat has begun where the knees bend by so large a share of their deepest bend."""
ALIKE = 1.0
"""Torques of both knees that differ by less are not said to differ [N m]."""


@read_only
class Bending:
    """Joints of a squat over time.

    Attributes
    ----------
    time : (frames,) of the motion [s]
    knees, hips : (frames,) flexion by side [degrees], None where the model has no such joint
    clock : (samples,) of the torques [s]
    moments : (samples,) extension moment of the knee by side [N m], None where it is not known
    back : (samples,) moment of the low back [N m], None where it is not known
    """

    time: Array
    knees: Mapping[str, Array | None]
    hips: Mapping[str, Array | None]
    clock: Array
    moments: Mapping[str, Array | None]
    back: Array | None

    @classmethod
    def of(cls, model: Model, motion: Motion, torques: Series | None) -> Bending:
        """Joints of a model in a motion; `torques` None where they are not to be used."""
        moments = {side: extension_moment(model, torques, "knee_flexion", side) for side in SIDES}
        return cls(
            time=motion.time,
            knees={side: joint_angle(model, motion, "knee_flexion", side) for side in SIDES},
            hips={side: joint_angle(model, motion, "hip_flexion", side) for side in SIDES},
            clock=motion.time if torques is None else torques.time,
            moments=moments,
            back=low_back_moment(torques),
        )

    @property
    def bend(self) -> Array | None:
        """(frames,) mean flexion of the knees [degrees], None where no knee is known."""
        known = [angle for angle in self.knees.values() if angle is not None]
        if not known or not np.isfinite(known[0]).any():
            return None
        return np.asarray(np.mean(known, axis=0))

    def carried(self, at: float) -> list[float]:
        """Return the moments of the knees that are known, at a time [N m]."""
        given = (moment for moment in self.moments.values() if moment is not None)
        found = [float(np.interp(at, self.clock, moment)) for moment in given]
        return [moment for moment in found if np.isfinite(moment)]


def squat(prepared: Prepared, use: Use) -> MainResult | None:
    """Return knees and low back at the deepest point; None for a model without knees."""
    results = prepared.results
    motion = results.dynamics.motion or results.kinematics.motion
    if results.model is None or motion is None:
        return None
    torques = results.dynamics.torques if use in WITH_TORQUES else None
    bending = Bending.of(results.model, motion, torques)
    bend = bending.bend
    if bend is None:
        return None
    deepest = int(np.nanargmax(bend))
    at = float(motion.time[deepest])
    numbers = prepared.movement_numbers
    count = len(numbers.parts) if numbers is not None and numbers.one == "repetition" else 1
    return MainResult(
        movement="Squat",
        sentence=_sentence(bending, float(bend[deepest]), at, count),
        caveat=_caveat(bending.carried(at), results.model.mass),
        curves=bending_curves(bending, prepared.span, at),
        poses=_poses(bending.time, bend, deepest),
        axis=SECONDS,
        amount=with_unit(prepared.span[1] - prepared.span[0], "s", 1),
    )


def bending_curves(
    bending: Bending, span: tuple[float, float], at: float
) -> tuple[AnswerCurve, ...]:
    """Return knees, and their torque and that of the low back, or hips where there is none.

    Parameters
    ----------
    bending : of the joints
    span : first and last time that is drawn [s]
    at : when values are printed [s]
    """
    time = bending.time
    clock = bending.clock
    trunk = {"": bending.back}
    knees = time_curve(Heading("Knee flexion", "°"), time, bending.knees, span, at)
    hips = time_curve(Heading("Hip flexion", "°"), time, bending.hips, span, at)
    moments = time_curve(Heading("Knee extension torque", "N·m"), clock, bending.moments, span, at)
    back = time_curve(Heading("Low-back extension torque", "N·m"), clock, trunk, span, at)
    shown = (knees, moments, back) if moments is not None else (knees, hips)
    return tuple(curve for curve in shown if curve is not None)


def _sentence(bending: Bending, bend: float, at: float, count: int) -> Sentence:
    """Say what knees and low back do at the deepest point of all repetitions."""
    where = "the deepest point" if count == 1 else f"the deepest of {count} squats"
    begin = f"At {where} the knees bend {degrees(bend)}"
    carried = bending.carried(at)
    if not carried:
        return Sentence.of(f"{begin}.")
    loads = f"; each carries {with_unit(float(np.mean(carried)), 'N·m')}"
    back = np.nan if bending.back is None else float(np.interp(at, bending.clock, bending.back))
    if not np.isfinite(back):
        return Sentence.of(f"{begin}{loads}.")
    trunk = with_unit(back, "N·m")
    return Sentence.of(f"{begin}{loads}, the low back {trunk}.")


def _caveat(carried: list[float], mass: float) -> str:
    """Return the knees' torque per body mass, and how far both sides differ."""
    if not carried or mass <= 0.0:
        return ""
    share = with_unit(float(np.mean(carried)) / mass, "N·m", 2)
    apart = float(np.ptp(carried))
    if apart < ALIKE:
        return f"{share} per kg of body."
    return f"{share} per kg of body; the knees differ by {with_unit(apart, 'N·m')}."


def _poses(time: Array, bend: Array, deepest: int) -> tuple[KeyPose, ...]:
    """Return the poses before it begins, half way and deepest."""
    before = bend[: deepest + 1]
    low = float(np.nanmin(before))
    depth = float(bend[deepest]) - low
    upright = np.flatnonzero(before <= low + MOVED * depth)
    half = np.flatnonzero(before <= low + 0.5 * depth)
    frames = (int(upright[-1]), int(half[-1]), deepest)
    words = ("standing", "half way", "deepest")
    return tuple(
        KeyPose(float(time[frame]), word, float(time[frame]))
        for frame, word in zip(frames, words, strict=True)
    )
