"""Parts that two models of a human body have in common.

Regions, joint centers between them, and masses given to regions.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cached_property
from itertools import compress
from typing import NamedTuple

import numpy as np

from myomorph.body.shape.points import frames_in_ground
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.inertia import inertial_parameters, pseudo_inertias
from myomorph.core.model.model import GROUND, Joint, Model
from myomorph.core.model.segments import Segment, segments_of
from myomorph.core.model.series import Motion
from myomorph.core.model.sides import split_side
from myomorph.core.rigid.tree import compile_tree

CENTER_OF = {
    "thigh": "hip",
    "shank": "knee",
    "talus": "ankle",
    "foot": "subtalar",
    "toes": "toes",
    "torso": "lumbar",
    "head": "neck",
    "upper_arm": "shoulder",
    "lower_arm": "elbow",
    "hand": "wrist",
}
"""The joint by which each region hangs on the one before it; a foot without a talus hangs on the
ankle.
"""
PARENT = {
    "torso": "pelvis",
    "thigh": "pelvis",
    "shank": "thigh",
    "talus": "shank",
    "foot": "talus",
    "toes": "foot",
    "head": "torso",
    "upper_arm": "torso",
    "lower_arm": "upper_arm",
    "hand": "lower_arm",
}
MIDDLE = ("pelvis", "torso", "head")
HINGES = ("knee", "elbow")


class Region(NamedTuple):
    """A part of the body that several models share: the pelvis, or one of `PARENT`.

    Attributes
    ----------
    name : of the part
    side : "left" or "right"; "" in the middle
    """

    name: str
    side: str = ""

    @property
    def parent(self) -> Region | None:
        """The region it hangs on, None of the pelvis."""
        if self.name not in PARENT:
            return None
        name = PARENT[self.name]
        return Region(name, "" if name in MIDDLE else self.side)

    def __str__(self) -> str:
        return f"{self.side} {self.name.replace('_', ' ')}".strip()


@read_only
class Center:
    """A joint center: a point of the first body of a region, and the joint that makes it.

    Attributes
    ----------
    name : of the joint, "hip"
    side : "left", "right" or ""
    inner, outer : the regions that meet there
    joint : that makes it
    location : (3,) in the body `joint.child` [m]
    """

    name: str
    side: str
    inner: Region
    outer: Region
    joint: Joint
    location: Array

    @property
    def key(self) -> str:
        """Name with side, "right hip"."""
        return f"{self.side} {self.name}".strip()


def regions_of(model: Model, stated: Mapping[str, Segment] | None = None) -> dict[str, Region]:
    """Assign bodies to regions, by the segments that the bodies' names mean.

    The pelvis is what cannot move against the body that carries the thighs; the rest of the trunk,
    spine, ribs and shoulder girdle together, is the torso.

    Parameters
    ----------
    model : of a human body
    stated : segments that go before the names

    Returns
    -------
    region of every body

    Raises
    ------
    BadData : no body is called a thigh, or names mean no segments
    """
    segments = segments_of(model, stated)
    parents = {joint.child: joint.parent for joint in model.joints}
    pelvis = _pelvis(model, segments, parents)
    result = {}
    for name, segment in segments.items():
        if name in pelvis:
            region = "pelvis"
        elif segment.name == "head" and all(
            segments[child].name == "head" for child in _below(model, name)
        ):
            region = "head"
        elif segment.name in ("head", "upper_trunk", "lower_trunk"):
            region = "torso"
        elif segment.name == "foot":
            region = _part_of_foot(name)
        else:
            region = segment.name
        result[name] = Region(region, "" if region in MIDDLE else segment.side)
    return result


def _pelvis(model: Model, segments: Mapping[str, Segment], parents: Mapping[str, str]) -> set[str]:
    carriers = {
        parents[name]
        for name, segment in segments.items()
        if segment.name == "thigh"
        and parents[name] != GROUND
        and segments[parents[name]].name != "thigh"
    }
    if not carriers:
        raise BadData(
            f"no body of model '{model.name}' is called a thigh, so its pelvis is unknown"
        )
    result = set(carriers)
    while True:
        size = len(result)
        for joint in model.joints:
            pair = {joint.parent, joint.child}
            still = not any(axis.function.arity for axis in joint.axes)
            if still and GROUND not in pair and pair & result:
                result |= {name for name in pair if segments[name].name == "lower_trunk"}
        if len(result) == size:
            return result


def _part_of_foot(body: str) -> str:
    base = split_side(body)[0].lower()
    if re.search(r"talus|astragal", base):
        return "talus"
    return "toes" if re.search(r"toe|phalan", base) else "foot"


def centers_of(model: Model, regions: Mapping[str, Region]) -> dict[str, Center]:
    """Find the joint centers between regions.

    A center is the origin of the joint's frame in the outer body, or the mean anchor of its hinges.
    Of several joints, it is that which carries the most bodies.

    Parameters
    ----------
    model : of a human body
    regions : of every body

    Returns
    -------
    centers by key
    """
    result: dict[str, Center] = {}
    for joint in model.joints:
        if joint.parent == GROUND or regions[joint.parent] == regions[joint.child]:
            continue
        inner = regions[joint.parent]
        outer = regions[joint.child]
        if outer.name not in CENTER_OF:
            continue
        name = "ankle" if outer.name == "foot" and inner.name == "shank" else CENTER_OF[outer.name]
        anchors = [
            axis.origin for axis in joint.axes if axis.kind == "rotation" and axis.function.arity
        ]
        location = joint.child_frame.apply(np.mean(anchors, axis=0) if anchors else np.zeros(3))
        center = Center(
            name=name, side=outer.side, inner=inner, outer=outer, joint=joint, location=location
        )
        other = result.get(center.key)
        if other is None or len(_below(model, joint.child)) > len(_below(model, other.joint.child)):
            result[center.key] = center
    return result


def _below(model: Model, body: str) -> tuple[str, ...]:
    """Return a body and all that hang on it."""
    return tuple(compress(model.body_names, compile_tree(model).hanging(body)[1:]))


@read_only
class Standing:
    """A model in the first frame of a motion, its bodies by region.

    Attributes
    ----------
    model : whose bodies they are
    pose : its first frame counts
    regions : of every body
    """

    model: Model
    pose: Motion
    regions: Mapping[str, Region]

    @cached_property
    def frames(self) -> dict[str, Array]:
        """(4, 4) poses of the bodies' frames in ground."""
        return dict(
            zip(self.model.body_names, frames_in_ground(self.model, self.pose), strict=True)
        )

    @cached_property
    def centers(self) -> dict[str, Center]:
        """See `centers_of`."""
        return centers_of(self.model, self.regions)

    @cached_property
    def places(self) -> dict[str, Array]:
        """(3,) each center in ground [m]."""
        return {
            key: self.in_ground(center.joint.child, center.location)
            for key, center in self.centers.items()
        }

    def in_ground(self, body: str, point: Array) -> Array:
        """Place a point of a body in ground.

        Parameters
        ----------
        body : name
        point : (3,) in the body [m]

        Returns
        -------
        (3,) [m]
        """
        return self.frames[body][:3, :3] @ point + self.frames[body][:3, 3]

    def in_body(self, body: str, place: Array) -> Array:
        """Express a position in ground as a point of a body.

        Parameters
        ----------
        body : name
        place : (3,) in ground [m]

        Returns
        -------
        (3,) [m]
        """
        return self.frames[body][:3, :3].T @ (place - self.frames[body][:3, 3])

    def hinge_axis(self, key: str) -> Array | None:
        """Find the first moving axis of the joint of a center.

        Parameters
        ----------
        key : of the center

        Returns
        -------
        (3,) in ground; None where none moves
        """
        joint = self.centers[key].joint
        axis = next(
            (each for each in joint.axes if each.kind == "rotation" and each.function.arity), None
        )
        if axis is None:
            return None
        return self.frames[joint.parent][:3, :3] @ joint.parent_frame.rotation @ axis.vector

    def pseudo_inertias(self) -> Array:
        """Compute pseudo-inertias of all bodies about the ground's origin.

        Returns
        -------
        (bodies, 4, 4) in ground
        """
        frames = np.array(list(self.frames.values()))
        return frames @ pseudo_inertias(inertial_parameters(self.model)) @ np.swapaxes(frames, 1, 2)


def spread(inertia: Array, target: Array) -> Array:
    """Change pseudo-inertias as evenly as possible so that their sum is a target.

    All masses grow by the same factor and all mass centers move by the same vector, which gives the
    sum its mass and its mass center. With second moments P of the sum and Q of the target about the
    mass center, both in the basis V that makes P = V V^T and Q = V L V^T with L diagonal: where L <
    1 the bodies are drawn together by the linear map that turns P into V min(L, 1) V^T and moves
    mass the least (Olkin and Pukelsheim 1982); where L > 1 each body gets its share by mass of V
    max(L - 1, 0) V^T, without moving. Every body stays physically possible.

    Parameters
    ----------
    inertia : (bodies, 4, 4) in ground, their sum of positive mass
    target : (4, 4) in ground

    Returns
    -------
    (bodies, 4, 4)

    Raises
    ------
    BadData : sum or target are of no body
    """
    total = inertia.sum(axis=0)
    P = _moments(total)
    Q = _moments(target)
    half = _root(P)
    inverse = np.linalg.inv(half)
    values, vectors = np.linalg.eigh(inverse @ Q @ inverse)
    V = half @ vectors
    less = V * np.minimum(values, 1.0) @ V.T
    more = V * np.maximum(values - 1.0, 0.0) @ V.T
    G = inverse @ _root(half @ less @ half) @ inverse
    result = _moved(inertia, total, target, G)
    result[:, :3, :3] += result[:, 3, 3, None, None] * more
    return result


def spread_mass(inertia: Array, target: Array) -> Array:
    """Change pseudo-inertias so that only mass and mass center of the sum are the target's.

    Moments about them are as they grow with mass.

    Parameters
    ----------
    inertia : (bodies, 4, 4) in ground, their sum of positive mass
    target : (4, 4) in ground

    Returns
    -------
    (bodies, 4, 4)
    """
    return _moved(inertia, inertia.sum(axis=0), target, np.eye(3))


def _moved(inertia: Array, total: Array, target: Array, linear: Array) -> Array:
    """Scale all masses, and move them so that mass and mass center are the target's.

    Parameters
    ----------
    inertia : (bodies, 4, 4)
    total, target : (4, 4) sum of them, and what it should be
    linear : (3, 3) map about the mass center of the sum
    """
    growth = target[3, 3] / total[3, 3]
    A = np.eye(4)
    A[:3, :3] = linear
    A[:3, 3] = target[:3, 3] / target[3, 3] - linear @ (total[:3, 3] / total[3, 3])
    return growth * (A @ inertia @ A.T)


def _moments(pseudo: Array) -> Array:
    """Compute second moments about the mass center per mass.

    Parameters
    ----------
    pseudo : (4, 4)

    Returns
    -------
    (3, 3) [m^2]

    Raises
    ------
    BadData : the mass or a principal second moment is not above 0
    """
    mass = pseudo[3, 3]
    if not mass > 0.0:
        raise BadData(f"its mass is {mass:.4g} kg")
    center = pseudo[:3, 3] / mass
    moments: Array = pseudo[:3, :3] / mass - np.outer(center, center)
    least = float(np.linalg.eigvalsh(moments)[0])
    if not least > 0.0:
        raise BadData(
            f"its least second moment of mass is {least * mass:.3g} kg m^2: no distribution of mass"
            " has it"
        )
    return moments


def _root(matrix: Array) -> Array:
    """Compute the square root of a positive semidefinite matrix."""
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    return (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
