"""Angles of ball joints: two triples of angles turn a body alike, and a motion stays with one of them."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from myomorph.model.arrays import Array
from myomorph.motion.pose_problem import PoseProblem
from myomorph.motion.root import floating_coordinates
from myomorph.rigid.kinematics import forward_kinematics
from myomorph.rigid.tree import Tree

SAME_POSE = 1e-6
"""Entries of poses that differ by less are those of one pose [1 or m]."""

JUMP = 0.5 * np.pi
"""Change of an angle from frame to frame beyond which another branch is looked for [rad]."""


def of_one_branch(tree: Tree, problem: PoseProblem, values: Array) -> Array:
    """The same poses, with the angles of every joint of three that are nearest to those of the frame before.

    Angles (a, b, c) about axes each perpendicular to the next turn a body as (a + pi, pi - b, c + pi) do. Frames are
    solved in stretches from poses that were found apart, and may begin on either. Where the nearer angles are out of
    bounds, or a task pulls at them, they stay; so do those of a floating root, which may come back turned around.

    Parameters
    ----------
    values : (frames, coordinates) [rad or m], NaN in gaps
    """
    values = values.copy()
    seen = np.flatnonzero(np.isfinite(values).all(axis=1))
    place = {int(j): i for i, j in enumerate(problem.free)}
    for triple in _triples(tree):
        steps = np.abs(np.diff(values[seen][:, triple], axis=0))
        if not all(j in place for j in triple) or not (steps > JUMP).any() or problem.coordinates.weight[triple].any():
            continue
        if not _turns_alike(tree, values[seen[0]], triple):
            continue
        low, high = (np.array([bound[place[j]] for j in triple]) for bound in (problem.lower, problem.upper))
        for before, frame in pairwise(seen):
            last, here = values[before, triple], values[frame, triple]
            other = nearest_turn(other_branch(here), last)
            nearer = np.sum((other - last) ** 2) < np.sum((here - last) ** 2)
            if np.abs(here - last).max() > JUMP and nearer and ((low <= other) & (other <= high)).all():
                values[frame, triple] = other
    return values


def other_branch(angles: Array) -> Array:
    """(3,) the other angles of the same rotation, about axes each perpendicular to the next [rad]."""
    return np.array([angles[0] + np.pi, np.pi - angles[1], angles[2] + np.pi])


def nearest_turn(angles: Array, reference: Array) -> Array:
    """Angles without whole turns away from a reference [rad]."""
    return np.asarray(angles - 2.0 * np.pi * np.round((angles - reference) / (2.0 * np.pi)))


def _triples(tree: Tree) -> Iterator[list[int]]:
    """The three angles of each joint that turns by three, but for a floating root's."""
    floating = set(floating_coordinates(tree.model))
    for joint in tree.model.joints:
        names = dict.fromkeys(name for axis in joint.axes if axis.kind == "rotation" for name in axis.coordinates)
        if len(names) == 3 and not floating.intersection(names):
            yield [tree.model.coordinate_names.index(name) for name in names]


def _turns_alike(tree: Tree, pose: Array, triple: list[int]) -> bool:
    """Whether the other branch of three angles, and whole turns of each, give every body the same pose."""
    poses = np.tile(pose, (5, 1))
    poses[1, triple] = other_branch(pose[triple])
    poses[[2, 3, 4], triple] += 2.0 * np.pi
    turned = forward_kinematics(tree, poses)
    return all(np.ptp(entries, axis=0).max() < SAME_POSE for entries in (turned.rotations, turned.origins))
