"""Muscle-tendon lengths, lengthening velocities and moment arms over frames, as OpenSim defines them.

A muscle's path is a taut string through points and around surfaces. Its moment arm about a
coordinate is the generalized force of unit tension along the path, r = -dl/dq. Two kinds of path are
known: OpenSim's (`path_chain.wrapped_nodes`) and MuJoCo's (`path_chain.tendon_nodes`, which
calls `wrap_tendon`); a path takes the second where its wraps are `TendonWrap`.

Most coordinates cannot move most muscles, so moment arms are kept for the structural pattern only:
the pairs of a muscle and a coordinate that moves some of its bodies against others.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.errors import BadData
from myomorph.model.labelled import Labelled, Variable
from myomorph.model.latest import Latest
from myomorph.model.model import Model, index_of
from myomorph.model.series import Motion
from myomorph.muscles.coupled_arms import LoopGroup, loop_couplings, loop_groups
from myomorph.muscles.path_arrays import (
    AFTER,
    ARMS,
    BODIES,
    BODY,
    LOCAL,
    OBJECT,
    OBJECT_BODY,
    OBJECT_LOCAL,
    POINTS,
    WRAPS,
    PathArrays,
    moved_paths,
    path_arrays,
)
from myomorph.muscles.path_kernels import coupler_slopes, path_frames
from myomorph.rigid.coordinates import Ints
from myomorph.rigid.frames import over_frames
from myomorph.rigid.kernels import kernel
from myomorph.rigid.tree import Tree, compile_tree


@dataclass(frozen=True, eq=False)
class Paths:
    """The muscle paths of a model, compiled.

    Attributes
    ----------
    tree : the model and its arrays
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
        return np.repeat(np.arange(len(self.muscles)), np.diff(self.arrays.start[:, ARMS]))

    @cached_property
    def wraps(self) -> tuple[int | None, int | None]:
        """`surfaces` and `tendons` of `path_frames`."""
        by_mujoco = self.arrays.wrap[:, AFTER] >= 0
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

        Parameters
        ----------
        coordinates : (frames, coordinates) in the model's order; dependent ones are set here [rad or m]
        speeds : (frames, coordinates) of which dependent ones are not read; None for rest [per s]
        progress : called with the number of frames just done

        Returns
        -------
        lengths, velocities : (frames, muscles) [m, m/s]
        arms : (frames, moment arms) in the order of `arm_muscle` and `arm_coordinate` [m/rad or m/m]. A
            coordinate that others follow has what reaches the muscle through them included; one that
            follows has its own share.
        """
        coordinates = np.array(coordinates, dtype=np.float64)
        wanted = (len(coordinates), len(self.tree.model.coordinates))
        speeds = np.zeros(wanted) if speeds is None else np.ascontiguousarray(speeds, dtype=np.float64)
        for given in (coordinates, speeds):
            if given.shape != wanted:
                raise BadData(f"expected coordinates and speeds of shape {wanted}, but got {given.shape}")
        frames = len(coordinates)
        lengths, velocities = np.empty((frames, len(self.muscles))), np.empty((frames, len(self.muscles)))
        arms = np.empty((frames, len(self.arm_coordinate)))
        none = np.empty((frames, 0, 6)), np.empty((frames, 0, 0, 4))
        T, P = self.tree.arrays, self.arrays

        def part(start: int, stop: int) -> None:
            here = slice(start, stop)
            results = lengths[here], velocities[here], arms[here], none[0][here], none[1][here]
            path_frames(T, P, *self.wraps, coordinates[here], speeds[here], *results)

        over_frames(part, frames, progress)
        return lengths, velocities, arms

    @cached_property
    def pull_muscle(self) -> Ints:
        """(pairs,) the muscle of each pair of a muscle and a body that its path touches."""
        return np.repeat(np.arange(len(self.muscles)), np.diff(self.arrays.start[:, BODIES]))

    @cached_property
    def pull_body(self) -> Ints:
        """(pairs,) number in the tree of the body of each of those pairs."""
        P, first = self.arrays, self.arrays.start[:, BODIES]
        bodies = np.zeros(int(first[-1]), np.int64)
        for column, local, numbers in (
            (POINTS, P.point[:, LOCAL], P.point[:, BODY]),
            (WRAPS, P.wrap[:, OBJECT_LOCAL], P.object[P.wrap[:, OBJECT], OBJECT_BODY]),
        ):
            muscle = np.repeat(np.arange(len(self.muscles)), np.diff(P.start[:, column]))
            bodies[first[muscle] + local] = numbers
        return bodies

    def pulls(self, coordinates: Array, progress: Callable[[int], None] | None = None) -> tuple[Array, Array]:
        """What unit tension of each muscle does to the bodies its path touches.

        Forces act at the path's points and where it leaves surfaces, along its straight parts. What they do through
        points that move in their bodies acts on no body, but on the coordinates that move the points.

        Parameters
        ----------
        coordinates, progress : as of `evaluate`

        Returns
        -------
        pulls : (frames, pairs, 6) force and its moment about the ground's origin, in ground, in the order of
            `pull_muscle` and `pull_body` [1, m]
        work : (frames, moment arms) the part of the moment arms that moving points have [m/rad or m/m]
        """
        c = np.array(coordinates, dtype=np.float64)
        frames, muscles = len(c), len(self.muscles)
        found, none = np.zeros((frames, len(self.pull_body), 6)), np.empty((frames, 0, 0, 4))
        work = np.empty((frames, len(self.arm_coordinate)))
        T, P = self.tree.arrays, self.arrays

        def part(start: int, stop: int) -> None:
            here, room = slice(start, stop), np.empty((2, stop - start, muscles))
            results = room[0], room[1], work[here], found[here], none[here]
            path_frames(T, P, *self.wraps, c[here], np.zeros_like(c[here]), *results)

        over_frames(part, frames, progress)
        return found, work

    def nodes(self, coordinates: Array) -> Array:
        """The points that each path runs through, those where it meets and leaves surfaces included.

        Parameters
        ----------
        coordinates : as of `evaluate`

        Returns
        -------
        (frames, muscles, nodes, 4) places in ground and the length of the arc that ends there, 0 after a straight
        part; NaN beyond the path's last point [m]
        """
        c = np.array(coordinates, dtype=np.float64)
        frames, muscles = len(c), len(self.muscles)
        found = np.full((frames, muscles, int(self.arrays.sizes[0]) + 2, 4), np.nan)
        none = np.empty((frames, 0, 6))
        T, P = self.tree.arrays, self.arrays

        def part(start: int, stop: int) -> None:
            n = stop - start
            room = np.empty((n, muscles)), np.empty((n, muscles)), np.empty((n, len(self.arm_coordinate)))
            here = slice(start, stop)
            path_frames(T, P, *self.wraps, c[here], np.zeros_like(c[here]), *room, none[here], found[here])

        over_frames(part, frames)
        return found


def compile_paths(model: Model) -> Paths:
    """The model's muscle paths as flat arrays; the same model compiles once.

    Raises
    ------
    UnknownName
        a path refers to a body, coordinate or wrap object that the model does not have
    BadModel
        a path has fewer than two points, or mixes the wraps of OpenSim and MuJoCo
    """
    return _latest(model)


def compile_paths_as(model: Model, like: Model) -> Paths:
    """`compile_paths` of a model made of another by moving path points and resizing surfaces, and as `compile_tree_as`.

    Parameters
    ----------
    like : the other one, with the same parts in the same order; what was compiled of it is used again
    """
    arrays = moved_paths(compile_paths(like).arrays, model)
    made = Paths(compile_tree(model), arrays)
    _latest.put(model, made)
    return made


def _compile(model: Model) -> Paths:
    tree = compile_tree(model)
    return Paths(tree, path_arrays(model, tree))


_latest = Latest(_compile)


@kernel
def _slopes(P, c, slopes):
    for frame in range(c.shape[0]):
        coupler_slopes(P, c[frame], slopes[frame])


@dataclass(frozen=True, eq=False)
class MuscleKinematics(Labelled):
    """Lengths, velocities and moment arms of muscles over time.

    Attributes
    ----------
    time : (frames,) [s]
    muscles, coordinates : names
    lengths : (frames, muscles) of the muscle-tendon units [m]
    velocities : (frames, muscles) or None where not asked for [m/s]
    arms : (frames, moment arms) as `Paths.evaluate` gives them, or None where not asked for
    coupler_slopes : (frames, couplers, 2) of the dependent coordinates in those they follow
    paths : the compiled paths, which hold the pattern of `arms`
    loops : of each group of coordinates that closed loops tie together, `loop_couplings`
    """

    time: Array
    muscles: tuple[str, ...]
    coordinates: tuple[str, ...]
    lengths: Array
    velocities: Array | None
    arms: Array | None
    coupler_slopes: Array
    paths: Paths = field(repr=False)
    loops: tuple[tuple[LoopGroup, Array], ...] = field(default=(), repr=False)

    def variables(self) -> dict[str, Variable]:
        """Lengths, and velocities and moment arms [m/rad or m/m] where they were asked for."""
        found = {"length": Variable(("time", "muscle"), self.lengths, "m")}
        if self.velocities is not None:
            found["velocity"] = Variable(("time", "muscle"), self.velocities, "m/s")
        if self.arms is not None:
            found["moment_arm"] = Variable(("time", "muscle", "coordinate"), self.moment_arms, "m")
        return found

    def labels(self) -> dict[str, Sequence[str] | Array]:
        """Times [s], muscles, coordinates."""
        return {"time": self.time, "muscle": self.muscles, "coordinate": self.coordinates}

    @property
    def moment_arms(self) -> Array:
        """(frames, muscles, coordinates) all moment arms; see `dense`."""
        return self.dense()

    def dense(self, frames: slice = slice(None)) -> Array:
        """Moment arms as OpenSim reports them, (frames, muscles, coordinates) [m/rad or m/m].

        A coordinate that others follow has what reaches the muscle through them included. One that
        follows has the moment arm of what it follows per unit of its own motion: with d = f(q) and
        slope g, r_d = r_q / g; where g is 0, its own share. Coordinates of a closed loop have what the
        others of the loop add while they follow; see `coupled_arms`.

        Parameters
        ----------
        frames : the frames wanted; big models are asked for in parts
        """
        return self._dense(frames, np.arange(len(self.muscles)))

    def moment_arm(self, muscle: str, coordinate: str) -> Array:
        """Moment arm of one muscle about one coordinate, (frames,), as of `dense`; raises `UnknownName`."""
        i = index_of("muscle", muscle, self.muscles)
        j = index_of("coordinate", coordinate, self.coordinates)
        return self._dense(slice(None), np.array([i]))[:, 0, j]

    def independent(self, frames: slice = slice(None)) -> tuple[Array, Ints, Ints]:
        """Moment arms about the coordinates that no coupler drives, each moved alone (loops opened), in sparse form.

        Returns
        -------
        values : (frames, pairs) [m/rad or m/m]
        muscle, coordinate : (pairs,) indices
        """
        free = self.paths.arm_free
        return self._arms()[frames][:, free], self.paths.arm_muscle[free], self.paths.arm_coordinate[free]

    def _arms(self) -> Array:
        if self.arms is None:
            raise BadData("these muscle kinematics were made without moment arms: ask for moment_arms=True")
        return self.arms

    def _dense(self, frames: slice, muscles: Ints) -> Array:
        arms, starts = self._arms()[frames], self.paths.arrays.start[:, ARMS]
        table = np.zeros((len(arms), len(muscles), len(self.coordinates)))
        for row, m in enumerate(muscles):
            pairs = slice(starts[m], starts[m + 1])
            table[:, row, self.paths.arm_coordinate[pairs]] = arms[:, pairs]
        tree = self.paths.tree.arrays
        for k, dependent in enumerate(tree.coupler_coordinate):
            slopes = self.coupler_slopes[frames, k]
            reached = np.zeros(table.shape[:2])
            for slope, source in zip(slopes.T, tree.coupler_source[k], strict=True):
                if source >= 0:
                    reached += slope[:, None] * table[:, :, source]
            square = (slopes**2).sum(axis=1)
            moves = square > 0.0
            table[moves, :, dependent] = reached[moves] / square[moves, None]
        for group, couplings in self.loops:
            own = table[:, :, group.coordinates[group.leading]]
            table[:, :, group.coordinates] = np.einsum("fml,flk->fmk", own, couplings[frames])
        return table


def muscle_kinematics(
    model: Model,
    motion: Motion,
    velocities: bool = True,
    moment_arms: bool = True,
    progress: Callable[[int], None] | None = None,
) -> MuscleKinematics:
    """Lengths, lengthening velocities and moment arms of a model's muscles in a motion.

    Source: Delp and Loan 1995, paths; Seth et al. 2018, moment arms.

    Parameters
    ----------
    model : with muscles
    motion : coordinates over time; what it lacks stands at the model's default, at rest
    velocities : also lengthening velocities, for which the motion must have velocities
    moment_arms : also moment arms, (frames, pairs of a muscle and a coordinate that moves it)
    progress : called with the number of frames just done

    Returns
    -------
    lengths (frames, muscles) [m], velocities (frames, muscles) [m/s] and moment arms (frames, muscles, coordinates) [m]

    Raises
    ------
    BadData
        velocities are asked for and the motion has none, or a value is not finite

    Examples
    --------
    >>> import myomorph as mm
    >>> model = mm.read_model("arm.osim")
    >>> found = mm.muscle_kinematics(model, mm.read_motion("reach.mot", model), velocities=False)
    >>> found.muscles, found.lengths.shape
    (('flexor', 'extensor'), (61, 2))
    >>> found.moment_arm("flexor", "elbow_flexion").shape
    (61,)
    """
    paths = compile_paths(model)
    if velocities and motion.velocities is None:
        raise BadData("lengthening velocities need the velocities of the coordinates: differentiate the motion first")
    coordinates = paths.tree.coordinates_of(motion)
    speeds = _speeds(model, motion) if velocities else None
    if not np.isfinite(coordinates).all() or not (speeds is None or np.isfinite(speeds).all()):
        raise BadData("the motion has values that are not finite")
    lengths, rates, arms = paths.evaluate(coordinates, speeds, progress)
    slopes = np.zeros((len(coordinates), len(paths.tree.arrays.coupler_coordinate), 2))
    _slopes(paths.arrays, coordinates, slopes)
    loops = tuple((one, loop_couplings(paths.tree, one, coordinates)) for one in loop_groups(paths.tree) if moment_arms)
    return MuscleKinematics(
        motion.time,
        model.muscle_names,
        model.coordinate_names,
        lengths,
        rates if velocities else None,
        arms if moment_arms else None,
        slopes,
        paths,
        loops,
    )


def _speeds(model: Model, motion: Motion) -> Array:
    """(frames, coordinates) speeds in the model's order, 0 for what the motion does not have."""
    assert motion.velocities is not None
    speeds = np.zeros((len(motion), len(model.coordinates)))
    columns = {name: i for i, name in enumerate(motion.names)}
    for j, name in enumerate(model.coordinate_names):
        if name in columns:
            speeds[:, j] = motion.velocities[:, columns[name]]
    return speeds
