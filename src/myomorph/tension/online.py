"""Muscle tensions of one frame after the other, each solved from the multipliers of the one before."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from myomorph.model.arrays import Array, read_only
from myomorph.model.errors import BadModel
from myomorph.model.model import Actuator, Model
from myomorph.model.series import Motion, Series
from myomorph.tension.dual import OPTIMAL
from myomorph.tension.problem import TensionInputs, tension_problem
from myomorph.tension.tension import TensionOptions


@read_only
class TensionFrame:
    """What one frame gives."""

    # activations, forces: (muscles,) NaN where the frame was not solved; along the tendons [N]
    activations: Array
    forces: Array
    reserves: Array  # (actuators,) their forces [N] and torques [N m]
    balanced: Array  # (rows,) what muscles and actuators had to give together, in the order of `OnlineTension.rows`
    status: int  # index into `STATUS_NAMES`
    equilibrium_residual: float  # greatest torque or force left unbalanced [N m or N]


class OnlineTension:
    """The problem of `solve_tension`, set up once.
    `actuators`: as of `solve_tension`. `muscles`, `actuators`: names; `rows`: names of the coordinates that are
    balanced; `lower`, `upper` (muscles,) bounds of the activations.
    """

    def __init__(
        self, model: Model, options: TensionOptions | None = None, actuators: Sequence[Actuator] | None = None
    ):
        if model.loops:
            raise BadModel(
                f"model '{model.name}' closes loops ('{model.loops[0].name}'), which muscle tensions frame by frame do "
                "not take: use 'myomorph tension' after the recording"
            )
        rest = np.array([[coordinate.default for coordinate in model.coordinates]])
        still = Motion(np.zeros(1), model.coordinate_names, rest, np.zeros_like(rest))
        none = Series(np.zeros(1), model.coordinate_names, np.zeros_like(rest))
        self._problem = tension_problem(TensionInputs(model, still, none, options or TensionOptions(), actuators))
        self.actuators = tuple(actuator.name for actuator in self._problem.actuators.actuators)
        self.muscles = model.muscle_names
        self.rows = self._problem.assembly.rows
        shared, muscles = self._problem.separable, len(self.muscles)
        self.lower, self.upper = shared.lower[:muscles], shared.upper[:muscles]
        self._optimal_forces = self._problem.actuators.optimal_forces
        self._warm = np.zeros(len(self._problem.assembly.pattern.order))

    def solve(self, coordinates: Array, rates: Array, torques: Array) -> TensionFrame:
        """Share torques of a frame among muscles; all (1, coordinates), consistent, of inverse dynamics [N m or N]."""
        self._problem.renew(coordinates, rates, torques)
        balance = self._problem.balance(0, 1)
        x, _, residual, _, status = self._problem.solved(balance, 0, self._warm)
        if status[0] != OPTIMAL:
            self._warm[:] = 0.0
        muscles = len(self.muscles)
        activations = x[0, :muscles]
        forces = balance.active[0] * activations + balance.passive[0] + balance.viscous[0]
        reserves = x[0, muscles:] * self._optimal_forces
        return TensionFrame(activations, forces, reserves, balance.torques[0], int(status[0]), float(residual[0]))
