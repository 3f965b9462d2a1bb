"""Tables of angles whose unit their head does not state, or states wrongly."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.causes import UNITS
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Coordinate, Model
from myomorph.core.model.series import Table

STATED = "inDegrees"  # Key of a head that states the unit.
MAX_SPAN = 4.0 * np.pi  # Of a range that says something about angles [rad].
MAX_BEYOND = np.pi  # By which an angle may leave its range as radians, floating bodies apart [rad].
SLACK = 0.6  # By which angles may leave their ranges as degrees [rad].
MAX_TURN = 3.2  # Radians of a whole recording in which everything moves and nothing turns round.
MIN_TRAVEL = 0.3  # Of a body that walks [m].


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
            gravity="changes results",
        )
        return AngleUnit(in_degrees=True, notes=(note,))
    said = f"the head states {STATED}=no, and" if stated else f"the head does not state {STATED}:"
    note = UNITS.message(
        f"{said} {text} taken as radians; are they degrees?", place=name, gravity="changes results"
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
    """Warn of a body that travels while no angle of a head in degrees moves by more than 3."""
    lengths = [
        columns[coordinate.name]
        for coordinate in model.coordinates
        if coordinate.name in columns and coordinate.motion == "translational"
    ]
    if not lengths or np.nanmax(np.abs(values), initial=0.0) > MAX_TURN:
        return ()
    travel = float(np.nanmax(np.ptp(table.values[:, lengths], axis=0)))
    turn = float(np.nanmax(np.ptp(values, axis=0)))
    if travel < MIN_TRAVEL or turn == 0.0:
        return ()
    return (
        UNITS.message(
            f"the head states {STATED}=yes, but the body travels {travel:.2g} m while no angle"
            f" changes by more than {turn:.2g}: are they radians?",
            gravity="changes results",
        ),
    )
