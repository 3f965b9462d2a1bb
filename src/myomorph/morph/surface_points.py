"""A surface that can be asked for its nearest points: evenly spread samples, outward normals, its open rim."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from myomorph.model.errors import BadData
from myomorph.model.spatial import Array
from myomorph.model.surface import Surface

SPREAD = 4000
"""Samples among which a rough nearest point is looked for."""


@dataclass(frozen=True, eq=False)
class Samples:
    """Points (n, 3) spread evenly over a surface, with outward normals (n, 3) and whether each is on its open rim."""

    points: Array
    normals: Array
    rim: np.ndarray

    def every(self, step: int) -> Samples:
        """Every so many of them."""
        return Samples(self.points[::step], self.normals[::step], self.rim[::step])


class Shape:
    """A surface with what nearest points need.

    Raises
    ------
    BadData : a surface without area
    """

    def __init__(self, surface: Surface):
        self.vertices = np.array(surface.vertices)
        self.faces = np.array(surface.faces)
        self.normals, self.areas = _face_normals(surface)
        self.area = float(self.areas.sum())
        if not self.area > 0:
            raise BadData("a surface has no area")

    @cached_property
    def rim(self) -> np.ndarray:
        """(faces,) whether a face touches an open edge; equal corners count as one."""
        _, same = np.unique(np.round(self.vertices, 7), axis=0, return_inverse=True)
        faces = same.reshape(-1)[self.faces]
        edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
        edges = edges[edges[:, 0] != edges[:, 1]]
        unique, counts = np.unique(edges, axis=0, return_counts=True)
        open_corners = np.zeros(int(same.max()) + 1, dtype=bool)
        open_corners[unique[counts == 1].reshape(-1)] = True
        return np.asarray(open_corners[faces].any(axis=1))

    @property
    def is_open(self) -> bool:
        """Whether more than a hundredth of the surface lies at open edges, as where a scan is cut off."""
        return float(self.areas[self.rim].sum()) > 0.01 * self.area

    def samples(self, count: int) -> Samples:
        """Points spread evenly over the surface; the same each time."""
        random = np.random.default_rng(0)
        # One point in every equal share of the area, in the order of the faces, spreads better than chance.
        places = (np.arange(count) + random.random(count)) / count * self.area
        face = np.minimum(np.searchsorted(np.cumsum(self.areas), places), len(self.areas) - 1)
        a, b = np.sqrt(random.random(count)), random.random(count)
        shares = np.stack([1.0 - a, a * (1.0 - b), a * b], axis=1)
        points = np.einsum("ij,ijk->ik", shares, self.vertices[self.faces[face]])
        order = random.permutation(count)
        return Samples(points[order], self.normals[face][order], self.rim[face][order])

    @cached_property
    def _spread(self) -> tuple[Samples, cKDTree]:
        samples = self.samples(SPREAD)
        return samples, cKDTree(samples.points)

    @cached_property
    def _boxes(self) -> object:
        import igl

        boxes = igl.AABB()
        boxes.init(self.vertices, self.faces)
        return boxes

    def nearest(self, points: Array, fine: bool) -> Samples:
        """Nearest points of the surface, their normals, and whether they lie on its rim; `fine` to the triangles."""
        if not fine:
            samples, tree = self._spread
            index = tree.query(points)[1]
            return Samples(samples.points[index], samples.normals[index], samples.rim[index])
        found = self._boxes.squared_distance(self.vertices, self.faces, np.ascontiguousarray(points))  # type: ignore[attr-defined]
        return Samples(found[2], self.normals[found[1]], self.rim[found[1]])

    def signed(self, points: Array) -> Array:
        """Distances (n,), positive outside [m]."""
        closest = self.nearest(points, fine=True)
        away = points - closest.points
        side = np.sign(np.einsum("ij,ij->i", away, closest.normals))
        distances: Array = np.where(side < 0, -1.0, 1.0) * np.linalg.norm(away, axis=1)
        return distances


def _face_normals(surface: Surface) -> tuple[Array, Array]:
    """Outward unit normals (faces, 3) and areas (faces,)."""
    corners = surface.vertices[surface.faces]
    crossed = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sizes = np.linalg.norm(crossed, axis=1)
    middle = surface.vertices.mean(axis=0)
    volume = np.einsum("ij,ij->", corners[:, 0] - middle, np.cross(corners[:, 1] - middle, corners[:, 2] - middle))
    outward = -1.0 if volume < 0 else 1.0
    return outward * crossed / np.where(sizes > 0, sizes, 1.0)[:, None], 0.5 * sizes
