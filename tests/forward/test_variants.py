"""Many variants in one process are what single simulations are."""

from __future__ import annotations

import numpy as np
from tests.trees import random_tree, swinging

from myomorph.core.io.formats import read_model
from myomorph.core.model.passive_dynamics import with_passive_dynamics
from myomorph.forward.changes import Changes
from myomorph.forward.simulate import SimulationOptions, simulate
from myomorph.forward.variants import Variant, simulate_variants

OPTIONS = SimulationOptions(seconds=0.2, rate=20.0)


def test_starts_masses_and_viscosities_of_a_tree():
    model = with_passive_dynamics(random_tree(3), damping={"c1": 0.4, "c4": 0.2})
    variants = [
        Variant(
            start=swinging(model, 1, 0.01, seed),
            changes=Changes(mass={"body2": 1.0 + 0.1 * seed}, viscosity=float(seed)),
        )
        for seed in range(4)
    ]
    many = simulate_variants(model, variants, options=OPTIONS)
    assert many.values.shape == (4, 5, 12)
    for variant, values in zip(variants, many.values, strict=True):
        one = simulate(variant.changes.applied(model), variant.start, options=OPTIONS)
        np.testing.assert_allclose(values, one.motion.values, atol=1e-9)
    assert many.energy_share.max() < 1e-5


def test_a_weaker_muscle_of_an_arm(data):
    model = read_model(data("opensim-reference-small/arm26_bounds.osim"))
    changes = Changes(strength={"BRA": 0.5})
    many = simulate_variants(model, [Variant(), Variant(changes=changes)], options=OPTIONS)
    weaker = simulate(changes.applied(model), options=OPTIONS)
    np.testing.assert_allclose(many.values[1], weaker.motion.values, atol=1e-12)
    assert np.abs(many.values[1] - many.values[0]).max() > 1e-3
