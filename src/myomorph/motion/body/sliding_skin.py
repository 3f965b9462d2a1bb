"""Skin and markers that move as one piece on a segment: what it adds to the spread of a calibration.

The estimate takes every marker's noise for its own. Most of what skin does is a common shift and turn of all markers of
a segment (Barré et al. 2017), alike in poses that are alike, which no other marker of the segment shows. Its
weights stay as they are; the spread of the estimate is that of noise and slides together, (A^-1) M (A^-1).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from myomorph.model.arrays import Array
from myomorph.motion.body.angle_slopes import frame_slopes
from myomorph.motion.body.shared_problem import Point, SharedProblem


@dataclass(frozen=True)
class Slides:
    """Standard deviations of what all markers of a segment share while the body moves: along each axis [m] and about
    each axis through the markers' middle [rad]. Slides are alike from frame to frame: so many independent frames say as
    much as all.
    """

    shift: float
    turn: float
    independent_frames: int


def sliding(problem: SharedProblem, at: Point, slides: Slides) -> Array:
    """(unknowns + coordinates, same) covariance that slides give the gradient [m^2 per unknown] and the angles' means.

    A slide u of a segment's markers moves them by E u, and the gradient by J^T W E u, where J are the slopes with the
    angles at their best; the angles follow the markers as well. Slides of neighboring frames are alike: their sum
    counts as that of `independent_frames`.
    """
    unknowns, n = len(at.x), len(problem.lengths)
    size = unknowns + len(problem.posture)
    result = np.zeros((size, size))
    if slides.shift <= 0.0 and slides.turn <= 0.0:
        return result
    bodies, places = problem.pose.markers.body, problem.placed(at.x)
    modes = [_modes(places, bodies == body, slides) for body in np.unique(bodies)]
    frames = sum(len(angle) for angle in at.angles)
    alike = max(1.0, frames / slides.independent_frames)
    for frame in frame_slopes(problem, at):
        R = frame.rotations[bodies]
        moved = []
        for of, mode in modes:
            # (markers of the body, 3, modes) in their body; a marker's own shift has the body's rotation, too.
            moves = frame.weight[of][:, None, None] * mode
            ground = (R[of] @ moves).reshape(-1, mode.shape[2])
            rows = np.repeat(3 * of, 3) + np.tile(np.arange(3), len(of))
            both = np.zeros((size, mode.shape[2]))
            both[:n] = frame.by_length[rows].T @ ground
            both[n + rows] = moves.reshape(-1, mode.shape[2])
            both[: unknowns - 1] += frame.angles.T @ (frame.by_angle[rows].T @ ground)
            # A seen marker moved one way is its place moved the other way.
            both[unknowns + frame.free] = -frame.angles[:, n + rows] @ mode.reshape(-1, mode.shape[2]) / frames
            moved.append(both)
        every = np.hstack(moved)
        # A frame stands for `share * frames` of them where not all are looked at.
        result += alike * frame.share * frames * every @ every.T
    return result


def widened(spread: Array, variance: float, skin: Array, free: NDArray[np.bool_]) -> Array:
    """(unknowns, unknowns) covariance with what slides add; `spread` is that of noise and priors, variance * A^-1."""
    inner = np.where(free[:, None] & free, skin[: len(free), : len(free)], 0.0)
    return spread + spread @ inner @ spread / variance**2


def _modes(places: Array, of: NDArray[np.bool_], slides: Slides) -> tuple[NDArray[np.int64], Array]:
    """Markers of a body, and (markers, 3, 6) their moves in it: three shifts and three turns about their middle."""
    chosen = np.flatnonzero(of)
    apart = places[chosen] - places[chosen].mean(axis=0)
    shift = np.repeat(slides.shift * np.eye(3)[None], len(chosen), axis=0)
    turn = slides.turn * np.cross(np.eye(3)[None], apart[:, None]).transpose(0, 2, 1)
    return chosen, np.concatenate([shift, turn], axis=2)
