"""Where the centers of joints come to lie in other bones: where the map puts them, or amid round surfaces."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.errors import BadData
from myomorph.model.model import Joint
from myomorph.morph.articular import articular_cylinder, articular_sphere, doubt
from myomorph.morph.carrier import Carrier, Carriers

APART = 0.05
"""Centers further apart than this share of the longer bone's length are left apart: the bones are not as in a body."""

AGREES = 0.2
"""The source's joint center is that of a round surface where it lies this near to it, as a share of the radius."""

STRAYS = 0.1
"""Where surfaces were matched, a round one further from where the map puts its center, as a share of the radius, is not
believed: a deformed head is no sphere any more, and condyles are round only in part."""

TILTED = np.cos(np.radians(15.0))
"""A hinge turns about a cylinder whose axis is within this of its own."""

Round = Literal["sphere", "cylinder"]


@dataclass(frozen=True, eq=False)
class Center:
    """A joint's center in the target's bones; see `RebuiltJoint`."""

    method: str
    in_parent: Array
    in_child: Array
    moved: float = 0.0
    gap: float = float("nan")


@dataclass(frozen=True, eq=False)
class _Fitted:
    """A center in one of the target's bones, by a round surface or by the map, and whether it lies inside the bone."""

    center: Array
    method: str = "mapped"
    moved: float = 0.0
    inside: bool = False


@dataclass(frozen=True, eq=False)
class CenterFinder:
    """Finds the centers of joints.

    Attributes
    ----------
    carriers : of all bodies and of the ground
    fitted : take them from round surfaces of the target where such fit as in the source
    together : the target's bones share a frame, so parent and child must agree
    """

    carriers: Carriers
    fitted: bool
    together: bool

    def center(self, joint: Joint, in_parent: Array, in_child: Array) -> Center:
        """Where a center (3,) known in the source's parent and child lies in the target's.

        A ball joint (that turns by two coordinates or more) is centered in a sphere, a hinge on a cylinder, of either
        bone, if the source's joint is so in the source's bone: what is between the joint's center and the surface's in
        the source is kept. Bones that share a frame share the center: a fitted one before a mapped one, that of a bone
        that it lies in before that of one beside which it lies, else the middle.
        """
        parent, child = self.carriers[joint.parent], self.carriers[joint.child]
        turns = [axis for axis in joint.axes if axis.kind == "rotation" and axis.function.arity]
        found = [_mapped(parent, in_parent), _mapped(child, in_child)]
        if self.fitted and turns:
            shape: Round = "sphere" if len({name for axis in turns for name in axis.coordinates}) > 1 else "cylinder"
            frames = joint.parent_frame, joint.child_frame
            found = [
                _fitted(carrier, place, frame.rotation @ turns[0].vector, shape)
                for carrier, place, frame in zip((parent, child), (in_parent, in_child), frames, strict=True)
            ]
        ours, theirs = found
        method = theirs.method if theirs.method != "mapped" else ours.method
        moved = max(ours.moved, theirs.moved)
        if not self.together or not {parent.bone.basis, child.bone.basis} <= {"bone", "landmarks", "given"}:
            return Center(method, ours.center, theirs.center, moved)
        gap = float(np.linalg.norm(ours.center - theirs.center))
        if gap > furthest_gap(parent, child):
            return Center(method, ours.center, theirs.center, moved, gap)
        shared = _shared(found)
        return Center(method, shared, shared, moved, gap)


def furthest_gap(parent: Carrier, child: Carrier) -> float:
    """How far the centers that two bones in one frame give their joint may be from each other [m]."""
    return APART * max(one.length * one.size for one in (parent, child))


def _shared(found: list[_Fitted]) -> Array:
    """One center for both bones: fitted rather than mapped, of a head rather than a socket."""
    ranks = [2 * (one.method != "mapped") + one.inside for one in found]
    best = [one.center for one, rank in zip(found, ranks, strict=True) if rank == max(ranks)]
    return np.mean(best, axis=0)


def _depth(carrier: Carrier, place: Array) -> float:
    """Of a place (3,) of the source over its bone's surface, negative inside, NaN without surfaces [m]."""
    return float("nan") if carrier.shapes is None else float(carrier.shapes[0].signed(place[None])[0])


def _mapped(carrier: Carrier, place: Array) -> _Fitted:
    return _Fitted(carrier.points(place), inside=_depth(carrier, place) < 0.0)


def _fitted(carrier: Carrier, place: Array, axis: Array, shape: Round) -> _Fitted:
    """A center (3,) of the source in the target's bone, by the round surface about it if there is one."""
    mapped = _mapped(carrier, place)
    if carrier.shapes is None:
        return mapped
    depth = _depth(carrier, place)
    try:
        fitted = _center(carrier, place, axis, shape, abs(depth), depth > 0.0)
    except BadData:  # there is nothing round
        return mapped
    if fitted is None:
        return mapped
    return _Fitted(fitted, shape, float(np.linalg.norm(fitted - mapped.center)), mapped.inside)


def _center(carrier: Carrier, place: Array, axis: Array, shape: Round, radius: float, hollow: bool) -> Array | None:
    source, target = carrier.bone.source, carrier.bone.target
    assert source is not None
    assert target is not None
    matrix = carrier.near(place)
    if shape == "sphere":
        ball = articular_sphere(source, place, radius, hollow)
        beside = place - ball.center
        if doubt(ball) or np.linalg.norm(beside) > AGREES * ball.radius:
            return None
        other = articular_sphere(target, carrier.points(ball.center), ball.radius * carrier.size, hollow)
        if doubt(other) or _strays(carrier, other.center, carrier.points(ball.center), other.radius):
            return None
        return np.asarray(other.center + matrix @ beside)
    roller = articular_cylinder(source, place, axis, radius, hollow=hollow)
    beside = (place - roller.point) - (place - roller.point) @ roller.axis * roller.axis
    if doubt(roller) or abs(roller.axis @ axis) < TILTED or np.linalg.norm(beside) > AGREES * roller.radius:
        return None
    along = matrix @ roller.axis
    size = carrier.size
    there = articular_cylinder(
        target, carrier.points(place), along, roller.radius * size, 2.0 * roller.length * size, hollow
    )
    goal = carrier.points(place)
    center: Array = there.point + (goal - there.point) @ there.axis * there.axis + matrix @ beside
    return None if doubt(there) or _strays(carrier, center, goal, there.radius) else center


def _strays(carrier: Carrier, fitted: Array, mapped: Array, radius: float) -> bool:
    return carrier.bone.basis == "bone" and bool(np.linalg.norm(fitted - mapped) > STRAYS * radius)
