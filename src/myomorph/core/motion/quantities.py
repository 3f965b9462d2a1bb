"""Quantities of inverse kinematics."""

from __future__ import annotations

from myomorph.core.model.quantity import Quantity
from myomorph.core.model.series_quantities import COORDINATE_VALUE

# What a fit holds in the motion that it found.
FITTED_COORDINATE = COORDINATE_VALUE.replaced(attribute="motion.values")
MARKER_ERROR = Quantity(
    name="marker_error",
    dims=("time", "marker"),
    unit="m",
    meaning="distance between model and recorded marker",
    file="marker_errors.sto",
)
MARKER_WEIGHT = Quantity(
    name="marker_weight",
    dims=("marker",),
    unit="1",
    meaning="weight in inverse kinematics",
)
IK_CONVERGED = Quantity(
    name="ik_converged",
    dims=("time",),
    unit="1",
    meaning="1 where the last step was within the tolerance",
    attribute="converged",
    kind="flag",
)
IK_ITERATIONS = Quantity(
    name="ik_iterations",
    dims=("time",),
    unit="1",
    meaning="iterations taken",
    attribute="iterations",
    kind="count",
)
LOOP_CLOSURE_ERROR = Quantity(
    name="loop_closure_error",
    dims=("time",),
    unit="m or rad",
    meaning="largest loop-closure error",
)
SENSOR_ERROR = Quantity(
    name="sensor_error",
    dims=("time", "sensor"),
    unit="rad",
    meaning="angle between body and sensor",
    file="sensor_errors.sto",
    file_unit="deg",
)
ASSUMED_SD = Quantity(
    name="assumed_sd",
    dims=("time", "coordinate"),
    unit="rad or m",
    meaning="standard deviation about what is assumed of a coordinate that no marker shows, else 0",
)
ASSUMED_AS = Quantity(
    name="assumed_as",
    dims=("coordinate",),
    unit="",
    meaning="what is assumed of a coordinate that no marker shows, else empty",
    kind="text",
)
UNUSED_MARKER = Quantity(
    name="unused_marker",
    dims=("unused_marker",),
    unit="",
    meaning="recorded marker missing in the model, or without weight",
    attribute="unused_markers",
    kind="text",
)
MISSING_MARKER = Quantity(
    name="missing_marker",
    dims=("missing_marker",),
    unit="",
    meaning="marker of the model missing in the recording",
    attribute="missing_markers",
    kind="text",
)

FIT = (
    MARKER_ERROR,
    MARKER_WEIGHT,
    IK_CONVERGED,
    IK_ITERATIONS,
    LOOP_CLOSURE_ERROR,
    SENSOR_ERROR,
    ASSUMED_SD,
    ASSUMED_AS,
    UNUSED_MARKER,
    MISSING_MARKER,
)
QUANTITIES = FIT
