"""Steps 1 and 2 of one condition, with all blocks of swings and with half of each left out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData
from myomorph.swings.viscosity.identification.inertia import (
    InertiaOptions,
    LimbInertia,
    limb_inertia,
)
from myomorph.swings.viscosity.identification.torque import (
    JointViscosity,
    joint_viscosity,
    torque_problem,
)
from myomorph.swings.viscosity.swings.sums import SwingSums

REJECT = 0.05  # Share of specimens with equal trials whose trials are taken to differ.


LACKING = 0.5
"""How much of a block is left out: half. With leverage h the change is then 1 / (1 - h / 2) times
what it would be without, almost the 1 / sqrt(1 - h) that makes its square unbiased; leaving out all
gives 1 / (1 - h)."""


@read_only
class Influences:
    """What blocks add to estimates, from which intervals are drawn.

    It is a studentised wild bootstrap over blocks of swings, or over trials. Swings of a trial die
    away, so that few blocks hold most of what is known: draws with replacement, which lose the
    first swing of a trial every third time, scatter far more than the estimate does. Here the
    swings stay as they are and only their misfits are drawn: with u_b twice what the estimate
    changes when half of block b is left out,

        draw = estimate + t sum_b z_b u_b,    z_b normal,  t = sqrt(dof / chi^2_dof)

    (the wild bootstrap of Wu 1986 in clusters, Cameron, Gelbach, Miller 2008, of influences that
    grow with a block's leverage as MacKinnon and White 1985 ask; t with the degrees of freedom of
    Satterthwaite 1946). Where the sums of u_b over trials scatter more than independent blocks
    could make them, trials are drawn instead of blocks.

    Attributes
    ----------
    values : (estimates,)
    blocks : (blocks, estimates) u_b
    trial : (blocks,) number of the trial of each
    parted : by how much less blocks scatter because they share frames (`SwingSums.parted`)
    """

    values: Array
    blocks: Array
    trial: np.ndarray
    parted: float = 1.0

    @property
    def trials(self) -> Array:
        """(trials, estimates) sums over the blocks of each trial."""
        return np.stack(
            [self.blocks[self.trial == number].sum(axis=0) for number in np.unique(self.trial)]
        )

    @property
    def by_trial(self) -> np.ndarray:
        """(estimates,) whether trials differ more than their blocks tell (a test of variances)."""
        if len(self.trials) < 2:
            return np.zeros(len(self.values), bool)
        inner = np.square(self.blocks).sum(axis=0)
        outer = np.square(self.trials).sum(axis=0)
        inner = inner / self.parted
        ratio = np.divide(outer, inner, out=np.zeros_like(outer), where=inner > 0.0)
        most = scipy.stats.f.ppf(1.0 - REJECT, _freedom(self.trials), _freedom(self.blocks))
        return ratio > most

    def draws(self, count: int, generator: np.random.Generator) -> Array:
        """Draw the estimates.

        Parameters
        ----------
        count : of draws
        generator : of random numbers

        Returns
        -------
        (count, estimates)
        """
        chance = generator.uniform(size=(count, 1))
        sampled = []
        # Influences of blocks have their leverage; of n trials n / (n - 1) times the sum of squares
        # is the variance.
        few = len(self.trials) / max(len(self.trials) - 1, 1)
        for parts, factor in ((self.blocks, 1.0 / self.parted), (self.trials, few)):
            freedom = _freedom(parts)
            heavy = np.sqrt(factor * freedom / scipy.stats.chi2.ppf(chance, freedom))
            sampled.append(heavy * (generator.standard_normal((count, len(parts))) @ parts))
        return self.values + np.where(self.by_trial, sampled[1], sampled[0])


def _freedom(parts: Array) -> Array:
    """Find the degrees of freedom of sums of squares of normal parts (parts, estimates).

    They are Satterthwaite's (sum s^2)^2 / sum s^4 of the variances s^2, with sum s^4 = sum u^4 / 3
    and (sum s^2)^2 = (sum u^2)^2 - 2 sum s^4 on average.

    Returns
    -------
    (estimates,) from 1 to one less than the parts
    """
    squares = np.square(parts)
    fourth = np.square(squares).sum(axis=0) / 3.0
    square = np.square(squares.sum(axis=0))
    free = np.divide(square, fourth, out=np.full_like(square, 3.0), where=fourth > 0.0) - 2.0
    return np.clip(free, 1.0, max(len(parts) - 1, 1))


ESTIMATED = ("mass", "com", "first_moment", "viscosity", "plate_viscosity", "least_mass")
"""Estimates of a condition, by name; the viscosity of each axis follows, by the name of the axis.
"""


@read_only
class Solution:
    """Steps 1 and 2 from some blocks.

    Attributes
    ----------
    counts : (blocks,) how often each counts
    inertia : of the limb
    joint : viscosity by inverse dynamics
    plate : viscosity from the moment about the joint that the plate measures
    """

    counts: Array
    inertia: LimbInertia
    joint: JointViscosity
    plate: JointViscosity

    @property
    def estimates(self) -> Array:
        """(6 + axes,) in the order of `ESTIMATED`, then the viscosity of each axis."""
        limb = self.inertia
        by_name = {
            "mass": limb.mass,
            "com": limb.com,
            "first_moment": limb.first_moment,
            "viscosity": self.joint.one,
            "plate_viscosity": self.plate.one,
            "least_mass": limb.least_mass,
        }
        return np.array([*(by_name[name] for name in ESTIMATED), *self.joint.axes])


@dataclass(frozen=True, eq=False)
class ConditionSolution:
    """All swings of a condition.

    Attributes
    ----------
    sums : over the blocks
    whole : from all blocks
    lacking : with `LACKING` of each block left out
    stiffness : whether a spring is fitted beside the viscosity
    """

    sums: SwingSums
    whole: Solution
    lacking: tuple[Solution, ...]
    stiffness: bool

    @property
    def influences(self) -> Influences:
        """Of the blocks on `Solution.estimates`."""
        value = self.whole.estimates
        blocks = np.array([value - block.estimates for block in self.lacking]) / LACKING
        return Influences(
            values=value, blocks=blocks, trial=self.sums.trial, parted=self.sums.parted
        )

    def torque(self, solution: Solution) -> Array:
        """Choose the columns of a solution's torque.

        Parameters
        ----------
        solution : with the limb's parameters

        Returns
        -------
        (axes, 3 + muscles, 3 + muscles) see `torque_problem`
        """
        return torque_problem(
            self.sums.torque_total(solution.counts), solution.inertia.parameters, self.stiffness
        )


def solve_condition(
    sums: SwingSums, inertial: InertiaOptions, stiffness: bool
) -> ConditionSolution:
    """Find inertia and joint viscosity, with all blocks and with a part of each left out.

    Parameters
    ----------
    sums : over the blocks
    inertial : how the inertia is identified
    stiffness : whether a spring is fitted beside the viscosity

    Raises
    ------
    BadData : there are fewer than three blocks
    """
    if len(sums) < 3:
        advice = "record longer, release more often, or make the blocks smaller"
        raise BadData(
            f"{len(sums)} blocks of swings in all: intervals need at least three; {advice}"
        )
    every = np.ones(len(sums))
    whole = solve_blocks(sums, every, inertial, stiffness)
    parts = [every - LACKING * block for block in np.eye(len(sums))]
    lacking = [
        solve_blocks(sums, counts, inertial, stiffness, whole.inertia.noise) for counts in parts
    ]
    return ConditionSolution(sums=sums, whole=whole, lacking=tuple(lacking), stiffness=stiffness)


def solve_blocks(
    sums: SwingSums,
    counts: Array,
    inertial: InertiaOptions,
    stiffness: bool,
    noise: Array | None = None,
) -> Solution:
    """Find inertia and joint viscosity of some blocks, without what intervals need.

    Parameters
    ----------
    sums : over the blocks
    counts : (blocks,) how often each counts
    inertial : how the inertia is identified
    stiffness : whether a spring is fitted beside the viscosity
    noise : (6,) of the wrench; found by repetition by default [N m], [N]

    Returns
    -------
    the solution
    """
    inertia = limb_inertia(sums, counts, inertial, noise)
    products = sums.torque_total(counts)
    frames = float(counts @ sums.frames)
    of_joint = torque_problem(products, inertia.parameters, stiffness)
    of_plate = torque_problem(products, None, stiffness)
    return Solution(
        counts=counts,
        inertia=inertia,
        joint=joint_viscosity(of_joint, frames),
        plate=joint_viscosity(of_plate, frames),
    )
