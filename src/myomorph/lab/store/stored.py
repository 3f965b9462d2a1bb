"""Nouns to the variables of a result file, and back: quantities, and what is more than these."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

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
from myomorph.core.motion.ik import KinematicsFit
from myomorph.core.motion.quantities import FIT, SENSOR_ERROR
from myomorph.core.rigid.quantities import GENERALIZED_FORCE
from myomorph.core.tension.emg_conflicts import EmgConflict
from myomorph.core.tension.emg_quantities import CONFLICTS
from myomorph.core.tension.fiber_quantities import (
    ELASTIC_CERTIFICATE_VALUE,
    FIBERS,
    MUSCLE_RIGID_TENDON,
    UNREACHABLE_FRAME,
    UNREACHABLE_LENGTH,
)
from myomorph.core.tension.quantities import (
    ACTUATOR_COORDINATE,
    MUSCLE_OVERSTRETCHED,
    MUSCLE_PASSIVE_SHARE,
    MUSCLE_PASSIVE_TIME,
    MUSCLE_VISCOUS_FORCE,
    TENSION,
)
from myomorph.core.tension.tension import Certificate, Fibers, Unreachable
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

if TYPE_CHECKING:
    from myomorph.core.tension.tension import Tension, TensionOptions

# Fields of `Certificate`.
KINDS_BY_UNIT: Mapping[str, MotionKind] = {
    "rad": "rotational",
    "m": "translational",
}
"""How a coordinate moves, by its unit."""
CERTIFICATE = ("residual", "equilibrium", "steps", "second_activations", "second_forces")


def put_fit(writer: ResultWriter, fit: KinematicsFit, model: Model) -> None:
    """Coordinates found, and how well they explain the markers."""
    put_motion(writer, fit.motion, model)
    put_value(writer, fit, leave_out=(COORDINATE_VALUE,))


def get_fit(stored: Stored) -> KinematicsFit | None:
    """Read what `put_fit` wrote, or None."""
    fields = get_fields(stored, FIT)
    if "converged" not in fields:
        return None
    absent = {
        "marker_error": np.empty((len(stored.time), 0)),
        "marker_weight": np.empty(0),
        "unused_markers": (),
        "missing_markers": (),
    }
    sensor_errors = fields.pop(SENSOR_ERROR.field, None)
    others = {
        "motion": get_motion(stored),
        "marker_names": stored.names.get("marker", ()),
        "task_errors": {} if sensor_errors is None else {"OrientationTask": sensor_errors},
        "sensor_names": stored.names.get("sensor", ()),
    }
    return value_of(KinematicsFit, absent, fields, others)


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


def put_tension(
    writer: ResultWriter, tension: Tension, reserve_coordinates: tuple[str, ...]
) -> None:
    """Muscle tensions, reserves, and whether each frame is an optimum."""
    silent = []
    if not tension.options.has_passive:
        silent += [MUSCLE_PASSIVE_SHARE, MUSCLE_PASSIVE_TIME]
    if not tension.muscle_viscous_force.any():
        silent.append(MUSCLE_VISCOUS_FORCE)
    put_value(writer, tension, leave_out=silent)
    labels = {"actuator": tension.reserve_names}
    put_quantity(writer, ACTUATOR_COORDINATE, reserve_coordinates, labels)
    if tension.fibers is not None:
        _put_certificate(writer, tension.fibers, tension.muscles)


def get_tension(stored: Stored, options: TensionOptions) -> Tension | None:
    """Read what `put_tension` wrote, or None."""
    from myomorph.core.tension.tension import Tension

    fields = get_fields(stored, TENSION)
    names = stored.names
    if "activation" not in fields:
        return None
    strained = fields.pop(MUSCLE_OVERSTRETCHED.field)
    without_actuators = {"actuator_force": np.zeros((len(stored.time), 0))}
    others = {
        "time": stored.time,
        "muscles": names["muscle"],
        "reserve_names": names.get("actuator", ()),
        "coordinates": names["balanced_coordinate"],
        "overstretched": tuple(np.array(names["muscle"])[strained].tolist()),
        "options": replace(options, passive=MUSCLE_PASSIVE_SHARE.field in fields),
        "fibers": get_fibers(stored),
    }
    return value_of(Tension, without_actuators, fields, others)


def put_markers(writer: ResultWriter, markers: Markers) -> None:
    """Markers as they were recorded, in ground."""
    put_value(writer, markers)


def get_markers(stored: Stored) -> Markers | None:
    """Markers of a result, or None."""
    positions = get_quantity(stored, MARKER_POSITION)
    if positions is None:
        return None
    return Markers(stored.time, stored.names["recorded_marker"], positions)


def _put_certificate(writer: ResultWriter, fibers: Fibers, muscles: tuple[str, ...]) -> None:
    """Muscles on rigid tendons, fibers that cannot reach, and how sure the solution is."""
    frames = np.full(len(muscles), -1, np.int32)
    lengths = np.full(len(muscles), np.nan)
    for missed in fibers.unreachable:
        muscle = muscles.index(missed.muscle)
        frames[muscle] = missed.frame
        lengths[muscle] = missed.worst
    rigid = np.array([name in fibers.rigid for name in muscles], bool)
    put_quantity(writer, MUSCLE_RIGID_TENDON, rigid)
    put_quantity(writer, UNREACHABLE_FRAME, frames)
    put_quantity(writer, UNREACHABLE_LENGTH, lengths)
    numbers = np.array([getattr(fibers.certificate, name) for name in CERTIFICATE], np.float64)
    labels = {"elastic_certificate": CERTIFICATE}
    put_quantity(writer, ELASTIC_CERTIFICATE_VALUE, numbers, labels)


def get_fibers(stored: Stored) -> Fibers | None:
    """Fibers and tendons of a result, or None where tendons were rigid."""
    fields = get_fields(stored, FIBERS)
    if "tendon_strain" not in fields:
        return None
    muscles = stored.names["muscle"]
    rigid = get_quantity(stored, MUSCLE_RIGID_TENDON)
    frames = get_quantity(stored, UNREACHABLE_FRAME)
    lengths = get_quantity(stored, UNREACHABLE_LENGTH)
    numbers = get_quantity(stored, ELASTIC_CERTIFICATE_VALUE).tolist()
    certificate = dict(zip(stored.names["elastic_certificate"], numbers, strict=True))
    steps = int(certificate.pop("steps"))
    others = {
        "rigid": tuple(name for name, stiff in zip(muscles, rigid, strict=True) if stiff),
        "unreachable": tuple(
            Unreachable(name, int(frame), float(length))
            for name, frame, length in zip(muscles, frames, lengths, strict=True)
            if frame >= 0
        ),
        "certificate": value_of(Certificate, certificate, {"steps": steps}),
    }
    return value_of(Fibers, fields, others)


def put_conflicts(writer: ResultWriter, conflicts: Sequence[EmgConflict]) -> None:
    """Write conflicts, none of them too.

    An empty table says that EMG took part and nothing contradicts it.
    """
    put_rows(writer, CONFLICTS, conflicts)


def get_conflicts(stored: Stored) -> tuple[EmgConflict, ...] | None:
    """Read what `put_conflicts` wrote, None where EMG took no part."""
    return get_rows(stored, CONFLICTS, EmgConflict)
