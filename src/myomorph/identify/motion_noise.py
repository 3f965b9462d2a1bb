"""What noise of the motion does to identified masses: the regressor is made of coordinates that were measured too.

Noise of the coordinates, filtered as they are, is added to them once more and the rows are made again. How the estimate
moves is what the noise that is there already did to it, to first order of its variance: the first step of SIMEX (Cook
and Stefanski 1994, Journal of the American Statistical Association 89:1314).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from scipy.signal import butter, sosfiltfilt

from myomorph.identify.base_parameters import BaseParameters
from myomorph.identify.least_squares import Recording
from myomorph.identify.parts import parts_of
from myomorph.model.arrays import Array
from myomorph.model.errors import BadData
from myomorph.model.model import Model
from myomorph.model.series import Motion
from myomorph.motion.filters import differentiate

DRAWS = 8
"""Times that noise is added."""

CUTOFF = 6.0
"""Of the filter of motions that came filtered already [Hz]."""

STILL = 1e-6
"""Coordinates that move by less are locked or coupled to nothing: they get no noise [rad or m]."""


def noisy_rows(
    model: Model,
    recordings: Sequence[Recording],
    base: BaseParameters,
    noise: Array,
    sd: float,
    cutoff: float | None = None,
    draws: int = DRAWS,
) -> Iterator[tuple[Array, Array]]:
    """(A, b) as `Parts.rows`, from motions with more noise than was measured.

    Parameters
    ----------
    noise : (2,) of moments and forces [N m], [N]
    sd : of the noise of a coordinate after filtering [rad or m]
    cutoff : of its low-pass filter [Hz]; `CUTOFF` where None
    """
    random = np.random.default_rng(0)
    for _ in range(draws):
        made = [replace(one, motion=noisy(one.motion, sd, cutoff or CUTOFF, random)) for one in recordings]
        yield parts_of(model, made, base, least=1).rows(noise)


def noisy(motion: Motion, sd: float, cutoff: float, random: np.random.Generator) -> Motion:
    """A motion with low-passed noise of a given standard deviation on every coordinate that moves.

    Raises
    ------
    BadData : the motion has no derivatives
    """
    rate = 1.0 / float(np.median(np.diff(motion.time)))
    white = random.normal(size=motion.values.shape)
    if 2.0 * cutoff < 0.95 * rate and len(white) > 30:
        white = sosfiltfilt(butter(2, cutoff, fs=rate, output="sos"), white, axis=0)
    seen = np.where(np.isfinite(motion.values), motion.values, np.nanmean(motion.values, axis=0))
    moving = np.ptp(seen, axis=0) > STILL
    added = white * (sd * moving / white.std(axis=0))
    # The noise is differentiated by itself: derivatives of the motion stay those of its own filter.
    extra = differentiate(Motion(motion.time, motion.names, added), None)
    if motion.velocities is None or motion.accelerations is None:
        raise BadData("noise can be added to a motion with derivatives only: differentiate it first")
    return replace(
        motion,
        values=motion.values + extra.values,
        velocities=motion.velocities + np.asarray(extra.velocities, float),
        accelerations=motion.accelerations + np.asarray(extra.accelerations, float),
    )
