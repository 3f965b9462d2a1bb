"""Specimens made from a virtual ball joint, with made intervals.

They are enough to draw every part of the page.
"""

from __future__ import annotations

import numpy as np

from myomorph.core.model.interval import Interval
from myomorph.swings.viscosity.cohort import SPECIMENS, PublishedSpecimen
from myomorph.swings.viscosity.identification.identify import (
    Condition,
    MuscleViscosity,
    SpecimenViscosity,
)
from myomorph.swings.viscosity.swings.recording import SwingRecording

MUSCLES = ("BicepsBrachiiLongum", "Supraspinatus", "TeresMajor")
AXES = ("x", "y", "z")


def published_row(specimen: PublishedSpecimen) -> dict[str, Interval]:
    """Return the quantities of a printed row; their intervals are unknown."""
    return {name: Interval(value, np.nan, np.nan) for name, value in specimen.values.items()}


def recording(name: str = "swing1", frames: int = 900, seed: int = 0) -> SwingRecording:
    """Numbers of the right shapes, with three swings of 300 frames."""
    random = np.random.default_rng(seed)
    time = np.arange(frames) / 200.0
    angles = np.sin(2 * np.pi * time[:, None] * (1.0, 0.9, 0.6)) * (0.6, 0.3, 0.05)
    rates = np.gradient(angles, time, axis=0)
    return SwingRecording(
        name=name,
        time=time,
        wrench_rows=random.normal(size=(frames, 6, 10)),
        wrench=random.normal(size=(frames, 6)),
        torque_rows=random.normal(size=(frames, 3, 10)),
        rates=rates,
        angles=angles,
        axes=AXES,
        muscles=MUSCLES,
        lengthening=0.02 * random.normal(size=(frames, 3, 3)),
        rotations=np.broadcast_to(np.eye(3), (frames, 3, 3)).copy(),
        gravity=np.array([0.0, -9.81, 0.0]),
        swing=np.repeat([0, 1, -1], -(-frames // 3))[:frames],
    )


def near(value: float, share: float = 0.05) -> Interval:
    """Return a value with an interval of this share to both sides."""
    return Interval(value, value * (1.0 - share), value * (1.0 + share))


def condition(mass: float, com: float, viscosity: float) -> Condition:
    """Make a condition with these values."""
    parameters = np.array([mass, 0.0, -mass * com, 0.0, 0.5, 0.01, 0.5, 0.0, 0.0, 0.0])
    axes = tuple(near(factor * viscosity, 0.1) for factor in (1.0, 1.1, 0.9))
    return Condition(
        recordings=(recording(),),
        parameters=parameters,
        mass=near(mass),
        com=near(com),
        first_moment=near(mass * com),
        least_mass=near(0.9 * mass),
        viscosity=near(viscosity),
        axis_viscosity=axes,
        excited=(True, True, False),
        residual=np.full(6, 0.3),
    )


def specimen(printed: PublishedSpecimen) -> SpecimenViscosity:
    """Make a specimen that was found to be just as printed."""
    muscles = MuscleViscosity(
        muscles=MUSCLES,
        common=near(printed.muscle_viscosity),
        pcsa=np.array([0.5, 1.0, 1.5]),
        by_pcsa=near(printed.muscle_viscosity),
        by_muscle=tuple(near(factor * printed.muscle_viscosity, 0.4) for factor in (0.8, 1.0, 1.3)),
        rank=2,
        singular_values=np.array([3.0, 1.0, 1e-4]),
    )
    return SpecimenViscosity(
        name=printed.name,
        without=condition(
            printed.mass_muscles_removed, printed.com_muscles_removed, printed.joint_viscosity
        ),
        intact=condition(printed.mass_intact, printed.com_intact, printed.total_viscosity),
        muscles=muscles,
        muscle_mass=near(printed.estimated_muscle_mass),
        measured_muscle_mass=printed.measured_muscle_mass,
        notes=("axis z hardly moved",),
    )


def specimens() -> tuple[SpecimenViscosity, ...]:
    """Return the paper's six specimens."""
    return tuple(specimen(one) for one in SPECIMENS)
