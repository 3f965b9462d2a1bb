"""Gains of EMG that torques do not tell are usual ones, and so is the level of all where only priors would move it."""

from __future__ import annotations

import numpy as np

from myomorph.model.arrays import Array
from myomorph.motion.emg_delay import DOUBT
from myomorph.tension.emg_groups import TOLD
from myomorph.tension.emg_tracking import NEAR_MAXIMUM, Fit, Prior, TorqueTracking

HELD = 1e6
"""Precision of the logarithm of a gain that is held."""


def kept_level(tracking: TorqueTracking, level: Prior, delays: Array, shapes: Array) -> Prior:
    """The prior of gains: that in which all share a usual level, unless torques are more likely otherwise.

    Muscles without EMG are expected to work as those beside them. Where hardly anything else says how large gains
    are (contact forces that nobody measured), that alone would make them small.

    `level`: the prior whose common level is known; `tracking` has the one whose level is not.
    """
    wide = tracking.prior
    free = tracking.fit(delays, shapes)
    tracking.prior = level
    kept = tracking.fit(delays, shapes)
    tracking.prior = wide
    return wide if kept.misfit - free.misfit > DOUBT else level


def settled_fit(tracking: TorqueTracking, wide: Prior, delays: Array, shapes: Array) -> Fit:
    """The most probable gains, where those that torques do not tell are the usual ones beside those that they do.
    `wide`: the prior whose common level is not known, for the deviations.
    """
    prior = tracking.prior
    tracking.prior = wide
    deviation = tracking.fit(delays, shapes).deviation
    tracking.prior = prior
    fit = tracking.fit(delays, shapes)
    spread = np.sqrt(np.diag(np.linalg.inv(wide.precision)))
    # A maximum contraction tells a gain well enough to be weighed against torques.
    silent = (deviation >= TOLD * spread) & (spread > 2.0 * NEAR_MAXIMUM)
    if not silent.any():
        return fit._replace(deviation=deviation)
    apart = (np.log(fit.gains) - prior.mean)[~silent]
    beside = np.linalg.solve(prior.precision[np.ix_(silent, silent)], prior.precision[np.ix_(silent, ~silent)] @ apart)
    mean = prior.mean.copy()
    mean[silent] = np.minimum(mean[silent] - beside, prior.upper[silent])
    tracking.prior = Prior(mean, prior.precision + HELD * np.diag(silent.astype(float)), prior.upper)
    held = tracking.fit(delays, shapes)
    tracking.prior = prior
    return held._replace(deviation=deviation)
