"""Forces in the columns of a table, found by the usual names, as wrenches in ground."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.errors import BadData, UnknownName, quoted
from myomorph.model.series import Table, Wrenches

OPENSIM = re.compile(r"(?P<before>.*?)(?P<kind>force|torque|moment)(?P<after>.*?)_?(?P<part>[vpm]?)_?(?P<axis>[xyz])$")
LABORATORY = re.compile(
    r"(?P<before>.*?)(?P<kind>cop|grf|grm|[fmtp]|(?<![a-z])[ac])(?P<after>[_. ]?\d*)[_. ]?(?P<axis>[xyz])"
    r"(?P<end>[_. ]?\w*)$"
)
UNIT = re.compile(r"\s*[\[(](?P<unit>[\w.*·]+)[\])]$")
WORDS = re.compile(r"ground|forces?|moments?|torques?|cop|grf|grm|[_. ]")
PARTS = {
    "force": "force", "f": "force", "grf": "force", "v": "force",
    "cop": "point", "p": "point", "c": "point", "a": "point",
    "torque": "torque", "moment": "torque", "m": "torque", "t": "torque", "grm": "torque",
}  # fmt: skip
UNITS = {"mm": 1e-3, "cm": 1e-2, "kn": 1e3, "nmm": 1e-3, "n.mm": 1e-3, "n*mm": 1e-3, "n·mm": 1e-3}

USUAL = "ground_force_vx, 1_ground_force_px, ground_torque_x; Fx1, COPx1, Mx1; FP1_Fx, FP1_COPx, FP1_Mx"
"""Names that are known, for messages."""


@dataclass(frozen=True)
class ForceColumns:
    """The columns of one force."""

    name: str  # what the columns of the force itself begin with, without what names the axis
    # force, point, torque: columns along x, y and z; () for a part that the table lacks, "" for an axis that it lacks
    force: tuple[str, ...]
    point: tuple[str, ...] = ()
    torque: tuple[str, ...] = ()


def force_columns(names: Sequence[str]) -> tuple[ForceColumns, ...]:
    """Forces with all three axes and a center of pressure or moments, among the columns of a table. Knows OpenSim's
    names (`1_ground_force_vx`, `ground_force_r_px`, `ground_torque_x`, `calcn_r_force_vx`) and those that laboratories
    write (`Fx1`, `COPx1`, `Mx1`, `FP2_Fx`, `F1x`, `COP1_x [mm]`), in capital or small letters.
    """
    by_force: dict[str, dict[str, dict[str, str]]] = {}
    titles: dict[str, str] = {}
    for name in names:
        known = _known(name)
        if known is None:
            continue
        key, part, axis, title = known
        by_force.setdefault(key, {}).setdefault(part, {}).setdefault(axis, name)
        if part == "force":
            titles.setdefault(key, title)
    forces = []
    for key, parts in by_force.items():
        force, point = parts.get("force", {}), parts.get("point", {})
        torque = parts.get("torque", {})
        if len(force) < 3 or (len(point) < 2 and not torque):
            continue
        forces.append(
            ForceColumns(
                titles[key].strip("_. ") or f"force{key}",
                tuple(force[axis] for axis in "xyz"),
                tuple(point.get(axis, "") for axis in "xyz") if len(point) > 1 else (),
                tuple(torque.get(axis, "") for axis in "xyz") if torque else (),
            )
        )
    return tuple(forces)


def _known(name: str) -> tuple[str, str, str, str] | None:
    """Of which force, which part and axis a column is, and what its name begins with; None where that is not known."""
    plain = UNIT.sub("", name)
    small = plain.lower()
    match = OPENSIM.match(small)
    if match is not None:
        part = PARTS[match["part"] or match["kind"]]
        rest, cut = match["before"] + match["after"], match.end("after")
    else:
        match = LABORATORY.match(small)
        if match is None:
            return None
        part = PARTS[match["kind"]]
        rest, cut = match["before"] + match["after"] + match["end"], match.end("after")
    title = plain[:cut] + (plain[match.end("axis") :] if match.end("axis") < len(plain) else "")
    return WORDS.sub("", rest), part, match["axis"], title


def table_wrenches(table: Table, bodies: Mapping[str, str] | None = None) -> Wrenches:
    """Forces of a table in ground [N, m, N m]; the bodies are those given by what names of columns begin with ("FP1_"),
    else not known (""). A force without a center of pressure acts at the ground's origin with its moment about it, and
    a note says so.
    """
    source = table.source or "the table"
    if bodies:
        chosen = tuple(_with_prefix(table, prefix, source) for prefix in bodies)
        names = tuple(bodies)
    else:
        chosen = force_columns(table.names)
        names = tuple(columns.name for columns in chosen)
    if not chosen:
        some = quoted(table.names)
        raise BadData(
            f"{source}: no columns of a force with a center of pressure or moments are found among {some}"
            f"{', ...' if len(table.names) > 6 else ''}; names that are known: {USUAL}"
        )
    notes = tuple(
        f"force '{name}' has no center of pressure: its moment was taken to be about the ground's origin"
        for name, columns in zip(names, chosen, strict=True)
        if not columns.point
    ) + tuple(
        f"force '{name}' has a center of pressure without {'xyz'[columns.point.index('')]}: taken as 0"
        for name, columns in zip(names, chosen, strict=True)
        if "" in columns.point
    )
    parts = [
        np.stack([_vectors(table, getattr(columns, part)) for columns in chosen], axis=1)
        for part in ("force", "point", "torque")
    ]
    owners = tuple(bodies.values()) if bodies else ("",) * len(names)
    return Wrenches(table.time, names, owners, *parts, notes=notes)


def _vectors(table: Table, columns: tuple[str, ...]) -> Array:
    """Three columns (frames, 3) in SI units; zero where the table has none."""
    values = np.zeros((len(table), 3))
    for axis, name in enumerate(columns):
        if name:
            unit = UNIT.search(name)
            values[:, axis] = table[name] * UNITS.get(unit["unit"].lower() if unit else "", 1.0)
    return values


def _with_prefix(table: Table, prefix: str, source: str) -> ForceColumns:
    """The columns of the force whose names begin so, as OpenSim names them or a laboratory."""
    torque = prefix.replace("force", "torque")
    choices = ((f"{prefix}v", f"{prefix}F", prefix), (f"{prefix}p", f"{prefix}P"), (torque, f"{prefix}m", f"{torque}m"))
    names = set(table.names)
    force, point, free = (
        next(
            (
                tuple(f"{start}{axis}" for axis in "xyz")
                for start in starts
                if {f"{start}{axis}" for axis in "xyz"} <= names
            ),
            (),
        )
        for starts in choices
    )
    if force and point:
        return ForceColumns(prefix, force, point, free)
    known = force_columns(table.names)
    begin = [columns for columns in known if columns.name == prefix.strip("_. ")] or [
        columns for columns in known if all(name.startswith(prefix) for name in columns.force)
    ]
    if len(begin) != 1:
        raise UnknownName("force", prefix, [columns.name for columns in known] or table.names, source)
    return begin[0]
