"""The main result of rising from a seat."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.lab.movements import quantities as of
from myomorph.lab.movements.body_curves import BodyCurves
from myomorph.lab.movements.part import MovementNumbers, Part
from myomorph.lab.movements.recorded_movement import body_curves
from myomorph.lab.report.trial.answer.answer_curve import AnswerCurve
from myomorph.lab.report.trial.answer.judgement import Use
from myomorph.lab.report.trial.answer.main_result import KeyPose, MainResult
from myomorph.lab.report.trial.answer.over_time import Heading, time_curve
from myomorph.lab.report.trial.answer.sentence import Sentence, degrees, with_unit
from myomorph.lab.report.trial.answer.squat import (
    WITH_TORQUES,
    Bending,
    bending_curves,
    squat,
)
from myomorph.lab.report.trial.prepared import Prepared

TIMES = ("", "once", "twice")
AIR = 0.7
"""Curves begin so long before the first rise and end so long after it [s]."""


def rise(prepared: Prepared, use: Use) -> MainResult | None:
    """Return how often and how fast, and the first rise; as a squat where no rise was seen."""
    bent = squat(prepared, use)
    numbers = prepared.movement_numbers
    recorded = prepared.recorded_movement
    curves = None if recorded is None else body_curves(recorded)
    if bent is None or numbers is None or curves is None or numbers.one != "rise":
        return bent
    first = numbers.parts[0]
    return replace(
        bent,
        movement="Rising from a seat",
        sentence=_sentence(numbers, use),
        caveat=_caveat(numbers),
        curves=_curves(prepared, use, curves, first),
        poses=_poses(first, curves.time),
    )


def _curves(
    prepared: Prepared, use: Use, curves: BodyCurves, first: Part
) -> tuple[AnswerCurve, ...]:
    """Return trunk, knees and what they carry, over the first rise."""
    results = prepared.results
    motion = results.dynamics.motion or results.kinematics.motion
    assert results.model is not None
    assert motion is not None
    start, stop = prepared.span
    span = (max(start, first.start - AIR), min(stop, first.stop + AIR))
    torques = results.dynamics.torques if use in WITH_TORQUES else None
    bending = Bending.of(results.model, motion, torques)
    joints = bending_curves(bending, span, first.phases[-1].start)
    if curves.lean is None:
        return joints
    lean = time_curve(Heading("Trunk and vertical", "°"), curves.time, {"": curves.lean}, span)
    return joints if lean is None else (lean, *joints[:2])


def _sentence(numbers: MovementNumbers, use: Use) -> Sentence:
    """Say how often, how fast, and how far the trunk leans or what knees carry."""
    count = len(numbers.parts)
    times = TIMES[count] if count < len(TIMES) else f"{count} times"
    lasting = numbers.summary(of.RISE_TIME, "") or numbers.summary(of.EXTENSION_TIME, "")
    lean = numbers.summary(of.TRUNK_LEAN, "")
    begin = f"Rises {times}"
    if lasting is not None:
        each = ", each in " if count > 1 else " in "
        begin += f"{each}{with_unit(lasting.mean, 's', 1)}"
    if lean is not None:
        begin += f"; the trunk leans {degrees(lean.mean)} forward"
    moments = [numbers.summary(of.KNEE_MOMENT_RIGHT, ""), numbers.summary(of.KNEE_MOMENT_LEFT, "")]
    known = [moment.mean for moment in moments if moment is not None]
    if use in WITH_TORQUES and known:
        begin += f", each knee carries {with_unit(float(np.mean(known)), 'N·m/kg', 1)}"
    return Sentence.of(f"{begin}.")


def _caveat(numbers: MovementNumbers) -> str:
    """Say how long several rises take together, from the first to the last."""
    if len(numbers.parts) < 2:
        return ""
    whole = numbers.parts[-1].stop - numbers.parts[0].start
    return f"From the first lean to the last standing: {with_unit(whole, 's', 1)}."


def _poses(part: Part, time: Array) -> tuple[KeyPose, ...]:
    """Return the poses of the first rise: on the seat, as it is left, and standing."""
    off = part.phases[-1].start
    instants = (part.start, off, part.stop)
    words = ("trunk begins to lean", "seat is left", "standing")
    nearest = [float(time[int(np.argmin(np.abs(time - instant)))]) for instant in instants]
    return tuple(KeyPose(at, word, at) for at, word in zip(nearest, words, strict=True))
