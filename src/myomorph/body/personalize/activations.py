"""Activations of a recording: what is known of them before the torques, and without them.

    r = tau - R^T F(p, a) + G (a - m),   S = var(e_tau) + G var(a) G^T,   G = R^T dF/da

r is the torque that muscles miss at the mean activations m that are expected, to first order about
the present ones; S is its covariance with activations marginalized.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from myomorph.body.personalize.prior import Prior
from myomorph.body.personalize.recorded import Recorded
from myomorph.core.model.arrays import Array, read_only

UNKNOWN = 0.15  # Standard deviation over time of an activation without EMG
EMG_FLOOR = 0.03
EMG_SHARE = 0.15  # Standard deviation of an activation that EMG shows: this much, and a share of it
MIN_OWN = 0.5  # Share of the variance of EMG over time that is activation's at least
REST = 0.003  # Standard deviation of an activation at rest
ACTIVE_SETS = 16  # Newton steps for the activations that stand at 0 or 1


def frame_products(matrices: Array, vectors: Array) -> Array:
    """Multiply each frame's matrix and vector.

    Parameters
    ----------
    matrices : (frames, m, n)
    vectors : (frames, n)

    Returns
    -------
    (frames, m)
    """
    return (matrices @ vectors[..., None])[..., 0]


class KnownActivations(NamedTuple):
    """What is known of activations before the torques, (frames, muscles) each.

    Attributes
    ----------
    mean, variance : of the activations
    growth : slope of the logarithm of the standard deviation in that of the gain
    """

    mean: Array
    variance: Array
    growth: Array


def known_activations(
    recorded: Recorded, prior: Prior, p: Array, emg_variance: float
) -> KnownActivations:
    """Compute what is known of activations before the torques.

    EMG has errors, so that its peaks are higher and its lows lower than those of activations:
    what is expected lies towards its mean (regression calibration, Carroll et al. 2006, ch. 4).

        m = mean(g e) + lambda (g e - mean(g e)),   lambda = own / (own + var(e_a))

    with the variance `own` over time that is the activation's. A part of the error grows with the
    activation, and so with the gain.

    Parameters
    ----------
    recorded : the recording
    prior : with the gains' muscles
    p : (parameters,)
    emg_variance : factor on the variance of activations that EMG shows

    Returns
    -------
    mean, variance and how this follows the gain
    """
    measured = recorded.measured
    # Where EMG is missing for a while, its gain says nothing of the level.
    without_emg = prior.gain >= len(prior.gains)
    gains = np.where(measured | without_emg, prior.gains_of(p), 1.0)
    level = np.clip(gains * recorded.envelope, 0.0, 1.0)
    scaled = np.where(measured, level, 0.0)
    errors = _emg_errors(scaled)
    variance = np.where(measured, emg_variance * errors.variance, UNKNOWN**2)

    counts = np.maximum(measured.sum(axis=0), 1)
    mean = scaled.sum(axis=0) / counts
    between = np.sum(np.where(measured, (scaled - mean) ** 2, 0.0), axis=0) / counts
    of_errors = np.sum(np.where(measured, variance, 0.0), axis=0) / counts
    own = np.maximum(between - of_errors, MIN_OWN * between)
    share = np.where(measured, own / np.maximum(own + variance, 1e-12), 1.0)
    expected = np.where(measured, mean + share * (scaled - mean), level)
    if recorded.at_rest:
        return KnownActivations(
            mean=expected,
            variance=np.full_like(variance, REST**2),
            growth=np.zeros_like(variance),
        )
    return KnownActivations(
        mean=expected,
        variance=share * variance,
        growth=np.where(measured, errors.growth, 0.0),
    )


class _EmgErrors(NamedTuple):
    """Assumed errors of activations that EMG shows, (frames, muscles) each.

    Attributes
    ----------
    variance : of a floor and of a share of the activation
    growth : see `KnownActivations`
    """

    variance: Array
    growth: Array


def _emg_errors(activations: Array) -> _EmgErrors:
    """Assume errors of activations (frames, muscles)."""
    of_share = (EMG_SHARE * activations) ** 2
    variance = EMG_FLOOR**2 + of_share
    return _EmgErrors(variance=variance, growth=of_share / variance)


class TorqueMisfit(NamedTuple):
    """Torques at the present activations.

    Attributes
    ----------
    left : (frames, rows) torque that muscles miss [N m or N]
    columns : (frames, rows, muscles) G, torque of a unit of activation
    variance : (frames, rows) of the measured torque, 1 where none was measured
    """

    left: Array
    columns: Array
    variance: Array


@read_only
@dataclass(frozen=True, eq=False, kw_only=True)
class Marginal:
    """The misfit with activations marginalized within 0 and 1; those at a bound have no part in it.

    Attributes
    ----------
    error : (frames, rows) r [N m or N]
    expected, variance : (frames, muscles) m and var(a); of an activation at a bound, the bound and
        0
    covariance : (frames, rows, rows) S
    gain : (frames, rows, muscles) S^-1 G var(a)
    """

    error: Array
    expected: Array
    variance: Array
    covariance: Array
    gain: Array

    def mean_activations(self, error: Array) -> Array:
        """Compute the mean activations given the torques.

            m + var(a) G^T S^-1 r

        Parameters
        ----------
        error : (frames, rows) r [N m or N]

        Returns
        -------
        (frames, muscles) that may leave 0 to 1
        """
        return self.expected + frame_products(self.gain.transpose(0, 2, 1), error)


def marginalized(torques: TorqueMisfit, now: Array, known: KnownActivations) -> Marginal:
    """Marginalize activations within 0 and 1.

    The least of |a - m|^2 / var(a) + |e_tau|^2 / var(e_tau), by Newton steps in the multipliers y
    of the balance: a = clip(m + var(a) G^T y), e_tau = var(e_tau) y.

    Parameters
    ----------
    torques : at the present activations
    now : (frames, muscles) present activations
    known : of activations before the torques

    Returns
    -------
    the misfit at expected activations, and its covariance
    """
    columns = torques.columns
    transposed = columns.transpose(0, 2, 1)
    measured = torques.variance[..., None] * np.eye(torques.variance.shape[1])
    multipliers = np.zeros_like(torques.left)
    side = np.zeros(now.shape, np.int8)  # -1 at 0, 1 at 1
    for number in range(ACTIVE_SETS):
        held = side != 0
        variance = np.where(held, 0.0, known.variance)
        expected = np.where(held, (side > 0).astype(np.float64), known.mean)
        error = torques.left + frame_products(columns, now - expected)
        spread = columns * variance[:, None]
        S = spread @ transposed + measured
        solved = np.asarray(np.linalg.solve(S, error[..., None])[..., 0], dtype=np.float64)
        # Half steps end most cycles of bounds that are taken in turns.
        full = number < ACTIVE_SETS // 2
        multipliers = solved if full else 0.5 * (multipliers + solved)
        wanted = known.mean + known.variance * frame_products(transposed, multipliers)
        before = side
        side = np.where(wanted < 0.0, -1, np.where(wanted > 1.0, 1, 0)).astype(np.int8)
        if np.array_equal(before, side):
            break
        if number == ACTIVE_SETS - 2:
            # Where bounds are still taken in turns, nothing is held: that leaves more open, not
            # less.
            side = np.where(before == side, side, 0).astype(np.int8)
    return Marginal(
        error=error,
        expected=expected,
        variance=variance,
        covariance=S,
        gain=np.asarray(np.linalg.solve(S, spread), dtype=np.float64),
    )
