"""Passive torques of legs as measured: values by hand, signs, and that they take muscles' part."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.core.io.osim.read import read_osim
from myomorph.core.model.errors import BadData
from myomorph.core.model.functions import constant
from myomorph.core.model.model import Model
from myomorph.core.model.paths import PassiveTorque
from myomorph.core.model.series import Motion
from myomorph.core.muscles.joint_tissue import persons_legs, tissue_torques
from myomorph.core.rigid.dynamics import inverse_dynamics
from myomorph.core.rigid.leg_angles import leg_angles
from myomorph.core.rigid.tree import compile_tree
from myomorph.core.tension.solve import solve_tension
from myomorph.core.tension.tension import TensionOptions

RAJAGOPAL = "rajagopal-walk-emg/raw/Rajagopal2016.osim"


@pytest.fixture(scope="module")
def model(data) -> Model:
    return read_osim(data(RAJAGOPAL))


def torque(model: Model, tissue: str, coordinate: str, **angles: float) -> float:
    """Torque at a coordinate in a pose, in the model's sign [N m]; angles [degrees]."""
    tree = compile_tree(model)
    pose = tree.defaults[None].copy()
    for name, value in angles.items():
        pose[0, model.coordinate_names.index(name)] = np.radians(value)
    found = tissue_torques(tree, pose, tissue)
    return float(found[0, model.coordinate_names.index(coordinate)])


def test_torques_by_hand(model) -> None:
    """Of an extended hip, a straight knee and an ankle pushed up, from the printed equations."""
    hip = np.exp(1.4655 + 1.5) - np.exp(1.3403 - 0.61) + 8.072
    assert torque(model, "hips", "hip_flexion_r", hip_flexion_r=-20.0) == pytest.approx(hip)
    assert torque(model, "hips", "knee_angle_r", hip_flexion_r=-20.0) == 0.0
    knee = np.exp(1.8) + np.exp(2.22) - np.exp(-3.971) - 4.82
    assert torque(model, "legs", "knee_angle_r") == pytest.approx(knee)
    ankle = np.exp(-7.9763 - 1.949) - np.exp(2.1016 + 0.843) + 1.792
    assert torque(model, "legs", "ankle_angle_r", ankle_angle_r=10.0) == pytest.approx(ankle)


def test_tissue_pulls_back_at_the_ends_of_each_joint(model) -> None:
    assert torque(model, "legs", "hip_flexion_l", hip_flexion_l=-25.0) > 20.0
    assert torque(model, "legs", "hip_flexion_l", hip_flexion_l=115.0) < -20.0
    assert torque(model, "legs", "knee_angle_l", knee_angle_l=-5.0) > 10.0
    assert torque(model, "legs", "knee_angle_l", knee_angle_l=130.0) < -5.0
    assert torque(model, "legs", "ankle_angle_l", ankle_angle_l=25.0) < -40.0
    assert torque(model, "legs", "ankle_angle_l", ankle_angle_l=-35.0) > 0.5
    # A bent knee slackens the calf.
    bent = torque(model, "legs", "ankle_angle_l", ankle_angle_l=25.0, knee_angle_l=60.0)
    assert bent > 0.5 * torque(model, "legs", "ankle_angle_l", ankle_angle_l=25.0)


def test_a_knee_that_counts_below_zero_has_the_same_torque(data, model) -> None:
    other = read_osim(data("walk-so-jointload-emg/Rajagopal_scaled_Sub1_gasAvoid.osim"))
    signs = {leg.knee.sign for each in (model, other) for leg in leg_angles(each)}
    for each in (model, other):
        for leg in persons_legs(each):
            name = each.coordinate_names[leg.knee.coordinate]
            bent = {name: 100.0 * leg.knee.sign}
            assert leg.knee.sign * torque(each, "legs", name, **bent) < 0.0
    assert signs <= {-1.0, 1.0}


def test_a_torque_that_the_model_has_is_not_added_to(model) -> None:
    own = PassiveTorque(
        name="own", coordinate="hip_flexion_r", torque=constant(0.0), damping=constant(0.0)
    )
    has = replace(model, passive_torques=(own,))
    assert torque(has, "hips", "hip_flexion_r", hip_flexion_r=-20.0) == 0.0
    assert torque(has, "hips", "hip_flexion_l", hip_flexion_l=-20.0) > 10.0


def test_no_tissue_without_legs_or_twice(arm) -> None:
    tree = compile_tree(read_osim(arm.model))
    assert not tissue_torques(tree, tree.defaults[None], "none").any()
    with pytest.raises(BadData, match="has no human leg"):
        tissue_torques(tree, tree.defaults[None], "hips")
    with pytest.raises(BadData, match="these are part of it"):
        TensionOptions(joint_tissue="hips", passive=True)


def test_what_tissue_gives_is_taken_off_the_torques(model) -> None:
    """A leg that hangs behind the body, with the tissue and with its torques left out by hand."""
    names = ("hip_flexion_r",)
    still = np.full((2, 1), np.radians(-20.0))
    none = np.zeros_like(still)
    motion = Motion(np.arange(2) * 0.01, names, still, velocities=none, accelerations=none)
    torques = inverse_dynamics(model, motion)
    tree = compile_tree(model)
    tissue = tissue_torques(tree, tree.coordinates_of(motion), "legs")
    order = [model.coordinate_names.index(name) for name in torques.names]
    less = replace(torques, values=torques.values - tissue[:, order])
    with_tissue = solve_tension(model, motion, torques, TensionOptions(joint_tissue="legs"))
    by_hand = solve_tension(model, motion, less)
    plain = solve_tension(model, motion, torques)
    assert with_tissue.optimal.all()
    np.testing.assert_allclose(with_tissue.muscle_force, by_hand.muscle_force, atol=1e-3)
    assert np.abs(with_tissue.muscle_force - plain.muscle_force).max() > 10.0
