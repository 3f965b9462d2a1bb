"""Key poses: more active is further from the page."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.lab.report.scene.scene import make_scene
from myomorph.lab.report.trial.answer.pose_pictures import (
    THEMES,
    Theme,
    pose_pictures,
    ramp_color,
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
