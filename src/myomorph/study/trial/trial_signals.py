"""What a result has over time, as columns with names and units that tables of values and curves use."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.model import Model
from myomorph.model.series import Series
from myomorph.store import stored as store
from myomorph.store.results import Stored

EXTREMES = ("minimum", "maximum", "range", "mean")
LOADED = 0.05
"""Of body weight: a foot that never carries more in a cycle did not stand on a plate."""


@dataclass(frozen=True, eq=False)
class Signals:
    """Columns of one kind.

    Attributes
    ----------
    step : that made them
    series : named as the model names coordinates, bodies and muscles, so that sides can be told
    endings : added to each name in tables of values
    units : of each column
    statistics : of each column that tables of values have, some of `EXTREMES`
    curve : what the curves over the cycle are called, with their unit; "" where none are drawn
    factor : from the columns to the curves (names,)
    drawn : columns of the curves
    """

    step: str
    series: Series
    endings: tuple[str, ...]
    units: tuple[str, ...]
    statistics: tuple[str, ...]
    curve: str
    factor: Array
    drawn: tuple[int, ...]


def signals_of(found: Stored, model: Model, mass: float) -> tuple[Signals, ...]:
    """Coordinates, torques, ground forces, muscle lengths, activations and forces, as far as a result has them.

    Parameters
    ----------
    mass : that torques are divided by in curves [kg]
    """
    made = [_coordinates(found, model)] if "coordinate_value" in found.values else []
    torques = store.get_torques(found)
    if torques is not None:
        made.append(_torques(torques, model, mass))
    made += _ground_forces(found, model)
    for step, name, ending, unit, statistics, curve, factor in (
        ("muscles", "muscle_length", "_length", "m", EXTREMES, "muscle length [mm]", 1000.0),
        ("tension", "activation", "_activation", "1", ("maximum", "mean"), "muscle activation", 1.0),
        ("tension", "muscle_force", "_force", "N", ("maximum", "mean"), "muscle force [N]", 1.0),
    ):
        if name in found.values:
            series = Series(found.time, found.names["muscle"], found.values[name])
            made.append(_all_drawn(step, series, ending, unit, statistics, curve, factor))
    return tuple(made)


def _coordinates(found: Stored, model: Model) -> Signals:
    motion = store.get_motion(found)
    kinds = [model.coordinate(name).motion for name in motion.names]
    turning = np.array([kind == "rotational" for kind in kinds])
    series = Series(motion.time, motion.names, motion.values * np.where(turning, 180.0 / np.pi, 1.0))
    units = tuple({"rotational": "deg", "translational": "m"}.get(kind, "1") for kind in kinds)
    drawn = tuple(np.flatnonzero(turning).tolist())
    return Signals("ik", series, ("",) * len(units), units, EXTREMES, "joint angle [°]", np.ones(len(units)), drawn)


def _torques(torques: Series, model: Model, mass: float) -> Signals:
    """Named as inverse dynamics of OpenSim names them: moments about coordinates that turn, else forces."""
    turning = [model.coordinate(name).motion == "rotational" for name in torques.names]
    endings = tuple("_moment" if turns else "_force" for turns in turning)
    units = tuple("N m" if turns else "N" for turns in turning)
    drawn = tuple(np.flatnonzero(turning).tolist())
    per = np.full(len(units), 1.0 / mass if mass > 0.0 else 1.0)
    unit = "N·m/kg" if mass > 0.0 else "N·m"
    return Signals("id", torques, endings, units, EXTREMES, f"joint torque [{unit}]", per, drawn)


def _ground_forces(found: Stored, model: Model) -> list[Signals]:
    wrenches = store.get_wrenches(found)
    if wrenches is None or not len(wrenches.names) or not model.weight > 0.0:
        return []
    bodies = tuple(dict.fromkeys(wrenches.bodies))
    upward = np.nan_to_num(wrenches.forces @ np.asarray(model.up))
    sums = [upward[:, [body == one for one in wrenches.bodies]].sum(axis=1) for body in bodies]
    series = Series(wrenches.time, bodies, np.column_stack(sums))
    made = _all_drawn("id", series, "_vertical_force", "N", ("maximum", "mean"), "vertical force [body weight]", 1.0)
    return [replace(made, factor=made.factor / model.weight)]


def _all_drawn(
    step: str, series: Series, ending: str, unit: str, statistics: tuple[str, ...], curve: str, factor: float
) -> Signals:
    count = len(series.names)
    return Signals(
        step, series, (ending,) * count, (unit,) * count, statistics, curve, np.full(count, factor), tuple(range(count))
    )


def statistics_of(values: Array, axis: int = 0) -> dict[str, Array]:
    """`EXTREMES` of values along an axis, NaN where none is known."""
    known = np.isfinite(values)
    some = known.any(axis=axis)
    low = np.where(some, np.min(np.where(known, values, np.inf), axis=axis), np.nan)
    high = np.where(some, np.max(np.where(known, values, -np.inf), axis=axis), np.nan)
    count = np.maximum(known.sum(axis=axis), 1)
    mean = np.where(some, np.where(known, values, 0.0).sum(axis=axis) / count, np.nan)
    return {"minimum": low, "maximum": high, "range": high - low, "mean": mean}
