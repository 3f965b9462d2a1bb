"""Coordinates that no sensor determines, and what those of a lost sensor most likely are."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.motion.marker_frames import STEP, nudged_poses
from myomorph.core.motion.pose_problem import PoseProblem
from myomorph.core.motion.turns import floating_coordinates
from myomorph.core.rigid.coordinates import Ints
from myomorph.core.rigid.tree import Tree

DETERMINED = 0.9
"""A coordinate of whose usual variance the sensors explain a smaller share is not determined by
them.
"""
NOISE = 0.05
USUAL = 0.35
"""Standard deviations of a sensor and of a coordinate, for that [rad]."""
RIDGE = 1e-3
"""Of the regression, relative to the variance of what explains."""
MIN_SPREAD = 0.02  # Of an angle that the others explain [rad]
MIN_RATE = 1e-9  # Standard deviation of a rate that counts as none [rad/s]
MIN_FRAMES = 10
"""Frames for each unknown of the regression, at least."""


@read_only
class LikelyAngles:
    """Coordinates in frames in which their sensor is lost.

    They are as the others were seen to go with them before or after.

    Attributes
    ----------
    columns : (columns,) coordinates
    values : (frames, columns), where the sensor is there what it shows [rad]
    spread : (columns,) standard deviation of what the others leave open [rad]
    lost : (frames,) whether a sensor is lost
    """

    columns: Ints
    values: Array
    spread: Array
    lost: np.ndarray


class Seen(NamedTuple):
    """Poses, and which sensors reported.

    Attributes
    ----------
    values : (frames, coordinates) [rad or m]
    known : (frames, sensors) whether a sensor reported
    bodies : (sensors,) numbers of their bodies in the tree
    joints : (variables,) which free coordinates are angles of joints
    """

    values: Array
    known: np.ndarray
    bodies: Ints
    joints: np.ndarray


def joint_angles(tree: Tree, free: Ints) -> np.ndarray:
    """Select free coordinates that are angles of joints, not of the root.

    Parameters
    ----------
    tree : of the model
    free : (variables,) coordinates

    Returns
    -------
    (variables,)
    """
    floating = floating_coordinates(tree.model)
    coordinates = tree.model.coordinates
    return np.array(
        [
            coordinates[j].motion == "rotational" and coordinates[j].name not in floating
            for j in free
        ]
    )


def body_slopes(
    tree: Tree, problem: PoseProblem, values: Array, bodies: Ints, bounded: bool = True
) -> tuple[Array, Array]:
    """Compute rotations of bodies, and their slopes in the free coordinates.

    Parameters
    ----------
    tree : of the model
    problem : with the free coordinates
    values : (frames, coordinates) [rad or m]
    bodies : (bodies,) numbers in the tree
    bounded : whether slopes are 0 at bounds

    Returns
    -------
    (frames, bodies, 3, 3) rotations to ground, and (frames, bodies, 3, variables) rotation vectors
        [rad per rad or m]
    """
    poses, held = nudged_poses(tree, problem, values)
    rotations = poses.rotations[:, bodies].reshape(len(values), len(problem.free) + 1, -1, 3, 3)
    turned = rotations[:, 1:] @ np.swapaxes(rotations[:, :1], 3, 4)
    # Of a small rotation the skew part is its vector.
    skew = 0.5 * (turned - np.swapaxes(turned, 3, 4))
    steps = np.stack([skew[..., 2, 1], skew[..., 0, 2], skew[..., 1, 0]], axis=-1) / STEP
    if bounded:
        steps[held] = 0.0
    return rotations[:, 0], np.moveaxis(steps, 1, 3)


def undetermined(
    tree: Tree, problem: PoseProblem, seen: Seen, known: np.ndarray, frame: int
) -> np.ndarray:
    """Find free coordinates that the reporting sensors do not determine at a frame.

    They are those of whose usual variance the sensors explain less than `DETERMINED`.

    Parameters
    ----------
    tree : of the model
    problem : with the free coordinates
    seen : poses
    known : (sensors,) which report
    frame : number

    Returns
    -------
    (variables,)
    """
    _, slopes = body_slopes(
        tree, problem, seen.values[frame : frame + 1], seen.bodies, bounded=False
    )
    rows = slopes[0, known].reshape(-1, len(problem.free)) / NOISE
    left = np.linalg.inv(rows.T @ rows + np.eye(len(problem.free)) / USUAL**2)
    return np.asarray(1.0 - np.diag(left) / USUAL**2 < DETERMINED)


def likely_angles(tree: Tree, problem: PoseProblem, seen: Seen, time: Array) -> LikelyAngles | None:
    """Estimate coordinates of lost sensors by regression on those that the others determine.

    On these and their rates.

    Parameters
    ----------
    tree : of the model
    problem : with the free coordinates
    seen : poses, and which sensors reported
    time : (frames,) [s]

    Returns
    -------
    None where no sensor is lost, or it was not there for long enough to learn from
    """
    whole = np.asarray(seen.known.all(axis=1))
    ever = np.asarray(seen.known.any(axis=0))
    if whole.all() or not ever.all() or not whole.any():
        return None
    free = problem.free
    middle = int(np.flatnonzero(whole)[whole.sum() // 2])
    always = undetermined(tree, problem, seen, ever, middle)
    values = np.array(seen.values)
    blind_ever = np.zeros(len(free), dtype=bool)
    spread = np.zeros(len(free))
    for pattern in np.unique(seen.known[~whole], axis=0):
        # Where no sensor reports, nothing says what the body does.
        if not pattern.any():
            continue
        blind = undetermined(tree, problem, seen, pattern, middle) & ~always & seen.joints
        explaining = free[seen.joints & ~always & ~blind]
        X = _explaining(seen.values[:, explaining], time, whole)
        if not blind.any() or whole.sum() < MIN_FRAMES * X.shape[1]:
            continue
        Y = seen.values[:, free[blind]]
        regression = _regression(X[whole], Y[whole])
        frames = (seen.known == pattern).all(axis=1)
        values[np.ix_(frames, free[blind])] = (X @ regression.factors)[frames]
        spread[blind] = np.maximum(spread[blind], regression.residual)
        blind_ever |= blind
    if not blind_ever.any():
        return None
    columns = free[blind_ever]
    return LikelyAngles(
        columns=columns,
        values=values[:, columns],
        spread=np.maximum(spread[blind_ever], MIN_SPREAD),
        lost=~whole,
    )


class _Regression(NamedTuple):
    """Angles as linear functions of others.

    Attributes
    ----------
    factors : (explaining, explained)
    residual : (explained,) root mean square of what is left [rad]
    """

    factors: Array
    residual: Array


def _explaining(angles: Array, time: Array, whole: np.ndarray) -> Array:
    """Collect what explains angles: other angles and their rates, each less its mean, and 1.

    Parameters
    ----------
    angles : (frames, angles) [rad]
    time : (frames,) [s]
    whole : (frames,) of which the means are taken

    Returns
    -------
    (frames, 2 angles + 1)
    """
    rates = np.gradient(angles, time, axis=0)
    scaled = rates / np.maximum(rates.std(axis=0), MIN_RATE)
    columns = np.hstack((angles, scaled))
    centered = columns - columns[whole].mean(axis=0)
    return np.hstack((centered, np.ones((len(columns), 1))))


def _regression(X: Array, Y: Array) -> _Regression:
    """Solve the ridge regression (X^T X + R) B = X^T Y, the last column of X without ridge.

    Parameters
    ----------
    X : (frames, explaining)
    Y : (frames, explained) [rad]
    """
    normal = X.T @ X
    normal[np.diag_indices(len(normal) - 1)] += RIDGE * np.diag(normal)[:-1]
    factors = np.asarray(np.linalg.solve(normal, X.T @ Y), np.float64)
    residual = np.sqrt(np.mean((X @ factors - Y) ** 2, axis=0))
    return _Regression(factors=factors, residual=residual)
