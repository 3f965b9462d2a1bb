"""Run a study of swinging limbs: every specimen from raw recordings to its rows of [S] tables I and II."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from myomorph import __version__
from myomorph.io.osim.write import write_osim
from myomorph.model.frozen_map import FrozenMap
from myomorph.model.provenance import Provenance, Source
from myomorph.report.page.parts import Note, SourceFile, Step
from myomorph.store.outcome import Outcome, failed
from myomorph.store.progress import Advance, progress
from myomorph.store.results import file_name, file_source, provenance_of, whole_folder
from myomorph.viscosity.identification.identify import SpecimenViscosity
from myomorph.viscosity.report.given import SpecimenReport, ViscosityInput
from myomorph.viscosity.study.plan import SpecimenFiles, StudyOptions, ViscosityPlan
from myomorph.viscosity.study.results import remake_report, write_store, write_swings, write_tables, write_whole
from myomorph.viscosity.study.specimen import input_sources, study_specimen

PROVENANCE, IDENTIFIED = "provenance.json", "identified.osim"


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

    A specimen that fails is named with its reason, and the others are done all the same. The tables are written
    after every specimen, the report at the end, each file whole or not at all.

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
            write_tables([one.report for one in outcomes], out)
    sources = [] if plan.path is None else [file_source("study", plan.path)]
    sources += [source for one in outcomes for source in one.sources]
    plain = {f"{table}.{name}": value for table, own in options.plain.items() for name, value in own.items()}
    made = provenance_of("viscosity", sources, plain)
    write_whole(made.to_json() + "\n", out / PROVENANCE)
    write_store(viscosity_input(plan, options, tuple(one.report for one in outcomes), made), out)
    remake_report(out)
    return outcomes


def _outcome(files: SpecimenFiles, options: StudyOptions, out: Path, advance: Advance) -> SpecimenOutcome:
    report = SpecimenReport(files.name, truth=files.truth, paper=files.paper)
    done = 0.0

    def within(share: float) -> None:
        nonlocal done
        share = min(share, 1.0 - done)
        done += share
        advance(share)

    try:
        sources = input_sources(files)
        studied = study_specimen(files, options, within)
        with whole_folder(out / file_name(files.name)) as folder:
            write_swings(studied.found, folder)
            lost = () if studied.model is None else write_osim(studied.model, folder / IDENTIFIED)
        report = replace(studied.report, notes=(*studied.report.notes, *(f"{IDENTIFIED}: {line}" for line in lost)))
        return SpecimenOutcome(report, studied.found, sources)
    except Exception as error:
        ended = failed(Outcome(files.name, "", out), error)
        return SpecimenOutcome(replace(report, failure=ended.error), fault=ended.fault)
    finally:
        within(1.0)


def viscosity_input(
    plan: ViscosityPlan, options: StudyOptions, reports: tuple[SpecimenReport, ...], made: Provenance
) -> ViscosityInput:
    """What the report shows of a study."""
    sources = dict.fromkeys(SourceFile(source.role, Path(source.name).name, source.sha256) for source in made.sources)
    steps = tuple(
        Step(table, FrozenMap({name: _told(value) for name, value in own.items()}))
        for table, own in options.plain.items()
    )
    return ViscosityInput(plan.name, reports, head_notes(plan), tuple(sources), steps, made.date, __version__)


def head_notes(plan: ViscosityPlan) -> tuple[Note, ...]:
    """What is real, simulated and assumed, as the study file says it and as the method has it."""
    real = plan.real
    if not real and not plan.simulated:
        trials = sum(len(specimen.without) + len(specimen.intact) for specimen in plan.specimens)
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
