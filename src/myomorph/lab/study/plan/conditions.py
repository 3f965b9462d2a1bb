"""In which condition trials were recorded, and which a study leaves out, by patterns of names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase

from myomorph.core.model.errors import listing
from myomorph.lab.store.outcome import Conditions, Excluded
from myomorph.lab.study.plan.subject_tables import ExcludeTable, Patterns, as_list
from myomorph.lab.study.trial.trial_inputs import TrialFiles


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
                problems.append(f"exclude.{number}: its reason is empty: say why")

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
        gone = {found.subject for found in self.found if not found.trial}
        for number, table in enumerate(self.tables):
            if number in self._used or not (table.subject or table.trial):
                continue
            where = f"exclude.{number + 1} excludes nothing"
            meant = [subject for subject in subjects if fnmatchcase(subject, table.subject or "*")]
            if not meant:
                problems.append(
                    f"{where}: no subject '{table.subject}': there are"
                    f" {listing(table.subject, subjects)}"
                )
            elif set(meant) <= gone:
                problems.append(
                    f"{where}: subject '{table.subject}' is excluded as a whole already"
                )
            else:
                names = list(dict.fromkeys(trial for name in meant for trial in names_of[name]))
                whose = f"subject '{table.subject}'" if table.subject else "the study"
                problems.append(
                    f"{where}: {whose} has no trial '{table.trial}': there are"
                    f" {listing(table.trial, names)}"
                )


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


def with_conditions(
    trials: Sequence[TrialFiles],
    study: Mapping[str, Patterns],
    own: Mapping[str, Mapping[str, Patterns]],
    excluded: Sequence[Excluded],
    problems: list[str],
    remarks: list[str],
) -> tuple[list[TrialFiles], Conditions]:
    """Return the trials with their conditions.

    A trial has the condition that its own table names, else that of a pattern of names, of `own` by
    subject or of the `study` for those that have none. A pattern may stand for trials that are
    `excluded`.
    """
    named = [trial.condition for trial in trials if trial.condition]
    names = tuple(study) or tuple(
        dict.fromkeys([*(name for some in own.values() for name in some), *named])
    )
    for subject, conditions in own.items():
        for name in conditions:
            if name not in names:
                problems.append(
                    f"subject '{subject}': conditions: '{name}' is none of the study's:"
                    f" {listing(name, names)}"
                )
    patterns = _Patterns(study, own)
    placed = [
        _placed(trial, patterns.fitting(trial.subject, trial.name), names, problems)
        for trial in trials
    ]
    found = {}
    for gone in excluded:
        for name in patterns.fitting(gone.subject, gone.trial) if gone.trial else ():
            found[gone.subject, gone.trial] = name
    for owner, conditions in patterns.by_owner.items():
        where = f"subject '{owner}'" if owner else "study"
        exist = tuple(dict.fromkeys(trial.name for trial in trials if owner in ("", trial.subject)))
        problems += [
            f"{where}: conditions: '{name}': no trial matches '{pattern}': there are"
            f" {listing(pattern, exist)}"
            for name, some in conditions.items()
            for pattern in as_list(some)
            if (owner, name, pattern) not in patterns.used
        ]
    without = [f"{trial.subject}/{trial.name}" for trial in placed if not trial.condition]
    if names and without:
        remarks.append(
            f"in no condition: {', '.join(without[:6])}"
            + (" and others" if len(without) > 6 else "")
        )
    found |= {(trial.subject, trial.name): trial.condition for trial in placed if trial.condition}
    return placed, Conditions(names, found)


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
