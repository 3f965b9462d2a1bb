"""Points that belong on a bone's surface, put back on the target's."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from myomorph.model.arrays import Array
from myomorph.morph.carrier import Carrier
from myomorph.morph.surface_points import Shape

DEEPER = 3.0
"""A height above the surface that the map makes so many times what the bone's size makes of it is not kept."""

FARTHEST = 0.05
"""A point that would be moved further than this share of the bone's length is left where the map puts it, or
brought out of the bone the nearest way: the target's surface ends there, as where a pelvis comes without its sacrum."""

FACES = 32
"""Triangles, the nearest by their middles, among which the nearest of one side is looked for."""


@dataclass(frozen=True, eq=False)
class SurfacePoints:
    """Points and how they lie to the bones.

    Attributes
    ----------
    points : (n, 3) in the target body [m]
    lifted : (n,) how far each was moved [m]
    depth_source, depth_target : (n,) signed distances from the surfaces, positive outside [m]; NaN without surfaces
    beyond : (n,) which belong on a part of the surface that the target does not have
    """

    points: Array
    lifted: Array
    depth_source: Array
    depth_target: Array
    beyond: np.ndarray


def put_on_surface(carrier: Carrier, points: Array, within: float) -> SurfacePoints:
    """Points of a body carried over, those near its bone at their height above the target's.

    The point of the surface nearest to such a point goes where the map sends it, and from there to the nearest point of
    the target's surface that faces the same way: what the map missed the surface by is added to the point itself. So
    nothing moves where the map brings surface onto surface, and a point stays on its side of a thin bone.

    Parameters
    ----------
    points : (n, 3) in the source body [m]
    within : distance from the surface up to which a point belongs to it, as a share of the bone's length
    """
    mapped = carrier.points(points)
    shapes, none = carrier.shapes, np.zeros(len(points))
    if shapes is None or not len(points):
        return SurfacePoints(mapped, none, none + np.nan, none + np.nan, none > 0.0)
    source, target = shapes
    feet, faces = source.closest(points)
    depth = source.signed(points)
    # A point that was outside the bone and would be inside belongs back outside, however far it was.
    near = (np.abs(depth) <= within * carrier.length) | ((depth > 0) & (target.signed(mapped) < 0))
    near &= within > 0.0
    moved = mapped.copy()
    if near.any():
        # Normals of the source as those of the mapped surface, by the bone as a whole.
        facing = source.normals[faces[near]] @ np.linalg.inv(carrier.linear)
        moved[near] = _lifted(carrier, target, mapped[near], feet[near], facing, depth[near])
    far = np.linalg.norm(moved - mapped, axis=1) > FARTHEST * carrier.length * carrier.size
    moved[far] = mapped[far]
    crossed = far & (depth > 0) & (target.signed(moved) < 0)
    places, faces = target.closest(moved[crossed])
    moved[crossed] = places + carrier.size * depth[crossed, None] * target.normals[faces]
    return SurfacePoints(moved, np.linalg.norm(moved - mapped, axis=1), depth, target.signed(moved), far)


def _lifted(carrier: Carrier, target: Shape, mapped: Array, feet: Array, facing: Array, depth: Array) -> Array:
    ground = carrier.points(feet)
    place, normals = nearest_facing(target, ground, facing)
    above = mapped - ground
    # The map may fold or stretch what is between foot and point; then the height is the bone's size times the old one.
    kept = carrier.size * depth
    height = np.einsum("ij,ij->i", above, normals)
    slack = 1e-9 * carrier.length
    wrong = (np.sign(height) * np.sign(depth) < 0) & (np.abs(height) > slack)
    wrong |= np.linalg.norm(above, axis=1) > DEEPER * np.abs(kept) + slack
    above[wrong] = kept[wrong, None] * normals[wrong]
    lifted: Array = place + above
    return lifted


def nearest_facing(shape: Shape, points: Array, facing: Array) -> tuple[Array, Array]:
    """Nearest points (n, 3) of a surface on the side that faces a direction (n, 3), and their normals (n, 3).

    Where no triangle near by faces that way, the nearest of all is taken.
    """
    places, faces = shape.closest(points)
    normals = shape.normals[faces]
    middles = shape.vertices[shape.faces].mean(axis=1)
    for i in np.flatnonzero(np.einsum("ij,ij->i", normals, facing) <= 0.0):
        turned = np.flatnonzero(shape.normals @ facing[i] > 0.0)
        if not len(turned):
            continue
        near = turned[np.argsort(np.linalg.norm(middles[turned] - points[i], axis=1))[:FACES]]
        corners = shape.vertices[shape.faces[near]]
        options = _nearest_on_triangles(points[i], corners)
        best = int(np.argmin(np.linalg.norm(options - points[i], axis=1)))
        places[i], normals[i] = options[best], shape.normals[near[best]]
    return places, normals


def _nearest_on_triangles(point: Array, corners: Array) -> Array:
    """(m, 3) the nearest point of each triangle (m, 3, 3)."""
    from trimesh.triangles import closest_point

    nearest: Array = np.asarray(closest_point(corners, np.broadcast_to(point, (len(corners), 3))), dtype=np.float64)
    return nearest
