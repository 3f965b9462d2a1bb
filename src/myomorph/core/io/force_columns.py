"""Forces in the columns of a table, found by the usual names, as wrenches in ground."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.causes import FORCE_FILES
from myomorph.core.model.errors import BadData, UnknownName, quoted
from myomorph.core.model.messages import Message
from myomorph.core.model.series import Table, Wrenches

OPENSIM = re.compile(
    r"(?P<before>.*?)(?P<kind>force|torque|moment)(?P<after>.*?)"
    r"_?(?P<part>[vpm]?)_?(?P<axis>[xyz])$"
)
LABORATORY = re.compile(
    r"(?P<before>.*?)(?P<kind>cop|grf|grm|[fmtp]|(?<![a-z])[ac])(?P<after>[_. ]?\d*)"
    r"[_. ]?(?P<axis>[xyz])(?P<end>[_. ]?\w*)$"
)
UNIT = re.compile(r"\s*[\[(](?P<unit>[\w.*·]+)[\])]$")
WORDS = re.compile(r"ground|forces?|moments?|torques?|cop|grf|grm|[_. ]")
PARTS = {
    "force": "force",
    "f": "force",
    "grf": "force",
    "v": "force",
    "cop": "point",
    "p": "point",
    "c": "point",
    "a": "point",
    "torque": "torque",
    "moment": "torque",
    "m": "torque",
    "t": "torque",
    "grm": "torque",
}
UNITS = {"mm": 1e-3, "cm": 1e-2, "kn": 1e3, "nmm": 1e-3, "n.mm": 1e-3, "n*mm": 1e-3, "n·mm": 1e-3}

USUAL = (
    "ground_force_vx, 1_ground_force_px, ground_torque_x; Fx1, COPx1, Mx1; FP1_Fx, FP1_COPx, FP1_Mx"
)
"""Names that are known, for messages."""


@dataclass(frozen=True, kw_only=True)
class ForceColumns:
    """The columns of one force.

    Attributes
    ----------
    name : what the columns of the force itself begin with, without what names the axis
    force, point, torque : columns along x, y and z; () for a part that the table lacks, "" for an
        axis that it lacks
    """

    name: str
    force: tuple[str, ...]
    point: tuple[str, ...] = ()
    torque: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class _Column:
    """A column of a force, by its name.

    Attributes
    ----------
    force : word that distinguishes its force from others
    part : "force", "point" or "torque"
    axis : "x", "y" or "z"
    title : of the force, as the column's name has it
    """

    force: str
    part: str
    axis: str
    title: str


def force_columns(names: Sequence[str]) -> tuple[ForceColumns, ...]:
    """Find forces with all three axes and a center of pressure or moments in a table's columns.

    Knows OpenSim's names (`1_ground_force_vx`, `ground_force_r_px`, `ground_torque_x`,
    `calcn_r_force_vx`) and those that laboratories write (`Fx1`, `COPx1`, `Mx1`, `FP2_Fx`, `F1x`,
    `COP1_x [mm]`), in capital or small letters.

    Parameters
    ----------
    names : of the columns

    Returns
    -------
    columns of each force, in the order in which the forces first occur
    """
    parts_by_force: dict[str, dict[str, dict[str, str]]] = {}
    titles: dict[str, str] = {}
    for name in names:
        column = _column(name)
        if column is None:
            continue
        parts = parts_by_force.setdefault(column.force, {})
        parts.setdefault(column.part, {}).setdefault(column.axis, name)
        if column.part == "force":
            titles.setdefault(column.force, column.title)
    forces = []
    for key, parts in parts_by_force.items():
        force = parts.get("force", {})
        point = parts.get("point", {})
        torque = parts.get("torque", {})
        has_point = len(point) > 1
        if len(force) < 3 or not (has_point or torque):
            continue
        forces.append(
            ForceColumns(
                name=titles[key].strip("_. ") or f"force{key}",
                force=_along_axes(force),
                point=_along_axes(point) if has_point else (),
                torque=_along_axes(torque) if torque else (),
            )
        )
    return tuple(forces)


def _along_axes(columns: Mapping[str, str]) -> tuple[str, ...]:
    """Order columns by axis, "" for one that is missing."""
    return tuple(columns.get(axis, "") for axis in "xyz")


def _column(name: str) -> _Column | None:
    """Find what a column is by its name, with its unit or without; None where it is not known."""
    plain = UNIT.sub("", name)
    small = plain.lower()
    match = OPENSIM.match(small)
    if match is not None:
        part = match["part"] or match["kind"]
        rest = match["before"] + match["after"]
    else:
        match = LABORATORY.match(small)
        if match is None:
            return None
        part = match["kind"]
        rest = match["before"] + match["after"] + match["end"]
    behind_axis = plain[match.end("axis") :]
    return _Column(
        force=WORDS.sub("", rest),
        part=PARTS[part],
        axis=match["axis"],
        title=plain[: match.end("after")] + behind_axis,
    )


def table_wrenches(table: Table, bodies: Mapping[str, str] | None = None) -> Wrenches:
    """Read the forces of a table in ground.

    A force without a center of pressure acts at the ground's origin with its moment about it, and a
    note says so.

    Parameters
    ----------
    table : columns (frames, columns), with their units in brackets where these are not SI
    bodies : body of each force by what names of its columns begin with ("FP1_"); None or empty
        takes all forces, whose bodies then are not known ("")

    Returns
    -------
    forces [N], points [m] and torques [N m] (frames, forces, 3)

    Raises
    ------
    BadData : the table has no forces
    UnknownName : none or several forces begin with a name in `bodies`
    """
    source = table.source or "the table"
    if bodies:
        names = tuple(bodies)
        chosen = tuple(_with_prefix(table, prefix, source) for prefix in bodies)
    else:
        chosen = force_columns(table.names)
        names = tuple(columns.name for columns in chosen)
    if not chosen:
        more = ", ..." if len(table.names) > 6 else ""
        raise BadData(
            f"{source}: no columns of a force with a center of pressure or moments are found among"
            f" {quoted(table.names)}{more}; names that are known: {USUAL}"
        )
    return Wrenches(
        time=table.time,
        names=names,
        bodies=tuple(bodies.values()) if bodies else ("",) * len(names),
        forces=np.stack([_vectors(table, columns.force) for columns in chosen], axis=1),
        points=np.stack([_vectors(table, columns.point) for columns in chosen], axis=1),
        torques=np.stack([_vectors(table, columns.torque) for columns in chosen], axis=1),
        notes=_notes(names, chosen),
    )


def _notes(names: Sequence[str], forces: Sequence[ForceColumns]) -> tuple[Message, ...]:
    """List the forces that have no center of pressure, and those that have it in part."""
    without = []
    in_part = []
    for name, columns in zip(names, forces, strict=True):
        if not columns.point:
            without.append(
                FORCE_FILES.message(
                    f"force '{name}' has no center of pressure: its moment was taken to be about"
                    " the ground's origin"
                )
            )
        elif "" in columns.point:
            axis = "xyz"[columns.point.index("")]
            in_part.append(
                FORCE_FILES.message(
                    f"force '{name}' has a center of pressure without {axis}: taken as 0"
                )
            )
    return (*without, *in_part)


def _vectors(table: Table, columns: tuple[str, ...]) -> Array:
    """Read three columns as vectors in SI units.

    Parameters
    ----------
    table : its columns name their units, else they are SI
    columns : along x, y and z, "" for one that it lacks; () for none

    Returns
    -------
    (frames, 3) with 0 where the table has no column
    """
    values = np.zeros((len(table), 3))
    for axis, name in enumerate(columns):
        if not name:
            continue
        match = UNIT.search(name)
        unit = match["unit"].lower() if match else ""
        values[:, axis] = table[name] * UNITS.get(unit, 1.0)
    return values


def _vector_columns(table: Table, *prefixes: str) -> tuple[str, ...]:
    """Find the columns x, y and z that begin with the first prefix that has all, or ()."""
    names = set(table.names)
    for prefix in prefixes:
        columns = tuple(f"{prefix}{axis}" for axis in "xyz")
        if names.issuperset(columns):
            return columns
    return ()


def _with_prefix(table: Table, prefix: str, source: str) -> ForceColumns:
    """Find the columns of the force whose names begin so, by any of the known names.

    Parameters
    ----------
    table : names of columns are read
    prefix : what the names begin with
    source : of the table, for messages

    Raises
    ------
    UnknownName : no force, or more than one, begins so
    """
    torque_prefix = prefix.replace("force", "torque")
    force = _vector_columns(table, f"{prefix}v", f"{prefix}F", prefix)
    point = _vector_columns(table, f"{prefix}p", f"{prefix}P")
    torque = _vector_columns(table, torque_prefix, f"{prefix}m", f"{torque_prefix}m")
    if force and point:
        return ForceColumns(name=prefix, force=force, point=point, torque=torque)
    known = force_columns(table.names)
    found = [columns for columns in known if columns.name == prefix.strip("_. ")]
    if not found:
        found = [columns for columns in known if _all_begin_with(prefix, columns.force)]
    if len(found) != 1:
        existing = [columns.name for columns in known]
        raise UnknownName("force", prefix, existing=existing or table.names, where=source)
    return found[0]


def _all_begin_with(prefix: str, names: Sequence[str]) -> bool:
    return all(name.startswith(prefix) for name in names)
