"""The vertices of a surface with what fits of round parts need: normals, areas, and what hangs together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from myomorph.model.arrays import Array
from myomorph.model.surface import Surface

FACING = 0.82
"""Cosine of the angle to the radius (35 degrees) up to which a vertex may belong to a round region."""


@dataclass(frozen=True, eq=False)
class Corners:
    """Vertices of a surface, equal ones as one.

    Attributes
    ----------
    points : (n, 3) [m]
    normals : (n, 3) outward, of the faces around, by their areas
    areas : (n,) a third of the faces around [m^2]
    edges : (m, 2) pairs of vertices that a face has
    """

    points: Array
    normals: Array
    areas: Array
    edges: np.ndarray

    @staticmethod
    def of(surface: Surface) -> Corners:
        """All that faces with an area have."""
        _, first, same = np.unique(np.round(surface.vertices, 9), axis=0, return_index=True, return_inverse=True)
        points, faces = surface.vertices[first], same.reshape(-1)[surface.faces]
        a, b, c = (points[faces[:, k]] for k in range(3))
        crossed = np.cross(b - a, c - a)
        normals, areas = np.zeros_like(points), np.zeros(len(points))
        for k in range(3):
            np.add.at(normals, faces[:, k], crossed)
            np.add.at(areas, faces[:, k], np.linalg.norm(crossed, axis=1) / 6.0)
        normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-30)[:, None]
        edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
        return Corners(points, normals, areas, edges)._where(areas > 0)

    def _where(self, kept: np.ndarray) -> Corners:
        number = np.cumsum(kept) - 1
        edges = number[self.edges[kept[self.edges].all(axis=1)]]
        return Corners(self.points[kept], self.normals[kept], self.areas[kept], edges)

    def within(self, middle: Array, reach: float) -> Corners:
        """Those near a point."""
        away = self.points - middle
        return self._where(np.einsum("ij,ij->i", away, away) < reach**2)

    def some(self, count: int) -> Corners:
        """So many of them or fewer, in a random order in which large areas come first, without edges."""
        order = np.argsort(np.random.default_rng(0).random(len(self.points)) / self.areas)[:count]
        areas = self.areas[order]
        return Corners(
            self.points[order],
            self.normals[order],
            areas * (self.areas.sum() / areas.sum()),
            np.zeros((0, 2), np.int64),
        )

    def around(self, away: Array, radius: float, shell: float, hollow: bool) -> np.ndarray:
        """Which face along the radius within a share of it, where `away` (n, 3) is from the center or the axis."""
        reach = np.sqrt(np.einsum("ij,ij->i", away, away))
        facing = np.einsum("ij,ij->i", self.normals, away) * (-1.0 if hollow else 1.0)
        chosen: np.ndarray = (np.abs(reach - radius) <= shell * radius) & (facing >= FACING * reach)
        return chosen

    def patch(
        self, away: Array, radius: float, shell: float, hollow: bool, inside: np.ndarray | None = None, pieces: int = 1
    ) -> np.ndarray:
        """Those around that are inside, in the piece (or pieces) with the largest area that hangs together."""
        chosen = self.around(away, radius, shell, hollow)
        if inside is not None:
            chosen &= inside
        edges = self.edges[chosen[self.edges].all(axis=1)]
        count = len(self.points)
        graph = coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(count, count))
        label = connected_components(graph, directed=False)[1]
        sizes = np.bincount(label, weights=np.where(chosen, self.areas, 0.0))
        result: np.ndarray = chosen & np.isin(label, np.argsort(-sizes)[:pieces])
        return result
