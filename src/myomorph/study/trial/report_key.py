"""What the report of a trial is made of, as one hash: whether it, and the facts of the recording, are those of now."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from myomorph import __version__
from myomorph.store.netcdf import open_netcdf
from myomorph.store.results import DAMAGED, STORED, ResultWriter, file_name, value_source
from myomorph.store.settings import ReportOptions, plain_settings
from myomorph.study.step.step import step_of
from myomorph.study.trial.trial_inputs import TrialInputs
from myomorph.study.trial.trial_step import step_provenance

KEY = "report_key"
PAGE = "report.html"


def report_key(trial: TrialInputs, done: Sequence[str]) -> str:
    """Hash of all that a report is made of: results by their keys, and its settings."""
    results = sorted(step_provenance(step_of(step), trial).key for step in done)
    settings = sorted(plain_settings(trial.options[ReportOptions]).items())
    return value_source("report", trial.name, __version__, results, settings, sorted(trial.facts.items())).sha256


def keep_facts(writer: ResultWriter, trial: TrialInputs, done: Sequence[str]) -> None:
    """Write the facts of the recording as they are now, before those of an earlier run are reused. Warnings stay those
    of the steps, which add their own.
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
