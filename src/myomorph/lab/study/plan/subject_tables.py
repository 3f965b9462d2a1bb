"""Tables of a study file: subjects, trials, their names and patterns, options of steps."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, Field, create_model

from myomorph.core.model.errors import MyomorphError
from myomorph.core.model.registry import remark
from myomorph.lab.store.named_files import globbed, is_pattern
from myomorph.lab.store.settings import Differentiation, Setting, with_settings
from myomorph.lab.store.study_file import Strict, StudyTable, options_table
from myomorph.lab.study.inputs.keys import Notes, Place
from myomorph.lab.study.inputs.table import INPUTS, all_keys
from myomorph.lab.study.plan.groups import StridesTable
from myomorph.lab.study.step.own_table import OwnTable
from myomorph.lab.study.step.step import step_head, step_of, trial_steps
from myomorph.lab.study.step.step_table import LAST_BEFORE_IK, REPORT, STEPS, usual_steps
from myomorph.lab.study.trial.together import TogetherTable

Patterns = str | list[str]  # One pattern or several.
PLACE = "{subject}"  # What stands for the subject's name in the texts of its table.


def study_steps() -> tuple[str, ...]:
    """Names of all steps in the order in which they run."""
    on_subject = tuple(STEPS["subject"])
    count = on_subject.index(LAST_BEFORE_IK) + 1
    later = (step for step in STEPS["trial"] if step != "ik")
    return (*on_subject[:count], "ik", *on_subject[count:], *later, REPORT)


def own_tables() -> dict[str, OwnTable]:
    """Return the tables of a subject that steps bring, by step; none takes the place of a key."""
    taken = {*SubjectTable.model_fields, *all_keys()}
    tables = {}
    for step in (step_of(name, "subject") for name in STEPS["subject"]):
        if step.own_table is None:
            continue
        key = step.own_table.key
        if key in taken:
            remark(
                f"step '{step.name}': subjects already have a key '{key}': its table is left out"
            )
        else:
            tables[step.name] = step.own_table
    return tables


def filtered_steps() -> tuple[str, ...]:
    """List steps that share one low-pass filter, as they share the derivatives."""
    return tuple(step.name for step in trial_steps() if Differentiation in step.options)


def step_settings() -> dict[str, tuple[Setting, ...]]:
    """Return what a study file can specify among the options of every step.

    These are the step's settings, and keys of inputs that stand there.
    """
    keys = [key for _, key in all_keys().values()]
    return {
        step: (
            *step_head(step).settings,
            *(
                Setting(name=key.name, kind=key.table, default=key.default, help=key.help)
                for key in keys
                if key.kind.option_of == step
            ),
        )
        for step in study_steps()
    }


def check_settings(
    settings: Mapping[str, Mapping[str, Any]], where: str, problems: list[str]
) -> None:
    """Add to the problems what the option dataclasses refuse, as a filter below zero."""
    for step in study_steps():
        for options in step_head(step).options:
            try:
                with_settings(options(), settings.get(step, {}))
            except MyomorphError as error:
                message = f"{where}options.{step}: {' '.join(str(error).split())}"
                if message not in problems:
                    problems.append(message)


def merged(
    settings: Mapping[str, Mapping[str, Any]], own: Mapping[str, Mapping[str, Any]]
) -> dict[str, dict[str, Any]]:
    """Return settings with those of a subject or a trial over them.

    A filter that these name for one of the steps that share it takes the place of all that were
    named before.
    """
    found = {step: dict(setting) for step, setting in settings.items()}
    filtered = filtered_steps()
    if any("cutoff" in own.get(step, {}) for step in filtered):
        for step in filtered:
            found.get(step, {}).pop("cutoff", None)
    for step, given in own.items():
        found[step] = found.get(step, {}) | dict(given)
    return {step: given for step, given in found.items() if given}


class StudyHead(StudyTable):
    """The table `[study]`.

    It has a name, a table of measures, conditions, and which two of its groups to compare. With
    `flat`, results of the only subject lie in the results' folder itself, without a folder of its
    own.
    """

    measures: str | None = None
    conditions: dict[str, Patterns] = Field(default_factory=dict)
    compare: list[str] = Field(default_factory=list)
    flat: bool = False


class TrialTable(Strict):
    """A trial given by a table, where its files do not follow the rule of names.

    `input_tables` adds keys of inputs.
    """

    name: str = ""
    condition: str = ""


class SubjectTable(Strict):
    """A subject, or all whose folders a pattern matches, or that a list names.

    `study_tables` adds keys of inputs and the tables that steps bring.
    """

    name: str | None = None
    names: list[str] = Field(default_factory=list)
    folders: Patterns = Field(default_factory=list)
    model: str | None = None
    model_of: str | None = None
    mass: float | None = Field(default=None, gt=0.0)
    trials: list[str | TrialTable]
    steps: list[str] = Field(default_factory=lambda: list(usual_steps()))
    conditions: dict[str, Patterns] = Field(default_factory=dict)
    static: str | None = None
    skin: str | None = None
    landmarks: str | None = None
    height: float | None = Field(default=None, gt=0.0)
    chest: float | None = Field(default=None, gt=0.0)
    sex: Literal["female", "male"] | None = None
    age: float | None = Field(default=None, gt=0.0)
    passive: list[str] = Field(default_factory=list)
    generic: str | None = None
    detailed: str | None = None
    static_turn: float | None = None


class ExcludeTable(Strict):
    """The table `[[exclude]]`: a subject, or trials, that the study leaves out, and why."""

    subject: str = ""
    trial: str = ""
    reason: str


def study_tables() -> type[BaseModel]:
    """All tables of a study file, with the options that its steps have."""
    return _tables(study_steps(), tuple(INPUTS))[0]


def trial_table() -> type[BaseModel]:
    """Return the table of a trial, with the keys of its inputs and the options of its steps."""
    return _tables(study_steps(), tuple(INPUTS))[1]


def input_keys(per: str, base: type[BaseModel]) -> dict[str, Any]:
    """Return keys of inputs that the table of a subject or a trial has beside those of a base.

    They are as pydantic makes fields.
    """
    return {
        name: (key.table, Field(default=None, validate_default=False))
        for name, (_, key) in all_keys().items()
        if key.kind.per in (per, "both") and name not in base.model_fields
    }


def _own_keys() -> dict[str, Any]:
    """Tables of steps as pydantic makes fields."""
    return {own.key: (own.table | None, None) for own in own_tables().values()}


@cache
def _tables(
    steps: tuple[str, ...], inputs: tuple[str, ...]
) -> tuple[type[BaseModel], type[BaseModel]]:
    """Those of a study file and of a trial, made once for the steps and inputs that there are."""
    options = options_table(step_settings())
    own: Any = (options, Field(default_factory=options))
    trial = create_model(
        "_Trial", __base__=TrialTable, options=own, **input_keys("trial", TrialTable)
    )
    subject = create_model(
        "_Subject",
        __base__=SubjectTable,
        options=own,
        trials=(list[str | trial], ...),  # type: ignore[valid-type]
        **input_keys("subject", SubjectTable),
        **_own_keys(),
    )
    file = create_model(
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
    return file, trial


def given_options(table: Any) -> dict[str, dict[str, Any]]:
    """Return what a table specifies for the steps, by step and setting.

    It holds only what is written, without keys of inputs.
    """
    given = getattr(table, "options", None)
    by_step: Mapping[str, dict[str, Any]] = (
        {} if given is None else given.model_dump(exclude_unset=True)
    )
    keys = all_keys()
    settings = {
        step: {
            name: value
            for name, value in said.items()
            if name not in keys or keys[name][1].kind.option_of != step
        }
        for step, said in by_step.items()
    }
    return {step: said for step, said in settings.items() if said}


def lacking(raw: Mapping[str, Any]) -> list[str]:
    """Keys required in a table or elsewhere, which the tables themselves cannot require."""
    study = raw.get("study")
    tables = raw.get("subject")
    elsewhere = isinstance(study, dict) and "measures" in study
    problems = []
    for number, table in enumerate(tables if isinstance(tables, list) else [], 1):
        if not isinstance(table, dict):
            continue
        ways = [one for one in ("name", "names", "folders") if one in table]
        if not ways:
            problems.append(f"'subject.{number}.name' is missing (or 'names', or 'folders')")
        elif len(ways) > 1:
            problems.append(
                f"'subject.{number}' has {' and '.join(map(repr, ways))}: expected one of them"
            )
        if "model" in table and "model_of" in table:
            problems.append(f"'subject.{number}' has 'model' and 'model_of': expected one of them")
        elif not elsewhere and not {"model", "model_of"} & set(table):
            problems.append(f"'subject.{number}.model' is missing (or 'model_of')")
    return problems


@dataclass(frozen=True)
class Named:
    """One subject, with its table.

    `folder`: that paths in its table are relative to; `matched`: it was found by a pattern, so a
    table that names it has priority.
    """

    name: str
    folder: Path
    table: Any
    matched: bool = False

    def place(self, notes: Notes) -> Place:
        """Where its table stands."""
        return Place(self.folder, f"subject '{self.name}'", notes)


def as_list(patterns: Patterns) -> list[str]:
    """One pattern or several as several."""
    return [patterns] if isinstance(patterns, str) else list(patterns)


def named_subjects(
    tables: Sequence[SubjectTable], home: Path, problems: list[str], remarks: list[str]
) -> list[Named]:
    """List every subject of a study file, its name put into the texts of its table.

    A subject that one table names is taken by no pattern of another. `home`: folder of the study
    file; `problems`, `remarks`: take up what is wrong, and who has a table of their own.
    """
    found = [one for table in tables for one in _of(table, home, problems)]
    own = {one.name for one in found if not one.matched}
    kept: list[Named] = []
    for one in found:
        if one.matched and one.name in own:
            remarks.append(
                f"subject '{one.name}' has a table of its own: the one for '{one.table.folders}' is"
                " not used"
            )
        elif one.matched and any(other.name == one.name for other in kept):
            twice = next(other.folder for other in kept if other.name == one.name)
            problems.append(
                f"subject '{one.name}' is given twice: folders {twice} and {one.folder}"
            )
        else:
            kept.append(one)
    filled = (_put(one.table.model_dump(exclude_unset=True), one.name) for one in kept)
    return [
        replace(one, table=type(one.table).model_validate(table))
        for one, table in zip(kept, filled, strict=True)
    ]


def _of(table: SubjectTable, home: Path, problems: list[str]) -> Iterator[Named]:
    if table.name is not None:
        yield Named(table.name, home, table)
    for name in dict.fromkeys(table.names):
        if table.names.count(name) > 1:
            problems.append(f"subject: names: '{name}' is given twice")
        yield Named(name, home, table)
    if table.name is None and not table.names and not as_list(table.folders):
        problems.append("subject: 'names' or 'folders' is empty: expected one or more")
    for pattern in as_list(table.folders):
        matched = is_pattern(pattern)
        folders = [one for one in globbed(home, pattern) if one.is_dir() and not _is_result(one)]
        if not folders:
            kind = "no folder matches" if matched else "there is no folder"
            problems.append(f"subject: {kind} '{pattern}' in {home}")
        for folder in folders:
            # A link is called as it is; "." and ".." have no name of their own.
            name = folder.name if folder.name not in ("", "..") else folder.resolve().name
            yield Named(name=name, folder=folder, table=table, matched=matched)


def _is_result(folder: Path) -> bool:
    """Whether a folder is hidden, or one that a study wrote."""
    return folder.name.startswith(".") or (folder / "results.csv").is_file()


def _put(value: Any, name: str) -> Any:
    if isinstance(value, str):
        return value.replace(PLACE, name)
    if isinstance(value, dict):
        return {key: _put(one, name) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_put(one, name) for one in value]
    return value
