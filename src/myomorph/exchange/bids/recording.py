"""A recording of markers, forces and events as files of BIDS, and back."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from myomorph.core.io.parsing.door import check_file
from myomorph.core.io.parsing.text import number, without_far_away
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData, BadFile, from_extra
from myomorph.core.model.messages import Message
from myomorph.core.model.series import Analog, Event, ForcePlate, Markers, Series, Trial, Wrenches
from myomorph.exchange.bids.signals import (
    AXES,
    CHANNELS,
    MOTION,
    RATE,
    SI,
    START,
    UNKNOWN,
    Channel,
    Signals,
    beside,
    channels_of_file,
    facts_of_file,
    number_of,
    read_signals,
    read_tsv,
    signals_of,
    write_json,
    write_tsv,
)

EVENTS = "_events.tsv"
MARKERS = "markers"
FORCES = "forces"  # Tracking systems of a recording, by what they give.
PARTS = {"force": ("MISC", "N"), "point": ("POS", "m"), "torque": ("MISC", "N*m")}
"""Of a force: its vector, the point it acts at and the free torque about that, with type and unit.
"""
MARGIN = 0.2  # How far a plate whose corners are not known goes beyond its centers of pressure [m].
LOADED = 20.0  # Force from which a plate carries somebody [N].
EVENT_FACTS = {
    "trial_type": {"Description": "what happened"},
    "side": {"Description": "side of the body, n/a for both or none"},
}


def marker_signals(markers: Markers, facts: Mapping[str, Any]) -> Signals:
    """Markers as channels."""
    channels = [
        Channel(name=f"{name}_{axis}", kind="POS", unit="m", component=axis, point=name)
        for name in markers.names
        for axis in AXES
    ]
    return signals_of(markers, channels, facts)


def force_signals(wrenches: Wrenches, facts: Mapping[str, Any]) -> Signals:
    """Write forces, their points of application and free torques as channels."""
    channels = [
        Channel(
            name=f"{name}_{part}_{axis}",
            kind=kind,
            unit=unit,
            component=axis,
            point=name,
            placement=body or "n/a",
        )
        for name, body in zip(wrenches.names, wrenches.bodies, strict=True)
        for part, (kind, unit) in PARTS.items()
        for axis in AXES
    ]
    values = np.stack([wrenches.forces, wrenches.points, wrenches.torques], axis=2).reshape(
        len(wrenches), -1
    )
    return signals_of(
        Series(wrenches.time, tuple(each.name for each in channels), values), channels, facts
    )


def write_events(stem: Path, events: Sequence[Event], start: float) -> None:
    """Write STEM_events.tsv; onsets count from the first frame, at `start` [s]."""
    rows = [
        (event.time - start, 0, event.label, event.side)
        for event in sorted(events, key=lambda each: each.time)
    ]
    write_tsv(stem.with_name(stem.name + EVENTS), ("onset", "duration", "trial_type", "side"), rows)
    write_json(stem.with_name(f"{stem.name}_events.json"), EVENT_FACTS)


def read_motion_trial(path: Path) -> Trial:
    """Read markers of a motion file, with the forces and events of the same recording.

    Those are in files beside it.
    """
    signals = read_signals(path)
    markers, notes = markers_of(signals, path)
    plates = plates_of(signals)
    plate_time = signals.time
    for other in [] if plates else _other_systems(path):
        more = read_signals(other)
        if plates := plates_of(more):
            plate_time = more.time
            break
    if markers is None and not plates:
        raise BadFile(
            path,
            "holds no positions of markers and no forces",
            "its channels have other types or units",
        )
    events = tuple(
        Event(
            onset + float(signals.time[0]), _known(row.get("trial_type")), _known(row.get("side"))
        )
        for file in beside(path, EVENTS)[-1:]
        for row in read_tsv(file)
        if np.isfinite(onset := _onset(row, file))
    )
    return Trial(
        markers=markers,
        plates=plates,
        plate_time=plate_time if plates else np.zeros(0),
        events=events,
        warnings=tuple(notes),
        source=str(path),
    )


def _other_systems(path: Path) -> list[Path]:
    """Return the motion files of the same recording by other tracking systems."""

    def entities(file: Path) -> list[str]:
        """Return the parts of a file's name but the tracking system."""
        parts = file.name.removesuffix(MOTION).split("_")
        return [part for part in parts if not part.startswith("tracksys-")]

    files = sorted(path.parent.glob(f"*{MOTION}"))
    return [file for file in files if file != path and entities(file) == entities(path)]


def markers_of(signals: Signals, path: Path) -> tuple[Markers | None, list[Message]]:
    """Return points of which only a position is known as markers [m].

    None without any. The second value reports what is odd.
    """
    groups = {
        point: [group["m", axis] for axis in AXES]
        for point, group in signals.by_point.items()
        if all(
            ("m", axis) in group and signals.channels[group["m", axis]].kind == "POS"
            for axis in AXES
        )
        and ("N", "x") not in group
    }
    if not groups:
        return None, []
    notes: list[Message] = []
    try:
        values = without_far_away(signals.values[:, list(groups.values())], notes)
        return Markers(signals.time, tuple(groups), values), notes
    except BadData as error:
        raise BadFile(path, str(error)) from None


def plates_of(signals: Signals) -> tuple[ForcePlate, ...]:
    """Return points with a force as plates.

    Corners that the file does not know lie around the centers of pressure.
    """
    corners = _known_corners(signals.facts.get("ForcePlates"))
    plates = []
    for point, group in signals.by_point.items():
        if ("N", "x") not in group:
            continue
        force = _part(signals, group, "force")
        place = _part(signals, group, "point")
        torque = np.nan_to_num(_part(signals, group, "torque"))
        around = corners.get(point)
        plates.append(
            ForcePlate(
                name=point,
                kind=1,
                corners=_corners(force, place) if around is None else around,
                forces=force,
                points=place,
                torques=torque,
            )
        )
    return tuple(plates)


def _part(signals: Signals, group: Mapping[tuple[str, str], int], part: str) -> Array:
    """Return a part of a force (frames, 3) by its name in `PARTS`."""
    _, unit = PARTS[part]
    return np.column_stack([_column(signals, group.get((unit, axis))) for axis in AXES])


def _column(signals: Signals, column: int | None) -> Array:
    return np.full(len(signals), np.nan) if column is None else signals.values[:, column]


def _corners(force: Array, place: Array) -> Array:
    """(4, 3) of a level rectangle, y upwards."""
    loaded = (np.linalg.norm(np.nan_to_num(force), axis=1) > LOADED) & np.isfinite(place).all(
        axis=1
    )
    points = place[loaded] if loaded.any() else np.zeros((1, 3))
    (low_x, height, low_z) = points.min(axis=0) - MARGIN
    (high_x, _, high_z) = points.max(axis=0) + MARGIN
    height = float(np.median(points[:, 1]))
    return np.array(
        [
            [x, height, z]
            for x, z in ((high_x, low_z), (low_x, low_z), (low_x, high_z), (high_x, high_z))
        ]
    )


def _known_corners(plates: Any) -> dict[str, Array]:
    """Corners (4, 3) of plates by name, as far as facts hold them."""
    try:
        corners = {
            str(plate["Name"]): np.array(plate["Corners"], np.float64) for plate in plates or ()
        }
    except (TypeError, KeyError, ValueError, OverflowError):
        return {}
    return {
        name: values
        for name, values in corners.items()
        if values.shape == (4, 3) and np.isfinite(values).all()
    }


def _onset(row: Mapping[str, str], file: Path) -> float:
    try:
        return number(row.get("onset") or "n/a")
    except ValueError:
        raise BadFile(file, f"has an onset that is no number: '{row['onset']}'") from None


def _known(text: str | None) -> str:
    return "" if text in (None, "n/a") else str(text)


ENDINGS = (".bdf", ".edf")
UNEVEN = 0.01  # Share of a sample by which times may be off an even clock.
DIGITS = 7  # Characters that a header has for the largest value of a channel, the sign apart.
LABEL = 16  # Characters of a channel's name in the header.
FACTS: dict[str, Any] = {
    "EMGPlacementScheme": "Other",
    "EMGPlacementSchemeDescription": "not stated by the files that the recording was read from",
    "EMGReference": UNKNOWN,
    "PowerLineFrequency": UNKNOWN,
    "RecordingType": "continuous",
    "SoftwareFilters": UNKNOWN,
}
"""What BIDS asks for and recordings do not say."""


def write_emg(stem: Path, emg: Series, units: Sequence[str], facts: Mapping[str, Any]) -> None:
    """Write STEM_emg.bdf, its channels and its facts.

    A value is rounded to a part in 2^23 of the largest one of its channel. Raises `BadData` where
    samples are not evenly spaced, `MissingPackage` without edfio.
    """
    edfio = from_extra("bids", "edfio")
    rate = emg.rate
    if (
        len(emg) < 2
        or np.abs(emg.time - emg.time[0] - np.arange(len(emg)) / rate).max() * rate > UNEVEN
    ):
        raise BadData("EMG has no even sampling rate, which a BDF file needs: resample it")
    duration = float(f"{len(emg) / rate:.7g}"[:8])
    signals = []
    rows = []
    for name, unit, column in zip(emg.names, units, emg.values.T, strict=True):
        lost = int((~np.isfinite(column)).sum())
        column = np.nan_to_num(column, nan=0.0, posinf=0.0, neginf=0.0)
        largest = float(np.abs(column).max(initial=0.0))
        if not largest < 10.0**DIGITS:
            raise BadData(
                f"EMG reaches {largest:.3g}, more than a BDF file holds: use another unit"
            )
        # The smallest number of a header's length that no value passes.
        decimals = DIGITS - 1 - len(str(int(largest)))
        limit = max(math.ceil(largest * 10.0**decimals) / 10.0**decimals, 10.0**-5)
        label = name.encode("ascii", "replace").decode()[:LABEL]
        signals.append(
            edfio.BdfSignal(
                column,
                len(emg) / duration,
                label=label,
                physical_dimension=unit[:8],
                physical_range=(-limit, limit),
            )
        )
        status = (
            ("bad", f"{lost} samples are not known and written as 0") if lost else ("good", UNKNOWN)
        )
        rows.append((name, "EMG", unit or UNKNOWN, name, *status))
    edfio.Bdf(signals, data_record_duration=duration).write(stem.with_name(f"{stem.name}_emg.bdf"))
    columns = ("name", "type", "units", "target_muscle", "status", "status_description")
    write_tsv(stem.with_name(stem.name + CHANNELS), columns, rows)
    known = {
        RATE: rate,
        "RecordingDuration": len(emg) / rate,
        "EMGChannelCount": len(rows),
        START: float(emg.time[0]),
    }
    write_json(stem.with_name(f"{stem.name}_emg.json"), FACTS | known | dict(facts))


def read_emg(path: Path) -> Analog:
    """Read channels of a BDF or EDF file (samples, channels), in V where they are volts.

    Of a file in a dataset, only channels of EMG are read, by the names and on the clock that files
    beside it state. Raises `BadFile`, or `MissingPackage` without edfio.
    """
    channels = _emg_channels(path, _edf_channels(path))
    sizes = {len(channel.samples) for channel in channels}
    if len(sizes) != 1:
        raise BadFile(
            path,
            "holds no EMG channel" if not sizes else "holds channels of several rates",
            "split it",
        )
    facts = facts_of_file(path)
    rate = number_of(facts, RATE) or channels[0].rate
    if not rate > 0.0:
        raise BadFile(path, "has no sampling rate")
    time = number_of(facts, START) + np.arange(sizes.pop()) / rate
    turned = [SI.get(each.unit.replace("µ", "u"), (each.unit, 1.0)) for each in channels]
    values = np.column_stack(
        [each.samples * factor for each, (_, factor) in zip(channels, turned, strict=True)]
    )
    names = tuple(each.name for each in channels)
    return Analog(time, names, values, units=tuple(unit for unit, _ in turned))


class _EdfChannel(NamedTuple):
    """A channel of a BDF or EDF file: its name, its unit, its rate [Hz] and (samples,)."""

    name: str
    unit: str
    rate: float
    samples: Array


def _edf_channels(path: Path) -> list[_EdfChannel]:
    """Read the channels of a BDF or EDF file."""
    edfio = from_extra("bids", "edfio")
    check_file(path, "EMG")
    try:
        file = (edfio.read_bdf if path.suffix.lower() == ".bdf" else edfio.read_edf)(str(path))
        channels = [
            _EdfChannel(
                name=signal.label,
                unit=signal.physical_dimension,
                rate=signal.sampling_frequency,
                samples=signal.data,
            )
            for signal in file.signals
        ]
    except OSError as error:
        raise BadFile(path, f"cannot be read ({error.strerror or error})") from None
    except Exception as error:
        raise BadFile(path, f"is no BDF or EDF file: {error}") from None
    if not channels:
        raise BadFile(path, "holds no channel")
    return channels


def _emg_channels(path: Path, channels: Sequence[_EdfChannel]) -> list[_EdfChannel]:
    """Return channels of EMG, with names and units of a _channels.tsv beside the file.

    Without one, all channels are returned as they are.
    """
    if not beside(path, CHANNELS):
        return list(channels)
    listed = channels_of_file(path, ("name", "type", "units"))
    if len(listed) != len(channels):
        raise BadFile(
            path, f"holds {len(channels)} channels, but its _channels.tsv names {len(listed)}"
        )
    return [
        channel._replace(name=row.name, unit=row.unit.replace(UNKNOWN, ""))
        for channel, row in zip(channels, listed, strict=True)
        if row.kind == "EMG"
    ]
