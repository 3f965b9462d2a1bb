"""Muscles as spindles have their volume and stand around their paths."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.lab.report.scene.scene import make_scene
from myomorph.lab.report.scene.spindles import BELLY, FACES, RINGS, SIDES, TENDON, spindles
from walker import everything


@pytest.fixture(scope="module")
def scene_and_muscles():
    given = everything(20)
    assert given.model is not None
    assert given.kinematics.motion is not None
    return make_scene(given.model, given.kinematics.motion, [0]), given.model.muscles


def test_a_spindle_keeps_within_the_volume_of_its_muscle(scene_and_muscles) -> None:
    scene, muscles = scene_and_muscles
    made = list(spindles(scene.muscles, muscles, 0))
    assert [spindle.muscle for spindle in made] == list(range(len(muscles)))
    for spindle, path, muscle in zip(made, scene.muscles, muscles, strict=True):
        points = path.points[0][np.isfinite(path.points[0]).all(axis=1)]
        length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
        volume = muscle.max_isometric_force / 3e5 * muscle.optimal_fiber_length
        widest = np.sqrt(volume / (np.pi * BELLY * length)) + 0.002
        rings = spindle.vertices.reshape(RINGS, SIDES, 3)
        radii = np.linalg.norm(rings - rings.mean(axis=1, keepdims=True), axis=2)
        assert radii.max() <= widest
        assert radii[[0, -1]] == pytest.approx(TENDON)


def test_normals_point_away_from_the_path(scene_and_muscles) -> None:
    scene, muscles = scene_and_muscles
    assert FACES.max() == RINGS * SIDES - 1
    for spindle in spindles(scene.muscles, muscles, 0):
        rings = spindle.vertices.reshape(RINGS, SIDES, 3)
        away = (rings - rings.mean(axis=1, keepdims=True)).reshape(-1, 3)
        assert np.linalg.norm(spindle.normals, axis=1) == pytest.approx(1.0)
        assert (np.einsum("ij,ij->i", away, spindle.normals) > 0.0).all()


def test_a_path_that_is_not_known_has_no_spindle(scene_and_muscles) -> None:
    scene, muscles = scene_and_muscles
    gone = replace(scene.muscles[1], points=np.full_like(scene.muscles[1].points, np.nan))
    paths = (scene.muscles[0], gone, *scene.muscles[2:])
    numbers = [spindle.muscle for spindle in spindles(paths, muscles, 0)]
    assert numbers == [0, *range(2, len(muscles))]
    assert list(spindles((gone,), muscles[1:2], 0)) == []
