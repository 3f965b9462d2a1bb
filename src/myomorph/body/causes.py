"""Causes of the messages that estimates of a body make."""

from __future__ import annotations

from myomorph.core.model.messages import Cause

CALIBRATION = Cause(
    key="calibration",
    title="Lengths and markers that recordings hardly show",
    severity="may change results",
    effect="Segment lengths, marker positions and zero angles follow the prior.",
    remedy="Add a static trial, markers, or motions that rotate the joints named.",
    quantities=("coordinate_value", "marker_error"),
)
SIDES = Cause(
    key="sides",
    title="Sides of the body that differ",
    severity="may change results",
    effect="Lengths and markers of both sides were found separately.",
    remedy=(
        "Check whether the person is asymmetric, or markers of one side are placed asymmetrically."
    ),
    quantities=("coordinate_value",),
)
SEARCH = Cause(
    key="search",
    title="Searches that did not converge",
    severity="may change results",
    effect="Further iterations may improve the estimate.",
    remedy="Allow more iterations.",
)
MASSES = Cause(
    key="masses",
    title="Implausible masses of segments",
    severity="may change results",
    effect="Torques of segments that move fast follow their masses.",
    remedy="Record longer and more varied motions, with nothing but plates to touch.",
    quantities=("generalized_force",),
)
HELD_OUT = Cause(
    key="held_out",
    title="Estimates that predict no better than the generic model",
    severity="may change results",
    effect="What was estimated may fit the recording and not the person.",
    remedy="Record longer and more varied motions.",
)
SKIN = Cause(
    key="skin",
    title="Shape of the body",
    severity="may change results",
    effect="Masses and mass centers of segments follow the skin.",
    remedy="Look at the skin, its unit and its pose, and at the measurements.",
    quantities=("generalized_force",),
)
COUNTERPARTS = Cause(
    key="counterparts",
    title="Parts that only one of two models has",
    severity="may change results",
    effect="What is missing in one model stays as it was in the other.",
    remedy="Look at the parts named.",
)
PERSONAL_MUSCLES = Cause(
    key="personal_muscles",
    title="Muscles that recordings hardly determine",
    severity="may change results",
    effect="Their strengths and lengths follow the prior.",
    remedy="Record EMG, and motions that use the muscles through their range.",
    quantities=("muscle_force", "activation"),
)
SENSOR_READING = Cause(
    key="sensor_reading",
    title="Sensors that fit only on another body or with another convention",
    severity="changes results",
    size="residuals {size} times the noise",
    effect="Angles of the segments named are of other sensors, or of none.",
    remedy="Correct labels and format, or leave the sensor out (--imu-bodies SENSOR=-).",
    quantities=("coordinate_value", "sensor_error"),
)
