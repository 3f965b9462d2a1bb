"""Jobs begin when what they need is there; losses are repeated once; a full disk ends the rest."""

from __future__ import annotations

from pathlib import Path

import pytest
import worker_jobs as made

from myomorph.model.errors import BadFile
from myomorph.store.outcome import Outcome
from myomorph.study.run.run import run_jobs
from myomorph.study.workers.jobs import Ended
from myomorph.study.workers.local_workers import InProcess


class Told:
    """Remembers what it was told."""

    def __init__(self):
        self.order, self.losses = [], []

    def started(self, job):
        self.order.append(job.key[1])

    def lost(self, job, why, again):
        self.losses.append((job.key[1], why, again))

    def ended(self, outcome):
        pass

    def idle(self):
        pass


class Losing(InProcess):
    """Loses the jobs with these names so many times."""

    def __init__(self, **times):
        super().__init__()
        self.times = times

    def ended(self, timeout):
        (one,) = super().ended(timeout)
        name = one.job.key[1]
        if self.times.get(name, 0):
            self.times[name] -= 1
            return [Ended(one.job, None, "out of reach")]
        return [one]


def failing(model, name, fault=False):
    return Outcome("s", name, Path(), error="ik: no markers", fault=fault)


def run(*jobs, workers=None, read=lambda path: (None, "")):
    told = Told()
    homes = {job.key: Path(job.key[1]) for job in jobs}
    found = run_jobs(jobs, homes, workers or InProcess(), read, told)
    assert set(found) == set(homes)
    return {key[1]: outcome for key, outcome in found.items()}, told


def test_what_is_needed_comes_first():
    jobs = (
        made.job(made.plain, "c", needs=(("s", "b"),)),
        made.job(made.plain, "b", after=(("s", "a"),)),
        made.job(made.plain, "a"),
    )
    found, told = run(*jobs)
    assert told.order == ["a", "b", "c"]
    assert not any(one.error for one in found.values())


def test_a_failure_keeps_those_from_running_that_need_it():
    jobs = (
        made.job(failing, "a", fault=True),
        made.job(made.plain, "b", needs=(("s", "a"),)),
        made.job(made.plain, "c", needs=(("s", "b"),)),
        made.job(made.plain, "d", after=(("s", "a"),)),
    )
    found, told = run(*jobs)
    assert told.order == ["a", "d"]
    assert found["b"].error == found["c"].error == "not run: ik: no markers"
    assert found["c"].fault
    assert found["d"].done == ("done",)


def test_a_lost_job_is_repeated_once():
    jobs = [made.job(made.plain, name) for name in "abc"]
    found, told = run(*jobs, workers=Losing(a=1, b=2))
    assert found["a"].done == found["c"].done == ("done",)
    assert found["b"].error == "its worker was lost twice: out of reach"
    assert told.losses == [("a", "out of reach", True), ("b", "out of reach", True), ("b", "out of reach", False)]
    assert told.order == ["a", "a", "b", "b", "c"]


def test_a_full_disk_stops_what_has_not_begun():
    found, told = run(made.job(made.plain, "a"), made.job(made.no_space, "b"), made.job(made.plain, "c"))
    assert found["a"].done == ("done",)
    assert found["b"].error.startswith("ik: no space is left")
    assert found["b"].full
    assert not found["b"].fault
    assert found["c"].error.startswith("not run: no space is left")
    assert told.order == ["a", "b"]


def test_a_model_that_cannot_be_read_fails_its_jobs_only():
    def read(path):
        if path == Path("bad.osim"):
            raise BadFile(path, "is no model")
        return None, ""

    jobs = (made.job(made.plain, "a", Path("bad.osim")), made.job(made.plain, "b"))
    found, _ = run(*jobs, read=read)
    assert found["a"].error == "bad.osim: is no model"
    assert found["b"].error == ""


def test_models_are_let_go_when_no_job_needs_them():
    """A study of a thousand subjects must not hold a thousand models."""
    opened = []

    def read(path):
        opened.append(path)
        return None, ""

    jobs = [made.job(made.plain, f"{subject}{trial}", Path(subject)) for subject in "xy" for trial in range(3)]
    run(*jobs, read=read)
    assert opened == [Path("x"), Path("y")]


@pytest.mark.parametrize("count", [1, 20_000])
def test_many_jobs(count):
    """Twenty thousand take seconds; were the time quadratic, they would take hours."""
    found, told = run(*(made.job(made.plain, str(index)) for index in range(count)))
    assert len(found) == len(told.order) == count
