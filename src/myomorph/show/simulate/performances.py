"""The performances of a simulated performer.

They are a slow shift of weight, taps of heels and toes, and impacts on two drums.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.spatial import axis_rotation
from myomorph.show.simulate import fighter
from myomorph.show.simulate.performer import HEIGHT, Blow, Contact, Part, sole
from myomorph.show.simulate.plan import Aim

WIDE = 0.2
NARROW = 0.12  # Half the distance of the feet [m].


def smooth(time: float | Array, start: float, stop: float) -> Array:
    """Rise from 0 to 1, smooth to the second derivative.

    Parameters
    ----------
    time : of any shape [s]
    start, stop : of the rise [s]

    Returns
    -------
    As `time`, from 0 to 1
    """
    x = np.clip((np.asarray(time) - start) / (stop - start), 0.0, 1.0)
    return x**3 * (10.0 - 15.0 * x + 6.0 * x * x)


def foot_aims(side: str, wide: float, pitch: float = 0.0, about: float = 0.0) -> list[Aim]:
    """Aim a foot at its position, pitched (toes up) about a point of the sole.

    `pitch` is in rad, and the point is `about` ahead of the ankle [m].
    """
    z = wide if side == "r" else -wide
    turn = axis_rotation((0.0, 0.0, 1.0), pitch)
    hinge = np.array([about, -fighter.SOLE_HEIGHT, 0.0])
    place = np.array([about, 0.0, z])
    return [
        Aim(f"foot_{side}", at, place + turn @ (at - hinge), weight=10.0)
        for at in fighter.sole_points(side).values()
    ]


def trunk_aims(sway: float, drop: float, twist: float = 0.0, ahead: float = 0.05) -> list[Aim]:
    """Aim the pelvis over the feet, and a trunk that turns left.

    The pelvis is `sway` to the right and `drop` below straight legs [m].
    """
    place = np.array([ahead - 0.03, fighter.LEG * HEIGHT / fighter.HEIGHT - drop, sway])
    turns = [
        (body, axis_rotation((0.0, 1.0, 0.0), share * twist))
        for body, share in (("torso", 1.0), ("pelvis", 0.5))
    ]
    return [
        Aim("pelvis", np.zeros(3), place),
        *(Aim(body, None, turn, weight=0.5) for body, turn in turns),
    ]


def fist_aim(side: str, place: Sequence[float]) -> Aim:
    """Aim a fist at a position from the middle between the feet [m]."""
    return Aim(f"forearm_{side}", np.array(fighter.GRIP), np.array(place), weight=0.3)


def taichi_part() -> Part:
    """Weight slowly from one foot to the other, arms that circle, the trunk that turns."""

    def aims(time: float) -> list[Aim]:
        turn = 2.0 * np.pi * time / 4.0
        sway = np.sin(turn)
        grow = float(smooth(time, 0.0, 1.5))
        high = 1.05 + 0.15 * np.cos(turn)
        fists = [fist_aim("r", (0.42, high, 0.25 + 0.06 * sway * grow))]
        fists += [fist_aim("l", (0.42, 2.1 - high, -0.25 + 0.06 * sway * grow))]
        trunk = trunk_aims(0.12 * grow * sway, 0.09, 0.2 * grow * sway)
        return [*foot_aims("r", WIDE), *foot_aims("l", WIDE), *trunk, *fists]

    feet = [Contact(f"foot_{side}", f"foot_{side}", sole(side)) for side in "rl"]
    return Part(aims, feet, 8.0, seed=51)


TAPS = (("toe_r", 1.2), ("heel_r", 1.9), ("toe_l", 3.9), ("heel_l", 4.6), ("toe_r", 6.6))
"""Ends of feet that are up, and when [s]."""
UP = 0.25  # Half of the time that an end is up [s].


def tap_part() -> Part:
    """Make the part of a tap dancer.

    Toes and heels lift and come down one after the other while the weight goes from foot to foot.
    """

    def lifted(end: str, time: float | Array) -> Array:
        result = np.zeros_like(np.asarray(time, dtype=float))
        for name, middle in TAPS:
            if name == end:
                inside = np.clip((np.asarray(time) - middle) / UP, -1.0, 1.0)
                result = np.maximum(result, (1.0 - inside**2) ** 3)
        return result

    def aims(time: float) -> list[Aim]:
        sway = float(
            smooth(time, 0.0, 1.0) - 2.0 * smooth(time, 2.1, 3.7) + 2.0 * smooth(time, 4.8, 6.4)
        )
        result = trunk_aims(-0.07 * sway, 0.06)
        for side in "rl":
            toe = float(lifted(f"toe_{side}", time))
            heel = float(lifted(f"heel_{side}", time))
            result += foot_aims(
                side, NARROW, 0.25 * toe - 0.25 * heel, 0.18 if heel > 0.0 else -0.06
            )
        return [*result, fist_aim("r", (0.36, 1.02, 0.24)), fist_aim("l", (0.36, 1.02, -0.24))]

    def down(end: str) -> Callable[[Array], Array]:
        return lambda time: np.clip(1.0 - 8.0 * lifted(end, time), 0.0, 1.0)

    ends = [
        Contact(
            name=f"{end}_{side}",
            body=f"foot_{side}",
            points=sole(side, end),
            on=down(f"{end}_{side}"),
        )
        for side in "rl"
        for end in ("heel", "toe")
    ]
    return Part(aims, ends, 7.2, squeeze=0.03, seed=54)


TIP = np.array(fighter.GRIP) + (0.0, -0.3, 0.0)  # Of the stick, in the forearm [m].
DRUM_PLACES = {"snare": (0.72, 1.0, 0.18), "high tom": (0.72, 1.0, -0.18)}
STICK_OF = {"snare": "r", "high tom": "l"}


def drum_part(strokes: Sequence[tuple[str, float, float]], duration: float) -> Part:
    """Make the part of a drummer, who strikes with both arms.

    The tip comes down to the drum, which pushes it up again. `strokes` have drum, time [s] and
    impulse [N s].
    """

    def aims(time: float) -> list[Aim]:
        result = [*foot_aims("r", WIDE), *foot_aims("l", WIDE), *trunk_aims(0.0, 0.06)]
        for drum, place in DRUM_PLACES.items():
            away = min((abs(time - at) for name, at, _ in strokes if name == drum), default=9.0)
            up = 0.12 * float(smooth(away, 0.0, 0.25))
            side = STICK_OF[drum]
            result.append(Aim(f"forearm_{side}", TIP, np.array(place) + (0.0, up, 0.0), weight=3.0))
        return result

    feet = [Contact(f"foot_{side}", f"foot_{side}", sole(side)) for side in "rl"]
    blows = [
        Blow(body=f"forearm_{STICK_OF[drum]}", point=TIP, time=at, impulse=impulse)
        for drum, at, impulse in strokes
    ]
    return Part(aims, feet, duration, rate=200.0, blows=blows, squeeze=0.03, seed=58)
