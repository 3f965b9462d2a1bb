"""Key poses: more active is further from the page; muscles have their volume."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.lab.report.scene.scene import make_scene
from myomorph.lab.report.trial.answer.pose_pictures import (
    BELLY,
    THEMES,
    Theme,
    pose_pictures,
    ramp_color,
    spindle_of,
)
from walker import everything

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


@pytest.mark.parametrize("theme", THEMES)
def test_the_ramp_goes_one_way_in_lightness(theme: Theme) -> None:
    light = [float(ramp_color(theme, value) @ LUMINANCE) for value in np.linspace(0.0, 0.6, 13)]
    steps = np.diff(light)
    assert (steps < 0.0).all() if theme == "light" else (steps > 0.0).all()


def test_what_is_not_known_is_at_rest() -> None:
    assert ramp_color("light", float("nan")) == pytest.approx(ramp_color("light", 0.0))


def test_poses_have_one_scale_in_both_themes() -> None:
    given = everything(60)
    assert given.model is not None
    assert given.kinematics.motion is not None
    scene = make_scene(given.model, given.kinematics.motion, [5, 30, 50])
    drawn = pose_pictures(given.model, scene)
    assert len(drawn) == 3
    for one in drawn:
        assert one.light.startswith("data:image/png;base64,")
        assert one.dark.startswith("data:image/png;base64,")
        assert one.light != one.dark
        assert one.width > 20


def test_a_spindle_keeps_within_the_volume_of_its_muscle() -> None:
    given = everything(20)
    assert given.model is not None
    assert given.kinematics.motion is not None
    scene = make_scene(given.model, given.kinematics.motion, [0])
    for path, muscle in zip(scene.muscles, given.model.muscles, strict=True):
        spindle = spindle_of(path, muscle, 0)
        assert spindle is not None
        points = path.points[0][np.isfinite(path.points[0]).all(axis=1)]
        length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
        volume = muscle.max_isometric_force / 3e5 * muscle.optimal_fiber_length
        widest = np.sqrt(volume / (np.pi * BELLY * length)) + 0.002
        middle = spindle.vertices.reshape(-1, 10, 3).mean(axis=1, keepdims=True)
        radii = np.linalg.norm(spindle.vertices.reshape(-1, 10, 3) - middle, axis=2)
        assert radii.max() <= widest
