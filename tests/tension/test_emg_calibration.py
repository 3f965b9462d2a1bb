"""Delay and gains of EMG found inside the tension problem: made ones come back, and the slope of the cost is right."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from walking import task, walk

from myomorph.io.osim.read import read_osim
from myomorph.io.sto import motion_from_table, read_sto
from myomorph.model.errors import BadData, UnknownName
from myomorph.model.series import Emg, Motion, Series
from myomorph.motion.emg_delay import EmgCalibration
from myomorph.motion.filters import differentiate, lowpass
from myomorph.rigid.dynamics import inverse_dynamics
from myomorph.tension.emg_calibration import EmgOptions, EmgTrial, _contacts_known, _Piece, calibrate_emg, emg_targets
from myomorph.tension.solve import solve_tension

ARM = "opensim-reference-small/"
GAINS = np.array([0.5, 2.0, 1.2])
CHANNELS = {"triceps": ("TRIlong", "TRIlat"), "biceps": ("BIClong",), "brachialis": ("BRA",)}
DELAY = 0.06


@pytest.fixture(scope="module")
def arm(data):
    """OpenSim's arm over four rounds of a movement of our own, its torques, and its tensions without EMG."""
    model = read_osim(data(ARM + "arm26_bounds.osim"))
    given = motion_from_table(read_sto(data(ARM + "arm26_InverseKinematics.mot")), model)
    time = np.arange(0.0, 4.0, 0.01)
    turn = 2.0 * np.pi * 0.9 * time
    swing = np.column_stack([0.6 * np.sin(turn), 1.1 + 0.8 * np.sin(1.7 * turn + 0.5)])
    motion = differentiate(replace(given, time=time, names=("r_shoulder_elev", "r_elbow_flex"), values=swing))
    torques = inverse_dynamics(model, motion)
    return model, motion, torques, solve_tension(model, motion, torques)


def emg_of(arm, gains=GAINS, delay=DELAY) -> Emg:
    """Envelopes that give the activations without EMG, `delay` later and times `gains`; of muscles that agree."""
    _, motion, _, alone = arm
    columns = []
    for (_, muscles), gain in zip(CHANNELS.items(), gains, strict=True):
        mean = np.mean([alone.activations[:, alone.muscles.index(one)] for one in muscles], axis=0)
        columns.append(mean / gain)
    return Emg(motion.time - delay, tuple(CHANNELS), np.array(columns).T)


def test_delay_and_gains_are_found_again(arm):
    model, motion, torques, alone = arm
    emg = emg_of(arm)
    only = {name: muscles for name, muscles in CHANNELS.items() if len(muscles) == 1}
    found = calibrate_emg(model, [EmgTrial(motion, torques, emg)], only)
    np.testing.assert_allclose(found.delays, DELAY, atol=0.0011)
    np.testing.assert_allclose(found.gains, GAINS[1:], rtol=0.01)
    told = emg_targets(emg, only, model, motion.time, EmgOptions(), found)
    informed = solve_tension(model, motion, torques, emg=told)
    np.testing.assert_allclose(informed.activations, alone.activations, atol=0.01)


def test_two_trials_share_one_gain(arm):
    model, motion, torques, _ = arm
    only = {"biceps": ("BIClong",)}
    trials = [EmgTrial(motion, torques, emg_of(arm)) for _ in range(2)]
    found = calibrate_emg(model, trials, only, EmgOptions(delay=DELAY))
    assert found.gains[0] == pytest.approx(GAINS[1], rel=0.01)
    assert found.delays[0] == DELAY


def test_gains_scale_against_the_envelopes(arm):
    model, motion, torques, _ = arm
    emg = emg_of(arm)
    larger = Emg(emg.time, emg.names, emg.values * 3.0)
    options = EmgOptions(delay=DELAY)
    first = calibrate_emg(model, [EmgTrial(motion, torques, emg)], CHANNELS, options)
    second = calibrate_emg(model, [EmgTrial(motion, torques, larger)], CHANNELS, options)
    np.testing.assert_allclose(3.0 * second.gains, first.gains, rtol=2e-3)


def piece(arm, emg: Emg) -> _Piece:
    model, motion, torques, _ = arm
    moved = np.array([np.interp(motion.time - DELAY, emg.time, column) for column in emg.values.T]).T
    return _Piece(model, EmgTrial(motion, torques, emg), moved, CHANNELS, EmgOptions(), None, None, 8)


def test_the_slope_of_the_least_cost_is_that_of_differences(arm):
    rng = np.random.default_rng(1)
    cost = piece(arm, emg_of(arm)).cost
    gains, offsets = rng.uniform(0.3, 2.0, 3), rng.uniform(0.0, 0.1, 3)
    _, to_gains, to_offsets = cost(gains, offsets)
    step = 1e-5
    for k in range(3):
        unit = step * np.eye(3)[k]
        across = (cost(gains + unit, offsets)[0] - cost(gains - unit, offsets)[0]) / (2 * step)
        assert to_gains[k] == pytest.approx(across, rel=1e-4, abs=1e-5)
        across = (cost(gains, offsets + unit)[0] - cost(gains, offsets - unit)[0]) / (2 * step)
        assert to_offsets[k] == pytest.approx(across, rel=1e-4, abs=1e-5)


def test_the_least_cost_is_convex_in_gains_and_offsets(arm):
    rng = np.random.default_rng(2)
    cost = piece(arm, emg_of(arm)).cost
    for _ in range(10):
        a, b = rng.uniform(0.0, 3.0, (2, 6))
        middle = 0.5 * (a + b)
        ends = 0.5 * (cost(a[:3], a[3:])[0] + cost(b[:3], b[3:])[0])
        assert cost(middle[:3], middle[3:])[0] <= ends + 1e-9 * ends


def test_fitted_gains_cost_less_than_any_near_them(arm):
    model, motion, torques, _ = arm
    noisy = emg_of(arm)
    noisy = Emg(noisy.time, noisy.names, noisy.values * np.random.default_rng(3).uniform(0.5, 1.5, noisy.values.shape))
    found = calibrate_emg(model, [EmgTrial(motion, torques, noisy)], CHANNELS, EmgOptions(delay=DELAY))
    cost = piece(arm, noisy).cost
    zero = np.zeros(3)
    # Calibration looks at other frames of the trial than this piece does.
    least = cost(found.gains, zero)[0]
    for factor in (0.8, 1.25):
        for k in range(3):
            other = found.gains * np.where(np.arange(3) == k, factor, 1.0)
            assert cost(other, zero)[0] > least


def test_targets_are_means_of_the_channels_that_are_known(arm):
    model, motion, _, _ = arm
    values = np.column_stack([np.linspace(0.2, 0.3, 400), np.linspace(0.4, 0.6, 400)])
    values[100:200, 0] = np.nan
    emg, channels = Emg(motion.time, ("a", "b"), values), {"a": ["BRA"], "b": ["BRA", "BIClong"]}
    told = emg_targets(emg, channels, model, motion.time, EmgOptions(delay=0.0))
    assert told.muscles == ("BIClong", "BRA")
    np.testing.assert_allclose(told.activations[150, 1], emg.values[150, 1])
    np.testing.assert_allclose(told.activations[300, 1], values[300].mean())


def test_what_cannot_be_used_is_named(arm):
    model, motion, _, _ = arm
    emg = emg_of(arm)
    with pytest.raises(UnknownName, match=r"muscle of EMG channel 'biceps' 'BIC': the model has 'BIClong'"):
        emg_targets(emg, {"biceps": ["BIC"]}, model, motion.time)
    with pytest.raises(UnknownName, match="unknown EMG channel 'bicep': the EMG has 'biceps'"):
        emg_targets(emg, {"bicep": ["BIClong"]}, model, motion.time)
    with pytest.raises(BadData, match="no time in common"):
        emg_targets(Emg(emg.time + 100.0, emg.names, emg.values), {"biceps": ["BIClong"]}, model, motion.time)
    with pytest.raises(BadData, match="no EMG channel tells of a muscle"):
        emg_targets(emg, {"biceps": []}, model, motion.time)
    with pytest.raises(BadData, match="none was given"):
        calibrate_emg(model, [], CHANNELS)
    one = EmgCalibration(("triceps",), np.zeros(1), np.ones(1), np.zeros(1))
    with pytest.raises(UnknownName, match="the calibration has 'triceps'"):
        emg_targets(emg, {"biceps": ["BIClong"]}, model, motion.time, None, one)


def test_a_delay_that_is_not_found_is_told(arm):
    model, motion, torques, _ = arm
    noise = np.abs(np.random.default_rng(4).standard_normal((len(motion), 3)))
    emg = Emg(motion.time, tuple(CHANNELS), noise)
    found = calibrate_emg(model, [EmgTrial(motion, torques, emg)], CHANNELS)
    assert len(found.warnings) == 1
    assert "no delay of all EMG channels was found from 0.01 to 0.15 s" in found.warnings[0]


def test_contact_forces_found_without_emg_are_taken_as_known(data):
    model, motion, _ = walk(data, slice(150, 1150, 200))
    torques = inverse_dynamics(model, motion)
    trial = EmgTrial(motion, torques, Emg(motion.time, ("a",), np.zeros((len(motion), 1))), task(model, motion))
    alone = solve_tension(model, motion, torques, contacts=trial.contacts)
    known = _contacts_known(model, trial, alone)
    assert known.contacts is None
    # Contacts held where they were best leave the muscles where they were best.
    again = solve_tension(model, motion, known.torques)
    np.testing.assert_allclose(again.activations, alone.activations, atol=1e-5)


def test_a_real_walk_follows_its_emg_when_told_to(data):
    model = read_osim(data("ceinms-emg-walk/model/gait2392.osim"))
    folder = "ceinms-emg-walk/walk36/"
    whole = differentiate(motion_from_table(read_sto(data(folder + "ik.sto")), model), 6.0)
    table, given = read_sto(data(folder + "id.sto")), read_sto(data(folder + "emgFilt.sto"))
    span = slice(1000, 1480, 4)
    motion = Motion(whole.time[span], whole.names, whole.values[span], velocities=whole.velocities[span])
    names = tuple(name.removesuffix("_moment").removesuffix("_force") for name in table.names)
    torques = Series(motion.time, names, lowpass(table.values, 100.0, 6.0)[span])
    emg = Emg(given.time, given.names, given.values)
    channels = {name: (name,) for name in emg.names}
    found = calibrate_emg(model, [EmgTrial(motion, torques, emg)], channels)
    assert 0.08 < found.delays[0] <= 0.15
    assert (found.gains > 0.0).all()
    distances = []
    for mode in (None, "soft", "equality"):
        told = emg_targets(emg, channels, model, motion.time, EmgOptions(mode=mode or "soft"), found)
        tension = solve_tension(model, motion, torques, emg=told if mode else None)
        assert tension.optimal.all()
        apart = tension.activations[:, [tension.muscles.index(one) for one in told.muscles]] - told.activations
        distances.append(np.sqrt(np.mean(apart**2)))
    assert distances[1] < 0.6 * distances[0]
    assert distances[2] < 0.6 * distances[1]
