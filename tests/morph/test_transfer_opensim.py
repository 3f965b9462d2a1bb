"""Morphed models as OpenSim 4.6 reads them.

Positions of bodies, markers and points are the same, and so are lengths.
"""

from __future__ import annotations

import numpy as np
import pytest
from given_maps import given

import opensim_oracle
from conftest import DATA
from myomorph.bones.morph.transfer.model import MorphTarget, morph_model
from myomorph.core.io.osim.read import read_osim
from myomorph.core.io.osim.write import write_osim
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion
from myomorph.core.model.spatial import rotation_from_euler_xyz
from myomorph.core.muscles.kinematics import muscle_kinematics
from osim_models import body_poses, point_place

pytest.importorskip("opensim")

FILES = (
    "ceinms-emg-walk/model/gait2392.osim",
    "rajagopal-walk-emg/raw/Rajagopal2016.osim",
    "opensim-reference-small/arm26_bounds.osim",
)


def morphed(model: Model) -> Model:
    """Every bone stretched and turned in a way of its own."""
    rng = np.random.default_rng(2)
    bones = {}
    for body in model.body_names:
        turn = rotation_from_euler_xyz(rng.uniform(-1.0, 1.0, 3))
        bones[body] = given(
            body, turn @ np.diag(rng.uniform(0.9, 1.2, 3)), rng.uniform(-0.1, 0.1, 3)
        )
    return morph_model(model, bones, target=MorphTarget(mass=60.0)).model


@pytest.fixture(scope="module")
def answers(tmp_path_factory):
    folder = tmp_path_factory.mktemp("morphed")
    models = {name: morphed(read_osim(DATA / name)) for name in FILES if (DATA / name).exists()}
    files = {name: folder / f"{i}.osim" for i, name in enumerate(models)}
    warnings = {name: write_osim(model, files[name]) for name, model in models.items()}
    return models, warnings, opensim_oracle.ask(files, folder)


@pytest.mark.parametrize("name", FILES)
def test_opensim_finds_everything_where_it_was_carried(answers, name):
    models, warnings, facts = answers
    if name not in models:
        pytest.skip(f"needs the data set '{name.split('/')[0]}'")
    model = models[name]
    fact = facts[name]
    assert not isinstance(fact, str), fact
    assert fact["mass"] == pytest.approx(60.0)
    sampled = any("spline through" in line for line in warnings[name])
    # The oracle moves each coordinate alone, those that follow others too: what hangs on them is
    # compared at rest only.
    following = {
        one.child for one in model.joints if set(one.coordinates) & set(model.dependent_coordinates)
    }
    for rest, pose in zip((True, False, False), fact["poses"], strict=True):
        values = pose["coordinates"]
        poses = body_poses(model, values)
        for body, (rotation, origin) in pose["bodies"].items():
            np.testing.assert_allclose(poses[body].rotation, rotation, atol=1e-9)
            np.testing.assert_allclose(poses[body].translation, origin, atol=1e-9)
        for marker in model.markers:
            place = poses[marker.body].apply(marker.location)
            np.testing.assert_allclose(place, pose["markers"][marker.name], atol=1e-9)
        motion = Motion(np.zeros(1), tuple(values), np.array([list(values.values())]))
        lengths = muscle_kinematics(model, motion, velocities=False).muscle_length[0]
        for i, muscle in enumerate(model.muscles):
            points = [
                poses[point.body].apply(point_place(point, values)) for point in muscle.path.points
            ]
            np.testing.assert_allclose(
                points, pose["points"][muscle.name], atol=2e-6 if sampled else 1e-9
            )
            if rest or not following & {point.body for point in muscle.path.points}:
                assert lengths[i] == pytest.approx(
                    pose["lengths"][muscle.name], abs=2e-6 if sampled else 1e-9
                )
