"""Where the spring of a ball joint is slack: angles counted from there make its torque linear in them.

The rotation vector from one rest is no linear function of that from another: with R_rest moved by a small c,
log(exp(c) exp(theta)) = theta + c + c x theta / 2 + ... The last part is neither spring nor constant, does work
like a damper in a conical swing, and 0.02 rad of it change the viscosity by 1 % (`docs/viscosity.md`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from myomorph.model.arrays import Array
from myomorph.viscosity.swing_sums import ANGLE, CONSTANT, MUSCLES, RATE, SwingSums, eliminated
from myomorph.viscosity.swings import PARAMETERS, SwingRecording

FARTHEST = 1.5
"""A rest farther than this from the mean pose is not believed: there is hardly a spring [rad]."""


def spring_rest(sums: SwingSums, parameters: Array) -> Array:
    """(axes,) rotation c from the slack spring to where the angles are zero; zero where there is no spring.

    Least squares of torque = -d rate - u d_M - k (angle + c): d, d_M and c of each axis, k of all.

    Parameters
    ----------
    parameters : (10,) of the limb
    """
    left = _without_dampers(sums, parameters)
    varying = eliminated(left, [2])
    square = varying[:, 1, 1].sum()
    stiffness = -varying[:, 0, 1].sum() / square if square > 0.0 else 0.0
    if not stiffness > 0.0:
        return np.zeros(len(sums.axes))
    shift: Array = -(left[:, 0, 2] / stiffness + left[:, 1, 2]) / left[:, 2, 2]
    return shift if np.linalg.norm(shift) < FARTHEST else np.zeros(len(shift))


def spring_misfit(sums: SwingSums, parameters: Array) -> float:
    """Sum of squares that the same least squares leave of the torque, with k of all axes and c of each [N^2 m^2]."""
    varying = eliminated(_without_dampers(sums, parameters), [2])
    square = float(varying[:, 1, 1].sum())
    explained = float(varying[:, 0, 1].sum()) ** 2 / square if square > 0.0 else 0.0
    return float(varying[:, 0, 0].sum()) - explained


def _without_dampers(sums: SwingSums, parameters: Array) -> Array:
    """(axes, 3, 3) products of torque, angle and one, with rates and muscles taken off."""
    muscles = len(sums.muscles)
    chosen = np.zeros((sums.torque.shape[-1], 4 + muscles))
    chosen[:PARAMETERS, 0] = parameters
    chosen[[ANGLE, CONSTANT, RATE], [1, 2, 3]] = 1.0
    chosen[MUSCLES:, 4:] = np.eye(muscles)
    return eliminated(chosen.T @ sums.torque_total(np.ones(len(sums))) @ chosen, range(3, 4 + muscles))


def counted_from(recordings: Sequence[SwingRecording], shift: Array) -> list[SwingRecording]:
    """The recordings with their angles counted from a rest that lies `shift` (3,) before theirs."""
    found = []
    turn = Rotation.from_rotvec(shift)
    for one in recordings:
        angles = np.array(one.angles)
        angles[one.used] = (turn * Rotation.from_rotvec(one.angles[one.used])).as_rotvec()
        found.append(replace(one, angles=angles))
    return found
