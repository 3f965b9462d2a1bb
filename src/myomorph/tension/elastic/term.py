"""Muscles on elastic tendons as a term: the unknown is the activation still, but columns are those of tendon forces."""

from __future__ import annotations

import numpy as np

from myomorph.model.arrays import Array
from myomorph.muscles.hill import fill_hill_forces
from myomorph.muscles.hill_arrays import activation_times, compile_elastic, has_elastic_tendon, muscle_models
from myomorph.rigid.tree import Tree
from myomorph.tension.elastic.program import Rates
from myomorph.tension.tension import TensionOptions
from myomorph.tension.terms.muscles import MuscleForces, MuscleTerm
from myomorph.tension.terms.term import Frames


class ElasticMuscleTerm(MuscleTerm):
    """A muscle's column is that of its maximum isometric force, by which tendon forces are normalized.
    `arrays`: curves of fibers and tendons; `elastic` (muscles,) which muscles have an elastic tendon; a muscle whose
    fibers cannot reach is taken off.
    """

    def __init__(self, tree: Tree, options: TensionOptions):
        super().__init__(tree, options)
        muscles = tree.model.muscles
        self.arrays = compile_elastic(tree.model, options.passive)
        self.elastic = np.array([has_elastic_tendon(muscle) for muscle in muscles], np.bool_) & (self.upper > 0.0)
        rise, fall = activation_times(tree.model)
        self.rates = Rates(rise, fall, np.array([kind.smooth for kind in muscle_models(tree.model)], np.bool_))

    def paths_of(self, coordinates: Array, rates: Array) -> tuple[Array, Array]:
        """Lengths and lengthening velocities (frames, muscles) of the paths [m], [m/s]."""
        lengths, speeds, _ = self._paths.evaluate(coordinates, rates)
        return lengths, speeds

    def rigid_forces(self, lengths: Array, speeds: Array) -> tuple[Array, Array]:
        """Active force per unit activation and passive force (frames, muscles) on rigid tendons [N]."""
        active, passive = np.empty_like(lengths), np.empty_like(lengths)
        fill_hill_forces(self.arrays.hill, lengths, speeds, self._options.passive, active, passive)
        return active * self._enabled, passive * self._enabled

    def _forces(self, frames: Frames) -> MuscleForces:
        lengths, speeds, arms = self._paths.evaluate(frames.coordinates, frames.rates)
        active, passive = self.rigid_forces(lengths, speeds)
        active[:, self.elastic] = np.where(np.isnan(lengths), np.nan, self.strength)[:, self.elastic]
        passive[:, self.elastic] = 0.0
        return MuscleForces(arms, active, passive, self._viscosity * speeds)
