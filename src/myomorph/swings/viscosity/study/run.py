"""A study of swinging limbs as a graph of jobs.

There is one for each specimen and limb, then the tables of the cohort.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any

from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.model import Model
from myomorph.lab.store.locks import RunMark
from myomorph.lab.store.outcome import GATHERED, Outcome
from myomorph.lab.store.results import file_name
from myomorph.lab.study.inputs.reading import open_model
from myomorph.lab.study.run.run import run_graph
from myomorph.lab.study.run.work import Graph, Recording, Work
from myomorph.lab.study.step.folder_steps import FolderSteps
from myomorph.lab.study.step.job_steps import JobSteps
from myomorph.lab.study.step.step import Step
from myomorph.lab.study.step.step_table import STEPS, Scope
from myomorph.lab.study.workers.jobs import Workers
from myomorph.swings.viscosity.study import limb_step, specimen_step
from myomorph.swings.viscosity.study.cohort_step import CohortInputs
from myomorph.swings.viscosity.study.limb_step import LimbInputs
from myomorph.swings.viscosity.study.options import StudyOptions
from myomorph.swings.viscosity.study.plan import ViscosityPlan
from myomorph.swings.viscosity.study.specimen_step import SpecimenInputs

Recorded = tuple[Path, Path | None, tuple[float, float] | None]
"""A recording, what was recorded beside it, and the part that is used [s]."""


def open_steps(
    model: Model | None,
    read: str,
    fresh: bool,
    *,
    inputs: SpecimenInputs | LimbInputs | CohortInputs,
    outcome: Outcome,
) -> JobSteps:
    """Choose the step of a specimen or a limb, or of all."""
    kinds: dict[type, Scope] = {
        SpecimenInputs: "specimen",
        LimbInputs: "limb",
        CohortInputs: "cohort",
    }
    return FolderSteps(scope=kinds[type(inputs)], inputs=inputs, outcome=outcome, fresh=fresh)


def graph_of(
    plan: ViscosityPlan, out: Path, fresh: bool = False, mark: RunMark | None = None
) -> Graph:
    """List what a study of swinging limbs has to do.

    Parameters
    ----------
    plan : of the study
    out : folder of the results
    fresh : whatever an earlier run left
    mark : of the run
    """
    options = StudyOptions.of(plan.settings)

    def work(
        step: Step[Any], inputs: SpecimenInputs | LimbInputs, recordings: Iterable[Recorded]
    ) -> Work:
        files = inputs.files
        recorded = list(recordings)
        outcome = Outcome(files.name, "", out / file_name(files.name))
        opened = partial(open_steps, inputs=inputs, outcome=outcome)
        paths = (path for recording, beside, _ in recorded for path in (recording, beside) if path)
        names = dict.fromkeys(path.name for path in (files.model, *paths))
        return Work(
            scope=step.scope,
            outcome=outcome,
            steps=tuple(STEPS[step.scope]),
            open=opened,
            fresh=fresh,
            mark=mark,
            settings=FrozenMap({step.name: plan.settings}),
            files=tuple(names),
            recordings=tuple(Recording(path, time) for path, _, time in recorded),
        )

    def last(outcomes: tuple[Outcome, ...]) -> tuple[Work, ...]:
        subject, trial = GATHERED
        outcome = Outcome(subject=subject, trial=trial, folder=out)
        opened = partial(open_steps, inputs=CohortInputs(plan, outcomes), outcome=outcome)
        return (
            Work(
                scope="cohort",
                outcome=outcome,
                steps=tuple(STEPS["cohort"]),
                open=opened,
                fresh=fresh,
            ),
        )

    works = []
    for specimen in plan.specimens:
        swings = (
            (each.markers, each.loads, each.time) for each in (*specimen.without, *specimen.intact)
        )
        works.append(work(specimen_step.STEP, SpecimenInputs(specimen, options), swings))
    for limb in plan.limbs:
        drops = ((each.recording, each.emg, each.time) for each in limb.drops)
        works.append(work(limb_step.STEP, LimbInputs(limb, options.limb), drops))
    return Graph(name=plan.name, works=tuple(works), last=last, open_model=open_model)


def run_viscosity(
    plan: ViscosityPlan,
    out: Path,
    report: Callable[[Outcome], None] = lambda outcome: None,
    *,
    fresh: bool = False,
    workers: Workers | None = None,
) -> list[Outcome]:
    """Identify every specimen of a plan and write tables and `report.html` into a folder.

    A specimen that fails is named with its reason, and the others are done all the same. Specimens
    whose inputs, options and version have not changed since an earlier run are reused.

    Parameters
    ----------
    plan : of `read_viscosity_plan`
    out : folder of the results
    report : called with each specimen's outcome when it ends
    fresh : compute every specimen, whatever an earlier run left
    workers : that do the jobs, closed at the end; None does them in this process

    Returns
    -------
    outcomes of the specimens, in the order of the plan, and of the tables where they failed; what
    is shown of a specimen is in its folder (`read_specimen`)

    Raises
    ------
    BadData : an option is out of its range, or another run writes into the folder

    Examples
    --------
    >>> from dataclasses import replace
    >>> from pathlib import Path
    >>> import myomorph as mm
    >>> short = mm.viscosity.ShoulderStudyOptions(seconds=6.0, trials=1, raw=())
    >>> study = mm.write_shoulder_study(Path("shoulder"), (3,), short)
    >>> plan = mm.viscosity.read_viscosity_plan(study)
    >>> plan = replace(plan, settings={"identification": {"draws": 20}})
    >>> outcomes = mm.viscosity.run_viscosity(plan, Path("swung"))
    >>> [outcome.error for outcome in outcomes], Path("swung/cohort.csv").exists()
    ([''], True)
    """
    StudyOptions.of(plan.settings)
    return run_graph(lambda mark: graph_of(plan, out, fresh, mark), out, workers, report)
