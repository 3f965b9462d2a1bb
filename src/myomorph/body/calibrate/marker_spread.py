"""How far all markers lie from their places, relative to what is usual.

The usual distances weigh the search. Intervals take those that the recordings show.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from myomorph.body.calibrate.shared_fit import Search
from myomorph.core.fit.unknowns import Bools
from myomorph.core.model.arrays import Array

SPREAD_SD = 0.5  # Of the logarithm of the spread, before anything is recorded
MAX_SPREAD = 4.0  # And its inverse the least one
CANDIDATES = 201  # Spreads that are compared
ROUNDING = 1e-10  # Relative information that counts as none
MIN_INFORMATION = 1e-300  # Of an unknown that no marker shows [1/m^2]


class _Directions(NamedTuple):
    """Independent combinations of shifts in units of their usual distance, all else eliminated.

    Attributes
    ----------
    information : (directions,) of data and of other priors, in units of the usual prior's
    pull : (directions,) slope of half the cost at the minimum, without the usual prior's
    shift : (directions,) where they are at the minimum
    """

    information: Array
    pull: Array
    shift: Array

    def log_evidence(self, spread: Array) -> Array:
        """Compute how likely the recordings are with each spread.

        Of a direction with information l, pull p and shift d, and the prior N(0, spread^2),

            2 log p(data | spread) = -2 log(spread) - log(l + w) - w d^2 + (p + w d)^2 / (l + w)

        with w = 1 / spread^2, up to a constant.

        Parameters
        ----------
        spread : (candidates,) relative to the usual one

        Returns
        -------
        (candidates,)
        """
        weight = spread[:, None] ** -2
        total = self.information + weight
        slope = self.pull + weight * self.shift
        misfit = weight * self.shift**2 - slope**2 / total
        each = -np.log(spread)[:, None] - 0.5 * np.log(total) - 0.5 * misfit
        return each.sum(axis=1)


def marker_spread(search: Search, skin: Array) -> float:
    """Find how far all markers lie from their places on the model, relative to what is usual.

    It is the most likely one by the evidence of the recordings, linear about the minimum, with a
    prior whose logarithm has the standard deviation `SPREAD_SD`.

    Source: MacKay 1992, Bayesian interpolation, Neural Computation 4(3):415.

    Parameters
    ----------
    search : where it ended, with the usual distances as prior
    skin : (unknowns + coordinates, same) the result of `sliding` [m^2 per unknown]

    Returns
    -------
    factor of the usual distances; 1 where no marker may move
    """
    shifts = _free_shifts(search)
    if not shifts.any():
        return 1.0
    spread = np.geomspace(1.0 / MAX_SPREAD, MAX_SPREAD, CANDIDATES)
    log_prior = -0.5 * (np.log(spread) / SPREAD_SD) ** 2
    evidence = _directions(search, shifts, skin).log_evidence(spread)
    return float(spread[np.argmax(evidence + log_prior)])


def gradient_of_spread(search: Search, spread: float, width: int) -> Array:
    """Compute what another spread than the usual one adds to the covariance of the gradient.

    The estimate is the one of the usual distances. With P the rows of the shifts' prior, whose
    misfits have the variance spread^2 and not 1, the gradient has the covariance

        H + P^T P + (spread^2 - 1) P^T P

    Parameters
    ----------
    search : where it ended
    spread : of the markers, relative to the usual distances
    width : number of unknowns and coordinates

    Returns
    -------
    (unknowns + coordinates, same) what is added, in the units of `sliding` [m^2 per unknown]; below
        0 where markers lie nearer than usual
    """
    shifts = _free_shifts(search)
    added = np.zeros(width)
    added[: len(shifts)] = np.where(shifts, _shift_information(search), 0.0)
    return np.diag((spread**2 - 1.0) * search.stage.variance**2 * added)


def _free_shifts(search: Search) -> Bools:
    """Select the shifts of markers that were estimated: (unknowns,)."""
    shifts = search.stage.free.copy()
    shifts[: len(search.problem.lengths)] = False
    shifts[-1] = False
    return shifts


def _shift_information(search: Search) -> Array:
    """Look up the prior's information of each shift: (unknowns,) [1/m^2]; others are no shifts."""
    rows = search.problem.prior.rows
    return (rows**2).sum(axis=0)


class _Quadratic(NamedTuple):
    """Half the cost about the minimum, 1/2 d^T H d + g^T d.

    Attributes
    ----------
    H : (unknowns, unknowns)
    g : (unknowns,)
    """

    H: Array
    g: Array

    def reduced(self, kept: Bools) -> _Quadratic:
        """Eliminate all other unknowns.

        Parameters
        ----------
        kept : (unknowns,) which stay
        """
        rest = ~kept
        across = np.linalg.solve(self.H[np.ix_(rest, rest)], self.H[np.ix_(rest, kept)])
        return _Quadratic(
            H=self.H[np.ix_(kept, kept)] - self.H[np.ix_(kept, rest)] @ across,
            g=self.g[kept] - across.T @ self.g[rest],
        )


def _directions(search: Search, shifts: Bools, skin: Array) -> _Directions:
    """Decompose what is known of the shifts without their prior.

    Parameters
    ----------
    shifts : (unknowns,) that were estimated
    skin : (unknowns + coordinates, same) [m^2 per unknown]
    """
    free = search.stage.free
    solution = search.found.solution
    usual = np.where(shifts, _shift_information(search), 0.0)
    data = _by_data(search, skin)
    known = _Quadratic(
        H=data.H + solution.prior.H[np.ix_(free, free)] - np.diag(usual[free]),
        g=data.g + (solution.prior.g - usual * solution.x)[free],
    )
    of_shifts = known.reduced(shifts[free])
    sd = 1.0 / np.sqrt(usual[shifts])
    levels, axes = np.linalg.eigh(of_shifts.H * sd[:, None] * sd)
    return _Directions(
        information=np.maximum(levels, 0.0),
        pull=axes.T @ (sd * of_shifts.g),
        shift=axes.T @ (solution.x[shifts] / sd),
    )


def _by_data(search: Search, skin: Array) -> _Quadratic:
    """Compute what the recordings say, over the free unknowns.

    Skin that slides, with the covariance K of the gradient, leaves of the data's information H

        H (H + K)^-1 H

    Parameters
    ----------
    skin : (unknowns + coordinates, same) [m^2 per unknown]
    """
    free = search.stage.free
    inner = np.ix_(free, free)
    data = search.found.solution.data
    H = data.H[inner]
    noisy = H + skin[: len(free), : len(free)][inner] / search.stage.variance**2
    scale = 1.0 / np.sqrt(np.maximum(np.diag(noisy), MIN_INFORMATION))
    # What no marker shows has no information, before and after.
    scaled = noisy * scale[:, None] * scale + ROUNDING * np.eye(len(noisy))
    kept = np.linalg.solve(scaled, scale[:, None] * np.column_stack([H, data.g[free]]))
    effective = H @ (scale[:, None] * kept)
    return _Quadratic(H=effective[:, :-1], g=effective[:, -1])
