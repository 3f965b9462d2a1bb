"""Step 2: the viscosity of a joint from the torque of its free swings ([S] eq. 1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from myomorph.model.arrays import Array
from myomorph.viscosity.swing_sums import ANGLE, CONSTANT, MUSCLES, PLATE, RATE, eliminated
from myomorph.viscosity.swings import PARAMETERS

TORQUE, SPEED, FIRST = 0, 1, 2
"""Columns of a torque problem: the torque by inverse dynamics, the rate, then one a muscle."""


@dataclass(frozen=True, eq=False)
class JointViscosity:
    """d_J of [S] eq. 1, the sign that resists: torque = -d rate.

    Attributes
    ----------
    one : of all axes alike, as the paper prints it, at least 0 [N m s/rad]
    axes : (axes,) each for itself, at least 0 [N m s/rad]
    residual : (axes,) root mean square of torque + one rate [N m]
    """

    one: float
    axes: Array
    residual: Array


def torque_problem(products: Array, parameters: Array | None, stiffness: bool = True) -> Array:
    """(axes, 2 + muscles, 2 + muscles) products of [torque, rate, u] of each axis, torque = torque_rows phi.

    Parameters
    ----------
    products : (axes, n, n) as `SwingSums.torque_total` gives them
    parameters : (10,) phi; None for the torque that the plate measures instead
    stiffness : take off what a spring and a constant torque of each axis explain, so that neither biases what
        resists motion
    """
    if stiffness:
        products = eliminated(products, [CONSTANT, ANGLE])
    muscles = products.shape[-1] - MUSCLES
    chosen = np.zeros((products.shape[-1], FIRST + muscles))
    if parameters is None:
        chosen[PLATE, TORQUE] = 1.0
    else:
        chosen[:PARAMETERS, TORQUE] = parameters
    chosen[RATE, SPEED] = 1.0
    chosen[MUSCLES:, FIRST:] = np.eye(muscles)
    problem: Array = chosen.T @ products @ chosen
    return problem


def joint_viscosity(problem: Array, frames: float) -> JointViscosity:
    """Least squares of torque = -d rate, d at least 0, over all axes together and each by itself.

    Parameters
    ----------
    problem : (axes, 2 + muscles, 2 + muscles) of `torque_problem`
    """
    power, square = -problem[:, TORQUE, SPEED], problem[:, SPEED, SPEED]
    axes = np.maximum(np.divide(power, square, out=np.zeros_like(power), where=square > 0.0), 0.0)
    one = max(float(power.sum() / square.sum()), 0.0) if square.sum() > 0.0 else 0.0
    left = problem[:, TORQUE, TORQUE] - 2.0 * one * power + one**2 * square
    return JointViscosity(one, axes, np.sqrt(np.maximum(left, 0.0) / frames))
