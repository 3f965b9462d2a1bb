"""Joints as MuJoCo has them: each axis one hinge or slide with a coordinate of its own.

An axis that moves by a function of a coordinate gets a coordinate that follows the first, and so
does each direction in which a path point moves: such a point becomes a body without mass. Nothing
is approximated here.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadModel
from myomorph.core.model.functions import Function, SineProduct, linear, value_at
from myomorph.core.model.model import Axis, Body, Coordinate, Coupler, Joint, Model
from myomorph.core.model.paths import MovingPathPoint, Muscle, PathPoint
from myomorph.core.model.spatial import Transform
from myomorph.core.rigid.coordinates import couple_frames
from myomorph.core.rigid.tree import compile_tree

WIDEST = {"rotational": np.pi, "translational": 0.1, "coupled": np.pi}
"""Range on both sides of a coordinate's default beyond which no joint goes [rad or m]."""

FREE_RANGE = np.pi / 2  # That of a coordinate without a range [rad or m].
SWEEP = 41
FEWEST = 7
ALTOGETHER = 1600
"""Poses of each coordinate alone, the others at their defaults: at most, at least, and of all
coordinates.
"""


def range_of(coordinate: Coordinate) -> tuple[float, float]:
    """Bounds between which a coordinate is compared with MuJoCo [rad or m]; a locked one stands."""
    if coordinate.locked:
        return coordinate.default, coordinate.default
    low, high = coordinate.range
    widest = min(
        WIDEST[coordinate.motion], np.inf if np.isfinite([low, high]).all() else FREE_RANGE
    )
    return max(low, coordinate.default - widest), min(high, coordinate.default + widest)


def poses_over_ranges(model: Model, count: int, seed: int = 0) -> tuple[Array, Array]:
    """Return coordinates over their ranges, dependent ones consistent.

    First each is moved alone, then all together at random.

    Parameters
    ----------
    model : with the coordinates
    count : of poses in which all coordinates move
    seed : of the random poses

    Returns
    -------
    (poses, coordinates) [rad or m], and (poses,) index of the coordinate that moves alone, -1 where
    all do
    """
    tree = compile_tree(model)
    bounds = np.array([range_of(coordinate) for coordinate in model.coordinates])
    count_alone = int(np.clip(ALTOGETHER // max(len(tree.independent), 1), FEWEST, SWEEP))
    rows = []
    swept = []
    for j in tree.independent:
        if bounds[j, 1] > bounds[j, 0]:
            rows.append(np.tile(tree.defaults, (count_alone, 1)))
            rows[-1][:, j] = np.linspace(bounds[j, 0], bounds[j, 1], count_alone)
            swept += [j] * count_alone
    together = np.random.default_rng(seed).random((count, len(bounds)))
    rows.append(bounds[:, 0] + (bounds[:, 1] - bounds[:, 0]) * together)
    coordinates = np.concatenate(rows)
    couple_frames(tree.arrays, coordinates)
    return coordinates, np.array(swept + [-1] * count)


def routes(model: Model, coordinates: Array, swept: np.ndarray) -> np.ndarray:
    """How poses of `poses_over_ranges` are reached by continuous movement.

    Parameters
    ----------
    model : whose poses they are
    coordinates : (poses, coordinates) [rad or m]
    swept : (poses,) number of the coordinate that moves alone, -1 where all do

    Returns
    -------
    (poses,) number of the pose before: of one coordinate its neighbor towards the default; -1 for
    the default pose
    """
    route = np.full(len(coordinates), -1, np.int64)
    for j in np.unique(swept[swept >= 0]):
        own = np.flatnonzero(swept == j)
        values = coordinates[own, j]
        nearest = int(np.argmin(np.abs(values - model.coordinates[j].default)))
        route[own[nearest + 1 :]] = own[nearest:-1]
        route[own[:nearest]] = own[1 : nearest + 1]
    return route


MAX_AXES = 6  # Degrees of freedom that MuJoCo allows a body.

OWN_KINDS = {"free", "ball", "hinge", "slide", "weld"}
"""Joints of models that were read from MuJoCo's files, which stay as they are."""


def mujoco_joints(model: Model) -> Model:
    """Give the model joints that MuJoCo can hold.

    These have unit axes, one coordinate each, in the child's frame. The amount of each axis is its
    coordinate less that coordinate's default, so the default pose is MuJoCo's `qpos0`. A coordinate
    that moves no axis one to one stays, without an axis, for those that depend on it. Raises
    `BadModel` where an independent coordinate moves no axis one to one, an axis moves by two
    coordinates, or a body by too many.
    """
    coordinates = {coordinate.name: coordinate for coordinate in _at_defaults(model)}
    points = _PointBodies(coordinates)
    muscles = tuple(points.with_bodies(muscle) for muscle in model.muscles)
    joints: list[Joint] = []
    followers = list(points.followers)
    for joint in model.joints:
        new, more = _joint(joint, coordinates, set(model.dependent_coordinates))
        joints.append(new)
        followers += more
    joints += points.joints
    made = {follower.name: follower for follower, _ in followers}
    order = [name for joint in joints for name in joint.coordinates]
    order += [name for name in coordinates if name not in order]
    return replace(
        model,
        bodies=(*model.bodies, *points.bodies),
        joints=tuple(joints),
        muscles=muscles,
        coordinates=tuple(coordinates.get(name) or made[name] for name in order),
        couplers=(*model.couplers, *(coupler for _, coupler in followers)),
    )


class _PointBodies:
    """Bodies without mass that carry the path points that move."""

    def __init__(self, coordinates: dict[str, Coordinate]):
        self.coordinates = coordinates
        self.bodies: list[Body] = []
        self.joints: list[Joint] = []
        self.followers: list[tuple[Coordinate, Coupler]] = []

    def with_bodies(self, muscle: Muscle) -> Muscle:
        """Fix each point of a muscle that moves to a body that does."""
        points = tuple(
            self._fixed(muscle, point) if isinstance(point, MovingPathPoint) else point
            for point in muscle.path.points
        )
        return replace(muscle, path=replace(muscle.path, points=points))

    def _fixed(self, muscle: Muscle, point: MovingPathPoint) -> PathPoint:
        body = f"{muscle.name}_{point.name}"
        axes = []
        names = []
        place = np.zeros(3)
        for i, (function, leader) in enumerate(
            zip(point.functions, point.coordinates, strict=True)
        ):
            place[i] = float(function(self.coordinates[leader].default if leader else 0.0))
            if leader and slope_of(function) != 0.0:
                names.append(f"{body}_{'xyz'[i]}")
                axes.append(
                    Axis(
                        kind="translation",
                        vector=np.eye(3)[i],
                        function=linear(1.0, -place[i]),
                        coordinates=(names[-1],),
                    )
                )
                self.followers.append(
                    _follower(names[-1], "translation", place[i], function, leader)
                )
        self.bodies.append(
            Body(name=body, mass=0.0, mass_center=np.zeros(3), inertia=np.zeros((3, 3)))
        )
        frame = Transform(np.eye(3), place)
        kind = "+".join("slide" for _ in axes) or "weld"
        self.joints.append(
            Joint(
                name=body,
                kind=kind,
                parent=point.body,
                child=body,
                parent_frame=frame,
                child_frame=Transform.identity(),
                axes=tuple(axes),
                coordinates=tuple(names),
            )
        )
        return PathPoint(point.name, body, np.zeros(3))


def _follower(
    name: str, kind: str, value: float, function: Function, leader: str
) -> tuple[Coordinate, Coupler]:
    motion: Literal["rotational", "translational"] = (
        "rotational" if kind == "rotation" else "translational"
    )
    return Coordinate(name, motion, default=value), Coupler(
        name=f"{name}_follows", dependent=name, function=function, independents=(leader,)
    )


def _at_defaults(model: Model) -> list[Coordinate]:
    """Return coordinates with defaults that keep to the couplers.

    MuJoCo's own stay, as their joints start from them.
    """
    values = {coordinate.name: coordinate.default for coordinate in model.coordinates}
    own = {name for joint in model.joints if _is_own(joint) for name in joint.coordinates}
    for coupler in model.couplers:
        if coupler.dependent in own:
            continue
        values[coupler.dependent] = value_at(coupler.function, coupler.independents, values)
    return [
        replace(coordinate, default=values[coordinate.name]) for coordinate in model.coordinates
    ]


def _is_own(joint: Joint) -> bool:
    return set(joint.kind.split("+")) <= OWN_KINDS


def slope_of(function: Function) -> float | None:
    """Slope of a function that is a line, else None."""
    if isinstance(function, SineProduct) or len(function.breaks) > 1:
        return None
    coefficients = function.coefficients[0]
    if coefficients[2:].any():
        return None
    return float(coefficients[1]) if len(coefficients) > 1 else 0.0


def _joint(
    joint: Joint, coordinates: dict[str, Coordinate], dependent: set[str]
) -> tuple[Joint, list[tuple[Coordinate, Coupler]]]:
    """Return a joint with one axis per coordinate.

    The second value holds the coordinates that it has besides its own.
    """
    if _is_own(joint):
        return joint, []
    leading = _leading_axes(joint, dependent)
    defaults = {name: coordinate.default for name, coordinate in coordinates.items()}
    made: list[Axis] = []
    followers: list[tuple[Coordinate, Coupler]] = []
    # What comes after an axis at the defaults: the axis is moved through it into the child's frame.
    after = joint.child_frame.inverse()
    for index, axis in reversed(list(enumerate(joint.axes))):
        amount = value_at(axis.function, axis.coordinates, defaults)
        if index in leading:
            name = axis.coordinates[0]
            sign = slope_of(axis.function) or 1.0
            made.insert(0, _moved_axis(axis, sign, after, name, coordinates[name].default))
        elif axis.function.arity and slope_of(axis.function) != 0.0:
            name = f"{joint.name}_{axis.kind[0]}{index}"
            leader = _leader(joint, axis)
            followers.insert(0, _follower(name, axis.kind, amount, axis.function, leader))
            made.insert(0, _moved_axis(axis, 1.0, after, name, amount))
        after = axis.moved(amount) @ after
    if len(made) > MAX_AXES:
        raise BadModel(
            f"joint '{joint.name}' has {len(made)} axes that move, and MuJoCo allows {MAX_AXES} a"
            " body"
        )
    kinds = ["hinge" if axis.kind == "rotation" else "slide" for axis in made]
    new = Joint(
        name=joint.name,
        kind="+".join(kinds) or "weld",
        parent=joint.parent,
        child=joint.child,
        parent_frame=joint.parent_frame @ after,
        child_frame=Transform.identity(),
        axes=tuple(made),
        coordinates=tuple(axis.coordinates[0] for axis in made),
    )
    return new, followers


def _leading_axes(joint: Joint, dependent: set[str]) -> frozenset[int]:
    """Return the indices of axes that a coordinate moves one to one, the first of each."""
    leading: dict[str, int] = {}
    for index, axis in enumerate(joint.axes):
        name = axis.coordinates[0] if len(axis.coordinates) == 1 else ""
        if (
            name in joint.coordinates
            and name not in leading
            and abs(slope_of(axis.function) or 0.0) == 1.0
        ):
            leading[name] = index
    missing = [name for name in joint.coordinates if name not in leading and name not in dependent]
    if missing:
        raise BadModel(
            f"coordinate '{missing[0]}' of joint '{joint.name}' moves no axis one to one, as MuJoCo"
            " needs"
        )
    return frozenset(leading.values())


def _leader(joint: Joint, axis: Axis) -> str:
    """Return the one coordinate that moves an axis by a function."""
    if axis.function.arity > 1:
        raise BadModel(
            f"joint '{joint.name}' has an axis that moves by two coordinates,"
            f" {axis.coordinates[0]} and {axis.coordinates[1]}, which MuJoCo cannot hold"
        )
    return axis.coordinates[0]


def _moved_axis(axis: Axis, sign: float, after: Transform, name: str, reference: float) -> Axis:
    """Return an axis in the child's frame.

    It moves by a coordinate less its reference [rad or m]. `after`: what comes after the axis at
    the defaults.
    """
    return Axis(
        kind=axis.kind,
        vector=sign * after.rotation.T @ axis.vector,
        function=linear(1.0, -reference),
        coordinates=(name,),
        origin=after.inverse().apply(axis.origin),
    )
