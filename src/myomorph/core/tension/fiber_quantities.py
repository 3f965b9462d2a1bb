"""Quantities of fibers and tendons, where tendons stretch."""

from __future__ import annotations

from myomorph.core.model.quantity import Quantity, Tidy

BY_MUSCLE = ("time", "muscle")
MUSCLE = ("muscle",)
BY_FRAME = ("time",)
BY_STRIDE = ("fiber_work",)
WORK_TABLE = "fiber_work.csv"

FIBER_LENGTH = Quantity(
    name="fiber_length",
    dims=BY_MUSCLE,
    unit="m",
    meaning="length of the muscle's fibers",
    file="fiber_lengths.sto",
    title="Muscle tensions: fiber lengths [m]",
)
NORMALIZED_FIBER_LENGTH = Quantity(
    name="normalized_fiber_length",
    dims=BY_MUSCLE,
    unit="1",
    meaning="length of the muscle's fibers over the optimal one",
    stored=False,
    tidy=Tidy(
        statistics=("minimum", "maximum", "range"),
        endings=("_normalized_fiber_length",),
        curve="normalized fiber length",
    ),
)
FIBER_VELOCITY = Quantity(
    name="fiber_velocity",
    dims=BY_MUSCLE,
    unit="m/s",
    meaning="lengthening velocity of the fibers",
    file="fiber_velocities.sto",
    title="Muscle tensions: lengthening velocities of fibers [m/s]",
)
TENDON_STRAIN = Quantity(
    name="tendon_strain",
    dims=BY_MUSCLE,
    unit="1",
    meaning="tendon length over slack length, less 1",
    file="tendon_strains.sto",
    title="Muscle tensions: tendon strains",
    tidy=Tidy(
        statistics=("maximum",),
        endings=("_tendon_strain",),
        curve="tendon strain",
        curve_unit="%",
    ),
)
TENDON_FORCE = Quantity(
    name="tendon_force",
    dims=BY_MUSCLE,
    unit="N",
    meaning="force of the tendon: muscle_force, under the name of OpenSim's MuscleAnalysis",
    stored=False,
    file="tendon_forces.sto",
    title="Muscle tensions: tendon forces [N]",
)
FIBER_POWER = Quantity(
    name="fiber_power",
    dims=BY_MUSCLE,
    unit="W",
    meaning="power of the fibers, positive where they do work",
    file="fiber_powers.sto",
    title="Muscle tensions: powers of fibers [W]",
    tidy=Tidy(
        statistics=("minimum", "maximum", "mean"),
        endings=("_fiber_power",),
        curve="fiber power",
        curve_unit="W",
    ),
)
TENDON_POWER = Quantity(
    name="tendon_power",
    dims=BY_MUSCLE,
    unit="W",
    meaning="power of the tendon, positive where it gives work back",
    file="tendon_powers.sto",
    title="Muscle tensions: powers of tendons [W]",
    tidy=Tidy(
        statistics=("minimum", "maximum", "mean"),
        endings=("_tendon_power",),
        curve="tendon power",
        curve_unit="W",
    ),
)
TRANSIENT = Quantity(
    name="transient",
    dims=BY_FRAME,
    unit="1",
    meaning="1 near an end, where what lies beyond it can be felt",
    kind="flag",
)
BRIDGED = Quantity(
    name="bridged",
    dims=BY_FRAME,
    unit="1",
    meaning="1 where torques or coordinates were interpolated",
    kind="flag",
)
FIBERS = (
    FIBER_LENGTH,
    FIBER_VELOCITY,
    TENDON_STRAIN,
    FIBER_POWER,
    TENDON_POWER,
    TRANSIENT,
    BRIDGED,
)
TIDY_FIBERS = (TENDON_STRAIN, FIBER_POWER, TENDON_POWER)

MUSCLE_RIGID_TENDON = Quantity(
    name="muscle_rigid_tendon",
    dims=MUSCLE,
    unit="1",
    meaning="1 where the tendon was taken as rigid",
    kind="flag",
)
UNREACHABLE_FRAME = Quantity(
    name="unreachable_frame",
    dims=MUSCLE,
    unit="1",
    meaning="first frame that the fibers cannot reach, -1 for none",
    kind="count",
)
UNREACHABLE_LENGTH = Quantity(
    name="unreachable_length",
    dims=MUSCLE,
    unit="1",
    meaning="normalized fiber length furthest out of reach",
)
ELASTIC_CERTIFICATE_VALUE = Quantity(
    name="elastic_certificate_value",
    dims=("elastic_certificate",),
    unit="1",
    meaning="certificate of the elastic solution: residuals, steps and distance from another start",
)

FIBER_WORK = (
    Quantity(
        name="fiber_work_muscle",
        dims=BY_STRIDE,
        unit="",
        meaning="muscle",
        attribute="muscle",
        kind="text",
        stored=False,
        file=WORK_TABLE,
    ),
    Quantity(
        name="fiber_work_stride",
        dims=BY_STRIDE,
        unit="1",
        meaning="stride of the muscle's own leg from 1 on, 0 for the whole recording",
        attribute="stride",
        kind="count",
        stored=False,
        file=WORK_TABLE,
    ),
    Quantity(
        name="fiber_work_start",
        dims=BY_STRIDE,
        unit="s",
        meaning="start of the stride",
        attribute="start",
        stored=False,
        file=WORK_TABLE,
    ),
    Quantity(
        name="fiber_work_stop",
        dims=BY_STRIDE,
        unit="s",
        meaning="end of the stride",
        attribute="stop",
        stored=False,
        file=WORK_TABLE,
    ),
    Quantity(
        name="fiber_work_fiber_positive_work",
        dims=BY_STRIDE,
        unit="J",
        meaning="positive work of the fibers",
        attribute="fiber_positive_work",
        stored=False,
        file=WORK_TABLE,
    ),
    Quantity(
        name="fiber_work_fiber_negative_work",
        dims=BY_STRIDE,
        unit="J",
        meaning="negative work of the fibers, as a positive number",
        attribute="fiber_negative_work",
        stored=False,
        file=WORK_TABLE,
    ),
    Quantity(
        name="fiber_work_tendon_returned_energy",
        dims=BY_STRIDE,
        unit="J",
        meaning="energy that the tendon returns",
        attribute="tendon_returned_energy",
        stored=False,
        file=WORK_TABLE,
    ),
    Quantity(
        name="fiber_work_tendon_stored_energy",
        dims=BY_STRIDE,
        unit="J",
        meaning="energy that the tendon stores",
        attribute="tendon_stored_energy",
        stored=False,
        file=WORK_TABLE,
    ),
    Quantity(
        name="fiber_work_fiber_peak_power",
        dims=BY_STRIDE,
        unit="W",
        meaning="peak power of the fibers",
        attribute="fiber_peak_power",
        stored=False,
        file=WORK_TABLE,
    ),
    Quantity(
        name="fiber_work_tendon_peak_power",
        dims=BY_STRIDE,
        unit="W",
        meaning="peak power of the tendon",
        attribute="tendon_peak_power",
        stored=False,
        file=WORK_TABLE,
    ),
    Quantity(
        name="fiber_work_max_tendon_strain",
        dims=BY_STRIDE,
        unit="1",
        meaning="maximum strain of the tendon",
        attribute="max_tendon_strain",
        stored=False,
        file=WORK_TABLE,
    ),
    Quantity(
        name="fiber_work_min_normalized_length",
        dims=BY_STRIDE,
        unit="1",
        meaning="minimum normalized fiber length",
        attribute="min_normalized_length",
        stored=False,
        file=WORK_TABLE,
    ),
    Quantity(
        name="fiber_work_max_normalized_length",
        dims=BY_STRIDE,
        unit="1",
        meaning="maximum normalized fiber length",
        attribute="max_normalized_length",
        stored=False,
        file=WORK_TABLE,
    ),
)
"""Columns of the table of work, in its order."""

QUANTITIES = (
    *FIBERS,
    NORMALIZED_FIBER_LENGTH,
    TENDON_FORCE,
    MUSCLE_RIGID_TENDON,
    UNREACHABLE_FRAME,
    UNREACHABLE_LENGTH,
    ELASTIC_CERTIFICATE_VALUE,
    *FIBER_WORK,
)
