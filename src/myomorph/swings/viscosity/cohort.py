"""Several specimens together: columns of [S] tables I and II, mean and SD, and the printed ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np

from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.interval import Interval
from myomorph.swings.viscosity.identification.identify import SpecimenViscosity

# Of a shoulder with its muscles [N m s/rad]: Stroeve 1999, as [S] cites it.
STROEVE_TOTAL_VISCOSITY = 0.2


Row = Mapping[str, Interval]


@dataclass(frozen=True)
class PublishedSpecimen:
    """A row of [S] tables I (without muscles) and II (with muscles).

    Its name is the number of the specimen, "mean" or "SD". Masses are of the limb [kg], com are
    distances of its mass center from the glenohumeral center [m]; viscosities d_J and d_{M+J} [N m
    s/rad], d_M, one value for all muscles [N s/m]; muscle mass, estimated (with less without) and
    on a scale [kg].
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
        return {
            field.name: float(getattr(self, field.name))
            for field in fields(self)
            if field.name != "name"
        }

    @property
    def first_moment_muscles_removed(self) -> float:
        """Of what is printed, [kg m]."""
        return self.mass_muscles_removed * self.com_muscles_removed

    @property
    def first_moment_intact(self) -> float:
        """Of what is printed, [kg m]."""
        return self.mass_intact * self.com_intact


SPECIMENS = (
    PublishedSpecimen(
        name="01",
        mass_muscles_removed=2.02,
        com_muscles_removed=0.425,
        joint_viscosity=7.61e-2,
        mass_intact=2.64,
        com_intact=0.347,
        total_viscosity=1.05e-1,
        muscle_viscosity=2.41e2,
        estimated_muscle_mass=0.614,
        measured_muscle_mass=0.765,
    ),
    PublishedSpecimen(
        name="02",
        mass_muscles_removed=2.04,
        com_muscles_removed=0.460,
        joint_viscosity=5.51e-2,
        mass_intact=2.43,
        com_intact=0.387,
        total_viscosity=1.06e-1,
        muscle_viscosity=3.23e2,
        estimated_muscle_mass=0.389,
        measured_muscle_mass=0.543,
    ),
    PublishedSpecimen(
        name="03",
        mass_muscles_removed=1.90,
        com_muscles_removed=0.387,
        joint_viscosity=5.80e-2,
        mass_intact=2.26,
        com_intact=0.335,
        total_viscosity=1.06e-1,
        muscle_viscosity=3.62e2,
        estimated_muscle_mass=0.361,
        measured_muscle_mass=0.444,
    ),
    PublishedSpecimen(
        name="04",
        mass_muscles_removed=2.05,
        com_muscles_removed=0.434,
        joint_viscosity=5.25e-2,
        mass_intact=2.65,
        com_intact=0.388,
        total_viscosity=9.54e-2,
        muscle_viscosity=2.56e2,
        estimated_muscle_mass=0.603,
        measured_muscle_mass=0.788,
    ),
    PublishedSpecimen(
        name="05",
        mass_muscles_removed=2.09,
        com_muscles_removed=0.479,
        joint_viscosity=4.62e-2,
        mass_intact=2.66,
        com_intact=0.435,
        total_viscosity=1.52e-1,
        muscle_viscosity=2.48e3,
        estimated_muscle_mass=0.562,
        measured_muscle_mass=0.936,
    ),
    PublishedSpecimen(
        name="06",
        mass_muscles_removed=2.03,
        com_muscles_removed=0.416,
        joint_viscosity=3.18e-2,
        mass_intact=2.60,
        com_intact=0.347,
        total_viscosity=7.60e-2,
        muscle_viscosity=3.52e2,
        estimated_muscle_mass=0.577,
        measured_muscle_mass=0.967,
    ),
)
"""The six cadaveric limbs."""

MEAN = PublishedSpecimen(
    name="mean",
    mass_muscles_removed=2.02,
    com_muscles_removed=0.433,
    joint_viscosity=5.33e-2,
    mass_intact=2.54,
    com_intact=0.373,
    total_viscosity=1.07e-1,
    muscle_viscosity=6.69e2,
    estimated_muscle_mass=0.518,
    measured_muscle_mass=0.740,
)
SD = PublishedSpecimen(
    name="SD",
    mass_muscles_removed=5.99e-2,
    com_muscles_removed=2.98e-2,
    joint_viscosity=1.33e-2,
    mass_intact=0.148,
    com_intact=3.42e-2,
    total_viscosity=2.28e-2,
    muscle_viscosity=8.11e2,
    estimated_muscle_mass=0.103,
    measured_muscle_mass=0.191,
)
"""The last rows of the tables as printed; the SD divides by the number of specimens."""


@dataclass(frozen=True)
class Quantity:
    """A column of the tables, as files call it and as the paper heads it.

    Table 1 is without muscles, 2 with them.
    """

    name: str
    label: str
    unit: str
    table: int


QUANTITIES = (
    Quantity(name="mass_muscles_removed", label="mass", unit="kg", table=1),
    Quantity(name="com_muscles_removed", label="COM", unit="m", table=1),
    Quantity(name="first_moment_muscles_removed", label="mass times COM", unit="kg m", table=1),
    Quantity(name="joint_viscosity", label="joint viscosity", unit="Nms/rad", table=1),
    Quantity(name="mass_intact", label="mass", unit="kg", table=2),
    Quantity(name="com_intact", label="COM", unit="m", table=2),
    Quantity(name="first_moment_intact", label="mass times COM", unit="kg m", table=2),
    Quantity(name="total_viscosity", label="total viscosity", unit="Nms/rad", table=2),
    Quantity(name="muscle_viscosity", label="muscle viscosity", unit="Ns/m", table=2),
    Quantity(name="estimated_muscle_mass", label="estimated muscles", unit="kg", table=2),
    Quantity(name="measured_muscle_mass", label="measured muscles", unit="kg", table=2),
)
"""In the order of `specimens.csv`."""


@dataclass(frozen=True)
class CohortLine:
    """One quantity over all specimens that have it.

    Attributes
    ----------
    quantity : of the tables
    mean, sd : the SD is that of the population (division by the count), as [S] prints it; NaN where
        a specimen has no more than a range
    count : of specimens
    low, high : 95 % interval of the mean of these specimens, from the intervals of each: how well
        they were measured, not how other specimens may differ; NaN where a specimen has none
    """

    quantity: Quantity
    mean: float
    sd: float
    low: float
    high: float
    count: int


def specimen_row(specimen_viscosity: SpecimenViscosity) -> Row:
    """List the quantities of one specimen.

    What is lacking is absent, what was weighed has no width.
    """
    known = specimen_viscosity.estimates
    if specimen_viscosity.measured_muscle_mass is not None:
        weighed = specimen_viscosity.measured_muscle_mass
        known["measured_muscle_mass"] = Interval(value=weighed, low=weighed, high=weighed)
    return FrozenMap(known)


def cohort(rows: Sequence[Row]) -> tuple[CohortLine, ...]:
    """Find mean and population SD of every quantity that a specimen has.

    The specimens' errors are taken as independent: with half-widths h of their intervals, that of
    the mean of n is sqrt(sum h^2) / n, below and above the mean each with its own. Where a specimen
    has no more than a range, the mean has one too: from the mean of the lower ends to that of the
    upper ones.

    Parameters
    ----------
    rows : of `specimen_row`
    """
    lines = []
    for quantity in QUANTITIES:
        known = [row[quantity.name] for row in rows if quantity.name in row]
        known = [each for each in known if np.isfinite(each.value) or np.isfinite(each.high)]
        if not known:
            continue
        values, lows, highs = np.array(
            [(estimate.value, estimate.low, estimate.high) for estimate in known]
        ).T
        if not np.isfinite(values).all():
            lines.append(
                CohortLine(
                    quantity=quantity,
                    mean=float("nan"),
                    sd=float("nan"),
                    low=float(lows.mean()),
                    high=float(highs.mean()),
                    count=len(known),
                )
            )
            continue
        mean = float(values.mean())
        sd = float(values.std())
        below = float(np.linalg.norm(values - lows)) / len(known)
        above = float(np.linalg.norm(highs - values)) / len(known)
        lines.append(
            CohortLine(
                quantity=quantity,
                mean=mean,
                sd=sd,
                low=mean - below,
                high=mean + above,
                count=len(known),
            )
        )
    return tuple(lines)
