"""Steps 1 and 2 of one condition, once with all blocks of swings and once with half of each block left out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.errors import BadData
from myomorph.viscosity.joint_viscosity import JointViscosity, joint_viscosity, torque_problem
from myomorph.viscosity.limb_inertia import InertiaOptions, LimbInertia, limb_inertia
from myomorph.viscosity.resampling import Influences
from myomorph.viscosity.swing_sums import SwingSums

LACKING = 0.5
"""How much of a block is left out: half. With leverage h the change is then 1 / (1 - h / 2) times what it would be
without, almost the 1 / sqrt(1 - h) that makes its square unbiased; leaving out all gives 1 / (1 - h)."""


@dataclass(frozen=True, eq=False)
class Solution:
    """Steps 1 and 2 from some of the blocks.

    Attributes
    ----------
    counts : (blocks,) how often each block counts
    joint : from the torque by inverse dynamics
    plate : from the moment about the joint that the plate measures
    """

    counts: Array
    inertia: LimbInertia
    joint: JointViscosity
    plate: JointViscosity

    @property
    def estimates(self) -> Array:
        """(4 + axes,) mass, mass center, one viscosity, that of the plate, and one an axis."""
        return np.array([self.inertia.mass, self.inertia.com, self.joint.one, self.plate.one, *self.joint.axes])


@dataclass(frozen=True, eq=False)
class ConditionSolution:
    """All swings of a condition, and what each block adds.

    Attributes
    ----------
    whole : with every block
    lacking : (blocks,) with `LACKING` of one block left out
    """

    sums: SwingSums
    whole: Solution
    lacking: tuple[Solution, ...]
    stiffness: bool

    @property
    def influences(self) -> Influences:
        """Of the blocks on `Solution.estimates`."""
        value = self.whole.estimates
        blocks = np.array([value - one.estimates for one in self.lacking]) / LACKING
        return Influences(value, blocks, self.sums.trial, self.sums.parted)

    def torque(self, solution: Solution) -> Array:
        """(axes, 2 + muscles, 2 + muscles) `torque_problem` of a solution."""
        return torque_problem(self.sums.torque_total(solution.counts), solution.inertia.parameters, self.stiffness)


def solve_condition(sums: SwingSums, inertial: InertiaOptions, stiffness: bool) -> ConditionSolution:
    """Inertia and joint viscosity of the sums, with all blocks and with a part of each left out.

    Raises
    ------
    BadData : fewer than three blocks, or as `limb_inertia`
    """
    if len(sums) < 3:
        raise BadData(
            f"{len(sums)} blocks of swings in all: intervals need at least three; record longer, release more often, "
            "or make the blocks smaller"
        )
    every = np.ones(len(sums))
    whole = _solve(sums, every, inertial, stiffness, None)
    lacking = [
        _solve(sums, every - LACKING * one, inertial, stiffness, whole.inertia.noise) for one in np.eye(len(sums))
    ]
    return ConditionSolution(sums, whole, tuple(lacking), stiffness)


def _solve(sums: SwingSums, counts: Array, inertial: InertiaOptions, stiffness: bool, noise: Array | None) -> Solution:
    inertia = limb_inertia(sums, counts, inertial, noise)
    products, frames = sums.torque_total(counts), float(counts @ sums.frames)
    return Solution(
        counts,
        inertia,
        joint_viscosity(torque_problem(products, inertia.parameters, stiffness), frames),
        joint_viscosity(torque_problem(products, None, stiffness), frames),
    )
