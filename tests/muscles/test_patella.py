"""The patella as a lever: virtual work, balance of forces, and published ratios and moment arms."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.io.osim.read import read_osim
from myomorph.core.model.series import Motion
from myomorph.core.muscles.kinematics import muscle_kinematics
from myomorph.core.muscles.model_paths import compile_paths
from myomorph.core.muscles.patella import extensors, tendon_arms, with_lever
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.lab.analyze.generic_model import generic_model

ANGLES = np.radians(np.arange(0.0, 121.0, 10.0))


@pytest.fixture(scope="module")
def bent():
    """Return the generic model with its right knee bent, its paths and their forces."""
    pytest.importorskip("myo_sim")
    model, _ = generic_model({})
    motion = Motion(0.01 * np.arange(len(ANGLES)), ("knee_angle_r",), ANGLES[:, None])
    paths = compile_paths(model)
    coordinates = paths.tree.coordinates_of(motion)
    return model, motion, paths, coordinates, *paths.pulls(coordinates)


def right(paths):
    return next(group for group in extensors(paths) if group.knee.name == "knee_r")


def test_quadriceps_of_both_sides_are_found(bent) -> None:
    model, _, paths, *_ = bent
    found = {
        group.knee.name: {model.muscle_names[muscle] for muscle in group.muscles}
        for group in extensors(paths)
    }
    names = ("recfem", "vasint", "vaslat", "vasmed")
    assert found == {f"knee_{side}": {f"{name}_{side}" for name in names} for side in "rl"}


def test_the_arm_of_the_whole_path_is_minus_its_slope(bent) -> None:
    model, motion, paths, coordinates, pulls, work = bent
    group = right(paths)
    arms = tendon_arms(paths, group, coordinates, pulls, work)
    expected = muscle_kinematics(model, motion, velocities=False)
    for column, muscle in enumerate(group.muscles):
        slope = expected.moment_arm_of(model.muscle_names[muscle], "knee_angle_r")
        np.testing.assert_allclose(arms.path[:, column], slope, atol=1e-9)


def test_the_tendons_arm_is_the_slope_of_its_own_part_with_a_patella_that_stays(bent) -> None:
    """Length of the last part by finite differences of the knee, patella and thigh held.

    Nothing of the path's code is used.
    """
    model, motion, paths, *state = bent
    group = right(paths)
    step = 1e-5
    arms = tendon_arms(paths, group, *state)
    moved = Motion(motion.time, motion.names, motion.values + step)
    before = forward_kinematics(paths.tree, paths.tree.coordinates_of(motion))
    after = forward_kinematics(paths.tree, paths.tree.coordinates_of(moved))
    for column, muscle in enumerate(group.muscles):
        upper, lower = model.muscles[muscle].path.points[-2:]
        patella = _place(before, upper)
        length = np.linalg.norm(_place(before, lower) - patella, axis=1)
        longer = np.linalg.norm(_place(after, lower) - patella, axis=1)
        np.testing.assert_allclose(arms.tendon[:, column], -(longer - length) / step, atol=2e-6)


def _place(poses, point):
    """Return a path point (frames, 3) in ground [m]."""
    body = np.array([poses.tree.body_index[point.body]])
    return poses.points(body, point.location[None])[:, 0]


def test_the_lever_keeps_forces_balanced_and_work_at_the_knee(bent) -> None:
    _, _, paths, coordinates, pulls, work = bent
    group = right(paths)
    levered = with_lever(paths, coordinates, pulls, work)
    for muscle in range(len(paths.muscles)):
        pairs = paths.pull_muscle == muscle
        np.testing.assert_allclose(
            levered[:, pairs].sum(axis=1), pulls[:, pairs].sum(axis=1), atol=1e-12
        )
    touched = np.zeros(len(paths.pull_muscle), bool)
    for each in extensors(paths):
        touched[each.shank] = touched[each.patella] = True
    np.testing.assert_array_equal(levered[:, ~touched], pulls[:, ~touched])
    arms = tendon_arms(paths, group, coordinates, pulls, work)
    after = tendon_arms(paths, group, coordinates, levered, work)
    np.testing.assert_allclose(after.tendon, arms.path, atol=1e-12)


def test_ratios_and_arms_of_the_generic_model_are_as_published(bent) -> None:
    """Buff et al. 1988: 1.16 at 10 and 0.645 at 70 degrees.

    Krevolin et al. 2004: tendon moment arms of 4 to 6 cm at most.
    """
    _, _, paths, coordinates, pulls, work = bent
    arms = tendon_arms(paths, right(paths), coordinates, pulls, work)
    whole = arms.ratio.mean(axis=1)
    degrees = np.degrees(ANGLES)
    assert (np.diff(whole[(degrees > 35.0) & (degrees < 95.0)]) < 0.0).all()
    assert np.all((whole[degrees > 85.0] > 0.55) & (whole[degrees > 85.0] < 0.65))
    assert np.all((-arms.tendon > 0.033) & (-arms.tendon < 0.06))


def test_a_model_without_a_patella_stays_as_it_is(data) -> None:
    model = read_osim(data("ceinms-emg-walk/model/gait2392.osim"))
    paths = compile_paths(model)
    coordinates = paths.tree.defaults[None]
    pulls, work = paths.pulls(coordinates)
    assert with_lever(paths, coordinates, pulls, work) is pulls
