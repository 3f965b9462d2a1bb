"""Tables I and II of the in-vitro shoulder experiment as they are printed ([S])."""

from __future__ import annotations

from dataclasses import dataclass

STROEVE_TOTAL_VISCOSITY = 0.2
"""Of a shoulder with its muscles [N m s/rad]: Stroeve 1999, as [S] cites it."""


@dataclass(frozen=True)
class PublishedSpecimen:
    """A row of [S] tables I (without muscles) and II (with muscles).

    Attributes
    ----------
    name : number of the specimen, "mean" or "SD"
    mass_without, mass_with : of the limb [kg]
    com_without, com_with : distance of the mass center from the glenohumeral center [m]
    joint_viscosity : d_J [N m s/rad]
    total_viscosity : d_{M+J} [N m s/rad]
    muscle_viscosity : d_M, one value for all muscles [N s/m]
    estimated_muscle_mass : mass with less mass without [kg]
    measured_muscle_mass : of the removed muscles on a scale [kg]
    """

    name: str
    mass_without: float
    com_without: float
    joint_viscosity: float
    mass_with: float
    com_with: float
    total_viscosity: float
    muscle_viscosity: float
    estimated_muscle_mass: float
    measured_muscle_mass: float


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
