"""Run a study of swinging limbs: every specimen from raw recordings to its rows of [S] tables I and II."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from myomorph import __version__
from myomorph.identify.arm_sensitivity import ArmOptions
from myomorph.identify.passive_models import PassiveOptions
from myomorph.identify.specimen import Specimen, SwingTrial
from myomorph.identify.swing_rows import SwingOptions, swing_recordings
from myomorph.identify.swings import SwingRecording
from myomorph.identify.tracking import TrackedSpecimen, TrackingOptions, track
from myomorph.identify.viscosity import SpecimenViscosity, ViscosityOptions, identify_specimen
from myomorph.model.errors import BadData, MyomorphError
from myomorph.model.provenance import Provenance, Source
from myomorph.report.given import Note, SourceFile, Step
from myomorph.report.viscosity import viscosity_page
from myomorph.report.viscosity_given import Residual, SpecimenReport, ViscosityInput, specimen_report
from myomorph.study.progress import Advance, progress
from myomorph.study.results import file_name, file_source, provenance_of, whole_folder
from myomorph.study.settings import plain_settings, with_settings
from myomorph.study.swing_files import marker_names, open_specimen, open_swing
from myomorph.study.viscosity_files import write_swings, write_tables, write_whole
from myomorph.study.viscosity_plan import CONDITIONS, SpecimenFiles, SwingFiles, ViscosityPlan
from myomorph.study.viscosity_store import write_store
from myomorph.study.viscosity_trust import trusted

REPORT, PROVENANCE = "report.html", "provenance.json"
TRACKING, IDENTIFYING = 0.5, 0.25
"""Shares of a specimen's time, for the bar."""


@dataclass(frozen=True)
class FilterOptions:
    """The low-pass of motion and wrench.

    Attributes
    ----------
    cutoff : of motion and wrench [Hz]; chosen from the recordings by default
    """

    cutoff: float | None = None


@dataclass(frozen=True)
class StudyOptions:
    """All that a study of swinging limbs may be told, each part in its own table."""

    filter: FilterOptions = field(default_factory=FilterOptions)
    tracking: TrackingOptions = field(default_factory=TrackingOptions)
    swings: SwingOptions = field(default_factory=SwingOptions)
    identification: ViscosityOptions = field(default_factory=ViscosityOptions)
    laws: PassiveOptions = field(default_factory=PassiveOptions)
    arms: ArmOptions = field(default_factory=ArmOptions)

    @staticmethod
    def of(settings: Mapping[str, Mapping[str, Any]]) -> StudyOptions:
        """Options from the tables of a study file, or from a command line."""
        plain = StudyOptions()
        return replace(plain, **{name: with_settings(getattr(plain, name), own) for name, own in settings.items()})

    @property
    def plain(self) -> dict[str, dict[str, object]]:
        """The settings as plain values, by table."""
        return {name: plain_settings(getattr(self, name)) for name in self.__dataclass_fields__}


@dataclass(frozen=True, eq=False)
class SpecimenOutcome:
    """What became of one specimen.

    Attributes
    ----------
    report : what is shown of it; its `failure` where it could not be done
    found : None where it could not be done
    sources : the files it was made from
    seconds : it took [s]
    fault : whether a failure is a fault of Myomorph rather than of the input
    """

    report: SpecimenReport
    found: SpecimenViscosity | None = None
    sources: tuple[Source, ...] = ()
    seconds: float = 0.0
    fault: bool = False


def run_viscosity(
    plan: ViscosityPlan, out: Path, said: Callable[[SpecimenOutcome], None] = lambda outcome: None
) -> list[SpecimenOutcome]:
    """Identify every specimen of a plan and write tables and `report.html` into a folder.

    A specimen that fails is named with its reason, and the others are done all the same. What is known so far is
    written after every specimen, each file whole or not at all.

    Parameters
    ----------
    said : called with each specimen's outcome when it ends

    Raises
    ------
    BadData : an option is out of its range
    """
    options = StudyOptions.of(plan.settings)
    out.mkdir(parents=True, exist_ok=True)
    outcomes: list[SpecimenOutcome] = []
    with progress("viscosity", len(plan.specimens), "specimens") as advance:
        for files in plan.specimens:
            started = time.monotonic()
            outcome = replace(_outcome(files, options, out, advance), seconds=time.monotonic() - started)
            outcomes.append(outcome)
            said(outcome)
            write_cohort(plan, options, outcomes, out)
    return outcomes


def _outcome(files: SpecimenFiles, options: StudyOptions, out: Path, advance: Advance) -> SpecimenOutcome:
    report = SpecimenReport(files.name, truth=files.truth, paper=files.paper)
    told = 0.0

    def within(share: float) -> None:
        nonlocal told
        share = min(share, 1.0 - told)
        told += share
        advance(share)

    try:
        return study_specimen(files, options, out / file_name(files.name), within)
    except (MyomorphError, OSError) as error:
        return SpecimenOutcome(replace(report, failure=" ".join(str(error).split())))
    except Exception as error:
        text = f"{type(error).__name__}: {' '.join(str(error).split())}"
        return SpecimenOutcome(replace(report, failure=text), fault=True)
    finally:
        within(1.0)


def study_specimen(files: SpecimenFiles, options: StudyOptions, folder: Path, advance: Advance) -> SpecimenOutcome:
    """Identify one specimen and write the tables of its trials into a folder.

    A condition that cannot be used is named in the notes, and what the other one shows is still found.

    Parameters
    ----------
    advance : called with the share of the specimen's work just done

    Raises
    ------
    BadData, BadFile, BadModel, UnknownName
        where neither condition can be used
    """
    sources = input_sources(files)
    first = next(iter((*files.without, *files.intact)))
    specimen = open_specimen(files, marker_names(first))
    notes = list(specimen.notes)
    count = sum(1 for entries in (files.without, files.intact) if entries)
    conditions: dict[str, Prepared] = {}
    for name, entries in zip(CONDITIONS, (files.without, files.intact), strict=True):
        if not entries:
            notes.append(f"no recordings {name} muscles: what needs them is lacking")
            continue
        try:
            conditions[name] = _prepared(
                specimen, files, entries, options, lambda part: advance(TRACKING * part / count)
            )
        except MyomorphError as error:
            notes.append(f"{name} muscles: {error}")
    if not conditions:
        raise BadData("; ".join(notes[len(specimen.notes) :]))
    cutoff = options.filter.cutoff or 8.0
    recordings: dict[str, tuple[SwingRecording, ...]] = dict.fromkeys(CONDITIONS, ())
    for name, one in conditions.items():
        notes += one.notes
        recordings[name] = swing_recordings(one.tracked, cutoff, options.swings, muscles=name == "with")
    pcsa = files.pcsa or dict(zip(specimen.muscles, specimen.isometric_forces.tolist(), strict=True))
    found = identify_specimen(
        files.name, recordings["without"], recordings["with"], pcsa, files.measured_muscle_mass, options.identification
    )
    advance(IDENTIFYING)
    found = replace(found, notes=tuple(dict.fromkeys((*notes, *found.notes))))
    report = trusted(specimen_report(found), found, options.laws, options.arms)
    report = replace(report, truth=files.truth, paper=files.paper, calibration=_calibration(conditions))
    with whole_folder(folder) as temporary:
        write_swings(found, temporary)
    return SpecimenOutcome(report, found, sources)


@dataclass(frozen=True, eq=False)
class Prepared:
    """One condition's trials as motion and wrench, and what was said of them."""

    tracked: TrackedSpecimen
    notes: tuple[str, ...]


def _prepared(
    specimen: Specimen, files: SpecimenFiles, entries: Sequence[SwingFiles], options: StudyOptions, advance: Advance
) -> Prepared:
    notes: list[str] = []
    trials: list[SwingTrial] = []
    for entry in entries:
        trial, told = open_swing(entry, specimen.model, files.tare)
        trials.append(trial)
        notes += told
    frames = 2 * sum(len(trial.markers) for trial in trials)
    tracked = track(specimen, trials, options.tracking, lambda done: advance(done / frames))
    notes += [*tracked.notes, *(note for trial in tracked.trials for note in trial.notes)]
    return Prepared(tracked, tuple(notes))


def _calibration(conditions: Mapping[str, Prepared]) -> tuple[Residual, ...]:
    lines = []
    for name, one in conditions.items():
        rms = np.concatenate([trial.rms for trial in one.tracked.trials])
        if np.isfinite(rms).any():
            worst = f"largest {1000 * float(np.nanmax(rms)):.2f} mm in a frame"
            value = 1000 * float(np.sqrt(np.nanmean(rms**2)))
            lines.append(Residual(f"markers to bones, {name} muscles", value, "mm", worst))
    return tuple(lines)


def input_sources(files: SpecimenFiles) -> tuple[Source, ...]:
    """The files that a specimen is made from, by their hashes."""
    sources = [file_source("model", files.model)]
    for name, entries in zip(CONDITIONS, (files.without, files.intact), strict=True):
        for entry in entries:
            sources.append(file_source(f"markers {name} muscles", entry.markers))
            if entry.loads != entry.markers:
                sources.append(file_source(f"loads {name} muscles", entry.loads))
    if files.tare is not None:
        sources.append(file_source("tare", files.tare))
    return tuple(sources)


def write_cohort(plan: ViscosityPlan, options: StudyOptions, outcomes: Sequence[SpecimenOutcome], out: Path) -> None:
    """Write tables, provenance and report of the specimens so far."""
    reports = tuple(one.report for one in outcomes)
    write_tables(reports, out)
    made = _provenance(plan, options, outcomes)
    write_whole(made.to_json() + "\n", out / PROVENANCE)
    given = viscosity_input(plan, options, reports, made)
    write_store(given, out)
    write_whole(viscosity_page(given), out / REPORT)


def _provenance(plan: ViscosityPlan, options: StudyOptions, outcomes: Sequence[SpecimenOutcome]) -> Provenance:
    sources = [] if plan.path is None else [file_source("study", plan.path)]
    sources += [source for one in outcomes for source in one.sources]
    plain = {f"{table}.{name}": value for table, own in options.plain.items() for name, value in own.items()}
    return provenance_of("viscosity", sources, plain)


def viscosity_input(
    plan: ViscosityPlan, options: StudyOptions, reports: tuple[SpecimenReport, ...], made: Provenance
) -> ViscosityInput:
    """What the report shows of a study."""
    sources = dict.fromkeys(SourceFile(one.role, Path(one.name).name, one.sha256) for one in made.sources)
    steps = tuple(
        Step(table, MappingProxyType({name: _told(value) for name, value in own.items()}))
        for table, own in options.plain.items()
    )
    return ViscosityInput(plan.name, reports, head_notes(plan), tuple(sources), steps, made.date, __version__)


def head_notes(plan: ViscosityPlan) -> tuple[Note, ...]:
    """What is real, simulated and assumed, as the study file says it and as the method has it."""
    real = plan.real
    if not real and not plan.simulated:
        trials = sum(len(one.without) + len(one.intact) for one in plan.specimens)
        real = (f"Markers and forces of {trials} recordings, as the study file names them.",)
    assumed = (
        "The limb beyond the joint is one rigid link; the joint turns about one fixed center; the base does not move.",
        "Swings are passive: nobody touches the limb, and no muscle is active.",
        "Moment arms are those of the model. One value for all axes and one for all muscles, as the paper has it; "
        "values by axis and by muscle stand beside.",
        *plan.assumed,
    )
    parts = (("real", real), ("simulated", plan.simulated), ("assumed", assumed))
    return tuple(Note(kind, text) for kind, texts in parts for text in texts)  # type: ignore[arg-type]


def _told(value: object) -> str:
    if value is None:
        return "chosen"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:g}" if isinstance(value, float) else str(value)
