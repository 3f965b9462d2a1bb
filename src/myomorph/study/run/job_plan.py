"""A plan as jobs: subjects, trials, and trials that are solved together, each after those it needs."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from myomorph.store.locks import RunMark
from myomorph.store.outcome import Key
from myomorph.store.results import file_name
from myomorph.study.plan.plan import Plan
from myomorph.study.run.job_work import do_subject, do_together, do_trial
from myomorph.study.run.jobs import Job
from myomorph.study.run.kept_work import kept_subject, kept_trial
from myomorph.study.subject.subject_files import SUBJECT_STEPS, MadeModel, made_model
from myomorph.study.trial.together import Together
from myomorph.study.trial.trial_files import TrialFiles


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
    found = _Found(plan, out, fresh, mark)
    for files, steps in zip(plan.trials, plan.steps, strict=True):
        found.trial(files, steps)
    for one in plan.together:
        found.together(one)
    return StudyJobs(tuple(found.jobs), {one.path: one for one in found.made.values()}, found.homes)


@dataclass
class _Found:
    """The jobs so far, in their order."""

    plan: Plan
    out: Path
    fresh: bool
    mark: RunMark | None
    jobs: list[Job] = field(default_factory=list)
    homes: dict[Key, Path] = field(default_factory=dict)
    made: dict[str, MadeModel] = field(default_factory=dict)
    used: dict[Key, TrialFiles] = field(default_factory=dict)

    def maker(self, subject: str) -> str:
        """The subject whose own steps make the model that trials use, its job among the jobs; "" for a file."""
        maker = self.plan.maker(subject) if subject in self.plan.subjects else ""
        if maker and maker not in self.made:
            self._subject(maker)
        return maker

    def _subject(self, name: str) -> None:
        files = self.plan.subjects[name]
        begins = self.plan.begins_with(name)
        if begins:
            begin = self.made[self.maker(begins)]
            files = replace(files, model=begin.path, drawn=begin.drawn)
        steps = tuple(step for step in SUBJECT_STEPS if step in self.plan.steps_of(name))
        home, key = self.out / file_name(name), (name, "")
        self.made[name], self.homes[key] = made_model(files, steps, home), home
        told: dict[str, Any] = {
            "files": files,
            "steps": steps,
            "settings": self.plan.settings_of(name),
            "folder": home,
            "mark": self.mark,
        }
        work, kept = partial(do_subject, **told, fresh=self.fresh), partial(kept_subject, **told)
        needs = ((self.plan.maker(begins), ""),) if begins else ()
        self.jobs.append(Job(key, work, needs, kept=None if self.fresh else kept))

    def trial(self, files: TrialFiles, steps: tuple[str, ...]) -> None:
        """Add a trial, and before the first of a subject its own steps."""
        maker, key = self.maker(files.subject), (files.subject, files.name)
        if maker:
            files = replace(files, model=self.made[maker].path)
        self.homes[key] = self.out / file_name(files.subject) / file_name(files.name)
        self.used[key] = files
        told: dict[str, Any] = {
            "files": files,
            "steps": steps,
            "settings": self.plan.settings_of(*key),
            "folder": self.homes[key],
            "mark": self.mark,
        }
        work, kept = partial(do_trial, **told, fresh=self.fresh), partial(kept_trial, **told)
        needs = ((maker, ""),) if maker else ()
        self.jobs.append(Job(key, work, needs, files.model, kept=None if self.fresh else kept))

    def together(self, one: Together) -> None:
        """Add trials that are solved as one, after these.

        Their coordinates are enough: their later steps may fail, but their models must be there.
        """
        key, keys = (one.name, one.name), tuple(one.trials.items())
        parts = {trial[0]: self.used[trial] for trial in keys}
        made = {model.path: model for model in self.made.values()}
        makers = dict.fromkeys(self.maker(name) for name in one.trials)
        self.homes[key] = self.out / file_name(one.name)
        work = partial(
            do_together,
            together=one,
            parts=parts,
            models={files.model: made[files.model] for files in parts.values() if files.model in made},
            settings={trial[0]: self.plan.settings_of(*trial) for trial in keys},
            common=self.plan.settings,
            out=self.out,
            fresh=self.fresh,
            mark=self.mark,
        )
        self.jobs.append(Job(key, work, tuple((maker, "") for maker in makers if maker), None, keys))
