"""Signals over time as BIDS has those of motion: a table without a heading, and files beside it.

Of `A_tracksys-B_motion.tsv` the channels stand in `A_tracksys-B_channels.tsv`, all else in
`A_tracksys-B_motion.json`, or in files higher up whose names have some of its parts (BIDS
specification 1.11, motion; inheritance principle).
"""

from __future__ import annotations

import csv
import json
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from myomorph.core.io.parsing.door import within_time
from myomorph.core.io.parsing.text import (
    TableBody,
    file_text,
    parse_cells,
    quick_numbers,
    rising,
    written,
)
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData, BadFile
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.messages import Message
from myomorph.core.model.series import Series

MOTION = "_motion.tsv"
CHANNELS = "_channels.tsv"
UNKNOWN = "n/a"
DATASET = "dataset_description.json"  # File that the top folder of a dataset has.
MAX_DEPTH = 4  # Folders from a file to the top: of its kind, session and subject.
HINT = "expected a motion file of BIDS, whose columns stand in the _channels.tsv beside it"
LATENCY = "LATENCY"
# Key of the time of the first row on the clock of the recording [s]; without it rows begin at 0.
START = "StartTime"
RATE = "SamplingFrequency"
COLUMNS = ("name", "component", "type", "tracked_point", "units", "placement", "reference_frame")
COUNTED = ("ACCEL", "ANGACCEL", "GYRO", "JNTANG", LATENCY, "MAGN", "ORNT", "POS", "VEL")
LARGEST = 1e12  # Rates [Hz] and times [s] beyond are none.
SI = {
    "deg": ("rad", np.pi / 180.0),
    "degree": ("rad", np.pi / 180.0),
    "cm": ("m", 1e-2),
    "mm": ("m", 1e-3),
    "N*mm": ("N*m", 1e-3),
    "kN": ("N", 1e3),
    "mV": ("V", 1e-3),
    "uV": ("V", 1e-6),
}
"""Units that become others when they are read, and their factor."""
AXES = ("x", "y", "z")


@dataclass(frozen=True)
class Channel:
    """A column of a motion file."""

    name: str
    kind: str  # a type of BIDS: POS, JNTANG, MISC, ...
    unit: str = UNKNOWN
    component: str = UNKNOWN  # x, y or z
    point: str = UNKNOWN  # what is tracked
    placement: str = UNKNOWN  # where that is: of a force the body it acts on


@read_only
class Signals(Series):
    """Columns of a motion file.

    Values (frames, channels) are in the channels' units, NaN where unknown.
    """

    channels: tuple[Channel, ...] = ()  # what each column is
    # what is known beside them, as JSON holds it
    facts: Mapping[str, Any] = field(default_factory=lambda: FrozenMap({}))

    @property
    def by_point(self) -> dict[str, dict[tuple[str, str], int]]:
        """Columns with a component by tracked point, unit and component."""
        groups: dict[str, dict[tuple[str, str], int]] = {}
        for column, channel in enumerate(self.channels):
            if channel.component in AXES:
                groups.setdefault(channel.point, {}).setdefault(
                    (channel.unit, channel.component), column
                )
        return groups


def signals_of(
    series: Series, channels: Sequence[Channel], facts: Mapping[str, Any] | None = None
) -> Signals:
    """Describe each column of a series (frames, channels)."""
    values = series.values.reshape(len(series), -1)
    return Signals(
        series.time,
        tuple(each.name for each in channels),
        values,
        channels=tuple(channels),
        facts=facts or {},
    )


def write_signals(stem: Path, signals: Signals, frame: str = "") -> None:
    """Write STEM_motion.tsv, its channels and its facts.

    `frame`: the axes of what has components. Numbers are written so that they are read back as they
    are.
    """
    start = float(signals.time[0]) if len(signals) else 0.0
    channels = (Channel("latency", LATENCY, "s"), *signals.channels)
    where = {True: "ground" if frame else UNKNOWN, False: UNKNOWN}
    rows = (
        (
            each.name,
            each.component,
            each.kind,
            each.point,
            each.unit,
            each.placement,
            where[each.component in AXES],
        )
        for each in channels
    )
    write_tsv(stem.with_name(stem.name + CHANNELS), COLUMNS, rows)
    about = {name: text for name, text in signals.facts.items() if name == "Description"}
    if frame:
        about["reference_frame"] = {
            "Levels": {"ground": {"Description": frame, "RotationRule": "right-hand"}}
        }
    if about:
        write_json(stem.with_name(f"{stem.name}_channels.json"), about)
    counts = Counter(each.kind for each in channels)
    rate = signals.rate if np.isfinite(signals.rate) else UNKNOWN
    facts = {
        RATE: rate,
        f"{RATE}Effective": rate,
        START: start,
        "MotionChannelCount": len(channels),
        **{f"{kind}ChannelCount": counts[kind] for kind in COUNTED},
        "MISCChannelCount": counts["MISC"],
        "TrackedPointsCount": len({each.point for each in channels} - {UNKNOWN}),
        "MissingValues": UNKNOWN,
    }
    write_json(stem.with_name(f"{stem.name}_motion.json"), facts | dict(signals.facts))
    with written(stem.with_name(stem.name + MOTION)) as stream:
        for row in np.column_stack([signals.time - start, signals.values]).tolist():
            stream.write("\t".join(map(cell, row)) + "\n")


def read_signals(path: Path) -> Signals:
    """Read a motion file, in m, rad, N and V; raises `BadFile`."""
    if not path.name.endswith(MOTION):
        raise BadFile(path, "is no motion file of BIDS", f"its name would end in {MOTION}")
    channels = channels_of_file(path, COLUMNS[:5])
    facts = facts_of_file(path)
    text = file_text(path, HINT)
    notes = list[Message]()
    width = len(text.split("\n", 1)[0].split("\t"))
    if width != len(channels):
        raise BadFile(path, f"has {width} columns, but its channels are {len(channels)}", HINT)
    values = quick_numbers(text, "\t", width)
    if values is None:
        body = TableBody(text=text, delimiter="\t", path=path, hint=HINT)
        values = parse_cells(body, width, notes)
    time = _time_of(path, values, channels, facts)
    kept = [column for column in range(width) if channels[column].kind != LATENCY]
    factors = [SI.get(channels[column].unit, ("", 1.0))[1] for column in kept]
    plain = tuple(
        replace(channels[column], unit=SI.get(channels[column].unit, (channels[column].unit,))[0])
        for column in kept
    )
    names = tuple(each.name for each in plain)
    try:
        return Signals(
            time, names, values[:, kept] * factors, channels=plain, facts=FrozenMap(facts)
        )
    except BadData as error:
        raise BadFile(path, str(error)) from None


def _time_of(
    path: Path, values: Array, channels: Sequence[Channel], facts: Mapping[str, Any]
) -> Array:
    """Return the times of a motion file's rows (frames,) [s].

    They come from its channel of latencies, or from its sampling rate where it has none. `values`:
    (frames, channels).
    """
    clock = next((column for column, each in enumerate(channels) if each.kind == LATENCY), None)
    rate = number_of(facts, RATE)
    if clock is None and not rate > 0.0:
        raise BadFile(
            path, f"has neither latencies nor a {RATE}", "state it in the _motion.json beside it"
        )
    time = np.arange(len(values)) / rate if clock is None else values[:, clock]
    time = time + number_of(facts, START)
    if not rising(time).all():
        raise BadFile(path, "its latencies do not rise from row to row")
    return time


def channels_of_file(path: Path, needed: Sequence[str]) -> tuple[Channel, ...]:
    """Return the channels of a file of signals, with the `needed` columns of its _channels.tsv."""
    files = beside(path, CHANNELS)
    if not files:
        raise BadFile(
            path, "has no _channels.tsv beside it", "a dataset of BIDS has one, by the same name"
        )
    rows = read_tsv(files[-1])
    missing = [name for name in needed if rows and name not in rows[0]]
    if missing:
        raise BadFile(files[-1], f"has no column '{missing[0]}'", f"expected {', '.join(needed)}")
    return tuple(
        Channel(
            name=row.get("name") or UNKNOWN,
            kind=row.get("type") or UNKNOWN,
            unit=row.get("units") or UNKNOWN,
            component=row.get("component") or UNKNOWN,
            point=row.get("tracked_point") or UNKNOWN,
            placement=row.get("placement") or UNKNOWN,
        )
        for row in rows
    )


def facts_of_file(path: Path) -> dict[str, Any]:
    """Return what JSON files state of a file of signals, those beside it last."""
    facts: dict[str, Any] = {}
    ending = "_" + path.stem.rsplit("_", 1)[-1] + ".json"
    for file in beside(path, ending):
        try:
            facts |= json.loads(file_text(file, HINT))
        except (ValueError, TypeError, RecursionError):
            raise BadFile(file, "is not JSON of names and values") from None
    return facts


def number_of(facts: Mapping[str, Any], name: str) -> float:
    """Return a finite number of facts, 0 where it is none."""
    value = facts.get(name)
    return float(value) if isinstance(value, int | float) and abs(value) < LARGEST else 0.0


def beside(path: Path, ending: str) -> list[Path]:
    """Return files that belong to a file of a dataset, from the top downwards.

    They have its ending and parts of its name.
    """
    parts = set(path.stem.split("_")[:-1])
    homes = [path.parent, *path.parent.parents][:MAX_DEPTH]
    top = next((depth for depth, home in enumerate(homes) if (home / DATASET).is_file()), 0)
    files = (
        file for home in reversed(homes[: top + 1]) for file in sorted(home.glob(f"*{ending}"))
    )
    return [
        file for file in files if set(file.name.removesuffix(ending).split("_")) <= parts | {""}
    ]


def read_tsv(path: Path) -> list[dict[str, str]]:
    """Rows of a table with a heading."""
    try:
        lines = file_text(path, HINT).splitlines()
        rows = csv.DictReader(lines, delimiter="\t", quoting=csv.QUOTE_NONE)
        return list(within_time(rows, path))
    except csv.Error as error:
        raise BadFile(path, f"is no table: {error}", HINT) from None


def write_tsv(path: Path, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Write a table with a heading; numbers so that they are read back as they are."""
    with written(path) as stream:
        for row in (columns, *rows):
            stream.write("\t".join(re.sub(r"\s+", " ", cell(value)) for value in row) + "\n")


def write_json(path: Path, facts: Mapping[str, Any]) -> None:
    """Write names and values."""
    with written(path) as stream:
        json.dump(facts, stream, indent=2, ensure_ascii=False)
        stream.write("\n")


def cell(value: object) -> str:
    """Write a value as it stands in a table, n/a where it is not known."""
    if isinstance(value, float):
        return repr(value) if np.isfinite(value) else UNKNOWN
    return str(value) or UNKNOWN
