"""Whether a trial's report still tells what its results and the study file say."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from myomorph import __version__
from myomorph.store.netcdf import open_netcdf
from myomorph.store.results import DAMAGED, STORED, ResultWriter, file_name, value_source
from myomorph.store.settings import ReportOptions, plain_settings
from myomorph.study.trial.step import step_of, step_provenance
from myomorph.study.trial.trial_inputs import TrialInputs

KEY = "report_key"
PAGE = "report.html"


def report_key(trial: TrialInputs, done: Sequence[str]) -> str:
    """Hash of all that a report is made of: results by their keys, and what it is told."""
    results = sorted(step_provenance(step_of(step), trial).key for step in done)
    told = sorted(plain_settings(trial.options[ReportOptions]).items())
    return value_source("report", trial.name, __version__, results, told, sorted(trial.facts.items())).sha256


def keep_facts(writer: ResultWriter, trial: TrialInputs, done: Sequence[str]) -> None:
    """Write what is told of the recording now, before what an earlier run was told is taken over.

    Warnings stay those of the steps, which add their own.
    """
    for name, text in trial.facts.items():
        if name != "warnings":
            writer.fact(name, text)
    writer.fact(KEY, report_key(trial, done))


def report_is_made(folder: Path, trial: TrialInputs, done: Sequence[str]) -> bool:
    """Whether the report of a folder is that of its results, told what it would be told now."""
    return (folder / PAGE).is_file() and told_the_same(folder, trial, done)


def told_the_same(folder: Path, trial: TrialInputs, done: Sequence[str]) -> bool:
    """Whether results hold what is told of the recording now, such as the subject's mass."""
    stored = folder / f"{file_name(trial.name)}{STORED}"
    if not stored.is_file():
        return False
    try:
        with open_netcdf(stored) as file:
            return file.attributes.get(KEY, "") == report_key(trial, done)
    except DAMAGED:
        return False
