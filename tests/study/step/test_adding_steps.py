"""A step of each scope is one file and one line in the table of steps; all else follows."""

from __future__ import annotations

import sys
from types import ModuleType

import pytest

from myomorph.core.model.provenance import Provenance
from myomorph.lab.store.results import provenance_of, value_source
from myomorph.lab.study.plan.plan import read_plan
from myomorph.lab.study.run.dry_run import dry_run
from myomorph.lab.study.run.job_plan import graph_of
from myomorph.lab.study.run.run import run_study
from myomorph.lab.study.step.folder_steps import FolderOutput
from myomorph.lab.study.step.step import Step, step_of
from myomorph.lab.study.step.step_table import STEPS
from myomorph.lab.study.subject.subject_files import SubjectInputs, recordings_provenance
from myomorph.lab.study.summary.study_inputs import StudyInputs
from myomorph.swings.viscosity.study import run as viscosity
from myomorph.swings.viscosity.study import specimen_step
from myomorph.swings.viscosity.study.cohort_step import CohortInputs
from myomorph.swings.viscosity.study.plan import ViscosityPlan
from myomorph.swings.viscosity.study.recordings import SwingFiles
from myomorph.swings.viscosity.study.specimen_files import SpecimenFiles
from myomorph.swings.viscosity.study.specimen_step import SpecimenInputs, specimen_provenance

STUDY = """
[study]
name = "reaching"
[[subject]]
name = "s01"
model = "arm.osim"
mass = {mass}
trials = ["reach.trc"]
steps = [{steps}]
"""


@pytest.fixture
def add(monkeypatch):
    """Return a function that adds a file with a step, and its line in the table."""

    def added(step: Step) -> None:
        module = ModuleType(f"added_{step.scope}_{step.name}")
        module.STEP = step
        monkeypatch.setitem(sys.modules, module.__name__, module)
        monkeypatch.setitem(STEPS[step.scope], step.name, module.__name__)

    return added


def plan(arm, steps='"ik"', mass=4.0):
    path = arm.folder / "study.toml"
    path.write_text(STUDY.format(steps=steps, mass=mass), encoding="utf-8")
    return read_plan(path)


def count_frames(subject: SubjectInputs, output: FolderOutput) -> None:
    recorded = {trial.name: trial.recording.markers for trial in subject.trials()}
    frames = {name: len(markers) for name, markers in recorded.items() if markers is not None}
    with output.whole(("a few frames",)) as folder:
        text = "".join(f"{name},{count}\n" for name, count in frames.items())
        (folder / "frames.csv").write_text(text, encoding="utf-8")


def test_a_step_of_a_subject(arm, add):
    add(
        Step(
            name="count",
            title="frames of a subject",
            scope="subject",
            tables="frames",
            leaves={"frames": "frames/frames.csv"},
            run=count_frames,
            made_from=lambda subject: recordings_provenance("count", subject),
        )
    )
    steps = '"ik", "count"'
    subject, trial = run_study(plan(arm, steps), arm.out)
    assert (subject.done, subject.error, trial.done) == (("count",), "", ("ik",))
    assert (arm.out / "s01" / "frames" / "frames.csv").read_text(encoding="utf-8") == "reach,61\n"
    assert subject.findings == ("count: a few frames",)
    again = run_study(plan(arm, steps), arm.out)[0]
    assert (again.reused, again.findings) == (("count",), subject.findings)
    changed = plan(arm, steps, mass=5.0)
    rows = {row.work.key: row for row in dry_run(graph_of(changed, arm.out), arm.out).rows}
    assert rows["s01", ""].reasons == {"count": ("mass 4.0 -> 5.0",)}
    assert run_study(changed, arm.out)[0].changed == ("mass 4.0 -> 5.0",)


def list_trials(study: StudyInputs, output: FolderOutput) -> None:
    with output.whole() as folder:
        names = "".join(f"{outcome.trial}\n" for outcome in study.outcomes if outcome.trial)
        (folder / "trials.txt").write_text(names, encoding="utf-8")


def trials_provenance(study: StudyInputs) -> Provenance:
    return provenance_of(
        "list",
        [value_source("trial", outcome.trial, outcome.done) for outcome in study.outcomes],
        {},
    )


def test_a_step_of_a_study(arm, add):
    add(
        Step(
            name="list",
            title="names of trials",
            scope="study",
            leaves={"list": "trials.txt"},
            run=list_trials,
            made_from=trials_provenance,
        )
    )
    outcomes = {outcome.key: outcome for outcome in run_study(plan(arm), arm.out)}
    assert outcomes["list", ""].done == ("list",)
    assert (arm.out / "trials.txt").read_text(encoding="utf-8") == "reach\n"
    again = {outcome.key: outcome for outcome in run_study(plan(arm), arm.out)}
    assert again["list", ""].reused == ("list",)
    (arm.out / "trials.txt").write_text("another\n", encoding="utf-8")
    run_study(plan(arm), arm.out)
    assert (arm.out / "trials.txt").read_text(encoding="utf-8") == "reach\n"
    assert not list(arm.out.rglob(".*"))


def weigh(specimen: SpecimenInputs, output: FolderOutput) -> None:
    with output.whole() as folder:
        (folder / "weight.txt").write_text(
            f"{specimen.files.measured_muscle_mass}\n", encoding="utf-8"
        )


def sum_up(cohort: CohortInputs, output: FolderOutput) -> None:
    weights = [
        float((outcome.folder / "weight.txt").read_text(encoding="utf-8"))
        for outcome in cohort.outcomes
    ]
    with output.whole() as folder:
        (folder / "sum.txt").write_text(f"{sum(weights):g}\n", encoding="utf-8")


def test_steps_of_specimens_and_of_a_cohort(arm, add, monkeypatch):
    monkeypatch.setitem(STEPS, "specimen", {})
    monkeypatch.setitem(STEPS, "cohort", {})
    leaves = {"weight": "weight.txt"}
    add(
        Step(
            name="weigh",
            title="weight",
            scope="specimen",
            leaves=leaves,
            run=weigh,
            made_from=specimen_provenance,
        )
    )
    add(
        Step(
            name="sum",
            title="sum of weights",
            scope="cohort",
            leaves={"sum": "sum.txt"},
            run=sum_up,
            made_from=lambda cohort: provenance_of("sum", [], {"specimens": len(cohort.outcomes)}),
        )
    )
    swings = (SwingFiles("reach", arm.markers, arm.forces),)
    files = [
        SpecimenFiles(name, arm.model, swings, measured_muscle_mass=mass)
        for name, mass in (("a", 1.0), ("b", 2.5))
    ]
    study = ViscosityPlan("weights", None, tuple(files))
    outcomes = viscosity.run_viscosity(study, arm.out)
    assert [(outcome.done, outcome.error) for outcome in outcomes] == [(("weigh",), "")] * 2
    assert (arm.out / "sum.txt").read_text(encoding="utf-8") == "3.5\n"
    assert [outcome.reused for outcome in viscosity.run_viscosity(study, arm.out)] == [
        ("weigh",)
    ] * 2
    assert specimen_step.STEP.scope == "specimen"


@pytest.mark.parametrize("scope", list(STEPS))
def test_every_step_is_what_the_table_says(scope):
    """A pair's steps are those of trials; each other step stands under its own scope and name."""
    for name in STEPS[scope]:
        step = step_of(name, scope)
        assert step.name == name
        assert step.scope == ("trial" if scope == "pair" else scope)
