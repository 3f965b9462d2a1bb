"""Generalized forces of passive parts: power, and what is left out by name."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from myomorph.core.model.passive_dynamics import with_passive_dynamics
from myomorph.core.model.paths import Muscle, Path, PathPoint
from myomorph.core.muscles.kinematics import muscle_kinematics
from myomorph.core.muscles.passive import passive_generalized_forces
from myomorph.core.rigid.dynamics import values_and_rates
from myomorph.core.rigid.tree import compile_tree
from trees import functional_tree, swinging


def strung():
    """Make a tree with couplers, and straight muscles between its bodies."""
    model = functional_tree(2, 10)
    rng = np.random.default_rng(1)
    names = model.body_names
    muscles = tuple(
        Muscle(
            name=f"m{i}",
            kind="Thelen2003Muscle",
            path=Path(
                tuple(
                    PathPoint(f"p{k}", body, 0.2 * rng.normal(size=3))
                    for k, body in enumerate(pair)
                )
            ),
            max_isometric_force=100.0,
            optimal_fiber_length=0.1,
            tendon_slack_length=0.1,
        )
        for i, pair in enumerate([("ground", names[9]), (names[0], names[8]), (names[2], names[7])])
    )
    return replace(model, muscles=muscles), swinging(model, 5, 0.02, 0)


def test_viscosity_takes_the_power_of_lengthening():
    """The power of the dampers is the sum of every coordinate's share times its rate.

    Dependent coordinates count too.
    """
    model, motion = strung()
    assert model.couplers
    viscosity = {"m0": 30.0, "m1": 70.0, "m2": 10.0}
    made = with_passive_dynamics(model, viscosity=viscosity)
    tree = compile_tree(made)
    _, rates = values_and_rates(tree, motion)
    lengthening = muscle_kinematics(made, motion).muscle_velocity
    power = (passive_generalized_forces(made, motion).values * rates).sum(axis=1)
    np.testing.assert_allclose(power, -(lengthening**2 @ np.array([30.0, 70.0, 10.0])), rtol=1e-10)


def test_parts_are_left_out_by_name():
    model, motion = strung()
    free = [model.coordinate_names[j] for j in compile_tree(model).independent[:2]]
    made = with_passive_dynamics(
        model, {free[0]: 0.3}, {free[1]: 2.0}, viscosity={"m0": 30.0, "m1": 70.0}
    )
    whole = passive_generalized_forces(made, motion).values
    parts = [f"passive_{free[0]}", f"passive_{free[1]}", "m0_viscosity", "m1_viscosity"]
    alone = [passive_generalized_forces(made, motion, set(parts) - {part}).values for part in parts]
    np.testing.assert_allclose(np.sum(alone, axis=0), whole, atol=1e-12)
    assert all(np.abs(one).max() > 0.0 for one in alone)
    assert not passive_generalized_forces(made, motion, parts).values.any()


def test_a_muscle_that_is_switched_off_does_not_resist():
    model, motion = strung()
    made = with_passive_dynamics(model, viscosity={"m0": 30.0})
    off = replace(made, muscles=tuple(replace(one, enabled=False) for one in made.muscles))
    assert passive_generalized_forces(made, motion).values.any()
    assert not passive_generalized_forces(off, motion).values.any()
