"""Three-dimensional keypoints of markerless cameras: HDF5 files with a dataset `tracks`.

Names of the points stand in the file or beside it.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from myomorph.core.io.parsing.door import MAX_NUMBERS, MAX_SIZES, content_of
from myomorph.core.io.parsing.hdf5 import ERRORS, open_hdf5
from myomorph.core.io.parsing.named_file import is_named_file
from myomorph.core.io.parsing.text import unique_names, without_far_away
from myomorph.core.model import causes
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadFile, from_extra, quoted
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.messages import Message
from myomorph.core.model.series import Markers, Trial

UNITS = FrozenMap({"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254})
NAME_KEYS = ("names", "KP_NAMES", "node_names", "keypoints")
BODY_KEYS = ("bodies", "KEYPOINT_MODEL_PAIRS")
OFFSET_KEYS = ("offsets", "KEYPOINT_INITIAL_OFFSETS")
RATE_KEYS = ("rate", "fps", "frame_rate", "FrameRate")
ENDINGS = (".yaml", ".yml", ".json", ".txt")
MAX_NAMES = 10_000
HINT = "expected an HDF5 file with a dataset 'tracks' of (frames, animals, points, 3)"


@dataclass(frozen=True, kw_only=True)
class KeypointNames:
    """Names, bodies, unit and rate of a recording's points, as a file of names states them.

    Attributes
    ----------
    names : of the points, in the order of the recording; () where not specified
    bodies : body of a model that a point belongs to, by point
    offsets : position of a point on that body (3,) [m], by point
    unit : of the positions [m], None where not specified
    rate : frames per second [Hz], None where not specified
    """

    names: tuple[str, ...] = ()
    bodies: Mapping[str, str] = field(default_factory=lambda: FrozenMap({}))
    offsets: Mapping[str, tuple[float, float, float]] = field(default_factory=lambda: FrozenMap({}))
    unit: float | None = None
    rate: float | None = None

    @property
    def is_complete(self) -> bool:
        """Whether names, unit and rate are specified."""
        return bool(self.names) and self.unit is not None and self.rate is not None

    def completed(self, other: KeypointNames) -> KeypointNames:
        """Take names, unit and rate from another source where they are not specified."""
        return replace(
            self,
            names=self.names or other.names,
            unit=other.unit if self.unit is None else self.unit,
            rate=other.rate if self.rate is None else self.rate,
        )


def read_keypoints(
    path: str | os.PathLike[str],
    names: Sequence[str] = (),
    units: str = "",
    rate: float | None = None,
    animal: int = 0,
) -> Trial:
    """Read keypoints as markers.

    What is not specified here is taken from the file itself (`node_names`, attributes `units` and
    `rate`), then from the file of names beside it: the recording's own name with .yaml, .json or
    .txt, or the only file of its folder with so many names, which the warnings report.

    Parameters
    ----------
    path : of the HDF5 file
    names : of the points, in order
    units : "m", "cm", "mm" or "in"
    rate : frames per second [Hz]; where nothing states it, times are frame numbers, with a warning
    animal : which one, counted from 0, where the file holds several

    Returns
    -------
    markers (frames, points, 3) [m] in the file's axes, NaN where hidden

    Raises
    ------
    BadFile : it cannot be read, has no such tracks or animal, or names or unit are unknown
    """
    path = Path(path)
    if units and units not in UNITS:
        raise BadFile(path, f"unknown unit '{units}'", f"expected one of {', '.join(UNITS)}")
    notes: list[Message] = []
    tracks, stored = _tracks(path, animal, notes)
    points = tracks.shape[1]
    requested = KeypointNames(names=tuple(names), unit=UNITS.get(units), rate=rate)
    header = requested.completed(stored)
    if not requested.is_complete:
        header = header.completed(_beside(path, points, notes))
    unit = _checked_unit(header, points, path)
    if header.rate is None:
        notes.append(
            causes.UNITS.message(
                "no frame rate is specified: times are frame numbers; put 'rate: HZ' into"
                f" {path.stem}.yaml"
            )
        )
    values = without_far_away(unit * tracks, notes)
    markers = Markers(
        np.arange(len(values)) / (header.rate or 1.0),
        unique_names(header.names, "point", notes),
        values,
    )
    facts = {
        "unit of length": f"{unit:g} m",
        "point rate": "not specified" if header.rate is None else f"{header.rate:g} Hz",
    }
    return Trial(markers=markers, facts=FrozenMap(facts), warnings=tuple(notes), source=str(path))


def _checked_unit(header: KeypointNames, points: int, path: Path) -> float:
    """Check what was found of a recording, and return its unit [m].

    Parameters
    ----------
    header : names, unit and rate
    points : count of the recording's points
    path : of the recording, for messages

    Raises
    ------
    BadFile : names or unit are missing, there are more or fewer names, or the rate is impossible
    """
    if not header.names:
        raise BadFile(
            path,
            f"does not name its {points} points",
            f"name them in {path.stem}.txt, one a line",
        )
    if len(header.names) != points:
        raise BadFile(path, f"has {points} points, but {len(header.names)} names were given", HINT)
    if header.unit is None:
        raise BadFile(
            path, "does not state its unit", f"put 'units: mm' (m, cm, in) into {path.stem}.yaml"
        )
    if header.rate is not None and not 0.0 < header.rate < 1e6:
        raise BadFile(
            path, f"a frame rate of {header.rate:g} Hz was specified", "expected frames per second"
        )
    return header.unit


def _tracks(path: Path, animal: int, notes: list[Message]) -> tuple[Array, KeypointNames]:
    """Read the positions of one animal.

    Parameters
    ----------
    path : of the HDF5 file
    animal : which one, counted from 0
    notes : gets a warning where there are several animals

    Returns
    -------
    (frames, points, 3) in the file's unit, NaN where hidden; and what the file states of the points

    Raises
    ------
    BadFile : it cannot be read, or has no tracks of numbers in three dimensions, or no such animal
    """
    try:
        with open_hdf5(path, HINT) as file:
            values, stored = _stored_tracks(file, path, animal, notes)
    except ERRORS as error:
        raise BadFile(path, f"cannot be read as HDF5 ({_one_line(error)})", HINT) from None
    return np.where(np.isfinite(values).all(axis=2, keepdims=True), values, np.nan), stored


def _stored_tracks(
    file: Any, path: Path, animal: int, notes: list[Message]
) -> tuple[Array, KeypointNames]:
    """Read positions as stored (frames, points, 3), and what an open file states of the points."""
    import h5py

    tracks = file.get("tracks")
    if not isinstance(tracks, h5py.Dataset):
        held = quoted(file) or "nothing"
        raise BadFile(path, f"holds {held}, but no 'tracks'", HINT)
    shape = _tracks_shape(tracks, path)
    animals = shape[1]
    if not 0 <= animal < animals:
        raise BadFile(path, f"has no animal {animal}", f"it holds {animals}, counted from 0")
    if animals > 1:
        notes.append(
            causes.READING.message(
                f"holds {animals} animals: this is number {animal}, counted from 0"
            )
        )
    values = np.asarray(tracks, dtype=np.float64).reshape(shape)[:, animal]
    return values, _stored_facts(file, tracks)


def _tracks_shape(tracks: Any, path: Path) -> tuple[int, ...]:
    """Return the shape (frames, animals, points, 3) of tracks; a file may leave out the animals.

    Parameters
    ----------
    tracks : data set
    path : of the file, for messages

    Raises
    ------
    BadFile : they have another shape or type, are empty, or too large to read
    """
    shape = tracks.shape
    if len(shape) == 3 and shape[-1] == 3:
        shape = (shape[0], 1, *shape[1:])
    if len(shape) != 4 or shape[-1] != 3 or not np.issubdtype(tracks.dtype, np.floating):
        flat = " (two-dimensional: triangulate the cameras first)" if 2 in tracks.shape else ""
        raise BadFile(path, f"its 'tracks' are {tracks.shape} of {tracks.dtype}{flat}", HINT)
    if math.prod(shape) > MAX_NUMBERS or 0 in shape:
        raise BadFile(path, f"its 'tracks' are {tracks.shape}: nothing, or too much to read", HINT)
    return shape


def _one_line(error: Exception) -> str:
    """Return the beginning of an error's text on one line."""
    return " ".join(str(error).split())[:120]


def _stored_facts(file: Any, tracks: Any) -> KeypointNames:
    """Read names, unit and rate that the recording itself states."""
    facts = {**dict(file.attrs), **dict(tracks.attrs)}
    names = file["node_names"] if "node_names" in file else facts.get("node_names", ())
    if len(names) > MAX_NAMES:
        raise ValueError(f"it holds {len(names)} node_names")
    rate = _first(facts, RATE_KEYS)
    return KeypointNames(
        names=tuple(_decoded(name) for name in names),
        unit=UNITS.get(_decoded(facts.get("units", ""))),
        rate=None if rate is None else float(rate),
    )


def _decoded(value: Any) -> str:
    """Return the text of an attribute, which may be stored as bytes."""
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)


def _beside(path: Path, points: int, notes: list[Message]) -> KeypointNames:
    """Read the file of names in the recording's folder.

    Parameters
    ----------
    path : of the recording
    points : count of its points
    notes : gets a warning where the file of names has another name than the recording

    Returns
    -------
    what the file states; nothing where there is none, or more than one fits
    """
    for ending in ENDINGS:
        named = path.with_suffix(ending)
        if is_named_file(named):
            return read_keypoint_names(named)
    fitting = []
    for candidate in sorted(path.parent.iterdir()):
        header = _names_of_candidate(candidate)
        if header is not None and len(header.names) == points:
            fitting.append((candidate, header))
    if len(fitting) != 1:
        return KeypointNames()
    file, header = fitting[0]
    unit = "" if header.unit is None else f", in units of {header.unit:g} m"
    notes.append(causes.READING.message(f"names of the points are those of {file.name}{unit}"))
    return header


def _names_of_candidate(path: Path) -> KeypointNames | None:
    """Read a file if it may be one of names, None where it is none."""
    if path.suffix.lower() not in ENDINGS or not path.is_file():
        return None
    if path.stat().st_size > MAX_SIZES["names of points"]:
        return None
    try:
        return read_keypoint_names(path)
    except BadFile:
        return None


def read_keypoint_names(path: str | os.PathLike[str]) -> KeypointNames:
    """Read names of points: YAML or JSON, or text with one name per line.

    Of YAML and JSON (a list, or tables as `KeypointNames`) the keys are names, bodies, offsets [m],
    units and rate; those of stac-mjx are understood too (KP_NAMES, KEYPOINT_MODEL_PAIRS,
    KEYPOINT_INITIAL_OFFSETS, MOCAP_SCALE_FACTOR).

    Parameters
    ----------
    path : of the file (.yaml, .yml, .json or .txt)

    Returns
    -------
    names, bodies, offsets (3,) [m], unit [m] and rate [Hz], as far as the file states them

    Raises
    ------
    BadFile : it cannot be read, is too long, or has something else where a name or number belongs
    """
    path = Path(path)
    text = _names_text(path)
    if path.suffix.lower() == ".txt":
        lines = (line.strip() for line in text.splitlines())
        return KeypointNames(names=tuple(line for line in lines if line))
    content = _parsed(text, path)
    if isinstance(content, list):
        content = {"names": content}
    if not isinstance(content, dict):
        raise BadFile(path, "holds no names of points", "expected a list, or a table with 'names'")
    return _names_of_content(content, path)


def _names_of_content(content: Mapping[str, Any], path: Path) -> KeypointNames:
    """Read names and what else a table states.

    Parameters
    ----------
    content : by key
    path : of the file, for messages

    Raises
    ------
    BadFile : something else stands where a list, a table, a name or a number belongs
    """
    names = _first(content, NAME_KEYS) or ()
    bodies = _first(content, BODY_KEYS) or {}
    offsets = _first(content, OFFSET_KEYS) or {}
    tables = isinstance(bodies, dict) and isinstance(offsets, dict)
    if not tables or not isinstance(names, (list, tuple)):
        raise BadFile(path, "its 'names' are no list, or its 'bodies' or 'offsets' no table")
    try:
        rate = _first(content, RATE_KEYS)
        return KeypointNames(
            unit=_unit(content),
            offsets=FrozenMap({_text(name): _three(offset) for name, offset in offsets.items()}),
            names=tuple(_text(name) for name in names),
            bodies=FrozenMap({_text(name): _text(body) for name, body in bodies.items()}),
            rate=None if rate is None else float(rate),
        )
    except (TypeError, ValueError) as error:
        raise BadFile(
            path, f"holds what is no name or number where one belongs ({error})"
        ) from None


def _names_text(path: Path) -> str:
    """Read a file of names; `BadFile` where it is too long or no text."""
    try:
        return content_of(path, "names of points").decode("utf-8-sig")
    except UnicodeDecodeError:
        raise BadFile(path, "is not text") from None


def _unit(content: Mapping[str, Any]) -> float | None:
    """Read the unit of positions [m], by stac-mjx's scale or by name; None where none is known."""
    scale = content.get("MOCAP_SCALE_FACTOR")
    if scale is not None:
        return float(scale)
    return UNITS.get(_text(content.get("units", "")))


def _parsed(text: str, path: Path) -> Any:
    """Parse JSON, or else YAML; `BadFile` where the text is none."""
    if path.suffix.lower() == ".json":
        try:
            return json.loads(text)
        except (ValueError, RecursionError) as error:
            raise BadFile(path, f"is not JSON ({error})") from None
    yaml = from_extra("keypoints", "yaml", "pyyaml")
    try:
        return yaml.safe_load(text)
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        raise BadFile(path, f"is not YAML ({_one_line(error)})") from None


def _first(table: Mapping[str, Any], keys: Sequence[str]) -> Any:
    """Return the value of the first key that a table has, None without."""
    return next((table[key] for key in keys if key in table), None)


def _text(value: Any) -> str:
    """Return a name; `TypeError` for a list or table, which may hold itself many times over."""
    if not isinstance(value, (str, int, float)):
        raise TypeError(f"a name cannot be a {type(value).__name__}")
    return str(value)


def _three(value: Any) -> tuple[float, float, float]:
    """Read three numbers, from a list or from a text."""
    x, y, z = map(float, value.split() if isinstance(value, str) else value)
    return x, y, z
