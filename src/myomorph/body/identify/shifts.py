"""Where the matter of a body lies beside its frame: mass centers that are off as a whole.

Joint centers are off by half a centimeter and more, and mass centers of people vary along the
segment and across it. Across a thin limb no change of density reaches that far, so that a fit of
densities gives the moments of the wrench which such a shift makes to other masses. The fit has no
unknowns for it, for it would take soft tissue and errors of the motion for shifts. But what the fit
says of masses counts no more than shifts allow: with B what a unit of each makes of parameters,
their covariance before anything is measured is that of densities and B B^T.
"""

from __future__ import annotations

import numpy as np

from myomorph.body.identify.pseudo_inertia import SMALLEST_SHARE
from myomorph.body.identify.sides import Sides
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.inertia import parameters_of, pseudo_inertias

SHIFT_SD = 0.015
"""Standard deviation of a body's mass center along each axis, beside what its density says, which
is assumed: joint centers are off by as much, and it is 3 % of the length of a thigh [m].
"""
SIDE_SHIFT_SD = 0.003
"""The same of what is not alike on both sides, as errors of joint centers are not [m]."""


@read_only
class MatterShifts:
    """Shifts of the matter of all bodies, alike on both sides but for a little.

    Attributes
    ----------
    directions : (bodies, 3, shifts) of each body's matter in its frame by a unit of each shift [m]
    columns : (10 bodies, shifts) change of all parameters by a unit of each
    """

    directions: Array
    columns: Array

    @classmethod
    def of(cls, shape: Array, sides: Sides | None) -> MatterShifts:
        """List the shifts of bodies that have mass.

        Parameters
        ----------
        shape : (bodies, 10) before anything is measured
        sides : bodies of both sides that are alike; None where nothing ties them

        Returns
        -------
        three shifts a body, and three more of each pair of bodies that are mirror images
        """
        heavy = shape[:, 0] > SMALLEST_SHARE * shape[:, 0].sum()
        paired = np.zeros(len(shape), bool)
        directions = []
        for pair in () if sides is None else sides.mirrors:
            paired[[pair.right, pair.left]] = True
            alike = np.zeros((len(shape), 3, 3))
            alike[pair.right] = SHIFT_SD * np.eye(3)
            # What moves the right body moves the left one mirrored.
            alike[pair.left] = SHIFT_SD * pair.mirror.T
            directions.append(alike)
        for body in np.flatnonzero(heavy):
            own = np.zeros((len(shape), 3, 3))
            own[body] = (SIDE_SHIFT_SD if paired[body] else SHIFT_SD) * np.eye(3)
            directions.append(own)
        every = np.concatenate([np.zeros((len(shape), 3, 0)), *directions], axis=2)
        columns = _slopes(shape) @ every
        return cls(directions=every, columns=columns.reshape(shape.size, -1))

    @property
    def covariance(self) -> Array:
        """(10 bodies, 10 bodies) of the parameters."""
        return self.columns @ self.columns.T


def _slopes(parameters: Array) -> Array:
    """Differentiate parameters (bodies, 10) along displacements: (bodies, 10, 3)."""
    P = pseudo_inertias(parameters)
    columns = []
    for axis in range(3):
        T = np.zeros((4, 4))
        T[axis, 3] = 1.0
        columns.append(parameters_of(T @ P + P @ T.T))
    return np.stack(columns, axis=2)
