"""What draws of errors are computed of.

They are tables of torques and tensions, drawn strengths, and numbers that are stored.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from myomorph.body.tension.task import TensionTask
from myomorph.core.io.loads import loads_table
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import MyomorphError
from myomorph.core.model.model import Model
from myomorph.core.model.quantity import Quantity
from myomorph.core.model.segments import joint_labels
from myomorph.core.model.series import Motion, Series, Table, Wrenches
from myomorph.core.model.series_quantities import COORDINATE_VALUE
from myomorph.core.model.units import MotionKind
from myomorph.core.rigid.quantities import GENERALIZED_FORCE
from myomorph.core.tension.joint_contact import JointPoints
from myomorph.core.tension.load_quantities import (
    CONTACT_GROUP_FORCE,
    CONTACT_LOAD,
    JOINT_CONTACT_LOAD,
    JOINT_REACTION,
)
from myomorph.core.tension.quantities import (
    ACTIVATION,
    GENERALIZED_FORCE_WITH_CONTACTS,
    MUSCLE_FORCE,
)
from myomorph.core.tension.tension import RESERVE, Tension
from myomorph.lab.analysis.gait_curves import SIDES, VARIABLES, WalkLoads, gait_curves
from myomorph.lab.analysis.strides import Strides
from myomorph.lab.store.quantity_files import motions_of, quantity_table
from myomorph.lab.store.settings import TensionTables
from myomorph.lab.study.step.step import step_giving
from myomorph.lab.study.trial.joint_force import held_from_nowhere, without_frames
from myomorph.lab.study.trial.steps.id import Torques, shown_torques
from myomorph.lab.study.trial.trial_inputs import IN_STRIDE, TrialInputs, statistics_of
from myomorph.lab.study.trial.trial_strides import TrialStrides, by_side
from myomorph.lab.uncertainty.spread import bounds_of


@read_only
class DrawnTable:
    """A quantity of the chain as it was computed without errors.

    Attributes
    ----------
    quantity : what it is
    time : (frames,) [s]
    names : of its columns
    values : (frames, names) in the quantity's unit
    motions : how the coordinate of each column moves, for units and names
    model : whose coordinates these are
    """

    quantity: Quantity
    time: Array
    names: tuple[str, ...]
    values: Array
    motions: tuple[MotionKind, ...]
    model: Model

    @property
    def name(self) -> str:
        """Name of the quantity."""
        return self.quantity.name

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each column in tables that people read."""
        return tuple(map(self.quantity.tidy_unit, self.motions))

    @property
    def factors(self) -> Array:
        """(names,) from the values to these units."""
        return np.array([self.quantity.tidy_factor(motion) for motion in self.motions])

    def table(self, values: Array) -> Table:
        """Return other values of the quantity, as its file has them.

        Parameters
        ----------
        values : (frames, names) in the unit of the quantity

        Returns
        -------
        the table of the file
        """
        series = Series(self.time, self.names, values, quantity=self.quantity)
        return quantity_table(series, self.model)


def drawn_table(
    quantity: Quantity, time: Array, names: Sequence[str], values: Array, model: Model
) -> DrawnTable:
    """Return a quantity with its columns, whose coordinates are those of a model.

    Parameters
    ----------
    quantity : of the table
    time : (frames,) [s]
    names : of the columns
    values : (frames, names) in the unit of the quantity
    model : that the coordinates are of

    Returns
    -------
    the table, with the kind of motion of each column
    """
    return DrawnTable(
        quantity=quantity,
        time=time,
        names=tuple(names),
        values=values,
        motions=motions_of(quantity, names, model),
        model=model,
    )


def unloaded_frames(task: TensionTask, tension: Tension) -> NDArray[np.bool_]:
    """Find frames of a result that have no loads of joints.

    Parameters
    ----------
    task : the problem
    tension : its result

    Returns
    -------
    (frames,)
    """
    if task.setting is None:
        return np.zeros(len(tension.time), bool)
    estimated = task.setting.supports.during(tension.time)
    return held_from_nowhere(tension, task.model, estimated)


def muscle_quantities(
    trial: TrialInputs, task: TensionTask, without_errors: WithoutErrors | None
) -> list[DrawnTable]:
    """Return tables of tensions and of what follows from them.

    Parameters
    ----------
    trial : with its options
    task : problem of the tensions, with the errors of a draw
    without_errors : the result that a draw belongs to, None where this is it

    Raises
    ------
    TooWeak : reserves of a draw give more than they may
    """
    tension, _ = task.solved(lambda count: None)
    if without_errors is None:
        unloaded = unloaded_frames(task, tension)
    else:
        without_errors.strength.check(tension)
        unloaded = np.isin(tension.time, without_errors.unloaded)
    by_muscle = (ACTIVATION, MUSCLE_FORCE)
    made = [
        drawn_table(quantity, tension.time, tension.muscles, quantity.of(tension), trial.model)
        for quantity in by_muscle
    ]
    tables = []
    if task.setting is not None:
        loads, explained = task.loads(tension)
        made.append(series_table(GENERALIZED_FORCE_WITH_CONTACTS, explained, trial.model))
        tables.append((CONTACT_LOAD, loads_table(loads)))
        tables.append((CONTACT_GROUP_FORCE, task.contact_groups(tension)))
    frame = trial.options[TensionTables].reactions
    points = trial.get(JointPoints)
    carried = without_frames(tension, unloaded)
    reactions, contacts = task.joint_loads(carried, frame, points)
    if reactions is not None:
        tables.append((JOINT_REACTION, reactions.table(joint_labels(trial.model))))
    if contacts is not None:
        tables.append((JOINT_CONTACT_LOAD, contacts.table()))
    return [*made, *(series_table(quantity, table, trial.model) for quantity, table in tables)]


def torque_quantity(trial: TrialInputs, torques: Torques) -> DrawnTable:
    """Return the table of torques."""
    return series_table(GENERALIZED_FORCE, shown_torques(trial, torques), trial.model)


def series_table(quantity: Quantity, series: Series, model: Model) -> DrawnTable:
    """Return a series as a table of a quantity."""
    return drawn_table(quantity, series.time, series.names, series.values, model)


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
    """Share of the largest torque of a coordinate that its reserve may give in a draw.

    Attributes
    ----------
    most : by the coordinates' names
    """

    most: dict[str, float]

    @classmethod
    def of(cls, tension: Tension) -> Strength:
        """Return what the result without errors needs, and a tolerance."""
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
                    " at most is allowed"
                )


@read_only
class WithoutErrors:
    """What draws need of the result without errors.

    Attributes
    ----------
    strength : what reserves may give
    unloaded : (frames,) times of those that have no loads of joints [s]
    """

    strength: Strength
    unloaded: Array

    @classmethod
    def of(cls, task: TensionTask) -> WithoutErrors:
        """Solve for the tensions of a task."""
        tension, _ = task.solved(lambda count: None)
        unloaded = tension.time[unloaded_frames(task, tension)]
        return cls(strength=Strength.of(tension), unloaded=unloaded)


def _peaks(tension: Tension) -> tuple[dict[str, float], dict[str, float]]:
    """Largest torque of every coordinate, and what its reserve gives at most."""
    tables = (tension.balanced_torque, tension.actuator_force)
    torques_table, reserves_table = tables
    torques = np.abs(np.nan_to_num(torques_table)).max(axis=0, initial=0.0).tolist()
    reserves = np.abs(np.nan_to_num(reserves_table)).max(axis=0, initial=0.0).tolist()
    named = zip(tension.reserve_names, reserves, strict=True)
    of_coordinates = {
        name.removeprefix(RESERVE): peak for name, peak in named if name.startswith(RESERVE)
    }
    return dict(zip(tension.coordinates, torques, strict=True)), of_coordinates


LOADS = ("total_", "medial_", "lateral_")
"""Begin of the columns of loads at contact points whose numbers are kept."""


@read_only
class DrawnValues:
    """The numbers of tables that are stored of each draw.

    Attributes
    ----------
    names : step and quantity of each
    tables : the table of each
    columns : of tables
    strides : over which means are taken, None without
    """

    names: tuple[tuple[str, str], ...]
    tables: tuple[str, ...]
    columns: tuple[tuple[DrawnTable, tuple[int, ...]], ...]
    strides: TrialStrides | None

    @property
    def bounds(self) -> Array:
        """(2, names) bounds of the numbers, in their units; a range is 0 or more."""
        parts = [np.zeros((2, 0))]
        for quantity, columns in self.columns:
            tidy = quantity.quantity.tidy
            assert tidy is not None
            names = [quantity.names[column] for column in columns]
            own = bounds_of(quantity.quantity, names) * quantity.factors[list(columns)]
            own_range = np.array([np.zeros(len(names)), np.full(len(names), np.inf)])
            whole = [own_range if what == "range" else own for what in tidy.statistics]
            kinds = _statistics(quantity, columns, quantity.values, self.strides)
            parts += whole * sum(1 for _ in kinds)
        return np.concatenate(parts, axis=1)

    def of(self, tables: Mapping[str, Array]) -> Array:
        """Return all numbers of a draw.

        Parameters
        ----------
        tables : (frames, names) by the name of the quantity

        Returns
        -------
        (names,) in the units of tables that people read
        """
        parts = [np.zeros(0)]
        for quantity, columns in self.columns:
            tidy = quantity.quantity.tidy
            assert tidy is not None
            for numbers in _statistics(quantity, columns, tables[quantity.name], self.strides):
                parts += [numbers[what] for what in tidy.statistics]
        return np.concatenate(parts)


def _statistics(
    quantity: DrawnTable, columns: tuple[int, ...], values: Array, strides: TrialStrides | None
) -> Iterator[dict[str, Array]]:
    """Yield statistics of columns of a table (frames, columns) over the whole.

    Means of those of strides follow if there are any.
    """
    factors = quantity.factors[list(columns)]
    names = tuple(quantity.names[column] for column in columns)
    series = Series(quantity.time, names, values[:, columns] * factors)
    yield statistics_of(series.values)
    of_plates = quantity.name == GENERALIZED_FORCE.name
    cycles = None if strides is None else by_side(series, strides, of_plates=of_plates)
    if cycles is not None:
        each = statistics_of(cycles.values, axis=1)
        yield {what: statistics_of(numbers)["mean"] for what, numbers in each.items()}


def drawn_values(quantities: Sequence[DrawnTable], strides: TrialStrides | None) -> DrawnValues:
    """Return which numbers of tables (at the frames that are drawn) are stored.

    They are those that the steps' tables of values have.
    """
    names = list[tuple[str, str]]()
    tables = list[str]()
    kept = []
    for quantity in quantities:
        if quantity.quantity.tidy is None:
            continue
        columns = _kept_columns(quantity)
        wheres = ("", f" {IN_STRIDE}")
        parts = _statistics(quantity, columns, quantity.values, strides)
        own = [
            (step_giving(quantity.name), value)
            for where, _ in zip(wheres, parts, strict=False)
            for value in _value_names(quantity, columns, where)
        ]
        names += own
        tables += [quantity.name] * len(own)
        kept.append((quantity, columns))
    return DrawnValues(
        names=tuple(names), tables=tuple(tables), columns=tuple(kept), strides=strides
    )


def _kept_columns(quantity: DrawnTable) -> tuple[int, ...]:
    """Columns whose numbers the tables of values have."""
    loads = quantity.quantity is JOINT_CONTACT_LOAD
    return tuple(
        column for column, name in enumerate(quantity.names) if not loads or name.startswith(LOADS)
    )


def _value_names(quantity: DrawnTable, columns: Sequence[int], where: str) -> list[str]:
    """Names of the numbers of columns as `values.csv` has them, statistic by statistic."""
    tidy = quantity.quantity.tidy
    assert tidy is not None
    return [
        f"{quantity.names[column]}{tidy.ending(quantity.motions[column])}, {statistic}{where}"
        for statistic in tidy.statistics
        for column in columns
    ]


@read_only
class DrawnGait:
    """What gait curves of a draw are made of, beside its tables of coordinates and torques."""

    model: Model
    time: Array
    names: tuple[str, ...]  # of the coordinates
    torques: DrawnTable | None
    strides: Strides
    wrenches: Wrenches | None

    def means(self, tables: Mapping[str, Array]) -> Mapping[str, Array]:
        """Return the mean gait curves of a draw.

        Parameters
        ----------
        tables : (frames, names) by the name of the quantity

        Returns
        -------
        (samples, variables) by side; {} where the model has no such curves
        """
        torques = None
        if self.torques is not None:
            torques = Series(self.torques.time, self.torques.names, tables[GENERALIZED_FORCE.name])
        motion = Motion(self.time, self.names, tables[COORDINATE_VALUE.name])
        loads = WalkLoads(torques=torques, wrenches=self.wrenches)
        curves = gait_curves(self.model, motion, self.strides, loads)
        return {} if curves is None else {side: curves.mean(side) for side in SIDES}


def widened_gait(errors: Mapping[str, Array], factors: Mapping[str, float]) -> dict[str, Array]:
    """Widen errors of gait curves as much as those of angles and of torques.

    Parameters
    ----------
    errors : (draws, samples, variables) by side
    factors : by the name of the quantity, 1 for one that is missing

    Returns
    -------
    (draws, samples, variables) by side
    """
    kinds = {"angle": factors.get(COORDINATE_VALUE.name, 1.0), "force": 1.0}
    factor = np.array(
        [
            kinds.get(variable.kind, factors.get(GENERALIZED_FORCE.name, 1.0))
            for variable in VARIABLES
        ]
    )
    return {side: factor * values for side, values in errors.items()}
