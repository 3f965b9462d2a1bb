"""`viscosity`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from myomorph.core.model.errors import BadData
from myomorph.lab.cli.options import (
    documented,
    inputs_class,
    inputs_of_flags,
    options_class,
    settings_dict,
)
from myomorph.lab.cli.output import said, warn
from myomorph.lab.cli.running import AS_USUAL, RunOptions, print_outcome, status_of
from myomorph.swings.viscosity.identification.identify import ViscosityOptions
from myomorph.swings.viscosity.study.results import NOTES
from myomorph.swings.viscosity.tracking.tracked import TrackingOptions
from myomorph.swings.viscosity.trust.cutoff import FilterOptions

if TYPE_CHECKING:
    from myomorph.lab.store.outcome import Outcome
    from myomorph.swings.viscosity.study.plan import ViscosityPlan

# Notes of a specimen that are printed; findings come first, clocks that were set right stay out.
MAX_NOTES = 4

ViscositySettings = options_class(FilterOptions, TrackingOptions, ViscosityOptions)


SwingInputs = inputs_class("time")
StudyFile = Annotated[
    Path, Parameter(help="Study file (.toml) of one or more specimens, or of relaxed limbs.")
]


@documented
@dataclass(frozen=True, kw_only=True)
class SwingFlags:
    """Files of a study of swings, of one specimen, or of a model that gets its viscosities.

    Attributes
    ----------
    out : folder for the results, created if it does not exist; with --into, the model to write
    template : folder into which a study file with every key is written, and nothing else is done
    into : model (.osim or .xml) that gets the viscosities of the specimen in --results, and is
        written as --out
    results : folder of a specimen's results, for --into
    model : model of a single specimen (.osim or .xml), instead of a study
    intact : recordings of swings with muscles intact: markers, or C3D with plates
    removed : recordings of swings with muscles removed
    intact_loads : forces on the base with muscles intact, in the same order; by default the files
        next to each recording
    removed_loads : forces on the base with muscles removed, in the same order; by default the files
        next to each recording
    base : body that is fixed to the plate; by default the scapula
    first : first body of the limb; by default the humerus
    muscle_mass : measured mass of the removed muscles [kg]
    """

    out: Path | None = None
    template: Path | None = None
    into: Path | None = None
    results: Path | None = None
    model: Path | None = None
    intact: tuple[Path, ...] = ()
    removed: tuple[Path, ...] = ()
    intact_loads: tuple[Path, ...] = ()
    removed_loads: tuple[Path, ...] = ()
    base: str | None = None
    first: Annotated[str | None, Parameter(name="--first-body")] = None
    muscle_mass: float | None = None

    def plan(self, options: Any, time: tuple[float, float] | None) -> ViscosityPlan:
        """Return the plan of one specimen; raises `BadData`.

        `time`: part of the recordings [s].
        """
        from myomorph.swings.viscosity.study.plan import GivenSpecimen, fixed_plan
        from myomorph.swings.viscosity.study.recordings import GivenFiles

        specimen = GivenSpecimen(
            model=self.model,
            recordings={
                "without": GivenFiles(self.removed, self.removed_loads),
                "with": GivenFiles(self.intact, self.intact_loads),
            },
            base=self.base,
            first=self.first,
            muscle_mass=self.muscle_mass,
            time=time,
        )
        return fixed_plan(specimen, settings_dict(options))

    def check_study(self, options: Any) -> None:
        """Refuse what a study file states itself; raises `BadData`."""
        if self.model is not None or self.intact or self.removed:
            raise BadData("give a study file, or --model with --intact and --removed, but not both")
        for option in () if options is None else fields(options):
            if getattr(options, option.name) != option.default:
                name = option.name.replace("_", "-")
                raise BadData(
                    f"--{name} is for --model: write it into the table [options] of the study file"
                )


SwingOptions = Annotated[SwingFlags, Parameter(name="*")]
NO_FILES = SwingFlags()


@documented
def viscosity_command(
    study: StudyFile | None = None,
    /,
    *,
    files: SwingOptions = NO_FILES,
    inputs: SwingInputs | None = None,  # type: ignore[valid-type]
    options: ViscositySettings | None = None,  # type: ignore[valid-type]
    running: RunOptions = AS_USUAL,
) -> int:
    """Identify viscosity of a joint and its muscles from swings of a limb on a force plate.

    The limb swings with and without muscles, or is a relaxed living one that is dropped.
    """
    from myomorph.lab.study.inputs.time_span import TimeSpan
    from myomorph.swings.viscosity.study.plan import read_viscosity_plan
    from myomorph.swings.viscosity.study.run import graph_of, run_viscosity
    from myomorph.swings.viscosity.study.template import write_template

    if files.template is not None:
        said(f"template: {write_template(files.template)}")
        return 0
    if files.out is None:
        raise BadData("give --out, the folder to write, or --template for a study file to fill in")
    if files.into is not None:
        return _write_into(files.into, files.out, files)
    running.begin()
    study = None if study is None else running.place(study)
    out = running.place(files.out)
    time = inputs_of_flags(inputs).or_default(TimeSpan).time
    if study is None:
        plan = files.plan(options, time)
    else:
        plan = read_viscosity_plan(study)
        files.check_study(options)
    for remark in plan.remarks:
        said(remark)
    jobs = len(plan.specimens) + len(plan.limbs)
    if running.dry_run:
        return running.print_dry_run(partial(graph_of, plan), out, jobs)
    # What is wrong with options is reported before workers begin.
    graph_of(plan, out)
    hands = running.hands(jobs, out)
    return ended(run_viscosity(plan, out, print_specimen, fresh=running.fresh, workers=hands), out)


def _write_into(model: Path, out: Path, files: SwingFlags) -> int:
    """Write a model with the viscosities of a specimen in results; the exit status."""
    from myomorph.swings.viscosity.study.into_model import write_identified
    from myomorph.swings.viscosity.study.specimen_step import read_specimen

    if files.results is None:
        raise BadData("--into needs --results, the folder of a specimen in the results of swings")
    specimen = read_specimen(files.results)
    for line in write_identified(model, specimen, out, files.base, files.first):
        said(line)
    said(f"wrote {out}")
    return 0


def ended(outcomes: Sequence[Outcome], out: Path) -> int:
    """Say how many specimens were done and where the report is; the exit status."""
    from myomorph.swings.viscosity.study.results import REPORT

    specimens = [outcome for outcome in outcomes if outcome.subject]
    words = (
        "specimens and limbs"
        if any("relaxed" in outcome.done for outcome in specimens)
        else "specimens"
    )
    done = sum(1 for outcome in specimens if not outcome.error)
    said(f"{done} of {len(specimens)} {words} done")
    said(f"report: {(out / REPORT).resolve()}")
    return status_of(outcomes)


def run_demo(name: str, out: Path) -> int:
    """Swing the virtual shoulders, identify them, and say where the report is; the exit status."""
    from myomorph.swings.demo import run_shoulder_demo

    return ended(run_shoulder_demo(out, print_specimen), out)


def print_specimen(outcome: Outcome) -> None:
    """Print what became of a specimen and its row, or why there is none."""
    if outcome.error:
        print_outcome(outcome)
        return
    from myomorph.swings.viscosity.relaxed.identify import UNITS
    from myomorph.swings.viscosity.study.limb_step import LIMB, read_limb
    from myomorph.swings.viscosity.study.specimen_step import read_specimen

    print_outcome(replace(outcome, findings=()))
    relaxed = (outcome.folder / LIMB).is_file()
    report = read_limb(outcome.folder) if relaxed else read_specimen(outcome.folder)
    limb = [(name, name.replace("_", " "), unit) for name, unit in UNITS.items()]
    parts = []
    for key, label, unit in (
        limb
        if relaxed
        else (
            ("joint_viscosity", "joint", "Nms/rad"),
            ("total_viscosity", "total", "Nms/rad"),
            ("muscle_viscosity", "muscles", "Ns/m"),
        )
    ):
        if key in report.row:
            value = report.row[key]
            parts.append(f"{label} {value.value:.3g} ({value.low:.3g} to {value.high:.3g}) {unit}")
    if report.law:
        parts.append(f"law: {report.law}")
    said(f"  {'; '.join(parts)}")
    notes = [note for note in report.notes if not note.endswith(": corrected")]
    warn(notes[:MAX_NOTES])
    if len(notes) > MAX_NOTES:
        warn([f"and {len(notes) - MAX_NOTES} notes more, in the report and in {NOTES}"])
