"""Nearest points on a surface: evenly spread samples, outward normals, its open rim."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData, from_extra
from myomorph.core.model.surface import Surface, edges_of, face_crosses, signed_volume

SPREAD = 4000  # Samples among which a rough nearest point is looked for.
DENSE = 20_000  # Samples among which one that faces a given way is looked for.
ON_EDGE = 1e-9
"""A corner that has no larger share in a place on a triangle has none: the place is on the edge
opposite to it.
"""


@read_only
class Samples:
    """Points spread evenly over a surface.

    Attributes
    ----------
    points : (n, 3) [m]
    normals : (n, 3) outward unit vectors
    rim : (n,) whether each is on the open rim
    """

    points: Array
    normals: Array
    rim: np.ndarray


class Boxes:
    """Triangles in a tree of boxes, for nearest points and for what lies inside."""

    def __init__(self, vertices: Array, faces: np.ndarray):
        # Imported here because it takes a moment that only bones should pay.
        igl = from_extra("morph", "igl", "libigl")

        self.vertices = vertices
        self.faces = np.ascontiguousarray(faces, dtype=np.int64)
        self._boxes = igl.AABB()
        self._boxes.init(self.vertices, self.faces)
        self._low = vertices[faces].min(axis=(0, 1))
        self._high = vertices[faces].max(axis=(0, 1))

    def nearest(self, points: Array) -> tuple[Array, np.ndarray, Array]:
        """Find the nearest places on the triangles.

        Parameters
        ----------
        points : (n, 3) [m]

        Returns
        -------
        squared distances (n,) [m^2], nearest faces (n,) and places on them (n, 3) [m]
        """
        if not len(points):
            return np.zeros(0), np.zeros(0, np.int64), np.zeros((0, 3))
        closest = self._boxes.squared_distance(
            self.vertices, self.faces, np.ascontiguousarray(points)
        )
        return np.atleast_1d(closest[0]), np.atleast_1d(closest[1]), np.reshape(closest[2], (-1, 3))

    def holds(self, points: Array) -> np.ndarray:
        """Find points that lie inside: their generalized winding number is above one half.

        Source: Barill et al. 2018.

        Parameters
        ----------
        points : (n, 3) [m]

        Returns
        -------
        (n,) whether each lies inside
        """
        igl = from_extra("morph", "igl", "libigl")

        inside = ((points >= self._low) & (points <= self._high)).all(axis=1)
        if inside.any():
            number = igl.fast_winding_number(
                self.vertices, self.faces, np.ascontiguousarray(points[inside])
            )
            inside[inside] = np.atleast_1d(number) > 0.5
        return np.asarray(inside)


class Shape:
    """A surface with its normals, areas and rim, prepared for nearest points.

    Raises
    ------
    BadData : the surface has no area
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
        """Faces (faces,) that touch an open edge; equal vertices count as one."""
        _, same = np.unique(np.round(self.vertices, 7), axis=0, return_inverse=True)
        faces = same.reshape(-1)[self.faces]
        edges = np.sort(edges_of(faces), axis=1)
        edges = edges[edges[:, 0] != edges[:, 1]]
        unique, counts = np.unique(edges, axis=0, return_counts=True)
        open_corners = np.zeros(int(same.max()) + 1, dtype=bool)
        open_corners[unique[counts == 1].reshape(-1)] = True
        return np.asarray(open_corners[faces].any(axis=1))

    @property
    def is_open(self) -> bool:
        """Whether more than a hundredth of the surface lies at open edges, as of a cut-off scan."""
        return float(self.areas[self.rim].sum()) > 0.01 * self.area

    def samples(self, count: int) -> Samples:
        """Spread points evenly over the surface; the same each time.

        One point in every equal share of the area, in random order.

        Parameters
        ----------
        count : number of points

        Returns
        -------
        the points with their normals
        """
        random = np.random.default_rng(0)
        # One point in every equal share of the area, in the order of the faces, spreads better than
        # chance.
        places = (np.arange(count) + random.random(count)) / count * self.area
        face = np.minimum(np.searchsorted(np.cumsum(self.areas), places), len(self.areas) - 1)
        a = np.sqrt(random.random(count))
        b = random.random(count)
        shares = np.stack([1.0 - a, a * (1.0 - b), a * b], axis=1)
        points = np.einsum("ij,ijk->ik", shares, self.vertices[self.faces[face]])
        order = random.permutation(count)
        return Samples(points[order], self.normals[face][order], self.rim[face][order])

    @cached_property
    def _spread(self) -> tuple[Samples, scipy.spatial.cKDTree]:
        """Few samples, and the tree of their points."""
        samples = self.samples(SPREAD)
        return samples, scipy.spatial.cKDTree(samples.points)

    @cached_property
    def dense(self) -> tuple[Samples, scipy.spatial.cKDTree]:
        """Many samples, and the tree of their points."""
        samples = self.samples(DENSE)
        return samples, scipy.spatial.cKDTree(samples.points)

    @cached_property
    def _boxes(self) -> Boxes:
        return Boxes(self.vertices, self.faces)

    def nearest(self, points: Array, fine: bool) -> Samples:
        """Find the nearest points of the surface.

        Parameters
        ----------
        points : (n, 3) [m]
        fine : on the triangles; else the nearest of `SPREAD` samples

        Returns
        -------
        n points with normals, and whether they lie on the rim
        """
        if not fine:
            samples, tree = self._spread
            index = tree.query(points)[1]
            return Samples(samples.points[index], samples.normals[index], samples.rim[index])
        places, faces = self.closest(points)
        return Samples(places, self.normals[faces], self.rim[faces])

    def closest(self, points: Array) -> tuple[Array, np.ndarray]:
        """Find the nearest points on the triangles.

        Parameters
        ----------
        points : (n, 3) [m]

        Returns
        -------
        places (n, 3) [m] and the triangles (n,) that they are on
        """
        _, faces, places = self._boxes.nearest(points)
        return places, faces

    def signed(self, points: Array) -> Array:
        """Compute signed distances from the surface.

        Where the nearest point is on an edge or a corner the normals of the faces around it are
        averaged: next to a sharp edge the normal of one of them alone may have the wrong sign.

        Source: Baerentzen and Aanaes 2005.

        Parameters
        ----------
        points : (n, 3) [m]

        Returns
        -------
        (n,) positive outside [m]
        """
        squared, face, places = self._seamless.nearest(points)
        side = np.einsum("ij,ij->i", points - places, self._seamless.normals(face, places))
        return np.where(side < 0, -1.0, 1.0) * np.sqrt(squared)

    @cached_property
    def _seamless(self) -> _Seamless:
        """Surface with equal vertices merged, and the faces that bound something, outward.

        Faces without an area, and two on the same vertices back to back, as files have them, bound
        nothing.
        """
        _, first, same = np.unique(
            np.round(self.vertices, 9), axis=0, return_index=True, return_inverse=True
        )
        vertices = self.vertices[first]
        faces = same.reshape(-1)[self.faces].astype(np.int64)
        crossed = face_crosses(vertices, faces)
        inward = np.einsum("ij,ij->i", crossed, self.normals) < 0.0
        faces[inward] = faces[inward][:, ::-1]
        # of going up or down the numbers
        way = np.sign(np.diff(faces, axis=1, append=faces[:, :1])).prod(axis=1)
        _, same = np.unique(np.sort(faces, axis=1), axis=0, return_inverse=True)
        bound = (np.linalg.norm(crossed, axis=1) > 0.0) & (
            way * np.bincount(same.reshape(-1), way)[same.reshape(-1)] > 0
        )
        return _Seamless(
            vertices, np.ascontiguousarray(faces[bound if bound.any() else slice(None)])
        )


class _Seamless(Boxes):
    """A surface whose faces share vertices, with normals of faces, edges and corners."""

    def __init__(self, vertices: Array, faces: np.ndarray):
        igl = from_extra("morph", "igl", "libigl")

        super().__init__(vertices, faces)
        crossed = face_crosses(vertices, faces)
        self._of_faces = crossed / np.linalg.norm(crossed, axis=1)[:, None]
        by_angle = igl.PER_VERTEX_NORMALS_WEIGHTING_TYPE_ANGLE
        self._of_corners = igl.per_vertex_normals(vertices, faces, by_angle)
        edges = igl.per_edge_normals(vertices, faces, igl.PER_EDGE_NORMALS_WEIGHTING_TYPE_UNIFORM)
        self._of_edges = edges[0][edges[2].reshape(3, -1).T]

    def normals(self, face: np.ndarray, places: Array) -> Array:
        """Find the normals at places on faces: at an edge or a vertex the mean of the faces around.

        Parameters
        ----------
        face : (n,) number of the face
        places : (n, 3) on it [m]

        Returns
        -------
        (n, 3)
        """
        corners = self.vertices[self.faces[face]]
        sides = np.roll(corners, -1, axis=1) - corners
        # Share of each corner: twice the area of the triangle between the place and the side
        # opposite to it.
        shares = np.einsum(
            "nij,nj->ni",
            np.cross(np.roll(sides, -1, axis=1), places[:, None] - np.roll(corners, -1, axis=1)),
            self._of_faces[face],
        )
        off = shares <= ON_EDGE * shares.sum(axis=1, keepdims=True)
        result = self._of_faces[face].copy()
        for index in range(3):
            here = off[:, index] & (off.sum(axis=1) == 1)
            result[here] = self._of_edges[face[here], index]
            here = ~off[:, index] & (off.sum(axis=1) == 2)
            result[here] = self._of_corners[self.faces[face[here], index]]
        return result


def _face_normals(surface: Surface) -> tuple[Array, Array]:
    """Compute outward unit normals (faces, 3) and areas (faces,) [m^2]."""
    crossed = face_crosses(surface.vertices, surface.faces)
    sizes = np.linalg.norm(crossed, axis=1)
    inward = signed_volume(surface.vertices - surface.vertices.mean(axis=0), surface.faces) < 0.0
    outward = -1.0 if inward else 1.0
    return outward * crossed / np.where(sizes > 0, sizes, 1.0)[:, None], 0.5 * sizes
