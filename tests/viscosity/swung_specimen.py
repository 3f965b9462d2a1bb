"""A specimen swung by an integrator of its own.

Markers without noise, wrench without noise, and the truth.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

from myomorph.core.model.arrays import Array
from myomorph.core.model.functions import linear
from myomorph.core.model.inertia import inertia_matrices, inertial_parameters
from myomorph.core.model.model import GROUND, Axis, Body, Coordinate, Joint, Model
from myomorph.core.model.paths import Muscle, Path, PathPoint
from myomorph.core.model.series import Markers, Motion, Wrenches
from myomorph.core.model.spatial import Transform, axis_rotation
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from myomorph.swings.simulate.limb import with_clusters
from myomorph.swings.viscosity.specimen.bodies import moved_parameters
from myomorph.swings.viscosity.specimen.model import (
    Specimen,
    SpecimenNames,
    SwingTrial,
    build_specimen,
)

STEP = 1e-3
EVERY = 5
"""Samples of the plate, 1000 Hz, a frame of the markers, 200 Hz."""

HELD = {"elbow": 0.35, "forearm": -0.4, "wrist_a": 0.1, "wrist_b": -0.15}


CENTER = (-0.01, -0.03, 0.01)
"""Of the shoulder, in the scapula [m]."""

PATHS = {
    "front": [("scapula", (0.02, -0.02, 0.02)), ("humerus", (0.01, -0.09, 0.015))],
    "back_1": [("scapula", (-0.07, -0.03, -0.03)), ("humerus", (-0.01, -0.04, 0.01))],
    "back_2": [("scapula", (-0.06, -0.07, -0.03)), ("humerus", (-0.012, -0.05, 0.0))],
    "long": [
        ("scapula", (-0.01, -0.055, 0.02)),
        ("humerus", (0.0, -0.2, 0.03)),
        ("ulna", (0.02, -0.02, 0.0)),
    ],
    "chest": [("trunk", (0.1, 0.3, 0.05)), ("humerus", (0.01, -0.06, 0.0))],
}
FORCES = {"front": 300.0, "back_1": 100.0, "back_2": 300.0, "long": 200.0, "chest": 200.0}


def arm_model() -> Model:
    """Make a trunk, a scapula on it, an arm on a chain with a phantom body, and muscles.

    The wrist has two axes.
    """
    joints = arm_joints()
    names = [name for one in joints for name in one.coordinates]
    coordinates = tuple(
        Coordinate(name, default=0.2 if name == "elevation" else 0.0) for name in names
    )
    muscles = tuple(
        Muscle(
            name=name,
            kind="made",
            path=muscle_path(name),
            max_isometric_force=FORCES[name],
            optimal_fiber_length=0.1,
            tendon_slack_length=0.1,
        )
        for name in PATHS
    )
    return Model(
        name="arm",
        bodies=arm_bodies(),
        joints=joints,
        coordinates=coordinates,
        gravity=np.array([0.0, -9.81, 0.0]),
        muscles=muscles,
    )


def arm_bodies() -> tuple[Body, ...]:
    """Return the bodies from the trunk to a finger."""
    return (
        made_body("trunk", 20.0, (0.0, 0.1, 0.0)),
        made_body("scapula", 0.5, (-0.04, -0.03, -0.04)),
        made_body("phantom", 1e-4, (0.0, 0.0, 0.0)),
        made_body("humerus", 1.2, (0.01, -0.14, -0.01)),
        made_body("ulna", 0.4, (0.01, -0.1, 0.02)),
        made_body("radius", 0.3, (0.01, -0.12, 0.01)),
        made_body("carpus", 0.1, (0.0, -0.01, 0.0)),
        made_body("hand", 0.2, (0.0, -0.06, 0.0)),
        made_body("finger", 0.05, (0.0, -0.02, 0.0)),
    )


def made_body(name: str, mass: float, center: tuple[float, float, float]) -> Body:
    """Return a body of a mass [kg] with its center at a place [m]."""
    return Body(
        name=name,
        mass=mass,
        mass_center=np.array(center),
        inertia=mass * np.diag([0.004, 0.001, 0.004]),
    )


def arm_joints() -> tuple[Joint, ...]:
    """Return the joints from the ground to a finger."""
    return (
        _made_joint("root", GROUND, "trunk", (0.0, 1.0, 0.0), [("y", "heading")]),
        _made_joint(
            "scapulothoracic",
            "trunk",
            "scapula",
            (0.0, 0.4, 0.15),
            [("y", "protraction")],
            (0.1, -0.5, 0.2),
        ),
        _made_joint(
            "plane",
            "scapula",
            "phantom",
            (-0.01, -0.03, 0.01),
            [("y", "plane"), ("x", "elevation")],
            (0.0, 0.4, 0.1),
        ),
        _made_joint("rotation", "phantom", "humerus", (0.0, 0.0, 0.0), [("y", "rotation")]),
        _made_joint(
            "elbow", "humerus", "ulna", (0.005, -0.29, -0.01), [("z", "elbow")], (0.05, 0.0, 0.1)
        ),
        _made_joint("forearm", "ulna", "radius", (0.0, -0.01, 0.02), [("y", "forearm")]),
        _made_joint(
            "wrist", "radius", "carpus", (0.02, -0.23, 0.01), [("x", "wrist_a")], (0.0, 0.3, 0.0)
        ),
        _made_joint("palm", "carpus", "hand", (0.0, -0.02, 0.0), [("z", "wrist_b")]),
        _made_joint("finger", "hand", "finger", (0.0, -0.09, 0.0), [("z", "grip")]),
    )


def _made_joint(name: str, parent: str, child: str, at, axes=(), turn=(0.0, 0.0, 0.0)) -> Joint:
    """Return a joint at a place [m] and turned [rad] in its parent, with axes for coordinates."""
    made = tuple(
        Axis(
            kind="rotation",
            vector=np.eye(3)["xyz".index(axis)],
            function=linear(1.0),
            coordinates=(one,),
        )
        for axis, one in axes
    )
    return Joint(
        name=name,
        kind="made",
        parent=parent,
        child=child,
        parent_frame=Transform.from_euler_xyz(turn, at),
        child_frame=Transform.identity(),
        axes=made,
        coordinates=tuple(one for _, one in axes),
    )


def muscle_path(name: str) -> Path:
    """Return the path of a muscle by its points in `PATHS`."""
    return Path(
        tuple(PathPoint(f"{name}{i}", one, np.array(at)) for i, (one, at) in enumerate(PATHS[name]))
    )


NAMES = SpecimenNames(
    base="scapula",
    first="humerus",
    bones=("ulna", "radius", "hand"),
    muscles={"front": ("front",), "back": ("back_1", "back_2"), "long": ("long",)},
)


def arm_specimen() -> Specimen:
    """Make the specimen of the made arm, on a plate somewhere in the laboratory, with clusters."""
    specimen = with_clusters(build_specimen(arm_model(), NAMES))
    stand = Transform.from_euler_xyz((0.3, -1.1, 0.2), (0.4, 1.3, -0.2))
    return specimen.standing(stand)


@dataclass(frozen=True, eq=False)
class Swung:
    """A recording with what is true of it.

    Attributes
    ----------
    rotations, rates : (frames, 3, 3), (frames, 3) of the humerus in ground, and in its own axes
    parameters : (10,) of the limb about the joint's center
    """

    trial: SwingTrial
    rotations: Array
    rates: Array
    parameters: Array
    damping: float


def limb_parameters(specimen: Specimen, held: Mapping[str, float]) -> Array:
    """Return inertial parameters of all bones of the limb about the joint's center.

    Parameters
    ----------
    specimen : with its limb
    held : angles of coordinates by name, 0 for the others [rad]

    Returns
    -------
    (10,) along the humerus' axes
    """
    model = specimen.model
    tree = compile_tree(model)
    values = np.array([[held.get(name, 0.0) for name in model.coordinate_names]])
    poses = forward_kinematics(tree, values)

    def pose(name: str) -> Transform:
        b = tree.body_index[name]
        return Transform(poses.rotations[0, b], poses.origins[0, b])

    frame = pose(specimen.first) @ Transform(np.eye(3), specimen.center_in_limb)
    table = dict(zip(model.body_names, inertial_parameters(model), strict=True))
    return sum(
        moved_parameters(table[name], frame.inverse() @ pose(name)) for name in specimen.limb
    )


@dataclass(frozen=True, kw_only=True)
class Release:
    """How a limb is let go.

    Attributes
    ----------
    name : of the recording
    turned : rotation vector from hanging [rad]
    seconds : length of the recording [s]
    damping : of every axis of the joint [N m s/rad]
    held : angles of the other coordinates by name [rad]
    hold : time for which a hand holds the limb at first [s]
    """

    name: str = "swing"
    turned: tuple[float, float, float] = (0.6, 0.2, -0.5)
    seconds: float = 6.0
    damping: float = 0.05
    held: Mapping[str, float] = field(default_factory=lambda: HELD)
    hold: float = 0.0


USUAL = Release()


def swing(specimen: Specimen, release: Release = USUAL) -> Swung:
    """Let the limb go, and record it."""
    limb = _Limb(specimen, release)
    path = _path(limb, specimen, release)
    wrenches = _plate_wrenches(limb, specimen, path)
    seen = path.rotations[::EVERY]
    markers = markers_of(specimen, path.time[::EVERY], seen, release.held)
    return Swung(
        trial=SwingTrial(release.name, markers, wrenches),
        rotations=seen,
        rates=path.rates[::EVERY],
        parameters=limb.parameters,
        damping=release.damping,
    )


class _Limb:
    """Equations of motion of a limb about the joint's center, along the humerus' axes.

    Attributes
    ----------
    parameters : (10,) of all its bones
    damping : of every axis [N m s/rad]
    gravity : (3,) in ground [m/s^2]
    """

    def __init__(self, specimen: Specimen, release: Release) -> None:
        self.parameters = limb_parameters(specimen, release.held)
        self.damping = release.damping
        self.gravity = specimen.model.gravity
        self.inertia = inertia_matrices(self.parameters)
        self._inverse = np.linalg.inv(self.inertia)

    @property
    def first_moment(self) -> Array:
        """(3,) [kg m]."""
        return self.parameters[1:4]

    def acceleration(self, R: Array, w: Array) -> Array:
        """Return angular accelerations.

        Parameters
        ----------
        R : (..., 3, 3) rotations in ground
        w : (..., 3) angular velocities [rad/s]

        Returns
        -------
        (..., 3) [rad/s^2]
        """
        moment = (
            np.cross(self.first_moment, np.einsum("...ji,j->...i", R, self.gravity))
            - self.damping * w
            - np.cross(w, w @ self.inertia)
        )
        return moment @ self._inverse

    def slope(self, _: float, state: Array) -> Array:
        """Return the derivative of a state (12,): rotation, row by row, and angular velocity."""
        R = state[:9].reshape(3, 3)
        w = state[9:]
        x, y, z = w
        spin = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        return np.concatenate([(R @ spin).ravel(), self.acceleration(R, w)])


class _Path(NamedTuple):
    """Motion of the limb at the plate's samples."""

    time: Array  # (samples,) [s]
    free: Array  # (samples,) whether the hand has let go
    rotations: Array  # (samples, 3, 3) in ground
    rates: Array  # (samples, 3) in the humerus [rad/s]
    accelerations: Array  # (samples, 3) in the humerus [rad/s^2]


def _path(limb: _Limb, specimen: Specimen, release: Release) -> _Path:
    gravity = specimen.model.gravity
    h = limb.first_moment
    hanging = _turn_onto(h / np.linalg.norm(h), gravity / np.linalg.norm(gravity))
    angle = float(np.linalg.norm(release.turned))
    start = hanging @ axis_rotation(np.array(release.turned) / angle, angle)
    time = STEP * np.arange(round(release.seconds / STEP))
    after = time >= release.hold
    begin = np.concatenate([start.ravel(), np.zeros(3)])
    states = np.tile(begin, (len(time), 1))
    solved = solve_ivp(
        limb.slope,
        (release.hold, release.seconds),
        begin,
        method="DOP853",
        t_eval=time[after],
        rtol=1e-10,
        atol=1e-11,
        max_step=0.05,
    )
    states[after] = solved.y.T
    R = states[:, :9].reshape(-1, 3, 3)
    w = states[:, 9:]
    a = np.where(after[:, None], limb.acceleration(R, w), 0.0)
    return _Path(time=time, free=after, rotations=R, rates=w, accelerations=a)


def _plate_wrenches(limb: _Limb, specimen: Specimen, path: _Path) -> Wrenches:
    """Return what carries the base, at a point off the joint's center."""
    h = limb.first_moment
    w = path.rates
    moment = np.einsum("fij,fj->fi", path.rotations, -limb.damping * w)
    pull = np.cross(path.accelerations, h) + np.cross(w, np.cross(w, h))
    force = np.einsum("fij,fj->fi", path.rotations, pull) - limb.parameters[0] * limb.gravity
    force[~path.free] *= 0.3  # The hand carries the rest.
    center = specimen.center_in_ground
    point = np.tile(center + [0.1, 0.0, -0.05], (len(path.time), 1))
    torque = moment - np.cross(point - center, force)
    return Wrenches(
        time=path.time,
        names=("plate",),
        bodies=("",),
        forces=force[:, None],
        points=point[:, None],
        torques=torque[:, None],
    )


def _turn_onto(one: Array, other: Array) -> Array:
    axis = np.cross(one, other)
    size = float(np.linalg.norm(axis))
    return axis_rotation(axis / size, float(np.arctan2(size, one @ other)))


def markers_of(
    specimen: Specimen, time: Array, rotations: Array, held: Mapping[str, float]
) -> Markers:
    """Return where the clusters are while the humerus rotates.

    Parameters
    ----------
    specimen : with its markers
    time : (frames,) [s]
    rotations : (frames, 3, 3) of the humerus in ground
    held : angles of the other coordinates by name, 0 where none is given [rad]

    Returns
    -------
    Markers of all clusters in ground [m]
    """
    model = specimen.model
    center = Transform(np.eye(3), specimen.center)
    in_limb = Transform(np.eye(3), specimen.center_in_limb)
    joints = tuple(
        replace(one, axes=(), coordinates=(), parent_frame=center, child_frame=in_limb)
        if one.child == specimen.first
        else one
        for one in model.joints
    )
    coordinates = tuple(
        replace(one, default=held.get(one.name, 0.0))
        for one in model.coordinates
        if one.name not in specimen.joint_coordinates
    )
    straight = replace(model, joints=joints, muscles=(), coordinates=coordinates)
    tree = compile_tree(straight)
    poses = forward_kinematics(tree, tree.coordinates_of(Motion(np.zeros(1), (), np.zeros((1, 0)))))
    columns = []
    about = specimen.center_in_ground
    base = tree.body_index[specimen.base]
    for one in model.markers:
        b = tree.body_index[one.body]
        place = poses.points(np.array([b]), one.location[None])[0, 0]
        if b == base:
            columns.append(np.tile(place, (len(time), 1)))
        else:
            # Straight, the humerus has the rotation of the base.
            arm = poses.rotations[0, base].T @ (place - about)
            columns.append(about + np.einsum("fij,j->fi", rotations, arm))
    return Markers(time, tuple(one.name for one in model.markers), np.stack(columns, axis=1))
