"""Steps 1 and 2 by several methods on virtual joints of known truth.

They show why the defaults are what they are.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from benchmarks.errors import rms
from myomorph.swings.viscosity.identification.identify import (
    Condition,
    ViscosityOptions,
    identify_specimen,
)
from truths.mechanical_joint import JointExperiment, VirtualJoint, mechanical_joint

Row = dict[str, object]

JOINTS = 12
SECONDS = 15.0
TRIALS = 2
CUTOFF = 12.0
METHODS = {
    "instruments, spring fitted (default)": ViscosityOptions(draws=2),
    "plain least squares in step 1": ViscosityOptions(draws=2, instruments=False),
    "no spring in step 2, as [S] eq. 1": ViscosityOptions(draws=2, stiffness=False),
    "still swings kept": ViscosityOptions(draws=2, min_relative_speed=0.0),
    "plain in both steps, still swings kept": ViscosityOptions(
        draws=2, instruments=False, stiffness=False, min_relative_speed=0.0
    ),
}
PLATE = "moment measured by the plate instead of inverse dynamics"


def measure() -> Iterable[Row]:
    """Yield a row for each method.

    It has errors of viscosity and mass center over hinges and balls, without and with a spring.
    """
    errors: dict[str, list[tuple[float, float, float]]] = {}
    for seed in range(JOINTS):
        damping = (0.02, 0.06, 0.2)[seed % 3]
        spring = 0.0 if seed % 4 < 2 else 2.0
        joint = mechanical_joint(
            "ball" if seed % 2 else "hinge",
            damping,
            spring,
            seed,
            experiment=JointExperiment(seconds=SECONDS, trials=TRIALS),
        )
        swings = joint.swings(CUTOFF)
        for name, options in METHODS.items():
            found = identify_specimen(name, swings, (), options=options).without
            assert found is not None
            errors.setdefault(name, []).append(
                (spring, *_errors(joint, found, found.viscosity.value))
            )
            if options == ViscosityOptions(draws=2):
                assert found.plate_viscosity is not None
                errors.setdefault(PLATE, []).append(
                    (spring, *_errors(joint, found, found.plate_viscosity.value))
                )
    for name, table in errors.items():
        springs, viscosity, com = np.array(table).T
        free = springs == 0.0
        yield {
            "method": name,
            "viscosity, no spring: RMS": f"{100 * rms(viscosity[free]):.2f} %",
            "largest": f"{100 * np.abs(viscosity[free]).max():.2f} %",
            "viscosity, spring of 2 Nm/rad: RMS": f"{100 * rms(viscosity[~free]):.2f} %",
            "largest with spring": f"{100 * np.abs(viscosity[~free]).max():.2f} %",
            "COM: RMS": f"{1e3 * rms(com):.3f} mm",
            "COM: largest": f"{1e3 * np.abs(com).max():.3f} mm",
        }


def _errors(joint: VirtualJoint, found: Condition, viscosity: float) -> tuple[float, float]:
    return viscosity / joint.truth.damping - 1.0, found.com.value - joint.truth.com
