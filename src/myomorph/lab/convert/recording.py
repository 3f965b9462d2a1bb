"""One recording from one or several files: markers, forces, EMG and events on one clock."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from pathlib import Path

import numpy as np

from myomorph.core.io.c3d.emg import emg_channels
from myomorph.core.io.force_table import holds_forces, read_forces
from myomorph.core.io.formats import trial_format
from myomorph.core.io.sto import read_sto
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData, BadFile
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.messages import Message, located
from myomorph.core.model.series import (
    Analog,
    Event,
    Markers,
    PlateRecording,
    Table,
    Trial,
    Wrenches,
)
from myomorph.core.motion.sync import cut
from myomorph.lab.causes import CONVERSION
from myomorph.lab.study.inputs.plate_wrenches import recorded_wrenches
from myomorph.lab.study.inputs.reading import about, faces_z, read_recording, renamed

TABLES = (".mot", ".sto", ".csv", ".txt")  # Endings of tables.


@read_only
class Recording:
    """Parts of a recording, whatever files they came from.

    Attributes
    ----------
    name : of the first file, without its ending
    wrenches : forces in ground, bodies "" where they are not known
    plates : as a C3D file stores them, None where forces came from a table
    plate_time : clock of the plates (samples,) [s]
    analog : channels that are no plate's
    emg : names of those that are EMG
    tables : other tables, as files hold them
    level : the plates lie level with z, so z points up
    notes : what was corrected or assumed
    """

    name: str
    markers: Markers | None = None
    wrenches: Wrenches | None = None
    plates: tuple[PlateRecording, ...] = ()
    plate_time: Array = field(default_factory=lambda: np.zeros(0))
    analog: Analog | None = None
    emg: tuple[str, ...] = ()
    events: tuple[Event, ...] = ()
    tables: Mapping[str, Table] = field(default_factory=lambda: FrozenMap({}))
    level: bool = False
    notes: tuple[Message, ...] = ()


def read_parts(paths: Sequence[Path]) -> Recording:
    """Read files of one recording: at most one with markers, tables of forces and of EMG."""
    if not paths:
        raise BadData(
            "no file to convert: give a recording (.c3d, .trc), or tables beside it (.mot, .sto,"
            " .csv)"
        )
    result = Recording(paths[0].stem)
    for path in paths:
        with about(path):
            if trial_format(path) is not None:
                result = _with_recording(result, path)
            elif path.suffix.lower() in TABLES:
                result = _with_table(result, path)
            else:
                raise BadFile(
                    path,
                    f"is neither a recording nor a table: its name ends in '{path.suffix}'",
                    "expected .c3d, .trc, .mat, .mot, .sto or .csv",
                )
    return result


def _with_recording(recording: Recording, path: Path) -> Recording:
    """Add what a recording holds; what it lacks stays as it was."""
    trial = read_recording(path)
    if recording.markers is not None and trial.markers is not None:
        raise BadData(f"{path}: a second file with markers: convert one recording at a time")
    if trial.plates:
        recording = replace(
            recording,
            wrenches=recorded_wrenches(trial),
            plates=trial.plate_recordings,
            plate_time=trial.plate_time,
        )
    others = _other_channels(trial)
    if others is not None and others.names:
        recording = replace(recording, analog=others)
    if trial.markers is not None:
        recording = replace(recording, markers=trial.markers)
    notes = [*located(path.name, trial.warnings)]
    if trial.other_points is not None:
        count = len(trial.other_points.names)
        notes.append(
            CONVERSION.message(
                f"{path.name}: {count} quantities that a program computed (angles, moments) are not"
                " converted"
            )
        )
    return replace(
        recording,
        emg=emg_channels(trial) or recording.emg,
        events=trial.events or recording.events,
        level=bool(trial.plates) and all(map(faces_z, trial.plates)),
        notes=(*recording.notes, *notes),
    )


def _other_channels(trial: Trial) -> Analog | None:
    """Analog channels that are no plate's; None where there are no analog channels."""
    if trial.analog is None:
        return None
    plates = {name for plate in trial.plate_recordings for name in plate.channel_names}
    kept = [index for index, name in enumerate(trial.analog.names) if name not in plates]
    return trial.analog.columns(kept)


def _with_table(recording: Recording, path: Path) -> Recording:
    if holds_forces(path):
        if recording.wrenches is not None:
            raise BadData(f"{path}: a second file with forces: convert one recording at a time")
        wrenches = read_forces(path)
        return replace(recording, wrenches=wrenches, notes=(*recording.notes, *wrenches.notes))
    table = read_sto(path)
    notes = (*recording.notes, *located(path.name, table.warnings))
    return replace(recording, tables=FrozenMap({**recording.tables, path.stem: table}), notes=notes)


def between(recording: Recording, start: float, end: float) -> Recording:
    """Cut the part of a recording between two times [s]."""
    if not start < end:
        raise BadData(f"--time {start:g} {end:g}: expected a start before an end [s]")
    wrenches = recording.wrenches
    analog = recording.analog
    plates = recording.plates
    plate_time = recording.plate_time
    if wrenches is not None:
        inside = (wrenches.time >= start - 1e-9) & (wrenches.time <= end + 1e-9)
        wrenches = wrenches.frames(inside)
    if len(plate_time):
        inside = (plate_time >= start - 1e-9) & (plate_time <= end + 1e-9)
        plates = tuple(replace(plate, channels=plate.channels[inside]) for plate in plates)
        plate_time = plate_time[inside]
    return replace(
        recording,
        markers=None if recording.markers is None else cut(recording.markers, start, end),
        wrenches=wrenches,
        plates=plates,
        plate_time=plate_time,
        analog=None if analog is None else cut(analog, start, end),
        events=tuple(event for event in recording.events if start <= event.time <= end),
        tables=FrozenMap(
            {name: cut(table, start, end) for name, table in recording.tables.items()}
        ),
    )


def labelled(recording: Recording, labels: Mapping[str, str]) -> Recording:
    """Give markers and channels of a recording other names; "" drops one."""
    markers = recording.markers
    analog = recording.analog
    known = {*(markers.names if markers else ()), *(analog.names if analog else ())}
    if labels and not known & set(labels):
        raise BadData(
            f"none of the {len(labels)} labels is in the recording: it has"
            f" {', '.join(sorted(known)[:8])}, ..."
        )
    return replace(
        recording,
        markers=None if markers is None else renamed(markers, labels),
        analog=None if analog is None else renamed(analog, labels),
        emg=tuple(filter(None, (labels.get(name, name) for name in recording.emg))),
    )
