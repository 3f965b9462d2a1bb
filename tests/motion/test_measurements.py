"""Scale factors from marker distances, and markers moved to where a static trial shows them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.core.io.formats import read_model
from myomorph.core.model.errors import BadData
from myomorph.core.model.landmarks import Measurement
from myomorph.core.model.model import Marker
from myomorph.core.model.scale import scale
from myomorph.core.model.series import Markers, Motion
from myomorph.core.motion.ik import InverseKinematicsOptions
from myomorph.core.motion.measurements import (
    default_markers,
    frames_around,
    measure,
    place_on_pose,
    with_measured,
)
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree


@pytest.fixture(scope="module")
def walker(data):
    return read_model(data("opensim-gait-subject01/ref_scale/std_subject01_simbody.osim"))


def recorded(model, frames=1, motion=None):
    """Return the model's own markers as a recording."""
    names = model.marker_names
    if motion is None:
        values = np.repeat(default_markers(model, names)[None], frames, axis=0)
        return Markers(np.arange(frames) / 100.0, names, values)
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.coordinates_of(motion))
    bodies = np.array([tree.body_index[one.body] for one in model.markers])
    return Markers(
        motion.time, names, poses.points(bodies, np.array([one.location for one in model.markers]))
    )


def factors_of(model, markers, lengths, factors=None):
    return with_measured([measure(model, markers, one) for one in lengths], factors)


def test_known_factors_are_recovered(walker):
    """Markers of one body: the distance grows as the body."""
    grown = scale(walker, {"femur_r": (1.1, 1.1, 1.1), "torso": (0.9, 0.9, 0.9)})
    lengths = (
        Measurement(
            "thigh",
            (("R.Thigh.Upper", "R.Knee.Lat"), ("R.Thigh.Front", "R.Thigh.Rear")),
            {"femur_r": "xyz"},
        ),
        Measurement("trunk", (("R.Acromium", "L.Acromium"),), {"torso": "xz", "pelvis": "y"}),
    )
    factors = factors_of(walker, recorded(grown, frames=3), lengths)
    np.testing.assert_allclose(factors["femur_r"], 1.1, rtol=1e-12)
    np.testing.assert_allclose(factors["torso"], (0.9, 1.0, 0.9), rtol=1e-12)
    np.testing.assert_allclose(factors["pelvis"], (1.0, 0.9, 1.0), rtol=1e-12)


def test_a_later_measurement_counts_and_others_stay(walker):
    trial = recorded(scale(walker, {"femur_r": (1.2, 1.2, 1.2)}))
    pair = (("R.Thigh.Upper", "R.Knee.Lat"),)
    lengths = (
        Measurement("a", pair, {"femur_r": "xy"}),
        Measurement("b", (("R.ASIS", "L.ASIS"),), {"femur_r": "y"}),
    )
    given = {"femur_r": np.array([2.0, 2.0, 3.0])}
    factors = factors_of(walker, trial, lengths, given)
    np.testing.assert_allclose(factors["femur_r"], (1.2, 1.0, 3.0), rtol=1e-12)
    np.testing.assert_array_equal(given["femur_r"], (2.0, 2.0, 3.0))


def test_distances_are_averaged_over_the_frames_that_show_both(walker):
    small = recorded(walker)
    large = recorded(scale(walker, {"femur_r": (1.2, 1.2, 1.2)}))
    values = np.concatenate([small.values, large.values, large.values])
    values[2, small.names.index("R.Knee.Lat")] = np.nan
    trial = Markers(np.arange(3.0), small.names, values)
    found = measure(
        walker, trial, Measurement("thigh", (("R.Thigh.Upper", "R.Knee.Lat"),), {"femur_r": "x"})
    )
    assert found.factor == pytest.approx(1.1, rel=1e-12)
    assert "1 of 3 frames do not show both 'R.Thigh.Upper' and 'R.Knee.Lat'" in found.notes[0]


@pytest.mark.parametrize(
    ("pairs", "said"),
    [
        ((), "has no marker pairs"),
        ((("R.ASIS", "Nose"),), "the model has no marker 'Nose'"),
        ((("R.ASIS", "R.ASIS"),), "its factor would be nan"),
    ],
)
def test_a_measurement_that_cannot_be_used_says_why(walker, pairs, said):
    found = measure(walker, recorded(walker), Measurement("odd", pairs, {"pelvis": "xyz"}))
    assert np.isnan(found.factor)
    assert any(said in note for note in found.notes)
    assert with_measured([found]) == {}


def test_unseen_and_unrecorded_markers_are_not_used(walker):
    trial = recorded(walker)
    hidden = replace(
        trial, values=np.where(np.arange(len(trial.names))[:, None] == 0, np.nan, trial.values)
    )
    first = trial.names[0]
    other = trial.names[1]
    assert np.isnan(
        measure(walker, hidden, Measurement("a", ((first, other),), {"torso": "x"})).factor
    )
    fewer = Markers(trial.time, trial.names[1:], trial.values[:, 1:])
    found = measure(walker, fewer, Measurement("a", ((first, other),), {"torso": "x"}))
    assert found.notes == (f"measurement 'a' is not used: marker '{first}' was not recorded",)


def test_axes_that_do_not_exist_are_refused():
    with pytest.raises(BadData, match="body 'pelvis' has axes 'w'"):
        Measurement("a", (), {"pelvis": "w"})


@pytest.mark.parametrize(
    ("span", "kept"),
    [
        ((1.0, 3.0), (1, 2, 3)),
        ((1.5, 2.5), (1, 2, 3)),
        ((-1.0, -1.0), (0,)),
        ((3.2, 99.0), (3, 4)),
        ((2.0, 2.0), (2,)),
    ],
)
def test_frames_around_a_range(span, kept):
    markers = Markers(np.arange(5.0), ("a",), np.zeros((5, 1, 3)))
    assert tuple(frames_around(markers, *span).time) == kept


def test_frames_around_nothing():
    with pytest.raises(BadData, match="ends before it starts"):
        frames_around(Markers(np.zeros(1), (), np.zeros((1, 0, 3))), 2.0, 1.0)


def test_markers_go_to_where_they_were_recorded(walker):
    """The pose comes from good markers; others return to true positions, fixed ones stay."""
    random = np.random.default_rng(3)
    pose = Motion(
        np.zeros(1),
        walker.coordinate_names,
        random.uniform(-0.2, 0.2, (1, len(walker.coordinates))),
    )
    trial = recorded(walker, motion=pose)
    lost = {"R.Thigh.Front", "L.Toe.Lat", "Top.Head"}
    wrong = {
        one.name: replace(one, location=one.location + random.normal(0.0, 0.02, 3))
        for one in walker.markers
        if one.name in lost
    }
    wrong["Top.Head"] = replace(wrong["Top.Head"], fixed=True)
    extra = Marker("not recorded", "torso", np.zeros(3))
    start = replace(walker, markers=(*(wrong.get(one.name, one) for one in walker.markers), extra))
    good = {name: 1.0 for name in walker.marker_names if name not in lost}
    options = InverseKinematicsOptions(
        marker_weights=good, only_weighted=True, tolerance=1e-10, posture_weight=0.0
    )
    found = place_on_pose(start, trial, options=options)
    assert found.removed == ("not recorded",)
    for one in found.model.markers:
        true = wrong["Top.Head"] if one.name == "Top.Head" else walker.marker(one.name)
        np.testing.assert_allclose(one.location, true.location, atol=1e-7)
    assert "Top.Head" not in found.moved
    assert found.moved["L.Toe.Lat"] == pytest.approx(
        np.linalg.norm(wrong["L.Toe.Lat"].location - walker.marker("L.Toe.Lat").location), abs=1e-6
    )


def test_a_static_trial_with_gaps_and_movement_is_told(walker):
    trial = recorded(walker, frames=4)
    values = np.array(trial.values)
    values[0, 0] = np.nan
    values[:, 1] = np.nan
    values[3, 2, 1] += 0.02
    found = place_on_pose(walker, replace(trial, values=values), most_movement=0.01)
    told = "\n".join(found.notes)
    assert f"marker '{trial.names[0]}' is not seen in 1 of 4 static frames" in told
    assert (
        f"marker '{trial.names[1]}' is not seen in the static frames: its position is kept" in told
    )
    assert f"marker '{trial.names[2]}' moves 20.0 mm" in told
    assert found.model.marker(trial.names[1]).location == pytest.approx(
        walker.marker(trial.names[1]).location
    )


def test_no_static_frame_in_the_range(walker):
    with pytest.raises(BadData, match="no frames between 5 and 6 s"):
        place_on_pose(walker, recorded(walker, frames=3), 5.0, 6.0)
