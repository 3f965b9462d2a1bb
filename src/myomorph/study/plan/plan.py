"""A study file: what is to be done with which files, checked as a whole before anything runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from myomorph.model.errors import BadFile, listing
from myomorph.model.frozen_map import FrozenMap
from myomorph.store.outcome import Conditions, Excluded, Key
from myomorph.store.results import file_name
from myomorph.store.study_file import checked, existing, read_toml, refuse
from myomorph.study.inputs.keys import Notes, Place, WordOrFile
from myomorph.study.plan import plan_checks
from myomorph.study.plan.conditions import Exclusions, with_conditions
from myomorph.study.plan.groups import GroupPlan, group_members, groups_of, measured_groups
from myomorph.study.plan.measures import Measures, read_measures
from myomorph.study.plan.subject_tables import (
    Named,
    check_settings,
    given_options,
    lacking,
    merged,
    named_subjects,
    study_steps,
    study_tables,
)
from myomorph.study.plan.subject_trials import located, measured, subject_files, subject_trials
from myomorph.study.step.step_table import STEPS, usual_steps
from myomorph.study.subject.subject_files import SubjectFiles
from myomorph.study.trial.together import Together, together_of
from myomorph.study.trial.trial_inputs import Settings, TrialFiles
from myomorph.study.trial.uncertainty_file import with_uncertainty


@dataclass(frozen=True)
class Plan:
    """What a study does: one `TrialFiles` a trial, and the options of the steps.

    Attributes
    ----------
    name : of the study
    path : of the study file
    trials : recordings of all subjects
    settings : by step, what the study file says for all
    steps : of each trial, in the order in which they run
    subjects : by name, what the steps on subjects need
    together : trials of several subjects that are solved as one after their own steps
    remarks : old names, what is not used, then which files were found by the rule of names
    groups : two groups of subjects to compare when all is done
    conditions : of the trials
    excluded : what the study file leaves out, and why
    own : settings of a subject or a trial, those for all included, where these have any
    flat : results of the only subject lie in the results' folder itself, without a folder of its own
    """

    name: str
    path: Path
    trials: tuple[TrialFiles, ...]
    steps: tuple[tuple[str, ...], ...]
    settings: Settings = field(default_factory=lambda: FrozenMap({}))
    remarks: tuple[str, ...] = ()
    subjects: Mapping[str, SubjectFiles] = field(default_factory=lambda: FrozenMap({}))
    together: tuple[Together, ...] = ()
    groups: GroupPlan | None = None
    conditions: Conditions = field(default_factory=Conditions)
    excluded: tuple[Excluded, ...] = ()
    own: Mapping[Key, Settings] = field(default_factory=lambda: FrozenMap({}))
    flat: bool = False

    def home(self, out: Path, subject: str, trial: str = "") -> Path:
        """Folder of the results of a subject, or of one of its trials."""
        own = out if self.flat else out / file_name(subject)
        return own / file_name(trial) if trial else own

    def settings_of(self, subject: str, trial: str = "") -> Settings:
        """Settings of the steps of a trial, or of the steps on a subject."""
        return self.own.get((subject, trial), self.own.get((subject, ""), self.settings))

    @cached_property
    def _steps(self) -> dict[str, tuple[str, ...]]:
        own: dict[str, set[str]] = {}
        for trial, steps in zip(self.trials, self.steps, strict=True):
            own.setdefault(trial.subject, set()).update(steps)
        return {subject: tuple(step for step in study_steps() if step in told) for subject, told in own.items()}

    def steps_of(self, subject: str) -> tuple[str, ...]:
        """All steps of a subject and its trials, in the order in which they run."""
        return self._steps.get(subject, ())

    def begins_with(self, subject: str) -> str:
        """The subject whose own steps make the model that this one begins with, "" where it begins with a file."""
        return self.subjects[subject].model_of

    def maker(self, subject: str) -> str:
        """The subject whose own steps make the model that this one's trials use, "" where they use a file."""
        return subject if plan_checks.makes_model(self.steps_of(subject)) else self.begins_with(subject)


def read_plan(path: str | Path) -> Plan:
    """Read a study file; paths in it are relative to its folder, or to that of a subject.

    The keys are listed in docs/studies.md.

    Parameters
    ----------
    path : of the study file (TOML)

    Returns
    -------
    subjects, trials and steps with their options, all paths found

    Raises
    ------
    BadFile
        where it is no TOML, or with one list of all that is wrong: unknown keys and steps, values of the
        wrong kind, files that do not exist, patterns that match nothing, names that clash, subjects that wait for
        each other

    Examples
    --------
    >>> import myomorph as mm
    >>> plan = mm.read_plan("study.toml")
    >>> plan.name, list(plan.subjects), plan.steps[0]
    ('reaching', ['s01'], ('ik', 'id', 'muscles', 'tension'))
    """
    path = Path(path)
    raw = read_toml(path)
    if "specimen" in raw and "subject" not in raw:
        raise BadFile(path, "describes specimens, not subjects", "run it with 'myomorph viscosity'")
    found, problems = checked(study_tables(), with_uncertainty(raw, usual_steps()))
    absent = [one for one in lacking(raw) if one not in problems]
    problems = [*problems, *absent]
    if found is None or absent:
        refuse(path, problems)
    notes = Notes(problems)
    plan = _plan(found, path, notes)
    refuse(path, list(dict.fromkeys(notes.problems)))
    return plan


@dataclass
class _Subjects:
    """Subjects and trials while a study file is being read. `tables`: of the subjects, in the order of the file; `own`:
    settings where they differ from those for all.
    """

    trials: list[TrialFiles] = field(default_factory=list)
    steps: list[tuple[str, ...]] = field(default_factory=list)
    subjects: dict[str, SubjectFiles] = field(default_factory=dict)
    tables: dict[str, Named] = field(default_factory=dict)
    own: dict[Key, Settings] = field(default_factory=dict)

    def steps_of(self, subject: str) -> list[str]:
        """All steps of a subject's trials."""
        return [
            step for trial, own in zip(self.trials, self.steps, strict=True) if trial.subject == subject for step in own
        ]


def _plan(file: Any, path: Path, notes: Notes) -> Plan:
    """The tables of a file as a plan; worth nothing where the notes have problems."""
    problems, home = notes.problems, path.parent
    settings = given_options(file)
    check_settings(settings, "", problems)
    common = located(file, "subject", Place(home, "study", notes))
    exclusions = Exclusions(file.exclude, problems)
    named = named_subjects(file.subject, home, problems, notes.remarks)
    names = list(dict.fromkeys(one.name for one in named))
    gone = [name for name in names if exclusions.subject(name)]
    measures = _measures(file.study.measures, home, names, gone, notes)
    found = _Subjects()
    for one in named:
        if one.name not in gone:
            _add(one, found, measures, file.study.measures, settings, common, exclusions, notes)
    exclusions.unused(names, found.trials, problems)
    if exclusions.found and not found.trials and not problems:
        problems.append(
            f"exclude: nothing is left: {len(exclusions.found)} subjects or trials are excluded, all of them"
        )
    steps = {name: found.steps_of(name) for name in found.subjects}
    plan_checks.check_masses(found.subjects, problems)
    plan_checks.check_names(found.trials, steps, [one.name for one in file.together], problems, file.study.flat)
    if file.study.flat and (len(found.subjects) != 1 or file.together or file.groups):
        problems.append("study: flat is for one subject, without [[together]] and [groups]")
    before = len(problems)
    plan_checks.check_makers(found.subjects, steps, problems)
    if len(problems) == before:
        _with_makers(found, steps)
    plan_checks.check_model_names(found.trials, problems)
    told = {name: table.table.conditions for name, table in found.tables.items() if table.table.conditions}
    trials, conditions = with_conditions(
        found.trials, file.study.conditions, told, exclusions.found, problems, notes.remarks
    )
    together = tuple(_together(file, trials, home, notes))
    groups = _groups(file, found, measures, [name for name in names if name not in found.subjects], notes)
    return Plan(
        file.study.name,
        path,
        tuple(trials),
        tuple(found.steps),
        FrozenMap(settings),
        tuple(dict.fromkeys((*notes.remarks, *notes.found))),
        found.subjects,
        together,
        groups,
        conditions,
        tuple(exclusions.found),
        FrozenMap(found.own),
        file.study.flat,
    )


def _measures(
    given: str | None, home: Path, names: Sequence[str], gone: Sequence[str], notes: Notes
) -> dict[str, Measures]:
    """The table of measures, with a line for each subject that the study does not leave out."""
    path = existing(home, given, "study: measures", notes.problems)
    if path is None:
        return {}
    before = len(notes.problems)
    measures = read_measures(path, notes.problems, notes.remarks)
    if not measures and len(notes.problems) > before:
        return {}
    for name in names:
        if name not in measures and name not in gone:
            notes.problems.append(
                f"{given}: has no line for subject '{name}': there are {listing(name, tuple(measures))}"
            )
    others = [name for name in measures if name not in names]
    if others:
        shown = ", ".join(others[:6]) + (" and others" if len(others) > 6 else "")
        notes.remarks.append(f"{given}: lines of subjects that the study does not have: {shown}")
    return measures


def _add(
    one: Named,
    subjects: _Subjects,
    measures: Mapping[str, Measures],
    source: str | None,
    settings: Settings,
    common: Mapping[str, Any],
    exclusions: Exclusions,
    notes: Notes,
) -> None:
    """Add a subject and its trials."""
    model = None
    if source is not None:
        table, model = measured(one, measures.get(one.name), source, notes)
        one = replace(one, table=table)
    given = given_options(one.table)
    whole = merged(settings, given)
    if given:
        subjects.own[one.name, ""] = whole
        check_settings(given, f"subject '{one.name}': ", notes.problems)
    steps = tuple(step for step in study_steps() if step in one.table.steps)
    trials = []
    for trial, told in subject_trials(one, model, common, exclusions.trial, notes):
        trials.append(trial)
        if given or told:
            subjects.own[one.name, trial.name] = merged(whole, told)
            check_settings(told, f"subject '{one.name}': trial '{trial.name}': ", notes.problems)
    files = subject_files(one, model, tuple(trials), notes)
    if one.name in subjects.subjects and set(STEPS["subject"]) & {*steps, *subjects.steps_of(one.name)}:
        notes.problems.append(f"subject '{one.name}' is there twice: put its trials into one table")
    if trials or not any(gone.subject == one.name for gone in exclusions.found):
        subjects.subjects[one.name] = files
    subjects.tables[one.name] = one
    subjects.trials += trials
    subjects.steps += [steps] * len(trials)


def _with_makers(subjects: _Subjects, steps: Mapping[str, Sequence[str]]) -> None:
    """Put who makes a model in the place of who is named, and the file that it began with in that of none."""
    makers = {name: plan_checks.maker_of(name, subjects.subjects, steps) for name in subjects.subjects}
    for name, maker in makers.items():
        if not maker:
            continue
        first = maker
        while makers[first]:
            first = makers[first]
        model = subjects.subjects[first].model
        subjects.trials = [replace(trial, model=model) if trial.subject == name else trial for trial in subjects.trials]
        own = tuple(trial for trial in subjects.trials if trial.subject == name)
        subjects.subjects[name] = replace(subjects.subjects[name], model=model, model_of=maker, trials=own)


def _together(file: Any, trials: Sequence[TrialFiles], home: Path, notes: Notes) -> list[Together]:
    """Trials of several subjects that are solved as one."""
    result = []
    for one in file.together:
        contacts = WordOrFile().located("contacts", one.contacts, Place(home, f"together '{one.name}'", notes))
        result.append(together_of(one, trials, home, contacts, notes.problems))
    return result


def _groups(
    file: Any, found: _Subjects, measures: Mapping[str, Measures], gone: Sequence[str], notes: Notes
) -> GroupPlan | None:
    """Which subjects are compared: by the table `[groups]`, or by the column of the table of measures."""
    subjects = tuple(found.subjects)
    trials = {name: [trial.name for trial in found.trials if trial.subject == name] for name in subjects}
    if file.groups and file.study.compare:
        notes.problems.append("study: compare and [groups] both name groups: give one of them")
    if file.groups:
        members = group_members(file.groups, subjects, gone, notes.problems)
    else:
        members = measured_groups(measures, subjects, file.study.compare, notes.problems, notes.remarks)
    return groups_of(members, file.strides, trials, notes.problems)
