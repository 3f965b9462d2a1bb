"""Run a study: every trial through its steps, what failed by name, the rest whole."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from myomorph.model.errors import BadData
from myomorph.model.model import Model
from myomorph.store.locks import study_lock
from myomorph.store.outcome import GATHERED, Outcome
from myomorph.store.results import file_source
from myomorph.study.plan.plan import Plan
from myomorph.study.run.job_plan import StudyJobs, jobs_of
from myomorph.study.run.job_work import do_groups, do_tables
from myomorph.study.run.jobs import Job, Workers
from myomorph.study.run.kept_work import kept_groups, kept_tables
from myomorph.study.run.local_workers import InProcess
from myomorph.study.run.schedule import run_jobs
from myomorph.study.run.watching import StudyWatcher
from myomorph.study.trial.inputs import open_model


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

    What a study is and what it writes is described in docs/studies.md.

    Parameters
    ----------
    plan : as `read_plan` reads it
    out : folder of the results, made where it does not exist
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

    Examples
    --------
    >>> from pathlib import Path
    >>> import myomorph as mm
    >>> outcomes = mm.run_study(mm.read_plan("study.toml"), Path("results"))
    >>> len(outcomes), sorted(mm.load("results"))
    (1, ['s01/reach'])
    """
    workers = workers or InProcess()
    try:
        with study_lock(out) as mark:
            jobs = jobs_of(plan, out, fresh, mark)
            watcher = StudyWatcher(plan.name, jobs, out, workers, said)
            try:
                _run(plan, out, fresh, jobs, workers, watcher)
            except BaseException as error:
                watcher.interrupted(error)
                raise
            finally:
                # Workers end before the lock does, so that no other run meets them.
                workers.close()
                watcher.close()
    finally:
        workers.close()
    return watcher.outcomes()


def _run(plan: Plan, out: Path, fresh: bool, jobs: StudyJobs, workers: Workers, watcher: StudyWatcher) -> None:
    """All jobs, then the tables of the study, which tell of failures, too."""

    def read(path: Path) -> tuple[Model, str]:
        sha = file_source("model", path).sha256
        model = jobs.models[path].open() if path in jobs.models else open_model(path)
        if file_source("model", path).sha256 != sha:
            raise BadData(f"{path}: has changed while it was read: run the study again")
        return model, sha

    found = run_jobs(jobs.jobs, jobs.homes, workers, read, watcher)
    outcomes = tuple(found[job.key] for job in jobs.jobs)
    made: dict[str, Any] = {"plan": plan, "outcomes": outcomes, "out": out}
    kept = None if fresh else partial(kept_tables, **made)
    last = [Job(GATHERED, partial(do_tables, **made), kept=kept)]
    if plan.groups is not None:
        key = (f"{plan.groups.first[0]} and {plan.groups.second[0]}", "")
        compared = None if fresh else partial(kept_groups, plan=plan, out=out)
        last.insert(0, Job(key, partial(do_groups, plan=plan, out=out), kept=compared))
    run_jobs(last, {job.key: out for job in last}, workers, read, watcher)
