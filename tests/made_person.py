"""A stick figure with Plug-in Gait's labels that does one of the movements of a session."""

from __future__ import annotations

import numpy as np

from myomorph.core.model.series import Markers

GRAVITY = 9.80665
SECONDS = 3.0
RATE = 100.0
LEG = 0.9
FOOT = 0.12  # Heel to ankle and ankle to toe along the foot, as a share of the leg.
WIDTH = 0.13  # Of half the pelvis, as a share of the leg.


def made_person(movement: str, leg: float = LEG, width: float = WIDTH) -> Markers:
    """Markers of somebody with legs of a length [m] who does one of the movements.

    The figure of another size moves in times that are as long as pendulums of its legs swing.

    Parameters
    ----------
    movement : one of `MOVEMENTS`
    leg : length of the legs [m]
    width : of half the pelvis over the leg
    """
    pace = np.sqrt(LEG / leg)
    time = np.arange(round(SECONDS * RATE)) / RATE
    pelvis, feet, hand = _paths(movement, time)
    places = {}
    for side, sign in (("R", 1.0), ("L", -1.0)):
        hip = pelvis + [0.0, 0.0, sign * width]
        ankle = feet[side] + [0.0, 0.08, sign * width]
        knee = 0.5 * (hip + ankle) + [0.1, 0.0, 0.0]
        shoulder = pelvis + [0.0, 0.55, 2.0 * sign * width]
        wrist = shoulder + [0.0, -0.5, 0.0] + (hand if side == "R" else 0.0)
        places |= {
            f"{side}ASI": hip + [0.1, 0.05, 0.0],
            f"{side}PSI": hip + [-0.1, 0.05, 0.0],
            f"{side}KNE": knee,
            f"{side}ANK": ankle,
            f"{side}HEE": ankle + [-FOOT, -0.05, 0.0],
            f"{side}TOE": ankle + [FOOT, -0.05, 0.0],
            f"{side}SHO": shoulder,
            f"{side}ELB": 0.5 * (shoulder + wrist),
            f"{side}WRA": wrist,
        }
    return Markers(time / pace, tuple(places), leg * np.stack(list(places.values()), axis=1))


def _paths(movement: str, time: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray], np.ndarray]:
    """Paths of pelvis, feet by side and a hand (frames, 3), in shares of a leg of `LEG`."""
    pelvis = np.zeros((len(time), 3)) + [0.0, 1.0, 0.0]
    feet = {side: np.zeros((len(time), 3)) for side in "RL"}
    hand = np.zeros((len(time), 3))
    bump = 0.5 - 0.5 * np.cos(2.0 * np.pi * time / SECONDS)  # From 0 to 1 and back.
    if movement in ("walking", "running", "stairs"):
        turn = 2.0 * np.pi * (1.4 if movement == "running" else 0.9) * time
        rise = 0.08 if movement == "running" else 0.02
        way = (2.5 if movement == "running" else 1.3) * time
        pelvis[:, 0] = way
        pelvis[:, 1] += rise * np.cos(2.0 * turn)
        for side, sign in (("R", 1.0), ("L", -1.0)):
            feet[side][:, 0] = way + 0.35 * sign * np.cos(turn)
            feet[side][:, 1] = 0.08 * np.maximum(0.0, -sign * np.sin(turn))
            if movement == "running":
                feet[side][:, 1] += 0.08 * (1.0 + np.cos(2.0 * turn))
            if movement == "stairs":
                feet[side][:, 1] += 0.4 * feet[side][:, 0]
        pelvis[:, 1] += 0.4 * way if movement == "stairs" else 0.0
    elif movement == "jumping":
        air = time - 1.2
        flight = np.where((air > 0.0) & (air < 0.5), 0.5 * GRAVITY / LEG * air * (0.5 - air), 0.0)
        pelvis[:, 1] += flight
        for path in feet.values():
            path[:, 1] += flight
    elif movement == "squatting":
        pelvis += bump[:, None] * [-0.1, -0.4, 0.0]
    elif movement == "rising":
        down = np.clip(1.5 - time, 0.0, 1.0)[:, None]
        pelvis += down * [-0.45, -0.5, 0.0]
    elif movement == "upper limb":
        hand += bump[:, None] * [0.4, 0.5, 0.0]
    elif movement == "other":
        feet["R"] += bump[:, None] * [0.4, 0.2, 0.0]
    return pelvis, feet, hand
