"""The dynamics of one specimen in three steps: inertia, joint viscosity, muscle viscosity ([S] section II)."""

from __future__ import annotations

from dataclasses import dataclass

from myomorph.identify.estimate import Estimate
from myomorph.identify.swings import SwingRecording
from myomorph.model.spatial import Array


@dataclass(frozen=True, eq=False)
class Condition:
    """What was identified of a specimen with its muscles, or without them.

    Attributes
    ----------
    recordings : what it was identified from
    parameters : (10,) of the limb as one link, about the joint's center ([D] order)
    mass : [kg]
    com : distance of the mass center from the joint's center [m]
    viscosity : the one value over all axes, as the paper prints it [N m s/rad]; with muscles d_{M+J}
    axis_viscosity : one an axis
    excited : one an axis: whether the swings moved it enough to tell its viscosity
    residual : (6,) root mean square of measured less predicted wrench [N m], [N]
    """

    recordings: tuple[SwingRecording, ...]
    parameters: Array
    mass: Estimate
    com: Estimate
    viscosity: Estimate
    axis_viscosity: tuple[Estimate, ...]
    excited: tuple[bool, ...]
    residual: Array


@dataclass(frozen=True, eq=False)
class MuscleViscosity:
    """d_M of the muscles ([S] eq. 3), with the joint's own viscosity taken off.

    Attributes
    ----------
    common : one value for all muscles, as the paper prints it [N s/m]
    pcsa : (muscles,) shares of the physiological cross-section, mean 1
    by_pcsa : the factor of those shares [N s/m]
    by_muscle : regularised values, one a muscle [N s/m]
    rank : number of independent combinations that the swings show, of `len(muscles)`
    singular_values : (muscles,) of the normalised problem, descending
    """

    muscles: tuple[str, ...]
    common: Estimate
    pcsa: Array
    by_pcsa: Estimate
    by_muscle: tuple[Estimate, ...]
    rank: int
    singular_values: Array


@dataclass(frozen=True, eq=False)
class SpecimenViscosity:
    """A specimen's row of [S] tables I and II.

    Attributes
    ----------
    without, intact : without and with muscles; None where that condition is lacking or failed
    muscles : None unless both conditions are there
    muscle_mass : with less without [kg]
    measured_muscle_mass : on a scale [kg], None where it was not weighed
    notes : doubts and what was left out, one line each
    """

    name: str
    without: Condition | None
    intact: Condition | None
    muscles: MuscleViscosity | None
    muscle_mass: Estimate | None
    measured_muscle_mass: float | None
    notes: tuple[str, ...] = ()
