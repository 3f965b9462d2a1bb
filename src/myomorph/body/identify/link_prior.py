"""What is known of links before anything is measured: a covariance of their parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property

import numpy as np

from myomorph.body.identify.mass_points import MassPointOptions, prior_variances
from myomorph.body.identify.shifts import MatterShifts
from myomorph.body.identify.sides import Sides
from myomorph.body.shape.points import MassPoints, point_moments
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.segments import Segment

MASS_ERROR = 1e-6  # Relative error of the whole mass, which counts as exact
LINK_SD = 0.2
"""Relative standard deviation by which a link's mass differs from the scaled model's, for
intervals, where no survey says it of people with the same measurements.

Segment masses of cadaver studies differ by 10 to 20 % of themselves at the same body mass (Clauser
1969, de Leva 1996).
"""


@read_only
class LinkPrior:
    """Parameters of links whose points' masses vary, with sides alike, and matter that is shifted.

    Attributes
    ----------
    points : mass points, whose geometry ties the parameters
    mass : of the body, known exactly [kg]
    sides : left and right alike; None where nothing ties them
    shifts : of the matter of bodies; None where it lies as the points say
    """

    points: MassPoints
    mass: float
    sides: Sides | None = None
    shifts: MatterShifts | None = None

    @cached_property
    def _relative(self) -> Array:
        """(n, n) covariance where masses of links have a relative standard deviation of 1."""
        return prior_covariance(self.points, 1.0)

    @property
    def without_shifts(self) -> LinkPrior:
        """The prior of links whose matter lies as the points say, as fits have it."""
        return replace(self, shifts=None)

    def free(self, sd: float) -> Array:
        """Compute the covariance with the whole mass and both sides free.

        Parameters
        ----------
        sd : relative standard deviation of a link's mass

        Returns
        -------
        (n, n)
        """
        return self._shifted(sd**2 * self._relative)

    def held(self, sd: float) -> Array:
        """Compute the covariance with the whole mass known, and both sides alike, as fits have it.

        Parameters
        ----------
        sd : relative standard deviation of a link's mass

        Returns
        -------
        (n, n)
        """
        return self._known(sd**2 * self._relative)

    def of_people(self, sd: float) -> Array:
        """Compute the covariance of links that differ by `sd` each, also those that have a twin.

        Two links of the variance v that turn out to be alike keep v / 2 each, since each says what
        the other is. So twins begin with twice the variance.

        Parameters
        ----------
        sd : relative standard deviation of a link's mass, the whole mass free

        Returns
        -------
        (n, n) with the whole mass known, and both sides alike
        """
        sizes = np.full(len(self._relative), sd)
        for pair in () if self.sides is None else self.sides.mirrors:
            for link in (pair.right, pair.left):
                sizes[10 * link : 10 * link + 10] *= np.sqrt(2.0)
        return self._known(self._relative * sizes[:, None] * sizes)

    def _known(self, covariance: Array) -> Array:
        """Condition a covariance on the whole mass and on both sides, and add shifts of matter."""
        whole = np.zeros((1, len(covariance)))
        whole[0, ::10] = 1.0 / (MASS_ERROR * self.mass)
        known = conditioned(covariance, whole)
        if self.sides is not None:
            known = conditioned(known, self.sides.rows)
        return self._shifted(known)

    def _shifted(self, covariance: Array) -> Array:
        """Add what shifts of matter make of parameters, which change no mass."""
        return covariance if self.shifts is None else covariance + self.shifts.covariance


def people_sd(points: MassPoints) -> float:
    """Return the relative standard deviation of a typical link's mass among people.

    Parameters
    ----------
    points : of the body; where a survey says how far people with its measurements differ, that

    Returns
    -------
    `LINK_SD` where no survey says it
    """
    return LINK_SD if points.typical_spread is None else points.typical_spread


def with_people_spread(
    points: MassPoints, segments: Mapping[str, Segment], errors: Mapping[Segment, float]
) -> MassPoints:
    """Say of links how far their masses differ among people with the same measurements.

    A link that is a segment of the body differs as the segment does. How a segment's mass is
    divided between several links no survey says: with a share s of it, a link's variance is

        sd(segment)^2 + (1 - s)^2 LINK_SD^2.

    Parameters
    ----------
    points : mass points of the body
    segments : of the links, by name
    errors : relative standard deviation of each segment's mass; NaN where no survey says it

    Returns
    -------
    points with the spread of the links; as they were where a segment has no error
    """
    masses = np.asarray(points.weights.T @ points.reference)
    whole: dict[Segment, float] = {}
    for name, mass in zip(points.links.names, masses, strict=True):
        whole[segments[name]] = whole.get(segments[name], 0.0) + float(mass)
    spread = np.full(len(masses), LINK_SD)
    for i, (name, mass) in enumerate(zip(points.links.names, masses, strict=True)):
        segment = segments[name]
        if not mass > 0.0:
            continue
        error = errors.get(segment, np.nan)
        if not np.isfinite(error):
            return points
        spread[i] = np.hypot(error, (1.0 - mass / whole[segment]) * LINK_SD)
    return replace(points, spread=spread)


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
