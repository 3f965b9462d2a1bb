"""Muscles as a term: activations, effort, moment arms times force, and passive force."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.model import Model
from myomorph.core.muscles.hill import compile_hill, rigid_tendon_forces, viscosities
from myomorph.core.muscles.model_paths import compile_paths
from myomorph.core.rigid.tree import Tree
from myomorph.core.tension.tension import TensionOptions
from myomorph.core.tension.terms.term import Columns, Frames, Penalties, Term, Unknowns, Variables

SECOND_STAGE = 1e-5
"""With recruitment "minmax" the cost of a^2, of a greatest activation of 1: any cost small enough
gives the same solution, the least sum of squares of all that have the least greatest activation
(Mangasarian and Meyer 1979).
"""

HIGHEST_POWER = 4.0
"""Above this exponent w a^p is so flat near 0 that rounding would decide on small activations: some
a^2 is added.
"""


class MuscleForces(NamedTuple):
    """Moment arms and forces of muscles in some frames.

    Attributes
    ----------
    arms : (frames, entries) moment arms [m], in the order of `compile_paths`
    active : (frames, muscles) force per unit activation [N]
    passive, viscous : (frames, muscles) passive elastic and viscous force [N]
    """

    arms: Array
    active: Array
    passive: Array
    viscous: Array


class MuscleTerm(Term):
    """sum_m w_m a_m^p of activations a, with forces R^T (F a + F_passive + F_viscous).

    Source: Crowninshield and Brand 1981 for the effort.

    Attributes
    ----------
    names : of the muscles
    strength : (muscles,) maximum isometric force [N]
    viscous : whether a muscle has viscosity that takes part
    lower, upper : (muscles,) bounds of the activations, 0 of muscles that are switched off
    """

    def __init__(self, tree: Tree, options: TensionOptions):
        muscles = tree.model.muscles
        self._options = options
        self.names = tree.model.muscle_names
        self._hill = compile_hill(tree.model, options.convention)
        self._paths = compile_paths(tree.model)
        self._enabled = np.array([muscle.enabled for muscle in muscles], dtype=np.bool_)
        self._viscosity = viscosities(tree.model) * options.viscous
        self.viscous = bool(self._viscosity.any())
        self.strength = np.array(
            [muscle.max_isometric_force for muscle in muscles], dtype=np.float64
        )
        # A muscle that is switched off has no force, so its activation must not be free.
        lower = np.zeros(len(muscles))
        if options.min_activation == "model":
            lower = np.array([muscle.min_activation for muscle in muscles], dtype=np.float64)
        self.lower = np.where(self._enabled, lower, 0.0)
        self.upper = np.where(self._enabled, [muscle.max_activation for muscle in muscles], 0.0)
        self._weight = self._effort_weights(tree.model)

    def _effort_weights(self, model: Model) -> Array:
        """(muscles,) weights w of the effort."""
        options = self._options
        weight = np.ones(len(model.muscles))
        if options.weights != "equal" and self._enabled.any():
            size = self.strength
            if options.weights == "volume":
                size = size * [muscle.optimal_fiber_length for muscle in model.muscles]
            weight = size / size[self._enabled].mean()
        return SECOND_STAGE * weight if options.recruitment == "minmax" else weight

    def variables(self) -> Variables:
        """Activations, with the effort."""
        exponent = np.full(len(self._weight), self._options.exponent)
        return Variables(
            names=self.names,
            weight=self._weight,
            exponent=exponent,
            lower=self.lower,
            upper=self.upper,
        )

    def penalties(self, unknowns: Unknowns) -> Penalties | None:
        """Add a curvature at 0 where the exponent leaves none."""
        if self._options.exponent <= HIGHEST_POWER:
            return None
        columns = unknowns.of(self)
        zero = np.zeros((1, len(self._weight)))
        # A hundredth of the curvature that w a^p has where an activation is about 0.2.
        share = 0.01 * 0.2 ** (self._options.exponent - 2.0)
        return Penalties(
            columns=range(columns.start, columns.stop),
            low=zero,
            high=zero,
            weight=share * self._weight[None],
        )

    def entries(self) -> Sequence[tuple[int, int]]:
        """Muscle and coordinate of each moment arm.

        Moment arms about a coordinate already hold what reaches the muscle through couplers.
        """
        paths = self._paths
        return [
            (int(m), int(j) if free else -1)
            for m, j, free in zip(
                paths.arm_muscle, paths.arm_coordinate, paths.arm_free, strict=True
            )
        ]

    def columns(self, frames: Frames) -> Columns:
        """Moment arms, active forces, and passive and viscous forces."""
        result = self.forces(frames)
        return Columns(
            entries=result.arms, forces=result.active, given=result.passive + result.viscous
        )

    def forces(self, frames: Frames) -> MuscleForces:
        """Moment arms and forces of some frames."""
        return frames.once(self, self._forces)

    def _forces(self, frames: Frames) -> MuscleForces:
        """Moment arms and forces of some frames, computed."""
        options = self._options
        lengths, speeds, arms = self._paths.evaluate(frames.coordinates, frames.rates)
        active, passive = rigid_tendon_forces(self._hill, lengths, speeds, options.passive_on_rigid)
        if options.curves == "constant":
            active[:] = np.where(np.isnan(active), np.nan, self.strength)
        active *= self._enabled
        passive *= self._enabled
        return MuscleForces(
            arms=arms, active=active, passive=passive, viscous=self._viscosity * speeds
        )
