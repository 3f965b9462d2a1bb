"""Slopes of marker positions in the coordinates, by differences of poses."""

from __future__ import annotations

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.motion.pose_problem import PoseProblem
from myomorph.core.rigid.coordinates import couple_frames
from myomorph.core.rigid.kinematics import Poses, forward_kinematics
from myomorph.core.rigid.tree import Tree

STEP = 1e-6  # Of the differences that give the slopes of marker positions [rad or m]


@read_only
class MarkerFrames:
    """Markers of some frames against a model's pose.

    Attributes
    ----------
    errors : (frames, markers, 3) recorded less model in ground [m], NaN where unseen
    slopes : (frames, markers, 3, variables) derivatives of model positions [m/rad or 1]
    rotations : (frames, markers, 3, 3) from the markers' bodies to ground
    held : (frames, variables) whether each lies at a bound, so that it has no slopes
    """

    errors: Array
    slopes: Array
    rotations: Array
    held: np.ndarray


def marker_frames(tree: Tree, problem: PoseProblem, observed: Array, values: Array) -> MarkerFrames:
    """Compute errors of markers and the slopes of their positions at poses.

    Variables at a bound do not move. The slopes are forward differences.

    Parameters
    ----------
    tree : the compiled model
    problem : with the markers and the free coordinates
    observed : (frames, markers, 3) recorded [m], NaN where unseen
    values : (frames, coordinates) poses [rad or m]

    Returns
    -------
    errors, slopes and rotations of each frame
    """
    poses, held = nudged_poses(tree, problem, values)
    points = poses.points(problem.markers.body, problem.markers.location)
    points = points.reshape(len(values), len(problem.free) + 1, -1, 3)
    slopes = (points[:, 1:] - points[:, :1]) / STEP
    slopes[held] = 0.0
    rotations = poses.rotations[:: len(problem.free) + 1, problem.markers.body]
    return MarkerFrames(
        errors=observed - points[:, 0],
        slopes=np.moveaxis(slopes, 1, 3),
        rotations=rotations,
        held=held,
    )


def nudged_poses(tree: Tree, problem: PoseProblem, values: Array) -> tuple[Poses, np.ndarray]:
    """Pose each frame as it is, then with each variable moved by `STEP` of its unit.

    Parameters
    ----------
    tree : the compiled model
    problem : with the free coordinates, their bounds and units
    values : (frames, coordinates) [rad or m]

    Returns
    -------
    poses (frames (variables + 1)), frame after frame, and (frames, variables) whether each variable
    lies at a bound
    """
    stacked = np.repeat(values[:, None], len(problem.free) + 1, axis=1)
    for i, j in enumerate(problem.free):
        stacked[:, i + 1, j] += STEP * problem.unit[j]
    flat = np.ascontiguousarray(stacked.reshape(-1, values.shape[1]))
    couple_frames(tree.arrays, flat)
    here = values[:, problem.free]
    return forward_kinematics(tree, flat), (here <= problem.lower + 1e-9) | (
        here >= problem.upper - 1e-9
    )
