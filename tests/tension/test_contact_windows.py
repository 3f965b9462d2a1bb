"""Smooth contact forces: windows of frames against one large program, and what must not matter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from readable import frame_program
from walking import task, walk

from myomorph.core.model.series import Motion, Series
from myomorph.core.rigid.dynamics import inverse_dynamics
from myomorph.core.tension.dual import OPTIMAL
from myomorph.core.tension.problem import TensionInputs, tension_problem
from myomorph.core.tension.solve import solve_tension


@pytest.fixture(scope="module")
def walker(data):
    """Return a tenth of a second of double support at 200 Hz.

    The values are model, motion, and torques without plates.
    """
    model, motion, _ = walk(data, slice(560, 660, 5))
    return model, motion, inverse_dynamics(model, motion)


def noisy(tau: Series, size: float = 5.0) -> Series:
    """Torques with noise of its own in every frame [N m], so that there is something to smooth."""
    noise = np.random.default_rng(0).normal(size=tau.values.shape)
    return Series(tau.time, tau.names, tau.values + size * noise)


def _all_at_once(problem, stiffness) -> np.ndarray:
    """Return amplitudes (frames, generators) of the one program of all frames.

    They are by an interior-point method.
    """
    frames, generators = problem.amplitudes.shape
    programs = [frame_program(problem, k) for k in range(frames)]
    n = len(programs[0].c)
    H = sp.block_diag(
        [np.diag(one.H) if one.H.ndim == 1 else one.H for one in programs], format="lil"
    )
    _add_smoothness(H, problem, stiffness, n)
    return _solved_by_clarabel(H, programs).reshape(frames, n)[:, n - generators :]


def _add_smoothness(H, problem, stiffness, n):
    """Add the links between frames of n variables, of which the amplitudes come last."""
    frames, generators = problem.amplitudes.shape
    first = n - generators
    contacts = problem.contacts
    scale = contacts.amounts / contacts.generators.weight[contacts.generators.site]
    for k in range(1, frames):
        for g in np.flatnonzero((scale[k] > 0.0) & (scale[k - 1] > 0.0)):
            weight = 2.0 * stiffness[k - 1] * contacts.cost[g]
            now = k * n + first + g
            before = (k - 1) * n + first + g
            H[now, now] += weight * scale[k, g] ** 2
            H[before, before] += weight * scale[k - 1, g] ** 2
            H[now, before] -= weight * scale[k, g] * scale[k - 1, g]
            H[before, now] -= weight * scale[k, g] * scale[k - 1, g]


def _solved_by_clarabel(H, programs):
    """Return the variables (frames n,) of least cost with this H, within the frames' limits."""
    clarabel = pytest.importorskip("clarabel")
    lower = np.concatenate([one.lower for one in programs])
    upper = np.concatenate([one.upper for one in programs])
    eye = sp.eye(len(lower), format="csr")
    low = np.isfinite(lower)
    high = np.isfinite(upper)
    rows = sp.csc_matrix(
        sp.vstack([sp.block_diag([one.A for one in programs]), -eye[low], eye[high]])
    )
    b = np.concatenate([one.b for one in programs])
    right = np.concatenate([b, -lower[low], upper[high]])
    cones = [clarabel.ZeroConeT(len(b)), clarabel.NonnegativeConeT(len(right) - len(b))]
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-10
    c = np.concatenate([one.c for one in programs])
    solver = clarabel.DefaultSolver(sp.csc_matrix(sp.triu(H)), c, rows, right, cones, settings)
    return np.array(solver.solve().x)


@pytest.mark.parametrize("smoothness", [0.3, 3.0, 30.0])
def test_a_window_reaches_the_optimum_of_all_its_frames_together(walker, smoothness):
    model, motion, tau = walker
    tau = noisy(tau)
    ask = task(model, motion, smoothness=smoothness, window=len(motion), compliance=1.0)
    problem = tension_problem(TensionInputs(model, motion, tau, contacts=ask))
    problem.solve(0, len(motion))
    stiffness = problem.smooth.stiffness
    np.testing.assert_allclose(stiffness, smoothness * (0.01 / 0.005) ** 2)
    push = problem.contacts.amounts / problem.contacts.generators.weight[0]
    theirs = _all_at_once(problem, stiffness)
    alone = tension_problem(
        TensionInputs(model, motion, tau, contacts=task(model, motion, compliance=1.0))
    )
    alone.solve(0, len(motion))
    apart = np.abs(push * (problem.amplitudes - theirs)).max()
    # In body weights: passes end at 1e-4 a pass.
    assert apart < 1e-3
    assert np.abs(push * (alone.amplitudes - theirs)).max() > 10.0 * apart


def test_windows_one_after_another_are_as_good_as_one(walker, monkeypatch):
    model, motion, tau = walker
    ask = task(model, motion, smoothness=0.3, window=len(motion))
    whole = solve_tension(model, motion, noisy(tau), contacts=ask)
    assert tension_problem(TensionInputs(model, motion, tau, contacts=ask)).smooth.window == len(
        motion
    )
    rolling = replace(ask, options=replace(ask.options, window=4))
    one = tension_problem(TensionInputs(model, motion, noisy(tau), contacts=rolling))
    assert one.window < len(motion)
    weight = sum(body.mass for body in model.bodies) * 9.8
    found = solve_tension(model, motion, noisy(tau), contacts=rolling)
    assert np.abs(found.contacts.contact_force - whole.contacts.contact_force).max() < 2e-3 * weight
    assert found.optimal.all()
    monkeypatch.setenv("MYOMORPH_THREADS", "1")
    single = solve_tension(model, motion, noisy(tau), contacts=rolling)
    np.testing.assert_array_equal(single.contacts.contact_force, found.contacts.contact_force)
    np.testing.assert_array_equal(single.activation, found.activation)


def test_smoothness_is_that_of_the_force_and_not_of_the_recording(data):
    """Twice the frames of one motion bring the same forces, where smoothness matters."""
    forces = []
    for step in (10, 5):
        model, motion, _ = walk(data, slice(500, 700, step))
        tau = inverse_dynamics(model, motion)
        bumpy = np.array(tau.values)
        bumpy[:, :6] += 20.0 * np.sin(2.0 * np.pi * 8.0 * motion.time)[:, None]
        ask = task(model, motion, smoothness=3.0, compliance=1.0)
        found = solve_tension(model, motion, Series(tau.time, tau.names, bumpy), contacts=ask)
        forces.append(found.contacts.contact_force[:: 10 // step])
    free = solve_tension(
        model,
        motion,
        Series(tau.time, tau.names, bumpy),
        contacts=task(model, motion, compliance=1.0),
    ).contacts.contact_force[::2]
    inside = slice(3, -3)
    twice = np.sqrt(np.mean((forces[0] - forces[1])[inside] ** 2))
    assert twice < 0.2 * np.sqrt(np.mean((free - forces[1])[inside] ** 2))


def test_a_frame_without_input_parts_those_beside_it(walker):
    model, motion, tau = walker
    values = np.array(motion.values)
    values[10, 0] = np.nan
    broken = Motion(
        motion.time,
        motion.names,
        values,
        velocities=motion.velocities,
        accelerations=motion.accelerations,
    )
    ask = task(model, motion, smoothness=3.0)
    found = solve_tension(model, broken, inverse_dynamics(model, broken), contacts=ask)
    assert np.flatnonzero(found.status != OPTIMAL).tolist() == [10]
    kept = np.arange(len(motion)) < 10
    before = motion.frames(kept)
    activations = Series(before.time, ask.activations.names, ask.activations.values[kept])
    part = replace(ask, activations=activations)
    alone = solve_tension(
        model, before, Series(before.time, tau.names, tau.values[kept]), contacts=part
    )
    np.testing.assert_allclose(
        found.contacts.contact_force[kept], alone.contacts.contact_force, atol=0.5
    )
