"""Study files in TOML: tables that know their keys, and one list of all that is wrong with a file."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from copy import deepcopy
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationError, create_model

from myomorph.core.model.errors import BadFile, listing
from myomorph.lab.store.settings import Setting


class Strict(BaseModel):
    """A table that takes no other keys than its own."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class StudyTable(Strict):
    """The table `[study]`."""

    name: str


def options_table(settings: Mapping[str, Sequence[Setting]]) -> type[BaseModel]:
    """The table `[options]`: one table a step, its keys the settings of the step's option
    dataclasses.
    """
    tables: dict[str, Any] = {}
    for step, setting in settings.items():
        keys: dict[str, Any] = {option.name: (option.kind, option.default) for option in setting}
        made = create_model(f"{step.capitalize()}Options", __base__=Strict, **keys)
        tables[step] = (made, Field(default_factory=made))
    return create_model("StepOptions", __base__=Strict, **tables)


MAX_PROBLEMS = 200
MAX_CHARACTERS = 200  # Problems of a file that are told, and signs of a value.


def read_toml(path: Path) -> dict[str, Any]:
    """The tables of a study file."""
    try:
        return tomllib.loads(path.read_bytes().decode("utf-8"))
    except OSError as error:
        beside = (
            sorted(file.name for file in path.parent.glob("*.toml")) if path.parent.is_dir() else []
        )
        hint = (
            f"{path.parent} has {listing(path.name, beside)}"
            if beside
            else "give a study file in TOML"
        )
        raise BadFile(path, f"cannot be read ({error.strerror or error})", hint) from None
    except UnicodeDecodeError:
        raise BadFile(path, "is not text", "give a study file in TOML") from None
    except (ValueError, RecursionError) as error:
        # Not only of `tomllib`: a whole number of thousands of digits is refused by `int`.
        raise BadFile(
            path, f"is not TOML: {error}", "see docs/getting-started.md for an example"
        ) from None


def checked(file: type[BaseModel], raw: Mapping[str, Any]) -> tuple[Any, list[str]]:
    """The file as checked values and what is wrong; None for the values unless all that is wrong
    are unknown keys. These are left out, so that what else is wrong with the file, as files that it
    names, is found with them.
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
    """Delete the key at a place of nested tables and lists; parts that are no key but the type of
    one are skipped.
    """
    *inner, key = place
    for part in inner:
        if isinstance(table, dict):
            table = table.get(part, table)
        elif isinstance(table, list) and isinstance(part, int) and part < len(table):
            table = table[part]
    if isinstance(table, dict):
        table.pop(key, None)


def refuse(path: Path, problems: Sequence[str]) -> None:
    """Raise `BadFile` with all problems in one line, where there are any."""
    if problems:
        count = f"{len(problems)} problems" if len(problems) > 1 else "1 problem"
        lines = list(problems[:MAX_PROBLEMS])
        if len(problems) > MAX_PROBLEMS:
            lines.append(f"and {len(problems) - MAX_PROBLEMS} more")
        raise BadFile(path, f"{count}: " + " | ".join(lines))


def existing(folder: Path, name: str | None, what: str, problems: list[str]) -> Path | None:
    """A file that a study file names; what is not there is added to the problems."""
    if name is None:
        return None
    path = folder / name
    # Of a name that no system can have, `Path.is_file` would raise an error.
    if os.path.isfile(path):
        return path
    near = (
        [file.name for file in path.parent.glob(f"*{path.suffix}")]
        if os.path.isdir(path.parent)
        else []
    )
    problems.append(
        f"{what} file '{name}' does not exist: {path.parent} has {listing(path.name, near)}"
    )
    return None


def matching(folder: Path, pattern: str, where: str, problems: list[str]) -> list[Path]:
    """The files that a name or a pattern stands for."""
    if is_pattern(pattern) and not os.path.isfile(folder / pattern):
        result = [path for path in globbed(folder, pattern) if path.is_file()]
        if not result:
            problems.append(f"{where}: no file matches '{pattern}' in {folder}")
        problems += [
            f"{where}: the name of '{path.name}' is not UTF-8: rename it"
            for path in result
            if not _is_utf8(path)
        ]
        return result
    path = existing(folder, pattern, f"{where}: trial", problems)
    return [] if path is None else [path]


def _is_utf8(path: Path) -> bool:
    """Whether tables and pages can hold the name: that of a file from an old Linux may be Latin-1."""
    try:
        str(path).encode("utf-8")
    except UnicodeEncodeError:
        return False
    return True


def is_pattern(text: str) -> bool:
    """Whether a name has signs that stand for others."""
    return any(sign in text for sign in "*?[")


def globbed(folder: Path, pattern: str) -> list[Path]:
    """What a pattern matches, in order; a name without such signs is itself, where it exists."""
    if not is_pattern(pattern):
        path = folder / pattern
        return [path] if pattern and os.path.exists(path) else []
    whole = Path(pattern)
    if whole.is_absolute():
        folder = Path(whole.anchor)
        pattern = str(whole.relative_to(whole.anchor))
    try:
        return sorted(folder.glob(pattern))
    except (ValueError, OSError):
        return []


def check_time(time: tuple[float, float] | None, where: str, problems: list[str]) -> None:
    """Add to the problems where a range of time does not end after its start."""
    if time is not None and not time[0] < time[1]:
        problems.append(f"{where} = [{time[0]:g}, {time[1]:g}]: expected a start before an end [s]")


def _sentence(error: Any, file: type[BaseModel]) -> str:
    """One validation error: where it is, what was given, what exists."""
    # Without parts that are no key, but one of the types that a key may have.
    kinds = [
        part
        for part in error["loc"]
        if part in ("str", "float", "int") or str(part).startswith("_")
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
    """A value as the file may have it, cut short."""
    try:
        text = repr(value)
    except ValueError:
        # Hexadecimal numbers may have more digits than Python writes as decimals.
        return "a number of thousands of digits"
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
    """Tables of a file that have a key, as their headings; options stand first where they are those
    of the file.
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
    """The table among the types that a key may have."""
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        return kind
    return next((table for table in map(_table, get_args(kind)) if table is not None), None)
