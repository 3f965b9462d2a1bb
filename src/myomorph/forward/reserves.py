"""Reserves beside muscles: the table that `tension` writes, as generalized forces."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from myomorph.core.io.sto import read_sto
from myomorph.core.model.arrays import Array
from myomorph.core.model.causes import FORCE_FILES
from myomorph.core.model.errors import BadData, BadFile, UnknownName, quoted
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Actuator, Model
from myomorph.core.model.series import Motion, Series, Table
from myomorph.core.rigid.tree import compile_tree
from myomorph.core.tension.terms.actuators import (
    body_directions,
    compile_body_actuators,
    default_reserves,
)
from myomorph.lab.study.inputs import reading
from myomorph.lab.study.inputs.torques import torque_coordinate


def read_reserves(
    path: Path, model: Model, motion: Motion | None
) -> tuple[Series, tuple[Message, ...]]:
    """Read the forces of reserves, residuals and other actuators as generalized forces.

        tau(t) = sum_r D_r(c(t)) f_r(t)

    with the directions D_r of actuators on bodies in the poses of a motion.

    Parameters
    ----------
    path : table whose columns are named as actuators, as 'myomorph tension' writes it
        (`reserve_knee_angle_r`, `residual_FX`, actuators of the model), or as coordinates
    model : with the coordinates
    motion : in whose poses residuals act on their bodies; None where there is none

    Returns
    -------
    by coordinate (frames, coordinates) [N m or N], and a line on columns that are not used

    Raises
    ------
    BadFile, BadData : the table has gaps, or residuals without a motion
    UnknownName : no column is of an actuator or a coordinate
    """
    if path.suffix.lower() not in reading.TABLE_FILES:
        raise BadFile(
            path,
            f"is no table of reserves: its name ends in '{path.suffix}'",
            "expected .sto or .mot, as 'myomorph tension' writes reserves.sto",
        )
    with reading.about(path):
        table = read_sto(path)
    actuators = {actuator.name: actuator for actuator in default_reserves(model)}
    actuators |= {actuator.name: actuator for actuator in model.actuators}
    forces = np.zeros((len(table.time), len(model.coordinates)))
    on_bodies: list[Actuator] = []
    columns: list[int] = []
    unused: list[str] = []
    for column, name in enumerate(table.names):
        actuator = actuators.get(name)
        if actuator is not None and actuator.kind != "coordinate":
            on_bodies.append(actuator)
            columns.append(column)
            continue
        coordinate = (
            torque_coordinate(name, model, path) if actuator is None else actuator.coordinate
        )
        if coordinate is None:
            unused.append(name)
            continue
        forces[:, model.coordinate_names.index(coordinate)] += table.values[:, column]
    if len(unused) == len(table.names):
        raise UnknownName(
            "actuator", unused[0] if unused else "", existing=tuple(actuators), where="the model"
        )
    if on_bodies:
        forces += _of_bodies(path, model, motion, on_bodies, _taken(table, columns))
    _refuse_gaps(path, table, forces)
    notes: tuple[Message, ...] = ()
    if unused:
        text = f"{path.name}: not used, neither actuators nor coordinates: {quoted(unused, 5)}"
        notes = (FORCE_FILES.message(text),)
    return Series(table.time, model.coordinate_names, forces), notes


def _taken(table: Table, columns: Sequence[int]) -> Series:
    """Take some columns of a table."""
    names = tuple(table.names[column] for column in columns)
    return Series(table.time, names, table.values[:, columns])


def _of_bodies(
    path: Path,
    model: Model,
    motion: Motion | None,
    actuators: Sequence[Actuator],
    forces: Series,
) -> Array:
    """Generalized forces (frames, coordinates) of actuators on bodies [N m or N]."""
    if motion is None:
        raise BadData(
            f"{path}: '{forces.names[0]}' acts on a body, in the poses of the motion that it was"
            " found with: give that motion as --start"
        )
    tree = compile_tree(model)
    values = tree.coordinates_of(motion)
    poses = np.column_stack([np.interp(forces.time, motion.time, column) for column in values.T])
    bodies = compile_body_actuators(tree, actuators)
    directions = np.empty((len(poses), len(bodies.coordinate)))
    body_directions(tree.arrays, bodies, np.ascontiguousarray(poses), directions)
    owner = np.repeat(np.arange(len(actuators)), np.diff(bodies.start))
    generalized = np.zeros_like(poses)
    for entry, coordinate in enumerate(bodies.coordinate):
        generalized[:, coordinate] += directions[:, entry] * forces.values[:, owner[entry]]
    return generalized


def _refuse_gaps(path: Path, table: Table, forces: Array) -> None:
    """Refuse forces (frames, coordinates) that are not finite."""
    if np.isfinite(forces).all():
        return
    frame, column = np.argwhere(~np.isfinite(table.values))[0].tolist()
    raise BadData(
        f"{path}: '{table.names[column]}' has no value at {table.time[frame]:g} s: fill the gap, or"
        " use --time START END"
    )
