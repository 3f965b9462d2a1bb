"""The law that acts in a joint, put into what was identified of a specimen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from myomorph.core.fit.interval_rule import half_width
from myomorph.core.model.interval import Interval
from myomorph.swings.viscosity.identification import identify
from myomorph.swings.viscosity.identification.budget import ErrorShare
from myomorph.swings.viscosity.identification.excitation import NOT_SHOWN
from myomorph.swings.viscosity.identification.shared_errors import wider
from myomorph.swings.viscosity.trust.acting import DRY, ActingLaw
from myomorph.swings.viscosity.trust.law import HINGES

FORM_WORDS = {
    "viscosity by axis": "axes",
    "hinges": "three angles one after another, as hinges or a diagonal matrix in joint angles,",
}
"""How the forms of a joint's viscosity are called in notes, where it is not one value."""


def with_acting(
    specimen_viscosity: identify.SpecimenViscosity,
    by_swings: identify.SpecimenViscosity,
    law: ActingLaw,
    shares: Sequence[ErrorShare],
    level: float,
) -> tuple[identify.SpecimenViscosity, dict[str, Interval]]:
    """Put what acts in the joint beside one viscosity into a specimen.

    It is what swings without muscles show. Instruments widen the one viscosity and friction as they
    widen the viscosity alone, and that of an axis as they widen that axis': an axis along the limb
    resists little, so that errors of the other axes' torque are large against it.

    Parameters
    ----------
    specimen_viscosity : with intervals that hold errors which all swings share
    by_swings : with intervals of swings alone
    law : that acts
    shares : what each source of errors adds
    level : of the intervals

    Returns
    -------
    the specimen, and what acts by name
    """
    condition = specimen_viscosity.without
    assert condition is not None
    assert by_swings.without is not None
    plain = condition.viscosity
    half = _shared_half(shares, level) / plain.value
    halves = _axis_halves(condition, by_swings.without)
    known = {
        name: _shown(wider(each, max(half * each.value, _own_half(name, law, halves)), True), plain)
        for name, each in law.coefficients.items()
    }
    used = replace(law, coefficients=known).viscosity_of(plain)
    condition = replace(condition, viscosity=used)
    if law.form == "viscosity by axis":
        axes = tuple(known[f"viscosity {axis}"] for axis in condition.recordings[0].axes)
        condition = replace(condition, axis_viscosity=axes)
    notes = [f"{identify.STATES['without']}: {note}" for note in _notes(law, known, plain, used)]
    return specimen_viscosity.changed({"without": condition}, notes), known


def _shared_half(shares: Sequence[ErrorShare], level: float) -> float:
    """Find the half-width that shared errors give the one viscosity [N m s/rad]."""
    swings = next(
        (each for each in shares if each.quantity == "joint_viscosity" and each.source == "swings"),
        None,
    )
    if swings is None or not swings.share > 0.0:
        return 0.0
    return float(half_width(swings.sd * np.sqrt(1.0 / swings.share - 1.0), level))


def _axis_halves(condition: identify.Condition, by_swings: identify.Condition) -> dict[str, float]:
    """Find the half-width that shared errors give the viscosity of each axis [N m s/rad]."""
    halves = {}
    pairs = zip(
        condition.recordings[0].axes,
        condition.axis_viscosity,
        by_swings.axis_viscosity,
        strict=True,
    )
    for axis, whole, swings in pairs:
        wide = 0.5 * (whole.high - whole.low)
        narrow = 0.5 * (swings.high - swings.low)
        known = np.isfinite(wide) and np.isfinite(narrow)
        halves[axis] = float(np.sqrt(max(wide**2 - narrow**2, 0.0))) if known else 0.0
    return halves


def _own_half(name: str, law: ActingLaw, halves: Mapping[str, float]) -> float:
    """Find the half-width that shared errors give the viscosity of an axis or of a hinge.

    The last of three hinges lies along the limb: what it is off by is the largest of the axes'.
    """
    if law.form == "viscosity by axis" and name.startswith("viscosity "):
        return halves[name.removeprefix("viscosity ")]
    if name == f"hinge {HINGES[-1]}":
        return max(halves.values())
    return 0.0


def _shown(estimate: Interval, plain: Interval) -> Interval:
    """Return an estimate, or that it is not shown where its interval says next to nothing."""
    half = 0.5 * (estimate.high - estimate.low)
    return NOT_SHOWN if half > identify.MAX_RELATIVE_WIDTH * plain.value else estimate


def _notes(
    law: ActingLaw, known: Mapping[str, Interval], plain: Interval, used: Interval
) -> list[str]:
    """Report what acts in the joint beside one viscosity.

    Parameters
    ----------
    law : that predicts held-out trials best
    known : its coefficients
    plain : the one viscosity alone
    used : the one viscosity that is used
    """
    notes = []
    if law.form in FORM_WORDS:
        parts = {name: each for name, each in known.items() if name not in (DRY, "viscosity")}
        values = ", ".join(
            f"{each.value:.3g} ({each.low:.3g} to {each.high:.3g})"
            if np.isfinite(each.value)
            else "what is not shown"
            for each in parts.values()
        )
        if any(np.isfinite(each.value) and not each.holds(used.value) for each in parts.values()):
            notes.append(
                f"{FORM_WORDS[law.form]} resist with {values} N m s/rad: the one value simplifies"
            )
    if law.friction:
        dry = known[DRY]
        friction = (
            f"dry friction of {dry.value:.2g} N m ({dry.low:.2g} to {dry.high:.2g}) {law.friction}"
            " of the joint"
        )
        values = f"{used.value:.3g}, is used; alone it is {plain.value:.3g} N m s/rad"
        notes.append(f"{friction}: the viscosity beside it, {values}")
    if law.alike:
        notes.append(
            f"the law is {law.name}: the viscosity's interval, {used.low:.3g} to"
            f" {used.high:.3g} N m s/rad, holds what each of them gives"
        )
    return notes
