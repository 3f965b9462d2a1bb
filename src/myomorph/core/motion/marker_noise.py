"""Noise of coordinates, as the residuals of inverse kinematics show it.

Several markers on a segment distinguish their own noise, and the skin's, from the motion: what they
do not share stays in the residuals r, and moves the coordinates by

    dq = K e,    K = (J^T W J)^-1 J^T W,    r = (1 - J K) e

with the errors e of markers, their slopes J and weights W. The power of e at each frequency is that
of r over the share that residuals hold. What the skin of a segment does as one piece is in no
residual: it is taken to be as large as what is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.model import Model
from myomorph.core.model.series import Markers, Motion
from myomorph.core.motion.ik import InverseKinematicsOptions, pose_problem, tracked_markers
from myomorph.core.motion.marker_frames import marker_frames
from myomorph.core.rigid.kinematics import marker_positions
from myomorph.core.rigid.tree import Tree, compile_tree

SHARED = 1.5
"""Power of the errors of markers over that of their own: of the skin's movement about half moves
all markers of a segment alike, of the cameras' noise nothing does.
"""

MIN_SEEN = 0.9  # Share of the frames in which a marker is seen and in its place
MAX_DEVIATION = 8.0  # From a residual's median, over the median deviation; further off is no noise
MIN_LEFT = 0.2  # Share of errors that residuals hold, below which they show too little
DETERMINED = 1e-3  # Smaller directions of slopes, over the largest, move no marker
SAME_TIME = 0.1  # Of a step
LEAST = 1e-12  # [m]


@read_only
@dataclass(frozen=True, kw_only=True, eq=False)
class MarkerNoise:
    """Residuals of markers, and how errors of markers move coordinates.

    Attributes
    ----------
    residuals : (frames, rows) recorded less model, one row for each axis of a marker [m]
    carried : (coordinates, rows) K, of the motion's coordinates [rad/m or 1]
    left : share of the power of errors that residuals hold
    """

    residuals: Array
    carried: Array
    left: float

    def power(self, of_residuals: Array, rows: Array | None = None) -> Array:
        """Compute the power of the noise of coordinates, and of sums of them.

        Parameters
        ----------
        of_residuals : (bins, rows of markers) power of the residuals [m^2/Hz]
        rows : (sums, coordinates) weights of the sums

        Returns
        -------
        (bins, coordinates + sums)
        """
        carried = self.carried if rows is None else np.vstack([self.carried, rows @ self.carried])
        return np.asarray(SHARED / self.left * of_residuals @ np.square(carried).T)


def marker_noise(
    model: Model, motion: Motion, markers: Markers, options: InverseKinematicsOptions | None = None
) -> MarkerNoise | None:
    """Find what residuals of markers say about the noise of coordinates.

    Parameters
    ----------
    model : with markers
    motion : as inverse kinematics gave it, without gaps
    markers : as recorded; frames that the motion lacks are left out
    options : weights of inverse kinematics

    Returns
    -------
    None where they say nothing: other times, or too few markers
    """
    frames = _frames_at(markers.time, motion.time)
    if frames is None or not set(model.marker_names) & set(markers.names):
        return None
    options = InverseKinematicsOptions(
        marker_weights={} if options is None else options.marker_weights,
        only_weighted=options is not None and options.only_weighted,
    )
    names, weights = tracked_markers(model, markers, options)
    residuals = _without_outliers(_residuals(model, motion, markers, frames, names))
    steady = np.isfinite(residuals).all(axis=2).mean(axis=0) >= MIN_SEEN
    if not steady.any():
        return None
    kept = tuple(name for name, is_steady in zip(names, steady, strict=True) if is_steady)
    slopes = _slopes(compile_tree(model), kept, weights[steady], motion)
    to_free = slopes.inverse(weights[steady])
    left = 1.0 - float(np.einsum("ij,ji->", slopes.matrix, to_free)) / len(slopes.matrix)
    if left < MIN_LEFT:
        return None
    carried = np.zeros((len(motion.names), len(slopes.matrix)))
    for row, name in zip(to_free, slopes.coordinates, strict=True):
        if name in motion.names:
            carried[motion.names.index(name)] = row
    filled = _bridged(residuals[:, steady])
    return MarkerNoise(residuals=filled.reshape(len(motion), -1), carried=carried, left=left)


def _residuals(
    model: Model, motion: Motion, markers: Markers, frames: np.ndarray, names: tuple[str, ...]
) -> Array:
    """Subtract the model's markers from the recorded ones.

    Parameters
    ----------
    model, motion : whose markers are posed
    markers : as recorded
    frames : (frames,) of the recording, at the motion's times
    names : of the markers

    Returns
    -------
    (frames, markers, 3) [m], NaN where unseen
    """
    observed = markers.values[frames][:, [markers.names.index(name) for name in names]]
    posed = marker_positions(model, motion)
    return observed - posed.values[:, [posed.names.index(name) for name in names]]


@read_only
@dataclass(frozen=True, kw_only=True, eq=False)
class _Slopes:
    """Slopes of markers at the middle pose.

    Attributes
    ----------
    coordinates : names of those that are free
    matrix : (rows of markers, free coordinates) J [m/rad or 1]
    """

    coordinates: tuple[str, ...]
    matrix: Array

    def inverse(self, weights: Array) -> Array:
        """Compute K for weights (markers,): (free coordinates, rows of markers)."""
        scale = np.repeat(np.sqrt(weights), 3)
        return np.linalg.pinv(scale[:, None] * self.matrix, rcond=DETERMINED) * scale


def _slopes(tree: Tree, names: tuple[str, ...], weights: Array, motion: Motion) -> _Slopes:
    """Compute the slopes of markers (markers,) with weights (markers,) in the motion's middle."""
    middle = len(motion) // 2
    pose = tree.coordinates_of(motion)[middle : middle + 1]
    nowhere = Markers(motion.time[:1], names, np.zeros((1, len(names), 3)))
    problem = pose_problem(tree, names, weights, InverseKinematicsOptions(), nowhere)
    slopes = marker_frames(tree, problem, nowhere.values, pose).slopes[0]
    coordinates = tree.model.coordinate_names
    return _Slopes(
        coordinates=tuple(coordinates[index] for index in problem.free),
        matrix=slopes.reshape(3 * len(names), -1),
    )


def _frames_at(time: Array, wanted: Array) -> np.ndarray | None:
    """Find the frames (n,) of a clock at wanted times (n,) [s], None where some are not there."""
    if not len(time) or len(wanted) < 2:
        return None
    after = np.searchsorted(time, wanted).clip(1, max(len(time) - 1, 1))
    frames = np.where(wanted - time[after - 1] < time[after] - wanted, after - 1, after)
    step = float(wanted[1] - wanted[0])
    return frames if np.abs(time[frames] - wanted).max() < SAME_TIME * step else None


def _without_outliers(residuals: Array) -> Array:
    """Hide residuals (frames, markers, 3) of markers that are not in their place [m]."""
    if not np.isfinite(residuals).any():
        return residuals
    known = np.isfinite(residuals)
    unseen = ~known.any(axis=0)
    middle = np.nanmedian(np.where(unseen, 0.0, residuals), axis=0)
    filled = np.where(known, residuals, middle)
    away = np.linalg.norm(filled - middle, axis=2)
    usual = np.median(away, axis=0)
    near = away <= MAX_DEVIATION * np.maximum(usual, LEAST)
    return np.where(near[:, :, None], residuals, np.nan)


def _bridged(residuals: Array) -> Array:
    """Fill gaps of residuals (frames, markers, 3) [m] by Akima's cubics."""
    known: np.ndarray = np.asarray(np.isfinite(residuals).all(axis=2))
    if known.all():
        return residuals
    filled = residuals.copy()
    frames = np.arange(len(residuals))
    for marker in np.flatnonzero(~known.all(axis=0)):
        seen = np.flatnonzero(known[:, marker])
        inside = frames.clip(seen[0], seen[-1])
        spline = scipy.interpolate.Akima1DInterpolator(seen, residuals[seen, marker])
        filled[:, marker] = spline(inside)
    return filled
