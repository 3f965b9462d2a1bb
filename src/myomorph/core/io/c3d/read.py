"""C3D files: markers, analog channels, force plates, events and facts about the recording."""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from myomorph.core.io.c3d.raw import RawC3d, read_raw_c3d
from myomorph.core.io.parsing.text import unique_names, without_far_away
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadFile
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.series import Analog, Event, Markers, PlateRecording, Series, Trial

# Parameters of a recording's date, in the groups of several makers; C3D itself has none.
DATE = re.compile(
    r"(trial_|capture_|recording_|acquisition_|file_)?date(_time|_of_\w*record\w*)?", re.I
)
HINT = "try to open it in the program that wrote it and save it again as C3D"
QUANTITIES = ("ANGLES", "MOMENTS", "POWERS", "FORCES", "SCALARS", "REACTIONS", "USERMOS")
QUANTITY_NAME = re.compile(r"(angles?|moments?|powers?|forces?|grf)$", re.IGNORECASE)
UNLABELLED = re.compile(r"(\*.*|unlabel\w*.*|unidentified.*|uname\*?\d*)?$", re.IGNORECASE)
EMG_NAME = re.compile(
    r"emg|rect|fem|vast|bicep|tricep|gast|sol(eus)?\b|tib|ham|glut|delt|trap|pect?\b|infra|supra|subscap|lat(iss)?\b"
    r"|semi[tm]|peron|erect|sartor|addu|(^|[\W_])([rl][\W_]?)?(ta|gm|gl|gas|rf|re|rec|vl|vm|va|vas|bf|bi|st|ham|isc|gmed|"
    r"gmax|glu|so|pe|pl|es|mh|lh|mg|lg)\d?$",
    re.IGNORECASE,
)
NOT_EMG = re.compile(
    r"switch|sync|trig|speed|\b(force|moment)\b|handle|accel|acc\b|gyro|\bpin\b|goni|digital|foot",
    re.IGNORECASE,
)


def read_c3d(path: str | os.PathLike[str]) -> Trial:
    """Read a C3D file: lengths in meters, a hidden marker as NaN, time 0 at frame 1.

    Points that a program computed (angles, moments, powers, forces) are in `other_points`; computed
    positions stay among the markers, as OpenSim has it. Force plates are `plate_recordings`:
    `contact.plates` makes forces of them. EMG stays in `analog`; see `emg_channels`.

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
    if not 0.0 < raw.point_rate < 1e6:
        raise BadFile(path, f"states a frame rate of {raw.point_rate:g} Hz", HINT)
    notes = list(raw.remarks)
    facts = _facts(raw)
    meters = _meters(raw, notes)
    start = (max(raw.first_frame, 1) - 1) / raw.point_rate
    time = start + np.arange(len(raw.points)) / raw.point_rate
    markers, others = _points(raw, time, meters, facts, notes)
    analog = _analog(raw, start, notes)
    plates = plate_recordings(raw, meters, notes)
    return Trial(
        markers=markers,
        plate_recordings=plates,
        plate_time=analog.time if analog is not None else np.zeros(0),
        analog=analog,
        events=_events(raw, notes),
        other_points=others,
        facts=FrozenMap(facts),
        warnings=tuple(notes),
        source=str(path),
    )


def _meters(raw: RawC3d, notes: list[str]) -> float:
    """Find the length of the file's unit, by its name or by the median of the positions.

    Parameters
    ----------
    raw : points in the file's unit
    notes : gets a warning where the unit was guessed

    Returns
    -------
    the unit [m]
    """
    text = (raw.texts("POINT", "UNITS") or ("",))[0].lower()
    units = {"mm": 1e-3, "mil": 1e-3, "cm": 1e-2, "cen": 1e-2, "dm": 0.1, "m": 1.0, "in": 0.0254}
    for begin, factor in units.items():
        if text.startswith(begin):
            return factor
    size = float(np.nanmedian(np.abs(raw.points))) if np.isfinite(raw.points).any() else 0.0
    unit, factor = ("mm", 1e-3) if size > 20.0 else ("m", 1.0)
    notes.append(f"the file names no unit of length that is known ('{text}'): taken as {unit}")
    return factor


def _points(
    raw: RawC3d, time: Array, meters: float, facts: dict[str, str], notes: list[str]
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
    count = raw.points.shape[1]
    if not count or not len(time):
        return None, None
    labels = _filled(raw.texts("POINT", "LABELS"), count)
    labels = _full_labels(labels, raw.texts("POINT", "DESCRIPTIONS"), notes)
    # What holds no position, by the lists that the file keeps.
    kinds = [
        kind
        for kind in raw.texts("POINT", "TYPE_GROUPS")[::2]
        if kind and "MARKER" not in kind.upper()
    ]
    computed = {
        label
        for kind in (*QUANTITIES, *kinds, "USERMOS")
        for label in raw.texts("POINT", kind)
        if label
    }
    qualisys = any("qualisys" in text.lower() for text in raw.texts("MANUFACTURER", "COMPANY"))
    plain = [
        UNLABELLED.match(label) or (qualisys and re.match(r"U\d+$", label)) for label in labels
    ]
    quantity = [label in computed or bool(QUANTITY_NAME.search(label)) for label in labels]
    if all(plain):
        notes.append(f"no point has a label: the {count} points were named unnamed_1, ...")
        labels = [f"unnamed_{index + 1}" for index in range(count)]
        plain = [None] * count
    # The name of the subject before a colon is left out where that keeps labels apart.
    short = [label.rpartition(":")[2].strip() or label for label in labels]
    prefixes = sorted({label.rpartition(":")[0] for label in labels if ":" in label})
    if prefixes:
        facts["label prefixes"] = ", ".join(prefixes)
    times = Counter(short)
    names = [cut if times[cut] == 1 else label for cut, label in zip(short, labels, strict=True)]
    real = [index for index in range(count) if not plain[index] and not quantity[index]]
    other = [index for index in range(count) if quantity[index] and not plain[index]]
    if any(plain):
        facts["unlabelled points"] = str(sum(1 for is_plain in plain if is_plain))
    values = raw.points[:, real] * meters
    values = np.where(np.isfinite(values).all(axis=2, keepdims=True), values, np.nan)
    # Programs differ in how they mark a hidden point; an exact zero in all three is never a place.
    values = np.where(np.all(values == 0.0, axis=2, keepdims=True), np.nan, values)
    values = without_far_away(values, notes)
    markers = (
        Markers(time, unique_names([names[index] for index in real], "marker", notes), values)
        if real
        else None
    )
    others = None
    if other:
        others = Series(
            time,
            unique_names([names[index] for index in other], "quantity", []),
            raw.points[:, other],
        )
    return markers, others


def _filled(texts: Sequence[str], count: int) -> list[str]:
    """Return so many texts, "" where there are fewer."""
    return [*texts[:count], *[""] * (count - len(texts))]


def _full_labels(labels: list[str], descriptions: Sequence[str], notes: list[str]) -> list[str]:
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
    if (
        len(set(labels)) == len(labels)
        or max(map(len, labels)) > 4
        or len(descriptions) < len(labels)
    ):
        return labels
    full = list(descriptions[: len(labels)])
    if not all(full) or len(set(full)) < len(full):
        return labels
    notes.append(
        "the labels are cut to four letters and repeat: markers were named by their descriptions"
    )
    return full


def _analog(raw: RawC3d, start: float, notes: list[str]) -> Analog | None:
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
    rate = (
        raw.analog_rate
        if raw.analog_rate > 0
        else raw.point_rate * samples / max(len(raw.points), 1)
    )
    labels = _filled(raw.texts("ANALOG", "LABELS"), channels)
    units = _filled(raw.texts("ANALOG", "UNITS"), channels)
    names = [label or f"channel_{index + 1}" for index, label in enumerate(labels)]
    values = np.where(np.isfinite(raw.analog), raw.analog, np.nan)
    if np.isnan(values).any():
        notes.append(
            f"{np.count_nonzero(np.isnan(values))} analog samples are not finite and were made NaN"
        )
    return Analog(
        start + np.arange(samples) / rate,
        unique_names(names, "channel", notes),
        values,
        units=tuple(units),
    )


def _events(raw: RawC3d, notes: list[str]) -> tuple[Event, ...]:
    """Read the events in order of time, those of the header where the parameters have none.

    Parameters
    ----------
    raw : parameters and events of the header are read
    notes : gets a warning for each that was left out

    Returns
    -------
    time [s], label and side ("Left", "Right", or "" for another)
    """
    labels = raw.texts("EVENT", "LABELS")
    sides = raw.texts("EVENT", "CONTEXTS")
    times = raw.numbers("EVENT", "TIMES")
    used = raw.numbers("EVENT", "USED")
    count = min(len(labels), len(times) // 2, int(used[0]) if len(used) else len(labels))
    events = []
    for index in range(count):
        side = sides[index] if index < len(sides) else ""
        moment = 60.0 * times[2 * index] + times[2 * index + 1]
        if not labels[index].isprintable() or not np.isfinite(moment) or abs(moment) > 1e6:
            notes.append(f"event {index + 1} is broken and was left out")
            continue
        events.append(
            Event(float(moment), labels[index], side if side in ("Left", "Right") else "")
        )
    if not events:
        events = [
            Event(time, label)
            for label, time in raw.events
            if label.strip() and np.isfinite(time) and abs(time) < 1e6
        ]
    return tuple(sorted(events, key=lambda event: event.time))


def _facts(raw: RawC3d) -> dict[str, str]:
    """Collect facts: rates, maker, unit, subjects, date, body mass and height, as texts."""
    facts = {"point rate": f"{raw.point_rate:g} Hz", "first frame": str(raw.first_frame)}
    if raw.analog.size:
        facts["analog rate"] = f"{raw.analog_rate:g} Hz"
    company = (raw.texts("MANUFACTURER", "COMPANY") or ("",))[0]
    software = (raw.texts("MANUFACTURER", "SOFTWARE") or ("",))[0]
    version = (raw.texts("MANUFACTURER", "VERSION_LABEL") or ("",))[0]
    maker = [software if software.startswith(company) else f"{company} {software}".strip(), version]
    if any(maker):
        facts["maker"] = " ".join(text for text in maker if text)
    units = raw.texts("POINT", "UNITS")
    if units and units[0]:
        facts["unit of length"] = units[0]
    names = [name for name in raw.texts("SUBJECTS", "NAMES") if name]
    names = names or [name for name in raw.texts("SUBJECT", "NAME") if name]
    if names:
        facts["subjects"] = ", ".join(names)
    modelled = [name for name in raw.texts("POINT", "MODELED_MARKERS") if name]
    if modelled:
        facts["computed positions"] = ", ".join(modelled)
    date = _date(raw)
    if date:
        facts["date"] = date
    mass = _measure(raw, ("BODYMASS", "MASS", "WEIGHT"))
    if mass:
        facts["body mass"] = f"{mass:.4g} kg"
    height = _measure(raw, ("HEIGHT", "BODYHEIGHT"))
    if height:
        facts["height"] = f"{height / 1000.0 if height > 3.0 else height:.4g} m"
    return facts


def _date(raw: RawC3d) -> str:
    """Find the date of the recording as the file writes it, "" without; never of birth."""
    places = ((group, name) for group, names in raw.groups.items() for name in names)
    dated = [(group, name) for group, name in places if DATE.fullmatch(name)]
    texts = (text for group, name in dated for text in raw.texts(group, name)[:1])
    return next((text for text in texts if text), "")


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


def emg_channels(trial: Trial) -> tuple[str, ...]:
    """List the analog channels that are probably EMG, a guess from labels and units.

    Channels that a force plate uses are left out. Those whose label says EMG or a muscle are taken;
    without any, all that are in volts and do not look like a switch, a trigger or an accelerometer.

    Parameters
    ----------
    trial : analog channels with their units, and plates

    Returns
    -------
    names of channels, in the recording's order; () without analog channels
    """
    if trial.analog is None:
        return ()
    plates = {name for plate in trial.plate_recordings for name in plate.channel_names}
    volts = []
    named = []
    units = trial.analog.units or ("",) * len(trial.analog.names)
    for name, unit in zip(trial.analog.names, units, strict=True):
        electric = unit.lower().replace("µ", "u") in ("v", "mv", "uv", "volts", "")
        if name in plates or NOT_EMG.search(name) or not electric:
            continue
        volts.append(name)
        if EMG_NAME.search(name):
            named.append(name)
    return tuple(named or volts)


CHANNELS = {1: 6, 2: 6, 3: 8, 4: 6, 5: 8, 6: 12, 7: 8, 11: 8, 12: 8, 21: 6}
FORCE_UNITS = {
    "n": 1.0,
    "nt": 1.0,
    "newton": 1.0,
    "newtons": 1.0,
    "kn": 1000.0,
    "lb": 4.4482216,
    "lbf": 4.4482216,
}
LOADED = 50.0  # A plate that carries more is loaded [N]
LENGTH_UNITS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "meters": 1.0, "meter": 1.0}


def plate_recordings(raw: RawC3d, meters: float, notes: list[str]) -> tuple[PlateRecording, ...]:
    """Read the force plates of the file; one that is described only in part is left out.

    Parameters
    ----------
    raw : parameters and analog samples
    meters : the file's unit of length [m]
    notes : gets a warning for each plate that was left out, and for units that were assumed

    Returns
    -------
    corners (4, 3) and origin (3,) [m] of each, channels (samples, channels) in [N, N m, m] for
    types 1 to 3, else as stored
    """
    group = "FORCE_PLATFORM" if "FORCE_PLATFORM" in raw.groups else "FORCE_PLATEFORM"
    used = raw.numbers(group, "USED")
    kinds = raw.numbers(group, "TYPE")
    count = min(int(used[0]) if len(used) and np.isfinite(used[0]) else len(kinds), len(kinds))
    if count <= 0:
        return ()
    if not raw.analog.size:
        notes.append(f"the file describes {count} force plates, but holds no analog samples")
        return ()
    plates = []
    for index in range(count):
        plate = _plate(raw, group, index, int(kinds[index]), meters, notes)
        if plate is not None:
            plates.append(plate)
    return tuple(plates)


def _plate(
    raw: RawC3d, group: str, index: int, kind: int, meters: float, notes: list[str]
) -> PlateRecording | None:
    """Read one force plate, None where corners, origin, channels or calibration are not usable.

    Parameters
    ----------
    raw : parameters and analog samples
    group : name of the group of parameters
    index : of the plate, from 0
    kind : C3D type of the plate
    meters : the file's unit of length [m]
    notes : gets a warning for what was left out or assumed
    """
    name = f"plate_{index + 1}"
    corners = raw.numbers(group, "CORNERS")[12 * index : 12 * index + 12]
    origin = raw.numbers(group, "ORIGIN")[3 * index : 3 * index + 3]
    columns = _columns(raw, group, index, kind)
    if len(corners) < 12 or len(origin) < 3:
        notes.append(
            f"force plate {index + 1} was left out: the file holds no corners or no origin for it"
        )
        return None
    if columns is None:
        notes.append(
            f"force plate {index + 1} was left out: its channels are not among the analog channels"
        )
        return None
    corners = corners.reshape(4, 3) * meters
    if (
        not np.isfinite(corners).all()
        or np.linalg.norm(np.cross(corners[0] - corners[1], corners[0] - corners[3])) == 0
    ):
        notes.append(f"force plate {index + 1} was left out: its corners span no surface")
        return None
    labels = raw.texts("ANALOG", "LABELS")
    units = raw.texts("ANALOG", "UNITS")
    samples = np.where(np.isfinite(raw.analog[:, columns]), raw.analog[:, columns], np.nan)
    calibration = _calibration(raw, group, index, meters) if kind == 4 else None
    if kind == 4 and calibration is None:
        notes.append(
            f"force plate {index + 1} is of type 4 without a calibration matrix: taken as"
            " calibrated"
        )
        kind = 2
    if kind in (1, 2, 3):
        texts = [units[column] if column < len(units) else "" for column in columns]
        samples = samples * _factors(kind, texts, meters, name, notes)
        if kind == 2 and _in_millimeters(samples, corners):
            notes.append(
                f"moments of {name}, in '{texts[3]}' by the file, put forces far off the plate:"
                " taken as N mm"
            )
            samples[:, 3:] *= 1e-3
    polynomial = raw.numbers(group, "FPCOPPOLY")[12 * index : 12 * index + 12]
    return PlateRecording(
        name=name,
        kind=kind,
        corners=corners,
        origin=np.where(np.isfinite(origin), origin, 0.0) * meters,
        channels=samples,
        channel_names=tuple(labels[column] if column < len(labels) else "" for column in columns),
        calibration=calibration,
        center_polynomial=polynomial.reshape(2, 6) if kind == 3 and len(polynomial) == 12 else None,
    )


def _columns(raw: RawC3d, group: str, index: int, kind: int) -> list[int] | None:
    """Find the columns of the analog samples that belong to a plate.

    Parameters
    ----------
    raw : parameters are read
    group : name of the group of parameters
    index : of the plate, from 0
    kind : C3D type of the plate, which says how many channels it has

    Returns
    -------
    indices from 0 in the order of the plate's channels; None where one is not among the samples
    """
    shape = raw.shape(group, "CHANNEL")
    channels = raw.numbers(group, "CHANNEL")
    size = int(shape[0]) if len(shape) == 2 else len(channels)
    wanted = CHANNELS.get(kind, size)
    mine = channels[size * index : size * index + size][:wanted].astype(int) - 1
    if len(mine) < wanted or not wanted or (mine < 0).any() or (mine >= raw.analog.shape[1]).any():
        return None
    return list(mine)


def _calibration(raw: RawC3d, group: str, index: int, meters: float) -> Array | None:
    """Read the matrix from channels to forces and moments of a plate.

    Parameters
    ----------
    raw : parameters are read; MATRIX_STORE says whether the file stores it by rows
    group : name of the group of parameters
    index : of the plate, from 0
    meters : the file's unit of length [m]

    Returns
    -------
    (6, 6) from channels to force [N] and moment [N m]; None where there is none that is finite
    """
    values = raw.numbers(group, "CAL_MATRIX")[36 * index : 36 * index + 36]
    if len(values) < 36 or not np.isfinite(values).all() or not values.any():
        return None
    matrix: Array = values.reshape(6, 6, order="F").copy()
    if any(text.upper() == "BYROW" for text in raw.texts(group, "MATRIX_STORE")):
        matrix = matrix.T.copy()
    matrix[3:] *= meters
    return matrix


def _factors(kind: int, units: list[str], meters: float, name: str, notes: list[str]) -> Array:
    """Find the factor of each channel of a plate to N, N m or m.

    Parameters
    ----------
    kind : C3D type of the plate, which says what each channel is
    units : text of each channel
    meters : unit of length where a channel's text names none [m]
    name : of the plate, for messages
    notes : gets a warning where units of forces are unknown

    Returns
    -------
    (channels,)
    """
    forces = 8 if kind == 3 else 3
    factors = np.ones(len(units))
    unknown = set()
    for column, text in enumerate(units):
        letters = re.sub(r"[^a-z]", "", text.lower())
        if column < forces:
            factors[column] = FORCE_UNITS.get(letters, 1.0)
            if letters not in FORCE_UNITS:
                unknown.add(text)
        elif kind == 1 and column < 5:
            factors[column] = LENGTH_UNITS.get(letters, meters)
        else:
            length = next(
                (LENGTH_UNITS[letters[cut:]] for cut in (1, 6, 7) if letters[cut:] in LENGTH_UNITS),
                meters,
            )
            factors[column] = length
    if unknown:
        notes.append(
            f"the channels of {name} are in '{', '.join(sorted(unknown))}': taken as newtons"
        )
    return factors


def _in_millimeters(samples: Array, corners: Array) -> bool:
    """Return whether moments are in N mm although the file says N m.

    The distance of the force from the middle of the loaded plate, its moment over the vertical
    force, then is many plates away, and within the plate in N mm.

    Parameters
    ----------
    samples : (samples, 6) force [N] and moment [N m as stated]
    corners : (4, 3) of the plate [m]
    """
    pressing = np.abs(samples[:, 2])
    moments = np.linalg.norm(samples[:, 3:5], axis=1)
    loaded = pressing > max(LOADED, 0.5 * np.nanmax(pressing, initial=0.0))
    away = np.median(moments[loaded] / pressing[loaded]) if loaded.any() else 0.0
    reach = np.linalg.norm(corners - corners.mean(axis=0), axis=1).max()
    return bool(away > 10.0 * reach and 1e-3 * away < reach)
