"""A stick animal with four feet that goes in one of the gaits."""

from __future__ import annotations

import numpy as np

from myomorph.core.model.series import Markers

LEG = 0.03
RATE = 200.0
PERIOD = 0.25
STRIDES = 12
REACH = 0.4  # Way of a foot under the body, as a share of the leg, to either side.
GAITS = {
    # Phases of left hind, right fore and left fore foot after the right hind one, and the duty.
    "walk": (0.5, 0.25, 0.75, 0.65),
    "trot": (0.5, 0.5, 0.0, 0.4),
    "pace": (0.5, 0.0, 0.5, 0.4),
    "gallop": (0.22, 0.6, 0.75, 0.3),
    "bound": (0.02, 0.5, 0.52, 0.3),
}


def made_animal(gait: str, fore: bool = True) -> Markers:
    """Markers of an animal that goes along x with y up.

    Parameters
    ----------
    gait : one of `GAITS`
    fore : markers are on the fore feet too
    """
    left_hind, right_fore, left_fore, duty = GAITS[gait]
    time = np.arange(round(STRIDES * PERIOD * RATE)) / RATE
    speed = 2.0 * REACH * LEG / (duty * PERIOD)
    trunk = np.stack([speed * time, np.full_like(time, LEG), np.zeros_like(time)], axis=1)
    places = {
        "Pelvis": trunk,
        "Spine": trunk + [2.0 * LEG, 0.0, 0.0],
        "RightHip": trunk + [0.0, 0.0, 0.3 * LEG],
        "LeftHip": trunk + [0.0, 0.0, -0.3 * LEG],
    }
    feet = {"RightFoot": 0.0, "LeftFoot": left_hind}
    feet |= {"RightHand": right_fore, "LeftHand": left_fore} if fore else {}
    for name, phase in feet.items():
        shift = 2.0 * LEG if "Hand" in name else 0.0
        side = 0.3 * LEG if "Right" in name else -0.3 * LEG
        foot = _foot((time / PERIOD - phase) % 1.0, duty)
        places[name] = trunk * [1.0, 0.0, 0.0] + foot + [shift, 0.0, side]
    return Markers(time, tuple(places), np.stack(list(places.values()), axis=1))


def _foot(phase: np.ndarray, duty: float) -> np.ndarray:
    """Path of a foot under the body (frames, 3): back at one speed, and forward through the air."""
    stance = phase < duty
    share = np.where(stance, phase / duty, (phase - duty) / (1.0 - duty))
    along = REACH * LEG * np.where(stance, 1.0 - 2.0 * share, -np.cos(np.pi * share))
    height = np.where(stance, 0.0, 0.2 * LEG * np.sin(np.pi * share))
    return np.stack([along, height, np.zeros_like(phase)], axis=1)
