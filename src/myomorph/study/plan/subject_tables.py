"""The tables of a study file that subjects and their trials are told in."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any, Literal

from pydantic import BaseModel, Field, create_model

from myomorph.store.settings import Measured, Side
from myomorph.store.study_file import Strict, StudyTable, options_table
from myomorph.study.plan.group_plan import StridesTable
from myomorph.study.plan.step_settings import step_settings, study_steps
from myomorph.study.subject.morph_files import BonesTable
from myomorph.study.subject.subject_files import SUBJECT_STEPS
from myomorph.study.trial.together import TogetherTable

Patterns = str | list[str]
"""One pattern or several."""


class StudyHead(StudyTable):
    """The table `[study]`: a name, a table of measures, conditions, and which two of its groups to compare."""

    measures: str | None = None
    conditions: dict[str, Patterns] = Field(default_factory=dict)
    compare: list[str] = Field(default_factory=list)


class TrialTable(Strict):
    """A trial given by a table, where its files do not follow the rule of names."""

    markers: str
    name: str = ""
    condition: str = ""
    loads: str | None = None
    bodies: dict[str, str] = Field(default_factory=dict)
    plates: list[str] = Field(default_factory=list)
    emg: str | None = None
    contacts: str = ""
    measured: Measured | None = None
    phases: dict[str, tuple[float, float]] = Field(default_factory=dict)
    time: tuple[float, float] | None = None


class SubjectTable(Strict):
    """A subject, or all whose folders a pattern matches, or that a list names."""

    name: str | None = None
    names: list[str] = Field(default_factory=list)
    folders: Patterns = Field(default_factory=list)
    model: str | None = None
    model_of: str | None = None
    mass: float | None = Field(default=None, gt=0.0)
    trials: list[str | TrialTable]
    steps: list[str] = Field(default_factory=lambda: [step for step in study_steps() if step not in SUBJECT_STEPS])
    conditions: dict[str, Patterns] = Field(default_factory=dict)
    static: str | None = None
    skin: str | None = None
    landmarks: str | None = None
    height: float | None = Field(default=None, gt=0.0)
    chest: float | None = Field(default=None, gt=0.0)
    sex: Literal["female", "male"] | None = None
    age: float | None = Field(default=None, gt=0.0)
    emg_muscles: dict[str, list[str]] = Field(default_factory=dict)
    emg_reference: list[str] = Field(default_factory=list)
    emg_side: Side = ""
    tasks: str | None = None
    actuators: str | None = None
    contacts: str = ""
    measured: Measured | None = None
    time: tuple[float, float] | None = None
    labels: dict[str, str] = Field(default_factory=dict)
    bones: BonesTable | None = None


class ExcludeTable(Strict):
    """The table `[[exclude]]`: a subject, or trials, that the study leaves out, and why."""

    subject: str = ""
    trial: str = ""
    reason: str


def study_tables() -> type[BaseModel]:
    """All tables of a study file, with the options that its steps have."""
    return _tables(study_steps())


@cache
def _tables(steps: tuple[str, ...]) -> type[BaseModel]:
    options = options_table(step_settings())
    own: Any = (options, Field(default_factory=options))
    trial = create_model("_Trial", __base__=TrialTable, options=own)
    subject = create_model("_Subject", __base__=SubjectTable, options=own, trials=(list[str | trial], ...))  # type: ignore[valid-type]
    return create_model(
        "StudyFile",
        __base__=Strict,
        study=(StudyHead, ...),
        subject=(list[subject], Field(min_length=1)),  # type: ignore[valid-type]
        exclude=(list[ExcludeTable], Field(default_factory=list)),
        together=(list[TogetherTable], Field(default_factory=list)),
        groups=(dict[str, list[str]], Field(default_factory=dict)),
        strides=(StridesTable, Field(default_factory=StridesTable)),
        options=own,
    )


def given_options(table: Any) -> dict[str, dict[str, Any]]:
    """What a table says of the steps, by step and setting; only what is written."""
    given = getattr(table, "options", None)
    told: Mapping[str, dict[str, Any]] = {} if given is None else given.model_dump(exclude_unset=True)
    return {step: one for step, one in told.items() if one}


def lacking(raw: Mapping[str, Any]) -> list[str]:
    """What must be in a table or in another place, so that the tables themselves cannot ask for it."""
    study, tables = raw.get("study"), raw.get("subject")
    elsewhere = isinstance(study, dict) and "measures" in study
    problems = []
    for number, table in enumerate(tables if isinstance(tables, list) else [], 1):
        if not isinstance(table, dict):
            continue
        told = [one for one in ("name", "names", "folders") if one in table]
        if not told:
            problems.append(f"'subject.{number}.name' is missing (or 'names', or 'folders')")
        elif len(told) > 1:
            problems.append(f"'subject.{number}' has {' and '.join(map(repr, told))}: expected one of them")
        if "model" in table and "model_of" in table:
            problems.append(f"'subject.{number}' has 'model' and 'model_of': expected one of them")
        elif not elsewhere and not {"model", "model_of"} & set(table):
            problems.append(f"'subject.{number}.model' is missing (or 'model_of')")
    return problems
