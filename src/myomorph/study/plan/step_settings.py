"""What the steps of a study may be told: for all trials, for those of a subject, for one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from myomorph.model.errors import MyomorphError
from myomorph.store.settings import Differentiation, Setting, with_settings
from myomorph.study.subject.subject_files import SUBJECT_STEPS, subject_step
from myomorph.study.trial.step import StepHead, step_head
from myomorph.study.trial.step_table import REPORT, STEPS

FIRST = ("morph", "calibrate", "ik", "identify")
"""Steps in whose order those on subjects and those on trials alternate."""


def study_steps() -> tuple[str, ...]:
    """Names of all steps in the order in which they run."""
    return (*FIRST, *(step for step in STEPS if step not in FIRST), REPORT)


def declared(name: str) -> StepHead:
    """A step of a study."""
    return subject_step(name) if name in SUBJECT_STEPS else step_head(name)


def filtered_steps() -> tuple[str, ...]:
    """Steps that share one low-pass filter, as they share the derivatives."""
    return tuple(step for step in STEPS if Differentiation in step_head(step).options)


def step_settings() -> dict[str, tuple[Setting, ...]]:
    """Settings of every step, by its name."""
    return {step: declared(step).settings for step in study_steps()}


def check_settings(settings: Mapping[str, Mapping[str, Any]], where: str, problems: list[str]) -> None:
    """Add to the problems what the option dataclasses refuse, as a filter below zero."""
    for step in study_steps():
        for options in declared(step).options:
            try:
                with_settings(options(), settings.get(step, {}))
            except MyomorphError as error:
                told = f"{where}options.{step}: {' '.join(str(error).split())}"
                if told not in problems:
                    problems.append(told)


def merged(
    settings: Mapping[str, Mapping[str, Any]], own: Mapping[str, Mapping[str, Any]]
) -> dict[str, dict[str, Any]]:
    """Settings with those of a subject or a trial over them.

    A filter that these name for one of the steps that share it takes the place of all that were named before.
    """
    found = {step: dict(given) for step, given in settings.items()}
    filtered = filtered_steps()
    if any("cutoff" in own.get(step, {}) for step in filtered):
        for step in filtered:
            found.get(step, {}).pop("cutoff", None)
    for step, given in own.items():
        found[step] = found.get(step, {}) | dict(given)
    return {step: given for step, given in found.items() if given}
