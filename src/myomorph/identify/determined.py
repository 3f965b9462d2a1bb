"""Which inertial parameters the data determine, and how far each may be off.

Two questions, two priors. What data alone show is counted against a prior in which every parameter of every link is
free of all others: there the shares sum to less than the rank of the regressor, and what the geometry of the mass
points ties together is not counted as data. How far a parameter may be off is told with that geometry, for a body
whose links differ from the model's by `LINK_SD`.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from myomorph.identify.body.points import MassPoints, point_moments
from myomorph.identify.mass_points import MassPointOptions, prior_variances
from myomorph.model.arrays import Array, read_only

DETERMINED = 0.9
"""Share of a parameter's prior variance that the data must take away to count as determined by them."""

LINK_SD = 0.2
"""Relative standard deviation by which a link's mass differs from the scaled model's, for intervals.

Segment masses of cadaver studies differ by 10 to 20 % of themselves at the same body mass (Clauser 1969, de Leva 1996).
"""

NINETY = 1.645
"""Standard deviations of a 90 % interval."""


@read_only
@dataclass(frozen=True, eq=False)
class Determined:
    """What the data say of the standard parameters.

    Attributes
    ----------
    shares : (bodies, 10) share of each parameter's variance, free of all others, that the data take away, 0 to 1
    rank : number of combinations of parameters that the data know better than the prior
    data : (bodies, 10) whether the data determine the parameter, never more than `rank`
    sd : (bodies, 10) standard deviation of the identified parameters' error [kg, kg m, kg m^2]
    prior_sd : (bodies, 10) the same of the shape's parameters, before anything was measured
    """

    shares: Array
    rank: int
    data: np.ndarray
    sd: Array
    prior_sd: Array


def determined(
    points: MassPoints,
    A: Array,
    mass: float,
    mass_sd: float,
    samples: float = 1.0,
    b: Array | None = None,
    noisy: Iterable[tuple[Array, Array]] = (),
) -> Determined:
    """What rows A x = b of unit noise say of the parameters x of every link.

    Parameters
    ----------
    A : (rows, 10 bodies) that were fitted
    mass : of the body, known exactly [kg]
    mass_sd : relative standard deviation of a link's mass with which was fitted
    samples : frames that make one independent sample; noise that repeats itself counts so much less
    b : (rows,) of the fit, where `noisy` are given
    noisy : (A, b) made with noise of the motion once more (`motion_noise.noisy_rows`): how far they move the estimate,
        on the mean and from one to the other, adds to its standard deviation
    """
    links = len(points.links.names)
    covariance = prior_covariance(points, LINK_SD)
    known = np.zeros((1, 10 * links))
    known[0, ::10] = 1.0 / (1e-6 * mass)
    truth = conditioned(covariance, known)

    sizes = np.sqrt(np.diag(covariance))
    scaled = (A / np.sqrt(samples)) * sizes
    free = np.diag(conditioned(np.eye(10 * links), scaled))
    shares = np.where(sizes > 0.0, np.clip(1.0 - free, 0.0, 1.0), 0.0)
    rank = int(np.sum(np.linalg.svd(scaled, compute_uv=False) > 1.0))
    data = shares >= DETERMINED
    best = np.argsort(-shares, kind="stable")[:rank]
    data &= np.isin(np.arange(len(shares)), best)

    # The estimate leans on its own prior, which may be tighter than what bodies differ by.
    prior = conditioned((mass_sd / LINK_SD) ** 2 * covariance, known)
    gain = _gain(prior, A)
    left = np.eye(10 * links) - gain @ A
    error = left @ truth @ left.T + samples * gain @ gain.T
    variance: Array = np.array(np.diag(error), float)
    center = points.parameters(points.reference).ravel()
    moved = [_gain(prior, more) @ (value - more @ center) for more, value in noisy]
    if moved and b is not None:
        steps = np.array(moved) - gain @ (b - A @ center)
        variance = variance + np.asarray(np.square(steps).mean(axis=0), float)
    table = (links, 10)
    return Determined(
        shares.reshape(table),
        rank,
        data.reshape(table),
        np.sqrt(np.maximum(variance, 0.0)).reshape(table),
        np.sqrt(np.maximum(np.diag(truth), 0.0)).reshape(table),
    )


def _gain(prior: Array, A: Array) -> Array:
    """(parameters, rows) from what rows of unit noise miss to the change of the parameters."""
    crossed = A @ prior
    gain: Array = np.array(np.linalg.solve(crossed @ A.T + np.eye(len(A)), crossed).T, float)
    return gain


def prior_covariance(points: MassPoints, mass_sd: float) -> Array:
    """(10 links, 10 links) covariance of all parameters where points' masses vary on their own, their sum free."""
    links = len(points.links.names)
    variances = prior_variances(points, MassPointOptions(mass_sd=mass_sd))
    moments = point_moments(points.points)
    # Parameters of unit masses times the points' standard deviations.
    columns = np.empty((links, 10, len(moments)))
    for i in range(links):
        columns[i] = (points.places[i] @ moments.T) * (points.weights[:, [i]].toarray().ravel() * np.sqrt(variances))
    flat = columns.reshape(10 * links, -1)
    covariance: Array = flat @ flat.T
    return covariance


def conditioned(covariance: Array, rows: Array) -> Array:
    """Covariance after measuring `rows` x with unit noise."""
    crossed = rows @ covariance
    result: Array = covariance - crossed.T @ np.linalg.solve(crossed @ rows.T + np.eye(len(rows)), crossed)
    return result
