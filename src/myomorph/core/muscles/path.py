"""A muscle's path: its length, its lengthening velocity and its moment arms, frame by frame.

A path is a taut string from origin to insertion, through points on bodies and around surfaces. In
each frame it becomes a chain of nodes (`path_chain`): the points, then for each surface that the
string meets the two ends of an arc (`path_surfaces` by OpenSim, `path_tendons` by MuJoCo). Then

    length    l = sum of the chain's straight parts and arcs
    moment arm r_j = -dl/dc_j about coordinate j, by virtual work (`moment_arms`)
    velocity  ldot = -sum r_j cdot_j over the independent coordinates

What the paths of a model consist of is compiled in `path_arrays`; `model_paths` runs the kernel
below over a motion.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.shapes import ArmPairs, MuscleValues, Pulls
from myomorph.core.muscles import path_arrays as columns
from myomorph.core.muscles.moment_arms import ArmRow, gather_arms, hand_on, pull_bodies
from myomorph.core.muscles.path_chain import (
    Chain,
    add_point,
    chain_length,
    chain_room,
    forget_seen,
    put_nodes,
)
from myomorph.core.muscles.path_frame import PathFrame, frame_room, place_frame, point_at
from myomorph.core.muscles.path_functions import (
    PathFunctionArrays,
    path_function_velocity,
    put_path_function,
)
from myomorph.core.muscles.path_surfaces import Passes, pass_room, wrap_surfaces
from myomorph.core.muscles.path_tendons import wrap_tendons
from myomorph.core.rigid.kernels import bare, in_place, inner, kernel

SLACK = 1e-5  # Beyond its range in which a coordinate still gives the path a point [rad or m]


class PathRules(NamedTuple):
    """Rules by which paths have their lengths; None where no path has it by a rule.

    Attributes
    ----------
    surfaces : 1 where a path wraps as in OpenSim, `path_surfaces`
    tendons : 1 where a path wraps as in MuJoCo, `path_tendons`
    functions : of coordinates, `path_functions`
    """

    surfaces: int | None
    tendons: int | None
    functions: PathFunctionArrays | None


class PathMotion(NamedTuple):
    """Coordinates over frames, as the kernel reads them.

    Attributes
    ----------
    coordinates : (frames, coordinates) of which it sets dependent ones [rad or m]
    speeds : (frames, coordinates) of which it does not read dependent ones [rad/s or m/s]
    """

    coordinates: Array
    speeds: Array

    def part(self, start: int, stop: int) -> PathMotion:
        """Frames from `start` to before `stop`."""
        return PathMotion(coordinates=self.coordinates[start:stop], speeds=self.speeds[start:stop])


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

    def part(self, start: int, stop: int) -> PathResults:
        """Frames from `start` to before `stop`."""
        values = PathValues(
            lengths=self.values.lengths[start:stop],
            velocities=self.values.velocities[start:stop],
            arms=self.values.arms[start:stop],
        )
        return PathResults(
            values=values, pulls=self.pulls[start:stop], nodes=self.nodes[start:stop]
        )


class PathRoom(NamedTuple):
    """Scratch arrays of `path_frames`, one set per thread.

    Attributes
    ----------
    frame : what all paths read in a frame
    chain : nodes of one path
    passes : order in which OpenSim wraps a path's surfaces, and the latest results
    pull : (muscle's bodies, 6) force of unit tension and its moment about the ground's origin
        [1, m]
    """

    frame: PathFrame
    chain: Chain
    passes: Passes
    pull: Array


@kernel
def path_frames(T, paths, rules, motion, results):
    """Lengths, velocities and moment arms of all muscles, frame by frame.

    Parameters
    ----------
    T, paths : `TreeArrays`, `PathArrays`
    rules : `PathRules`; what is None there is not compiled: each of wrapping is half of this kernel
    motion : `PathMotion`, whose dependent coordinates are set here
    results : `PathResults`, filled; pulls only where they have pairs, and then `arms` holds only
        the work of points that move in their bodies; nodes only where they have muscles, and what
        is beyond a path's last point is left
    """
    room = path_room(T, paths)
    for frame in range(motion.coordinates.shape[0]):
        place_frame(T, paths, motion.coordinates[frame], room.frame)
        frame_paths(paths, rules, room, (motion, results), frame)


@inner
def path_room(T, paths):
    """Make the scratch arrays."""
    return PathRoom(
        frame=frame_room(T, paths),
        chain=chain_room(paths),
        passes=pass_room(paths),
        pull=np.zeros((paths.sizes[2], 6)),
    )


@bare
def frame_paths(paths, rules, room, values, frame):
    """Compute all paths in a frame whose poses are known.

    Parameters
    ----------
    paths : `PathArrays`
    rules : `PathRules`
    room : `PathRoom`, placed by `place_frame`
    values : `PathMotion` and `PathResults`
    frame : its number
    """
    motion, results = values
    _paths(paths, rules[0], rules[1], rules[2], room, motion, results, frame)


@bare
def _paths(paths, surfaces, tendons, functions, room, motion, results, frame):
    """Compute all paths in a frame whose poses are known.

    Parameters
    ----------
    surfaces, tendons, functions : of `PathRules`
    frame : its number
    """
    start = paths.start
    here = room.frame
    chain = room.chain
    pull = room.pull
    values = results.values
    arms = values.arms[frame]
    coordinates = motion.coordinates[frame]
    for muscle in range(start.shape[0] - 1):
        _put_points(paths, muscle, coordinates, here, chain)
        _wrap(paths, muscle, surfaces, tendons, room)
        values.lengths[frame, muscle] = chain_length(chain)
        if results.nodes.shape[1] > 0:
            put_nodes(chain, results.nodes[frame, muscle])

        row = ArmRow(values=arms, first=start[muscle, columns.ARMS])
        for arm in range(row.first, start[muscle + 1, columns.ARMS]):
            arms[arm] = 0.0
        _clear_pulls(paths, muscle, pull)
        pull_bodies(paths, here, chain, pull, row)
        if results.pulls.shape[1] > 0:
            _put_pulls(paths, muscle, pull, results.pulls[frame])
        else:
            gather_arms(paths, muscle, here.bodies, pull, row)
        _put_function(functions, muscle, motion, values, frame, row)
        hand_on(paths, muscle, here.slopes, row)
        values.velocities[frame, muscle] = _velocity(paths, muscle, row, motion.speeds[frame])
        _put_function_velocity(functions, muscle, motion, values, frame)


@in_place
def _wrap(paths, muscle, surfaces, tendons, room):
    """Lay the chain of a muscle around its surfaces.

    Numba leaves out a branch whose condition is None by type, if nothing else stands in the
    condition.
    """
    start = paths.start
    here = room.frame
    chain = room.chain
    first_wrap = start[muscle, columns.WRAPS]
    if start[muscle + 1, columns.WRAPS] > first_wrap:
        forget_seen(chain, start[muscle + 1, columns.WRAPS] - first_wrap)
        by_mujoco = paths.wrap[first_wrap, columns.AFTER] >= 0
        if tendons is not None:  # noqa: SIM102
            if by_mujoco:
                wrap_tendons(paths, muscle, here, chain)
        if surfaces is not None:  # noqa: SIM102
            if not by_mujoco:
                wrap_surfaces(paths, muscle, here, chain, room.passes)


@in_place
def _put_function(functions, muscle, motion, values, frame, row):
    """Put length and arms of a muscle whose path is a function."""
    if functions is not None:  # noqa: SIM102
        if functions.number[muscle] >= 0:
            length = put_path_function(functions, muscle, motion, frame, row)
            values.lengths[frame, muscle] = length


@in_place
def _put_function_velocity(functions, muscle, motion, values, frame):
    """Put the velocity of a muscle whose path is a function, with what of it depends on time."""
    if functions is not None:  # noqa: SIM102
        if functions.number[muscle] >= 0:
            known = values.velocities[frame, muscle]
            velocity = path_function_velocity(functions, muscle, motion, frame, known)
            values.velocities[frame, muscle] = velocity


@in_place
def _put_points(paths, muscle, c, frame, chain):
    """Begin the chain of a muscle with its active points.

    A point may belong to the path only while a coordinate is in a range.
    """
    start = paths.start
    point = paths.point
    place = paths.place
    chain.used[0] = 0
    for index in range(start[muscle, columns.POINTS], start[muscle + 1, columns.POINTS]):
        j = point[index, columns.COORDINATE]
        low = place[index, columns.LOW] - SLACK
        high = place[index, columns.HIGH] + SLACK
        if j >= 0 and not low <= c[j] <= high:
            continue
        position = point_at(point, place, frame, index)
        weight = place[index, columns.WEIGHT]
        add_point(chain, index, position, weight, point[index, columns.LOCAL])


@in_place
def _clear_pulls(paths, muscle, pull):
    """Set the pulls on a muscle's bodies to 0."""
    start = paths.start
    for b in range(start[muscle + 1, columns.BODIES] - start[muscle, columns.BODIES]):
        for i in range(6):
            pull[b, i] = 0.0


@in_place
def _put_pulls(paths, muscle, pull, table):
    """Store the pulls on a muscle's bodies in `table`, (pairs, 6) of all muscles."""
    start = paths.start
    first = start[muscle, columns.BODIES]
    for pair in range(first, start[muscle + 1, columns.BODIES]):
        for i in range(6):
            table[pair, i] = pull[pair - first, i]


@in_place
def _velocity(paths, muscle, row, speeds):
    """Lengthening velocity -sum r_j cdot_j over the independent coordinates [m/s]."""
    start = paths.start
    pattern = paths.arm
    speed = 0.0
    for arm in range(start[muscle, columns.ARMS], start[muscle + 1, columns.ARMS]):
        if pattern[arm, 1] == 1:
            speed -= row.values[arm] * speeds[pattern[arm, 0]]
    return speed
