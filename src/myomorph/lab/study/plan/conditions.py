"""In which condition trials were recorded, and which a study leaves out, by patterns of names."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase

from myomorph.core.model.errors import listing
from myomorph.lab.store.outcome import Conditions, Excluded
from myomorph.lab.study.inputs.keys import Notes
from myomorph.lab.study.plan.subject_tables import ExcludeTable, Patterns, as_list
from myomorph.lab.study.trial.trial_inputs import TrialFiles

MAX_NAMED = 6  # Trials that a remark names one by one.


class Exclusions:
    """What a study file leaves out (`found`, so far) while its subjects and trials are sought."""

    def __init__(self, tables: Sequence[ExcludeTable], problems: list[str]):
        self.tables = tables
        self.found: list[Excluded] = []
        self._used: set[int] = set()
        for number, table in enumerate(tables, 1):
            if not table.subject and not table.trial:
                problems.append(
                    f"exclude.{number}: names no subject and no trial: expected one of them, or"
                    " both"
                )
            if not table.reason.strip():
                problems.append(f"exclude.{number}: its reason is empty: give one")

    def leaves_out(self, subject: str, trial: str = "") -> bool:
        """Whether a trial is left out, or a subject with all its trials."""
        reasons = []
        for number, table in enumerate(self.tables):
            meant = bool(table.trial) == bool(trial) and (table.subject or table.trial)
            if (
                meant
                and fnmatchcase(subject, table.subject or "*")
                and fnmatchcase(trial, table.trial or "*")
            ):
                self._used.add(number)
                reasons.append(table.reason.strip())
        if reasons:
            self.found.append(Excluded(subject, trial, "; ".join(dict.fromkeys(reasons))))
        return bool(reasons)

    def unused(
        self, subjects: Sequence[str], trials: Sequence[TrialFiles], problems: list[str]
    ) -> None:
        """Add to the problems each table that leaves nothing out."""
        names_of: dict[str, list[str]] = {name: [] for name in subjects}
        for one in trials:
            names_of[one.subject].append(one.name)
        for number, table in enumerate(self.tables):
            if number in self._used or not (table.subject or table.trial):
                continue
            why = self._why_unused(table, names_of)
            problems.append(f"exclude.{number + 1} excludes nothing: {why}")

    def _why_unused(self, table: ExcludeTable, trials: Mapping[str, Sequence[str]]) -> str:
        """Say why a table leaves nothing out; `trials`: names by subject, of all subjects."""
        meant = [subject for subject in trials if fnmatchcase(subject, table.subject or "*")]
        if not meant:
            return f"no subject '{table.subject}': there are {listing(table.subject, [*trials])}"
        gone = {found.subject for found in self.found if not found.trial}
        if set(meant) <= gone:
            return f"subject '{table.subject}' is excluded as a whole already"
        names = list(dict.fromkeys(trial for name in meant for trial in trials[name]))
        whose = f"subject '{table.subject}'" if table.subject else "the study"
        return f"{whose} has no trial '{table.trial}': there are {listing(table.trial, names)}"


class _Patterns:
    """Patterns of names by condition.

    `own` ones are of subjects, those of the `study` are for subjects that have none. `used`: which
    of them (whose, condition, pattern) fit a trial that was considered.
    """

    def __init__(
        self, study: Mapping[str, Patterns], own: Mapping[str, Mapping[str, Patterns]]
    ) -> None:
        self.by_owner = {"": study, **own}
        self.used: set[tuple[str, str, str]] = set()

    def fitting(self, subject: str, trial: str) -> list[str]:
        """Conditions that a trial's name fits."""
        owner = subject if self.by_owner.get(subject) else ""
        names = []
        for name, patterns in self.by_owner[owner].items():
            fit = [pattern for pattern in as_list(patterns) if fnmatchcase(trial, pattern)]
            self.used.update((owner, name, pattern) for pattern in fit)
            names += [name] if fit else []
        return names

    def unmatched(self, trials: Sequence[TrialFiles]) -> Iterator[str]:
        """Yield a line on each pattern that fits none of the trials that were considered."""
        for owner, conditions in self.by_owner.items():
            where = f"subject '{owner}'" if owner else "study"
            own = (trial.name for trial in trials if owner in ("", trial.subject))
            names = tuple(dict.fromkeys(own))
            for name, patterns in conditions.items():
                for pattern in as_list(patterns):
                    if (owner, name, pattern) not in self.used:
                        yield (
                            f"{where}: conditions: '{name}': no trial matches '{pattern}': there"
                            f" are {listing(pattern, names)}"
                        )


def with_conditions(
    trials: Sequence[TrialFiles],
    study: Mapping[str, Patterns],
    own: Mapping[str, Mapping[str, Patterns]],
    excluded: Sequence[Excluded],
    notes: Notes,
) -> tuple[list[TrialFiles], Conditions]:
    """Return the trials with their conditions.

    A trial has the condition that its own table names, else that of a pattern of names, of `own` by
    subject or of the `study` for those that have none. A pattern may stand for trials that are
    `excluded`. What is wrong is added to the notes.
    """
    names = _names_of_conditions(trials, study, own)
    notes.problems += [
        f"subject '{subject}': conditions: '{name}' is none of the study's: {listing(name, names)}"
        for subject, conditions in own.items()
        for name in conditions
        if name not in names
    ]
    patterns = _Patterns(study, own)
    placed = [
        _placed(trial, patterns.fitting(trial.subject, trial.name), names, notes.problems)
        for trial in trials
    ]
    found = {
        (gone.subject, gone.trial): name
        for gone in excluded
        if gone.trial
        for name in patterns.fitting(gone.subject, gone.trial)
    }
    notes.problems += patterns.unmatched(trials)
    without = [f"{trial.subject}/{trial.name}" for trial in placed if not trial.condition]
    if names and without:
        others = " and others" if len(without) > MAX_NAMED else ""
        notes.remarks.append(f"in no condition: {', '.join(without[:MAX_NAMED])}{others}")
    found |= {(trial.subject, trial.name): trial.condition for trial in placed if trial.condition}
    return placed, Conditions(names, found)


def _names_of_conditions(
    trials: Sequence[TrialFiles],
    study: Mapping[str, Patterns],
    own: Mapping[str, Mapping[str, Patterns]],
) -> tuple[str, ...]:
    """Return the study's conditions; without any, those of subjects and of tables of trials."""
    of_subjects = [name for conditions in own.values() for name in conditions]
    of_trials = [trial.condition for trial in trials if trial.condition]
    return tuple(study) or tuple(dict.fromkeys([*of_subjects, *of_trials]))


def _placed(
    trial: TrialFiles, fits: Sequence[str], names: Sequence[str], problems: list[str]
) -> TrialFiles:
    """Return a trial with its condition, the one that it fits where its table names none."""
    where = f"subject '{trial.subject}': trial '{trial.name}'"
    if trial.condition:
        if trial.condition not in names:
            problems.append(
                f"{where}: unknown condition '{trial.condition}': there are"
                f" {listing(trial.condition, names)}"
            )
        return trial
    if len(fits) > 1:
        problems.append(f"{where} is in more than one condition: {', '.join(fits)}")
    return replace(trial, condition=fits[0]) if fits else trial
