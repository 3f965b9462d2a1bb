"""The other side of a model: nothing about its muscles changes but the side."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from myomorph.bones.morph.mirror.model import mirrored, mirrored_motion, with_other_side
from myomorph.bones.morph.mirror.sides import Reflection, backwards, flip, other_side_of
from myomorph.core.io.formats import read_model
from myomorph.core.io.osim.read import read_osim
from myomorph.core.io.osim.write import write_osim
from myomorph.core.model.errors import BadModel, UnknownName
from myomorph.core.model.functions import SineProduct, piecewise_linear, simm_spline
from myomorph.core.model.series import Motion
from myomorph.core.model.sides import other_side, split_side
from myomorph.core.model.spatial import Transform, axis_rotation
from myomorph.core.muscles.kinematics import muscle_kinematics
from myomorph.core.rigid.kinematics import forward_kinematics, standing_poses
from myomorph.core.rigid.tree import compile_tree

OSIM = (
    "ceinms-emg-walk/model/gait2392.osim",
    "rajagopal-walk-emg/raw/Rajagopal2016.osim",
    "shoulder-thoracoscapular/model_cmc/TSM_subject_CMC_noWeight.osim",
    "c3d-functional-joints/models/Wu_Shoulder_Model_via_points.osim",
    "opensim-reference-small/arm26_bounds.osim",
    "lenhart-knee-contact-walk/lenhart2015.osim",
)


def moved(model, frames=12, seed=0):
    rng = np.random.default_rng(seed)
    low = np.array([max(one.range[0], -1.0) for one in model.coordinates])
    high = np.maximum(low, [min(one.range[1], 1.0) for one in model.coordinates])
    return Motion(
        np.arange(frames) * 0.01,
        model.coordinate_names,
        low + (high - low) * rng.random((frames, len(low))),
    )


def centers(model, motion):
    """(frames, bodies, 3) mass centers of the bodies in ground."""
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.coordinates_of(motion))
    numbers = np.array([tree.body_index[one.name] for one in model.bodies])
    return poses.points(numbers, np.array([one.mass_center for one in model.bodies]))


def differences(model, axis):
    """Largest differences of lengths [m] and moment arms [m] of a model and its mirror image."""
    other = mirrored(model, axis)
    motion = moved(model)
    side = other_side_of(model, axis)
    one = muscle_kinematics(model, motion, velocities=False)
    two = muscle_kinematics(other, mirrored_motion(model, motion, axis), velocities=False)
    rows = [two.muscles.index(side.named("muscles", name)) for name in one.muscles]
    columns = [two.coordinates.index(side.named("coordinates", name)) for name in one.coordinates]
    arms = two.moment_arm[:, rows][:, :, columns] * np.array(side.of(one.coordinates))
    return abs(two.muscle_length[:, rows] - one.muscle_length).max(), abs(
        arms - one.moment_arm
    ).max()


@pytest.mark.parametrize("name", OSIM)
def test_lengths_and_moment_arms_are_those_of_the_given_side(name, data):
    lengths, arms = differences(read_model(data(name)), "z")
    assert lengths < 1e-12
    assert arms < 1e-12


def test_a_mouse_has_two_legs(data):
    data("mouse-hindlimb-muscles")
    sys.path.insert(0, str(Path(__file__).parents[2]))
    from truths.mouse_hindlimb import mouse_hindlimb_model

    model = mouse_hindlimb_model()
    assert max(differences(model, "z")) < 1e-12
    whole = with_other_side(model)
    assert whole.body_names[: len(model.bodies)] == model.body_names
    assert whole.coordinate_names[: len(model.coordinates)] == model.coordinate_names
    assert len(whole.muscles) == 2 * len(model.muscles)
    assert whole.body("Pelvis").mass == model.body("Pelvis").mass
    both = mirrored(whole)
    assert both.body_names == whole.body_names
    assert both.muscle_names == whole.muscle_names
    motion = moved(whole)
    there = centers(whole, motion) * (1.0, 1.0, -1.0)
    here = centers(both, mirrored_motion(whole, motion))
    order = [
        whole.body_names.index(other_side_of(whole).named("bodies", name))
        for name in whole.body_names
    ]
    np.testing.assert_allclose(here[:, order], there, atol=1e-12)


def test_in_mujoco_with_a_tilted_frame(data):
    pytest.importorskip("mujoco")
    sim = pytest.importorskip("myo_sim")
    from myomorph.core.io.mjcf.read import model_from_mujoco

    model = model_from_mujoco(sim.load_model("myolegs26"))
    lengths, arms = differences(model, "x")
    assert lengths < 1e-12
    assert arms < 1e-12
    with pytest.raises(BadModel, match="face each other along x, not along"):
        mirrored(model, "z")


@pytest.mark.parametrize("name", OSIM)
def test_twice_mirrored_is_the_model(name, data):
    model = read_model(data(name))
    twice = mirrored(mirrored(model))
    assert [one.name for one in twice.joints] == [one.name for one in model.joints]
    for one, two in zip(model.bodies, twice.bodies, strict=True):
        np.testing.assert_allclose(two.mass_center, one.mass_center, atol=1e-15)
        np.testing.assert_allclose(two.inertia, one.inertia, atol=1e-15)
    for one, two in zip(model.joints, twice.joints, strict=True):
        assert (two.kind, two.parent, two.child, two.coordinates) == (
            one.kind,
            one.parent,
            one.child,
            one.coordinates,
        )
        for end in ("parent_frame", "child_frame"):
            np.testing.assert_allclose(
                getattr(two, end).rotation, getattr(one, end).rotation, atol=1e-15
            )
            np.testing.assert_allclose(
                getattr(two, end).translation, getattr(one, end).translation, atol=1e-15
            )
        for here, there in zip(one.axes, two.axes, strict=True):
            np.testing.assert_allclose(there.vector, here.vector, atol=1e-15)
    for one, two in zip(model.coordinates, twice.coordinates, strict=True):
        assert (two.name, two.default, two.range) == (one.name, one.default, one.range)
    for one, two in zip(model.wrap_objects, twice.wrap_objects, strict=True):
        assert (two.name, two.quadrant, two.size) == (one.name, one.quadrant, one.size)
        np.testing.assert_allclose(two.pose.rotation, one.pose.rotation, atol=1e-15)


def test_the_other_leg_of_a_real_model(data):
    model = read_model(data("ceinms-emg-walk/model/gait2392.osim"))
    rest = Motion(
        np.zeros(1), model.coordinate_names, np.array([[one.default for one in model.coordinates]])
    )
    kept = dict(
        zip(
            model.muscle_names,
            muscle_kinematics(model, rest, False, False).muscle_length[0],
            strict=True,
        )
    )
    other = mirrored(model)
    made = dict(
        zip(
            other.muscle_names,
            muscle_kinematics(other, rest, False, False).muscle_length[0],
            strict=True,
        )
    )
    assert max(abs(made[name] - kept[name]) for name in kept) < 1e-3
    for name in ("hip_l", "knee_l"):
        (one,) = [joint for joint in model.joints if joint.name == name]
        (two,) = [joint for joint in other.joints if joint.name == name]
        for here, there in zip(one.axes, two.axes, strict=True):
            if here.kind == "rotation" and here.coordinates:
                np.testing.assert_allclose(there.vector, here.vector, atol=1e-12)


def test_a_leg_taken_away_comes_back(data):
    whole = read_model(data("ceinms-emg-walk/model/gait2392.osim"))

    def right_of(parts, *fields):
        """Leave out parts of which a field ends in _l."""
        return tuple(
            one
            for one in parts
            if not any(str(getattr(one, field)).endswith("_l") for field in fields)
        )

    markers = [one for one in whole.markers if not one.name.startswith("L.")]
    right = replace(
        whole,
        bodies=right_of(whole.bodies, "name"),
        joints=right_of(whole.joints, "child"),
        coordinates=right_of(whole.coordinates, "name"),
        markers=right_of(markers, "body"),
        muscles=right_of(whole.muscles, "name"),
        wrap_objects=right_of(whole.wrap_objects, "name"),
        actuators=right_of(whole.actuators, "coordinate"),
        couplers=right_of(whole.couplers, "dependent"),
        passive_torques=right_of(whole.passive_torques, "coordinate"),
        frames=right_of(whole.frames, "body"),
        kept=(),
    )
    again = with_other_side(right)
    assert set(again.body_names) == set(whole.body_names)
    assert set(again.coordinate_names) == set(whole.coordinate_names)
    assert set(again.muscle_names) == set(whole.muscle_names)
    assert set(again.marker_names) == set(whole.marker_names)
    with pytest.raises(BadModel, match="nothing to add"):
        with_other_side(again)


def test_opensim_reads_the_other_side(data, tmp_path):
    model = read_model(data("rajagopal-walk-emg/raw/Rajagopal2016.osim"))
    other = mirrored(model)
    write_osim(other, tmp_path / "other.osim")
    again = read_osim(tmp_path / "other.osim")
    motion = mirrored_motion(model, moved(model, 4))
    one = muscle_kinematics(other, motion, velocities=False)
    two = muscle_kinematics(again, motion, velocities=False)
    order = [two.muscles.index(name) for name in one.muscles]
    np.testing.assert_allclose(two.muscle_length[:, order], one.muscle_length, atol=1e-9)


def test_a_joint_on_an_ellipsoid_is_not_written_as_the_wrong_side(data, tmp_path):
    model = mirrored(read_model(data(OSIM[2])))
    warnings = write_osim(model, tmp_path / "left.osim")
    assert any("scapulothoracic" in one for one in warnings)
    assert "<ScapulothoracicJoint" not in (tmp_path / "left.osim").read_text()


@pytest.mark.parametrize(
    "function",
    [simm_spline([-1, 0, 0.3, 2], [0, 1, 0.5, 2]), piecewise_linear([-1, 0.5, 2], [0, 1, -1])],
)
def test_functions_run_backwards(function):
    x = np.linspace(-4.0, 4.0, 201)
    np.testing.assert_allclose(backwards(function, (-1.0,), 2.0)(x), 2.0 * function(-x), atol=1e-12)
    np.testing.assert_allclose(
        backwards(backwards(function, (-1.0,)), (-1.0,))(x), function(x), atol=1e-12
    )
    wave = SineProduct(
        factor=2.0, frequencies=np.array([1.0, 3.0]), phases=np.array([0.2, 0.1]), offset=0.5
    )
    np.testing.assert_allclose(backwards(wave, (-1.0, 1.0))(x, x), wave(-x, x), atol=1e-14)


def test_a_reflection_is_its_own_inverse_and_goes_along_with_frames():
    rng = np.random.default_rng(1)
    plane = Reflection(rng.standard_normal(3), 0.3)
    pose = Transform(axis_rotation((0.6, 0.0, 0.8), 0.7), rng.standard_normal(3))
    points = rng.standard_normal((5, 3))
    np.testing.assert_allclose(plane.points(plane.points(points)), points, atol=1e-15)
    np.testing.assert_allclose(
        pose.apply(plane.seen_from(pose).points(points)),
        plane.points(pose.apply(points)),
        atol=1e-14,
    )
    turned = plane.pose(pose, flip(1))
    assert np.linalg.det(turned.rotation) == pytest.approx(1.0)
    np.testing.assert_allclose(
        turned.apply(points * (1, -1, 1)), plane.points(pose.apply(points)), atol=1e-14
    )


@pytest.mark.parametrize(
    ("name", "other"),
    [
        ("Thigh_r", "Thigh_l"),
        ("RightHIP", "LeftHIP"),
        ("Abd_R_L1", "Abd_L_L1"),
        ("med_gas_r_m_r-P2", "med_gas_l_m_l-P2"),
        ("r_humerus", "l_humerus"),
        ("glut_med1_r-P1", "glut_med1_l-P1"),
        ("RKnee", "LKnee"),
        ("mouse__RBPhalange3", "mouse__LBPhalange3"),
        ("mouse__RBPhalange3_flexion", "mouse__LBPhalange3_flexion"),
        ("Anna:RThigh", "Anna:LThigh"),
        ("rectus", ""),
        ("Lumbar", ""),
        ("RASI", ""),
    ],
)
def test_names_of_the_other_side(name, other):
    assert other_side(name) == other
    assert other == "" or other_side(other) == name
    assert other_side("RASI", capitals=True) == "LASI"


def test_toes_of_a_mouse_hang_on_the_foot_of_their_own_side(data):
    """Each body lies where the plane puts it, on the image of the body that it hung on.

    The image of the image is the skeleton.
    """
    model = read_model(data("mouse-skeleton-keypoints/mouse_with_meshes.xml"))
    side = other_side_of(model, "x")
    image = mirrored(model, "x")
    parents = {joint.child: joint.parent for joint in image.joints}
    here = standing_poses(model, dict.fromkeys(model.coordinate_names, 0.0))
    there = standing_poses(image, dict.fromkeys(image.coordinate_names, 0.0))
    for joint in model.joints:
        other = side.named("bodies", joint.child)
        assert parents[other] == side.named("bodies", joint.parent)
        sides = {split_side(name)[1] for name in (other, parents[other])} - {""}
        assert len(sides) <= 1
        place = side.planes["ground"].points(here[joint.child].translation)
        np.testing.assert_allclose(there[other].translation, place, atol=1e-9)
    paired = [name for name in model.body_names if split_side(name)[1]]
    assert {split_side(side.named("bodies", name))[1] for name in paired} == {"right", "left"}
    again = standing_poses(mirrored(image, "x"), dict.fromkeys(model.coordinate_names, 0.0))
    for name, pose in here.items():
        np.testing.assert_allclose(again[name].translation, pose.translation, atol=1e-9)


def test_an_axis_that_there_is_not_is_named(data):
    model = read_model(data("opensim-reference-small/arm26_bounds.osim"))
    for axis in ("w", (0.0, 0.0, 0.0), (1.0, 0.0)):
        with pytest.raises(BadModel, match="expected 'x', 'y', 'z' or a vector"):
            mirrored(model, axis)


def test_what_cannot_be_mirrored_is_named(data):
    model = read_model(data("opensim-reference-small/arm26_bounds.osim"))
    with pytest.raises(BadModel, match="expected 'x', 'y', 'z' or a vector"):
        mirrored(model, (0.0, 0.0, 0.0))
    with pytest.raises(UnknownName, match="trunk"):
        mirrored(model, middle=("trunk",))
