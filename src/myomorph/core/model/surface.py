"""A triangulated surface as a value: a bone's mesh, a skin."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from myomorph.core.model.arrays import Array, freeze, read_only
from myomorph.core.model.errors import BadData, from_extra
from myomorph.core.model.model import Body


@read_only
class Surface:
    """Triangles over points.

    Attributes
    ----------
    vertices : (n, 3) in the surface's own frame [m]
    faces : (m, 3) indices of the vertices

    Raises
    ------
    BadData : a face names a vertex that does not exist, or a vertex is not finite
    """

    vertices: Array
    faces: NDArray[np.int64]

    def __post_init__(self) -> None:
        freeze(self, vertices=(-1, 3))
        faces = np.array(self.faces, dtype=np.int64).reshape(-1, 3)
        faces.setflags(write=False)
        object.__setattr__(self, "faces", faces)
        if len(faces) and (faces.min() < 0 or faces.max() >= len(self.vertices)):
            raise BadData(
                f"a face names vertex {int(faces.max())}, but there are {len(self.vertices)}"
            )
        if not np.isfinite(self.vertices).all():
            raise BadData("a surface has vertices that are not finite")


def face_crosses(vertices: Array, faces: np.ndarray) -> Array:
    """Cross products (b - a) x (c - a) of faces with the corners a, b and c.

    Parameters
    ----------
    vertices : (n, 3) [m]
    faces : (m, 3) indices

    Returns
    -------
    (m, 3) along the normals of faces, twice as long as their areas [m^2]
    """
    a = vertices[faces[:, 0]]
    b = vertices[faces[:, 1]]
    c = vertices[faces[:, 2]]
    return np.cross(b - a, c - a)


def hull_faces(hull: Any) -> np.ndarray:
    """Faces of a convex hull, which look outward.

    Parameters
    ----------
    hull : scipy's `ConvexHull`

    Returns
    -------
    (m, 3) indices of its points
    """
    crosses = face_crosses(hull.points, hull.simplices)
    inward = np.einsum("ij,ij->i", crosses, hull.equations[:, :3]) < 0.0
    return np.where(inward[:, None], hull.simplices[:, ::-1], hull.simplices)


def used_part(vertices: Array, faces: np.ndarray) -> Surface:
    """Drop the vertices that no face names.

    Parameters
    ----------
    vertices : (n, 3) [m]
    faces : (m, 3) indices

    Returns
    -------
    the faces with the vertices that they name and no others
    """
    used, compact = np.unique(faces, return_inverse=True)
    return Surface(vertices[used], compact.reshape(-1, 3))


def body_meshes(body: Body, surfaces: Mapping[str, Surface]) -> list[Surface]:
    """Place a body's meshes in its frame, as far as they are known.

    Parameters
    ----------
    body : with meshes
    surfaces : by `Mesh.file`
    """
    result = []
    for mesh in body.meshes:
        if mesh.shape == "mesh" and mesh.file in surfaces:
            surface = surfaces[mesh.file]
            # A mirrored mesh is turned inside out, and back by the order of its corners.
            faces = surface.faces[:, ::-1] if np.prod(mesh.scale) < 0.0 else surface.faces
            result.append(Surface(mesh.pose.apply(surface.vertices * mesh.scale), faces))
    return result


def joined_surfaces(surfaces: Sequence[Surface]) -> Surface:
    """Join several surfaces to one."""
    starts = np.cumsum([0, *(len(surface.vertices) for surface in surfaces[:-1])])
    faces = [surface.faces + start for surface, start in zip(surfaces, starts, strict=True)]
    return Surface(
        vertices=np.concatenate([surface.vertices for surface in surfaces]),
        faces=np.concatenate(faces),
    )


def signed_volume(vertices: Array, faces: np.ndarray) -> float:
    """Volume that faces enclose, the sum of a . (b x c) / 6 over faces.

    Parameters
    ----------
    vertices : (n, 3) [m]
    faces : (m, 3) indices

    Returns
    -------
    negative where the faces look inward [m^3]
    """
    a = vertices[faces[:, 0]]
    b = vertices[faces[:, 1]]
    c = vertices[faces[:, 2]]
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def area_of(vertices: Array, faces: np.ndarray) -> float:
    """Area of faces.

    Parameters
    ----------
    vertices : (n, 3) [m]
    faces : (m, 3) indices

    Returns
    -------
    [m^2]
    """
    return float(np.linalg.norm(face_crosses(vertices, faces), axis=1).sum() / 2.0)


def distinct_faces(faces: np.ndarray) -> np.ndarray:
    """Drop faces that name a vertex twice, and those that another one repeats.

    Parameters
    ----------
    faces : (m, 3) indices

    Returns
    -------
    (distinct, 3) in their order
    """
    repeated = (faces == np.roll(faces, 1, axis=1)).any(axis=1)
    kept = faces[~repeated]
    _, first = np.unique(np.sort(kept, axis=1), axis=0, return_index=True)
    return kept[np.sort(first)]


def edges_of(faces: np.ndarray) -> np.ndarray:
    """List the directed edges of faces.

    Parameters
    ----------
    faces : (m, 3) indices

    Returns
    -------
    (3 m, 2) their first sides, then the second ones, then the third
    """
    return np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])


def connected(count: int, edges: np.ndarray) -> np.ndarray:
    """Find the connected pieces of vertices.

    Parameters
    ----------
    count : of vertices
    edges : (n, 2) indices

    Returns
    -------
    (count,) number of the piece that each vertex is in
    """
    entries = (np.ones(len(edges)), (edges[:, 0], edges[:, 1]))
    graph = scipy.sparse.coo_array(entries, shape=(count, count))
    return scipy.sparse.csgraph.connected_components(graph, directed=False)[1]


def pieces_of(count: int, faces: np.ndarray) -> list[np.ndarray]:
    """Split faces into pieces that are connected by their vertices.

    Parameters
    ----------
    count : of vertices
    faces : (m, 3) indices

    Returns
    -------
    (faces, 3) of each piece
    """
    label = connected(count, edges_of(faces))[faces[:, 0]]
    order = np.argsort(label, kind="stable")
    starts = np.flatnonzero(np.diff(label[order])) + 1
    return np.split(faces[order], starts)


def turned_outward(vertices: Array, faces: np.ndarray) -> np.ndarray:
    """Turn the faces of one piece to one side and outward, in their order.

    Where no turning makes neighbors look to the same side, as where a surface touches itself, they
    stay as they are.

    Parameters
    ----------
    vertices : (n, 3) [m]
    faces : (m, 3) indices

    Returns
    -------
    (m, 3)
    """
    result = faces
    before = _conflicts(faces)
    if before:
        # Imported here because only surfaces whose faces look to both sides need it.
        igl = from_extra("morph", "igl", "libigl")

        oriented, part = igl.bfs_orient(np.array(faces, dtype=np.int64))
        for number in np.unique(part):
            if _inward(vertices, oriented[part == number]):
                oriented[part == number] = oriented[part == number][:, ::-1]
        result = oriented if _conflicts(oriented) <= 0.5 * before else faces
    return np.ascontiguousarray(result[:, ::-1] if _inward(vertices, result) else result)


def _conflicts(faces: np.ndarray) -> int:
    """Count the edges of neighbors that look to different sides.

    Two such faces run along their common edge in the same direction.
    """
    directed = edges_of(faces)
    return len(directed) - len(np.unique(directed, axis=0))


def _inward(vertices: Array, faces: np.ndarray) -> bool:
    """Whether the faces (m, 3) of one piece look inward."""
    # About a point amid the piece, so that an open one has a volume of the right sign too.
    return signed_volume(vertices - vertices[np.unique(faces)].mean(axis=0), faces) < 0.0


def border_of(faces: np.ndarray) -> np.ndarray:
    """Find the border of faces.

    Parameters
    ----------
    faces : (m, 3) indices

    Returns
    -------
    (edges, 2) directed edges without a face on their other side
    """
    directed = edges_of(faces).astype(np.int64)
    count = int(faces.max()) + 1
    keys = directed[:, 0] * count + directed[:, 1]
    opposite = directed[:, 1] * count + directed[:, 0]
    return directed[~np.isin(keys, opposite)]
