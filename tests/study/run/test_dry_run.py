"""A dry run says what a run then does, and computes and writes nothing."""

from __future__ import annotations

import shutil

import pytest

from identified_arm import put_on_plate
from myomorph.lab.study.plan.plan import read_plan
from myomorph.lab.study.run.dry_run import dry_run, dry_run_lines
from myomorph.lab.study.run.job_plan import graph_of
from myomorph.lab.study.run.run import run_study
from myomorph.lab.study.run.step_times import in_words
from myomorph.lab.study.step.job_steps import AFTER_OTHERS

STUDY = """
[study]
name = "reaching"
conditions = {slow = ["reach"], fast = ["again"]}
[[subject]]
name = "s01"
model = "arm.osim"
mass = 4.0
trials = ["reach.trc"]
steps = ["ik", "identify", "id"]
[[subject]]
name = "s02"
model_of = "s01"
mass = 4.0
trials = ["again.trc", "lost.trc"]
steps = ["ik", "id"]
[[exclude]]
subject = "s02"
trial = "lost"
reason = "the marker of the hand fell off"
[options.identify]
spacing = 0.02
compare = false
"""


@pytest.fixture
def study(arm):
    put_on_plate(arm)
    for name in ("again", "lost"):
        shutil.copy(arm.markers, arm.folder / f"{name}.trc")
    path = arm.folder / "study.toml"
    path.write_text(STUDY, encoding="utf-8")
    return path


def looked_at(study, out, **told):
    return dry_run(graph_of(read_plan(study), out), out, **told)


def lines(study, out):
    plan = read_plan(study)
    return "\n".join(dry_run_lines(looked_at(study, out), plan.excluded, plan.conditions.names))


def looked(study, out, **told):
    return {row.work.key: row for row in looked_at(study, out, **told).rows}


def test_before_the_first_run(arm, study):
    rows = looked(study, arm.out)
    assert list(rows) == [("s01", ""), ("s01", "reach"), ("s02", "again")]
    assert rows["s01", ""].computed == ("identify",)
    assert rows["s02", "again"].computed == ("ik", "id")
    assert {row.frames for row in rows.values()} == {61}
    assert rows["s01", "reach"].unknown == ("ik", "id")
    text = lines(study, arm.out)
    for words in (
        "2 subjects, 2 trials",
        "s02/lost: the marker of the hand fell off",
        "time unknown: identify, ik, id",
        "reach.trc",
    ):
        assert words in text
    assert not arm.out.exists()


def test_it_says_what_a_run_then_does(arm, study, monkeypatch, tmp_path):
    monkeypatch.setenv("MYOMORPH_STEP_TIMES", str(tmp_path / "times.csv"))
    # A job during which kernels are compiled tells nothing of times, and the tests beside this one
    # compile some.
    monkeypatch.setattr("myomorph.lab.study.run.step_times._kernels", lambda: 0)
    run_study(read_plan(study), arm.out)
    rows = looked(study, arm.out)
    assert all(not row.computed for row in rows.values())
    assert "nothing to compute" in lines(study, arm.out)
    assert looked(study, arm.out, fresh=True)["s01", "reach"].computed == ("ik", "id")

    study.write_text(STUDY + "[options.id]\ncutoff = 30\n", encoding="utf-8")
    rows = looked(study, arm.out)
    found = {one.key: one for one in run_study(read_plan(study), arm.out)}
    # The filter is told to identification too, so the model is made anew, and with it all that uses
    # it.
    assert rows["s01", ""].computed == ("identify",)
    assert rows["s02", "again"].reasons["ik"] == (AFTER_OTHERS,)
    assert all(
        (found[key].reused, found[key].error) == (row.reused, "") for key, row in rows.items()
    )
    # With another filter inverse dynamics never ran here; of the other steps the time is known.
    assert all(
        row.unknown == tuple(step for step in row.computed if step == "id") for row in rows.values()
    )
    assert all(row.seconds > 0.0 for row in rows.values())

    study.write_text(STUDY + "[options.id]\ncutoff = 30\nnet = true\n", encoding="utf-8")
    before = {path: path.stat().st_mtime_ns for path in arm.out.rglob("*")}
    text = lines(study, arm.out)
    assert "expected: " in text
    assert {path: path.stat().st_mtime_ns for path in arm.out.rglob("*")} == before


def test_what_cannot_be_opened_is_told(arm, study):
    run_study(read_plan(study), arm.out)
    (arm.folder / "again.trc").write_text("no recording")
    found = looked_at(study, arm.out)
    assert any("again.trc" in problem for problem in found.problems)
    assert "cannot be checked:" in "\n".join(dry_run_lines(found))


def test_a_time_that_no_frame_has_is_told_before_the_first_run(arm, study):
    study.write_text(
        STUDY.replace('trials = ["again.trc"', 'time = [90.0, 91.0]\ntrials = ["again.trc"', 1),
        encoding="utf-8",
    )
    found = looked_at(study, arm.out)
    assert ["no frame from 90 to 91 s" in problem for problem in found.problems] == [True]


def test_a_model_that_cannot_be_read_is_told_once(arm, study):
    arm.model.write_text("no model")
    found = looked_at(study, arm.out)
    assert [arm.model.name in problem for problem in found.problems] == [True]


@pytest.mark.parametrize(
    ("seconds", "words"),
    [
        (0.04, "0.0 s"),
        (9.97, "10 s"),
        (59.6, "1 min 0 s"),
        (200, "3 min 20 s"),
        (7501, "2 h 5 min"),
    ],
)
def test_times_in_words(seconds, words):
    assert in_words(seconds) == words
