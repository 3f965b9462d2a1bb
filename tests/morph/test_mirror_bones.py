"""Bones of one side for both, on a real model that has both sides."""

from __future__ import annotations

import numpy as np
import pytest
from given_maps import given

from myomorph.bones.morph.mirror.model import with_mirrored_bones
from myomorph.bones.morph.transfer.model import morph_model
from myomorph.core.io.formats import read_model
from myomorph.core.model.series import Motion
from myomorph.core.model.spatial import rotation_from_euler_xyz
from myomorph.core.model.surface import Surface
from myomorph.core.muscles.kinematics import muscle_kinematics

FLIP = np.diag([1.0, 1.0, -1.0])
MATRIX = rotation_from_euler_xyz((0.3, -0.2, 0.5)) @ np.diag([1.1, 0.9, 1.05])
OFFSET = np.array([0.02, -0.01, 0.03])
SIDED = ("femur", "tibia", "talus", "calcn", "toes")


@pytest.fixture
def model(data):
    return read_model(data("ceinms-emg-walk/model/gait2392.osim"))


@pytest.fixture
def right():
    return {f"{name}_r": given(f"{name}_r", MATRIX, OFFSET) for name in SIDED}


def test_a_mirrored_map_is_the_map_seen_in_two_mirrors(model, right):
    left = with_mirrored_bones(model, right, {})["femur_l"]
    points = np.random.default_rng(0).normal(scale=0.2, size=(20, 3))
    np.testing.assert_allclose(
        left.map.apply(points), (points @ FLIP @ MATRIX.T + OFFSET) @ FLIP, atol=1e-15
    )
    np.testing.assert_allclose(
        left.map.jacobian(points), np.tile(FLIP @ MATRIX @ FLIP, (20, 1, 1)), atol=1e-15
    )
    whole = right["femur_r"].whole
    np.testing.assert_allclose(
        left.whole.apply(points), whole.apply(points @ FLIP) @ FLIP, atol=1e-14
    )
    assert np.linalg.det(left.whole.rotation) == pytest.approx(1.0)


def test_a_bone_that_is_given_is_not_replaced(model, right):
    own = given("tibia_l", np.eye(3), np.zeros(3))
    assert with_mirrored_bones(model, right | {"tibia_l": own}, {})["tibia_l"] is own


def test_left_muscles_are_the_right_ones_mirrored(model, right):
    bones = {"pelvis": given("pelvis", 1.1 * np.eye(3), np.zeros(3))} | right
    morphed = morph_model(model, with_mirrored_bones(model, bones, {})).model
    rng = np.random.default_rng(1)
    values = np.zeros((5, len(morphed.coordinates)))
    for j, name in enumerate(morphed.coordinate_names):
        if name.endswith("_r"):
            other = morphed.coordinate_names.index(f"{name[:-2]}_l")
            values[:, j] = values[:, other] = np.clip(
                rng.normal(scale=0.3, size=5), *morphed.coordinates[j].range
            )
    motion = Motion(np.arange(5.0), morphed.coordinate_names, values)
    lengths = muscle_kinematics(morphed, motion, velocities=False, moment_arms=False).muscle_length
    names = morphed.muscle_names
    pairs = [(i, names.index(f"{one[:-2]}_l")) for i, one in enumerate(names) if one.endswith("_r")]
    ours, theirs = np.array(pairs).T
    np.testing.assert_allclose(lengths[:, ours], lengths[:, theirs], atol=1e-9)


def test_bones_in_one_scan_are_mirrored_across_the_pelvis(model, right):
    turn = rotation_from_euler_xyz((0.1, 0.4, -0.3))
    pelvis = given("pelvis", turn, np.array([0.5, 0.2, 0.1]))
    found = with_mirrored_bones(model, right | {"pelvis": pelvis}, {}, together=True)["femur_l"]
    normal = turn @ [0.0, 0.0, 1.0]
    mirror = np.eye(3) - 2.0 * np.outer(normal, normal)
    shift = 2.0 * (np.array([0.5, 0.2, 0.1]) @ normal) * normal
    points = np.random.default_rng(0).normal(scale=0.2, size=(20, 3))
    expected = right["femur_r"].map.apply(points @ FLIP) @ mirror.T + shift
    np.testing.assert_allclose(found.map.apply(points), expected, atol=1e-14)


def test_a_source_whose_sides_differ_is_told(model, right):
    rng = np.random.default_rng(2)
    ours = Surface(rng.normal(size=(30, 3)), np.arange(30).reshape(-1, 3))
    same = Surface(ours.vertices @ FLIP, ours.faces)
    assert (
        len(with_mirrored_bones(model, right, {"femur_r": ours, "femur_l": same})["femur_l"].notes)
        == 1
    )
    other = Surface(ours.vertices, ours.faces)
    notes = with_mirrored_bones(model, right, {"femur_r": ours, "femur_l": other})["femur_l"].notes
    assert any("give the bone itself" in note for note in notes)
