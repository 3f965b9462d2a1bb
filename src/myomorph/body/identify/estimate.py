"""Masses as an estimate: unknowns with names, what was measured of them, and the shape as prior."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from myomorph.body.identify.sides import Sides
from myomorph.core.fit.problem import Problem
from myomorph.core.fit.residuals import Condensed, LinearPrior
from myomorph.core.fit.unknowns import Block, Unknown, Unknowns
from myomorph.core.model.arrays import Array
from myomorph.core.model.inertia import PARAMETERS

MASSES = "masses"
"""The block of unknowns."""
UNITS = ("kg", *["kg m"] * 3, *["kg m^2"] * 6)
"""Of the parameters of a body."""
SMALLEST = 1e-12  # Share of the largest scaled variance under which a direction has none


def mass_unknowns(names: Sequence[str], parameters: Array, sizes: Array) -> Unknowns:
    """Name the inertial parameters of all bodies: "femur_r m", "femur_r m c_x", ...

    Parameters
    ----------
    names : of the bodies
    parameters : (bodies, 10) where they start
    sizes : (10 bodies,) standard deviations before anything is measured; what has none is fixed

    Returns
    -------
    one block, `MASSES`
    """
    unknowns = []
    for body, row, scales in zip(names, parameters, np.reshape(sizes, (-1, 10)), strict=True):
        for index, name in enumerate(PARAMETERS):
            fixed = not scales[index] > 0.0
            unknowns.append(
                Unknown(
                    name=f"{body} {name}",
                    unit=UNITS[index],
                    where=f"body {body}: {name}",
                    start=float(row[index]),
                    low=min(0.0, float(row[0])) if index == 0 else -np.inf,
                    fixed=fixed,
                    scale=1.0 if fixed else float(scales[index]),
                )
            )
    return Unknowns((Block(name=MASSES, unknowns=tuple(unknowns)),))


def mass_problem(
    unknowns: Unknowns,
    rows: tuple[Array, Array],
    center: Array,
    covariance: Array,
    sides: Sides | None = None,
) -> Problem:
    """State what is known of masses: the measured wrench, and the body's shape.

    The prior x ~ N(c, C) is that of a body whose points' masses vary. With C = V s V^T, scaled,

        s^-1/2 V^T (x - c) ~ N(0, 1)

    Directions in which the points leave no freedom have no rows: they are met exactly.

    Parameters
    ----------
    unknowns : of `mass_unknowns`
    rows : (rows, 10 bodies) A and (rows,) b of the wrench, in units of noise
    center : (bodies, 10) parameters of the shape
    covariance : (10 bodies, 10 bodies) C
    sides : left and right alike; None where nothing ties them

    Returns
    -------
    unknowns and residuals, which add up with others
    """
    A, b = rows
    sizes = np.sqrt(np.diag(covariance))
    scale = np.where(sizes > 0.0, sizes, 1.0)
    levels, directions = np.linalg.eigh(covariance / scale[:, None] / scale)
    free = levels > SMALLEST * levels.max(initial=0.0)
    whitening = (directions[:, free] / np.sqrt(levels[free])).T / scale
    priors = [
        LinearPrior(
            name="shape of the body",
            blocks=(MASSES,),
            rows=whitening,
            right=whitening @ center.ravel(),
        )
    ]
    if sides is not None:
        priors.append(
            LinearPrior(
                name="both sides alike", blocks=(MASSES,), rows=sides.rows, right=sides.right
            )
        )
    return Problem(
        unknowns=unknowns,
        residuals=(
            Condensed(name="wrench on the base", blocks=(MASSES,), rows=A, right=b),
            *priors,
        ),
    )
