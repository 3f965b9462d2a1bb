"""Torques and tensions of one frame after the other are those of all frames at once."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from walking import walk

from looped import four_bar
from myomorph.core.model.errors import BadData, BadModel, UnknownName
from myomorph.core.model.series import Series
from myomorph.core.rigid.dynamics import OnlineDynamics, inverse_dynamics, motion_arrays
from myomorph.core.rigid.tree import compile_tree
from myomorph.core.tension.online import OnlineTension
from myomorph.core.tension.recruitment import (
    EFFORT_ALONE,
    KNEE_LOAD,
    RecruitmentOptions,
    recruitment_terms,
)
from myomorph.core.tension.solve import solve_tension
from myomorph.core.tension.tension import TensionOptions
from myomorph.live.online_identification import total_wrench


@pytest.mark.parametrize("passive", [False, True])
def test_frame_by_frame_is_the_whole_at_once(data: Callable[[str], Path], passive: bool) -> None:
    model, motion, wrenches = walk(data, slice(0, 1350, 25))
    torques = inverse_dynamics(model, motion, wrenches)
    options = TensionOptions(passive=passive)
    whole = solve_tension(model, motion, torques, options)
    dynamics = OnlineDynamics(model, wrenches.bodies)
    tension = OnlineTension(model, options)
    parts = (one[:, :, None] for one in (wrenches.forces, wrenches.points, wrenches.torques))
    each = total_wrench(*parts)
    moved = motion_arrays(compile_tree(model), motion)
    assert tension.coordinates == whole.coordinates
    assert tension.actuators == whole.reserve_names
    for frame in range(len(motion)):
        found = dynamics.solve(*(one[frame] for one in moved), each[frame])
        np.testing.assert_allclose(found, torques.values[frame], atol=1e-8)
        shared = tension.solve_after(dynamics)
        assert shared.status == whole.status[frame] == 0
        np.testing.assert_allclose(shared.activations, whole.activation[frame], atol=1e-7)
        np.testing.assert_allclose(shared.forces, whole.muscle_force[frame], atol=1e-3)
        np.testing.assert_allclose(shared.reserves, whole.actuator_force[frame], atol=1e-5)
        np.testing.assert_allclose(shared.balanced, whole.balanced_torque[frame], atol=1e-8)


def test_a_frame_that_cannot_be_solved_does_not_spoil_the_next(data: Callable[[str], Path]) -> None:
    model, motion, wrenches = walk(data, slice(0, 1350, 400))
    torques = inverse_dynamics(model, motion, wrenches)
    dynamics = OnlineDynamics(model, ())
    tension = OnlineTension(model, recruitment=EFFORT_ALONE)
    coordinates = motion_arrays(compile_tree(model), motion)[0]
    still = np.zeros_like(coordinates[1])
    dynamics.solve(coordinates[1], still, still, np.zeros((0, 6)))
    given = torques.values[1][None].copy()
    first = tension.solve(dynamics.coordinates, dynamics.rates, given)
    lost = tension.solve(dynamics.coordinates, dynamics.rates, np.full_like(given, np.nan))
    assert lost.status != 0
    assert np.isnan(lost.activations).all()
    again = tension.solve(dynamics.coordinates, dynamics.rates, given)
    np.testing.assert_allclose(again.activations, first.activations, atol=1e-7)


def test_what_cannot_be_is_told(data: Callable[[str], Path]) -> None:
    model, _, _ = walk(data, slice(0, 2))
    with pytest.raises(UnknownName, match="'foot'"):
        OnlineDynamics(model, ("foot",))
    with pytest.raises(BadModel, match="closes loops"):
        OnlineTension(four_bar())
    with pytest.raises(BadData, match="co-contraction"):
        OnlineTension(model, recruitment=RecruitmentOptions(co_contraction=0.1))
    resting = np.zeros((1, len(model.coordinates)))
    with pytest.raises(BadData, match="forces that joints transmit"):
        OnlineTension(model).solve(resting, resting, resting)


def test_one_default_everywhere(data: Callable[[str], Path]) -> None:
    """Python, frames as they come and the terms that commands make minimize the same."""
    model, motion, wrenches = walk(data, slice(300, 900, 150))
    torques = inverse_dynamics(model, motion, wrenches)
    default = solve_tension(model, motion, torques)
    stated = RecruitmentOptions(joint_load=KNEE_LOAD)
    terms = recruitment_terms(model, motion, torques, wrenches, stated)
    of_terms = solve_tension(model, motion, torques, recruitment=EFFORT_ALONE, terms=terms)
    np.testing.assert_array_equal(default.activation, of_terms.activation)
    alone = solve_tension(model, motion, torques, recruitment=EFFORT_ALONE)
    assert np.abs(default.activation - alone.activation).max() > 1e-3
    # A table of torques does not say what pushes on the body.
    table = Series(torques.time, torques.names, torques.values)
    of_table = solve_tension(model, motion, table)
    np.testing.assert_array_equal(of_table.activation, alone.activation)
    with pytest.raises(BadData, match="external forces"):
        solve_tension(model, motion, table, recruitment=stated)
    some = torques.frames(slice(1, 3))
    assert some.wrenches is not None
    np.testing.assert_array_equal(some.wrenches.time, motion.time[1:3])
