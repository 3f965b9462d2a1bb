"""The performances of a simulated performer.

They are a slow shift of weight, taps of heels and toes, and impacts on two drums.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.integrate import cumulative_trapezoid

from myomorph.core.model.arrays import Array
from myomorph.core.model.spatial import axis_rotation
from myomorph.show.simulate import fighter
from myomorph.show.simulate.performer import Blow, Contact, Part, sole
from myomorph.show.simulate.plan import WHOLE, Aim

WIDE = 0.15  # Half the distance of the feet [m].
INNER = WIDE - 0.01  # Of the mass center over one foot [m].


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


def foot_aims(
    side: str,
    wide: float,
    pitch: float = 0.0,
    about: float = 0.0,
    shift: tuple[float, float] = (0.0, 0.0),
) -> list[Aim]:
    """Aim a foot at its position, pitched (toes up) about a point of the sole.

    `pitch` is in rad, the point is `about` ahead of the ankle, and `shift` ahead and up [m].
    """
    z = wide if side == "r" else -wide
    turn = axis_rotation((0.0, 0.0, 1.0), pitch)
    hinge = np.array([about, -fighter.SOLE_HEIGHT, 0.0])
    place = np.array([about + shift[0], shift[1], z])
    return [
        Aim(f"foot_{side}", at, place + turn @ (at - hinge), weight=10.0)
        for at in fighter.sole_points(side).values()
    ]


def weight_aims(
    x: float, height: float, z: float, twist: float = 0.0, lean: float = 0.0
) -> list[Aim]:
    """Aim the mass center of the whole body at a position [m], and an upright trunk to the left.

    `twist` and `lean`, backward, are in rad.
    """
    back = axis_rotation((0.0, 0.0, 1.0), lean)
    turns = [
        (body, axis_rotation((0.0, 1.0, 0.0), share * twist) @ back)
        for body, share in (("torso", 1.0), ("pelvis", 0.5))
    ]
    return [
        Aim(WHOLE, None, np.array([x, height, z]), weight=10.0),
        *(Aim(body, None, turn, weight=1.0) for body, turn in turns),
    ]


def fist_aim(side: str, place: Sequence[float]) -> Aim:
    """Aim a fist at a position from the middle between the feet [m]."""
    return Aim(f"forearm_{side}", np.array(fighter.GRIP), np.array(place), weight=0.3)


def path(times: Sequence[float], values: Sequence[float], time: float | Array) -> Array:
    """Go from each value to the next, smooth to the second derivative, at rest at every one.

    Parameters
    ----------
    times, values : of the stops, ascending times [s]
    time : where it is asked for

    Returns
    -------
    values, in their unit
    """
    result = np.full(np.shape(time), values[0])
    for start, stop, before, after in zip(
        times[:-1], times[1:], values[:-1], values[1:], strict=True
    ):
        result = result + (after - before) * smooth(time, start, stop)
    return result


LOW = 0.85  # Height of the mass center in Tai Chi [m].
STRIDE = 0.15  # Length of half a step of it [m].
STEPS = {"r": (3.1, 4.7, 2 * STRIDE), "l": (7.9, 9.3, STRIDE)}
"""When a foot is off the ground [s], and how far it is put ahead [m]."""
LIFT = {"r": 0.06, "l": 0.18}  # How high [m].
OVER = 0.05  # The mass center is so far ahead of the ankle of the foot that carries it [m].
UNLOAD = 0.25  # Before a foot lifts, and after it is down, it bears less and less for so long [s].


def taichi_part() -> Part:
    """Make the part of somebody who takes two slow steps of Tai Chi.

    All the weight goes onto one foot, the other is lifted, put ahead and loaded; then the other
    way. Arms circle, the trunk turns.
    """
    when = (0.4, 2.8, 5.0, 7.6, 9.6, 11.6)
    far = 2.0 * STRIDE + OVER
    stops_x = (OVER, OVER, OVER, far, far, 1.5 * STRIDE + OVER)
    stops_z = (0.0, -INNER, -INNER, INNER, INNER, 0.0)

    def aims(time: float) -> list[Aim]:
        grow = float(smooth(time, 0.0, 1.5))
        turn = 2.0 * np.pi * time / 4.0
        x = float(path(when, stops_x, time))
        z = float(path(when, stops_z, time))
        high = 1.0 + 0.15 * np.cos(turn)
        fists = [
            fist_aim("r", (x + 0.36, high, z + 0.25)),
            fist_aim("l", (x + 0.36, 2.0 - high, z - 0.25)),
        ]
        result = weight_aims(x, LOW, z, 0.2 * grow * np.sin(turn))
        for side, (start, stop, far) in STEPS.items():
            middle = 0.5 * (start + stop)
            up = float(path((start, middle, stop), (0.0, LIFT[side], 0.0), time))
            result += foot_aims(side, WIDE, shift=(far * float(smooth(time, start, stop)), up))
        return [*result, *fists]

    def down(side: str) -> Callable[[Array], Array]:
        start, stop, _ = STEPS[side]
        return lambda time: (
            1.0 - path((start - UNLOAD, start, stop, stop + UNLOAD), (0.0, 1.0, 1.0, 0.0), time)
        )

    feet = [
        Contact(name=f"foot_{side}", body=f"foot_{side}", points=sole(side), on=down(side))
        for side in "rl"
    ]
    return Part(aims, feet, 12.0, seed=51)


TAPS = (("toe_r", 0.9), ("heel_r", 1.6), ("toe_l", 8.5), ("heel_l", 9.2))
"""Ends of feet that are up, and when [s]."""
UP = 0.25  # Half of the time that an end is up [s].
BRUSH = (3.5, 4.5)
"""From when to when the right foot is off the ground, brushes ahead and comes back [s]."""
HOP = 6.8  # Middle of the time in which nothing touches [s].
FLIGHT = 0.2  # How long that is [s].
PUSH = 0.5  # How long a hop takes from rest to the end of the push [s].
LEAN = 2.6  # By which the trunk leans back as legs extend [rad/m].
TUCK = 0.03  # How much feet are lifted in the air, against where they left the ground [m].
SHOE = 0.13  # Half the distance of the feet [m].
TALL = 0.87  # Height of the mass center [m].


def hop_height(time: float | Array) -> Array:
    """Compute the height of the mass center over rest in a hop.

    It falls freely while nothing touches.

    From the middle on, acceleration is -g, blends into the push, and ends in the crouch from which
    rest follows; the beginning is the same in reverse. Sizes of push and crouch are those by which
    the height ends at rest.

    Parameters
    ----------
    time : (frames,) [s]

    Returns
    -------
    (frames,) [m]
    """
    grid = np.linspace(0.0, 0.5 * FLIGHT + PUSH, 2001)
    x = (grid - 0.5 * FLIGHT) / PUSH
    free = -9.81 * (1.0 - smooth(x, 0.0, 0.15))
    push = smooth(x, 0.0, 0.15) * (1.0 - smooth(x, 0.4, 0.6))
    crouch = smooth(x, 0.4, 0.6) * (1.0 - smooth(x, 0.85, 1.0))
    speeds = np.array(
        [cumulative_trapezoid(one, grid, initial=0.0) for one in (free, push, crouch)]
    )
    heights = cumulative_trapezoid(speeds, grid, axis=1, initial=0.0)
    # At rest at the end, as far below the top as the flight and the rise before it are high.
    top = 0.5 * 9.81 * (0.5 * FLIGHT) ** 2 + RISE
    left = np.array([speeds[1:, -1], heights[1:, -1]])
    sizes = np.linalg.solve(left, -np.array([speeds[0, -1], top + heights[0, -1]]))
    height = top + np.concatenate([[1.0], sizes]) @ heights
    return np.asarray(np.interp(np.abs(np.asarray(time) - HOP), grid, height))


RISE = 0.03  # Height of the mass center over rest when feet leave the ground [m].


def tap_part() -> Part:
    """Make the part of a tap dancer.

    Toes and heels lift and come down one after the other, a foot brushes through the air while the
    other carries all, and both hop.
    """

    def lifted(end: str, time: float | Array) -> Array:
        result = np.zeros_like(np.asarray(time, dtype=float))
        for name, middle in TAPS:
            if name == end:
                inside = np.clip((np.asarray(time) - middle) / UP, -1.0, 1.0)
                result = np.maximum(result, (1.0 - inside**2) ** 3)
        return result

    def aims(time: float) -> list[Aim]:
        z = float(
            path(
                (0.0, 0.7, 1.9, 3.2, 4.7, 6.0, 7.4, 8.2),
                (0.0, -0.05, -0.05, -SHOE + 0.015, -SHOE + 0.015, 0.0, 0.0, 0.05),
                time,
            )
        )
        hop = float(hop_height(time))
        air = np.clip((time - HOP) / (0.5 * FLIGHT), -1.0, 1.0)
        tuck = TUCK * float((1.0 - air**2) ** 3)
        result = weight_aims(0.05, TALL + hop, z, lean=LEAN * (hop - tuck))
        middle = 0.5 * sum(BRUSH)
        brush = float(path((BRUSH[0], middle, BRUSH[1]), (0.0, 1.0, 0.0), time))
        for side in "rl":
            toe = float(lifted(f"toe_{side}", time))
            heel = float(lifted(f"heel_{side}", time))
            away = brush * (side == "r")
            result += foot_aims(
                side,
                SHOE,
                0.25 * toe - 0.25 * heel,
                0.18 if heel > 0.0 else -0.06,
                (0.15 * away, tuck + 0.07 * away),
            )
        fists = (
            fist_aim("r", (0.36, 1.02 + hop, z + 0.24)),
            fist_aim("l", (0.36, 1.02 + hop, z - 0.24)),
        )
        return [*result, *fists]

    def down(end: str) -> Callable[[Array], Array]:
        def on(time: Array) -> Array:
            ready = np.clip(1.0 - 8.0 * lifted(end, time), 0.0, 1.0)
            ready = ready * (np.abs(time - HOP) > 0.5 * FLIGHT)
            if end.endswith("_r"):
                spans = (BRUSH[0] - 0.15, BRUSH[0], BRUSH[1], BRUSH[1] + 0.15)
                ready = ready * (1.0 - path(spans, (0.0, 1.0, 1.0, 0.0), time))
            return np.asarray(ready)

        return on

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
    fast = (HOP - 0.5 * FLIGHT - PUSH, HOP + 0.5 * FLIGHT + PUSH)
    # Feet that hardly press take no moment either.
    half = 0.5 * FLIGHT + 0.04
    air = (HOP - half, HOP + half)
    return Part(aims, ends, 9.8, squeeze=0.03, seed=54, fast=fast, air=air)


TIP = np.array(fighter.GRIP) + (0.0, -0.3, 0.0)  # Of the stick, in the forearm [m].
DRUM_PLACES = {"snare": (0.32, 0.72, 0.18), "high tom": (0.32, 0.72, -0.18)}
PEDAL = 1.4  # Period of the foot on the pedal [s].
HIPS = (-0.38, 0.52, 0.0)  # Middle of a drummer's hips, from the middle between the feet [m].
STOOL = np.array([[x, -0.09, z] for x in (-0.1, 0.02) for z in (-0.07, 0.07)])
"""Where the pelvis rests on the stool, in its frame (4, 3) [m]."""
STICK_OF = {"snare": "r", "high tom": "l"}


def drum_part(strokes: Sequence[tuple[str, float, float]], duration: float) -> Part:
    """Make the part of a drummer on a stool, who strikes with both arms.

    The tip comes down to the drum, which pushes it up again. The right foot lifts and comes down as
    on a pedal, and the trunk leans to and fro. `strokes` have drum, time [s] and impulse [N s].
    """

    def lifted(time: float | Array, early: float = 0.0) -> Array:
        """Share of its height that the right foot has, or is free of load `early` before [s]."""
        phase = np.asarray(time) % PEDAL
        rise = smooth(phase, 0.3 - early, 0.5 - early)
        return np.asarray(rise * (1.0 - smooth(phase, 0.8 + early, 1.0 + early)))

    def aims(time: float) -> list[Aim]:
        up = 0.03 * float(lifted(time))
        result = [*foot_aims("r", WIDE, shift=(0.0, up)), *foot_aims("l", WIDE)]
        result.append(Aim("pelvis", np.zeros(3), np.array(HIPS), weight=10.0))
        lean = axis_rotation((0.0, 0.0, 1.0), -0.1 - 0.12 * float(np.sin(np.pi * time)))
        result.append(Aim("pelvis", None, np.eye(3), weight=1.0))
        result.append(Aim("torso", None, lean, weight=1.0))
        for drum, place in DRUM_PLACES.items():
            away = min((abs(time - at) for name, at, _ in strokes if name == drum), default=9.0)
            high = 0.12 * float(smooth(away, 0.0, 0.25))
            side = STICK_OF[drum]
            result.append(
                Aim(f"forearm_{side}", TIP, np.array(place) + (0.0, high, 0.0), weight=3.0)
            )
        return result

    def on_pedal(time: Array) -> Array:
        return 1.0 - lifted(time, early=0.2)

    feet = [
        Contact(name="foot_r", body="foot_r", points=sole("r"), on=on_pedal),
        Contact(name="foot_l", body="foot_l", points=sole("l")),
    ]
    stool = Contact(name="stool", body="pelvis", points=STOOL, share=6.0)
    blows = [
        Blow(body=f"forearm_{STICK_OF[drum]}", point=TIP, time=at, impulse=impulse)
        for drum, at, impulse in strokes
    ]
    return Part(aims, [*feet, stool], duration, rate=200.0, blows=blows, squeeze=0.03, seed=58)
