"""Faults put into recordings are found, named with their frames and corrected.

Clean recordings are not called faulty.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.motion.test_turns import bounded_walker, recorded

from myomorph.core.model.errors import BadData
from myomorph.core.model.series import Markers
from myomorph.core.motion.ik import (
    InverseKinematicsOptions,
    inverse_kinematics,
    pose_problem,
    tracked_markers,
)
from myomorph.core.motion.label_repair import front_pairs, limb_pairs, side_pairs
from myomorph.core.motion.marker_checks import (
    MarkerCheckOptions,
    checked_kinematics,
    edges_of,
    exchanges,
    excursions,
    name_findings,
    near_names,
)
from myomorph.core.motion.marker_frames import marker_frames
from myomorph.core.motion.marker_influence import left_out, undetermined
from myomorph.core.rigid.tree import compile_tree
from myomorph.lab.study.inputs.reading import fitted_to, open_model, read_recording

ABOUT_THE_MODEL = {"undetermined", "at its bound"}
"""Findings about the model, which clean recordings have too."""

RECORDINGS = {
    "knee": ("knee-implant-walk/scaled.osim", "knee-implant-walk/walk1.trc"),
    "gait2354": (
        "opensim-gait-subject01/ref_ik/subject01_simbody.osim",
        "opensim-gait-subject01/experiment/subject01_walk1.trc",
    ),
}


@pytest.fixture(params=RECORDINGS)
def walk(request, data):
    """Return a scaled model and a clean walk of 90 frames."""
    model, recording = map(data, RECORDINGS[request.param])
    body = open_model(model)
    markers = fitted_to(body, read_recording(recording)).markers
    return body, replace(markers, time=markers.time[:90], values=markers.values[:90])


def kinds(found):
    return {one.kind for one in found.findings} - ABOUT_THE_MODEL


def swapped(markers, pairs, span=slice(None)):
    values = np.array(markers.values)
    for one, other in pairs:
        i = markers.names.index(one)
        j = markers.names.index(other)
        values[span, i], values[span, j] = values[span, j].copy(), values[span, i].copy()
    return replace(markers, values=values)


def sided(model, markers):
    names, _ = tracked_markers(model, markers, InverseKinematicsOptions())
    return side_pairs(names)


def test_a_clean_walk_is_left_as_it_is(walk):
    model, markers = walk
    found = checked_kinematics(model, markers)
    assert kinds(found) == set()
    np.testing.assert_array_equal(
        found.fit.motion.values, inverse_kinematics(model, markers).motion.values
    )


@pytest.mark.parametrize("which", [0, 5, -1])
def test_a_pair_swapped_throughout_is_put_back(walk, which):
    model, markers = walk
    pair = sided(model, markers)[which]
    found = checked_kinematics(model, swapped(markers, [pair]))
    assert kinds(found) == {"swapped labels"}
    np.testing.assert_array_equal(found.markers.values, markers.values)
    assert all(name in found.findings[0].text for name in pair)


def test_both_sides_swapped_for_some_frames_are_put_back_there(walk):
    model, markers = walk
    found = checked_kinematics(model, swapped(markers, sided(model, markers), slice(30, 50)))
    assert kinds(found) == {"swapped labels"}
    np.testing.assert_array_equal(found.markers.values, markers.values)
    (span,) = found.findings[0].times
    assert span == pytest.approx((markers.time[30], markers.time[49]))


def test_all_labels_of_both_sides_swapped_are_told_from_a_mirrored_axis(walk):
    model, markers = walk
    labels = checked_kinematics(model, swapped(markers, sided(model, markers)))
    assert kinds(labels) == {"swapped labels"}
    np.testing.assert_array_equal(labels.markers.values, markers.values)
    mirrored = checked_kinematics(model, replace(markers, values=markers.values * [-1.0, 1.0, 1.0]))
    assert kinds(mirrored) == {"mirrored axis"}
    assert not mirrored.findings[0].repaired


def test_a_limb_and_the_front_of_the_pelvis_swapped_are_put_back(walk):
    model, markers = walk
    pairs = sided(model, markers)
    limbs = limb_pairs(model, pairs)
    leg = max(limbs, key=lambda body: len(limbs[body]))
    front = front_pairs(model, pairs)
    for fault in (limbs[leg], *((front,) if front else ())):
        found = checked_kinematics(model, swapped(markers, fault))
        assert kinds(found) == {"swapped labels"}
        np.testing.assert_array_equal(found.markers.values, markers.values)


@pytest.mark.parametrize("frames", [1, 5])
def test_a_marker_that_jumps_is_bridged_there(walk, frames):
    model, markers = walk
    name = sided(model, markers)[0][0]
    values = np.array(markers.values)
    column = markers.names.index(name)
    values[40 : 40 + frames, column] += [0.05, 0.04, -0.03]
    found = checked_kinematics(model, replace(markers, values=values))
    assert kinds(found) == {"jumping marker"}
    finding = next(one for one in found.findings if one.kind == "jumping marker")
    assert finding.place == name
    assert finding.repaired
    assert finding.times == (pytest.approx((markers.time[40], markers.time[39 + frames])),)
    clean = inverse_kinematics(model, markers).motion.values
    assert np.abs(found.fit.motion.values - clean).max() < np.radians(1.0)


def test_two_labels_of_one_marker_are_named_and_nothing_is_put_right(walk):
    """Whichever of both is wrong, the recording does not show it by itself."""
    model, markers = walk
    names = [name for name in markers.names if name in model.marker_names]
    values = np.array(markers.values)
    values[:, markers.names.index(names[1])] = values[:, markers.names.index(names[-1])]
    found = checked_kinematics(model, replace(markers, values=values))
    doubled = [one.place for one in found.findings if one.kind == "doubled marker"]
    assert doubled == [f"{names[1]}, {names[-1]}"]
    assert not any(one.repaired for one in found.findings)


def test_what_is_only_told_is_not_repaired(walk):
    model, markers = walk
    name = sided(model, markers)[0][0]
    values = np.array(markers.values)
    values[40, markers.names.index(name)] += [0.05, 0.04, -0.03]
    wrong = replace(markers, values=values)
    found = checked_kinematics(model, wrong, checks=MarkerCheckOptions(repair=False))
    assert kinds(found) == {"jumping marker"}
    assert not any(one.repaired or "repaired" in one.text for one in found.findings)
    np.testing.assert_array_equal(
        found.fit.motion.values, inverse_kinematics(model, wrong).motion.values
    )


def test_a_marker_five_centimetres_off_is_named(walk):
    model, markers = walk
    names, _ = tracked_markers(model, markers, InverseKinematicsOptions())
    others = {
        one: [
            two for two in names if two != one and model.marker(two).body == model.marker(one).body
        ]
        for one in names
    }
    name = next(one for one, _ in reversed(sided(model, markers)) if others[one])
    mate = others[name][0]
    towards = markers[mate] - markers[name]
    values = np.array(markers.values)
    values[:, markers.names.index(name)] += (
        0.05 * towards / np.linalg.norm(towards, axis=1, keepdims=True)
    )
    found = checked_kinematics(model, replace(markers, values=values))
    assert kinds(found) == {"displaced marker"}
    assert next(one for one in found.findings if one.kind == "displaced marker").place == name


def test_a_recording_whose_vertical_is_another_axis_is_told(walk):
    model, markers = walk
    found = checked_kinematics(
        model, replace(markers, values=markers.values[:, :, [0, 2, 1]] * [1.0, -1.0, 1.0])
    )
    assert "vertical axis" in kinds(found)


def test_a_coordinate_at_its_bound_is_told_with_what_the_markers_ask_for():
    model = bounded_walker()
    markers, true = recorded(model, 0.2, 0.0)
    bound = replace(model.coordinate("hip_z_r"), clamped=True, range=(-1.0, 0.2))
    held = replace(
        model,
        coordinates=tuple(bound if one.name == "hip_z_r" else one for one in model.coordinates),
    )
    found = checked_kinematics(held, markers)
    (finding,) = [one for one in found.findings if one.kind == "at its bound"]
    assert finding.place == "hip_z_r"
    at = true.values[:, model.coordinate_names.index("hip_z_r")] > 0.2
    assert f"in {int(at.sum())} of 10 frames" in finding.text
    more = np.degrees(np.median(true["hip_z_r"][at] - 0.2))
    assert f"about {more:.0f} degrees more" in finding.text


def test_a_coordinate_that_no_marker_shows_is_told():
    model = bounded_walker()
    markers, _ = recorded(model, 0.2, 0.0)
    kept = [i for i, one in enumerate(model.markers) if one.body not in ("shank_l", "cap_l")]
    some = replace(
        markers, names=tuple(markers.names[i] for i in kept), values=markers.values[:, kept]
    )
    (finding,) = [
        one for one in checked_kinematics(model, some).findings if one.kind == "undetermined"
    ]
    assert finding.place == "knee_l"
    assert not [
        one for one in checked_kinematics(model, markers).findings if one.kind == "undetermined"
    ]


def test_frames_that_do_not_show_where_the_body_is_are_left_empty():
    """A walker who enters the view: two of its markers determine no pose.

    The frames with all markers are as they were.
    """
    model = bounded_walker()
    markers, _ = recorded(model, 0.2, 0.0)
    values = np.array(markers.values)
    values[:2, 2:] = np.nan
    entering = replace(markers, values=values)
    found = checked_kinematics(model, entering)
    (finding,) = [one for one in found.findings if one.kind == "hidden frames"]
    assert finding.repaired
    assert "2 of 10 frames" in finding.text
    assert f"as few as 2 of {len(markers.names)}" in finding.text
    np.testing.assert_array_equal(found.fit.seen, np.arange(10) >= 2)
    assert np.isnan(found.fit.motion.values[:2]).all()
    clean = checked_kinematics(model, markers)
    np.testing.assert_allclose(found.fit.motion.values[2:], clean.fit.motion.values[2:], atol=1e-6)
    assert not {one.kind for one in clean.findings} & {"hidden frames", "hidden in part"}
    told = checked_kinematics(model, entering, checks=MarkerCheckOptions(repair=False))
    assert told.fit.seen.all()
    assert [one.repaired for one in told.findings if one.kind == "hidden frames"] == [False]


def test_a_coordinate_hidden_in_part_of_the_frames_is_named_with_them():
    model = bounded_walker()
    markers, _ = recorded(model, 0.2, 0.0)
    values = np.array(markers.values)
    shank = [
        i for i, name in enumerate(markers.names) if model.marker(name).body in ("shank_l", "cap_l")
    ]
    values[4:7, shank] = np.nan
    found = checked_kinematics(model, replace(markers, values=values))
    (finding,) = [one for one in found.findings if "hidden" in one.kind]
    assert finding.kind == "hidden in part"
    assert finding.place == "knee_l"
    assert finding.times == ((markers.time[4], markers.time[6]),)
    assert found.fit.seen.all()


def _with_noise(markers):
    noise = np.random.default_rng(3).normal(scale=1e-4, size=markers.values.shape)
    return replace(markers, values=markers.values + noise)


def test_what_a_marker_left_out_says_is_what_a_fit_without_it_gives():
    model = bounded_walker()
    noisy = _with_noise(recorded(model, 0.2, 0.0)[0])
    fit = inverse_kinematics(model, noisy, InverseKinematicsOptions(tolerance=1e-10))
    tree = compile_tree(model)
    arrays = pose_problem(tree, fit.marker_names, fit.marker_weight, InverseKinematicsOptions())
    observed = noisy.values[:, [noisy.names.index(name) for name in fit.marker_names]]
    frames = marker_frames(tree, arrays, observed, fit.motion.values)
    k = fit.marker_names.index("thigh_r_2")
    without = InverseKinematicsOptions(marker_weights={"thigh_r_2": 0.0}, tolerance=1e-10)
    other = inverse_kinematics(model, noisy, without)
    place = marker_frames(tree, arrays, observed, other.motion.values)
    wanted = np.einsum("fji,fj->fi", place.rotations[:, k], place.errors[:, k])
    away = left_out(frames, arrays.markers.weight)[:, k]
    np.testing.assert_allclose(away, wanted, atol=2e-7)
    assert undetermined(frames, arrays, arrays.markers.weight) == ()


def test_clean_paths_have_no_edges_and_a_stamp_is_no_jump():
    time = np.arange(200) / 100.0
    foot = np.column_stack([1.3 * time, 0.1 * np.abs(np.sin(4.0 * np.pi * time)), 0.0 * time])
    edges = edges_of(time, foot[:, None])
    assert excursions(time, edges) == ()
    assert exchanges(foot[:, None], edges) == ()


def test_names_that_are_spelled_otherwise_are_hinted_and_sides_are_not_confused():
    near = near_names(("R.ASIS", "L.ASIS", "R.Heel"), ("RASIS", "lasis", "LHeel", "Subject:T10"))
    assert near == {"R.ASIS": "RASIS", "L.ASIS": "lasis"}
    (finding,) = name_findings(("R.ASIS",), ("RASIS",), 30)
    assert "'RASIS' for 'R.ASIS'" in finding.text


def test_few_markers_that_match_are_told_and_enough_are_not():
    missing = tuple(f"m{i}" for i in range(56))
    unused = tuple(f"x{i}" for i in range(20))
    (finding,) = name_findings(missing, unused, 10)
    assert "only 10 of the model's 66 markers" in finding.text
    assert name_findings(missing[:20], unused, 30) == ()


def test_next_to_no_marker_of_the_model_is_an_error_and_no_perfect_fit():
    model = bounded_walker()
    names = model.marker_names
    labels = (names[0], *(f"other_{i}" for i in range(11)))
    markers = Markers(np.arange(5) / 100.0, labels, np.zeros((5, 12, 3)))
    with pytest.raises(BadData, match=rf"only 1 of the model's {len(names)} markers"):
        checked_kinematics(model, markers)
