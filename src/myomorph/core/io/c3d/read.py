"""C3D files: markers, analog channels, force plates, events and facts about the recording."""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from myomorph.core.io.c3d.plates import plate_recordings, unit_of_plates
from myomorph.core.io.c3d.raw import RawC3d, read_raw_c3d
from myomorph.core.io.parsing.text import unique_names, without_far_away
from myomorph.core.model.arrays import Array
from myomorph.core.model.causes import LABELS, READING, UNITS
from myomorph.core.model.errors import BadFile
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.messages import Message
from myomorph.core.model.segment_poses import SegmentPoses
from myomorph.core.model.series import Analog, Event, Markers, Series, Trial

# Parameters of a recording's date, in the groups of several makers; C3D itself has none.
DATE = re.compile(
    r"(trial_|capture_|recording_|acquisition_|file_)?date(_time|_of_\w*record\w*)?", re.I
)
LENGTH_UNITS = {
    "mm": 1e-3,
    "mil": 1e-3,
    "cm": 1e-2,
    "cen": 1e-2,
    "dm": 0.1,
    "m": 1.0,
    "in": 0.0254,
}
"""Unit of length [m] by the letters with which its name begins."""
MAX_METERS = 20.0  # Median of positions, above which a unit without a name is taken as mm.
MAX_TIME = 1e6  # Of an event [s].
MAX_RATE = 1e6  # Of frames [Hz].
MAX_SKEW = 1e-2  # Of a rotation matrix R, of an entry of R R^T - 1.
POSE_LABEL = re.compile(r"_4x4$", re.IGNORECASE)  # Ends the names of Theia3D's segments.
HINT = "try to open it in the program that wrote it and save it again as C3D"
QUANTITIES = ("ANGLES", "MOMENTS", "POWERS", "FORCES", "SCALARS", "REACTIONS", "USERMOS")
QUANTITY_NAME = re.compile(r"(angles?|moments?|powers?|forces?|grf)$", re.IGNORECASE)
UNLABELLED = re.compile(r"(\*.*|unlabel\w*.*|unidentified.*|uname\*?\d*)?$", re.IGNORECASE)


def read_c3d(path: str | os.PathLike[str]) -> Trial:
    """Read a C3D file: lengths in meters, a hidden marker as NaN, time 0 at frame 1.

    Points that a program computed (angles, moments, powers, forces) are in `other_points`; computed
    positions stay among the markers, as OpenSim has it. Poses of segments (Theia3D) are `segments`.
    Force plates are `plate_recordings`: `contact.plates` makes forces of them. EMG stays in
    `analog`; see `c3d.emg`.

    Parameters
    ----------
    path : of the file

    Returns
    -------
    markers (frames, markers, 3) [m] in the file's axes, analog channels (samples, channels) in the
    units that the file names, plates in [N, N m, m], events [s]; `facts` has what the header says,
    `warnings` what was assumed or left out

    Raises
    ------
    BadFile : it cannot be read, is no C3D file, holds no whole frame, or states an impossible rate
    """
    path = Path(path)
    raw = read_raw_c3d(path)
    if not 0.0 < raw.point_rate < MAX_RATE:
        raise BadFile(path, f"states a frame rate of {raw.point_rate:g} Hz", HINT)
    notes = list(raw.remarks)
    facts = _facts(raw)
    meters = _meters(raw, notes)
    start = (max(raw.first_frame, 1) - 1) / raw.point_rate
    time = start + np.arange(len(raw.points)) / raw.point_rate
    markers, others = _points(raw, time, meters, facts, notes)
    analog = _analog(raw, start, notes)
    plates = plate_recordings(raw, meters, notes)
    segments = _segments(raw, meters, start)
    return Trial(
        markers=markers,
        plate_recordings=plates,
        plate_time=analog.time if analog is not None else np.zeros(0),
        analog=analog,
        events=_events(raw, notes),
        other_points=others,
        segments=segments,
        facts=FrozenMap(facts),
        warnings=tuple(notes),
        source=str(path),
    )


def _meters(raw: RawC3d, notes: list[Message]) -> float:
    """Find the length of the file's unit, by its name, the median of the positions or the plates.

    Parameters
    ----------
    raw : points in the file's unit
    notes : gets a warning where the unit was guessed

    Returns
    -------
    the unit [m]
    """
    text = _first_text(raw, "POINT", "UNITS").lower()
    for begin, meters in LENGTH_UNITS.items():
        if text.startswith(begin):
            return meters
    if np.isfinite(raw.points).any():
        unit = "mm" if float(np.nanmedian(np.abs(raw.points))) > MAX_METERS else "m"
    else:
        # Without points only plates, or segments that stand in a laboratory, have a size.
        unit = unit_of_plates(raw) or ("mm" if raw.rotations.size else "m")
    notes.append(
        UNITS.message(f"the file states no known unit of length ('{text}'): taken as {unit}")
    )
    return LENGTH_UNITS[unit]


def _segments(raw: RawC3d, meters: float, start: float) -> SegmentPoses | None:
    """Read poses of segments, None where the file holds none.

    Parameters
    ----------
    raw : poses (samples, segments, 4, 4)
    meters : the file's unit of length [m]
    start : time of the first sample [s]
    """
    samples, count = raw.rotations.shape[:2]
    if not samples or not 0.0 < raw.rotation_rate < MAX_RATE:
        return None
    labels = _filled(raw.texts("ROTATION", "LABELS"), count)
    names = [POSE_LABEL.sub("", label) or f"segment_{i + 1}" for i, label in enumerate(labels)]
    rotations = raw.rotations[:, :, :3, :3]
    # A matrix that does not rotate marks a segment that was not seen.
    gram = rotations @ rotations.swapaxes(2, 3)
    odd = ~(np.abs(gram - np.eye(3)).max(axis=(2, 3)) < MAX_SKEW)
    return SegmentPoses(
        time=start + np.arange(samples) / raw.rotation_rate,
        names=unique_names(names, "segment", []),
        rotations=np.where(odd[:, :, None, None], np.nan, rotations),
        origins=np.where(odd[:, :, None], np.nan, raw.rotations[:, :, :3, 3] * meters),
    )


@dataclass(frozen=True, kw_only=True)
class _PointLabels:
    """Labels of the points, and which of them are what.

    Attributes
    ----------
    labels : one per point, made up where no point has one
    unlabelled : (points,) whether the point has no label of its own
    computed : (points,) whether its label is one of a computed quantity
    """

    labels: list[str]
    unlabelled: list[bool]
    computed: list[bool]

    def markers(self) -> list[int]:
        """Return the indices of the markers."""
        return self._with_label(computed=False)

    def quantities(self) -> list[int]:
        """Return the indices of the computed quantities."""
        return self._with_label(computed=True)

    def _with_label(self, computed: bool) -> list[int]:
        kinds = zip(self.unlabelled, self.computed, strict=True)
        return [
            index
            for index, (unlabelled, is_computed) in enumerate(kinds)
            if not unlabelled and is_computed == computed
        ]

    def prefixes(self) -> list[str]:
        """Names before a colon, as of subjects."""
        return sorted({label.rpartition(":")[0] for label in self.labels if ":" in label})

    def names(self) -> list[str]:
        """Labels without their prefixes where that keeps them apart."""
        short = [label.rpartition(":")[2].strip() or label for label in self.labels]
        counts = Counter(short)
        return [
            cut if counts[cut] == 1 else label
            for cut, label in zip(short, self.labels, strict=True)
        ]


def _points(
    raw: RawC3d, time: Array, meters: float, facts: dict[str, str], notes: list[Message]
) -> tuple[Markers | None, Series | None]:
    """Sort the points into markers and computed quantities.

    Parameters
    ----------
    raw : points (frames, points, 3) in the file's units, and their labels
    time : (frames,) [s]
    meters : the file's unit of length [m]
    facts : gets the prefixes of labels and the count of points without a label
    notes : gets a warning for what was assumed

    Returns
    -------
    markers (frames, markers, 3) [m], NaN where hidden, and computed quantities (frames, quantities,
    3) in the file's units; None for a kind that the file does not hold
    """
    if not raw.points.shape[1] or not len(time):
        return None, None
    labels = _point_labels(raw, notes)
    prefixes = labels.prefixes()
    if prefixes:
        facts["label prefixes"] = ", ".join(prefixes)
    if any(labels.unlabelled):
        facts["unlabelled points"] = str(sum(labels.unlabelled))
    names = labels.names()

    markers = None
    marked = labels.markers()
    positions = _positions(raw.points[:, marked] * meters, notes)
    if marked:
        marker_names = unique_names([names[index] for index in marked], "marker", notes)
        markers = Markers(time, marker_names, positions)
    quantities = None
    computed = labels.quantities()
    if computed:
        quantity_names = unique_names([names[index] for index in computed], "quantity", [])
        quantities = Series(time, quantity_names, raw.points[:, computed])
    return markers, quantities


def _point_labels(raw: RawC3d, notes: list[Message]) -> _PointLabels:
    """Read the labels of the points and sort them.

    Parameters
    ----------
    raw : parameters and points
    notes : gets a warning where labels were replaced, or no point has one
    """
    count = raw.points.shape[1]
    labels = _filled(raw.texts("POINT", "LABELS"), count)
    labels = _full_labels(labels, raw.texts("POINT", "DESCRIPTIONS"), notes)
    of_quantities = _labels_of_quantities(raw)
    computed = [label in of_quantities or bool(QUANTITY_NAME.search(label)) for label in labels]
    qualisys = any("qualisys" in text.lower() for text in raw.texts("MANUFACTURER", "COMPANY"))
    unlabelled = [_is_unlabelled(label, qualisys) for label in labels]
    if all(unlabelled):
        notes.append(
            LABELS.message(f"no point has a label: the {count} points were named unnamed_1, ...")
        )
        labels = [f"unnamed_{index + 1}" for index in range(count)]
        unlabelled = [False] * count
    return _PointLabels(labels=labels, unlabelled=unlabelled, computed=computed)


def _labels_of_quantities(raw: RawC3d) -> set[str]:
    """Collect the labels of points that hold no position, by the lists that the file keeps."""
    own_kinds = raw.texts("POINT", "TYPE_GROUPS")[::2]
    kinds = [kind for kind in own_kinds if kind and "MARKER" not in kind.upper()]
    labels = {label for kind in (*QUANTITIES, *kinds) for label in raw.texts("POINT", kind)}
    return labels - {""}


def _is_unlabelled(label: str, qualisys: bool) -> bool:
    """Return whether a label is one that programs give to points that nobody has named."""
    if UNLABELLED.match(label):
        return True
    return qualisys and re.match(r"U\d+$", label) is not None


def _positions(values: Array, notes: list[Message]) -> Array:
    """Make positions NaN that are hidden or too far away.

    Programs differ in how they mark a hidden point; an exact zero in all three is never a place.

    Parameters
    ----------
    values : (frames, markers, 3) [m] as stored
    notes : gets a warning for positions that are too far away

    Returns
    -------
    (frames, markers, 3) [m]
    """
    finite = np.isfinite(values).all(axis=2, keepdims=True)
    values = np.where(finite, values, np.nan)
    zero = np.all(values == 0.0, axis=2, keepdims=True)
    return without_far_away(np.where(zero, np.nan, values), notes)


def _filled(texts: Sequence[str], count: int) -> list[str]:
    """Return so many texts, "" where there are fewer."""
    return [*texts[:count], *[""] * (count - len(texts))]


def _full_labels(labels: list[str], descriptions: Sequence[str], notes: list[Message]) -> list[str]:
    """Replace labels that old programs cut to four letters, so that they repeat.

    Parameters
    ----------
    labels : one per point
    descriptions : of the points, as the file has them
    notes : gets a warning where labels were replaced

    Returns
    -------
    the descriptions; or the labels, where these do not repeat, are longer, or descriptions are
    missing or repeat
    """
    repeat = len(set(labels)) < len(labels)
    if not repeat or max(map(len, labels)) > 4 or len(descriptions) < len(labels):
        return labels
    full = list(descriptions[: len(labels)])
    if not all(full) or len(set(full)) < len(full):
        return labels
    notes.append(
        LABELS.message(
            "the labels are cut to four letters and repeat: markers were named by their"
            " descriptions",
            severity="good to know",
        )
    )
    return full


def _analog(raw: RawC3d, start: float, notes: list[Message]) -> Analog | None:
    """Read the analog channels in the units that the file names.

    Parameters
    ----------
    raw : analog samples (samples, channels)
    start : time of the first sample [s]
    notes : gets a warning where samples are not finite or names occur twice

    Returns
    -------
    values (samples, channels), NaN where not finite; None where the file holds none
    """
    samples, channels = raw.analog.shape
    if not samples or not channels:
        return None
    rate = raw.analog_rate
    if not rate > 0:
        rate = raw.point_rate * samples / max(len(raw.points), 1)
    labels = _filled(raw.texts("ANALOG", "LABELS"), channels)
    names = [label or f"channel_{index + 1}" for index, label in enumerate(labels)]
    values = np.where(np.isfinite(raw.analog), raw.analog, np.nan)
    missing = np.count_nonzero(np.isnan(values))
    if missing:
        notes.append(READING.message(f"{missing} analog samples are not finite and were made NaN"))
    return Analog(
        start + np.arange(samples) / rate,
        unique_names(names, "channel", notes),
        values,
        units=tuple(_filled(raw.texts("ANALOG", "UNITS"), channels)),
    )


def _events(raw: RawC3d, notes: list[Message]) -> tuple[Event, ...]:
    """Read the events in order of time, those of the header where the parameters have none.

    Parameters
    ----------
    raw : parameters and events of the header are read
    notes : gets a warning for each that was left out

    Returns
    -------
    time [s], label and side ("Left", "Right", or "" for another)
    """
    events = _events_of_parameters(raw, notes)
    if not events:
        events = [
            Event(time, label)
            for label, time in raw.events
            if label.strip() and np.isfinite(time) and abs(time) < MAX_TIME
        ]
    return tuple(sorted(events, key=lambda event: event.time))


def _events_of_parameters(raw: RawC3d, notes: list[Message]) -> list[Event]:
    """Read the events of the group EVENT; those that are broken leave a warning in `notes`."""
    labels = raw.texts("EVENT", "LABELS")
    sides = raw.texts("EVENT", "CONTEXTS")
    times = raw.numbers("EVENT", "TIMES")
    used = raw.numbers("EVENT", "USED")
    stated = int(used[0]) if len(used) else len(labels)
    count = min(len(labels), len(times) // 2, stated)
    events = []
    for index in range(count):
        label = labels[index]
        minutes = times[2 * index]
        seconds = times[2 * index + 1]
        time = 60.0 * minutes + seconds
        if not label.isprintable() or not np.isfinite(time) or abs(time) > MAX_TIME:
            notes.append(READING.message(f"event {index + 1} is broken and was left out"))
            continue
        side = sides[index] if index < len(sides) else ""
        events.append(Event(float(time), label, side if side in ("Left", "Right") else ""))
    return events


def _facts(raw: RawC3d) -> dict[str, str]:
    """Collect facts: rates, maker, unit, subjects, date, body mass and height, as texts."""
    facts = {"point rate": f"{raw.point_rate:g} Hz", "first frame": str(raw.first_frame)}
    if raw.analog.size:
        facts["analog rate"] = f"{raw.analog_rate:g} Hz"
    subjects = _named(raw, "SUBJECTS", "NAMES") or _named(raw, "SUBJECT", "NAME")
    texts = {
        "maker": _maker(raw),
        "unit of length": _first_text(raw, "POINT", "UNITS"),
        "subjects": ", ".join(subjects),
        "computed positions": ", ".join(_named(raw, "POINT", "MODELED_MARKERS")),
        "date": _date(raw),
    }
    facts |= {name: text for name, text in texts.items() if text}
    mass = _measure(raw, ("BODYMASS", "MASS", "WEIGHT"))
    if mass:
        facts["body mass"] = f"{mass:.4g} kg"
    height = _measure(raw, ("HEIGHT", "BODYHEIGHT"))
    if height:
        # Nobody is taller than 3 m: millimeters.
        meters = height / 1000.0 if height > 3.0 else height
        facts["height"] = f"{meters:.4g} m"
    return facts


def _maker(raw: RawC3d) -> str:
    """Join company, program and version, "" where the file names none."""
    company = _first_text(raw, "MANUFACTURER", "COMPANY")
    software = _first_text(raw, "MANUFACTURER", "SOFTWARE")
    version = _first_text(raw, "MANUFACTURER", "VERSION_LABEL")
    # Some programs begin their own name with the company's.
    program = software if software.startswith(company) else f"{company} {software}".strip()
    return " ".join(text for text in (program, version) if text)


def _first_text(raw: RawC3d, group: str, name: str) -> str:
    """Return the first text of a parameter, "" without."""
    return (raw.texts(group, name) or ("",))[0]


def _named(raw: RawC3d, group: str, name: str) -> list[str]:
    """List the texts of a parameter that are not empty."""
    return [text for text in raw.texts(group, name) if text]


def _date(raw: RawC3d) -> str:
    """Find the date of the recording as the file writes it, "" without; never of birth."""
    for group, parameters in raw.groups.items():
        for name in parameters:
            if DATE.fullmatch(name) and _first_text(raw, group, name):
                return _first_text(raw, group, name)
    return ""


def _measure(raw: RawC3d, names: Sequence[str]) -> float:
    """Find a measure of the subject that is larger than zero, 0 if the file holds none.

    Parameters
    ----------
    raw : parameters are read
    names : of the parameter, in order of preference

    Returns
    -------
    the value in the file's unit
    """
    for group in ("PROCESSING", "SUBJECTS", "SUBJECT", "ANALYSIS_SUBJECT"):
        for name in names:
            values = raw.numbers(group, name)
            if len(values) and np.isfinite(values[0]) and values[0] > 0:
                return float(values[0])
    return 0.0
