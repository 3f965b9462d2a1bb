"""EMG gains, delays and shapes from joint torques.

Made ones are recovered, with co-contraction, or the reason is reported.
"""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from myomorph.body.tension import emg_calibration
from myomorph.body.tension.emg_calibration import calibrate_emg
from myomorph.body.tension.emg_groups import kept_level
from myomorph.body.tension.emg_held_out import WEIGHTS, EmgTrial, HeldOut
from myomorph.body.tension.task import EmgRecording, emg_targets_of
from myomorph.core.fit.bounds import bounded_step
from myomorph.core.io.osim.read import read_osim
from myomorph.core.io.sto import motion_from_table, read_sto
from myomorph.core.model.errors import BadData, UnknownName
from myomorph.core.model.series import Emg, Motion, Series
from myomorph.core.motion.emg_activation import LIKELIHOOD_95, EmgCalibration, shaped, uncalibrated
from myomorph.core.motion.filters import differentiate, lowpass
from myomorph.core.rigid.dynamics import inverse_dynamics
from myomorph.core.tension.emg_conflicts import APART, conflict_line, emg_conflicts
from myomorph.core.tension.emg_targets import EmgOptions, emg_targets
from myomorph.core.tension.problem import TensionInputs, tension_problem
from myomorph.core.tension.solve import solve_tension
from myomorph.core.tension.tension import TensionOptions
from myomorph.core.tension.terms.emg import EmgTarget

ARM = "opensim-reference-small/"
DELAY = 0.06
RIGID = TensionOptions(passive=False)
PAIR = {"flexor": ("BRA",), "extensor": ("TRIlat",)}


def swinging(data, muscles: tuple[str, ...]):
    """Return OpenSim's arm with some of its muscles, and its inverse dynamics.

    Its elbow swings for four seconds.
    """
    model = read_osim(data(ARM + "arm26_bounds.osim"))
    model = replace(model, muscles=tuple(one for one in model.muscles if one.name in muscles))
    given = motion_from_table(read_sto(data(ARM + "arm26_InverseKinematics.mot")), model)
    time = np.arange(0.0, 4.0, 0.01)
    turn = 2.0 * np.pi * 0.9 * time
    values = np.column_stack([np.zeros(len(time)), 1.2 + 0.7 * np.sin(turn)])
    motion = differentiate(
        replace(given, time=time, names=("r_shoulder_elev", "r_elbow_flex"), values=values)
    )
    return model, motion, inverse_dynamics(model, motion)


@pytest.fixture(scope="module")
def pair(data):
    """Return an antagonist pair that co-contracts by 0.3.

    The values are model, motion, the torques that its activations make, the activations, and
    forces.
    """
    model, motion, torques = swinging(data, ("BRA", "TRIlat"))
    problem = tension_problem(
        TensionInputs(model=model, motion=motion, torques=torques, options=RIGID)
    )
    given = problem.balance(0, len(motion))
    count = len(problem.separable.weight)
    whole = np.zeros((len(motion), given.right.shape[1], count))
    whole[
        :, problem.separable.row, np.repeat(np.arange(count), np.diff(problem.separable.start))
    ] = given.values
    row = problem.assembly.coordinate_row[problem.assembly.coordinates.index("r_elbow_flex")]
    arms = whole[:, row, :2]
    flexor = model.muscle_names.index("BRA")
    extensor = model.muscle_names.index("TRIlat")
    activations = solve_tension(model, motion, torques, RIGID).activation.copy()
    activations[:, flexor] += 0.3
    activations[:, extensor] -= 0.3 * arms[:, flexor] / arms[:, extensor]
    assert 0.3 < activations.max() < 1.0
    values = torques.values.copy()
    values[:, torques.names.index("r_elbow_flex")] += (
        np.sum(arms * activations, axis=1) - given.right[:, row]
    )
    return (
        model,
        motion,
        Series(torques.time, torques.names, values),
        activations,
        given.active * activations,
    )


def recorded(pair, gains=(1.0, 1.0), delay: float = DELAY, shape: float = 0.0) -> Emg:
    """Noise-free envelopes that make the pair's activations with these gains, `delay` later."""
    model, motion, _, activations, _ = pair
    order = [model.muscle_names.index(names[0]) for names in PAIR.values()]
    envelopes = activations[:, order] / np.array(gains)
    if shape:
        envelopes = np.log1p(envelopes * np.expm1(shape)) / shape
        np.testing.assert_allclose(
            shaped(envelopes, np.full(2, shape)), activations[:, order] / np.array(gains)
        )
    return Emg(motion.time - delay, tuple(PAIR), envelopes)


@pytest.mark.parametrize("gains", [(1.0, 1.0), (0.6, 2.5)])
@pytest.mark.parametrize("delay", [0.0, DELAY])
def test_co_contraction_is_found_by_default(pair, gains, delay):
    model, motion, torques, _, forces = pair
    emg = recorded(pair, gains, delay)
    found = calibrate_emg(model, [EmgTrial(motion, torques, emg)], PAIR, None, RIGID)
    np.testing.assert_allclose(found.gains, gains, rtol=0.05)
    np.testing.assert_allclose(found.delays, delay, atol=0.003)
    assert found.by_torque.all()
    assert (found.intervals[:, 0] <= gains).all()
    assert (found.intervals[:, 1] >= gains).all()
    assert found.warnings == ()
    assert found.estimate.converged
    np.testing.assert_allclose(np.exp(found.estimate.values["gains"]), found.gains, rtol=1e-12)
    assert "joint torques" in " ".join(found.estimate.certificate)
    target = emg_targets(emg, PAIR, model, motion.time, None, found)
    informed = solve_tension(model, motion, torques, RIGID, emg=target)
    # Both muscles press the joint together: their forces add up.
    use = slice(10, -10)
    assert informed.muscle_force[use].sum() == pytest.approx(forces[use].sum(), rel=0.05)
    alone = solve_tension(model, motion, torques, RIGID)
    assert alone.muscle_force[use].sum() < 0.5 * forces[use].sum()
    assert emg_conflicts(model, informed, target) == ()


def test_noise_widens_the_intervals_and_moves_the_gains_little(pair):
    model, motion, torques, _, _ = pair
    emg = recorded(pair)
    rng = np.random.default_rng(2)
    rough = Emg(
        emg.time,
        emg.names,
        np.clip(emg.values + 0.02 * rng.standard_normal(emg.values.shape), 0.0, 1.0),
    )
    clean = calibrate_emg(
        model, [EmgTrial(motion, torques, emg)], PAIR, EmgOptions(delay=DELAY, weight=1.0), RIGID
    )
    noisy = calibrate_emg(
        model, [EmgTrial(motion, torques, rough)], PAIR, EmgOptions(delay=DELAY, weight=1.0), RIGID
    )
    np.testing.assert_allclose(noisy.gains, 1.0, rtol=0.1)
    assert (np.ptp(noisy.intervals, axis=1) > 2.0 * np.ptp(clean.intervals, axis=1)).all()


def test_noise_does_not_make_gains_small(pair, monkeypatch):
    """Noise of a fifth of the activations.

    Without the correction the gains are too small, with it nearer to 1.
    """
    model, motion, torques, _, _ = pair
    emg = recorded(pair)
    rng = np.random.default_rng(6)
    rough = Emg(emg.time, emg.names, emg.values + 0.15 * rng.standard_normal(emg.values.shape))
    options = EmgOptions(delay=DELAY, weight=1.0)
    trials = [EmgTrial(motion, torques, rough)]
    corrected = calibrate_emg(model, trials, PAIR, options, RIGID).gains
    monkeypatch.setattr(emg_calibration, "_noise", lambda *_: np.zeros(2))
    plain = calibrate_emg(model, trials, PAIR, options, RIGID).gains
    assert (plain < 1.0).all()
    assert (np.abs(corrected - 1.0) < np.abs(plain - 1.0)).all()


def test_two_trials_share_one_gain(pair):
    model, motion, torques, _, _ = pair
    emg = recorded(pair, (0.5, 2.0))
    half = len(motion) // 2
    trials = []
    for use in (slice(0, half), slice(half, None)):
        part = Motion(
            motion.time[use], motion.names, motion.values[use], velocities=motion.velocities[use]
        )
        trials.append(EmgTrial(part, Series(part.time, torques.names, torques.values[use]), emg))
    found = calibrate_emg(model, trials, PAIR, EmgOptions(delay=DELAY, weight=1.0), RIGID)
    np.testing.assert_allclose(found.gains, (0.5, 2.0), rtol=0.02)


def test_the_shape_is_found(pair):
    model, motion, torques, _, _ = pair
    emg = recorded(pair, shape=-2.0)
    trials = [EmgTrial(motion, torques, emg)]
    found = calibrate_emg(
        model, trials, PAIR, EmgOptions(shape=None, delay=DELAY, weight=1.0), RIGID
    )
    assert found.shapes[0] == -2.0
    np.testing.assert_allclose(found.gains, 1.0, rtol=0.02)
    straight = calibrate_emg(
        model, trials, PAIR, EmgOptions(shape=0.0, delay=DELAY, weight=1.0), RIGID
    )
    assert np.abs(straight.gains - 1.0).max() > 0.1
    # With the delay unknown, too, neighbouring shapes are alike for torques.
    both = calibrate_emg(model, trials, PAIR, EmgOptions(shape=None, weight=1.0), RIGID)
    assert abs(both.shapes[0] + 2.0) <= 0.5
    np.testing.assert_allclose(both.gains, 1.0, rtol=0.05)
    np.testing.assert_allclose(both.delays, DELAY, atol=0.02)


def test_maximum_contractions_bound_the_gains(pair):
    model, motion, torques, _, _ = pair
    emg = recorded(pair)
    maxima = {"flexor": 0.9, "extensor": 1.6}
    options = EmgOptions(delay=DELAY, weight=1.0)
    found = calibrate_emg(
        model, [EmgTrial(motion, torques, emg)], PAIR, options, RIGID, maxima=maxima
    )
    assert found.gains[1] == pytest.approx(1.0 / 1.6)
    assert (found.gains * np.array([0.9, 1.6]) <= 1.0 + 1e-9).all()


def test_a_gain_that_torques_do_not_tell_is_the_usual_one_and_named(data):
    """Six muscles at two joints and EMG of one: the others can bear whatever it does not."""
    model, motion, torques = swinging(
        data, ("BRA", "BIClong", "BICshort", "TRIlong", "TRIlat", "TRImed")
    )
    emg = Emg(motion.time, ("one",), 0.5 + 0.5 * np.sin(3.0 * motion.time)[:, None] ** 2)
    found = calibrate_emg(
        model, [EmgTrial(motion, torques, emg)], {"one": ("TRIlat",)}, None, RIGID
    )
    assert not found.by_torque[0]
    assert found.intervals[0, 1] > 2.0 * found.intervals[0, 0]
    assert any("torques hardly determine the EMG gain of one" in text for text in found.warnings)


def test_normalized_envelopes_are_activations(pair):
    model, motion, torques, activations, _ = pair
    emg = recorded(pair)
    found = calibrate_emg(
        model,
        [EmgTrial(motion, torques, emg)],
        PAIR,
        EmgOptions(gains="normalized", delay=DELAY),
        RIGID,
    )
    assert found.gains.tolist() == [1.0, 1.0]
    told = emg_targets(emg, PAIR, model, motion.time, EmgOptions(gains="normalized"), found)
    np.testing.assert_allclose(told.activations, activations, atol=1e-9)


def test_what_emg_and_torque_cannot_both_have_is_told(pair):
    """The flexor's EMG is silent for half a second in which the joint needs it."""
    model, motion, torques, activations, _ = pair
    told = activations.copy()
    flexor = model.muscle_names.index("BRA")
    silent = (motion.time > 1.0) & (motion.time < 1.5)
    told[silent, flexor] = 0.0
    target = EmgTarget(model.muscle_names, told, "driven")
    found = solve_tension(model, motion, torques, RIGID, emg=target)
    conflicts = emg_conflicts(model, found, target)
    assert conflicts
    for one in conflicts:
        assert 0.98 <= one.start <= one.worst <= one.stop <= 1.52
        assert abs(one.found - one.emg) > APART or one.coordinate == "r_elbow_flex"
    (line,) = conflict_line(conflicts, "table.csv")
    assert line.startswith("EMG and torques contradict each other: ")
    assert "see table.csv" in line
    assert conflict_line((), "table.csv") == ()


def test_bounded_least_squares_is_that_of_scipy():
    rng = np.random.default_rng(5)
    for _ in range(20):
        rows = rng.standard_normal((12, 6))
        target = rng.standard_normal(12)
        upper = rng.uniform(0.05, 0.6, 6)
        wanted = lsq_linear(rows, target, (0.0, upper), tol=1e-12).x
        found = bounded_step(rows.T @ rows, -rows.T @ target, np.zeros(6), upper)
        cost = float(np.sum((rows @ found - target) ** 2))
        least = float(np.sum((rows @ wanted - target) ** 2))
        assert ((found >= 0.0) & (found <= upper + 1e-12)).all()
        assert cost <= least * 1.02 + 1e-9


def test_targets_are_means_of_the_channels_that_are_known(data):
    model, motion, _ = swinging(data, ("BRA", "BIClong", "TRIlat"))
    values = np.column_stack([np.linspace(0.2, 0.3, 400), np.linspace(0.4, 0.6, 400)])
    values[100:200, 0] = np.nan
    emg = Emg(motion.time, ("a", "b"), values)
    channels = {"a": ["BRA"], "b": ["BRA", "BIClong"]}
    told = emg_targets(emg, channels, model, motion.time, EmgOptions(delay=0.0))
    assert told.muscles == ("BIClong", "BRA")
    np.testing.assert_allclose(told.activations[150, 1], emg.values[150, 1])
    np.testing.assert_allclose(told.activations[300, 1], values[300].mean())


def test_what_cannot_be_used_is_named(pair):
    model, motion, _, _, _ = pair
    emg = recorded(pair)
    with pytest.raises(UnknownName, match=r"muscle of EMG channel 'flexor' 'BIC': the model has"):
        emg_targets(emg, {"flexor": ["BIC"]}, model, motion.time)
    with pytest.raises(UnknownName, match="unknown EMG channel 'flex': the EMG has 'flexor'"):
        emg_targets(emg, {"flex": ["BRA"]}, model, motion.time)
    with pytest.raises(BadData, match="no time in common"):
        emg_targets(Emg(emg.time + 100.0, emg.names, emg.values), PAIR, model, motion.time)
    with pytest.raises(BadData, match="no EMG channel belongs to a muscle"):
        emg_targets(emg, {"flexor": []}, model, motion.time)
    with pytest.raises(BadData, match="give one or more"):
        calibrate_emg(model, [], PAIR)
    one = EmgCalibration(
        channels=("extensor",), delays=np.zeros(1), gains=np.ones(1), offsets=np.zeros(1)
    )
    with pytest.raises(UnknownName, match="the calibration has 'extensor'"):
        emg_targets(emg, {"flexor": ["BRA"]}, model, motion.time, None, one)
    for wrong, message in (
        ({"gains": "given"}, "there are 'fitted', 'normalized'"),
        ({"unmeasured": "zero"}, "there are 'effort', 'synergies'"),
        ({"shape": 2.0}, "expected -10 to 0"),
    ):
        with pytest.raises(BadData, match=message):
            replace(EmgOptions(), **wrong)


def test_a_delay_that_torques_do_not_tell_is_said(data):
    model, motion, torques = swinging(data, ("BRA", "BIClong", "TRIlat", "TRIlong"))
    noise = np.abs(np.random.default_rng(4).standard_normal((len(motion), 1))) * 0.01 + 0.3
    found = calibrate_emg(
        model,
        [EmgTrial(motion, torques, Emg(motion.time, ("a",), noise))],
        {"a": ("TRIlat",)},
        None,
        RIGID,
    )
    assert any(
        "the torques determine no delay of the EMG channels" in text for text in found.warnings
    )


def _real_walk(data, model):
    """Read motion, torques and EMG of 4.8 s of a walk at 25 Hz."""
    folder = "ceinms-emg-walk/walk36/"
    whole = differentiate(motion_from_table(read_sto(data(folder + "ik.sto")), model), 6.0)
    table = read_sto(data(folder + "id.sto"))
    given = read_sto(data(folder + "emgFilt.sto"))
    span = slice(1000, 1480, 4)
    motion = Motion(
        whole.time[span], whole.names, whole.values[span], velocities=whole.velocities[span]
    )
    names = tuple(name.removesuffix("_moment").removesuffix("_force") for name in table.names)
    torques = Series(motion.time, names, lowpass(table.values, 100.0, 6.0)[span])
    return motion, torques, Emg(given.time, given.names, given.values)


def test_a_real_walk_follows_its_emg_when_told_to(data):
    model = read_osim(data("ceinms-emg-walk/model/gait2392.osim"))
    motion, torques, emg = _real_walk(data, model)
    channels = {name: (name,) for name in emg.names}
    found = calibrate_emg(model, [EmgTrial(motion, torques, emg)], channels, None, RIGID)
    assert 0.08 < found.delays[0] <= 0.15
    assert (found.gains > 0.0).all()
    unmeasured = {name for one in found.synergies for name in one.muscles}
    assert "vas_int_r" in unmeasured
    assert "glut_max1_r" not in unmeasured
    assert "soleus_l" not in unmeasured
    # Held-out channels do not come out worse than without EMG, or it is said of which.
    before, after = found.held_out.T
    assert after.mean() >= before.mean() - 0.01
    for name, fall in zip(found.channels, before - after, strict=True):
        assert fall <= 0.05 or any("misleads" in text and name in text for text in found.warnings)
    distances = []
    for options in (None, EmgOptions(weight=10.0), EmgOptions(mode="driven")):
        target = emg_targets(emg, channels, model, motion.time, options, found)
        tension = solve_tension(
            model, motion, torques, RIGID, emg=None if options is None else target
        )
        assert tension.optimal.all()
        measured = [tension.muscles.index(one) for one in target.muscles]
        apart = tension.activation[:, measured] - target.activations
        distances.append(np.sqrt(np.mean(apart**2)))
    assert distances[1] < 0.8 * distances[0]
    assert distances[2] < 0.6 * distances[1]


@pytest.mark.parametrize("misfit", [0.0, 100.0])
@pytest.mark.parametrize(("worse", "chosen"), [(0.9, "known"), (1.1, "free")])
def test_a_level_is_given_up_where_torques_are_so_much_likelier_without_it(misfit, worse, chosen):
    """The likelihood ratio decides, not how well either explains the torques."""
    misfits = {None: misfit, "known": misfit + worse * LIKELIHOOD_95}
    tracking = SimpleNamespace(
        prior="free", fit=lambda *given: SimpleNamespace(misfit=misfits[(*given, None)[2]])
    )
    assert kept_level(tracking, "known", np.zeros(1), np.zeros(1)) == chosen


@pytest.mark.parametrize("channels", [("flexor",), ("flexor", "extensor")])
def test_emg_that_nothing_can_check_takes_no_part(pair, channels):
    """A channel cannot be left out where it is the only one, or where none shows its muscles."""
    model, motion, torques, _, _ = pair
    held = object.__new__(HeldOut)
    held.calibration = SimpleNamespace(channels=channels)
    held._without = lambda channel, out: np.full(1 + len(WEIGHTS), np.nan)
    held._with_twins = list
    calibration = held.chosen(uncalibrated(channels, DELAY))
    assert calibration.weight == 0.0
    measured = {name: PAIR[name] for name in channels}
    told = EmgRecording(
        emg=recorded(pair),
        muscles=measured,
        maxima={},
        options=EmgOptions(),
        calibration=calibration,
    )
    inputs = TensionInputs(
        model=model, motion=motion, torques=torques, options=RIGID, actuators=None
    )
    targets = emg_targets_of(told, inputs)
    assert targets.target is None
    assert any("EMG is not used, as nothing checks it" in note for note in targets.notes)


@pytest.mark.parametrize(("after", "weight"), [(0.6, 10.0), (0.4, 0.0)])
def test_emg_takes_no_part_where_channels_that_are_left_out_come_out_worse(pair, after, weight):
    model, motion, torques, _, _ = pair
    held = object.__new__(HeldOut)
    held.calibration = SimpleNamespace(channels=tuple(PAIR))
    held._without = lambda channel, out: np.array([0.5, *np.full(len(WEIGHTS), after)])
    held._with_twins = list
    calibration = held.chosen(uncalibrated(tuple(PAIR), DELAY))
    assert calibration.weight == weight
    told = EmgRecording(
        emg=recorded(pair), muscles=PAIR, maxima={}, options=EmgOptions(), calibration=calibration
    )
    targets = emg_targets_of(
        told,
        TensionInputs(model=model, motion=motion, torques=torques, options=RIGID, actuators=None),
    )
    assert (targets.target is None) == (weight == 0.0)
    part = "part" if weight else "no part"
    assert f"EMG takes {part}" in targets.notes[0]
    assert f"0.50 without EMG, {after:.2f} with" in targets.notes[0]
