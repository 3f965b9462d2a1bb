"""Torques and tensions of one frame after the other are those of all frames at once."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from walking import walk

from looped import four_bar
from myomorph.core.model.errors import BadModel, UnknownName
from myomorph.core.rigid.dynamics import OnlineDynamics, inverse_dynamics, motion_arrays
from myomorph.core.rigid.tree import compile_tree
from myomorph.core.tension.problem import OnlineTension
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
        shared = tension.solve(dynamics.coordinates, dynamics.rates, dynamics.torques)
        assert shared.status == whole.status[frame] == 0
        np.testing.assert_allclose(shared.activations, whole.activation[frame], atol=1e-7)
        np.testing.assert_allclose(shared.forces, whole.muscle_force[frame], atol=1e-3)
        np.testing.assert_allclose(shared.reserves, whole.actuator_force[frame], atol=1e-5)
        np.testing.assert_allclose(shared.balanced, whole.balanced_torque[frame], atol=1e-8)


def test_a_frame_that_cannot_be_solved_does_not_spoil_the_next(data: Callable[[str], Path]) -> None:
    model, motion, wrenches = walk(data, slice(0, 1350, 400))
    torques = inverse_dynamics(model, motion, wrenches)
    dynamics = OnlineDynamics(model, ())
    tension = OnlineTension(model)
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
