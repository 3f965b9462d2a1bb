"""Quantities of muscle paths."""

from __future__ import annotations

from myomorph.core.model.quantity import Quantity, Tidy

BY_MUSCLE = ("time", "muscle")

MUSCLE_LENGTH = Quantity(
    name="muscle_length",
    dims=BY_MUSCLE,
    unit="m",
    meaning="length of the muscle-tendon path",
    file="lengths.sto",
    title="Lengths",
    tidy=Tidy(
        statistics=("minimum", "maximum", "range", "mean"),
        endings=("_length",),
        curve="muscle length",
        curve_unit="mm",
    ),
)
MUSCLE_VELOCITY = Quantity(
    name="muscle_velocity",
    dims=BY_MUSCLE,
    unit="m/s",
    meaning="lengthening velocity of the muscle-tendon path",
    file="velocities.sto",
    title="Velocities",
)
MOMENT_ARM = Quantity(
    name="moment_arm",
    dims=("time", "muscle", "coordinate"),
    unit="m",
    meaning="moment arm -d(length)/d(coordinate) of crossing_muscle about crossing_coordinate",
    packed=("time", "crossing"),
    file="moment_arms_{coordinate}.sto",
    title="Moment arms about {coordinate}",
)
CROSSING_MUSCLE = Quantity(
    name="crossing_muscle",
    dims=("crossing",),
    unit="",
    meaning="muscle of a moment arm",
    kind="text",
)
CROSSING_COORDINATE = Quantity(
    name="crossing_coordinate",
    dims=("crossing",),
    unit="",
    meaning="coordinate of a moment arm",
    kind="text",
)

PATHS = (MUSCLE_LENGTH, MUSCLE_VELOCITY, MOMENT_ARM)
QUANTITIES = (*PATHS, CROSSING_MUSCLE, CROSSING_COORDINATE)
