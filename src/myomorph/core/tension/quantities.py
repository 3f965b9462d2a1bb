"""Quantities of muscle tensions: muscles, actuators, what was balanced, and how well."""

from __future__ import annotations

import numpy as np

from myomorph.core.model.quantity import Quantity, Tidy
from myomorph.core.rigid.quantities import GENERALIZED_FORCE

BY_MUSCLE = ("time", "muscle")
MUSCLE = ("muscle",)
BY_FRAME = ("time",)
NOT_NEGATIVE = (0.0, np.inf)

ACTIVATION = Quantity(
    name="activation",
    dims=BY_MUSCLE,
    unit="1",
    meaning="muscle activation",
    file="activations.sto",
    title="Muscle tensions: activations",
    label="Muscle activations",
    tidy=Tidy(statistics=("maximum", "mean"), endings=("_activation",), curve="muscle activation"),
    drawn=True,
    bounds=(0.0, 1.0),
)
MUSCLE_FORCE = Quantity(
    name="muscle_force",
    dims=BY_MUSCLE,
    unit="N",
    meaning="muscle force along the tendon",
    file="forces.sto",
    title="Muscle tensions: forces",
    label="Muscle tensions",
    tidy=Tidy(
        statistics=("maximum", "mean"),
        endings=("_force",),
        curve="muscle force",
        curve_unit="N",
    ),
    drawn=True,
    bounds=NOT_NEGATIVE,
)
MUSCLE_VISCOUS_FORCE = Quantity(
    name="muscle_viscous_force",
    dims=BY_MUSCLE,
    unit="N",
    meaning="part of muscle_force that is viscous",
)
ACTUATOR_FORCE = Quantity(
    name="actuator_force",
    dims=("time", "actuator"),
    unit="N m or N",
    meaning="force or torque of reserve, residual and other actuators",
    file="reserves.sto",
    title="Muscle tensions: reserves",
)
ACTUATOR_COORDINATE = Quantity(
    name="actuator_coordinate",
    dims=("actuator",),
    unit="",
    meaning="coordinate that an actuator drives, nothing where it drives none",
    kind="text",
)
BALANCED_TORQUE = Quantity(
    name="balanced_torque",
    dims=("time", "balanced_coordinate"),
    unit="N m or N",
    meaning="what muscles and actuators had to balance",
)
EQUILIBRIUM_RESIDUAL = Quantity(
    name="equilibrium_residual",
    dims=BY_FRAME,
    unit="N m or N",
    meaning="largest torque left unbalanced",
)
TENSION_STATUS = Quantity(
    name="tension_status",
    dims=BY_FRAME,
    unit="1",
    meaning="0 where the frame is optimal",
    attribute="status",
    kind="code",
)
TENSION_ITERATIONS = Quantity(
    name="tension_iterations",
    dims=BY_FRAME,
    unit="1",
    meaning="iterations taken",
    attribute="iterations",
    kind="count",
)
ACTIVATION_LOWER = Quantity(
    name="activation_lower",
    dims=MUSCLE,
    unit="1",
    meaning="lower bound of the activation",
)
ACTIVATION_UPPER = Quantity(
    name="activation_upper",
    dims=MUSCLE,
    unit="1",
    meaning="upper bound of the activation",
)
MUSCLE_OVERSTRETCHED = Quantity(
    name="muscle_overstretched",
    dims=MUSCLE,
    unit="1",
    meaning="1 where passive force passes F0",
    kind="flag",
)
MUSCLE_PASSIVE_SHARE = Quantity(
    name="muscle_passive_share",
    dims=MUSCLE,
    unit="1",
    meaning="largest passive force over F0",
)
MUSCLE_PASSIVE_TIME = Quantity(
    name="muscle_passive_time",
    dims=MUSCLE,
    unit="s",
    meaning="when that was",
)
TENSION = (
    ACTIVATION,
    MUSCLE_FORCE,
    MUSCLE_VISCOUS_FORCE,
    ACTUATOR_FORCE,
    BALANCED_TORQUE,
    EQUILIBRIUM_RESIDUAL,
    TENSION_STATUS,
    TENSION_ITERATIONS,
    ACTIVATION_LOWER,
    ACTIVATION_UPPER,
    MUSCLE_OVERSTRETCHED,
    MUSCLE_PASSIVE_SHARE,
    MUSCLE_PASSIVE_TIME,
)

GENERALIZED_FORCE_WITH_CONTACTS = GENERALIZED_FORCE.replaced(
    name="generalized_force_with_contacts",
    meaning="generalized force of inverse dynamics with estimated contacts",
    file="torques_with_contacts.sto",
    label="Joint torques under estimated contact forces",
    tidy=None,
)

QUANTITIES = (*TENSION, ACTUATOR_COORDINATE, GENERALIZED_FORCE_WITH_CONTACTS)
