"""A study runs again.

What has changed is named and computed, the rest is reused, and the bytes are the same.
"""

from __future__ import annotations

import csv
import errno
import hashlib
import os
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from myomorph.core.model.errors import BadData, BadFile
from myomorph.lab.study.plan.plan import read_plan
from myomorph.lab.study.plan.plan_checks import OF_STUDY
from myomorph.lab.study.run.run import run_study
from myomorph.lab.study.step.step import step_of
from myomorph.lab.study.step.step_table import STEPS
from myomorph.lab.study.trial import run_trial as module
from myomorph.lab.study.workers.local_workers import LocalWorkers
from myomorph.show.demo.arm import example_files

STUDY = """
[study]
name = "reaching"
[[subject]]
name = "s01"
model = "arm.osim"
trials = [{trials}]
steps = [{steps}]
[options.id]
cutoff = {cutoff}
[options.report]
preset = "{preset}"
"""
DATE = "1700000000"
OF_A_RUN = ("study.log", "study.json", "timings.csv")
"""Files that tell of runs, not of results."""


@pytest.fixture
def dated(monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", DATE)


ALL = '"ik", "id", "report"'
EVERY = '"ik", "id", "muscles", "tension", "report"'


def _run(arm, trials=1, cutoff=6, preset="", out=None, steps='"ik", "id"', **given):
    names = [f"reach{index}" for index in range(trials)]
    for name in names:
        if not (arm.folder / f"{name}.trc").exists():
            shutil.copy(arm.folder / "reach.trc", arm.folder / f"{name}.trc")
    path = arm.folder / "study.toml"
    path.write_text(
        STUDY.format(
            trials=", ".join(f'"{name}.trc"' for name in names),
            cutoff=cutoff,
            preset=preset,
            steps=steps,
        ).replace('[options.report]\npreset = ""\n', "")
    )
    return run_study(read_plan(path), out or arm.out, **given)


def contents(out):
    """Hash of every result, by its path."""
    return {
        str(path.relative_to(out)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(out.rglob("*"))
        if path.is_file() and path.name not in OF_A_RUN
    }


def test_workers_write_what_this_process_writes(arm, dated, tmp_path):
    """Byte for byte, tables, results and reports."""
    there = tmp_path / "there"
    here = tmp_path / "here"
    by_workers = _run(arm, 2, out=there, steps=ALL, workers=LocalWorkers(2))
    by_this = _run(arm, 2, out=here, steps=ALL)
    assert [one.error for one in by_workers] == [one.error for one in by_this] == ["", ""]
    assert [one.key for one in by_workers] == [one.key for one in by_this]
    found = contents(there)
    expected = contents(here)
    # Reports tell the folder of results nowhere, tables of links neither.
    assert found == expected
    assert not list(there.rglob(".*"))


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """Make the example's files and the results of two trials, and the contents of these.

    Nothing writes there.
    """
    arm = example_files(tmp_path_factory.mktemp("finished"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SOURCE_DATE_EPOCH", DATE)
        _run(arm, trials=2, steps=ALL)
    return arm, contents(arm.out)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Make the example's files, and the contents of the results of one uninterrupted trial."""
    arm = example_files(tmp_path_factory.mktemp("whole"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SOURCE_DATE_EPOCH", DATE)
        _run(arm, steps=EVERY)
    return arm, contents(arm.out)


@pytest.mark.parametrize("stopped_in", ["id", "tension", "gather", "report"])
def test_an_interrupted_run_ends_with_the_same_bytes(
    whole, dated, tmp_path, monkeypatch, stopped_in
):
    arm, expected = whole

    def interrupted(*_, **__):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        if stopped_in in STEPS["trial"]:
            patch.setattr(
                f"{STEPS['trial'][stopped_in]}.STEP", replace(step_of(stopped_in), run=interrupted)
            )
        elif stopped_in == "gather":
            patch.setattr(module.os, "replace", interrupted)
        else:
            patch.setattr(module, "_report", interrupted)
        with pytest.raises((KeyboardInterrupt, BadFile)):
            _run(arm, out=tmp_path / "halves", steps=EVERY)
    (outcome,) = _run(arm, out=tmp_path / "halves", steps=EVERY)
    assert outcome.error == ""
    assert contents(tmp_path / "halves") == expected
    assert not list((tmp_path / "halves").rglob(".*"))


def test_nothing_is_written_where_nothing_has_changed(arm):
    _run(arm, 2, steps=ALL)
    before = {
        path: path.stat().st_mtime_ns
        for path in arm.out.rglob("*")
        if path.is_file() and "reach" in str(path)
    }
    outcomes = _run(arm, 2, steps=ALL)
    assert [one.reused for one in outcomes] == [("ik", "id", "report")] * 2
    assert [one.timed for one in outcomes] == [()] * 2
    assert outcomes[0].frames == 61
    assert outcomes[0].rms < 1e-6
    assert {path: path.stat().st_mtime_ns for path in before} == before


def test_what_changed_is_named_and_only_that_computed(arm):
    _run(arm, 2)
    outcomes = _run(arm, 2, cutoff=5)
    assert [one.reused for one in outcomes] == [("ik",)] * 2
    assert [one.changed for one in outcomes] == [("id.cutoff 6.0 -> 5.0",)] * 2
    text = (arm.folder / "reach1.trc").read_text()
    (arm.folder / "reach1.trc").write_text(text + "\n")
    first, second = _run(arm, 2, cutoff=5)
    assert first.reused == ("ik", "id")
    assert second.reused == ()
    assert second.changed == ("markers reach1.trc has changed",)
    arm.model.write_text(arm.model.read_text().replace("800", "900"))
    outcomes = _run(arm, 2, cutoff=5)
    assert [one.changed for one in outcomes] == [("model arm.osim has changed",)] * 2
    assert "because model arm.osim has changed" in (arm.out / "study.log").read_text(
        encoding="utf-8"
    )


def test_another_look_makes_only_the_report_again(arm):
    _run(arm, steps=ALL)
    page = arm.out / "s01" / "reach0" / "report.html"
    before = page.read_text(encoding="utf-8")
    (outcome,) = _run(arm, preset="gait", steps=ALL)
    assert outcome.reused == ("ik", "id")
    assert [step for step, _ in outcome.timed] == ["report"]
    assert page.read_text(encoding="utf-8") != before
    assert _run(arm, preset="gait", steps=ALL)[0].reused == ("ik", "id", "report")


def test_the_report_shows_the_muscles_of_the_study_file(arm):
    _run(arm, preset="gait", steps=EVERY)
    path = arm.folder / "study.toml"
    path.write_text(path.read_text() + 'muscles = ["flexor", "Psoas"]\n')
    (outcome,) = run_study(read_plan(path), arm.out)
    assert [step for step, _ in outcome.timed] == ["report"]
    assert "Missing in the model: Psoas." in (arm.out / "s01" / "reach0" / "report.html").read_text(
        encoding="utf-8"
    )


def test_results_do_not_outlive_the_steps_that_now_fail(arm):
    """What an earlier run found must not stand beside an error as if it were this run's."""
    _run(arm)
    arm.loads.write_text(arm.loads.read_text().replace(">fore<", ">leg<"))
    (arm.folder / "reach0_external_loads.xml").write_text(arm.loads.read_text())
    (outcome,) = _run(arm)
    assert outcome.reused == ("ik",)
    assert outcome.error.startswith("id: ")
    stored = module.store.stored_provenance(arm.out / "s01" / "reach0" / "reach0.nc")
    assert set(stored) == {"ik"}


def test_fresh_computes_all(arm):
    _run(arm)
    (outcome,) = _run(arm, fresh=True)
    assert outcome.reused == outcome.changed == ()


def test_a_model_that_changes_while_the_study_runs(arm):
    """Its values and its hash would not belong together."""

    def change(outcome):
        arm.model.write_text(arm.model.read_text() + "\n")

    first, second = _run(arm, 2, report=change)
    assert first.error == ""
    assert "has changed while the study ran" in second.error
    assert all(one.error == "" for one in _run(arm, 2))


def test_leftovers_of_a_killed_process_are_removed(arm):
    home = arm.out / "s01" / "reach0"
    (home / ".steps" / ".ik.ab12cd3_").mkdir(parents=True)
    (home / ".reach0.nc.q_9zz0x1").write_bytes(b"half")
    (home / ".report.html.part").write_text("half")
    (home / "notes.txt").write_text("the user's own")
    (home / ".hidden").write_text("the user's own")
    _run(arm)
    assert sorted(path.name for path in home.glob(".*")) == [".hidden"]
    assert (home / "notes.txt").exists()


def test_a_full_disk_stops_the_study(arm, monkeypatch):
    ik = step_of("ik")
    calls = []

    def full(*given):
        calls.append(1)
        if len(calls) > 1:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return ik.run(*given)

    monkeypatch.setattr(f"{STEPS['trial']['ik']}.STEP", replace(ik, run=full))
    outcomes = _run(arm, 3)
    assert outcomes[0].error == ""
    assert outcomes[1].error.startswith("ik: no space is left")
    assert [one.error[:22] for one in outcomes[2:3]] == ["not run: no space is l"]
    assert len(calls) == 2
    assert not any(one.fault for one in outcomes)
    monkeypatch.setattr(f"{STEPS['trial']['ik']}.STEP", ik)
    assert [one.error for one in _run(arm, 3)] == [""] * 3


def test_two_runs_at_once(arm):
    def second(outcome):
        with pytest.raises(BadData, match=f"process {os.getpid()} on"):
            _run(arm)

    assert _run(arm, report=second)[0].error == ""


def test_the_log_and_the_times(arm):
    _run(arm, 2)
    _run(arm, 2, cutoff=5)
    lines = (arm.out / "study.log").read_text(encoding="utf-8").splitlines()
    assert sum("done s01/reach0: computed ik id;" in line for line in lines) == 1
    assert (
        sum(
            "done s01/reach0: computed id; reused ik; because id.cutoff 6.0 -> 5.0" in line
            for line in lines
        )
        == 1
    )
    assert sum("(2 of 2)" in line for line in lines) >= 2
    with (arm.out / "timings.csv").open(newline="", encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["step"] for row in rows if row["trial"] == "reach0"] == ["ik", "id", "id"]
    assert {row["frames"] for row in rows if row["trial"]} == {"61"}
    assert [row["step"] for row in rows if not row["subject"]] == ["tables", "tables"]
    assert all(float(row["seconds"]) >= 0.0 for row in rows)


def test_steps_held_in_memory_give_the_same_bytes(arm, dated, tmp_path, monkeypatch):
    _run(arm, out=tmp_path / "held", steps=ALL)
    monkeypatch.setattr(module, "HELD_FRAMES", 0)
    _run(arm, out=tmp_path / "written", steps=ALL)
    assert contents(tmp_path / "held") == contents(tmp_path / "written")


def test_no_subject_can_have_the_name_of_a_file_of_the_study(arm):
    _run(arm)
    assert {path.name for path in arm.out.iterdir() if path.is_file()} <= set(OF_STUDY)


def test_no_worker_begins_where_nothing_has_changed(arm):
    class Idle:
        count = 2
        memory = None

        def start(self, job, model):
            raise AssertionError(f"{job.key} is given out")

        def ended(self, timeout):
            return []

        def close(self):
            pass

    first = _run(arm, trials=3, steps=ALL)
    before = contents(arm.out)
    again = _run(arm, trials=3, steps=ALL, workers=Idle())
    assert [one.reused for one in again] == [("ik", "id", "report")] * 3
    assert [(one.done, one.frames, one.rms, one.largest) for one in again] == [
        (one.done, one.frames, one.rms, one.largest) for one in first
    ]
    assert contents(arm.out).keys() == before.keys()
    assert {name for name, one in contents(arm.out).items() if one != before[name]} <= {
        "results.csv"
    }


@pytest.mark.parametrize(
    "lost",
    [
        "study.html",
        "results_tidy.csv",
        "s01/reach0/values.csv",
        "s01/reach0/report.html",
        "s01/reach0/reach0.nc",
    ],
)
def test_what_was_removed_is_made_again(finished, dated, tmp_path, lost):
    arm, before = finished
    out = Path(shutil.copytree(arm.out, tmp_path / "out"))
    (out / lost).unlink()
    first, second = _run(arm, trials=2, out=out, steps=ALL)
    assert first.error == ""
    assert second.reused == ("ik", "id", "report")
    assert contents(out) == before


def test_a_table_that_was_altered_is_made_again(arm, dated):
    _run(arm, trials=2)
    before = contents(arm.out)
    with (arm.out / "results_tidy.csv").open("a") as stream:
        stream.write("s01,,reach9,ik,frames,1,1\n")
    _run(arm, trials=2)
    assert contents(arm.out) == before


def test_steps_whose_values_found_no_room_are_not_said_to_be_done(arm, monkeypatch):
    def full(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(module.store, "new_result", full)
        first = _run(arm)[0]
    assert "no space is left" in first.error
    assert (first.done, first.timed) == ((), ())
    assert _run(arm)[0].done == ("ik", "id")
