"""Co-contraction as a term: both sides of a joint give at least a share of what they can."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData, check_name
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion, Series
from myomorph.core.muscles.model_paths import compile_paths
from myomorph.core.muscles.passive import joint_forces
from myomorph.core.rigid.dynamics import values_and_rates
from myomorph.core.rigid.forward import gathered
from myomorph.core.rigid.tree import compile_tree
from myomorph.core.tension.terms.actuators import balanced_coordinates
from myomorph.core.tension.terms.least_value import LeastValueTerm
from myomorph.core.tension.terms.term import Frames

MIN_ARM = 1e-4
"""Moment arms below this turn nothing [m]."""
MAX_FRAMES_LOOKED_AT = 9
"""Number of frames, evenly over the motion, whose moment arms tell who turns a joint."""


class CoContractionTerm(LeastValueTerm):
    """The weaker side of every joint that muscles turn both ways gives at least a share.

    With moment arms r and forces F of unit activation, A = min over the sides of sum |r| F, and the
    joint torque tau,

        sum_m |r_m| F_m a_m / A >= |tau| / A + 2 level

    as both sides together give |tau| and twice the torque of the weaker side. What is missing costs
    `WEIGHT` times its square; more than that costs nothing but its effort.

    Parameters
    ----------
    motion : with velocities
    torques : joint torques at the motion's times [N m]
    level : share of what the weaker side can give, 0 to 1
    coordinates : names; none for all rotations that muscles turn both ways

    Raises
    ------
    BadData : `level` is not above 0 and at most 1, or muscles do not turn a coordinate both ways
    UnknownName : a coordinate is not free
    """

    def __init__(
        self,
        model: Model,
        motion: Motion,
        torques: Series,
        level: float,
        coordinates: Sequence[str] = (),
    ):
        if not 0.0 < level <= 1.0:
            raise BadData(f"co-contraction of {level:g}: expected above 0, at most 1")
        self._tree = compile_tree(model)
        self._paths = compile_paths(model)
        self._level = level
        free = balanced_coordinates(model)
        for name in coordinates:
            check_name("free coordinate", name, free)
        values, rates = values_and_rates(self._tree, motion)
        looked_at = np.linspace(0, len(motion) - 1, min(len(motion), MAX_FRAMES_LOOKED_AT))
        frames = looked_at.round().astype(int)
        arms = self._arms(self._paths.evaluate(values[frames], rates[frames])[2])
        self._columns = _turned_both_ways(model, arms, coordinates)
        self.coordinates = tuple(model.coordinate_names[column] for column in self._columns)
        self._crossing = [
            np.flatnonzero((np.abs(arms[:, :, column]) > MIN_ARM).any(axis=0))
            for column in self._columns
        ]
        super().__init__([f"co-contraction of {name}" for name in self.coordinates], self._crossing)

        # What springs and bushings of joints give is not asked of muscles.
        none = np.zeros(len(motion))
        known = {name: torques[name] for name in torques.names}
        tau = np.array([known.get(name, none) for name in model.coordinate_names]).T
        balanced = gathered(self._tree, values, tau - joint_forces(self._tree, values, rates))
        self._torque = np.abs(balanced[:, self._columns])

    def _arms(self, arms: Array) -> Array:
        """Write moment arms out; those of a coordinate that leads hold what follows it.

        Parameters
        ----------
        arms : (frames, entries) in the order of `compile_paths` [m]

        Returns
        -------
        (frames, muscles, coordinates) [m]
        """
        shape = (len(arms), len(self._paths.muscles), len(self._tree.model.coordinates))
        result = np.zeros(shape)
        result[:, self._paths.arm_muscle, self._paths.arm_coordinate] = arms
        return result

    def least_values(self, frames: Frames) -> tuple[list[Array], Array]:
        """|r| F / A of each muscle, and |tau| / A + 2 level.

        Parameters
        ----------
        frames : a chunk of the motion

        Returns
        -------
        (frames, crossing muscles) of each coordinate, and (frames, coordinates)
        """
        muscles = self._muscles.forces(frames)
        turning = self._arms(muscles.arms)[:, :, self._columns] * muscles.active[..., None]
        flexing = np.maximum(turning, 0.0).sum(axis=1)
        extending = np.maximum(-turning, 0.0).sum(axis=1)
        weaker = np.maximum(np.minimum(flexing, extending), 1e-9)
        size = np.abs(turning) / weaker[:, None]
        values = [size[:, crossing, j] for j, crossing in enumerate(self._crossing)]
        return values, self._torque[frames.part] / weaker + 2.0 * self._level


def _turned_both_ways(model: Model, arms: Array, coordinates: Sequence[str]) -> list[int]:
    """Numbers of the rotations that muscles turn both ways.

    Parameters
    ----------
    arms : (frames, muscles, coordinates) moment arms in some frames [m]
    coordinates : names of those that must be turned both ways; none for all that are

    Raises
    ------
    BadData : muscles do not turn one of `coordinates` both ways, or turn none so
    """
    chosen = coordinates or balanced_coordinates(model)
    wanted = [index for index, name in enumerate(model.coordinate_names) if name in chosen]
    # (coordinates,) whether some muscle turns a coordinate that way in every frame
    forward = np.asarray((arms > MIN_ARM).any(axis=1)).all(axis=0)
    backward = np.asarray((arms < -MIN_ARM).any(axis=1)).all(axis=0)
    both_ways = np.asarray(forward & backward)
    turned = [
        index
        for index in wanted
        if model.coordinates[index].motion == "rotational" and both_ways[index]
    ]
    if coordinates and len(turned) < len(wanted):
        missing = next(model.coordinate_names[index] for index in wanted if index not in turned)
        raise BadData(
            f"muscles do not act on '{missing}' in both directions: there is no co-contraction of"
            " it"
        )
    if not turned:
        raise BadData(
            f"muscles of model '{model.name}' act on no joint in both directions: there is no"
            " co-contraction"
        )
    return turned
