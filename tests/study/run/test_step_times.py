"""Expected times are what steps took on this machine, by their settings.

The time of compilation, which happens once, is left out.
"""

from __future__ import annotations

from dataclasses import replace

import pytest

from identified_arm import put_on_plate
from myomorph.lab.study.plan.plan import read_plan
from myomorph.lab.study.run.dry_run import dry_run
from myomorph.lab.study.run.job_plan import graph_of
from myomorph.lab.study.run.run import run_study
from myomorph.lab.study.run.step_times import (
    MAX_SAMPLES,
    Learning,
    Sample,
    StepTimes,
    keep_samples,
    read_samples,
    settings_key,
    times_file,
)

STUDY = """
[study]
name = "reaching"
[[subject]]
name = "s01"
model = "arm.osim"
mass = 4.0
trials = ["reach.trc"]
steps = ["ik", "id"]
"""


def tension(seconds, frames=100, settings="", muscles=54):
    return Sample(
        step="tension", settings=settings, muscles=muscles, frames=frames, seconds=seconds
    )


@pytest.fixture
def kept(tmp_path, monkeypatch):
    path = tmp_path / "cache" / "step_times.csv"
    monkeypatch.setenv("MYOMORPH_STEP_TIMES", str(path))
    assert times_file() == path
    return path


@pytest.fixture
def plan(arm):
    put_on_plate(arm)
    path = arm.folder / "study.toml"
    path.write_text(STUDY, encoding="utf-8")
    return read_plan(path)


def test_a_run_teaches_the_dry_run_of_another_study(arm, plan, kept, monkeypatch):
    other = arm.folder / "other"
    assert dry_run(graph_of(plan, other), other).unknown == ("ik", "id")
    # A job during which kernels are compiled teaches nothing: they are compiled before, and those
    # that tests beside this one compile are not heard.
    run_study(plan, arm.folder / "compiled")
    monkeypatch.setattr("myomorph.lab.study.run.step_times._kernels", lambda: 0)
    outcome = run_study(plan, arm.folder / "first")[0]
    samples = read_samples(kept)
    assert {sample.step for sample in samples} == {"ik", "id"}
    assert {sample.muscles for sample in samples} == {2}
    row = dry_run(graph_of(plan, other), other).rows[0]
    assert row.unknown == ()
    assert row.seconds == pytest.approx(outcome.seconds, rel=2.0, abs=0.1)


def test_times_grow_with_frames(kept):
    keep_samples(kept, [tension(10.0), tension(30.0, 300), tension(2.0, 10)])
    times = StepTimes(kept)
    assert times.expected("tension", {}, 54, 1000) == pytest.approx(100.0)
    assert times.expected("tension", {}, 54, None) is None


def test_only_what_ran_is_known(kept):
    """Elastic tendons take many times as long, and so do more muscles.

    The times of other settings give no information.
    """
    elastic = {"tendons": "elastic"}
    keep_samples(kept, [*[tension(1.0)] * 5, *[tension(60.0, settings=settings_key(elastic))] * 2])
    times = StepTimes(kept)
    assert times.expected("tension", {}, 54, 100) == pytest.approx(1.0)
    assert times.expected("tension", elastic, 54, 100) == pytest.approx(60.0)
    assert times.expected("tension", {"exponent": 3.0}, 54, 100) is None
    assert times.expected("tension", {}, 520, 100) is None
    assert times.expected("ik", {}, 54, 100) is None


def test_jobs_that_compiled_are_left_out(arm, plan, kept, monkeypatch, tmp_path):
    graph = graph_of(plan, tmp_path / "out")
    (work,) = graph.works
    learning = Learning({work.key: work})
    counts = iter([10, 86, 86, 86])
    monkeypatch.setattr("myomorph.lab.study.run.step_times._kernels", lambda: next(counts))
    outcome = replace(work.outcome, frames=61, seconds=1.0, timed=(("ik", 0.5),))
    learning.started(work.key)
    learning.ended(outcome)
    learning.keep([outcome])
    assert learning.compiled == {work.key}
    assert read_samples(kept) == []
    learning.compiled.clear()
    learning.started(work.key)
    learning.ended(outcome)
    learning.keep([outcome])
    assert [(sample.step, sample.frames, sample.seconds) for sample in read_samples(kept)] == [
        ("ik", 61, 0.5)
    ]


def test_the_file_stays_small_and_damage_is_passed_over(kept):
    for _ in range(3):
        keep_samples(kept, [tension(float(index)) for index in range(MAX_SAMPLES // 2)])
    assert len(read_samples(kept)) <= MAX_SAMPLES
    keep_samples(kept, [tension(7.5)])
    with kept.open("a", encoding="utf-8") as stream:
        stream.write("tension,,x,54\n\0\n")
    assert read_samples(kept)[-1].seconds == 7.5
    keep_samples(None, [tension(1.0)])
