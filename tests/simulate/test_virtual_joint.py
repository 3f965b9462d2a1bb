"""The virtual mechanical joint obeys the laws of mechanics.

Its recordings have the stated errors.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import mujoco
import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from myomorph.core.model.errors import BadData
from myomorph.core.model.inertia import inertia_matrices, pseudo_inertias
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from myomorph.swings.simulate.laboratory import Noise, simulate
from truths.mechanical_joint import (
    CENTER,
    GRAVITY,
    JointExperiment,
    VirtualJoint,
    mechanical_joint,
    on_true_clock,
)

QUIET = Noise(marker=0.0, force=0.0)
CASES = [("hinge", 0.05, 0.0), ("hinge", 0.3, 5.0), ("ball", 0.05, 0.0), ("ball", 0.3, 5.0)]


@pytest.fixture(scope="module", params=CASES, ids=str)
def joint(request: pytest.FixtureRequest) -> VirtualJoint:
    kind, damping, stiffness = request.param
    return mechanical_joint(
        kind,
        damping,
        stiffness,
        seed=3,
        experiment=JointExperiment(seconds=3.0, trials=1, noise=QUIET),
    )


def test_newton_euler(joint: VirtualJoint) -> None:
    (swing,) = joint.exact_swings()
    assert np.abs(swing.wrench_rows @ joint.truth.parameters - swing.wrench).max() < 1e-10


def test_force_is_the_change_of_momentum(joint: VirtualJoint) -> None:
    exact = joint.trials[0].exact
    truth = joint.truth
    places = np.einsum("fij,j->fi", exact.rotations, truth.mass_center)
    force = truth.mass * (CubicSpline(exact.time, places).derivative(2)(exact.time) - GRAVITY)
    assert np.abs(force - exact.wrench[:, 3:])[5:-5].max() < 5e-3


def test_passive_torque_is_damper_and_spring(joint: VirtualJoint) -> None:
    (swing,) = joint.exact_swings()
    torque = swing.torque_rows @ joint.truth.parameters
    assert np.abs(torque - joint.truth.passive_torque(swing.angles, swing.rates)).max() < 1e-10


def test_energy_goes_into_the_damper(joint: VirtualJoint) -> None:
    (swing,) = joint.exact_swings(1.0 / (joint.trials[0].exact.time[1]))
    truth = joint.truth
    spatial = joint.trials[0].exact.rates
    inertia = inertia_matrices(truth.parameters)
    kinetic = 0.5 * np.einsum("fi,ij,fj->f", spatial, inertia, spatial)
    places = np.einsum("fij,j->fi", swing.rotations, truth.parameters[1:4])
    energy = kinetic - places @ GRAVITY + 0.5 * truth.stiffness * np.sum(swing.angles**2, axis=1)
    power = CubicSpline(swing.time, truth.damping * np.sum(swing.rates**2, axis=1))
    lost = power.antiderivative()(swing.time)
    assert lost[-1] > 0.05
    np.testing.assert_allclose(energy[0] - energy, lost, atol=1e-5 * lost[-1])


def test_half_the_step_changes_nothing(joint: VirtualJoint) -> None:
    compiled = mujoco.MjModel.from_xml_string(joint.mjcf)
    exact = joint.trials[0].exact
    step = float(exact.time[1])
    first = Rotation.from_matrix(exact.rotations[0])
    along = joint.truth.directions
    start = first.as_quat(scalar_first=True) if len(along) == 3 else along @ first.as_rotvec()
    finer = simulate(compiled, start, along @ exact.rates[0], 3.0, 0.5 * step).every(2)
    apart = Rotation.from_matrix(np.swapaxes(finer.rotations, 1, 2) @ exact.rotations).magnitude()
    assert apart.max() < 1e-5
    assert np.abs(finer.rates - exact.rates).max() < 1e-4


def test_markers_lie_on_the_limb_and_the_plate_feels_its_wrench(joint: VirtualJoint) -> None:
    trial = joint.trials[0]
    exact = joint.trials[0].exact
    every = round(0.005 / exact.time[1])
    seen = trial.markers["limb_3"] - CENTER
    expected = exact.rotations[::every] @ joint.places["limb_3"]
    assert np.abs(seen - expected).max() < 1e-12
    moment = trial.wrenches.torques[:, 0] + np.cross(
        trial.wrenches.points[:, 0] - CENTER, trial.wrenches.forces[:, 0]
    )
    at_samples = CubicSpline(exact.time, exact.wrench)(trial.wrenches.time)
    assert np.abs(np.hstack([moment, trial.wrenches.forces[:, 0]]) - at_samples).max() < 1e-9


def test_model_has_the_joint_and_its_markers(joint: VirtualJoint) -> None:
    model = joint.model
    assert len(model.markers) == 9
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.defaults[None])
    assert poses.origins[0, tree.body_index["limb"]] == pytest.approx(CENTER)


def test_limb_is_a_physical_body_that_hangs() -> None:
    for seed in range(20):
        truth = mechanical_joint(
            "ball", 0.1, 0.0, seed, experiment=JointExperiment(seconds=0.1, trials=0)
        ).truth
        assert np.linalg.eigvalsh(pseudo_inertias(truth.parameters)).min() > 0.0
        assert truth.mass_center == pytest.approx([0.0, 0.0, -truth.com], abs=1e-12)
        assert 1.7 < truth.mass < 2.5
        assert 0.2 < truth.com < 0.4


def test_noise_and_clock_are_as_stated() -> None:
    noise = Noise(marker=4e-4, force=0.5, lever=0.1, offset=0.02, drift=1e-4)
    hinge = partial(mechanical_joint, "hinge", 0.1, 1.0, 1)
    usual = JointExperiment(seconds=8.0, trials=1, noise=noise)
    quiet = replace(usual, noise=Noise(0.0, 0.0, offset=0.02, drift=1e-4))
    loud = hinge(experiment=usual).trials[0]
    still = hinge(experiment=quiet).trials[0]
    assert np.std(loud.markers.values - still.markers.values) == pytest.approx(4e-4, rel=0.03)
    assert np.std(loud.wrenches.forces - still.wrenches.forces) == pytest.approx(0.5, rel=0.03)
    assert np.std(loud.wrenches.torques - still.wrenches.torques) == pytest.approx(0.05, rel=0.03)
    true = on_true_clock(still.wrenches, noise)
    force = CubicSpline(still.exact.time, still.exact.wrench[:, 3:])(true.time)
    assert np.abs(force - still.wrenches.forces[:, 0]).max() < 1e-9
    assert still.wrenches.time[0] == pytest.approx(0.02, abs=6e-4)


def test_noisy_swings_are_near_the_truth() -> None:
    joint = mechanical_joint("ball", 0.1, 0.0, 5, experiment=JointExperiment(seconds=5.0, trials=1))
    (noisy,) = joint.swings(6.0)
    (exact,) = joint.exact_swings()
    used = noisy.used
    assert 0.8 < used.mean() < 1.0
    assert np.abs(noisy.rates - exact.rates)[used].max() < 0.05
    assert np.sqrt(np.mean((noisy.wrench - exact.wrench)[used] ** 2, axis=0)).max() < 0.1


def test_spring_pulls_towards_its_rest() -> None:
    joint = mechanical_joint(
        "hinge",
        0.2,
        4.0,
        2,
        experiment=JointExperiment(seconds=2.0, trials=1, rest=[0.3], noise=QUIET),
    )
    (swing,) = joint.exact_swings()
    torque = swing.torque_rows @ joint.truth.parameters
    assert np.abs(torque - (-0.2 * swing.rates - 4.0 * (swing.angles - 0.3))).max() < 1e-10


def test_bad_joints_are_refused() -> None:
    with pytest.raises(BadData, match="'hinge' or 'ball'"):
        mechanical_joint("slide", 0.1, 0.0)  # type: ignore[arg-type]
    with pytest.raises(BadData, match="negative"):
        mechanical_joint("ball", -0.1, 0.0)
