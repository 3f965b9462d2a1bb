"""Run a study: every trial through its steps, what failed by name, the rest whole."""

from __future__ import annotations

import csv
import io
import os
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path

from myomorph import __version__
from myomorph.model.errors import BadFile
from myomorph.model.model import Model
from myomorph.study.inputs import open_model
from myomorph.study.job_plan import StudyJobs, jobs_of
from myomorph.study.job_work import GATHERED, do_groups, do_tables
from myomorph.study.jobs import Job, Key, Outcome, Workers
from myomorph.study.local_workers import InProcess
from myomorph.study.locks import study_lock
from myomorph.study.plan import Plan
from myomorph.study.results import file_source, fixed_date
from myomorph.study.schedule import run_jobs
from myomorph.study.study_log import StudyLog

TABLE = "results.csv"
RARELY = 1.0
"""The table is not written more often than this, so that many short trials do not wait for it [s]."""


def run_study(
    plan: Plan,
    out: Path,
    *,
    fresh: bool = False,
    workers: Workers | None = None,
    said: Callable[[Outcome], None] = lambda outcome: None,
) -> list[Outcome]:
    """Run all trials of a plan, each into `out/subject/trial`, and write the tables of the study.

    Steps whose inputs, options and version have not changed since an earlier run are taken over.

    Parameters
    ----------
    fresh : compute every step, whatever an earlier run left
    workers : that do the jobs, closed at the end; None does them in this process
    said : called with each trial's outcome when it ends

    Returns
    -------
    outcomes in the order of the study file, those of groups and tables last

    Raises
    ------
    BadData
        where another run writes into the folder, or a newer version has
    BadFile
        where the folder cannot be written
    """
    workers = workers or InProcess()
    try:
        with study_lock(out) as mark:
            jobs = jobs_of(plan, out, fresh, mark)
            watcher = _Watcher(jobs, out, workers, said)
            try:
                _run(plan, out, jobs, workers, watcher)
            except BaseException as error:
                watcher.log.say(f"interrupted: {type(error).__name__}")
                raise
            finally:
                # Workers end before the lock does, so that no other run meets them.
                workers.close()
                watcher.close()
    finally:
        workers.close()
    return watcher.outcomes()


def _run(plan: Plan, out: Path, jobs: StudyJobs, workers: Workers, watcher: _Watcher) -> None:
    def read(path: Path) -> tuple[Model, str]:
        sha = file_source("model", path).sha256
        return (jobs.models[path].open() if path in jobs.models else open_model(path)), sha

    found = run_jobs(jobs.jobs, jobs.homes, workers, read, watcher)
    last = [Job(GATHERED, partial(do_tables, plan=plan, outcomes=tuple(found[job.key] for job in jobs.jobs), out=out))]
    if plan.groups is not None:
        key = (f"{plan.groups.first[0]} and {plan.groups.second[0]}", "")
        last.insert(0, Job(key, partial(do_groups, plan=plan, out=out)))
    run_jobs(last, {job.key: out for job in last}, workers, read, watcher)


class _Watcher:
    """Keeps the outcomes, and tells of them: the table, the log and whoever called."""

    def __init__(self, jobs: StudyJobs, out: Path, workers: Workers, said: Callable[[Outcome], None]):
        self.out, self.said = out, said
        self.log = StudyLog(out)
        self.order: dict[Key, int] = {job.key: index for index, job in enumerate(jobs.jobs)}
        self.found: dict[Key, Outcome] = {}
        self.written = time.monotonic()
        memory = "" if workers.memory is None else f", {workers.memory / 2**30:.1f} GiB each"
        self.log.say(f"begin: Myomorph {__version__}, {len(jobs.jobs)} jobs, {workers.count} workers{memory}")

    def started(self, job: Job) -> None:
        self.log.say(f"start {_name(job.key)}")

    def lost(self, job: Job, why: str, again: bool) -> None:
        self.log.say(f"lost {_name(job.key)}: {why}; {'done again' if again else 'given up'}")

    def ended(self, outcome: Outcome) -> None:
        self.found[outcome.key] = outcome
        self.log.say(told(outcome))
        self.log.time(outcome)
        if outcome.key != GATHERED or outcome.error:
            self.said(outcome)
        if time.monotonic() - self.written > RARELY:
            with suppress(OSError):
                self.write()

    def idle(self) -> None:
        pass

    def outcomes(self) -> list[Outcome]:
        last = len(self.order)
        ordered = sorted(self.found.values(), key=lambda one: self.order.get(one.key, last))
        return [one for one in ordered if one.key != GATHERED or one.error]

    def write(self) -> None:
        write_table(self.outcomes(), self.out / TABLE)
        self.written = time.monotonic()

    def close(self) -> None:
        try:
            self.write()
        except OSError as error:
            reason = error.strerror or str(error)
            raise BadFile(self.out / TABLE, f"cannot be written ({reason})", "make room, then run again") from None
        finally:
            self.log.close()


def told(outcome: Outcome) -> str:
    """An outcome as a line of the log."""
    name = _name(outcome.key)
    computed = " ".join(step for step in outcome.done if step not in outcome.kept)
    parts = [f"computed {computed}"] if computed else []
    if outcome.kept:
        parts.append(f"kept {' '.join(outcome.kept)}")
    if outcome.changed:
        parts.append(f"because {', '.join(outcome.changed)}")
    if outcome.error:
        parts.append(outcome.error)
    return f"{'failed' if outcome.error else 'done'} {name}: {'; '.join((*parts, f'{outcome.seconds:.2f} s'))}"


def _name(key: Key) -> str:
    return "/".join(one for one in key if one) or "tables"


def write_table(outcomes: Sequence[Outcome], path: Path) -> None:
    """Write what became of every trial as a CSV file, whole or not at all."""
    text = io.StringIO(newline="")
    table = csv.writer(text, lineterminator="\n")
    heading = ("subject", "trial", "steps", "frames", "marker_rms_m", "marker_largest_m", "seconds", "error")
    table.writerow((*heading, "condition"))
    for one in outcomes:
        # Results that are to be equal byte for byte cannot hold how long they took.
        seconds = f"{one.seconds:.2f}" if fixed_date() is None else ""
        numbers = (one.frames, f"{one.rms:.6g}", f"{one.largest:.6g}", seconds)
        table.writerow((one.subject, one.trial, " ".join(one.done), *numbers, one.error, one.condition))
    temporary = path.with_name(f".{path.name}.part")
    try:
        temporary.write_text(text.getvalue(), encoding="utf-8")
        os.replace(temporary, path)
    except OSError:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)
        raise
