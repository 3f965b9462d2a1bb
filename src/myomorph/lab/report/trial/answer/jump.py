"""The main result of a jump."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion
from myomorph.lab.analysis.gait_curves import SIDES
from myomorph.lab.analysis.phases import GroundPhases
from myomorph.lab.report.trial.answer.answer_curve import AnswerCurve
from myomorph.lab.report.trial.answer.joints import extension_moment, joint_angle
from myomorph.lab.report.trial.answer.judgement import Use
from myomorph.lab.report.trial.answer.main_result import KeyPose, MainResult
from myomorph.lab.report.trial.answer.over_time import SECONDS, Heading, time_curve
from myomorph.lab.report.trial.answer.sentence import Sentence, degrees, with_unit
from myomorph.lab.report.trial.prepared import Prepared

HEIGHT = "Jump height from take-off velocity"
LANDING = "Peak force of landing"
STANDING = "Body weight on the plates"
FLIGHT = "Flight time"
BEFORE = 1.0
"""Charts begin so long before the lowest point where no onset was seen [s]."""
LEAD = 0.1
"""They begin so long before the onset [s], ..."""
AFTER = 0.5
"""... and end so long after the landing [s]."""


@dataclass(frozen=True, kw_only=True)
class JumpInstants:
    """When a jump does what [s].

    Attributes
    ----------
    onset : of the movement, None where it was not seen
    lowest : knees bent most before take-off
    off, landing : feet leave the ground, and meet it again
    """

    onset: float | None
    lowest: float
    off: float
    landing: float

    def span(self, whole: tuple[float, float]) -> tuple[float, float]:
        """Return from when to when charts show it, within the whole recording [s]."""
        start = self.lowest - BEFORE if self.onset is None else self.onset - LEAD
        return max(start, whole[0]), min(self.landing + AFTER, whole[1])

    @property
    def poses(self) -> tuple[KeyPose, ...]:
        """Lowest point, take-off and landing."""
        times = (self.lowest, self.off, self.landing)
        words = ("lowest point", "take-off", "landing")
        return tuple(KeyPose(time, word, time) for time, word in zip(times, words, strict=True))


def jump(prepared: Prepared, use: Use) -> MainResult | None:
    """Return height, landing and knees; None where forces show no jump."""
    results = prepared.results
    motion = results.dynamics.motion or results.kinematics.motion
    measures = {measure.name: measure.value for measure in prepared.ground.measures}
    if HEIGHT not in measures or results.model is None or motion is None:
        return None
    knees = {side: joint_angle(results.model, motion, "knee_flexion", side) for side in SIDES}
    instants = _instants(prepared.ground, knees, motion.time)
    if instants is None:
        return None
    return MainResult(
        movement="Countermovement jump",
        sentence=_sentence(measures, knees, motion.time, instants.off),
        caveat="The height is that of the take-off velocity, by the impulse on the plates.",
        curves=_curves(prepared, use, motion, knees, instants),
        poses=instants.poses,
        axis=SECONDS,
        amount=f"flies {with_unit(measures[FLIGHT], 's', 2)}",
    )


def _instants(
    ground: GroundPhases, knees: Mapping[str, Array | None], time: Array
) -> JumpInstants | None:
    """Return when the jump does what; None where its flight, or no knee, was seen."""
    times = {event.label: event.time for event in ground.events}
    known = [angle for angle in knees.values() if angle is not None]
    if not {"Take-off", "Landing"} <= set(times) or not known:
        return None
    off = times["Take-off"]
    before = np.flatnonzero(time <= off)
    bend = np.mean(known, axis=0)[before]
    if not np.isfinite(bend).any():
        return None
    return JumpInstants(
        onset=times.get("Onset"),
        lowest=float(time[before[int(np.nanargmax(bend))]]),
        off=off,
        landing=times["Landing"],
    )


def _curves(
    prepared: Prepared,
    use: Use,
    motion: Motion,
    knees: Mapping[str, Array | None],
    instants: JumpInstants,
) -> tuple[AnswerCurve, ...]:
    """Return the force on the plates, the knees, and their torque where it may be used."""
    model = prepared.results.model
    assert model is not None
    span = instants.span(prepared.span)
    force = _force_curve(prepared, span)
    torque = _torque_curve(prepared, model, span) if use not in ("angles", "nothing") else None
    bend = time_curve(Heading("Knee flexion", "°"), motion.time, knees, span, instants.lowest)
    flexion = {side: joint_angle(model, motion, "hip_flexion", side) for side in SIDES}
    hips = time_curve(Heading("Hip flexion", "°"), motion.time, flexion, span, instants.lowest)
    shown = [curve for curve in (force, torque, bend, hips) if curve is not None]
    return tuple(shown[:3])


def _force_curve(prepared: Prepared, span: tuple[float, float]) -> AnswerCurve | None:
    """Return the vertical force on the ground in body weights."""
    wrenches = prepared.results.dynamics.wrenches
    weight = next((each.value for each in prepared.ground.measures if each.name == STANDING), None)
    if wrenches is None or not weight:
        return None
    total = np.nan_to_num(wrenches.forces @ prepared.up).sum(axis=1) / weight
    heading = Heading("Vertical force", "body weights", digits=1, middle="plates")
    return time_curve(heading, wrenches.time, {"": total}, span)


def _torque_curve(
    prepared: Prepared, model: Model, span: tuple[float, float]
) -> AnswerCurve | None:
    """Return the extension torque of the knees."""
    torques = prepared.results.dynamics.torques
    if torques is None:
        return None
    moments = {side: extension_moment(model, torques, "knee_flexion", side) for side in SIDES}
    return time_curve(Heading("Knee extension torque", "N·m"), torques.time, moments, span)


def _sentence(
    measures: Mapping[str, float], knees: Mapping[str, Array | None], time: Array, off: float
) -> Sentence:
    """Say how high, how hard, and how deep before."""
    high = with_unit(100.0 * measures[HEIGHT], "cm")
    land = measures[LANDING] / measures[STANDING]
    known = [angle[time <= off] for angle in knees.values() if angle is not None]
    bends = degrees(float(np.nanmax(np.mean(known, axis=0))))
    plural = "knees bend" if len(known) > 1 else "knee bends"
    return Sentence.of(
        f"Jumps {high} high and lands with {land:.1f} body weights;",
        f" the {plural} {bends} before take-off.",
    )
