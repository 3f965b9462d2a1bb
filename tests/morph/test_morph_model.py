"""Laws of the transfer on real models, of identity, similarity, affine and mirrored maps."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from given_maps import given, grown, poses_of, sheared, similar

from mujoco_models import compiled
from myomorph.bones.morph.mirror.model import mirrored_motion
from myomorph.bones.morph.morphed import MorphOptions
from myomorph.bones.morph.transfer.model import MorphTarget, morph_model
from myomorph.core.io.mjcf.read import model_from_mujoco
from myomorph.core.io.osim.read import read_osim
from myomorph.core.model.errors import BadData, UnknownName
from myomorph.core.model.model import Model
from myomorph.core.model.paths import MovingPathPoint, PathPoint, PathWrap
from myomorph.core.model.scale import scale
from myomorph.core.model.spatial import rotation_from_euler_xyz
from myomorph.core.muscles.kinematics import default_path_lengths, muscle_kinematics
from myomorph.core.rigid.kinematics import standing_poses
from osim_models import point_place

MODELS = (
    "ceinms-emg-walk/model/gait2392.osim",
    "rajagopal-walk-emg/raw/Rajagopal2016.osim",
    "shoulder-thoracoscapular/model_cmc/TSM_subject_CMC_noWeight.osim",
    "lenhart-knee-contact-walk/lenhart2015.osim",
    "opensim-reference-small/arm26_bounds.osim",
    "myolegs",
    "mixed",
)
"""Moving and conditional points, cylinders, ellipsoids, joints with travel, ligaments, muscles on
ground; tendons.
"""

SIZE = 1.3
LENGTH = 0.4
"""Of a bone [m]."""


@pytest.fixture(params=MODELS)
def model(request, data) -> Model:
    return (
        read(data(request.param))
        if request.param.endswith(".osim")
        else model_from_mujoco(compiled(request.param))
    )


read = cache(read_osim)


def lengths_and_arms(model, motion):
    found = muscle_kinematics(model, motion, velocities=False)
    turning = np.array([one.motion == "rotational" for one in model.coordinates], dtype=bool)
    return found.muscle_length, found.moment_arm[:, :, turning]


def test_identity_leaves_everything(model):
    morph = morph_model(model, similar(model, 1.0))
    motion = poses_of(model, 5, sliding=True)
    for ours, theirs in zip(
        lengths_and_arms(morph.model, motion), lengths_and_arms(model, motion), strict=True
    ):
        np.testing.assert_allclose(ours, theirs, atol=1e-9 * LENGTH)
    for one in morph.points:
        np.testing.assert_allclose(one.target, one.source, atol=1e-12)
    for before, after in zip(model.muscles, morph.model.muscles, strict=True):
        assert after.optimal_fiber_length == pytest.approx(before.optimal_fiber_length, rel=1e-9)
        assert after.tendon_slack_length == pytest.approx(
            before.tendon_slack_length, rel=1e-9, abs=1e-9
        )
        assert after.max_isometric_force == pytest.approx(before.max_isometric_force, rel=1e-9)
    for before, after in zip(model.bodies, morph.model.bodies, strict=True):
        np.testing.assert_allclose(after.mass_center, before.mass_center, atol=1e-12)
        np.testing.assert_allclose(after.inertia, before.inertia, atol=1e-12)


def test_a_larger_twin_in_other_frames(model):
    """Lengths and moment arms are those of the twin that scaling makes.

    The orientation of its bodies' frames does not matter.
    """
    bones = similar(model, SIZE, seed=3) | {
        "ground": given("ground", SIZE * np.eye(3), np.zeros(3))
    }
    morph = morph_model(model, bones)
    motion = poses_of(model, 5, sliding=True)
    twin = morph_model(model, similar(model, SIZE) | {"ground": bones["ground"]}).model
    ours = lengths_and_arms(morph.model, grown(model, motion, SIZE))
    for one, other in zip(ours, lengths_and_arms(twin, grown(model, motion, SIZE)), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-9 * LENGTH)
    # OpenSim's surfaces stop their iterations at distances in meters: paths around them do not grow
    # exactly.
    loose = np.array(
        [any(isinstance(wrap, PathWrap) for wrap in one.path.wraps) for one in model.muscles],
        dtype=bool,
    )
    for one, other in zip(ours, lengths_and_arms(model, motion), strict=True):
        np.testing.assert_allclose(one[:, ~loose], SIZE * other[:, ~loose], atol=1e-9 * LENGTH)
        np.testing.assert_allclose(one[:, loose], SIZE * other[:, loose], atol=2e-4)


def test_points_surfaces_and_masses_of_a_larger_twin_are_those_of_scaling(model):
    morph = morph_model(model, similar(model, SIZE))
    twin = scale(
        model,
        dict.fromkeys(model.body_names, (SIZE, SIZE, SIZE)),
        path_lengths=default_path_lengths,
    )
    for ours, theirs in zip(morph.model.wrap_objects, twin.wrap_objects, strict=True):
        if ours.body != "ground":
            np.testing.assert_allclose(ours.size, theirs.size, rtol=1e-9)
            np.testing.assert_allclose(ours.pose.rotation, theirs.pose.rotation, atol=1e-9)
            np.testing.assert_allclose(ours.pose.translation, theirs.pose.translation, atol=1e-12)
    for ours, theirs in zip(morph.model.bodies, twin.bodies, strict=True):
        assert ours.mass == pytest.approx(theirs.mass, rel=1e-9)
        np.testing.assert_allclose(ours.inertia, theirs.inertia, rtol=1e-9, atol=1e-12)
    for ours, theirs in zip(morph.model.markers, twin.markers, strict=True):
        if ours.body != "ground":
            np.testing.assert_allclose(ours.location, theirs.location, atol=1e-12)
    for ours, before in zip(morph.model.ligaments, model.ligaments, strict=True):
        assert ours.slack_length == pytest.approx(SIZE * before.slack_length, rel=1e-4)


def test_an_affine_map_of_the_whole_body(model):
    """In the default pose every point is where the matrix puts it, joints included.

    Polygons are as long.
    """
    rng = np.random.default_rng(5)
    matrix = rotation_from_euler_xyz((0.3, -0.4, 0.2)) @ (
        np.diag([1.2, 0.8, 1.1]) + 0.05 * rng.standard_normal((3, 3))
    )
    morph = morph_model(model, sheared(model, matrix))
    before = standing_poses(model)
    after = standing_poses(morph.model)
    # The ground turns as its bone does, so what is left is the matrix without its rotation.
    _, d, vt = np.linalg.svd(matrix)
    stretch = vt.T * d @ vt
    for one in morph.points:
        there = after[one.target_body].apply(one.target)
        np.testing.assert_allclose(
            there, stretch @ before[one.body].apply(one.source), atol=1e-9 * LENGTH
        )


def test_points_that_move_go_where_the_map_sends_them(data):
    model = read(data(MODELS[0]))
    rng = np.random.default_rng(0)
    bones = {
        body: given(body, np.eye(3) + 0.2 * rng.standard_normal((3, 3)), rng.uniform(-1, 1, 3))
        for body in model.body_names
    }
    morph = morph_model(model, bones)
    moving = 0
    for before, after in zip(model.muscles, morph.model.muscles, strict=True):
        for point, carried in zip(before.path.points, after.path.points, strict=True):
            for x in (-2.0, -1.0, 0.1) if isinstance(point, MovingPathPoint) else (0.0,):
                values = dict.fromkeys(model.coordinate_names, x)
                expected = bones[point.body].map.apply(point_place(point, values))
                np.testing.assert_allclose(point_place(carried, values), expected, atol=1e-12)
                moving += isinstance(point, MovingPathPoint)
            if isinstance(point, PathPoint):
                assert (carried.coordinate, carried.range) == (point.coordinate, point.range)
    assert moving


def test_a_symmetric_model_stays_so(data):
    """Left bones that are the mirrored right ones give mirrored left muscles."""
    model = read(data(MODELS[0]))
    morph = morph_model(model, _symmetric_bones(model))
    motion = poses_of(model, 4)
    other = mirrored_motion(model, motion)
    found = muscle_kinematics(morph.model, motion, velocities=False).muscle_length
    there = muscle_kinematics(morph.model, other, velocities=False).muscle_length
    names = model.muscle_names
    before = muscle_kinematics(model, motion, velocities=False).muscle_length
    beside = muscle_kinematics(model, other, velocities=False).muscle_length
    for i, name in enumerate(names):
        if name.endswith("_r"):
            j = names.index(name[:-2] + "_l")
            # The model itself is not symmetric to the last digit.
            asymmetry = np.abs(before[:, i] - beside[:, j]).max()
            np.testing.assert_allclose(found[:, i], there[:, j], atol=2.0 * asymmetry + 1e-9)


def _symmetric_bones(model):
    """Return random maps, those of the left bones mirrored from the right ones."""
    flip = np.diag([1.0, 1.0, -1.0])
    rng = np.random.default_rng(1)
    bones = {}
    for body in model.body_names:
        matrix = np.eye(3) + 0.1 * rng.standard_normal((3, 3))
        offset = rng.uniform(-0.1, 0.1, 3)
        if body.endswith("_r"):
            left = body[:-2] + "_l"
            bones |= {
                body: given(body, matrix, offset),
                left: given(left, flip @ matrix @ flip, flip @ offset),
            }
        elif not body.endswith("_l"):
            bones[body] = given(
                body, 0.5 * (matrix + flip @ matrix @ flip), 0.5 * (offset + flip @ offset)
            )
    return bones


def test_a_mirrored_bone_is_refused(data):
    model = read(data(MODELS[0]))
    with pytest.raises(BadData, match="'femur_r' turns right into left: mirror the model first"):
        morph_model(model, {"femur_r": given("femur_r", np.diag([1.0, 1.0, -1.0]), np.zeros(3))})


def test_bones_of_other_models_are_refused(data):
    model = read(data(MODELS[0]))
    with pytest.raises(UnknownName, match="thigh"):
        morph_model(model, {"thigh": given("thigh", np.eye(3), np.zeros(3))})
    with pytest.raises(BadData, match="no bone is given"):
        morph_model(model, {})


def test_bodies_without_a_bone_take_their_neighbors_size(data):
    model = read(data(MODELS[0]))
    bones = {
        "pelvis": given("pelvis", np.eye(3), np.zeros(3)),
        "tibia_r": given("tibia_r", 1.44 * np.eye(3), np.zeros(3)),
    }
    morph = morph_model(model, bones, target=MorphTarget(mass=60.0))
    sizes = {body: bone.whole.scale for body, bone in morph.bones.items()}
    assert sizes["femur_r"] == pytest.approx(1.2)
    assert sizes["toes_r"] == pytest.approx(1.44)
    assert sizes["torso"] == sizes["toes_l"] == pytest.approx(1.0)
    assert morph.model.mass == pytest.approx(60.0)
    assert any(
        "scaled with their neighbors by 1 to 1.44" in note and "in all" in note
        for note in morph.notes
    )


def test_one_transform_for_all_at_the_scanner(data):
    """Bones that share a frame give joints one center.

    The gap is the distance by which their maps disagreed.
    """
    model = read(data(MODELS[0]))
    poses = standing_poses(model)
    bones = {
        body: given(body, poses[body].rotation, poses[body].translation)
        for body in model.body_names
    }
    wrong = bones["femur_r"]
    bones["femur_r"] = given("femur_r", wrong.map.matrix, wrong.map.offset + [0.0, 0.0, 0.004])
    morph = morph_model(model, bones, target=MorphTarget(together=True))
    joints = {one.name: one for one in morph.joints}
    assert joints["hip_r"].gap == pytest.approx(0.004)
    assert joints["hip_l"].gap == pytest.approx(0.0, abs=1e-12)
    assert np.isnan(joints["ground_pelvis"].gap)
    np.testing.assert_allclose(joints["hip_r"].in_parent, joints["hip_r"].in_child)
    # In the default pose, in which the bones were scanned, all frames are the scanner's.
    first = standing_poses(morph.model)["pelvis"]
    for body, pose in standing_poses(morph.model).items():
        if body != "ground":
            np.testing.assert_allclose((first.inverse() @ pose).translation, 0.0, atol=0.003)
            np.testing.assert_allclose((first.inverse() @ pose).rotation, np.eye(3), atol=1e-9)


@pytest.mark.parametrize("fibers", ["range", "path", "keep"])
def test_parameters_of_a_larger_twin(model, fibers):
    morph = morph_model(model, similar(model, SIZE), MorphOptions(fibers=fibers))
    size = 1.0 if fibers == "keep" else SIZE
    for change in morph.muscles:
        assert change.fiber == pytest.approx(size, rel=2e-3)
        assert change.force == pytest.approx(SIZE**3 / size, rel=2e-3)
        if fibers != "keep":
            np.testing.assert_allclose(
                change.range_target, change.range_source, rtol=3e-3, atol=1e-3
            )
    for muscle in morph.model.muscles:
        given = muscle.parameters
        if "L0" in given:
            assert given["L0"] == pytest.approx(muscle.optimal_fiber_length)
            assert given["LT"] == pytest.approx(muscle.tendon_slack_length)
            assert given["lengthrange0"] == pytest.approx(
                given["LT"] + given["range0"] * given["L0"]
            )
            assert given["lengthrange1"] == pytest.approx(
                given["LT"] + given["range1"] * given["L0"]
            )


def test_fibers_keep_their_range_in_other_proportions(data):
    """A longer thigh, a shorter shank.

    Normalized fiber lengths over the range of motion hardly change.
    """
    model = read(data("rajagopal-walk-emg/raw/Rajagopal2016.osim"))
    bones = similar(model, 1.0)
    for side in "rl":
        bones[f"femur_{side}"] = given(f"femur_{side}", np.diag([1.0, 1.15, 1.0]), np.zeros(3))
        bones[f"tibia_{side}"] = given(f"tibia_{side}", np.diag([1.05, 0.9, 1.05]), np.zeros(3))
    spread = {}
    for fibers in ("range", "path", "keep"):
        changes = morph_model(model, bones, MorphOptions(fibers=fibers)).muscles
        spread[fibers] = np.median(
            [np.abs(np.subtract(one.range_target, one.range_source)).max() for one in changes]
        )
    assert spread["range"] < 0.01 < spread["path"] < spread["keep"]


@pytest.mark.parametrize(
    ("force", "expected"),
    [("volume", 1.3**2), ("area", 1.3**2), ("mass", 90.0 / 75.0 / 1.3), ("keep", 1.0)],
)
def test_force_grows_as_wanted(data, force, expected):
    model = read(data("rajagopal-walk-emg/raw/Rajagopal2016.osim"))
    mass = 90.0 / 75.0 * model.mass
    morph = morph_model(
        model,
        similar(model, 1.3),
        MorphOptions(fibers="path", force=force),
        MorphTarget(mass=mass),
    )
    assert {one.name for one in morph.muscles} == set(model.muscle_names)
    for change in morph.muscles:
        assert change.force == pytest.approx(expected, rel=1e-5)


def test_thickness_of_a_muscle_grows_with_its_bones(data):
    model = read(data("rajagopal-walk-emg/raw/Rajagopal2016.osim"))
    bones = {body: given(body, np.diag([1.0, 1.2, 1.0]), np.zeros(3)) for body in model.body_names}
    morph = morph_model(model, bones, MorphOptions(pennation="thickness"))
    for before, after, change in zip(
        model.muscles, morph.model.muscles, morph.muscles, strict=True
    ):
        thick = after.optimal_fiber_length * np.sin(after.pennation_at_optimal)
        was = before.optimal_fiber_length * np.sin(before.pennation_at_optimal)
        assert thick == pytest.approx(was * np.cbrt(1.2), abs=1e-12)
        assert change.pennation == pytest.approx(
            after.pennation_at_optimal - before.pennation_at_optimal
        )


def test_a_muscle_without_fiber_data_is_carried(data):
    model = read(data(MODELS[0]))
    plain = replace(model.muscles[0], optimal_fiber_length=0.0, tendon_slack_length=0.0)
    morph = morph_model(replace(model, muscles=(plain,)), similar(model, 1.1))
    assert morph.model.muscles[0].optimal_fiber_length == 0.0
    assert np.isnan(morph.muscles[0].range_source).all()
    assert morph.muscles[0].path == pytest.approx(1.1)
