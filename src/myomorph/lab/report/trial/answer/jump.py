"""The main result of a jump."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion
from myomorph.lab.analysis.gait_curves import SIDES
from myomorph.lab.analysis.sagittal_joints import extension_moment, joint_angle
from myomorph.lab.report.trial.answer.answer_curve import AnswerCurve, SideCurve
from myomorph.lab.report.trial.answer.judgement import Use
from myomorph.lab.report.trial.answer.main_result import KeyPose, MainResult
from myomorph.lab.report.trial.answer.over_time import SAMPLES, SECONDS, Heading, time_curve
from myomorph.lab.report.trial.answer.seen_jump import SeenJump, seen_jump
from myomorph.lab.report.trial.answer.sentence import NO_BREAK, Sentence, degrees, with_unit
from myomorph.lab.report.trial.prepared import Prepared

BEFORE = 1.0
"""Charts begin so long before the lowest point where no onset was seen [s]."""
LEAD = 0.1
"""They begin so long before the onset [s], ..."""
AFTER = 0.5
"""... and end so long after the landing [s]."""
ALIKE = 5.0
"""A landing that is so near to even is not said to lean to a side [%]."""


@dataclass(frozen=True, kw_only=True)
class JumpInstants:
    """When a jump does what [s].

    Attributes
    ----------
    onset : of the movement, NaN where it was not seen
    lowest : knees bent most before take-off
    off, landing : feet leave the ground, and meet it again
    """

    onset: float
    lowest: float
    off: float
    landing: float

    def span(self, whole: tuple[float, float]) -> tuple[float, float]:
        """Return from when to when charts show it, within the whole recording [s]."""
        start = self.onset - LEAD if np.isfinite(self.onset) else self.lowest - BEFORE
        return max(start, whole[0]), min(self.landing + AFTER, whole[1])

    @property
    def poses(self) -> tuple[KeyPose, ...]:
        """Lowest point, take-off and landing."""
        times = (self.lowest, self.off, self.landing)
        words = ("lowest point", "take-off", "landing")
        return tuple(KeyPose(time, word, time) for time, word in zip(times, words, strict=True))


def jump(prepared: Prepared, use: Use) -> MainResult | None:
    """Return height, landing and knees; None where forces show no jump, or no knee was seen."""
    results = prepared.results
    motion = results.dynamics.motion or results.kinematics.motion
    seen = seen_jump(prepared)
    if seen is None or results.model is None or motion is None:
        return None
    knees = {side: joint_angle(results.model, motion, "knee_flexion", side) for side in SIDES}
    bend = _bend_before(seen, knees, motion.time)
    if bend is None:
        return None
    instants = JumpInstants(
        onset=seen.onset,
        lowest=float(motion.time[int(np.nanargmax(bend))]),
        off=seen.off,
        landing=seen.land,
    )
    return MainResult(
        movement="Drop jump" if seen.drops else "Countermovement jump",
        sentence=_sentence(seen, float(np.nanmax(bend)), knees),
        caveat=_caveat(seen),
        curves=_curves(prepared, use, motion, seen, instants),
        poses=instants.poses,
        axis=SECONDS,
        amount=f"flies {with_unit(seen.land - seen.off, 's', 2)}",
    )


def _bend_before(seen: SeenJump, knees: Mapping[str, Array | None], time: Array) -> Array | None:
    """Return the mean flexion of the knees before take-off, and none after it.

    Returns
    -------
    (frames,) [degrees], NaN outside of the push-off; None where no knee was seen in it
    """
    known = [angle for angle in knees.values() if angle is not None]
    if not known:
        return None
    inside = time <= seen.off
    if np.isfinite(seen.onset):
        inside &= time >= seen.onset
    bend = np.where(inside, np.mean(known, axis=0), np.nan)
    return np.asarray(bend) if np.isfinite(bend).any() else None


def _curves(
    prepared: Prepared, use: Use, motion: Motion, seen: SeenJump, instants: JumpInstants
) -> tuple[AnswerCurve, ...]:
    """Return the force on the plates, the knees, and their torque where it may be used."""
    model = prepared.results.model
    assert model is not None
    span = instants.span(prepared.span)
    force = _force_curve(seen, span)
    torque = _torque_curve(prepared, model, span) if use not in ("angles", "nothing") else None
    knees = {side: joint_angle(model, motion, "knee_flexion", side) for side in SIDES}
    bend = time_curve(Heading("Knee flexion", "°"), motion.time, knees, span, instants.lowest)
    flexion = {side: joint_angle(model, motion, "hip_flexion", side) for side in SIDES}
    hips = time_curve(Heading("Hip flexion", "°"), motion.time, flexion, span, instants.lowest)
    shown = [curve for curve in (force, torque, bend, hips) if curve is not None]
    return tuple(shown[:3])


def _force_curve(seen: SeenJump, span: tuple[float, float]) -> AnswerCurve | None:
    """Return the force on the plates, with the very sample of its peak, that of the sentence."""
    inside = (seen.time >= span[0]) & (seen.time <= span[1])
    if not inside.any():
        return None
    time = seen.time[inside]
    force = seen.force[inside]
    peak = float(time[int(np.argmax(force))])
    at = np.unique(np.concatenate([np.linspace(time[0], time[-1], SAMPLES), [peak]]))
    mark = int(np.searchsorted(at, peak))
    cycles = np.interp(at, time, force)[None]
    side = SideCurve(side="", label="plates", cycles=cycles, mark=mark)
    return AnswerCurve(title="Vertical force", unit="body weights", sides=(side,), at=at, digits=1)


def _torque_curve(
    prepared: Prepared, model: Model, span: tuple[float, float]
) -> AnswerCurve | None:
    """Return the extension torque of the knees."""
    torques = prepared.results.dynamics.torques
    if torques is None:
        return None
    moments = {side: extension_moment(model, torques, "knee_flexion", side) for side in SIDES}
    return time_curve(Heading("Knee extension torque", "N·m"), torques.time, moments, span)


def _sentence(seen: SeenJump, bend: float, knees: Mapping[str, Array | None]) -> Sentence:
    """Say how high, and how hard or how fast."""
    high = with_unit(100.0 * seen.height, "cm")
    if seen.drops:
        ground = with_unit(seen.contact, "s", 2)
        index = with_unit(seen.index, "m/s", 2)
        return Sentence.of(
            f"Jumps {high} high after {ground} on the ground:",
            f" a reactive strength index of {index}.",
        )
    plural = sum(angle is not None for angle in knees.values()) > 1
    knees_bend = "knees bend" if plural else "knee bends"
    bends = f"the {knees_bend} {degrees(bend)} before take-off"
    if not np.isfinite(seen.landing):
        return Sentence.of(f"Jumps {high} high; {bends}.")
    return Sentence.of(f"Jumps {high} high and lands with {_landing(seen)}; {bends}.")


def _landing(seen: SeenJump) -> str:
    """Return the force of landing, and the side that it leans to."""
    force = f"{seen.landing:.1f} body weights"
    if not np.isfinite(seen.right) or abs(seen.right - 50.0) < ALIKE:
        return force
    share = max(seen.right, 100.0 - seen.right)
    side = "right" if seen.right > 50.0 else "left"
    return f"{force}, {share:.0f}{NO_BREAK}% on the {side}"


def _caveat(seen: SeenJump) -> str:
    """Say what the height is known by."""
    known = (
        "The height is that of the take-off velocity, by the impulse on the plates."
        if seen.by_impulse
        else "The height is that of the flight time: landing with bent legs adds to it."
    )
    return known if seen.count == 1 else f"{known} The highest of {seen.count} jumps."
