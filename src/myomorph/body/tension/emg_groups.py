"""Groups of muscles that share joints: synergies of their channels, and a fit as a calibration.

Gains of EMG that torques do not show are usual ones, and so is the level of all where only priors
would move it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from myomorph.core.fit.estimation import Estimate, estimate_of
from myomorph.core.fit.interval_rule import half_width
from myomorph.core.fit.posterior import Posterior
from myomorph.core.model.arrays import Array
from myomorph.core.motion.emg_activation import (
    LIKELIHOOD_95,
    EmgCalibration,
    Synergies,
    SynergyWeights,
    find_synergies,
)
from myomorph.core.tension.emg_gains import GAINS, NEAR_MAXIMUM, Prior, gain_posterior
from myomorph.core.tension.emg_tracking import (
    Fit,
    Group,
    TorqueTracking,
    TrackedFrames,
    action_cosines,
    alike,
)

MIN_CHANNELS = 2
"""Number of channels that synergies need."""
SAME = 0.95
"""Cosine between what an unmeasured muscle and measured ones do at the joints, from which on these
tell of it: both gastrocnemii, hamstrings or vasti have 0.95 and more, soleus and gastrocnemii 0.88,
rectus femoris and vasti 0.7.
"""


INTERVAL = 0.95
"""Share of true gains that intervals hold."""
HELD = 1e6
"""Precision of the logarithm of a gain that is held."""


def synergy_groups(
    frames: Sequence[TrackedFrames], names: tuple[str, ...], tells: Array, peaks: Array
) -> tuple[Group, ...]:
    """Channels whose muscles share joints, their synergies, and these joints' unmeasured muscles.

    Parameters
    ----------
    frames : of all trials
    names : of the channels
    tells : (muscles, channels) True where a channel measures a muscle
    peaks : (channels,) largest envelope over all trials

    Returns
    -------
    groups that have synergies and an unmeasured muscle
    """
    # (rows, muscles) which muscles act on which rows of the balance
    acts = np.array([np.abs(frame.columns).max(axis=0) for frame in frames]).max(axis=0) > 0.0
    reach = (acts.astype(float) @ tells) > 0.0
    taken = np.asarray(tells.any(axis=1)).copy()
    groups = []
    remaining = [int(channel) for channel in np.flatnonzero(reach.any(axis=0))]
    while remaining:
        rows = _connected_rows(reach, remaining)
        here = [channel for channel in remaining if reach[rows, channel].any()]
        remaining = [channel for channel in remaining if channel not in here]
        muscles = np.flatnonzero(acts[rows].any(axis=0) & ~taken)
        alive = np.array([channel for channel in here if peaks[channel] > 0.0], dtype=np.int64)
        # Synergies of one channel would be that channel.
        if len(alive) < MIN_CHANNELS or not len(muscles):
            continue
        taken[muscles] = True
        values = np.vstack([frame.emg.values[:, alive] for frame in frames])
        if not np.isfinite(values).all(axis=1).any():
            continue
        groups.append(
            Group(
                synergies=find_synergies(tuple(names[c] for c in alive), values, peaks[alive]),
                channels=alive,
                muscles=muscles,
                like=alike(frames, muscles, tells[:, alive]),
            )
        )
    return tuple(groups)


def _connected_rows(reach: NDArray[np.bool_], channels: Sequence[int]) -> NDArray[np.bool_]:
    """Rows that the first of some channels acts on, and all that share rows with it.

    Parameters
    ----------
    reach : (rows, all channels) whether a channel's muscles act on a row
    channels : some of them

    Returns
    -------
    (rows,)
    """
    rows = reach[:, channels[0]].copy()
    count = -1
    while rows.sum() != count:
        count = int(rows.sum())
        here = [channel for channel in channels if reach[rows, channel].any()]
        rows |= reach[:, here].any(axis=1)
    return rows


class SettledGains(NamedTuple):
    """Gains that were settled on, at some delays and shapes.

    Attributes
    ----------
    fit : gains, offsets and weights
    posterior : what torques leave open of them, with a common level that is not known
    delays, shapes : (channels,) [s], shape factors
    """

    fit: Fit
    posterior: Posterior
    delays: Array
    shapes: Array

    @property
    def deviation(self) -> Array:
        """(channels,) standard deviation of the gains' logarithms."""
        return self.posterior.sd[self.posterior.unknowns.slices[GAINS]]

    @property
    def shown(self) -> NDArray[np.bool_]:
        """(channels,) whether torques halve the standard deviation of the gain's logarithm."""
        return np.asarray(self.posterior.shown[self.posterior.unknowns.slices[GAINS]])

    @property
    def estimate(self) -> Estimate:
        """The gains with what certifies them."""
        posterior = replace(self.posterior, x=self.fit.solution.x)
        return estimate_of(self.fit.solution, posterior=posterior)


def calibration_of(
    tracking: TorqueTracking,
    settled: SettledGains,
    names: tuple[str, ...],
    muscles: tuple[str, ...],
) -> EmgCalibration:
    """Make a calibration of the channels from a fit.

    Parameters
    ----------
    tracking : the regression over all trials
    settled : the most probable gains
    names, muscles : of the channels, and of all muscles

    Returns
    -------
    gains with intervals, and activations of muscles that act as measured ones do
    """
    gains = settled.fit.gains
    half = half_width(settled.deviation, INTERVAL)
    spread = np.exp(np.stack([-half, half], axis=1))
    cosines = np.maximum(action_cosines(tracking.frames), 0.0)
    near = cosines @ tracking.tells / np.maximum(tracking.tells.sum(axis=0), 1.0)
    synergies = tuple(_twins(group, near, gains, names, muscles) for group in tracking.groups)
    return EmgCalibration(
        channels=names,
        delays=settled.delays,
        gains=gains,
        offsets=settled.fit.offsets,
        warnings=(),
        shapes=settled.shapes,
        intervals=gains[:, None] * spread,
        by_torque=settled.shown,
        synergies=tuple(synergy for synergy in synergies if synergy.muscles),
        estimate=settled.estimate,
    )


def _twins(
    group: Group, near: Array, gains: Array, names: tuple[str, ...], muscles: tuple[str, ...]
) -> SynergyWeights:
    """Activations of muscles that act as measured ones do: the mean of these.

    Their own course says more of them than synergies that they share with muscles which act
    otherwise.

    Parameters
    ----------
    near : (muscles, channels) cosine between what muscles do at the joints
    gains : (channels,)
    names, muscles : of the channels, and of all muscles
    """
    coupled = near[np.ix_(group.muscles, group.channels)] >= SAME
    told = coupled.any(axis=1)
    scale = group.synergies.scale
    share = coupled[told] / coupled[told].sum(axis=1, keepdims=True)
    weights = share * (gains[group.channels] * scale)
    courses = Synergies(
        channels=tuple(names[c] for c in group.channels),
        scale=scale,
        vectors=np.eye(len(scale)),
        explained=1.0,
    )
    return SynergyWeights(courses, tuple(muscles[m] for m in group.muscles[told]), weights)


def some_names(names: Sequence[str]) -> str:
    """Join a few names for a line."""
    return ", ".join(names[:6]) + (" ..." if len(names) > 6 else "")


def kept_level(tracking: TorqueTracking, level: Prior, delays: Array, shapes: Array) -> Prior:
    """Choose the prior of gains: a usual level of all, unless torques are more likely otherwise.

    Muscles without EMG are expected to work as those beside them. Where hardly anything else says
    how large gains are (unmeasured contact forces), that alone would make them small.

    Parameters
    ----------
    tracking : the regression over all trials
    level : the prior whose common level is known; `tracking` has the one whose level is not
    delays, shapes : (channels,) [s], shape factors

    Returns
    -------
    one of the two
    """
    free = tracking.fit(delays, shapes)
    usual = tracking.fit(delays, shapes, level)
    return tracking.prior if usual.misfit - free.misfit > LIKELIHOOD_95 else level


def settled_gains(
    tracking: TorqueTracking, prior: Prior, delays: Array, shapes: Array
) -> SettledGains:
    """Find gains, those that torques do not show as usual beside those that they do.

    The mean of the silent ones, given the others, is that of a normal distribution,

        mean_s - P_ss^-1 P_st (log g_t - mean_t)

    with its precision P.

    Parameters
    ----------
    tracking : the regression over all trials
    prior : that of `kept_level`; deviations are by that of `tracking`, whose common level is not
        known
    delays, shapes : (channels,) [s], shape factors

    Returns
    -------
    gains, offsets and weights, with their cost
    """
    posterior = gain_posterior(tracking.fit(delays, shapes).solution, tracking.prior)
    settled = SettledGains(
        fit=tracking.fit(delays, shapes, prior),
        posterior=posterior,
        delays=delays,
        shapes=shapes,
    )
    spread = np.sqrt(np.diag(np.linalg.inv(tracking.prior.precision)))
    # A maximum contraction tells a gain well enough to be weighed against torques.
    silent = ~settled.shown & (spread > 2.0 * NEAR_MAXIMUM)
    if not silent.any():
        return settled
    difference = (np.log(settled.fit.gains) - prior.mean)[~silent]
    P = prior.precision
    shift = np.linalg.solve(P[np.ix_(silent, silent)], P[np.ix_(silent, ~silent)] @ difference)
    mean = prior.mean.copy()
    mean[silent] = np.minimum(mean[silent] - shift, prior.upper[silent])
    precision = P + HELD * np.diag(silent.astype(float))
    held = Prior(mean=mean, precision=precision, upper=prior.upper)
    return settled._replace(fit=tracking.fit(delays, shapes, held))
