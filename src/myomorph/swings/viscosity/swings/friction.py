"""Dry friction of a joint in its swings."""

from __future__ import annotations

import numpy as np

from myomorph.core.model.arrays import Array, runs
from myomorph.core.motion.filters import lowpass
from myomorph.swings.viscosity.swings.recording import SwingRecording

FINER = 10  # Instants between two frames at which the sign of a rate is taken, before the filter.
WIDTH = 0.03
"""Rate within which friction turns its sign, before the filter: about the noise of a rate, which
hides the sign of a slower one. Held-out swings of virtual limbs are predicted best with it [rad/s].
"""
FRICTIONS = ("against the motion", "about each axis")
"""A ball rubs against the direction of its angular velocity, or about each of its axes alike."""


def friction_rows(recording: SwingRecording) -> Array:
    """Find the torque of `FRICTIONS` of 1 N m against the motion, through the motion's low-pass.

    Parameters
    ----------
    recording : of a swing

    Returns
    -------
    (frames, axes, 2) [N m]
    """
    result = np.zeros((*recording.rates.shape, len(FRICTIONS)))
    known = np.asarray(np.isfinite(recording.rates).all(axis=1))
    for start, stop in runs(known):
        rates = recording.rates[start:stop]
        frames = np.arange(len(rates))
        instants = np.arange((len(rates) - 1) * FINER + 1) / FINER
        fine = np.stack([np.interp(instants, frames, rate) for rate in rates.T], axis=1)
        speed = np.linalg.norm(fine, axis=1)[:, None]
        against_motion = fine / np.hypot(speed, WIDTH)
        about_axes = fine / np.hypot(fine, WIDTH)
        rubbing = np.concatenate([against_motion, about_axes], axis=1)
        if recording.cutoff and len(rates) > 1:
            rate = FINER / float(np.median(np.diff(recording.time[start:stop])))
            rubbing = lowpass(rubbing, rate, recording.cutoff)
        by_friction = rubbing[::FINER].reshape(len(rates), len(FRICTIONS), -1)
        result[start:stop] = by_friction.transpose(0, 2, 1)
    return result
