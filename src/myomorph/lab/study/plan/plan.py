"""A study file: what is to be done with which files, checked as a whole before anything runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from myomorph.core.model.errors import BadFile, listing
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.lab.store.named_files import existing
from myomorph.lab.store.outcome import Conditions, Excluded, Key
from myomorph.lab.store.results import file_name
from myomorph.lab.store.study_file import checked
from myomorph.lab.store.toml_file import read_toml, refuse
from myomorph.lab.study.inputs.keys import Notes, Place
from myomorph.lab.study.plan import plan_checks
from myomorph.lab.study.plan.conditions import Exclusions, with_conditions
from myomorph.lab.study.plan.groups import GroupPlan, group_members, groups_of, measured_groups
from myomorph.lab.study.plan.measures import Measures, read_measures
from myomorph.lab.study.plan.subject_tables import (
    Named,
    check_settings,
    given_options,
    lacking,
    merged,
    named_subjects,
    study_steps,
    study_tables,
)
from myomorph.lab.study.plan.subject_trials import located, measured, subject_files, subject_trials
from myomorph.lab.study.step.step_table import STEPS, usual_steps
from myomorph.lab.study.subject.subject_files import SubjectFiles
from myomorph.lab.study.trial.together import Together, together_of
from myomorph.lab.study.trial.trial_inputs import Settings, TrialFiles
from myomorph.lab.study.trial.uncertainty_file import with_uncertainty


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
    flat : results of the only subject lie in the results' folder itself, without a folder of its
        own
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
        """Return settings of the steps of a trial, or of the steps on a subject."""
        return self.own.get((subject, trial), self.own.get((subject, ""), self.settings))

    @cached_property
    def _steps(self) -> dict[str, tuple[str, ...]]:
        own: dict[str, set[str]] = {}
        for trial, steps in zip(self.trials, self.steps, strict=True):
            own.setdefault(trial.subject, set()).update(steps)
        return {
            subject: tuple(step for step in study_steps() if step in told)
            for subject, told in own.items()
        }

    def steps_of(self, subject: str) -> tuple[str, ...]:
        """All steps of a subject and its trials, in the order in which they run."""
        return self._steps.get(subject, ())

    def begins_with(self, subject: str) -> str:
        """Return the subject whose own steps make the model that this one begins with.

        It is "" where this one begins with a file.
        """
        return self.subjects[subject].model_of

    def maker(self, subject: str) -> str:
        """Return the subject whose own steps make the model that this one's trials use.

        It is "" where they use a file.
        """
        return (
            subject
            if plan_checks.makes_model(self.steps_of(subject))
            else self.begins_with(subject)
        )


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
        where it is no TOML, or with one list of all that is wrong: unknown keys and steps, values
        of the wrong kind, files that do not exist, patterns that match nothing, names that clash,
        subjects that wait for each other

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


class _Reading:
    """A study file while it is read.

    It has what the file says of all subjects, and its subjects and trials so far.

    `tables`: of the subjects, in the order of the file; `own`: settings where they differ from
    those for all.
    """

    def __init__(self, file: Any, home: Path, notes: Notes) -> None:
        self.file = file
        self.home = home
        self.notes = notes
        self.settings = given_options(file)
        check_settings(self.settings, "", notes.problems)
        self.common = located(file, "subject", Place(home, "study", notes))
        self.exclusions = Exclusions(file.exclude, notes.problems)
        named = named_subjects(file.subject, home, notes.problems, notes.remarks)
        self.names = list(dict.fromkeys(subject.name for subject in named))
        gone = [name for name in self.names if self.exclusions.leaves_out(name)]
        self.measures = self._measures(gone)
        self.trials: list[TrialFiles] = []
        self.steps: list[tuple[str, ...]] = []
        self.subjects: dict[str, SubjectFiles] = {}
        self.tables: dict[str, Named] = {}
        self.own: dict[Key, Settings] = {}
        for subject in named:
            if subject.name not in gone:
                self._add(subject)

    def _measures(self, gone: Sequence[str]) -> dict[str, Measures]:
        """Read the table of measures.

        It has a line for each subject that the study does not leave out.
        """
        given = self.file.study.measures
        problems = self.notes.problems
        remarks = self.notes.remarks
        path = existing(self.home, given, "study: measures", problems)
        if path is None:
            return {}
        before = len(problems)
        measures = read_measures(path, problems, remarks)
        if not measures and len(problems) > before:
            return {}
        for name in self.names:
            if name not in measures and name not in gone:
                problems.append(
                    f"{given}: has no line for subject '{name}': there are"
                    f" {listing(name, tuple(measures))}"
                )
        others = [name for name in measures if name not in self.names]
        if others:
            shown = ", ".join(others[:6]) + (" and others" if len(others) > 6 else "")
            remarks.append(f"{given}: lines of subjects that the study does not have: {shown}")
        return measures

    def _add(self, subject: Named) -> None:
        """Add a subject and its trials."""
        name = subject.name
        problems = self.notes.problems
        source = self.file.study.measures
        model = None
        if source is not None:
            table, model = measured(subject, self.measures.get(name), source, self.notes)
            subject = replace(subject, table=table)
        given = given_options(subject.table)
        whole = merged(self.settings, given)
        if given:
            self.own[name, ""] = whole
            check_settings(given, f"subject '{name}': ", problems)
        steps = tuple(step for step in study_steps() if step in subject.table.steps)
        trials = []
        for trial, told in subject_trials(
            subject, model, self.common, self.exclusions.leaves_out, self.notes
        ):
            trials.append(trial)
            if given or told:
                self.own[name, trial.name] = merged(whole, told)
                check_settings(told, f"subject '{name}': trial '{trial.name}': ", problems)
        files = subject_files(subject, model, tuple(trials), self.notes)
        if name in self.subjects and set(STEPS["subject"]) & {*steps, *self.steps_of(name)}:
            problems.append(f"subject '{name}' is given twice: put its trials into one table")
        if trials or not any(gone.subject == name for gone in self.exclusions.found):
            self.subjects[name] = files
        self.tables[name] = subject
        self.trials += trials
        self.steps += [steps] * len(trials)

    def steps_of(self, subject: str) -> list[str]:
        """All steps of a subject's trials."""
        each = zip(self.trials, self.steps, strict=True)
        return [step for trial, steps in each if trial.subject == subject for step in steps]

    def put_makers(self, steps: Mapping[str, Sequence[str]]) -> None:
        """Replace the subject that a model is of by the one whose steps make it.

        The file of the model is the one that the first maker began with.
        """
        makers = {name: plan_checks.maker_of(name, self.subjects, steps) for name in self.subjects}
        for name, maker in makers.items():
            if not maker:
                continue
            first = maker
            while makers[first]:
                first = makers[first]
            model = self.subjects[first].model
            self.trials = [
                replace(trial, model=model) if trial.subject == name else trial
                for trial in self.trials
            ]
            own = tuple(trial for trial in self.trials if trial.subject == name)
            self.subjects[name] = replace(
                self.subjects[name], model=model, model_of=maker, trials=own
            )

    def groups(self) -> GroupPlan | None:
        """Return which subjects are compared.

        The table `[groups]` says it, or the column of the table of measures.
        """
        file = self.file
        problems = self.notes.problems
        subjects = tuple(self.subjects)
        trials = {
            name: [trial.name for trial in self.trials if trial.subject == name]
            for name in subjects
        }
        if file.groups and file.study.compare:
            problems.append("study: compare and [groups] both name groups: give one of them")
        if file.groups:
            left_out = [name for name in self.names if name not in self.subjects]
            members = group_members(file.groups, subjects, left_out, problems)
        else:
            members = measured_groups(
                self.measures, subjects, file.study.compare, problems, self.notes.remarks
            )
        return groups_of(members, file.strides, trials, problems)


def _plan(file: Any, path: Path, notes: Notes) -> Plan:
    """Read the tables of a file as a plan, which is invalid where the notes have problems."""
    problems = notes.problems
    read = _Reading(file, path.parent, notes)
    excluded = read.exclusions.found
    read.exclusions.unused(read.names, read.trials, problems)
    if excluded and not read.trials and not problems:
        problems.append(
            f"exclude: nothing is left: {len(excluded)} subjects or trials are excluded, all of"
            " them"
        )
    steps = {name: read.steps_of(name) for name in read.subjects}
    plan_checks.check_masses(read.subjects, problems)
    plan_checks.check_names(
        read.trials, steps, [table.name for table in file.together], problems, file.study.flat
    )
    if file.study.flat and (len(read.subjects) != 1 or file.together or file.groups):
        problems.append("study: flat is for one subject, without [[together]] and [groups]")
    before = len(problems)
    plan_checks.check_makers(read.subjects, steps, problems)
    if len(problems) == before:
        read.put_makers(steps)
    plan_checks.check_model_names(read.trials, problems)
    own = {
        name: subject.table.conditions
        for name, subject in read.tables.items()
        if subject.table.conditions
    }
    trials, conditions = with_conditions(read.trials, file.study.conditions, own, excluded, notes)
    together = tuple(together_of(table, trials, path.parent, notes) for table in file.together)
    groups = read.groups()
    return Plan(
        name=file.study.name,
        path=path,
        trials=tuple(trials),
        steps=tuple(read.steps),
        settings=FrozenMap(read.settings),
        remarks=tuple(dict.fromkeys((*notes.remarks, *notes.found))),
        subjects=read.subjects,
        together=together,
        groups=groups,
        conditions=conditions,
        excluded=tuple(excluded),
        own=FrozenMap(read.own),
        flat=file.study.flat,
    )
