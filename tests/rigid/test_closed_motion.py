"""Motions kept on closed loops, and torques folded through the loops' null space."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from looped import four_bar, four_bar_angles, looped_tree
from myomorph.core.model.errors import BadData
from myomorph.core.model.series import Motion, Series
from myomorph.core.rigid.coordinates import couple_frames
from myomorph.core.rigid.dynamics import inverse_dynamics, motion_arrays
from myomorph.core.rigid.loops import (
    MAX_OPENING,
    close_loops,
    closed_motion,
    closure,
    closure_jacobian,
    closure_rates,
    loop_torques,
)
from myomorph.core.rigid.tree import compile_tree


def cranked(model, frames=7):
    """Return a rotating crank.

    Its rates are by differences that are far finer than the tolerance.
    """
    turn = np.linspace(0.4, 1.6, frames)
    angles = four_bar_angles(turn)
    step = 1e-4
    ahead = four_bar_angles(turn + step)
    behind = four_bar_angles(turn - step)
    rates = 2.0 * (ahead - behind) / (2 * step)
    accelerations = 4.0 * (ahead - 2 * angles + behind) / step**2
    return Motion(
        time=turn / 2.0,
        names=model.coordinate_names,
        values=angles,
        velocities=rates,
        accelerations=accelerations,
    )


def closed(seed, functional, frames=4):
    """Return a motion of a random looped tree that keeps its loops closed, and the tree."""
    model, start = looped_tree(seed, functional=functional)
    tree = compile_tree(model)
    rng = np.random.default_rng(seed)
    near = start + 0.02 * rng.normal(size=(frames, len(start)))
    couple_frames(tree.arrays, near)
    rates, accelerations = rng.normal(size=(2, *near.shape))
    motion = Motion(
        time=np.arange(frames) / 10,
        names=model.coordinate_names,
        values=close_loops(tree, near),
        velocities=rates,
        accelerations=accelerations,
    )
    return tree, closed_motion(model, motion)[0]


@pytest.mark.parametrize("functional", [False, True])
def test_power_of_folded_torques_is_that_of_all(functional):
    """Loop forces give no power on a closed motion, so the folded torques give all of it."""
    for seed in range(3):
        tree, motion = closed(seed, functional)
        model = tree.model
        # Couplers make the dependents' rates; `motion_arrays` has them.
        _, cdot, _ = motion_arrays(tree, motion)
        tau = inverse_dynamics(model, motion)
        folded = loop_torques(model, motion, tau)
        columns = [model.coordinate_names.index(name) for name in folded.torques.names]
        assert set(folded.dependent).isdisjoint(folded.torques.names)
        power = (folded.torques.values * cdot[:, columns]).sum(axis=1)
        np.testing.assert_allclose(power, (tau.values * cdot).sum(axis=1), rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("functional", [False, True])
def test_loads_of_the_loop_itself_drop_out(functional):
    tree, motion = closed(5, functional)
    model = tree.model
    c, _, _ = motion_arrays(tree, motion)
    tau = inverse_dynamics(model, motion)
    G = closure_jacobian(tree, c)
    G[:, :, [j for j in range(c.shape[1]) if j not in tree.independent]] = 0.0
    carried = np.einsum("frj,fr->fj", G, np.random.default_rng(1).normal(size=G.shape[:2]))
    one = loop_torques(model, motion, tau).torques
    other = loop_torques(model, motion, replace(tau, values=tau.values + carried)).torques
    np.testing.assert_allclose(one.values, other.values, atol=1e-9)


def test_crank_torque_is_the_rate_of_energy():
    model = four_bar()
    motion = cranked(model)
    tau = inverse_dynamics(model, motion)
    folded = loop_torques(model, motion, tau).torques
    assert len(folded.names) == 1
    independent = model.coordinate_names.index(folded.names[0])
    power = folded.values[:, 0] * motion.velocities[:, independent]
    np.testing.assert_allclose(
        power, (tau.values * motion.velocities).sum(axis=1), rtol=1e-4, atol=1e-6
    )


def test_a_model_without_loops_keeps_its_torques():
    model = replace(four_bar(), loops=())
    motion = cranked(model)
    tau = inverse_dynamics(model, motion)
    assert closed_motion(model, motion) == (motion, ())
    folded = loop_torques(model, motion, tau)
    assert folded.dependent == ()
    np.testing.assert_array_equal(folded.torques.values, tau.values)


def test_a_motion_that_is_nearly_closed_is_closed_and_said_so():
    model = four_bar()
    tree = compile_tree(model)
    good = cranked(model)
    rng = np.random.default_rng(3)
    off = replace(good, values=good.values + 2e-3 * rng.normal(size=good.values.shape))
    found, notes = closed_motion(model, off)
    assert len(notes) == 1
    assert "'pin'" in notes[0]
    assert "coordinates moved by up to" in notes[0]
    assert np.abs(closure(tree, found.values)).max() < 1e-9
    first, second = closure_rates(tree, found.values, found.velocities, found.accelerations)
    assert max(np.abs(first).max(), np.abs(second).max()) < 1e-7
    assert np.abs(found.values - off.values).max() < 2e-2
    assert closed_motion(model, good)[1] == ()


def test_positions_alone_stay_positions():
    model = four_bar()
    good = cranked(model)
    found, _ = closed_motion(model, Motion(good.time, good.names, good.values))
    assert found.velocities is None
    assert found.accelerations is None


def test_a_motion_that_is_open_is_refused():
    model = four_bar()
    good = cranked(model)
    off = replace(good, values=good.values + np.array([0.0, 0.1, 0.0]))
    torques = Series(off.time, off.names, np.zeros_like(off.values))
    for ask in (lambda: closed_motion(model, off), lambda: loop_torques(model, off, torques)):
        with pytest.raises(BadData, match=rf"'pin' open by up to .* at most {MAX_OPENING:g}"):
            ask()
