"""Step 1: the limb's inertial parameters from its swings and the wrench on the base.

Source: [S] section II A.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from myomorph.body.identify.pseudo_inertia import (
    PseudoInertiaOptions,
    solve_pseudo_inertia,
    solve_ridge,
    tangents,
)
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.inertia import inertia_matrices, parameters_of
from myomorph.swings.viscosity.swings.parameter_scale import parameter_scale
from myomorph.swings.viscosity.swings.recording import PARAMETERS
from myomorph.swings.viscosity.swings.sums import ONE, PREDICTED, WRENCH, SwingSums, eliminated

Tare = Literal["known", "loaded", "unknown"]
"""What the plate's zero leaves in the wrench beside the limb: nothing; a constant load of the base,
the same in all trials of a condition; a constant wrench of each trial, which hides the mass.
"""

SLENDER = 0.3
"""Radius of the prior's cylinder as a share of its mass center's distance from the joint.

A straight arm has about 0.1, one with a bent elbow 0.5. Of a tenth the inertia along a bent limb
lies twenty standard deviations away, and was pulled down by up to a half.
"""
FIXED = 1e-8
"""Share of the squares of a unit mass' force that changes, below which the base is fixed: what is
left of it is rounding. On a base that moves the mass is carried along.
"""
# Share of the squared misfit by which a possible body may fit worse and still be what was measured.
IMPOSSIBLE = 1e-3


@dataclass(frozen=True)
class InertiaOptions:
    """How the limb's inertia is identified, see `ViscosityOptions`.

    A hinge shows where its limb's mass center lies along the axis by a constant moment alone, as a
    load of the base makes one too: with "loaded" it comes from the prior, and distances of the mass
    center are those from the axis.
    """

    tare: Tare = "loaded"
    prior_sd: float = 1.0
    instruments: bool = True

    def __post_init__(self) -> None:
        if self.tare not in get_args(Tare):
            raise BadData(
                f"unknown tare '{self.tare}': there are {', '.join(map(repr, get_args(Tare)))}"
            )
        if not self.prior_sd > 0.0:
            raise BadData(f"prior_sd of the limb's inertia is {self.prior_sd:g}: expected above 0")


@read_only
class LimbInertia:
    """The limb as one rigid link, whose mass is what the constant force shows, the base's load too.

    Attributes
    ----------
    parameters : (10,) about the joint's center ([D] order)
    noise : (6,) root mean square of measured less predicted wrench, by which its rows are weighted
        [N m], [N]
    hidden : whether the mass hides behind an unknown zero of the plate, so that parameters[0] is a
        guess
    possible : whether a body can have the parameters that the wrench shows, up to its noise
    hinge : (3,) axis along which the mass center is not shown; zeros where it is
    spread : (10, 10) independent errors of one standard deviation in columns, were the noise of
        all frames independent
    """

    parameters: Array
    noise: Array
    hidden: bool
    possible: bool
    hinge: Array
    spread: Array

    @property
    def mass(self) -> float:
        """[kg]; NaN where it hides."""
        return float("nan") if self.hidden else float(self.parameters[0])

    @property
    def com(self) -> float:
        """Distance of the mass center from the joint's center [m]; NaN where the mass hides."""
        return float("nan") if self.hidden else self.first_moment / float(self.parameters[0])

    @property
    def first_moment(self) -> float:
        """Mass times distance of the mass center, which needs no zero of the plate [kg m].

        The distance is that from the joint's center, from the axis of a hinge.
        """
        return float(np.linalg.norm(_across(self.parameters[1:4], self.hinge)))

    @property
    def least_mass(self) -> float:
        """The least that a body of this first moment and inertia weighs, [kg]."""
        return least_mass(self.parameters, self.hinge)


def least_mass(parameters: Array, hinge: Array) -> float:
    """Find the mass |h|^2 / I below which no body has these parameters.

    Parameters
    ----------
    parameters : (10,) with first moment h and largest inertia I about the joint
    hinge : (3,) axis of a hinge, which shows h across and I about it alone; zeros for a ball

    Returns
    -------
    [kg]; 0 without an inertia
    """
    about = inertia_matrices(parameters)
    inertia = float(hinge @ about @ hinge if hinge.any() else np.linalg.eigvalsh(about)[-1])
    moment = _across(parameters[1:4], hinge)
    return float(moment @ moment) / inertia if inertia > 0.0 else 0.0


def _across(moment: Array, hinge: Array) -> Array:
    """Take off what lies along a unit axis (3,); all is left where that is zero."""
    return moment - hinge * float(hinge @ moment)


def limb_inertia(
    sums: SwingSums,
    counts: Array | None = None,
    options: InertiaOptions | None = None,
    noise: Array | None = None,
) -> LimbInertia:
    """Find the parameters phi of a possible body that explain the wrench.

        minimize sum |(wrench - wrench_rows phi - offset) / noise|^2

    Each row of the wrench is weighted by its own residual. Parameters that the swings do not show
    (the axial inertia, all but seven or fewer of a hinge) come from the prior of `InertiaOptions`;
    what they do show outweighs it by the number of frames.

    Parameters
    ----------
    sums : over blocks of swings
    counts : (blocks,) how often each counts; by default once
    options : see `InertiaOptions`
    noise : (6,) of the rows; found by repetition by default [N m], [N]

    Returns
    -------
    the limb
    """
    options = options or InertiaOptions()
    counts = np.ones(len(sums)) if counts is None else counts
    hidden = options.tare == "unknown"
    free = options.tare != "known"
    products = sums.wrench_total(counts)
    whole = products.sum(axis=0)
    if free:
        products = eliminated(products if hidden else whole[None], [ONE])
    products = products.sum(axis=0)[:, :ONE, :ONE]
    if free and products[:, 0, 0].sum() < FIXED * whole[:, 0, 0].sum():
        for column in (0, PREDICTED):
            products[:, column] = products[:, :, column] = 0.0
    if not options.instruments:
        products[:, PREDICTED:] = 0.0
        products[:, PREDICTED:, : WRENCH + 1] = products[:, :PARAMETERS, : WRENCH + 1]
        products[:, PREDICTED:, PREDICTED:] = products[:, :PARAMETERS, :PARAMETERS]
    if noise is None:
        noise = _noise(products, float(counts @ sums.frames))
    A, b = _equations(np.tensordot(noise**-2.0, products, axes=1))
    if free and not hidden:
        # The constant force along gravity, which limb and base share, is put down to the limb.
        forces = whole[3:, 0].sum(axis=0) / (np.sqrt(whole[3:, 0, 0].sum()) * noise[3:].mean())
        A = np.vstack([A, forces[:PARAMETERS]])
        b = np.append(b, forces[WRENCH])
    reference = _cylinder(_least_norm(A, b), hidden)
    prior = PseudoInertiaOptions(mass_sd=options.prior_sd)
    fit = solve_pseudo_inertia(A, b, reference[None], options=prior)
    possible = fit.status == "closed form"
    if not possible:
        unbound = solve_ridge(A, b, reference[None], options=prior)
        possible = fit.misfit - unbound.misfit < 6.0 * IMPOSSIBLE * float(counts @ sums.frames)
    return LimbInertia(
        parameters=fit.parameters[0],
        noise=noise,
        hidden=hidden,
        possible=possible,
        hinge=_hinge(sums) if free else np.zeros(3),
        spread=_spread(A, reference, options.prior_sd),
    )


def _spread(A: Array, reference: Array, sd: float) -> Array:
    """Find how far parameters may be off, see `LimbInertia.spread`.

    Parameters
    ----------
    A : (rows, 10) equations in units of their noise
    reference : (10,) mean of the prior
    sd : relative standard deviation of the prior

    Returns
    -------
    (10, 10)
    """
    changes = tangents(reference[None])[0]
    # By singular values: of swings without noise the covariance itself would be rounding.
    _, values, directions = np.linalg.svd(np.vstack([A @ changes, np.eye(PARAMETERS) / sd]))
    return np.asarray(changes @ directions.T / values)


def _hinge(sums: SwingSums) -> Array:
    """Find the unit axis (3,) of a hinge in the limb; zeros for a ball."""
    if len(sums.axes) > 1:
        return np.zeros(3)
    axis = sums.directions[0]
    return np.asarray(axis / np.linalg.norm(axis))


def _noise(products: Array, frames: float) -> Array:
    """Find the residual (6,) of each row of the wrench, the rows weighted by it.

    Parameters
    ----------
    products : (6, n, n) of the columns
    frames : how many they are of
    """
    size = np.sqrt(products[:, WRENCH, WRENCH] / frames)
    least = 1e-9 * np.repeat([size[:3].max(), size[3:].max()], 3)
    noise = np.maximum(size, least)
    for _ in range(4):
        parameters = _least_norm(*_equations(np.tensordot(noise**-2.0, products, axes=1)))
        taken = np.append(parameters, -1.0)
        left = np.einsum("rij,i,j->r", products[:, : WRENCH + 1, : WRENCH + 1], taken, taken)
        noise = np.maximum(np.sqrt(np.maximum(left, 0.0) / frames), least)
    return noise


def _equations(products: Array) -> tuple[Array, Array]:
    """Make the equations of the wrench as the predicted rows Z see it.

        A = (Z^T Z)^-1/2 Z^T Y,    b = (Z^T Z)^-1/2 Z^T wrench

    Parameters
    ----------
    products : (n, n) of the columns

    Returns
    -------
    A (10, 10), b (10,)
    """
    Z = slice(PREDICTED, PREDICTED + PARAMETERS)
    scale = parameter_scale(np.sqrt(np.diagonal(products)[Z]))
    values, vectors = np.linalg.eigh(products[Z, Z] / scale[:, None] / scale)
    seen = values > 1e-13 * values[-1]
    root = np.divide(
        1.0,
        np.sqrt(values, where=seen, out=np.ones(PARAMETERS)),
        where=seen,
        out=np.zeros(PARAMETERS),
    )
    turn = root[:, None] * vectors.T / scale
    return turn @ products[Z, :PARAMETERS], turn @ products[Z, WRENCH]


def _least_norm(A: Array, b: Array) -> Array:
    """Solve A x = b (10,) by least squares; what is not seen is zero."""
    scale = parameter_scale(np.linalg.norm(A, axis=0))
    return np.linalg.lstsq(A / scale, b, rcond=1e-6)[0] / scale


def _cylinder(estimate: Array, hidden: bool) -> Array:
    """Make the prior: a uniform cylinder from the joint through the estimated mass center.

    Parameters
    ----------
    estimate : (10,) parameters
    hidden : whether the mass is a guess

    Returns
    -------
    (10,)
    """
    moment = estimate[1:4]
    size = float(np.linalg.norm(moment))
    if not size > 0.0:
        raise BadData(
            "the wrench on the base contains no moment of the limb's weight about the joint: does"
            " the plate support it?"
        )
    inertia = float(np.linalg.eigvalsh(inertia_matrices(estimate))[-1])
    mass = 4.0 / 3.0 * size**2 / inertia if hidden and inertia > 0.0 else float(estimate[0])
    if not mass > 0.0:
        asked = (
            "is the sign that of the force on the base, and was the plate's zero set without the"
            " limb"
        )
        raise BadData(f"the limb's mass is {mass:.3g} kg: {asked} (else set tare to 'unknown')?")
    c = moment / mass
    distance = size / mass
    along = np.outer(c, c) / distance**2
    pseudo = np.zeros((4, 4))
    pseudo[:3, :3] = mass * (
        4.0 / 3.0 * np.outer(c, c) + 0.25 * (SLENDER * distance) ** 2 * (np.eye(3) - along)
    )
    pseudo[:3, 3] = pseudo[3, :3] = moment
    pseudo[3, 3] = mass
    return parameters_of(pseudo)
