"""A plan as jobs: subjects, trials, and trials that are solved together, each after those it needs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from myomorph.study.job_work import do_subject, do_together, do_trial
from myomorph.study.jobs import Job, Key
from myomorph.study.locks import RunMark
from myomorph.study.plan import Plan
from myomorph.study.results import file_name
from myomorph.study.subjects import SUBJECT_STEPS, MadeModel, made_model
from myomorph.study.takes import FileTake


@dataclass(frozen=True)
class StudyJobs:
    """The jobs of a study, in the order of its file.

    Attributes
    ----------
    models : those that subjects' own steps make, by their file
    homes : where the results of each job go
    """

    jobs: tuple[Job, ...]
    models: dict[Path, MadeModel]
    homes: dict[Key, Path]


def jobs_of(plan: Plan, out: Path, fresh: bool = False, mark: RunMark | None = None) -> StudyJobs:
    """What a study has to do, apart from the tables that are made when all is done.

    Parameters
    ----------
    fresh : compute every step, whatever an earlier run left
    mark : the run that the folder belongs to
    """
    jobs: list[Job] = []
    models: dict[Path, MadeModel] = {}
    homes: dict[Key, Path] = {}
    used: dict[Key, FileTake] = {}
    made: dict[str, MadeModel] = {}
    for files, steps in zip(plan.takes, plan.steps, strict=True):
        home = out / file_name(files.subject)
        needs: tuple[Key, ...] = ()
        own = tuple(step for step in SUBJECT_STEPS if step in steps)
        if own:
            subject = plan.subjects[files.subject]
            key = (files.subject, "")
            if files.subject not in made:
                made[files.subject] = made_model(subject, own, home)
                models[made[files.subject].path] = made[files.subject]
                work = partial(
                    do_subject, files=subject, steps=own, settings=plan.settings, folder=home, fresh=fresh, mark=mark
                )
                jobs.append(Job(key, work))
                homes[key] = home
            needs = (key,)
            files = replace(files, model=made[files.subject].path)
        key = (files.subject, files.name)
        homes[key], used[key] = home / file_name(files.name), files
        work = partial(
            do_trial, files=files, steps=steps, settings=plan.settings, folder=homes[key], fresh=fresh, mark=mark
        )
        jobs.append(Job(key, work, needs, files.model))
    for one in plan.together:
        key = (one.name, one.name)
        keys = tuple(one.trials.items())
        parts = {trial[0]: used[trial] for trial in keys}
        homes[key] = out / file_name(one.name)
        known = {files.model: models[files.model] for files in parts.values() if files.model in models}
        work = partial(
            do_together,
            together=one,
            parts=parts,
            models=known,
            settings=plan.settings,
            out=out,
            fresh=fresh,
            mark=mark,
        )
        # Its parts' coordinates are enough: their later steps may fail, but their models must be there.
        needs = tuple(dict.fromkeys((name, "") for name in one.trials if (name, "") in homes))
        jobs.append(Job(key, work, needs, None, keys))
    return StudyJobs(tuple(jobs), models, homes)
