"""Legs drawn more or less bowed, seen from the front, than those of the model that was given."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from myomorph.model.arrays import Array, read_only
from myomorph.model.frozen_map import FrozenMap
from myomorph.model.latest import Latest
from myomorph.model.model import Joint, Marker, Model
from myomorph.model.spatial import Transform, axis_rotation
from myomorph.rigid.knees import flexed, hinge_axis, knee_joints, long_axis
from myomorph.rigid.tree import compile_tree


@read_only
@dataclass(frozen=True, eq=False)
class Leg:
    """Where a leg is turned when it is bowed.

    Attributes
    ----------
    thigh, shank : bodies
    on_thigh, on_shank : (3,) unit vectors fore-aft, about which they are turned
    hip, ankle : (3,) centers on the thigh and on the shank [m]
    """

    thigh: str
    shank: str
    on_thigh: Array
    on_shank: Array
    hip: Array
    ankle: Array


def _legs(model: Model) -> Mapping[str, Leg]:
    """Legs by the names of their knees; those without a hip or an ankle, or whose knee does not turn, are left out."""
    return FrozenMap({knee.name: leg for knee in knee_joints(model) if (leg := _leg(model, knee)) is not None})


def _leg(model: Model, knee: Joint) -> Leg | None:
    down, poses = long_axis(model, knee), flexed(model, knee)
    hip = next((joint for joint in model.joints if joint.child == knee.parent), None)
    if down is None or poses is None or hip is None:
        return None
    index = compile_tree(model).body_index
    thigh, shank = (poses.rotations[0, index[body]] for body in (knee.parent, knee.child))
    axis = np.cross(down, hinge_axis(model, knee, poses, down))
    below = [joint.parent_frame.translation for joint in model.joints if joint.parent == knee.child]
    ankle = max(below, key=lambda point: float((point - knee.child_frame.translation) @ down))
    return Leg(knee.parent, knee.child, thigh.T @ shank @ axis, axis, hip.child_frame.translation, ankle)


legs_of = Latest(_legs)


def bowed_knee(knee: Joint, leg: Leg, angle: float) -> Joint:
    """A knee whose axes are turned on the shank, about its center [rad]: so that the shank turns the other way."""
    frame = knee.child_frame
    turned = axis_rotation(leg.on_shank, angle) @ frame.rotation
    return replace(knee, child_frame=Transform(turned, frame.translation))


def beside_bowed_bones(marker: Marker, leg: Leg, angle: float) -> Marker:
    """A marker where it was seen: hip and ankle stay and the knee moves out, half of the angle in each bone."""
    if marker.body == leg.thigh:
        return _turned(marker, leg.hip, leg.on_thigh, -0.5 * angle)
    return _turned(marker, leg.ankle, leg.on_shank, 0.5 * angle) if marker.body == leg.shank else marker


def _turned(marker: Marker, center: Array, axis: Array, angle: float) -> Marker:
    return replace(marker, location=center + axis_rotation(axis, angle) @ (marker.location - center))
