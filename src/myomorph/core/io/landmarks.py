"""Landmarks of bones: tables, 3D Slicer's markups, JSON, OpenSim's markers and stations.

`read_landmark_pairs` gives plain values (`model.landmarks.LandmarkPairs`), since readers know only
the nouns of `model`; `study` makes feature points of them.
"""

from __future__ import annotations

import json
import os
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np

from myomorph.core.io.osim.document import read_document
from myomorph.core.io.osim.frames import Frames
from myomorph.core.io.osim.setup_parts import holder_of, named_markers
from myomorph.core.io.parsing.cells import csv_rows
from myomorph.core.io.parsing.door import within_time
from myomorph.core.io.parsing.text import file_text, number
from myomorph.core.model.arrays import Array, frozen_array, read_only
from myomorph.core.model.errors import BadData, BadFile, UnknownName, quoted
from myomorph.core.model.landmarks import LandmarkPairs

MAX_NAME = 200  # Characters of a column's name in which a unit is looked for.
UNITS = {
    "m": 1.0,
    "meter": 1.0,
    "meters": 1.0,
    "metre": 1.0,
    "metres": 1.0,
    "cm": 0.01,
    "mm": 0.001,
}
SIDES = ("source", "target")
PAIR_COLUMNS = ("body", "name", *(f"{side}_{axis}" for side in SIDES for axis in "xyz"))
POINT_COLUMNS = ("name", "x", "y", "z")
ENDINGS = (".csv", ".tsv", ".txt", ".fcsv", ".json", ".osim", ".xml")

_WITH_UNIT = re.compile(
    r"^(?P<name>.*?)[ _]*(?:[\[(](?P<in>\w+)[\])]|(?<=[xyz])[ _](?P<after>cm|mm|m))$"
)
# A first line that is a point already.
_HEADLESS = re.compile(r"[^,;\t]+([,;\t]\s*[-+.\d][-+.\deE]*\s*){3}")
JSON_HINT = (
    'expected {"name": [x, y, z], ...}, {"body": {"name": [x, y, z], ...}}, or 3D Slicer\'s markups'
)
MARKUPS_HINT = "expected lists of points, as 3D Slicer writes them"
_SLICER_NAMES = {"label": "name"}
_IN_MILLIMETERS = "# Markups fiducial file"


def read_landmark_pairs(path: str | os.PathLike[str]) -> dict[str, LandmarkPairs]:
    """Read the landmarks of two skeletons.

    The table has the columns `body, name, source_x, source_y, source_z, target_x, target_y,
    target_z`, in any order and case, separated by commas, semicolons or tabs; it is in meters
    unless a column says otherwise (`source_x [mm]`).

    Parameters
    ----------
    path : of the table

    Returns
    -------
    by body of the source, names with source points (landmarks, 3) in the source body's frame [m]
    and target points (landmarks, 3) in the frame of the target's bone [m]

    Raises
    ------
    BadFile : it is no such table, a line lacks a body, a name or a number, or names a landmark
        again
    """
    path = Path(path)
    table = _table(path, PAIR_COLUMNS)
    pairs: dict[str, dict[str, _Pair]] = {}
    for line in within_time(table.lines, path):
        body = line.cells["body"]
        name = line.cells["name"]
        if not body or not name:
            missing = "name" if body else "body"
            table.wrong(line, f"has no {missing}", "every landmark needs both")
            continue
        whose = f"'{name}' of '{body}'"
        source = table.point(line, "source_", whose, "source")
        target = table.point(line, "target_", whose, "target")
        of_body = pairs.setdefault(body, {})
        if name in of_body:
            table.wrong(line, f"names landmark {whose} again", "each may stand there once")
        of_body[name] = _Pair(source=source, target=target)
    table.done()
    return {
        body: LandmarkPairs(
            names=tuple(of_body),
            source=np.stack([pair.source for pair in of_body.values()]),
            target=np.stack([pair.target for pair in of_body.values()]),
        )
        for body, of_body in pairs.items()
    }


def read_landmarks(path: str | os.PathLike[str], body: str = "") -> dict[str, Array]:
    """Read the landmarks of one bone.

    Parameters
    ----------
    path : of a table (`name, x, y, z`), 3D Slicer's markups (`.json`, `.fcsv`), JSON (`{"name": [x,
        y, z]}`), an OpenSim model or MarkerSet; see `read_body_landmarks` for units and frames
    body : whose landmarks, where a file has those of several bodies

    Returns
    -------
    (3,) by name [m]

    Raises
    ------
    BadFile : it is no such file, or has several bodies and none is chosen
    UnknownName : it has no landmarks of the body
    """
    by_body = read_body_landmarks(path)
    if body:
        names_no_bodies = set(by_body) == {""}
        if body not in by_body and not names_no_bodies:
            raise UnknownName("body", body, existing=sorted(by_body), where=str(path))
        return by_body[body] if body in by_body else by_body[""]
    if len(by_body) > 1:
        raise BadFile(
            path,
            f"has landmarks of {len(by_body)} bodies",
            f"say which: {quoted(sorted(by_body))}",
        )
    return next(iter(by_body.values()))


def read_body_landmarks(path: str | os.PathLike[str]) -> dict[str, dict[str, Array]]:
    """Read the landmarks of several bones.

    Tables (an optional column `body`, then `name, x, y, z`) and JSON are in meters unless they say
    otherwise: a column `x [mm]`, a key `"units": "mm"`. 3D Slicer's markups are in millimeters
    unless they say otherwise; their axes stay as the file has them (LPS or RAS), so the bone must
    be saved in the same. OpenSim's markers and stations come in the frames of their bodies; a
    MarkerSet without a model in the frames that it names.

    Parameters
    ----------
    path : of the file (.csv, .tsv, .txt, .fcsv, .json, .osim or .xml)

    Returns
    -------
    (3,) by body and name [m]; the body is "" where the file names none

    Raises
    ------
    BadFile : it has another ending, is not as its format asks for, names a landmark twice, or has
        none
    """
    path = Path(path)
    ending = path.suffix.lower()
    if ending in (".osim", ".xml"):
        result = _stations(path)
    elif ending == ".json":
        result = _from_json(path)
    elif ending in ENDINGS:
        result = _points(path)
    else:
        raise BadFile(
            path,
            f"is no file of landmarks: its name ends in '{ending}'",
            f"expected {', '.join(ENDINGS)}",
        )
    if not any(result.values()):
        raise BadFile(path, "holds no landmarks")
    return result


@read_only
@dataclass(frozen=True, kw_only=True, eq=False)
class _Pair:
    """A landmark of two skeletons.

    Attributes
    ----------
    source, target : (3,) [m]
    """

    source: Array
    target: Array


@dataclass(frozen=True, kw_only=True)
class _Line:
    """One line of a table.

    Attributes
    ----------
    number : of the line in the file, counted from 1
    cells : by column
    """

    number: int
    cells: Mapping[str, str]


@dataclass(frozen=True, kw_only=True)
class _Row:
    """A line of a file that is not empty.

    Attributes
    ----------
    number : counted from 1
    text : of the line
    """

    number: int
    text: str


@dataclass(frozen=True, kw_only=True)
class _Column:
    """A column of a table.

    Attributes
    ----------
    name : in small letters, without its unit
    meters : its unit [m]
    """

    name: str
    meters: float


class _Table:
    """Lines of a table whose header is known, and the errors in them.

    Parameters
    ----------
    path : of the file
    lines : below the header
    columns : of the header
    """

    def __init__(self, path: Path, lines: Sequence[_Line], columns: Iterable[_Column]):
        self.path = path
        self.lines = lines
        self.meters = {column.name: column.meters for column in columns}
        self._wrong: list[tuple[str, str]] = []

    def wrong(self, line: _Line, problem: str, hint: str) -> None:
        """Add an error of a line.

        Parameters
        ----------
        line : that cannot be used
        problem : what is wrong with it
        hint : what would be right
        """
        self._wrong.append((f"line {line.number} {problem}", hint))

    def point(self, line: _Line, prefix: str, whose: str, side: str = "") -> Array:
        """Read the three numbers of a point; errors in them are added to the table's.

        Parameters
        ----------
        line : of the table
        prefix : of the columns, before x, y and z
        whose : the point is, for the message
        side : "source", "target" or ""

        Returns
        -------
        (3,) [m], 0 where a number is missing
        """
        position = np.zeros(3)
        for index, axis in enumerate("xyz"):
            column = prefix + axis
            text = line.cells[column]
            try:
                position[index] = self.meters[column] * number(text)
            except ValueError:
                self.wrong(line, f"has '{text[:40]}' for {column} of {whose}", "expected a number")
                return np.zeros(3)
        what = f"{side} point" if side else "place"
        if np.isnan(position).all():
            self.wrong(line, f"has no {what} of {whose}", "give it, or leave the line out")
        elif not np.isfinite(position).all():
            self.wrong(line, f"has no finite {what} of {whose}", "expected three numbers")
        return frozen_array(np.nan_to_num(position))

    def done(self) -> None:
        """Check that there are lines without errors.

        Raises
        ------
        BadFile : a line has an error, or there is none
        """
        if not self.lines:
            raise BadFile(self.path, "has a header, but no landmark below it")
        if not self._wrong:
            return
        problem, hint = self._wrong[0]
        others = len(self._wrong) - 1
        more = f" ({others} more lines are wrong too)" if others else ""
        raise BadFile(self.path, f"{problem}{more}", hint)


def _text(path: Path, hint: str) -> str:
    """Read the text of a file that is not too large; `BadFile` where it is."""
    return file_text(path, hint, "landmarks")


def _table(path: Path, columns: Sequence[str], optional: Sequence[str] = ()) -> _Table:
    """Read a table with a header, in 3D Slicer's form too.

    Parameters
    ----------
    path : of the file
    columns : that it must have; a table of points may lack the header
    optional : columns that must not stand there twice

    Returns
    -------
    lines by names of columns in small letters, and the factor of each column to meters

    Raises
    ------
    BadFile : it lacks a column, has one twice, or a line has more cells than the header
    """
    hint = f"expected a table with the columns {', '.join(columns)}"
    rows = _rows(_text(path, hint))
    slicer = bool(rows) and rows[0].text.startswith(_IN_MILLIMETERS)
    header = _slicer_header(rows) if slicer else ""
    rows = [row for row in rows if not row.text.lstrip().startswith("#")]
    if not header:
        if not rows:
            raise BadFile(path, "has no header", hint)
        first = rows[0].text
        if columns == POINT_COLUMNS and _HEADLESS.fullmatch(first):
            header = _delimiter(first).join(columns)
        else:
            header = first
            rows = rows[1:]
    delimiter = _delimiter(header)
    found = _columns(_cells(path, header, delimiter), 0.001 if slicer else 1.0)
    names = [column.name for column in found]
    _check_columns(names, columns, optional, hint, path)
    lines = [
        _Line(number=row.number, cells=_cells_by_column(path, row, delimiter, names))
        for row in within_time(rows, path)
    ]
    return _Table(path, lines, found)


def _rows(text: str) -> list[_Row]:
    """Split a text into its lines that hold more than delimiters."""
    return [
        _Row(number=number, text=line)
        for number, line in enumerate(text.split("\n"), 1)
        if line.strip(" \t,;")
    ]


def _delimiter(line: str) -> str:
    """Return the character that a line has most of: comma, semicolon or tab."""
    return max(",;\t", key=line.count)


def _check_columns(
    names: Sequence[str], columns: Sequence[str], optional: Sequence[str], hint: str, path: Path
) -> None:
    """Check that a header has all columns, none of them twice.

    Parameters
    ----------
    names : of the header
    columns : that it must have
    optional : columns that must not stand there twice
    hint : what was expected, for the message
    path : of the file, for messages
    """
    missing = [name for name in columns if name not in names]
    if missing:
        raise BadFile(
            path, f"has no column {quoted(missing)}: its header is {quoted(names, 10)}", hint
        )
    twice = [name for name in (*columns, *optional) if names.count(name) > 1]
    if twice:
        raise BadFile(path, f"has the column {quoted(twice)} twice", hint)


def _cells_by_column(
    path: Path, row: _Row, delimiter: str, names: Sequence[str]
) -> Mapping[str, str]:
    """Split a line by column, "" where it has fewer cells; `BadFile` where it has more."""
    cells = _cells(path, row.text, delimiter)
    if any(cells[len(names) :]):
        raise BadFile(
            path,
            f"line {row.number} has {len(cells)} cells, but the header {len(names)}",
            "is a decimal comma in it? Write points, or separate cells by semicolons",
        )
    return dict(zip_longest(names, cells[: len(names)], fillvalue=""))


def _cells(path: Path, row: str, delimiter: str) -> list[str]:
    """Split a line into cells without blanks around; `BadFile` where quotes are broken."""
    try:
        return [cell.strip() for cell in next(csv_rows([row], delimiter=delimiter), [])]
    except BadData as error:
        raise BadFile(path, f"is no table of landmarks ({error})") from None


def _columns(cells: Sequence[str], meters: float) -> list[_Column]:
    """Read names and units of columns.

    Parameters
    ----------
    cells : of the header
    meters : unit of a column that states none [m]
    """
    columns = []
    for cell in cells:
        name = cell.lower()
        match = _WITH_UNIT.match(name) if len(name) <= MAX_NAME else None
        unit = match["in"] or match["after"] if match else ""
        if match and unit in UNITS:
            columns.append(_Column(name=match["name"].strip(), meters=UNITS[unit]))
        else:
            columns.append(_Column(name=name, meters=meters))
    return columns


def _slicer_header(rows: Iterable[_Row]) -> str:
    """Return the header that 3D Slicer writes as a comment, with our names; "" without one."""
    for row in rows:
        if row.text.replace(" ", "").startswith("#columns="):
            _, header = row.text.split("=", 1)
            cells = [cell.strip() for cell in header.split(",")]
            names = [_SLICER_NAMES.get(cell, cell) for cell in cells]
            return ",".join(names) if header else ""
    return ""


def _points(path: Path) -> dict[str, dict[str, Array]]:
    """Read a table of points: (3,) [m] by body and name."""
    table = _table(path, POINT_COLUMNS, ("body",))
    result: dict[str, dict[str, Array]] = {}
    for line in within_time(table.lines, path):
        name = line.cells["name"]
        body = line.cells.get("body", "")
        if not name:
            table.wrong(line, "has no name", "every landmark needs one")
            continue
        of_body = result.setdefault(body, {})
        if name in of_body:
            table.wrong(line, f"names landmark '{name}' again", "each may stand there once")
        of_body[name] = table.point(line, "", f"'{name}'")
    table.done()
    return result


def _from_json(path: Path) -> dict[str, dict[str, Array]]:
    """Read landmarks from JSON, a table of them or 3D Slicer's markups.

    Parameters
    ----------
    path : of the file

    Returns
    -------
    (3,) by body and name [m]

    Raises
    ------
    BadFile : it is not JSON, of another form, in an unknown unit, or has a name twice
    """
    content = _json_table(path)
    if "markups" in content:
        return {"": _markups(path, content["markups"])}
    unit = content.pop("units", "m")
    landmarks = content.pop("landmarks", content)
    if not isinstance(landmarks, dict):
        raise BadFile(path, "its 'landmarks' are no table", JSON_HINT)
    if not isinstance(unit, str) or unit.lower() not in UNITS:
        form = JSON_HINT.removeprefix("expected ")
        raise BadFile(
            path, f"has units '{unit}'", f"expected one of {quoted(list(UNITS))}, in {form}"
        )
    meters = UNITS[unit.lower()]
    result: dict[str, dict[str, Array]] = {}
    for name, value in landmarks.items():
        if isinstance(value, dict):
            result[name] = {
                landmark: _position(path, landmark, position, meters, JSON_HINT)
                for landmark, position in value.items()
            }
        else:
            result.setdefault("", {})[name] = _position(path, name, value, meters, JSON_HINT)
    return result


def _json_table(path: Path) -> dict[str, Any]:
    """Parse JSON; `BadFile` where it is none, no table, or has a name twice."""

    def unique(items: list[tuple[str, object]]) -> dict[str, object]:
        table = dict(items)
        if len(table) < len(items):
            counts = Counter(name for name, _ in items)
            twice, _ = counts.most_common(1)[0]
            raise BadFile(path, f"names '{twice}' twice", "each may stand there once")
        return table

    text = _text(path, JSON_HINT)
    try:
        content = json.loads(text, object_pairs_hook=unique)
    except (ValueError, RecursionError) as error:
        raise BadFile(path, f"is not JSON ({error})", JSON_HINT) from None
    if not isinstance(content, dict):
        raise BadFile(path, "holds no object of landmarks", JSON_HINT)
    return content


def _markups(path: Path, markups: object) -> dict[str, Array]:
    """Read the control points of 3D Slicer's markups.

    Parameters
    ----------
    path : of the file, for messages
    markups : of its JSON

    Returns
    -------
    (3,) by label [m], along the file's axes

    Raises
    ------
    BadFile : a point has no label, one that another has, or no position
    """
    result: dict[str, Array] = {}
    for markup in markups if isinstance(markups, list) else []:
        points = markup.get("controlPoints", []) if isinstance(markup, dict) else []
        if not isinstance(points, list):
            raise BadFile(path, "has control points that are no list", MARKUPS_HINT)
        if not points:
            continue
        unit = str(markup.get("coordinateUnits", "mm")).lower()
        if unit not in UNITS:
            raise BadFile(
                path, f"has coordinates in '{unit}'", f"expected one of {quoted(list(UNITS))}"
            )
        for point in points:
            name = _label(path, point)
            if name in result:
                raise BadFile(path, f"names point '{name}' twice", MARKUPS_HINT)
            if point.get("positionStatus", "defined") not in ("defined", "preview"):
                raise BadFile(
                    path, f"point '{name}' has no place yet", "place it in 3D Slicer, or delete it"
                )
            position = point.get("position")
            result[name] = _position(path, name, position, UNITS[unit], MARKUPS_HINT)
    return result


def _label(path: Path, point: object) -> str:
    """Return the label of a control point; `BadFile` without."""
    name = str(point.get("label", "")) if isinstance(point, dict) else ""
    if not name:
        raise BadFile(path, "has a point without a label", MARKUPS_HINT)
    return name


def _position(path: Path, name: str, value: object, meters: float, hint: str) -> Array:
    """Convert three numbers to a position.

    Parameters
    ----------
    path : of the file, for messages
    name : of the landmark, for messages
    value : of the JSON
    meters : the file's unit [m]
    hint : what was expected, for the message

    Returns
    -------
    (3,) [m]

    Raises
    ------
    BadFile : it is no list of three numbers
    """
    if not isinstance(value, list) or len(value) != 3 or not all(map(_is_coordinate, value)):
        raise BadFile(
            path, f"landmark '{name}' is {str(value)[:40]}", f"expected three numbers: {hint}"
        )
    return frozen_array(meters * np.array(value, dtype=np.float64))


def _is_coordinate(value: object) -> bool:
    """Return whether this is a number that may be a coordinate.

    Beyond 1e12 an integer may have no float, and nothing is there.
    """
    if not isinstance(value, int | float) or isinstance(value, bool):
        return False
    return abs(value) < 1e12


def _stations(path: Path) -> dict[str, dict[str, Array]]:
    """Read OpenSim's stations and markers: (3,) [m] by body and name.

    Raises
    ------
    BadFile : it is neither a model nor a MarkerSet, or names a landmark of a body twice
    """
    node = read_document(path, ("Model", "MarkerSet"), "an OpenSim model or MarkerSet")
    if node.kind == "Model":
        stations = Frames(node).stations()
    else:
        stations = [
            (marker.name, holder_of(marker), marker.vector("location"))
            for marker in named_markers(node)
        ]
    result: dict[str, dict[str, Array]] = {}
    for name, body, location in stations:
        of_body = result.setdefault(body, {})
        if name in of_body:
            raise BadFile(
                path, f"names landmark '{name}' of '{body}' twice", "each may stand there once"
            )
        of_body[name] = frozen_array(location)
    return result
