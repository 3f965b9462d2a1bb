"""Tracked swings as equations: true for the true parameters only where the limb is free."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from swung_specimen import HELD, Release, Swung, arm_specimen, limb_parameters, swing

from myomorph.core.model.errors import BadData
from myomorph.core.model.series import Markers, Motion, Wrenches
from myomorph.core.model.spatial import Transform
from myomorph.core.motion.clocks import Clock
from myomorph.swings.viscosity.specimen.model import SpecimenNames, SwingTrial, build_specimen
from myomorph.swings.viscosity.swings.recording import (
    REACH,
    CarriedLimb,
    SwingRecording,
    swing_numbers,
    touched_frames,
    whole_frames,
)
from myomorph.swings.viscosity.tracking.track import track
from myomorph.swings.viscosity.tracking.tracked import (
    TrackedSpecimen,
    TrackedTrial,
    TrackingOptions,
    swing_recordings,
)

SPECIMEN = arm_specimen()
CUTOFF = 10.0
PLAIN = TrackingOptions(clock=False, find_contact=False)


@lru_cache(maxsize=1)
def swung() -> Swung:
    return swing(SPECIMEN, Release(seconds=6.0))


@lru_cache(maxsize=1)
def recording() -> SwingRecording:
    (found,) = swing_recordings(track(SPECIMEN, [swung().trial], PLAIN), CUTOFF)
    return found


def noisy(trial: SwingTrial, seed: int = 0) -> SwingTrial:
    """0.3 mm on markers, 0.3 N and 20 N mm on the plate."""
    rng = np.random.default_rng(seed)
    values = trial.markers.values + 3e-4 * rng.normal(size=trial.markers.values.shape)
    given = trial.wrenches
    wrenches = replace(
        given,
        forces=given.forces + 0.3 * rng.normal(size=given.forces.shape),
        torques=given.torques + 0.02 * rng.normal(size=given.torques.shape),
    )
    return replace(trial, markers=replace(trial.markers, values=values), wrenches=wrenches)


def joined(first: SwingTrial, second: SwingTrial) -> SwingTrial:
    """One trial after the other."""
    step = first.markers.time[1]
    after = first.markers.time[-1] + step

    def both(name: str):
        return np.concatenate([getattr(first.wrenches, name), getattr(second.wrenches, name)])

    markers = Markers(
        np.concatenate([first.markers.time, second.markers.time + after]),
        first.markers.names,
        np.concatenate([first.markers.values, second.markers.values]),
    )
    time = np.concatenate([first.wrenches.time, second.wrenches.time + after])
    wrenches = Wrenches(
        time=time,
        names=("plate",),
        bodies=("",),
        forces=both("forces"),
        points=both("points"),
        torques=both("torques"),
    )
    return SwingTrial("joined", markers, wrenches)


def test_the_rows_explain_wrench_and_torque_by_the_true_parameters():
    """Newton-Euler of an integrator that knows nothing of the rows; the filter's error is left."""
    one = recording()
    truth = swung()
    use = one.used
    size = np.abs(one.wrench[use]).max(axis=0)
    error = one.wrench_rows[use] @ truth.parameters - one.wrench[use]
    assert np.sqrt(np.mean(error[:, 3:] ** 2)) < 1e-3 * size[3:].max()
    assert np.sqrt(np.mean(error[:, :3] ** 2)) < 2e-3
    torque = one.torque_rows[use] @ truth.parameters
    assert np.sqrt(np.mean((torque + truth.damping * one.rates[use]) ** 2)) < 2e-3
    np.testing.assert_allclose(one.rates[use], truth.rates[use], atol=5e-3)
    damping = -(torque * one.rates[use]).sum() / (one.rates[use] ** 2).sum()
    assert damping == pytest.approx(truth.damping, rel=2e-3)


def test_the_wrench_of_the_rows_is_that_of_the_joint_torque():
    one = recording()
    truth = swung()
    moment = (one.wrench_rows @ truth.parameters)[:, :3]
    np.testing.assert_allclose(
        np.einsum("fji,fj->fi", one.rotations, moment), one.torque_rows @ truth.parameters
    )


def test_angles_count_from_the_mean_of_the_swings():
    one = recording()
    turned = Rotation.from_rotvec(one.angles[one.used]).as_matrix()
    rest = np.einsum("fij,fkj->fik", one.rotations[one.used], turned)
    np.testing.assert_allclose(rest, np.broadcast_to(rest[0], rest.shape), atol=1e-9)
    assert np.abs(Rotation.from_matrix(turned.mean(axis=0)).as_rotvec()).max() < 1e-6


def test_swings_last_from_a_turn_to_the_next_but_one():
    one = recording()
    numbers, counts = np.unique(one.swing[one.used], return_counts=True)
    assert list(numbers) == list(range(len(numbers)))
    period = 0.005 * np.median(counts)
    # A physical pendulum's, a little longer at large angles.
    phi = swung().parameters
    small = 2.0 * np.pi * np.sqrt(0.26 / (9.81 * np.linalg.norm(phi[1:4])))
    assert small < period < 1.1 * small
    speed = np.linalg.norm(one.rates, axis=1)
    for number in numbers[1:]:
        first = np.flatnonzero(one.swing == number)[0]
        assert speed[first] < 0.35 * speed[one.used].max()


def test_ends_and_gaps_are_out_of_the_filters_reach():
    truth = swung()
    values = np.array(truth.trial.markers.values)
    values[500:520, 3:] = np.nan
    trial = replace(truth.trial, markers=replace(truth.trial.markers, values=values))
    tracked = track(SPECIMEN, [trial], PLAIN)
    (one,) = swing_recordings(tracked, CUTOFF)
    reach = round(REACH / CUTOFF / 0.005)
    left_out = set(np.flatnonzero(~one.used))
    assert left_out == {*range(reach), *range(500 - reach, 520 + reach), *range(1200 - reach, 1200)}
    error = one.wrench_rows[one.used] @ truth.parameters - one.wrench[one.used]
    assert np.sqrt(np.mean(error**2)) < 0.03
    assert np.isfinite(one.lengthening[one.used]).all()
    # A second run of swings, a number of its own.
    assert one.swing[600] > one.swing[450]


def test_a_gap_of_the_plate_is_left_out_too():
    truth = swung()
    forces = np.array(truth.trial.wrenches.forces)
    forces[3000:3050] = np.nan
    trial = replace(truth.trial, wrenches=replace(truth.trial.wrenches, forces=forces))
    (one,) = swing_recordings(track(SPECIMEN, [trial], PLAIN), CUTOFF)
    assert not one.used[590:620].any()
    assert one.used[550]
    assert one.used[660]
    error = one.wrench_rows[one.used] @ truth.parameters - one.wrench[one.used]
    assert np.sqrt(np.mean(error**2)) < 0.03


def test_releases_within_a_trial_and_the_hand_between_them():
    first = swing(SPECIMEN, Release(seconds=4.0))
    second = swing(SPECIMEN, Release(turned=(-0.5, 0.1, 0.4), seconds=6.0, hold=1.5))
    trial = noisy(joined(first.trial, second.trial))
    tracked = track(SPECIMEN, [trial], TrackingOptions(clock=False))
    touched = tracked.trials[0].touched
    time = trial.markers.time
    held = (time > 4.0) & (time < 5.5)
    assert touched[held].all()
    assert not touched[(time < 3.6) | (time > 5.7)].any()
    (one,) = swing_recordings(tracked, 8.0)
    before = set(one.swing[time < 4.0]) - {-1}
    after = set(one.swing[time > 5.5]) - {-1}
    assert len(before) >= 2
    assert len(after) >= 3
    assert not before & after
    used = one.used
    phi = np.linalg.lstsq(
        one.wrench_rows[used].reshape(-1, 10), one.wrench[used].ravel(), rcond=None
    )[0]
    assert phi[0] == pytest.approx(first.parameters[0], rel=2e-3)
    np.testing.assert_allclose(phi[1:4], first.parameters[1:4], atol=2e-3)


def test_hands_are_found_whatever_the_plate_was_tared_with():
    rng = np.random.default_rng(1)
    truth = recording()
    rows = np.array(truth.wrench_rows)
    wrench = np.array(truth.wrench) + rng.normal(size=6) * 20.0
    free = truth.used
    hand = (truth.time > 2.0) & (truth.time < 2.4)
    wrench[hand, 3:] += [1.5, 0.0, -1.0]
    carried = CarriedLimb(time=truth.time, rows=rows, wrench=wrench, candidates=free)
    (found,) = touched_frames([carried], 0.1, 0.1)
    assert found[hand].all()
    assert not found[(truth.time < 1.8) | (truth.time > 2.6)].any()


@pytest.mark.parametrize(("offset", "drift"), [(0.03, 4e-5), (-0.7, 0.0)])
def test_the_plates_clock_is_found_and_corrected(offset, drift):
    truth = swing(SPECIMEN, Release(seconds=12.0, hold=1.0))
    time = truth.trial.wrenches.time
    other = replace(truth.trial.wrenches, time=(time - offset) / (1.0 + drift))
    tracked = track(SPECIMEN, [noisy(replace(truth.trial, wrenches=other))])
    clock = tracked.trials[0].clock
    error = clock.times(other.time) - time
    assert np.abs(error).max() < 2e-3
    assert any("corrected" in note for note in tracked.trials[0].notes)
    (one,) = swing_recordings(tracked, 8.0)
    residual = one.wrench_rows[one.used] @ truth.parameters - one.wrench[one.used]
    assert np.sqrt(np.mean(residual**2)) < 0.1


def test_clocks_that_agree_are_left_alone():
    tracked = track(SPECIMEN, [noisy(swung().trial)])
    assert tracked.trials[0].clock.offset == 0.0
    assert not tracked.trials[0].notes


def test_a_hinge_swings_about_its_axis():
    from swung_specimen import arm_model

    specimen = build_specimen(
        arm_model(), SpecimenNames("humerus", "ulna", ("radius", "hand"), joint="hinge")
    )
    phi = limb_parameters(specimen, HELD)
    time = 0.005 * np.arange(800)
    angle = 0.8 * np.exp(-0.4 * time) * np.cos(7.0 * time) + 0.2
    motion = Motion(time, specimen.joint_coordinates, angle[:, None])
    trial = TrackedTrial(
        name="hinge",
        motion=motion,
        wrench=np.zeros((800, 6)),
        touched=np.zeros(800, bool),
        rms=np.zeros(800),
        clock=Clock(),
    )
    (one,) = swing_recordings(
        TrackedSpecimen(specimen=specimen, trials=(trial,), held={}, slips=()), None
    )
    assert one.axes == ("ulna_angle",)
    assert one.torque_rows.shape == (800, 1, 10)
    assert one.muscles == tuple(specimen.muscles)
    np.testing.assert_allclose(one.angles[:, 0], angle - angle.mean(), atol=1e-12)
    inertia = (one.torque_rows @ phi)[:, 0]
    assert np.corrcoef(inertia, np.gradient(np.gradient(angle, 0.005), 0.005))[0, 1] > 0.9


def test_swing_numbers_of_a_decaying_oscillation():
    time = 0.01 * np.arange(1000)
    angle = np.exp(-0.2 * time) * np.cos(2 * np.pi * time)
    rate = np.zeros(1000)
    rate[:] = np.gradient(angle, 0.01)
    free = np.ones(1000, bool)
    free[400:450] = False
    numbers = swing_numbers(angle, rate, free, 0.01)
    assert (numbers[400:450] == -1).all()
    assert list(np.unique(numbers[:400])) == [0, 1, 2, 3]
    assert numbers[450] == 4
    assert [int((numbers == k).sum()) for k in range(1, 3)] == pytest.approx([100, 100], abs=2)
    # A limb that hangs still keeps its last numbers, cut as long as the swings before.
    still = swing_numbers(
        np.where(time < 5.0, angle, 0.0), np.where(time < 5.0, rate, 0.0), np.ones(1000, bool), 0.01
    )
    assert np.unique(still, return_counts=True)[1].max() < 200


def test_frames_in_reach_of_ends_are_told():
    finite = np.ones(100, bool)
    finite[50] = False
    whole = whole_frames(0.01 * np.arange(100), finite, 10.0 * REACH)
    assert set(np.flatnonzero(~whole)) == {*range(10), *range(40, 61), *range(90, 100)}


def test_nothing_free_is_refused():
    tracked = track(SPECIMEN, [swung().trial], PLAIN)
    held = replace(
        tracked, trials=tuple(replace(one, touched=np.ones(1200, bool)) for one in tracked.trials)
    )
    with pytest.raises(BadData, match="none of the trials swing has a frame of free swing"):
        swing_recordings(held, CUTOFF)


def test_recordings_without_muscles_have_none():
    tracked = track(SPECIMEN, [swung().trial], PLAIN)
    (one,) = swing_recordings(tracked, CUTOFF, muscles=False)
    assert one.muscles == ()
    assert one.lengthening.shape == (1200, 0, 3)


def test_swings_are_told_by_the_limbs_sway_however_much_it_twists():
    time = 0.005 * np.arange(1600)
    sway = 0.4 * np.cos(5.0 * time)
    twist = 4.0 * np.sin(2.0 * time)
    turns = Rotation.from_rotvec(np.outer(sway, [0.6, 0.0, 0.8])) * Rotation.from_rotvec(
        np.outer(twist, [0.0, 1.0, 0.0])
    )
    hanging = SPECIMEN.standing(Transform(np.eye(3), np.zeros(3))).resting(np.eye(3))
    motion = Motion(time, hanging.joint_coordinates, turns.as_euler("XYZ"))
    trial = TrackedTrial(
        name="twist",
        motion=motion,
        wrench=np.zeros((1600, 6)),
        touched=np.zeros(1600, bool),
        rms=np.zeros(1600),
        clock=Clock(),
    )
    (one,) = swing_recordings(
        TrackedSpecimen(specimen=hanging, trials=(trial,), held={}, slips=()), None, muscles=False
    )
    counts = np.unique(one.swing, return_counts=True)[1]
    assert counts[:-1] == pytest.approx(
        np.full(len(counts) - 1, 2.0 * np.pi / 5.0 / 0.005), rel=0.05
    )
