"""A simulated motion, with what caused it and how sure its steps are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion, Series
from myomorph.forward.arrays import WORKS

MIN_ENERGY = 1e-3  # Least energy that a residual is held against [J]


@dataclass(frozen=True, kw_only=True)
class StepCounts:
    """Work of the integrator.

    Attributes
    ----------
    steps, rejected, evaluations : steps taken and given up, and evaluations of the equations
    """

    steps: int
    rejected: int
    evaluations: int


@read_only
class EnergyBalance:
    """Energy of a motion against the work of what moved it.

        kinetic + potential = initial + sum of works + residual

    Attributes
    ----------
    time : (frames,) [s]
    kinetic, potential : (frames,) [J]
    work : (frames, works) since the start, of each of `names` [J]
    names : what does work
    """

    time: Array
    kinetic: Array
    potential: Array
    work: Array
    names: tuple[str, ...] = WORKS

    @cached_property
    def residual(self) -> Array:
        """(frames,) energy that no work explains [J]."""
        energy = self.kinetic + self.potential
        return energy - energy[0] - self.work.sum(axis=1)

    @cached_property
    def exchanged(self) -> float:
        """Energy that the residual is held against: the most that was moving or worked [J]."""
        most = max(float(np.abs(self.work).max(initial=0.0)), float(np.ptp(self.potential)))
        return max(most, float(self.kinetic.max(initial=0.0)), MIN_ENERGY)

    @property
    def largest_share(self) -> float:
        """Largest residual by the energy exchanged."""
        return float(np.abs(self.residual).max(initial=0.0)) / self.exchanged


@read_only
class Simulation:
    """A simulated motion.

    Attributes
    ----------
    model : that moved
    motion : all coordinates with velocities and accelerations
    muscles : names
    activation, muscle_force : (frames, muscles) [1], [N]
    muscle_length, muscle_velocity : (frames, muscles) of the path [m], [m/s]
    fiber_length : (frames, elastic muscles) [m]
    elastic : names of muscles whose tendons stretch
    feedback : (frames, free coordinates) forces of the feedback [N m or N]
    free : names of coordinates that move freely
    contact_force, contact_point : (frames, spheres, 3) in ground [N], [m]
    contact_bodies : (spheres,) names of the bodies that carry the spheres
    energy : balance
    counts : of steps
    tolerance : of the error of a step
    halved : largest difference of any coordinate from a run with half the tolerance [rad or m]; NaN
        where none was made
    notes : what to look at
    """

    model: Model
    motion: Motion
    muscles: tuple[str, ...]
    activation: Array
    muscle_force: Array
    muscle_length: Array
    muscle_velocity: Array
    fiber_length: Array
    elastic: tuple[str, ...]
    feedback: Array
    free: tuple[str, ...]
    contact_force: Array
    contact_point: Array
    contact_bodies: tuple[str, ...]
    energy: EnergyBalance
    counts: StepCounts
    tolerance: float
    halved: float = float("nan")
    notes: tuple[Message, ...] = ()

    @property
    def time(self) -> Array:
        """(frames,) [s]."""
        return self.motion.time

    def feedback_share(self, torques: Series) -> Mapping[str, float]:
        """Size of the feedback by that of the torques, by coordinate.

        Parameters
        ----------
        torques : what drives the body [N m or N]

        Returns
        -------
        root mean square of the feedback over that of the torque, of free coordinates with a torque
        """
        shares = {}
        for column, name in enumerate(self.free):
            if name not in torques.names:
                continue
            driven = _rms(torques.values[:, torques.names.index(name)])
            if driven > 0.0:
                shares[name] = _rms(self.feedback[:, column]) / driven
        return shares


def _rms(values: Array) -> float:
    """Root mean square of values (frames,)."""
    return float(np.sqrt(np.mean(np.square(values))))
