"""Which inertial parameters the data determine, and how far each may be off.

Two questions, two priors. What data alone show is counted against a prior in which every parameter
of every link is free of all others: there the shares sum to less than the rank of the regressor,
and what the geometry of the mass points ties together is not counted as data. How far a parameter
may be off is told with that geometry, for a body whose links differ from the model's as
people's do (`people_sd`).
"""

from __future__ import annotations

import numpy as np

from myomorph.body.identify.estimate import mass_unknowns
from myomorph.body.identify.link_prior import LinkPrior, conditioned, people_sd
from myomorph.body.identify.shifts import MatterShifts
from myomorph.body.identify.sides import Sides
from myomorph.body.shape.points import MassPoints
from myomorph.core.fit.posterior import Posterior
from myomorph.core.fit.unknowns import Unknowns
from myomorph.core.model.arrays import Array, read_only

# Share of a parameter's prior variance that the data must take away to count as determined by them
DETERMINED = 0.9


@read_only
class MeasuredRows:
    """What is known of the parameters of all links beside their shape: A x with noise of 1.

    Attributes
    ----------
    A : (rows, 10 bodies) that were fitted, in units of noise
    samples : frames that make one independent sample; noise that repeats itself counts so much less
    forces : (rows, 10 bodies) the rows in units of the noise that is not the motion's; `A` itself
        where None
    scores : (draws, 10 bodies) how noise of the motion pulls at the estimate
        (`MotionNoise.scores`), which adds to its standard deviation; more than three draws
    sides : left and right alike, which is known and was not measured; None where nothing ties them
    shifts : of the matter of bodies; None where it lies as the points say
    """

    A: Array
    samples: float = 1.0
    forces: Array | None = None
    scores: Array | None = None
    sides: Sides | None = None
    shifts: MatterShifts | None = None

    def gradient_covariance(self) -> Array:
        """Compute the covariance of A^T r, with the noise r of the rows.

        Returns
        -------
        (10 bodies, 10 bodies)
        """
        forces = self.A if self.forces is None else self.forces
        covariance: Array = self.samples * (forces.T @ forces)
        if self.scores is not None:
            # Known from few draws only: the variance of Student's t, not of a normal distribution.
            covariance = covariance + self.scores.T @ self.scores / (len(self.scores) - 3)
        return covariance


@read_only
class Determined:
    """Standard parameters as far as the data determine them.

    Attributes
    ----------
    shares : (bodies, 10) share of each parameter's variance, free of all others, that the data take
        away, 0 to 1
    rank : number of combinations of parameters that the data know better than the prior
    data : (bodies, 10) whether the data determine the parameter, never more than `rank`
    posterior : of the identified parameters
    """

    shares: Array
    rank: int
    data: np.ndarray
    posterior: Posterior

    @property
    def sd(self) -> Array:
        """(bodies, 10) standard deviation of the parameters' error [kg, kg m, kg m^2]."""
        return self.posterior.sd.reshape(self.shares.shape)

    @property
    def prior_sd(self) -> Array:
        """(bodies, 10) the same of the shape's parameters, before anything was measured."""
        return np.sqrt(self.posterior.before).reshape(self.shares.shape)


def determined(
    points: MassPoints,
    measured: MeasuredRows,
    mass: float,
    mass_sd: float,
    parameters: Array | None = None,
) -> Determined:
    """Judge what measurements say of the parameters of every link.

    Parameters
    ----------
    points : mass points, whose geometry ties the parameters
    measured : rows and their noise
    mass : of the body, known exactly [kg]
    mass_sd : relative standard deviation of a link's mass in the prior of the fit
    parameters : (bodies, 10) that were identified; the shape's where None

    Returns
    -------
    shares of the data, and the posterior of the parameters
    """
    names = points.links.names
    prior = LinkPrior(points=points, mass=mass, sides=measured.sides, shifts=measured.shifts)
    sd = people_sd(points)
    covariance = prior.free(sd)
    sizes = np.sqrt(np.diag(covariance))
    scaled = (measured.A / np.sqrt(measured.samples)) * sizes
    free = np.diag(conditioned(np.eye(len(sizes)), scaled))
    shares = np.where(sizes > 0.0, np.clip(1.0 - free, 0.0, 1.0), 0.0)
    rank = int(np.sum(np.linalg.svd(scaled, compute_uv=False) > 1.0))
    best = np.argsort(-shares, kind="stable")[:rank]
    data = (shares >= DETERMINED) & np.isin(np.arange(len(shares)), best)

    x = points.parameters(points.reference) if parameters is None else parameters
    table = (len(names), 10)
    return Determined(
        shares=shares.reshape(table),
        rank=rank,
        data=data.reshape(table),
        posterior=_posterior(
            mass_unknowns(names, x, sizes),
            FitPrior(of_people=prior.of_people(sd), of_fit=prior.without_shifts.held(mass_sd)),
            measured,
        ),
    )


@read_only
class FitPrior:
    """Covariances before anything is measured, with the whole mass known and both sides alike.

    Attributes
    ----------
    of_people : (n, n) of the parameters of people's links
    of_fit : (n, n) that the fit holds parameters by
    """

    of_people: Array
    of_fit: Array


def _posterior(unknowns: Unknowns, prior: FitPrior, measured: MeasuredRows) -> Posterior:
    """Make the posterior of parameters whose fit had another prior than bodies have.

    The fit leans on its own prior, which may be tighter than what bodies differ by. With its
    covariance C_fit after the data, its error has the covariance

        (1 - C_fit A^T A) C (1 - C_fit A^T A)^T + C_fit cov(A^T r) C_fit

    where C is that of bodies of this mass, and r the noise of the rows.

    Parameters
    ----------
    unknowns : the parameters, which start where they were found
    prior : of people, and of the fit
    measured : rows and their noise
    """
    n = len(unknowns)
    A = measured.A
    truth = prior.of_people
    after = conditioned(prior.of_fit, A)
    left = np.eye(n) - after @ A.T @ A
    error = left @ truth @ left.T + after @ measured.gradient_covariance() @ after.T
    return Posterior(
        unknowns=unknowns,
        x=unknowns.start,
        free=unknowns.free(),
        covariance=error,
        after=np.maximum(np.diag(error), 0.0),
        before=np.maximum(np.diag(truth), 0.0),
        hidden=np.zeros((0, n)),
    )
