"""Muscle paths that run through bones: how deep, in source and target, over the joints' ranges."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData, from_extra
from myomorph.core.model.model import Model
from myomorph.core.model.paths import Muscle
from myomorph.core.model.surface import Surface, face_crosses
from myomorph.core.muscles.drawn_paths import drawn_paths
from myomorph.core.muscles.model_paths import Paths, compile_paths
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from myomorph.core.surfaces.surface_points import Boxes

# Distance between samples of a path, as a share of the smallest bone's length, but no finer than
# `FINEST`.
STEP = 0.01
FINEST = 0.005  # And of the largest bone's.
OPEN_EDGES = 0.01  # Share of a surface's edges without a second face above which it counts as open.


class Solid:
    """A bone with an inside, even where its surface is open, flipped or in many pieces.

    Inside is where the generalized winding number is above one half (Barill et al. 2018). Pieces
    are turned outward first (`turned`: share of faces); `open`: more than a hundredth of its edges
    has a face on one side only; `length`: greatest extent along an axis [m].
    """

    def __init__(self, surface: Surface):
        if not len(surface.faces):
            raise BadData("a bone's surface has no faces")
        self.length = float(np.ptp(surface.vertices[np.unique(surface.faces)], axis=0).max())
        vertices, faces = _merged(surface, 1e-6 * self.length)
        turned, self.turned = _outward(vertices, faces)
        self._boxes = Boxes(vertices, turned)
        edges = np.sort(turned[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        self.open = bool((np.unique(edges, axis=0, return_counts=True)[1] == 1).mean() > OPEN_EDGES)

    @property
    def surface(self) -> Surface:
        """The surface with its faces outward."""
        return Surface(self._boxes.vertices, self._boxes.faces)

    def depths(self, points: Array) -> Array:
        """Return the depth of points under the surface.

        Parameters
        ----------
        points : (n, 3) in the bone's frame [m]

        Returns
        -------
        (n,) depths, 0 outside [m]
        """
        within = self._boxes.holds(points)
        result = np.zeros(len(points))
        result[within] = self.distances(points[within])
        return result

    def distances(self, points: Array) -> Array:
        """Return unsigned distances of points from the surface.

        Parameters
        ----------
        points : (n, 3) in the bone's frame [m]

        Returns
        -------
        (n,) distances [m]
        """
        return np.sqrt(self._boxes.nearest(points)[0])

    def way_out(self, point: Array) -> Array:
        """Return the direction from a point inside to the nearest point of the surface.

        Parameters
        ----------
        point : (3,) in the bone's frame [m]

        Returns
        -------
        (3,) unit vector
        """
        way = self._boxes.nearest(point[None])[2][0] - point
        return way / max(float(np.linalg.norm(way)), np.finfo(float).tiny)


def _merged(surface: Surface, nearness: float) -> tuple[Array, np.ndarray]:
    """Return vertices and faces, coincident vertices merged and faces without area left out."""
    _, first, same = np.unique(
        np.round(surface.vertices / nearness).astype(np.int64),
        axis=0,
        return_index=True,
        return_inverse=True,
    )
    faces = same.reshape(-1)[surface.faces]
    distinct = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    return np.array(surface.vertices[first]), np.ascontiguousarray(faces[distinct], dtype=np.int64)


def _outward(vertices: Array, faces: np.ndarray) -> tuple[np.ndarray, float]:
    """Faces of every piece turned to one side and outward, and the share that was turned."""
    igl = from_extra("morph", "igl", "libigl")

    oriented, piece = igl.bfs_orient(faces)
    oriented = np.array(oriented)
    piece = np.asarray(piece).reshape(-1)
    count = int(piece.max()) + 1
    corners = vertices[oriented]
    weights = np.bincount(piece, minlength=count)
    middle = np.stack(
        [np.bincount(piece, corners[:, :, i].mean(axis=1), count) / weights for i in range(3)],
        axis=1,
    )
    local = corners - middle[piece][:, None]
    volume = np.einsum("fi,fi->f", local[:, 0], np.cross(local[:, 1], local[:, 2]))
    inward = np.bincount(piece, volume, count)[piece] < 0.0
    oriented[inward] = oriented[inward][:, ::-1]
    before = np.sign(
        np.einsum("fi,fi->f", face_crosses(vertices, faces), face_crosses(vertices, oriented))
    )
    return np.ascontiguousarray(oriented), float(np.mean(before < 0.0))


@read_only
class Poses:
    """Poses at which paths are looked at."""

    coordinates: Array  # (poses, coordinates) in the model's order [rad or m]
    # coordinate that each pose moves away from the default, "" for the default pose
    moved: tuple[str, ...]


def range_poses(model: Model, names: Sequence[str], values: Sequence[Array]) -> Poses:
    """Return the default pose, and each coordinate at each of its values.

    Parameters
    ----------
    model : with the coordinates
    names : of the coordinates
    values : of each coordinate, (count,) [rad or m]

    Returns
    -------
    poses, with the name of the coordinate that each moves; the default pose has none
    """
    default = compile_tree(model).defaults
    rows = [default]
    moved = [""]
    for name, along in zip(names, values, strict=True):
        column = model.coordinate_names.index(name)
        for value in along:
            row = default.copy()
            row[column] = value
            rows.append(row)
            moved.append(name)
    return Poses(np.array(rows), tuple(moved))


@dataclass(frozen=True)
class Penetration:
    """A muscle's path through a bone.

    Attributes
    ----------
    muscle, body : names
    source, target : deepest place under the bone's surface over all poses [m]; 0 where it runs
        outside
    increase : target less source times the bone's size [m]
    coordinate, value : moved in the pose where it is deepest in the target [rad or m]; "" in the
        default pose
    length : of the target's bone [m]
    """

    muscle: str
    body: str
    source: float
    target: float
    increase: float
    coordinate: str
    value: float
    length: float


@read_only
class Depth:
    """How deep a muscle runs in a bone."""

    depth: float  # at the deepest place over all poses [m]
    pose: int  # number of the pose where that is
    # place, outward: (3,) that place in ground [m], and the unit vector from it to the nearest
    # point of the surface
    place: Array
    outward: Array


# Of a path that runs outside a bone.
NOWHERE = Depth(depth=0.0, pose=0, place=np.zeros(3), outward=np.zeros(3))


def path_depths(
    model: Model, bones: Mapping[str, Solid], poses: Poses, muscles: Sequence[str] | None = None
) -> dict[tuple[str, str], Depth]:
    """Measure how deep each muscle's path runs under the surface of each bone, by muscle and body.

    Paths are drawn around their wrap surfaces and sampled every hundredth of the smallest bone's
    length. A muscle is checked in the default pose and in those whose coordinate moves it, and only
    against `bones_beside` it: two legs that are crossed run through each other in any model. Paths
    that run through no bone are left out.
    """
    paths = compile_paths(model)
    lengths = [solid.length for solid in bones.values()]
    step = max(STEP * min(lengths), FINEST * max(lengths)) if lengths else np.inf
    looked = _looked_at(model, paths, poses, muscles)
    points, muscle, pose = _samples(paths, poses.coordinates, looked, step)
    placed = forward_kinematics(compile_tree(model), np.ascontiguousarray(poses.coordinates))
    beside = [bones_beside(model, muscle) for muscle in model.muscles]
    result: dict[tuple[str, str], Depth] = {}
    for body, solid in bones.items():
        near = np.flatnonzero(np.array([body in bodies for bodies in beside], dtype=bool)[muscle])
        number = placed.tree.body_index[body]
        bone = (placed.rotations[:, number], placed.origins[:, number])
        deepest = _deepest(solid, bone, points[near], pose[near], muscle[near])
        result |= {(model.muscle_names[m], body): depth for m, depth in deepest.items()}
    return result


def _looked_at(
    model: Model, paths: Paths, poses: Poses, muscles: Sequence[str] | None
) -> np.ndarray:
    """Return in which poses each muscle is checked, (poses, muscles).

    These are the default pose and those whose coordinate moves it; `muscles`: all by default.
    """
    wanted = np.isin(model.muscle_names, model.muscle_names if muscles is None else list(muscles))
    moves = np.zeros((len(model.muscles), len(model.coordinates)), dtype=bool)
    moves[paths.arm_muscle, paths.arm_coordinate] = True
    column = np.array(
        [model.coordinate_names.index(name) if name else -1 for name in poses.moved], dtype=np.int64
    )
    return np.asarray(wanted[None] & ((column < 0)[:, None] | moves[:, column].T))


def _deepest(
    solid: Solid,
    bone: tuple[Array, Array],
    points: Array,
    pose: np.ndarray,
    muscle: np.ndarray,
) -> dict[int, Depth]:
    """Find the deepest sample of each muscle in a bone, by the muscle's index.

    Parameters
    ----------
    solid : the bone
    bone : rotations (poses, 3, 3) and origins (poses, 3) of its body in ground [m]
    points : (samples, 3) of paths in ground [m]
    pose : (samples,) index of the pose of each
    muscle : (samples,) index of the muscle of each
    """
    rotations, origins = bone
    local = np.einsum("nji,nj->ni", rotations[pose], points - origins[pose])
    depths = solid.depths(local)
    result = {}
    for m in np.unique(muscle[depths > 0.0]):
        rows = np.flatnonzero(muscle == m)
        deepest = rows[np.argmax(depths[rows])]
        result[int(m)] = Depth(
            depth=float(depths[deepest]),
            pose=int(pose[deepest]),
            place=points[deepest],
            outward=rotations[pose[deepest]] @ solid.way_out(local[deepest]),
        )
    return result


def bones_beside(model: Model, muscle: Muscle) -> frozenset[str]:
    """Return the bodies that a muscle is fixed to, and those between them.

    What ends on these belongs to them, as a patella on a femur.
    """
    parents = {joint.child: joint.parent for joint in model.joints}
    chains = []
    for body in dict.fromkeys(point.body for point in muscle.path.points):
        chain = [body]
        while chain[-1] in parents:
            chain.append(parents[chain[-1]])
        chains.append(chain)
    common = set(chains[0]).intersection(*chains[1:])
    between = {body for chain in chains for body in chain if body not in common}
    between.add(next((body for body in chains[0] if body in common), chains[0][0]))
    inner = set(parents.values())
    return frozenset(
        between
        | {body for body, parent in parents.items() if parent in between and body not in inner}
    )


def _samples(
    paths: object, coordinates: Array, looked: np.ndarray, step: float
) -> tuple[Array, np.ndarray, np.ndarray]:
    """Points (n, 3) in ground along the paths, the muscle and the pose of each."""
    drawn = drawn_paths(paths, coordinates)  # type: ignore[arg-type]
    same = drawn.muscle[1:] == drawn.muscle[:-1]
    starts = drawn.places[:, :-1]
    ends = drawn.places[:, 1:]
    lengths = np.linalg.norm(ends - starts, axis=2)
    kept = same & np.isfinite(lengths) & (lengths > 0.0) & looked[:, drawn.muscle[:-1]]
    pose, segment = np.nonzero(kept)
    starts = starts[pose, segment]
    ends = ends[pose, segment]
    counts = np.maximum(np.ceil(lengths[pose, segment] / step), 1.0).astype(np.int64)
    owner = np.repeat(np.arange(len(counts)), counts)
    within = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
    share = ((within + 0.5) / counts[owner])[:, None]
    return starts[owner] + share * (ends - starts)[owner], drawn.muscle[segment[owner]], pose[owner]
