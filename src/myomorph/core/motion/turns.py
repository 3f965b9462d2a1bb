"""Angles that give the same pose: whole turns, and the two triples of a ball joint.

A body floats in the laboratory by coordinates whose bounds say nothing about it. A motion keeps to
the nearest angles.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from myomorph.core.model.arrays import Array, runs
from myomorph.core.model.model import GROUND, Joint, Model
from myomorph.core.model.spatial import axis_rotation
from myomorph.core.motion.pose_problem import PoseProblem
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import Tree

SAME_POSE = 1e-6  # Entries of poses that differ by less are those of one pose [1 or m]
# Change of an angle from frame to frame beyond which another branch is looked for [rad]
JUMP = 0.5 * np.pi
QUARTER_TURN = 0.5 * np.pi  # An angle that stays so near its default has made no whole turn [rad]
SLACK = 1e-9  # Of an angle, that counts as none [rad]
MASSLESS = 1e-6  # A body lighter than this share of the whole is a link on the way from the ground


def floating_coordinates(model: Model) -> tuple[str, ...]:
    """Find coordinates of the joints that let a body float.

    These have at least two translations and one rotation against the ground. A joint to the ground
    that only rotates (an arm fixed at the shoulder) or only slides (a sled) is part of the body or
    of a rig, and its bounds count. Massless links between ground and body belong to the root joint.

    Parameters
    ----------
    model : of any kind

    Returns
    -------
    names of the coordinates, joint by joint
    """
    result: list[str] = []
    for chain in _root_chains(model):
        axes = [
            (axis.kind, name) for joint in chain for axis in joint.axes for name in axis.coordinates
        ]
        turns = {name for kind, name in axes if kind == "rotation"}
        # Old files call the translations of a custom joint coupled; a rotation may bring a
        # translation along.
        slides = {name for kind, name in axes if kind == "translation"} - turns
        if len(slides) >= 2 and turns:
            result += dict.fromkeys(name for _, name in axes)
    return tuple(result)


def of_one_turn(tree: Tree, problem: PoseProblem, values: Array) -> Array:
    """Shift angles by whole turns so that they begin and go on after gaps at the nearest.

    Chunks of frames are solved from poses that were found separately, which may differ by whole
    turns. The first frame is compared with the default pose, that after a gap with the last one
    before it. Angles that would leave their bounds, or that a task pulls at, stay.

    Parameters
    ----------
    tree : the compiled model
    problem : with the free coordinates and their bounds
    values : (frames, coordinates) [rad or m], NaN in gaps

    Returns
    -------
    (frames, coordinates) [rad or m], the same poses
    """
    values = values.copy()
    for index, low, high in zip(problem.free, problem.lower, problem.upper, strict=True):
        column = values[:, index].copy()
        last = tree.defaults[index]
        name = tree.model.coordinates[index].name
        if np.nanmax(np.abs(column - last)) < QUARTER_TURN or problem.coordinates.weight[index]:
            continue
        if not _turns_whole(tree.model, name):
            continue
        for start, stop in runs(np.isfinite(column)):
            column[start:stop] = np.unwrap(column[start:stop])
            column[start:stop] -= 2.0 * np.pi * np.round((column[start] - last) / (2.0 * np.pi))
            last = column[stop - 1]
        if np.nanmin(column) >= low and np.nanmax(column) <= high:
            values[:, index] = column
    return values


def _turns_whole(model: Model, name: str) -> bool:
    """Return whether an angle gives the same pose a turn later: one axis rotates one to one."""
    turning = [axis for joint in model.joints for axis in joint.axes if name in axis.coordinates]
    coupled = any(name in coupler.independents for coupler in model.couplers)
    if (
        coupled
        or len(turning) != 1
        or turning[0].kind != "rotation"
        or turning[0].function.arity != 1
    ):
        return False
    zero = float(turning[0].function(np.array(0.0)))
    half = float(turning[0].function(np.array(np.pi)))
    whole = float(turning[0].function(np.array(2.0 * np.pi)))
    return abs(abs(whole - zero) - 2.0 * np.pi) < SLACK and abs(abs(half - zero) - np.pi) < SLACK


def _root_chains(model: Model) -> Iterator[list[Joint]]:
    """Yield the joints between the ground and each body on it, massless links included."""
    light = MASSLESS * max(model.mass, 1e-12)
    for joint in model.joints:
        if joint.parent != GROUND:
            continue
        chain = [joint]
        while model.body(chain[-1].child).mass < light:
            after = [following for following in model.joints if following.parent == chain[-1].child]
            if len(after) != 1:
                break
            chain += after
        yield chain


def of_one_branch(tree: Tree, problem: PoseProblem, values: Array) -> Array:
    """Choose the angles of every joint of three that are nearest to those of the frame before.

    Two triples of angles about three axes rotate a body alike. Chunks of frames are solved from
    poses that were found separately, and may begin on either. Where the nearer angles are out of
    bounds, or a task pulls at them, they stay; so do those of a floating root, which may come back
    from behind.

    Parameters
    ----------
    tree : the compiled model
    problem : with the free coordinates and their bounds
    values : (frames, coordinates) [rad or m], NaN in gaps

    Returns
    -------
    (frames, coordinates) [rad or m], the same poses
    """
    values = values.copy()
    seen = np.flatnonzero(np.isfinite(values).all(axis=1))
    place = {int(j): i for i, j in enumerate(problem.free)}
    for triple, axes in _triples(tree):
        steps = np.abs(np.diff(values[seen][:, triple], axis=0))
        if (
            not all(j in place for j in triple)
            or not (steps > JUMP).any()
            or problem.coordinates.weight[triple].any()
        ):
            continue
        if not _turns_alike(tree, values[seen[0]], triple, axes):
            continue
        low = np.array([problem.lower[place[j]] for j in triple])
        high = np.array([problem.upper[place[j]] for j in triple])
        for before, frame in pairwise(seen):
            last = values[before, triple]
            here = values[frame, triple]
            if np.abs(here - last).max() > JUMP:
                alike = (
                    here,
                    nearest_turn(here, last),
                    nearest_turn(other_angles(here, axes), last),
                )
                inside = [angles for angles in alike if ((low <= angles) & (angles <= high)).all()]
                tried = np.array(inside or [here])
                values[frame, triple] = tried[np.argmin(np.sum((tried - last) ** 2, axis=1))]
    return values


def other_branch(angles: Array) -> Array:
    """Find the other angles of a rotation about axes each perpendicular to the next.

        (a, b, c) -> (a + pi, pi - b, c + pi)

    Parameters
    ----------
    angles : (3,) [rad]

    Returns
    -------
    (3,) [rad]
    """
    return np.array([angles[0] + np.pi, np.pi - angles[1], angles[2] + np.pi])


def other_angles(angles: Array, axes: Array) -> Array:
    """Find the other angles of a rotation about any three axes u, v, w.

    The angle between the first axis u and the last axis w, rotated about v by the middle angle b,
    depends on cos(b - beta) alone, with

        beta = atan2(u . (v x w), u . w - (u . v) (v . w))

    so the middle angle may be 2 beta - b. The others follow from where u and w come to lie
    (Davenport angles).

    Parameters
    ----------
    angles : (3,) [rad]
    axes : (3, 3) unit vectors, one a row

    Returns
    -------
    (3,) [rad]
    """
    first, second, last = axes
    beta = np.arctan2(
        first @ np.cross(second, last), first @ last - (first @ second) * (second @ last)
    )
    middle = 2.0 * beta - angles[1]
    here = axis_rotation(second, angles[1])
    there = axis_rotation(second, middle)
    before = _angle_about(first, there @ last, here @ last)
    after = _angle_about(last, there.T @ first, here.T @ first)
    return np.array([angles[0] + before, middle, angles[2] - after])


def _angle_about(axis: Array, start: Array, end: Array) -> float:
    """Measure the angle from `start` (3,) to `end` (3,) about a unit `axis` (3,) [rad]."""
    return float(
        np.arctan2(axis @ np.cross(start, end), start @ end - (axis @ start) * (axis @ end))
    )


def nearest_turn(angles: Array, reference: Array) -> Array:
    """Remove whole turns that lead away from a reference.

        angle - 2 pi round((angle - reference) / 2 pi)

    Parameters
    ----------
    angles : of any shape [rad]
    reference : of the same shape [rad]

    Returns
    -------
    of the same shape, within half a turn of the reference [rad]
    """
    return np.asarray(angles - 2.0 * np.pi * np.round((angles - reference) / (2.0 * np.pi)))


def _triples(tree: Tree) -> Iterator[tuple[list[int], Array]]:
    """Yield the numbers of the three angles of each joint that rotates by three, and their axes.

    A floating root's are left out. The axes (3, 3), one a row, point so that a growing angle
    rotates by the right-hand rule.
    """
    floating = set(floating_coordinates(tree.model))
    for joint in tree.model.joints:
        turning = [axis for axis in joint.axes if axis.kind == "rotation" and axis.coordinates]
        names = [name for axis in turning for name in axis.coordinates]
        if len(turning) == len(set(names)) == 3 and not floating.intersection(names):
            signs = [
                float(axis.function(np.array(1.0)) - axis.function(np.array(0.0)))
                for axis in turning
            ]
            axes = np.array([sign * axis.vector for sign, axis in zip(signs, turning, strict=True)])
            yield [tree.model.coordinate_names.index(name) for name in names], axes


def _turns_alike(tree: Tree, pose: Array, triple: list[int], axes: Array) -> bool:
    """Return whether the other branch of three angles, and whole turns of each, give the same pose.

    Parameters
    ----------
    pose : (coordinates,) [rad or m]
    triple : numbers of the three angles
    axes : (3, 3) unit vectors, one a row
    """
    poses = np.tile(pose, (5, 1))
    poses[1, triple] = other_angles(pose[triple], axes)
    poses[[2, 3, 4], triple] += 2.0 * np.pi
    turned = forward_kinematics(tree, poses)
    return all(
        np.ptp(entries, axis=0).max() < SAME_POSE for entries in (turned.rotations, turned.origins)
    )
