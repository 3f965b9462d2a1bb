"""EMG in the tension problem.

Soft targets, driven muscles with slack, any exponent, and channels that do not fit.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy
from readable import frame_program, solve_program
from walking import task, walk

from myomorph.body.tension.emg_calibration import calibrate_emg
from myomorph.body.tension.emg_held_out import EmgTrial
from myomorph.core.model.errors import BadData, UnknownName
from myomorph.core.model.series import Emg, Series
from myomorph.core.rigid.dynamics import inverse_dynamics
from myomorph.core.tension.emg_targets import EmgOptions
from myomorph.core.tension.emg_tracking import tracked_frames
from myomorph.core.tension.problem import TensionInputs, tension_problem
from myomorph.core.tension.solve import solve_tension
from myomorph.core.tension.tension import TensionOptions
from myomorph.core.tension.terms.emg import EmgTarget

MUSCLES = ("soleus_r", "tibant_l", "gaslat_r", "recfem_r")


@pytest.fixture(scope="module")
def walker(data):
    """Frames of the walk, their torques with the plates, and activations that EMG may tell."""
    model, motion, loads = walk(data, slice(150, 1150, 100))
    told = np.random.default_rng(3).uniform(0.02, 0.8, (len(motion), len(MUSCLES)))
    return model, motion, inverse_dynamics(model, motion, loads), told


def optimality(problem, found, exponent: float) -> float:
    """Greatest relative slope of the cost that no balance and no bound explains."""
    worst = 0.0
    for frame in range(len(found)):
        given = problem.balance(frame, frame + 1)
        shape = problem.assembly.pattern
        n = len(problem.separable.weight)
        A = np.zeros((len(shape.order), n))
        A[shape.row, np.repeat(np.arange(n), np.diff(shape.start))] = given.values[0]
        x = np.concatenate(
            [
                found.activation[frame],
                found.actuator_force[frame] / problem.actuators.optimal_forces,
            ]
        )
        slope = exponent * np.sign(x) * np.abs(x) ** (exponent - 1.0)
        drawn = problem.penalties[frame : frame + 1][0]
        beyond = x - np.clip(x, drawn[0], drawn[1])
        slope += 2.0 * drawn[2] * np.where(drawn[2] > 0.0, beyond, 0.0)
        inside = (x > problem.separable.lower + 1e-7) & (x < problem.separable.upper - 1e-7)
        y = np.linalg.lstsq(A[:, inside].T, slope[inside], rcond=None)[0]
        left = slope - A.T @ y
        at_low = x <= problem.separable.lower + 1e-7
        at_high = x >= problem.separable.upper - 1e-7
        left = np.where(
            at_low, np.minimum(left, 0.0), np.where(at_high, np.maximum(left, 0.0), left)
        )
        worst = max(worst, float(np.abs(left).max() / (1.0 + np.abs(slope).max())))
    return worst


@pytest.mark.parametrize("exponent", [1.5, 2.0, 3.0])
@pytest.mark.parametrize("mode", ["soft", "driven"])
def test_the_conditions_of_an_optimum_hold_with_emg_for_any_exponent(walker, exponent, mode):
    model, motion, tau, told = walker
    emg = EmgTarget(MUSCLES, told, mode)
    options = TensionOptions(exponent=exponent)
    problem = tension_problem(
        TensionInputs(model=model, motion=motion, torques=tau, options=options, emg=emg)
    )
    problem.solve(0, len(motion))
    found = problem.result()
    assert found.optimal.all()
    assert optimality(problem, found, exponent) < 1e-5


@pytest.mark.parametrize("mode", ["soft", "driven"])
def test_emg_without_contacts_is_the_readable_program(walker, mode):
    model, motion, tau, told = walker
    told = told.copy()
    told[::2, 1] = np.nan
    emg = EmgTarget(MUSCLES, told, mode)
    problem = tension_problem(TensionInputs(model, motion, tau, emg=emg))
    problem.solve(0, len(motion))
    found = problem.result()
    for frame in range(0, len(motion), 3):
        theirs = solve_program(frame_program(problem, frame))[: len(model.muscles)]
        np.testing.assert_allclose(found.activation[frame], theirs, atol=1e-4)


def test_a_soft_target_draws_and_a_driven_muscle_holds(walker):
    """Activations that balance the torques too, but at another cost, are told of."""
    model, motion, tau, _ = walker
    columns = [model.muscle_names.index(name) for name in MUSCLES]
    free = solve_tension(model, motion, tau)
    told = solve_tension(model, motion, tau, TensionOptions(exponent=4.0)).activation[:, columns]
    soft = solve_tension(model, motion, tau, emg=EmgTarget(MUSCLES, told))
    held = solve_tension(model, motion, tau, emg=EmgTarget(MUSCLES, told, "driven", slack=0.03))
    missed = [np.abs(one.activation[:, columns] - told) for one in (free, soft, held)]
    assert missed[0].max() > 0.08
    assert missed[1].mean() < 0.7 * missed[0].mean()
    assert missed[2].max() < 0.03 + 1e-3
    assert missed[2].max() > 0.03 - 1e-3


def test_what_emg_does_not_tell_changes_nothing(walker):
    model, motion, tau, told = walker
    free = solve_tension(model, motion, tau)
    silent = solve_tension(model, motion, tau, emg=EmgTarget(MUSCLES, np.full_like(told, np.nan)))
    np.testing.assert_allclose(silent.activation, free.activation, atol=1e-9)
    itself = free.activation[:, [model.muscle_names.index(name) for name in MUSCLES]]
    same = solve_tension(model, motion, tau, emg=EmgTarget(MUSCLES, itself, "driven"))
    np.testing.assert_allclose(same.activation, free.activation, atol=1e-7)


def test_emg_reaches_contact_forces(walker):
    """In double support nothing but effort divides the load.

    A calf whose EMG is active carries more.
    """
    model, motion, _, _ = walker
    tau = inverse_dynamics(model, motion)
    ask = task(model, motion)
    free = solve_tension(model, motion, tau, contacts=ask)
    calf = EmgTarget(("soleus_r",), np.full((len(motion), 1), 0.5), weight=100.0)
    told = solve_tension(model, motion, tau, contacts=ask, emg=calf)
    assert np.abs(told.contacts.contact_force - free.contacts.contact_force).max() > 20.0


def test_emg_that_does_not_fit_is_refused_by_name(walker):
    model, motion, tau, told = walker
    with pytest.raises(UnknownName, match="soleus_x"):
        solve_tension(model, motion, tau, emg=EmgTarget(("soleus_x",), told[:, :1]))
    with pytest.raises(BadData, match="EMG has"):
        solve_tension(model, motion, tau, emg=EmgTarget(MUSCLES, told[1:]))
    with pytest.raises(BadData, match="twice"):
        solve_tension(model, motion, tau, emg=EmgTarget(("soleus_r", "soleus_r"), told[:, :2]))
    for wrong, message in (
        ({"mode": "hard"}, "unknown use of EMG 'hard'"),
        ({"weight": -1.0}, "EMG weight -1"),
    ):
        with pytest.raises(BadData, match=message):
            replace(EmgOptions(), **wrong)


def test_frames_without_a_body_in_sight_take_none_of_the_others(walker):
    """The first frame is not known: gains are found from the rest, with unmeasured contacts too."""
    model, motion, _, told = walker
    tau = inverse_dynamics(model, motion)
    values = np.array(tau.values)
    values[0] = np.nan
    ask = task(model, motion)
    emg = Emg(motion.time, MUSCLES, told)
    tells = np.array(
        [[muscle == name for name in MUSCLES] for muscle in model.muscle_names], dtype=float
    )
    whole = tracked_frames(
        TensionInputs(model, motion, Series(tau.time, tau.names, tau.values), contacts=ask),
        emg,
        tells,
        1,
    )
    part = tracked_frames(
        TensionInputs(model, motion, Series(tau.time, tau.names, values), contacts=ask),
        emg,
        tells,
        1,
    )
    assert len(part.time) == len(whole.time) - 1
    np.testing.assert_array_equal(part.columns, whole.columns[1:])
    assert np.isfinite(part.others).all()
    assert np.abs(part.others).max() == pytest.approx(np.abs(whole.others).max(), rel=0.2)


def test_emg_is_checked_on_left_out_channels_where_forces_of_contacts_are_unknown(data):
    """Envelopes that have nothing to do with the walk take no part, or hardly any."""
    model, motion, _ = walk(data, slice(150, 1150, 8))
    names = ("soleus", "gastrocnemius", "tibialis", "vasti")
    random = np.random.default_rng(11)
    bursts = scipy.ndimage.gaussian_filter1d(random.random((len(motion), 4)), 4.0, axis=0)
    envelopes = (bursts - bursts.min(axis=0)) / np.ptp(bursts, axis=0)
    trial = EmgTrial(
        motion=motion,
        torques=inverse_dynamics(model, motion),
        emg=Emg(motion.time, names, envelopes),
        contacts=task(model, motion),
    )
    muscles = (("soleus_r",), ("gasmed_r", "gaslat_r"), ("tibant_r",), ("vaslat_r", "vasmed_r"))
    found = calibrate_emg(model, [trial], dict(zip(names, muscles, strict=True)))
    assert found.held_out.shape == (4, 2)
    assert np.isfinite(found.held_out).all()
    assert found.weight <= 0.1
