"""One specimen from its files to its row of [S] tables I and II."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData, MyomorphError
from myomorph.core.model.findings import Finding
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.model import Model
from myomorph.core.model.provenance import Source
from myomorph.core.model.series import Trial
from myomorph.lab.report.charts.axis import number
from myomorph.lab.store.progress import Advance
from myomorph.lab.store.results import file_source
from myomorph.swings.viscosity.identification import identify
from myomorph.swings.viscosity.identification.identify import SpecimenViscosity
from myomorph.swings.viscosity.identified_model import identified_model
from myomorph.swings.viscosity.report import specimen_report as reports
from myomorph.swings.viscosity.specimen.model import Specimen, SwingTrial
from myomorph.swings.viscosity.study.calibration import calibrate, placed, plate_residuals
from myomorph.swings.viscosity.study.conditions import Prepared, identify_conditions
from myomorph.swings.viscosity.study.options import StudyOptions
from myomorph.swings.viscosity.study.recordings import CONDITIONS, SwingFiles
from myomorph.swings.viscosity.study.specimen_files import SpecimenFiles
from myomorph.swings.viscosity.study.swing_files import (
    OpenedSpecimen,
    open_specimen,
    open_swing,
    recorded_markers,
)
from myomorph.swings.viscosity.swings.recording import SwingRecording
from myomorph.swings.viscosity.tracking.track import track
from myomorph.swings.viscosity.tracking.tracked import TrackedSpecimen, swing_recordings
from myomorph.swings.viscosity.trust.checks import TARED, TOO_SMALL, condition_findings
from myomorph.swings.viscosity.trust.cutoff import SCANNED, choose_cutoff, scan_cutoffs
from myomorph.swings.viscosity.trust.models import (
    UNITS,
    PassiveComparison,
    PassiveOptions,
    compare_passive_laws,
)
from myomorph.swings.viscosity.trust.moment_arms import MomentArmOptions, moment_arm_sensitivity

LEVELS = (0.05, 0.10, 0.15, 0.20)  # Relative errors of moment arms that the figure shows.


def trusted(
    report: reports.SpecimenReport,
    specimen_viscosity: SpecimenViscosity,
    laws: PassiveOptions,
    arms: MomentArmOptions,
    compared: Mapping[str, PassiveComparison] = FrozenMap({}),
) -> reports.SpecimenReport:
    """Add to the report what shows how far its values can be trusted.

    What is unknown is named in its notes.
    """
    steps = [
        partial(
            with_laws, name=name, condition=condition, options=laws, compared=compared.get(name)
        )
        for name, condition in specimen_viscosity.conditions.items()
    ]
    for make in (*steps, partial(with_arms, specimen_viscosity=specimen_viscosity, options=arms)):
        try:
            report = make(report)
        except MyomorphError as error:
            report = replace(report, notes=(*report.notes, " ".join(str(error).split())))
    return report


def with_laws(
    report: reports.SpecimenReport,
    name: str,
    condition: identify.Condition,
    options: PassiveOptions,
    compared: PassiveComparison | None = None,
) -> reports.SpecimenReport:
    """Add alternatives to plain viscosity for one condition to the report."""
    if np.isnan(condition.mass.high):
        options = replace(options, tare="unknown")
    compared = compared or compare_passive_laws(condition.recordings, options)
    models = []
    for fit in compared.fits:
        terms = [
            (part, term.value)
            for part, term in fit.coefficients.items()
            if not part.startswith("rest")
        ]
        values = ", ".join(f"{part} {number(value)} {_unit(part)}" for part, value in terms)
        viscosity = dict(terms).get("viscosity", float("nan"))
        numbers = (viscosity, fit.aic, fit.bic, fit.angle_error, fit.moment_error)
        models.append(
            reports.PassiveModel(name, fit.name, values, *numbers, fit is compared.chosen)
        )
    shown = compared.prediction
    if shown is None:
        return replace(report, models=(*report.models, *models))
    predicted = FrozenMap({"viscosity": shown.viscous, compared.chosen.name: shown.chosen})
    held = reports.HeldOutSwing(name, shown.time, shown.axes, shown.measured, predicted)
    return replace(report, models=(*report.models, *models), held_out=(*report.held_out, held))


def _unit(part: str) -> str:
    unit = next((unit for start, unit in UNITS.items() if part.startswith(start)), "")
    return unit.replace(" ", "").replace("^2", "²")


def _with_cutoffs(
    report: reports.SpecimenReport,
    tracked: Mapping[str, TrackedSpecimen],
    cutoff: float,
    reason: str,
    options: identify.ViscosityOptions,
    hidden: Collection[str] = (),
) -> reports.SpecimenReport:
    """Add what other cut-offs would have given to the report.

    The mass of conditions in `hidden` is not shown.
    """
    values: dict[str, Array] = {}
    for name, condition_tracked in tracked.items():
        condition_options = replace(options, tare="unknown") if name in hidden else options
        scan = scan_cutoffs(
            partial(swing_recordings, condition_tracked, muscles=False), options=condition_options
        )
        mass, com, _, viscosity = identify.QUANTITIES_OF[name]
        values |= dict(zip((mass, com, viscosity), scan.T, strict=True))
    shown = {name: value for name, value in values.items() if np.isfinite(value).any()}
    scanned = reports.CutoffScan(np.array(SCANNED), cutoff, FrozenMap(shown), reason)
    return replace(report, cutoff=scanned) if shown else report


def with_arms(
    report: reports.SpecimenReport, specimen_viscosity: SpecimenViscosity, options: MomentArmOptions
) -> reports.SpecimenReport:
    """Add the spread of the common muscle viscosity under errors of the moment arms."""
    intact = specimen_viscosity.intact
    without = specimen_viscosity.without
    if specimen_viscosity.muscles is None or intact is None or without is None:
        return report
    swings = intact.recordings, intact.parameters, without.viscosity.value
    kinds = moment_arm_sensitivity(*swings, options)
    by_level = [
        moment_arm_sensitivity(*swings, replace(options, factor=level, offset=0.0))[1]
        for level in LEVELS
    ]
    exact = by_level[0].exact
    low, median, high = np.array(
        [np.full(3, exact), *(spread.quantiles() for spread in by_level)]
    ).T
    table = []
    for kind in kinds:
        size = (
            f"{1000 * kind.error:.1f} mm"
            if kind.kind.startswith("offset")
            else f"{100 * kind.error:.0f} %"
        )
        table.append(reports.ArmError(kind.kind, size, kind.sd, kind.bias, *kind.quantiles()))
    spread = reports.ArmSpread(
        np.array([0.0, *LEVELS]), low, median, high, len(by_level[0].draws), tuple(table)
    )
    return replace(report, arms=spread)


TRACKING = 0.5
IDENTIFYING = 0.25  # Shares of a specimen's time, for the bar.


@dataclass(frozen=True, eq=False)
class Studied:
    """An identified specimen: results, its report, its model with them, and its swings."""

    found: SpecimenViscosity
    report: reports.SpecimenReport
    model: Model | None = None
    tracked: Mapping[str, TrackedSpecimen] = field(default_factory=lambda: FrozenMap({}))


def study_specimen(files: SpecimenFiles, options: StudyOptions, advance: Advance) -> Studied:
    """Identify one specimen; an unusable condition is named in its notes.

    `advance` gets shares of the work done.
    """
    opened, conditions, lost = _opened(files, options, advance)
    specimen = opened.specimen
    notes = list(opened.notes)
    try:
        identified = identify_conditions(specimen, files, conditions, options)
    except BadData as error:
        raise BadData("; ".join((*lost, str(error)))) from None
    notes += [*lost, *identified.lost, *identified.conflicts]
    advance(IDENTIFYING)
    report, viscosity = _judged(
        identified.found, identified.by_swings, identified.conditions, notes
    )
    report = trusted(
        report,
        viscosity,
        identified.options.laws,
        identified.options.moment_arms,
        identified.compared,
    )
    tracked = {name: condition.tracked for name, condition in identified.conditions.items()}
    hidden = [name for name, condition in identified.conditions.items() if condition.hides_mass]
    filtered = identified.cutoff, identified.reason
    report = _with_cutoffs(report, tracked, *filtered, identified.options.identification, hidden)
    report, model = _with_model(report, viscosity, tracked, identified.cutoff)
    residuals = (*opened.residuals, *_marker_residuals(identified.conditions))
    shoulder = "scapula" in specimen.base.lower() and "humer" in specimen.first.lower()
    report = replace(
        report,
        truth=files.truth,
        paper=files.paper,
        calibration=residuals,
        scans=opened.scans,
        errors=identified.shares,
        instruments=identified.instruments,
        law=identified.law_name,
        shoulder=shoulder and len(specimen.joint_coordinates) == 3,
    )
    return Studied(found=viscosity, report=report, model=model, tracked=tracked)


def read_swings(
    files: SpecimenFiles, cutoff: float | None = None
) -> Mapping[str, tuple[SwingRecording, ...]]:
    """Read the recordings of a specimen as linear equations, which `identify_specimen` takes.

    Bones are tracked and the plate is calibrated as in a study; errors of instruments that the
    swings themselves show stay in.

    Parameters
    ----------
    files : one of `ViscosityPlan.specimens`
    cutoff : of the low-pass of motion and forces [Hz]; chosen from the recordings by default

    Returns
    -------
    recordings without and with muscles as "without" and "intact", arguments of `identify_specimen`

    Raises
    ------
    BadData, BadFile, BadModel, UnknownName
        where a condition has recordings that cannot be used

    Examples
    --------
    >>> from pathlib import Path
    >>> import myomorph as mm
    >>> short = mm.viscosity.ShoulderStudyOptions(seconds=6.0, trials=1, raw=())
    >>> study = mm.write_shoulder_study(Path("shoulder"), (3,), short)
    >>> specimen = mm.viscosity.read_viscosity_plan(study).specimens[0]
    >>> swings = mm.viscosity.read_swings(specimen, cutoff=6.0)
    >>> [(len(trials), len(trials[0].muscles)) for trials in swings.values()]
    [(1, 0), (1, 11)]
    """
    _, conditions, lost = _opened(files, StudyOptions(), lambda part: None)
    if lost:
        raise BadData("; ".join(lost))
    if cutoff is None:
        cutoff = choose_cutoff([condition.tracked for condition in conditions.values()]).cutoff
    result = dict.fromkeys(("without", "intact"), tuple[SwingRecording, ...]())
    for name, condition in conditions.items():
        muscles = name == "with"
        result["intact" if muscles else name] = swing_recordings(
            condition.tracked, cutoff, muscles=muscles
        )
    return FrozenMap(result)


def _opened(
    files: SpecimenFiles, options: StudyOptions, advance: Advance
) -> tuple[OpenedSpecimen, dict[str, Prepared], list[str]]:
    """Open the specimen and track its conditions.

    The third value holds why the others cannot be used, a line each.
    """
    opened = open_specimen(files, recorded_markers((*files.without, *files.intact)[0]))
    notes = (*opened.specimen.notes, *opened.notes)
    residuals = opened.residuals
    place = None
    if files.plate is not None:
        calibration = calibrate(files.plate)
        place = partial(placed, files=files.plate, calibration=calibration)
        notes += calibration.notes
        residuals += plate_residuals(calibration)
    conditions: dict[str, Prepared] = {}
    lost = []
    recordings = {name: entries for name, entries in files.recordings.items() if entries}

    def further(part: float) -> None:
        advance(TRACKING / len(recordings) * part)

    for name, entries in recordings.items():
        try:
            conditions[name] = _tracked(opened.specimen, files, entries, place, options, further)
        except MyomorphError as error:
            lost.append(f"{identify.STATES[name]}: {error}")
    if not conditions:
        raise BadData("; ".join(lost))
    return replace(opened, notes=notes, residuals=residuals), conditions, lost


def _tracked(
    specimen: Specimen,
    files: SpecimenFiles,
    entries: Sequence[SwingFiles],
    place: Callable[[Trial], Trial] | None,
    options: StudyOptions,
    advance: Advance,
) -> Prepared:
    notes: list[str] = []
    trials: list[SwingTrial] = []
    for entry in entries:
        trial, trial_notes = open_swing(entry, specimen.model, files, place)
        trials.append(trial)
        notes += trial_notes
    frames = 2 * sum(len(trial.markers) for trial in trials)
    tracked = track(specimen, trials, options.tracking, lambda done: advance(done / frames))
    notes += [*tracked.notes, *(note for trial in tracked.trials for note in trial.notes)]
    return Prepared(tracked, tuple(notes))


def _judged(
    viscosity: SpecimenViscosity,
    by_swings: SpecimenViscosity,
    conditions: Mapping[str, Prepared],
    notes: list[str],
) -> tuple[reports.SpecimenReport, SpecimenViscosity]:
    """Return the specimen without what its recordings cannot show, faults as notes.

    Small swings are judged by `by_swings`.
    """
    unknown: set[str] = set()
    for name in CONDITIONS:
        findings = _findings(name, conditions, by_swings)
        fresh = (finding.text for finding in findings if finding.text not in notes)
        notes += [f"{identify.STATES[name]}: {text}" for text in fresh]
        unknown |= _not_shown(name, {finding.kind for finding in findings})
    common = None if by_swings.muscles is None else by_swings.muscles.common
    if viscosity.muscles is not None and common is not None and not identify.is_narrow(common):
        notes.append(
            f"the swings do not determine the muscles' viscosity: {common.low:.2g} to"
            f" {common.high:.2g}"
            " N s/m"
        )
        unknown.add("muscle_viscosity")
        viscosity = replace(viscosity, muscles=None)
    notes += _further_notes(conditions, notes)
    viscosity = replace(viscosity, notes=tuple(dict.fromkeys((*notes, *viscosity.notes))))
    report = reports.specimen_report(viscosity)
    known = {name: estimate for name, estimate in report.row.items() if name not in unknown}
    return replace(report, row=known), viscosity


def _findings(
    name: str, conditions: Mapping[str, Prepared], by_swings: SpecimenViscosity
) -> list[Finding]:
    """Return the findings of a condition's recordings and of its estimates."""
    findings = list(conditions[name].findings) if name in conditions else []
    if name in by_swings.conditions:
        findings += condition_findings(by_swings.conditions[name])
    return findings


def _further_notes(conditions: Mapping[str, Prepared], notes: Sequence[str]) -> list[str]:
    """Return the notes of conditions that no line has already."""
    further = (note for condition in conditions.values() for note in condition.notes)
    return [note for note in further if not any(note in line for line in notes)]


def _not_shown(name: str, kinds: Collection[str]) -> set[str]:
    """Return the quantities that a condition with findings of these kinds does not show."""
    unknown: set[str] = set()
    if TARED in kinds:
        unknown |= {*identify.QUANTITIES_OF[name][:2], "estimated_muscle_mass"}
    if TOO_SMALL in kinds:
        unknown.add(identify.QUANTITIES_OF[name][-1])
    return unknown


def _with_model(
    report: reports.SpecimenReport,
    specimen_viscosity: SpecimenViscosity,
    tracked: Mapping[str, TrackedSpecimen],
    cutoff: float,
) -> tuple[reports.SpecimenReport, Model | None]:
    """Write the results into the specimen's model, for OpenSim.

    None of MJCF, whose tendons `.osim` cannot hold.
    """
    known = "joint_viscosity" in report.row
    condition_tracked = tracked.get("with", tracked.get("without"))
    if (
        condition_tracked is None
        or not known
        or not condition_tracked.specimen.model.source.lower().endswith(".osim")
    ):
        return report, None
    try:
        made = identified_model(condition_tracked, specimen_viscosity, cutoff)
    except MyomorphError as error:
        return replace(report, notes=(*report.notes, f"no identified.osim: {error}")), None
    return (
        (report, None)
        if made is None
        else (replace(report, notes=(*report.notes, *made[1])), made[0])
    )


def _marker_residuals(conditions: Mapping[str, Prepared]) -> tuple[reports.Residual, ...]:
    lines = []
    for name, condition in conditions.items():
        rms = np.concatenate([trial.rms for trial in condition.tracked.trials])
        if np.isfinite(rms).any():
            worst = f"largest {1000 * float(np.nanmax(rms)):.2f} mm in a frame"
            value = 1000 * float(np.sqrt(np.nanmean(rms**2)))
            lines.append(
                reports.Residual(f"markers to bones, {identify.STATES[name]}", value, "mm", worst)
            )
        for trial in condition.tracked.trials:
            clock = trial.clock
            if clock.length > 0.0:
                millionths = round(1e6 * clock.drift, 1)
                drift = f"drift {millionths:g} parts per million" if millionths else "no drift"
                lines.append(
                    reports.Residual(
                        f"clock of the plate, {trial.name}", 1e3 * clock.offset, "ms", drift
                    )
                )
    return tuple(lines)


def input_sources(files: SpecimenFiles) -> tuple[Source, ...]:
    """Return the files that a specimen is made from, with their hashes."""
    sources = [file_source("model", files.model)]
    for name, entries in files.recordings.items():
        for entry in entries:
            sources.append(file_source(f"markers {name} muscles", entry.markers))
            if entry.loads != entry.markers:
                sources.append(file_source(f"loads {name} muscles", entry.loads))
    further: list[tuple[str, Path]] = [] if files.tare is None else [("tare", files.tare)]
    further += [("CT", path) for scan in files.ct for path in (scan.surface, scan.cluster)]
    if files.plate is not None:
        further += [("plate calibration", path) for path in files.plate.placements]
    return (*sources, *(file_source(role, path) for role, path in further))
