"""The ten inertial parameters of every body as numbers, and back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from myomorph.model.arrays import Array
from myomorph.model.errors import BadData
from myomorph.model.model import Model

PARAMETERS = ("m", "m c_x", "m c_y", "m c_z", "I_xx", "I_yy", "I_zz", "I_yz", "I_zx", "I_xy")
"""Order of a body's parameters, [D] eq. 3.4; the inertia is about the body's origin."""

_DIAGONAL, _OFF = (4, 5, 6), ((7, 1, 2), (8, 2, 0), (9, 0, 1))


def inertial_parameters(model: Model) -> Array:
    """(bodies, 10) mass [kg], first moments [kg m] and inertia about the body's origin [kg m^2]."""
    table = np.empty((len(model.bodies), 10))
    for row, body in zip(table, model.bodies, strict=True):
        c = body.mass_center
        inertia = body.inertia + body.mass * (c @ c * np.eye(3) - np.outer(c, c))
        row[0], row[1:4] = body.mass, body.mass * c
        row[4:7] = np.diag(inertia)
        row[7], row[8], row[9] = inertia[1, 2], inertia[2, 0], inertia[0, 1]
    return table


def inertia_matrices(parameters: ArrayLike) -> Array:
    """(..., 3, 3) inertia about the bodies' origins of parameters (..., 10)."""
    given = np.asarray(parameters, dtype=np.float64)
    matrices = np.zeros((*given.shape[:-1], 3, 3))
    for k, i in enumerate(_DIAGONAL):
        matrices[..., k, k] = given[..., i]
    for i, a, b in _OFF:
        matrices[..., a, b] = matrices[..., b, a] = given[..., i]
    return matrices


def pseudo_inertias(parameters: ArrayLike) -> Array:
    """(..., 4, 4) pseudo-inertia [[S, h], [h^T, m]], S = tr(I) / 2 - I the second moments of mass.

    A body of some distribution of positive mass has a positive definite one (Wensing, Kim, Slotine
    2018, IEEE Robotics and Automation Letters 3(1):60).
    """
    given = np.asarray(parameters, dtype=np.float64)
    inertia = inertia_matrices(given)
    half_trace = 0.5 * np.trace(inertia, axis1=-2, axis2=-1)
    result = np.empty((*given.shape[:-1], 4, 4))
    result[..., :3, :3] = half_trace[..., None, None] * np.eye(3) - inertia
    result[..., :3, 3] = result[..., 3, :3] = given[..., 1:4]
    result[..., 3, 3] = given[..., 0]
    return result


def with_inertial_parameters(model: Model, parameters: ArrayLike) -> Model:
    """The model with other masses, mass centers and inertias.

    Parameters
    ----------
    parameters : (bodies, 10) as `inertial_parameters` gives them

    Raises
    ------
    BadData : another shape, a number that is not finite, or a negative mass
    """
    given = np.asarray(parameters, dtype=np.float64)
    if given.shape != (len(model.bodies), 10) or not np.isfinite(given).all():
        raise BadData(f"expected finite parameters ({len(model.bodies)}, 10), but got shape {given.shape}")
    if (given[:, 0] < 0.0).any():
        worst = int(np.argmin(given[:, 0]))
        raise BadData(f"body '{model.body_names[worst]}' would weigh {given[worst, 0]:.4g} kg")
    bodies = []
    for body, row, about_origin in zip(model.bodies, given, inertia_matrices(given), strict=True):
        mass = float(row[0])
        center = row[1:4] / mass if mass > 0.0 else np.zeros(3)
        inertia = about_origin - mass * (center @ center * np.eye(3) - np.outer(center, center))
        bodies.append(replace(body, mass=mass, mass_center=center, inertia=inertia))
    return replace(model, bodies=tuple(bodies))


def parameters_of(pseudo: Array) -> Array:
    """(..., 10) inertial parameters of pseudo-inertias (..., 4, 4); see `pseudo_inertias`."""
    second = pseudo[..., :3, :3]
    inertia = np.trace(second, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - second
    result = np.empty((*pseudo.shape[:-2], 10))
    result[..., 0], result[..., 1:4] = pseudo[..., 3, 3], pseudo[..., :3, 3]
    for i, (a, b) in enumerate(((0, 0), (1, 1), (2, 2), (1, 2), (2, 0), (0, 1)), start=4):
        result[..., i] = inertia[..., a, b]
    return result
