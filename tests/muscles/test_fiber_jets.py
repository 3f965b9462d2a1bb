"""Fibers on elastic tendons with derivatives: against finite differences, and against the curves used elsewhere."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.model.model import Model
from myomorph.model.paths import Muscle, Path
from myomorph.muscles.elastic_arrays import compile_elastic, has_elastic_tendon
from myomorph.muscles.fiber_equations import degroote_stretch, tendon_factor
from myomorph.muscles.fiber_jets import FLOOR, TAKEN_UP, TONE, fiber_jet, tendon_jet
from myomorph.muscles.hill import active_length_factor, passive_length_factor, velocity_factor
from myomorph.rigid.kernels import kernel
from myomorph.tension.elastic.elements import elements, integrate

CLASSES = ("DeGrooteFregly2016Muscle", "Millard2012EquilibriumMuscle", "Thelen2003Muscle")
FRAMES, COUNT = 7, 30


@kernel
def _curves(E, x, v, factors):
    for k in range(x.shape[0]):
        factors[k, 0] = active_length_factor(E.hill, 0, x[k])
        factors[k, 1] = passive_length_factor(E.hill, 0, x[k])
        factors[k, 2] = velocity_factor(E.hill, 0, v[k])


@kernel
def _pulls(E, x, u, a, out):
    for k in range(x.shape[0]):
        fiber_jet(E, 0, x[k], u[k], a[k], out[k])


@kernel
def _stretches(E, f, out):
    for k in range(f.shape[0]):
        out[k] = tendon_jet(E, 0, f[k])[0]


def model(kind: str, count: int = 1) -> Model:
    """Muscles of one class, pennate, of different sizes."""
    muscles = tuple(
        Muscle(f"m{i}", kind, Path(()), 500.0, 0.05 + 0.002 * i, 0.1 + 0.01 * i, 0.01 * i, 10.0) for i in range(count)
    )
    return Model("muscles", (), (), (), np.zeros(3), muscles=muscles)


def arrays(kind: str, count: int = 1, passive: bool = True):
    return compile_elastic(model(kind, count), passive)


@pytest.mark.parametrize("kind", CLASSES)
def test_derivatives_of_equilibrium_are_those_of_finite_differences(kind):
    E, own, rng = arrays(kind, COUNT), np.arange(COUNT), np.random.default_rng(0)
    shape = (FRAMES - 1, COUNT)
    f, a = rng.uniform(0.03, 1.3, (FRAMES, COUNT)), rng.uniform(0.05, 0.95, shape)
    H, steps = E.hill, np.full(FRAMES - 1, 0.02)
    lengths = 1.02 * H.tendon + H.fiber * rng.uniform(0.6, 1.4, shape)
    speeds = H.fiber * rng.uniform(-3.0, 3.0, shape)

    def of(f, a):
        out, fibers = np.empty((*shape, 10)), np.empty((*shape, 2))
        elements(E, own, f, a, lengths, speeds, steps, out, fibers)
        return out

    at, h = of(f, a), 1e-6
    over_a = (of(f, a + h) - of(f, a - h)) / (2.0 * h)
    over = []
    for first in (0, 1):
        # Every second frame moves, so that of each element one end does.
        moved = np.zeros_like(f)
        moved[first::2] = h
        over.append((of(f + moved, a) - of(f - moved, a)) / (2.0 * h))
    even = (np.arange(FRAMES - 1) % 2 == 0)[:, None, None]
    over_k, over_n = np.where(even, over[0], over[1]), np.where(even, over[1], over[0])
    told = at[..., [1, 2, 3, 4, 5, 6, 7, 8, 9]]
    found = np.stack(
        [over_k[..., 0], over_n[..., 0], over_a[..., 0], over_k[..., 1], over_k[..., 2], over_n[..., 2],
         over_k[..., 3], over_n[..., 3], over_a[..., 3]], axis=-1,
    )  # fmt: skip
    assert np.abs((told - found) / (1.0 + np.abs(found))).max() < 1e-7


@pytest.mark.parametrize("kind", CLASSES)
def test_what_fibers_pull_with_is_what_their_curves_say(kind):
    E = arrays(kind)
    rng = np.random.default_rng(1)
    x, v, a = rng.uniform(0.6, 1.5, 200), rng.uniform(-0.6, 0.6, 200), rng.uniform(0.3, 1.0, 200)
    kappa = 1.0 - E.slowed[0] * (1.0 - a)
    v *= kappa
    # Outside of where corners of Thelen's curves are rounded; how much that changes is a test of its own.
    v = np.where(np.abs(v / kappa) < 0.02, 0.02 * kappa, v)
    x = np.where(np.abs(x - 1.0) < TAKEN_UP, 1.0 + TAKEN_UP, x)
    factors, out = np.empty((200, 3)), np.empty((200, 10))
    _curves(E, x, v / kappa, factors)
    _pulls(E, x * E.hill.fiber[0], v * E.hill.speed[0], a, out)
    expected = a * factors[:, 0] * factors[:, 2] + factors[:, 1] + E.damping[0] * v
    pulling = expected > 0.05
    assert pulling.sum() > 100
    assert np.abs(out[:, 0] - expected - TONE - FLOOR * a)[pulling].max() < 1e-4


def test_where_thelens_passive_force_sets_in_it_is_rounded_by_a_thousandth():
    E, x = arrays("Thelen2003Muscle"), np.linspace(1.0 - 1.5 * TAKEN_UP, 1.0 + 1.5 * TAKEN_UP, 300)
    factors, out = np.empty((300, 3)), np.empty((300, 10))
    _pulls(E, x * E.hill.fiber[0], np.full(300, 0.1 * E.hill.speed[0]), np.ones(300), out)
    _curves(E, x, np.full(300, 0.1), factors)
    left = out[:, 0] - factors[:, 0] * factors[:, 2] - factors[:, 1] - TONE - FLOOR
    assert 1e-4 < np.abs(left).max() < 1e-3
    # No step in the slope any more: neighbors differ by a small part of the slope with which the curve begins.
    steps, begins = np.abs(np.diff(out[:, 1])), (factors[-1, 1] - factors[-2, 1]) / (x[-1] - x[-2]) / E.hill.fiber[0]
    assert steps.max() < 0.1 * begins


@pytest.mark.parametrize("kind", CLASSES)
def test_the_stretch_of_a_tendon_is_the_inverse_of_its_force(kind):
    one = model(kind)
    f = np.linspace(0.002, 1.8, 300)
    stretch = np.empty_like(f)
    _stretches(compile_elastic(one, True), f, stretch)
    muscle = one.muscles[0]
    if kind == "DeGrooteFregly2016Muscle":
        assert np.allclose(stretch, degroote_stretch(muscle, f), atol=1e-14)
    else:
        assert np.allclose(tendon_factor(muscle, stretch), f, atol=1e-9)


@pytest.mark.parametrize("kind", CLASSES)
def test_forces_integrated_from_activations_are_in_equilibrium_as_steps_shrink(kind):
    E, own = arrays(kind, 5), np.arange(5)
    missed = []
    for frames in (50, 200):
        time = np.linspace(0.0, 1.0, frames)
        middle = 0.5 * (time[1:] + time[:-1])[:, None]
        a = 0.4 + 0.2 * np.sin(5.0 * middle) + np.zeros(5)
        lengths = 1.03 * E.hill.tendon + E.hill.fiber * (1.0 + 0.1 * np.sin(4.0 * middle))
        speeds = E.hill.fiber * 0.4 * np.cos(4.0 * middle)
        f, out, fibers = np.empty((frames, 5)), np.empty((frames - 1, 5, 10)), np.empty((frames - 1, 5, 2))
        integrate(E, own, a, lengths, speeds, np.diff(time), 1e-3, 2.0, f)
        elements(E, own, f, a, lengths, speeds, np.diff(time), out, fibers)
        missed.append(np.abs(out[frames // 5 :, :, 0]).max())
    assert missed[0] < 0.1
    assert missed[1] < 0.4 * missed[0]


def test_a_tendon_that_the_model_calls_rigid_is_not_elastic():
    muscle = Muscle(
        "m", "Millard2012EquilibriumMuscle", Path(()), 1.0, 0.1, 0.1, parameters={"ignore_tendon_compliance": 1.0}
    )
    assert not has_elastic_tendon(muscle)
    assert not has_elastic_tendon(Muscle("r", "RigidTendonMuscle", Path(()), 1.0, 0.1, 0.1))
