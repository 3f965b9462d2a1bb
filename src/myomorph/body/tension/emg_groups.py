"""Groups of muscles that share joints: synergies of their channels, and a fit of gains as a
calibration.

Gains of EMG that torques do not show are usual ones, and so is the level of all where only priors
would move it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.motion.emg_activation import (
    LIKELIHOOD_95,
    EmgCalibration,
    Synergies,
    SynergyWeights,
    find_synergies,
)
from myomorph.core.tension.emg_tracking import (
    NEAR_MAXIMUM,
    Fit,
    Group,
    Prior,
    TorqueTracking,
    TrackedFrames,
    action_cosines,
    alike,
)

TOLD = 0.5
"""Torques tell a gain where they leave less than this share of the prior's standard deviation of
its logarithm.
"""
CROWDED = 2  # Synergies need as many channels
SAME = 0.95
"""Cosine between what an unmeasured muscle and measured ones do at the joints, from which on these
tell of it: both gastrocnemii, hamstrings or vasti have 0.95 and more, soleus and gastrocnemii 0.88,
rectus femoris and vasti 0.7.
"""


def synergy_groups(
    frames: Sequence[TrackedFrames], names: tuple[str, ...], tells: Array, peaks: Array
) -> tuple[Group, ...]:
    """Channels whose muscles share joints, their synergies, and the unmeasured muscles of these
    joints.
    """
    acts = np.asarray(
        np.array([np.abs(frame.columns).max(axis=0) for frame in frames]).max(axis=0) > 0.0
    )
    reach = (acts.astype(float) @ tells) > 0.0
    measured = np.asarray(tells.any(axis=1))
    groups = list[Group]()
    left = list(np.flatnonzero(reach.any(axis=0)))
    taken = np.zeros(len(measured), dtype=bool)
    while left:
        rows = reach[:, left[0]].copy()
        before = -1
        while rows.sum() != before:
            before = int(rows.sum())
            here = [c for c in left if reach[rows, c].any()]
            rows |= reach[:, here].any(axis=1)
        left = [c for c in left if c not in here]
        # Synergies of one channel would be that channel.
        muscles = np.flatnonzero(acts[rows].any(axis=0) & ~measured & ~taken)
        alive = np.array([c for c in here if peaks[c] > 0.0], dtype=np.int64)
        if len(alive) < CROWDED or not len(muscles):
            continue
        taken[muscles] = True
        values = np.vstack([frame.emg.values[:, alive] for frame in frames])
        if not np.isfinite(values).all(axis=1).any():
            continue
        synergies = find_synergies(tuple(names[c] for c in alive), values, peaks[alive])
        groups.append(
            Group(
                synergies=synergies,
                channels=alive,
                muscles=muscles,
                like=alike(frames, muscles, tells[:, alive]),
            )
        )
    return tuple(groups)


def calibration_of(
    tracking: TorqueTracking,
    fit: Fit,
    names: tuple[str, ...],
    muscles: tuple[str, ...],
    delays: Array,
    shapes: Array,
) -> EmgCalibration:
    """A fit as a calibration of the channels."""
    prior = np.sqrt(np.diag(np.linalg.inv(tracking.prior.precision)))
    spread = np.exp(np.outer(fit.deviation, (-1.96, 1.96)))
    near = (
        np.maximum(action_cosines(tracking.frames), 0.0)
        @ tracking.tells
        / np.maximum(tracking.tells.sum(axis=0), 1.0)
    )
    synergies = tuple(_twins(group, near, fit.gains, names, muscles) for group in tracking.groups)
    return EmgCalibration(
        channels=names,
        delays=delays,
        gains=fit.gains,
        offsets=fit.offsets,
        warnings=(),
        shapes=shapes,
        intervals=fit.gains[:, None] * spread,
        by_torque=fit.deviation < TOLD * prior,
        synergies=tuple(synergy for synergy in synergies if synergy.muscles),
    )


def _twins(
    group: Group, near: Array, gains: Array, names: tuple[str, ...], muscles: tuple[str, ...]
) -> SynergyWeights:
    """Activations of muscles that act as measured ones do: the mean of these.
    Their own course says more of them than synergies that they share with muscles which act
    otherwise. `near` (muscles, channels) cosine between what muscles do at the joints.
    """
    coupled = near[np.ix_(group.muscles, group.channels)] >= SAME
    told = coupled.any(axis=1)
    scale = group.synergies.scale
    weights = (
        coupled[told] / coupled[told].sum(axis=1, keepdims=True) * (gains[group.channels] * scale)
    )
    courses = Synergies(
        channels=tuple(names[c] for c in group.channels),
        scale=scale,
        vectors=np.eye(len(scale)),
        explained=1.0,
    )
    return SynergyWeights(courses, tuple(muscles[m] for m in group.muscles[told]), weights)


def some_names(names: Sequence[str]) -> str:
    """A few names for a line."""
    return ", ".join(names[:6]) + (" ..." if len(names) > 6 else "")


HELD = 1e6  # Precision of the logarithm of a gain that is held


def kept_level(tracking: TorqueTracking, level: Prior, delays: Array, shapes: Array) -> Prior:
    """The prior of gains: that in which all share a usual level, unless torques are more likely
    otherwise. Muscles without EMG are expected to work as those beside them. Where hardly anything
    else says how large gains are (unmeasured contact forces), that alone would make them small.
    `level`: the prior whose common level is known; `tracking` has the one whose level is not.
    """
    free = tracking.fit(delays, shapes)
    kept = tracking.fit(delays, shapes, level)
    return tracking.prior if kept.misfit - free.misfit > LIKELIHOOD_95 else level


def settled_fit(tracking: TorqueTracking, prior: Prior, delays: Array, shapes: Array) -> Fit:
    """The most probable gains, where those that torques do not show are the usual ones beside those
    that they do. `prior`: that of `kept_level`; deviations are by that of `tracking`, whose common
    level is not known.
    """
    deviation = tracking.fit(delays, shapes).deviation
    fit = tracking.fit(delays, shapes, prior)
    spread = np.sqrt(np.diag(np.linalg.inv(tracking.prior.precision)))
    # A maximum contraction tells a gain well enough to be weighed against torques.
    silent = (deviation >= TOLD * spread) & (spread > 2.0 * NEAR_MAXIMUM)
    if not silent.any():
        return fit._replace(deviation=deviation)
    apart = (np.log(fit.gains) - prior.mean)[~silent]
    beside = np.linalg.solve(
        prior.precision[np.ix_(silent, silent)], prior.precision[np.ix_(silent, ~silent)] @ apart
    )
    mean = prior.mean.copy()
    mean[silent] = np.minimum(mean[silent] - beside, prior.upper[silent])
    held = Prior(mean, prior.precision + HELD * np.diag(silent.astype(float)), prior.upper)
    return tracking.fit(delays, shapes, held)._replace(deviation=deviation)
