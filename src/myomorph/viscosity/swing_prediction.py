"""What the state of a free swing predicts of its acceleration, without differentiating markers twice.

A rigid limb on a joint with linear spring and damper accelerates by I^-1 (m c x g - omega x I omega - d omega
- k theta): linear in the direction of gravity, the products of the rates, the rates and the angles. The fit of
the measured acceleration to these has hardly any of its noise, and what it has is not that of the acceleration
at the same instant. Rows with it are the instruments of step 1 (Janot, Vandanjon, Gautier 2014): least squares
on the rows themselves draws the parameters towards zero, because noise in a row counts as motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from myomorph.model.arrays import Array
from myomorph.viscosity.swings import SwingRecording

STILL, EXPLAINED = 0.1, 0.8
"""A direction is still whose rate is below this share of the fastest's and whose acceleration the state explains less
than this. Only noise is measured there; it would say that the inertia is small, and a possible body's other inertias
with it. White noise below a cutoff explains 0.56 of its own second derivative."""


def free_directions(recordings: Sequence[SwingRecording]) -> Array:
    """(axes, 3) the free axes in the limb's first body."""
    left, right = np.zeros((3, 3)), np.zeros((3, len(recordings[0].axes)))
    for one in recordings:
        moments, rows = moment_rows(one)[one.used], one.torque_rows[one.used]
        left += np.einsum("fip,fjp->ij", moments, moments, optimize=True)
        right += np.einsum("fip,fap->ia", moments, rows, optimize=True)
    return np.asarray(np.linalg.lstsq(left, right, rcond=1e-12)[0].T, np.float64)


def moment_rows(one: SwingRecording) -> Array:
    """(frames, 3, 10) moment about the joint's center that unit parameters need, along the limb's axes."""
    rows: Array = one.rotations.transpose(0, 2, 1) @ one.wrench_rows[:, :3]
    return rows


class PredictedRows(NamedTuple):
    """The wrench rows of a recording and their instruments, (frames, 6, 10) each.

    Attributes
    ----------
    rows : `wrench_rows` without the acceleration of directions in which the limb is still
    instruments : the same rows with the acceleration that the state predicts
    """

    rows: Array
    instruments: Array


def predicted_rows(recordings: Sequence[SwingRecording], frames: Sequence[np.ndarray]) -> list[PredictedRows]:
    """Rows of every recording with the measured and with the predicted acceleration.

    Parameters
    ----------
    frames : of each recording, those that take part in the fit
    """
    along = free_directions(recordings)
    states = [_state(one) for one in recordings]
    # The columns of I_xx, I_yy, I_zz hold the angular acceleration about x, y, z.
    measured = [moment_rows(one)[:, [0, 1, 2], [4, 5, 6]] @ along.T for one in recordings]
    A = np.concatenate([state[use] for state, use in zip(states, frames, strict=True)])
    b = np.concatenate([one[use] for one, use in zip(measured, frames, strict=True)])
    size = np.sqrt(np.square(A).mean(axis=0))
    size = np.where(size > 0.0, size, 1.0)
    law = np.linalg.lstsq(A / size, b, rcond=1e-9)[0] / size[:, None]
    rates = np.concatenate([one.rates[use] for one, use in zip(recordings, frames, strict=True)])
    still = _still(rates, b, A @ law)
    turning = np.eye(len(still)) - still
    found = []
    for one, state, seen in zip(recordings, states, measured, strict=True):
        rows = one.wrench_rows - _rows_of(one.rotations, seen @ still @ along)
        change = (state @ law - seen) @ turning
        found.append(PredictedRows(rows, rows + _rows_of(one.rotations, change @ along)))
    return found


def _still(rates: Array, measured: Array, predicted: Array) -> Array:
    """(axes, axes) projection on the directions in which the limb is still."""
    squares, directions = np.linalg.eigh(rates.T @ rates)
    seen, left = (np.square(one @ directions).sum(axis=0) for one in (measured, measured - predicted))
    still = directions[:, (squares < STILL**2 * squares[-1]) & (left > (1.0 - EXPLAINED) * seen)]
    projection: Array = still @ still.T
    return projection


def _state(one: SwingRecording) -> Array:
    """(frames, n) direction of gravity, rates, products of rates, angles and a one."""
    down = np.einsum("fji,j->fi", one.rotations, one.gravity)
    first, second = np.triu_indices(one.rates.shape[1])
    products = one.rates[:, first] * one.rates[:, second]
    return np.concatenate([down, one.rates, products, one.angles, np.ones((len(one), 1))], axis=1)


def _rows_of(rotations: Array, accelerations: Array) -> Array:
    """(frames, 6, 10) part of the rows that angular accelerations (frames, 3) in the limb make."""
    x, y, z = accelerations.T
    rows = np.zeros((len(rotations), 6, 10))
    moment, force = rows[:, :3], rows[:, 3:]
    for column, entries in enumerate(
        (((0, x),), ((1, y),), ((2, z),), ((1, z), (2, y)), ((0, z), (2, x)), ((0, y), (1, x)))
    ):
        for axis, value in entries:
            moment[:, axis, 4 + column] = value
    force[:, 0, 2], force[:, 0, 3], force[:, 1, 1] = -z, y, z
    force[:, 1, 3], force[:, 2, 1], force[:, 2, 2] = -x, -y, x
    return np.concatenate([rotations @ moment, rotations @ force], axis=1)
