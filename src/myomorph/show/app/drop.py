"""Files that a browser sends: each whole or not at all, within limits, into one folder."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePath
from typing import IO

from myomorph.core.io.formats import CHANNELS, MODELS, TRIALS
from myomorph.core.io.inertial.read import SENSORS
from myomorph.core.model.errors import BadData, BadFile
from myomorph.show.app.paths import upload_parts

MAX_FILE = 2 << 30  # Of a file [bytes].
MAX_ALL = 8 << 30  # Of all files of a drop [bytes].
MAX_FILES = 2000
RESERVE = 1 << 30  # That is left free on the disk [bytes].
CHUNK = 1 << 20
BIG = "name their folder on this computer instead of dropping them"
TABLES = (".mot", ".sto", ".csv", ".tsv", ".txt", ".xml", ".json", ".toml", ".yaml", ".yml")
"""List the endings of files that belong to a recording: forces, EMG, names."""


def endings() -> tuple[str, ...]:
    """List the endings of files that recordings are made of; others are left where they are."""
    kinds = (*TRIALS, *SENSORS, *MODELS, *CHANNELS)
    return tuple(sorted({*TABLES, *(ending for kind in kinds for ending in kind.endings)}))


@dataclass(kw_only=True)
class Drop:
    """Files on their way into a folder.

    Attributes
    ----------
    folder : that they go to
    left : bytes that may still come
    files : that are there
    """

    folder: Path
    left: int = MAX_ALL
    files: list[Path] = field(default_factory=list)

    def receive(self, relative: str, stream: IO[bytes], length: int) -> Path:
        """Write a file that comes.

        Parameters
        ----------
        relative : path below what was dropped
        stream : to read it from
        length : of the file [bytes]

        Raises
        ------
        BadFile : it is too large, of no kind that is read, there already, or ended too early
        """
        path = self.folder.joinpath(*upload_parts(relative))
        self._check(path, relative, length)
        self.left -= length
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_name(f"{path.name}.part")
        try:
            with part.open("wb") as target:
                _copy(stream, target, length, relative)
            part.replace(path)
        finally:
            part.unlink(missing_ok=True)
        self.files.append(path)
        return path

    def _check(self, path: Path, relative: str, length: int) -> None:
        if not path.name.lower().endswith(endings()):
            expected = ", ".join(endings())
            raise BadFile(
                relative, "is not a recording and belongs to none", f"expected {expected}"
            )
        if path.exists():
            raise BadFile(relative, "came twice", "drop files of different names")
        if len(self.files) >= MAX_FILES:
            raise BadFile(relative, f"is one of more than {MAX_FILES} files", BIG)
        if length > MAX_FILE or length > self.left:
            raise BadFile(relative, f"is too large to be dropped ({length / 1e9:.1f} GB)", BIG)


def new_drop(folder: Path, sizes: Sequence[int]) -> Drop:
    """Begin to take files into a new folder.

    Parameters
    ----------
    folder : made here
    sizes : of the files that will come [bytes]

    Raises
    ------
    BadData : there are none, or they are too many or too large
    BadFile : the folder cannot be made
    """
    if not sizes:
        raise BadData(
            "nothing was dropped that holds a recording: drop files of markers (.c3d, .trc, .mat)"
            " or inertial sensors, or their folder"
        )
    total = sum(sizes)
    if len(sizes) > MAX_FILES or total > MAX_ALL:
        raise BadData(f"{len(sizes)} files of {total / 1e9:.1f} GB were dropped: {BIG}")
    try:
        folder.mkdir(parents=True)
        free = shutil.disk_usage(folder).free
    except OSError as error:
        raise BadFile(
            folder, f"cannot be made ({error.strerror or error})", "give another folder (--out)"
        ) from None
    if total + RESERVE > free:
        raise BadFile(folder, f"has {free / 1e9:.1f} GB of free space", "make room, or drop less")
    return Drop(folder=folder)


def common_name(paths: Sequence[str]) -> str:
    """Name for what was dropped: of the only folder, else of the first file without its ending."""
    parts = [upload_parts(path) for path in paths]
    tops = {part[0] for part in parts if len(part) > 1}
    if len(tops) == 1 and all(len(part) > 1 for part in parts):
        return tops.pop()
    return PurePath(parts[0][-1]).stem


def _copy(stream: IO[bytes], target: IO[bytes], length: int, name: str) -> None:
    left = length
    while left:
        piece = stream.read(min(CHUNK, left))
        if not piece:
            raise BadFile(name, "arrived incomplete", "drop it again")
        target.write(piece)
        left -= len(piece)
