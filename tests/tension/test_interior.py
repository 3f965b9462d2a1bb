"""Parts of the interior-point solver.

Convex curvature against eigenvalues, and which steps its filter takes.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from test_elements import arrays

from myomorph.core.tension.elastic.interior import (
    Blocks,
    Merit,
    NewtonStep,
    Solver,
    _not_negative,
)
from myomorph.core.tension.elastic.program import Costs, Point, Program, Rates


def test_the_nearest_curvature_that_is_not_negative_is_the_clipped_spectrum():
    """Higham 1988: negative eigenvalues become zero, and with them the distance is least."""
    kk, kn, nn = np.random.default_rng(0).normal(size=(3, 200))
    found = np.stack(_not_negative(Blocks(kk, kn, nn)))
    for given, ours in zip(np.stack([kk, kn, nn], axis=1), found.T, strict=True):
        values, vectors = np.linalg.eigh(given[[0, 1, 1, 2]].reshape(2, 2))
        nearest = (vectors * np.maximum(values, 0.0)) @ vectors.T
        np.testing.assert_allclose(ours, nearest[[0, 0, 1], [0, 1, 1]], atol=1e-12)


@pytest.mark.parametrize("smooth", [False, True], ids=["switched", "De Groote"])
def test_slopes_and_curvatures_of_the_rates_are_their_differences(smooth):
    """Without the curvature the solver's last steps gain a thousandth each."""
    rates = Rates(np.full(9, 0.015), np.full(9, 0.06), np.full(9, smooth))
    a = np.linspace(0.05, 0.95, 9)
    h = 1e-5
    here = rates.bounds(a)
    ahead = rates.bounds(a + h)
    behind = rates.bounds(a - h)
    for k in (0, 1, 3, 4):
        np.testing.assert_allclose(
            here[k + 1], (ahead[k] - behind[k]) / (2.0 * h), rtol=1e-6, atol=1e-4
        )


def _costs(number, shape, high):
    """Return costs of unknowns between bounds on both sides of zero."""
    zero = np.zeros(number)
    return Costs(
        weight=zero + 1.0,
        exponent=zero + 2.0,
        lower=zero - high,
        upper=zero + high,
        penalty=np.zeros((3, *shape)),
        share=np.ones((shape[0], 1)),
    )


FRAMES = 4
COUNT = 3  # Of muscles
ROWS = 3  # Of the balance
OTHERS = 2
SIZES = [
    (FRAMES, COUNT),
    (FRAMES - 1, COUNT),
    (FRAMES, OTHERS),
    (FRAMES - 1, COUNT),
    (FRAMES, ROWS),
]
"""Shapes of forces, activations, others, multipliers of equilibrium and of the balance."""


def _small_solver():
    """Return a solver of three muscles on elastic tendons over four frames."""
    E = arrays("Thelen2003Muscle", 3)
    rng = np.random.default_rng(1)
    f, a, x = [rng.uniform(0.3, 0.6, shape) for shape in SIZES[:3]]
    program = Program(
        arrays=E,
        own=np.arange(COUNT),
        steps=np.full(FRAMES - 1, 0.02),
        lengths=E.hill.tendon + 1.1 * E.hill.fiber + np.zeros_like(a),
        speeds=np.zeros_like(a),
        pulls=30.0 * rng.normal(size=(FRAMES, ROWS, COUNT)),
        columns=rng.normal(size=(FRAMES, ROWS, OTHERS)),
        right=rng.normal(size=(FRAMES, ROWS)),
        activation=_costs(COUNT, a.shape, 1.0),
        other=_costs(OTHERS, x.shape, 10.0),
        rates=None,
    )
    return Solver(program, Point(f, a, x), rng.normal(size=SIZES[4]))


def _split(flat):
    """Return the unknowns by kind."""
    ends = np.cumsum([np.prod(shape) for shape in SIZES])[:-1]
    parts = np.split(flat, ends)
    return [part.reshape(shape) for part, shape in zip(parts, SIZES, strict=True)]


def _slopes(solver, flat):
    """Return slopes over all unknowns, which are zero at the optimum."""
    f, a, x, lam, y = _split(flat)
    at = solver.linearize([f, a, x], y)
    over_f, over_a, over_x = [
        box.barrier(part, solver.mu)[0] for box, part in zip(solver.boxes, (f, a, x), strict=True)
    ]
    over_f += solver._smooth_slope(f) - np.einsum("fr,frm->fm", y, solver.p.pulls)
    over_f[:-1] += lam * at.g[..., 1]
    over_f[1:] += lam * at.g[..., 2]
    over_a += at.slope_a + lam * at.g[..., 3]
    over_x += at.slope_x - np.einsum("fr,frm->fm", y, solver.p.columns)
    return np.concatenate(
        [part.ravel() for part in (over_f, over_a, over_x, at.g[..., 0], at.balance)]
    )


def test_the_first_step_is_newtons_for_all_unknowns_at_once():
    """Of slopes over f, a, x, multipliers of equilibrium and of the balance.

    Nothing is eliminated; slopes are by differences.
    """
    solver = _small_solver()
    at = solver.linearize(solver.v, solver.y)
    start = [*solver.v, solver.multipliers(at)[1], solver.y]
    u = np.concatenate([part.ravel() for part in start])
    h = 1e-6
    differences = [
        (_slopes(solver, u + h * way) - _slopes(solver, u - h * way)) / (2.0 * h)
        for way in np.eye(len(u))
    ]
    matrix = np.stack(differences, axis=1)
    f, a, x, _, y = _split(np.linalg.solve(matrix, -_slopes(solver, u)))
    step, dy = solver.step(at, 0.0)
    assert solver.bent == 0
    for ours, whole in zip((*step, dy), (f, a, x, y), strict=True):
        np.testing.assert_allclose(ours, whole, rtol=1e-4, atol=1e-5)


class Free:
    """Unknowns without bounds, as far as a step asks of them."""

    z = w = np.zeros(1)

    def reach(self, v, dv, share):
        return 1.0

    def changes(self, v, dv, mu):
        return np.zeros(1), np.zeros(1)

    def dual_reach(self, dz, dw, share):
        return 1.0

    def keep_near(self, v, mu):
        """They have no multipliers."""


@pytest.mark.parametrize(("gained", "length"), [(2e-4, 1.0), (0.5e-4, 0.25), (-0.5e-4, 0.25)])
def test_a_step_is_taken_where_the_cost_falls_by_a_ten_thousandth_of_what_its_slope_says(
    gained, length
):
    """Armijo's rule with a slope of -1.

    The cost falls by `gained` of the step, and truly from a quarter of it on.
    """
    values = {1.0: 10.0 - gained, 0.5: 10.0 - 0.5 * min(gained, 0.5e-4), 0.25: 9.9}
    solver = SimpleNamespace(
        mu=1e-3,
        v=[np.zeros(1)],
        y=np.zeros(1),
        boxes=[Free()],
        filter=[],
        slope=lambda at, step: -1.0,
        linearize=lambda v, y: float(v[0][0]),
        merit=lambda v, y, at: Merit(0.0, values.get(float(v[0][0]), 10.0)),
        _accepted=lambda at, step, share: Solver._accepted(solver, at, step, share),
        _accepts=lambda *step: Solver._accepts(solver, *step),
    )
    step = NewtonStep([np.ones(1)], np.zeros(1))
    assert Solver.advance(solver, 0.0, step) == length
    assert solver.taken == length
    assert solver.v[0] == length
    assert solver.filter == []
