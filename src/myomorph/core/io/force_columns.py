"""Forces in the columns of a table, found by the usual names, as wrenches in ground."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData, UnknownName, quoted
from myomorph.core.model.series import Table, Wrenches

OPENSIM = re.compile(
    r"(?P<before>.*?)(?P<kind>force|torque|moment)(?P<after>.*?)_?(?P<part>[vpm]?)_?(?P<axis>[xyz])$"
)
LABORATORY = re.compile(
    r"(?P<before>.*?)(?P<kind>cop|grf|grm|[fmtp]|(?<![a-z])[ac])(?P<after>[_. ]?\d*)[_."
    r" ]?(?P<axis>[xyz])"
    r"(?P<end>[_. ]?\w*)$"
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


@dataclass(frozen=True)
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
        force = parts.get("force", {})
        point = parts.get("point", {})
        torque = parts.get("torque", {})
        if len(force) < 3 or (len(point) < 2 and not torque):
            continue
        forces.append(
            ForceColumns(
                name=titles[key].strip("_. ") or f"force{key}",
                force=tuple(force[axis] for axis in "xyz"),
                point=tuple(point.get(axis, "") for axis in "xyz") if len(point) > 1 else (),
                torque=tuple(torque.get(axis, "") for axis in "xyz") if torque else (),
            )
        )
    return tuple(forces)


def _known(name: str) -> tuple[str, str, str, str] | None:
    """Find what a column is by its name.

    Parameters
    ----------
    name : of the column, with its unit or without

    Returns
    -------
    key of its force, "force", "point" or "torque", its axis, and what its name begins with; None
    where the name is not known
    """
    plain = UNIT.sub("", name)
    small = plain.lower()
    match = OPENSIM.match(small)
    if match is not None:
        part = PARTS[match["part"] or match["kind"]]
        rest = match["before"] + match["after"]
        cut = match.end("after")
    else:
        match = LABORATORY.match(small)
        if match is None:
            return None
        part = PARTS[match["kind"]]
        rest = match["before"] + match["after"] + match["end"]
        cut = match.end("after")
    title = plain[:cut] + (plain[match.end("axis") :] if match.end("axis") < len(plain) else "")
    return WORDS.sub("", rest), part, match["axis"], title


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
        chosen = tuple(_with_prefix(table, prefix, source) for prefix in bodies)
        names = tuple(bodies)
    else:
        chosen = force_columns(table.names)
        names = tuple(columns.name for columns in chosen)
    if not chosen:
        some = quoted(table.names)
        raise BadData(
            f"{source}: no columns of a force with a center of pressure or moments are found among"
            f" {some}{', ...' if len(table.names) > 6 else ''}; names that are known: {USUAL}"
        )
    notes = tuple(
        f"force '{name}' has no center of pressure: its moment was taken to be about the ground's"
        " origin"
        for name, columns in zip(names, chosen, strict=True)
        if not columns.point
    ) + tuple(
        f"force '{name}' has a center of pressure without {'xyz'[columns.point.index('')]}: taken"
        " as 0"
        for name, columns in zip(names, chosen, strict=True)
        if "" in columns.point
    )
    return Wrenches(
        time=table.time,
        names=names,
        bodies=tuple(bodies.values()) if bodies else ("",) * len(names),
        forces=np.stack([_vectors(table, columns.force) for columns in chosen], axis=1),
        points=np.stack([_vectors(table, columns.point) for columns in chosen], axis=1),
        torques=np.stack([_vectors(table, columns.torque) for columns in chosen], axis=1),
        notes=notes,
    )


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
        if name:
            unit = UNIT.search(name)
            values[:, axis] = table[name] * UNITS.get(unit["unit"].lower() if unit else "", 1.0)
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
    torque = prefix.replace("force", "torque")
    force = _vector_columns(table, f"{prefix}v", f"{prefix}F", prefix)
    point = _vector_columns(table, f"{prefix}p", f"{prefix}P")
    free = _vector_columns(table, torque, f"{prefix}m", f"{torque}m")
    if force and point:
        return ForceColumns(name=prefix, force=force, point=point, torque=free)
    known = force_columns(table.names)
    begin = [columns for columns in known if columns.name == prefix.strip("_. ")] or [
        columns for columns in known if all(name.startswith(prefix) for name in columns.force)
    ]
    if len(begin) != 1:
        raise UnknownName(
            "force",
            prefix,
            existing=[columns.name for columns in known] or table.names,
            where=source,
        )
    return begin[0]


XYZ = "xyz"
PUSH = 50.0  # Largest force of a plate that somebody stands on, at least [N].
LOADED = 20.0  # Force from which on a point or a moment is looked at [N].
LEVEL = 0.002  # A center of pressure stays on its plate: its height changes by less [m].
UPRIGHT = 0.7
ONE_WAY = 0.95
"""Share of a plate's force along the vertical, and of its loaded samples in which that has one
sign.
"""
NEAR = 10.0
FAR = 20.0
"""A center of pressure is nearer to the origin than the first [m]; numbers beyond the second are
millimetres.
"""
TURNS = 0.05  # A moment about the vertical changes by more with the steps of a walk [N m].


def guessed_names(values: Array) -> list[str] | None:
    """Guess the names of all columns of a table of forces from its numbers.

    The first column is time where it rises evenly. The rest are groups of a force and a center of
    pressure (6 columns each), a force and a moment (6), or a force, a center of pressure and a
    moment in one of both orders (9). One axis is vertical: the forces point along it, to one side
    each, and centers of pressure do not move along it, which moments do.

    Parameters
    ----------
    values : (rows, columns)

    Returns
    -------
    as "time", "Fx1", "COPx1", "Mx1"; None where none of these readings is possible, or more than
    one
    """
    steps = np.diff(values[:, 0])
    even = (
        len(steps) > 1
        and np.isfinite(steps).all()
        and (steps > 0.0).all()
        and np.ptp(steps) < 0.1 * steps.mean()
    )
    time, rest = (["time"], values[:, 1:]) if even else ([], values)
    readings = [names for names in (_read(rest, kinds) for kinds in KINDS) if names is not None]
    return [*time, *readings[0]] if len(readings) == 1 else None


KINDS = (("F", "COP"), ("F", "M"), ("F", "COP", "M"), ("F", "M", "COP"))


def _read(values: Array, kinds: tuple[str, ...]) -> list[str] | None:
    """Name columns that are read as groups of these kinds.

    Parameters
    ----------
    values : (rows, columns) without the time
    kinds : "F", "COP" and "M" in the order in which each group has them

    Returns
    -------
    one name per column; None where the numbers do not allow this reading
    """
    width = 3 * len(kinds)
    if not values.shape[1] or values.shape[1] % width:
        return None
    groups = values.reshape(len(values), -1, len(kinds), 3)
    forces = groups[:, :, 0]
    size = np.linalg.norm(forces, axis=2)
    if not np.nanmax(size, initial=0.0) > PUSH:
        return None
    up = int(np.argmax(np.nansum(np.abs(forces), axis=(0, 1))))
    looked = 0
    for g in range(groups.shape[1]):
        loaded = size[:, g] > LOADED
        if any(_is_force(groups[:, g, part], up) for part in range(1, len(kinds))):
            return None
        if loaded.sum() < 3:
            continue
        if not _is_force(forces[:, g], up):
            return None
        looked += 1
        for index, kind in enumerate(kinds[1:], 1):
            part = groups[loaded, g, index]
            if not (
                _is_point(part, up) if kind == "COP" else _is_moment(part, size[loaded, g], up)
            ):
                return None
    if not looked:
        return None
    return [
        f"{kind}{axis}{g + 1}" for g in range(groups.shape[1]) for kind in kinds for axis in XYZ
    ]


def _is_force(part: Array, up: int) -> bool:
    """Return whether vectors (samples, 3) [N] push along the vertical axis `up`, in one sense."""
    size = np.linalg.norm(part, axis=1)
    loaded = size > LOADED
    if loaded.sum() < 3:
        return False
    along = part[loaded, up]
    one_way = max(np.mean(along > 0.0), np.mean(along < 0.0)) > ONE_WAY
    return bool(one_way and np.median(np.abs(along) / size[loaded]) > UPRIGHT)


def _is_point(part: Array, up: int) -> bool:
    """Return whether vectors (samples, 3) [m or mm] are near and at one height."""
    scale = 1e-3 if np.nanmedian(np.linalg.norm(part, axis=1)) > FAR else 1.0
    inside = np.nanmedian(np.linalg.norm(part, axis=1)) * scale < NEAR
    return bool(
        inside
        and np.nanpercentile(part[:, up], 95) - np.nanpercentile(part[:, up], 5) < LEVEL / scale
    )


def _is_moment(part: Array, force: Array, up: int) -> bool:
    """Return whether vectors are moments: changing about the vertical, with a short lever.

    Parameters
    ----------
    part : (samples, 3) [N m or N mm]
    force : (samples,) norm of the force [N]
    up : index of the vertical axis
    """
    scale = 1e-3 if np.nanmedian(np.linalg.norm(part, axis=1) / force) > FAR else 1.0
    lever = np.nanmedian(np.linalg.norm(part, axis=1) / force) * scale
    about = part[np.isfinite(part[:, up]), up]
    return bool(lever < NEAR and len(about) and np.ptp(about) * scale > TURNS)
