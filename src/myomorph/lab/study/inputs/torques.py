"""Joint torques of a table, as inverse dynamics writes it.

They take the place of external forces and inverse dynamics.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np

from myomorph.core.io.sto import read_sto
from myomorph.core.model.causes import FORCE_FILES
from myomorph.core.model.errors import BadData, BadFile, UnknownName
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Model
from myomorph.core.model.series import Series
from myomorph.lab.store.results import file_source
from myomorph.lab.store.settings import TensionTables
from myomorph.lab.study.inputs import reading
from myomorph.lab.study.inputs.contact_points import ContactPointsFile
from myomorph.lab.study.inputs.contacts import ContactsFile
from myomorph.lab.study.inputs.input import Input, Opened, Opening
from myomorph.lab.study.inputs.keys import File
from myomorph.lab.study.inputs.loads import LoadsFile


@dataclass(frozen=True)
class TorquesFile:
    """Joint torques from elsewhere.

    Attributes
    ----------
    torques : Joint torques (.sto, .mot) instead of loads and inverse dynamics; columns are named as
        coordinates, or with _moment and _force as in OpenSim's inverse dynamics [N m, N].
    """

    torques: Annotated[Path | None, File(per="trial")] = None


@dataclass(frozen=True, eq=False)
class RecordedTorques:
    """Generalized forces of a file (frames, coordinates) [N m or N]."""

    torques: Series


MOMENT = "_moment"
FORCE = "_force"


def read_torques(path: Path, model: Model) -> tuple[Series, tuple[Message, ...]]:
    """Read generalized forces of a table, and report columns that are not used.

    Columns are named as coordinates, or as OpenSim's inverse dynamics names them:
    `knee_angle_r_moment` of one that rotates, `pelvis_tx_force` of one that translates (or does
    both). A free coordinate must have one, without gaps. The result is (frames, coordinates) [N m
    or N], with a line on the columns that are not used.
    """
    if path.suffix.lower() not in reading.TABLE_FILES:
        raise BadFile(
            path,
            f"is no table of torques: its name ends in '{path.suffix}'",
            "expected .sto or .mot",
        )
    with reading.about(path):
        table = read_sto(path)
    columns: dict[str, int] = {}
    unused: list[str] = []
    for index, column in enumerate(table.names):
        name = torque_coordinate(column, model, path)
        if name is None:
            unused.append(column)
        elif name in columns:
            raise BadData(
                f"{path}: coordinate '{name}' has two columns, '{table.names[columns[name]]}' and"
                f" '{column}'"
            )
        else:
            columns[name] = index
    # Numba, which other steps do without
    from myomorph.core.tension.terms.actuators import balanced_coordinates

    for name in balanced_coordinates(model):
        if name not in columns:
            raise UnknownName(
                "coordinate", name, existing=table.names, where=f"{path}: the table of torques"
            )
    values = table.values[:, list(columns.values())]
    if not np.isfinite(values).all():
        frame, column = np.argwhere(~np.isfinite(values))[0].tolist()
        raise BadData(
            f"{path}: the torque of '{list(columns)[column]}' has no finite value at"
            f" {table.time[frame]:g} s; fill the gap, or use --time START END"
        )
    notes = (
        (
            FORCE_FILES.message(
                f"{path.name}: not used, no coordinates of the model: {', '.join(unused)}"
            ),
        )
        if unused
        else ()
    )
    return Series(table.time, tuple(columns), values), notes


def torque_coordinate(column: str, model: Model, path: Path) -> str | None:
    """Find the coordinate that a column of a table of torques is of.

    Parameters
    ----------
    column : its name
    model : with the coordinates
    path : of the table, for messages

    Returns
    -------
    name of the coordinate, None where the column is of none

    Raises
    ------
    BadData : the ending of the column is that of the other kind of coordinate
    """
    if column in model.coordinate_names:
        return column
    for ending, wrong in ((MOMENT, "translational"), (FORCE, "rotational")):
        name = column.removesuffix(ending)
        if name != column and name in model.coordinate_names:
            kind = model.coordinate(name).motion
            if kind == wrong:
                right = FORCE if ending == MOMENT else MOMENT
                raise BadData(
                    f"{path}: column '{column}': coordinate '{name}' is {kind}; expected"
                    f" '{name}{right}', or '{name}'"
                )
            return name
    return None


def _open(settings: TorquesFile, opening: Opening) -> Opened:
    """Torques of a trial. Raises `BadData` if inputs are present that they exclude."""
    path = settings.torques
    others = opening.settings
    if path is None:
        return Opened()
    reactions = opening.options[TensionTables].reactions != "none"
    excluded = {
        "loads: the torques already contain the external forces; give one of them": (
            others.or_default(LoadsFile).loads
        ),
        "contacts: contact forces are estimated with inverse dynamics, so leave the torques out": (
            others.or_default(ContactsFile).estimated
        ),
        (
            "joint reactions or contact points: joint loads need the external forces, so give loads"
            " instead"
        ): (reactions or others.or_default(ContactPointsFile).contact_points),
    }
    for what, value in excluded.items():
        if value:
            raise BadData(f"{path.name}: torques are given together with {what}")
    torques, unused = read_torques(path, opening.model)
    return Opened(
        values=(RecordedTorques(torques),),
        sources=(file_source("torques", path),),
        warnings=unused,
        real=f"joint torques from {path.name}",
    )


INPUT = Input(name="torques", settings=TorquesFile, open=_open, main="torques")
