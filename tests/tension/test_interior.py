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


def test_the_first_step_is_newtons_for_all_unknowns_at_once():
    """Of slopes over f, a, x, multipliers of equilibrium and of the balance.

    Nothing is eliminated; slopes are by differences.
    """
    E = arrays("Thelen2003Muscle", 3)
    rng = np.random.default_rng(1)
    frames = 4
    count = 3
    rows = 3
    others = 2
    sizes = [
        (frames, count),
        (frames - 1, count),
        (frames, others),
        (frames - 1, count),
        (frames, rows),
    ]

    def costs(number, shape, high):
        zero = np.zeros(number)
        return Costs(
            weight=zero + 1.0,
            exponent=zero + 2.0,
            lower=zero - high,
            upper=zero + high,
            penalty=np.zeros((3, *shape)),
            share=np.ones((shape[0], 1)),
        )

    f_shape, a_shape, x_shape = sizes[:3]
    f = rng.uniform(0.3, 0.6, f_shape)
    a = rng.uniform(0.3, 0.6, a_shape)
    x = rng.uniform(0.3, 0.6, x_shape)
    program = Program(
        arrays=E,
        own=np.arange(count),
        steps=np.full(frames - 1, 0.02),
        lengths=E.hill.tendon + 1.1 * E.hill.fiber + np.zeros_like(a),
        speeds=np.zeros_like(a),
        pulls=30.0 * rng.normal(size=(frames, rows, count)),
        columns=rng.normal(size=(frames, rows, others)),
        right=rng.normal(size=(frames, rows)),
        activation=costs(count, a.shape, 1.0),
        other=costs(others, x.shape, 10.0),
        rates=None,
    )
    solver = Solver(program, Point(f, a, x), rng.normal(size=sizes[4]))
    at = solver.linearize(solver.v, solver.y)
    start = [*solver.v, solver.multipliers(at)[1], solver.y]

    def slopes(flat):
        parts = np.split(flat, ends)
        f, a, x, lam, y = [part.reshape(shape) for part, shape in zip(parts, sizes, strict=True)]
        at = solver.linearize([f, a, x], y)
        f_box, a_box, x_box = solver.boxes
        over_f = f_box.barrier(f, solver.mu)[0]
        over_a = a_box.barrier(a, solver.mu)[0]
        over_x = x_box.barrier(x, solver.mu)[0]
        over_f += solver._smooth_slope(f) - np.einsum("fr,frm->fm", y, program.pulls)
        over_f[:-1] += lam * at.g[..., 1]
        over_f[1:] += lam * at.g[..., 2]
        over_a += at.slope_a + lam * at.g[..., 3]
        over_x += at.slope_x - np.einsum("fr,frm->fm", y, program.columns)
        return np.concatenate(
            [part.ravel() for part in (over_f, over_a, over_x, at.g[..., 0], at.balance)]
        )

    ends = np.cumsum([np.prod(shape) for shape in sizes])[:-1]
    u = np.concatenate([part.ravel() for part in start])
    h = 1e-6
    matrix = np.stack(
        [(slopes(u + h * way) - slopes(u - h * way)) / (2.0 * h) for way in np.eye(len(u))], axis=1
    )
    f, a, x, _, y = np.split(np.linalg.solve(matrix, -slopes(u)), ends)
    step, dy = solver.step(at, 0.0)
    assert solver.bent == 0
    for ours, whole in zip((*step, dy), (f, a, x, y), strict=True):
        np.testing.assert_allclose(ours.ravel(), whole, rtol=1e-4, atol=1e-5)


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
