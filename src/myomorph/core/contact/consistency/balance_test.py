"""The verdict: whether plates, motion and body belong to each other, and if not, what is wrong.

A finding needs decisive evidence, a size that matters, and a correction that leaves little more
than noise. Explanations that are nearly as likely are named beside it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from myomorph.core.contact.consistency.body_needs import SHORTEST, body_needs
from myomorph.core.contact.consistency.channels import channels
from myomorph.core.contact.consistency.corrected_plates import corrected_plates
from myomorph.core.contact.consistency.corrections import Correction, Plates, hypotheses
from myomorph.core.contact.consistency.evidence import Comparison, Tried, compared, misfit
from myomorph.core.contact.consistency.plate_signals import BROKEN, PlateSignals
from myomorph.core.contact.consistency.plate_signals import LOST as LOST_SAMPLES
from myomorph.core.contact.consistency.scene import Scene
from myomorph.core.model.causes import CLOCKS, FEET_BESIDE, PLATES, WEIGHT
from myomorph.core.model.errors import quoted
from myomorph.core.model.findings import Finding, times_text
from myomorph.core.model.messages import Cause
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion, Wrenches
from myomorph.core.motion.lost_frames import FROZEN

DECISIVE = 4.5
"""Log evidence over nothing wrong that names a fault, where it leaves no more than noise.

What is left beyond `CLEAN` is alike from frame to frame, so that evidence counts too much: more is
asked by the square of it.
"""
APART = 3.0
"""Log evidence within which others are named as well."""
CLEAN = 1.4
"""What is left of most recordings that are as they should be, over the noise, at most."""
EXPLAINED = 2.2
"""What a correction may leave, over the noise, and still explain."""
MUCH_BESIDE = 0.25
"""Share of the time that something else than the plates carries, from which signs and units are
tried.
"""
LESS_BESIDE = 0.05
"""By how much of the time that falls once they are put right."""
SUDDEN = ("reversed", "exchanged axes", "unit", "turned plate", "points mirrored", "clock")
"""Kinds that make plates seem to carry a part of the body only."""
FEWEST = 8
"""Frames that show something."""
UNDER = 0.25
"""Distance from the middle of a foot within which a force is that foot's [m]."""
BESIDE = "foot beside the plates"
NOT_ONE = "not one fault"
"""Kinds of findings: a foot that stands where no plate measures it, and forces that do not belong
to the motion though no single fault explains it.
"""
NEAR = 0.12
"""Time around repeated or missing frames in which accelerations are wrong [s]."""
IDLE = 0.02
"""Share of the weight below which a plate carries nothing."""
OF_CLOCKS = ("clock", "lost samples", "clock rate")
"""Kinds that missing frames explain."""
MOST_ODDS = 1e6
"""Odds beyond which none are written."""
MOST_RIVALS = 4
"""Explanations that are named."""
CAUSES: dict[str, Cause] = {
    "clock": CLOCKS,
    "lost samples": CLOCKS,
    "clock rate": CLOCKS,
    "mass": WEIGHT,
    "gain of all plates": WEIGHT,
    "gain": WEIGHT,
}
"""Causes of findings by kind, `PLATES` of the others."""


@dataclass(frozen=True, eq=False)
class MeasuredPlates:
    """Plates as they were recorded.

    Attributes
    ----------
    wrenches : on their own clock
    signals : what they show by themselves
    zeros : numbers of those that were seen without load
    one_foot_each : whether each stance is that of one foot, so that its sole shows where plates lie
    """

    wrenches: Wrenches
    signals: PlateSignals
    zeros: frozenset[int] = frozenset()
    one_foot_each: bool = True

    @property
    def live(self) -> tuple[int, ...]:
        """Numbers of those that are stepped on and work."""
        return tuple(int(number) for number in np.flatnonzero(self.signals.usable))


def scene_of(model: Model, motion: Motion, plates: MeasuredPlates) -> Scene | None:
    """Bring a body and its plates onto one clock; None where nothing can be compared.

    Parameters
    ----------
    model : of a person with two feet
    motion : (frames, coordinates) [rad or m]
    plates : on their own clock
    """
    wrenches = plates.wrenches
    signals = plates.signals
    known = np.isfinite(motion.values).all(axis=1)
    if len(motion) < SHORTEST or not known.all() or len(wrenches) < SHORTEST:
        return None
    steps = np.diff(motion.time)
    if steps.max() > 1.5 * steps.min():
        return None
    usable = _usable(model, motion, wrenches, signals)
    # Times of files are rounded, which differentiating would take for accelerations.
    even = np.linspace(motion.time[0], motion.time[-1], len(motion))
    motion = replace(motion, time=even, velocities=None, accelerations=None)
    up = int(np.argmax(np.abs(model.up)))
    return Scene(
        needs=body_needs(model, motion),
        channels=channels(wrenches, signals.usable, up, model.weight),
        usable=usable,
        one_foot_each=plates.one_foot_each,
    )


def _usable(
    model: Model, motion: Motion, wrenches: Wrenches, signals: PlateSignals
) -> NDArray[np.bool_]:
    """Flag frames whose pose is the body's, and in which all plates that are stepped on work.

    Where frames are missing, one clock holds on the longer side only.
    """
    time = motion.time
    usable = np.ones(len(motion), bool)
    for finding in motion.findings:
        for start, stop in finding.times:
            beside = (time < start - NEAR, time > stop + NEAR)
            if finding.kind == FROZEN:
                usable &= beside[0] | beside[1]
            else:
                usable &= max(beside, key=np.count_nonzero)
    for plate in np.flatnonzero(signals.stepped_on & ~signals.usable):
        force = np.linalg.norm(np.nan_to_num(wrenches.forces[:, plate]), axis=1)
        usable &= np.interp(time, wrenches.time, force) < IDLE * model.weight
    return usable


@dataclass(frozen=True)
class Verdict:
    """Whether plates, motion and body belong to each other.

    Attributes
    ----------
    findings : one of what is wrong or none, and one for each foot beside the plates
    fits : whether enough frames leave no more than recordings as they should be, what is found put
        right; else other checks have to say what they see
    """

    findings: tuple[Finding, ...] = ()
    fits: bool = False


def verdict_of(model: Model, motion: Motion, plates: MeasuredPlates) -> Verdict:
    """Test whether plates, motion and body belong to each other.

    Parameters
    ----------
    model : of a person with two feet
    motion : (frames, coordinates) [rad or m]
    plates : on their own clock
    """
    scene = scene_of(model, motion, plates)
    signals = plates.signals
    if scene is None or not signals.usable.any():
        return Verdict()
    answer = None
    if scene.beside > MUCH_BESIDE or len(scene.chosen) < FEWEST:
        answer = _brought_back(scene, plates)
    if answer is None and len(scene.chosen) >= FEWEST:
        answer = _likeliest(_compared(scene, plates), _late(motion, signals))
    if answer is None:
        answer = _Answer()
    broken = any(item.kind in BROKEN for item in signals.findings)
    beside = () if broken or not all(plates.wrenches.bodies) else tuple(_beside(scene))
    fits = answer.left <= CLEAN
    if answer.finding is None or (beside and answer.finding.kind == NOT_ONE):
        return Verdict(beside, fits)
    return Verdict((answer.finding,), fits)


class _Answer(NamedTuple):
    """What a comparison says.

    Attributes
    ----------
    finding : of what is wrong, None for nothing
    left : what is left then, over the noise
    """

    finding: Finding | None = None
    left: float = np.inf


def _late(motion: Motion, signals: PlateSignals) -> bool:
    """Whether missing frames or samples are known, which make what follows late."""
    return bool(motion.findings) or any(item.kind == LOST_SAMPLES for item in signals.findings)


def _likeliest(found: Comparison, late: bool) -> _Answer:
    """Name the likeliest fault, where one is decisive.

    Parameters
    ----------
    found : what may be wrong, the likeliest first
    late : whether missing frames explain clocks that differ
    """
    tried = [item for item in found.tried if not (late and item.hypothesis.kinds[0] in OF_CLOCKS)]
    best = next((item for item in tried if item.matters), None)
    if best is not None and best.gain >= DECISIVE * max(1.0, best.left / CLEAN) ** 2:
        rivals = [item for item in tried if item.gain > best.gain - APART]
        # Something too small to matter explains as much.
        if all(item.matters for item in rivals):
            return _Answer(_finding(best, rivals, found.left), best.left)
    return _Answer(_unexplained(found) if found.left > EXPLAINED else None, found.left)


def _unexplained(found: Comparison) -> Finding:
    """Say that forces do not belong to the motion, and that nothing that is known explains it."""
    places = dict.fromkeys(item.hypothesis.place for item in found.tried)
    text = PLATES.message(
        f"the forces do not belong to the motion: residual forces and moments are {found.left:.1f}"
        " times their noise; no single fault explains it",
        severity="changes results",
    )
    return Finding(kind=NOT_ONE, place=max(places, key=len), text=text)


def _beside(scene: Scene) -> Iterator[Finding]:
    """Find the times at which a foot stands where no plate measures it."""
    for foot, side in enumerate(scene.needs.feet.sides):
        spans = tuple(
            (bare.start, bare.stop)
            for bare in scene.bare
            if int(np.argmin(bare.gaps)) == foot and bare.gaps[foot] < UNDER
        )
        if not spans:
            continue
        name = {"r": "right", "l": "left"}[side]
        share = (
            100.0
            * sum(stop - start for start, stop in spans)
            / float(scene.needs.time[-1] - scene.needs.time[0])
        )
        text = FEET_BESIDE.message(
            f"no plate measures the {name} foot in {share:.0f} % of the time"
            f" ({times_text(spans)}), though it carries the body: torques of its leg are wrong"
            " there",
            size=share,
        )
        yield Finding(kind=BESIDE, place=f"{name} foot", text=text, times=spans)


def _compared(scene: Scene, plates: MeasuredPlates) -> Comparison:
    """Compare all that may be wrong with plates, a trifle that explains as much taken off first."""
    found = _compared_as_is(scene, plates)
    least = max(DECISIVE, found.tried[0].gain - APART)
    for item in found.tried:
        if item.gain > least and not item.matters and item.correction.of_plates:
            right = corrected_plates(plates.wrenches, item.correction)
            return _compared_as_is(_seen_with(scene, plates, right), plates)
    return found


def _compared_as_is(scene: Scene, plates: MeasuredPlates) -> Comparison:
    """Compare all that may be wrong with plates."""
    live = plates.live
    named = Plates(
        names=plates.wrenches.names,
        live=live,
        zeros=plates.zeros,
        up=scene.up,
        weight=scene.weight,
        times=scene.frames.time,
    )
    return compared(scene, list(hypotheses(named)), live)


def _seen_with(scene: Scene, plates: MeasuredPlates, wrenches: Wrenches) -> Scene:
    """Look at a scene with other forces of its plates."""
    seen = channels(wrenches, plates.signals.usable, scene.up, scene.weight)
    return replace(scene, channels=seen)


def _brought_back(scene: Scene, plates: MeasuredPlates) -> _Answer | None:
    """Find the sign, axis, unit or clock by which plates seem to carry a part of the body only."""
    whole = replace(scene, whole=True)
    if len(whole.chosen) < FEWEST:
        return None
    found = _compared_as_is(whole, plates)
    for item in found.tried[:3]:
        if item.gain > 2.0 * DECISIVE and item.hypothesis.kinds[0].startswith(SUDDEN):
            left = _left_with(scene, plates, item.correction)
            if left is not None:
                rivals = [other for other in found.tried if other.gain > item.gain - APART]
                return _Answer(_finding(item._replace(left=left), rivals, found.left), left)
    return None


def _left_with(scene: Scene, plates: MeasuredPlates, correction: Correction) -> float | None:
    """Make a correction of signs, axes, units or clocks, and return what is left then.

    Returns
    -------
    over its noise; None where the plates then carry no more of the body, or do not carry it
    """
    again = _seen_with(scene, plates, corrected_plates(plates.wrenches, correction))
    if len(again.chosen) < FEWEST or again.beside > scene.beside - LESS_BESIDE:
        return None
    left = misfit(again, plates.live)
    return left if left < 0.6 * EXPLAINED else None


def _forces(place: str) -> str:
    """Write the names of plates as those of forces."""
    names = place.split(", ")
    return ("force " if len(names) == 1 else "forces ") + quoted(names)


def _odds(gain: float) -> str:
    """Write how much likelier log evidence makes a recording, to two digits."""
    if gain > np.log(MOST_ODDS):
        return "over a million"
    rounded = float(f"{np.exp(gain):.1e}")
    return f"{rounded:,.0f}"


def _finding(best: Tried, rivals: list[Tried], left: float) -> Finding:
    """Name what is wrong, and what may be meant as well."""
    kinds = dict.fromkeys(kind for item in rivals for kind in item.hypothesis.kinds)
    texts = dict.fromkeys(f"{_forces(item.hypothesis.place)}: {item.text}" for item in rivals)
    first, *others = list(texts)[:MOST_RIVALS]
    sure = best.left < EXPLAINED
    start = "the forces do not belong to the motion: " if not sure else ""
    beside = "".join(f"; or {text}" for text in others)
    told = (
        f"{start}{first}{beside} (the recording is {_odds(best.gain)} times as likely so; residual"
        f" forces and moments fall from {left:.1f} to {best.left:.1f} times their noise)"
    )
    if not sure:
        told += "; no single fault explains it"
    cause = CAUSES.get(best.hypothesis.kinds[0], PLATES)
    return Finding(
        kind=" or ".join(kinds if sure else (NOT_ONE, *kinds)),
        place=best.hypothesis.place,
        text=cause.message(told, size=best.size, severity="changes results"),
    )
