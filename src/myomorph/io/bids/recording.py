"""A recording of markers, forces and events as files of BIDS, and back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from myomorph.io.bids.signals import (
    AXES,
    MOTION,
    Channel,
    Signals,
    beside,
    read_signals,
    read_tsv,
    signals_of,
    write_json,
    write_tsv,
)
from myomorph.io.parsing.text import number, without_far_away
from myomorph.model.arrays import Array
from myomorph.model.errors import BadData, BadFile
from myomorph.model.series import Event, ForcePlate, Markers, Series, Trial, Wrenches

EVENTS = "_events.tsv"
MARKERS, FORCES = "markers", "forces"
"""Tracking systems of a recording, by what they give."""
PARTS = {"force": ("MISC", "N"), "point": ("POS", "m"), "torque": ("MISC", "N*m")}
"""Of a force: its vector, the point it acts at and the free torque about that, with type and unit."""
MARGIN = 0.2
"""How far a plate whose corners are not known goes beyond its centers of pressure [m]."""
LOADED = 20.0  # Force from which a plate carries somebody [N].
EVENT_FACTS = {
    "trial_type": {"Description": "what happened"},
    "side": {"Description": "side of the body, n/a for both or none"},
}


def marker_signals(markers: Markers, facts: Mapping[str, Any]) -> Signals:
    """Markers as channels."""
    channels = [Channel(f"{name}_{axis}", "POS", "m", axis, name) for name in markers.names for axis in AXES]
    return signals_of(markers, channels, facts)


def force_signals(wrenches: Wrenches, facts: Mapping[str, Any]) -> Signals:
    """Forces, their points of application and free torques as channels."""
    channels = [
        Channel(f"{name}_{part}_{axis}", kind, unit, axis, name, body or "n/a")
        for name, body in zip(wrenches.names, wrenches.bodies, strict=True)
        for part, (kind, unit) in PARTS.items()
        for axis in AXES
    ]
    values = np.stack([wrenches.forces, wrenches.points, wrenches.torques], axis=2).reshape(len(wrenches), -1)
    return signals_of(Series(wrenches.time, tuple(each.name for each in channels), values), channels, facts)


def write_events(stem: Path, events: Sequence[Event], start: float) -> None:
    """Write STEM_events.tsv; onsets count from the first frame, at `start` [s]."""
    rows = [(event.time - start, 0, event.label, event.side) for event in sorted(events, key=lambda each: each.time)]
    write_tsv(stem.with_name(stem.name + EVENTS), ("onset", "duration", "trial_type", "side"), rows)
    write_json(stem.with_name(f"{stem.name}_events.json"), EVENT_FACTS)


def read_motion_trial(path: Path) -> Trial:
    """Markers of a motion file, with the forces and events of the same recording in files beside it."""
    signals = read_signals(path)
    parts = [part for part in path.name.removesuffix(MOTION).split("_") if not part.startswith("tracksys-")]
    others = [
        other
        for other in sorted(path.parent.glob(f"*{MOTION}"))
        if other != path and [part for part in other.name.split("_")[:-1] if not part.startswith("tracksys-")] == parts
    ]
    markers, notes = markers_of(signals, path)
    plates, plate_time = plates_of(signals), signals.time
    for other in others if not plates else ():
        more = read_signals(other)
        if plates := plates_of(more):
            plate_time = more.time
            break
    if markers is None and not plates:
        raise BadFile(path, "holds no positions of markers and no forces", "its channels have other types or units")
    events = tuple(
        Event(onset + float(signals.time[0]), _known(row.get("trial_type")), _known(row.get("side")))
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


def markers_of(signals: Signals, path: Path) -> tuple[Markers | None, list[str]]:
    """Points of which a position is all that is known as markers [m], None without any, and what is odd."""
    groups = {
        point: [group["m", axis] for axis in AXES]
        for point, group in signals.by_point.items()
        if all(("m", axis) in group and signals.channels[group["m", axis]].kind == "POS" for axis in AXES)
        and ("N", "x") not in group
    }
    if not groups:
        return None, []
    notes: list[str] = []
    try:
        values = without_far_away(signals.values[:, list(groups.values())], notes)
        return Markers(signals.time, tuple(groups), values), notes
    except BadData as error:
        raise BadFile(path, str(error)) from None


def plates_of(signals: Signals) -> tuple[ForcePlate, ...]:
    """Points with a force as plates; corners that the file does not know lie around the centers of pressure."""
    corners = _known_corners(signals.facts.get("ForcePlates"))
    plates = []
    for point, group in signals.by_point.items():
        if ("N", "x") not in group:
            continue
        force, place, torque = (
            np.column_stack([_column(signals, group.get((unit, axis))) for axis in AXES]) for _, unit in PARTS.values()
        )
        torque = np.nan_to_num(torque)
        around = corners.get(point)
        plates.append(ForcePlate(point, 1, _corners(force, place) if around is None else around, force, place, torque))
    return tuple(plates)


def _column(signals: Signals, column: int | None) -> Array:
    return np.full(len(signals), np.nan) if column is None else signals.values[:, column]


def _corners(force: Array, place: Array) -> Array:
    """(4, 3) of a level rectangle, y upwards."""
    loaded = (np.linalg.norm(np.nan_to_num(force), axis=1) > LOADED) & np.isfinite(place).all(axis=1)
    points = place[loaded] if loaded.any() else np.zeros((1, 3))
    (low_x, height, low_z), (high_x, _, high_z) = points.min(axis=0) - MARGIN, points.max(axis=0) + MARGIN
    height = float(np.median(points[:, 1]))
    return np.array([[x, height, z] for x, z in ((high_x, low_z), (low_x, low_z), (low_x, high_z), (high_x, high_z))])


def _known_corners(plates: Any) -> dict[str, Array]:
    """Corners (4, 3) of plates by name, as far as facts hold them."""
    try:
        corners = {str(plate["Name"]): np.array(plate["Corners"], np.float64) for plate in plates or ()}
    except (TypeError, KeyError, ValueError, OverflowError):
        return {}
    return {name: values for name, values in corners.items() if values.shape == (4, 3) and np.isfinite(values).all()}


def _onset(row: Mapping[str, str], file: Path) -> float:
    try:
        return number(row.get("onset") or "n/a")
    except ValueError:
        raise BadFile(file, f"has an onset that is no number: '{row['onset']}'") from None


def _known(text: str | None) -> str:
    return "" if text in (None, "n/a") else str(text)
