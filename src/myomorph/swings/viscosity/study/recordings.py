"""Recordings of swings and the forces that belong to them, before anything is read."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from myomorph.core.io.parsing.named_file import is_named_file
from myomorph.core.model.errors import BadData, BadFile
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.lab.store import named_files
from myomorph.lab.store.study_file import Strict
from myomorph.lab.study.inputs.beside import plain_stem
from myomorph.lab.study.inputs.loads import loads_by_name
from myomorph.swings.viscosity.study.study_folder import StudyFolder

CONDITIONS = ("without", "with")
OPTIONS: Mapping[str, str] = FrozenMap(dict(zip(CONDITIONS, ("removed", "intact"), strict=True)))
"""What the two conditions are called in study files and on the command line."""
Span = tuple[float, float]
"""Start and end of a part of a recording [s]."""


class RecordingTable(Strict):
    """A trial given by a table, where its files do not follow the rule of names."""

    markers: str
    loads: str | None = None
    name: str = ""
    time: Span | None = None


@dataclass(frozen=True)
class SwingFiles:
    """One recording of a swing.

    Attributes
    ----------
    name : of the recording
    markers, loads : files; the same where one C3D file holds both
    time : the part that is used, None for all of it
    """

    name: str
    markers: Path
    loads: Path
    time: Span | None = None


class GivenFiles(NamedTuple):
    """Recordings of one condition on a command line, and their forces, or none for those beside."""

    markers: Sequence[Path] = ()
    loads: Sequence[Path] = ()


def swing_loads(markers: Path) -> Path | None:
    """Find the forces of a recording: in a C3D file itself, else beside it by its stem."""
    return markers if markers.suffix.lower() == ".c3d" else loads_by_name(markers)


def found_swings(
    entries: Sequence[str | RecordingTable], time: Span | None, where: str, folder: StudyFolder
) -> Iterator[SwingFiles]:
    """Find the recordings of one condition.

    Parameters
    ----------
    entries : of the study file: names, patterns or tables
    time : the part of recordings that have none of their own
    where : in the study file, for what is noted
    folder : of the study file

    Yields
    ------
    those whose forces were found
    """
    seen: set[str] = set()
    for entry in entries:
        table = RecordingTable(markers=entry) if isinstance(entry, str) else entry
        span = table.time or time
        named_files.check_time(span, f"{where}: time", folder.problems)
        for markers in named_files.matching(folder.path, table.markers, where, folder.problems):
            loads = _loads(table, markers, where, folder)
            name = table.name or plain_stem(markers)
            if name in seen:
                folder.problems.append(
                    f"{where}: two recordings are named '{name}': give one a 'name'"
                )
            seen.add(name)
            if loads is not None:
                yield SwingFiles(name=name, markers=markers, loads=loads, time=span)


def _loads(table: RecordingTable, markers: Path, where: str, folder: StudyFolder) -> Path | None:
    """Find the forces that a table names, or those of its recording."""
    if table.loads is not None:
        return named_files.existing(folder.path, table.loads, f"{where}: loads", folder.problems)
    loads = swing_loads(markers)
    if loads is None:
        folder.problems.append(
            f"{where}: no forces belong to {markers.name}: give 'loads', a table or C3D file"
        )
    elif loads != markers:
        folder.remarks.append(f"{markers.name}: loads from {loads.name}")
    return loads


def given_swings(condition: str, files: GivenFiles, time: Span | None) -> Iterator[SwingFiles]:
    """Find the recordings that a command line gives.

    Parameters
    ----------
    condition : of `CONDITIONS`
    files : recordings, and their forces
    time : the part of all of them

    Raises
    ------
    BadData : as many forces as recordings are expected
    BadFile : a file is missing
    """
    option = OPTIONS[condition]
    if files.loads and len(files.loads) != len(files.markers):
        raise BadData(
            f"{len(files.markers)} recordings but {len(files.loads)} files of forces for"
            f" --{option}: give one of each"
        )
    for number, markers in enumerate(files.markers):
        loads = files.loads[number] if files.loads else swing_loads(markers)
        for path in (markers, loads):
            if path is not None and not is_named_file(path):
                raise BadFile(path, "does not exist")
        if loads is None:
            raise BadFile(markers, "has no forces beside it", f"give --{option}-loads")
        yield SwingFiles(name=plain_stem(markers), markers=markers, loads=loads, time=time)
