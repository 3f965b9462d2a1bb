"""A ball's motion is differentiated through any pose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from myomorph.core.model.series import Motion
from myomorph.core.motion.filters import differentiate
from myomorph.swings.simulate.laboratory import Sampled
from myomorph.swings.viscosity.specimen.model import Specimen, SpecimenNames, build_specimen
from myomorph.swings.viscosity.swings.motion import (
    angular_motion,
    continuous,
    differentiate_joint,
    limb_motion,
    on_moving_base,
)
from truths.mechanical_joint import JointExperiment, mechanical_joint


@pytest.fixture(scope="module")
def spun() -> tuple[Specimen, Motion, Sampled]:
    """Make a limb that rotates several times about its length, without noise.

    It is returned as coordinates of its specimen.
    """
    joint = mechanical_joint(
        "ball", 0.01, 0.0, 25, experiment=JointExperiment(seconds=8.0, trials=1)
    )
    specimen = build_specimen(joint.model, SpecimenNames("base", "limb"))
    exact = joint.trials[0].exact.every(5)
    order = "".join("XYZ"[int(np.argmax(axis.vector))] for axis in specimen.model.joints[1].axes)
    angles = Rotation.from_matrix(exact.rotations).as_euler(order)
    return specimen, Motion(exact.time, specimen.joint_coordinates, angles), exact


def test_rates_through_jumps_of_angles(spun: tuple[Specimen, Motion, Sampled]) -> None:
    specimen, motion, exact = spun
    assert np.abs(np.diff(motion.values, axis=0)).max() > 6.0
    limb = limb_motion(specimen, differentiate_joint(specimen, motion))
    inside = slice(20, -20)
    assert np.abs(limb.rates - exact.rates)[inside].max() < 1e-4
    apart = Rotation.from_matrix(np.swapaxes(limb.rotations, 1, 2) @ exact.rotations).magnitude()
    assert apart.max() < 1e-9


def test_accelerations_give_the_wrench(spun: tuple[Specimen, Motion, Sampled]) -> None:
    specimen, motion, exact = spun
    rows = limb_motion(specimen, differentiate_joint(specimen, motion)).wrench_rows[20:-20]
    parameters = mechanical_joint(
        "ball", 0.01, 0.0, 25, experiment=JointExperiment(seconds=0.1, trials=0)
    ).truth.parameters
    assert np.abs(rows @ parameters - exact.wrench[20:-20]).max() < 1e-2


def test_an_accelerated_base_is_as_gravity_the_other_way(
    spun: tuple[Specimen, Motion, Sampled],
) -> None:
    specimen, motion, _ = spun
    swung = differentiate_joint(specimen, motion)
    time = motion.time
    acceleration = np.array([0.3, -0.2, 0.5])
    turning = np.array([0.1, 0.2, -0.3])
    moves = np.hstack([0.5 * np.outer(time**2, acceleration), np.outer(time, turning)])
    base = differentiate(Motion(time, ("x", "y", "z", "a", "b", "c"), moves))
    moved = on_moving_base(specimen, limb_motion(specimen, swung), base)
    heavier = replace(specimen.model, gravity=specimen.model.gravity - acceleration)
    still = limb_motion(replace(specimen, model=heavier), swung)
    inside = slice(20, -20)
    assert moved.wrench_rows[inside] == pytest.approx(still.wrench_rows[inside], abs=1e-6)
    assert moved.torque_rows[inside] == pytest.approx(still.torque_rows[inside], abs=1e-6)
    against = still.rates - np.einsum("fji,j->fi", still.rotations, turning)
    assert moved.rates[inside] == pytest.approx(against[inside], abs=1e-6)


def test_same_as_angles_where_they_are_smooth(spun: tuple[Specimen, Motion, Sampled]) -> None:
    specimen, motion, _ = spun
    time = motion.time
    smooth = np.stack(
        [0.3 * np.sin(4.0 * time), 0.2 * np.cos(3.0 * time), 0.25 * np.sin(2.0 * time + 1.0)],
        axis=1,
    )
    plain = Motion(time, motion.names, smooth)
    ours = differentiate_joint(specimen, plain)
    angles = differentiate(plain)
    for name, tolerance in (("values", 1e-12), ("velocities", 1e-6), ("accelerations", 1e-3)):
        np.testing.assert_allclose(
            getattr(ours, name)[30:-30], getattr(angles, name)[30:-30], atol=tolerance
        )


def test_gaps_stay_gaps(spun: tuple[Specimen, Motion, Sampled]) -> None:
    specimen, motion, exact = spun
    values = motion.values.copy()
    values[300:340] = np.nan
    found = differentiate_joint(specimen, Motion(motion.time, motion.names, values), 10.0)
    assert np.array_equal(np.isnan(found.values).all(axis=1), np.isnan(values).all(axis=1))
    rates = limb_motion(specimen, found).rates
    assert np.nanmax(np.abs(rates - exact.rates)[400:-100]) < 1e-2


def test_length_of_a_quaternion_is_of_no_account() -> None:
    time = np.linspace(0.0, 1.0, 501)
    turn = Rotation.from_rotvec(np.outer(time, [0.3, 2.0, -1.0])).as_quat(scalar_first=True)
    grown = continuous(turn) * (1.0 + 0.5 * np.sin(time))[:, None]
    motion = differentiate(Motion(time, ("w", "x", "y", "z"), grown))
    assert motion.velocities is not None
    assert motion.accelerations is not None
    _, rates, gains = angular_motion(motion.values, motion.velocities, motion.accelerations)
    np.testing.assert_allclose(rates[20:-20], np.tile([0.3, 2.0, -1.0], (461, 1)), atol=1e-6)
    assert np.abs(gains[20:-20]).max() < 1e-3
