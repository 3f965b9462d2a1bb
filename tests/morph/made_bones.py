"""Real bones that come with a package, and the same bones smoothly deformed.

The deformed position of every point is known.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from myomorph.core.io.mesh import read_mesh
from myomorph.core.model.spatial import axis_rotation
from myomorph.core.model.surface import Surface
from myomorph.core.surfaces.surface_points import Shape


def real_bone(name: str, edge: float = 0.006) -> Surface:
    """Return a bone of `myo-sim` with triangles no longer than an edge [m]."""
    package = pytest.importorskip("myo_sim")
    bone = read_mesh(Path(package.MODELS_DIR) / "meshes" / f"{name}.stl")
    mesh = trimesh.Trimesh(bone.vertices, bone.faces, process=True)
    vertices, faces = trimesh.remesh.subdivide_to_size(mesh.vertices, mesh.faces, edge)
    return Surface(vertices=vertices, faces=faces)


def deformed(points: np.ndarray, bone: Surface, size: float = 1.0) -> np.ndarray:
    """Deform points of a bone.

    It grows thicker at one end, and is bent, twisted and swollen on one side.

    Parameters
    ----------
    points : (n, 3) [m]
    bone : that the points belong to
    size : factor of the deformations

    Returns
    -------
    (n, 3) the points after the deformation, in other axes [m]
    """
    middle = bone.vertices.mean(axis=0)
    axes = np.linalg.svd(bone.vertices - middle, full_matrices=False)[2]
    axes *= np.array([1.0, 1.0, np.linalg.det(axes)])[:, None]
    x = (points - middle) @ axes.T
    length = np.ptp((bone.vertices - middle) @ axes[0])
    along = x[:, :1] / length
    thick = 1.0 + size * 0.15 * along
    x = np.column_stack([x[:, :1], thick * x[:, 1:]])
    turn = size * np.radians(20.0) * along[:, 0]
    c = np.cos(turn)
    s = np.sin(turn)
    x = np.column_stack([x[:, 0], c * x[:, 1] - s * x[:, 2], s * x[:, 1] + c * x[:, 2]])
    x[:, 1] += size * 0.06 * length * along[:, 0] ** 2
    x[:, 2] += size * 0.02 * length * np.exp(-(((along[:, 0] - 0.35) / 0.15) ** 2))
    moved: np.ndarray = middle + 1.05 * x @ axes
    return moved @ axis_rotation(np.array([0.6, 0.0, 0.8]), 0.5).T + [0.2, -0.1, 0.05]


def made_target(bone: Surface, size: float = 1.0) -> Surface:
    """Return the deformed bone, its triangles others than the source's."""
    mesh = trimesh.Trimesh(bone.vertices, bone.faces, process=False).subdivide()
    return Surface(deformed(np.array(mesh.vertices), bone, size), mesh.faces)


def errors(points: np.ndarray, truth: np.ndarray, target: Surface) -> tuple[float, float]:
    """Return the distance of points from a surface, and the distance along it.

    Parameters
    ----------
    points : (n, 3) found [m]
    truth : (n, 3) where they belong [m]
    target : the surface

    Returns
    -------
    root mean squares of the distance from the surface, and along it from where a point belongs [m]
    """
    shape = Shape(target)
    nearest = shape.nearest(points, fine=True)
    off = np.linalg.norm(points - nearest.points, axis=1)
    apart = points - truth
    across = np.einsum("ij,ij->i", apart, shape.nearest(truth, fine=True).normals)
    slid = np.sqrt(np.maximum(np.sum(apart**2, axis=1) - across**2, 0.0))
    return float(np.sqrt(np.mean(off**2))), float(np.sqrt(np.mean(slid**2)))
