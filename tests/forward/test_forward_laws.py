"""Laws of forward dynamics: what inverse dynamics undoes, decays in closed form, and energy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.trees import floating_tree, functional_tree, random_tree, swinging

from myomorph.core.model.errors import BadData
from myomorph.core.model.functions import linear, polynomial
from myomorph.core.model.model import Axis, Body, Coordinate, Joint, Model
from myomorph.core.model.passive_dynamics import with_passive_dynamics
from myomorph.core.model.series import Motion, Series
from myomorph.core.model.spatial import Transform
from myomorph.core.rigid.coordinates import couple_rates_frames
from myomorph.core.rigid.dynamics import inverse_dynamics, joint_wrenches
from myomorph.core.rigid.forward import gathered
from myomorph.core.rigid.mass_matrix import mass_matrix_frames
from myomorph.core.rigid.tree import compile_tree
from myomorph.forward.drives import Drives
from myomorph.forward.simulate import SimulationOptions, simulate

TIGHT = SimulationOptions(seconds=0.5, rate=50.0, tolerance=1e-9)


def oscillator(mass=2.0):
    """Make a body on a slide."""
    axis = Axis(
        kind="translation",
        vector=np.array([1.0, 0.0, 0.0]),
        function=linear(1.0),
        coordinates=("x",),
    )
    joint = Joint(
        name="slide",
        kind="slide",
        parent="ground",
        child="cart",
        parent_frame=Transform.identity(),
        child_frame=Transform.identity(),
        axes=(axis,),
        coordinates=("x",),
    )
    body = Body(name="cart", mass=mass, mass_center=np.zeros(3), inertia=np.eye(3))
    return Model(
        name="oscillator",
        bodies=(body,),
        joints=(joint,),
        coordinates=(Coordinate("x", "translational"),),
        gravity=np.array([0.0, -9.81, 0.0]),
    )


def at(model, seed=0):
    """Draw a state of a model, as a motion of one frame."""
    return swinging(model, 1, 0.01, seed)


@pytest.mark.parametrize("make", [random_tree, floating_tree, functional_tree])
def test_mass_matrix_is_what_unit_accelerations_need(make):
    model = make(3)
    tree = compile_tree(model)
    c = tree.coordinates_of(at(model))
    still = np.zeros_like(c)
    unloaded = np.zeros((1, len(tree.arrays.parent), 6))
    M = np.empty((1, c.shape[1], c.shape[1]))
    mass_matrix_frames(tree.arrays, c, M)

    weight = gathered(tree, c, joint_wrenches(tree, c, still, still, unloaded).torques)
    for column in tree.independent:
        unit = still.copy()
        unit[0, column] = 1.0
        couple_rates_frames(tree.arrays, c, still.copy(), unit)
        needed = gathered(tree, c, joint_wrenches(tree, c, still, unit, unloaded).torques)
        np.testing.assert_allclose(
            M[0, tree.independent, column], (needed - weight)[0, tree.independent], atol=1e-10
        )


@pytest.mark.parametrize("make", [random_tree, floating_tree, functional_tree])
def test_inverse_dynamics_of_a_free_motion_needs_no_torques(make):
    model = make(5)
    simulation = simulate(model, at(model), options=replace(TIGHT, seconds=0.2))
    tree = compile_tree(model)
    torques = inverse_dynamics(model, simulation.motion).values
    missing = gathered(tree, simulation.motion.values, torques)[:, tree.independent]
    assert np.abs(missing).max() < 1e-8 * model.weight
    assert simulation.energy.largest_share < 1e-6


def test_torques_of_inverse_dynamics_give_the_motion_back():
    model = random_tree(7)
    motion = swinging(model, 401, 0.001, seed=2)
    torques = inverse_dynamics(model, motion)
    options = SimulationOptions(rate=100.0, tolerance=1e-9)
    simulation = simulate(model, motion, Drives(torques=torques), options)
    wanted = motion.values[:: len(motion) // (len(simulation.time) - 1)]
    # Torques are straight between samples a millisecond apart.
    assert np.abs(simulation.motion.values - wanted).max() < 2e-5
    assert simulation.energy.largest_share < 1e-6


def test_a_damped_spring_decays_as_in_the_textbook():
    stiffness = 50.0
    damping = 3.0
    mass = 2.0
    model = with_passive_dynamics(
        oscillator(mass), damping={"x": damping}, stiffness={"x": stiffness}, rest={"x": 0.0}
    )
    start = Motion(np.zeros(1), ("x",), np.array([[0.3]]), velocities=np.zeros((1, 1)))
    simulation = simulate(model, start, options=replace(TIGHT, seconds=2.0))
    decay = damping / (2.0 * mass)
    rate = np.sqrt(stiffness / mass - decay**2)
    t = simulation.time
    x = 0.3 * np.exp(-decay * t) * (np.cos(rate * t) + decay / rate * np.sin(rate * t))
    np.testing.assert_allclose(simulation.motion.values[:, 0], x, atol=1e-8)
    work = dict(zip(simulation.energy.names, simulation.energy.work[-1], strict=True))
    assert work["joint damping"] < 0.0
    assert simulation.energy.largest_share < 1e-7


def test_half_the_tolerance_changes_little_and_a_coarse_one_is_said():
    model = random_tree(4)
    fine = simulate(model, at(model), options=replace(TIGHT, certify=True))
    assert 0.0 < fine.halved < 1e-6
    coarse = simulate(
        model, at(model), options=SimulationOptions(seconds=2.0, tolerance=1e-2, max_step=1.0)
    )
    assert coarse.energy.largest_share > fine.energy.largest_share


def test_a_feedback_keeps_a_body_at_a_motion_and_is_small():
    model = random_tree(7)
    motion = swinging(model, 401, 0.001, seed=2)
    torques = inverse_dynamics(model, motion)
    # Torques of a body that is 2 % too light.
    wrong = Series(torques.time, torques.names, 0.98 * torques.values)
    options = SimulationOptions(rate=100.0, tolerance=1e-8)
    free = simulate(model, motion, Drives(torques=wrong), options)
    followed = simulate(model, motion, Drives(torques=wrong, follow=motion, feedback=5.0), options)
    wanted = motion.values[::10]
    assert np.abs(followed.motion.values - wanted).max() < np.abs(free.motion.values - wanted).max()
    shares = followed.feedback_share(torques)
    assert 0.0 < max(shares.values()) < 0.5


def test_a_prescribed_coordinate_moves_as_it_is_told_and_does_work():
    model = random_tree(2)
    first = replace(model.coordinates[0], prescribed=polynomial([0.5, 0.3, -0.4]))
    model = replace(model, coordinates=(first, *model.coordinates[1:]))
    simulation = simulate(model, options=TIGHT)
    t = simulation.time
    np.testing.assert_allclose(simulation.motion.values[:, 0], first.prescribed(t), atol=1e-12)
    assert simulation.energy.largest_share < 1e-6


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: SimulationOptions(seconds=-1.0), "expected a time above 0"),
        (lambda: SimulationOptions(tolerance=1.0), "expected 1e-12 to 0.01"),
        (lambda: SimulationOptions(rate=0.0), "frames a second"),
    ],
)
def test_options_say_what_they_expect(make, words):
    with pytest.raises(BadData, match=words):
        make()


def test_too_many_steps_say_when_and_what_to_try():
    model = random_tree(4)
    with pytest.raises(BadData, match=r"stopped at .* s after .* steps .*--max-steps"):
        simulate(model, at(model), options=replace(TIGHT, max_steps=3))
