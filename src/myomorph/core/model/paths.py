"""Muscles as values: the points and surfaces of their paths, and what makes their force."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from myomorph.core.model.arrays import Array, freeze, read_only
from myomorph.core.model.errors import BadModel, quoted
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.functions import Function
from myomorph.core.model.polynomial import Polynomial
from myomorph.core.model.shown import shown
from myomorph.core.model.spatial import Transform


@read_only
class PathPoint:
    """A point fixed to a body: `location` (3,) in its frame [m].

    With a `coordinate`, the path goes through it only while that coordinate is in `range`
    (OpenSim's ConditionalPathPoint) [rad or m].
    """

    name: str
    body: str
    location: Array
    coordinate: str = ""
    range: tuple[float, float] = (-np.inf, np.inf)

    def __post_init__(self) -> None:
        freeze(self, location=(3,))


@shown
@dataclass(frozen=True, eq=False)
class MovingPathPoint:
    """A point whose place in its body's frame [m] is a function of coordinates.

    Attributes
    ----------
    name, body : of the point, and that it is on
    functions : of x, y and z
    coordinates : name each function takes, "" where the function is constant
    """

    name: str
    body: str
    functions: tuple[Function, Function, Function]
    coordinates: tuple[str, str, str]


@shown
@dataclass(frozen=True, eq=False)
class WrapObject:
    """A surface that muscle paths go around.

    Attributes
    ----------
    name, body : of the surface, and that it is on
    active : whether paths wrap around it
    kind : "cylinder" (axis z), "sphere", "ellipsoid" or "torus" (axis z)
    pose : in the body's frame
    size : cylinder (radius, length), sphere (radius,), ellipsoid (x, y, z), torus (inner, outer)
        [m]; an infinite cylinder has length inf
    quadrant : "" for all, or the side that constrains the path: "+x", "-x", "+y", "-y", "+z", "-z"
    """

    name: str
    body: str
    kind: Literal["cylinder", "sphere", "ellipsoid", "torus"]
    pose: Transform
    size: tuple[float, ...]
    quadrant: str = ""
    active: bool = True


def surface_level(wrap: WrapObject, points: Array) -> Array:
    """Distances of points from a surface's middle or axis (of a torus, its ring) over its sizes.

    Parameters
    ----------
    wrap : the surface
    points : (n, 3) in its frame [m]

    Returns
    -------
    (n,) 1 on the surface, less inside
    """
    if wrap.kind == "torus":
        from_ring = np.hypot(points[:, 0], points[:, 1]) - wrap.size[1]
        return np.hypot(from_ring, points[:, 2]) / wrap.size[0]
    if wrap.kind == "cylinder":
        return np.linalg.norm(points[:, :2], axis=1) / wrap.size[0]
    return np.linalg.norm(points / np.asarray(wrap.size), axis=1)


@shown
@dataclass(frozen=True, eq=False)
class PathWrap:
    """A path's use of a wrap object, as OpenSim defines it.

    Attributes
    ----------
    wrap_object : name, unique in the model
    method : of ellipsoids: "hybrid", "midpoint" or "axial"
    first, last : numbers, from 1 as OpenSim counts, of the path points between which it may wrap;
        -1 for the ends
    """

    wrap_object: str
    method: str = "hybrid"
    first: int = -1
    last: int = -1


@read_only
class TendonWrap:
    """A tendon's wrap in the way of MuJoCo: between path points `after` and `after + 1`.

    Attributes
    ----------
    wrap_object : name of a sphere or (infinite) cylinder
    after : index of the path point before the surface
    side_body, side : body and position (3,) in it of the side site, which chooses the way around;
        inside the surface it wraps inward [m]
    version : of MuJoCo, whose rules the path follows
    """

    wrap_object: str
    after: int
    side_body: str = ""
    side: Array | None = None
    version: int = 4  # of MuJoCo whose rule of side sites it follows: 4, or 3 for all before


@shown
@dataclass(frozen=True, eq=False)
class PathFunction:
    """Length of a path as a function of coordinates (OpenSim's FunctionBasedPath).

        r_i = -dl/dc_i,   ldot = -sum_i r_i cdot_i

    where the file brings no functions of these.

    Attributes
    ----------
    coordinates : names that the functions take, in order
    length : of the coordinates [m]
    moment_arms : one per coordinate, of the coordinates [m/rad or m/m]; () without
    velocity : lengthening, of the coordinates and then of their rates [m/s]; None without
    """

    coordinates: tuple[str, ...]
    length: Polynomial | Function
    moment_arms: tuple[Polynomial | Function, ...] = ()
    velocity: Polynomial | Function | None = None

    def scaled(self, factor: float) -> PathFunction:
        """Multiply length, moment arms and velocity by a factor, as in a larger body."""
        return replace(
            self,
            length=self.length.scaled(factor),
            moment_arms=tuple(function.scaled(factor) for function in self.moment_arms),
            velocity=None if self.velocity is None else self.velocity.scaled(factor),
        )


@shown
@dataclass(frozen=True, eq=False)
class Path:
    """A muscle's way from origin to insertion.

    Attributes
    ----------
    points : at least two, origin first; none where a function gives the length
    wraps : all `PathWrap` (OpenSim) or all `TendonWrap` (MuJoCo)
    divisors : one per segment between points: its share in the length is 1 / divisor, 0 where the
        path has a gap (MuJoCo pulleys); () means all 1
    function : gives the length instead of points
    """

    points: tuple[PathPoint | MovingPathPoint, ...]
    wraps: tuple[PathWrap | TendonWrap, ...] = ()
    divisors: tuple[float, ...] = ()
    function: PathFunction | None = None


@shown
@dataclass(frozen=True, eq=False)
class Muscle:
    """A muscle-tendon unit.

    Attributes
    ----------
    name : of the muscle
    path : its points and wraps
    groups : names of groups that it belongs to
    kind : the file's class, "Millard2012EquilibriumMuscle", "Thelen2003Muscle", ..., or "mujoco"
    max_isometric_force : [N]
    optimal_fiber_length, tendon_slack_length : [m]
    pennation_at_optimal : [rad]
    max_contraction_velocity : [optimal fiber lengths / s]
    viscosity : of a damper along the whole path, force = viscosity * lengthening velocity [N s/m];
        part of the passive force ([S] eq. 3)
    min_activation, max_activation : bounds of the activation
    parameters : what else the class has, by the file's own names, e.g. "KshapeActive"
    enabled : false where the file switches it off (`appliesForce`)
    curves : where the file brings its own, by its names, e.g. "active_force_length_curve"
    """

    name: str
    kind: str
    path: Path
    max_isometric_force: float
    optimal_fiber_length: float
    tendon_slack_length: float
    pennation_at_optimal: float = 0.0
    max_contraction_velocity: float = 10.0
    min_activation: float = 0.01
    max_activation: float = 1.0
    parameters: Mapping[str, float] = field(default_factory=lambda: FrozenMap({}))
    groups: tuple[str, ...] = ()
    enabled: bool = True
    curves: Mapping[str, Function] = field(default_factory=lambda: FrozenMap({}))
    viscosity: float = 0.0


@shown
@dataclass(frozen=True, eq=False)
class Ligament:
    """A passive string between bones, whose force is not modelled.

    The file's own part is stored (`Kept`).

    Attributes
    ----------
    name : of the ligament
    path : its points and wraps
    kind : the file's class, "Ligament", "Blankevoort1991Ligament", ...
    slack_length : at which it begins to pull; NaN where the file has none [m]
    """

    name: str
    kind: str
    path: Path
    slack_length: float

    def as_muscle(self) -> Muscle:
        """Make a muscle along the same path, by which the path's length can be computed."""
        return Muscle(
            name=self.name,
            kind=self.kind,
            path=self.path,
            max_isometric_force=0.0,
            optimal_fiber_length=0.0,
            tendon_slack_length=0.0,
        )


@shown
@dataclass(frozen=True, eq=False)
class PassiveTorque:
    """Torque of ligaments and springs at a coordinate: tau = torque(q) - damping(q) qdot.

    It takes part in muscle tensions; inverse dynamics gives the torque of all that acts together.

    Attributes
    ----------
    name, coordinate : of the torque, and that it acts on
    torque : [N m or N] of the coordinate's value
    damping : [N m s or N s/m] of the coordinate's value
    """

    name: str
    coordinate: str
    torque: Function
    damping: Function

    def total(self, values: Array, rates: Array) -> Array:
        """Torque at values and rates of the coordinate.

        Parameters
        ----------
        values, rates : (frames,) [rad or m, per s]

        Returns
        -------
        (frames,) [N m or N]
        """
        return self.torque(values) - self.damping(values) * rates


@read_only
class Bushing:
    """Springs and dampers that hold one frame at another, as OpenSim's BushingForce defines them.

    With q the body-fixed x-y-z angles and the origin of frame 2 seen from frame 1, the generalized
    forces on q are -stiffness q - damping qdot, along each of the six alone.

    Attributes
    ----------
    name : of the bushing
    body_1, body_2 : the bodies held together
    pose_1, pose_2 : the frames in those bodies
    rotational_stiffness, rotational_damping : (3,) [N m/rad], [N m s/rad]
    translational_stiffness, translational_damping : (3,) [N/m], [N s/m]
    """

    name: str
    body_1: str
    body_2: str
    pose_1: Transform
    pose_2: Transform
    rotational_stiffness: Array = field(default_factory=lambda: np.zeros(3))
    rotational_damping: Array = field(default_factory=lambda: np.zeros(3))
    translational_stiffness: Array = field(default_factory=lambda: np.zeros(3))
    translational_damping: Array = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        freeze(self, rotational_stiffness=(3,), rotational_damping=(3,))
        freeze(self, translational_stiffness=(3,), translational_damping=(3,))


def refuse_path_functions(muscles: Iterable[Muscle], use: str) -> None:
    """Refuse muscles whose paths have no points.

    Parameters
    ----------
    muscles : of a model
    use : what needs the points, for the message

    Raises
    ------
    BadModel : a function of coordinates gives the length of one
    """
    names = [muscle.name for muscle in muscles if muscle.path.function is not None]
    if names:
        raise BadModel(
            f"functions of coordinates give the lengths of {quoted(names, 3)} (FunctionBasedPath),"
            f" and {use} needs points of paths: use the model from which they were fitted"
        )


def impossible_fibers(muscles: Iterable[Muscle]) -> tuple[str, ...]:
    """Find muscles whose optimal fiber is longer than the muscle, or whose tendon is negative.

    MuJoCo states no fiber: its length follows from two numbers of each muscle, its length range and
    its operating range. Where a modeller has set these for the force alone, the length is no
    length of fibers.

    Parameters
    ----------
    muscles : of a model

    Returns
    -------
    their names
    """
    return tuple(
        muscle.name
        for muscle in muscles
        if muscle.tendon_slack_length < 0.0
        or muscle.optimal_fiber_length > muscle.parameters.get("lengthrange1", np.inf)
    )
