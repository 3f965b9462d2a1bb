"""What the jobs of a study do, each in whatever process it is sent to; files are read where it runs."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from myomorph.model.errors import BadData
from myomorph.model.model import Model
from myomorph.motion.sync import cut
from myomorph.store.locks import RunMark, folder_lock
from myomorph.store.outcome import GATHERED, Key, Outcome, failed
from myomorph.store.results import STORED, file_name, file_source, read_result
from myomorph.study.inputs.reading import open_model
from myomorph.study.plan.plan import Plan
from myomorph.study.subject.subject_files import MadeModel, SubjectFiles
from myomorph.study.subject.subjects import prepare_subject, subject_notes
from myomorph.study.trial.open_trial import open_trial
from myomorph.study.trial.run_trial import run_trial
from myomorph.study.trial.step import StepResults, large_variables
from myomorph.study.trial.steps import ik
from myomorph.study.trial.together import TOGETHER_STEPS, Part, Together, join_trials, object_part
from myomorph.study.trial.trial_files import Settings, TrialFiles


def _alone(outcome: Outcome, mark: RunMark | None, work: Callable[[Outcome], Outcome]) -> Outcome:
    """Do what one process may do at a time in the outcome's folder; an error ends it, but not the study."""
    started = time.monotonic()
    try:
        with folder_lock(outcome.folder, mark):
            found = work(outcome)
    except Exception as error:
        found = failed(outcome, error)
    return replace(found, subject=outcome.subject, condition=outcome.condition, seconds=time.monotonic() - started)


def do_trial(
    model: Model | None,
    files: TrialFiles,
    steps: Sequence[str],
    settings: Settings,
    folder: Path,
    fresh: bool = False,
    mark: RunMark | None = None,
    read: str = "",
) -> Outcome:
    """One trial through its steps.

    Parameters
    ----------
    read : hash of the model's file when the model was read, "" where that is not known
    """

    def work(outcome: Outcome) -> Outcome:
        if read and file_source("model", files.model).sha256 != read:
            raise BadData(f"{files.model}: has changed while the study ran: run it again")
        trial = open_trial(files, settings, model)
        check = (lambda: None) if mark is None else mark.check
        return run_trial(trial, steps, folder, fresh, check=check)

    return _alone(Outcome(files.subject, files.name, folder, condition=files.condition), mark, work)


def do_subject(
    model: Model | None,
    files: SubjectFiles,
    steps: Sequence[str],
    settings: Settings,
    folder: Path,
    fresh: bool = False,
    mark: RunMark | None = None,
) -> Outcome:
    """A subject's own steps, which make the model of its trials."""

    def work(outcome: Outcome) -> Outcome:
        made = prepare_subject(files, steps, settings, folder, fresh)
        notes = subject_notes(made.done, folder)
        return replace(
            outcome, done=made.done, reused=made.reused, changed=made.changed, timed=made.timed, findings=notes
        )

    return _alone(Outcome(files.name, "", folder), mark, work)


def do_together(
    model: Model | None,
    together: Together,
    parts: Mapping[str, TrialFiles],
    models: Mapping[Path, MadeModel],
    settings: Mapping[str, Settings],
    common: Settings,
    out: Path,
    fresh: bool = False,
    mark: RunMark | None = None,
) -> Outcome:
    """Several trials as one, from the coordinates that their own steps found.

    Parameters
    ----------
    parts : by the name of the part, its recording
    models : by file, those of the parts that a subject's own steps made
    settings, common : settings of the steps for each part, and of all as one
    """
    folder = out / file_name(together.name)

    def work(outcome: Outcome) -> Outcome:
        opened: dict[Path, Model] = {}
        joined: dict[str, Part] = {}
        for subject, files in parts.items():
            if files.model not in opened:
                opened[files.model] = models[files.model].open() if files.model in models else open_model(files.model)
            stored = out / file_name(subject) / file_name(files.name) / f"{file_name(files.name)}{STORED}"
            trial = open_trial(files, settings[subject], opened[files.model])
            found = ik.STEP.read(read_result(stored, leave_out=large_variables()), trial.options)
            if found is None:
                raise BadData(f"{stored}: holds no coordinates: run the step 'ik' of subject '{subject}' first")
            recorded = found.recorded if trial.time is None else cut(found.recorded, *trial.time)
            joined[subject] = Part(trial, recorded, str(files.model))
        joined |= {table.name: object_part(table, path) for table, path in together.objects}
        trial, poses = join_trials(together, joined, common)
        check = (lambda: None) if mark is None else mark.check
        return run_trial(trial, TOGETHER_STEPS, folder, fresh, StepResults(poses), check)

    return _alone(Outcome(together.name, together.name, folder), mark, work)


def do_groups(model: Model | None, plan: Plan, out: Path) -> Outcome:
    """Two groups compared, from the results of their subjects' trials."""
    # Needed at the end of a study only, not by its workers.
    from myomorph.study.summary.grouping import compare_stored

    assert plan.groups is not None
    started = time.monotonic()
    outcome = Outcome(f"{plan.groups.first[0]} and {plan.groups.second[0]}", "", out)
    try:
        compare_stored(plan.groups, out, plan.name)
        outcome = replace(outcome, done=("groups",))
    except Exception as error:
        outcome = failed(outcome, error, "groups")
    return replace(outcome, seconds=time.monotonic() - started)


def do_tables(model: Model | None, plan: Plan, outcomes: Sequence[Outcome], out: Path) -> Outcome:
    """The tables and the report of the whole study, from the results of its trials."""
    # Needed at the end of a study only, not by its workers.
    from myomorph.study.summary.study_tables import gather_study

    started = time.monotonic()
    outcome = Outcome(*GATHERED, out)
    try:
        gather_study(plan, outcomes, out)
        outcome = replace(outcome, done=("tables",))
    except Exception as error:
        outcome = failed(outcome, error, "tables")
    return replace(outcome, seconds=time.monotonic() - started)


def not_run(key: Key, folder: Path, why: str, like: Outcome | None = None) -> Outcome:
    """The outcome of a job that could not begin.

    Parameters
    ----------
    like : the outcome that kept it from beginning
    """
    return Outcome(*key, folder, error=f"not run: {why}", fault=like is not None and like.fault)
