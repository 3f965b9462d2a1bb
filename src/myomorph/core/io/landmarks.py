"""Landmarks of bones: tables, 3D Slicer's markups, JSON, OpenSim's markers and stations.

`read_landmark_pairs` gives plain values (`model.landmarks.LandmarkPairs`), since readers know only
the nouns of `model`; `study` makes feature points of them.
"""

from __future__ import annotations

import csv
import json
import os
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from myomorph.core.io.osim.document import read_document
from myomorph.core.io.osim.frames import Frames
from myomorph.core.io.osim.setup_parts import holder_of, named_markers
from myomorph.core.io.parsing.text import check_size, file_text, number
from myomorph.core.model.arrays import Array, frozen_array
from myomorph.core.model.errors import BadFile, UnknownName, quoted
from myomorph.core.model.landmarks import LandmarkPairs

LARGEST = 64 * 1024 * 1024
LONGEST = 200  # Letters of a column's name in which a unit is looked for.
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
    pairs: dict[str, dict[str, Array]] = {}
    for line in table.lines:
        body = line.cells["body"]
        name = line.cells["name"]
        if not body or not name:
            table.wrong(line, f"has no {'name' if body else 'body'}", "every landmark needs both")
            continue
        sides = [table.point(line, f"{side}_", f"'{name}' of '{body}'", side) for side in SIDES]
        known = pairs.setdefault(body, {})
        if name in known:
            table.wrong(
                line, f"names landmark '{name}' of '{body}' again", "each may stand there once"
            )
        known[name] = np.array(sides)
    table.done()
    return {
        body: LandmarkPairs(
            names=tuple(pair),
            source=np.stack([source for source, _ in pair.values()]),
            target=np.stack([target for _, target in pair.values()]),
        )
        for body, pair in pairs.items()
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
    body_landmarks = read_body_landmarks(path)
    if body:
        if body not in body_landmarks and set(body_landmarks) != {""}:
            raise UnknownName("body", body, existing=sorted(body_landmarks), where=str(path))
        return body_landmarks[body] if body in body_landmarks else body_landmarks[""]
    if len(body_landmarks) > 1:
        raise BadFile(
            path,
            f"has landmarks of {len(body_landmarks)} bodies",
            f"say which: {quoted(sorted(body_landmarks))}",
        )
    return next(iter(body_landmarks.values()))


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


@dataclass(frozen=True)
class _Line:
    """One line of a table.

    Attributes
    ----------
    number : of the line in the file, counted from 1
    cells : by column
    """

    number: int
    cells: Mapping[str, str]


class _Table:
    """Lines of a table whose header is known, and the errors in them.

    Parameters
    ----------
    path : of the file
    lines : below the header
    factors : unit of each column [m]
    """

    def __init__(self, path: Path, lines: Sequence[_Line], factors: Mapping[str, float]):
        self.path = path
        self.lines = lines
        self.factors = factors
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
        values = []
        for axis in "xyz":
            text = line.cells[prefix + axis]
            try:
                values.append(self.factors[prefix + axis] * number(text))
            except ValueError:
                self.wrong(
                    line, f"has '{text[:40]}' for {prefix}{axis} of {whose}", "expected a number"
                )
                return np.zeros(3)
        what = f"{side} point" if side else "place"
        if np.isnan(values).all():
            self.wrong(line, f"has no {what} of {whose}", "give it, or leave the line out")
        elif not np.isfinite(values).all():
            self.wrong(line, f"has no finite {what} of {whose}", "expected three numbers")
        return frozen_array(np.nan_to_num(values))

    def done(self) -> None:
        """Check that there are lines without errors.

        Raises
        ------
        BadFile : a line has an error, or there is none
        """
        if not self.lines:
            raise BadFile(self.path, "has a header, but no landmark below it")
        if self._wrong:
            problem, hint = self._wrong[0]
            more = len(self._wrong) - 1
            raise BadFile(
                self.path, problem + (f" ({more} more lines are wrong too)" if more else ""), hint
            )


def _text(path: Path, hint: str) -> str:
    """Read the text of a file that is not too large; `BadFile` where it is."""
    check_size(path, LARGEST, "landmarks")
    return file_text(path, hint)


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
    text = _text(path, hint)
    rows = [(index + 1, row) for index, row in enumerate(text.split("\n")) if row.strip(" \t,;")]
    slicer = bool(rows) and rows[0][1].startswith(_IN_MILLIMETERS)
    header = _slicer_header(rows) if slicer else ""
    rows = [(line, row) for line, row in rows if not row.lstrip().startswith("#")]
    if not header:
        if not rows:
            raise BadFile(path, "has no header", hint)
        if columns == POINT_COLUMNS and _HEADLESS.fullmatch(rows[0][1]):
            header = max(",;\t", key=rows[0][1].count).join(columns)
        else:
            header = rows[0][1]
            rows = rows[1:]
    delimiter = max(",;\t", key=header.count)
    names, factors = _columns(_cells(path, header, delimiter), 0.001 if slicer else 1.0)
    missing = [name for name in columns if name not in names]
    if missing:
        raise BadFile(
            path, f"has no column {quoted(missing)}: its header is {quoted(names, 10)}", hint
        )
    twice = [name for name in (*columns, *optional) if names.count(name) > 1]
    if twice:
        raise BadFile(path, f"has the column {quoted(twice)} twice", hint)
    lines = []
    for line, row in rows:
        cells = _cells(path, row, delimiter)
        if any(cells[len(names) :]):
            hint = "is a decimal comma in it? Write points, or separate cells by semicolons"
            raise BadFile(
                path, f"line {line} has {len(cells)} cells, but the header {len(names)}", hint
            )
        cells += [""] * (len(names) - len(cells))
        lines.append(_Line(line, dict(zip(names, cells, strict=False))))
    return _Table(path, lines, dict(zip(names, factors, strict=True)))


def _cells(path: Path, row: str, delimiter: str) -> list[str]:
    """Split a line into cells without blanks around; `BadFile` where quotes are broken."""
    try:
        return [cell.strip() for cell in next(csv.reader([row], delimiter=delimiter), [])]
    except csv.Error as error:
        raise BadFile(path, f"is no table of landmarks ({error})") from None


def _columns(cells: Sequence[str], factor: float) -> tuple[list[str], list[float]]:
    """Read names and units of columns.

    Parameters
    ----------
    cells : of the header
    factor : of a column without a unit [m]

    Returns
    -------
    names in small letters without units, and the unit of each [m]
    """
    names = []
    factors = []
    for cell in cells:
        name = cell.lower()
        unit = _WITH_UNIT.match(name) if len(name) <= LONGEST else None
        unit_text = (unit["in"] or unit["after"]) if unit else ""
        known = unit is not None and unit_text in UNITS
        names.append(unit["name"].strip() if unit is not None and known else name)
        factors.append(UNITS[unit_text] if known else factor)
    return names, factors


def _slicer_header(rows: Sequence[tuple[int, str]]) -> str:
    """Return the header that 3D Slicer writes as a comment, with our names; "" without one."""
    header = next(
        (row.split("=", 1)[1] for _, row in rows if row.replace(" ", "").startswith("#columns=")),
        "",
    )
    cells = [_SLICER_NAMES.get(cell.strip(), cell.strip()) for cell in header.split(",")]
    return ",".join(cells) if header else ""


def _points(path: Path) -> dict[str, dict[str, Array]]:
    """Read a table of points: (3,) [m] by body and name."""
    table = _table(path, POINT_COLUMNS, ("body",))
    result: dict[str, dict[str, Array]] = {}
    for line in table.lines:
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
    hint = (
        'expected {"name": [x, y, z], ...}, {"body": {"name": [x, y, z], ...}}, or 3D Slicer\'s'
        " markups"
    )
    text = _text(path, hint)

    def unique(items: list[tuple[str, object]]) -> dict[str, object]:
        table = dict(items)
        if len(table) < len(items):
            twice = Counter(name for name, _ in items).most_common(1)[0][0]
            raise BadFile(path, f"names '{twice}' twice", "each may stand there once")
        return table

    try:
        content = json.loads(text, object_pairs_hook=unique)
    except (ValueError, RecursionError) as error:
        raise BadFile(path, f"is not JSON ({error})", hint) from None
    if not isinstance(content, dict):
        raise BadFile(path, "holds no object of landmarks", hint)
    if "markups" in content:
        return {"": _markups(path, content["markups"])}
    unit = content.pop("units", "m")
    inner = content.pop("landmarks", content)
    if not isinstance(inner, dict):
        raise BadFile(path, "its 'landmarks' are no table", hint)
    if not isinstance(unit, str) or unit.lower() not in UNITS:
        raise BadFile(
            path, f"has units '{unit}'", f"expected one of {quoted(list(UNITS))}, in {hint[9:]}"
        )
    factor = UNITS[unit.lower()]
    result: dict[str, dict[str, Array]] = {}
    for name, value in inner.items():
        if isinstance(value, dict):
            result[name] = {
                landmark: _place(path, landmark, place, factor, hint)
                for landmark, place in value.items()
            }
        else:
            result.setdefault("", {})[name] = _place(path, name, value, factor, hint)
    return result


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
    hint = "expected lists of points, as 3D Slicer writes them"
    result: dict[str, Array] = {}
    for markup in markups if isinstance(markups, list) else []:
        points = markup.get("controlPoints", []) if isinstance(markup, dict) else []
        if not isinstance(points, list):
            raise BadFile(path, "has control points that are no list", hint)
        unit = str(markup.get("coordinateUnits", "mm")).lower() if points else "mm"
        if unit not in UNITS:
            raise BadFile(
                path, f"has coordinates in '{unit}'", f"expected one of {quoted(list(UNITS))}"
            )
        for point in points:
            name = str(point.get("label", "")) if isinstance(point, dict) else ""
            if not name or name in result:
                raise BadFile(
                    path,
                    f"names point '{name}' twice" if name else "has a point without a label",
                    hint,
                )
            if point.get("positionStatus", "defined") not in ("defined", "preview"):
                raise BadFile(
                    path, f"point '{name}' has no place yet", "place it in 3D Slicer, or delete it"
                )
            result[name] = _place(path, name, point.get("position"), UNITS[unit], hint)
    return result


def _place(path: Path, name: str, value: object, factor: float, hint: str) -> Array:
    """Convert three numbers to a position.

    Parameters
    ----------
    path : of the file, for messages
    name : of the landmark, for messages
    value : of the JSON
    factor : the file's unit [m]
    hint : what was expected, for the message

    Returns
    -------
    (3,) [m]

    Raises
    ------
    BadFile : it is no list of three numbers
    """
    numbers = (
        value
        if isinstance(value, list) and all(type(number) in (int, float) for number in value)
        else []
    )
    # Beyond this an integer has no float, and nothing is a place.
    if len(numbers) != 3 or not all(abs(number) < 1e12 for number in numbers):
        raise BadFile(
            path, f"landmark '{name}' is {str(value)[:40]}", f"expected three numbers: {hint}"
        )
    return frozen_array(factor * np.array(numbers, dtype=np.float64))


def _stations(path: Path) -> dict[str, dict[str, Array]]:
    """Read OpenSim's stations and markers: (3,) [m] by body and name.

    Raises
    ------
    BadFile : it is neither a model nor a MarkerSet, or names a landmark of a body twice
    """
    node = read_document(path, ("Model", "MarkerSet"), "an OpenSim model or MarkerSet")
    result: dict[str, dict[str, Array]] = {}
    if node.kind == "Model":
        placed = Frames(node).stations()
    else:
        placed = [
            (marker.name, holder_of(marker), marker.vector("location"))
            for marker in named_markers(node)
        ]
    for name, body, location in placed:
        if name in result.setdefault(body, {}):
            raise BadFile(
                path, f"names landmark '{name}' of '{body}' twice", "each may stand there once"
            )
        result[body][name] = frozen_array(location)
    return result
