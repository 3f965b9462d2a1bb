"""Quantities of draws: errors of gait curves and of the numbers of a trial."""

from __future__ import annotations

from myomorph.core.model.quantity import BOUNDS, Quantity

VALUE = ("drawn_value",)
SIDES = ("right", "left")

GAIT_ERRORS = tuple(
    Quantity(
        name=f"gait_error_{side}",
        dims=("draw", "gait_sample", "gait_variable"),
        unit="°, N·m/kg, W/kg or body weight",
        meaning="error of a mean curve of gait under a draw, widened",
        kind="single",
    )
    for side in SIDES
)
VALUE_ERROR = Quantity(
    name="value_error",
    dims=("draw", *VALUE),
    unit="of values.csv",
    meaning="error of a value under a draw, widened",
    kind="single",
)
VALUE_BOUNDS = tuple(
    Quantity(
        name=f"value_{bound}",
        dims=VALUE,
        unit="of values.csv",
        meaning=f"{meaning}, less the value",
    )
    for bound, meaning in BOUNDS.items()
)

QUANTITIES = (*GAIT_ERRORS, VALUE_ERROR, *VALUE_BOUNDS)
