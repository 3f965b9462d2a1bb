"""Fibers on elastic tendons with derivatives.

Against finite differences, and against the curves used elsewhere.
"""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.model.model import Model
from myomorph.core.model.paths import Muscle, Path
from myomorph.core.muscles.fiber_jets import FLOOR, TONE, fiber_jet, tendon_jet
from myomorph.core.muscles.hill import compile_elastic, has_elastic_tendon, muscle_model
from myomorph.core.muscles.models.thelen import ROUNDED_LENGTH
from myomorph.core.rigid.kernels import kernel

CLASSES = ("DeGrooteFregly2016Muscle", "Millard2012EquilibriumMuscle", "Thelen2003Muscle")


def _factors_of(kind: str, x: np.ndarray, v: np.ndarray) -> np.ndarray:
    """(values, 3) f_L, f_PE and f_V of a class."""
    muscle = model(kind).muscles[0]
    curves = muscle_model(muscle).curves(muscle)
    return np.stack(
        [curves.active(x), curves.passive(x), np.maximum(curves.velocity(v), 0.0)], axis=1
    )


@kernel
def _pulls(E, x, u, a, out):
    for k in range(x.shape[0]):
        fiber_jet(E, 0, x[k], u[k], a[k], out[k])


@kernel
def _stretch_jets(E, f, out):
    for k in range(f.shape[0]):
        out[k, 0], out[k, 1], out[k, 2] = tendon_jet(E, 0, f[k])


def model(kind: str, count: int = 1) -> Model:
    """Muscles of one class, pennate, of different sizes."""
    muscles = tuple(
        Muscle(
            name=f"m{i}",
            kind=kind,
            path=Path(()),
            max_isometric_force=500.0,
            optimal_fiber_length=0.05 + 0.002 * i,
            tendon_slack_length=0.1 + 0.01 * i,
            pennation_at_optimal=0.01 * i,
            max_contraction_velocity=10.0,
        )
        for i in range(count)
    )
    return Model(
        name="muscles", bodies=(), joints=(), coordinates=(), gravity=np.zeros(3), muscles=muscles
    )


def arrays(kind: str, count: int = 1, passive: bool = True):
    return compile_elastic(model(kind, count), passive)


@pytest.mark.parametrize("kind", CLASSES)
def test_derivatives_of_pulls_and_stretches_are_those_of_finite_differences(kind):
    """Slopes of the pull over length, speed and activation, and their slopes.

    Also both slopes of a tendon's strain.
    """
    E = arrays(kind)
    rng = np.random.default_rng(0)
    at = np.stack(
        [rng.uniform(0.6, 1.4, 200), rng.uniform(-3.0, 3.0, 200), rng.uniform(0.05, 0.95, 200)]
    )
    fiber = E.hill.fiber[0]
    x, u, a = _pull_differences(E, at)
    found = np.column_stack(
        [x[:, 0], u[:, 0], a[:, 0], x[:, 1], x[:, 2], u[:, 2], x[:, 3], u[:, 3], a[:, 3]],
    )
    size = np.array([1, 1, 0, 2, 2, 2, 1, 1, 0])
    error = np.abs(_pulls_at(E, *at)[:, 1:] - found) * fiber**size
    assert (error / (1.0 + np.abs(found) * fiber**size)).max() < 1e-7
    h = 1e-6
    f = rng.uniform(0.03, 1.3, 200)
    jets = [np.empty((200, 3)) for _ in range(3)]
    for shift, jet in zip((-h, 0.0, h), jets, strict=True):
        _stretch_jets(E, f + shift, jet)
    slopes = (jets[2] - jets[0]) / (2.0 * h)
    np.testing.assert_allclose(jets[1][:, 1:], slopes[:, :2], rtol=1e-6, atol=1e-7)


def _pulls_at(E, x, u, a):
    """Return pulls and derivatives (values, 10) at lengths and speeds in fiber lengths."""
    out = np.empty((len(x), 10))
    _pulls(E, x * E.hill.fiber[0], u * E.hill.fiber[0], a, out)
    return out


def _pull_differences(E, at):
    """Return differences (values, 10) of the pulls over length [m], speed [m/s], activation."""
    h = 1e-6
    units = (E.hill.fiber[0], E.hill.fiber[0], 1.0)
    return [
        (_pulls_at(E, *(at + step[:, None])) - _pulls_at(E, *(at - step[:, None])))
        / (2.0 * h)
        / unit
        for step, unit in zip(h * np.eye(3), units, strict=True)
    ]


@pytest.mark.parametrize("kind", CLASSES)
def test_what_fibers_pull_with_is_what_their_curves_say(kind):
    E = arrays(kind)
    rng = np.random.default_rng(1)
    x = rng.uniform(0.6, 1.5, 200)
    v = rng.uniform(-0.6, 0.6, 200)
    a = rng.uniform(0.3, 1.0, 200)
    kappa = 1.0 - E.slowed[0] * (1.0 - a)
    v *= kappa
    # Outside of where corners of Thelen's curves are rounded; how much that changes is a test of
    # its own.
    v = np.where(np.abs(v / kappa) < 0.02, 0.02 * kappa, v)
    x = np.where(np.abs(x - 1.0) < ROUNDED_LENGTH, 1.0 + ROUNDED_LENGTH, x)
    factors = _factors_of(kind, x, v / kappa)
    out = np.empty((200, 10))
    _pulls(E, x * E.hill.fiber[0], v * E.hill.speed[0], a, out)
    expected = a * factors[:, 0] * factors[:, 2] + factors[:, 1] + E.damping[0] * v
    pulling = expected > 0.05
    assert pulling.sum() > 100
    assert np.abs(out[:, 0] - expected - TONE - FLOOR * a)[pulling].max() < 1e-4


def test_where_thelens_passive_force_sets_in_it_is_rounded_by_a_thousandth():
    E = arrays("Thelen2003Muscle")
    x = np.linspace(1.0 - 1.5 * ROUNDED_LENGTH, 1.0 + 1.5 * ROUNDED_LENGTH, 300)
    factors = _factors_of("Thelen2003Muscle", x, np.full(300, 0.1))
    out = np.empty((300, 10))
    _pulls(E, x * E.hill.fiber[0], np.full(300, 0.1 * E.hill.speed[0]), np.ones(300), out)
    left = out[:, 0] - factors[:, 0] * factors[:, 2] - factors[:, 1] - TONE - FLOOR
    assert 1e-4 < np.abs(left).max() < 1e-3
    # No step in the slope any more: neighbors differ by a small part of the slope with which the
    # curve begins.
    steps = np.abs(np.diff(out[:, 1]))
    begins = (factors[-1, 1] - factors[-2, 1]) / (x[-1] - x[-2]) / E.hill.fiber[0]
    assert steps.max() < 0.1 * begins


@pytest.mark.parametrize("kind", CLASSES)
def test_the_stretch_of_a_tendon_is_the_inverse_of_its_force(kind):
    one = model(kind)
    f = np.linspace(0.002, 1.8, 300)
    jets = np.empty((300, 3))
    _stretch_jets(compile_elastic(one, True), f, jets)
    muscle = one.muscles[0]
    assert np.allclose(muscle_model(muscle).tendon(muscle)(jets[:, 0]), f, atol=1e-9)


def test_a_tendon_that_the_model_calls_rigid_is_not_elastic():
    muscle = Muscle(
        name="m",
        kind="Millard2012EquilibriumMuscle",
        path=Path(()),
        max_isometric_force=1.0,
        optimal_fiber_length=0.1,
        tendon_slack_length=0.1,
        parameters={"ignore_tendon_compliance": 1.0},
    )
    assert not has_elastic_tendon(muscle)
    assert not has_elastic_tendon(
        Muscle(
            name="r",
            kind="RigidTendonMuscle",
            path=Path(()),
            max_isometric_force=1.0,
            optimal_fiber_length=0.1,
            tendon_slack_length=0.1,
        )
    )
