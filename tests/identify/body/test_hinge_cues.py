"""A model laid on itself: points on hinges' axes, which rotate a limb about its length.

Also the angle by which its limbs rotate.
"""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.body.shape.center_fit import AXIS_LENGTH, CenterFit, hinge_cues
from myomorph.body.shape.regions import HINGES, Region, Standing, regions_of
from myomorph.core.model.series import DEFAULT_POSE
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from myomorph.lab.analyze.leg_model import leg_model


def test_a_model_on_itself_has_its_cues_in_place():
    model = leg_model()
    standing = Standing(model, DEFAULT_POSE, regions_of(model))
    cues = hinge_cues(standing, standing, list(standing.centers), np.eye(3))
    hinges = [key for key, center in standing.centers.items() if center.name in HINGES]
    assert [cue.name for cue in cues] == [f"{key} axis" for key in hinges]
    assert len(cues) >= 2
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.coordinates_of(DEFAULT_POSE))
    for key, cue in zip(hinges, cues, strict=True):
        here = poses.points(np.array([tree.body_index[cue.body]]), cue.location[None])[0, 0]
        np.testing.assert_allclose(here, cue.target, atol=1e-6)  # centers are where a search ends
        assert np.linalg.norm(cue.target - standing.places[key]) == pytest.approx(AXIS_LENGTH)


def test_a_thigh_is_searched_over_the_rotations_of_its_own_hip():
    """Neither the other hip's nor the knee's, whose ranges are finite too, nor any of a shank."""
    model = leg_model()
    standing = Standing(model, DEFAULT_POSE, regions_of(model))
    fit = CenterFit(
        model=model,
        regions=standing.regions,
        centers=standing.centers,
        targets=standing.places,
        cues=[],
    )
    hip = next(joint for joint in model.joints if joint.child == "femur_r")
    expected = {name: model.coordinate(name).range for name in hip.coordinates}
    assert len(expected) == 3
    assert fit._ball(model, Region("thigh", "right")) == expected
    assert fit._ball(model, Region("shank", "right")) == {}
