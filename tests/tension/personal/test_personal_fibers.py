"""Fibers integrated from known activations.

Slopes by finite differences, forces against an independent integrator.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.body.personalize.fiber_kernel import Paths
from myomorph.body.personalize.fibers import follow
from myomorph.body.personalize.muscle_curves import LENGTHS, muscle_shapes
from myomorph.body.personalize.prior import sizes_of
from myomorph.core.io.formats import read_model
from myomorph.core.muscles.hill import hill_forces, muscle_model
from myomorph.core.muscles.kinematics import muscle_kinematics
from truths.simulated_muscles import (
    as_degroote,
    integrated_degroote,
    integrated_forces,
    smooth_activations,
    swings,
)


def paths_of(moved, activations, step=0.01, speeds=None):
    speeds = moved.muscle_velocity if speeds is None else speeds
    return Paths(
        lengths=moved.muscle_length[None],
        speeds=speeds[None],
        activations=activations[None],
        step=step,
    )


TIME = np.arange(0.0, 1.2, 0.01)
RANGES = {"r_shoulder_elev": (-0.15, 0.4), "r_elbow_flex": (0.3, 2.0)}


@pytest.fixture(scope="module", params=["Thelen2003Muscle", "DeGrooteFregly2016Muscle"])
def case(request, data):
    """Return a swinging arm with six muscles of a class, paths and activations."""
    model = read_model(data("opensim-reference-small/arm26_bounds.osim"))
    if request.param == "DeGrooteFregly2016Muscle":
        model = as_degroote(model)
    rng = np.random.default_rng(3)
    motion = swings(model, RANGES, TIME, rng)
    moved = muscle_kinematics(model, motion, moment_arms=False)
    return model, motion, moved, smooth_activations(TIME, len(model.muscles), rng)


@pytest.mark.parametrize("elastic", [True, False])
def test_slopes_are_those_of_finite_differences(case, elastic):
    model, _, moved, a = case
    shapes = muscle_shapes(model, elastic)
    sizes = sizes_of(model)
    paths = paths_of(moved, a)
    found = follow(shapes, sizes, paths)
    for name, slope in (
        ("fiber", found.by_fiber),
        ("slack", found.by_slack),
        ("strain", found.by_strain),
    ):
        h = 1e-6 * getattr(sizes, name)
        longer = replace(sizes, **{name: getattr(sizes, name) + h})
        shorter = replace(sizes, **{name: getattr(sizes, name) - h})
        up = follow(shapes, longer, paths).force
        down = follow(shapes, shorter, paths).force
        difference = (up - down) / (2.0 * h)
        scale = np.abs(difference).max(axis=(0, 1)) + 1e-3 * sizes.force / getattr(sizes, name)
        # Tables are joined with one slope but a jump of curvature: a difference across a joint sees
        # it.
        assert np.quantile(np.abs(difference - slope) / scale, 0.99) < 1e-4, name
    h = 1e-6
    up = follow(shapes, sizes, paths_of(moved, a + h)).force
    down = follow(shapes, sizes, paths_of(moved, a - h)).force
    scale = np.abs(found.by_activation).max(axis=(0, 1))
    assert np.quantile(np.abs((up - down) / (2.0 * h) - found.by_activation) / scale, 0.99) < 1e-4


def test_forces_are_those_of_an_independent_integrator(case):
    model, motion, moved, a = case
    if model.muscles[0].kind.startswith("DeGroote"):
        theirs = integrated_degroote(model, moved.muscle_length, TIME, a)
    else:
        theirs = integrated_forces(model, motion, a)
    ours = follow(muscle_shapes(model), sizes_of(model), paths_of(moved, a)).force[0]
    settled = slice(20, None)
    error = np.sqrt(np.mean((ours - theirs)[settled] ** 2, axis=0)) / theirs.max(axis=0)
    assert error.max() < 0.02
    assert np.median(error) < 0.002


def test_rigid_tendons_give_the_forces_of_hill_forces(case):
    model, _, moved, a = case
    known = hill_forces(model, moved.muscle_length, moved.muscle_velocity)
    wanted = a * known.active + known.passive
    found = follow(muscle_shapes(model, False), sizes_of(model), paths_of(moved, a))
    scale = sizes_of(model).force
    damped = np.array([one.parameters.get("fiber_damping", 0.0) for one in model.muscles])
    assert not damped.any()
    assert np.abs((found.force[0] - wanted) / scale).max() < 1e-3


def test_frames_held_still_are_in_equilibrium(case):
    model, _, moved, a = case
    shapes = muscle_shapes(model)
    sizes = sizes_of(model)
    still = np.zeros_like(moved.muscle_length)
    found = follow(shapes, sizes, paths_of(moved, a, step=np.inf, speeds=still))
    x = found.length[0]
    w = np.sqrt(x**2 - shapes.sine**2)
    pull = (
        (a * shapes.active(x)[0] * shapes.velocity(np.zeros_like(x))[0] + shapes.passive(x)[0])
        * w
        / x
    )
    tendon = shapes.tendon((moved.muscle_length - sizes.fiber * w) / sizes.slack - 1.0)[0]
    reaches = moved.muscle_length > 1.02 * sizes.slack + sizes.fiber * shapes.shortest
    assert np.abs(pull - tendon)[reaches].max() < 1e-8
    np.testing.assert_allclose(found.force[0], sizes.force * tendon, atol=1e-9 * sizes.force.max())


def test_tables_hold_the_curves(case):
    model = case[0]
    shapes = muscle_shapes(model)
    x = np.linspace(0.4, 1.7, 77)
    for m in range(2):
        curves = muscle_model(model.muscles[m]).curves(model.muscles[m])
        columns = np.tile(x[:, None], (1, len(model.muscles)))
        np.testing.assert_allclose(shapes.active(columns)[0][:, m], curves.active(x), atol=1e-7)
        np.testing.assert_allclose(shapes.passive(columns)[0][:, m], curves.passive(x), atol=1e-5)
    assert LENGTHS[0] == 0.0
