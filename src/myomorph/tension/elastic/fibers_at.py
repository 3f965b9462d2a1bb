"""Fibers and tendons at the frames, from the tendon forces that were found."""

from __future__ import annotations

import numpy as np

from myomorph.model.arrays import Array
from myomorph.muscles.fiber_jets import tendon_jet
from myomorph.rigid.kernels import kernel
from myomorph.tension.elastic.term import ElasticMuscleTerm


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
