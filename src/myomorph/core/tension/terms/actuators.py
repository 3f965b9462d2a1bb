"""Ideal actuators as a term: controls, their generalized forces, and default reserves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadModel
from myomorph.core.model.model import GROUND, Actuator, Joint, Model, index_of
from myomorph.core.motion.lengths import length_unit
from myomorph.core.rigid.kernels import inner, kernel
from myomorph.core.rigid.kinematics import body_poses, pose_room
from myomorph.core.rigid.knees import THIGH
from myomorph.core.rigid.tree import ROTATION, Tree, compile_tree
from myomorph.core.rigid.vectors import along, cross, dot, matrix, minus, norm, plus, turned, vector
from myomorph.core.tension.tension import RESERVE, RESIDUAL
from myomorph.core.tension.terms.term import Columns, Frames, Penalties, Term, Unknowns, Variables

TORQUE = 0
POINT = 1
POINT_TO_POINT = 2
_KINDS = {"torque": TORQUE, "point": POINT, "point_to_point": POINT_TO_POINT}


RESERVE_FORCE = 1.0
RESIDUAL_FORCE = 10.0
"""Optimal force of a reserve and of a residual on a body of human size [N], [N m]."""
ROTATOR_FORCE = 5.0
"""Optimal force of the reserve of a hip's axial rotation where a model lacks what turns a bent
thigh outward [N m].

Gluteus maximus turns a thigh inward that is bent by 90 degrees. Without its antagonists hamstrings
must straighten the hip alone, against quadriceps.
"""
ROTATORS = ("quadfem", "quadratus", "obturator", "obtur", "gem")
"""How names of those muscles begin, lower case without underscores: quadratus femoris, obturators,
gemelli.
"""
NEAR_ZERO_COST = 1e-6
"""Cost of u^2 that controls have besides |u|^p where p > 2: near 0 that power alone has no
curvature to step by.
"""


class BodyActuators(NamedTuple):
    """Actuators that push or turn bodies, as the kernel reads them.

    Attributes
    ----------
    kind : (actuators,) TORQUE, POINT or POINT_TO_POINT
    body, other : (actuators,) numbers in the tree; -1 where nothing reacts
    point, other_point : (actuators, 3) in the bodies' frames, or in ground [m]
    direction : (actuators, 3) unit vectors in the body's frame, or in ground
    global_point, global_direction : (actuators,) whether they are in ground
    start : (actuators + 1,) entries of an actuator are start[a] ... start[a + 1] - 1
    coordinate : (entries,) the coordinates it can have a part in
    supports : (bodies, axes) whether an axis lies between the ground and a body
    """

    kind: NDArray[np.int64]
    body: NDArray[np.int64]
    other: NDArray[np.int64]
    point: Array
    other_point: Array
    direction: Array
    global_point: NDArray[np.bool_]
    global_direction: NDArray[np.bool_]
    start: NDArray[np.int64]
    coordinate: NDArray[np.int64]
    supports: NDArray[np.bool_]


def compile_body_actuators(tree: Tree, actuators: Sequence[Actuator]) -> BodyActuators:
    """Torque, point and point-to-point actuators as flat arrays, in the order given.

    Raises
    ------
    UnknownName : an actuator's body is not in the model
    BadModel : an actuator has no direction
    """
    bodies = []
    others = []
    coordinates = []
    start = [0]
    for actuator in actuators:
        where = f"actuator '{actuator.name}': the model"
        bodies.append(tree.body_number(actuator.body, where))
        others.append(tree.body_number(actuator.other_body, where) if actuator.other_body else -1)
        if actuator.kind != "point_to_point" and not np.linalg.norm(actuator.direction) > 0.0:
            raise BadModel(f"actuator '{actuator.name}' has direction (0, 0, 0)")
        coordinates += _reached_coordinates(tree, bodies[-1], others[-1])
        start.append(len(coordinates))
    direction = _vectors([actuator.direction for actuator in actuators])
    length = np.linalg.norm(direction, axis=1, keepdims=True)
    return BodyActuators(
        kind=np.array([_KINDS[actuator.kind] for actuator in actuators], np.int64),
        body=np.array(bodies, np.int64),
        other=np.array(others, np.int64),
        point=_vectors([actuator.point for actuator in actuators]),
        other_point=_vectors([actuator.other_point for actuator in actuators]),
        direction=direction / np.where(length > 0.0, length, 1.0),
        global_point=np.array([actuator.point_is_global for actuator in actuators], np.bool_),
        global_direction=np.array(
            [actuator.direction_is_global for actuator in actuators], np.bool_
        ),
        start=np.array(start, np.int64),
        coordinate=np.array(coordinates, np.int64),
        supports=np.ascontiguousarray(tree.supports),
    )


def _vectors(rows: Sequence[ArrayLike]) -> Array:
    """Stack vectors, (vectors, 3) also where there is none."""
    return np.array(rows, dtype=np.float64).reshape(-1, 3)


def _reached_coordinates(tree: Tree, body: int, other: int) -> list[int]:
    """Coordinates that an actuator can have a part in; `other` -1 where nothing reacts.

    What both bodies hang on moves them alike, but need not cancel: a force pair has two points.
    """
    numbers = [number for number in (body, other) if number >= 0]
    supported = tree.supports[numbers].any(axis=0)
    coordinates = np.unique(tree.arrays.axis_coordinate[supported])
    return [int(coordinate) for coordinate in coordinates[coordinates >= 0]]


@kernel
def body_directions(T, actuators, coordinates, out):
    """Fill generalized forces per unit of force or torque of every body actuator.

    Parameters
    ----------
    T, actuators : arrays of the tree, `BodyActuators`
    coordinates : (frames, coordinates)
    out : (frames, entries) filled, on their `coordinate`
    """
    pose = pose_room(T)
    column = np.empty(coordinates.shape[1])
    zero = (0.0, 0.0, 0.0)
    for frame in range(coordinates.shape[0]):
        body_poses(T, coordinates[frame], pose)
        for a in range(actuators.kind.shape[0]):
            for e in range(actuators.start[a], actuators.start[a + 1]):
                column[actuators.coordinate[e]] = 0.0
            b = actuators.body[a]
            other = actuators.other[a]
            d = vector(actuators.direction, a)
            if not actuators.global_direction[a]:
                d = turned(matrix(pose.R, b), d)
            if actuators.kind[a] == TORQUE:
                _add_work(T, actuators, pose, b, zero, d, column)
                if other >= 0:
                    _add_work(T, actuators, pose, other, zero, minus(zero, d), column)
            else:
                x = _place(actuators, a, pose, vector(actuators.point, a), b)
                if actuators.kind[a] == POINT_TO_POINT:
                    # A positive force drives the points apart.
                    y = _place(actuators, a, pose, vector(actuators.other_point, a), max(other, 0))
                    d = minus(x, y)
                    d = along(zero, 1.0 / norm(d), d)
                    if other >= 0:
                        _add_work(T, actuators, pose, other, minus(zero, d), cross(d, y), column)
                _add_work(T, actuators, pose, b, d, cross(x, d), column)
            for e in range(actuators.start[a], actuators.start[a + 1]):
                out[frame, e] = column[actuators.coordinate[e]]


@inner
def _place(actuators, a, pose, point, body):
    """Point of an actuator in ground."""
    if actuators.global_point[a]:
        return point
    return plus(vector(pose.p, body), turned(matrix(pose.R, body), point))


@inner
def _add_work(T, actuators, pose, body, force, moment, column):
    """Add the generalized forces of a force and its moment on a body to `column`.

    Parameters
    ----------
    T, actuators : arrays of the tree, `BodyActuators`
    pose : of `body_poses`
    force, moment : on the body, the moment about the ground's origin
    column : (coordinates,) added to
    """
    for index in range(T.axis_kind.shape[0]):
        if actuators.supports[body, index]:
            acts = force
            if T.axis_kind[index] == ROTATION:
                acts = minus(moment, cross(vector(pose.o, index), force))
            power = dot(vector(pose.w, index), acts)
            for s in range(2):
                if T.axis_coordinate[index, s] >= 0:
                    column[T.axis_coordinate[index, s]] += pose.dphi[index, s] * power


def balanced_coordinates(model: Model) -> tuple[str, ...]:
    """Coordinates whose torque has to be balanced.

    They are neither locked nor prescribed, and no coupler drives them.
    """
    return tuple(
        coordinate.name
        for coordinate in model.coordinates
        if not coordinate.locked
        and coordinate.prescribed is None
        and coordinate.name not in model.dependent_coordinates
    )


def default_reserves(
    model: Model, reserve: float | None = None, residual: float | None = None
) -> tuple[Actuator, ...]:
    """Add a weak actuator to every free coordinate, and force and torque to bodies that float.

    What is weak on a human is not on a mouse: by default forces go with the cube and torques with
    the fourth power of the body's `length_unit`, as weights and their moments do. `ROTATOR_FORCE`
    stands in for muscles that many models of the leg leave out.

    Parameters
    ----------
    model : of the body
    reserve : optimal force of the coordinates' actuators, named "reserve_<coordinate>" [N m or N]
    residual : optimal force of what holds a body that is joined to the ground by six free
        coordinates: "residual_FX" ... "residual_FZ" at its mass center and "residual_MX" ...
        "residual_MZ", along the ground's axes [N], [N m]

    Returns
    -------
    residuals first, then reserves in the order of coordinates
    """
    unit = length_unit(compile_tree(model)) if reserve is None or residual is None else 1.0
    floating = floating_joints(model)
    actuators: list[Actuator] = []
    for joint in floating:
        ending = "" if len(floating) == 1 else f"_{joint.child}"
        force = RESIDUAL_FORCE * unit**3 if residual is None else residual
        torque = RESIDUAL_FORCE * unit**4 if residual is None else residual
        actuators += _residuals(model, joint, "point", force, ending)
        actuators += _residuals(model, joint, "torque", torque, ending)

    held = {name for joint in floating for name in joint.coordinates}
    weak = _without_rotators(model)
    for name in balanced_coordinates(model):
        if name in held:
            continue
        power = 3 if model.coordinate(name).motion == "translational" else 4
        strength = ROTATOR_FORCE if name in weak else RESERVE_FORCE
        optimal_force = strength * unit**power if reserve is None else reserve
        actuators.append(Actuator(f"{RESERVE}{name}", "coordinate", optimal_force, coordinate=name))
    return tuple(actuators)


def _residuals(
    model: Model, joint: Joint, kind: Literal["point", "torque"], optimal_force: float, ending: str
) -> list[Actuator]:
    """Make forces or torques along the ground's axes that hold the body of a joint."""
    letter = {"point": "F", "torque": "M"}[kind]
    return [
        Actuator(
            name=f"{RESIDUAL}{letter}{axis}{ending}",
            kind=kind,
            optimal_force=optimal_force,
            body=joint.child,
            point=model.body(joint.child).mass_center,
            direction=direction,
        )
        for axis, direction in zip("XYZ", np.eye(3), strict=True)
    ]


def _without_rotators(model: Model) -> set[str]:
    """Coordinates of the hips' axial rotation of a model whose rotators are missing.

    There are none where the model has no muscles, or rotators among them.
    """
    plain = [muscle.name.lower().replace("_", "") for muscle in model.muscles]
    if not plain or any(name.startswith(ROTATORS) for name in plain):
        return set()
    hips = [joint for joint in model.joints if any(word in joint.child.lower() for word in THIGH)]
    return {name for joint in hips for name in joint.coordinates if "rotation" in name.lower()}


def floating_joints(model: Model) -> tuple[Joint, ...]:
    """Joints to the ground with six free coordinates.

    Each holds a subject or an object that floats.
    """
    free = set(balanced_coordinates(model))
    return tuple(joint for joint in model.joints if joint.parent == GROUND and _floats(joint, free))


def _floats(joint: Joint, free: set[str]) -> bool:
    """Tell whether a joint lets its body move and turn all ways by coordinates of its own."""
    moving = [axis for axis in joint.axes if axis.function.arity]
    used = {name for axis in moving for name in axis.coordinates}
    rotations = sum(axis.kind == "rotation" for axis in moving)
    return (
        len(moving) == 6
        and rotations == 3
        and used == set(joint.coordinates)
        and len(used) == 6
        and used <= free
    )


class ActuatorTerm(Term):
    """sum_r |u_r|^p of controls u, with generalized forces D u.

    The actuators are reserves, residuals and the model's own.

    Attributes
    ----------
    actuators : in the order of their controls
    optimal_forces : (actuators,) [N or N m]
    """

    def __init__(self, tree: Tree, actuators: Sequence[Actuator], exponent: float):
        self.actuators = tuple(actuators)
        self.optimal_forces = np.array(
            [actuator.optimal_force for actuator in actuators], dtype=np.float64
        )
        self._tree = tree
        self._exponent = exponent
        self._on_bodies = [
            i for i, actuator in enumerate(actuators) if actuator.kind != "coordinate"
        ]
        self._bodies = compile_body_actuators(tree, [actuators[i] for i in self._on_bodies])

    def variables(self) -> Variables:
        """Bounds and effort of the controls."""
        count = len(self.actuators)
        return Variables(
            names=tuple(actuator.name for actuator in self.actuators),
            weight=np.ones(count),
            exponent=np.full(count, self._exponent),
            lower=np.array([actuator.min_control for actuator in self.actuators], np.float64),
            upper=np.array([actuator.max_control for actuator in self.actuators], np.float64),
        )

    def entries(self) -> Sequence[tuple[int, int]]:
        """Control and coordinate of actuators on bodies first, then of those on coordinates."""
        names = self._tree.model.coordinate_names
        bodies = self._bodies
        owner = np.repeat(self._on_bodies, np.diff(bodies.start)).astype(np.int64)
        result = list(zip(owner.tolist(), bodies.coordinate.tolist(), strict=True))
        return result + [
            (i, index_of("coordinate", actuator.coordinate, names))
            for i, actuator in enumerate(self.actuators)
            if actuator.kind == "coordinate"
        ]

    def columns(self, frames: Frames) -> Columns:
        """Generalized forces of unit forces, and the optimal forces."""
        filled = np.empty((len(frames), len(self._bodies.coordinate)))
        if filled.shape[1]:
            body_directions(self._tree.arrays, self._bodies, frames.coordinates, filled)
        ones = np.ones((len(frames), len(self.actuators) - len(self._on_bodies)))
        forces = np.broadcast_to(self.optimal_forces, (len(frames), len(self.actuators)))
        return Columns(np.hstack([filled, ones]), forces)

    def penalties(self, unknowns: Unknowns) -> Penalties | None:
        """Add a curvature at 0 where the exponent leaves none."""
        if self._exponent <= 2.0:
            return None
        columns = unknowns.of(self)
        zero = np.zeros((1, len(self.actuators)))
        return Penalties(
            columns=range(columns.start, columns.stop),
            low=zero,
            high=zero,
            weight=np.full_like(zero, NEAR_ZERO_COST),
        )
