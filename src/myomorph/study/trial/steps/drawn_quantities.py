"""Tables that draws of errors are computed of: torques, tensions, and the forces that follow from these."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from myomorph.io.loads import loads_table
from myomorph.model.arrays import Array, read_only
from myomorph.model.frozen_map import FrozenMap
from myomorph.model.series import Series, Table
from myomorph.store.settings import TensionTables
from myomorph.study.trial.steps.drawn_strength import Strength
from myomorph.study.trial.steps.id import Torques, shown_torques, torque_table
from myomorph.study.trial.trial_inputs import TrialInputs
from myomorph.tension.joint_contact import JointPoints
from myomorph.tension.task import TensionTask


@read_only
@dataclass(frozen=True, eq=False)
class Quantity:
    """A table of the chain, values (frames, names) as they were computed without errors; `table` makes of values what
    is written. `units` and `factors`: of each column in tables that people read, and from the values to these.
    """

    name: str
    time: Array
    names: tuple[str, ...]
    values: Array
    table: Callable[[Array], Table]
    unit: str
    units: tuple[str, ...]
    factors: Array


def muscle_quantities(trial: TrialInputs, task: TensionTask, strength: Strength | None) -> list[Quantity]:
    """Tables of tensions and of what follows from them; `TooWeak` where reserves of a draw give more than they may."""
    tension, _ = task.solved(lambda count: None)
    if strength is not None:
        strength.check(tension)
    parts = (("activations", tension.activations, "1"), ("forces", tension.forces, "N"))
    made = [quantity_of(name, tension.time, tension.muscles, values, unit) for name, values, unit in parts]
    tables = []
    if task.setting is not None:
        tables.append(("contact_forces", loads_table(task.loads(tension)[0])))
        tables.append(("contact_groups", task.contact_groups(tension)))
    frame, points = trial.options[TensionTables].reactions, trial.get(JointPoints)
    if frame != "none":
        tables.append(("joint_reactions", task.reactions(tension, frame)))
    if points is not None:
        tables.append(("joint_contact_forces", task.joint_contacts(tension, points).table()))
    return [*made, *(quantity_of(name, table.time, table.names, table.values, "N, N m or m") for name, table in tables)]


def torque_quantity(trial: TrialInputs, torques: Torques) -> Quantity:
    """The table of torques."""
    shown = shown_torques(trial, torques)
    kinds = [trial.model.coordinate(name).motion for name in shown.names]
    units = tuple("N m" if kind == "rotational" else "N" for kind in kinds)

    def table(values: Array) -> Table:
        return torque_table(Series(shown.time, shown.names, values), trial.model)

    given = (shown.time, shown.names, shown.values)
    return Quantity("torques", *given, table, "N m or N", units, np.ones(len(units)))


def quantity_of(name: str, time: Array, names: tuple[str, ...], values: Array, unit: str) -> Quantity:
    """A table whose columns have one unit, written as they are."""

    def table(array: Array) -> Table:
        return Table(time, names, array, facts=FrozenMap({"name": name.replace("_", " ")}))

    count = len(names)
    return Quantity(name, time, names, values, table, unit, (unit,) * count, np.ones(count))
