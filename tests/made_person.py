"""A stick figure with Plug-in Gait's labels that does one of the movements of a session."""

from __future__ import annotations

from dataclasses import dataclass

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
    paths = _paths(movement, time)
    places = {}
    for side, sign in (("R", 1.0), ("L", -1.0)):
        hip = paths.pelvis + [0.0, 0.0, sign * width]
        ankle = paths.feet[side] + [0.0, 0.08, sign * width]
        knee = 0.5 * (hip + ankle) + [0.1, 0.0, 0.0]
        shoulder = paths.pelvis + [0.0, 0.55, 2.0 * sign * width]
        wrist = shoulder + [0.0, -0.5, 0.0] + (paths.hand if side == "R" else 0.0)
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


@dataclass(frozen=True, eq=False)
class Paths:
    """Paths of a body's parts, in shares of a leg of `LEG`.

    Attributes
    ----------
    pelvis : (frames, 3)
    feet : (frames, 3) by side
    hand : (frames, 3) of the right hand beside its place at rest
    """

    pelvis: np.ndarray
    feet: dict[str, np.ndarray]
    hand: np.ndarray

    @staticmethod
    def at_rest(frames: int) -> Paths:
        """Somebody who stands."""
        still = np.zeros((frames, 3))
        return Paths(
            pelvis=still + [0.0, 1.0, 0.0], feet={"R": still.copy(), "L": still.copy()}, hand=still
        )


def _paths(movement: str, time: np.ndarray) -> Paths:
    paths = Paths.at_rest(len(time))
    moves = {
        "walking": lambda: _step(paths, time, rate=0.9, speed=1.3, rise=0.02),
        "stairs": lambda: _step(paths, time, rate=0.9, speed=1.3, rise=0.02, slope=0.4),
        "running": lambda: _step(paths, time, rate=1.4, speed=2.5, rise=0.08),
        "jumping": lambda: _jump(paths, time - 1.2),
        "squatting": lambda: _add(paths.pelvis, _bump(time), [-0.1, -0.4, 0.0]),
        "rising": lambda: _add(paths.pelvis, np.clip(1.5 - time, 0.0, 1.0), [-0.45, -0.5, 0.0]),
        "upper limb": lambda: _add(paths.hand, _bump(time), [0.4, 0.5, 0.0]),
        "other": lambda: _add(paths.feet["R"], _bump(time), [0.4, 0.2, 0.0]),
    }
    moves.get(movement, lambda: None)()
    return paths


def _bump(time: np.ndarray) -> np.ndarray:
    """From 0 to 1 and back."""
    return 0.5 - 0.5 * np.cos(2.0 * np.pi * time / SECONDS)


def _add(path: np.ndarray, share: np.ndarray, way: list[float]) -> None:
    path += share[:, None] * way


def _step(
    paths: Paths, time: np.ndarray, rate: float, speed: float, rise: float, slope: float = 0.0
) -> None:
    """Make so many strides a second; a pelvis that rises much flies."""
    turn = 2.0 * np.pi * rate * time
    way = speed * time
    paths.pelvis[:, 0] = way
    paths.pelvis[:, 1] += rise * np.cos(2.0 * turn) + slope * way
    flight = np.where(rise > 0.05, 0.08 * (1.0 + np.cos(2.0 * turn)), 0.0)
    for side, sign in (("R", 1.0), ("L", -1.0)):
        foot = paths.feet[side]
        foot[:, 0] = way + 0.35 * sign * np.cos(turn)
        swing = 0.08 * np.maximum(0.0, -sign * np.sin(turn))
        foot[:, 1] = swing + flight + slope * foot[:, 0]


def _jump(paths: Paths, air: np.ndarray) -> None:
    """Flight of half a second that begins where `air` is 0 [s]."""
    height = np.where((air > 0.0) & (air < 0.5), 0.5 * GRAVITY / LEG * air * (0.5 - air), 0.0)
    for path in (paths.pelvis, *paths.feet.values()):
        path[:, 1] += height
