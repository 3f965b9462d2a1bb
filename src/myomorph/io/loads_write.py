"""Wrenches on bodies as OpenSim's external loads: a table of forces, and the XML file that says where they act."""

from __future__ import annotations

import os
from pathlib import Path
from types import MappingProxyType

import numpy as np
from lxml import etree

from myomorph.io.parsing.text import written
from myomorph.io.sto import write_sto
from myomorph.model.arrays import Array
from myomorph.model.errors import BadData
from myomorph.model.model import GROUND
from myomorph.model.series import Table, Wrenches

PARTS = ("force_v", "force_p", "torque_")


def loads_table(wrenches: Wrenches, name: str = "Contact forces") -> Table:
    """Forces, points and torques in ground as OpenSim's external loads name them.

    Columns of a load NAME are NAME_force_vx, vy, vz [N], NAME_force_px, py, pz [m] and NAME_torque_x, y, z
    [N m]: the force on the body. An unknown point of a load without force becomes 0.

    Raises
    ------
    BadData
        where a load has no body, or two have one name
    """
    for load, body in zip(wrenches.names, wrenches.bodies, strict=True):
        if not body:
            raise BadData(f"load '{load}' acts on no body: assign it first")
    if len(set(wrenches.names)) != len(wrenches.names):
        raise BadData(f"two loads have one name among {', '.join(wrenches.names)}")
    columns, blocks = [], []
    idle = (wrenches.forces == 0.0).all(axis=2, keepdims=True)
    points: Array = np.where(idle & np.isnan(wrenches.points), 0.0, wrenches.points)
    for k, load in enumerate(wrenches.names):
        for part, values in zip(PARTS, (wrenches.forces, points, wrenches.torques), strict=True):
            columns += [f"{load}_{part}{axis}" for axis in "xyz"]
            blocks.append(values[:, k])
    values = np.hstack([*blocks, np.zeros((len(wrenches), 0))])
    return Table(wrenches.time, tuple(columns), values, facts=MappingProxyType({"name": name}))


def write_external_loads(
    wrenches: Wrenches, table: str | os.PathLike[str], loads: str | os.PathLike[str], name: str = "Contact forces"
) -> None:
    """Write a table of loads (.sto or .mot) and the external loads file (.xml) that names it, both in ground.

    OpenSim and `io.loads.read_external_loads` take them back; the XML finds the table beside itself.
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
    etree.indent(document, space="\t")
    text = etree.tostring(document, encoding="unicode")
    with written(loads) as stream:
        stream.write(f'<?xml version="1.0" encoding="UTF-8" ?>\n{text}\n')
