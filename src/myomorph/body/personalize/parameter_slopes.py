"""Slopes of torques, and of the spread of their misfits, in the parameters of a person."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from myomorph.body.personalize.activations import TorqueMisfit
from myomorph.body.personalize.fibers import Followed, MuscleSizes
from myomorph.body.personalize.prior import Prior
from myomorph.body.personalize.recorded import Recorded
from myomorph.core.model.arrays import Array

MORE = 1e-3  # Of activation, for the slopes of what an activation gives


class MusclesAt(NamedTuple):
    """Muscles at some parameters, in the frames that count.

    Attributes
    ----------
    p : (parameters,)
    sizes : lengths and strengths
    followed : forces and slopes, (frames, muscles)
    expected : (frames, muscles) activations that are expected before the torques
    present : (frames, muscles) activations
    growth : (frames, muscles) see `KnownActivations`
    """

    p: Array
    sizes: MuscleSizes
    followed: Followed
    expected: Array
    present: Array
    growth: Array


def torque_slopes(recorded: Recorded, prior: Prior, at: MusclesAt, torques: TorqueMisfit) -> Array:
    """Compute slopes of the muscles' torques in the parameters.

    With lo = lo_0 exp(p_fiber) and ls = L - (point + p_point) lo,

        dF/dp_fiber = lo (dF/dlo - (point + p_point) dF/dls),   dF/dp_point = -lo dF/dls

    A gain moves the expected activations m, and their spread with its growth c. Strength moves the
    force of the present activations a, but where EMG shows them, of their spread no more than the
    gain does:

        dF/dp_gain = dF/da (m + c (a - m)),   dF/dp_strength = F - (1 - c) dF/da (a - m)

    so that how far torques scatter, which is by errors of EMG, says nothing of how strength and
    gain share what both make.

    Parameters
    ----------
    recorded : the recording
    prior : of the parameters
    at : muscles at the parameters
    torques : at the present activations

    Returns
    -------
    (frames, rows, parameters)
    """
    parts = prior.parts
    followed = at.followed
    fiber = at.sizes.fiber
    arms = recorded.arms
    point = prior.point + at.p[parts.points]
    groups = len(prior.groups)

    slopes = np.zeros((*recorded.torques.shape, len(at.p)))
    by_fiber = followed.by_fiber * fiber - followed.by_slack * point * fiber
    slopes[..., parts.fibers] = arms * by_fiber[:, None]
    slopes[..., parts.points] = -arms * (followed.by_slack * fiber)[:, None]
    apart = at.present - at.expected
    fixed = np.where(recorded.measured, (1.0 - at.growth) * apart, 0.0)
    by_strength = arms * (followed.force - followed.by_activation * fixed)[:, None]
    slopes[..., parts.strength] = by_strength @ _members(prior.group, groups)
    by_passive = arms * (followed.by_strain * at.sizes.strain)[:, None]
    slopes[..., parts.passive] = by_passive @ _members(prior.group, groups)
    # Where EMG is missing for a while, no gain moves the activation.
    follows = recorded.measured | (prior.gain >= len(prior.gains))
    moved = at.expected + at.growth * apart
    by_gain = torques.columns * np.where(follows, moved, 0.0)[:, None]
    slopes[..., parts.gains] = by_gain @ _members(prior.gain, len(prior.gains) + prior.levels)
    return slopes


def widening_slopes(
    recorded: Recorded, prior: Prior, at: MusclesAt, more: Followed, gain: Array
) -> Array:
    """Compute slopes of half the logarithm of det S.

        1/2 d log det S = tr(S^-1 G var(a) dG^T)

    A muscle's column of G depends on its own parameters alone. Activations that follow the torque
    make its slopes in the parameters follow its errors: without this term, whatever widens S would
    seem the more probable.

    Parameters
    ----------
    recorded : the recording
    prior : of the parameters
    at : muscles at the present activations
    more : muscles at activations `MORE` above
    gain : (frames, rows, muscles) S^-1 G var(a)

    Returns
    -------
    (parameters,)
    """
    parts = prior.parts
    now = at.followed
    share = np.sum(gain * recorded.arms, axis=1)
    of_fiber = np.sum(share * (more.by_fiber - now.by_fiber), axis=0) / MORE
    of_slack = np.sum(share * (more.by_slack - now.by_slack), axis=0) / MORE
    of_strain = np.sum(share * (more.by_strain - now.by_strain), axis=0) / MORE
    follows = np.where(recorded.measured, at.growth, 1.0)
    of_force = np.sum(share * now.by_activation * follows, axis=0)

    groups = len(prior.groups)
    point = prior.point + at.p[parts.points]
    slopes = np.zeros(len(at.p))
    slopes[parts.fibers] = (of_fiber - of_slack * point) * at.sizes.fiber
    slopes[parts.points] = -of_slack * at.sizes.fiber
    slopes[parts.strength] = np.bincount(prior.group, of_force, minlength=groups)
    of_passive = of_strain * at.sizes.strain
    slopes[parts.passive] = np.bincount(prior.group, of_passive, minlength=groups)
    of_gain = np.sum(share * now.by_activation * at.growth, axis=0)
    slopes[parts.gains] = of_gain @ _members(prior.gain, len(prior.gains) + prior.levels)
    return slopes


def _members(number: np.ndarray, count: int) -> Array:
    """Tell which muscles share which parameter.

    Parameters
    ----------
    number : (muscles,) of each muscle's parameter
    count : of parameters

    Returns
    -------
    (muscles, count) 1 where a muscle has the parameter, else 0
    """
    return (number[:, None] == np.arange(count)).astype(np.float64)
