"""How far a run is, and the time left."""

from __future__ import annotations

import pytest

from myomorph.show.app.bar import Bar, PlannedJob


def job(trial, steps, seconds):
    return PlannedJob(subject="s", trial=trial, steps=steps, seconds=seconds)


JOBS = (
    job("", ("calibrate", "report"), (6.0, 2.0)),
    job("walk", ("ik", "id"), (4.0, 4.0)),
    PlannedJob(subject="", trial="", steps=("tables",), seconds=(4.0,)),
)


def test_nothing_yet():
    assert Bar().look((), 3.0) == {"share": 0.0, "left": "", "now": []}
    assert Bar(jobs=JOBS).look((), 0.0) == {"share": 0.0, "left": "20 s", "now": []}


def test_steps_count_by_what_they_take():
    bar = Bar(jobs=JOBS)
    look = bar.look([{"subject": "s", "trial": "", "step": "calibrate"}, {"done": 0.5}], 3.0)
    assert look["share"] == pytest.approx(3.0 / 20.0)
    assert look["left"] == "17 s"
    assert look["now"] == ["s: fitting the body to the markers"]
    bar.ended.add(("s", ""))
    look = bar.look([{"subject": "s", "trial": "walk", "step": "id"}, {"done": 0.25}], 13.0)
    assert look["share"] == pytest.approx(13.0 / 20.0)
    assert look["now"] == ["walk: joint torques"]


def test_a_slower_machine_takes_longer():
    said = [{"subject": "s", "trial": "walk", "step": "id"}]
    bar = Bar(jobs=JOBS, ended={("s", "")})
    fast = bar.look(said, 12.0)["left"]
    slow = bar.look(said, 120.0)["left"]
    assert fast == "8.0 s"
    assert slow == "1 min 6 s"


def test_without_experience_nothing_is_promised_at_first():
    unknown = (job("walk", ("ik", "tension"), (None, None)),)
    said = [{"subject": "s", "trial": "walk", "step": "ik"}]
    assert Bar(jobs=unknown).look(said, 5.0)["left"] == ""
    assert Bar(jobs=unknown).look([*said, {"done": 1.0}], 3.0)["left"] == "8.0 s"


def test_what_is_not_of_the_run_is_passed_over():
    said = [{"subject": "x", "trial": "y", "step": "ik"}, {"done": 1.0}, {"other": 1}]
    assert Bar(jobs=JOBS).look(said, 1.0)["share"] == 0.0
