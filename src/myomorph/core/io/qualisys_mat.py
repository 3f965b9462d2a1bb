"""MATLAB exports of Qualisys Track Manager: marker trajectories.

They are version 5 files with one structure per recording.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from myomorph.core.io.mat5 import HEADER, Matrix, arrays_of
from myomorph.core.io.parsing.door import MAX_NUMBERS, mapped_bytes
from myomorph.core.io.parsing.text import unique_names, without_far_away
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.causes import READING
from myomorph.core.model.errors import BadFile, quoted
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.messages import Message
from myomorph.core.model.series import Markers, Trial

HINT = "export the recording from QTM as MAT, or as C3D"
MILLIMETERS = 1e-3
FRAGMENT = "unidentified_"
UNREAD = ("Analog", "Force", "EMG", "RigidBodies")


def read_qualisys_mat(path: str | os.PathLike[str], unidentified: bool = False) -> Trial:
    """Read a Qualisys export: labelled trajectories, time 0 at frame 1.

    QTM writes millimetres and, unless set otherwise, z upwards.

    Parameters
    ----------
    path : of the file
    unidentified : whether trajectories without a label become markers named `unidentified_1`, ...;
        else only their number and duration are reported

    Returns
    -------
    markers (frames, markers, 3) [m] in the file's axes, NaN where hidden; `warnings` name what is
    not read

    Raises
    ------
    BadFile : it cannot be read, is damaged or too large, has no labelled trajectories, or its
        labels, frames or rate do not fit
    """
    path = Path(path)
    try:
        return _trial(path, unidentified)
    except ValueError as error:
        # What is damaged is met where it is read.
        raise BadFile(path, f"is damaged: {error}", HINT) from None


def _trial(path: Path, unidentified: bool) -> Trial:
    """Read a recording; `BadFile` or `ValueError` where that cannot be done."""
    name, recording = _recording(path)
    if _field(_field(recording, "Trajectories"), "Labeled") is None:
        raise BadFile(path, f"'{name}' has no labelled trajectories", HINT)
    rate = _number(recording, "FrameRate")
    if not 0.0 < rate < 1e6:
        raise BadFile(path, f"states a frame rate of {rate:g} Hz", HINT)
    trajectories = _trajectories(recording, path)
    notes = _notes(recording, trajectories.frames)
    facts = _facts(recording, name, rate, trajectories.unidentified)
    if unidentified:
        trajectories = trajectories.with_unidentified()
    start = _number(recording, "StartFrame")
    first = max(start, 1.0) - 1.0 if np.isfinite(start) else 0.0
    time = np.asarray((first + np.arange(trajectories.frames)) / rate, np.float64)
    positions = without_far_away(MILLIMETERS * trajectories.labelled.transpose(1, 0, 2), notes)
    names = unique_names(trajectories.labels, "marker", notes)
    markers = Markers(time, names, positions)
    return Trial(markers=markers, facts=FrozenMap(facts), warnings=tuple(notes), source=str(path))


@read_only
@dataclass(frozen=True, kw_only=True, eq=False)
class _Trajectories:
    """Trajectories of a recording.

    Attributes
    ----------
    labels : of the labelled ones
    labelled, unidentified : (trajectories, frames, 3) [mm], NaN where hidden
    """

    labels: list[str]
    labelled: Array
    unidentified: Array

    @property
    def frames(self) -> int:
        """Count of frames, of which unidentified ones have as many."""
        return (self.labelled if len(self.labelled) else self.unidentified).shape[1]

    def with_unidentified(self) -> _Trajectories:
        """Label the unidentified ones by their numbers."""
        count = len(self.unidentified)
        labels = [f"{FRAGMENT}{index + 1}" for index in range(count)]
        parts = [part for part in (self.labelled, self.unidentified) if len(part)]
        labelled = np.concatenate(parts) if parts else self.labelled
        return replace(self, labels=[*self.labels, *labels], labelled=labelled)


def _trajectories(recording: Matrix, path: Path) -> _Trajectories:
    """Read the trajectories of a recording.

    Raises
    ------
    BadFile : labels do not fit the labelled ones, or the groups have other counts of frames
    """
    group = _field(recording, "Trajectories")
    labelled_group = _field(group, "Labeled")
    labelled = _positions(labelled_group, path, "labelled")
    labels = _labels(labelled_group)
    if len(labels) != len(labelled):
        raise BadFile(
            path, f"has {len(labels)} labels for {len(labelled)} labelled trajectories", HINT
        )
    unidentified = _positions(_field(group, "Unidentified"), path, "unidentified")
    result = _Trajectories(labels=labels, labelled=labelled, unidentified=unidentified)
    if len(unidentified) and unidentified.shape[1] != result.frames:
        raise BadFile(
            path,
            f"has {result.frames} frames with a label and {unidentified.shape[1]} without",
            HINT,
        )
    return result


def _labels(group: Matrix | None) -> list[str]:
    """Read the labels of a group of trajectories; a single one is no array."""
    value = _field(group, "Labels")
    return [] if value is None else [text.strip() for text in value.texts()]


def _notes(recording: Matrix, frames: int) -> list[Message]:
    """List warnings of a recording: another count of frames than stated, and parts not read."""
    notes = []
    stated = _number(recording, "Frames")
    if np.isfinite(stated) and stated != frames:
        notes.append(READING.message(f"the file announces {stated:.0f} frames, but holds {frames}"))
    unread = [part for part in UNREAD if _field(recording, part) is not None]
    if unread:
        notes.append(
            READING.message(f"not read: {', '.join(unread)}; export the recording as C3D for these")
        )
    return notes


def _facts(recording: Matrix, name: str, rate: float, unidentified: Array) -> dict[str, str]:
    """Collect facts: maker, name, unit, rate, date and unidentified trajectories, as texts.

    Parameters
    ----------
    recording : structure of the file
    name : of the structure
    rate : of frames [Hz]
    unidentified : (trajectories, frames, 3), NaN where hidden
    """
    facts = {
        "maker": "Qualisys Track Manager",
        "recording": name,
        "unit of length": "mm",
        "point rate": f"{rate:g} Hz",
    }
    timestamp = _field(recording, "Timestamp")
    date = "" if timestamp is None else timestamp.text().strip()
    if date:
        facts["date"] = date
    if len(unidentified):
        durations = np.isfinite(unidentified).all(axis=2).sum(axis=1) / rate
        facts["unidentified fragments"] = (
            f"{len(unidentified)}, together {durations.sum():.1f} s, the longest"
            f" {durations.max():.2f} s"
        )
    return facts


def _recording(path: Path) -> tuple[str, Matrix]:
    """Find the first structure with trajectories, and its name.

    Raises
    ------
    BadFile : the file is of another version, damaged or too large, or has no such structure
    """
    data = mapped_bytes(path, "a MATLAB file")
    head = bytes(data[:HEADER])
    if head.startswith((b"MATLAB 7.3", b"\x89HDF")):
        raise BadFile(path, "is a MATLAB file of version 7.3", "save it with save(..., '-v7')")
    if head[HEADER - 2 :] not in (b"IM", b"MI"):
        raise BadFile(path, "is not a MATLAB file of version 5", HINT)
    names = []
    for array in arrays_of(data):
        if array.field("Trajectories") is not None:
            return array.name, array
        names.append(array.name)
    held = quoted(names) or "nothing"
    raise BadFile(
        path, f"holds {held}, but no Qualisys recording (a structure with Trajectories)", HINT
    )


def _field(structure: Matrix | None, name: str) -> Matrix | None:
    """Return a field of a structure, None where it has none or it is empty."""
    return None if structure is None else structure.field(name)


def _number(structure: Matrix | None, name: str) -> float:
    """Return a field's first number, NaN where it has none."""
    value = _field(structure, name)
    try:
        return float("nan") if value is None else float(value.values().reshape(-1)[0])
    except ValueError:
        return float("nan")


def _positions(group: Matrix | None, path: Path, kind: str) -> Array:
    """Read the trajectories of a group.

    Parameters
    ----------
    group : structure with the field `Data` (trajectories, 3 or 4, frames); one may lack the first
        axis
    path : of the file, for messages
    kind : of trajectories, for messages

    Returns
    -------
    (trajectories, frames, 3) in the file's unit, NaN where hidden; (0, 0, 3) where there is none

    Raises
    ------
    BadFile : it is of another shape, or no numbers
    """
    array = _field(group, "Data")
    if array is None:
        return np.zeros((0, 0, 3))
    if array.size > MAX_NUMBERS:
        raise BadFile(path, f"holds more than {MAX_NUMBERS} numbers of {kind} trajectories", HINT)
    try:
        data = np.asarray(array.values(), dtype=np.float64)
    except ValueError as error:
        problem = f"its {kind} trajectories are no numbers ({error})"
        raise BadFile(path, problem, HINT) from None
    data = data[None] if data.ndim == 2 else data
    if data.ndim != 3 or data.shape[1] not in (3, 4):
        shape = f"its {kind} trajectories have the shape {data.shape}"
        raise BadFile(path, shape, "expected (trajectories, 3 or 4, frames)")
    places = data[:, :3].transpose(0, 2, 1)
    return np.where(np.isfinite(places).all(axis=2, keepdims=True), places, np.nan)
