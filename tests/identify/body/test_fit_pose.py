"""A skeleton posed in a skin: known poses return, joint centers are inside, misfits named."""

from __future__ import annotations

import importlib.util

import numpy as np
import pytest
from skins import capsule

from myomorph.body.shape.fit_pose import pose_model_to_skin
from myomorph.body.shape.points import links_of
from myomorph.body.shape.regions import Standing, regions_of
from myomorph.body.shape.shape import body_shape
from myomorph.body.shape.skin import Skin, inside
from myomorph.core.io.formats import read_model
from myomorph.core.model.errors import BadData, UnknownName
from myomorph.core.model.series import Motion
from myomorph.core.model.surface import Surface
from myomorph.core.rigid.tree import compile_tree

absent = importlib.util.find_spec("anny") is None
needs_anny = pytest.mark.skipif(
    absent, reason="needs the optional package anny: pip install --no-deps anny"
)
RAJAGOPAL = "rajagopal-walk-emg/subject_walk_scaled.osim"
CASES = {
    RAJAGOPAL: 17,
    "opensim-gait-subject01/ref_id/subject01.osim": 11,
    "hamner-run-subject04/unscaled_generic.osim": 17,
    "opencap-subject4-multitask/models/manually_scaled.osim": 17,
    "lenhart-knee-contact-walk/lenhart2015.osim": 18,
    "fullbody-many-muscles/cyclistFullBodyMuscle.osim": 18,
}
SHOWN = ("hip", "knee", "ankle", "toes")


@pytest.fixture(scope="module")
def shape():
    return body_shape(1.80, 1.0, 80.0)


@needs_anny
@pytest.mark.parametrize("name", CASES)
def test_joint_centers_of_every_model_land_in_the_skin(data, shape, name):
    model = read_model(data(name))
    fit = pose_model_to_skin(model, shape)
    places = Standing(model, fit.motion, regions_of(model)).places
    assert len(places) == CASES[name]
    # Toes and heels of another foot, and vertebrae of another back, may end a little outside.
    limbs = [
        name
        for name in places
        if name.split()[-1] in ("hip", "knee", "ankle", "shoulder", "elbow", "wrist")
    ]
    within = inside(fit.skin, np.array([places[name] for name in limbs]))
    assert within.all(), [name for name, one in zip(limbs, within, strict=True) if not one]
    centers = [error for name, error in zip(fit.names, fit.errors, strict=True) if name in limbs]
    assert np.sqrt(np.mean(np.square(centers))) < 0.06
    if "gait" in name:
        assert any("the model has no neck, right shoulder" in note for note in fit.notes)


@needs_anny
def test_the_pose_does_not_depend_on_the_skins_axes(data, shape):
    model = read_model(data(RAJAGOPAL))
    straight = pose_model_to_skin(model, shape)
    turn = np.array([[0, 0, 1.0], [1, 0, 0], [0, 1, 0]])
    centers = {
        name: turn @ point
        for name, point in shape.centers.items()
        if name.split()[-1] in ("hip", "knee", "toes")
    }
    upright = {name: point for name, point in shape.centers.items() if name in centers}
    one = pose_model_to_skin(model, shape.skin, upright)
    other = pose_model_to_skin(model, shape.skin.moved(turn, np.zeros(3)), centers)
    # The rotation of a nearly straight leg about itself is soft; the places of the joint centers
    # are not.
    np.testing.assert_allclose(other.errors, one.errors, atol=1e-5)
    places = Standing(model, one.motion, regions_of(model)).places
    moved = Standing(model, other.motion, regions_of(model)).places
    for name in upright:
        np.testing.assert_allclose(moved[name], places[name], atol=1e-4)
    np.testing.assert_allclose(other.skin.surface.vertices, one.skin.surface.vertices, atol=1e-6)
    assert straight.skin.volume == pytest.approx(shape.skin.volume)


def test_a_known_pose_comes_back_from_landmarks(data):
    model = read_model(data(RAJAGOPAL))
    tree = compile_tree(model)
    rng = np.random.default_rng(0)
    values = tree.coordinates_of(Motion(np.zeros(1), (), np.zeros((1, 0))))[0].copy()
    for j in tree.independent:
        if not model.coordinates[j].locked and not model.coordinate_names[j].startswith("pelvis"):
            low, high = model.coordinates[j].range
            values[j] = np.clip(values[j] + rng.uniform(-0.15, 0.15), low, high)
    pose = Motion(np.zeros(1), model.coordinate_names, values[None])
    places = Standing(model, pose, regions_of(model)).places
    from myomorph.core.rigid.kinematics import forward_kinematics

    poses = forward_kinematics(tree, tree.coordinates_of(pose)[:1])
    bodies = np.array([tree.body_index[marker.body] for marker in model.markers])
    points = poses.points(bodies, np.array([marker.location for marker in model.markers]))[0]
    landmarks = {**dict(zip(model.marker_names, points, strict=True)), **places}
    fit = pose_model_to_skin(model, Skin(capsule(), True), landmarks)
    assert fit.rms < 1e-4
    assert not fit.notes


def test_a_skin_in_the_default_pose_is_checked(data):
    model = read_model(data(RAJAGOPAL))
    links = links_of(model, Motion(np.zeros(1), (), np.zeros((1, 0))))
    middle = links.centers.mean(axis=0)
    around = Skin(Surface(capsule(2.5, 0.8).vertices + middle, capsule().faces), True)
    fit = pose_model_to_skin(model, around)
    np.testing.assert_array_equal(fit.rotation, np.eye(3))
    assert "default pose" in fit.notes[0]
    with pytest.raises(
        BadData, match=r"mass centers are outside of it, as that of 'pelvis'.*give landmarks"
    ):
        pose_model_to_skin(model, around.moved(np.eye(3), np.array([5.0, 0.0, 0.0])))


def test_landmarks_that_cannot_be(data):
    model = read_model(data(RAJAGOPAL))
    skin = Skin(capsule(), True)
    point = np.zeros(3)
    with pytest.raises(UnknownName, match=r"landmark 'right kneee'.*'right knee'"):
        pose_model_to_skin(model, skin, {"right kneee": point})
    with pytest.raises(BadData, match="expected at least three"):
        pose_model_to_skin(model, skin, {"right knee": point, "left knee": point})
    with pytest.raises(BadData, match="three finite coordinates"):
        pose_model_to_skin(model, skin, {"right knee": np.array([np.nan, 0, 0])})
    line = {
        name: np.array([0.0, i, 0.0])
        for i, name in enumerate(("right hip", "right knee", "right ankle"))
    }
    with pytest.raises(BadData, match="on one line"):
        pose_model_to_skin(model, skin, line)
