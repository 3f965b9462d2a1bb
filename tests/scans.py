"""A made CT of a bone, and balls as markers.

It is rotated, shifted, resized, refined or coarsened, cut off, with noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import igl
import numpy as np
import trimesh

from myomorph.core.model.spatial import rotation_from_euler_xyz
from myomorph.core.model.surface import Surface
from myomorph.core.surfaces.linear_maps import Similarity


@dataclass(frozen=True, kw_only=True)
class ScanQuality:
    """How well a scan shows a bone.

    Attributes
    ----------
    noise : standard deviation of each vertex along an axis [m]
    cut : share of the bone's length that is cut off
    refine : times that every triangle is split into four
    """

    noise: float = 3e-4
    cut: float = 0.0
    refine: int = 2


USUAL = ScanQuality()


def made_scan(
    bone: Surface, seed: int = 1, scale: float = 1.02, quality: ScanQuality = USUAL
) -> tuple[Surface, Similarity]:
    """Make a scan of a bone, and the similarity from scan to bone.

    The scan is `scale` times smaller than the model's bone.
    """
    random = np.random.default_rng(seed)
    mesh = trimesh.Trimesh(bone.vertices, bone.faces, process=True)
    for _ in range(quality.refine):
        mesh = mesh.subdivide()
    vertices = np.array(mesh.vertices)
    faces = np.array(mesh.faces)
    if quality.cut:
        long = np.linalg.svd(vertices - vertices.mean(axis=0), full_matrices=False)[2][0]
        along = vertices @ long
        kept = along < np.quantile(along, 1 - quality.cut)
        used, index = np.unique(faces[kept[faces].all(axis=1)], return_inverse=True)
        vertices = vertices[used]
        faces = index.reshape(-1, 3)
    vertices = vertices + quality.noise * random.normal(size=vertices.shape)
    back = Similarity(
        rotation_from_euler_xyz(random.uniform(-3, 3, 3)), random.uniform(-0.3, 0.3, 3), 1 / scale
    )
    return Surface(back.apply(vertices), faces), back.inverse()


def sharper(bone: Surface) -> Surface:
    """Make a bone without a plane of symmetry: cones on an ellipsoid, for tests without data."""
    mesh = trimesh.creation.icosphere(subdivisions=3)
    points = np.array(mesh.vertices)
    size = np.ones(len(points))
    for direction, height in (
        ((1, 0.2, 0.3), 0.5),
        ((-0.8, 0.5, 0.1), 0.35),
        ((0.1, -0.9, 0.4), 0.4),
    ):
        away = points @ (np.array(direction) / np.linalg.norm(direction))
        size += height * np.exp(20 * (away - 1))
    return Surface(points * size[:, None] * [0.15, 0.03, 0.02], mesh.faces)


def ball(
    center: np.ndarray, diameter: float, random: np.random.Generator, noise: float, keep=None
) -> Surface:
    """Make a noisy sphere.

    Parameters
    ----------
    center : (3,) [m]
    diameter : [m]
    random : generator of the noise
    noise : standard deviation of each vertex along an axis [m]
    keep : function of points (n, 3) that chooses which of them are visible, None for all

    Returns
    -------
    Surface of the triangles whose corners are all visible
    """
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=0.5 * diameter)
    points = np.array(mesh.vertices)
    faces = np.array(mesh.faces)
    if keep is not None:
        faces = faces[keep(points)[faces].all(axis=1)]
    return Surface(points + noise * random.normal(size=points.shape) + center, faces)


def joined(parts: list[Surface]) -> Surface:
    """Several surfaces as one."""
    first = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    faces = [part.faces + start for part, start in zip(parts, first, strict=True)]
    return Surface(np.concatenate([part.vertices for part in parts]), np.concatenate(faces))


def cluster(
    centers: np.ndarray, diameter: float = 0.009, seed: int = 0, noise: float = 5e-5
) -> Surface:
    """Make balls at centers, apart from each other, with a plate and a pin that hold them.

    Parameters
    ----------
    centers : (balls, 3) [m]
    diameter : [m]
    seed : of the noise
    noise : standard deviation of each vertex along an axis [m]

    Returns
    -------
    Surface of several parts
    """
    random = np.random.default_rng(seed)
    plate = trimesh.creation.box(extents=(0.06, 0.05, 0.003))
    pin = trimesh.creation.cylinder(radius=0.001, height=0.08)
    below = centers.mean(axis=0) + [0, 0, -0.02]
    held = [
        Surface(
            np.array(mesh.subdivide().subdivide().vertices) + below,
            mesh.subdivide().subdivide().faces,
        )
        for mesh in (plate, pin)
    ]
    return joined([ball(center, diameter, random, noise) for center in centers] + held)


def grown_together(centers: np.ndarray, diameter: float = 0.009) -> Surface:
    """Make balls on a plate as one connected surface, as a threshold leaves them.

    Parameters
    ----------
    centers : (balls, 3) [m]
    diameter : [m]

    Returns
    -------
    Surface of one part
    """
    solid = trimesh.creation.box(extents=(0.07, 0.06, 0.004))
    solid.apply_translation(centers.mean(axis=0) + [0, 0, -0.005])
    grid = 0.0005
    low = centers.min(axis=0) - 0.02
    shape = np.ceil((centers.max(axis=0) + 0.02 - low) / grid).astype(int)
    axes = [low[k] + grid * np.arange(shape[k]) for k in range(3)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    away = np.min(
        [np.linalg.norm(points - center, axis=-1) - 0.5 * diameter for center in centers], axis=0
    )
    box = np.abs(points - solid.centroid) - np.array([0.035, 0.03, 0.002])
    field = np.minimum(away, box.max(axis=-1))
    flat = points.transpose(2, 1, 0, 3).reshape(-1, 3)
    values = field.transpose(2, 1, 0).reshape(-1)
    vertices, faces = igl.marching_cubes(values, flat, *(int(one) for one in shape), 0.0)[:2]
    return Surface(vertices, faces)
