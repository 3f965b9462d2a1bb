"""A plan as jobs: subjects, trials, and trials that are solved together, each after those it needs; and which of
them need no worker, since their results are there already.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from myomorph.identify.refine.options import RefineOptions
from myomorph.model.model import Model
from myomorph.store.locks import RunMark, folder_lock
from myomorph.store.netcdf import open_netcdf
from myomorph.store.outcome import GATHERED, Key, Outcome
from myomorph.store.results import STORED, file_name, file_source, made_from, stored_values
from myomorph.store.settings import TrialMotion, with_settings
from myomorph.study.plan.plan import Plan
from myomorph.study.run.job_work import do_subject, do_together, do_trial
from myomorph.study.run.jobs import Job
from myomorph.study.subject.subject_files import SUBJECT_STEPS, MadeModel, SubjectFiles, made_model
from myomorph.study.subject.subjects import reused_subject_steps, subject_notes
from myomorph.study.summary.page_key import groups_key, made_of
from myomorph.study.trial.open_trial import open_trial
from myomorph.study.trial.reuse import KEY, PAGE, report_key
from myomorph.study.trial.run_trial import PARTS, VALUES, clear_leftovers, with_results
from myomorph.study.trial.step import StepResults, step_of, step_provenance
from myomorph.study.trial.step_table import REPORT, STEPS
from myomorph.study.trial.together import Together
from myomorph.study.trial.trial_files import Settings, TrialFiles
from myomorph.study.trial.trial_inputs import TrialInputs


def reused_trial(
    model: Model | None,
    files: TrialFiles,
    steps: Sequence[str],
    settings: Settings,
    folder: Path,
    mark: RunMark | None = None,
    read: str = "",
) -> Outcome | None:
    """The outcome of a trial of which nothing would be computed, None for one that a worker must see.

    Parameters
    ----------
    read : hash of the model's file when the model was read, "" where that is not known
    """
    if not (folder / f"{file_name(files.name)}{STORED}").is_file():
        return None

    def look() -> Outcome | None:
        if read and file_source("model", files.model).sha256 != read:
            return None
        found = unchanged(open_trial(files, settings, model), steps, folder)
        return None if found is None else replace(found, condition=files.condition)

    return _looked(folder, mark, look)


def reused_subject(
    model: Model | None,
    files: SubjectFiles,
    steps: Sequence[str],
    settings: Settings,
    folder: Path,
    mark: RunMark | None = None,
) -> Outcome | None:
    """The same for a subject's own steps."""
    if not folder.is_dir():
        return None

    def look() -> Outcome | None:
        reasons = reused_subject_steps(files, steps, settings, folder)
        if any(reasons.values()):
            return None
        done = tuple(reasons)
        return Outcome(files.name, "", folder, done, done, findings=subject_notes(done, folder))

    return _looked(folder, mark, look)


def _looked(folder: Path, mark: RunMark | None, look: Callable[[], Outcome | None]) -> Outcome | None:
    """What is found while nobody else writes into a folder; a worker tells of whatever is wrong."""
    started = time.monotonic()
    try:
        with folder_lock(folder, mark, patience=0.0):
            found = look()
    except Exception:
        return None
    return None if found is None else replace(found, seconds=time.monotonic() - started)


def unchanged(trial: TrialInputs, steps: Sequence[str], folder: Path) -> Outcome | None:
    """The outcome of a trial whose folder is what a run would leave it as, None for any other."""
    stored = folder / f"{file_name(trial.name)}{STORED}"
    wanted = tuple(step for step in STEPS if step in steps)
    expected = [VALUES, PAGE] if REPORT in steps else [VALUES]
    if (folder / PARTS).exists() or not all((folder / name).is_file() for name in expected):
        return None
    own = [step_of(step) for step in wanted]
    with open_netcdf(stored) as file:
        earlier = made_from(file.attributes)
        # A step that nobody asks for now is for a run to keep or to remove.
        if set(earlier) != set(wanted) or file.attributes.get(KEY, "") != report_key(trial, wanted):
            return None
        if any(earlier[step.name].key != step_provenance(step, trial).key for step in own):
            return None
        telling = [step for step in own if step.outcome is not None]
        found = stored_values(stored, file, only=[name for step in telling for name in step.outcome_variables])
    clear_leftovers(folder)
    done = (*wanted, REPORT) if REPORT in steps else wanted
    outcome = Outcome(trial.subject, trial.name, folder, done, done)
    return with_results(outcome, StepResults(*(step.read(found, trial.options) for step in telling)))


def reused_tables(model: Model | None, plan: Plan, outcomes: Sequence[Outcome], out: Path) -> Outcome | None:
    """The outcome of the tables of a study where they would come out the same, else None."""
    # Needed at the end of a study only, not by its workers.
    from myomorph.study.summary.study_tables import PAGE, made_here

    if not (out / PAGE).is_file() or not made_of(out / PAGE, made_here(plan, outcomes, out)):
        return None
    return Outcome(*GATHERED, out, ("tables",), ("tables",))


def reused_groups(model: Model | None, plan: Plan, out: Path) -> Outcome | None:
    """The outcome of the comparison of groups where it would come out the same, else None."""
    # Needed at the end of a study only, not by its workers.
    from myomorph.study.summary.grouping import PAGE, TABLES

    assert plan.groups is not None
    made = [out / name for name in TABLES]
    if not (out / PAGE).is_file() or not made_of(out / PAGE, groups_key(plan.groups, plan.name, out, made)):
        return None
    return Outcome(f"{plan.groups.first[0]} and {plan.groups.second[0]}", "", out, ("groups",), ("groups",))


@dataclass(frozen=True)
class StudyJobs:
    """The jobs of a study, in the order of its file.

    Attributes
    ----------
    models : those that subjects' own steps make, by their file
    homes : where the results of each job go
    made : the models again, by the subject whose steps make them
    """

    jobs: tuple[Job, ...]
    models: dict[Path, MadeModel]
    homes: dict[Key, Path]
    made: dict[str, MadeModel]


def jobs_of(plan: Plan, out: Path, fresh: bool = False, mark: RunMark | None = None) -> StudyJobs:
    """What a study has to do, apart from the tables that are made when all is done.

    Parameters
    ----------
    fresh : compute every step, whatever an earlier run left
    mark : the run that the folder belongs to
    """
    found = _Jobs(plan, out, fresh, mark)
    for files, steps in zip(plan.trials, plan.steps, strict=True):
        found.trial(files, steps)
    for one in plan.together:
        found.together(one)
    models = {one.path: one for one in found.made.values()}
    return StudyJobs(tuple(found.jobs), models, found.homes, dict(found.made))


def with_made(files: TrialFiles, made: MadeModel, maker: str, settings: Settings) -> TrialFiles:
    """A trial with the model, the gains of EMG and the motion that a subject's own steps make.

    Electrodes and recordings are one subject's: those of a subject whose model another begins with are not the other's.

    Parameters
    ----------
    maker : subject whose steps they are
    settings : of the trial's subject
    """
    files = replace(files, model=made.path, error_sizes=made.sizes)
    if maker != files.subject:
        return files
    if made.gains is not None and files.emg is not None:
        files = replace(files, emg_gains=made.gains)
    given = settings.get("refine", {})
    if made.motions is not None and with_settings(TrialMotion(), given).use_motions:
        cutoff = with_settings(RefineOptions(), given).cutoff
        files = replace(files, refined=made.motions / f"{file_name(files.name)}.mot", refined_cutoff=cutoff)
    return files


@dataclass
class _Jobs:
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
        home, key = self.plan.home(self.out, name), (name, "")
        self.made[name], self.homes[key] = made_model(files, steps, home), home
        arguments: dict[str, Any] = {
            "files": files,
            "steps": steps,
            "settings": self.plan.settings_of(name),
            "folder": home,
            "mark": self.mark,
        }
        work, reused = partial(do_subject, **arguments, fresh=self.fresh), partial(reused_subject, **arguments)
        needs = ((self.plan.maker(begins), ""),) if begins else ()
        self.jobs.append(Job(key, work, needs, reused=None if self.fresh else reused))

    def trial(self, files: TrialFiles, steps: tuple[str, ...]) -> None:
        """Add a trial, and before the first of a subject its own steps."""
        maker, key = self.maker(files.subject), (files.subject, files.name)
        if maker:
            files = with_made(files, self.made[maker], maker, self.plan.settings_of(files.subject))
        self.homes[key] = self.plan.home(self.out, *key)
        self.used[key] = files
        arguments: dict[str, Any] = {
            "files": files,
            "steps": steps,
            "settings": self.plan.settings_of(*key),
            "folder": self.homes[key],
            "mark": self.mark,
        }
        work, reused = partial(do_trial, **arguments, fresh=self.fresh), partial(reused_trial, **arguments)
        needs = ((maker, ""),) if maker else ()
        self.jobs.append(Job(key, work, needs, files.model, reused=None if self.fresh else reused))

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
