"""Muscle-tendon lengths, lengthening velocities and moment arms over frames, as OpenSim defines
them.

A muscle's path is a taut string through points and around surfaces. Its moment arm about a
coordinate is the generalized force of unit tension along the path, r = -dl/dq. Two kinds of path
are known: OpenSim's (`path_chain.wrapped_nodes`) and MuJoCo's (`path_chain.tendon_nodes`, which
calls `wrap_tendon`); a path takes the second where its wraps are `TendonWrap`.

Most coordinates cannot move most muscles, so moment arms are kept for the structural pattern only:
the pairs of a muscle and a coordinate that moves some of its bodies against others.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.latest import Latest
from myomorph.core.model.model import Model
from myomorph.core.muscles import path_arrays as columns
from myomorph.core.muscles.path_arrays import PathArrays, moved_paths, path_arrays
from myomorph.core.muscles.path_kernels import path_frames
from myomorph.core.rigid.coordinates import Ints
from myomorph.core.rigid.frames import run_frames
from myomorph.core.rigid.tree import Tree, compile_tree


@dataclass(frozen=True, eq=False)
class Paths:
    """The muscle paths of a model, compiled."""

    tree: Tree  # the model and its arrays
    arrays: PathArrays = field(repr=False)  # of the paths

    @property
    def muscles(self) -> tuple[str, ...]:
        """Names of the muscles, in order."""
        return self.tree.model.muscle_names

    @cached_property
    def arm_muscle(self) -> Ints:
        """(moment arms,) the muscle of each pair of the pattern."""
        return np.repeat(np.arange(len(self.muscles)), np.diff(self.arrays.start[:, columns.ARMS]))

    @cached_property
    def wraps(self) -> tuple[int | None, int | None]:
        """`surfaces` and `tendons` of `path_frames`."""
        by_mujoco = self.arrays.wrap[:, columns.AFTER] >= 0
        return (1 if (~by_mujoco).any() else None), (1 if by_mujoco.any() else None)

    @property
    def arm_coordinate(self) -> Ints:
        """(moment arms,) the coordinate of each pair of the pattern."""
        return self.arrays.arm[:, 0]

    @property
    def arm_free(self) -> np.ndarray:
        """(moment arms,) whether the pair's coordinate follows no other."""
        return self.arrays.arm[:, 1] == 1

    def evaluate(
        self,
        coordinates: Array,
        speeds: Array | None = None,
        progress: Callable[[int], None] | None = None,
    ) -> tuple[Array, Array, Array]:
        """Lengths, velocities and moment arms of all muscles.
        `coordinates` (frames, coordinates) in the model's order; dependent ones are set here [rad
        or m]; `speeds` (frames, coordinates) of which dependent ones are not read; None for rest
        [per s]; `progress`: called with the number of frames just done. Returns `lengths`,
        `velocities` (frames, muscles) [m, m/s]; `arms` (frames, moment arms) in the order of
        `arm_muscle` and `arm_coordinate` [m/rad or m/m]. A coordinate that others follow has what
        reaches the muscle through them included; one that follows has its own share.
        """
        coordinates = np.array(coordinates, dtype=np.float64)
        wanted = (len(coordinates), len(self.tree.model.coordinates))
        speeds = (
            np.zeros(wanted) if speeds is None else np.ascontiguousarray(speeds, dtype=np.float64)
        )
        for given in (coordinates, speeds):
            if given.shape != wanted:
                raise BadData(
                    f"expected coordinates and speeds of shape {wanted}, but got {given.shape}"
                )
        return self._run(coordinates, speeds, progress)[:3]

    def _run(
        self,
        c: Array,
        speeds: Array,
        progress: Callable[[int], None] | None,
        pairs: int = 0,
        nodes: int = 0,
    ) -> tuple[Array, Array, Array, Array, Array]:
        """What `path_frames` fills, of so many pairs of muscles and bodies and nodes of each
        muscle, 0 for none. `c`, `speeds` (frames, coordinates); dependent ones are set in `c`.
        """
        frames = len(c)
        muscles = len(self.muscles)
        lengths, velocities = np.empty((2, frames, muscles))
        arms = np.empty((frames, len(self.arm_coordinate)))
        pulls = np.zeros((frames, pairs, 6))
        places = np.full((frames, muscles if nodes else 0, nodes, 4), np.nan)
        fixed = (self.tree.arrays, self.arrays, *self.wraps)
        results = (lengths, velocities, arms, pulls, places)
        run_frames(path_frames, fixed, c, speeds, *results, progress=progress)
        return results

    @cached_property
    def pull_muscle(self) -> Ints:
        """(pairs,) the muscle of each pair of a muscle and a body that its path touches."""
        return np.repeat(
            np.arange(len(self.muscles)), np.diff(self.arrays.start[:, columns.BODIES])
        )

    @cached_property
    def pull_body(self) -> Ints:
        """(pairs,) number in the tree of the body of each of those pairs."""
        P = self.arrays
        first = self.arrays.start[:, columns.BODIES]
        bodies = np.zeros(int(first[-1]), np.int64)
        for column, local, numbers in (
            (columns.POINTS, P.point[:, columns.LOCAL], P.point[:, columns.BODY]),
            (
                columns.WRAPS,
                P.wrap[:, columns.OBJECT_LOCAL],
                P.object[P.wrap[:, columns.OBJECT], columns.OBJECT_BODY],
            ),
        ):
            muscle = np.repeat(np.arange(len(self.muscles)), np.diff(P.start[:, column]))
            bodies[first[muscle] + local] = numbers
        return bodies

    def pulls(
        self, coordinates: Array, progress: Callable[[int], None] | None = None
    ) -> tuple[Array, Array]:
        """What unit tension of each muscle does to the bodies its path touches.
        Forces act at the path's points and where it leaves surfaces, along its straight parts. What
        they do through points that move in their bodies acts on no body, but on the coordinates
        that move the points. `coordinates`, `progress`: as of `evaluate`. Returns `pulls` (frames,
        pairs, 6) force and its moment about the ground's origin, in ground, in the order of
        `pull_muscle` and `pull_body` [1, m]; `work` (frames, moment arms) the part of the moment
        arms that moving points have [m/rad or m/m].
        """
        c = np.array(coordinates, dtype=np.float64)
        _, _, work, pulls, _ = self._run(c, np.zeros_like(c), progress, pairs=len(self.pull_body))
        return pulls, work

    def nodes(self, coordinates: Array) -> Array:
        """The points that each path runs through, those where it meets and leaves surfaces
        included. `coordinates`: as of `evaluate`. Returns (frames, muscles, nodes, 4) places in
        ground and the length of the arc that ends there, 0 after a straight part; NaN beyond the
        path's last point [m].
        """
        c = np.array(coordinates, dtype=np.float64)
        return self._run(c, np.zeros_like(c), None, nodes=int(self.arrays.sizes[0]) + 2)[4]


def compile_paths(model: Model) -> Paths:
    """The model's muscle paths as flat arrays; the same model compiles once."""
    return _latest(model)


def compile_paths_as(model: Model, like: Model) -> Paths:
    """`compile_paths` of a model made of another by moving path points and resizing surfaces, and
    as `compile_tree_as`. `like`: the other one, with the same parts in the same order; what was
    compiled of it is used again.
    """
    arrays = moved_paths(compile_paths(like).arrays, model)
    made = Paths(compile_tree(model), arrays)
    _latest.put(model, made)
    return made


def _compile(model: Model) -> Paths:
    tree = compile_tree(model)
    return Paths(tree, path_arrays(model, tree))


_latest = Latest(_compile)


ARC_PARTS = 4  # Straight parts that an arc on a surface is drawn from


@read_only
class DrawnPaths:
    """All paths of a model as one list of points."""

    muscle: np.ndarray  # (points,) index of the muscle that each belongs to
    places: Array  # (frames, points, 3) in ground, NaN beyond a path's last point [m]


def drawn_paths(paths: Paths, coordinates: Array) -> DrawnPaths:
    """Every path as points to draw lines between, as many at any frame.
    An arc becomes `ARC_PARTS` chords of the cubic that leaves both ends along the straight parts
    beside them, as a taut string does, with the arc's length as the size of its tangents.
    `coordinates` (frames, coordinates) in the model's order [rad or m].
    """
    nodes = paths.nodes(coordinates)
    start = paths.arrays.start
    rooms = np.diff(start[:, columns.POINTS]) + np.diff(start[:, columns.WRAPS]) * (ARC_PARTS + 1)
    most = int(rooms.max(initial=0))
    drawn = np.full((len(nodes), len(paths.muscles), most + 1, 3), np.nan)
    real = np.isfinite(nodes[..., 0])
    arcs = real & (nodes[..., 3] > 0.0)
    # Each arc puts points before the node at which it ends.
    slots = np.arange(nodes.shape[2]) + (ARC_PARTS - 1) * np.cumsum(arcs, axis=2)
    f, m, n = np.nonzero(real)
    drawn[f, m, slots[f, m, n]] = nodes[f, m, n, :3]
    f, m, n = np.nonzero(arcs)
    first = nodes[f, m, n - 1, :3]
    last = nodes[f, m, n, :3]
    chord = last - first
    after = np.minimum(n + 1, nodes.shape[2] - 1)
    into = _tangent(first - nodes[f, m, np.maximum(n - 2, 0), :3], chord)
    out = _tangent(nodes[f, m, after, :3] - last, chord)
    length = nodes[f, m, n, 3][:, None]
    for index in range(1, ARC_PARTS):
        s = index / ARC_PARTS
        place = (2 * s**3 - 3 * s**2 + 1) * first + (3 * s**2 - 2 * s**3) * last
        place = place + length * ((s**3 - 2 * s**2 + s) * into + (s**3 - s**2) * out)
        drawn[f, m, slots[f, m, n] - ARC_PARTS + index] = place
    kept = np.arange(most + 1) < rooms[:, None]
    return DrawnPaths(np.repeat(np.arange(len(rooms)), rooms), drawn[:, kept])


def _tangent(along: Array, chord: Array) -> Array:
    """Unit vectors along the straight parts, or the chords where there is none."""
    lengths = np.linalg.norm(along, axis=1, keepdims=True)
    usable = np.isfinite(lengths) & (lengths > 1e-9)
    return np.where(
        usable,
        along / np.where(usable, lengths, 1.0),
        chord / np.linalg.norm(chord, axis=1)[:, None],
    )
