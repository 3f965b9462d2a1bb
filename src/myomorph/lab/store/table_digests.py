"""Digests of the tables that belong to a result: which one is missing or was altered since."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

from myomorph.core.io.parsing.text import written
from myomorph.lab.store.digests import file_digest


def table_digests(folder: Path, leave_out: str = "") -> dict[str, str]:
    """Hash the files of a folder, those of folders in it too.

    Parameters
    ----------
    folder : of the tables
    leave_out : name of a file that is none of them

    Returns
    -------
    digest by path from the folder; temporary files, whose names begin with a dot, are left out
    """
    files = (path for path in sorted(folder.rglob("*")) if path.is_file())
    return {
        path.relative_to(folder).as_posix(): file_digest(path)
        for path in files
        if path.name != leave_out and not path.name.startswith(".")
    }


def altered_tables(folder: Path, digests: Mapping[str, str]) -> tuple[str, ...]:
    """List what is wrong with tables, one line each.

    Parameters
    ----------
    folder : of the tables
    digests : by path from the folder, as they were when the tables were written
    """
    problems = []
    for name, digest in digests.items():
        try:
            found = file_digest(folder / name)
        except OSError:
            problems.append(f"{name} is missing")
            continue
        if found != digest:
            problems.append(f"{name} is damaged or was edited")
    return tuple(problems)


def write_digests(path: Path, folder: Path, names: tuple[str, ...]) -> None:
    """Write the digests of some files of a folder, those that exist, as JSON.

    Parameters
    ----------
    path : of the new file
    folder : of the others
    names : of these
    """
    there = [name for name in names if (folder / name).is_file()]
    digests = {name: file_digest(folder / name) for name in there}
    with written(path) as stream:
        stream.write(json.dumps(digests, indent=1) + "\n")


def read_digests(text: str) -> dict[str, str]:
    """Read digests by name; none where the text holds something else."""
    try:
        digests = json.loads(text)
    except (ValueError, RecursionError):
        return {}
    if not isinstance(digests, dict):
        return {}
    return {name: digest for name, digest in digests.items() if isinstance(digest, str)}
