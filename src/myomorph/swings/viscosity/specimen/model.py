"""A limb that swings from a fixed bone: the model of the in-vitro experiment.

It is made out of any larger model.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array, frozen_array, read_only
from myomorph.core.model.errors import BadModel
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.functions import linear
from myomorph.core.model.model import GROUND, Axis, Coordinate, Joint, Marker, Model
from myomorph.core.model.series import Markers, Wrenches
from myomorph.core.model.spatial import Transform
from myomorph.swings.viscosity.specimen import bodies
from myomorph.swings.viscosity.specimen.muscles import kept_muscles

AXES = ("x", "y", "z")


@dataclass(frozen=True)
class SpecimenNames:
    """What of a model makes a specimen.

    Attributes
    ----------
    base : the body on the plate (the scapula)
    first : the limb's first (the humerus)
    bones : bodies that carry markers
    muscles : strands of the model by the muscle's name, empty for all between base and limb
    joint : a hinge has the one axis of the model's joint
    """

    base: str
    first: str
    bones: tuple[str, ...] = ()
    muscles: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    joint: Literal["ball", "hinge"] = "ball"


@dataclass(frozen=True, eq=False)
class SwingTrial:
    """One raw recording of a swing.

    Attributes
    ----------
    name : of the trial
    markers : in the laboratory, whose axes are those of the model's ground
    wrenches : on the plate's clock, that count for the base, whatever body they name
    time : start and end of what is to be used [s]
    tare : the plate with the fixture but without limb, of which the mean is taken off; None where
        it was set to zero so
    """

    name: str
    markers: Markers
    wrenches: Wrenches
    time: tuple[float, float] | None = None
    tare: Wrenches | None = None


@read_only
class Specimen:
    """A base, a joint and a limb, everything else of the model gone.

    The base stands on the ground by six coordinates that are zero at `stand`; the joint turns by
    the angles of body-fixed rotations that are zero at the model's default pose, or at another that
    `resting` sets. The middle rotation is the one nearest to the limb's long axis, so that a limb
    that hangs and swings stays far from the pose in which the other two fall together.

    The joint's `center` is in the base, `center_in_limb` in the limb's first body [m]; `axes` are
    those that the joint leaves free, "x", "y", "z" of that body or a hinge's name, `axis_vectors`
    (axes, 3) in it; `notes` on what is otherwise than in the source; `turning_axes` (2, 3): where
    the source's joint has three axes, the first in the base and the last in the limb.
    """

    model: Model
    names: SpecimenNames
    center: Array
    center_in_limb: Array
    base_coordinates: tuple[str, ...]
    joint_coordinates: tuple[str, ...]
    held_coordinates: tuple[str, ...]
    axes: tuple[str, ...]
    axis_vectors: Array
    muscles: Mapping[str, tuple[str, ...]]
    notes: tuple[str, ...] = ()
    turning_axes: Array = field(default_factory=lambda: np.zeros((0, 3)))

    @property
    def base(self) -> str:
        """Name of the base."""
        return self.names.base

    @property
    def first(self) -> str:
        """Name of the limb's first body."""
        return self.names.first

    @property
    def limb(self) -> tuple[str, ...]:
        """Names of the bones that swing."""
        return tuple(name for name in self.model.body_names if name != self.base)

    @cached_property
    def stand(self) -> Transform:
        """Pose of the base in ground where its coordinates are zero."""
        joint = self._joint(self.base)
        return joint.parent_frame @ joint.child_frame.inverse()

    @cached_property
    def center_in_ground(self) -> Array:
        """(3,) of the joint while the base's coordinates are zero [m]."""
        return self.stand.apply(self.center)

    @cached_property
    def pendulum(self) -> Model:
        """The limb as one link about the joint's center, along the axes of its first body.

        Its joint stands on the ground where the base carries it, and has the specimen's
        coordinates.
        """
        joint = self._joint(self.first)
        frame = self.stand @ joint.parent_frame
        hung = replace(joint, parent=GROUND, parent_frame=frame, child_frame=Transform.identity())
        coordinates = tuple(self.model.coordinate(name) for name in self.joint_coordinates)
        link = replace(self.model.body(self.first), meshes=())
        return Model(
            name=self.model.name,
            bodies=(link,),
            joints=(hung,),
            coordinates=coordinates,
            gravity=self.model.gravity,
        )

    @property
    def hinges(self) -> Array:
        """(2, 3) first and last of a ball's three axes; (0, 3) of a hinge.

        The first is in ground while it stands, the last in the limb: those of the source's joint
        where it has three, else those of its own angles.
        """
        joint = self._joint(self.first)
        if joint.kind != "ball":
            return np.zeros((0, 3))
        parent = joint.parent_frame.rotation
        child = joint.child_frame.rotation
        first = parent @ joint.axes[0].vector
        last = child @ joint.axes[2].vector
        if len(self.turning_axes):
            first, last = self.turning_axes
        return np.stack([self.stand.rotation @ first, last])

    @property
    def isometric_forces(self) -> Array:
        """(muscles,) largest isometric force, all strands together [N].

        It is proportional to the cross-section.
        """
        forces = {muscle.name: muscle.max_isometric_force for muscle in self.model.muscles}
        return np.array(
            [sum(forces[strand] for strand in strands) for strands in self.muscles.values()]
        )

    def standing(self, pose: Transform) -> Specimen:
        """Let the base stand at a pose in ground when its coordinates are zero."""
        joint = self._joint(self.base)
        frame = pose @ joint.child_frame
        return replace(self, model=self._with_joint(replace(joint, parent_frame=frame)))

    def resting(self, rotation: Array) -> Specimen:
        """Let the joint's coordinates be zero at a rotation; a hinge keeps its zero.

        Parameters
        ----------
        rotation : (3, 3) of the limb in the base

        Returns
        -------
        the specimen
        """
        if len(self.joint_coordinates) == 1:
            return self
        joint = self._joint(self.first)
        frame = Transform(np.asarray(rotation) @ joint.child_frame.rotation, self.center)
        return replace(self, model=self._with_joint(replace(joint, parent_frame=frame)))

    def centered(self, in_base: Array, in_limb: Array) -> Specimen:
        """Move the joint's center.

        Parameters
        ----------
        in_base, in_limb : (3,) where it is in both [m]

        Returns
        -------
        the specimen
        """
        joint = self._joint(self.first)
        parent = Transform(joint.parent_frame.rotation, in_base)
        child = Transform(joint.child_frame.rotation, in_limb)
        model = self._with_joint(replace(joint, parent_frame=parent, child_frame=child))
        return replace(
            self, model=model, center=frozen_array(in_base), center_in_limb=frozen_array(in_limb)
        )

    def turned(self, rotation: Array) -> Specimen:
        """Turn the ground.

        Parameters
        ----------
        rotation : (3, 3) its rows are the new axes in the old ones

        Returns
        -------
        the specimen
        """
        turn = Transform(np.asarray(rotation, dtype=np.float64), np.zeros(3))
        moved = self.standing(turn @ self.stand)
        return replace(
            moved, model=replace(moved.model, gravity=turn.rotation @ self.model.gravity)
        )

    def with_markers(self, markers: tuple[Marker, ...]) -> Specimen:
        """Give it other markers."""
        return replace(self, model=self.model.with_markers(markers))

    def _joint(self, child: str) -> Joint:
        return next(joint for joint in self.model.joints if joint.child == child)

    def _with_joint(self, joint: Joint) -> Model:
        joints = tuple(
            joint if other.child == joint.child else other for other in self.model.joints
        )
        return replace(self.model, joints=joints)


def build_specimen(model: Model, names: SpecimenNames) -> Specimen:
    """Make the specimen of [S] out of a shoulder model, or of any model with a limb on a base.

    The base stands on six coordinates; between base and limb is a ball joint of three coordinates
    at the center of the model's joint, or a hinge, whatever phantom bodies the model has there.
    Joints beyond stay, as coordinates that wires hold. Bodies beyond a bone move with it,
    everything else of the model is dropped.

    Parameters
    ----------
    model : with base and limb
    names : of their bodies and muscles
    """
    source = bodies.anatomy(model, names.base, names.first, names.bones)
    center, directions, distance = bodies.joint_center(source, names.base, names.first)
    joints = _joints(source, names, center, directions)
    kept = frozenset(coordinate.name for coordinate in joints.held)
    muscles, strands, surfaces, changed = kept_muscles(source, names.muscles, kept)
    couplers = [
        coupler
        for coupler in model.couplers
        if kept.issuperset((coupler.dependent, *coupler.independents))
    ]
    made = Model(
        name=model.name,
        bodies=bodies.lumped_bodies(source),
        joints=joints.chain,
        coordinates=(*joints.base, *joints.turning, *joints.held),
        gravity=model.gravity,
        markers=_markers(source),
        muscles=strands,
        wrap_objects=surfaces,
        couplers=tuple(couplers),
        source=model.source,
    )
    return Specimen(
        model=made,
        names=names,
        center=frozen_array(source.pose(names.base).inverse().apply(center)),
        center_in_limb=frozen_array(source.pose(names.first).inverse().apply(center)),
        base_coordinates=_names(joints.base),
        joint_coordinates=_names(joints.turning),
        held_coordinates=_names(joints.held),
        axes=AXES if names.joint == "ball" else _names(joints.turning),
        axis_vectors=frozen_array(joints.vectors),
        muscles=FrozenMap(muscles),
        notes=(*_center_notes(names, distance), *changed),
        turning_axes=frozen_array(_turning_axes(source, names, directions)),
    )


class SpecimenJoints(NamedTuple):
    """The joints of a specimen.

    Attributes
    ----------
    chain : of base, limb, and bones that are held
    base, turning, held : coordinates of these
    vectors : (axes, 3) free axes in the limb's first body
    """

    chain: tuple[Joint, ...]
    base: tuple[Coordinate, ...]
    turning: tuple[Coordinate, ...]
    held: tuple[Coordinate, ...]
    vectors: Array


def _joints(
    source: bodies.Anatomy, names: SpecimenNames, center: Array, directions: Array
) -> SpecimenJoints:
    """Make the joints: the base's on the ground, the one that turns at the center, those held.

    Parameters
    ----------
    center : (3,) in ground [m]
    directions : (axes, 3) of the source's axes
    """
    base_joint, base_coordinates = _base_joint(source, names.base)
    joint, joint_coordinates, vectors = _joint(source, names, center, directions)
    chain = [base_joint, joint]
    held = list[Coordinate]()
    for bone in source.bones:
        if bone not in (names.base, names.first):
            holding, coordinates = bodies.held_joint(source, bone)
            chain.append(holding)
            held += coordinates
    return SpecimenJoints(
        chain=tuple(chain),
        base=base_coordinates,
        turning=joint_coordinates,
        held=tuple(held),
        vectors=vectors,
    )


def _names(coordinates: Sequence[Coordinate]) -> tuple[str, ...]:
    """List the names of coordinates."""
    return tuple(coordinate.name for coordinate in coordinates)


def _center_notes(names: SpecimenNames, distance: float) -> tuple[str, ...]:
    """Note where the axes of the source's joint miss each other [m]."""
    if distance <= bodies.ASTRAY:
        return ()
    missed = f"the joint's center is {1000 * distance:.1f} mm from one of them"
    return (f"the axes between '{names.base}' and '{names.first}' miss each other: {missed}",)


def _turning_axes(source: bodies.Anatomy, names: SpecimenNames, directions: Array) -> Array:
    """Find the first of three axes in the base and the last in the limb (2, 3), or none (0, 3)."""
    if len(directions) != 3:
        return np.zeros((0, 3))
    # The first axis never moves in the base, nor the last in the limb, whatever the pose.
    ends = zip((names.base, names.first), directions[[0, 2]], strict=True)
    return np.stack([source.pose(body).rotation.T @ direction for body, direction in ends])


def _base_joint(source: bodies.Anatomy, base: str) -> tuple[Joint, tuple[Coordinate, ...]]:
    places = [f"{base}_t{axis}" for axis in AXES]
    angles = [f"{base}_r{axis}" for axis in AXES]
    coordinates = bodies.free(places, "translational") + bodies.free(angles)
    names = tuple(coordinate.name for coordinate in coordinates)
    axes = bodies.shifts(places) + bodies.turns(angles)
    return (
        Joint(
            name=f"ground_{base}",
            kind="free",
            parent=GROUND,
            child=base,
            parent_frame=source.pose(base),
            child_frame=Transform.identity(),
            axes=axes,
            coordinates=names,
        ),
        coordinates,
    )


def _joint(
    source: bodies.Anatomy, names: SpecimenNames, center: Array, directions: Array
) -> tuple[Joint, tuple[Coordinate, ...], Array]:
    """Make the joint at the center; its frames have the axes of the limb's first body."""
    base = source.pose(names.base)
    first = source.pose(names.first)
    in_limb = first.inverse().apply(center)
    child = Transform(np.eye(3), in_limb)
    parent = base.inverse() @ first @ child
    if names.joint == "ball":
        order = _order(source, names.first, in_limb)
        angles = [f"{names.first}_r{AXES[axis]}" for axis in order]
        coordinates = bodies.free(angles)
        joint = Joint(
            name=f"{names.base}_{names.first}",
            kind="ball",
            parent=names.base,
            child=names.first,
            parent_frame=parent,
            child_frame=child,
        )
        return (
            replace(joint, axes=bodies.turns(angles, order), coordinates=tuple(angles)),
            coordinates,
            np.eye(3),
        )
    aligned = directions @ directions[0]
    if np.abs(aligned).min() < np.cos(0.02):
        turns = f"'{names.first}' rotates on '{names.base}' about several axes, so it is no hinge"
        raise BadModel(f"model '{source.model.name}': {turns}: set joint to 'ball'")
    vector = first.rotation.T @ directions[0]
    angle = f"{names.first}_angle"
    axis = Axis(kind="rotation", vector=vector, function=linear(1.0), coordinates=(angle,))
    joint = Joint(
        name=f"{names.base}_{names.first}",
        kind="hinge",
        parent=names.base,
        child=names.first,
        parent_frame=parent,
        child_frame=child,
        axes=(axis,),
        coordinates=(angle,),
    )
    return joint, bodies.free([angle]), vector[None]


def _order(source: bodies.Anatomy, first: str, in_limb: Array) -> tuple[int, int, int]:
    """Order a ball's rotations: in the middle the axis nearest to the limb's length."""
    inverse = source.pose(first).inverse()
    places = [inverse.apply(source.pose(name).translation) - in_limb for name in source.bones]
    places += [source.model.body(first).mass_center - in_limb]
    below = [
        place
        for place, name in zip(places, (*source.bones, first), strict=True)
        if name != source.bones[0]
    ]
    farthest = max(below, key=lambda place: float(np.linalg.norm(place)))
    middle = int(np.argmax(np.abs(farthest)))
    return (middle - 1) % 3, middle, (middle + 1) % 3


def _markers(source: bodies.Anatomy) -> tuple[Marker, ...]:
    kept = []
    for marker in source.model.markers:
        if marker.body in source.homes:
            home, pose = source.homes[marker.body]
            kept.append(replace(marker, body=home, location=pose.apply(marker.location)))
    return tuple(kept)
