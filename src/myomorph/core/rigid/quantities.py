"""Quantities of rigid-body dynamics."""

from __future__ import annotations

from myomorph.core.model.quantity import Quantity, Tidy

GENERALIZED_FORCE = Quantity(
    name="generalized_force",
    dims=("time", "coordinate"),
    unit="N m or N",
    meaning="generalized force of inverse dynamics",
    attribute="values",
    file="torques.sto",
    title="Inverse Dynamics Generalized Forces",
    endings=("_moment", "_force"),
    label="Joint torques",
    tidy=Tidy(
        statistics=("minimum", "maximum", "range", "mean"),
        endings=("_moment", "_force"),
        curve="joint torque",
        curve_unit="N·m",
    ),
    drawn=True,
)

QUANTITIES = (GENERALIZED_FORCE,)
