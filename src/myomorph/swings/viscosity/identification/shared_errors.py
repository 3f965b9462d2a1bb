"""Intervals that also hold errors which all swings of a specimen share.

These are errors of the plate, of gains, of the clock and of the joint's center.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from myomorph.core.fit.interval_rule import half_width
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import MyomorphError
from myomorph.core.model.interval import Interval
from myomorph.swings.viscosity.identification import identify
from myomorph.swings.viscosity.identification.budget import (
    ErrorOptions,
    ErrorShare,
    disturbed,
    thinned,
)
from myomorph.swings.viscosity.identification.condition import Solution, solve_blocks
from myomorph.swings.viscosity.identification.identify import (
    Condition,
    SpecimenViscosity,
    ViscosityOptions,
)
from myomorph.swings.viscosity.identification.instruments import Instruments
from myomorph.swings.viscosity.identification.torque import muscle_problem, torque_problem
from myomorph.swings.viscosity.swings.recording import SwingRecording
from myomorph.swings.viscosity.swings.sums import SwingSums, swing_sums


def with_shared_errors(
    specimen_viscosity: SpecimenViscosity,
    options: ViscosityOptions,
    errors: ErrorOptions,
    instruments: Instruments | None = None,
) -> tuple[SpecimenViscosity, tuple[ErrorShare, ...]]:
    """Widen intervals by errors that all swings of a specimen share.

    Every source is put into the recordings (rid of the errors of `instruments`) once with one
    standard deviation about or along each axis, and the whole identification repeated: g of each
    result. The result's variance is then g C g beside what swings scatter, with C the covariance of
    what is not known of the errors. Both conditions stand on one plate and have one center, so they
    share each error.

    Parameters
    ----------
    specimen_viscosity : with intervals of swings alone
    options : of the identification
    errors : assumed before any swing
    instruments : what swings show of them; by default nothing

    Returns
    -------
    the specimen, and what each source adds
    """
    instruments = instruments or Instruments.assumed(errors)
    try:
        slopes = _slopes(specimen_viscosity, options, instruments)
    except MyomorphError as error:
        return specimen_viscosity.changed(
            {}, [f"intervals hold no errors of instruments: {error}"]
        ), ()
    unit = float(half_width(1.0, options.level))
    covariance = instruments.covariance
    halves = {
        name: unit * float(np.sqrt(max(float(g @ covariance @ g), 0.0)))
        for name, g in slopes.items()
    }
    swings = {
        name: (estimate.high - estimate.low) / (2.0 * unit)
        for name, estimate in specimen_viscosity.estimates.items()
        if np.isfinite(estimate.value)
    }
    widened = _widened(specimen_viscosity, halves)
    return widened, _shares(swings, slopes, instruments)


def _slopes(
    specimen_viscosity: SpecimenViscosity, options: ViscosityOptions, instruments: Instruments
) -> dict[str, Array]:
    """Find what a unit of each error (sources,) changes of every result."""
    conditions = specimen_viscosity.conditions
    recordings = {
        name: tuple(thinned(each) for each in condition.recordings)
        for name, condition in conditions.items()
    }
    exact = _values(recordings, conditions, options)
    changes = []
    for (source, axis), size in zip(instruments.sources, instruments.prior, strict=True):
        moved = {
            name: tuple(disturbed(recording, source, axis, size) for recording in of_condition)
            for name, of_condition in recordings.items()
        }
        other = _values(moved, conditions, options)
        changes.append({name: (other[name] - value) / size for name, value in exact.items()})
    return {name: np.array([change[name] for change in changes]) for name in exact}


def _widened(
    specimen_viscosity: SpecimenViscosity, halves: Mapping[str, float]
) -> SpecimenViscosity:
    """Widen all results by half-widths of shared errors, by quantity."""
    changed = {
        key: _widened_condition(key, condition, halves)
        for key, condition in specimen_viscosity.conditions.items()
    }
    parts: dict[str, Any] = {}
    muscles = specimen_viscosity.muscles
    if muscles is not None:
        common = wider(muscles.common, halves.get("muscle_viscosity", 0.0), True)
        parts["muscles"] = replace(muscles, common=common)
    mass = specimen_viscosity.muscle_mass
    if mass is not None:
        # A difference of two masses may come out negative; the least mass may not.
        parts["muscle_mass"] = wider(mass, halves.get("estimated_muscle_mass", 0.0), False)
    least = specimen_viscosity.least_muscle_mass
    if least is not None:
        parts["least_muscle_mass"] = wider(least, halves.get("least_muscle_mass", 0.0), True)
    return specimen_viscosity.changed(changed, **parts)


def _widened_condition(key: str, condition: Condition, halves: Mapping[str, float]) -> Condition:
    """Widen the results of a condition by half-widths of shared errors, by quantity."""
    mass, com, moment, viscosity = identify.QUANTITIES_OF[key]
    axes = zip(condition.recordings[0].axes, condition.axis_viscosity, strict=True)
    plate = condition.plate_viscosity

    def widened(name: str, estimate: Interval) -> Interval:
        return wider(estimate, halves.get(name, 0.0), True)

    return replace(
        condition,
        mass=widened(mass, condition.mass),
        com=widened(com, condition.com),
        first_moment=widened(moment, condition.first_moment),
        least_mass=widened(f"{mass} least", condition.least_mass),
        viscosity=widened(viscosity, condition.viscosity),
        plate_viscosity=None if plate is None else widened(f"plate {viscosity}", plate),
        axis_viscosity=tuple(widened(f"{axis} {viscosity}", estimate) for axis, estimate in axes),
    )


def _shares(
    swings: Mapping[str, float], slopes: Mapping[str, Array], instruments: Instruments
) -> tuple[ErrorShare, ...]:
    """Make the table of sources and results.

    Parameters
    ----------
    swings : standard deviation that swings scatter, by result
    slopes : (sources,) what a unit of each error changes, by result
    """
    names = list(dict.fromkeys(name for name, _ in instruments.sources))
    known = {name: instruments.covariance - instruments.known(name) for name in names}
    prior = {
        name: float(size)
        for (name, _), size in zip(instruments.sources, instruments.prior, strict=True)
    }
    shares = []
    for quantity, scatter in swings.items():
        g = slopes[quantity]
        variances = {"swings": scatter**2} | {
            name: max(float(g @ less @ g), 0.0) for name, less in known.items()
        }
        total = scatter**2 + max(float(g @ instruments.covariance @ g), 0.0)
        for name, variance in variances.items():
            share = variance / total if total > 0.0 else 0.0
            shares.append(
                ErrorShare(
                    source=name,
                    prior_sd=prior.get(name, float("nan")),
                    quantity=quantity,
                    sd=float(np.sqrt(variance)),
                    share=share,
                )
            )
    return tuple(shares)


def wider(estimate: Interval, half: float, positive: bool) -> Interval:
    """Add the half-width of another error to an interval, by squares.

    Parameters
    ----------
    estimate : with its interval
    half : that is added
    positive : whether it cannot be below 0

    Returns
    -------
    the wider interval; the same of an estimate that is not shown
    """
    if not np.isfinite(estimate.value):
        return estimate
    low = estimate.value - float(np.hypot(estimate.value - estimate.low, half))
    high = estimate.value + float(np.hypot(estimate.high - estimate.value, half))
    return Interval(estimate.value, max(low, 0.0) if positive else low, high)


def _values(
    recordings: Mapping[str, tuple[SwingRecording, ...]],
    conditions: Mapping[str, Condition],
    options: ViscosityOptions,
) -> dict[str, float]:
    """Identify every result of the specimen from recordings of its conditions."""
    known: dict[str, float] = {}
    solved: dict[str, SolvedSwings] = {}
    for key, of_condition in recordings.items():
        sums = swing_sums(of_condition, options.block, options.min_relative_speed)
        solution = _solution(sums, conditions[key], options)
        mass, *_, viscosity = identify.QUANTITIES_OF[key]
        names = (
            *identify.QUANTITIES_OF[key],
            f"plate {viscosity}",
            f"{mass} least",
            *(f"{axis} {viscosity}" for axis in sums.axes),
        )
        known |= dict(zip(names, solution.estimates.tolist(), strict=True))
        solved[key] = SolvedSwings(sums=sums, solution=solution)
    if len(solved) == len(identify.QUANTITIES_OF):
        known |= _muscle_values(solved["without"], solved["with"], options)
    return known


class SolvedSwings(NamedTuple):
    """The sums of one condition, and what was identified from them."""

    sums: SwingSums
    solution: Solution


def _solution(sums: SwingSums, condition: Condition, options: ViscosityOptions) -> Solution:
    """Identify one condition from all its blocks, with the noise that it had."""
    hidden = bool(np.isnan(condition.mass.value))
    inertial = replace(options, tare="unknown") if hidden else options
    every = np.ones(len(sums))
    return solve_blocks(sums, every, inertial, options.stiffness is not False, condition.residual)


def _muscle_values(
    without: SolvedSwings, intact: SolvedSwings, options: ViscosityOptions
) -> dict[str, float]:
    """Compare both conditions: mass and viscosity of the muscles."""
    full = intact.solution
    masses = identify.muscle_masses(without.solution.inertia, full.inertia)
    names = ("estimated_muscle_mass", "least_muscle_mass")
    known = dict(zip(names, masses.tolist(), strict=True))
    muscles = len(intact.sums.muscles)
    if muscles:
        total = intact.sums.torque_total(full.counts)
        torque = torque_problem(total, full.inertia.parameters, options.stiffness is not False)
        joint = without.solution.joint.taken_off(options.subtract)
        known["muscle_viscosity"] = float(muscle_problem(torque, joint).along(np.ones(muscles)))
    return known
