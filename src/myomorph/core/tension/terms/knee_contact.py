"""Knees that stay in contact: each side of a nearly straight knee carries at least a share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData
from myomorph.core.model.model import Model
from myomorph.core.muscles.model_paths import compile_paths
from myomorph.core.muscles.patella import with_lever
from myomorph.core.rigid.coordinates import Ints
from myomorph.core.tension.terms.least_value import LeastValueTerm
from myomorph.core.tension.terms.term import Frames

NOTHING_ASKED = -1e3  # Least force of frames that are bent farther [body weights]


class Side(NamedTuple):
    """One side of a knee.

    Attributes
    ----------
    knee : name of the joint
    point : name of its contact point
    opposite : (frames, 3) the other side's point, about which moments are taken [m]
    per_moment : (frames, 3) force of this side for unit moment about it along each axis [1/m]
    alone : (frames,) force without muscles [body weights]
    asked : (frames,) whether the knee is straight enough
    muscles : (crossing,) numbers of those that cross the knee
    pairs : rows of `Paths.pulls` on the shank and beyond
    owners : (crossing, pairs) 1 where a pull is of a muscle, else 0
    """

    knee: str
    point: str
    opposite: Array
    per_moment: Array
    alone: Array
    asked: Array
    muscles: Ints
    pairs: Ints
    owners: Array


class KneeContactTerm(LeastValueTerm):
    """Each side of a nearly straight knee carries at least a share of the body's weight.

    With the points r and o of both sides, the force F and moment M that the joint transmits, and
    a the axis about which both points make moments along their mean normal n,

        f = a . (M - o x F) / a . ((r - o) x n)  >=  level W

    It is linear in activations. What is missing costs `WEIGHT` times its square; more costs nothing
    but its effort. An implant never measured that a side lifts off, least effort lets it.

    Parameters
    ----------
    model : with muscles
    sides : of its knees, as of `knee_sides`
    level : least force of each side [body weights], above 0

    Raises
    ------
    BadData : `level` is not above 0 or is above 1
    """

    def __init__(self, model: Model, sides: Sequence[Side], level: float):
        if not 0.0 < level <= 1.0:
            raise BadData(f"knee_contact {level:g}: expected above 0, at most 1 body weight")
        self._paths = compile_paths(model)
        self._weight = model.weight
        self._level = level
        self._sides = tuple(sides)
        names = [f"{side.point} of {side.knee}" for side in self._sides]
        super().__init__(names, [side.muscles for side in self._sides])

    def least_values(self, frames: Frames) -> tuple[list[Array], Array]:
        """Force on each side per unit activation, and what is missing without activations.

        Parameters
        ----------
        frames : a chunk of the motion

        Returns
        -------
        (frames, crossing muscles) of each side, and (frames, sides), all in body weights
        """
        muscles = self._muscles.forces(frames)
        pulls, work = self._paths.pulls(frames.coordinates)
        pulls = with_lever(self._paths, frames.coordinates, pulls, work)
        anyway = muscles.passive + muscles.viscous
        values = []
        targets = []
        for side in self._sides:
            unit = np.einsum("mp,fpi->fmi", side.owners, pulls[:, side.pairs])
            opposite = side.opposite[frames.part, None]
            moments = unit[..., 3:] - np.cross(opposite, unit[..., :3])
            # The bones push back against what muscles pull.
            share = -np.einsum("fmi,fi->fm", moments, side.per_moment[frames.part]) / self._weight
            values.append(share * muscles.active[:, side.muscles])
            least = np.where(side.asked[frames.part], self._level, NOTHING_ASKED)
            carried = np.einsum("fm,fm->f", share, anyway[:, side.muscles])
            targets.append(least - side.alone[frames.part] - carried)
        return values, np.stack(targets, axis=1)
