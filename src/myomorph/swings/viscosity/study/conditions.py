"""The conditions of one specimen from tracked trials to values.

On the way are cut-off, equations, law, three steps and shared errors.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from myomorph.core.fit.interval_rule import half_width
from myomorph.core.model.errors import BadData, MyomorphError
from myomorph.core.model.findings import Finding
from myomorph.core.model.interval import Interval
from myomorph.swings.causes import PLATE
from myomorph.swings.viscosity.identification import identify
from myomorph.swings.viscosity.identification.base_load import UNKNOWN, BaseLoad, with_base_load
from myomorph.swings.viscosity.identification.budget import ErrorOptions, ErrorShare
from myomorph.swings.viscosity.identification.instruments import Instruments, estimate_instruments
from myomorph.swings.viscosity.identification.shared_errors import wider, with_shared_errors
from myomorph.swings.viscosity.specimen.model import Specimen
from myomorph.swings.viscosity.study.joint_law import with_acting
from myomorph.swings.viscosity.study.options import StudyOptions
from myomorph.swings.viscosity.study.recordings import CONDITIONS
from myomorph.swings.viscosity.study.specimen_files import SpecimenFiles
from myomorph.swings.viscosity.swings.recording import SwingRecording
from myomorph.swings.viscosity.tracking.tracked import TrackedSpecimen, swing_recordings
from myomorph.swings.viscosity.trust.acting import ActingLaw
from myomorph.swings.viscosity.trust.attachments import with_attachments
from myomorph.swings.viscosity.trust.checks import (
    TARED,
    base_findings,
    recording_findings,
    tracking_findings,
)
from myomorph.swings.viscosity.trust.cutoff import choose_cutoff
from myomorph.swings.viscosity.trust.models import (
    PassiveComparison,
    PassiveOptions,
    compare_passive_laws,
)

SWAY_SHARE = 0.3
"""Relative standard deviation of a viscosity, over the angle by which its base turns to and fro;
chosen on virtual limbs whose base's motion was taken off [1/rad].
"""


@dataclass(frozen=True, eq=False)
class Prepared:
    """One condition on its way.

    Attributes
    ----------
    tracked : its trials
    notes : on them
    recordings : as equations at one cut-off
    findings : what is wrong with them
    """

    tracked: TrackedSpecimen
    notes: tuple[str, ...]
    recordings: tuple[SwingRecording, ...] = ()
    findings: tuple[Finding, ...] = ()

    @property
    def hides_mass(self) -> bool:
        """Whether the plate was set to zero with the limb on it."""
        return any(finding.kind == TARED for finding in self.findings)


@dataclass(frozen=True, eq=False)
class Identified:
    """What the conditions of one specimen come to.

    Attributes
    ----------
    found : with intervals that hold errors which all swings share, and those of attachments
    by_swings : of swings alone, by which a swing is judged too small
    shares : what each source of errors adds
    instruments : errors that the swings show
    conditions : rid of these errors
    options : with the law of the passive torque decided
    compared : laws, by condition
    cutoff, reason : of the low-pass [Hz], and why it is that
    lost : conditions that could not be used
    conflicts : criteria of a law that disagree
    law : what acts in the joint beside one viscosity, by name
    law_name : in words, "" for one viscosity alone
    """

    found: identify.SpecimenViscosity
    by_swings: identify.SpecimenViscosity
    shares: tuple[ErrorShare, ...]
    instruments: Instruments
    conditions: Mapping[str, Prepared]
    options: StudyOptions
    compared: Mapping[str, PassiveComparison]
    cutoff: float
    reason: str
    lost: tuple[str, ...]
    conflicts: tuple[str, ...]
    law: Mapping[str, Interval]
    law_name: str


def identify_conditions(
    specimen: Specimen, files: SpecimenFiles, tracked: Mapping[str, Prepared], options: StudyOptions
) -> Identified:
    """Identify a specimen from the tracked trials of one condition or both.

    Parameters
    ----------
    specimen : of the model
    files : what else is known of it
    tracked : trials by condition
    options : of the study

    Raises
    ------
    BadData : no condition can be used
    """
    lost: list[str] = []
    cutoff, reason = _cutoff(options, tracked)
    conditions = _equations(tracked, cutoff, options.identification.tare != "unknown", lost)
    if not conditions:
        raise BadData("; ".join(lost))
    sway = _sway(conditions)
    # The inertia of a base that goes to and fro is in the wrench too, and would look like errors of
    # the instruments.
    told = replace(options.errors, estimate=options.errors.estimate and not sway)
    conditions, instruments = _corrected(conditions, told, options.identification.tare != "known")
    conditions = _with_base(conditions, instruments, files.base_load)
    compared, conflicts = _compared(conditions, options.laws)
    options = _with_law(options, compared)
    # A base that gives way resists by itself, which looks like friction.
    acting = compared["without"].acting if "without" in compared and not sway else None
    if acting is not None and options.identification.subtract == "one":
        conditions = _resisting(conditions, acting)
    by_swings = _identified(specimen, files, conditions, options.identification)
    found, shares = _with_errors(by_swings, options, instruments, conditions)
    found = with_base_load(found, files.base_load)
    joint: dict[str, Interval] = {}
    if sway:
        found = _with_sway(found, sway, options.identification.level)
    if acting is not None and found.without is not None:
        found, joint = with_acting(found, by_swings, acting, shares, options.identification.level)
    return Identified(
        found=found,
        by_swings=by_swings,
        shares=shares,
        instruments=instruments,
        conditions=conditions,
        options=options,
        compared=compared,
        cutoff=cutoff,
        reason=reason,
        lost=tuple(lost),
        conflicts=tuple(conflicts),
        law=joint,
        law_name=acting.name if joint and acting is not None else "",
    )


def _sway(conditions: Mapping[str, Prepared]) -> float:
    """Find how far the base turns to and fro at most [rad]."""
    slips = [slip for condition in conditions.values() for slip in condition.tracked.slips]
    turns = [
        slip.amount
        for slip in slips
        if slip.what == "base" and slip.unit == "rad" and not (slip.lasting or slip.before)
    ]
    return max(turns, default=0.0)


def _resisting(conditions: Mapping[str, Prepared], acting: ActingLaw) -> dict[str, Prepared]:
    """Let the joint resist as a law acts, in the place of its rates."""
    return {
        name: replace(
            condition,
            recordings=tuple(
                replace(each, resisting=acting.resisting(each)) for each in condition.recordings
            ),
        )
        for name, condition in conditions.items()
    }


def _with_errors(
    by_swings: identify.SpecimenViscosity,
    options: StudyOptions,
    instruments: Instruments,
    conditions: Mapping[str, Prepared],
) -> tuple[identify.SpecimenViscosity, tuple[ErrorShare, ...]]:
    """Widen intervals by shared errors and those of attachments, and find what each adds.

    Parameters
    ----------
    by_swings : with intervals of swings alone
    options : of the study
    instruments : what swings show of their errors
    conditions : with their trials
    """
    intact = conditions["with"].tracked if "with" in conditions else None
    level = options.identification.level
    found, shares = with_shared_errors(
        by_swings, options.identification, options.errors, instruments
    )
    return with_attachments(found, shares, intact, options.moment_arms, level)


def _cutoff(options: StudyOptions, conditions: Mapping[str, Prepared]) -> tuple[float, str]:
    """Choose the cut-off of all conditions [Hz], and say why."""
    if options.filter.cutoff is not None:
        return options.filter.cutoff, f"The cut-off of {options.filter.cutoff:g} Hz was given."
    chosen = choose_cutoff([condition.tracked for condition in conditions.values()])
    return chosen.cutoff, f"{chosen.reason[:1].upper()}{chosen.reason[1:]}."


def _equations(
    conditions: Mapping[str, Prepared], cutoff: float, tared: bool, lost: list[str]
) -> dict[str, Prepared]:
    """Make equations of the conditions, and find faults; those that have none are lost."""
    result = {}
    for name, condition in conditions.items():
        try:
            recordings = swing_recordings(condition.tracked, cutoff, muscles=name == "with")
            findings = (*tracking_findings(condition.tracked), *recording_findings(recordings))
        except MyomorphError as error:
            lost.append(f"{identify.STATES[name]}: {error}")
            continue
        if not tared:
            hidden = Finding(
                TARED,
                "plate",
                PLATE.message(
                    "the plate's zero is assumed unknown, so the mass is not identifiable"
                ),
            )
            findings = (hidden, *(each for each in findings if each.kind not in (TARED, "zero")))
        result[name] = replace(condition, recordings=recordings, findings=findings)
    return result


def _corrected(
    conditions: Mapping[str, Prepared], options: ErrorOptions, loaded: bool
) -> tuple[dict[str, Prepared], Instruments]:
    """Take off the errors of instruments that swings tell, and say what is known of these."""
    if not options.estimate:
        return dict(conditions), Instruments.assumed(options)
    free = [name for name, condition in conditions.items() if loaded or condition.hides_mass]
    recordings = {name: condition.recordings for name, condition in conditions.items()}
    instruments = estimate_instruments(recordings, options, free)
    corrected = {
        name: map(instruments.corrected, condition.recordings)
        for name, condition in conditions.items()
    }
    return {
        name: replace(conditions[name], recordings=tuple(made)) for name, made in corrected.items()
    }, instruments


def _with_base(
    conditions: Mapping[str, Prepared], instruments: Instruments, load: BaseLoad
) -> dict[str, Prepared]:
    """Find where the base carries a load that was not stated.

    Of a load that was stated no moment is a fault.
    """
    result = dict(conditions)
    for name, condition in conditions.items():
        findings = condition.findings
        if 0.0 < (load.removed if name == "without" else load.intact)[1] < UNKNOWN[1]:
            findings = tuple(finding for finding in findings if finding.kind != "zero")
        elif not any(finding.kind in (TARED, "zero") for finding in findings):
            findings += base_findings(condition.recordings, instruments)
        result[name] = replace(condition, findings=findings)
    return result


def _compared(
    conditions: Mapping[str, Prepared], options: PassiveOptions
) -> tuple[dict[str, PassiveComparison], list[str]]:
    """Compare laws of the passive torque of every condition, and note where criteria disagree."""
    comparisons = {}
    notes = []
    for name, condition in conditions.items():
        condition_options = replace(options, tare="unknown") if condition.hides_mass else options
        try:
            comparisons[name] = compare_passive_laws(condition.recordings, condition_options)
        except MyomorphError:
            continue  # `with_laws` tries again and names it.
        if comparisons[name].conflict:
            notes.append(f"{identify.STATES[name]}: {comparisons[name].conflict}")
    return comparisons, notes


def _with_sway(
    specimen_viscosity: identify.SpecimenViscosity, sway: float, level: float
) -> identify.SpecimenViscosity:
    """Widen viscosities by what a base that goes to and fro leaves unknown."""
    share = float(half_width(SWAY_SHARE * sway, level))

    def swayed(estimate: Interval) -> Interval:
        return wider(estimate, share * estimate.value, True)

    conditions = specimen_viscosity.conditions.items()
    changed = {
        name: replace(condition, viscosity=swayed(condition.viscosity))
        for name, condition in conditions
    }
    muscles = specimen_viscosity.muscles
    muscles = muscles and replace(muscles, common=swayed(muscles.common))
    return specimen_viscosity.changed(changed, muscles=muscles)


def _with_law(options: StudyOptions, compared: Mapping[str, PassiveComparison]) -> StudyOptions:
    """Fit a spring where it was asked for, or where swings are predicted better with it."""
    if options.identification.stiffness is not None:
        return options
    sprung = any(
        "stiffness" in term for comparison in compared.values() for term in comparison.chosen.terms
    )
    parts = {
        name: replace(getattr(options, name), stiffness=sprung)
        for name in ("identification", "moment_arms")
    }
    return replace(options, **parts)


def _identified(
    specimen: Specimen,
    files: SpecimenFiles,
    conditions: Mapping[str, Prepared],
    options: identify.ViscosityOptions,
) -> identify.SpecimenViscosity:
    """Do the three steps.

    Where one plate hides the mass, that of the other condition comes from it alone.
    """
    forces = specimen.isometric_forces
    shares = (
        dict(zip(specimen.muscles, forces.tolist(), strict=True)) if (forces > 0.0).all() else None
    )
    measured = identify.MeasuredMuscles(pcsa=files.pcsa or shares, mass=files.measured_muscle_mass)
    recordings = {
        name: conditions[name].recordings if name in conditions else () for name in CONDITIONS
    }

    def solved(
        which: tuple[str, ...], chosen: identify.ViscosityOptions
    ) -> identify.SpecimenViscosity:
        bare_name, full_name = CONDITIONS
        bare = recordings[bare_name] if bare_name in which else ()
        full = recordings[full_name] if full_name in which else ()
        return identify.identify_specimen(files.name, bare, full, measured, chosen)

    hidden = [name for name, condition in conditions.items() if condition.hides_mass]
    if not hidden:
        return solved(CONDITIONS, options)
    solution = solved(CONDITIONS, replace(options, tare="unknown"))
    for name in set(conditions) - set(hidden):
        known = solution.conditions.get(name)
        alone = solved((name,), options).conditions.get(name)
        if known is not None and alone is not None:
            solution = solution.changed({name: replace(known, mass=alone.mass, com=alone.com)})
    return replace(solution, muscle_mass=None)
