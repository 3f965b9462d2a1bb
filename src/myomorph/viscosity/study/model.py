"""The identified viscosity in the specimen's own model, in forms that OpenSim honours."""

from __future__ import annotations

import numpy as np

from myomorph.model.model import Model
from myomorph.model.passive_dynamics import strand_viscosity, with_passive_dynamics
from myomorph.model.series import Motion
from myomorph.motion.filters import differentiate
from myomorph.viscosity.joint_bushing import joint_bushing
from myomorph.viscosity.tracking import TrackedSpecimen
from myomorph.viscosity.viscosity import SpecimenViscosity

RATE = 25.0
"""Frames a second that the bushing is fitted to [Hz]."""
LOSSY = 0.05
"""Share of the joint's torque that a bushing may miss without being named."""


def identified_model(
    tracked: TrackedSpecimen, found: SpecimenViscosity, cutoff: float
) -> tuple[Model, tuple[str, ...]] | None:
    """The specimen as it stood, its joint damped as found and every muscle with the common viscosity.

    A hinge gets a damper of its coordinate, a ball the bushing nearest to its damping over the first trial.
    Masses stay those of the model.

    Returns
    -------
    the model and what it does not express, one line each; None where the joint's viscosity is not known

    Raises
    ------
    BadData
        the motion cannot be differentiated
    """
    if found.without is None:
        return None
    specimen, condition = tracked.specimen, found.without
    muscles = {} if found.muscles is None else dict.fromkeys(found.muscles.muscles, found.muscles.common.value)
    viscosity = strand_viscosity(muscles, specimen.muscles)
    if len(specimen.joint_coordinates) == 1:
        damping = {specimen.joint_coordinates[0]: condition.viscosity.value}
        return with_passive_dynamics(specimen.model, damping, viscosity=viscosity), ()
    by_axis = [
        own.value if excited else condition.viscosity.value
        for own, excited in zip(condition.axis_viscosity, condition.excited, strict=True)
    ]
    joint = joint_bushing(specimen.model, specimen.base, specimen.first, by_axis, _motion(tracked, cutoff))
    told = f"identified.osim: its bushing misses {100 * joint.residual:.0f} % of the torque of the joint's damping"
    model = with_passive_dynamics(specimen.model, viscosity=viscosity, bushings=(joint.bushing,))
    return model, (told,) if joint.residual > LOSSY else ()


def _motion(tracked: TrackedSpecimen, cutoff: float) -> Motion:
    motion = differentiate(tracked.trials[0].motion, cutoff)
    rates = motion.velocities
    assert rates is not None
    keep = np.flatnonzero(np.isfinite(motion.values).all(axis=1) & np.isfinite(rates).all(axis=1))
    keep = keep[:: max(1, round(motion.rate / RATE))]
    return Motion(motion.time[keep], motion.names, motion.values[keep], rates[keep])
