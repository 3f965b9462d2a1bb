"""A study of swinging limbs as a graph of jobs: one for each specimen and limb, then the tables of the cohort."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

from myomorph.model.frozen_map import FrozenMap
from myomorph.model.model import Model
from myomorph.store.locks import RunMark
from myomorph.store.outcome import GATHERED, Outcome
from myomorph.store.results import file_name
from myomorph.study.inputs.reading import open_model
from myomorph.study.run.run import run_graph
from myomorph.study.run.work import Graph, Recording, Work
from myomorph.study.step.folder_steps import FolderSteps
from myomorph.study.step.job_steps import JobSteps
from myomorph.study.step.step_table import STEPS, Scope
from myomorph.study.workers.jobs import Workers
from myomorph.viscosity.study import limb_step, specimen_step
from myomorph.viscosity.study.cohort_step import CohortInputs
from myomorph.viscosity.study.limb_files import LimbFiles
from myomorph.viscosity.study.limb_step import LimbInputs
from myomorph.viscosity.study.plan import SpecimenFiles, StudyOptions, ViscosityPlan
from myomorph.viscosity.study.specimen_step import SpecimenInputs


def open_steps(
    model: Model | None, read: str, fresh: bool, *, inputs: SpecimenInputs | LimbInputs | CohortInputs, outcome: Outcome
) -> JobSteps:
    """The step of a specimen or a limb, or of all."""
    kinds: dict[type, Scope] = {SpecimenInputs: "specimen", LimbInputs: "limb", CohortInputs: "cohort"}
    return FolderSteps(kinds[type(inputs)], inputs, outcome, fresh)


def graph_of(plan: ViscosityPlan, out: Path, fresh: bool = False, mark: RunMark | None = None) -> Graph:
    """What a study of swinging limbs has to do, `fresh` whatever an earlier run left."""
    options = StudyOptions.of(plan.settings)
    settings = FrozenMap({specimen_step.STEP.name: plan.settings})

    def work(files: SpecimenFiles) -> Work:
        outcome = Outcome(files.name, "", out / file_name(files.name))
        recordings = (*files.without, *files.intact)
        names = dict.fromkeys(path.name for each in recordings for path in (each.markers, each.loads))
        return Work(
            "specimen", outcome, tuple(STEPS["specimen"]),
            partial(open_steps, inputs=SpecimenInputs(files, options), outcome=outcome), fresh=fresh, mark=mark,
            settings=settings, files=(files.model.name, *names),
            recordings=tuple(Recording(each.markers, each.time) for each in recordings),
        )  # fmt: skip

    def limb_work(files: LimbFiles) -> Work:
        outcome = Outcome(files.name, "", out / file_name(files.name))
        opened = partial(open_steps, inputs=LimbInputs(files, options.limb), outcome=outcome)
        names = (files.model.name, *(path.name for drop in files.drops for path in (drop.recording, drop.emg) if path))
        recordings = tuple(Recording(drop.recording, drop.time) for drop in files.drops)
        settings = FrozenMap({limb_step.STEP.name: plan.settings})
        return Work("limb", outcome, tuple(STEPS["limb"]), opened, fresh=fresh, mark=mark, settings=settings,
                    files=names, recordings=recordings)  # fmt: skip

    def last(outcomes: tuple[Outcome, ...]) -> tuple[Work, ...]:
        outcome = Outcome(*GATHERED, out)
        opened = partial(open_steps, inputs=CohortInputs(plan, outcomes), outcome=outcome)
        return (Work("cohort", outcome, tuple(STEPS["cohort"]), opened, fresh=fresh),)

    works = (*map(work, plan.specimens), *map(limb_work, plan.limbs))
    return Graph(plan.name, works, last, open_model)


def run_viscosity(
    plan: ViscosityPlan,
    out: Path,
    report: Callable[[Outcome], None] = lambda outcome: None,
    *,
    fresh: bool = False,
    workers: Workers | None = None,
) -> list[Outcome]:
    """Identify every specimen of a plan and write tables and `report.html` into a folder.

    A specimen that fails is named with its reason, and the others are done all the same. Specimens whose inputs,
    options and version have not changed since an earlier run are reused.

    Parameters
    ----------
    plan : of `read_viscosity_plan`
    out : folder of the results
    report : called with each specimen's outcome when it ends
    fresh : compute every specimen, whatever an earlier run left
    workers : that do the jobs, closed at the end; None does them in this process

    Returns
    -------
    outcomes of the specimens, in the order of the plan, and of the tables where they failed; what is shown of a
    specimen is in its folder (`read_specimen`)

    Raises
    ------
    BadData : an option is out of its range, or another run writes into the folder

    Examples
    --------
    >>> from dataclasses import replace
    >>> from pathlib import Path
    >>> import myomorph as mm
    >>> plan = mm.viscosity.read_viscosity_plan(
    ...     mm.write_shoulder_study(Path("shoulder"), (3,), seconds=6.0, trials=1, raw=())
    ... )
    >>> outcomes = mm.viscosity.run_viscosity(replace(plan, settings={"identification": {"draws": 20}}), Path("swung"))
    >>> [outcome.error for outcome in outcomes], Path("swung/cohort.csv").exists()
    ([''], True)
    """
    StudyOptions.of(plan.settings)
    return run_graph(lambda mark: graph_of(plan, out, fresh, mark), out, workers, report)
