"""EMG in the separable problem: what pulls an activation towards what was measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from myomorph.model.arrays import Array
from myomorph.model.errors import BadData
from myomorph.model.model import index_of
from myomorph.tension.emg import EmgTarget

STIFFNESS = 1e4
"""Cost of passing the slack of an equality, of the excess squared, in units of the effort a^2 of one muscle."""


@dataclass(frozen=True, eq=False)
class Wells:
    """What pulls variables towards intervals, kept for those variables alone that anything pulls.

    Attributes
    ----------
    base : (3, variables) l, h and k of all frames
    columns : (told,) variables that EMG tells of
    values : (frames, 3, told) l, h and k of these
    """

    base: Array
    columns: NDArray[np.int64]
    values: Array

    def __getitem__(self, frames: slice | NDArray[np.int64]) -> Array:
        """Wells of some frames for `solve_separable`, (frames, 3, variables); (1, 3, variables) where all are alike."""
        if not len(self.columns):
            return self.base[None]
        told = self.values[frames]
        found = np.repeat(self.base[None], len(told), axis=0)
        found[:, :, self.columns] = told
        return found


def emg_wells(emg: EmgTarget | None, muscles: tuple[str, ...], variables: int, frames: int) -> Wells:
    """Intervals that activations are drawn into, and how strongly.

    The cost gains k dist(a, [l, h])^2: l = h = EMG with a soft target, EMG -+ slack with an equality.

    Raises
    ------
    BadData
        where EMG has another number of frames than the motion, or tells of a muscle twice
    UnknownName
        where it tells of a muscle that the model does not have
    """
    if emg is None:
        return Wells(np.zeros((3, variables)), np.zeros(0, np.int64), np.zeros((0, 3, 0)))
    if len(emg.activations) != frames:
        raise BadData(f"EMG has {len(emg.activations)} frames, the motion {frames}: both must have the same times")
    columns = [index_of("muscle", name, muscles, "the model, for EMG,") for name in emg.muscles]
    if len(set(columns)) != len(columns):
        twice = next(name for name in emg.muscles if emg.muscles.count(name) > 1)
        raise BadData(f"EMG tells of muscle '{twice}' twice: combine its channels first")
    slack, stiffness = (0.0, emg.weight) if emg.mode == "soft" else (emg.slack, STIFFNESS)
    pulls = np.where(np.isfinite(emg.activations), stiffness, 0.0)
    told = np.stack([emg.activations - slack, emg.activations + slack, pulls], axis=1)
    return Wells(np.zeros((3, variables)), np.array(columns, np.int64), told)
