"""Intervals that also hold errors which all swings of a specimen share: plate, gains, clock,
joint's center.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

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
    """The specimen with intervals widened by errors that all its swings share, and what each source
    adds.

    Every source is put into the recordings (rid of the errors of `instruments`) once with one
    standard deviation about or along each axis, and the whole identification repeated: g of each
    result. The result's variance is then g C g beside what swings scatter, with C the covariance of
    what is not known of the errors. Both conditions stand on one plate and have one center, so they
    share each error.
    """
    instruments = instruments or Instruments.assumed(errors)
    conditions = specimen_viscosity.conditions
    recordings = {
        name: tuple(thinned(each) for each in condition.recordings)
        for name, condition in conditions.items()
    }
    try:
        exact = _values(recordings, conditions, options)
        changes = []
        for (source, axis), size in zip(instruments.sources, instruments.prior, strict=True):
            moved = {
                name: tuple(
                    disturbed(recording, source, axis, size) for recording in condition_recordings
                )
                for name, condition_recordings in recordings.items()
            }
            other = _values(moved, conditions, options)
            changes.append({name: (other[name] - value) / size for name, value in exact.items()})
    except MyomorphError as error:
        return specimen_viscosity.changed(
            {}, [f"intervals hold no errors of instruments: {error}"]
        ), ()
    z = float(half_width(1.0, options.level))
    slopes = {name: np.array([change[name] for change in changes]) for name in exact}
    sds = {
        name: float(np.sqrt(max(g @ instruments.covariance @ g, 0.0))) for name, g in slopes.items()
    }

    def widened(name: str, estimate: Interval) -> Interval:
        return wider(estimate, z * sds.get(name, 0.0), name != "estimated_muscle_mass")

    parts: dict[str, Any] = {}
    changed: dict[str, Condition] = {}
    for key, condition in conditions.items():
        mass, com, moment, viscosity = identify.QUANTITIES_OF[key]
        axes = zip(condition.recordings[0].axes, condition.axis_viscosity, strict=True)
        plate = condition.plate_viscosity
        changed[key] = replace(
            condition,
            mass=widened(mass, condition.mass),
            com=widened(com, condition.com),
            first_moment=widened(moment, condition.first_moment),
            least_mass=widened(f"{mass} least", condition.least_mass),
            viscosity=widened(viscosity, condition.viscosity),
            plate_viscosity=None if plate is None else widened(f"plate {viscosity}", plate),
            axis_viscosity=tuple(
                widened(f"{axis} {viscosity}", estimate) for axis, estimate in axes
            ),
        )
    muscles = specimen_viscosity.muscles
    if muscles is not None:
        parts["muscles"] = replace(muscles, common=widened("muscle_viscosity", muscles.common))
    for part, name in (
        ("muscle_mass", "estimated_muscle_mass"),
        ("least_muscle_mass", "least_muscle_mass"),
    ):
        estimate = getattr(specimen_viscosity, part)
        parts[part] = None if estimate is None else widened(name, estimate)
    known = (
        (name, each)
        for name, each in specimen_viscosity.estimates.items()
        if np.isfinite(each.value)
    )
    swings = {name: (each.high - each.low) / (2.0 * z) for name, each in known}
    return specimen_viscosity.changed(changed, **parts), _shares(swings, slopes, instruments)


def _shares(
    swings: Mapping[str, float], slopes: Mapping[str, Array], instruments: Instruments
) -> tuple[ErrorShare, ...]:
    """The table of sources and results, by the scatter of `swings` and what a unit of each error
    changes.
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
    """The estimate with an interval to which the half-width of another error is added in the mean
    of squares.
    """
    low = estimate.value - float(np.hypot(estimate.value - estimate.low, half))
    high = estimate.value + float(np.hypot(estimate.high - estimate.value, half))
    return Interval(estimate.value, max(low, 0.0) if positive else low, high)


def _values(
    recordings: dict[str, tuple[SwingRecording, ...]],
    conditions: dict[str, Condition],
    options: ViscosityOptions,
) -> dict[str, float]:
    """Every result of the specimen from recordings of its conditions."""
    known: dict[str, float] = {}
    solved: dict[str, tuple[SwingSums, Solution]] = {}
    for key, condition_recordings in recordings.items():
        hidden = bool(np.isnan(conditions[key].mass.value))
        inertial = replace(options, tare="unknown") if hidden else options
        sums = swing_sums(condition_recordings, options.block, options.min_relative_speed)
        every = np.ones(len(sums))
        sprung = options.stiffness is not False
        whole = solve_blocks(sums, every, inertial, sprung, conditions[key].residual)
        mass, *_, viscosity = identify.QUANTITIES_OF[key]
        names = (
            f"plate {viscosity}",
            f"{mass} least",
            *(f"{axis} {viscosity}" for axis in sums.axes),
        )
        known |= dict(
            zip((*identify.QUANTITIES_OF[key], *names), whole.estimates.tolist(), strict=True)
        )
        solved[key] = sums, whole
    if len(solved) == len(identify.QUANTITIES_OF):
        masses = identify.muscle_masses(solved["without"][1].inertia, solved["with"][1].inertia)
        known |= dict(
            zip(("estimated_muscle_mass", "least_muscle_mass"), masses.tolist(), strict=True)
        )
        sums, full = solved["with"]
        if sums.muscles:
            total = sums.torque_total(full.counts)
            torque = torque_problem(total, full.inertia.parameters, options.stiffness is not False)
            problem = muscle_problem(torque, solved["without"][1].joint.taken_off(options.subtract))
            known["muscle_viscosity"] = float(problem.along(np.ones(len(sums.muscles))))
    return known
