"""Leans of the trunk that keep a body's angular momentum while nothing touches it.

The mass center of a plan falls freely, but limbs that move need a moment, which nothing gives in
the air. A lean u(t) about the lateral axis takes it:

    min_u  sum_air (m + I u'')^2 + lambda sum (I u'')^2

with the moment m that the plan needs about the mass center. I is a rough inertia of the trunk, so
it takes some rounds until m is 0.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from myomorph.core.model.arrays import Array
from myomorph.core.model.spatial import axis_rotation
from myomorph.show.simulate.plan import WHOLE, Aim

Aims = Callable[[float], Sequence[Aim]]

ROUNDS = 8
INERTIA = 3.6  # Of a trunk about the lateral axis, roughly [kg m^2].
STEP = 0.6  # Of the way to the leans of a round, so that they do not swing.
PRICE = 1e-3  # Of leans on the ground against those in the air.
LEFT = 0.5  # Moment that is no matter [N m].


def leaning(aims: Aims, grid: Array, lean: Array) -> Aims:
    """Turn all attitudes that a plan aims at.

    Parameters
    ----------
    aims : of the pose at a time
    grid : times of the leans (n,) [s]
    lean : about z (n,) [rad]

    Returns
    -------
    aims with leans, which are 0 outside the grid
    """
    spline = CubicSpline(grid, lean, bc_type="clamped")

    def leant(time: float) -> Sequence[Aim]:
        angle = float(spline(time)) if grid[0] < time < grid[-1] else 0.0
        turn = axis_rotation((0.0, 0.0, 1.0), angle)
        return [
            replace(aim, target=turn @ np.asarray(aim.target))
            if aim.point is None and aim.body != WHOLE
            else aim
            for aim in aims(time)
        ]

    return leant


def balanced_leans(
    moment_of: Callable[[Aims], Array], aims: Aims, grid: Array, air: NDArray[np.bool_]
) -> Aims:
    """Find the leans that leave no moment in the air.

    Parameters
    ----------
    moment_of : moment about z at the grid's times that aims need (n,) [N m]
    aims : of the pose at a time
    grid : evenly spaced times (n,) [s]
    air : (n,) whether nothing touches

    Returns
    -------
    aims with leans
    """
    step = float(grid[1] - grid[0])
    curvature = np.zeros((len(grid), len(grid)))
    for row in range(1, len(grid) - 1):
        curvature[row, row - 1 : row + 2] = np.array([1.0, -2.0, 1.0]) / step**2
    ends = np.eye(len(grid))[[0, 1, -2, -1]]
    weight = np.where(air, 1.0, PRICE)
    lean = np.zeros(len(grid))
    for _ in range(ROUNDS):
        moment = moment_of(leaning(aims, grid, lean))
        if np.abs(moment[air]).max() < LEFT:
            break
        bend = curvature @ lean
        # Of the bend in the air what is missing; on the ground as little as brings it back to 0.
        goal = np.where(air, bend - STEP * moment / INERTIA, 0.0)
        rows = np.vstack([weight[:, None] * curvature, 1e3 * ends, 1e-3 * np.eye(len(grid))])
        aim = np.concatenate([weight * goal, np.zeros(len(ends) + len(grid))])
        lean = np.linalg.lstsq(rows, aim, rcond=None)[0]
    return leaning(aims, grid, lean)
