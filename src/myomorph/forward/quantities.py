"""Quantities of a simulation."""

from __future__ import annotations

from myomorph.core.model.quantity import Quantity

ENERGY = Quantity(
    name="energy",
    dims=("time", "energy_part"),
    unit="J",
    meaning="energy of the body, work done on it since the start, and their residual",
    file="energy.sto",
    title="Energy and work [J]",
)
FEEDBACK_FORCE = Quantity(
    name="feedback_force",
    dims=("time", "free_coordinate"),
    unit="N m or N",
    meaning="generalized force of the feedback to a motion that is followed",
    file="feedback.sto",
    title="Feedback",
)
ELASTIC_FIBER_LENGTH = Quantity(
    name="elastic_fiber_length",
    dims=("time", "elastic_muscle"),
    unit="m",
    meaning="length of the fibers of a muscle whose tendon stretches",
    file="elastic_fiber_lengths.sto",
    title="Fiber lengths [m]",
)
QUANTITIES = (ENERGY, FEEDBACK_FORCE, ELASTIC_FIBER_LENGTH)
