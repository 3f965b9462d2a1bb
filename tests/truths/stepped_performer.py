"""A simulated person who climbs, or rests a foot on a step, with every foot's force known.

MuJoCo gives what the planned motion needs, and the person's own random weights share it; none of it
comes from Myomorph's kernels or its estimate. See `myomorph.show.simulate.performer`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache, partial
from types import SimpleNamespace

import numpy as np

import myomorph as mm
from myomorph.core.model.series import Wrenches
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from myomorph.show.simulate import fighter
from myomorph.show.simulate.performances import foot_aims, path, smooth, weight_aims
from myomorph.show.simulate.performer import Contact, Part, performed

WIDE = 0.12  # Half the distance of the feet [m].
AHEAD = 0.05  # The mass center is so far ahead of the ankle [m].
LOW = 0.85  # Height of the mass center over the ground that both feet stand on [m].
RATE = 50.0
NOISE = 0.0007  # Of coordinates, smooth [rad, m].
CLEARANCE = 0.08  # Of a foot on its way over the higher of both ends [m].
UNLOAD = 0.2  # Before a foot lifts, and after it is down, it bears less and less for so long [s].


@dataclass(frozen=True)
class Way:
    """How a foot goes: `times` when it lifts and is down again, and how far ahead and up [m]."""

    lifts: float
    down: float
    ahead: float
    up: float


@dataclass(frozen=True)
class Plan:
    """What somebody does.

    `ways` by side, in the order of time; `weight` holds times, and ahead, up and sideways of the
    mass center at each.
    """

    ways: dict[str, tuple[Way, ...]]
    weight: tuple[tuple[float, float, float, float], ...]
    duration: float


def corners(side: str) -> np.ndarray:
    """Make the corners of the sole that is pressed on, a little inside the body's own.

    Parameters
    ----------
    side : "r" or "l"

    Returns
    -------
    (4, 3) in the foot [m]
    """
    sign = 1.0 if side == "r" else -1.0
    low = -fighter.SOLE_HEIGHT
    return np.array([(x, low, sign * z) for x in (-0.05, 0.16) for z in (-0.03, 0.04)])


def step_up(height: float, seed: int) -> Plan:
    """Plan of somebody who puts the left foot on a step, shifts weight onto it and climbs."""
    random = np.random.default_rng(seed)
    ahead = random.uniform(0.25, 0.32)
    inner = WIDE - 0.01
    return Plan(
        ways={
            "l": (Way(lifts=0.9, down=1.6, ahead=ahead, up=height),),
            "r": (Way(lifts=3.3, down=4.1, ahead=ahead, up=height),),
        },
        weight=(
            (0.2, 0.0, 0.0, 0.0),
            (0.8, 0.0, 0.0, inner),
            (1.7, 0.0, 0.0, inner),
            (3.1, ahead, 0.7 * height, -inner),
            (4.2, ahead, height, -inner),
            (5.0, ahead, height, 0.0),
        ),
        duration=5.2,
    )


def foot_on_step(height: float, seed: int, share: float = 0.45) -> Plan:
    """Plan of somebody who rests the left foot on a step for a while, weight on both."""
    random = np.random.default_rng(seed)
    ahead = random.uniform(0.15, 0.3)
    inner = WIDE - 0.01
    z = inner - share * 2.0 * WIDE
    x = share * ahead
    return Plan(
        ways={
            "l": (
                Way(lifts=0.9, down=1.6, ahead=ahead, up=height),
                Way(lifts=3.5, down=4.2, ahead=0.0, up=0.0),
            ),
            "r": (),
        },
        weight=(
            (0.2, 0.0, 0.0, 0.0),
            (0.8, 0.0, 0.0, inner),
            (1.7, 0.0, 0.0, inner),
            (2.3, x, 0.0, z),
            (2.8, x, 0.0, z),
            (3.4, 0.0, 0.0, inner),
            (4.3, 0.0, 0.0, inner),
            (4.9, 0.0, 0.0, 0.0),
        ),
        duration=5.0,
    )


def balance(height: float, seed: int) -> Plan:
    """Plan of somebody who holds the left foot up for a while: nothing is under it."""
    plan = foot_on_step(height, seed)
    held = tuple((time, 0.0, 0.0, WIDE - 0.01) for time in (0.8, 1.7, 3.4, 4.3))
    return Plan(
        ways=plan.ways,
        weight=((0.2, 0.0, 0.0, 0.0), *held, (4.9, 0.0, 0.0, 0.0)),
        duration=plan.duration,
    )


def _shift(ways: tuple[Way, ...], time: float) -> tuple[float, float]:
    """Find how far ahead and up a foot is at a time [m]."""
    ahead = 0.0
    up = 0.0
    for way in ways:
        if time < way.lifts:
            break
        middle = 0.5 * (way.lifts + way.down)
        top = max(up, way.up) + CLEARANCE
        rises = (way.lifts, middle, way.down)
        ahead += (way.ahead - ahead) * float(smooth(time, way.lifts, way.down))
        up = float(path(rises, (up, top, way.up), time))
    return ahead, up


def _aims(plan: Plan, time: float):
    """Aim the mass center and both feet."""
    times, x, y, z = zip(*plan.weight, strict=True)
    result = weight_aims(
        AHEAD + float(path(times, x, time)),
        LOW + float(path(times, y, time)),
        float(path(times, z, time)),
    )
    for side, ways in plan.ways.items():
        result += foot_aims(side, WIDE, shift=_shift(ways, time))
    return result


def _ready(ways: tuple[Way, ...], touches: bool, time: np.ndarray) -> np.ndarray:
    """Find how ready a foot is to carry (times,): not in the air, nor while it is held up."""
    off = [(way.lifts, way.down) for way in ways]
    if not touches and off:
        off = [(off[0][0], off[-1][1])]
    result = np.ones_like(np.asarray(time, float))
    for lifts, down in off:
        stops = (lifts - UNLOAD, lifts, down, down + UNLOAD)
        result = result - path(stops, (0.0, 1.0, 1.0, 0.0), time)
    return np.clip(result, 0.0, 1.0)


@cache
def _performed(plan_name: str, height: float, seed: int):
    """Simulate a plan; in one of balance nothing is under the foot that is held up."""
    plan = PLANS[plan_name](height, seed)
    contacts = [
        Contact(
            name=f"foot_{side}.{corner}",
            body=f"foot_{side}",
            points=corners(side)[corner : corner + 1],
            on=partial(_ready, plan.ways[side], plan_name != "balance"),
        )
        for side in "rl"
        for corner in range(len(corners(side)))
    ]
    return performed(Part(partial(_aims, plan), contacts, plan.duration, rate=RATE, seed=seed))


PLANS = {"step up": step_up, "foot on a step": foot_on_step, "balance": balance}


def stepped(name: str, height: float = 0.2, seed: int = 1) -> SimpleNamespace:
    """Make a recording of a plan, with the force of every foot.

    Parameters
    ----------
    name : of `PLANS`
    height : of the step [m]
    seed : of the plan, of masses, of how contacts share forces, and of noise

    Returns
    -------
    MJCF text and model, noisy motion as recorded and with rates at the laboratory's 6 Hz, true
    wrenches on both feet at its times, what plates in the floor measure of them, and the share of
    the weight that no contact gives (frames,)
    """
    shown = _performed(name, height, seed)
    random = np.random.default_rng(1000 + seed)
    noisy = mm.Motion(
        shown.motion.time,
        shown.motion.names,
        shown.motion.values + NOISE * _slow(random, shown.motion.values.shape),
    )
    motion = mm.differentiate(noisy, cutoff=6.0)
    wrenches = _of_feet(shown)
    return SimpleNamespace(
        text=shown.text,
        model=shown.body,
        recorded=noisy,
        motion=motion,
        wrenches=wrenches,
        plates=on_floor(wrenches),
        missing=np.linalg.norm(shown.missing[:, 3:], axis=1) / shown.body.weight,
    )


def on_floor(wrenches: Wrenches) -> Wrenches:
    """Leave out what plates in the floor do not measure: a foot that stands higher."""
    low = (wrenches.points[..., 1] < 0.02)[..., None]
    return replace(wrenches, forces=low * wrenches.forces, torques=low * wrenches.torques)


def _slow(random, shape):
    """White noise that a usual filter has smoothed, of unit size (frames, ...)."""
    window = np.hanning(9)
    white = random.normal(size=shape)
    smooth_noise = np.stack(
        [np.convolve(column, window, mode="same") for column in white.T], axis=1
    )
    return smooth_noise / smooth_noise.std()


def _of_feet(shown) -> Wrenches:
    """Sum the true forces of the corners of each foot, at its center of pressure."""
    tree = compile_tree(shown.body)
    poses = forward_kinematics(tree, tree.coordinates_of(shown.motion))
    forces = []
    points = []
    torques = []
    for side in "rl":
        number = tree.body_index[f"foot_{side}"]
        points_of_sole = corners(side)
        places = poses.points(np.full(len(points_of_sole), number), points_of_sole)
        own = np.stack(
            [
                shown.forces.values[:, shown.forces.names.index(f"foot_{side}.{corner}")]
                for corner in range(len(points_of_sole))
            ],
            axis=1,
        )
        press = np.maximum(own[..., 1], 0.0)
        total = press.sum(axis=1, keepdims=True)
        weights = np.where(total > 1e-6, press / np.maximum(total, 1e-6), 1.0 / len(points_of_sole))
        center = np.einsum("fc,fci->fi", weights, places)
        forces.append(own.sum(axis=1))
        points.append(center)
        torques.append(np.cross(places - center[:, None], own).sum(axis=1))
    return Wrenches(
        time=shown.motion.time,
        names=("plate_r", "plate_l"),
        bodies=("foot_r", "foot_l"),
        forces=np.stack(forces, axis=1),
        points=np.stack(points, axis=1),
        torques=np.stack(torques, axis=1),
    )
