"""Both sides of a body are alike, in the frames that each has."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.body.identify.sides import sides_of
from myomorph.core.io.formats import read_model
from myomorph.core.model.inertia import inertial_parameters, with_inertial_parameters


@pytest.fixture(scope="module")
def model(data):
    return read_model(data("rajagopal-walk-emg/subject_walk_scaled.osim"))


def misses(sides, parameters):
    return sides.rows @ parameters.ravel() - sides.right


def test_a_body_that_grows_alike_misses_no_row(model):
    own = inertial_parameters(model)
    sides = sides_of(model, own, 0.05)
    # The toes of this model are no mirror images.
    assert len(sides.pairs) == 9
    assert ("femur_r", "femur_l") in sides.pairs
    np.testing.assert_allclose(misses(sides, own), 0.0, atol=1e-9)
    grown = own.copy()
    names = list(model.body_names)
    for side, sign in (("r", 1.0), ("l", -1.0)):
        row = grown[names.index(f"femur_{side}")]
        row *= 1.2
        row[3] += 0.05 * sign
    np.testing.assert_allclose(misses(sides, grown), 0.0, atol=1e-9)


def test_a_side_that_is_heavier_by_its_standard_deviation_misses_by_one(model):
    own = inertial_parameters(model)
    sides = sides_of(model, own, 0.05)
    heavier = own.copy()
    heavier[model.body_names.index("tibia_l")] *= 1.05
    off = misses(sides, heavier).reshape(-1, 10)
    # A change of all masses alike is 1 + E with E = 0.05 on the diagonal: four entries.
    np.testing.assert_allclose(np.linalg.norm(off, axis=1).max(), 2.0, rtol=1e-6)
    assert (np.linalg.norm(off, axis=1) > 1e-9).sum() == 1


def test_frames_that_are_turned_are_no_difference(model):
    """MuJoCo's bodies have frames of their own: the left thigh turned by a quarter about y."""
    turn = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    joints = []
    for joint in model.joints:
        if joint.child == "femur_l":
            frame = replace(
                joint.child_frame,
                rotation=turn.T @ joint.child_frame.rotation,
                translation=turn.T @ joint.child_frame.translation,
            )
            joint = replace(joint, child_frame=frame)
        if joint.parent == "femur_l":
            frame = replace(
                joint.parent_frame,
                rotation=turn.T @ joint.parent_frame.rotation,
                translation=turn.T @ joint.parent_frame.translation,
            )
            joint = replace(joint, parent_frame=frame)
        joints.append(joint)
    bodies = tuple(
        replace(
            body,
            mass_center=turn.T @ body.mass_center,
            inertia=turn.T @ body.inertia @ turn,
        )
        if body.name == "femur_l"
        else body
        for body in model.bodies
    )
    turned = replace(model, joints=tuple(joints), bodies=bodies)
    sides = sides_of(turned, inertial_parameters(turned))
    assert ("femur_r", "femur_l") in sides.pairs
    np.testing.assert_allclose(misses(sides, inertial_parameters(turned)), 0.0, atol=1e-9)


def test_a_model_whose_sides_differ_is_not_tied(model):
    own = inertial_parameters(model)
    own[model.body_names.index("calcn_l")] *= 2.0
    sides = sides_of(with_inertial_parameters(model, own), own)
    assert ("calcn_r", "calcn_l") not in sides.pairs
    assert len(sides.pairs) == 8
