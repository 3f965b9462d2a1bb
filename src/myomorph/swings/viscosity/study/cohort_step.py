"""The step of a study of swinging limbs that is done once for all: tables and report."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from myomorph import __version__
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.provenance import Provenance, Source
from myomorph.lab.report.page.parts import Note, SourceFile, option_text
from myomorph.lab.report.page.parts import Step as PageStep
from myomorph.lab.store.outcome import Outcome
from myomorph.lab.store.results import file_source, provenance_of, value_source
from myomorph.lab.study.step.folder_steps import FolderOutput, ScopeInputs, stored_provenance
from myomorph.lab.study.step.step import Step
from myomorph.swings.viscosity.report.specimen_report import (
    LimbReport,
    SpecimenReport,
    ViscosityInput,
)
from myomorph.swings.viscosity.study import limb_step, specimen_step
from myomorph.swings.viscosity.study.limb_files import LimbFiles
from myomorph.swings.viscosity.study.options import StudyOptions
from myomorph.swings.viscosity.study.plan import ViscosityPlan
from myomorph.swings.viscosity.study.results import (
    DIGITS,
    REPORT,
    STORE,
    remake_report,
    write_tables,
    write_value,
)
from myomorph.swings.viscosity.study.specimen_files import SpecimenFiles
from myomorph.swings.viscosity.study.specimen_step import SPECIMEN, read_specimen


@dataclass(frozen=True)
class CohortInputs(ScopeInputs):
    """The specimens and limbs of a study, in the order of the plan, when all have ended."""

    plan: ViscosityPlan
    outcomes: tuple[Outcome, ...]

    def reports(self) -> tuple[SpecimenReport, ...]:
        """Read what is shown of each specimen; of one that failed, why."""
        reports = []
        ended = self.outcomes[: len(self.plan.specimens)]
        for files, outcome in zip(self.plan.specimens, ended, strict=True):
            failure = outcome.error.removeprefix(f"{specimen_step.STEP.name}: ")
            report = (
                SpecimenReport(files.name, failure=failure)
                if failure
                else read_specimen(outcome.folder)
            )
            reports.append(replace(report, truth=files.truth, paper=files.paper))
        return tuple(reports)

    def limbs(self) -> tuple[LimbReport, ...]:
        """Read what is shown of each limb; of one that failed, why."""
        reports = []
        for files, outcome in zip(
            self.plan.limbs, self.outcomes[len(self.plan.specimens) :], strict=True
        ):
            failure = outcome.error.removeprefix(f"{limb_step.STEP.name}: ")
            report = (
                LimbReport(files.name, failure=failure)
                if failure
                else limb_step.read_limb(outcome.folder)
            )
            reports.append(replace(report, truth=files.truth))
        return tuple(reports)

    def sources(self) -> Iterator[Source]:
        """Yield the files that the specimens were made from."""
        if self.plan.path is not None:
            yield file_source("study", self.plan.path)
        for outcome in self.outcomes:
            # or of a limb
            made = None if outcome.error else stored_provenance(outcome.folder, specimen_step.STEP)
            yield from () if made is None else made.sources


def cohort_provenance(cohort: CohortInputs) -> Provenance:
    """List what the tables of a cohort are derived from.

    These are its specimens' results, and what the study file says of them.
    """
    plan = cohort.plan
    sources = [] if plan.path is None else [file_source("study", plan.path)]
    every: tuple[SpecimenFiles | LimbFiles, ...] = (*plan.specimens, *plan.limbs)
    for files, outcome in zip(every, cohort.outcomes, strict=True):
        result = outcome.folder / (limb_step.LIMB if isinstance(files, LimbFiles) else SPECIMEN)
        sha = "" if outcome.error else file_source("specimen", result).sha256
        known = (sorted(files.truth.items()), sorted(getattr(files, "paper", {}).items()))
        sources.append(value_source("specimen", files.name, outcome.error, sha, known))
    options = {
        "name": plan.name,
        "real": plan.real,
        "simulated": plan.simulated,
        "assumed": plan.assumed,
    }
    return provenance_of("cohort", sources, options)


def _run(cohort: CohortInputs, output: FolderOutput) -> None:
    shown = viscosity_input(cohort, output.made.date)
    with output.whole() as folder:
        write_tables(shown.specimens, folder, shown.limbs)
        write_value(shown, folder / STORE, DIGITS)
        remake_report(folder)


def viscosity_input(cohort: CohortInputs, date: str) -> ViscosityInput:
    """Collect what the report shows of a study."""
    plan = cohort.plan
    options = StudyOptions.of(cohort.plan.settings)
    sources = {
        SourceFile(source.role, Path(source.name).name, source.sha256): None
        for source in cohort.sources()
    }
    steps = tuple(
        PageStep(
            table,
            FrozenMap({name: option_text(value, "chosen") for name, value in settings.items()}),
        )
        for table, settings in options.plain.items()
        if (plan.limbs if table == "limb" else plan.specimens)
    )
    head = head_notes(plan)
    reports = cohort.reports()
    limbs = cohort.limbs()
    return ViscosityInput(
        title=plan.name,
        specimens=reports,
        notes=head,
        sources=tuple(sources),
        steps=steps,
        date=date,
        version=__version__,
        limbs=limbs,
    )


def head_notes(plan: ViscosityPlan) -> tuple[Note, ...]:
    """List what is real, simulated and assumed, by the study file and by the method."""
    real = plan.real
    if not real and not plan.simulated:
        trials = sum(len(specimen.without) + len(specimen.intact) for specimen in plan.specimens)
        drops = sum(len(limb.drops) for limb in plan.limbs)
        kinds = ((trials, "Markers and forces"), (drops, "Motion"))
        real = tuple(
            f"{what} of {count} recordings, as the study file names them."
            for count, what in kinds
            if count
        )
    relaxed = (
        (
            "A relaxed limb's masses, centers and inertias are the model's, but for the errors that"
            " its intervals hold."
        ),
        (
            "Its swings are passive where EMG does not say otherwise; the passive torque has"
            " constant coefficients."
        ),
    )
    specimens = (
        (
            "The limb beyond the joint is one rigid link; the joint turns about one fixed center;"
            " the base does not move."
        ),
        "Swings are passive: nobody touches the limb, and no muscle is active.",
        (
            "Moment arms are those of the model. One value for all axes and one for all muscles, as"
            " the paper has it; values by axis and by muscle stand beside."
        ),
    )
    assumed = (
        *(specimens if plan.specimens else ()),
        *(relaxed if plan.limbs else ()),
        *plan.assumed,
    )
    parts = (("real", real), ("simulated", plan.simulated), ("assumed", assumed))
    return tuple(Note(kind, text) for kind, texts in parts for text in texts)  # type: ignore[arg-type]


STEP = Step(
    name="cohort",
    title="tables and report of a cohort",
    scope="cohort",
    leaves=FrozenMap({"page": REPORT, "store": STORE}),
    run=_run,
    made_from=cohort_provenance,
)
