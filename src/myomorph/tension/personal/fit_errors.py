"""Errors of torques and of EMG, estimated from the misfits of recordings; see `fit`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from myomorph.model.arrays import Array
from myomorph.tension.personal.fit_part import Noise, Part, frame_products

REST_ERROR, REST_FLOOR = 0.01, 0.1
"""Least standard deviation of a measured passive torque: a share of its root mean square, and in N m or N."""
SCALES = (0.1, 9.0)
"""Within which the variances of activations are adjusted to the misfits."""
HASTE, CHANGES = 2.0, (0.6, 1.25)
"""Power of the steps by which errors change, and the least and largest factor of a step."""
MAX_ERROR = 0.5
"""Of the root mean square of a torque: more of it is not taken for an error."""


def noise_of(parts: Sequence[Part], noise: Noise, floors: Array, covariance: Array) -> Noise:
    """Errors of torques and of EMG as their means given the misfits (a step of expectation and maximization)."""
    moving = [part for part in parts if not part.rest]
    if not moving:
        return noise
    squares, carried, frames = np.zeros(len(noise.torque)), np.zeros(len(noise.torque)), 0
    apart, known = 0.0, 0.0
    for part in moving:
        among, mean_squares = torque_errors(part, covariance)
        squares += mean_squares
        carried += np.sum(part.torques**2, axis=0)
        frames += len(part.error)
        free = part.measured[part.windows.counted] & (part.variance > 0.0)
        moved = frame_products(part.gain.transpose(0, 2, 1), part.error)
        after = part.variance - part.variance * np.einsum("frm,frm->fm", part.gain, part.columns)
        after = after + np.einsum("frm,frm->fm", part.gain, among @ part.gain)
        own = np.where(free, part.variance, 1.0) / noise.emg
        apart += float(np.sum(np.where(free, (moved**2 + after) / own, 0.0)))
        known += float(free.sum())
    most = np.maximum(MAX_ERROR**2 * carried / frames, floors**2)
    torque = np.sqrt(np.clip(squares / frames, floors**2, most))
    emg = float(np.clip(apart / known, *SCALES)) if known else 1.0
    return replace(noise, torque=torque, emg=emg)


def hastened(old: Noise, new: Noise, floors: Array, floors_at_rest: Array) -> Noise:
    """A longer step of expectation and maximization, whose own steps are short where much of a misfit is errors'.

    Upwards it is a short one: a misfit that the parameters have yet to follow is no error.
    """
    torque, rest, emg = (
        one * np.clip((other / one) ** HASTE, *CHANGES)
        for one, other in ((old.torque, new.torque), (old.rest, new.rest), (old.emg, new.emg))
    )
    return Noise(np.maximum(torque, floors), np.maximum(rest, floors_at_rest), float(np.clip(emg, *SCALES)))


def torque_errors(part: Part, covariance: Array) -> tuple[Array, Array]:
    """What parameters leave open of each frame's torques (frames, rows, rows), and summed squares of errors (rows,)."""
    solved = np.asarray(np.linalg.inv(part.covariance), dtype=np.float64)
    # What the parameters leave open is no part of the errors, but of what is known of them.
    among = part.slopes @ covariance @ part.slopes.transpose(0, 2, 1)
    by_torque = part.of_torque[..., None] * solved
    mean = frame_products(by_torque, part.error)
    left = part.of_torque - part.of_torque * np.einsum("frr->fr", by_torque)
    left += np.einsum("frs,fst,frt->fr", by_torque, among, by_torque)
    return among, np.sum(np.where(part.known, mean**2 + left, 0.0), axis=0)


def floors_of_rest(parts: Sequence[Part], floors: Array) -> Array:
    """(rows,) least error of measured passive torques [N m or N]."""
    still = [part for part in parts if part.rest]
    if not still:
        return np.full(len(floors), REST_FLOOR)
    counts = np.maximum(np.sum([recording.known.sum(axis=0) for recording in still], axis=0), 1)
    squares = np.sum([np.sum(recording.torques**2, axis=0) for recording in still], axis=0)
    return np.maximum(np.minimum(REST_FLOOR, floors), REST_ERROR * np.sqrt(squares / counts))


def noise_at_rest(parts: Sequence[Part], noise: Noise, floors: Array, covariance: Array) -> Noise:
    """Errors of measured passive torques, among them what is no muscle's: ligaments, capsules, the poses' errors."""
    still = [part for part in parts if part.rest]
    if not still:
        return noise
    counts = np.sum([recording.known.sum(axis=0) for recording in still], axis=0)
    squares = np.sum([torque_errors(recording, covariance)[1] for recording in still], axis=0)
    rest = np.sqrt(squares / np.maximum(counts, 1))
    return replace(noise, rest=np.where(counts > 0, np.maximum(rest, floors), floors))
