"""Quantities of the conflicts of EMG and torques."""

from __future__ import annotations

from myomorph.core.model.quantity import Quantity

CONFLICT = ("emg_conflict",)
TABLE = "emg_conflicts.csv"

CONFLICTS = (
    Quantity(
        name="emg_conflict_muscle",
        dims=CONFLICT,
        unit="",
        meaning="muscle with EMG, nothing where a reserve bears what is left",
        attribute="muscle",
        kind="text",
        file=TABLE,
    ),
    Quantity(
        name="emg_conflict_coordinate",
        dims=CONFLICT,
        unit="",
        meaning="coordinate of the reserve",
        attribute="coordinate",
        kind="text",
        file=TABLE,
    ),
    Quantity(
        name="emg_conflict_start",
        dims=CONFLICT,
        unit="s",
        meaning="begin of a stretch in which EMG and torques contradict each other",
        attribute="start",
        file=TABLE,
    ),
    Quantity(
        name="emg_conflict_stop",
        dims=CONFLICT,
        unit="s",
        meaning="its end",
        attribute="stop",
        file=TABLE,
    ),
    Quantity(
        name="emg_conflict_worst",
        dims=CONFLICT,
        unit="s",
        meaning="when they are farthest apart",
        attribute="worst",
        file=TABLE,
    ),
    Quantity(
        name="emg_conflict_emg",
        dims=CONFLICT,
        unit="1",
        meaning="activation by EMG then, or torque wanted where a reserve bears it",
        attribute="emg",
        file=TABLE,
    ),
    Quantity(
        name="emg_conflict_found",
        dims=CONFLICT,
        unit="1",
        meaning="activation of the solution then, or torque of the reserve",
        attribute="found",
        file=TABLE,
    ),
)

QUANTITIES = CONFLICTS
