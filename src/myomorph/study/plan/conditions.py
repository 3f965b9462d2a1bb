"""In which condition trials were recorded, and which a study leaves out, by patterns of names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase

from myomorph.model.errors import listing
from myomorph.store.outcome import Conditions, Excluded
from myomorph.study.plan.subject_tables import ExcludeTable, Patterns, as_list
from myomorph.study.trial.trial_inputs import TrialFiles


class Exclusions:
    """What a study file leaves out (`found`, so far), while its subjects and trials are looked for."""

    def __init__(self, tables: Sequence[ExcludeTable], problems: list[str]):
        self.tables = tables
        self.found: list[Excluded] = []
        self._used: set[int] = set()
        for number, table in enumerate(tables, 1):
            if not table.subject and not table.trial:
                problems.append(f"exclude.{number}: names no subject and no trial: expected one of them, or both")
            if not table.reason.strip():
                problems.append(f"exclude.{number}: its reason is empty: say why")

    def subject(self, name: str) -> bool:
        """Whether a subject is left out with all its trials."""
        return self._left_out(name, "")

    def trial(self, subject: str, name: str) -> bool:
        """Whether a trial is left out."""
        return self._left_out(subject, name)

    def _left_out(self, subject: str, trial: str) -> bool:
        reasons = []
        for number, table in enumerate(self.tables):
            meant = bool(table.trial) == bool(trial) and (table.subject or table.trial)
            if meant and fnmatchcase(subject, table.subject or "*") and fnmatchcase(trial, table.trial or "*"):
                self._used.add(number)
                reasons.append(table.reason.strip())
        if reasons:
            self.found.append(Excluded(subject, trial, "; ".join(dict.fromkeys(reasons))))
        return bool(reasons)

    def unused(self, subjects: Sequence[str], trials: Sequence[TrialFiles], problems: list[str]) -> None:
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
                problems.append(f"{where}: no subject '{table.subject}': there are {listing(table.subject, subjects)}")
            elif set(meant) <= gone:
                problems.append(f"{where}: subject '{table.subject}' is excluded as a whole already")
            else:
                names = list(dict.fromkeys(trial for name in meant for trial in names_of[name]))
                whose = f"subject '{table.subject}'" if table.subject else "the study"
                problems.append(
                    f"{where}: {whose} has no trial '{table.trial}': there are {listing(table.trial, names)}"
                )


def with_conditions(
    trials: Sequence[TrialFiles],
    study: Mapping[str, Patterns],
    own: Mapping[str, Mapping[str, Patterns]],
    excluded: Sequence[Excluded],
    problems: list[str],
    remarks: list[str],
) -> tuple[list[TrialFiles], Conditions]:
    """The trials with their conditions: what their own table says, else what a pattern of names says, of `own` by
    subject or of the `study` for those that have none. A pattern may stand for trials that are `excluded`.
    """
    named = [trial.condition for trial in trials if trial.condition]
    names = tuple(study) or tuple(dict.fromkeys([*(name for one in own.values() for name in one), *named]))
    for subject, conditions in own.items():
        for name in conditions:
            if name not in names:
                problems.append(
                    f"subject '{subject}': conditions: '{name}' is none of the study's: {listing(name, names)}"
                )
    used: set[tuple[str, str, str]] = set()
    placed = [_placed(trial, study, own.get(trial.subject, {}), names, used, problems) for trial in trials]
    found = {}
    for gone in excluded:
        for name in (own.get(gone.subject) or study) if gone.trial else ():
            if _matches(gone.subject, gone.trial, name, own.get(gone.subject) or {}, study, used):
                found[gone.subject, gone.trial] = name
    for owner, conditions in (("", study), *own.items()):
        where = f"subject '{owner}'" if owner else "study"
        exist = tuple(dict.fromkeys(trial.name for trial in trials if owner in ("", trial.subject)))
        problems += [
            f"{where}: conditions: '{name}': no trial matches '{pattern}': there are {listing(pattern, exist)}"
            for name, patterns in conditions.items()
            for pattern in as_list(patterns)
            if (owner, name, pattern) not in used
        ]
    without = [f"{one.subject}/{one.name}" for one in placed if not one.condition]
    if names and without:
        remarks.append(f"in no condition: {', '.join(without[:6])}" + (" and others" if len(without) > 6 else ""))
    found |= {(one.subject, one.name): one.condition for one in placed if one.condition}
    return placed, Conditions(names, found)


def _placed(
    trial: TrialFiles,
    study: Mapping[str, Patterns],
    own: Mapping[str, Patterns],
    names: Sequence[str],
    used: set[tuple[str, str, str]],
    problems: list[str],
) -> TrialFiles:
    """A trial with its condition."""
    where = f"subject '{trial.subject}': trial '{trial.name}'"
    fits = [name for name in (own or study) if _matches(trial.subject, trial.name, name, own, study, used)]
    if trial.condition:
        if trial.condition not in names:
            problems.append(
                f"{where}: unknown condition '{trial.condition}': there are {listing(trial.condition, names)}"
            )
        return trial
    if len(fits) > 1:
        problems.append(f"{where} is in more than one condition: {', '.join(fits)}")
    return replace(trial, condition=fits[0]) if fits else trial


def _matches(
    subject: str,
    trial: str,
    name: str,
    own: Mapping[str, Patterns],
    study: Mapping[str, Patterns],
    used: set[tuple[str, str, str]],
) -> bool:
    """Whether a trial's name fits a condition; patterns that fit are noted as used."""
    fit = [pattern for pattern in as_list((own or study)[name]) if fnmatchcase(trial, pattern)]
    used.update((subject if own else "", name, pattern) for pattern in fit)
    return bool(fit)
