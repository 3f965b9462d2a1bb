"""Study files in TOML: tables that know their keys, and one list of all errors of a file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from copy import deepcopy
from typing import Any, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationError, create_model

from myomorph.core.model.errors import listing
from myomorph.lab.store.settings import Setting


class Strict(BaseModel):
    """A table that takes no other keys than its own."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class StudyTable(Strict):
    """The table `[study]`."""

    name: str


def options_table(settings: Mapping[str, Sequence[Setting]]) -> type[BaseModel]:
    """Make the table `[options]`: one table a step, its keys the settings of its options."""
    tables: dict[str, Any] = {}
    for step, setting in settings.items():
        keys: dict[str, Any] = {option.name: (option.kind, option.default) for option in setting}
        made = create_model(f"{step.capitalize()}Options", __base__=Strict, **keys)
        tables[step] = (made, Field(default_factory=made))
    return create_model("StepOptions", __base__=Strict, **tables)


MAX_CHARACTERS = 200  # Problems of a file that are told, and signs of a value.


def checked(file: type[BaseModel], raw: Mapping[str, Any]) -> tuple[Any, list[str]]:
    """Check a file.

    Unknown keys are left out, so that what else is wrong with the file, as files that it names, is
    found with them.

    Returns
    -------
    the checked values, None unless unknown keys are all that is wrong; and what is wrong
    """
    try:
        return file.model_validate(raw), []
    except ValidationError as error:
        errors = [
            problem
            for problem in error.errors()
            if not (problem["loc"][-1] == "str" and isinstance(problem["input"], dict))
        ]
        problems = list(dict.fromkeys(_sentence(problem, file) for problem in errors))
        unknown = [problem["loc"] for problem in errors if problem["type"] == "extra_forbidden"]
    rest = deepcopy(dict(raw))
    for place in unknown:
        _leave_out(rest, place)
    try:
        return (file.model_validate(rest) if unknown else None), problems
    except ValidationError:
        return None, problems


def _leave_out(table: Any, place: Sequence[Any]) -> None:
    """Delete the key at a position of nested tables and lists.

    Parts that are no key but the type of one are skipped.
    """
    *inner, key = place
    for part in inner:
        if isinstance(table, dict):
            table = table.get(part, table)
        elif isinstance(table, list) and isinstance(part, int) and part < len(table):
            table = table[part]
    if isinstance(table, dict):
        table.pop(key, None)


def _sentence(error: Any, file: type[BaseModel]) -> str:
    """One validation error: where it is, what was given, what exists."""
    # Without parts that are no key, but one of the types that a key may have.
    kinds = [
        part
        for part in error["loc"]
        if part in ("str", "float", "int")
        or str(part).startswith("_")
        or str(part).endswith("Table")
    ]
    where = [part for part in error["loc"] if part not in kinds and "[" not in str(part)]
    name = ".".join(f"{part + 1}" if isinstance(part, int) else str(part) for part in where)
    if error["type"] == "extra_forbidden":
        elsewhere = dict.fromkeys(_tables_with(str(where[-1]), file))
        belongs = f"it belongs to {' or '.join(elsewhere)}; here " if elsewhere else ""
        return (
            f"unknown key '{name}': {belongs}there are"
            f" {listing(str(where[-1]), _keys(file, where[:-1]))}"
        )
    if error["type"] == "missing":
        return f"'{name}' is missing"
    return f"'{name}' = {_shown(error['input'])}: {error['msg'][:1].lower()}{error['msg'][1:]}"


def _shown(value: Any) -> str:
    """Write a value as the file may have it, cut short."""
    try:
        text = repr(value)
    except ValueError:
        # Hexadecimal numbers may have more digits than Python writes as decimals.
        return "a number with thousands of digits"
    return text if len(text) <= MAX_CHARACTERS else f"{text[:MAX_CHARACTERS]} ..."


def _keys(file: type[BaseModel], where: Sequence[Any]) -> tuple[str, ...]:
    """Keys that exist in the table at a place of the file."""
    table = file
    for key in where:
        field = next(
            (field for name, field in table.model_fields.items() if key in (name, field.alias)),
            None,
        )
        inner = None if field is None else _table(field.annotation)
        table = inner or table
    return tuple(field.alias or name for name, field in table.model_fields.items())


def _tables_with(key: str, table: type[BaseModel], place: str = "") -> Iterator[str]:
    """Yield tables of a file that have a key, as their headings.

    Options stand first where they are those of the file.
    """
    for name, field in table.model_fields.items():
        inner = _table(field.annotation)
        if inner is not None:
            heading = f"{place}.{field.alias or name}".removeprefix(".")
            if key in inner.model_fields:
                yield f"[{heading}]"
            if not (place and name == "options"):
                yield from _tables_with(key, inner, heading)


def _table(kind: Any) -> type[BaseModel] | None:
    """Find the table among the types that a key may have."""
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        return kind
    return next((table for table in map(_table, get_args(kind)) if table is not None), None)
