"""What no marker shows: an upright trunk, bridged gaps, and nothing that markers show is moved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.core.io.formats import read_model
from myomorph.core.io.trc import read_trc
from myomorph.core.model.series import Markers, Motion
from myomorph.core.model.spatial import axis_rotation, vector_from_rotation
from myomorph.core.motion.filters import differentiate
from myomorph.core.motion.ik import InverseKinematicsOptions, inverse_kinematics
from myomorph.core.motion.unseen import BRIDGED, UPRIGHT
from myomorph.core.motion.upright import AHEAD, SLOW, smoothed
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from myomorph.lab.uncertainty.bodies import Draw
from myomorph.lab.uncertainty.drawn_inputs import drawn_unseen
from myomorph.lab.uncertainty.normals import Normals
from myomorph.lab.uncertainty.sources import Sources
from upright_person import RATE, person, seen, walk, without

PLAIN = InverseKinematicsOptions(untracked_coordinates="default")
LUMBAR = ("lumbar_extension", "lumbar_bending", "lumbar_rotation")
SHANK = ("tibia_r_0", "tibia_r_1", "tibia_r_2")


def rotations(model, motion, body):
    """Orientations (frames, 3, 3) of a body."""
    tree = compile_tree(model)
    return forward_kinematics(tree, tree.coordinates_of(motion)).rotations[:, tree.body_index[body]]


def leaning(model, motion, body="torso"):
    """Rotation vectors (frames, 3) of a body from its default pose, in ground."""
    rest = rotations(model, Motion(np.zeros(1), (), np.zeros((1, 0))), body)[0]
    return vector_from_rotation(rotations(model, motion, body) @ rest.T)


def test_where_all_is_seen_nothing_is_assumed_and_every_bit_stays():
    model = person()
    markers = seen(model, walk(model))
    fit = inverse_kinematics(model, markers)
    assert fit.assumed_as == ()
    assert fit.assumed_sd is None
    np.testing.assert_array_equal(
        fit.motion.values, inverse_kinematics(model, markers, PLAIN).motion.values
    )


def test_coordinates_that_markers_show_are_not_moved_by_the_prior():
    model = person()
    markers = seen(model, walk(model), hidden=("torso",))
    fit = inverse_kinematics(model, markers)
    plain = inverse_kinematics(model, markers, PLAIN)
    shown = [name for name in model.coordinate_names if name not in LUMBAR]
    for name in shown:
        np.testing.assert_array_equal(fit.motion[name], plain.motion[name])
    np.testing.assert_array_equal(fit.marker_error, plain.marker_error)
    assert [fit.assumed_as[model.coordinate_names.index(name)] for name in LUMBAR] == 3 * [UPRIGHT]
    assert sum(map(bool, fit.assumed_as)) == 3


def test_a_trunk_that_is_never_seen_stays_upright_while_the_pelvis_swings():
    model = person()
    motion = walk(model)
    fit = inverse_kinematics(model, seen(model, motion, hidden=("torso",)))
    whole_strides = slice(100, 300)
    pelvis = leaning(model, fit.motion, "pelvis")[whole_strides].std(axis=0)
    torso = leaning(model, fit.motion)[whole_strides].std(axis=0)
    assert (torso[[0, 1]] < 0.2 * pelvis[[0, 1]]).all()
    # Ahead is x, so a lean ahead turns about -z.
    assert leaning(model, fit.motion)[:, 2].mean() == pytest.approx(-AHEAD, abs=0.02)


def test_the_assumed_trunk_is_nearer_to_the_true_one_than_one_fixed_to_the_pelvis():
    model = person()
    motion = walk(model)
    markers = seen(model, motion, hidden=("torso",))
    true = rotations(model, motion, "torso")

    def away(fit):
        moved = rotations(model, fit.motion, "torso") @ np.swapaxes(true, 1, 2)
        return float(np.sqrt(np.mean(vector_from_rotation(moved) ** 2)))

    fit = inverse_kinematics(model, markers)
    assert away(fit) < 0.4 * away(inverse_kinematics(model, markers, PLAIN))
    columns = [model.coordinate_names.index(name) for name in LUMBAR]
    errors = np.abs(fit.motion.values - motion.values)[:, columns]
    assert (errors <= 2.0 * fit.assumed_sd[:, columns]).mean() > 0.95
    assert not fit.assumed_sd[:, [j for j in range(len(fit.assumed_as)) if j not in columns]].any()


def test_the_prior_goes_round_with_the_laboratory():
    model = person()
    markers = seen(model, walk(model), hidden=("torso",))
    turn = axis_rotation((0.0, 1.0, 0.0), 2.0)
    moved = replace(markers, values=markers.values @ turn.T + np.array([3.0, 0.0, -5.0]))
    here = inverse_kinematics(model, markers).motion
    there = inverse_kinematics(model, moved).motion
    for name in LUMBAR:
        np.testing.assert_allclose(there[name], here[name], atol=1e-5)


def test_a_model_whose_vertical_is_z_gets_the_same_trunk():
    first = person("y")
    other = person("z")
    here = inverse_kinematics(first, seen(first, walk(first), hidden=("torso",))).motion
    there = inverse_kinematics(other, seen(other, walk(other), hidden=("torso",))).motion
    for name in LUMBAR:
        np.testing.assert_allclose(there[name], here[name], atol=1e-5)


def test_a_trunk_goes_round_a_corner_and_lies_down_with_the_pelvis():
    model = person()
    motion = walk(model)
    values = np.array(motion.values)
    values[:, model.coordinate_names.index("pelvis_rotation")] += 0.6 * motion.time
    turning = Motion(motion.time, motion.names, values)
    fit = inverse_kinematics(model, seen(model, turning, hidden=("torso",)))
    assert np.abs(fit.motion["lumbar_rotation"]).max() < 0.25

    values = np.array(motion.values)
    values[:, model.coordinate_names.index("pelvis_tilt")] = -0.5 * np.pi
    lying = Motion(motion.time, motion.names, values)
    fit = inverse_kinematics(model, seen(model, lying, hidden=("torso",)))
    assert np.abs(fit.motion["lumbar_extension"] + AHEAD).max() < 0.1


def test_a_line_in_time_is_smoothed_to_itself():
    time = np.arange(200) / RATE
    lines = np.column_stack([1.0 + 2.0 * time, -time])
    np.testing.assert_allclose(smoothed(time, lines, 0.3), lines, atol=1e-9)


@pytest.mark.parametrize("duration", [0.1, 0.2])
def test_a_gap_is_bridged_with_small_errors_of_acceleration(duration):
    """All markers of a shank are hidden while it swings."""
    model = person()
    motion = walk(model)
    markers = without(seen(model, motion), SHANK, (2.0, 2.0 + duration))
    true = differentiate(motion, 6.0).accelerations
    own = true.std(axis=0)
    knee = model.coordinate_names.index("knee_angle_r")

    def error(options):
        fit = inverse_kinematics(model, markers, options)
        away = np.abs(differentiate(fit.motion, 6.0).accelerations - true).max(axis=0)
        return fit, away[knee] / own[knee]

    fit, bridged = error(None)
    _, plain = error(PLAIN)
    assert fit.assumed_as[knee] == BRIDGED
    assert bridged < 0.35
    assert bridged < 0.1 * plain
    hidden = fit.assumed_sd[:, knee] > 0.0
    assert hidden.sum() == round(duration * RATE)
    away = np.abs(fit.motion.values - motion.values)[hidden, knee]
    assert (away < 2.0 * fit.assumed_sd[hidden, knee]).mean() > 0.9


def test_what_is_hidden_to_the_end_eases_to_the_default_pose():
    model = person()
    motion = walk(model)
    fit = inverse_kinematics(model, without(seen(model, motion), SHANK, (2.0, 9.0)))
    angle = fit.motion["knee_angle_r"]
    steps = np.abs(np.diff(angle))
    assert steps.max() < 1.5 * np.abs(np.diff(motion["knee_angle_r"])).max()
    assert abs(angle[-1]) < 0.05


def test_a_marker_that_is_hidden_for_a_while_lets_no_seen_joint_jump():
    """A marker that lies 3 cm off draws at the pose; so it does while it is hidden."""
    model = person()
    motion = walk(model)
    values = np.array(seen(model, motion).values)
    names = seen(model, motion).names
    thigh = rotations(model, motion, "femur_r")
    values[:, names.index("femur_r_1")] += thigh @ np.array([0.03, 0.0, 0.01])
    whole = Markers(motion.time, names, values)
    markers = without(whole, ("femur_r_1",), (1.5, 2.1))
    all_seen = inverse_kinematics(model, whole).motion
    fit = inverse_kinematics(model, markers)
    plain = inverse_kinematics(model, markers, PLAIN).motion
    edges = [149, 209]

    def jumps(found):
        steps = np.diff(found.values, axis=0) - np.diff(all_seen.values, axis=0)
        return np.abs(steps[edges]).max()

    assert jumps(fit.motion) < 0.05 * jumps(plain)
    inside = slice(150, 210)
    away = np.abs(fit.motion.values - all_seen.values)[inside].max()
    assert away < 0.5 * np.abs(plain.values - all_seen.values)[inside].max()


def test_a_hidden_thigh_hides_no_forearm(data):
    """Two markers at the wrist turn little with the forearm: less than a hidden marker may.

    A marker of the right thigh is seen in a twelfth of this walk.
    """
    folder = data("opencap-subject4-multitask")
    model = read_model(folder / "models/manually_scaled.osim")
    markers = read_trc(folder / "markers/walking1.trc").markers
    fit = inverse_kinematics(model, markers)
    plain = inverse_kinematics(model, markers, PLAIN)
    assert np.isnan(markers.values[:, markers.names.index("r_thigh5")]).any(axis=1).mean() > 0.9
    assert BRIDGED not in fit.assumed_as
    for name in ("arm_rot_r", "elbow_flex_r", "pro_sup_r", "pro_sup_l"):
        np.testing.assert_allclose(fit.motion[name], plain.motion[name], atol=1e-6)


def test_draws_of_what_was_assumed_have_its_standard_deviation():
    model = person()
    fit = inverse_kinematics(model, seen(model, walk(model), hidden=("torso",)))
    normals = Normals(200)
    draws = np.array(
        [
            drawn_unseen(
                fit.modes,
                fit.motion.time,
                Draw(number=number, sources=Sources(), normals=normals),
            )
            for number in range(200)
        ]
    )
    columns = [model.coordinate_names.index(name) for name in LUMBAR]
    np.testing.assert_allclose(
        draws.std(axis=0)[:, columns].mean(axis=0),
        fit.assumed_sd[:, columns].mean(axis=0),
        rtol=0.1,
    )
    left_out = Draw(number=0, sources=Sources(untracked_coordinates=0.0), normals=normals)
    assert not drawn_unseen(fit.modes, fit.motion.time, left_out).any()


def test_frames_far_apart_are_not_smoothed():
    time = np.array([0.0, 18.0, 36.0, 54.0])
    values = np.array([[0.3], [-0.2], [0.5], [0.1]])
    np.testing.assert_allclose(smoothed(time, values, SLOW), values, atol=1e-12)


def test_what_grows_steadily_is_kept_by_smoothing_up_to_the_ends():
    time = np.arange(60) / 20.0
    values = np.column_stack([2.0 * time - 1.0, 0.5 - time])
    np.testing.assert_allclose(smoothed(time, values, SLOW), values, atol=1e-9)
