"""External loads (OpenSim's ExternalLoads XML and its table) as wrenches in ground."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from lxml import etree

from myomorph.core.io.osim.document import Node, read_document, write_document
from myomorph.core.io.osim.joints import plain_name
from myomorph.core.io.parsing.named_file import is_named_file
from myomorph.core.io.sto import read_sto, write_sto
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData, BadFile, BadModel, UnknownName
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.model import GROUND
from myomorph.core.model.series import Table, Wrenches

UNASSIGNED = ("", "Unassigned", "NULL")
PosesOf = Callable[[str, Array], tuple[Array, Array]]

PARTS = ("force_v", "force_p", "torque_")


@dataclass(frozen=True)
class LoadEntry:
    """One force of an external loads file, before its numbers are read.

    Attributes
    ----------
    name : of the load
    body : the body it acts on
    force_body, point_body : bodies in whose frames its force (with its torque) and its point are
        expressed
    force, point, torque : what the names of the three columns begin with, "" where there are none
    data : path of the table that holds the columns
    """

    name: str
    body: str
    force_body: str
    point_body: str
    force: str
    point: str
    torque: str
    data: Path


def read_load_entries(
    path: str | os.PathLike[str], motion_file: str | os.PathLike[str] | None = None
) -> tuple[LoadEntry, ...]:
    """Read which forces an external loads file names, without those it switches off.

    Parameters
    ----------
    path : of the XML file
    motion_file : table to use instead of the one the file names

    Returns
    -------
    one entry per force that is applied, in the file's order

    Raises
    ------
    BadFile : it is no such file, its table does not exist, or a force names no body, neither a
        force nor a torque, or a point without a force
    """
    loads = read_document(path, ("ExternalLoads",), "external loads (ExternalLoads)")
    shared = loads.text("", "datafile")
    entries = []
    for node in loads.items("objects"):
        if not node.is_applied:
            continue
        data_source = node.text("", "data_source_name")
        if shared not in UNASSIGNED:
            source = shared
        elif data_source in UNASSIGNED:
            source = ""
        else:
            source = data_source
        data = Path(motion_file) if motion_file is not None else _data_file(loads, source)
        entries.append(
            _old_entry(node, data) if node.kind == "PrescribedForce" else _entry(node, data)
        )
    return tuple(entries)


def _data_file(loads: Node, name: str) -> Path:
    """Find the table that a loads file names, by its path or beside the file.

    Raises
    ------
    BadFile : it names none, or the table is in neither place
    """
    folder = loads.document.path.parent
    if not name:
        raise loads.bad("names no data file", "put the force table beside it")
    path = folder / name.replace("\\", "/")
    beside = folder / path.name
    for choice in (path, beside):
        if is_named_file(choice):
            return choice
    raise loads.bad(f"its data file '{name}' does not exist", "put the force table beside it")


def _entry(node: Node, data: Path) -> LoadEntry:
    """Read an `ExternalForce`; `BadFile` where it has no body, or neither a force nor a torque."""
    force = "" if (text := node.text("", "force_identifier")) in UNASSIGNED else text
    point = "" if (text := node.text("", "point_identifier")) in UNASSIGNED else text
    torque = "" if (text := node.text("", "torque_identifier")) in UNASSIGNED else text
    body = plain_name(node.text("", "applied_to_body"))
    if not body:
        raise node.bad("names no body in applied_to_body")
    if not force and not torque:
        raise node.bad("identifies neither a force nor a torque")
    if point and not force:
        raise node.bad("identifies a point but no force")
    return LoadEntry(
        name=node.name or body,
        body=body,
        force_body=plain_name(node.text("", "force_expressed_in_body") or GROUND),
        point_body=plain_name(node.text("", "point_expressed_in_body") or GROUND),
        force=force,
        point=point,
        torque=torque,
        data=data,
    )


def _old_entry(node: Node, data: Path) -> LoadEntry:
    """Read a `PrescribedForce`, in which the name of a function gives each column.

    So it was before version 2.3.1: the last letter of a name is the axis, "#3" is the third column
    of the table.
    """
    columns: list[str] = []
    for what in ("forceFunctions", "pointFunctions", "torqueFunctions"):
        names = [
            element.get("name", "")
            for element in node.element.findall(f"FunctionSet[@name='{what}']/objects/*")
        ]
        first = names[0] if names else ""
        if first.startswith("#"):
            first = read_sto(data).names[int(first[1:]) - 1]
        columns.append(first[:-1])
    body = plain_name(node.socket("frame", "body_name", "body"))
    if not body or not (columns[0] or columns[2]):
        raise node.bad("names no body, or neither a force nor a torque")
    force, point, torque = columns
    return LoadEntry(
        name=node.name or body,
        body=body,
        force_body=GROUND,
        point_body=GROUND,
        force=force,
        point=point,
        torque=torque,
        data=data,
    )


def read_external_loads(
    path: str | os.PathLike[str],
    motion_file: str | os.PathLike[str] | None = None,
    poses: PosesOf | None = None,
) -> Wrenches:
    """Read the wrenches of an external loads file, over the times of its table.

    Parameters
    ----------
    path : of the XML file
    motion_file : table to use instead of the one the file names
    poses : gives rotations (frames, 3, 3) and origins (frames, 3) [m] in ground of a body at times
        (frames,) [s]; needed only where a force or point is given in a moving body's frame, or a
        force has no point

    Returns
    -------
    forces [N], points [m] and torques [N m] (frames, loads, 3) in ground

    Raises
    ------
    BadFile : it is no such file, applies no force, or takes its forces from several tables
    BadModel : a load needs the motion of a body, and there are no `poses`
    UnknownName : the table lacks columns that the file names
    """
    entries = read_load_entries(path, motion_file)
    tables = {data: read_sto(data) for data in dict.fromkeys(entry.data for entry in entries)}
    if not tables:
        raise BadFile(path, "applies no force")
    if len(tables) > 1:
        raise BadFile(
            path, f"takes its forces from {len(tables)} tables", "put them into one table"
        )
    (table,) = tables.values()
    shape = (len(table), len(entries), 3)
    forces = np.zeros(shape)
    points = np.zeros(shape)
    torques = np.zeros(shape)
    for i, entry in enumerate(entries):
        if entry.force:
            forces[:, i] = _in_ground(
                _columns(table, entry.force, entry), entry.force_body, poses, table.time, entry
            )
            points[:, i] = _point(table, entry, poses)
        if entry.torque:
            torques[:, i] = _in_ground(
                _columns(table, entry.torque, entry), entry.force_body, poses, table.time, entry
            )
    names = tuple(entry.name for entry in entries)
    return Wrenches(
        time=table.time,
        names=names,
        bodies=tuple(entry.body for entry in entries),
        forces=forces,
        points=points,
        torques=torques,
    )


def _columns(table: Table, identifier: str, entry: LoadEntry) -> Array:
    """Read the columns of an identifier: its name and x, y, z, or the only three that begin so.

    Parameters
    ----------
    table : of forces
    identifier : what the names of the columns begin with
    entry : of the loads file, for messages

    Returns
    -------
    (rows, 3)

    Raises
    ------
    UnknownName : other than three columns begin so
    """
    exact = [f"{identifier}{axis}" for axis in "xyz"]
    columns = (
        exact
        if set(exact) <= set(table.names)
        else [name for name in table.names if name.startswith(identifier)]
    )
    if len(columns) != 3:
        where = (
            f"{entry.data} (where force '{entry.name}' needs three columns that begin so, and"
            f" {len(columns)} do)"
        )
        raise UnknownName("column", f"{identifier}x", existing=table.names, where=where)
    return np.column_stack([table[name] for name in columns])


def _in_ground(
    vectors: Array, body: str, poses: PosesOf | None, time: Array, entry: LoadEntry
) -> Array:
    """Rotate vectors (frames, 3) from the frame of a body to ground."""
    if body == GROUND:
        return vectors
    rotations, _ = _poses(body, poses, time, entry)
    return np.einsum("fij,fj->fi", rotations, vectors)


def _point(table: Table, entry: LoadEntry, poses: PosesOf | None) -> Array:
    """Return points of application in ground, the body's origin where none are identified.

    Parameters
    ----------
    table : of forces
    entry : which columns, in the frame of which body
    poses : as in `read_external_loads`

    Returns
    -------
    (frames, 3) [m]

    Raises
    ------
    BadModel : the motion of a body is needed, and there are no `poses`
    UnknownName : the table lacks the columns
    """
    if not entry.point:
        return _poses(entry.body, poses, table.time, entry)[1]
    columns = _columns(table, entry.point, entry)
    if entry.point_body == GROUND:
        return columns
    rotations, origins = _poses(entry.point_body, poses, table.time, entry)
    return np.einsum("fij,fj->fi", rotations, columns) + origins


def _poses(body: str, poses: PosesOf | None, time: Array, entry: LoadEntry) -> tuple[Array, Array]:
    """Return rotations (frames, 3, 3) and origins (frames, 3) [m] of a body in ground.

    Raises
    ------
    BadModel : the body is not the ground, and there are no `poses`
    """
    if body == GROUND:
        return np.broadcast_to(np.eye(3), (len(time), 3, 3)), np.zeros((len(time), 3))
    if poses is None:
        raise BadModel(
            f"external force '{entry.name}' is given in the frame (or at the origin) of body"
            f" '{body}': its place in ground needs the motion of that body"
        )
    return poses(body, time)


def loads_table(wrenches: Wrenches, name: str = "Contact forces") -> Table:
    """Lay out forces, points and torques in ground as OpenSim's external loads name them.

    Columns of a load NAME are NAME_force_vx, vy, vz [N], NAME_force_px, py, pz [m] and
    NAME_torque_x, y, z [N m]: the force on the body. An unknown point of a load without force
    becomes 0.

    Parameters
    ----------
    wrenches : (frames, loads, 3) in ground, each on a body
    name : title of the table

    Returns
    -------
    (frames, 9 loads)

    Raises
    ------
    BadData : a load acts on no body, or two have one name
    """
    for load, body in zip(wrenches.names, wrenches.bodies, strict=True):
        if not body:
            raise BadData(f"load '{load}' acts on no body: assign it first")
    if len(set(wrenches.names)) != len(wrenches.names):
        raise BadData(f"two loads have one name among {', '.join(wrenches.names)}")
    columns = []
    blocks = []
    idle = (wrenches.forces == 0.0).all(axis=2, keepdims=True)
    points: Array = np.where(idle & np.isnan(wrenches.points), 0.0, wrenches.points)
    for index, load in enumerate(wrenches.names):
        for part, values in zip(PARTS, (wrenches.forces, points, wrenches.torques), strict=True):
            columns += [f"{load}_{part}{axis}" for axis in "xyz"]
            blocks.append(values[:, index])
    values = np.hstack([*blocks, np.zeros((len(wrenches), 0))])
    return Table(wrenches.time, tuple(columns), values, facts=FrozenMap({"name": name}))


def write_external_loads(
    wrenches: Wrenches,
    table: str | os.PathLike[str],
    loads: str | os.PathLike[str],
    name: str = "Contact forces",
) -> None:
    """Write a table of loads and the external loads file that names it, both in ground.

    OpenSim and `read_external_loads` take them back; the XML finds the table beside itself.

    Parameters
    ----------
    wrenches : (frames, loads, 3) in ground, each on a body
    table : path of the new table (.sto or .mot)
    loads : path of the new external loads file (.xml)
    name : of the loads

    Raises
    ------
    BadData : a load acts on no body, or two have one name
    BadFile : a file cannot be written
    """
    write_sto(loads_table(wrenches, name), table)
    document = etree.Element("OpenSimDocument", Version="40000")
    group = etree.SubElement(document, "ExternalLoads", name=name.replace(" ", "_"))
    objects = etree.SubElement(group, "objects")
    for load, body in zip(wrenches.names, wrenches.bodies, strict=True):
        force = etree.SubElement(objects, "ExternalForce", name=load)
        for tag, text in (
            ("applied_to_body", body),
            ("force_expressed_in_body", GROUND),
            ("point_expressed_in_body", GROUND),
            ("force_identifier", f"{load}_force_v"),
            ("point_identifier", f"{load}_force_p"),
            ("torque_identifier", f"{load}_torque_"),
        ):
            etree.SubElement(force, tag).text = text
    etree.SubElement(group, "datafile").text = Path(table).name
    write_document(document, loads)
