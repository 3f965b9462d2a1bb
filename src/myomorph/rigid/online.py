"""Inverse dynamics of one frame after the other, in arrays that are made once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.errors import UnknownName
from myomorph.model.model import Model
from myomorph.rigid.couplers import couple_rates_frames
from myomorph.rigid.dynamics import inverse_dynamics_frames
from myomorph.rigid.tree import compile_tree


class OnlineDynamics:
    """Generalized forces of a frame, as `inverse_dynamics` gives them.

    Parameters
    ----------
    bodies : names of those that external wrenches act on

    Attributes
    ----------
    coordinates, rates, accelerations : (1, coordinates) of the last frame, those that follow others set
    torques : (1, coordinates) [N m or N]

    Raises
    ------
    UnknownName : a body that the model does not have
    """

    def __init__(self, model: Model, bodies: Sequence[str]):
        self._tree = compile_tree(model)
        for one in bodies:
            if one not in self._tree.body_index:
                raise UnknownName("body", one, tuple(self._tree.body_index))
        self._bodies = np.array([self._tree.body_index[one] for one in bodies], np.int64)
        n, wrenches = len(model.coordinates), len(bodies)
        self.coordinates, self.rates, self.accelerations = np.zeros((3, 1, n))
        self.torques = np.zeros((1, n))
        self._forces, self._points, self._torques = np.zeros((3, 1, wrenches, 3))

    def solve(self, values: Array, velocities: Array, accelerations: Array, wrenches: Array) -> Array:
        """Torques (coordinates,) of one frame; the array is used again by the next.

        Parameters
        ----------
        values, velocities, accelerations : (coordinates,) in the model's order
        wrenches : (bodies, 6) moment about the ground's origin and force, in ground [N m], [N]
        """
        self.coordinates[0], self.rates[0], self.accelerations[0] = values, velocities, accelerations
        couple_rates_frames(self._tree.arrays, self.coordinates, self.rates, self.accelerations)
        self._torques[0], self._forces[0] = wrenches[:, :3], wrenches[:, 3:]
        inverse_dynamics_frames(
            self._tree.arrays, self.coordinates, self.rates, self.accelerations, self._bodies, self._forces,
            self._points, self._torques, self.torques,
        )  # fmt: skip
        return self.torques[0]
