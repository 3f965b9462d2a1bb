"""What a run need not do: jobs whose results are there already, found without a worker for it."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from myomorph.model.model import Model
from myomorph.store.locks import RunMark, folder_lock
from myomorph.store.netcdf import open_netcdf
from myomorph.store.outcome import Outcome
from myomorph.store.results import STORED, file_name, file_source, made_from, stored_values
from myomorph.study.plan.plan import Plan
from myomorph.study.subject.subject_files import SubjectFiles
from myomorph.study.subject.subjects import kept_subject_steps
from myomorph.study.summary.page_key import groups_key, made_of
from myomorph.study.trial.kept_report import KEY, PAGE, report_key
from myomorph.study.trial.run_trial import PARTS, VALUES, clear_leftovers, with_results
from myomorph.study.trial.step import StepResults, step_of, step_provenance
from myomorph.study.trial.step_table import REPORT, STEPS
from myomorph.study.trial.trial_files import Settings, TrialFiles, read_trial
from myomorph.study.trial.trial_inputs import TrialInputs


def kept_trial(
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
        found = unchanged(read_trial(files, settings, model), steps, folder)
        return None if found is None else replace(found, condition=files.condition)

    return _looked(folder, mark, look)


def kept_subject(
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
        reasons = kept_subject_steps(files, steps, settings, folder)
        return None if any(reasons.values()) else Outcome(files.name, "", folder, tuple(reasons), tuple(reasons))

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


def kept_tables(model: Model | None, plan: Plan, outcomes: Sequence[Outcome], out: Path) -> Outcome | None:
    """The outcome of the tables of a study where they would come out the same, else None."""
    from myomorph.store.outcome import GATHERED
    from myomorph.study.summary.study_tables import PAGE, made_here

    if not (out / PAGE).is_file() or not made_of(out / PAGE, made_here(plan, outcomes, out)):
        return None
    return Outcome(*GATHERED, out, ("tables",), ("tables",))


def kept_groups(model: Model | None, plan: Plan, out: Path) -> Outcome | None:
    """The outcome of the comparison of groups where it would come out the same, else None."""
    from myomorph.study.summary.grouping import PAGE, TABLES

    assert plan.groups is not None
    made = [out / name for name in TABLES]
    if not (out / PAGE).is_file() or not made_of(out / PAGE, groups_key(plan.groups, plan.name, out, made)):
        return None
    return Outcome(f"{plan.groups.first[0]} and {plan.groups.second[0]}", "", out, ("groups",), ("groups",))
