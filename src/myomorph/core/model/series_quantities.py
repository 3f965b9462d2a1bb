"""Quantities of recordings and motions: coordinates, markers, forces, EMG, events, plates."""

from __future__ import annotations

from myomorph.core.model.quantity import Quantity, Tidy

BY_COORDINATE = ("time", "coordinate")
BY_FORCE = ("time", "external_force", "axis")

COORDINATE_VALUE = Quantity(
    name="coordinate_value",
    dims=BY_COORDINATE,
    unit="rad or m",
    meaning="coordinate",
    attribute="values",
    file="coordinates.mot",
    title="Coordinates",
    file_unit="deg or m",
    label="Joint angles and translations",
    tidy=Tidy(
        statistics=("minimum", "maximum", "range", "mean"),
        unit="deg or m",
        curve="joint angle",
        curve_unit="°",
    ),
    drawn=True,
)
COORDINATE_FILTERED = Quantity(
    name="coordinate_filtered",
    dims=BY_COORDINATE,
    unit="rad or m",
    meaning="coordinate that the forces belong to",
    attribute="values",
)
COORDINATE_VELOCITY = Quantity(
    name="coordinate_velocity",
    dims=BY_COORDINATE,
    unit="rad/s or m/s",
    meaning="coordinate velocity",
    attribute="velocities",
)
COORDINATE_ACCELERATION = Quantity(
    name="coordinate_acceleration",
    dims=BY_COORDINATE,
    unit="rad/s2 or m/s2",
    meaning="coordinate acceleration",
    attribute="accelerations",
)
COORDINATE_UNIT = Quantity(
    name="coordinate_unit",
    dims=("coordinate",),
    unit="",
    meaning="unit of a coordinate, nothing where it is the file's own",
    kind="text",
)
COORDINATE_SD = Quantity(
    name="coordinate_sd",
    dims=BY_COORDINATE,
    unit="rad or m",
    meaning="standard deviation of the error that the low-pass filter leaves in a coordinate",
    attribute="value_sd",
    kind="single",
)
COORDINATE_VELOCITY_SD = Quantity(
    name="coordinate_velocity_sd",
    dims=BY_COORDINATE,
    unit="rad/s or m/s",
    meaning="standard deviation of the error that the low-pass filter leaves in a velocity",
    attribute="velocity_sd",
    kind="single",
)
COORDINATE_ACCELERATION_SD = Quantity(
    name="coordinate_acceleration_sd",
    dims=BY_COORDINATE,
    unit="rad/s2 or m/s2",
    meaning="standard deviation of the error that the low-pass filter leaves in an acceleration",
    attribute="acceleration_sd",
    kind="single",
)
COORDINATE_UNCERTAIN = Quantity(
    name="coordinate_uncertain",
    dims=("time",),
    unit="1",
    meaning="1 at ends and beside long gaps, where accelerations are less certain",
    attribute="uncertain",
    kind="flag",
)
MOTION_ERRORS = (
    COORDINATE_SD,
    COORDINATE_VELOCITY_SD,
    COORDINATE_ACCELERATION_SD,
    COORDINATE_UNCERTAIN,
)
MOTION = (COORDINATE_VALUE, COORDINATE_VELOCITY, COORDINATE_ACCELERATION)
FILTERED_MOTION = (COORDINATE_FILTERED, COORDINATE_VELOCITY, COORDINATE_ACCELERATION)

MARKER_POSITION = Quantity(
    name="recorded_marker_position",
    dims=("time", "recorded_marker", "axis"),
    unit="m",
    meaning="recorded marker in ground",
    attribute="values",
)

EXTERNAL_FORCE_BODY = Quantity(
    name="external_force_body",
    dims=("external_force",),
    unit="",
    meaning="body that an external force acts on",
    attribute="bodies",
    kind="text",
)
EXTERNAL_FORCE_VECTOR = Quantity(
    name="external_force_vector",
    dims=BY_FORCE,
    unit="N",
    meaning="external force in ground",
    attribute="forces",
)
EXTERNAL_FORCE_POINT = Quantity(
    name="external_force_point",
    dims=BY_FORCE,
    unit="m",
    meaning="point of application in ground",
    attribute="points",
)
EXTERNAL_FREE_TORQUE = Quantity(
    name="external_free_torque",
    dims=BY_FORCE,
    unit="N m",
    meaning="free torque about the point, in ground",
    attribute="torques",
)
WRENCHES = (
    EXTERNAL_FORCE_BODY,
    EXTERNAL_FORCE_VECTOR,
    EXTERNAL_FORCE_POINT,
    EXTERNAL_FREE_TORQUE,
)

FORCE_TIME = Quantity(
    name="force_time",
    dims=("force_time",),
    unit="s",
    meaning="clock of the forces as measured",
    attribute="time",
)
MEASURED_VERTICAL_FORCE = Quantity(
    name="measured_vertical_force",
    dims=("force_time", "loaded_body"),
    unit="N",
    meaning="vertical force on a body as measured, without a low-pass filter",
    attribute="values",
    kind="single",
)

EMG_TIME = Quantity(
    name="emg_time", dims=("emg_time",), unit="s", meaning="clock of the EMG", attribute="time"
)
EMG = Quantity(
    name="emg",
    dims=("emg_time", "emg_channel"),
    unit="1",
    meaning="EMG envelope",
    attribute="values",
)

EVENTS = (
    Quantity(
        name="event_time",
        dims=("event",),
        unit="s",
        meaning="time of an event",
        attribute="time",
    ),
    Quantity(
        name="event_label",
        dims=("event",),
        unit="",
        meaning="name of an event",
        attribute="label",
        kind="text",
    ),
    Quantity(
        name="event_side",
        dims=("event",),
        unit="",
        meaning="side of the body of an event",
        attribute="side",
        kind="text",
    ),
)

PLATE_CORNER = Quantity(
    name="plate_corner",
    dims=("plate", "corner", "axis"),
    unit="m",
    meaning="corner of a force plate in ground",
    attribute="corners",
)

QUANTITIES = (
    *MOTION,
    COORDINATE_FILTERED,
    *MOTION_ERRORS,
    COORDINATE_UNIT,
    MARKER_POSITION,
    *WRENCHES,
    FORCE_TIME,
    MEASURED_VERTICAL_FORCE,
    EMG_TIME,
    EMG,
    *EVENTS,
    PLATE_CORNER,
)
