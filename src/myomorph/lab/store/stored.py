"""Nouns to the variables of a result file, and back: quantities, and what is more than these."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.labelled import AXES
from myomorph.core.model.model import Model
from myomorph.core.model.quantity import Quantity
from myomorph.core.model.series import Emg, Event, ForcePlate, Markers, Motion, Series, Wrenches
from myomorph.core.model.series_quantities import (
    COORDINATE_FILTERED,
    COORDINATE_UNIT,
    COORDINATE_VALUE,
    EMG,
    EMG_TIME,
    EVENTS,
    FILTERED_MOTION,
    FORCE_TIME,
    MARKER_POSITION,
    MEASURED_VERTICAL_FORCE,
    PLATE_CORNER,
    WRENCHES,
)
from myomorph.core.model.units import MotionKind
from myomorph.core.rigid.quantities import GENERALIZED_FORCE
from myomorph.lab.store.quantities import (
    get_fields,
    get_quantity,
    get_rows,
    put_quantity,
    put_rows,
    put_value,
    value_of,
)
from myomorph.lab.store.results import ResultWriter, Stored, coordinate_units
from myomorph.lab.store.truth_quantities import FORMER_NAMES, KNOWN, true_quantity

KINDS_BY_UNIT: Mapping[str, MotionKind] = {
    "rad": "rotational",
    "m": "translational",
}
"""How a coordinate moves, by its unit."""


def put_motion(writer: ResultWriter, motion: Motion, model: Model) -> None:
    """Coordinates, with their derivatives where known."""
    _put_coordinates(writer, replace(motion, quantity=COORDINATE_VALUE), model)


def put_derivatives(writer: ResultWriter, motion: Motion, model: Model) -> None:
    """Write coordinates as the forces were computed from them, and their derivatives.

    They are filtered where that was asked for.
    """
    _put_coordinates(writer, replace(motion, quantity=COORDINATE_FILTERED), model)


def _put_coordinates(writer: ResultWriter, motion: Motion, model: Model) -> None:
    put_value(writer, motion)
    put_quantity(writer, COORDINATE_UNIT, coordinate_units(model, motion.names))


def get_motion(stored: Stored) -> Motion:
    """Read the coordinates of a result."""
    return Motion(
        time=stored.time,
        names=stored.names["coordinate"],
        values=stored.values[COORDINATE_VALUE.name],
        motion_kinds=stored_motion_kinds(stored),
    )


def stored_motion_kinds(stored: Stored) -> Mapping[str, MotionKind] | None:
    """Return how the coordinates of a result move, by name; None where it does not say."""
    units = stored.names.get(COORDINATE_UNIT.name)
    if units is None:
        return None
    pairs = zip(stored.names["coordinate"], units, strict=True)
    # A coordinate without a unit moves in both ways.
    return FrozenMap({name: KINDS_BY_UNIT.get(unit, "coupled") for name, unit in pairs})


def get_derivatives(stored: Stored) -> Motion | None:
    """Read the coordinates that forces were computed from, with derivatives, or None."""
    fields = get_fields(stored, FILTERED_MOTION)
    if COORDINATE_FILTERED.field not in fields:
        return None
    names = stored.names["coordinate"]
    others = {
        "time": stored.time,
        "names": names,
        "quantity": COORDINATE_FILTERED,
        "motion_kinds": stored_motion_kinds(stored),
    }
    return value_of(Motion, fields, others)


def get_series(stored: Stored, quantity: Quantity) -> Series | None:
    """Read a quantity with one column a name, or None."""
    values = get_quantity(stored, quantity)
    if values is None:
        return None
    return Series(
        time=stored.time,
        names=stored.names[quantity.dims[1]],
        values=values,
        quantity=quantity,
        motion_kinds=stored_motion_kinds(stored),
    )


def put_torques(writer: ResultWriter, torques: Series, wrenches: Wrenches | None) -> None:
    """Generalized forces, and the external forces on the same clock.

    Plates on which nobody steps are left out: there may be no force among those that were measured.
    """
    put_value(writer, replace(torques, quantity=GENERALIZED_FORCE))
    if wrenches is not None:
        put_value(writer, wrenches)


def get_torques(stored: Stored) -> Series | None:
    """Generalized forces of a result, or None."""
    return get_series(stored, GENERALIZED_FORCE)


def get_wrenches(stored: Stored) -> Wrenches | None:
    """External forces of a result, or None."""
    fields = get_fields(stored, WRENCHES)
    if "forces" not in fields:
        return None
    others = {"time": stored.time, "names": stored.names["external_force"]}
    return value_of(Wrenches, fields, others)


def put_measured_force(writer: ResultWriter, measured: Series) -> None:
    """Vertical forces on bodies as measured (samples, bodies) [N], on their own clock."""
    put_quantity(writer, FORCE_TIME, measured.time)
    put_value(writer, replace(measured, quantity=MEASURED_VERTICAL_FORCE))


def get_measured_force(stored: Stored) -> Series | None:
    """Read what `put_measured_force` wrote, or None."""
    fields = get_fields(stored, (FORCE_TIME, MEASURED_VERTICAL_FORCE))
    if MEASURED_VERTICAL_FORCE.field not in fields:
        return None
    others = {"names": stored.names["loaded_body"], "quantity": MEASURED_VERTICAL_FORCE}
    return value_of(Series, fields, others)


def put_emg(writer: ResultWriter, emg: Emg) -> None:
    """EMG envelopes on their own clock."""
    put_quantity(writer, EMG_TIME, emg.time)
    put_value(writer, emg)


def get_emg(stored: Stored) -> Emg | None:
    """EMG envelopes of a result, or None."""
    fields = get_fields(stored, (EMG_TIME, EMG))
    if EMG.field not in fields:
        return None
    return value_of(Emg, fields, {"names": stored.names["emg_channel"]})


def put_truth(writer: ResultWriter, truth: Mapping[str, Series]) -> None:
    """Write the true values of a simulated recording, each on its own clock.

    Parameters
    ----------
    writer : of the result file
    truth : by the names of quantities of `KNOWN`
    """
    known = {quantity.name: quantity for quantity in KNOWN}
    for name, series in truth.items():
        true = true_quantity(known[name])
        put_quantity(writer, true.clock, series.time)
        put_value(writer, replace(series, quantity=true.values))


def get_truth(stored: Stored) -> dict[str, Series]:
    """Read true values by the names of their quantities; older files have other names."""
    truth = {}
    for quantity in KNOWN:
        for name in (quantity.name, FORMER_NAMES[quantity.name]):
            true = true_quantity(quantity, name)
            fields = get_fields(stored, true)
            if true.values.field in fields:
                others = {
                    "names": stored.names[true.values.dims[1]],
                    "quantity": true.values,
                }
                truth[quantity.name] = value_of(Series, fields, others)
    return truth


def put_plates(writer: ResultWriter, plates: Sequence[ForcePlate]) -> None:
    """Outlines of force plates."""
    if plates:
        corners = np.array([plate.corners for plate in plates])
        labels = {"plate": [plate.name for plate in plates], "axis": AXES}
        put_quantity(writer, PLATE_CORNER, corners, labels)


def get_plates(stored: Stored) -> tuple[ForcePlate, ...]:
    """Outlines of force plates, without forces."""
    none = np.zeros((0, 3))
    corners = stored.values.get(PLATE_CORNER.name, ())
    return tuple(
        ForcePlate(name=name, kind=2, corners=place, forces=none, points=none, torques=none)
        for name, place in zip(stored.names.get("plate", ()), corners, strict=True)
    )


def put_events(writer: ResultWriter, events: tuple[Event, ...]) -> None:
    """Events of the recording."""
    if events:
        put_rows(writer, EVENTS, events)


def get_events(stored: Stored) -> tuple[Event, ...]:
    """Events of a result."""
    return get_rows(stored, EVENTS, Event) or ()


def put_markers(writer: ResultWriter, markers: Markers) -> None:
    """Markers as they were recorded, in ground."""
    put_value(writer, markers)


def get_markers(stored: Stored) -> Markers | None:
    """Markers of a result, or None."""
    positions = get_quantity(stored, MARKER_POSITION)
    if positions is None:
        return None
    return Markers(stored.time, stored.names["recorded_marker"], positions)
