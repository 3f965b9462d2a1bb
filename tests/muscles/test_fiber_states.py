"""Fibers and elastic tendons: balance of forces and powers, and equilibrium.

The rigid tendon is the limit.
"""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.model.errors import BadData
from myomorph.core.model.functions import linear
from myomorph.core.model.model import Axis, Body, Coordinate, Joint, Model
from myomorph.core.model.paths import Muscle, Path, PathPoint
from myomorph.core.model.spatial import Transform
from myomorph.core.muscles.fiber_states import (
    default_states,
    fiber_states,
    state_names,
    without_fibers,
)
from myomorph.core.muscles.hill import hill_forces, muscle_model

SIZES = {"max_isometric_force": 950.0, "optimal_fiber_length": 0.09, "tendon_slack_length": 0.21}
ELASTIC = ("Thelen2003Muscle", "Millard2012EquilibriumMuscle", "DeGrooteFregly2016Muscle")
LENGTHS = np.linspace(0.28, 0.33, 11)[:, None]
SPEEDS = np.linspace(-0.2, 0.2, 11)[:, None]


def one_muscle(kind, pennation=0.2, **parameters):
    """Make a model of one muscle from the ground to a block that slides."""
    path = Path((PathPoint("a", "ground", np.zeros(3)), PathPoint("b", "block", np.zeros(3))))
    muscle = Muscle(
        name="m",
        kind=kind,
        path=path,
        max_isometric_force=SIZES["max_isometric_force"],
        optimal_fiber_length=SIZES["optimal_fiber_length"],
        tendon_slack_length=SIZES["tendon_slack_length"],
        pennation_at_optimal=pennation,
        parameters=parameters,
    )
    axis = Axis(
        kind="translation", vector=np.array([1.0, 0, 0]), function=linear(1.0), coordinates=("x",)
    )
    joint = Joint(
        name="slider",
        kind="SliderJoint",
        parent="ground",
        child="block",
        parent_frame=Transform.identity(),
        child_frame=Transform.identity(),
        axes=(axis,),
        coordinates=("x",),
    )
    body = Body(name="block", mass=1.0, mass_center=np.zeros(3), inertia=np.eye(3))
    return Model(
        name="sliding",
        bodies=(body,),
        joints=(joint,),
        coordinates=(Coordinate("x", "translational"),),
        gravity=np.zeros(3),
        muscles=(muscle,),
    )


def states_of(kind, activation=0.4):
    """States of the muscle that are not in balance."""
    last = "normalized_tendon_force" if kind.startswith("DeGroote") else "fiber_length"
    values = (
        np.linspace(0.1, 0.9, 11) if kind.startswith("DeGroote") else np.linspace(0.075, 0.1, 11)
    )
    return {("m", "activation"): np.full(11, activation), ("m", last): values}


@pytest.mark.parametrize("kind", ELASTIC)
def test_fibers_pull_what_the_tendon_pulls(kind):
    found, _ = fiber_states(one_muscle(kind), LENGTHS, SPEEDS, states_of(kind))
    along = found.fiber_force * np.cos(found.pennation)
    np.testing.assert_allclose(along, found.tendon_force, rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(
        found.active_force + found.passive_force, found.fiber_force, rtol=1e-9, atol=1e-6
    )
    np.testing.assert_allclose(
        found.fiber_length * np.cos(found.pennation) + found.tendon_length, LENGTHS, atol=1e-12
    )


@pytest.mark.parametrize("kind", ELASTIC)
def test_powers_of_fibers_and_tendon_are_the_muscles(kind):
    found, _ = fiber_states(one_muscle(kind), LENGTHS, SPEEDS, states_of(kind))
    parts = found.active_power + found.passive_power + found.tendon_power
    np.testing.assert_allclose(parts, found.muscle_power, rtol=1e-9, atol=1e-6)


@pytest.mark.parametrize("kind", ELASTIC)
def test_equilibrium_stands_still_where_the_path_does(kind):
    model = one_muscle(kind)
    rest = np.zeros_like(LENGTHS)
    found, states = fiber_states(
        model, LENGTHS, rest, {("m", "activation"): np.full(11, 0.5)}, balanced=True
    )
    assert found.in_balance.all()
    assert np.abs(found.normalized_velocity).max() < 1e-6
    again, _ = fiber_states(model, LENGTHS, rest, states)
    np.testing.assert_array_equal(again.tendon_force, found.tendon_force)
    assert found.tendon_force.min() > 100.0


def test_thelens_fibers_move_at_the_speed_of_his_formula():
    """Thelen 2003, eq. 3, 4, 6 and 7, of the tendon's force.

    Passive force (3), active force and length (4), and speed (6 and 7).
    """
    a = 0.4
    af = 0.25
    most = 1.4
    lengths = np.linspace(0.295, 0.312, 11)[:, None]
    found, _ = fiber_states(
        one_muscle("Thelen2003Muscle"), lengths, SPEEDS, states_of("Thelen2003Muscle", a)
    )
    x = found.fiber_length / SIZES["optimal_fiber_length"]
    pull = found.tendon_force / SIZES["max_isometric_force"] / np.sqrt(1.0 - (np.sin(0.2) / x) ** 2)
    passive = np.where(x > 1.0, np.expm1(5.0 * (x - 1.0) / 0.6) / np.expm1(5.0), 0.0)
    isometric = a * np.exp(-((x - 1.0) ** 2) / 0.45)
    force = pull - passive
    lengthening = (2.0 + 2.0 / af) * (isometric * most - force) / (most - 1.0)
    b = np.where(force <= isometric, isometric + force / af, lengthening)
    inside = (force > 0.0) & (force < 0.95 * most * isometric)
    assert np.count_nonzero(inside & (passive > 0.003)) >= 3
    speeds = (0.25 + 0.75 * a) * (force - isometric) / b
    np.testing.assert_allclose(
        found.normalized_velocity[inside], speeds[inside], rtol=1e-6, atol=1e-9
    )


def test_a_rigid_tendon_gives_the_rigid_tendons_forces():
    model = one_muscle(
        "Millard2012EquilibriumMuscle", ignore_tendon_compliance=1.0, fiber_damping=0.0
    )
    found, _ = fiber_states(model, LENGTHS, SPEEDS, {("m", "activation"): np.full(11, 0.3)})
    rigid = hill_forces(model, LENGTHS, SPEEDS)
    np.testing.assert_allclose(found.tendon_force, 0.3 * rigid.active + rigid.passive, rtol=1e-9)
    assert state_names(model.muscles[0]) == ("activation",)


def test_stiff_tendons_come_near_rigid_ones():
    """A tendon of 1 % of the usual strain.

    Forces of the equilibrium at rest are within 1 % of the rigid tendon's.
    """
    stiff = one_muscle(
        "Millard2012EquilibriumMuscle",
        **{"TendonForceLengthCurve/strain_at_one_norm_force": 4.9e-4},
    )
    rest = np.zeros_like(LENGTHS)
    states = {("m", "activation"): np.full(11, 0.5)}
    found, _ = fiber_states(stiff, LENGTHS, rest, states, balanced=True)
    rigid = hill_forces(stiff, LENGTHS, rest)
    np.testing.assert_allclose(found.tendon_force, 0.5 * rigid.active + rigid.passive, rtol=0.01)


def test_where_no_equilibrium_is_found_the_given_length_stands():
    model = one_muscle("Thelen2003Muscle")
    nowhere = np.array([[np.nan], [0.3]])
    found, states = fiber_states(model, nowhere, np.zeros((2, 1)), balanced=True)
    assert found.in_balance.ravel().tolist() == [False, True]
    assert states["m", "fiber_length"][0] == default_states(model)["m", "fiber_length"]


def test_classes_that_are_not_built_are_named():
    model = one_muscle("Schutte1993Muscle_Deprecated")
    assert without_fibers(model) == ("Schutte1993Muscle_Deprecated",)
    with pytest.raises(BadData, match="fibers of Schutte1993Muscle_Deprecated are not supported"):
        fiber_states(model, LENGTHS, SPEEDS)
    with pytest.raises(BadData, match=r"expected lengths and speeds of shape \(frames, 1\)"):
        fiber_states(one_muscle("Thelen2003Muscle"), LENGTHS, SPEEDS[:, :0])


@pytest.mark.parametrize("activation", [0.2, 0.7])
def test_fibers_on_a_rigid_tendon_pull_most_at_their_optimal_length(activation):
    stretched = np.linspace(0.6, 1.4, 9)
    lengths = (SIZES["tendon_slack_length"] + SIZES["optimal_fiber_length"] * stretched)[:, None]
    given = {("m", "activation"): np.full(9, activation)}
    found, _ = fiber_states(
        one_muscle("RigidTendonMuscle", 0.0), lengths, np.zeros_like(lengths), given
    )
    np.testing.assert_allclose(
        found.fiber_length[:, 0], SIZES["optimal_fiber_length"] * stretched, rtol=1e-12
    )
    shares = found.active_force[:, 0] / (activation * SIZES["max_isometric_force"])
    assert shares[4] == pytest.approx(1.0, rel=2e-2)
    assert (np.diff(shares[:5]) > 0.0).all()
    assert (np.diff(shares[4:]) < 0.0).all()


def test_millards_fiber_moves_at_the_speed_whose_force_is_left():
    """a f_L f_V(v) + damping v = pull - passive, of shortening and lengthening fibers."""
    muscle = one_muscle("Millard2012EquilibriumMuscle").muscles[0]
    model = muscle_model(muscle)
    pull = np.linspace(0.05, 1.2, 12)
    v, f_v = model.balancing_velocity(
        muscle, np.full(12, 0.6), np.full(12, 0.9), np.full(12, 0.1), pull
    )
    assert v.min() < -0.1
    assert v.max() > 0.1
    left = 0.6 * 0.9 * f_v + model.fiber_damping(muscle) * v + 0.1 - pull
    np.testing.assert_allclose(left, 0.0, atol=1e-10)
