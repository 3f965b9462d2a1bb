"""Lengths and marker positions of persons whose truth is known.

Also laws, and recordings with little information.
"""

from dataclasses import replace

import numpy as np
import pytest

from myomorph.body.calibrate.calibrate import calibrate
from myomorph.body.calibrate.calibration import CalibrationOptions
from myomorph.core.model.errors import BadData, UnknownName
from myomorph.core.model.scale import scale
from myomorph.core.model.series import Markers
from myomorph.core.model.spatial import axis_rotation
from myomorph.core.motion.ik import InverseKinematicsOptions, inverse_kinematics
from stick_figure import person, stick_figure

EXACT = CalibrationOptions(noise=0.0)


@pytest.fixture(scope="module")
def subject():
    return person()


@pytest.fixture(scope="module")
def found(subject):
    return calibrate(subject.generic, [subject.markers], EXACT)


def distances(model):
    """Joint to joint: trunk, thighs, shanks, hips [m]."""
    frames = {joint.child: joint.parent_frame.translation for joint in model.joints}
    hips = np.linalg.norm(frames["femur_r"] - frames["femur_l"])
    trunk = np.linalg.norm(frames["torso"] - 0.5 * (frames["femur_r"] + frames["femur_l"]))
    return np.array(
        [
            hips,
            trunk,
            *(np.linalg.norm(frames[f"{a}_{s}"]) for a in ("tibia", "foot") for s in "rl"),
        ]
    )


def test_lengths_come_back(subject, found):
    """[D] step 1 with 0.3 mm of marker noise: link lengths within 2 mm."""
    assert found.converged
    assert np.abs(distances(subject.generic) - distances(subject.model)).max() > 0.02
    np.testing.assert_allclose(distances(found.model), distances(subject.model), atol=2e-3)


def test_markers_that_the_motion_shows_come_back(subject, found):
    known = [one for one in found.markers if one.sd.max() < 1e-3]
    assert len(known) > len(found.markers) // 2
    for one in known:
        np.testing.assert_allclose(
            one.location, subject.model.marker(one.name).location, atol=3e-3, err_msg=one.name
        )


def test_the_noise_is_told_by_the_residual(found):
    assert found.noise == pytest.approx(3e-4, rel=0.1)


def test_errors_agree_with_their_deviations(subject, found):
    """Errors over deviations of what the data show are about as large as they should be."""
    error = np.array(
        [one.location - subject.model.marker(one.name).location for one in found.markers]
    )
    ratio = error / np.array([one.sd for one in found.markers])
    assert 0.3 < np.sqrt(np.mean(ratio**2)) < 2.0


def test_the_model_is_the_stretched_one_with_its_markers(subject, found):
    again = scale(subject.generic, found.factors)
    for one, other in zip(again.joints, found.model.joints, strict=True):
        np.testing.assert_array_equal(one.parent_frame.translation, other.parent_frame.translation)
    fit = inverse_kinematics(found.model, subject.markers, InverseKinematicsOptions())
    assert np.sqrt(np.mean(fit.marker_error**2)) < 1.1 * np.sqrt(3.0) * found.noise
    assert found.rms_before > 20.0 * found.rms_after


def test_the_laboratory_may_be_turned(subject, found):
    turn = axis_rotation(np.array([0.0, 1.0, 0.0]), 2.1)
    moved = Markers(
        subject.markers.time,
        subject.markers.names,
        (subject.markers.values + [1.0, 0.2, -2.0]) @ turn.T,
    )
    other = calibrate(subject.generic, [moved], EXACT)
    for one, two in zip(found.lengths, other.lengths, strict=True):
        assert one.factor == pytest.approx(two.factor, abs=2e-3)


def test_symmetric_gives_one_factor_for_both_sides(subject):
    found = calibrate(subject.generic, [subject.markers], replace(EXACT, symmetric=True))
    for name in ("femur", "tibia", "foot"):
        np.testing.assert_array_equal(found.factors[f"{name}_r"], found.factors[f"{name}_l"])
    np.testing.assert_allclose(distances(found.model), distances(subject.model), atol=2e-3)


def test_any_subset_of_the_unknowns_is_estimated(subject, found):
    lengths = calibrate(subject.generic, [subject.markers], replace(EXACT, fit=("lengths",)))
    np.testing.assert_array_equal([one.shift for one in lengths.markers], 0.0)
    markers = calibrate(subject.generic, [subject.markers], replace(EXACT, fit=("markers",)))
    np.testing.assert_array_equal([one.factor for one in markers.lengths], markers.size)
    np.testing.assert_array_equal([one.sd for one in markers.lengths], 0.0)
    # Together they explain more than either alone.
    for alone in (lengths, markers):
        assert found.rms_after < alone.rms_after < alone.rms_before
    with pytest.raises(UnknownName, match="masses"):
        calibrate(subject.generic, [subject.markers], replace(EXACT, fit=("masses",)))
    with pytest.raises(BadData, match="nothing to fit"):
        calibrate(subject.generic, [subject.markers], replace(EXACT, fit=()))


def test_a_calibration_certifies_itself(subject, found):
    """Its estimate has all unknowns and what each source of residuals left; the noise is right."""
    estimate = found.estimate
    assert estimate.converged == found.converged
    lengths = estimate.values["lengths"]
    np.testing.assert_array_equal(lengths, [one.factor for one in found.lengths])
    np.testing.assert_array_equal(
        estimate.posterior.sd[: len(lengths)], [one.sd for one in found.lengths]
    )
    explained = {one.name: one for one in estimate.explained}
    assert set(explained) == {"markers", "usual bodies", "symmetric posture"}
    assert not explained["markers"].prior
    assert 0.5 < explained["markers"].rms < 1.1
    assert any(line.startswith("markers: ") for line in estimate.certificate)


def test_in_turn_as_the_dissertation_reaches_the_same_place(subject):
    """[D] (a), (b), (c) in turn against all at once.

    The same cost to 2 %, the same lengths to 2 mm, in many more steps.
    """
    options = CalibrationOptions(noise=0.02, frames=12, posture_sd=1e6)
    joint = calibrate(subject.generic, [subject.markers], options)
    turns = calibrate(subject.generic, [subject.markers], replace(options, method="alternating"))
    assert turns.costs[-1] == pytest.approx(joint.costs[-1], rel=0.02)
    np.testing.assert_allclose(distances(turns.model), distances(joint.model), atol=2e-3)
    assert len(joint.costs) < len(turns.costs)


def test_costs_never_rise_at_one_noise(subject):
    costs = calibrate(subject.generic, [subject.markers], CalibrationOptions(noise=0.03)).costs
    assert np.all(np.diff(costs) <= 1e-9 * costs[0])


def test_without_knowledge_from_markers_deviations_are_those_of_the_prior(subject):
    """The overall size is known to a half at first; each length varies about it on its own."""
    found = calibrate(
        subject.generic,
        [subject.markers],
        CalibrationOptions(noise=1e3, frames=4, iterations=3, posture_sd=1e6),
    )
    assert len(found.lengths) > 10
    for one in found.lengths:
        assert 0.01 < one.prior_sd < 0.2
        assert one.sd == pytest.approx(np.hypot(0.5, one.prior_sd), rel=1e-4), one.length.name


def test_hidden_markers_do_not_count(subject):
    values = subject.markers.values.copy()
    rng = np.random.default_rng(3)
    values[rng.random(values.shape[:2]) < 0.15] = np.nan
    found = calibrate(
        subject.generic, [Markers(subject.markers.time, subject.markers.names, values)], EXACT
    )
    np.testing.assert_allclose(distances(found.model), distances(subject.model), atol=2e-3)


def test_fixed_markers_and_bounds_hold(subject):
    found = calibrate(
        subject.generic,
        [subject.markers],
        CalibrationOptions(fixed_markers=("pelvis0", "femur_r1"), mass=70.0),
    )
    for name in ("pelvis0", "femur_r1"):
        one = next(one for one in found.markers if one.name == name)
        np.testing.assert_array_equal(one.shift, 0.0)
        body = subject.generic.marker(name).body
        np.testing.assert_allclose(
            one.location, subject.generic.marker(name).location * found.factors[body]
        )
    knee = subject.generic.coordinate_names.index("tibia_r_r0")
    assert max(one[:, knee].max() for one in found.angles) <= 0.0
    assert found.model.mass == pytest.approx(70.0)


def test_locked_coordinates_stay(subject):
    locked = tuple(
        replace(one, locked=True, default=0.05) if one.name == "foot_r_r1" else one
        for one in subject.generic.coordinates
    )
    found = calibrate(replace(subject.generic, coordinates=locked), [subject.markers])
    column = subject.generic.coordinate_names.index("foot_r_r1")
    for one in found.angles:
        np.testing.assert_array_equal(one[:, column], 0.05)


def test_a_static_pose_that_is_known_pulls(subject):
    """One frame of standing whose foot is known to be flat.

    It fixes the gauge between foot markers and angle.
    """
    still = Markers(subject.markers.time[:1], subject.markers.names, subject.markers.values[:1])
    pose = {"foot_r_r0": 0.3, "foot_r_r1": -0.2}
    found = calibrate(
        subject.generic,
        [subject.markers],
        CalibrationOptions(static=still, static_pose=pose, static_sd=1e-4),
    )
    for name, value in pose.items():
        assert found.angles[-1][0, subject.generic.coordinate_names.index(name)] == pytest.approx(
            value, abs=2e-3
        )


def test_one_frame_is_told(subject):
    one = Markers(subject.markers.time[:1], subject.markers.names, subject.markers.values[:1])
    found = calibrate(subject.generic, [one], EXACT)
    assert any("only 1 frames" in note for note in found.notes)
    assert any("too few frames to determine the noise" in note for note in found.notes)
    assert all(0.8 < one.factor < 1.3 for one in found.lengths)


def test_a_second_frame_of_a_posture_is_no_evidence(subject):
    still = np.repeat(subject.markers.values[:1], 100, axis=0) + 1e-4 * np.random.default_rng(
        0
    ).normal(size=3)
    found = calibrate(
        subject.generic, [Markers(np.arange(100) / 50.0, subject.markers.names, still)]
    )
    assert sum(len(one) for one in found.frames) == 1


def test_segments_without_markers_follow_the_size(subject):
    kept = [name for name in subject.markers.names if not name.startswith(("foot", "tibia"))]
    columns = [subject.markers.names.index(name) for name in kept]
    found = calibrate(
        subject.generic,
        [Markers(subject.markers.time, tuple(kept), subject.markers.values[:, columns])],
    )
    hidden = {
        one.length.name: one
        for one in found.lengths
        if one.length.segment.startswith(("foot", "tibia"))
    }
    assert not any(one.shown for one in hidden.values())
    assert hidden["tibia_r_y"].factor == pytest.approx(found.size, abs=0.02)
    assert any("tibia_r_y" in note for note in found.notes)
    assert next(one for one in found.lengths if one.length.name == "femur_r_y").length.along


def test_millimetres_are_named(subject):
    large = Markers(subject.markers.time, subject.markers.names, 1e3 * subject.markers.values)
    with pytest.raises(BadData, match="millimetres"):
        calibrate(subject.generic, [large])


def test_strangers_are_named(subject):
    other = Markers(subject.markers.time, tuple(f"x{i}" for i in range(30)), subject.markers.values)
    with pytest.raises(BadData, match="share no marker"):
        calibrate(subject.generic, [other])
    with pytest.raises(BadData, match=r"recording 2 of 2"):
        calibrate(subject.generic, [subject.markers, other])
    with pytest.raises(UnknownName, match="'nose'"):
        calibrate(subject.generic, [subject.markers], CalibrationOptions(fixed_markers=("nose",)))
    with pytest.raises(BadData, match="frames is 0"):
        calibrate(subject.generic, [subject.markers], CalibrationOptions(frames=0))
    with pytest.raises(BadData, match="at least one recording"):
        calibrate(stick_figure(), [])
