"""Wrap objects in other bones: refitted to where the map brings their own surface."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.paths import WrapObject
from myomorph.model.spatial import Transform
from myomorph.morph.carrier import Carrier, nearest_rotation

LONGEST = 0.25
"""A cylinder counts up to this share of the bone's length to either side of its middle: files have some of a metre."""

_AROUND = 2.0 * np.pi * np.arange(8) / 8.0
_RING = np.column_stack([np.cos(_AROUND), np.sin(_AROUND), np.zeros(8)])
_LATITUDES = np.arcsin(np.linspace(-0.8, 0.8, 5))
_BALL = np.concatenate([np.cos(a) * _RING + [0.0, 0.0, np.sin(a)] for a in _LATITUDES])


def carried_wrap(wrap: WrapObject, carrier: Carrier) -> WrapObject:
    """A wrap object that lies in the target's bone as it did in the source's.

    Points of its surface go where the map sends them. The affine map nearest to that gives the middle and how the
    object turns (a cylinder's axis stays along the same line of the bone); radii are the mean distances of the points
    from the middle or the axis, so a similarity is met exactly. Sides that constrain the path turn with the object.
    """
    points = surface_points(wrap, LONGEST * carrier.length)
    moved = carrier.points(wrap.pose.apply(points))
    middle = moved.mean(axis=0)
    matrix = np.linalg.lstsq(points, moved - middle, rcond=None)[0].T
    if np.linalg.det(matrix) <= 0.0:
        matrix = carrier.linear @ wrap.pose.rotation
    rotation = nearest_rotation(matrix)
    if wrap.kind == "cylinder":
        rotation = _axis_along(rotation, matrix[:, 2])
    local = (moved - middle) @ rotation
    return replace(wrap, body=carrier.body, pose=Transform(rotation, middle), size=_size(wrap, points, local, matrix))


def surface_points(wrap: WrapObject, longest: float) -> Array:
    """Points (n, 3) spread evenly over a wrap object's surface, in its frame, the middle their mean [m].

    Parameters
    ----------
    longest : how far a cylinder counts to either side of its middle [m]
    """
    if wrap.kind == "cylinder":
        radius, length = wrap.size
        half = min(0.5 * length, max(longest, radius))
        return np.concatenate([radius * _RING + [0.0, 0.0, z * half] for z in np.linspace(-1.0, 1.0, 5)])
    if wrap.kind == "torus":
        inner, outer = wrap.size
        tube, middle = 0.5 * (outer - inner), 0.5 * (outer + inner)
        angles = 2.0 * np.pi * np.arange(6) / 6.0
        return np.concatenate([(middle + tube * np.cos(a)) * _RING + [0, 0, tube * np.sin(a)] for a in angles])
    points: Array = _BALL * (wrap.size if wrap.kind == "ellipsoid" else wrap.size[0])
    return points


def _axis_along(rotation: Array, axis: Array) -> Array:
    """The rotation turned as little as needed to have its z axis along a direction."""
    z = axis / np.linalg.norm(axis)
    x = rotation[:, 0] - (rotation[:, 0] @ z) * z
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def _size(wrap: WrapObject, points: Array, moved: Array, matrix: Array) -> tuple[float, ...]:
    """Sizes from points of the surface before and after, both in the wrap object's frame."""
    if wrap.kind == "ellipsoid":
        return tuple(float(a) for a in np.asarray(wrap.size) * np.linalg.norm(matrix, axis=0))
    if wrap.kind == "sphere":
        return (wrap.size[0] * _growth(points, moved),)
    across = _growth(points[:, :2], moved[:, :2])
    if wrap.kind == "torus":
        return wrap.size[0] * across, wrap.size[1] * across
    return wrap.size[0] * across, wrap.size[1] * float(np.linalg.norm(matrix[:, 2]))


def _growth(points: Array, moved: Array) -> float:
    return float(np.linalg.norm(moved, axis=1).mean() / np.linalg.norm(points, axis=1).mean())
