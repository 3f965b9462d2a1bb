"""Lengths of a body that may differ from the model's.

Which bodies are scaled together, along which axes, and units of size.

The virtual prismatic coordinates of [D] 3.2.1: the distances between the joint centers of a segment
are unknowns that do not change with time. They are factors of the model's own lengths here, so that
everything fixed to a segment follows when the model is scaled.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.frozen_map import grouped
from myomorph.core.model.model import GROUND, Model
from myomorph.core.model.segments import Segment, segments_if_human
from myomorph.core.model.series import DEFAULT_POSE
from myomorph.core.model.sides import mirror_names, split_side
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import ROTATION, Tree, compile_tree

AXES = "xyz"
_SHOULDER_BLADE = re.compile(r"clav|scap|acromi|shoulder", re.IGNORECASE)


@dataclass(frozen=True)
class Length:
    """One length: an axis of a segment, scaled by one factor.

    Attributes
    ----------
    name : of the segment's heaviest body and the axis, as "femur_r_y"
    segment : name of its heaviest body
    stretched : (body, axis 0 ... 2) of every body axis that takes the factor
    extent : how far the joint centers lie apart along it; in a last segment the joint and the
        markers, or the center of mass [m]
    along : this is the longest of the segment's axes, from joint to joint
    between_joints : the segment has joints at both ends; else the length shows in markers only
    """

    name: str
    segment: str
    stretched: tuple[tuple[str, int], ...]
    extent: float
    along: bool
    between_joints: bool


def lengths_of(model: Model, symmetric: bool = False) -> tuple[Length, ...]:
    """Find three lengths for every segment of a model: from joint to joint, and the two across.

    Bodies belong to one segment where no coordinate of their own lets them move against each other
    (welds, couplers, paths driven by a neighbor's angle) and, in a model of a human body, where
    their names say the same segment: heel, ankle bone and toes are a foot, ulna and radius a
    forearm, all vertebrae and ribs above the pelvis a trunk. The axes of a segment are those of its
    first body; other bodies' axes follow the one they lie nearest to in the default pose.

    Parameters
    ----------
    model : of any body
    symmetric : use one factor for the right and the left

    Returns
    -------
    three lengths for each segment, in the order of the tree
    """
    pose = _DefaultPose.of(model)
    lengths = [length for bodies in segments_that_stretch(model) for length in pose.lengths(bodies)]
    return _one_for_both_sides(lengths) if symmetric else tuple(lengths)


@read_only
class _DefaultPose:
    """Bodies, joints and markers of a model in its default pose.

    Attributes
    ----------
    model : of any body
    tree : the compiled model
    rotations : (bodies, 3, 3) to ground
    origins : (bodies, 3) in ground [m]
    centers : (bodies, 3) joint of each body with its parent, in ground [m]
    """

    model: Model
    tree: Tree
    rotations: Array
    origins: Array
    centers: Array

    @staticmethod
    def of(model: Model) -> _DefaultPose:
        """Pose a model."""
        tree = compile_tree(model)
        pose = forward_kinematics(tree, tree.coordinates_of(DEFAULT_POSE))
        return _DefaultPose(
            model=model,
            tree=tree,
            rotations=pose.rotations[0],
            origins=pose.origins[0],
            centers=joint_centers(tree, pose.axis_points[0], pose.origins[0]),
        )

    def place(self, body: str, point: Array) -> Array:
        """Locate a point of a body (3,) in ground (3,) [m]."""
        b = self.tree.body_index[body]
        return np.asarray(self.rotations[b] @ point + self.origins[b])

    def joints(self, bodies: Sequence[str]) -> list[Array]:
        """Locate the joints of a segment in ground (3,) [m], that to its parent first."""
        inside = set(bodies)
        others = [
            joint.child
            for joint in self.model.joints
            if joint.parent in inside and joint.child not in inside
        ]
        return [self.centers[self.tree.body_index[body]] for body in (bodies[0], *others)]

    def lengths(self, bodies: Sequence[str]) -> list[Length]:
        """Measure a segment along the axes of its first body.

        Parameters
        ----------
        bodies : of the segment

        Returns
        -------
        three lengths
        """
        name = max(bodies, key=lambda body: self.model.body(body).mass)
        first = self.rotations[self.tree.body_index[bodies[0]]]
        joints = self.joints(bodies)
        between_joints = len(joints) > 1
        ends = [] if between_joints else self._ends(bodies, name)
        extents = np.ptp(np.array([*joints, *ends]) @ first, axis=0)
        axes = {
            body: _nearest_axes(first, self.rotations[self.tree.body_index[body]])
            for body in bodies
        }
        longest = int(np.argmax(extents))
        return [
            Length(
                name=f"{name}_{AXES[axis]}",
                segment=name,
                stretched=tuple((body, axes[body][axis]) for body in bodies),
                extent=float(extents[axis]),
                along=axis == longest,
                between_joints=between_joints,
            )
            for axis in range(3)
        ]

    def _ends(self, bodies: Sequence[str], heaviest: str) -> list[Array]:
        """Locate in ground (3,) [m] what shows where a last segment ends.

        Its markers, or where it has none the center of mass of its heaviest body.
        """
        by_body = [
            [marker for marker in self.model.markers if marker.body == body] for body in bodies
        ]
        markers = [self.place(marker.body, marker.location) for each in by_body for marker in each]
        return markers or [self.place(heaviest, self.model.body(heaviest).mass_center)]


def segments_that_stretch(model: Model) -> tuple[tuple[str, ...], ...]:
    """Group the bodies that are scaled as one segment.

    Parameters
    ----------
    model : of any body

    Returns
    -------
    the bodies of every segment, each in the order of the tree
    """
    free = {coordinate.name for coordinate in model.coordinates} - set(model.dependent_coordinates)
    joints = {joint.child: joint for joint in model.joints}
    named = segments_if_human(model)
    keys: dict[str, object] = {}
    for body in model.body_names:
        joint = joints[body]
        if joint.parent != GROUND and not free & set(joint.coordinates):
            keys[body] = keys[joint.parent]
        elif body not in named:
            keys[body] = body
        elif named[body].name not in ("upper_trunk", "lower_trunk"):
            keys[body] = named[body]
        elif joint.parent == GROUND:
            keys[body] = "base"
        elif split_side(body)[1] and _SHOULDER_BLADE.search(body):
            keys[body] = Segment("shoulder", split_side(body)[1])
        else:
            keys[body] = "trunk"
    return tuple(
        tuple(bodies) for bodies in grouped((key, body) for body, key in keys.items()).values()
    )


def factors_of(lengths: Sequence[Length], values: Array) -> dict[str, Array]:
    """Spread the factor of each length to the bodies that it scales.

    Parameters
    ----------
    lengths : of the model
    values : (lengths,) factor of each [-]

    Returns
    -------
    scale factors (3,) of every body, along its x, y and z, as `scale` takes them [-]
    """
    factors: dict[str, Array] = {}
    for length, value in zip(lengths, values, strict=True):
        for body, axis in length.stretched:
            factors.setdefault(body, np.ones(3))[axis] = value
    return factors


def mirrored_lengths(lengths: Sequence[Length]) -> tuple[tuple[int, int], ...]:
    """Pair lengths that are the same one of the right and the left side.

    Parameters
    ----------
    lengths : of the model

    Returns
    -------
    numbers (i, j) of each pair, i < j
    """
    index = {length.name: i for i, length in enumerate(lengths)}
    mirror = mirror_names(length.segment for length in lengths)
    pairs = (
        (i, index[mirror[length.segment] + length.name[len(length.segment) :]])
        for i, length in enumerate(lengths)
        if length.segment in mirror
        and mirror[length.segment] + length.name[len(length.segment) :] in index
    )
    return tuple((i, j) for i, j in pairs if i < j)


def joint_centers(tree: Tree, axis_points: Array, origins: Array) -> Array:
    """Locate the center of every body's joint: a point on its last rotation axis, else its origin.

    Parameters
    ----------
    tree : the compiled model
    axis_points : (axes, 3) a point on each axis in ground, of `Poses.axis_points` [m]
    origins : (bodies, 3) in ground [m]

    Returns
    -------
    (bodies, 3) in ground [m]
    """
    centers = origins.copy()
    arrays = tree.arrays
    for index in range(len(arrays.axis_kind)):
        if arrays.axis_kind[index] == ROTATION:
            centers[arrays.axis_body[index]] = axis_points[index]
    return centers


def _nearest_axes(first: Array, other: Array) -> list[int]:
    """Match each axis of one frame to the nearest of another, each taken once.

    Parameters
    ----------
    first, other : (3, 3) rotations, axes as columns

    Returns
    -------
    for each axis of the first, the number of the other's
    """
    _, columns = scipy.optimize.linear_sum_assignment(-np.abs(first.T @ other))
    return [int(axis) for axis in columns]


def _one_for_both_sides(lengths: Sequence[Length]) -> tuple[Length, ...]:
    """Merge each pair of the right and the left into one length that scales both."""
    partner = dict(mirrored_lengths(lengths))
    merged = []
    for i, length in enumerate(lengths):
        if i in partner.values():
            continue
        if i in partner:
            other = lengths[partner[i]]
            segment = split_side(length.segment)[0]
            length = replace(
                length,
                name=segment + length.name[len(length.segment) :],
                segment=segment,
                stretched=length.stretched + other.stretched,
                extent=0.5 * (length.extent + other.extent),
            )
        merged.append(length)
    return tuple(merged)


# A body whose longest segment is that long, as an adult's forearm, or longer is of human size [m]
HUMAN_SEGMENT = 0.24


def length_unit(tree: Tree) -> float:
    """Return what stands for one metre in tolerances and usual distances.

        unit = min(1, longest segment / 0.24 m)

    It is 1 for a body of human size, else less in proportion. A segment is here the distance of a
    joint's center to that of its body's parent or to a marker of its body, in the default pose.

    Parameters
    ----------
    tree : the compiled model

    Returns
    -------
    [m], above 0 and at most 1
    """
    poses = forward_kinematics(tree, tree.coordinates_of(DEFAULT_POSE))
    centers = joint_centers(tree, poses.axis_points[0], poses.origins[0])
    joined = np.flatnonzero(tree.arrays.parent > 0)
    spans = np.linalg.norm(centers[joined] - centers[tree.arrays.parent[joined]], axis=1)
    bodies = np.array([tree.body_index[marker.body] for marker in tree.model.markers], np.int64)
    places = poses.markers(tree.model.markers)[0]
    marked = bodies > 0
    spans = np.concatenate([spans, np.linalg.norm(places - centers[bodies], axis=1)[marked]])
    longest = float(spans.max(initial=0.0))
    return min(1.0, longest / HUMAN_SEGMENT) if longest > 0.0 else 1.0


def coordinate_units(tree: Tree) -> Array:
    """Return the scale of a change of each coordinate: 1 rad, or `length_unit` for a translation.

    Parameters
    ----------
    tree : the compiled model

    Returns
    -------
    (coordinates,) [rad or m]
    """
    slides = np.array(
        [coordinate.motion == "translational" for coordinate in tree.model.coordinates]
    )
    return np.where(slides, length_unit(tree), 1.0)
