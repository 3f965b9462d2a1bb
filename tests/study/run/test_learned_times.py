"""Expected times learn from runs of this machine: of other studies, by settings, without what was compiled once."""

from __future__ import annotations

import pytest

from identified_arm import put_on_plate
from myomorph.store.outcome import Outcome
from myomorph.study.plan.plan import read_plan
from myomorph.study.run.dry_run import dry_run
from myomorph.study.run.expected_time import ModelSize, StepTimes
from myomorph.study.run.learned_times import (
    MAX_SAMPLES,
    RUN,
    TRIAL,
    Learning,
    Sample,
    keep_samples,
    read_samples,
    settings_key,
    times_file,
)
from myomorph.study.run.run import run_study
from myomorph.study.run.watching import StudyLog

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
SIZE = ModelSize(23, 54)


def tension(seconds, frames=100, settings="", first=0, muscles=54):
    return Sample("tension", settings, 23, muscles, frames, first, seconds)


@pytest.fixture
def kept(tmp_path, monkeypatch):
    path = tmp_path / "cache" / "step_times.csv"
    monkeypatch.setenv("MYOMORPH_STEP_TIMES", str(path))
    assert times_file() == path
    return path


def test_a_run_teaches_the_dry_run_of_another_study(arm, kept, monkeypatch):
    put_on_plate(arm)
    path = arm.folder / "study.toml"
    path.write_text(STUDY, encoding="utf-8")
    plan = read_plan(path)
    assert not dry_run(plan, arm.folder / "other").rows[0].expected.measured
    # A job during which kernels are compiled teaches nothing: they are compiled before, and those that tests beside
    # this one compile are not heard.
    run_study(plan, arm.folder / "compiled")
    monkeypatch.setattr("myomorph.study.run.learned_times._kernels", lambda: 0)
    outcome = run_study(plan, arm.folder / "first")[0]
    found = read_samples(kept)
    assert {one.step for one in found} == {"ik", "id", TRIAL, RUN}
    assert {(one.coordinates, one.muscles) for one in found if one.step != RUN} == {(2, 2)}
    row = dry_run(plan, arm.folder / "other").rows[0]
    assert row.expected.measured
    assert row.expected.seconds == pytest.approx(outcome.seconds, rel=2.0, abs=0.1)


def test_times_grow_with_frames_and_muscles_as_in_the_table(kept):
    keep_samples(kept, [tension(10.0)])
    times, plain = StepTimes(learned=kept), StepTimes()
    ratio = 10.0 / plain._guess("tension", 100, SIZE)
    for frames, size in ((100, SIZE), (1000, SIZE), (50, ModelSize(33, 80))):
        found = times.expected("s", "t", "tension", frames, size, {})
        assert found.measured
        assert found.seconds == pytest.approx(ratio * plain._guess("tension", frames, size))


def test_settings_are_apart(kept):
    """Elastic tendons take many times as long: what rigid ones took is only a guess of them."""
    elastic = {"tendons": "elastic"}
    keep_samples(kept, [*[tension(1.0)] * 5, *[tension(60.0, settings=settings_key(elastic))] * 2])
    times = StepTimes(learned=kept)
    assert times.expected("s", "t", "tension", 100, SIZE, {}).seconds == pytest.approx(1.0)
    assert times.expected("s", "t", "tension", 100, SIZE, elastic).seconds == pytest.approx(60.0)
    assert not times.expected("s", "t", "tension", 100, SIZE, {"exponent": 3.0}).measured


def test_the_first_job_of_a_process_loads_programs_too(kept):
    keep_samples(kept, [tension(3.0, first=1), tension(1.0), tension(1.1)])
    times = StepTimes(learned=kept)
    assert times.expected("s", "t", "tension", 100, SIZE, {}, first=True).seconds == pytest.approx(3.0)
    assert times.expected("s", "t", "tension", 100, SIZE, {}).seconds == pytest.approx(1.05)


def test_what_the_table_does_not_know_grows_with_frames(kept):
    keep_samples(kept, [Sample("morph", "", 23, 54, 200, 0, 20.0)])
    assert StepTimes(learned=kept).expected("s", "", "morph", 100, SIZE, {}).seconds == pytest.approx(10.0)


def test_jobs_that_compiled_are_left_out(arm, kept, monkeypatch, tmp_path):
    put_on_plate(arm)
    path = arm.folder / "study.toml"
    path.write_text(STUDY, encoding="utf-8")
    counts = iter([10, 86, 86, 86])
    monkeypatch.setattr("myomorph.study.run.learned_times._kernels", lambda: next(counts))
    learning = Learning(read_plan(path), 1)
    outcomes = {}
    for name in ("reach", "again"):
        one = Outcome("s01", name, tmp_path, frames=61, seconds=1.0, timed=(("ik", 0.5),))
        learning.started(one.key)
        learning.ended(one)
        outcomes[one.key] = one
    learning.keep(outcomes)
    assert learning.compiled == {("s01", "reach")}
    assert [one.step for one in read_samples(kept)] == ["ik", TRIAL]

    log = StudyLog(tmp_path)
    log.time(outcomes["s01", "reach"], compiled=True)
    log.close()
    assert not StepTimes(tmp_path / "timings.csv").expected("s01", "reach", "ik", 61, ModelSize(2, 0)).measured


def test_the_file_stays_small_and_damage_is_passed_over(kept):
    for _ in range(3):
        keep_samples(kept, [tension(float(k)) for k in range(MAX_SAMPLES // 2)])
    assert len(read_samples(kept)) <= MAX_SAMPLES
    keep_samples(kept, [tension(7.5)])
    with kept.open("a", encoding="utf-8") as stream:
        stream.write("tension,,x,54\n\0\n")
    assert read_samples(kept)[-1].seconds == 7.5
    keep_samples(None, [tension(1.0)])
