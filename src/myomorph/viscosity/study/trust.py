"""How far to trust a specimen's viscosity: other passive laws, held-out swings, moment arms in error."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import replace

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.errors import MyomorphError
from myomorph.model.frozen_map import FrozenMap
from myomorph.report.charts.axis import number
from myomorph.viscosity.identification.identify import Condition, SpecimenViscosity, ViscosityOptions
from myomorph.viscosity.report.given import (
    ArmError,
    ArmSpread,
    CutoffScan,
    HeldOutSwing,
    PassiveModel,
    SpecimenReport,
)
from myomorph.viscosity.tracking.rows import swing_recordings
from myomorph.viscosity.tracking.track import TrackedSpecimen
from myomorph.viscosity.trust.cutoff import SCANNED, scan_cutoffs
from myomorph.viscosity.trust.models import UNITS, PassiveComparison, PassiveOptions, compare_passive_laws
from myomorph.viscosity.trust.moment_arms import MomentArmOptions, moment_arm_sensitivity

LEVELS = (0.05, 0.10, 0.15, 0.20)
"""Relative errors of moment arms that the figure shows."""

EACH = "factor of each muscle"


def trusted(
    report: SpecimenReport, found: SpecimenViscosity, laws: PassiveOptions, arms: MomentArmOptions
) -> SpecimenReport:
    """The report with what tells how far to trust its values; what cannot be told is named in its notes."""
    for make in (
        lambda one: with_laws(one, "without", found.without, laws),
        lambda one: with_laws(one, "with", found.intact, laws),
        lambda one: with_arms(one, found, arms),
    ):
        report = _tried(report, make)
    return report


def _tried(report: SpecimenReport, make: Callable[[SpecimenReport], SpecimenReport]) -> SpecimenReport:
    try:
        return make(report)
    except MyomorphError as error:
        return replace(report, notes=(*report.notes, " ".join(str(error).split())))


def with_laws(
    report: SpecimenReport, name: str, condition: Condition | None, options: PassiveOptions
) -> SpecimenReport:
    """The report with alternatives to plain viscosity for one condition."""
    if condition is None:
        return report
    if np.isnan(condition.mass.value):
        options = replace(options, tare="unknown")
    compared = compare_passive_laws(condition.recordings, options)
    models = tuple(
        PassiveModel(
            name,
            one.name,
            ", ".join(
                f"{part} {number(value.value)} {_unit(part)}"
                for part, value in one.coefficients.items()
                if not part.startswith("rest")
            ),
            one.coefficients["viscosity"].value if "viscosity" in one.coefficients else float("nan"),
            one.aic,
            one.bic,
            one.angle_error,
            one.moment_error,
            one is compared.chosen,
        )
        for one in compared.fits
    )
    held = () if compared.prediction is None else (_held_out(name, compared),)
    return replace(report, models=(*report.models, *models), held_out=(*report.held_out, *held))


def _unit(part: str) -> str:
    return (
        next((unit for start, unit in UNITS.items() if part.startswith(start)), "").replace(" ", "").replace("^2", "²")
    )


def _held_out(name: str, compared: PassiveComparison) -> HeldOutSwing:
    shown = compared.prediction
    assert shown is not None
    predicted = {"viscosity": shown.viscous_angles}
    if compared.chosen.name != "viscosity":
        predicted[compared.chosen.name] = shown.chosen_angles
    return HeldOutSwing(name, shown.measured.time, shown.axes, shown.measured_angles, FrozenMap(predicted))


def with_cutoffs(
    report: SpecimenReport,
    tracked: Mapping[str, TrackedSpecimen],
    cutoff: float,
    reason: str,
    options: ViscosityOptions,
    hidden: Collection[str] = (),
) -> SpecimenReport:
    """The report with what other cut-offs of the filter would have given.

    Parameters
    ----------
    hidden : conditions whose plate hides the mass
    """
    values: dict[str, Array] = {}
    for name, one in tracked.items():
        own = replace(options, tare="unknown") if name in hidden else options
        scan = scan_cutoffs(lambda at, one=one: swing_recordings(one, at, muscles=False), options=own)  # type: ignore[misc]
        kind = "joint_viscosity" if name == "without" else "total_viscosity"
        values |= {kind: scan.viscosity, f"com_{name}": scan.com, f"mass_{name}": scan.mass}
    shown = {name: one for name, one in values.items() if np.isfinite(one).any()}
    cutoffs = np.array(SCANNED)
    return replace(report, cutoff=CutoffScan(cutoffs, cutoff, FrozenMap(shown), reason)) if shown else report


def with_arms(report: SpecimenReport, found: SpecimenViscosity, options: MomentArmOptions) -> SpecimenReport:
    """The report with the spread of the common muscle viscosity under errors of the moment arms."""
    if found.muscles is None or found.intact is None or found.without is None:
        return report

    def spreads(one: MomentArmOptions) -> tuple:
        assert found.intact is not None
        assert found.without is not None
        given = found.without.viscosity.value
        return moment_arm_sensitivity(found.intact.recordings, found.intact.parameters, given, one).spreads

    kinds = spreads(options)
    by_level = [
        next(one for one in spreads(replace(options, factor=level, offset=0.0)) if one.kind == EACH) for level in LEVELS
    ]
    exact = by_level[0].exact
    low, median, high = np.array([np.full(3, exact), *(one.quantiles() for one in by_level)]).T
    table = tuple(ArmError(one.kind, _size(one.kind, one.error), one.sd, one.bias, *one.quantiles()) for one in kinds)
    spread = ArmSpread(np.array([0.0, *LEVELS]), low, median, high, len(by_level[0].draws), table)
    return replace(report, arms=spread)


def _size(kind: str, error: float) -> str:
    return f"{1000 * error:.1f} mm" if kind.startswith("offset") else f"{100 * error:.0f} %"
