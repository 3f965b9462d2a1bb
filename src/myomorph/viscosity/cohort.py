"""Several specimens together: the columns of [S] tables I and II, their mean and SD, and the printed ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np

from myomorph.model.frozen_map import FrozenMap
from myomorph.model.provenance import Estimate
from myomorph.viscosity.identification.identify import SpecimenViscosity

STROEVE_TOTAL_VISCOSITY = 0.2  # Of a shoulder with its muscles [N m s/rad]: Stroeve 1999, as [S] cites it.


Row = Mapping[str, Estimate]


@dataclass(frozen=True)
class PublishedSpecimen:
    """A row of [S] tables I (without muscles) and II (with muscles); `name` is the number of the specimen, "mean" or
    "SD". Masses of the limb and distances of its mass center from the glenohumeral center [kg, m]; d_J and d_{M+J} [N m
    s/rad]; d_M, one value for all muscles [N s/m]; muscle mass, estimated (with less without) and on a scale [kg].
    """

    name: str
    mass_muscles_removed: float
    com_muscles_removed: float
    joint_viscosity: float
    mass_intact: float
    com_intact: float
    total_viscosity: float
    muscle_viscosity: float
    estimated_muscle_mass: float
    measured_muscle_mass: float

    @property
    def values(self) -> dict[str, float]:
        """What is printed, by quantity."""
        return {field.name: float(getattr(self, field.name)) for field in fields(self) if field.name != "name"}

    @property
    def first_moment_muscles_removed(self) -> float:
        """Of what is printed, [kg m]."""
        return self.mass_muscles_removed * self.com_muscles_removed

    @property
    def first_moment_intact(self) -> float:
        """Of what is printed, [kg m]."""
        return self.mass_intact * self.com_intact


SPECIMENS = (
    PublishedSpecimen("01", 2.02, 0.425, 7.61e-2, 2.64, 0.347, 1.05e-1, 2.41e2, 0.614, 0.765),
    PublishedSpecimen("02", 2.04, 0.460, 5.51e-2, 2.43, 0.387, 1.06e-1, 3.23e2, 0.389, 0.543),
    PublishedSpecimen("03", 1.90, 0.387, 5.80e-2, 2.26, 0.335, 1.06e-1, 3.62e2, 0.361, 0.444),
    PublishedSpecimen("04", 2.05, 0.434, 5.25e-2, 2.65, 0.388, 9.54e-2, 2.56e2, 0.603, 0.788),
    PublishedSpecimen("05", 2.09, 0.479, 4.62e-2, 2.66, 0.435, 1.52e-1, 2.48e3, 0.562, 0.936),
    PublishedSpecimen("06", 2.03, 0.416, 3.18e-2, 2.60, 0.347, 7.60e-2, 3.52e2, 0.577, 0.967),
)
"""The six cadaveric limbs."""

MEAN = PublishedSpecimen("mean", 2.02, 0.433, 5.33e-2, 2.54, 0.373, 1.07e-1, 6.69e2, 0.518, 0.740)
SD = PublishedSpecimen("SD", 5.99e-2, 2.98e-2, 1.33e-2, 0.148, 3.42e-2, 2.28e-2, 8.11e2, 0.103, 0.191)
"""The last rows of the tables as printed; the SD divides by the number of specimens."""


@dataclass(frozen=True)
class Quantity:
    """A column of the tables, as files call it and as the paper heads it; table 1 is without muscles, 2 with them."""

    name: str
    label: str
    unit: str
    table: int


QUANTITIES = (
    Quantity("mass_muscles_removed", "mass", "kg", 1),
    Quantity("com_muscles_removed", "COM", "m", 1),
    Quantity("first_moment_muscles_removed", "mass times COM", "kg m", 1),
    Quantity("joint_viscosity", "joint viscosity", "Nms/rad", 1),
    Quantity("mass_intact", "mass", "kg", 2),
    Quantity("com_intact", "COM", "m", 2),
    Quantity("first_moment_intact", "mass times COM", "kg m", 2),
    Quantity("total_viscosity", "total viscosity", "Nms/rad", 2),
    Quantity("muscle_viscosity", "muscle viscosity", "Ns/m", 2),
    Quantity("estimated_muscle_mass", "estimated muscles", "kg", 2),
    Quantity("measured_muscle_mass", "measured muscles", "kg", 2),
)
"""In the order of `specimens.csv`."""


@dataclass(frozen=True)
class CohortLine:
    """One quantity over all specimens that have it: mean and population SD (division by `count`), as [S] prints it.
    `low` and `high` are the 95 % interval of the mean of these specimens, from the intervals of each: how well they
    were measured, not how other specimens may differ; NaN where a specimen has none.
    """

    quantity: Quantity
    mean: float
    sd: float
    low: float
    high: float
    count: int


def specimen_row(specimen_viscosity: SpecimenViscosity) -> Row:
    """The quantities of one specimen; what is lacking is absent, what was weighed has no width."""
    known = specimen_viscosity.estimates
    if specimen_viscosity.measured_muscle_mass is not None:
        known["measured_muscle_mass"] = Estimate(*[specimen_viscosity.measured_muscle_mass] * 3)
    return FrozenMap(known)


def cohort(rows: Sequence[Row]) -> tuple[CohortLine, ...]:
    """Mean and population SD of every quantity that a specimen has (rows of `specimen_row`). The specimens' errors are
    taken as independent: with half-widths h of their intervals, that of the mean of n is sqrt(sum h^2) / n, below and
    above the mean each with its own.
    """
    lines = []
    for quantity in QUANTITIES:
        known = [row[quantity.name] for row in rows if quantity.name in row]
        known = [estimate for estimate in known if np.isfinite(estimate.value)]
        if not known:
            continue
        values, lows, highs = np.array([(estimate.value, estimate.low, estimate.high) for estimate in known]).T
        mean, sd = float(values.mean()), float(values.std())
        below, above = (float(np.linalg.norm(half)) / len(known) for half in (values - lows, highs - values))
        lines.append(CohortLine(quantity, mean, sd, mean - below, mean + above, len(known)))
    return tuple(lines)
