"""`myomorph convert`: what files hold of a recording, written as other files."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from myomorph.core.contact.assign import assign_bodies
from myomorph.core.io.c3d.write import write_trial
from myomorph.core.io.loads import loads_table, write_external_loads
from myomorph.core.io.parsing.text import write_csv
from myomorph.core.io.sto import write_sto
from myomorph.core.io.trc import METERS, write_trc
from myomorph.core.model.arrays import Array
from myomorph.core.model.causes import PLATES
from myomorph.core.model.errors import BadData, BadFile
from myomorph.core.model.frozen_map import FrozenMap, grouped
from myomorph.core.model.messages import Message
from myomorph.core.model.series import Analog, Markers, PlateRecording, Table, Trial, Wrenches
from myomorph.core.model.sides import other_side, split_side
from myomorph.lab.convert.axes import Forward, Up, turned, vertical
from myomorph.lab.convert.recording import Recording, between, labelled, read_parts

KINDS = (".trc", ".mot", ".sto", ".csv", ".c3d")  # Endings of files that can be written.

SAME = 1e-6  # Times that differ by less are the same: files round them [s].


@dataclass(frozen=True)
class ConvertOptions:
    """What a converted recording looks like.

    Attributes
    ----------
    up : axis that points up; by default y, but as it is where a C3D file is written
    forward : axis that the walk goes along, "" for as it is
    axes : instead of both, the new axes in the old frame, as "x,z,-y"
    units : of lengths in a TRC file
    labels : names of markers and channels in the file, and their new names; "" drops one
    plates : bodies on the plates in their order, "" for one that is left out; by default by the
        feet's markers
    time : start and end of what is converted [s], None for all
    """

    up: Up = ""
    forward: Forward = ""
    axes: str = ""
    units: str = "mm"
    labels: Mapping[str, str] = field(default_factory=lambda: FrozenMap({}))
    plates: tuple[str, ...] = ()
    time: tuple[float, float] | None = None


@dataclass(frozen=True)
class Converted:
    """Files that were written, what each holds, and what was corrected or assumed."""

    files: tuple[tuple[Path, str], ...]
    notes: tuple[Message, ...]


def convert(paths: Sequence[Path], out: Path, options: ConvertOptions | None = None) -> Converted:
    """Read files of one recording and write them as others.

    The ending of `out` says what: .trc markers, .mot forces (with external loads .xml beside it),
    .sto or .csv EMG or a table, .c3d all of it; without an ending a folder, for all that there is.

    Parameters
    ----------
    paths : of a recording (C3D, TRC, ...), and tables of forces and EMG
    out : file or folder that is written
    options : axes, units, labels, plates and time

    Raises
    ------
    BadFile, BadData : a file cannot be read, or what is asked for is not there
    """
    options = options or ConvertOptions()
    ending = out.suffix.lower()
    if ending and ending not in KINDS:
        raise BadFile(
            out,
            f"cannot be written: its name ends in '{out.suffix}'",
            f"expected {', '.join(KINDS)}, or a folder",
        )
    if options.units not in METERS:
        raise BadData(f"--units {options.units}: expected mm, cm or m")
    recording = read_parts(paths)
    if options.time is not None:
        recording = between(recording, *options.time)
    recording = labelled(recording, options.labels)
    # OpenSim's y where nothing is asked for and the vertical is known.
    up: Up = options.up or ("y" if ending != ".c3d" and vertical(recording) == "z" else "keep")
    recording = turned(recording, up, options.forward, options.axes)
    if ending == ".c3d":
        write_trial(out, c3d_trial(recording))
        held = [f"{len(recording.markers.names)} markers" if recording.markers else "no markers"]
        held += (
            [f"{len(recording.wrenches.names)} plates"] if recording.wrenches is not None else []
        )
        return Converted(((out, ", ".join(held)),), recording.notes)
    if ending:
        return _one_file(recording, out, options)
    return _folder(recording, out, options)


def _folder(recording: Recording, out: Path, options: ConvertOptions) -> Converted:
    """All parts of a recording as files in a folder."""
    if out.exists() and not out.is_dir():
        raise BadFile(
            out, "is a file, but several files are to be written", "give the name of a folder"
        )
    out.mkdir(parents=True, exist_ok=True)
    files: list[tuple[Path, str]] = []
    notes = recording.notes
    if recording.markers is not None:
        path = out / f"{recording.name}.trc"
        files.append((path, _write_markers(recording.markers, path, options.units)))
    if recording.wrenches is not None:
        wrenches = on_feet(recording.wrenches, recording.markers, options.plates)
        notes = (*notes, *wrenches.notes)
        if wrenches.names:
            files += _write_forces(wrenches, out / f"{recording.name}_grf.mot")
        else:
            notes = (*notes, PLATES.message("no plate is loaded: no table of forces is written"))
    if recording.analog is not None and recording.emg:
        path = out / f"{recording.name}_emg.sto"
        write_sto(table := _emg(recording), path)
        files.append((path, f"EMG: {', '.join(table.names)}"))
    if recording.events:
        path = out / f"{recording.name}_events.csv"
        rows = ((f"{event.time:.10g}", event.label, event.side) for event in recording.events)
        write_csv(path, ("time", "event", "side"), rows)
        files.append((path, f"{len(recording.events)} events"))
    for name, table in recording.tables.items():
        path = out / f"{name}.sto"
        files.append((path, _write_table(table, path)))
    if not files:
        raise BadData("nothing to convert: the files hold neither markers, forces, EMG nor events")
    return Converted(tuple(files), notes)


def _one_file(recording: Recording, out: Path, options: ConvertOptions) -> Converted:
    """Write the part of a recording that a file is for, by its ending."""
    ending = out.suffix.lower()
    if ending == ".trc":
        if recording.markers is None:
            raise BadData(f"{out}: there are no markers to write")
        return Converted(
            ((out, _write_markers(recording.markers, out, options.units)),), recording.notes
        )
    if recording.wrenches is not None and (
        ending == ".mot" or not (recording.emg or recording.tables)
    ):
        wrenches = on_feet(recording.wrenches, recording.markers, options.plates)
        return Converted(tuple(_write_forces(wrenches, out)), (*recording.notes, *wrenches.notes))
    tables = list(recording.tables.values())
    table: Table | None
    if len(tables) == 1:
        table = tables[0]
    elif recording.analog is not None and recording.emg:
        table = _emg(recording)
    else:
        table = None
    if table is None:
        what = "forces" if ending == ".mot" else "forces, EMG, or a single table"
        raise BadData(f"{out}: there are no {what} to write")
    return Converted(((out, _write_table(table, out)),), recording.notes)


def _write_markers(markers: Markers, path: Path, units: str) -> str:
    write_trc(markers, path, units)
    return f"{len(markers.names)} markers, {len(markers)} frames"


def _write_forces(wrenches: Wrenches, path: Path) -> list[tuple[Path, str]]:
    """Write a table of forces, and an external loads file where the bodies are known."""
    if not wrenches.names:
        raise BadData(f"{path}: there are no forces to write: no plate of the recording is loaded")
    known = all(wrenches.bodies)
    table = path if path.suffix.lower() in (".mot", ".sto") else path.with_suffix(".mot")
    if not known:
        plain = replace(wrenches, bodies=("unknown",) * len(wrenches.names))
        write_sto(loads_table(plain), table)
        return [
            (
                table,
                (
                    f"forces of {', '.join(wrenches.names)}; no .xml: --plates names the bodies"
                    " they act on"
                ),
            )
        ]
    loads = table.with_suffix(".xml")
    write_external_loads(wrenches, table, loads)
    owners = ", ".join(
        f"{name} on {body}" for name, body in zip(wrenches.names, wrenches.bodies, strict=True)
    )
    return [(table, f"forces of {', '.join(wrenches.names)}"), (loads, owners)]


def _emg(recording: Recording) -> Table:
    """Channels of EMG as a table, in the file's units."""
    assert recording.analog is not None
    names = recording.analog.names
    emg = recording.analog.columns([names.index(name) for name in recording.emg if name in names])
    return Table(emg.time, emg.names, emg.values, facts=FrozenMap({"name": "EMG"}))


def _write_table(table: Table, path: Path) -> str:
    if path.suffix.lower() == ".csv":
        write_csv(
            path,
            ("time", *table.names),
            np.column_stack([table.time, table.values]).tolist(),
            digits=10,
        )
    else:
        write_sto(table, path)
    return f"{len(table.names)} columns, {len(table)} rows"


def c3d_trial(recording: Recording) -> Trial:
    """Bring a recording into the form of a C3D file.

    Analog channels and plates have a whole number of samples a frame. Forces of a table become
    plates of type 2 under their centers of pressure. What does not lie on the clock of the file is
    interpolated linearly.
    """
    if recording.markers is None:
        raise BadData("a C3D file needs markers: give the recording (.trc) beside the tables")
    markers = recording.markers
    if len(markers) < 2:
        return Trial(markers=markers)
    clocks = _clocks(recording)
    if not clocks:
        return Trial(markers=markers, events=recording.events)
    fastest = max(1.0 / float(np.median(np.diff(clock))) for clock in clocks if len(clock) > 1)
    every = max(1, round(fastest / markers.rate))
    step = 1.0 / (markers.rate * every)
    clock = markers.time[0] + step * np.arange(len(markers) * every)
    return Trial(
        markers=markers,
        plate_recordings=_plates(recording, clock),
        plate_time=clock,
        analog=_analog(recording, clock),
        events=recording.events,
        source=recording.name,
    )


def _clocks(recording: Recording) -> list[Array]:
    """Collect times (samples,) of forces, tables, plates and analog channels [s]."""
    clocks = [table.time for table in recording.tables.values()]
    if recording.plates:
        clocks.append(recording.plate_time)
    elif recording.wrenches is not None:
        clocks.append(recording.wrenches.time)
    if recording.analog is not None:
        clocks.append(recording.analog.time)
    return clocks


def _plates(recording: Recording, clock: Array) -> tuple[PlateRecording, ...]:
    """Bring plates, or the forces of a table as plates, to a clock (samples,) [s]."""
    if recording.plates:
        return tuple(
            replace(plate, channels=_at(recording.plate_time, plate.channels, clock))
            for plate in recording.plates
        )
    wrenches = recording.wrenches
    if wrenches is None:
        return ()
    up = np.eye(3)["xyz".index(vertical(recording) or "y")]
    return tuple(_plate(wrenches, index, clock, up) for index in range(len(wrenches.names)))


def _analog(recording: Recording, clock: Array) -> Analog | None:
    """Bring analog channels and tables to a clock (samples,) [s]; None where there are none."""
    names: list[str] = []
    units: list[str] = []
    columns: list[Array] = []
    if recording.analog is not None:
        names += recording.analog.names
        units += recording.analog.units or ("",) * len(recording.analog.names)
        columns.append(_at(recording.analog.time, recording.analog.values, clock))
    for table in recording.tables.values():
        names += [name if name not in names else f"{name}_2" for name in table.names]
        units += ["V"] * len(table.names)
        columns.append(_at(table.time, table.values, clock))
    if not names:
        return None
    return Analog(clock, tuple(names), np.hstack(columns), units=tuple(units))


def _at(time: Array, values: Array, clock: Array) -> Array:
    """Bring columns to other times, exactly where the times are the same.

    Parameters
    ----------
    time : (samples,) [s]
    values : (samples, columns)
    clock : (times,) [s]

    Returns
    -------
    (times, columns), zero outside
    """
    inside = (clock >= time[0] - SAME) & (clock <= time[-1] + SAME)
    after = np.clip(np.searchsorted(time, clock), 1, len(time) - 1)
    nearest = np.where(clock - time[after - 1] < time[after] - clock, after - 1, after)
    if np.all(np.abs(time[nearest] - clock)[inside] < SAME):
        columns = values[nearest]
    else:
        columns = np.column_stack([np.interp(clock, time, column) for column in values.T])
    return np.asarray(np.where(inside[:, None], columns, 0.0))


def _plate(wrenches: Wrenches, number: int, clock: Array, up: Array) -> PlateRecording:
    """Make a plate of type 2 of a force, which lies under its center of pressure, z downwards."""
    force = np.nan_to_num(wrenches.forces[:, number])
    point = np.nan_to_num(wrenches.points[:, number])
    size = np.linalg.norm(force, axis=1)
    loaded = size > 0.05 * max(float(size.max(initial=0.0)), 1e-9)
    seen = point[loaded] if loaded.any() else np.zeros((1, 3))
    x = np.eye(3)[0] if up[0] == 0.0 else np.roll(up, 1)
    axes = np.stack([x, np.cross(-up, x), -up], axis=1)
    middle, corners = _under(seen, axes, up)
    moment = np.nan_to_num(wrenches.torques[:, number]) + np.cross(point - middle, force)
    channels = _at(wrenches.time, np.hstack([force @ axes, moment @ axes]), clock)
    names = tuple(f"{part}{number + 1}" for part in ("Fx", "Fy", "Fz", "Mx", "My", "Mz"))
    return PlateRecording(
        name=f"plate_{number + 1}",
        kind=2,
        corners=corners,
        origin=np.zeros(3),
        channels=channels,
        channel_names=names,
    )


def _under(points: Array, axes: Array, up: Array) -> tuple[Array, Array]:
    """Lay a rectangle under centers of pressure, 20 cm larger on all sides.

    Parameters
    ----------
    points : (samples, 3) [m]
    axes : (3, 3) columns are the axes of the plate, z downwards
    up : (3,)

    Returns
    -------
    middle (3,) and corners (4, 3) [m]
    """
    low = (points @ axes).min(axis=0) - 0.2
    high = (points @ axes).max(axis=0) + 0.2
    height = float(np.median(points @ up))
    middle = axes[:, :2] @ (0.5 * (low + high))[:2] + height * up
    half = 0.5 * (high - low)
    corners = np.stack(
        [
            middle + a * half[0] * axes[:, 0] + b * half[1] * axes[:, 1]
            for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))
        ]
    )
    return middle, corners


FOOT_MARKER = re.compile(
    r"heel|hee|calc|toe|mt_?[1-5p]|mtp|meta|foot|hallux|hal\b|ank|mall", re.IGNORECASE
)
"""What markers on a foot are called."""

FEET = {"right": "calcn_r", "left": "calcn_l"}
"""Bodies that forces are given to, as OpenSim's models call the heel bones."""

LOADED = 20.0  # Force from which a plate carries somebody [N].


def on_feet(wrenches: Wrenches, markers: Markers | None, bodies: Sequence[str] = ()) -> Wrenches:
    """Put forces on bodies that are given, else step by step on the nearest foot.

    Forces that never act are left out.

    Parameters
    ----------
    wrenches : bodies "" where they are not known
    markers : of the recording, None for none
    bodies : in the order of the forces, "" for one that is left out; () for the feet
    """
    if bodies:
        return _on_given(wrenches, bodies)
    size = np.nan_to_num(np.linalg.norm(wrenches.forces, axis=2))
    used = [
        index for index in range(len(wrenches.names)) if size[:, index].max(initial=0.0) > LOADED
    ]
    idle = [name for index, name in enumerate(wrenches.names) if index not in used]
    notes = (
        *wrenches.notes,
        *(
            (
                PLATES.message(
                    f"{', '.join(idle)} are never loaded: left out", severity="good to know"
                ),
            )
            if idle
            else ()
        ),
    )
    wrenches = replace(wrenches.columns(used), notes=notes)
    places = {} if markers is None else foot_places(markers, wrenches.time)
    if all(wrenches.bodies) or len(places) < 2 or not used:
        return wrenches
    assigned = assign_bodies(wrenches, places)
    kept = [index for index, body in enumerate(assigned.wrenches.bodies) if body]
    return replace(assigned.wrenches.columns(kept), notes=(*notes, *assigned.warnings))


def _on_given(wrenches: Wrenches, bodies: Sequence[str]) -> Wrenches:
    """Put forces on bodies that are given, in their order; "" leaves one out."""
    if len(bodies) > len(wrenches.names):
        raise BadData(
            f"{len(bodies)} bodies are given, but the forces are {', '.join(wrenches.names)}"
        )
    chosen = [index for index, body in enumerate(bodies) if body]
    bodies = (*bodies, *wrenches.bodies[len(bodies) :])
    return replace(wrenches, bodies=bodies).columns(chosen)


def foot_places(markers: Markers, time: Array) -> dict[str, Array]:
    """Positions of the markers on each foot, by the bodies of the feet.

    Parameters
    ----------
    markers : of the recording
    time : (times,) [s]

    Returns
    -------
    (times, markers, 3) by body [m]
    """
    sided = [
        (FEET.get(side_of(name)), column)
        for column, name in enumerate(markers.names)
        if FOOT_MARKER.search(name)
    ]
    places = {}
    for body, columns in grouped(
        (body, column) for body, column in sided if body is not None
    ).items():
        parts = []
        for column in columns:
            values = markers.values[:, column]
            seen = np.isfinite(values).all(axis=1)
            if seen.sum() < 2:
                continue
            parts.append(
                np.column_stack(
                    [np.interp(time, markers.time[seen], values[seen, axis]) for axis in range(3)]
                )
            )
        if parts:
            places[body] = np.stack(parts, axis=1)
    return places


def side_of(name: str) -> str:
    """Side of a marker by its name: "right", "left", or "" where it has none."""
    side = split_side(name)[1]
    if not side and other_side(name, capitals=True):
        side = "right" if name[:1].upper() == "R" or name.lower().startswith("right") else "left"
    if not side and re.match(r"[rl][A-Z]", name):
        side = "right" if name[0] == "r" else "left"
    return side
