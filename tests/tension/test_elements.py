"""Equilibrium of fibers and elastic tendons between frames.

Its derivatives, and the forces that fulfill it.
"""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.model.model import Model
from myomorph.core.model.paths import Muscle, Path
from myomorph.core.muscles.hill import compile_elastic
from myomorph.core.tension.elastic.program import elements, integrate

CLASSES = ("DeGrooteFregly2016Muscle", "Millard2012EquilibriumMuscle", "Thelen2003Muscle")
FRAMES = 7
COUNT = 30


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


def arrays(kind: str, count: int):
    return compile_elastic(model(kind, count), True)


def _elements_of(kind, rng):
    """Return a function of forces (frames, count) and activations that gives the elements."""
    E = arrays(kind, COUNT)
    shape = (FRAMES - 1, COUNT)
    lengths = 1.02 * E.hill.tendon + E.hill.fiber * rng.uniform(0.6, 1.4, shape)
    speeds = E.hill.fiber * rng.uniform(-3.0, 3.0, shape)

    def of(f, a):
        out = np.empty((*shape, 10))
        steps = np.full(FRAMES - 1, 0.02)
        elements(E, np.arange(COUNT), f, a, lengths, speeds, steps, out)
        return out

    return of


def _differences_of_ends(of, f, a, h):
    """Return differences of the elements over the forces at their first and last frames."""
    over = []
    for first in (0, 1):
        # Every second frame moves, so that of each element one end does.
        moved = np.zeros_like(f)
        moved[first::2] = h
        over.append((of(f + moved, a) - of(f - moved, a)) / (2.0 * h))
    even = (np.arange(len(a)) % 2 == 0)[:, None, None]
    return np.where(even, over[0], over[1]), np.where(even, over[1], over[0])


@pytest.mark.parametrize("kind", CLASSES)
def test_derivatives_of_equilibrium_are_those_of_finite_differences(kind):
    rng = np.random.default_rng(0)
    f = rng.uniform(0.03, 1.3, (FRAMES, COUNT))
    a = rng.uniform(0.05, 0.95, (FRAMES - 1, COUNT))
    of = _elements_of(kind, rng)
    h = 1e-6
    over_a = (of(f, a + h) - of(f, a - h)) / (2.0 * h)
    over_k, over_n = _differences_of_ends(of, f, a, h)
    told = of(f, a)[..., [1, 2, 3, 4, 5, 6, 7, 8, 9]]
    found = np.stack(
        [
            over_k[..., 0],
            over_n[..., 0],
            over_a[..., 0],
            over_k[..., 1],
            over_k[..., 2],
            over_n[..., 2],
            over_k[..., 3],
            over_n[..., 3],
            over_a[..., 3],
        ],
        axis=-1,
    )
    assert np.abs((told - found) / (1.0 + np.abs(found))).max() < 1e-7


@pytest.mark.parametrize("kind", CLASSES)
def test_forces_integrated_from_activations_are_in_equilibrium_as_steps_shrink(kind):
    E = arrays(kind, 5)
    own = np.arange(5)
    missed = []
    for frames in (50, 200):
        time = np.linspace(0.0, 1.0, frames)
        middle = 0.5 * (time[1:] + time[:-1])[:, None]
        a = 0.4 + 0.2 * np.sin(5.0 * middle) + np.zeros(5)
        lengths = 1.03 * E.hill.tendon + E.hill.fiber * (1.0 + 0.1 * np.sin(4.0 * middle))
        speeds = E.hill.fiber * 0.4 * np.cos(4.0 * middle)
        f = np.empty((frames, 5))
        out = np.empty((frames - 1, 5, 10))
        integrate(E, own, a, lengths, speeds, np.diff(time), 1e-3, 2.0, f)
        elements(E, own, f, a, lengths, speeds, np.diff(time), out)
        missed.append(np.abs(out[frames // 5 :, :, 0]).max())
    assert missed[0] < 0.1
    assert missed[1] < 0.4 * missed[0]
