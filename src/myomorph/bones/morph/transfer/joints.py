"""Joints in other bones: centers, axes, and the travel of slides.

Centers come from the maps of parent and child or lie amid round surfaces.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from myomorph.bones.morph.morphed import RebuiltJoint
from myomorph.bones.morph.shapes.articular import (
    ExpectedCylinder,
    articular_cylinder,
    articular_sphere,
    warning_of,
)
from myomorph.bones.morph.transfer.body_transfer import Transfer, Transfers, nearest_rotation
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.functions import Function, value_at
from myomorph.core.model.model import Axis, Joint, Model
from myomorph.core.model.paths import PassiveTorque
from myomorph.core.model.scale import scaled_coordinates, scaled_couplers, slides_freely, stretched
from myomorph.core.model.series import DEFAULT_POSE
from myomorph.core.model.spatial import Transform, least_rotation
from myomorph.core.rigid.tree import compile_tree

APART = 0.05
"""Centers further apart than this share of the longer bone's length are left apart: the bones are
not as in a body.
"""

AGREES = 0.2
"""The source's joint center is that of a round surface where it lies this near to it, as a share of
the radius.
"""

STRAYS = 0.1
"""Where surfaces were matched, a round one further from where the map puts its center, as a share
of the radius, is not believed: a deformed head is no sphere any more, and condyles are round only
in part.
"""

# A hinge turns about a cylinder whose axis is within this of its own.
TILTED = np.cos(np.radians(15.0))
Round = Literal["sphere", "cylinder"]


@read_only
class _Fitted:
    """A center in one of the target's bones, and whether it lies inside the bone.

    It comes from a round surface or the map.
    """

    center: Array
    method: str = "mapped"
    moved: float = 0.0
    inside: bool = False


@dataclass(frozen=True, eq=False)
class CenterFinder:
    """Finds the centers of joints."""

    transfers: Transfers  # of all bodies and of the ground
    fitted: bool  # take them from round surfaces of the target where such fit as in the source
    together: bool  # the target's bones share a frame, so parent and child must agree

    def center(self, joint: Joint, in_parent: Array, in_child: Array) -> RebuiltJoint:
        """Find in the target a center that is known in the source's parent and child.

        A ball joint (that turns by two coordinates or more) is centered in a sphere, a hinge on a
        cylinder, of either bone, if the source's joint is so in the source's bone: what is between
        the joint's center and the surface's in the source is kept. Bones that share a frame share
        the center: a fitted one before a mapped one, that of a bone that it lies in before that of
        one beside which it lies, else the middle.

        Parameters
        ----------
        joint : of the source
        in_parent : (3,) center in its parent's frame [m]
        in_child : (3,) center in its child's frame [m]

        Returns
        -------
        the joint in the target, with its center in parent and child
        """
        parent = self.transfers[joint.parent]
        child = self.transfers[joint.child]
        turns = [axis for axis in joint.axes if axis.kind == "rotation" and axis.function.arity]
        centers = [_mapped(parent, in_parent), _mapped(child, in_child)]
        if self.fitted and turns:
            shape: Round = (
                "sphere"
                if len({name for axis in turns for name in axis.coordinates}) > 1
                else "cylinder"
            )
            frames = joint.parent_frame, joint.child_frame
            centers = [
                _fitted(transfer, place, frame.rotation @ turns[0].vector, shape)
                for transfer, place, frame in zip(
                    (parent, child), (in_parent, in_child), frames, strict=True
                )
            ]
        ours, theirs = centers
        method = theirs.method if theirs.method != "mapped" else ours.method
        moved = max(ours.moved, theirs.moved)
        if not self.together or not {parent.bone.basis, child.bone.basis} <= {
            "bone",
            "landmarks",
            "given",
        }:
            return RebuiltJoint(
                name=joint.name,
                method=method,
                in_parent=ours.center,
                in_child=theirs.center,
                moved=moved,
            )
        gap = float(np.linalg.norm(ours.center - theirs.center))
        if gap > furthest_gap(parent, child):
            return RebuiltJoint(
                name=joint.name,
                method=method,
                in_parent=ours.center,
                in_child=theirs.center,
                moved=moved,
                gap=gap,
            )
        shared = _shared(centers)
        return RebuiltJoint(
            name=joint.name, method=method, in_parent=shared, in_child=shared, moved=moved, gap=gap
        )


def furthest_gap(parent: Transfer, child: Transfer) -> float:
    """Return the allowed distance of the joint centers that two bones in one frame give [m]."""
    return APART * max(transfer.length * transfer.size for transfer in (parent, child))


def _shared(fitteds: list[_Fitted]) -> Array:
    """One center for both bones: fitted rather than mapped, of a head rather than a socket."""
    ranks = [2 * (fitted.method != "mapped") + fitted.inside for fitted in fitteds]
    best = [
        fitted.center for fitted, rank in zip(fitteds, ranks, strict=True) if rank == max(ranks)
    ]
    return np.mean(best, axis=0)


def _depth(transfer: Transfer, place: Array) -> float:
    """Return the height of a point (3,) of the source over its bone's surface [m].

    Negative inside, NaN without surfaces.
    """
    return (
        float("nan")
        if transfer.shapes is None
        else float(transfer.shapes[0].signed(place[None])[0])
    )


def _mapped(transfer: Transfer, place: Array) -> _Fitted:
    return _Fitted(transfer.points(place), inside=_depth(transfer, place) < 0.0)


def _fitted(transfer: Transfer, place: Array, axis: Array, shape: Round) -> _Fitted:
    """Find a center (3,) of the source in the target's bone.

    The round surface about it gives the center if there is one.
    """
    mapped = _mapped(transfer, place)
    if transfer.shapes is None:
        return mapped
    depth = _depth(transfer, place)
    try:
        fitted = _center(transfer, place, axis, shape, abs(depth), depth > 0.0)
    except BadData:  # there is nothing round
        fitted = None
    if fitted is None:
        return mapped
    return _Fitted(fitted, shape, float(np.linalg.norm(fitted - mapped.center)), mapped.inside)


def _center(
    transfer: Transfer, place: Array, axis: Array, shape: Round, radius: float, hollow: bool
) -> Array | None:
    source = transfer.bone.source
    target = transfer.bone.target
    assert source is not None
    assert target is not None
    matrix = transfer.near(place)
    if shape == "sphere":
        ball = articular_sphere(source, place, radius, hollow)
        beside = place - ball.center
        if warning_of(ball) or np.linalg.norm(beside) > AGREES * ball.radius:
            return None
        other = articular_sphere(
            target, transfer.points(ball.center), ball.radius * transfer.size, hollow
        )
        if warning_of(other) or _strays(
            transfer, other.center, transfer.points(ball.center), other.radius
        ):
            return None
        return np.asarray(other.center + matrix @ beside)
    roller = articular_cylinder(source, ExpectedCylinder(place, axis, radius), hollow)
    beside = (place - roller.point) - (place - roller.point) @ roller.axis * roller.axis
    if (
        warning_of(roller)
        or abs(roller.axis @ axis) < TILTED
        or np.linalg.norm(beside) > AGREES * roller.radius
    ):
        return None
    along = matrix @ roller.axis
    size = transfer.size
    expected = ExpectedCylinder(
        near=transfer.points(place),
        axis=along,
        radius=roller.radius * size,
        width=2.0 * roller.length * size,
    )
    there = articular_cylinder(target, expected, hollow)
    goal = transfer.points(place)
    center: Array = there.point + (goal - there.point) @ there.axis * there.axis + matrix @ beside
    return None if warning_of(there) or _strays(transfer, center, goal, there.radius) else center


def _strays(transfer: Transfer, fitted: Array, mapped: Array, radius: float) -> bool:
    return transfer.bone.basis == "bone" and bool(np.linalg.norm(fitted - mapped) > STRAYS * radius)


@dataclass(frozen=True, eq=False)
class TransferredJoints:
    """A skeleton in other bones."""

    skeleton: Model  # the model with its joints transferred and nothing else
    # how much further a sliding coordinate goes, for the coordinates that slide
    travel: Mapping[str, float]
    rebuilt: tuple[RebuiltJoint, ...]
    notes: tuple[str, ...] = ()


def transferred_joints(
    model: Model, transfers: Transfers, centers: CenterFinder
) -> TransferredJoints:
    """All joints of a model, with the coordinates that slide in meters.

    A joint's center is where the child's joint frame is in the default pose. Parent and child carry
    it each by its own map. Their frames turn as the whole bones do, so that at equal coordinates
    shafts lie to each other as they did; the axis of a hinge turns as the bone around it does, as
    condyles and malleoli may be twisted against their shaft.
    """
    values = compile_tree(model).coordinates_of(DEFAULT_POSE)[0].tolist()
    defaults = dict(zip(model.coordinate_names, values, strict=True))
    anchored = [_anchored(joint) for joint in model.joints]
    scale_factors = [_scale_factors(joint, transfers, defaults) for joint in anchored]
    travel = {
        axis.coordinates[0]: scale_factor
        for joint, along in zip(anchored, scale_factors, strict=True)
        for axis, scale_factor in zip(joint.axes, along, strict=True)
        if axis.kind == "translation" and axis.coordinates and slides_freely(axis.function)
    }
    pairs = [
        _carried(joint, along, travel, defaults, transfers, centers)
        for joint, along in zip(anchored, scale_factors, strict=True)
    ]
    skeleton = replace(
        model,
        joints=tuple(joint for joint, _ in pairs),
        coordinates=scaled_coordinates(model.coordinates, travel),
        couplers=scaled_couplers(model.couplers, travel),
        passive_torques=tuple(
            _torque(torque, travel.get(torque.coordinate, 1.0)) for torque in model.passive_torques
        ),
    )
    rebuilt = tuple(joint for _, joint in pairs)
    notes = tuple(
        note
        for joint, rebuilt_joint in pairs
        for note in _warnings(joint, rebuilt_joint, transfers)
    )
    return TransferredJoints(
        skeleton=skeleton, travel=FrozenMap(travel), rebuilt=rebuilt, notes=notes
    )


def _anchored(joint: Joint) -> Joint:
    """Return the same joint with its frames at the first point that it turns about.

    That point is MuJoCo's anchor.
    """
    anchor = next((axis.origin for axis in joint.axes if axis.kind == "rotation"), np.zeros(3))
    if not anchor.any():
        return joint
    to_anchor = Transform(np.eye(3), anchor)
    return replace(
        joint,
        parent_frame=joint.parent_frame @ to_anchor,
        child_frame=joint.child_frame @ to_anchor,
        axes=tuple(replace(axis, origin=axis.origin - anchor) for axis in joint.axes),
    )


def _pose(axes: tuple[Axis, ...], values: Mapping[str, float]) -> Transform:
    """Of the child's joint frame in the parent's."""
    pose = Transform.identity()
    for axis in axes:
        pose = pose @ axis.moved(value_at(axis.function, axis.coordinates, values))
    return pose


def _scale_factors(joint: Joint, transfers: Transfers, values: Mapping[str, float]) -> list[float]:
    """Return how much longer the parent becomes along each sliding axis, at the joint.

    It is 1 for axes of rotation.
    """
    amounts = [value_at(axis.function, axis.coordinates, values) for axis in joint.axes]
    result = [1.0] * len(joint.axes)
    sliding = [
        axis.kind == "translation" and (axis.function.arity > 0 or amount != 0.0)
        for axis, amount in zip(joint.axes, amounts, strict=True)
    ]
    if not any(sliding):
        return result
    center = (joint.parent_frame @ _pose(joint.axes, values)).translation
    matrix = transfers[joint.parent].near(center)
    rotation = nearest_rotation(matrix)
    pose = joint.parent_frame
    for i, (axis, amount) in enumerate(zip(joint.axes, amounts, strict=True)):
        if sliding[i]:
            along = pose.rotation @ axis.vector / np.linalg.norm(axis.vector)
            result[i] = float((rotation @ along) @ (matrix @ along))
        pose = pose @ axis.moved(amount)
    return result


def _carried(
    joint: Joint,
    scale_factors: list[float],
    travel: Mapping[str, float],
    defaults: Mapping[str, float],
    transfers: Transfers,
    centers: CenterFinder,
) -> tuple[Joint, RebuiltJoint]:
    parent = transfers[joint.parent]
    child = transfers[joint.child]
    was = _pose(joint.axes, defaults).translation
    in_parent = joint.parent_frame.apply(was)
    in_child = joint.child_frame.translation
    center = centers.center(joint, in_parent, in_child)
    hinge = _hinge(joint)
    child_frame = Transform(_turned(child, in_child, joint.child_frame, hinge), center.in_child)
    axes = tuple(
        replace(
            axis,
            function=_travelled(axis, scale_factor, travel),
            origin=(
                child_frame.inverse().apply(child.points(joint.child_frame.apply(axis.origin)))
                if axis.origin.any()
                else axis.origin
            ),
        )
        for axis, scale_factor in zip(joint.axes, scale_factors, strict=True)
    )
    after = {name: value * travel.get(name, 1.0) for name, value in defaults.items()}
    turn = _turned(parent, in_parent, joint.parent_frame, hinge)
    origin = center.in_parent - turn @ _pose(axes, after).translation
    moved = replace(joint, parent_frame=Transform(turn, origin), child_frame=child_frame, axes=axes)
    return moved, center


def _hinge(joint: Joint) -> Array | None:
    """Return the axis (3,) of a joint that turns by one coordinate alone, in its frames."""
    turns = [axis for axis in joint.axes if axis.kind == "rotation" and axis.function.arity]
    if len({name for axis in turns for name in axis.coordinates}) != 1:
        return None
    return turns[0].vector / np.linalg.norm(turns[0].vector)


def _turned(transfer: Transfer, place: Array, frame: Transform, hinge: Array | None) -> Array:
    """Return the rotation (3, 3) of a joint's frame in the target.

    It is that of the whole bone, swung so that a hinge follows its end.
    """
    whole = transfer.rotation @ frame.rotation
    if hinge is None:
        return whole
    along = whole @ hinge
    goal = transfer.turn(place) @ frame.rotation @ hinge
    return least_rotation(along, goal) @ whole


def _travelled(axis: Axis, scale_factor: float, travel: Mapping[str, float]) -> Function:
    """Amounts grow by the scale_factor; coordinates in meters are read in their own new size."""
    source = travel.get(axis.coordinates[0], 1.0) if axis.coordinates else 1.0
    return stretched(axis.function, scale_factor if axis.kind == "translation" else 1.0, source)


def _torque(torque: PassiveTorque, factor: float) -> PassiveTorque:
    """Keep forces along a sliding coordinate at the same share of the way."""
    return replace(
        torque,
        torque=stretched(torque.torque, 1.0, factor),
        damping=stretched(torque.damping, 1.0, factor),
    )


def _warnings(joint: Joint, rebuilt: RebuiltJoint, transfers: Transfers) -> list[str]:
    if not rebuilt.gap > furthest_gap(transfers[joint.parent], transfers[joint.child]):
        return []
    return [
        f"joint '{joint.name}': in the frame that they share the bones of '{joint.parent}' and"
        f" '{joint.child}' put its center {1e3 * rebuilt.gap:.1f} mm apart: each keeps its own"
    ]
