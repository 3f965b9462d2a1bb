"""What each marker says against all others: where they would put it, and what no marker determines."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from myomorph.model.arrays import Array, read_only
from myomorph.motion.pose_problem import PoseProblem
from myomorph.rigid.couplers import couple_frames
from myomorph.rigid.kinematics import forward_kinematics
from myomorph.rigid.tree import Tree

STEP = 1e-6
"""Of the differences that give the slopes of marker positions [rad or m]."""

UNKNOWN = 0.15
"""A direction of a marker of which the others determine a smaller share has no prediction."""

BLIND = 1e-5
"""A direction of the coordinates that moves the markers by a smaller share of the usual is not determined."""


@read_only
@dataclass(frozen=True, eq=False)
class MarkerFrames:
    """Markers of some frames against a model's pose: recorded less model (frames, markers, 3) [m] in ground, NaN where
    unseen; slopes (..., variables) of model positions; rotations (..., 3, 3) of the markers' bodies; `held` (frames,
    variables), whether each lies at a bound, so that it has no slopes.
    """

    errors: Array
    slopes: Array
    rotations: Array
    held: np.ndarray


def marker_frames(tree: Tree, problem: PoseProblem, observed: Array, values: Array) -> MarkerFrames:
    """Errors of markers (frames, markers, 3) [m] and slopes at poses (frames, coordinates); variables at a bound do not
    move.
    """
    frames, count = len(values), len(problem.free)
    stacked = np.repeat(values[:, None], count + 1, axis=1)
    for i, j in enumerate(problem.free):
        stacked[:, i + 1, j] += STEP * problem.unit[j]
    flat = np.ascontiguousarray(stacked.reshape(-1, values.shape[1]))
    couple_frames(tree.arrays, flat)
    poses = forward_kinematics(tree, flat)
    points = poses.points(problem.markers.body, problem.markers.location).reshape(frames, count + 1, -1, 3)
    slopes = (points[:, 1:] - points[:, :1]) / STEP
    here = values[:, problem.free]
    held = (here <= problem.lower + 1e-9) | (here >= problem.upper - 1e-9)
    slopes[held] = 0.0
    rotations = poses.rotations.reshape(frames, count + 1, -1, 3, 3)[:, 0, problem.markers.body]
    return MarkerFrames(observed - points[:, 0], np.moveaxis(slopes, 1, 3), rotations, held)


def left_out(marker_frames: MarkerFrames, weight: Array) -> Array:
    """(frames, markers, 3) how far each marker lies from where all others would put it, in its body's frame [m].

    By the leverage h of a marker in the linear problem: (1 - h)^-1 e, without the directions that others hardly tell;
    NaN where a marker is unseen or none is told.
    """
    frames, markers = marker_frames.errors.shape[:2]
    result = np.full((frames, markers, 3), np.nan)
    for f in range(frames):
        seen = np.flatnonzero(np.isfinite(marker_frames.errors[f]).all(axis=1) & (weight > 0.0))
        if len(seen) < 2:
            continue
        scale = np.sqrt(weight[seen])[:, None, None]
        rows = (marker_frames.slopes[f, seen] * scale).reshape(3 * len(seen), -1)
        basis, sizes, _ = np.linalg.svd(rows, full_matrices=False)
        basis = basis[:, sizes > 1e-6 * sizes.max(initial=0.0)].reshape(len(seen), 3, -1)
        rest = np.eye(3) - np.einsum("mik,mjk->mij", basis, basis)
        eigenvalues, axes = np.linalg.eigh(rest)
        inverse = np.where(eigenvalues > UNKNOWN, 1.0 / np.maximum(eigenvalues, UNKNOWN), 0.0)
        away = np.einsum("mij,mj,mkj,mk->mi", axes, inverse, axes, marker_frames.errors[f, seen])
        away[(eigenvalues <= UNKNOWN).sum(axis=1) > 1] = np.nan
        result[f, seen] = np.einsum("mji,mj->mi", marker_frames.rotations[f, seen], away)
    return result


def undetermined(marker_frames: MarkerFrames, problem: PoseProblem, weight: Array) -> tuple[int, ...]:
    """Coordinates that take part in a motion that no marker of any of the frames shows."""
    seen = np.isfinite(marker_frames.errors).all(axis=2) & (weight > 0.0)
    rows = marker_frames.slopes[seen].reshape(-1, len(problem.free))
    sizes, directions = np.linalg.eigh(rows.T @ rows)
    usual = np.median(sizes[sizes > 0.0]) if (sizes > 0.0).any() else 1.0
    blind = directions[:, sizes < BLIND**2 * usual]
    part = np.abs(blind).max(axis=1, initial=0.0)
    # A variable at its bound in all frames is determined by the bound.
    blind_variables = [i for i in range(len(problem.free)) if part[i] > 0.3 and not marker_frames.held[:, i].all()]
    return tuple(int(problem.free[i]) for i in blind_variables if problem.coordinates.weight[problem.free[i]] == 0.0)
