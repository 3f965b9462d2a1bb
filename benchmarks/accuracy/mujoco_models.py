"""Models written for MuJoCo: what the certificate says, in the MuJoCo that is installed."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import myomorph as mm
from myomorph.core.io.formats import COMPOSED
from myomorph.exchange.mujoco.certificate import Certificate

MODELS = (
    "opensim-gait-subject01/ref_scale/gait2354_simbody.osim",
    "opensim-gait-subject01/ref_so_10dof18musc/subject01_adjusted_spring.osim",
    "ceinms-emg-walk/model/gait2392.osim",
    "hamner-run-subject04/unscaled_generic.osim",
    "rajagopal-walk-emg/raw/Rajagopal2016.osim",
    "opencap-subject4-multitask/models/manually_scaled.osim",
    "opensim-reference-small/arm26.osim",
    "c3d-functional-joints/models/Wu_Shoulder_Model_via_points.osim",
    "lenhart-knee-contact-walk/lenhart2015.osim",
    "myo-sim:myoarm",
    "myo-sim:myolegs",
    "myo-sim:myofullbody",
)

Row = dict[str, object]


def measure(folder: Path) -> Iterator[Row]:
    """Yield a row for each model.

    It has muscles within the tolerance, the largest differences and where they are, torques and
    masses.
    """
    for name in MODELS:
        composed = name.startswith(COMPOSED)
        if not composed and not (folder / name).exists():
            continue
        with tempfile.TemporaryDirectory() as temporary:
            certificate = mm.write_mjcf(
                mm.read_model(name if composed else folder / name), Path(temporary) / "a.xml"
            )
        title = name if composed else f"{name.split('/')[0]} {Path(name).stem}"
        yield {"model": title} | _row(certificate)


def _row(certificate: Certificate) -> Row:
    every = certificate.differences
    length = max(every, key=lambda one: one.length)
    arm = max(every, key=lambda one: one.arm)
    length_at, length_value = length.length_at
    arm_at, arm_value = arm.arm_at
    return {
        "MuJoCo": certificate.version,
        "muscles": len(every),
        "within": sum(one.within for one in every),
        "lengths within": sum(one.length <= 1e-4 for one in every),
        "median length [mm]": 1e3 * float(np.median([one.length for one in every])),
        "length [mm]": 1e3 * length.length,
        "length of": f"{length.muscle}, {length_at} {length_value:.2f}",
        "median moment arm [mm]": 1e3 * float(np.median([one.arm for one in every])),
        "moment arm [mm]": 1e3 * arm.arm,
        "moment arm of": f"{arm.muscle} about {arm.arm_about}, {arm_at} {arm_value:.2f}",
        "own [mm]": 1e3 * max(one.own for one in every),
        "poses within, all together [%]": 100.0 * float(np.mean([one.share for one in every])),
        "force at rest [% of strength]": 100.0 * max(one.force for one in every),
        "force in motion [% of strength]": 100.0 * max(one.moving_force for one in every),
        "torque [N m]": certificate.torque,
        "mass [kg]": certificate.mass,
        "steps": "yes" if certificate.steps else "no",
    }
