"""Virtual specimens agree with the tables, and their muscles move as ours.

Their files hold the same values as they do.
"""

from __future__ import annotations

import tomllib
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from myomorph.core.io.mjcf.read import read_mjcf
from myomorph.core.io.sto import read_sto
from myomorph.core.io.trc import read_trc
from myomorph.core.model.errors import BadData, BadModel
from myomorph.core.model.inertia import inertia_matrices, pseudo_inertias
from myomorph.core.model.paths import Path as MusclePath
from myomorph.core.model.paths import PathWrap
from myomorph.core.model.series import Motion
from myomorph.core.muscles.kinematics import muscle_kinematics
from myomorph.swings.simulate.laboratory import Noise, Sampled, write_recording
from myomorph.swings.simulate.limb import HeldLimb, specimen_mjcf, tendon_wraps, with_scaled_muscles
from myomorph.swings.simulate.shoulder import (
    BASE,
    FIRST,
    FURTHER,
    HELD,
    Setup,
    VirtualSpecimen,
    arm_model,
    arm_specimen,
    virtual_specimen,
)
from myomorph.swings.viscosity.cohort import SPECIMENS
from myomorph.swings.viscosity.specimen.model import Specimen, SpecimenNames, build_specimen
from myomorph.swings.viscosity.specimen.muscles import fig1_muscles

pytest.importorskip("myo_sim")


@pytest.fixture(scope="module")
def made() -> VirtualSpecimen:
    return virtual_specimen(2, seconds=4.0, trials=2)


def held(specimen: Specimen, exact: Sampled) -> Motion:
    """Coordinates and speeds of a simulated swing."""
    joint = next(one for one in specimen.model.joints if one.child == FIRST)
    axes = np.array([axis.vector for axis in joint.axes])
    order = "".join("XYZ"[int(np.argmax(np.abs(axis)))] for axis in axes)
    start = specimen.stand.rotation @ joint.parent_frame.rotation
    angles = Rotation.from_matrix(start.T @ exact.rotations).as_euler(order)
    speeds = np.empty_like(angles)
    for row, one, rates in zip(speeds, angles, exact.rates, strict=True):
        last = Rotation.from_rotvec(one[2] * axes[2]).as_matrix()
        middle = Rotation.from_rotvec(one[1] * axes[1]).as_matrix()
        row[:] = np.linalg.solve(
            np.column_stack([last.T @ middle.T @ axes[0], last.T @ axes[1], axes[2]]), rates
        )
    wires = np.tile(list(HELD.values()), (len(angles), 1))
    names = (*specimen.joint_coordinates, *HELD)
    return Motion(
        time=exact.time,
        names=names,
        values=np.hstack([angles, wires]),
        velocities=np.hstack([speeds, np.zeros_like(wires)]),
    )


def _lengthening(specimen: Specimen, motion: Motion) -> np.ndarray:
    speeds = muscle_kinematics(specimen.model, motion, moment_arms=False).muscle_velocity
    assert speeds is not None
    return speeds


@pytest.mark.parametrize("number", range(1, 7))
def test_limbs_hold_both_tables_and_are_physical(number: int) -> None:
    row = SPECIMENS[number - 1]
    limb = HeldLimb(arm_specimen(), HELD)
    bare = limb.parameters(row.mass_muscles_removed, row.com_muscles_removed)
    whole = limb.with_muscle_mass(bare, row.mass_intact, row.com_intact)
    for parameters, mass, com in (
        (bare, row.mass_muscles_removed, row.com_muscles_removed),
        (whole, row.mass_intact, row.com_intact),
    ):
        assert parameters[0] == pytest.approx(mass)
        assert np.linalg.norm(parameters[1:4]) / mass == pytest.approx(com)
        assert np.linalg.eigvalsh(pseudo_inertias(parameters)).min() > 0.0
    assert np.linalg.eigvalsh(pseudo_inertias(whole - bare)).min() > 0.0


def test_specimen_holds_tables_one_and_two_together(made: VirtualSpecimen) -> None:
    row = made.published
    assert made.joint_viscosity == row.joint_viscosity
    assert made.muscle_viscosity == row.muscle_viscosity
    assert made.intact.viscosity == pytest.approx(row.total_viscosity, rel=1e-4)
    assert made.factor < 0.3
    implied = (row.total_viscosity - row.joint_viscosity) / row.muscle_viscosity / 11
    assert made.moment_arm == pytest.approx(np.sqrt(implied), rel=1e-3)


def test_total_viscosity_is_that_of_the_torque(made: VirtualSpecimen) -> None:
    work = energy = 0.0
    for trial in made.intact.trials:
        exact = trial.exact
        inertia = inertia_matrices(made.intact.parameters)
        first = made.intact.parameters[1:4]
        weight = np.einsum("fji,j->fi", exact.rotations, arm_model().gravity)
        torque = (
            exact.accelerations @ inertia
            + np.cross(exact.rates, exact.rates @ inertia)
            - np.cross(first, weight)
        )
        work -= float(np.sum(torque * exact.rates))
        energy += float(np.sum(exact.rates**2))
    assert work / energy == pytest.approx(made.intact.viscosity, rel=1e-9)


def test_tendons_lengthen_as_our_paths(made: VirtualSpecimen) -> None:
    exact = made.intact.trials[0].exact.every(40)
    ours = _lengthening(made.specimen, held(made.specimen, exact))
    assert np.abs(exact.lengthening).max() > 5e-3
    np.testing.assert_allclose(ours, exact.lengthening, atol=1e-12)


def test_muscles_scale_exactly_about_the_joint(made: VirtualSpecimen) -> None:
    motion = held(made.specimen, made.intact.trials[1].exact.every(40))
    third = with_scaled_muscles(HeldLimb(made.specimen, HELD), 1.0 / 3.0)
    np.testing.assert_allclose(
        _lengthening(third, motion), _lengthening(made.specimen, motion) / 3.0, atol=1e-13
    )


def test_wrench_on_the_base_holds_what_tendons_pull(made: VirtualSpecimen) -> None:
    exact = made.intact.trials[0].exact
    center = made.intact.parameters[1:4]
    turned = np.cross(exact.accelerations, center) + np.cross(
        exact.rates, np.cross(exact.rates, center)
    )
    force = np.einsum("fij,fj->fi", exact.rotations, turned) - made.intact.mass * np.asarray(
        arm_model().gravity
    )
    np.testing.assert_allclose(exact.wrench[:, 3:], force, atol=1e-9)


def test_muscles_of_full_size_need_less_viscosity() -> None:
    made = virtual_specimen(1, seconds=3.0, trials=1, setup=Setup(full_size=True))
    assert made.factor == 1.0
    assert made.muscle_viscosity < 0.1 * made.published.muscle_viscosity
    assert made.intact.viscosity == pytest.approx(made.published.total_viscosity, rel=1e-3)


def test_clocks_differ_and_noise_is_as_stated(made: VirtualSpecimen) -> None:
    assert abs(made.noise.offset) > 1e-3
    assert made.noise.drift != 0.0
    still = virtual_specimen(2, seconds=1.0, trials=1, setup=Setup(noise=Noise(0.0, 0.0)))
    base = still.without.trials[0].markers.values[:, :3]
    assert np.ptp(base, axis=0).max() == 0.0
    noise = made.without.trials[0].markers.values[:, :3]
    assert np.std(noise - noise.mean(axis=0)) == pytest.approx(3e-4, rel=0.05)


def test_files_say_what_the_specimen_is(made: VirtualSpecimen, tmp_path) -> None:
    (tmp_path / "model.xml").write_text(specimen_mjcf(made.specimen))
    names = [one.name for one in made.specimen.model.markers]
    model = read_mjcf(tmp_path / "model.xml", marker_sites="|".join(names))
    read = build_specimen(
        model, SpecimenNames(base=BASE, first=FIRST, bones=FURTHER, muscles=fig1_muscles(model))
    )
    assert [one.name for one in model.markers] == names
    np.testing.assert_allclose(read.center, made.specimen.center, atol=1e-12)
    exact = made.intact.trials[0].exact.every(40)
    np.testing.assert_allclose(_lengthening(read, held(read, exact)), exact.lengthening, atol=1e-12)
    trial = made.without.trials[0]
    write_recording(trial, tmp_path / "swing")
    markers = read_trc(tmp_path / "swing.trc").markers
    assert markers is not None
    np.testing.assert_allclose(markers.values, trial.markers.values, atol=1e-6)
    forces = read_sto(tmp_path / "swing.mot")
    assert len(forces.names) == 9
    np.testing.assert_allclose(forces.values[:, :3], trial.wrenches.forces[:, 0], atol=1e-3)
    np.testing.assert_allclose(forces.time, trial.wrenches.time, atol=1e-9)


def test_example_study_is_written_and_read(tmp_path) -> None:
    from myomorph.swings.demo import ShoulderStudyOptions, write_shoulder_study
    from myomorph.swings.viscosity.study.plan import read_viscosity_plan

    path = write_shoulder_study(
        tmp_path / "here", (3,), ShoulderStudyOptions(seconds=1.0, trials=1)
    )
    raw = tomllib.loads(path.read_text())
    assert raw["specimen"][0]["truth"]["muscle_viscosity"] == 362.0
    plan = read_viscosity_plan(path)
    (one,) = plan.specimens
    assert [len(one.without), len(one.intact)] == [1, 1]
    assert one.paper["joint_viscosity"] == 5.8e-2
    assert "nobody was measured" in plan.simulated[0]


def test_what_cannot_be_is_refused(made: VirtualSpecimen) -> None:
    with pytest.raises(BadData, match="1 to 6"):
        virtual_specimen(7)
    with pytest.raises(BadModel, match="mass center"):
        HeldLimb(made.specimen, HELD).parameters(2.0, 0.7)
    muscle = made.specimen.model.muscles[0]
    opensim = MusclePath(muscle.path.points, (PathWrap("ball"),))

    with pytest.raises(BadModel, match="as in OpenSim"):
        tendon_wraps(replace(muscle, path=opensim))
