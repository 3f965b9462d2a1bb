"""Nouns to the variables of a result file, and back."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from myomorph.core.model.model import Model
from myomorph.core.model.series import Emg, Event, ForcePlate, Markers, Motion, Series, Wrenches
from myomorph.core.motion.ik import KinematicsFit
from myomorph.core.tension.emg_conflicts import EmgConflict
from myomorph.core.tension.tension import Certificate, Fibers, Unreachable
from myomorph.lab.store.results import ResultWriter, Stored, coordinate_units

if TYPE_CHECKING:
    from myomorph.core.tension.tension import Tension, TensionOptions

XYZ = ("x", "y", "z")
FIBER_MEANINGS = {
    "fiber_length": "length of the muscle's fibers",
    "fiber_velocity": "lengthening velocity of the fibers",
    "tendon_strain": "tendon length over slack length, less 1",
    "fiber_power": "power of the fibers, positive where they do work",
    "tendon_power": "power of the tendon, positive where it gives work back",
    "transient": "1 near an end, where what lies beyond it can be felt",
    "bridged": "1 where torques or coordinates were interpolated",
}
"""Of the variables of fibers and tendons over time."""

# Fields of `Certificate`.
CERTIFICATE = ("residual", "equilibrium", "steps", "second_activations", "second_forces")

CONFLICT = "emg_conflict"
CONFLICT_NUMBERS = {
    "start": ("s", "begin of a stretch in which EMG and torques contradict each other"),
    "stop": ("s", "its end"),
    "worst": ("s", "when they are farthest apart"),
    "emg": ("1", "activation by EMG then, or torque wanted where a reserve bears it"),
    "found": ("1", "activation of the solution then, or torque of the reserve"),
}


def put_fit(writer: ResultWriter, fit: KinematicsFit, model: Model) -> None:
    """Coordinates found, and how well they explain the markers."""
    put_motion(writer, fit.motion, model)
    writer.names("marker", fit.marker_names)
    if fit.marker_names:
        writer.put(
            "marker_error",
            ("time", "marker"),
            fit.errors,
            "m",
            "distance between model and recorded marker",
        )
        writer.put("marker_weight", ("marker",), fit.weights, "1", "weight in inverse kinematics")
    writer.put(
        "ik_converged",
        ("time",),
        fit.converged,
        "1",
        "1 where the last step was within the tolerance",
    )
    writer.put(
        "ik_iterations", ("time",), np.asarray(fit.iterations, np.int32), "1", "iterations taken"
    )
    if fit.closure is not None:
        writer.put(
            "loop_closure_error", ("time",), fit.closure, "m or rad", "largest loop-closure error"
        )
    if fit.sensor_names:
        writer.names("sensor", fit.sensor_names)
        writer.put(
            "sensor_error",
            ("time", "sensor"),
            fit.sensor_errors,
            "rad",
            "angle between body and sensor",
        )
    writer.names("unused_marker", fit.unused_markers)
    writer.names("missing_marker", fit.missing_markers)


def get_fit(stored: Stored) -> KinematicsFit | None:
    """What `put_fit` wrote, or None."""
    if "ik_converged" not in stored.values:
        return None
    return KinematicsFit(
        motion=get_motion(stored),
        marker_names=stored.names.get("marker", ()),
        errors=stored.values.get("marker_error", np.empty((len(stored.time), 0))),
        weights=stored.values.get("marker_weight", np.empty(0)),
        converged=stored.values["ik_converged"] != 0,
        iterations=stored.values["ik_iterations"].astype(np.int64),
        unused_markers=stored.names.get("unused_marker", ()),
        missing_markers=stored.names.get("missing_marker", ()),
        closure=stored.values.get("loop_closure_error"),
        task_errors={"OrientationTask": stored.values["sensor_error"]}
        if "sensor_error" in stored.values
        else {},
        sensor_names=stored.names.get("sensor", ()),
    )


def put_motion(writer: ResultWriter, motion: Motion, model: Model) -> None:
    """Coordinates, with their derivatives where known."""
    _put_coordinates(writer, motion, model, "coordinate_value", "coordinate")


def put_derivatives(writer: ResultWriter, motion: Motion, model: Model) -> None:
    """Coordinates as the forces were computed from them (filtered where asked for), and their
    derivatives.
    """
    _put_coordinates(
        writer, motion, model, "coordinate_filtered", "coordinate that the forces belong to"
    )


def _put_coordinates(
    writer: ResultWriter, motion: Motion, model: Model, name: str, meaning: str
) -> None:
    writer.time(motion.time)
    writer.names("coordinate", motion.names)
    writer.texts("coordinate_unit", "coordinate", coordinate_units(model, motion.names))
    two = ("time", "coordinate")
    writer.put(name, two, motion.values, "rad or m", meaning)
    if motion.velocities is not None:
        writer.put(
            "coordinate_velocity", two, motion.velocities, "rad/s or m/s", "coordinate velocity"
        )
    if motion.accelerations is not None:
        writer.put(
            "coordinate_acceleration",
            two,
            motion.accelerations,
            "rad/s2 or m/s2",
            "coordinate acceleration",
        )


def get_motion(stored: Stored) -> Motion:
    """The coordinates of a result."""
    return Motion(stored.time, stored.names["coordinate"], stored.values["coordinate_value"])


def get_derivatives(stored: Stored) -> Motion | None:
    """The coordinates that forces were computed from, with derivatives, or None."""
    values = stored.values
    if "coordinate_filtered" not in values:
        return None
    names = stored.names["coordinate"]
    rates = (values.get("coordinate_velocity"), values.get("coordinate_acceleration"))
    return Motion(stored.time, names, values["coordinate_filtered"], *rates)


def put_torques(writer: ResultWriter, torques: Series, wrenches: Wrenches | None) -> None:
    """Generalized forces, and the external forces on the same clock."""
    meaning = "generalized force of inverse dynamics"
    writer.names("coordinate", torques.names)
    writer.put("generalized_force", ("time", "coordinate"), torques.values, "N m or N", meaning)
    # Plates on which nobody steps are left out: there may be no force among those that were
    # measured.
    if wrenches is not None and wrenches.names:
        writer.names("external_force", wrenches.names)
        writer.names("axis", XYZ)
        writer.texts("external_force_body", "external_force", wrenches.bodies)
        three = ("time", "external_force", "axis")
        writer.put("external_force_vector", three, wrenches.forces, "N", "external force in ground")
        writer.put(
            "external_force_point", three, wrenches.points, "m", "point of application in ground"
        )
        writer.put(
            "external_free_torque",
            three,
            wrenches.torques,
            "N m",
            "free torque about the point, in ground",
        )


def get_torques(stored: Stored) -> Series | None:
    """Generalized forces of a result, or None."""
    forces = stored.values.get("generalized_force")
    return (
        None
        if forces is None
        else Series(stored.time, stored.names["coordinate"], forces, unit="N m or N")
    )


def get_wrenches(stored: Stored) -> Wrenches | None:
    """External forces of a result, or None."""
    if "external_force_vector" not in stored.values:
        return None
    return Wrenches(
        time=stored.time,
        names=stored.names["external_force"],
        bodies=stored.names["external_force_body"],
        forces=stored.values["external_force_vector"],
        points=stored.values["external_force_point"],
        torques=stored.values["external_free_torque"],
    )


def put_emg(writer: ResultWriter, emg: Emg) -> None:
    """EMG envelopes on their own clock."""
    writer.names("emg_channel", emg.names)
    writer.sizes("emg_time", len(emg))
    writer.put("emg_time", ("emg_time",), emg.time, "s", "clock of the EMG")
    writer.put("emg", ("emg_time", "emg_channel"), emg.values, "1", "EMG envelope")


def get_emg(stored: Stored) -> Emg | None:
    """EMG envelopes of a result, or None."""
    if "emg" not in stored.values:
        return None
    return Emg(stored.values["emg_time"], stored.names["emg_channel"], stored.values["emg"])


def put_truth(writer: ResultWriter, truth: Mapping[str, Series]) -> None:
    """What is known of a simulated recording, each on its own clock."""
    for kind, series in truth.items():
        writer.sizes(f"true_{kind}_time", len(series))
        writer.names(f"true_{kind}_name", series.names)
        writer.put(
            f"true_{kind}_time",
            (f"true_{kind}_time",),
            series.time,
            "s",
            f"clock of the true {kind}",
        )
        two = (f"true_{kind}_time", f"true_{kind}_name")
        writer.put(
            f"true_{kind}", two, series.values, "SI", f"true {kind} of the simulated recording"
        )


def get_truth(stored: Stored) -> dict[str, Series]:
    """What `put_truth` wrote."""
    kinds = [
        name[len("true_") : -len("_time")]
        for name in stored.values
        if re.fullmatch(r"true_\w+_time", name)
    ]
    return {
        kind: Series(
            stored.values[f"true_{kind}_time"],
            stored.names[f"true_{kind}_name"],
            stored.values[f"true_{kind}"],
        )
        for kind in kinds
    }


def put_plates(writer: ResultWriter, plates: Sequence[ForcePlate]) -> None:
    """Outlines of force plates."""
    if not plates:
        return
    writer.names("plate", [plate.name for plate in plates])
    writer.names("axis", XYZ)
    writer.sizes("corner", 4)
    corners = np.array([plate.corners for plate in plates])
    writer.put(
        "plate_corner",
        ("plate", "corner", "axis"),
        corners,
        "m",
        "corner of a force plate in ground",
    )


def get_plates(stored: Stored) -> tuple[ForcePlate, ...]:
    """Outlines of force plates, without forces."""
    none = np.zeros((0, 3))
    corners = stored.values.get("plate_corner", ())
    return tuple(
        ForcePlate(name=name, kind=2, corners=place, forces=none, points=none, torques=none)
        for name, place in zip(stored.names.get("plate", ()), corners, strict=True)
    )


def put_events(writer: ResultWriter, events: tuple[Event, ...]) -> None:
    """Events of the recording."""
    if not events:
        return
    writer.sizes("event", len(events))
    writer.put(
        "event_time",
        ("event",),
        np.array([event.time for event in events]),
        "s",
        "when it happened",
    )
    writer.texts("event_label", "event", [event.label for event in events])
    writer.texts("event_side", "event", [event.side for event in events])


def get_events(stored: Stored) -> tuple[Event, ...]:
    """Events of a result."""
    if "event_time" not in stored.values:
        return ()
    parts = zip(
        stored.values["event_time"],
        stored.names["event_label"],
        stored.names["event_side"],
        strict=True,
    )
    return tuple(Event(float(time), label, side) for time, label, side in parts)


def put_tension(
    writer: ResultWriter, tension: Tension, reserve_coordinates: tuple[str, ...]
) -> None:
    """Muscle tensions, reserves, and whether each frame is an optimum."""
    writer.time(tension.time)
    writer.names("muscle", tension.muscles)
    writer.names("actuator", tension.reserve_names)
    writer.names("balanced_coordinate", tension.coordinates)
    strained = [name in tension.overstretched for name in tension.muscles]
    writer.put(
        "muscle_overstretched",
        ("muscle",),
        np.array(strained, bool),
        "1",
        "1 where passive force passes F0",
    )
    writer.texts("actuator_coordinate", "actuator", reserve_coordinates)
    by_muscle = ("time", "muscle")
    writer.put("activation", by_muscle, tension.activations, "1", "muscle activation")
    writer.put("muscle_force", by_muscle, tension.forces, "N", "muscle force along the tendon")
    if tension.options.passive:
        share = "largest passive force over F0"
        writer.put("muscle_passive_share", ("muscle",), np.array(tension.passive_share), "1", share)
        writer.put(
            "muscle_passive_time", ("muscle",), np.array(tension.passive_time), "s", "when that was"
        )
    if tension.viscous.any():
        writer.put(
            "muscle_viscous_force",
            by_muscle,
            tension.viscous,
            "N",
            "part of muscle_force that is viscous",
        )
    if tension.reserve_names:
        meaning = "force or torque of reserve, residual and other actuators"
        writer.put("actuator_force", ("time", "actuator"), tension.reserves, "N m or N", meaning)
    two = ("time", "balanced_coordinate")
    writer.put(
        "balanced_torque",
        two,
        tension.torques,
        "N m or N",
        "what muscles and actuators had to balance",
    )
    writer.put(
        "equilibrium_residual",
        ("time",),
        tension.equilibrium_residual,
        "N m or N",
        "largest torque left unbalanced",
    )
    writer.put(
        "tension_status",
        ("time",),
        np.asarray(tension.status, np.int8),
        "1",
        "0 where the frame is optimal",
    )
    writer.put(
        "tension_iterations",
        ("time",),
        np.asarray(tension.iterations, np.int32),
        "1",
        "iterations taken",
    )
    writer.put("activation_lower", ("muscle",), tension.lower, "1", "lower bound of the activation")
    writer.put("activation_upper", ("muscle",), tension.upper, "1", "upper bound of the activation")
    if tension.fibers is not None:
        put_fibers(writer, tension.fibers, tension.muscles)


def get_tension(stored: Stored, options: TensionOptions) -> Tension | None:
    """What `put_tension` wrote, or None."""
    from myomorph.core.tension.tension import Tension

    values = stored.values
    names = stored.names
    if "activation" not in values:
        return None
    return Tension(
        time=stored.time,
        muscles=names["muscle"],
        activations=values["activation"],
        forces=values["muscle_force"],
        reserve_names=names.get("actuator", ()),
        reserves=values.get("actuator_force", np.zeros((len(stored.time), 0))),
        coordinates=names["balanced_coordinate"],
        torques=values["balanced_torque"],
        equilibrium_residual=values["equilibrium_residual"],
        status=values["tension_status"],
        iterations=values["tension_iterations"],
        lower=values["activation_lower"],
        upper=values["activation_upper"],
        overstretched=tuple(
            np.array(names["muscle"])[values["muscle_overstretched"] != 0].tolist()
        ),
        options=replace(options, passive="muscle_passive_share" in values),
        viscous=values.get("muscle_viscous_force", np.zeros((1, 1))),
        passive_share=values.get("muscle_passive_share", np.zeros(1)),
        passive_time=values.get("muscle_passive_time", np.zeros(1)),
        fibers=get_fibers(stored),
    )


def put_markers(writer: ResultWriter, markers: Markers) -> None:
    """Markers as they were recorded, in ground."""
    writer.time(markers.time)
    writer.names("recorded_marker", markers.names)
    writer.names("axis", XYZ)
    three = ("time", "recorded_marker", "axis")
    writer.put("recorded_marker_position", three, markers.values, "m", "recorded marker in ground")


def get_markers(stored: Stored) -> Markers | None:
    """Markers of a result, or None."""
    positions = stored.values.get("recorded_marker_position")
    return (
        None
        if positions is None
        else Markers(stored.time, stored.names["recorded_marker"], positions)
    )


def put_fibers(writer: ResultWriter, fibers: Fibers, muscles: tuple[str, ...]) -> None:
    """Fibers and tendons; time and muscles are there already."""
    for name, variable in fibers.variables().items():
        writer.put(
            name, variable.dimensions, variable.values, variable.unit or "1", FIBER_MEANINGS[name]
        )
    rigid = np.array([name in fibers.rigid for name in muscles], bool)
    writer.put(
        "muscle_rigid_tendon", ("muscle",), rigid, "1", "1 where the tendon was taken as rigid"
    )
    frames = np.full(len(muscles), -1, np.int32)
    worst = np.full(len(muscles), np.nan)
    for missed in fibers.unreachable:
        place = muscles.index(missed.muscle)
        frames[place] = missed.frame
        worst[place] = missed.worst
    writer.put(
        "unreachable_frame",
        ("muscle",),
        frames,
        "1",
        "first frame that the fibers cannot reach, -1 for none",
    )
    writer.put(
        "unreachable_length",
        ("muscle",),
        worst,
        "1",
        "normalized fiber length furthest out of reach",
    )
    writer.names("elastic_certificate", CERTIFICATE)
    values = np.array([getattr(fibers.certificate, name) for name in CERTIFICATE], np.float64)
    writer.put(
        "elastic_certificate_value",
        ("elastic_certificate",),
        values,
        "1",
        "how sure the elastic solution is",
    )


def get_fibers(stored: Stored) -> Fibers | None:
    """What `put_fibers` wrote, or None."""
    values = stored.values
    names = stored.names
    if "tendon_strain" not in values:
        return None
    muscles = names["muscle"]
    frames = values["unreachable_frame"]
    worst = values["unreachable_length"]
    certificate = dict(
        zip(names["elastic_certificate"], values["elastic_certificate_value"].tolist(), strict=True)
    )
    steps = int(certificate.pop("steps"))
    return Fibers(
        lengths=values["fiber_length"],
        velocities=values["fiber_velocity"],
        tendon_strains=values["tendon_strain"],
        fiber_powers=values["fiber_power"],
        tendon_powers=values["tendon_power"],
        transient=values["transient"] != 0,
        bridged=values["bridged"] != 0,
        rigid=tuple(
            name
            for name, value in zip(muscles, values["muscle_rigid_tendon"], strict=True)
            if value
        ),
        unreachable=tuple(
            Unreachable(name, int(frame), float(length))
            for name, frame, length in zip(muscles, frames, worst, strict=True)
            if frame >= 0
        ),
        certificate=Certificate(**certificate, steps=steps),
    )


def put_conflicts(writer: ResultWriter, conflicts: Sequence[EmgConflict]) -> None:
    """Write conflicts, none of them too: an empty table says that EMG took part and nothing
    contradicts it.
    """
    writer.sizes(CONFLICT, len(conflicts))
    for name in ("muscle", "coordinate"):
        writer.texts(
            f"{CONFLICT}_{name}", CONFLICT, [getattr(conflict, name) for conflict in conflicts]
        )
    for name, (unit, meaning) in CONFLICT_NUMBERS.items():
        values = np.array([getattr(conflict, name) for conflict in conflicts], dtype=np.float64)
        writer.put(f"{CONFLICT}_{name}", (CONFLICT,), values, unit, meaning)


def get_conflicts(stored: Stored) -> tuple[EmgConflict, ...] | None:
    """What `put_conflicts` wrote, None where EMG took no part."""
    if f"{CONFLICT}_start" not in stored.values:
        return None
    numbers = zip(
        *(stored.values[f"{CONFLICT}_{name}"].tolist() for name in CONFLICT_NUMBERS), strict=True
    )
    muscles = stored.names[f"{CONFLICT}_muscle"]
    coordinates = stored.names[f"{CONFLICT}_coordinate"]
    return tuple(
        EmgConflict(muscle, coordinate, *values)
        for muscle, coordinate, values in zip(muscles, coordinates, numbers, strict=True)
    )
