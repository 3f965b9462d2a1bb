"""The main result of a movement that has no words of its own: the joints that move most."""

from __future__ import annotations

from typing import cast

import numpy as np

from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion
from myomorph.lab.analysis.columns import extremes
from myomorph.lab.analysis.selection import Pair, pairs, root_coordinates
from myomorph.lab.report.trial.answer.answer_curve import AnswerCurve
from myomorph.lab.report.trial.answer.judgement import Use
from myomorph.lab.report.trial.answer.main_result import KeyPose, MainResult
from myomorph.lab.report.trial.answer.over_time import SECONDS, Heading, time_curve
from myomorph.lab.report.trial.answer.sentence import Phrase, Sentence, Side, degrees, with_unit
from myomorph.lab.report.trial.prepared import Prepared

SHOWN = 3
SEEN = 1.0
"""Range from which on a joint moves [degrees]."""


def any_movement(prepared: Prepared, use: Use) -> MainResult | None:
    """Return the joints that move most, over time; None where no joint moves."""
    motion = prepared.results.kinematics.motion
    model = prepared.results.model
    if model is None or motion is None or not len(motion):
        return None
    ranges = _ranges(model, motion)
    chosen = sorted(pairs(ranges), key=lambda pair: -_range(pair, ranges))[:SHOWN]
    chosen = [pair for pair in chosen if _range(pair, ranges) > SEEN]
    if not chosen:
        return None
    curves = [_curve(pair, motion, prepared.detail) for pair in chosen]
    movement = prepared.results.recorded.movement.value or "Movement"
    first = max(chosen[0].names, key=lambda name: ranges.get(name, 0.0))
    return MainResult(
        movement=movement.capitalize(),
        sentence=_sentence(chosen, motion, ranges),
        caveat="",
        curves=tuple(curve for curve in curves if curve is not None),
        poses=_poses(motion, first, _words(chosen[0], first), prepared.detail),
        axis=SECONDS,
        amount=with_unit(prepared.span[1] - prepared.span[0], "s", 1),
    )


def _ranges(model: Model, motion: Motion) -> dict[str, float]:
    """How far each joint angle goes [degrees], without those of the root."""
    turning = {
        coordinate.name
        for coordinate in model.coordinates
        if coordinate.motion == "rotational" and coordinate.name not in model.dependent_coordinates
    }
    turning -= {name for group in root_coordinates(model) for name in group}
    return {
        extreme.name: float(np.degrees(extreme.high - extreme.low))
        for extreme in extremes(motion)
        if extreme.name in turning
    }


def _range(pair: Pair, ranges: dict[str, float]) -> float:
    """Of the side that moves more [degrees]."""
    return max((ranges.get(name, 0.0) for name in pair.names), default=0.0)


def _curve(pair: Pair, motion: Motion, span: tuple[float, float]) -> AnswerCurve | None:
    """Return an angle of both sides over time."""
    values = {side: np.degrees(motion[names[0]]) for side, names in pair.members.items() if names}
    return time_curve(Heading(pair.label, "°"), motion.time, values, span)


def _sentence(chosen: list[Pair], motion: Motion, ranges: dict[str, float]) -> Sentence:
    """Between which angles the joint moves that moves most, and the next one."""
    parts: list[Phrase | str] = []
    for pair in chosen[:2]:
        name = max(pair.names, key=lambda each: ranges.get(each, 0.0))
        side = next(side for side, names in pair.members.items() if name in names)
        values = np.degrees(motion[name])
        low = degrees(float(np.nanmin(values)))
        high = degrees(float(np.nanmax(values)))
        words = f"{_words(pair, name)} goes from {low} to {high}"
        parts.append("; " if parts else "")
        parts.append(Phrase(words if len(parts) > 1 else _capital(words), cast(Side, side)))
    return Sentence.of(*parts, ".")


def _capital(words: str) -> str:
    return words[:1].upper() + words[1:]


def _words(pair: Pair, name: str) -> str:
    """Return a coordinate in words, as "right knee angle"."""
    side = next(side for side, names in pair.members.items() if name in names)
    return f"{side} {pair.label.lower()}".strip()


def _poses(motion: Motion, name: str, label: str, span: tuple[float, float]) -> tuple[KeyPose, ...]:
    """Where a joint's angle is lowest, half way and highest, in order of time."""
    inside = np.flatnonzero((motion.time >= span[0]) & (motion.time <= span[1]))
    values = motion[name][inside]
    if not np.isfinite(values).any():
        return ()
    low = int(np.nanargmin(values))
    high = int(np.nanargmax(values))
    between = slice(min(low, high), max(low, high) + 1)
    middle = 0.5 * (values[low] + values[high])
    half = between.start + int(np.nanargmin(np.abs(values[between] - middle)))
    words = {low: f"smallest {label}", half: "half way", high: f"largest {label}"}
    times = {frame: float(motion.time[inside[frame]]) for frame in sorted(words)}
    return tuple(KeyPose(time, words[frame], time) for frame, time in times.items())
