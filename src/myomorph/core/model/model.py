"""The body as a value: segments, joints, coordinates, markers, muscles and what they touch."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np

from myomorph.core.model.arrays import Array, freeze, frozen_array, read_only
from myomorph.core.model.drawings import lines_drawing
from myomorph.core.model.errors import BadData, BadModel, UnknownName, counted
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.functions import Function, value_at
from myomorph.core.model.messages import Message
from myomorph.core.model.paths import Bushing, Ligament, Muscle, PassiveTorque, WrapObject
from myomorph.core.model.shown import shown
from myomorph.core.model.spatial import Transform, axis_rotation
from myomorph.core.model.units import MotionKind

GROUND = "ground"
STANDARD_GRAVITY = 9.80665  # [m/s^2]


@read_only
class Mesh:
    """A surface that draws a body (or, in MJCF, a geom).

    Attributes
    ----------
    file : name of the file as the model writes it (looked up by `io`), or "" for a primitive
    pose : pose in the body's frame
    scale : (3,) factors along the mesh's axes
    shape : "mesh", or "sphere", "capsule", "cylinder", "box", "ellipsoid" of half sizes `scale` [m]
    """

    file: str
    pose: Transform
    scale: Array
    shape: str = "mesh"


@read_only
class Body:
    """A rigid segment.

    Attributes
    ----------
    name : of the body
    meshes : drawn on it
    mass : [kg]
    mass_center : (3,) in the body's frame [m]
    inertia : (3, 3) about the mass center, in the body's frame [kg m^2]
    """

    name: str
    mass: float
    mass_center: Array
    inertia: Array
    meshes: tuple[Mesh, ...] = ()

    def __post_init__(self) -> None:
        freeze(self, mass_center=(3,), inertia=(3, 3))


@dataclass(frozen=True, eq=False)
class Coordinate:
    """One degree of freedom as users see it.

    Attributes
    ----------
    name : of the coordinate
    motion : "rotational" [rad], "translational" [m], or "coupled" (in the unit of the file)
    default, default_speed : value and speed of the model's default pose [rad or m, per s]
    range : (lower, upper) [rad or m]
    clamped : inverse kinematics keeps it inside `range`
    locked : stays at its default (or at a motion's value)
    prescribed : function of time [s], or None
    """

    name: str
    motion: Literal["rotational", "translational", "coupled"] = "rotational"
    default: float = 0.0
    range: tuple[float, float] = (-np.inf, np.inf)
    clamped: bool = False
    locked: bool = False
    prescribed: Function | None = None
    default_speed: float = 0.0

    @property
    def is_free(self) -> bool:
        """Whether it is neither locked nor prescribed."""
        return not self.locked and self.prescribed is None


@read_only
class Axis:
    """One elementary motion of a joint: a rotation about, or a translation along, a fixed axis.

    Attributes
    ----------
    kind : "rotation" or "translation"
    vector : (3,) direction of length 1, in the frame that the joint's earlier axes have moved
    function : amount of motion [rad or m] from the coordinates
    coordinates : names the function takes, in order; () for a constant
    origin : (3,) a point on the axis of rotation [m] (zero in OpenSim, the anchor in MJCF)
    """

    kind: Literal["rotation", "translation"]
    vector: Array
    function: Function
    coordinates: tuple[str, ...] = ()
    origin: Array = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        freeze(self, vector=(3,), origin=(3,))
        if self.function.arity > len(self.coordinates):
            raise BadModel(
                f"an axis function takes {self.function.arity} coordinates, but got"
                f" {self.coordinates}"
            )

    def moved(self, amount: float) -> Transform:
        """Transform that the axis makes at an amount of motion [rad or m]."""
        if self.kind == "translation":
            return Transform(np.eye(3), amount * self.vector)
        rotation = axis_rotation(self.vector / np.linalg.norm(self.vector), amount)
        return Transform(rotation, self.origin - rotation @ self.origin)


@shown
@dataclass(frozen=True, eq=False)
class Joint:
    """Motion of a child body on its parent.

    pose of child in parent = parent_frame @ axes[0] @ axes[1] @ ... @ child_frame.inverse().

    Attributes
    ----------
    name : of the joint
    kind : the file's own word: "PinJoint", "CustomJoint", "ScapulothoracicJoint", "hinge", ...
    parent, child : body names; the parent may be "ground"
    parent_frame : joint frame in the parent's frame
    child_frame : joint frame in the child's frame
    axes : applied in order; an OpenSim custom joint has three translations, then three rotations
    coordinates : names of the coordinates the joint owns, in the file's order
    parent_frame_name, child_frame_name : names of the offset frames in the file, "" if none
    """

    name: str
    kind: str
    parent: str
    child: str
    parent_frame: Transform
    child_frame: Transform
    axes: tuple[Axis, ...] = ()
    coordinates: tuple[str, ...] = ()
    parent_frame_name: str = ""
    child_frame_name: str = ""

    def pose(self, values: Mapping[str, float]) -> Transform:
        """Pose of the child in its parent at values of the coordinates [rad or m]."""
        pose = self.parent_frame
        for axis in self.axes:
            pose = pose @ axis.moved(value_at(axis.function, axis.coordinates, values))
        return pose @ self.child_frame.inverse()


@shown
@dataclass(frozen=True, eq=False)
class Coupler:
    """A coordinate that follows others: dependent = function(independents)."""

    name: str
    dependent: str
    function: Function
    independents: tuple[str, ...]


@shown
@dataclass(frozen=True, eq=False)
class Loop:
    """A constraint that closes a kinematic loop (point or weld), which the tree alone cannot hold.

    Attributes
    ----------
    name : of the constraint
    kind : "PointConstraint", "WeldConstraint", "connect", "weld", ...
    body_1, body_2 : the bodies tied together
    pose_1, pose_2 : the tied frames in those bodies; a point constraint uses their origins
    """

    name: str
    kind: str
    body_1: str
    body_2: str
    pose_1: Transform
    pose_2: Transform


@read_only
class Marker:
    """A point fixed to a body: `location` (3,) in its frame [m]."""

    name: str
    body: str
    location: Array
    fixed: bool = False

    def __post_init__(self) -> None:
        freeze(self, location=(3,))


@shown
@dataclass(frozen=True, eq=False)
class Frame:
    """A named frame fixed to a body, that loads, points and actuators may refer to."""

    name: str
    body: str
    pose: Transform


@read_only
class Actuator:
    """An ideal actuator: force = optimal_force * control, control in [min_control, max_control].

    Attributes
    ----------
    name : of the actuator
    min_control, max_control : bounds of its control
    point_is_global, direction_is_global : whether point and direction are those of ground
    enabled : whether it takes part
    kind : "coordinate", "torque", "point" or "point_to_point"
    optimal_force : [N or N m]
    coordinate : for "coordinate"
    body, other_body : body acted on and body that reacts ("" for none); "ground" is allowed
    point, other_point : (3,) points of application [m]; in ground if `point_is_global`
    direction : (3,) of the force or torque on `body`; in ground if `direction_is_global`
    """

    name: str
    kind: Literal["coordinate", "torque", "point", "point_to_point"]
    optimal_force: float
    min_control: float = -np.inf
    max_control: float = np.inf
    coordinate: str = ""
    body: str = ""
    other_body: str = ""
    point: Array = field(default_factory=lambda: np.zeros(3))
    other_point: Array = field(default_factory=lambda: np.zeros(3))
    direction: Array = field(default_factory=lambda: np.zeros(3))
    point_is_global: bool = False
    direction_is_global: bool = True
    enabled: bool = True

    def __post_init__(self) -> None:
        freeze(self, point=(3,), other_point=(3,), direction=(3,))


@shown
@dataclass(frozen=True, eq=False)
class Kept:
    """A part of the file that Myomorph does not model: carried to the file it writes.

    Attributes
    ----------
    kind, name : class and name in the file
    effect : what leaving it out means, as a short clause for a warning
    text : the part as the file has it
    room : where in the file it belongs ("ForceSet", "ControllerSet", ...)
    version : version of the document whose layout `text` has, 40000 for OpenSim 4.0
    """

    kind: str
    name: str
    effect: str
    text: str
    room: str
    version: int = 0


@read_only
class Model:
    """A musculoskeletal model: frozen, in SI and radians, whatever file it came from.

    Bodies are in tree order (a parent before its children) and exclude the ground. Every body
    has exactly one joint to its parent. Couplers make some coordinates dependent on others.

    Attributes
    ----------
    name : of the model
    bodies : rigid segments in tree order, without the ground
    joints : one a body, to its parent
    coordinates : degrees of freedom as users see them [rad or m]
    gravity : (3,) in ground [m/s^2]
    markers : places on bodies that recordings see [m]
    muscles : with their paths and properties
    wrap_objects : surfaces that muscles wrap around
    actuators : forces and torques in addition to the muscles [N or N m]
    couplers : coordinates that follow others
    loops : constraints that close kinematic loops
    frames : named frames fixed to bodies
    ground_meshes : surfaces that draw the ground
    source : path of the file it was read from, for messages and provenance
    kept : what the file holds that is not modelled
    warnings : what reading the file found odd, one line each
    passive_torques : of joints' tissues and springs
    bushings : springs and dampers between two frames
    ligaments : paths of ligaments, the rest of which is in `kept`
    """

    name: str
    bodies: tuple[Body, ...]
    joints: tuple[Joint, ...]
    coordinates: tuple[Coordinate, ...]
    gravity: Array
    markers: tuple[Marker, ...] = ()
    muscles: tuple[Muscle, ...] = ()
    wrap_objects: tuple[WrapObject, ...] = ()
    actuators: tuple[Actuator, ...] = ()
    couplers: tuple[Coupler, ...] = ()
    loops: tuple[Loop, ...] = ()
    frames: tuple[Frame, ...] = ()
    ground_meshes: tuple[Mesh, ...] = ()
    kept: tuple[Kept, ...] = ()
    source: str = ""
    warnings: tuple[Message, ...] = ()
    passive_torques: tuple[PassiveTorque, ...] = ()
    bushings: tuple[Bushing, ...] = ()
    ligaments: tuple[Ligament, ...] = ()

    def __post_init__(self) -> None:
        freeze(self, gravity=(3,))
        placed = {GROUND}
        by_child = {joint.child: joint for joint in self.joints}
        if len(by_child) != len(self.joints):
            raise BadModel(f"model '{self.name}': a body has two joints to a parent")
        for body in self.bodies:
            if body.name not in by_child:
                raise BadModel(f"model '{self.name}': body '{body.name}' has no joint")
            if by_child[body.name].parent not in placed:
                raise BadModel(f"model '{self.name}': body '{body.name}' comes before its parent")
            placed.add(body.name)
        for what in ("bodies", "joints", "coordinates", "markers", "muscles"):
            names = [part.name for part in getattr(self, what)]
            if len(set(names)) != len(names):
                twice = next(name for name in names if names.count(name) > 1)
                raise BadModel(f"model '{self.name}': two {what} are named '{twice}'")

    @cached_property
    def coordinate_names(self) -> tuple[str, ...]:
        """Names of all coordinates, in order."""
        return tuple(coordinate.name for coordinate in self.coordinates)

    @cached_property
    def muscle_names(self) -> tuple[str, ...]:
        """Names of all muscles, in order."""
        return tuple(muscle.name for muscle in self.muscles)

    @cached_property
    def marker_names(self) -> tuple[str, ...]:
        """Names of all markers, in order."""
        return tuple(marker.name for marker in self.markers)

    @cached_property
    def body_names(self) -> tuple[str, ...]:
        """Names of all bodies, in tree order."""
        return tuple(body.name for body in self.bodies)

    @cached_property
    def motion_kinds(self) -> Mapping[str, MotionKind]:
        """How each coordinate moves, by name."""
        return FrozenMap({coordinate.name: coordinate.motion for coordinate in self.coordinates})

    @cached_property
    def mass(self) -> float:
        """Mass of all bodies [kg]."""
        return sum(body.mass for body in self.bodies)

    @cached_property
    def dependent_coordinates(self) -> Mapping[str, Coupler]:
        """The coupler of each coordinate that follows others."""
        return FrozenMap({coupler.dependent: coupler for coupler in self.couplers})

    @cached_property
    def up(self) -> Array:
        """(3,) unit vector against gravity in ground; y where the model has no gravity."""
        norm = float(np.linalg.norm(self.gravity))
        return frozen_array(-self.gravity / norm if norm > 0.0 else (0.0, 1.0, 0.0))

    @cached_property
    def weight(self) -> float:
        """Weight of all bodies, by standard gravity where the model has none [N]."""
        return self.mass * (float(np.linalg.norm(self.gravity)) or STANDARD_GRAVITY)

    def coordinate(self, name: str) -> Coordinate:
        """Find the coordinate of that name; raises `UnknownName`."""
        return self.coordinates[index_of("coordinate", name, self.coordinate_names)]

    def body(self, name: str) -> Body:
        """Find the body of that name; raises `UnknownName`."""
        return self.bodies[index_of("body", name, self.body_names)]

    def muscle(self, name: str) -> Muscle:
        """Find the muscle of that name; raises `UnknownName`."""
        return self.muscles[index_of("muscle", name, self.muscle_names)]

    def marker(self, name: str) -> Marker:
        """Find the marker of that name; raises `UnknownName`."""
        return self.markers[index_of("marker", name, self.marker_names)]

    def with_markers(self, markers: tuple[Marker, ...]) -> Model:
        """Replace the markers of the model."""
        return replace(self, markers=markers)

    def with_muscle(self, name: str, *, strength: float = 1.0, **properties: Any) -> Model:
        """Change a muscle: its strength, or any property by its name.

        Parameters
        ----------
        name : of the muscle
        strength : factor of its maximum isometric force, above 0; `without` takes a muscle away
        **properties : of `Muscle`, as `optimal_fiber_length=0.05` [m]

        Raises
        ------
        UnknownName : the model has no such muscle, or muscles no such property
        BadData : the strength is not above 0

        Examples
        --------
        >>> import myomorph as mm
        >>> model = mm.demo_recording().model
        >>> weak = model.with_muscle("soleus_r", strength=0.5)
        >>> for one in (model, weak):
        ...     print(f"{one.muscle('soleus_r').max_isometric_force:.0f} N")
        5322 N
        2661 N
        """
        old = self.muscle(name)
        known = [part.name for part in fields(Muscle) if part.name != "name"]
        for key in properties:
            if key not in known:
                raise UnknownName("property", key, known, where="muscles")
        if not 0.0 < strength < np.inf:
            raise BadData(f"strength of '{name}': expected a factor above 0, but got {strength}")
        force = strength * old.max_isometric_force
        muscle = replace(old, **({"max_isometric_force": force} | properties))
        return replace(self, muscles=tuple(muscle if one is old else one for one in self.muscles))

    def with_body(self, name: str, *, mass: float) -> Model:
        """Give one body another mass, and an inertia that is as much larger.

        Parameters
        ----------
        name : of the body
        mass : [kg], above 0

        Raises
        ------
        UnknownName : there is no such body
        BadData : the mass is not above 0, or the body has none
        """
        old = self.body(name)
        if not 0.0 < mass < np.inf or not old.mass > 0.0:
            raise BadData(
                f"mass of '{name}': expected kilograms above 0 of a body that has a mass, but got"
                f" {mass} for {old.mass:g} kg"
            )
        body = replace(old, mass=mass, inertia=old.inertia * (mass / old.mass))
        return replace(self, bodies=tuple(body if one is old else one for one in self.bodies))

    def with_mass(self, mass: float) -> Model:
        """Scale the masses and inertias of all bodies to a mass of the whole body.

        Parameters
        ----------
        mass : [kg], above 0

        Raises
        ------
        BadData : the mass is not above 0, or the bodies have none
        """
        if not 0.0 < mass < np.inf or not self.mass > 0.0:
            raise BadData(
                f"mass: expected kilograms above 0 of bodies that have a mass, but got {mass} for"
                f" {self.mass:g} kg"
            )
        share = mass / self.mass
        bodies = [
            replace(body, mass=share * body.mass, inertia=share * body.inertia)
            for body in self.bodies
        ]
        return replace(self, bodies=tuple(bodies))

    def without(self, *names: str) -> Model:
        """Take muscles, markers and actuators away.

        Parameters
        ----------
        *names : of what goes

        Raises
        ------
        UnknownName : the model has nothing of a name
        """
        actuators = [actuator.name for actuator in self.actuators]
        known = (*self.muscle_names, *self.marker_names, *actuators)
        for name in names:
            index_of("muscle, marker or actuator", name, known)
        return replace(
            self,
            muscles=tuple(one for one in self.muscles if one.name not in names),
            markers=tuple(one for one in self.markers if one.name not in names),
            actuators=tuple(one for one in self.actuators if one.name not in names),
        )

    def lock(self, *names: str, at: float | None = None) -> Model:
        """Lock coordinates, at a value or where they are by default.

        Parameters
        ----------
        *names : of the coordinates
        at : value of all of them [rad or m], None for their defaults

        Raises
        ------
        UnknownName : the model has no such coordinate
        BadData : a coordinate follows others
        """
        for name in names:
            self.coordinate(name)
            if name in self.dependent_coordinates:
                others = ", ".join(self.dependent_coordinates[name].independents)
                raise BadData(f"'{name}' cannot be locked, for it follows {others}: lock these")
        locked = [
            replace(one, locked=True, default=one.default if at is None else at)
            if one.name in names
            else one
            for one in self.coordinates
        ]
        return replace(self, coordinates=tuple(locked))

    @property
    def headline(self) -> str:
        """What the model has, in one line."""
        bodies = "1 body" if len(self.bodies) == 1 else f"{len(self.bodies)} bodies"
        counts = (
            bodies,
            counted(len(self.coordinates), "coordinate"),
            counted(len(self.muscles), "muscle"),
            counted(len(self.markers), "marker"),
        )
        return f"'{self.name}': {', '.join(counts)}, {self.mass:.4g} kg"

    def drawing(self) -> str:
        """Draw the default pose from the side, as SVG for notebooks.

        Each body is a line from its parent's origin to its own.
        """
        defaults = {coordinate.name: coordinate.default for coordinate in self.coordinates}
        poses = {GROUND: Transform.identity()}
        lines = []
        for joint in self.joints:
            parent = poses[joint.parent]
            child = parent @ joint.pose(defaults)
            poses[joint.child] = child
            if joint.parent != GROUND:
                lines.append((parent.translation, child.translation))
        return lines_drawing(lines, self.up)


def index_of(kind: str, name: str, names: tuple[str, ...], where: str = "the model") -> int:
    """Find the position of a name in others.

    Parameters
    ----------
    kind : of name, for the message
    name : to find
    names : that exist
    where : what has them, for the message

    Raises
    ------
    UnknownName : it is not among them
    """
    try:
        return names.index(name)
    except ValueError:
        raise UnknownName(kind, name, names, where=where) from None
