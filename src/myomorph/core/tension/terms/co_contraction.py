"""Co-contraction as a term: muscles on both sides of a joint give at least a share of what they
can.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData, check_name
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion, Series
from myomorph.core.muscles.passive import joint_forces
from myomorph.core.muscles.path import compile_paths
from myomorph.core.rigid.dynamics import rates_of
from myomorph.core.rigid.forward import gathered
from myomorph.core.rigid.tree import compile_tree
from myomorph.core.tension.terms.actuators import free_coordinates
from myomorph.core.tension.terms.muscles import MuscleTerm
from myomorph.core.tension.terms.term import LIMIT_COST, Frames, Rows, Term, Unknowns, Variables

WEIGHT = 100.0
"""Cost of a co-contraction that lacks, squared, in units of the effort a^2 of one muscle: an aim
and no constraint, so that a joint whose muscles cannot do it still has a solution.
"""
SMALL = 1e-4  # Moment arms below this turn nothing [m]


class CoContractionTerm(Term):
    """At every coordinate that muscles turn both ways, the weaker side gives at least `level` of
    what it can.

    With moment arms r and forces F of unit activation, A = min over the sides of sum |r| F, and the
    joint torque tau,

        sum_m |r_m| F_m a_m / A >= |tau| / A + 2 level

    as both sides together give |tau| and twice the torque of the weaker side. What lacks costs
    `WEIGHT` times its square; more than that costs nothing but its effort.

    `motion`: with velocities; `torques`: joint torques at the motion's times [N m]; `level`: 0 to
    1; `coordinates`: names; none for all rotations that muscles turn both ways.
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
        free = free_coordinates(model)
        for name in coordinates:
            check_name("free coordinate", name, free)
        values, rates = rates_of(self._tree, motion)
        known = {name: torques[name] for name in torques.names}
        tau = np.array(
            [known.get(name, np.zeros(len(motion))) for name in model.coordinate_names]
        ).T
        every = np.linspace(0, len(motion) - 1, min(len(motion), 9)).round().astype(int)
        arms = self._arms(self._paths.evaluate(values[every], rates[every])[2])
        wanted = [
            index
            for index, name in enumerate(model.coordinate_names)
            if name in (coordinates or free)
        ]
        rotates = [number for number in wanted if model.coordinates[number].motion == "rotational"]
        both = [
            rotate
            for rotate in rotates
            if (arms[:, :, rotate] > SMALL).any(1).all()
            and (arms[:, :, rotate] < -SMALL).any(1).all()
        ]
        if coordinates and len(both) < len(wanted):
            lacking = next(
                model.coordinate_names[number] for number in wanted if number not in both
            )
            raise BadData(
                f"muscles do not turn '{lacking}' both ways: there is no co-contraction of it"
            )
        if not both:
            raise BadData(
                f"muscles of model '{model.name}' turn no joint both ways: there is no"
                " co-contraction"
            )
        self.coordinates = tuple(model.coordinate_names[number] for number in both)
        self._columns = both
        self._crossing = [
            np.flatnonzero((np.abs(arms[:, :, number]) > SMALL).any(axis=0)) for number in both
        ]
        left = gathered(self._tree, values, tau - joint_forces(self._tree, values, rates))
        self._torque = np.abs(left[:, both])

    def _arms(self, arms: Array) -> Array:
        """(frames, muscles, coordinates) moment arms; those of a coordinate that leads hold what
        follows it.
        """
        whole = np.zeros((len(arms), len(self._paths.muscles), len(self._tree.model.coordinates)))
        whole[:, self._paths.arm_muscle, self._paths.arm_coordinate] = arms
        return whole

    def variables(self) -> Variables:
        """How far each coordinate passes what is asked for."""
        count = len(self.coordinates)
        names = tuple(f"co-contraction of {name} beyond" for name in self.coordinates)
        ends = np.zeros(count), np.full(count, np.inf)
        return Variables(names, np.full(count, LIMIT_COST), np.full(count, 2.0), *ends)

    def rows(self, unknowns: Unknowns) -> Rows:
        """A row a coordinate, of the muscles that cross it and of what passes."""
        self._muscles = next(term for term in unknowns.terms if isinstance(term, MuscleTerm))
        first = unknowns.of(self._muscles).start
        beyond = unknowns.of(self).start
        columns = [np.append(first + of, beyond + j) for j, of in enumerate(self._crossing)]
        names = tuple(f"co-contraction of {name}" for name in self.coordinates)
        return Rows.of_frames(names, columns, 1.0, WEIGHT, on_forces=True)

    def row_values(self, rows: Rows, frames: Frames) -> tuple[Array, Array]:
        """|r| F / A of each muscle, and |tau| / A + 2 level."""
        result = self._muscles.forces(frames)
        turning = self._arms(result.arms)[:, :, self._columns] * result.active[..., None]
        sides = [np.maximum(sign * turning, 0.0).sum(axis=1) for sign in (1.0, -1.0)]
        weaker = np.maximum(np.minimum(*sides), 1e-9)
        size = np.abs(turning) / weaker[:, None]
        beyond = -np.ones((len(frames), 1))
        values = [np.hstack([size[:, of, j], beyond]) for j, of in enumerate(self._crossing)]
        return np.hstack(values), self._torque[frames.part] / weaker + 2.0 * self._level
