"""Markers placed from a known pose come back where they were."""

import numpy as np
import pytest

from mujoco_models import compiled, random_motion
from myomorph.core.io.mjcf.read import model_from_mujoco
from myomorph.core.model.errors import BadData, UnknownName
from myomorph.core.model.series import Markers, Motion
from myomorph.core.motion.measurements import place_markers
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree

BODIES = {"hip": "trunk", "hand": "tip", "elbow": "fore"}


@pytest.fixture(scope="module")
def recorded():
    """Make a model, a motion of it, markers fixed to its bodies, and where they are fixed."""
    model = model_from_mujoco(compiled("mixed"))
    motion = random_motion(model, 6)
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.coordinates_of(motion))
    places = np.random.default_rng(4).uniform(-0.2, 0.2, (len(BODIES), 3))
    numbers = np.array([tree.body_index[body] for body in BODIES.values()])
    markers = Markers(motion.time, tuple(BODIES), poses.points(numbers, places))
    return model, motion, markers, places


def test_places_are_recovered(recorded):
    model, motion, markers, places = recorded
    found = place_markers(model, motion, markers, BODIES)
    assert [(one.name, one.body) for one in found] == list(BODIES.items())
    np.testing.assert_allclose([one.location for one in found], places, atol=1e-12)


def test_frames_without_the_marker_do_not_count(recorded):
    model, motion, markers, places = recorded
    values = markers.values.copy()
    values[2:4, 1] = np.nan
    found = place_markers(model, motion, Markers(markers.time, markers.names, values), BODIES)
    np.testing.assert_allclose([one.location for one in found], places, atol=1e-12)


def test_what_cannot_be_placed_is_named(recorded):
    model, motion, markers, _ = recorded
    values = markers.values.copy()
    values[:, 0] = np.nan
    with pytest.raises(BadData, match="hip"):
        place_markers(model, motion, Markers(markers.time, markers.names, values), BODIES)
    with pytest.raises(UnknownName, match="'toe'"):
        place_markers(model, motion, markers, {"toe": "tip"})
    with pytest.raises(UnknownName, match="'skull'"):
        place_markers(model, motion, markers, {"hip": "skull"})
    with pytest.raises(BadData, match="frames"):
        place_markers(
            model, Motion(motion.time[:2], motion.names, motion.values[:2]), markers, BODIES
        )
