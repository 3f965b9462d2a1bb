"""What draws of errors are computed of: tables of torques and tensions, drawn strengths, numbers
that are kept.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from myomorph.body.tension.task import TensionTask
from myomorph.core.io.loads import loads_table
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import MyomorphError
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion, Series, Table, Wrenches
from myomorph.core.tension.joint_contact import JointPoints
from myomorph.core.tension.tension import RESERVE, Tension
from myomorph.lab.analysis.gait_curves import SIDES, VARIABLES, gait_curves
from myomorph.lab.analysis.strides import Strides
from myomorph.lab.store.settings import TensionTables
from myomorph.lab.study.trial.joint_contact_step import ENDING as JOINT_CONTACT
from myomorph.lab.study.trial.steps.id import Torques, shown_torques, torque_table
from myomorph.lab.study.trial.trial_inputs import EXTREMES, IN_STRIDE, TrialInputs, statistics_of
from myomorph.lab.study.trial.trial_strides import TrialStrides, by_side


@read_only
class Quantity:
    """A table of the chain, values (frames, names) as they were computed without errors; `table`
    makes of values what is written. `units` and `factors`: of each column in tables that people
    read, and from the values to these.
    """

    name: str
    time: Array
    names: tuple[str, ...]
    values: Array
    table: Callable[[Array], Table]
    unit: str
    units: tuple[str, ...]
    factors: Array


def muscle_quantities(
    trial: TrialInputs, task: TensionTask, strength: Strength | None
) -> list[Quantity]:
    """Tables of tensions and of what follows from them; `TooWeak` where reserves of a draw give
    more than they may.
    """
    tension, _ = task.solved(lambda count: None)
    if strength is not None:
        strength.check(tension)
    parts = (("activations", tension.activations, "1"), ("forces", tension.forces, "N"))
    made = [
        quantity_of(name, tension.time, tension.muscles, values, unit)
        for name, values, unit in parts
    ]
    tables = []
    if task.setting is not None:
        loads, carried = task.loads(tension)
        made.append(_generalized_forces("torques_with_contacts", carried, trial.model))
        tables.append(("contact_forces", loads_table(loads)))
        tables.append(("contact_groups", task.contact_groups(tension)))
    frame = trial.options[TensionTables].reactions
    points = trial.get(JointPoints)
    if frame != "none":
        tables.append(("joint_reactions", task.reactions(tension, frame)))
    if points is not None:
        tables.append(("joint_contact_forces", task.joint_contacts(tension, points).table()))
    return [
        *made,
        *(
            quantity_of(name, table.time, table.names, table.values, "N, N m or m")
            for name, table in tables
        ),
    ]


def torque_quantity(trial: TrialInputs, torques: Torques) -> Quantity:
    """The table of torques."""
    return _generalized_forces("torques", shown_torques(trial, torques), trial.model)


def _generalized_forces(name: str, shown: Series, model: Model) -> Quantity:
    kinds = [model.coordinate(name).motion for name in shown.names]
    units = tuple("N m" if kind == "rotational" else "N" for kind in kinds)

    def table(values: Array) -> Table:
        return torque_table(Series(shown.time, shown.names, values), model)

    shown_columns = (shown.time, shown.names, shown.values)
    return Quantity(name, *shown_columns, table, "N m or N", units, np.ones(len(units)))


def quantity_of(
    name: str, time: Array, names: tuple[str, ...], values: Array, unit: str
) -> Quantity:
    """A table whose columns have one unit, written as they are."""

    def table(array: Array) -> Table:
        return Table(time, names, array, facts=FrozenMap({"name": name.replace("_", " ")}))

    count = len(names)
    return Quantity(
        name=name,
        time=time,
        names=names,
        values=values,
        table=table,
        unit=unit,
        units=(unit,) * count,
        factors=np.ones(count),
    )


LARGE = 0.3
"""Share of the largest torque from which a coordinate's muscles are judged: those of toes are weak
in every model.
"""
# Share of a coordinate's largest torque that its reserve may give beyond its share in the result.
BEYOND = 0.2


class TooWeak(MyomorphError):
    """A drawn body whose muscles cannot do what was recorded."""


@dataclass(frozen=True)
class Strength:
    """What share of the largest torque of coordinates reserves may give in a draw, by the
    coordinates' names.
    """

    most: dict[str, float]

    @classmethod
    def of(cls, tension: Tension) -> Strength:
        """What the result without errors needs, and a tolerance."""
        peaks, reserves = _peaks(tension)
        largest = max(peaks.values(), default=0.0)
        judged = [name for name in reserves if peaks.get(name, 0.0) > LARGE * largest]
        return cls({name: reserves[name] / peaks[name] + BEYOND for name in judged})

    def check(self, tension: Tension) -> None:
        """Raise `TooWeak` where reserves of a draw give more."""
        peaks, reserves = _peaks(tension)
        for name, most in self.most.items():
            if reserves[name] > most * peaks[name]:
                share = 100.0 * reserves[name] / max(peaks[name], 1e-300)
                raise TooWeak(
                    f"the reserve of {name} gives {share:.0f} % of its torque, {100.0 * most:.0f} %"
                    " at most can be"
                )


def _peaks(tension: Tension) -> tuple[dict[str, float], dict[str, float]]:
    """Largest torque of every coordinate, and what its reserve gives at most."""
    tables = (tension.torques, tension.reserves)
    torques, reserves = (
        np.abs(np.nan_to_num(table)).max(axis=0, initial=0.0).tolist() for table in tables
    )
    named = zip(tension.reserve_names, reserves, strict=True)
    of_coordinates = {
        name.removeprefix(RESERVE): peak for name, peak in named if name.startswith(RESERVE)
    }
    return dict(zip(tension.coordinates, torques, strict=True)), of_coordinates


PEAKS = ("maximum", "mean")
LOADS = ("total_", "medial_", "lateral_")
KEPT: dict[str, tuple[str, tuple[str, ...], dict[str, str]]] = {
    "coordinates": ("ik", EXTREMES, {}),
    "torques": ("id", EXTREMES, {"N m": "_moment", "N": "_force"}),
    "activations": ("tension", PEAKS, {"1": "_activation"}),
    "forces": ("tension", PEAKS, {"N": "_force"}),
    "joint_contact_forces": ("tension", PEAKS, {"N, N m or m": JOINT_CONTACT}),
}
"""Tables whose numbers are kept as the step's signals have them: step, statistics, ends of names by
unit.
"""


@read_only
class DrawnValues:
    """Which numbers of tables are kept of each draw: step and quantity, and the table of each;
    `columns` of tables.
    """

    names: tuple[tuple[str, str], ...]
    tables: tuple[str, ...]
    columns: tuple[tuple[Quantity, tuple[int, ...]], ...]
    strides: TrialStrides | None

    def of(self, tables: Mapping[str, Array]) -> Array:
        """All numbers of a draw (names,)."""
        parts = [np.zeros(0)]
        for quantity, columns in self.columns:
            statistics = KEPT[quantity.name][1]
            for numbers in _statistics(quantity, columns, tables[quantity.name], self.strides):
                parts += [numbers[what] for what in statistics]
        return np.concatenate(parts)


def _statistics(
    quantity: Quantity, columns: tuple[int, ...], values: Array, strides: TrialStrides | None
) -> Iterator[dict[str, Array]]:
    """Statistics of columns of a table (frames, columns) over the whole, and means of those of
    strides if there are.
    """
    factors = quantity.factors[list(columns)]
    names = tuple(quantity.names[column] for column in columns)
    series = Series(quantity.time, names, values[:, columns] * factors)
    yield statistics_of(series.values)
    cycles = None if strides is None else by_side(series, strides)
    if cycles is not None:
        each = statistics_of(cycles.values, axis=1)
        yield {what: statistics_of(numbers)["mean"] for what, numbers in each.items()}


def drawn_values(quantities: Sequence[Quantity], strides: TrialStrides | None) -> DrawnValues:
    """Which numbers of tables (at the frames that are drawn) are kept: those that the steps' tables
    of values have.
    """
    names = list[tuple[str, str]]()
    tables = list[str]()
    kept = []
    for quantity in (quantity for quantity in quantities if quantity.name in KEPT):
        step, statistics, endings = KEPT[quantity.name]
        every = enumerate(quantity.names)
        loads = quantity.name == "joint_contact_forces"
        columns = tuple(column for column, name in every if not loads or name.startswith(LOADS))
        count = len(names)
        wheres = ("", f" {IN_STRIDE}")
        for where, _ in zip(
            wheres, _statistics(quantity, columns, quantity.values, strides), strict=False
        ):
            for what in statistics:
                ends = (
                    (quantity.names[column], endings.get(quantity.units[column], ""))
                    for column in columns
                )
                names += [(step, f"{name}{ending}, {what}{where}") for name, ending in ends]
        tables += [quantity.name] * (len(names) - count)
        kept.append((quantity, columns))
    return DrawnValues(
        names=tuple(names), tables=tuple(tables), columns=tuple(kept), strides=strides
    )


@read_only
class DrawnGait:
    """What gait curves of a draw are made of, beside its tables of coordinates and torques."""

    model: Model
    time: Array
    names: tuple[str, ...]  # of the coordinates
    torques: Quantity | None
    strides: Strides
    wrenches: Wrenches | None

    def means(self, tables: Mapping[str, Array]) -> Mapping[str, Array]:
        """By side, (samples, variables); {} where the model has no such curves."""
        torques = None
        if self.torques is not None:
            torques = Series(self.torques.time, self.torques.names, tables["torques"])
        motion = Motion(self.time, self.names, tables["coordinates"])
        curves = gait_curves(self.model, motion, self.strides, torques, self.wrenches)
        return {} if curves is None else {side: curves.mean(side) for side in SIDES}


def widened_gait(errors: Mapping[str, Array], factors: Mapping[str, float]) -> dict[str, Array]:
    """Errors of gait curves (draws, samples, variables) by side, as much wider as those of angles
    and of torques.
    """
    kinds = {"angle": factors.get("coordinates", 1.0), "force": 1.0}
    factor = np.array(
        [kinds.get(variable.kind, factors.get("torques", 1.0)) for variable in VARIABLES]
    )
    return {side: factor * values for side, values in errors.items()}
