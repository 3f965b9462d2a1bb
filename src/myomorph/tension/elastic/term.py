"""Muscles on elastic tendons as a term: the unknown is the activation still, but columns are those of tendon forces."""

from __future__ import annotations

import numpy as np

from myomorph.model.arrays import Array
from myomorph.muscles.fiber_jets import tendon_jet
from myomorph.muscles.hill import fill_hill_forces
from myomorph.muscles.hill_arrays import activation_times, compile_elastic, has_elastic_tendon, muscle_models
from myomorph.rigid.kernels import kernel
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


@kernel(counted=False)
def _stretches(E, elastic, f, out):
    """Tendon length over slack length (frames, muscles) at normalized forces f, 1 of a rigid tendon."""
    for m in range(f.shape[1]):
        for index in range(f.shape[0]):
            out[index, m] = 1.0
            if elastic[m]:
                out[index, m] = tendon_jet(E, m, f[index, m])[0] if f[index, m] == f[index, m] else np.nan


def fibers_at(
    term: ElasticMuscleTerm, time: Array, lengths: Array, speeds: Array, f: Array, forces: Array
) -> tuple[Array, Array, Array, Array, Array]:
    """Lengths and velocities of fibers, strains of tendons, powers of fibers and of tendons: fields of `Fibers`.
    A tendon's speed at a frame is the mean of those before and after it.
    `lengths`, `speeds` (frames, muscles) of the paths [m], [m/s]; `f` (frames, muscles) normalized tendon forces, not
    read of rigid tendons; `forces` (frames, muscles) [N].
    """
    H = term.arrays.hill
    stretch = np.empty_like(f)
    _stretches(term.arrays, term.elastic, f, stretch)
    stretch = np.where(np.isnan(forces), np.nan, stretch)
    tendon = stretch * H.tendon
    speed = np.zeros_like(tendon)
    if len(time) > 1:
        each = np.diff(tendon, axis=0) / np.diff(time)[:, None]
        ends = np.full((1, each.shape[1]), np.nan)
        both = np.stack([np.concatenate([ends, each]), np.concatenate([each, ends])])
        known = np.isfinite(both)
        count = known.sum(axis=0)
        speed = np.where(count > 0, np.where(known, both, 0.0).sum(axis=0) / np.maximum(count, 1), 0.0)
    along = lengths - tendon
    fiber = np.sqrt(along**2 + H.height**2)
    velocity = (speeds - speed) * along / fiber
    of_path, of_tendon = -forces * speeds, -forces * speed
    return fiber, velocity, stretch - 1.0, of_path - of_tendon, of_tendon
