"""A mouse of sticks that trots: two hind legs under a trunk, and two fore legs."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.functions import linear
from myomorph.core.model.model import GROUND, Axis, Body, Coordinate, Joint, Marker, Model
from myomorph.core.model.paths import Muscle, Path, PathPoint
from myomorph.core.model.series import Markers, Motion
from myomorph.core.model.spatial import Transform
from myomorph.core.motion.ik import InverseKinematicsOptions, inverse_kinematics
from myomorph.core.rigid.kinematics import marker_positions
from myomorph.show.simulate.gait.plan import smooth

MASS = 0.025  # [kg]
SHARES = {"trunk": 0.8, "thigh": 0.05, "shank": 0.035, "foot": 0.015}
THIGH = 0.016
SHANK = 0.018
FOOT = 0.016  # Lengths [m].
HIPS = 0.012  # Between them [m].
REST = {"hip_flexion": 55.0, "knee_angle": -95.0, "ankle_angle": 70.0}
"""Standing: thighs forward, crouched [degrees]."""
SPEED = 0.28  # [m/s]
STRIDE = 0.2  # [s]
DUTY = 0.45
RISE = 0.004  # Of a foot in swing [m].
HEIGHT = 0.031
BOB = 0.0006
ANKLE = 0.007  # Heights of hips, their amplitude, and ankles in stance [m].
ASIDE = 0.002  # Of a marker beside its leg [m].
STRIDES = 7
RATE = 200.0
NOISE = 2e-4  # Standard deviation of a marker [m].
SPREAD = 0.03  # Of the lengths of steps, over their mean.
MUSCLES = (
    ("quadriceps", 4.0, (("thigh", 0.003, -0.002), ("shank", 0.003, -0.004))),
    ("hamstrings", 3.0, (("trunk", -0.006, 0.0), ("shank", -0.002, -0.004))),
    ("gastrocnemius", 3.0, (("thigh", -0.002, -0.013), ("foot", -0.004, 0.0))),
    ("tibialis_anterior", 1.0, (("shank", 0.002, -0.005), ("foot", 0.004, 0.0))),
)
"""Name, maximum isometric force [N], and points: body, forward and up in it [m]."""


@dataclass(frozen=True, eq=False)
class SimulatedMouse:
    """A mouse with what cameras would have seen.

    Attributes
    ----------
    model : of the mouse
    motion : true coordinates [rad, m]
    markers : with noise [m]
    """

    model: Model
    motion: Motion
    markers: Markers


@cache
def mouse_model() -> Model:
    """Make a mouse whose trunk floats and whose hind legs have three hinges each."""
    sides = (("r", 1.0), ("l", -1.0))
    bodies = [_body("trunk", np.array([0.02, 0.004, 0.0]), 0.03)]
    joints = [_root()]
    markers = [
        Marker("Tail", "trunk", np.array([-0.008, 0.006, 0.0])),
        Marker("Spine", "trunk", np.array([0.02, 0.012, 0.0])),
        Marker("Neck", "trunk", np.array([0.05, 0.01, 0.0])),
    ]
    muscles = []
    for letter, sign in sides:
        bodies += [
            _body(f"thigh_{letter}", np.array([0.0, -THIGH / 2, 0.0]), THIGH),
            _body(f"shank_{letter}", np.array([0.0, -SHANK / 2, 0.0]), SHANK),
            _body(f"foot_{letter}", np.array([FOOT / 2, 0.0, 0.0]), FOOT),
        ]
        joints += _leg(letter, sign)
        markers += _leg_markers(letter, sign)
        muscles += [_muscle(letter, *row) for row in MUSCLES]
    angles = [f"{name}_{letter}" for letter, _ in sides for name in REST]
    defaults = [np.radians(REST[name[:-2]]) for name in angles]
    coordinates = [
        Coordinate("trunk_tilt", "rotational", range=(-1.5, 1.5)),
        Coordinate("trunk_tx", "translational", range=(-10.0, 10.0)),
        Coordinate("trunk_ty", "translational", default=0.03, range=(-1.0, 1.0)),
        *(
            Coordinate(name, "rotational", default=float(angle), range=(-3.0, 3.0))
            for name, angle in zip(angles, defaults, strict=True)
        ),
    ]
    return Model(
        name="simulated mouse",
        bodies=tuple(bodies),
        joints=tuple(joints),
        coordinates=tuple(coordinates),
        gravity=np.array([0.0, -9.80665, 0.0]),
        markers=tuple(markers),
        muscles=tuple(muscles),
    )


def _body(name: str, center: Array, length: float) -> Body:
    """Make a body as heavy as its share, with the inertia of a rod."""
    mass = MASS * SHARES[name.split("_")[0]]
    inertia = mass * length**2 / 12.0 * np.eye(3)
    return Body(name=name, mass=mass, mass_center=center, inertia=inertia)


def _root() -> Joint:
    tilt = _axis("rotation", 2, "trunk_tilt")
    slides = (_axis("translation", 0, "trunk_tx"), _axis("translation", 1, "trunk_ty"))
    still = Transform.identity()
    return Joint(
        name="ground_trunk",
        kind="CustomJoint",
        parent=GROUND,
        child="trunk",
        parent_frame=still,
        child_frame=still,
        axes=(*slides, tilt),
        coordinates=("trunk_tilt", "trunk_tx", "trunk_ty"),
    )


def _axis(kind: str, axis: int, name: str) -> Axis:
    if kind == "rotation":
        return Axis(
            kind="rotation", vector=np.eye(3)[axis], function=linear(1.0), coordinates=(name,)
        )
    return Axis(
        kind="translation", vector=np.eye(3)[axis], function=linear(1.0), coordinates=(name,)
    )


def _leg(letter: str, sign: float) -> list[Joint]:
    """Make hinges of hip, knee and ankle."""
    places = (
        ("hip_flexion", "trunk", "thigh", np.array([0.0, 0.0, sign * HIPS / 2])),
        ("knee_angle", "thigh", "shank", np.array([0.0, -THIGH, 0.0])),
        ("ankle_angle", "shank", "foot", np.array([0.0, -SHANK, 0.0])),
    )
    return [
        Joint(
            name=f"{name.split('_')[0]}_{letter}",
            kind="PinJoint",
            parent=parent if parent == "trunk" else f"{parent}_{letter}",
            child=f"{child}_{letter}",
            parent_frame=Transform(np.eye(3), place),
            child_frame=Transform.identity(),
            axes=(_axis("rotation", 2, f"{name}_{letter}"),),
            coordinates=(f"{name}_{letter}",),
        )
        for name, parent, child, place in places
    ]


def _leg_markers(letter: str, sign: float) -> list[Marker]:
    side = "Right" if letter == "r" else "Left"
    aside = ASIDE * sign
    places = (
        ("Hip", "trunk", (0.0, 0.0, sign * HIPS / 2 + aside)),
        ("Knee", f"thigh_{letter}", (0.0, -THIGH, aside)),
        ("Ankle", f"shank_{letter}", (0.0, -SHANK, aside)),
        ("Foot", f"foot_{letter}", (0.7 * FOOT, 0.0, aside)),
        ("Toe", f"foot_{letter}", (FOOT, 0.0, aside)),
    )
    return [Marker(f"{side}{name}", body, np.array(place)) for name, body, place in places]


def _muscle(
    letter: str, name: str, force: float, points: tuple[tuple[str, float, float], ...]
) -> Muscle:
    """Make a straight muscle."""
    sign = 1.0 if letter == "r" else -1.0
    path = [
        PathPoint(
            f"{name}_{letter}_{number}",
            body if body == "trunk" else f"{body}_{letter}",
            np.array([x, y, sign * HIPS / 2 if body == "trunk" else 0.0]),
        )
        for number, (body, x, y) in enumerate(points, 1)
    ]
    return Muscle(
        name=f"{name}_{letter}",
        kind="Millard2012EquilibriumMuscle",
        path=Path(tuple(path)),
        max_isometric_force=force,
        optimal_fiber_length=0.006,
        tendon_slack_length=0.01,
    )


def simulated_mouse(seed: int) -> SimulatedMouse:
    """Let a mouse trot along x, and see its markers.

    Parameters
    ----------
    seed : of the differences between steps, and of the noise
    """
    random = np.random.default_rng(seed)
    model = mouse_model()
    time = np.arange(round(STRIDES * STRIDE * RATE)) / RATE
    trunk = {
        "trunk_tilt": np.zeros(len(time)),
        "trunk_tx": SPEED * time,
        "trunk_ty": HEIGHT + BOB * np.cos(4.0 * np.pi * time / STRIDE),
    }
    held = Motion(time, tuple(trunk), np.stack(list(trunk.values()), axis=1))
    right = _foot_path(time, 0.0, random)
    left = _foot_path(time, 0.5, random)
    aside = np.array([0.0, 0.0, HIPS / 2 + ASIDE])
    feet = Markers(
        time,
        ("RightAnkle", "RightToe", "LeftAnkle", "LeftToe"),
        np.concatenate([right + aside, left - aside], axis=1),
    )
    led = model.with_markers(tuple(map(model.marker, feet.names))).lock(*trunk)
    motion = inverse_kinematics(led, feet, InverseKinematicsOptions(coordinates=held)).motion
    exact = marker_positions(model, motion)
    noise = NOISE * random.standard_normal(exact.values.shape)
    markers = Markers(time, exact.names, exact.values + noise)
    return SimulatedMouse(model=model, motion=motion, markers=markers)


def _foot_path(time: Array, phase: float, random: np.random.Generator) -> Array:
    """Find ankle and toe of a foot that stands and swings, in the middle plane.

    Parameters
    ----------
    time : (frames,) [s]
    phase : of its strikes, as a share of a stride

    Returns
    -------
    (frames, 2, 3) [m]
    """
    count = STRIDES + 4
    strikes = (np.arange(count) - 2.0 + phase) * STRIDE
    way = SPEED * STRIDE
    # Half of a stance before and after the ankle is below the hip
    places = SPEED * (strikes + 0.5 * DUTY * STRIDE) + SPREAD * way * random.standard_normal(count)
    step = np.searchsorted(strikes, time, side="right") - 1
    share = (time - strikes[step]) / STRIDE
    swing = np.clip((share - DUTY) / (1.0 - DUTY), 0.0, 1.0)
    ankle = np.zeros((len(time), 3))
    ankle[:, 0] = places[step] + smooth(swing) * (places[step + 1] - places[step])
    ankle[:, 1] = ANKLE + RISE * np.sin(np.pi * swing) ** 2
    toe = ankle + np.array([np.sqrt(FOOT**2 - ANKLE**2), -ANKLE, 0.0])
    return np.stack([ankle, toe], axis=1)
