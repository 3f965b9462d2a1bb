"""Muscle-tendon lengths, lengthening velocities and moment arms over frames, as in OpenSim.

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
from typing import NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.latest import Latest
from myomorph.core.model.model import Model
from myomorph.core.model.shapes import ArmPairs, Coordinates, MuscleValues, Points, Pulls
from myomorph.core.model.shown import shown
from myomorph.core.muscles import path_arrays as columns
from myomorph.core.muscles.path_arrays import PathArrays, moved_paths, path_arrays
from myomorph.core.muscles.path_kernels import path_frames
from myomorph.core.rigid.coordinates import Ints
from myomorph.core.rigid.frames import run_frames
from myomorph.core.rigid.tree import Flags, Tree, compile_tree

ARC_PARTS = 4  # Straight parts that an arc on a surface is drawn from
MIN_LENGTH = 1e-9  # Of a straight part that has a direction [m]


class PathValues(NamedTuple):
    """Lengths, velocities and moment arms of all muscles.

    Attributes
    ----------
    lengths, velocities : (frames, muscles) [m], [m/s]
    arms : (frames, arms) in the order of `Paths.arm_muscle` and `arm_coordinate` [m/rad or m/m]
    """

    lengths: MuscleValues
    velocities: MuscleValues
    arms: ArmPairs


class PathResults(NamedTuple):
    """Everything that `path_frames` fills.

    Attributes
    ----------
    values : lengths, velocities and moment arms
    pulls : (frames, pairs, 6) see `Paths.pulls`
    nodes : (frames, muscles, nodes, 4) see `Paths.nodes`
    """

    values: PathValues
    pulls: Pulls
    nodes: Array


class PathPulls(NamedTuple):
    """Loads that unit tensions put on bodies.

    Attributes
    ----------
    pulls : (frames, pairs, 6) force [1] and its moment about the ground's origin [m], in ground, in
        the order of `Paths.pull_muscle` and `pull_body`
    work : (frames, arms) part of the moment arms that moving points have [m/rad or m/m]
    """

    pulls: Pulls
    work: ArmPairs


@shown
@dataclass(frozen=True, eq=False)
class Paths:
    """Muscle paths of a model, compiled.

    Attributes
    ----------
    tree : the compiled model
    arrays : of the paths
    """

    tree: Tree
    arrays: PathArrays = field(repr=False)

    @property
    def muscles(self) -> tuple[str, ...]:
        """Names of the muscles, in order."""
        return self.tree.model.muscle_names

    @cached_property
    def arm_muscle(self) -> Ints:
        """(moment arms,) the muscle of each pair of the pattern."""
        return np.repeat(np.arange(len(self.muscles)), np.diff(self.arrays.start[:, columns.ARMS]))

    @cached_property
    def wrap_rules(self) -> tuple[int | None, int | None]:
        """Rules of wrapping in use, OpenSim's and MuJoCo's: 1, or None where no path has them."""
        by_mujoco = self.arrays.wrap[:, columns.AFTER] >= 0
        return (1 if (~by_mujoco).any() else None), (1 if by_mujoco.any() else None)

    @property
    def arm_coordinate(self) -> Ints:
        """(moment arms,) the coordinate of each pair of the pattern."""
        return self.arrays.arm[:, 0]

    @property
    def arm_free(self) -> Flags:
        """(moment arms,) whether the pair's coordinate is independent."""
        return self.arrays.arm[:, 1] == 1

    def evaluate(
        self,
        coordinates: Array,
        speeds: Array | None = None,
        progress: Callable[[int], None] | None = None,
    ) -> PathValues:
        """Lengths, velocities and moment arms of all muscles.

        A coordinate that others follow has what reaches the muscle through them included in its
        moment arm. A dependent one has its own share.

        Parameters
        ----------
        coordinates : (frames, coordinates) in the model's order; dependent ones are set here
            [rad or m]
        speeds : (frames, coordinates) of which dependent ones are not read; None for rest [per s]
        progress : called with the number of frames just done

        Returns
        -------
        values of as many frames

        Raises
        ------
        BadData : the shape of an array is wrong
        """
        coordinates = np.array(coordinates, dtype=np.float64)
        shape = (len(coordinates), len(self.tree.model.coordinates))
        if speeds is None:
            speeds = np.zeros(shape)
        speeds = np.ascontiguousarray(speeds, dtype=np.float64)
        for values in (coordinates, speeds):
            if values.shape != shape:
                raise BadData(
                    f"expected coordinates and speeds of shape {shape}, but got {values.shape}"
                )
        return self._run(coordinates, speeds, progress).values

    def _run(
        self,
        c: Array,
        speeds: Array,
        progress: Callable[[int], None] | None,
        pairs: int = 0,
        nodes: int = 0,
    ) -> PathResults:
        """Run the path kernel over frames.

        Parameters
        ----------
        c, speeds : (frames, coordinates); dependent ones are set in `c`
        progress : called with the number of frames just done
        pairs : of muscles and bodies whose pulls are computed, 0 for none
        nodes : of each muscle that are computed, 0 for none
        """
        frames = len(c)
        muscles = len(self.muscles)
        lengths, velocities = np.empty((2, frames, muscles))
        arms = np.empty((frames, len(self.arm_coordinate)))
        pulls = np.zeros((frames, pairs, 6))
        places = np.full((frames, muscles if nodes else 0, nodes, 4), np.nan)
        fixed = (self.tree.arrays, self.arrays, *self.wrap_rules)
        results = (lengths, velocities, arms, pulls, places)
        run_frames(path_frames, fixed, c, speeds, *results, progress=progress)
        return PathResults(
            values=PathValues(lengths=lengths, velocities=velocities, arms=arms),
            pulls=pulls,
            nodes=places,
        )

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
        muscles = np.arange(len(self.muscles))
        muscle = np.repeat(muscles, np.diff(P.start[:, columns.POINTS]))
        bodies[first[muscle] + P.point[:, columns.LOCAL]] = P.point[:, columns.BODY]
        muscle = np.repeat(muscles, np.diff(P.start[:, columns.WRAPS]))
        surface_bodies = P.object[P.wrap[:, columns.OBJECT], columns.OBJECT_BODY]
        bodies[first[muscle] + P.wrap[:, columns.OBJECT_LOCAL]] = surface_bodies
        return bodies

    def pulls(
        self, coordinates: Coordinates, progress: Callable[[int], None] | None = None
    ) -> PathPulls:
        """Compute what unit tension of each muscle does to the bodies its path touches.

        Forces act at the path's points and where it leaves surfaces, along its straight parts. What
        they do through points that move in their bodies acts on no body, but on the coordinates
        that move the points.

        Parameters
        ----------
        coordinates, progress : as of `evaluate`

        Returns
        -------
        pulls and work of as many frames
        """
        c = np.array(coordinates, dtype=np.float64)
        results = self._run(c, np.zeros_like(c), progress, pairs=len(self.pull_body))
        return PathPulls(pulls=results.pulls, work=results.values.arms)

    def nodes(self, coordinates: Coordinates) -> Array:
        """Points that each path runs through, where it meets and leaves surfaces included.

        Parameters
        ----------
        coordinates : as of `evaluate`

        Returns
        -------
        (frames, muscles, nodes, 4) positions in ground and the length of the arc that ends there, 0
        after a straight part; NaN beyond the path's last point [m]
        """
        c = np.array(coordinates, dtype=np.float64)
        return self._run(c, np.zeros_like(c), None, nodes=int(self.arrays.sizes[0]) + 2).nodes


def compile_paths(model: Model) -> Paths:
    """Compile a model's muscle paths to flat arrays; the same model compiles once."""
    return _latest(model)


def compile_paths_as(model: Model, like: Model) -> Paths:
    """Compile a model that differs from another in places of path points and sizes of surfaces.

    It may also differ as of `compile_tree_as`. What was compiled of the other is used again.

    Parameters
    ----------
    model : to compile
    like : the other one, with the same parts in the same order
    """
    arrays = moved_paths(compile_paths(like).arrays, model)
    paths = Paths(compile_tree(model), arrays)
    _latest.put(model, paths)
    return paths


def _compile(model: Model) -> Paths:
    """Compile a model's muscle paths."""
    tree = compile_tree(model)
    return Paths(tree, path_arrays(model, tree))


_latest = Latest(_compile)


@read_only
class DrawnPaths:
    """All paths of a model as one list of points.

    Attributes
    ----------
    muscle : (points,) index of the muscle that each belongs to
    places : (frames, points, 3) in ground, NaN beyond a path's last point [m]
    """

    muscle: np.ndarray
    places: Points


def drawn_paths(paths: Paths, coordinates: Coordinates) -> DrawnPaths:
    """Every path as points to draw lines between, as many at any frame.

    An arc becomes `ARC_PARTS` chords of the cubic that leaves both ends along the straight parts
    beside them, as a taut string does, with the arc's length as the norm of its tangents.

    Parameters
    ----------
    paths : of a model's muscles
    coordinates : (frames, coordinates) in the model's order [rad or m]

    Returns
    -------
    points of all paths in as many frames
    """
    nodes = paths.nodes(coordinates)
    start = paths.arrays.start
    points = np.diff(start[:, columns.POINTS]) + np.diff(start[:, columns.WRAPS]) * (ARC_PARTS + 1)
    most_points = int(points.max(initial=0))
    drawn = np.full((len(nodes), len(paths.muscles), most_points + 1, 3), np.nan)
    is_node = np.isfinite(nodes[..., 0])
    ends_arc = is_node & (nodes[..., 3] > 0.0)
    # Each arc puts points before the node at which it ends.
    slots = np.arange(nodes.shape[2]) + (ARC_PARTS - 1) * np.cumsum(ends_arc, axis=2)
    frame, muscle, node = np.nonzero(is_node)
    drawn[frame, muscle, slots[frame, muscle, node]] = nodes[frame, muscle, node, :3]
    _put_arcs(drawn, nodes, ends_arc, slots)
    is_drawn = np.arange(most_points + 1) < points[:, None]
    return DrawnPaths(muscle=np.repeat(np.arange(len(points)), points), places=drawn[:, is_drawn])


def _put_arcs(drawn: Array, nodes: Array, ends_arc: Flags, slots: Ints) -> None:
    """Put the inner points of arcs before the nodes at which they end.

    With s from 0 to 1 between the ends p and q, unit tangents t and u and the arc's length L, the
    cubic Hermite curve is

        (2 s^3 - 3 s^2 + 1) p + (3 s^2 - 2 s^3) q + L ((s^3 - 2 s^2 + s) t + (s^3 - s^2) u)

    Parameters
    ----------
    drawn : (frames, muscles, points, 3) changed in place
    nodes : (frames, muscles, nodes, 4) of `Paths.nodes`
    ends_arc : (frames, muscles, nodes) whether an arc ends in each
    slots : (frames, muscles, nodes) positions of the nodes in `drawn`
    """
    frame, muscle, node = np.nonzero(ends_arc)
    first = nodes[frame, muscle, node - 1, :3]
    last = nodes[frame, muscle, node, :3]
    chord = last - first
    before = nodes[frame, muscle, np.maximum(node - 2, 0), :3]
    after = nodes[frame, muscle, np.minimum(node + 1, nodes.shape[2] - 1), :3]
    into = _tangent(first - before, chord)
    out = _tangent(after - last, chord)
    length = nodes[frame, muscle, node, 3][:, None]
    for part in range(1, ARC_PARTS):
        s = part / ARC_PARTS
        point = (2 * s**3 - 3 * s**2 + 1) * first + (3 * s**2 - 2 * s**3) * last
        point = point + length * ((s**3 - 2 * s**2 + s) * into + (s**3 - s**2) * out)
        drawn[frame, muscle, slots[frame, muscle, node] - ARC_PARTS + part] = point


def _tangent(along: Array, chord: Array) -> Array:
    """Make unit vectors along straight parts, or along the chords where there is none.

    Parameters
    ----------
    along, chord : (arcs, 3) [m]

    Returns
    -------
    (arcs, 3)
    """
    lengths = np.linalg.norm(along, axis=1, keepdims=True)
    usable = np.isfinite(lengths) & (lengths > MIN_LENGTH)
    along_part = along / np.where(usable, lengths, 1.0)
    along_chord = chord / np.linalg.norm(chord, axis=1)[:, None]
    return np.where(usable, along_part, along_chord)
