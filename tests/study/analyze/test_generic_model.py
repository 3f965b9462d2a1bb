"""The generic model: markers by landmark, and muscle paths in OpenSim's form."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.model.series import Motion
from myomorph.core.motion.ik import KinematicsFit
from myomorph.core.motion.pose_checks import turned_findings
from myomorph.core.motion.protocols import protocols
from myomorph.core.motion.turns import floating_coordinates
from myomorph.core.muscles.model_paths import compile_paths
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from myomorph.lab.analyze.generic_model import (
    generic_model,
    in_opensim_form,
    legs_and_trunk,
    placed,
)

pytest.importorskip("myo_sim")


def test_left_markers_are_mirror_images_of_right_ones() -> None:
    labels = protocols().protocols["plug_in_gait"].labels
    markers = {one.name: one for one in placed(labels)[0]}
    for name, one in markers.items():
        if name.startswith("R") and f"L{name[1:]}" in markers:
            other = markers[f"L{name[1:]}"]
            np.testing.assert_allclose(other.location, one.location * (1.0, 1.0, -1.0))
            assert other.body == one.body.replace("_r", "_l")


@pytest.mark.parametrize("name", list(protocols().protocols))
def test_every_protocol_shows_pelvis_and_legs_or_an_arm_and_the_trunk(name: str) -> None:
    labels = protocols().protocols[name].labels
    if not any(site.segment == "thigh" for site in labels.values()):
        model, without = generic_model(labels, arms=True, alone=True)
        assert {"torso", "humerus_r", "ulna_r", "radius_r"} <= {one.body for one in model.markers}
        assert not without
        return
    model, without = generic_model(labels)
    bodies = {one.body for one in model.markers}
    for side in "rl":
        assert {"pelvis", f"femur_{side}", f"tibia_{side}", f"calcn_{side}"} <= bodies
    assert {protocols().protocols[name].labels[label].segment for label in without} <= {
        "head",
        "scapula",
        "upper_arm",
        "forearm",
        "hand",
    }


def test_no_joint_of_the_leg_turns_over() -> None:
    """Ankle and subtalar joint, both free, went once around together in a walk.

    The torque at the hip was 125 N m for 30.
    """
    model, _ = generic_model(protocols().protocols["plug_in_gait"].labels)
    floating = floating_coordinates(model)
    for one in model.coordinates:
        if (
            one.motion == "rotational"
            and one.name not in floating
            and one.name not in model.dependent_coordinates
        ):
            assert one.locked or (one.clamped and one.range[1] - one.range[0] < np.pi + 0.1)


def test_what_follows_a_knee_has_no_bounds_of_its_own() -> None:
    """OpenSim assembled no model whose patella stood at its bound where the knee does."""
    model, _ = generic_model(protocols().protocols["plug_in_gait"].labels)
    assert model.dependent_coordinates
    assert not any(model.coordinate(name).clamped for name in model.dependent_coordinates)


def test_a_joint_that_turned_over_is_named() -> None:
    model, _ = generic_model(protocols().protocols["plug_in_gait"].labels)
    values = np.zeros((5, len(model.coordinates)))
    values[3:, model.coordinate_names.index("ankle_angle_l")] = np.radians(380.0)
    fit = KinematicsFit(
        motion=Motion(0.01 * np.arange(5.0), model.coordinate_names, values),
        marker_names=(),
        marker_error=np.zeros((5, 0)),
        marker_weight=np.zeros(0),
        converged=np.ones(5, bool),
        iterations=np.zeros(5, int),
        unused_markers=(),
        missing_markers=(),
    )
    (found,) = turned_findings(model, fit)
    assert found.place == "ankle_angle_l"
    assert found.times == ((0.03, 0.04),)
    assert "2 of 5 frames from 0.03 s" in found.text


def test_paths_in_opensims_form_have_mujocos_lengths() -> None:
    """Lengths agree within 0.3 mm over postures of walking.

    Surfaces choose their side otherwise.
    """
    model = legs_and_trunk()
    ours = compile_paths(in_opensim_form(model))
    theirs = compile_paths(model)
    random = np.random.default_rng(0)
    values = np.tile(theirs.tree.defaults, (12, 1))
    for side in "rl":
        for joint, low, high in (
            ("hip_flexion", -0.3, 0.8),
            ("hip_adduction", -0.2, 0.2),
            ("knee_angle", 0.05, 1.1),
            ("ankle_angle", -0.3, 0.3),
        ):
            values[:, model.coordinate_names.index(f"{joint}_{side}")] = random.uniform(
                low, high, 12
            )
    np.testing.assert_allclose(ours.evaluate(values)[0], theirs.evaluate(values)[0], atol=3e-4)


def test_joints_and_the_trunk_have_the_names_of_the_field() -> None:
    model = legs_and_trunk()
    names = {joint.name: joint.child for joint in model.joints}
    for joint, child in (
        ("hip", "femur"),
        ("knee", "tibia"),
        ("ankle", "talus"),
        ("subtalar", "calcn"),
    ):
        assert all(names[f"{joint}_{side}"] == f"{child}_{side}" for side in "rl")
    assert names["back"] == "lumbar5"
    assert {"lumbar_extension", "lumbar_bending", "lumbar_rotation"} <= set(model.coordinate_names)


@pytest.mark.parametrize(
    ("coordinate", "axis"), [("lumbar_extension", 2), ("lumbar_bending", 0), ("lumbar_rotation", 1)]
)
def test_the_trunk_turns_as_in_rajagopals_model(coordinate: str, axis: int) -> None:
    """OpenSim's lumbar coordinates.

    About z backwards, about x to the right and about y to the left, each positive.
    """
    model = legs_and_trunk()
    tree = compile_tree(model)
    values = np.array([tree.defaults, tree.defaults])
    values[1, model.coordinate_names.index(coordinate)] += 0.2
    rest, turned = forward_kinematics(tree, values).rotations[:, tree.body_index["torso"]]
    change = turned @ rest.T
    vector = (
        np.array(
            [change[2, 1] - change[1, 2], change[0, 2] - change[2, 0], change[1, 0] - change[0, 1]]
        )
        / 2.0
    )
    # Where the pelvis stands, myo-sim's axis is off by 0.0008 rad.
    np.testing.assert_allclose(vector, np.sin(0.2) * np.eye(3)[axis], atol=2e-4)
