"""Which results of an earlier run still hold: what has changed in how a step is made, and in what the report says."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path, PurePath

from myomorph import __version__
from myomorph.model.provenance import Provenance, Source
from myomorph.store.netcdf import open_netcdf
from myomorph.store.results import DAMAGED, STORED, ResultWriter, file_name, value_source
from myomorph.store.settings import ReportOptions, plain_settings
from myomorph.study.trial.step import step_of, step_provenance
from myomorph.study.trial.trial_inputs import TrialInputs

NEVER = "is not computed yet"
"""Why a step is computed of which there is no result."""

MOST = 60
"""Longest value that is reported whole [characters]."""
KEY = "report_key"
PAGE = "report.html"


def changes(before: Provenance, after: Provenance) -> tuple[str, ...]:
    """Why a result that was made one way would come out otherwise the other way, one line each.

    Returns
    -------
    () where the keys are equal: "model generic.osim has changed", "ik.tolerance 1e-05 -> 0.0001",
    "version 1.0.0 -> 1.1.0"
    """
    if before.key == after.key:
        return ()
    found = []
    if before.version != after.version:
        found.append(f"version {before.version or 'unknown'} -> {after.version or 'unknown'}")
    found += _sources(before.sources, after.sources)
    names = sorted(before.options.keys() | after.options.keys())
    for name in names:
        old, new = _option(before.options, name), _option(after.options, name)
        if old != new:
            short = max(len(old), len(new)) <= MOST
            found.append(f"{name} {old} -> {new}" if short else f"{name} has changed")
    return tuple(dict.fromkeys(found)) or ("what it was made from has changed",)


def _sources(before: Iterable[Source], after: Iterable[Source]) -> list[str]:
    """Inputs that came, went or hold something else; a file that only moved is the same input."""
    result = []
    old, new = _by_role(before), _by_role(after)
    for role in dict.fromkeys((*old, *new)):
        gone = [one for one in old.get(role, ()) if one.sha256 not in {other.sha256 for other in new.get(role, ())}]
        come = [one for one in new.get(role, ()) if one.sha256 not in {other.sha256 for other in old.get(role, ())}]
        for one in come:
            same = next((other for other in gone if other.name == one.name), None)
            if same is None and len(gone) == len(come) == 1:
                same = gone[0]
            if same is None:
                result.append(f"{role} {_name(one)} is new")
                continue
            gone.remove(same)
            moved = "" if _name(same) == _name(one) else f"{_name(same)} -> "
            result.append(f"{role} {moved}{_name(one)} has changed" if not moved else f"{role} {moved}{_name(one)}")
        result += [f"{role} {_name(one)} is no longer used" for one in gone]
    return result


def _by_role(sources: Iterable[Source]) -> dict[str, list[Source]]:
    result: dict[str, list[Source]] = {}
    for source in sources:
        result.setdefault(source.role, []).append(source)
    return result


def _name(source: Source) -> str:
    return PurePath(source.name.replace("\\", "/")).name or source.name


def _option(options: Mapping[str, object], name: str) -> str:
    """A value as text; stored ones were read back from JSON, so tuples and lists are the same."""
    return str(json.loads(json.dumps(options.get(name), default=str)))


def report_key(trial: TrialInputs, done: Sequence[str]) -> str:
    """Hash of all that a report is made of: results by their keys, and its settings."""
    results = sorted(step_provenance(step_of(step), trial).key for step in done)
    settings = sorted(plain_settings(trial.options[ReportOptions]).items())
    return value_source("report", trial.name, __version__, results, settings, sorted(trial.facts.items())).sha256


def keep_facts(writer: ResultWriter, trial: TrialInputs, done: Sequence[str]) -> None:
    """Write the facts of the recording as they are now, before those of an earlier run are reused.

    Warnings stay those of the steps, which add their own.
    """
    for name, text in trial.facts.items():
        if name != "warnings":
            writer.fact(name, text)
    writer.fact(KEY, report_key(trial, done))


def report_is_made(folder: Path, trial: TrialInputs, done: Sequence[str]) -> bool:
    """Whether the report of a folder is that of its results and of the present facts."""
    return (folder / PAGE).is_file() and same_report(folder, trial, done)


def same_report(folder: Path, trial: TrialInputs, done: Sequence[str]) -> bool:
    """Whether results hold the present facts of the recording, such as the subject's mass."""
    stored = folder / f"{file_name(trial.name)}{STORED}"
    if not stored.is_file():
        return False
    try:
        with open_netcdf(stored) as file:
            return file.attributes.get(KEY, "") == report_key(trial, done)
    except DAMAGED:
        return False
