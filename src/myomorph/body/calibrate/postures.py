"""Frames of recordings that show most of a body before anything else is known."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from myomorph.body.calibrate.recorded import RecordedMarkers
from myomorph.core.fit.unknowns import Bools
from myomorph.core.model.arrays import Array
from myomorph.core.model.model import Model
from myomorph.core.model.series import Markers
from myomorph.core.motion.ik import InverseKinematicsOptions, inverse_kinematics
from myomorph.core.motion.lengths import length_unit
from myomorph.core.rigid.coordinates import Ints
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree

MAX_CANDIDATES = 1000  # Frames of all recordings that are looked at
MAX_MISFIT = 3.0  # Error of a frame, relative to the median, beyond which it is not chosen
MIN_SHOWN = 0.5  # Share of the largest number of markers below which a frame is not chosen
SAME_POSTURE = 0.01
"""Frames whose markers lie nearer to each other than this, root mean square, show the same posture
[length units].
"""


class ChosenFrames(NamedTuple):
    """Frames of one recording.

    Attributes
    ----------
    frames : (chosen,) their numbers, ascending
    angles : (chosen, coordinates) of inverse kinematics in them [rad or m]
    """

    frames: Ints
    angles: Array


class Candidates(NamedTuple):
    """Frames of all recordings that may be chosen, after inverse kinematics.

    Attributes
    ----------
    recording : (candidates,) number of the recording
    frame : (candidates,) number in it
    angles : (candidates, coordinates) [rad or m]
    postures : (candidates, 3 markers) the model's markers relative to its first body [m]
    error : (candidates,) root mean square distance of the markers [m]
    shown : (candidates,) number of markers that are seen
    """

    recording: Ints
    frame: Ints
    angles: Array
    postures: Array
    error: Array
    shown: Ints

    def usable(self) -> Ints:
        """Select candidates that fit about as well as usual and show enough markers.

        Returns
        -------
        (usable,) numbers of candidates
        """
        fits = self.error <= MAX_MISFIT * np.median(self.error)
        shows = self.shown >= MIN_SHOWN * self.shown.max()
        return np.flatnonzero(fits & shows)

    def of_recording(self, number: int, chosen: list[int]) -> ChosenFrames:
        """Collect the chosen frames of one recording.

        Parameters
        ----------
        number : of the recording
        chosen : numbers of candidates of all recordings

        Returns
        -------
        frames, ascending, with their angles
        """
        rows = [row for row in sorted(chosen) if self.recording[row] == number]
        frames = self.frame[rows].astype(np.int64)
        angles = self.angles[rows].reshape(-1, self.angles.shape[1])
        return ChosenFrames(frames=frames, angles=angles)


def spread_postures(
    model: Model, recorded: RecordedMarkers, frames: int
) -> tuple[ChosenFrames, ...]:
    """Choose the frames of all recordings whose postures differ most.

    A posture is where the model's markers lie relative to its first body, after inverse kinematics.
    The first frame is the one nearest to the mean posture, of the static trial if there is one.
    Then follows the frame farthest from all those chosen, until none differs by `SAME_POSTURE`: a
    second frame of a posture shows the same skin and the same errors of the model, so it must not
    count as evidence. Frames that fit three times worse than usual or show fewer than half the
    markers are not chosen. Of long recordings only `MAX_CANDIDATES` frames, evenly spaced, are
    considered.

    Parameters
    ----------
    model : of about the body's size
    recorded : recordings, and which markers count
    frames : at most so many are chosen

    Returns
    -------
    for each recording its chosen frames
    """
    candidates = _candidates(model, recorded, frames)
    usable = candidates.usable()
    first = np.ones(len(usable), np.bool_)
    if recorded.static:
        of_static = candidates.recording[usable] == len(recorded.recordings) - 1
        first = of_static if of_static.any() else first
    same = SAME_POSTURE * length_unit(compile_tree(model))
    rows = _farthest(candidates.postures[usable], frames, first, same)
    chosen = [int(usable[row]) for row in rows]
    return tuple(
        candidates.of_recording(number, chosen) for number in range(len(recorded.recordings))
    )


def _candidates(model: Model, recorded: RecordedMarkers, frames: int) -> Candidates:
    """Solve inverse kinematics of evenly spaced frames of all recordings.

    Parameters
    ----------
    frames : that are chosen in the end; at least twice as many are looked at
    """
    options = recorded.tracking
    total = sum(len(recording) for recording in recorded.recordings)
    stride = max(1, -(-total // max(MAX_CANDIDATES, 2 * frames)))
    parts = [
        _candidates_of(model, number, recording, stride, options)
        for number, recording in enumerate(recorded.recordings)
    ]
    return Candidates(
        recording=np.concatenate([part.recording for part in parts]),
        frame=np.concatenate([part.frame for part in parts]),
        angles=np.concatenate([part.angles for part in parts]),
        postures=np.concatenate([part.postures for part in parts]),
        error=np.concatenate([part.error for part in parts]),
        shown=np.concatenate([part.shown for part in parts]),
    )


def _candidates_of(
    model: Model, number: int, recording: Markers, stride: int, options: InverseKinematicsOptions
) -> Candidates:
    """Solve inverse kinematics of every `stride`-th frame of one recording."""
    looked = np.arange(0, len(recording), stride)
    fit = inverse_kinematics(model, recording.frames(looked), options)
    solved = np.isfinite(fit.motion.values).all(axis=1)
    angles = fit.motion.values[solved]
    return Candidates(
        recording=np.full(len(angles), number),
        frame=looked[solved],
        angles=angles,
        postures=seen_from_base(model, angles),
        error=fit.rms[solved],
        shown=np.isfinite(fit.marker_error[solved]).sum(axis=1),
    )


def seen_from_base(model: Model, angles: Array) -> Array:
    """Express the model's markers in the frame of its first body.

    Parameters
    ----------
    model : with markers
    angles : (frames, coordinates) [rad or m]

    Returns
    -------
    (frames, 3 markers) positions [m]
    """
    poses = forward_kinematics(compile_tree(model), angles)
    from_base = poses.markers(model.markers) - poses.origins[:, 1, None]
    local = np.einsum("fji,fmj->fmi", poses.rotations[:, 1], from_base)
    return local.reshape(len(angles), -1)


def _farthest(postures: Array, count: int, first: Bools, same: float) -> list[int]:
    """Choose rows that each lie as far as possible from those chosen before.

    Parameters
    ----------
    postures : (rows, 3 markers) positions [m]
    count : at most so many are chosen
    first : (rows,) those among which the first is chosen, the one nearest to their mean
    same : distance below which two rows are the same posture [m RMS]

    Returns
    -------
    rows, in the order of choice
    """
    min_square = same**2 * postures.shape[1] / 3.0
    from_mean = ((postures - postures[first].mean(axis=0)) ** 2).sum(axis=1)
    chosen = [int(np.argmin(np.where(first, from_mean, np.inf)))]
    nearest = ((postures - postures[chosen[0]]) ** 2).sum(axis=1)
    while len(chosen) < count and nearest.max() > min_square:
        chosen.append(int(np.argmax(nearest)))
        from_last = ((postures - postures[chosen[-1]]) ** 2).sum(axis=1)
        nearest = np.minimum(nearest, from_last)
    return chosen
