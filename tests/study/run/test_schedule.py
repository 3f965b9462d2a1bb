"""Jobs begin when what they need is there; losses are repeated once; a full disk ends the rest."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import pytest
import worker_jobs as made

from myomorph.core.model.errors import BadFile
from myomorph.lab.store.outcome import Outcome
from myomorph.lab.study.run.run import Schedule
from myomorph.lab.study.run.work import Work
from myomorph.lab.study.workers.jobs import Ended
from myomorph.lab.study.workers.local_workers import InProcess


@dataclass(frozen=True)
class Done(Work):
    """A job that a function does."""

    do: Callable = made.plain

    def __call__(self, model, read=""):
        return self.do(model, name=self.key[1])

    def reused(self, model, read=""):
        return None


def job(do, name, model=None, needs=(), after=()):
    return Done(
        scope="trial",
        outcome=Outcome("s", name, Path(name)),
        steps=(),
        open=None,
        needs=needs,
        after=after,
        model=model,
        do=do,
    )


class Told:
    """Remembers what it was told."""

    def __init__(self):
        self.order = []
        self.losses = []

    def started(self, key):
        self.order.append(key[1])

    def lost(self, key, why, again):
        self.losses.append((key[1], why, again))

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
    found = Schedule(works=jobs, workers=workers or InProcess(), read=read, watcher=told).run()
    assert set(found) == {each.key for each in jobs}
    return {key[1]: outcome for key, outcome in found.items()}, told


def test_what_is_needed_comes_first():
    jobs = (
        job(made.plain, "c", needs=(("s", "b"),)),
        job(made.plain, "b", after=(("s", "a"),)),
        job(made.plain, "a"),
    )
    found, told = run(*jobs)
    assert told.order == ["a", "b", "c"]
    assert not any(one.error for one in found.values())


def test_a_failure_keeps_those_from_running_that_need_it():
    jobs = (
        job(partial(failing, fault=True), "a"),
        job(made.plain, "b", needs=(("s", "a"),)),
        job(made.plain, "c", needs=(("s", "b"),)),
        job(made.plain, "d", after=(("s", "a"),)),
    )
    found, told = run(*jobs)
    assert told.order == ["a", "d"]
    assert found["b"].error == found["c"].error == "not run: ik: no markers"
    assert found["c"].fault
    assert found["d"].done == ("done",)


def test_a_lost_job_is_repeated_once():
    jobs = [job(made.plain, name) for name in "abc"]
    found, told = run(*jobs, workers=Losing(a=1, b=2))
    assert found["a"].done == found["c"].done == ("done",)
    assert found["b"].error == "its worker was lost twice: out of reach"
    assert told.losses == [
        ("a", "out of reach", True),
        ("b", "out of reach", True),
        ("b", "out of reach", False),
    ]
    assert told.order == ["a", "a", "b", "b", "c"]


def test_a_full_disk_stops_what_has_not_begun():
    found, told = run(job(made.plain, "a"), job(made.no_space, "b"), job(made.plain, "c"))
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

    jobs = (job(made.plain, "a", Path("bad.osim")), job(made.plain, "b"))
    found, _ = run(*jobs, read=read)
    assert found["a"].error == "bad.osim: is no model"
    assert found["b"].error == ""


def test_models_are_let_go_when_no_job_needs_them():
    """A study of a thousand subjects must not hold a thousand models."""
    opened = []

    def read(path):
        opened.append(path)
        return None, ""

    jobs = [
        job(made.plain, f"{subject}{trial}", Path(subject))
        for subject in "xy"
        for trial in range(3)
    ]
    run(*jobs, read=read)
    assert opened == [Path("x"), Path("y")]


@pytest.mark.parametrize("count", [1, 20_000])
def test_many_jobs(count):
    """Twenty thousand take seconds; were the time quadratic, they would take hours."""
    found, told = run(*(job(made.plain, str(index)) for index in range(count)))
    assert len(found) == len(told.order) == count
