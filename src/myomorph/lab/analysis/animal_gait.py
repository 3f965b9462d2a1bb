"""Gait of an animal: walk, trot, pace, gallop or bound, by the phases of its limbs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData
from myomorph.core.model.known import Known
from myomorph.core.model.movement import Movement
from myomorph.lab.analysis.foot_events import FootTrack, StrideOptions, foot_track
from myomorph.lab.analysis.seen_body import SIDES, SeenBody
from myomorph.lab.analysis.travel import FootPaths, travel_of

Gait = Literal["walk", "trot", "pace", "gallop", "bound"]
GAIT_MOVEMENTS: Mapping[Gait, Movement] = {
    "walk": "walking",
    "trot": "running",
    "pace": "running",
    "gallop": "running",
    "bound": "running",
}
MIN_STRIDES = 3  # Strides that a phase is the mean of.
MIN_AGREEMENT = 0.8  # Length of the mean of unit vectors at the phases of single strides.
SYMMETRIC = 0.1
"""The left hind foot of a symmetric gait strikes this near to half a stride after the right one."""
TOGETHER = 0.1  # Hind feet of a bound strike together, within this share of a stride.
STANDS = 0.5  # Each hind foot of a walk is on the ground for more of the stride.
UNSURE = 0.03  # Share of a stride to which the time on the ground is known.
UP = np.array([0.0, 1.0, 0.0])


@dataclass(frozen=True, kw_only=True)
class LimbPhases:
    """When limbs strike the ground, and for how long.

    Attributes
    ----------
    left_hind : strike of the left hind foot after that of the right one, as a share of the stride
    fore : strike of a fore foot after that of the hind foot of its side, nan where none is seen
    duty : share of the stride for which a hind foot is on the ground
    strides : of both hind feet
    """

    left_hind: float
    fore: float
    duty: float
    strides: int


def found_gait(body: SeenBody) -> Known[Gait]:
    """Gait of an animal, by Hildebrand's phases.

    Symmetric gaits have their hind feet half a stride apart. On the ground for more than half of
    the stride, they walk. Else they trot where fore and hind feet of one side are half a stride
    apart, and pace where they strike together. In other gaits hind feet strike one after the other
    (gallop), or together (bound).

    Parameters
    ----------
    body : as markers show it

    Returns
    -------
    the gait and its phases; not known where feet are not seen over some strides, or do not agree

    Notes
    -----
    Source: Hildebrand 1989.
    """
    phases = limb_phases(body)
    if phases is None:
        return Known(sentence="feet are not seen over enough strides that are alike")
    after = f"the left hind foot strikes {phases.left_hind:.2f} of a stride after the right one"
    ground = f"each on the ground for {phases.duty:.2f} of it"
    shown = f"{after}, {ground}"
    apart = abs(phases.left_hind - 0.5)
    if apart > 0.5 - TOGETHER:
        return _by_markers("bound", shown)
    if apart > 2.0 * SYMMETRIC:
        return _by_markers("gallop", shown)
    if apart > SYMMETRIC:
        return Known(sentence=f"neither symmetric nor not: {shown}")
    if phases.duty > STANDS + UNSURE:
        return _by_markers("walk", shown)
    if phases.duty > STANDS - UNSURE:
        return Known(sentence=f"between a walk and a trot: {shown}")
    return _run(phases, shown)


def _run(phases: LimbPhases, shown: str) -> Known[Gait]:
    """Symmetric gait with flights, by the phase of the fore feet."""
    if not np.isfinite(phases.fore):
        return Known(sentence=f"fore feet are not seen, so trot and pace look alike: {shown}")
    text = f"{shown}, fore feet {phases.fore:.2f} after hind feet"
    apart = abs(phases.fore - 0.5)
    if apart < 0.25 - SYMMETRIC:
        return _by_markers("trot", text)
    if apart > 0.25 + SYMMETRIC:
        return _by_markers("pace", text)
    return Known(sentence=f"between a trot and a pace: {text}")


def _by_markers(gait: Gait, sentence: str) -> Known[Gait]:
    return Known(value=gait, origin="markers", sentence=sentence)


def limb_phases(body: SeenBody) -> LimbPhases | None:
    """Phases of limbs over the strides that are seen.

    Parameters
    ----------
    body : as markers show it

    Returns
    -------
    the phases; None where strides are few, or differ
    """
    tracks = _tracks(body)
    right = tracks.get(("foot", "right"))
    left = tracks.get(("foot", "left"))
    if right is None or left is None:
        return None
    left_hind = _phases(right.strikes, left.strikes)
    if len(left_hind) < MIN_STRIDES or _agreement(left_hind) < MIN_AGREEMENT:
        return None
    duty = np.concatenate([_duty(right), _duty(left)])
    if not len(duty):
        return None
    fore = np.concatenate([_fore(tracks, side) for side in SIDES])
    agree = len(fore) >= MIN_STRIDES and _agreement(fore) >= MIN_AGREEMENT
    return LimbPhases(
        left_hind=_mean_phase(left_hind),
        fore=_mean_phase(fore) if agree else float("nan"),
        duty=float(np.median(duty)),
        strides=len(left_hind),
    )


def _tracks(body: SeenBody) -> dict[tuple[str, str], FootTrack]:
    """Strikes and lifts of each foot that is seen, by segment and side."""
    feet = {("foot", side): place for side, place in body.feet.items()}
    for side in SIDES:
        hand = body.mean("hand", side=side)
        if hand is not None:
            feet["hand", side] = hand
    trunk = body.root
    if trunk is None:
        return {}
    places = {key: body.smooth(place) for key, place in feet.items()}
    trunk = body.smooth(trunk)
    paths = FootPaths(time=body.time, trunk=trunk, feet=tuple(places.values()), up=UP)
    try:
        travel = travel_of(paths)
    except BadData:
        return {}
    options = StrideOptions()
    return {key: foot_track(place, place, trunk, travel, options) for key, place in places.items()}


def _phases(of: Array, strikes: Array) -> Array:
    """Phase of each strike within the stride of another foot that it falls into.

    Parameters
    ----------
    of : (strikes,) of the foot whose strides count [s]
    strikes : (strikes,) of the other one [s]

    Returns
    -------
    (strikes within strides,) in 0 to 1
    """
    if len(of) < 2:
        return np.zeros(0)
    stride = np.searchsorted(of, strikes, side="right") - 1
    inside = (stride >= 0) & (stride < len(of) - 1)
    start = of[stride[inside]]
    stop = of[stride[inside] + 1]
    lasting = stop - start
    # A stride in which a strike was missed is twice as long.
    whole = lasting < 1.5 * np.median(np.diff(of))
    return np.asarray(((strikes[inside] - start) / lasting)[whole])


def _fore(tracks: Mapping[tuple[str, str], FootTrack], side: str) -> Array:
    """Phase of the fore foot of a side after the hind foot (strides,)."""
    hind = tracks.get(("foot", side))
    fore = tracks.get(("hand", side))
    if hind is None or fore is None:
        return np.zeros(0)
    return _phases(hind.strikes, fore.strikes)


def _duty(track: FootTrack) -> Array:
    """Share of each stride from the strike to the lift (strides,)."""
    return _phases(track.strikes, track.lifts)


def _agreement(phases: Array) -> float:
    """Length of the mean of unit vectors at phases (strides,): 1 where all are alike."""
    return float(np.abs(np.mean(np.exp(2j * np.pi * phases))))


def _mean_phase(phases: Array) -> float:
    """Circular mean of phases (strides,), in 0 to 1."""
    mean = np.angle(np.mean(np.exp(2j * np.pi * phases))) / (2.0 * np.pi)
    return float(mean % 1.0)
