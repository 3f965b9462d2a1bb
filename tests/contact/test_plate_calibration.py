"""A force plate's pose from placements.

Known poses are recovered, deviations are truthful, bad placements are named.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.core.contact.plate_placements import MarkedWeight, Placement, find_placements
from myomorph.core.contact.plates import force_plate, plate_axes
from myomorph.core.model.errors import BadData, UnknownName
from myomorph.core.model.series import Markers, PlateRecording
from myomorph.core.model.spatial import axis_rotation, rotation_from_euler_xyz, vector_from_rotation
from myomorph.swings.plate_calibration import calibrate_plate, place_plate
from myomorph.swings.plate_pose import LineResiduals, Pose, solve_pose
from truths.plate_checks import check_plate, pose_deviations

GRAVITY = 9.80665
GRID = [(x, y) for x in (-0.15, 0.0, 0.15) for y in (-0.25, 0.0, 0.25)]
CORNERS = np.array([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]]) * [0.2, 0.3, 0.0]
AXES = axis_rotation((0, 0, 1), 0.7) @ rotation_from_euler_xyz((np.pi + 0.01, 0.005, 0.0))
CENTER = np.array([0.4, -0.2, 0.01])
EXACT = {"force": 0.0, "moment": 0.0, "point": 0.0}
USUAL = {"force": 0.3, "moment": 0.05, "point": 0.0005}


def _weights(places=GRID, seed=0, mass=20.0, noise=EXACT, axes=AXES, center=CENTER):
    """Simulate a weight at rest at positions (x, y) of the plate.

    Its center of mass is 0.1 m above the plate.
    """
    random = np.random.default_rng(seed)
    found = []
    for number, place in enumerate(places):
        foot = center + axes @ np.array([*place, 0.0])
        found.append(
            _placement(
                f"place {number}",
                foot,
                np.array([0.0, 0, 1]),
                mass * GRAVITY,
                random,
                noise,
                axes,
                center,
            )
        )
    return [replace(one, weight="disc", expected=mass * GRAVITY) for one in found]


def _pushes(places=GRID, seed=0, noise=EXACT, tip=False, axes=AXES, center=CENTER):
    """Pushes of a rod at places of the plate, 10 to 30 degrees off the vertical."""
    random = np.random.default_rng(seed)
    found = []
    for number, place in enumerate(places):
        foot = center + axes @ np.array([*place, 0.0])
        tilt = random.uniform(0.2, 0.5)
        turn = random.uniform(0, 2 * np.pi)
        up = np.array([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)])
        one = _placement(
            f"push {number}", foot, up, random.uniform(100, 300), random, noise, axes, center
        )
        found.append(replace(one, pushed=True, contact=foot if tip else None))
    return found


def _placement(name, foot, up, size, random, noise, axes, center):
    force = size * axes.T @ up
    moment = np.cross(axes.T @ (foot - center), force)
    return Placement(
        name=name,
        force=force + noise["force"] * random.normal(size=3),
        moment=moment + noise["moment"] * random.normal(size=3),
        point=foot + 0.1 * up + noise["point"] * random.normal(size=3),
        direction=up,
    )


def plate(axes=AXES, center=CENTER) -> PlateRecording:
    return PlateRecording(
        name="FP1",
        kind=2,
        corners=CORNERS @ axes.T + center,
        origin=np.zeros(3),
        channels=np.zeros((1, 6)),
    )


def apart(found) -> tuple[float, float]:
    """Distance of the centers [m] and angle between the axes [rad] from the truth."""
    turn = vector_from_rotation(found.rotation @ AXES.T)
    return float(np.linalg.norm(found.center - CENTER)), float(np.linalg.norm(turn))


def test_oblique_pushes_show_the_whole_pose():
    found = calibrate_plate(_pushes())
    assert apart(found)[0] < 1e-9
    assert apart(found)[1] < 1e-9
    assert found.unknown.shape == (6, 0)
    assert not found.notes


def test_weights_at_rest_never_show_the_height():
    """Everything but the height is recovered.

    The height stays where the file has it, and that is reported.
    """
    nominal = plate(axis_rotation((0, 0, 1), 0.05) @ AXES, CENTER + [0.01, -0.02, 0.004])
    found = calibrate_plate(_weights(), nominal)
    np.testing.assert_allclose(found.center, CENTER + [0, 0, 0.004], atol=2e-4)
    assert apart(found)[1] < 1e-9
    assert found.unknown.shape == (6, 1)
    assert np.isinf(pose_deviations(found)[5])
    assert np.isfinite(pose_deviations(found)[3:5]).all()
    assert "the height of the plate is not determined" in found.notes[0]
    assert "stays where the file has it" in found.notes[0]
    assert "arbitrary" in calibrate_plate(_weights()).notes[0]


def test_a_rods_tip_on_the_surface_shows_the_height_too():
    upright = [
        replace(one, contact=one.point - 0.1 * one.direction, pushed=True) for one in _weights()
    ]
    found = calibrate_plate(upright)
    assert apart(found)[0] < 1e-9
    assert found.unknown.shape == (6, 0)


@pytest.mark.parametrize("turned", [0.5, 2.0, 3.1])
def test_a_nominal_pose_that_is_far_off_does_no_harm(turned):
    nominal = plate(axis_rotation((0, 0, 1), turned) @ AXES, CENTER + 0.3)
    assert apart(calibrate_plate(_pushes(), nominal))[1] < 1e-9


def test_the_whole_laboratory_may_turn():
    """Equivariance: placements seen from other axes give the pose seen from there."""
    turn = rotation_from_euler_xyz((0.4, -1.1, 2.0))
    shift = np.array([1.0, 2.0, -0.5])
    given = _pushes(noise=USUAL)
    moved = [
        replace(one, point=turn @ one.point + shift, direction=turn @ one.direction)
        for one in given
    ]
    here = calibrate_plate(given)
    there = calibrate_plate(moved)
    np.testing.assert_allclose(there.center, turn @ here.center + shift, atol=1e-8)
    np.testing.assert_allclose(there.rotation, turn @ here.rotation, atol=1e-7)
    np.testing.assert_allclose(there.distances, here.distances, atol=1e-8)


def test_the_pose_found_is_a_least_one():
    """No small turn or shift makes the sum of squares smaller."""
    given = _pushes(noise=USUAL, tip=True)
    found = calibrate_plate(given)
    lines = LineResiduals.of(given)
    best = solve_pose(lines, found).cost
    for k in range(6):
        for size in (1e-5, -1e-5):
            turn = axis_rotation(np.eye(3)[k], size) if k < 3 else np.eye(3)
            shift = size * np.eye(3)[k - 3] if k > 2 else np.zeros(3)
            near = Pose(rotation=turn @ found.rotation, center=found.center + shift)
            assert lines.rows(near).cost > best


def test_derivatives_of_lengths_are_those_of_finite_differences():
    """The sum of squares is free of how the sides across a force are chosen."""
    given = _pushes(noise=USUAL, tip=True)
    lines = LineResiduals.of(given)
    axes = axis_rotation((1, 0, 0), 0.02) @ AXES
    center = CENTER + 0.003

    def cost(step):
        size = np.linalg.norm(step[:3])
        turn = axis_rotation(step[:3] / size, size) if size > 0 else np.eye(3)
        return lines.rows(Pose(rotation=turn @ axes, center=center + step[3:])).cost

    gradient = 2.0 * lines.rows(Pose(rotation=axes, center=center)).normal().g
    difference = [(cost(1e-6 * one) - cost(-1e-6 * one)) / 2e-6 for one in np.eye(6)]
    np.testing.assert_allclose(gradient, difference, rtol=1e-5)


def test_deviations_are_those_that_runs_show():
    errors = []
    told = []
    for seed in range(30):
        found = calibrate_plate(_pushes(seed=seed, noise=USUAL))
        errors.append(
            np.concatenate([vector_from_rotation(found.rotation @ AXES.T), found.center - CENTER])
        )
        told.append(pose_deviations(found))
    ratio = np.sqrt(np.mean(np.square(errors), axis=0)) / np.sqrt(np.mean(np.square(told), axis=0))
    assert np.all((ratio > 0.6) & (ratio < 1.6))


def test_left_out_residuals_are_those_of_a_fit_without_the_placement():
    given = _pushes(noise=USUAL)
    found = calibrate_plate(given)
    without = solve_pose(LineResiduals.of(given[1:]), found)
    nearest, force = given[0].line
    away = given[0].point - without.center - without.rotation @ nearest
    line = without.rotation @ force
    assert found.left_out_distances[0] == pytest.approx(
        np.linalg.norm(away - (away @ line) * line), rel=1e-9
    )
    assert found.left_out_shifts[0] == pytest.approx(
        np.linalg.norm(without.center - found.center), rel=1e-9
    )
    assert np.mean(found.left_out_distances) > np.mean(found.distances)


def test_a_check_finds_what_is_off_and_only_that():
    turn = axis_rotation((0, 0, 1), 0.02)
    wrong = plate(turn @ AXES, CENTER + [0.005, 0.003, 0.0])
    given = _weights(noise=USUAL, seed=3)
    off = check_plate(wrong, given)
    assert off.significant
    np.testing.assert_allclose(off.shift[:2], [-0.005, -0.003], atol=1e-3)
    assert off.turn[2] == pytest.approx(-0.02, abs=0.003)
    assert not check_plate(plate(), given).significant


def test_chance_is_uniform_where_the_calibration_is_right():
    chances = [check_plate(plate(), _weights(noise=USUAL, seed=seed)).chance for seed in range(25)]
    assert 0 <= np.mean(np.array(chances) < 0.05) < 0.15
    assert 0.35 < np.mean(chances) < 0.65


def test_a_calibrated_plate_gives_forces_in_the_laboratory():
    """The center of pressure of the recording then lies under the center of mass.

    The force is vertical.
    """
    given = _weights()
    wrong = plate(axis_rotation((0, 0, 1), 0.05) @ AXES, CENTER + [0.01, -0.02, 0.0])
    channels = np.array([np.concatenate([one.force, one.moment]) for one in given])
    found = calibrate_plate(given, wrong)
    placed = force_plate(place_plate(replace(wrong, channels=channels), found))
    np.testing.assert_allclose(placed.points[:, :2], [one.point[:2] for one in given], atol=2e-4)
    np.testing.assert_allclose(placed.forces, np.tile([0, 0, 20 * GRAVITY], (9, 1)), atol=1e-5)
    np.testing.assert_allclose(
        np.linalg.norm(np.diff(placed.corners, axis=0), axis=1), [0.4, 0.6, 0.4], atol=1e-12
    )
    np.testing.assert_allclose(
        plate_axes(place_plate(wrong, found).corners), found.rotation, atol=1e-9
    )


def test_too_few_or_coincident_placements_are_refused():
    with pytest.raises(BadData, match="2 placements can be used, expected at least 3"):
        calibrate_plate(_weights(GRID[:2]))
    with pytest.raises(BadData, match="the plate's rotation about the vertical is not determined"):
        calibrate_plate(_weights([(0.01, 0.0), (0.0, 0.01), (0.0, 0.0)]))


def test_placements_on_a_line_are_named():
    notes = calibrate_plate(_weights([(0.0, -0.2), (0.0, 0.05), (0.0, 0.2)])).notes
    assert any("lie on a line" in line for line in notes)
    assert not any("lie on a line" in line for line in calibrate_plate(_weights()).notes)


def test_a_weight_that_was_not_at_rest_is_left_out_by_name():
    given = _weights(noise=USUAL)
    given[2] = replace(given[2], moved=0.012, point=given[2].point + [0.05, 0.0, 0.0])
    given[5] = replace(given[5], unsteady=0.08)
    found = calibrate_plate(given)
    assert len(found.names) == 7
    assert "'place 2' was left out: the weight was not at rest (moved 12.0 mm)" in found.notes[0]
    assert "'place 5' was left out: its force varied by 8.0 %" in found.notes[1]


def test_a_wrong_mass_and_a_touched_weight_are_named():
    given = [replace(one, expected=18.0 * GRAVITY) for one in _weights()]
    given[4] = replace(given[4], force=0.7 * given[4].force, moment=0.7 * given[4].moment)
    found = calibrate_plate(given)
    assert (
        "'place 4' was left out: it weighs 14.00 kg, the other placements of 'disc' 20.00 kg"
        in found.notes[0]
    )
    assert "given as 18.00 kg, but the plate measures 20.00 kg (+11.1 %)" in found.notes[1]
    assert found.scale == pytest.approx(20 / 18)


def test_a_mislabelled_marker_is_named():
    given = _weights(noise=USUAL)
    given[7] = replace(given[7], point=given[7].point + [0.03, 0.0, 0.0])
    assert any(
        "'place 7' lies" in line and "mislabelled" in line for line in calibrate_plate(given).notes
    )


def test_the_force_on_the_plate_instead_of_the_weight_is_named():
    given = [replace(one, force=-one.force, moment=-one.moment) for one in _weights()]
    assert any("reversed" in line for line in calibrate_plate(given).notes)


def a_recording(seed=0, noise=0.3, pauses=GRID[:4], swinging=False):
    """Simulate 60 s of a disc that is lifted from position to position, with drifted zero.

    Markers are at 200 Hz, the plate at 2000 Hz.
    """
    random = np.random.default_rng(seed)
    time = np.arange(0, 6.0 * len(pauses), 0.005)
    fine = np.arange(0, 6.0 * len(pauses), 0.0005)
    point = np.zeros((len(time), 3))
    force = np.zeros((len(fine), 3))
    moment = np.zeros((len(fine), 3))
    for number, place in enumerate(pauses):
        foot = CENTER + AXES @ np.array([*place, 0.0])
        rest = (time >= 6 * number) & (time < 6 * number + 6)
        loaded = (fine >= 6 * number + 1) & (fine < 6 * number + 5)
        height = 0.1 + 0.2 * np.clip(np.abs(time[rest] - 6 * number - 3) - 2, 0, 1)
        point[rest] = foot + height[:, None] * [0.0, 0, 1]
        if swinging and number == 1:
            point[rest, 0] += 0.03 * np.sin(8 * time[rest])
        force[loaded] = 20 * GRAVITY * AXES.T @ [0.0, 0, 1]
        moment[loaded] = np.cross(AXES.T @ (foot - CENTER), force[loaded])
    spread = np.array([[0.08, 0, 0], [-0.04, 0.07, 0], [-0.04, -0.07, 0]])
    values = point[:, None] + spread + 0.0003 * random.normal(size=(len(time), 3, 3))
    channels = np.hstack([force + [2.0, -1.0, 3.0], moment + [0.2, 0.3, -0.1]])
    channels = channels + random.normal(size=channels.shape) * np.repeat([noise, noise / 6], 3)
    recording = replace(plate(), channels=channels)
    return recording, fine, Markers(time, ("a", "b", "c"), values)


def test_placements_are_found_in_a_recording():
    recording, fine, markers = a_recording()
    found = find_placements(
        recording, fine, markers, MarkedWeight("disc", ("a", "b", "c"), mass=20.0)
    )
    assert len(found) == 4
    for one, known in zip(found, _weights(GRID[:4]), strict=True):
        np.testing.assert_allclose(one.force, known.force, atol=0.05)
        np.testing.assert_allclose(one.moment, known.moment, atol=0.01)
        np.testing.assert_allclose(one.point, known.point, atol=1e-4)
        assert one.tared
        assert one.moved < 1e-3
    calibrated = calibrate_plate(found, recording)
    assert np.linalg.norm((calibrated.center - CENTER)[:2]) < 1e-3
    assert apart(calibrated)[1] < 0.003


def test_a_weight_that_swings_becomes_a_placement_that_says_so():
    recording, fine, markers = a_recording(swinging=True)
    found = find_placements(recording, fine, markers, MarkedWeight("disc", ("a", "b", "c")))
    assert [one.moved > 0.01 for one in found] == [False, True, False, False]
    assert any("not at rest" in line for line in calibrate_plate(found, recording).notes)


def test_gravity_is_told_by_the_plate_and_the_markers():
    """The same recording in a laboratory whose y points up.

    It gives the same calibration, expressed there.
    """
    from myomorph.core.model.series import Z_UP_TO_Y_UP as TURN

    recording, fine, markers = a_recording()
    there = replace(recording, corners=recording.corners @ TURN.T)
    disc = MarkedWeight("disc", ("a", "b", "c"))
    first = calibrate_plate(find_placements(recording, fine, markers, disc), recording)
    second = calibrate_plate(find_placements(there, fine, markers.rotated(TURN), disc), there)
    np.testing.assert_allclose((second.center - TURN @ first.center)[[0, 2]], 0.0, atol=1e-4)
    np.testing.assert_allclose(second.rotation, TURN @ first.rotation, atol=1e-4)


def test_bad_weights_and_recordings_are_named():
    recording, fine, markers = a_recording()
    with pytest.raises(UnknownName, match="unknown marker 'd'"):
        find_placements(recording, fine, markers, MarkedWeight("disc", ("a", "d")))
    with pytest.raises(BadData, match="between 100 and 101 s"):
        find_placements(recording, fine, markers, MarkedWeight("disc", ("a",)), [(100.0, 101.0)])
    with pytest.raises(BadData, match="shares that sum to 1"):
        MarkedWeight("bar", ("a", "b"), shares=(0.5, 0.6))
    with pytest.raises(BadData, match="2 shares that sum to 1"):
        MarkedWeight("bar", ("a", "b"), shares=(1.0,))
    assert MarkedWeight("bar", ("a", "b"), shares=(1.25, -0.25)).shares == (1.25, -0.25)
    with pytest.raises(BadData, match="is not among its markers"):
        MarkedWeight("rod", ("a", "b"), axis=("a", "c"))
    with pytest.raises(BadData, match="samples, but its clock has"):
        find_placements(recording, fine[:-1], markers, MarkedWeight("disc", ("a",)))
