"""Coordinates that no marker shows: what is assumed of them, and how far that may be off.

Markers do not determine all of a body in every frame: sets end at the pelvis, markers are hidden
for a while. Of what is left open something is known beforehand, which holds in those directions of
the coordinates alone that move no seen marker (`myomorph.core.motion.hidden_coordinates`):

- a trunk that is never seen stays upright, and goes where the pelvis heads
  (`myomorph.core.motion.upright`), a head on a trunk that is seen likewise; other joints keep the
  angles of the default pose, so that arms hang from the trunk;
- what is hidden for a while goes on as before and comes back as after
  (`myomorph.core.motion.gap_bridges`), and to the end of a recording it eases to the former;
- a marker that is hidden leaves its share in the pose behind: no marker fits exactly, and without
  it the pose would jump by what it misses.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.motion.gap_bridges import bridged, eased_offsets, usual_acceleration
from myomorph.core.motion.hidden_coordinates import (
    Hidden,
    along_hidden,
    hidden_by,
    hidden_coordinates,
    informations,
    seen_markers,
)
from myomorph.core.motion.lengths import length_unit
from myomorph.core.motion.newton import Settings, solve_poses
from myomorph.core.motion.pose_problem import PoseProblem
from myomorph.core.motion.starts import root_coordinates
from myomorph.core.motion.tasks.coordinates import CoordinateArrays
from myomorph.core.motion.tasks.markers import MarkerArrays
from myomorph.core.motion.upright import UprightTrunk, upright_chains, upright_trunk
from myomorph.core.rigid.coordinates import Ints, couple_frames
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import Tree

UPRIGHT = "upright"
DEFAULT = "default pose"
BRIDGED = "bridged"

LEAN = (0.09, 0.03, 0.06)
"""Standard deviation of what of a trunk's orientation lasts through a recording: leaning forward,
leaning to a side, turning about the vertical [rad].
"""
SWAY = (0.035, 0.035, 0.06)
"""The same of what changes within `SWAY_TIME` [rad]. Both as `python -m benchmarks.validation
unseen_posture` finds them.
"""
BENDING = 0.8
"""By so much of the pelvis' tilt the first grows: who bends or sits bends the trunk as well."""
JOINT = (0.5, 0.2)
"""The same two of other joints [rad]; of slides in units of `SLIDE`."""
SLIDE = 0.1
WALKING = 2.0
"""Acceleration of the body from which on what is not seen sways more than in a walk, in proportion
[m/s^2]; of smaller animals in proportion to their size.
"""
SWAY_TIME = 0.1  # Over which a sway keeps its place, as of `Sources.skin_time` [s]
MAX_JUMP = 0.5  # A jump beyond it is no marker's share in a pose, in units [rad]
USUAL = 0.2  # Least share of the frames that show all markers, for a hidden one to leave a share
ROUNDS = 2  # Of taking the hidden part of a change, which is curved
AT_ONCE = 128  # Frames whose slopes are held at once


@read_only
class AssumedMode:
    """A way in which what no marker shows may differ from what is assumed.

    Attributes
    ----------
    name : of it
    shape : (coordinates,) change of the coordinates for 1 rad, or 1 m
    lasting : (frames,) standard deviation of what lasts through the recording [rad or m]
    changing : (frames,) the same of what changes within `SWAY_TIME`
    """

    name: str
    shape: Array
    lasting: Array
    changing: Array


@read_only
class Assumed:
    """What was assumed of coordinates that no marker shows.

    Attributes
    ----------
    values : (frames, coordinates) poses with it [rad or m]
    sd : (frames, coordinates) standard deviation about what is assumed, 0 where markers determine
        [rad or m]
    how : by coordinate `UPRIGHT`, `DEFAULT` or `BRIDGED`, "" where markers determine it throughout
    modes : how what is never seen may differ
    moved : (frames,) whose markers lie elsewhere than before
    """

    values: Array
    sd: Array
    how: tuple[str, ...]
    modes: tuple[AssumedMode, ...]
    moved: np.ndarray


@read_only
@dataclass(frozen=True, kw_only=True, eq=False)
class _Likely:
    """What is known of the free coordinates without any marker.

    Attributes
    ----------
    values : (frames, variables) [rad or m]
    sd : (frames, variables) standard deviation [rad or m]
    how : (variables,) `UPRIGHT` or `DEFAULT`
    trunk : that is upright, None without one
    vigor : of the motion, see `_vigor`
    """

    values: Array
    sd: Array
    how: tuple[str, ...]
    trunk: UprightTrunk | None
    vigor: float


def assumed_poses(
    tree: Tree, problem: PoseProblem, time: Array, values: Array, settings: Settings
) -> Assumed | None:
    """Complete poses by what is known beforehand of coordinates that markers do not show.

    Parameters
    ----------
    tree : the compiled model
    problem : of all frames, solved
    time : (frames,) [s]
    values : (frames, coordinates) its solution, NaN where no marker is seen [rad or m]
    settings : of the search

    Returns
    -------
    the poses; None where markers show all coordinates in all frames, and of problems with loops, or
    with other measurements than markers
    """
    if not _markers_alone(problem):
        return None
    hidden = _hidden(tree, problem, values)
    if not hidden.flags.any() and hidden.whole.all():
        return None
    likely = _likely(tree, problem, hidden, time, values)
    search = _Search(tree=tree, problem=problem, settings=settings, hidden=hidden, likely=likely)
    return search.assumed(time, values)


def posture_near(tree: Tree, problem: PoseProblem, values: Array) -> Array:
    """Find what coordinates are weakly drawn to near known poses.

    Parameters
    ----------
    tree : the compiled model
    problem : of all frames
    values : (frames, coordinates) the poses [rad or m]

    Returns
    -------
    (frames, coordinates) the poses' own values of hidden coordinates, else the default pose, as of
        all where something else than markers is measured [rad or m]
    """
    posture = np.tile(tree.defaults, (len(values), 1))
    if not _markers_alone(problem):
        return posture
    flags = np.zeros(values.shape, dtype=bool)
    flags[:, problem.free] = _hidden(tree, problem, values).flags
    posture[flags] = values[flags]
    return posture


def _hidden(tree: Tree, problem: PoseProblem, values: Array) -> Hidden:
    """Find the hidden coordinates of poses (frames, coordinates) [rad or m]."""
    root = np.isin(problem.free, root_coordinates(tree))
    return hidden_coordinates(tree, problem, values, root, length_unit(tree))


def _markers_alone(problem: PoseProblem) -> bool:
    """Whether markers are the only measurements, and no loop ties what they do not show."""
    others = (part for part in problem.tasks if not isinstance(part, MarkerArrays))
    measured = any(
        not isinstance(part, CoordinateArrays) and len(getattr(part, "body", (0,))) > 0
        for part in others
    )
    return problem.ties is None and not measured and len(problem.free) > 0


def _likely(
    tree: Tree, problem: PoseProblem, hidden: Hidden, time: Array, values: Array
) -> _Likely:
    """Find what is likely of every free coordinate: upright, or the default pose."""
    free = problem.free
    frames = len(values)
    turns = np.array([tree.model.coordinates[j].motion == "rotational" for j in free])
    size = np.where(turns, 1.0, SLIDE * problem.unit[free])
    likely = np.tile(tree.defaults[free], (frames, 1))
    vigor = _vigor(tree, problem, time, values)
    sd = np.tile(np.hypot(JOINT[0], vigor * JOINT[1]) * size, (frames, 1))
    how = [DEFAULT] * len(free)
    trunk = None
    for chain in upright_chains(tree, problem, hidden.always):
        columns = list(chain.variables)
        trunk = upright_trunk(tree, problem, chain, time, values)
        likely[:, columns] = trunk.values
        sd[:, columns] = _chain_sd(trunk, vigor)
        for column in columns:
            how[column] = UPRIGHT
    return _Likely(values=likely, sd=sd, how=tuple(how), trunk=trunk, vigor=vigor)


def _vigor(tree: Tree, problem: PoseProblem, time: Array, values: Array) -> float:
    """How much more what is not seen sways than in a walk, by the body's own acceleration.

    It is the root mean square acceleration of the body's place over `WALKING`, but at least 1.

    Parameters
    ----------
    time : (frames,) [s]
    values : (frames, coordinates) [rad or m], NaN where no marker is seen
    """
    known = np.asarray(np.isfinite(values).all(axis=1))
    sliding = [
        j for j in root_coordinates(tree) if tree.model.coordinates[j].motion == "translational"
    ]
    squares = [
        (usual_acceleration(time, values[:, j], known) / problem.unit[j]) ** 2 for j in sliding
    ]
    return max(1.0, float(np.sqrt(sum(squares))) / WALKING)


def _trunk_sizes(trunk: UprightTrunk, vigor: float) -> Iterator[tuple[Array, Array]]:
    """Yield standard deviations (frames,) of each way a trunk may lean, two of each [rad].

    The first is of what lasts, the other of what changes.
    """
    for index, (lasting, changing) in enumerate(zip(LEAN, SWAY, strict=True)):
        bending = BENDING * trunk.tilt if index == 0 else np.zeros_like(trunk.tilt)
        yield np.hypot(lasting, bending), np.full_like(trunk.tilt, vigor * changing)


def _chain_sd(trunk: UprightTrunk, vigor: float) -> Array:
    """Add up standard deviations (frames, variables of the chain) of an upright trunk [rad]."""
    squares = [
        np.multiply.outer(lasting**2 + changing**2, shape**2)
        for shape, (lasting, changing) in zip(trunk.shapes, _trunk_sizes(trunk, vigor), strict=True)
    ]
    return np.asarray(np.sqrt(np.sum(squares, axis=0)))


def _trunk_modes(
    trunk: UprightTrunk, vigor: float, columns: Ints, count: int
) -> Iterator[AssumedMode]:
    """How an upright trunk may differ.

    Parameters
    ----------
    columns : (variables of the chain,) numbers of its coordinates
    count : of all coordinates
    """
    names = ("leans ahead", "leans aside", "turns")
    for name, along, (lasting, changing) in zip(
        names, trunk.shapes, _trunk_sizes(trunk, vigor), strict=True
    ):
        shape = np.zeros(count)
        shape[columns] = along
        yield AssumedMode(
            name=f"{trunk.chain.name} {name}",
            shape=shape,
            lasting=np.nan_to_num(lasting),
            changing=np.nan_to_num(changing),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Search:
    """Poses with what is assumed of hidden coordinates."""

    tree: Tree
    problem: PoseProblem
    settings: Settings
    hidden: Hidden
    likely: _Likely

    def assumed(self, time: Array, values: Array) -> Assumed:
        """Complete poses.

        Parameters
        ----------
        time : (frames,) [s]
        values : (frames, coordinates) [rad or m], NaN where no marker is seen

        Returns
        -------
        the poses with what is assumed
        """
        poses = values
        sd = np.where(self.hidden.flags, self.likely.sd, 0.0)
        # Where nothing else is hidden than joints at the default pose, the solution is there.
        if not self.hidden.whole.all() or self.likely.trunk is not None:
            poses, sd = self._filled(time, values)
        return Assumed(
            values=poses,
            sd=self._of_all(sd),
            how=self._how(),
            modes=tuple(self._modes(sd)),
            moved=np.asarray((poses != values).any(axis=1)) & ~self.hidden.lost,
        )

    def _filled(self, time: Array, values: Array) -> tuple[Array, Array]:
        """Fill gaps, hold the trunk upright, and put off the jumps of what is seen.

        Returns
        -------
        poses (frames, coordinates) [rad or m], and standard deviations (frames, variables)
        """
        free = self.problem.free
        hidden = self.hidden
        offsets = self._offsets(time, values)
        targets = values[:, free] + offsets
        sd = np.zeros_like(targets)
        sd[:, self._solved] = np.where(hidden.flags, self.likely.sd, 0.0)[:, self._solved]
        for i in np.flatnonzero(hidden.flags.any(axis=0) & ~self._solved):
            known = np.asarray(~hidden.flags[:, i] & ~hidden.lost)
            likely = self.likely.values[:, i]
            bridge = bridged(time, targets[:, i], known, likely, self.likely.sd[:, i])
            targets[:, i] = np.where(hidden.lost, values[:, free[i]], bridge.values)
            sd[:, i] = np.where(hidden.flags[:, i], bridge.sd, 0.0)
        # Offsets are added in the end: what markers show of a hidden joint has its share in them.
        poses = self._reached(values, targets - offsets)
        shifted = np.flatnonzero(np.any(offsets != 0.0, axis=1))
        poses[np.ix_(shifted, free)] += offsets[shifted]
        poses[shifted] = self._within(poses[shifted])
        return poses, sd

    def _offsets(self, time: Array, values: Array) -> Array:
        """Find what takes off the jumps of poses as markers go and come.

        Where all markers are seen in fewer than `USUAL` of the frames there is no usual set, whose
        share a hidden marker could leave behind: nothing is taken off.

        Parameters
        ----------
        time : (frames,) [s]
        values : (frames, coordinates) [rad or m]

        Returns
        -------
        (frames, variables) [rad or m]
        """
        hidden = self.hidden
        shown = ~hidden.lost
        if hidden.whole.sum() < USUAL * shown.sum():
            return np.zeros((len(values), len(self.problem.free)))
        offsets = eased_offsets(time, self._jumps(values), hidden.whole, hidden.lost)
        offsets[:, hidden.always] = 0.0
        return offsets

    @property
    def _solved(self) -> np.ndarray:
        """(variables,) which are at the default pose as far as markers let them, as solved."""
        default = np.array([how == DEFAULT for how in self.likely.how])
        return np.asarray(self.hidden.always & default)

    @property
    def _filled_in(self) -> np.ndarray:
        """(frames, variables) which are hidden and not as solved."""
        return np.asarray(self.hidden.flags & ~self._solved)

    def _how(self) -> tuple[str, ...]:
        """By coordinate, what is assumed."""
        how = [""] * len(self.tree.defaults)
        for i, j in enumerate(self.problem.free):
            if self.hidden.always[i]:
                how[j] = self.likely.how[i]
            elif self.hidden.flags[:, i].any():
                how[j] = BRIDGED
        return tuple(how)

    def _modes(self, sd: Array) -> Iterator[AssumedMode]:
        """How what was assumed may differ: the trunk as a whole, other joints each by itself.

        Parameters
        ----------
        sd : (frames, variables) standard deviations [rad or m]
        """
        free = self.problem.free
        names = self.tree.model.coordinate_names
        trunk = self.likely.trunk
        taken = () if trunk is None else trunk.chain.variables
        if trunk is not None:
            columns = free[list(taken)]
            yield from _trunk_modes(trunk, self.likely.vigor, columns, len(names))
        for i in np.flatnonzero(self.hidden.flags.any(axis=0)):
            if i in taken:
                continue
            shape = np.zeros(len(names))
            shape[free[i]] = 1.0
            changing = 1.0
            if self.hidden.always[i]:
                sway = self.likely.vigor * JOINT[1]
                changing = sway / float(np.hypot(JOINT[0], sway))
            yield AssumedMode(
                name=names[free[i]],
                shape=shape,
                lasting=np.sqrt(1.0 - changing**2) * sd[:, i],
                changing=changing * sd[:, i],
            )

    def _of_all(self, free_values: Array) -> Array:
        """Spread values (frames, variables) to all coordinates, others 0."""
        whole = np.zeros((len(free_values), len(self.tree.defaults)))
        whole[:, self.problem.free] = free_values
        return whole

    def _within(self, poses: Array) -> Array:
        """Put poses (frames, coordinates) within their bounds, and let coupled ones follow."""
        free = self.problem.free
        within = np.array(poses, order="C")
        within[:, free] = np.clip(within[:, free], self.problem.lower, self.problem.upper)
        couple_frames(self.tree.arrays, within)
        return within

    def _reached(self, values: Array, targets: Array) -> Array:
        """Move hidden coordinates to targets, as far as no seen marker moves.

        Parameters
        ----------
        values : (frames, coordinates) [rad or m]
        targets : (frames, variables) of hidden ones [rad or m]

        Returns
        -------
        (frames, coordinates) [rad or m]
        """
        free = self.problem.free
        poses = values.copy()
        filled = self._filled_in
        frames = np.flatnonzero(filled.any(axis=1) & ~self.hidden.lost)
        for start in range(0, len(frames), AT_ONCE):
            some = frames[start : start + AT_ONCE]
            flags = filled[some]
            wanted = poses[some]
            wanted[:, free] = np.where(flags, targets[some], wanted[:, free])
            poses[some] = self._within(wanted)
        mixed = frames[self._moves_markers(values[frames], poses[frames], frames)]
        if len(mixed):
            poses[mixed] = self._along(mixed, values[mixed], targets[mixed])
        return poses

    def _moves_markers(self, before: Array, after: Array, frames: Ints) -> np.ndarray:
        """Whether seen markers move between two poses of frames, (frames, coordinates) each."""
        markers = self.problem.markers
        here = forward_kinematics(self.tree, before).points(markers.body, markers.location)
        there = forward_kinematics(self.tree, after).points(markers.body, markers.location)
        seen = seen_markers(self.problem)[frames]
        moved = np.where(seen, np.abs(there - here).max(axis=2), 0.0)
        still = self.settings.tolerance * length_unit(self.tree)
        return np.asarray(moved.max(axis=1, initial=0.0) > still)

    def _along(self, frames: Ints, values: Array, targets: Array) -> Array:
        """Move hidden coordinates towards targets along directions that move no seen marker.

        Other coordinates of such a direction go with it, and markers are fitted again from there.

        Parameters
        ----------
        frames : their numbers
        values : (frames, coordinates) [rad or m]
        targets : (frames, variables) [rad or m]

        Returns
        -------
        (frames, coordinates) [rad or m]
        """
        problem = part_of(self.problem, frames)
        free = problem.free
        unit = problem.unit[free]
        flags = self._filled_in[frames]
        whole = self.hidden.whole[frames]
        limit = np.where(whole, self.hidden.faint, self.hidden.weak)
        poses = values.copy()
        for _ in range(ROUNDS):
            for start in range(0, len(frames), AT_ONCE):
                some = slice(start, start + AT_ONCE)
                observed = problem.markers.observed[some]
                information = informations(self.tree, problem, poses[some], observed)
                change = np.where(flags[some], targets[some] - poses[some][:, free], 0.0) / unit
                moved = along_hidden(information, change, limit[some])
                poses[some, free] += unit * moved
            poses = self._within(poses)
            weight = np.where(seen_markers(problem), problem.markers.weight, 0.0).sum(axis=1)
            pull = np.where(flags, (limit**2 / weight)[:, None], 0.0)
            drawn = problem._replace(posture=poses, pull=self._of_all(pull))
            poses = solve_poses(
                self.tree, drawn, poses, self.settings._replace(chained=False)
            ).values
        return poses

    def _jumps(self, values: Array) -> Array:
        """Find how far poses jump as markers go and come, by which they are put off afterwards.

        Between two frames with other markers, the markers of both give poses c' of the one before
        and of the one after, which do not jump; what these hide stays. What the others add changes
        by

            (c - c')_before - (c - c')_after

        Parameters
        ----------
        values : (frames, coordinates) poses c [rad or m]

        Returns
        -------
        (frames, variables) of the jump before each frame [rad or m]
        """
        free = self.problem.free
        jumps = np.zeros((len(values), len(free)))
        hidden = self.hidden
        changed = np.diff(hidden.groups) != 0
        after = 1 + np.flatnonzero(changed & ~hidden.lost[1:] & ~hidden.lost[:-1])
        if not len(after):
            return jumps
        pairs = np.stack([after - 1, after], axis=1).ravel()
        seen = seen_markers(self.problem)
        common = np.repeat(seen[after - 1] & seen[after], 2, axis=0)
        shares = self._shares(values[pairs], pairs, common)[:, free].reshape(-1, 2, len(free))
        sizes = np.nan_to_num(shares[:, 0] - shares[:, 1])
        sizes[np.abs(sizes / self.problem.unit[free]) > MAX_JUMP] = 0.0
        jumps[after] = sizes
        return jumps

    def _shares(self, values: Array, frames: Ints, common: np.ndarray) -> Array:
        """Find what markers other than the common ones have made of poses.

        Parameters
        ----------
        values : (frames, coordinates) poses [rad or m]
        frames : their numbers
        common : (frames, markers) which markers are common

        Returns
        -------
        (frames, coordinates) [rad or m], NaN where the common markers give no pose
        """
        problem = part_of(self.problem, frames)
        observed = np.where(common[:, :, None], problem.markers.observed, np.nan)
        problem = problem.with_markers(observed=np.ascontiguousarray(observed))
        flags = self._hidden_at(problem, values, self.hidden.flags[frames])
        weight = np.maximum(np.where(common, problem.markers.weight, 0.0).sum(axis=1), 1e-300)
        pull = np.where(flags, (self.hidden.weak**2 / weight)[:, None], 0.0)
        drawn = problem._replace(posture=values, pull=self._of_all(pull))
        solved = solve_poses(self.tree, drawn, values, self.settings._replace(chained=False))
        sure = np.asarray(solved.converged & common.any(axis=1))
        return np.where(sure[:, None], values - solved.values, np.nan)

    def _hidden_at(self, problem: PoseProblem, values: Array, flags: np.ndarray) -> np.ndarray:
        """Add to flags (pairs, variables) what the common markers of both frames hide."""
        result = flags.copy()
        for start in range(0, len(values), AT_ONCE):
            some = slice(start, start + AT_ONCE)
            observed = problem.markers.observed[some]
            for row, information in enumerate(
                informations(self.tree, problem, values[some], observed)
            ):
                result[start + row] |= hidden_by(information, self.hidden.weak)
        return result


def part_of(problem: PoseProblem, frames: Ints) -> PoseProblem:
    """Take some frames of a problem that has markers and pulls of coordinates alone.

    Parameters
    ----------
    problem : of all frames
    frames : their numbers

    Returns
    -------
    the problem of these frames, with errors of its own
    """
    markers = problem.markers
    observed = np.ascontiguousarray(markers.observed[frames])
    tasks = (
        markers._replace(observed=observed, errors=np.full(observed.shape[:2], np.nan)),
        problem.coordinates._replace(value=np.ascontiguousarray(problem.coordinates.value[frames])),
        *problem.tasks[2:],
    )
    return problem._replace(tasks=tasks, fixed=np.ascontiguousarray(problem.fixed[frames]))


def marker_errors(tree: Tree, problem: PoseProblem, values: Array) -> Array:
    """Distances of the model's markers from those seen.

    Parameters
    ----------
    tree : the compiled model
    problem : with the markers of these frames
    values : (frames, coordinates) poses [rad or m]

    Returns
    -------
    (frames, markers) [m], NaN where hidden
    """
    markers = problem.markers
    points = forward_kinematics(tree, values).points(markers.body, markers.location)
    return np.asarray(np.linalg.norm(points - markers.observed, axis=2))
