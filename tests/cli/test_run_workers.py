"""`myomorph run`: workers of this machine, what is taken over, and what is refused in one line."""

from __future__ import annotations

import csv

import pytest

from myomorph.lab.study.workers.local_workers import InProcess

STUDY = """
[study]
name = "reaching"
[[subject]]
name = "s01"
model = "arm.osim"
trials = ["reach.trc", "again.trc"]
steps = ["ik"]
"""


@pytest.fixture
def study(arm):
    (arm.folder / "again.trc").write_text((arm.folder / "reach.trc").read_text())
    path = arm.folder / "study.toml"
    path.write_text(STUDY)
    return path


def test_workers_and_again(arm, study, command):
    first = command("run", study, "--out", arm.out, "--workers", 2, "--memory", 2)
    assert (first.status, first.err) == (0, "")
    assert "2 of 2 trials done" in first.out
    assert f"page: {arm.out / 'study.html'}" in first.out
    assert "failed:" not in first.out
    assert "2 workers, 1.86 GiB of memory each" in (arm.out / "study.log").read_text(
        encoding="utf-8"
    )
    with (arm.out / "results.csv").open(newline="", encoding="utf-8") as stream:
        assert [row["trial"] for row in csv.DictReader(stream)] == ["reach", "again"]
    text = study.read_text() + "[options.ik]\ntolerance = 1e-5\n"
    study.write_text(text)
    second = command("run", study, "--out", arm.out, "--workers", 1)
    assert second.status == 0
    assert "(again, because ik.tolerance " in second.out


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (("--workers", 0), "workers 0: expected 1 or more"),
        (("--workers", -1, "--dry-run"), "workers -1: expected 1 or more"),
        (("--memory", "nan"), "--memory nan: expected a number of GB"),
        (("--memory", 0.001), "less does not hold a model"),
        (("--fresh", "--resume"), "--resume and --fresh exclude each other"),
    ],
)
def test_what_is_refused(arm, study, command, given, told):
    found = command("run", study, "--out", arm.out, *given)
    assert found.status == 2
    assert told in found.err
    assert found.err.count("\n") == 1
    assert not arm.out.exists()


def test_threads_are_those_of_each_process(arm, study, command, monkeypatch):
    given = []

    def workers(*told):
        given.append(told)
        return InProcess()

    monkeypatch.setenv("MYOMORPH_THREADS", "1")
    monkeypatch.setattr("myomorph.lab.study.workers.local_workers.local_workers", workers)
    assert command("run", study, "--out", arm.out, "--workers", 2, "--threads", 3).status == 0
    assert given == [(2, None, 2, 3)]


def test_what_failed_is_named_at_the_end(arm, study, command, in_process):
    (arm.folder / "again.trc").write_text("no recording")
    found = command("run", study, "--out", arm.out, "--workers", 1)
    assert found.status == 2
    *_, done, failed, page = found.out.splitlines()
    assert done.startswith("1 of 2 trials done")
    assert failed == "failed: s01/again; reasons are in results.csv and study.log"
    assert page.endswith("study.html")
