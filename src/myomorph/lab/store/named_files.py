"""Files and times that a study file names."""

from __future__ import annotations

import os
from pathlib import Path

from myomorph.core.model.errors import listing


def existing(folder: Path, name: str | None, what: str, problems: list[str]) -> Path | None:
    """Find a file that a study file names; what is not there is added to the problems."""
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
    """List the files that a name or a pattern stands for."""
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
    """Whether tables and pages can hold the name: an old Linux may have named it in Latin-1."""
    try:
        str(path).encode("utf-8")
    except UnicodeEncodeError:
        return False
    return True


def is_pattern(text: str) -> bool:
    """Whether a name has signs that stand for others."""
    return any(sign in text for sign in "*?[")


def globbed(folder: Path, pattern: str) -> list[Path]:
    """List what a pattern matches, in order.

    A name without the characters of a pattern is itself, where it exists.
    """
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
