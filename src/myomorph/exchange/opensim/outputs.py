"""The files that a tool writes: all of them or none, and never one that it read."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from myomorph.core.model.errors import BadData, BadFile
from myomorph.core.model.messages import Message
from myomorph.exchange.causes import TOO_WEAK

# What writes each file under the name that it is given.
Writers = Mapping[Path, Callable[[Path], object]]


@dataclass(frozen=True)
class ToolResult:
    """What running a setup file came to."""

    tool: str
    lines: tuple[str, ...]  # what was found, one line each
    written: tuple[Path, ...]  # the files
    warnings: tuple[Message, ...] = ()  # what looked wrong but did not stop the work, one line each

    @property
    def solved(self) -> bool:
        """Whether every frame that was asked for has a solution."""
        return not any(warning.cause is TOO_WEAK for warning in self.warnings)


def check_outputs(outputs: Iterable[Path], inputs: Iterable[Path | None]) -> None:
    """Raise `BadFile` where an output is an input, a folder, or named twice."""
    read = {path.resolve() for path in inputs if path is not None}
    seen: set[Path] = set()
    for path in outputs:
        place = path.resolve()
        if place in read:
            raise BadFile(
                path, "is both read and written by this setup", "give the output another name"
            )
        if place in seen:
            raise BadFile(path, "is the name of two results", "give one of them another name")
        if path.is_dir():
            raise BadFile(path, "is a folder, but has the name of a result")
        seen.add(place)


def write_outputs(writers: Writers) -> tuple[Path, ...]:
    """Write files, whole and all together; folders that they need are made."""
    temporary: dict[Path, Path] = {}
    try:
        for target, write in writers.items():
            target.parent.mkdir(parents=True, exist_ok=True)
            handle, name = tempfile.mkstemp(
                prefix=f".{target.name}.", suffix=target.suffix, dir=target.parent
            )
            os.close(handle)
            temporary[target] = Path(name)
            write(Path(name))
        for target, path in temporary.items():
            os.chmod(path, 0o644)
            os.replace(path, target)
    finally:
        for path in temporary.values():
            path.unlink(missing_ok=True)
    return tuple(temporary)


def needed(path: Path | None, tag: str, source: Path) -> Path:
    """Return the path, or raise `BadData` that names the missing part of the setup."""
    if path is None:
        raise BadData(f"{source}: names no {tag}")
    return path
