"""Which inertial parameters the data determine, and how far each may be off.

Two questions, two priors. What data alone show is counted against a prior in which every parameter
of every link is free of all others: there the shares sum to less than the rank of the regressor,
and what the geometry of the mass points ties together is not counted as data. How far a parameter
may be off is told with that geometry, for a body whose links differ from the model's by `LINK_SD`.
"""

from __future__ import annotations

import numpy as np

from myomorph.body.identify.mass_points import MassPointOptions, prior_variances
from myomorph.body.shape.points import MassPoints, point_moments
from myomorph.core.model.arrays import Array, read_only

# Share of a parameter's prior variance that the data must take away to count as determined by them
DETERMINED = 0.9
LINK_SD = 0.2
"""Relative standard deviation by which a link's mass differs from the scaled model's, for
intervals.

Segment masses of cadaver studies differ by 10 to 20 % of themselves at the same body mass (Clauser
1969, de Leva 1996).
"""

NINETY = 1.645  # Standard deviations of a 90 % interval


@read_only
class Determined:
    """Standard parameters as far as the data determine them.

    Attributes
    ----------
    shares : (bodies, 10) share of each parameter's variance, free of all others, that the data take
        away, 0 to 1
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
    forces: Array | None = None,
    scores: Array | None = None,
) -> Determined:
    """Judge what rows A x = b of unit noise say of the parameters x of every link.

    Parameters
    ----------
    points : mass points, whose geometry ties the parameters
    A : (rows, 10 bodies) that were fitted, in units of noise
    mass : of the body, known exactly [kg]
    mass_sd : relative standard deviation of a link's mass in the prior of the fit
    samples : frames that make one independent sample; noise that repeats itself counts so much less
    forces : (rows, 10 bodies) the rows in units of the noise that is not the motion's; `A` itself
        where None
    scores : (draws, 10 bodies) how noise of the motion pulls at the estimate
        (`MotionNoise.scores`), which adds to its standard deviation; more than three draws

    Returns
    -------
    shares of the data, and standard deviations of the errors [kg, kg m, kg m^2]
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
    after = conditioned(conditioned((mass_sd / LINK_SD) ** 2 * covariance, known), A)
    left = np.eye(10 * links) - after @ A.T @ A
    variance: Array = np.einsum("ij,jk,ik->i", left, truth, left)
    forces = A if forces is None else forces
    variance = variance + samples * np.square(after @ forces.T).sum(axis=1)
    if scores is not None:
        # Known from few draws only: the variance of Student's t, not of a normal distribution.
        variance = variance + np.square(after @ scores.T).sum(axis=1) / (len(scores) - 3)
    table = (links, 10)
    return Determined(
        shares=shares.reshape(table),
        rank=rank,
        data=data.reshape(table),
        sd=np.sqrt(np.maximum(variance, 0.0)).reshape(table),
        prior_sd=np.sqrt(np.maximum(np.diag(truth), 0.0)).reshape(table),
    )


def prior_covariance(points: MassPoints, mass_sd: float) -> Array:
    """Compute the prior covariance of all parameters where points' masses vary independently.

    With phi = W rho ([D] eq. 3.5), cov(phi) = W V W^T and the variances V of the points. The sum of
    the masses is free.

    Parameters
    ----------
    points : with weights
    mass_sd : relative standard deviation of a link's mass

    Returns
    -------
    (10 links, 10 links) [kg, kg m, kg m^2], squared
    """
    links = len(points.links.names)
    variances = prior_variances(points, MassPointOptions(mass_sd=mass_sd))
    moments = point_moments(points.points)
    # Parameters of unit masses times the points' standard deviations.
    columns = np.empty((links, 10, len(moments)))
    for i in range(links):
        columns[i] = (points.places[i] @ moments.T) * (
            points.weights[:, [i]].toarray().ravel() * np.sqrt(variances)
        )
    flat = columns.reshape(10 * links, -1)
    return flat @ flat.T


def conditioned(covariance: Array, rows: Array) -> Array:
    """Condition a covariance on measured `rows` x of unit noise.

        C - C A^T (A C A^T + 1)^-1 A C

    Parameters
    ----------
    covariance : (n, n) C before
    rows : (m, n) A

    Returns
    -------
    (n, n) covariance after
    """
    crossed = rows @ covariance
    return covariance - crossed.T @ np.linalg.solve(crossed @ rows.T + np.eye(len(rows)), crossed)
