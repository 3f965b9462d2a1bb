"""Who the subjects of a study are: by name, by a list of names, or by the folders that a pattern matches."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from myomorph.store.study_file import globbed, is_pattern
from myomorph.study.plan.subject_tables import Patterns, SubjectTable

PLACE = "{subject}"
"""What stands for the subject's name in the texts of its table."""


@dataclass(frozen=True)
class Named:
    """One subject, with its table.

    Attributes
    ----------
    folder : that paths in its table are relative to
    matched : it was found by a pattern, so a table that names it goes before
    """

    name: str
    folder: Path
    table: SubjectTable
    matched: bool = False


def as_list(patterns: Patterns) -> list[str]:
    """One pattern or several as several."""
    return [patterns] if isinstance(patterns, str) else list(patterns)


def named_subjects(tables: Sequence[SubjectTable], home: Path, problems: list[str], remarks: list[str]) -> list[Named]:
    """Every subject of a study file, its name put into the texts of its table.

    A subject that one table names is taken by no pattern of another.

    Parameters
    ----------
    home : folder of the study file
    problems, remarks : take up what is wrong, and who has a table of their own
    """
    found = [one for table in tables for one in _of(table, home, problems)]
    own = {one.name for one in found if not one.matched}
    kept: list[Named] = []
    for one in found:
        if one.matched and one.name in own:
            remarks.append(
                f"subject '{one.name}' has a table of its own: the one for '{one.table.folders}' is not used"
            )
        elif one.matched and any(other.name == one.name for other in kept):
            twice = next(other.folder for other in kept if other.name == one.name)
            problems.append(f"subject '{one.name}' is there twice: folders {twice} and {one.folder}")
        else:
            kept.append(one)
    return [Named(one.name, one.folder, _filled(one.table, one.name), one.matched) for one in kept]


def _of(table: SubjectTable, home: Path, problems: list[str]) -> Iterator[Named]:
    if table.name is not None:
        yield Named(table.name, home, table)
    for name in dict.fromkeys(table.names):
        if table.names.count(name) > 1:
            problems.append(f"subject: names: '{name}' is there twice")
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
            yield Named(name, folder, table, matched)


def _is_result(folder: Path) -> bool:
    """Whether a folder is hidden, or one that a study wrote."""
    return folder.name.startswith(".") or (folder / "results.csv").is_file()


def _filled(table: SubjectTable, name: str) -> SubjectTable:
    return type(table).model_validate(_put(table.model_dump(exclude_unset=True), name))


def _put(value: Any, name: str) -> Any:
    if isinstance(value, str):
        return value.replace(PLACE, name)
    if isinstance(value, dict):
        return {key: _put(one, name) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_put(one, name) for one in value]
    return value
