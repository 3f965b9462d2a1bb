"""Tables of angles whose unit their head does not state, or states wrongly."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.causes import UNITS
from myomorph.core.model.messages import Message
from myomorph.core.model.model import GROUND, Coordinate, Model
from myomorph.core.model.series import Table

STATED = "inDegrees"  # Key of a head that states the unit.
MAX_SPAN = 4.0 * np.pi  # Of a range that says something about angles [rad].
MAX_BEYOND = np.pi  # By which an angle may leave its range as radians, floating bodies apart [rad].
SLACK = 0.6  # By which angles may leave their ranges as degrees [rad].
MAX_TURN = 3.2  # Radians of a whole recording in which everything moves and nothing turns round.
MIN_TRAVEL = 0.3  # Of a body that walks [m].
MIN_RISE = 0.02  # Of a body that legs raise or lower [m].
ALONG = 0.99  # Cosine of the angle between an axis and the vertical.


@dataclass(frozen=True, kw_only=True)
class AngleUnit:
    """Unit of the angles of a table.

    Attributes
    ----------
    in_degrees : whether they are in degrees
    notes : what was assumed, or looks wrong
    """

    in_degrees: bool
    notes: tuple[Message, ...] = ()


def unit_of_angles(table: Table, model: Model, columns: Mapping[str, int]) -> AngleUnit:
    """Find the unit of the angles of a table, by its head and by the ranges of the coordinates.

    A table of a file whose head states none holds degrees where its values lie far outside of the
    ranges as radians, and inside as degrees. One whose head states the other unit is believed, with
    a note.

    Parameters
    ----------
    table : angles and lengths
    model : with the ranges
    columns : of the table, by coordinate
    """
    angles = [
        coordinate
        for coordinate in model.coordinates
        if coordinate.name in columns and coordinate.motion == "rotational"
    ]
    if not angles or not table.source or not len(table):
        return AngleUnit(in_degrees=table.in_degrees)
    values = table.values[:, [columns[coordinate.name] for coordinate in angles]]
    beyond = _beyond(values, angles)
    worst = int(np.argmax(beyond))
    name = angles[worst].name
    stated = STATED in table.facts
    if table.in_degrees:
        return AngleUnit(in_degrees=True, notes=_radians(table, model, columns, values))
    if beyond[worst] <= MAX_BEYOND:
        return AngleUnit(in_degrees=False)
    fits = bool((_beyond(np.radians(values), angles) <= SLACK).all())
    low, high = angles[worst].range
    size = float(np.nanmax(np.abs(values[:, worst])))
    text = (
        f"'{name}' reaches {size:.4g} where its range is {low:.3g} to {high:.3g} rad: angles were"
    )
    if fits and not stated:
        note = UNITS.message(
            f"the head does not state {STATED}, and {text} taken as degrees",
            place=name,
            severity="changes results",
        )
        return AngleUnit(in_degrees=True, notes=(note,))
    said = f"the head states {STATED}=no, and" if stated else f"the head does not state {STATED}:"
    note = UNITS.message(
        f"{said} {text} taken as radians; are they degrees?", place=name, severity="changes results"
    )
    return AngleUnit(in_degrees=False, notes=(note,))


def _beyond(values: Array, angles: list[Coordinate]) -> Array:
    """How far angles leave their ranges [rad], 0 for ranges that say nothing.

    Parameters
    ----------
    values : (rows, angles) [rad]
    angles : their coordinates

    Returns
    -------
    (angles,)
    """
    low, high = np.array([coordinate.range for coordinate in angles]).T
    largest = np.nanmax(np.maximum(low - values, values - high), axis=0, initial=0.0)
    return np.where(high - low <= MAX_SPAN, largest, 0.0)


def _radians(
    table: Table, model: Model, columns: Mapping[str, int], values: Array
) -> tuple[Message, ...]:
    """Warn of a body that travels or rises while no angle of a head in degrees changes by over 3.

    Legs that turn by 3 degrees carry nobody over 0.3 m, and neither lift nor lower a body by 2 cm.

    Parameters
    ----------
    table, model, columns : as of `unit_of_angles`
    values : (rows, angles) as the table has them
    """
    known = np.isfinite(values).all(axis=1)
    if known.sum() < 2 or np.abs(values[known]).max(initial=0.0) > MAX_TURN:
        return ()
    turn = float(np.ptp(values[known], axis=0).max())
    moved = _way(table, columns, _slides(model))
    risen = _way(table, columns, _slides(model, upwards=True))
    if turn == 0.0 or (moved < MIN_TRAVEL and risen < MIN_RISE):
        return ()
    way = f"travels {moved:.2g} m" if moved >= MIN_TRAVEL else f"rises by {100.0 * risen:.2g} cm"
    return (
        UNITS.message(
            f"the head states {STATED}=yes, but the body {way} while no angle changes by more than"
            f" {turn:.2g}: are they radians?",
            severity="changes results",
        ),
    )


def _slides(model: Model, upwards: bool = False) -> list[str]:
    """Names of the coordinates along which a body moves against the ground, or against gravity."""
    axes = (
        axis
        for joint in model.joints
        if joint.parent == GROUND
        for axis in joint.axes
        if axis.kind == "translation" and (not upwards or abs(axis.vector @ model.up) > ALONG)
    )
    return [name for axis in axes for name in axis.coordinates]


def _way(table: Table, columns: Mapping[str, int], names: Iterable[str]) -> float:
    """Largest way of some coordinates in a table [m], 0 for those that it does not have."""
    paths = (table.values[:, columns[name]] for name in names if name in columns)
    ways = (float(np.nanmax(path) - np.nanmin(path)) for path in paths if np.isfinite(path).any())
    return max(ways, default=0.0)
