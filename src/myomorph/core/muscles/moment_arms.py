"""Moment arms by virtual work: what a path of unit tension does to bodies and coordinates.

Each straight part of the path pulls the bodies at its ends towards each other, with f at x on one
and -f on the other. An arc pulls nothing but through the straight parts at its ends. Moving a
coordinate c_j turns and shifts the bodies that hang on its axes, so its generalized force, which is
the moment arm, is

    r_j = sum over axes of dphi/dc_j (w . (m - o x f)   of a rotation about w through o
                                      or w . f)         of a translation along w

with the sums of f and of m = x x f over the muscle's bodies that hang on the axis. Source: Sherman
et al. 2013; Seth et al. 2018.
"""

from __future__ import annotations

from typing import NamedTuple

from myomorph.core.model.arrays import Array
from myomorph.core.muscles import path_arrays as columns
from myomorph.core.muscles import path_chain as nodes
from myomorph.core.muscles.path_chain import between, seen_at
from myomorph.core.rigid.kernels import bare, in_place
from myomorph.core.rigid.vectors import cross, dot, minus, plus, times, vector

MIN_PART = 1e-14  # Length of a straight part that pulls [m]


class ArmRow(NamedTuple):
    """Moment arms of one muscle in one frame, as a part of those of all muscles.

    Attributes
    ----------
    values : (moment arms,) of all muscles [m/rad or m/m]
    first : place of the muscle's first one
    """

    values: Array
    first: int


@in_place
def pull_bodies(paths, frame, chain, pull, row):
    """Add force and moment of unit tension to each body of the muscle.

    Parts within one body do nothing, unless their points move in it: then they work on the
    coordinates that move the points.

    Parameters
    ----------
    paths : `PathArrays`
    frame : `PathFrame`
    chain : `Chain` of the path
    pull : (muscle's bodies, 6) force and its moment about the ground's origin, added to [1, m]
    row : `ArmRow`, to which the work of moving points is added
    """
    point = paths.point
    numbers = chain.numbers
    values = chain.values
    for n in range(chain.used[0] - 1):
        here = numbers[n, nodes.LOCAL]
        there = numbers[n + 1, nodes.LOCAL]
        moving = _moving_point(point, numbers[n, nodes.POINT])
        next_moving = _moving_point(point, numbers[n + 1, nodes.POINT])
        if here == there and moving < 0 and next_moving < 0:
            continue
        start = seen_at(chain, n)
        stop = seen_at(chain, n + 1)
        length = between(start, stop)
        if length < MIN_PART:
            continue
        force = times(values[n, nodes.WEIGHT] / length, minus(stop, start))
        back = times(-1.0, force)
        _pull(pull, here, vector(values, n), force)
        _pull(pull, there, vector(values, n + 1), back)
        if moving >= 0:
            body = point[numbers[n, nodes.POINT], columns.BODY]
            _work(paths.moving, frame, moving, body, force, row)
        if next_moving >= 0:
            body = point[numbers[n + 1, nodes.POINT], columns.BODY]
            _work(paths.moving, frame, next_moving, body, back, row)


@bare
def _moving_point(points, index):
    """Row of `PathArrays.moving` of a point; -1 if it is fixed in its body, or on a surface."""
    return points[index, columns.MOVING] if index >= 0 else -1


@bare
def _pull(pull, local, x, force):
    """Add a force f at x in ground, and its moment x x f, to a body of the muscle."""
    moment = cross(x, force)
    for i in range(3):
        pull[local, i] += force[i]
        pull[local, 3 + i] += moment[i]


@bare
def _work(moving_points, frame, moving, b, force, row):
    """Add the work of a force on a moving point, per unit of its coordinates.

    Of component i of the point in body b it is (R_b^T f)_i dx_i/dc.

    Parameters
    ----------
    moving_points : `PathArrays.moving`
    moving : its row of the point
    b : number of the point's body in the tree
    """
    R = frame.bodies.R
    moved = frame.moved
    arms = row.values
    for i in range(3):
        slot = moving_points[moving, 6 + i]
        if slot >= 0:
            share = R[b, 0, i] * force[0] + R[b, 1, i] * force[1] + R[b, 2, i] * force[2]
            arms[row.first + slot] += moved[moving, 3 + i] * share


@in_place
def gather_arms(paths, muscle, bodies, pull, row):
    """Add what the forces do along the axes that lie between the muscle's bodies.

    Parameters
    ----------
    paths : `PathArrays`
    muscle : its number
    bodies : `PoseArrays`
    pull : of `pull_bodies`
    row : `ArmRow`, added to
    """
    start = paths.start
    axes = paths.axis
    support = paths.support
    dphi = bodies.dphi
    arms = row.values
    for q in range(start[muscle, columns.AXES], start[muscle + 1, columns.AXES]):
        force = (0.0, 0.0, 0.0)
        moment = (0.0, 0.0, 0.0)
        for n in range(axes[q, columns.SUPPORT], axes[q, columns.SUPPORT_STOP]):
            b = support[n]
            force = plus(force, vector(pull, b))
            moment = plus(moment, (pull[b, 3], pull[b, 4], pull[b, 5]))
        axis = axes[q, columns.TREE_AXIS]
        acting = force
        if axes[q, columns.ROTATES] == 1:
            acting = minus(moment, cross(vector(bodies.o, axis), force))
        work = dot(vector(bodies.w, axis), acting)
        if axes[q, columns.SLOT_1] >= 0:
            arms[row.first + axes[q, columns.SLOT_1]] += dphi[axis, 0] * work
        if axes[q, columns.SLOT_2] >= 0:
            arms[row.first + axes[q, columns.SLOT_2]] += dphi[axis, 1] * work


@in_place
def hand_on(paths, muscle, slopes, row):
    """Add what reaches coordinates through those that follow them: r_i += g_i r_d.

    Parameters
    ----------
    paths : `PathArrays`
    muscle : its number
    slopes : (couplers, 2) g of each dependent coordinate d in those it follows
    row : `ArmRow`, changed in place
    """
    start = paths.start
    follow = paths.follow
    arms = row.values
    for index in range(start[muscle, columns.FOLLOWS], start[muscle + 1, columns.FOLLOWS]):
        coupler = follow[index, 0]
        dependent_arm = arms[row.first + follow[index, 1]]
        for i in range(2):
            slot = follow[index, 2 + i]
            if slot >= 0:
                arms[row.first + slot] += slopes[coupler, i] * dependent_arm
