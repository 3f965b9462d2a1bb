"""Dynamics of one specimen in three steps: inertia, joint and muscle viscosity ([S] section II)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from itertools import compress
from typing import Any, Literal

import numpy as np
from threadpoolctl import threadpool_limits

from myomorph.core.fit.interval_rule import interval_of_draws
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData, MyomorphError, check_name
from myomorph.core.model.interval import Interval
from myomorph.core.model.shown import shown
from myomorph.swings.viscosity.identification import torque as torques
from myomorph.swings.viscosity.identification.condition import (
    ESTIMATED,
    LACKING,
    ConditionSolution,
    Influences,
    Solution,
    solve_condition,
)
from myomorph.swings.viscosity.identification.excitation import NOT_SHOWN, Excitation
from myomorph.swings.viscosity.identification.inertia import (
    InertiaOptions,
    LimbInertia,
    least_mass,
    limb_inertia,
)
from myomorph.swings.viscosity.swings.recording import SwingRecording
from myomorph.swings.viscosity.swings.sums import SwingSums, swing_sums

MAX_RELATIVE_WIDTH = (
    0.5  # An axis is excited where its interval is narrower than +- this share of the one value.
)
STATES = {
    "without": "muscles removed",
    "with": "muscles intact",
}  # The conditions of a specimen in texts.

QUANTITIES_OF = {
    "without": (
        "mass_muscles_removed",
        "com_muscles_removed",
        "first_moment_muscles_removed",
        "joint_viscosity",
    ),
    "with": ("mass_intact", "com_intact", "first_moment_intact", "total_viscosity"),
}
"""Mass, distance of the mass center, their product and viscosity of a condition, as tables call
them.
"""

STREAMS = {"without": 0, "with": 1, "muscle mass": 2, "muscles": 3}
"""Streams of random numbers, so that what one estimate draws does not change another."""

NEUTRAL_ROUNDS = (
    3  # How often a ball joint's spring is found again from angles counted from its last rest.
)


def is_narrow(estimate: Interval) -> bool:
    """Whether an interval is narrower than plus or minus `MAX_RELATIVE_WIDTH` of its value."""
    return estimate.high - estimate.low <= 2.0 * MAX_RELATIVE_WIDTH * estimate.value


@dataclass(frozen=True)
class ViscosityOptions(InertiaOptions):
    """Settings of `identify_specimen`.

    Attributes
    ----------
    tare : load on the plate besides the limb after taring; "known": none; "loaded": a constant load
        of the base, so that the constant force gives an upper bound of the mass; "unknown": a
        constant force and moment in every trial, as after taring with the limb on the plate, so
        that the mass is not identifiable and the limb's moment is
    prior_sd : relative standard deviation of the prior of the limb's inertia: a uniform cylinder
        from the joint through the estimated mass center to twice its distance, with three tenths of
        that distance as radius, as a limb may be bent
    instruments : estimate the inertia by instrumental variables (the acceleration predicted from
        the state), which the noise of twice differentiated markers does not bias; otherwise by
        ordinary least squares as in the paper
    stiffness : also fit a spring and a constant torque about each axis, so that they do not bias
        the viscosity; off, least squares as in the paper; by default a study fits them if a law
        with a spring predicts held-out swings better than viscosity alone (this function alone
        compares no laws, and fits them)
    subtract : joint viscosity that step 3 subtracts: one common value, or one per axis
    spread : relative standard deviation of the viscosities of single muscles about the common one
    min_relative_speed : minimum speed of a swing relative to the fastest one (root mean square of
        the rates); slower swings are left out
    block : number of successive swings in a block of the bootstrap
    draws : number of draws of the bootstrap
    seed : seed of the random numbers
    level : confidence level of the intervals
    """

    stiffness: bool | None = None
    subtract: Literal["one", "axes"] = "one"
    spread: float = 1.0
    min_relative_speed: float = 0.1
    block: int = 1
    draws: int = 500
    seed: int = 0
    level: float = 0.95

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.spread > 0.0:
            raise BadData(f"spread of the viscosity is {self.spread:g}: expected above 0")
        if not 0.0 <= self.min_relative_speed < 1.0:
            raise BadData(
                f"min_relative_speed is {self.min_relative_speed:g}: expected from 0 to below 1"
            )
        if self.block < 1 or self.draws < 2:
            raise BadData(
                f"expected block from 1 and draws from 2, but got {self.block} and {self.draws}"
            )
        if not 0.0 < self.level < 1.0:
            raise BadData(f"the level of the intervals is {self.level:g}: expected between 0 and 1")


@read_only
class Condition:
    """What was identified of a specimen with its muscles intact, or removed.

    Attributes
    ----------
    recordings : what it was identified from
    parameters : (10,) of the limb as one link, about the joint's center ([D] order)
    mass : [kg]; a load of the base included (a study takes it off, as far as it is known)
    com : distance of the mass center from the joint's center [m]
    first_moment : mass times that distance, which no load of the base changes [kg m]
    least_mass : the least that a body of this first moment and inertia weighs [kg]
    viscosity : the one value over all axes, as the paper prints it [N m s/rad]; with muscles
        d_{M+J}
    axis_viscosity : one an axis; NaN, from 0 to infinity, of one that is not excited
    excited : one an axis: whether the swings moved it enough, against the other axes and against
        the noise of its rates, and tell its viscosity
    residual : (6,) root mean square of measured less predicted wrench [N m], [N]
    plate_viscosity : the one value from the moment about the joint that the plate measures, instead
        of the torque by inverse dynamics: a check that shares hardly any noise with `viscosity`
    by_trial : which intervals are drawn by trial, because trials differ more than their swings
        explain
    """

    recordings: tuple[SwingRecording, ...]
    parameters: Array
    mass: Interval
    com: Interval
    first_moment: Interval
    least_mass: Interval
    viscosity: Interval
    axis_viscosity: tuple[Interval, ...]
    excited: tuple[bool, ...]
    residual: Array
    plate_viscosity: Interval | None = None
    by_trial: tuple[str, ...] = ()


@read_only
class MuscleViscosity:
    """d_M of the muscles ([S] eq. 3), with the joint's own viscosity taken off.

    Attributes
    ----------
    muscles : names
    common : one value for all muscles, as the paper prints it [N s/m]
    pcsa : (muscles,) shares of the physiological cross-section, mean 1
    by_pcsa : the factor of those shares [N s/m]
    by_muscle : regularised values, one a muscle [N s/m]
    rank : number of independent combinations that the swings show, of `len(muscles)`
    singular_values : (muscles,) of the normalised problem, descending
    resolved : how many of those combinations are known to better than their own size, were all
        muscles alike
    """

    muscles: tuple[str, ...]
    common: Interval
    pcsa: Array
    by_pcsa: Interval
    by_muscle: tuple[Interval, ...]
    rank: int
    singular_values: Array
    resolved: int | None = None


@shown
@dataclass(frozen=True, eq=False)
class SpecimenViscosity:
    """A specimen's row of [S] tables I and II.

    Attributes
    ----------
    name : of the specimen
    without, intact : muscles removed and intact; None where that condition is lacking or failed
    muscles : None unless both conditions are there
    muscle_mass : with less without [kg]
    least_muscle_mass : the least that what muscles add to first moment and inertia weighs [kg]
    measured_muscle_mass : on a scale [kg], None where it was not weighed
    notes : warnings and what was left out, one line each
    """

    name: str
    without: Condition | None
    intact: Condition | None
    muscles: MuscleViscosity | None
    muscle_mass: Interval | None
    measured_muscle_mass: float | None
    notes: tuple[str, ...] = ()
    least_muscle_mass: Interval | None = None

    @property
    def conditions(self) -> dict[str, Condition]:
        """What there is of "without" and "with" muscles."""
        pairs = (("without", self.without), ("with", self.intact))
        return {name: condition for name, condition in pairs if condition is not None}

    def changed(
        self, conditions: Mapping[str, Condition], notes: Iterable[str] = (), **parts: Any
    ) -> SpecimenViscosity:
        """Return the same with other conditions, by "without" and "with".

        Further notes are added, and other parts replaced.
        """
        named: dict[str, Any] = {
            "intact" if name == "with" else name: condition
            for name, condition in conditions.items()
        }
        return replace(self, **named, **parts, notes=(*self.notes, *notes))

    @property
    def estimates(self) -> dict[str, Interval]:
        """What was estimated, by quantity as tables call it."""
        known: dict[str, Interval] = {}
        for name, condition in self.conditions.items():
            values = condition.mass, condition.com, condition.first_moment, condition.viscosity
            known |= dict(zip(QUANTITIES_OF[name], values, strict=True))
        if self.muscles is not None:
            known["muscle_viscosity"] = self.muscles.common
        if self.muscle_mass is not None:
            known["estimated_muscle_mass"] = self.muscle_mass
        return known


@dataclass(frozen=True, kw_only=True)
class MeasuredMuscles:
    """What was measured of a specimen's muscles themselves.

    Attributes
    ----------
    pcsa : physiological cross-section of each muscle, in any unit; even shares where None
    mass : of the removed muscles on a scale [kg]
    """

    pcsa: Mapping[str, float] | None = None
    mass: float | None = None


def identify_specimen(
    name: str,
    without: Sequence[SwingRecording],
    intact: Sequence[SwingRecording],
    measured: MeasuredMuscles | None = None,
    options: ViscosityOptions | None = None,
) -> SpecimenViscosity:
    """Inertia, joint viscosity and muscle viscosity of one specimen, each with its interval.

    A condition that is lacking or that fails is None and named in the notes; the other is still
    identified. The intervals hold what swings and trials scatter; what all trials share (the
    joint's center, the plate's place and gain, the held pose, moment arms) they cannot know. Masses
    and centers are those of limb and base load together, as the constant force shows them; a study
    gives the range that the limb's can have.

    Source: [S] section II.

    Parameters
    ----------
    name : of the specimen
    without, intact : recordings of the limb, muscles removed and intact; either may be empty
    measured : what was measured of the muscles themselves; see `MeasuredMuscles`
    options : see `ViscosityOptions`

    Returns
    -------
    mass [kg], mass center [m] and viscosity [N m s/rad] of each condition, viscosity of the muscles
    [N s/m]

    Raises
    ------
    BadData : neither condition can be identified
    UnknownName : a muscle is missing in `measured.pcsa`

    Examples
    --------
    >>> from pathlib import Path
    >>> import myomorph as mm
    >>> short = mm.viscosity.ShoulderStudyOptions(seconds=6.0, trials=1, raw=())
    >>> study = mm.write_shoulder_study(Path("shoulder"), (3,), short)
    >>> plan = mm.viscosity.read_viscosity_plan(study)
    >>> swings = mm.viscosity.read_swings(plan.specimens[0], cutoff=6.0)
    >>> options = mm.viscosity.ViscosityOptions(draws=20)
    >>> found = mm.viscosity.identify_specimen("03", **swings, options=options)
    >>> 0.04 < found.without.viscosity.value < 0.08 < found.intact.viscosity.value
    True
    """
    options = options or ViscosityOptions()
    measured = measured or MeasuredMuscles()
    recordings = {"without": without, "with": intact}
    muscles = muscle_mass = least_muscle_mass = None
    # One thread of BLAS each: the matrices are small, and the two conditions are solved side by
    # side.
    with threadpool_limits(1, "blas"), ThreadPoolExecutor(2) as pool:
        outcomes = pool.map(lambda swings: _solved(swings, options), recordings.values())
        solutions, notes = _sorted_out(name, dict(zip(recordings, outcomes, strict=True)))
        identified = {
            condition: _condition(solution, recordings[condition], options, STREAMS[condition])
            for condition, solution in solutions.items()
        }
        if len(solutions) == len(recordings):
            bare = solutions["without"]
            full = solutions["with"]
            muscle_mass, least_muscle_mass = _muscle_mass(bare, full, options)
            if full.sums.muscles:
                muscles = _muscles(bare, full, measured.pcsa, options)
    for condition, solution in solutions.items():
        notes += [f"{STATES[condition]}: {warning}" for warning in _warnings(solution)]
    return SpecimenViscosity(
        name=name,
        without=identified.get("without"),
        intact=identified.get("with"),
        muscles=muscles,
        muscle_mass=muscle_mass,
        measured_muscle_mass=measured.mass,
        notes=tuple(notes),
        least_muscle_mass=least_muscle_mass,
    )


def _sorted_out(
    name: str, outcomes: Mapping[str, ConditionSolution | str]
) -> tuple[dict[str, ConditionSolution], list[str]]:
    """Return the conditions that were solved, and a note on each other; raises `BadData`."""
    solutions: dict[str, ConditionSolution] = {}
    notes: list[str] = []
    for condition, outcome in outcomes.items():
        if isinstance(outcome, str):
            notes.append(f"{STATES[condition]}: {outcome}")
        else:
            solutions[condition] = outcome
    if not solutions:
        raise BadData(f"specimen '{name}': " + "; ".join(notes))
    return solutions, notes


def _solved(
    recordings: Sequence[SwingRecording], options: ViscosityOptions
) -> ConditionSolution | str:
    """Run steps 1 and 2 of a condition, or return the reason why they failed."""
    has_spring = options.stiffness is not False
    try:
        sums = swing_sums(recordings, options.block, options.min_relative_speed)
        if has_spring and len(sums.axes) == 3:
            sums = _sums_about_neutral(recordings, sums, options)
        return solve_condition(sums, options, has_spring)
    except MyomorphError as error:
        return str(error)


def _sums_about_neutral(
    recordings: Sequence[SwingRecording], sums: SwingSums, options: ViscosityOptions
) -> SwingSums:
    """Return sums of a ball joint with angles counted from the neutral position of its spring.

    Torques of a spring are linear in the angles about that position alone, and the position
    follows from the spring: they are found in turn as long as the misfit falls.
    """
    parameters = limb_inertia(sums, None, options).parameters
    for _ in range(NEUTRAL_ROUNDS):
        neutral = torques.neutral_position(sums, parameters)
        shifted = torques.counted_from(recordings, neutral)
        shifted_sums = swing_sums(shifted, options.block, options.min_relative_speed)
        shifted_misfit = torques.spring_misfit(shifted_sums, parameters)
        if shifted_misfit >= torques.spring_misfit(sums, parameters):
            break
        recordings = shifted
        sums = shifted_sums
    return sums


def _estimates(
    influences: Influences, options: ViscosityOptions, stream: int, lowest: Array
) -> list[Interval]:
    """Values with their intervals, from draws of the bootstrap.

    Parameters
    ----------
    stream : of random numbers, another one for each set of estimates
    lowest : (estimates,) the least possible values, to which lower draws are raised
    """
    generator = np.random.default_rng((options.seed, stream))
    drawn = np.maximum(influences.draws(options.draws, generator), lowest)
    return [
        interval_of_draws(value, draws, options.level)
        for value, draws in zip(influences.values, drawn.T, strict=True)
    ]


def _condition(
    solved: ConditionSolution,
    recordings: Sequence[SwingRecording],
    options: ViscosityOptions,
    stream: int,
) -> Condition:
    """Estimates of a condition with their intervals; none of them can be below 0."""
    axes = solved.sums.axes
    names = (*ESTIMATED, *axes)
    influences = solved.influences
    estimates = _estimates(influences, options, stream, lowest=np.zeros(len(names)))
    by_name = dict(zip(names, estimates, strict=True))
    viscosity = by_name["viscosity"]
    shown = Excitation.of(recordings).shown.tolist()
    excited = tuple(
        moved and _is_narrow_beside(by_name[axis], viscosity)
        for axis, moved in zip(axes, shown, strict=True)
    )
    return Condition(
        recordings=tuple(recordings),
        parameters=solved.whole.inertia.parameters,
        mass=by_name["mass"],
        com=by_name["com"],
        first_moment=by_name["first_moment"],
        least_mass=by_name["least_mass"],
        viscosity=viscosity,
        axis_viscosity=tuple(
            by_name[axis] if told else NOT_SHOWN for axis, told in zip(axes, excited, strict=True)
        ),
        excited=excited,
        residual=solved.whole.inertia.noise,
        plate_viscosity=by_name["plate_viscosity"],
        by_trial=tuple(compress(names, influences.by_trial)),
    )


def _is_narrow_beside(axis: Interval, viscosity: Interval) -> bool:
    """Whether an axis' interval is narrow against the one viscosity."""
    half_width = 0.5 * (axis.high - axis.low)
    return half_width <= MAX_RELATIVE_WIDTH * viscosity.value


def _both(
    bare: ConditionSolution, full: ConditionSolution, values: Array, blocks: Array
) -> Influences:
    """Influences of the blocks without muscles, then those with."""
    trial = np.concatenate([bare.sums.trial, full.sums.trial + len(bare.sums.names)])
    return Influences(
        values=values,
        blocks=(values - blocks) / LACKING,
        trial=trial,
        parted=min(bare.sums.parted, full.sums.parted),
    )


def muscle_masses(bare: LimbInertia, full: LimbInertia) -> Array:
    """Return the mass of the muscles by the constant forces, and the least mass.

    The least is that which their first moment and inertia weigh.

    Parameters
    ----------
    bare : limb with muscles removed
    full : limb with muscles intact

    Returns
    -------
    (2,) masses [kg]
    """
    return np.array(
        [full.mass - bare.mass, least_mass(full.parameters - bare.parameters, full.hinge)]
    )


def _muscle_mass(
    bare: ConditionSolution, full: ConditionSolution, options: ViscosityOptions
) -> list[Interval]:
    """Mass of the muscles and the least that it can be [kg]: intact less muscles removed."""
    without = bare.whole.inertia
    intact = full.whole.inertia
    values = muscle_masses(without, intact)
    fewer_blocks = [muscle_masses(solution.inertia, intact) for solution in bare.lacking]
    fewer_blocks += [muscle_masses(without, solution.inertia) for solution in full.lacking]
    influences = _both(bare, full, values, np.array(fewer_blocks))
    # A difference of two masses may come out negative; the least mass may not.
    lowest = np.array([-np.inf, 0.0])
    return _estimates(influences, options, STREAMS["muscle mass"], lowest)


def _muscles(
    bare: ConditionSolution,
    full: ConditionSolution,
    pcsa: Mapping[str, float] | None,
    options: ViscosityOptions,
) -> MuscleViscosity:
    """Step 3: what the intact limb's damping has beside the joint's, over the muscles."""
    names = full.sums.muscles
    shares = _shares(names, pcsa)
    whole = full.torque(full.whole)
    joint = bare.whole.joint.taken_off(options.subtract)
    problem = torques.muscle_problem(whole, joint)
    common = problem.along(np.ones(len(names)))
    variance = torques.noise_variance(_torque_blocks(full, options), joint)
    strength = torques.ridge_strength(problem, variance, common, options.spread)

    def values(torque: Array, without: Solution) -> Array:
        """(2 + muscles,) the common value, the factor of the cross-sections, one a muscle."""
        joint = without.joint.taken_off(options.subtract)
        return torques.muscle_problem(torque, joint).solved(shares, strength)

    best = values(whole, bare.whole)
    fewer_blocks = [values(whole, solution) for solution in bare.lacking]
    fewer_blocks += [values(full.torque(solution), bare.whole) for solution in full.lacking]
    influences = _both(bare, full, best, np.array(fewer_blocks))
    common_value, pcsa_factor, *by_muscle = _estimates(
        influences, options, STREAMS["muscles"], lowest=np.zeros(len(best))
    )
    return MuscleViscosity(
        muscles=names,
        common=common_value,
        pcsa=shares,
        by_pcsa=pcsa_factor,
        by_muscle=tuple(by_muscle),
        rank=problem.rank,
        singular_values=problem.singular_values,
        resolved=problem.resolved(variance, common),
    )


def _torque_blocks(full: ConditionSolution, options: ViscosityOptions) -> Array:
    """Return the torque problem of each block of the swings."""
    phi = full.whole.inertia.parameters
    with_stiffness = options.stiffness is not False
    return np.stack(
        [torques.torque_problem(sums, phi, with_stiffness) for sums in full.sums.torque]
    )


def _shares(names: tuple[str, ...], pcsa: Mapping[str, float] | None) -> Array:
    """(muscles,) of mean 1."""
    if pcsa is None:
        return np.ones(len(names))
    for name in names:
        check_name("muscle", name, pcsa, "the table of cross-sections")
    shares = np.array([pcsa[name] for name in names], dtype=np.float64)
    if not (np.isfinite(shares).all() and (shares > 0.0).all()):
        raise BadData(
            "a muscle's cross-section must be above 0: got"
            f" {dict(zip(names, shares.tolist(), strict=True))}"
        )
    return shares / shares.mean()


def _warnings(solved: ConditionSolution) -> list[str]:
    """Return the warnings that concern steps 1 and 2."""
    result = []
    sums = solved.sums
    inertia = solved.whole.inertia
    if inertia.hidden:
        result.append(
            "the plate's zero is unknown, so the mass is not identifiable; viscosities do not need"
            " it"
        )
    if not inertia.possible:
        result.append("the wrench implies an impossible inertia; the nearest possible one is used")
    if len(sums.names) < 2:
        result.append("one trial only: how trials differ is not in the intervals")
    lost = [name for i, name in enumerate(sums.names) if not (sums.trial == i).any()]
    if lost:
        result.append(f"trial {', '.join(lost)}: no swing large enough to use")
    return result
