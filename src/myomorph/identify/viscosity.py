"""The dynamics of one specimen in three steps: inertia, joint viscosity, muscle viscosity ([S] section II)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Literal

import numpy as np
from threadpoolctl import threadpool_limits

from myomorph.identify.estimate import Estimate
from myomorph.identify.joint_viscosity import JointViscosity, joint_viscosity, torque_problem
from myomorph.identify.limb_inertia import InertiaOptions, LimbInertia, Tare, limb_inertia
from myomorph.identify.muscle_viscosity import muscle_problem, ridge_strength, solve_muscles
from myomorph.identify.resampling import block_counts
from myomorph.identify.swing_sums import SwingSums, swing_sums
from myomorph.identify.swings import SwingRecording
from myomorph.model.errors import BadData, MyomorphError, UnknownName
from myomorph.model.spatial import Array

TOLD = 0.5
"""An axis is excited where its interval is narrower than plus or minus this share of the one value."""


@dataclass(frozen=True)
class ViscosityOptions:
    """Settings of `identify_specimen`.

    Attributes
    ----------
    tare : whether the plate's zero is known; where unknown, the mass hides and only its moment shows
    prior_sd : relative standard deviation of the prior of the limb's inertia, a slender cylinder
    stiffness : fit a spring and a constant torque of each axis beside the viscosity, so that they do not bias it;
        without, least squares as the paper writes them
    subtract : joint viscosity that step 3 takes off: the one value, or one an axis
    spread : relative standard deviation of single muscles' viscosities about the common one
    block : swings that are drawn together by the bootstrap
    draws : of the bootstrap
    seed : of the draws
    level : of the intervals
    """

    tare: Tare = "known"
    prior_sd: float = 1.0
    stiffness: bool = True
    subtract: Literal["one", "axes"] = "one"
    spread: float = 1.0
    block: int = 1
    draws: int = 500
    seed: int = 0
    level: float = 0.95

    def __post_init__(self) -> None:
        for name in ("prior_sd", "spread"):
            if not getattr(self, name) > 0.0:
                raise BadData(f"{name} of the viscosity is {getattr(self, name):g}: expected above 0")
        if self.block < 1 or self.draws < 2:
            raise BadData(f"expected block from 1 and draws from 2, but got {self.block} and {self.draws}")
        if not 0.0 < self.level < 1.0:
            raise BadData(f"the level of the intervals is {self.level:g}: expected between 0 and 1")


@dataclass(frozen=True, eq=False)
class Condition:
    """What was identified of a specimen with its muscles, or without them.

    Attributes
    ----------
    recordings : what it was identified from
    parameters : (10,) of the limb as one link, about the joint's center ([D] order)
    mass : [kg]
    com : distance of the mass center from the joint's center [m]
    viscosity : the one value over all axes, as the paper prints it [N m s/rad]; with muscles d_{M+J}
    axis_viscosity : one an axis
    excited : one an axis: whether the swings moved it enough to tell its viscosity
    residual : (6,) root mean square of measured less predicted wrench [N m], [N]
    """

    recordings: tuple[SwingRecording, ...]
    parameters: Array
    mass: Estimate
    com: Estimate
    viscosity: Estimate
    axis_viscosity: tuple[Estimate, ...]
    excited: tuple[bool, ...]
    residual: Array


@dataclass(frozen=True, eq=False)
class MuscleViscosity:
    """d_M of the muscles ([S] eq. 3), with the joint's own viscosity taken off.

    Attributes
    ----------
    common : one value for all muscles, as the paper prints it [N s/m]
    pcsa : (muscles,) shares of the physiological cross-section, mean 1
    by_pcsa : the factor of those shares [N s/m]
    by_muscle : regularised values, one a muscle [N s/m]
    rank : number of independent combinations that the swings show, of `len(muscles)`
    singular_values : (muscles,) of the normalised problem, descending
    """

    muscles: tuple[str, ...]
    common: Estimate
    pcsa: Array
    by_pcsa: Estimate
    by_muscle: tuple[Estimate, ...]
    rank: int
    singular_values: Array


@dataclass(frozen=True, eq=False)
class SpecimenViscosity:
    """A specimen's row of [S] tables I and II.

    Attributes
    ----------
    without, intact : without and with muscles; None where that condition is lacking or failed
    muscles : None unless both conditions are there
    muscle_mass : with less without [kg]
    measured_muscle_mass : on a scale [kg], None where it was not weighed
    notes : doubts and what was left out, one line each
    """

    name: str
    without: Condition | None
    intact: Condition | None
    muscles: MuscleViscosity | None
    muscle_mass: Estimate | None
    measured_muscle_mass: float | None
    notes: tuple[str, ...] = ()


def identify_specimen(
    name: str,
    without: Sequence[SwingRecording],
    intact: Sequence[SwingRecording],
    pcsa: Mapping[str, float] | None = None,
    measured_muscle_mass: float | None = None,
    options: ViscosityOptions | None = None,
) -> SpecimenViscosity:
    """Inertia, joint viscosity and muscle viscosity of one specimen, each with its interval.

    A condition that is lacking or that fails is None and named in the notes; the other is still identified.

    Parameters
    ----------
    without, intact : recordings of the limb without and with its muscles; either may be empty
    pcsa : physiological cross-section of each muscle, in any unit; even shares where None
    measured_muscle_mass : of the removed muscles on a scale [kg]

    Raises
    ------
    BadData : neither condition can be identified
    UnknownName : `pcsa` lacks a muscle
    """
    options = options or ViscosityOptions()
    seeds = np.random.SeedSequence(options.seed).spawn(2)
    with threadpool_limits(1, "blas"), ThreadPoolExecutor(2) as pool:
        solving = [
            pool.submit(_try, _Solved.of, given, options, seed)
            for given, seed in zip((without, intact), seeds, strict=True)
        ]
        bare, full = (one.result() for one in solving)
        notes = [
            f"{condition} muscles: {problem}"
            for condition, problem in (("without", bare), ("with", full))
            if isinstance(problem, str)
        ]
        if isinstance(bare, str) and isinstance(full, str):
            raise BadData(f"specimen '{name}': " + "; ".join(notes))
        muscles = mass = None
        if isinstance(bare, _Solved) and isinstance(full, _Solved):
            muscles = _muscles(bare, full, pcsa, options)
            draws = full.masses - bare.masses
            mass = Estimate.of_draws(full.inertia.mass - bare.inertia.mass, draws, options.level)
    return SpecimenViscosity(
        name,
        bare.condition() if isinstance(bare, _Solved) else None,
        full.condition() if isinstance(full, _Solved) else None,
        muscles,
        mass,
        measured_muscle_mass,
        tuple(notes),
    )


def _try(solve, given: Sequence[SwingRecording], options: ViscosityOptions, seed) -> _Solved | str:
    try:
        return solve(given, options, seed)
    except MyomorphError as error:
        return str(error)


@dataclass(frozen=True, eq=False)
class _Solved:
    """Steps 1 and 2 of one condition, at the recordings and at every draw."""

    recordings: tuple[SwingRecording, ...]
    options: ViscosityOptions
    sums: SwingSums
    counts: Array
    inertia: LimbInertia
    joint: JointViscosity
    inertias: tuple[LimbInertia, ...]
    joints: tuple[JointViscosity, ...]

    @staticmethod
    def of(given: Sequence[SwingRecording], options: ViscosityOptions, seed: np.random.SeedSequence) -> _Solved:
        sums = swing_sums(given, options.block)
        inertial = InertiaOptions(options.tare, options.prior_sd)
        inertia = limb_inertia(sums, None, inertial)
        counts = block_counts(sums.trial, options.draws, np.random.default_rng(seed))
        inertias = [limb_inertia(sums, one, inertial, inertia.noise) for one in counts]
        joint, *joints = (
            joint_viscosity(
                torque_problem(sums.torque_total(one), phi.parameters, options.stiffness), one @ sums.frames
            )
            for one, phi in zip([np.ones(len(sums)), *counts], [inertia, *inertias], strict=True)
        )
        return _Solved(tuple(given), options, sums, counts, inertia, joint, tuple(inertias), tuple(joints))

    @property
    def masses(self) -> Array:
        """(draws,) [kg]."""
        return np.array([one.mass for one in self.inertias])

    def problems(self, stiffness: bool) -> list[Array]:
        """Torque problems at every draw."""
        return [
            torque_problem(self.sums.torque_total(one), phi.parameters, stiffness)
            for one, phi in zip(self.counts, self.inertias, strict=True)
        ]

    def condition(self) -> Condition:
        level = self.options.level
        by_axis = np.array([one.axes for one in self.joints])
        axes = tuple(
            Estimate.of_draws(value, draws, level) for value, draws in zip(self.joint.axes, by_axis.T, strict=True)
        )
        return Condition(
            self.recordings,
            self.inertia.parameters,
            Estimate.of_draws(self.inertia.mass, self.masses, level),
            Estimate.of_draws(self.inertia.com, np.array([one.com for one in self.inertias]), level),
            Estimate.of_draws(self.joint.one, np.array([one.one for one in self.joints]), level),
            axes,
            tuple(0.5 * (one.high - one.low) <= TOLD * self.joint.one for one in axes),
            self.inertia.noise,
        )


def _muscles(
    bare: _Solved, full: _Solved, pcsa: Mapping[str, float] | None, options: ViscosityOptions
) -> MuscleViscosity | None:
    names = full.sums.muscles
    if not names:
        return None
    shares = _shares(names, pcsa)

    def joint_part(one: JointViscosity) -> Array:
        return np.full(len(one.axes), one.one) if options.subtract == "one" else one.axes

    joint = joint_part(bare.joint)
    phi = full.inertia.parameters
    problem = muscle_problem(
        torque_problem(full.sums.torque_total(np.ones(len(full.sums))), phi, options.stiffness), joint
    )
    common = problem.along(np.ones(len(names)))
    blocks = np.stack([torque_problem(one, phi, options.stiffness) for one in full.sums.torque])
    strength = ridge_strength(blocks, joint, common, options.spread)
    best = solve_muscles(problem, shares, strength)
    draws = [
        solve_muscles(muscle_problem(one, joint_part(d)), shares, strength)
        for one, d in zip(full.problems(options.stiffness), bare.joints, strict=True)
    ]
    single = np.array([one.by_muscle for one in draws])
    return MuscleViscosity(
        names,
        Estimate.of_draws(best.common, np.array([one.common for one in draws]), options.level),
        shares,
        Estimate.of_draws(best.by_pcsa, np.array([one.by_pcsa for one in draws]), options.level),
        tuple(Estimate.of_draws(v, d, options.level) for v, d in zip(best.by_muscle, single.T, strict=True)),
        problem.rank,
        problem.singular_values,
    )


def _shares(names: tuple[str, ...], pcsa: Mapping[str, float] | None) -> Array:
    """(muscles,) of mean 1."""
    if pcsa is None:
        return np.ones(len(names))
    for name in names:
        if name not in pcsa:
            raise UnknownName("muscle", name, tuple(pcsa), "the table of cross-sections")
    shares = np.array([pcsa[name] for name in names], dtype=np.float64)
    if not (np.isfinite(shares).all() and (shares > 0.0).all()):
        raise BadData(f"a muscle's cross-section must be above 0: got {dict(zip(names, shares, strict=True))}")
    return shares / shares.mean()
