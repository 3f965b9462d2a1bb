"""Lengths of both sides: which pairs the data show to differ."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from myomorph.body.calibrate.calibration import CalibrationOptions, SideEstimate
from myomorph.body.calibrate.priors import ASYMMETRIC_SD
from myomorph.core.fit.residuals import LinearPrior
from myomorph.core.model.arrays import Array
from myomorph.core.motion.lengths import Length, mirrored_lengths

# Of pairs of lengths that differ more than usual: the odds at which the data must show it
ASYMMETRIC_SHARE = 0.1
MIN_INFORMATION = 1e-12  # Below which the data say nothing of an unknown [1/variance]


class Differences(NamedTuple):
    """Differences of the sides as the data show them, without a prior on sides.

    Attributes
    ----------
    values : (pairs,) first less second, as a share of the length
    covariance : (pairs, pairs)
    """

    values: Array
    covariance: Array

    def log_evidence(self, sd: Array) -> float:
        """Compute the log evidence of the differences, without its constant.

        Parameters
        ----------
        sd : (pairs,) standard deviation by which the true differences vary

        Returns
        -------
        log likelihood of N(0, covariance + diag(sd^2))
        """
        total = self.covariance + np.diag(sd**2)
        misfit = self.values @ np.linalg.solve(total, self.values)
        return -0.5 * float(np.linalg.slogdet(total)[1] + misfit)


def side_differences(
    lengths: Sequence[Length], x: Array, H: Array, prior: LinearPrior, options: CalibrationOptions
) -> tuple[SideEstimate, ...]:
    """Find pairs of lengths whose sides differ more than `side_sd` explains.

    Of two Gaussian priors on a difference, narrow (`side_sd`) and wide (`ASYMMETRIC_SD`), the one
    is taken that makes the data likelier, at odds of `ASYMMETRIC_SHARE`: pair after pair, the most
    telling first. The evidence is that of the differences without a prior on sides, about the
    minimum x.

    Parameters
    ----------
    lengths : of the model; only those from joint to joint are compared
    x : (unknowns,) at the minimum
    H : (unknowns, unknowns) information of the data alone [1/variance]
    prior : whose last rows are those of the sides
    options : with `side_sd`

    Returns
    -------
    one for each pair from joint to joint
    """
    pairs = mirrored_lengths(lengths)
    compared = [
        number
        for number, (i, _) in enumerate(pairs)
        if lengths[i].along and lengths[i].between_joints
    ]
    if not compared:
        return ()
    side_rows = len(prior.rows) - len(pairs) + np.array(compared)
    difference = np.zeros((len(compared), len(x)))
    for row, number in enumerate(compared):
        first, second = pairs[number]
        difference[row, first] = 1.0
        difference[row, second] = -1.0
    shown = _without_sides(x, H, prior, side_rows, difference)
    sd = _likely_sd(shown, options.side_sd)
    estimates = []
    for row, number in enumerate(compared):
        first, second = pairs[number]
        estimate = SideEstimate(
            first=lengths[first].name,
            second=lengths[second].name,
            difference=float(shown.values[row]),
            sd=float(np.sqrt(shown.covariance[row, row])),
            differs=bool(sd[row] > options.side_sd),
        )
        estimates.append(estimate)
    return tuple(estimates)


def _without_sides(
    x: Array, H: Array, prior: LinearPrior, side_rows: Array, difference: Array
) -> Differences:
    """Solve for the differences that data and prior show without the rows of the sides.

    At the minimum the data and the rest pull against the rows D x ~ N(d, 1) of the sides: without
    these it lies one step away, at

        x + C D^T (D x - d)

    with the covariance C of data and rest.

    Parameters
    ----------
    x : (unknowns,) at the minimum
    H : (unknowns, unknowns) information of the data [1/variance]
    side_rows : (pairs,) numbers of the prior's rows
    difference : (pairs, unknowns) first less second
    """
    rest = np.setdiff1d(np.arange(len(prior.rows)), side_rows)
    rows = prior.rows[rest]
    information = H + rows.T @ rows
    scale = np.sqrt(np.maximum(np.diag(information), MIN_INFORMATION))
    scales = np.outer(scale, scale)
    covariance = np.linalg.pinv(information / scales, hermitian=True) / scales
    misfit = prior.rows[side_rows] @ x - prior.right[side_rows]
    pull = prior.rows[side_rows].T @ misfit
    freed = x + covariance @ pull
    return Differences(values=difference @ freed, covariance=difference @ covariance @ difference.T)


def _likely_sd(shown: Differences, side_sd: float) -> Array:
    """Choose for each pair the narrow or the wide standard deviation.

    Parameters
    ----------
    shown : differences as the data show them
    side_sd : the narrow one

    Returns
    -------
    (pairs,)
    """
    count = len(shown.values)
    wide_sd = max(ASYMMETRIC_SD, side_sd)
    sd = np.full(count, side_sd)
    gains = np.full(count, -np.inf)
    for _ in range(count):
        # Where one length differs, others of the same limb are as likely to.
        share = 0.5 if (sd >= wide_sd).any() else ASYMMETRIC_SHARE
        log_odds = float(np.log(share / (1.0 - share)))
        before = shown.log_evidence(sd)
        narrow = sd < wide_sd
        for pair in np.flatnonzero(narrow).tolist():
            widened = sd.copy()
            widened[pair] = wide_sd
            gains[pair] = shown.log_evidence(widened) - before + log_odds
        best = int(np.argmax(np.where(narrow, gains, -np.inf)))
        if sd[best] >= wide_sd or gains[best] <= 0.0:
            break
        sd[best] = wide_sd
    return sd
