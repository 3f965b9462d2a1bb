"""Which bodies are scaled together.

Also derivatives of marker positions against differences of scaled models.
"""

import numpy as np
import pytest

from myomorph.core.io.formats import read_model
from myomorph.core.model.scale import scale
from myomorph.core.motion.ik import InverseKinematicsOptions, pose_problem
from myomorph.core.motion.lengths import (
    factors_of,
    lengths_of,
    mirrored_lengths,
    segments_that_stretch,
)
from myomorph.core.motion.stretch import skeleton, slopes_of_frame, stretch_of, with_travel
from myomorph.core.rigid.coordinates import couple_frames
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from stick_figure import stick_figure

GENERIC = "opencap-subject4-multitask/models/unscaled_generic.osim"
LARGE = "fullbody-many-muscles/cyclistFullBodyMuscle.osim"


def placing(model, lengths, values):
    """Return the tree of a scaled model, and a function that gives its markers' positions.

    The function makes coordinates consistent and returns them too.
    """
    stretched = scale(model, factors_of(lengths, values))
    tree = compile_tree(stretched)
    bodies = np.array([tree.body_index[one.body] for one in stretched.markers])
    locations = np.array([one.location for one in stretched.markers])

    def placed(coordinates):
        c = coordinates[None].copy()
        couple_frames(tree.arrays, c)
        return forward_kinematics(tree, c).points(bodies, locations)[0].ravel(), c[0]

    return tree, placed


def hold_against_differences(model):
    rng = np.random.default_rng(1)
    model = skeleton(model)
    lengths = lengths_of(model)
    values = rng.uniform(0.9, 1.1, len(lengths))
    start = compile_tree(model).defaults.copy()
    start += 0.2 * rng.normal(size=len(start))
    tree, placed = placing(model, lengths, values)
    places, c = placed(start)
    problem = pose_problem(
        tree, model.marker_names, np.ones(len(model.markers)), InverseKinematicsOptions()
    )
    stretch = with_travel(stretch_of(model, lengths, model.marker_names), model, values)
    found, by_length, by_coordinate = slopes_of_frame(tree.arrays, problem.markers, stretch, c)
    np.testing.assert_allclose(found.ravel(), places, atol=1e-12)
    for i, length in enumerate(lengths):
        slope = _slope(lambda x: placing(model, lengths, x)[1](start)[0], values, i)
        np.testing.assert_allclose(by_length[:, i], slope, atol=1e-8, err_msg=length.name)
    for j in tree.independent[:: max(1, len(tree.independent) // 40)]:
        slope = _slope(lambda x: placed(x)[0], start, j)
        np.testing.assert_allclose(by_coordinate[:, j], slope, atol=1e-8)


def _slope(function, x, i):
    """Return the central difference of a function over the i-th of its arguments."""
    h = 1e-6
    d = h * np.eye(len(x))[i]
    return (function(x + d) - function(x - d)) / (2 * h)


def test_slopes_on_a_figure():
    hold_against_differences(stick_figure())


@pytest.mark.parametrize("name", [GENERIC, LARGE, "ceinms-emg-walk/model/gait2392.osim"])
def test_slopes_on_real_models(name, data):
    """Knees that slide on splines, patellas on couplers, 171 coordinates."""
    model = read_model(data(name))
    if not model.markers:
        from myomorph.core.model.model import Marker

        model = model.with_markers(
            tuple(Marker(f"m_{one}", one, [0.1, 0.2, 0.3]) for one in model.body_names)
        )
    hold_against_differences(model)


def test_segments_of_a_walking_model(data):
    segments = segments_that_stretch(read_model(data(GENERIC)))
    assert ("femur_r", "patella_r") in segments
    assert ("talus_l", "calcn_l", "toes_l") in segments
    assert ("ulna_r", "radius_r", "hand_r") in segments
    assert len(segments) == 12


def test_a_spine_is_one_trunk(data):
    segments = segments_that_stretch(read_model(data(LARGE)))
    trunk = next(one for one in segments if "lumbar3" in one)
    assert {"lumbar5", "thoracic12", "thoracic1", "rib7_L", "sternum", "scapula_R"} <= set(trunk)
    assert "pelvis" not in trunk
    assert "head_neck" not in trunk


def test_every_body_axis_has_one_length(data):
    for model in (stick_figure(), read_model(data(LARGE))):
        for symmetric in (False, True):
            stretched = [one for length in lengths_of(model, symmetric) for one in length.stretched]
            assert sorted(stretched) == sorted(
                (body, axis) for body in model.body_names for axis in range(3)
            )


def test_joint_to_joint_lengths_of_a_figure():
    found = {one.name: one for one in lengths_of(stick_figure(), symmetric=True)}
    assert found["femur_y"].extent == pytest.approx(0.4)
    assert found["tibia_y"].extent == pytest.approx(0.41)
    assert found["pelvis_z"].extent == pytest.approx(0.16)
    assert found["femur_y"].along
    assert found["femur_y"].between_joints
    assert not found["foot_x"].between_joints


def test_sides_are_paired():
    lengths = lengths_of(stick_figure())
    pairs = {(lengths[i].name, lengths[j].name) for i, j in mirrored_lengths(lengths)}
    assert ("femur_r_y", "femur_l_y") in pairs
    assert len(pairs) == 9


def test_factors_grow_the_extent():
    model = stick_figure()
    lengths = lengths_of(model)
    values = np.linspace(0.9, 1.1, len(lengths))
    grown = {one.name: one.extent for one in lengths_of(scale(model, factors_of(lengths, values)))}
    for one, value in zip(lengths, values, strict=True):
        if one.between_joints:
            assert grown[one.name] == pytest.approx(one.extent * value)
