"""Several specimens together: the columns of [S] tables I and II, their mean and population SD."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from myomorph.model.provenance import Estimate
from myomorph.viscosity.murai_tables import PublishedSpecimen
from myomorph.viscosity.viscosity import SpecimenViscosity


@dataclass(frozen=True)
class Quantity:
    """A column of the tables.

    Attributes
    ----------
    name : as files call it
    label, unit : as the paper heads it
    table : 1 without muscles, 2 with muscles
    """

    name: str
    label: str
    unit: str
    table: int


QUANTITIES = (
    Quantity("mass_without", "mass", "kg", 1),
    Quantity("com_without", "COM", "m", 1),
    Quantity("joint_viscosity", "joint viscosity", "Nms/rad", 1),
    Quantity("mass_with", "mass", "kg", 2),
    Quantity("com_with", "COM", "m", 2),
    Quantity("total_viscosity", "total viscosity", "Nms/rad", 2),
    Quantity("muscle_viscosity", "muscle viscosity", "Ns/m", 2),
    Quantity("estimated_muscle_mass", "estimated muscles", "kg", 2),
    Quantity("measured_muscle_mass", "measured muscles", "kg", 2),
)
"""In the order of `specimens.csv`."""

Row = Mapping[str, Estimate]


@dataclass(frozen=True)
class CohortLine:
    """One quantity over all specimens that have it.

    Attributes
    ----------
    mean, sd : over specimens; the population SD (division by `count`), as [S] prints it
    low, high : 95 % interval of the mean of these specimens, from the intervals of each: it tells how well
        they were measured, not how other specimens may differ; NaN where a specimen has none
    count : of specimens
    """

    quantity: Quantity
    mean: float
    sd: float
    low: float
    high: float
    count: int


def specimen_row(found: SpecimenViscosity) -> Row:
    """The quantities of one specimen; what is lacking is absent, what was weighed has no width."""
    known: dict[str, Estimate | None] = {}
    if found.without is not None:
        one = found.without
        known |= {"mass_without": one.mass, "com_without": one.com, "joint_viscosity": one.viscosity}
    if found.intact is not None:
        one = found.intact
        known |= {"mass_with": one.mass, "com_with": one.com, "total_viscosity": one.viscosity}
    if found.muscles is not None:
        known["muscle_viscosity"] = found.muscles.common
    known["estimated_muscle_mass"] = found.muscle_mass
    if found.measured_muscle_mass is not None:
        known["measured_muscle_mass"] = exactly(found.measured_muscle_mass)
    return MappingProxyType({name: one for name, one in known.items() if one is not None})


def published_row(specimen: PublishedSpecimen) -> Row:
    """The quantities of a printed row; their intervals are unknown."""
    values = {one.name: float(getattr(specimen, one.name)) for one in QUANTITIES}
    return MappingProxyType({name: Estimate(value, np.nan, np.nan) for name, value in values.items()})


def exactly(value: float) -> Estimate:
    """A value that was not estimated."""
    return Estimate(value, value, value)


def cohort(rows: Sequence[Row]) -> tuple[CohortLine, ...]:
    """Mean and population SD of every quantity that a specimen has.

    The specimens' errors are taken as independent: with half-widths h of their intervals, that of the mean of
    n is sqrt(sum h^2) / n, below and above the mean each with its own.

    Parameters
    ----------
    rows : of `specimen_row`, one a specimen
    """
    lines = []
    for quantity in QUANTITIES:
        known = [row[quantity.name] for row in rows if quantity.name in row]
        values = np.array([one.value for one in known])
        keep = np.isfinite(values)
        count = int(keep.sum())
        if not count:
            continue
        values = values[keep]
        below = values - np.array([one.low for one in known])[keep]
        above = np.array([one.high for one in known])[keep] - values
        mean = float(values.mean())
        lines.append(
            CohortLine(
                quantity,
                mean,
                float(values.std(ddof=0)),
                mean - float(np.sqrt(below @ below)) / count,
                mean + float(np.sqrt(above @ above)) / count,
                count,
            )
        )
    return tuple(lines)
