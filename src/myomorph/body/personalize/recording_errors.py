"""Errors of torques and EMG, estimated from the misfits by expectation and maximization.

    var(e_tau) = mean of E[e_tau^2 | recordings],   E[e_tau | r] = var(e_tau) S^-1 r

What the parameters leave open is no part of the errors, but of what is known of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from myomorph.body.personalize.activations import frame_products
from myomorph.body.personalize.recorded import Recorded
from myomorph.body.personalize.recording_at import Noise, RecordingAt
from myomorph.core.model.arrays import Array, read_only

REST_ERROR = 0.01
REST_FLOOR = 0.1
"""Least standard deviation of a measured passive torque: a share of its root mean square, and in N
m or N.
"""
SCALES = (0.1, 9.0)  # Within which the variances of activations are adjusted to the misfits
HASTE = 2.0
CHANGES = (0.6, 1.25)
"""Power of the steps by which errors change, and the least and largest factor of a step."""
MAX_ERROR = 0.5  # Of the root mean square of a torque: more of it is not taken for an error


@read_only
class Floors:
    """Least standard deviations of torques, (rows,) each [N m or N].

    Attributes
    ----------
    torque : of inverse dynamics
    rest : of measured passive torques
    """

    torque: Array
    rest: Array

    @classmethod
    def of(cls, recordings: Sequence[Recorded], torque: Array) -> Floors:
        """Find those at rest beside those in motion.

        Parameters
        ----------
        recordings : all of them
        torque : (rows,) in motion [N m or N]

        Returns
        -------
        both
        """
        still = [recording for recording in recordings if recording.at_rest]
        if not still:
            return cls(torque=torque, rest=np.full(len(torque), REST_FLOOR))
        counts = np.sum([recording.known.sum(axis=0) for recording in still], axis=0)
        squares = np.sum([np.sum(recording.torques**2, axis=0) for recording in still], axis=0)
        carried = np.sqrt(squares / np.maximum(counts, 1))
        rest = np.maximum(np.minimum(REST_FLOOR, torque), REST_ERROR * carried)
        return cls(torque=torque, rest=rest)


def better_noise(
    parts: Sequence[RecordingAt], noise: Noise, floors: Floors, covariance: Array
) -> Noise:
    """Take one lengthened step of expectation and maximization.

    Its own steps are short where much of a misfit is errors'. Upwards it is a short one: a misfit
    that the parameters have yet to follow is no error.

    Parameters
    ----------
    parts : linearized recordings
    noise : before
    floors : least standard deviations of torques
    covariance : (parameters, parameters) after the recordings

    Returns
    -------
    noise
    """
    moving = [part for part in parts if not part.recorded.at_rest]
    still = [part for part in parts if part.recorded.at_rest]
    new = noise
    if moving:
        new = _in_motion(moving, new, floors.torque, covariance)
    if still:
        new = _at_rest(still, new, floors.rest, covariance)
    torque = noise.torque * _hastened(new.torque / noise.torque)
    rest = noise.rest * _hastened(new.rest / noise.rest)
    emg = noise.emg * _hastened(new.emg / noise.emg)
    return Noise(
        torque=np.maximum(torque, floors.torque),
        rest=np.maximum(rest, floors.rest),
        emg=float(np.clip(emg, *SCALES)),
    )


def _hastened(ratio: Array | float) -> Array:
    """Lengthen the factor of a step."""
    return np.clip(ratio**HASTE, *CHANGES)


class _TorqueErrors(NamedTuple):
    """Errors of torques of one recording.

    Attributes
    ----------
    open : (frames, rows, rows) covariance of each frame's torques from the parameters [(N m)^2 or
        N^2]
    squares : (rows,) summed squares of errors
    """

    open: Array
    squares: Array


def _torque_errors(part: RecordingAt, covariance: Array) -> _TorqueErrors:
    """Compute what parameters leave open of torques, and squared errors of the torques.

    Parameters
    ----------
    part : a linearized recording
    covariance : (parameters, parameters) after the recordings
    """
    variance = part.torques.variance
    inverse = np.asarray(np.linalg.inv(part.marginal.covariance), dtype=np.float64)
    left_open = part.slopes @ covariance @ part.slopes.transpose(0, 2, 1)
    by_torque = variance[..., None] * inverse
    mean = frame_products(by_torque, part.marginal.error)
    spread = variance - variance * np.einsum("frr->fr", by_torque)
    spread += np.einsum("frs,fst,frt->fr", by_torque, left_open, by_torque)
    squares = np.sum(np.where(part.recorded.known, mean**2 + spread, 0.0), axis=0)
    return _TorqueErrors(open=left_open, squares=squares)


def _in_motion(
    parts: Sequence[RecordingAt], noise: Noise, floors: Array, covariance: Array
) -> Noise:
    """Estimate errors of torques and of EMG as their means given the misfits.

    Parameters
    ----------
    parts : linearized recordings in motion
    noise : before
    floors : (rows,) least standard deviation of the torques [N m or N]
    covariance : (parameters, parameters) after the recordings

    Returns
    -------
    noise with other errors of torques and EMG
    """
    squares = np.zeros(len(noise.torque))
    carried = np.zeros(len(noise.torque))
    frames = 0
    of_activations = 0.0
    with_emg = 0.0
    for part in parts:
        errors = _torque_errors(part, covariance)
        squares += errors.squares
        carried += np.sum(part.recorded.torques**2, axis=0)
        frames += len(part.torques.left)
        free = part.recorded.measured & (part.marginal.variance > 0.0)
        of_activations += _activation_errors(part, errors.open, free, noise.emg)
        with_emg += float(free.sum())
    most = np.maximum(MAX_ERROR**2 * carried / frames, floors**2)
    torque = np.sqrt(np.clip(squares / frames, floors**2, most))
    emg = float(np.clip(of_activations / with_emg, *SCALES)) if with_emg else 1.0
    return replace(noise, torque=torque, emg=emg)


def _activation_errors(
    part: RecordingAt, left_open: Array, free: np.ndarray, emg_variance: float
) -> float:
    """Sum squared errors of activations with EMG, in units of what EMG is assumed to show.

    Parameters
    ----------
    part : a linearized recording
    left_open : (frames, rows, rows) covariance of torques from the parameters
    free : (frames, muscles) with EMG and at no bound
    emg_variance : factor on the variance that EMG shows, as it is now
    """
    marginal = part.marginal
    gain = marginal.gain
    moved = frame_products(gain.transpose(0, 2, 1), marginal.error)
    after = marginal.variance - marginal.variance * np.einsum(
        "frm,frm->fm", gain, part.torques.columns
    )
    after = after + np.einsum("frm,frm->fm", gain, left_open @ gain)
    assumed = np.where(free, marginal.variance, 1.0) / emg_variance
    return float(np.sum(np.where(free, (moved**2 + after) / assumed, 0.0)))


def _at_rest(parts: Sequence[RecordingAt], noise: Noise, floors: Array, covariance: Array) -> Noise:
    """Estimate errors of measured passive torques.

    Among them is what is no muscle's: ligaments, capsules, the poses' errors.

    Parameters
    ----------
    parts : linearized recordings at rest
    noise : before
    floors : (rows,) least errors at rest [N m or N]
    covariance : (parameters, parameters) after the recordings

    Returns
    -------
    noise with other errors at rest
    """
    counts = np.sum([part.recorded.known.sum(axis=0) for part in parts], axis=0)
    squares = np.sum([_torque_errors(part, covariance).squares for part in parts], axis=0)
    rest = np.sqrt(squares / np.maximum(counts, 1))
    return replace(noise, rest=np.where(counts > 0, np.maximum(rest, floors), floors))
