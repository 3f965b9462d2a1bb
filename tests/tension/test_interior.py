"""Parts of the interior-point solver: convex curvature against eigenvalues, and which steps its filter takes."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from myomorph.tension.elastic.interior import Solver, _not_negative
from myomorph.tension.elastic.program import Rates


def test_the_nearest_curvature_that_is_not_negative_is_the_clipped_spectrum():
    """Higham 1988: negative eigenvalues become zero, and with them the distance is least."""
    kk, kn, nn = np.random.default_rng(0).normal(size=(3, 200))
    found = np.stack(_not_negative(kk, kn, nn))
    for given, ours in zip(np.stack([kk, kn, nn], axis=1), found.T, strict=True):
        values, vectors = np.linalg.eigh(given[[0, 1, 1, 2]].reshape(2, 2))
        nearest = (vectors * np.maximum(values, 0.0)) @ vectors.T
        np.testing.assert_allclose(ours, nearest[[0, 0, 1], [0, 1, 1]], atol=1e-12)


@pytest.mark.parametrize("smooth", [False, True], ids=["switched", "De Groote"])
def test_slopes_and_curvatures_of_the_rates_are_their_differences(smooth):
    """Without the curvature the solver's last steps gain a thousandth each."""
    rates = Rates(np.full(9, 0.015), np.full(9, 0.06), np.full(9, smooth))
    a, h = np.linspace(0.05, 0.95, 9), 1e-5
    here, ahead, behind = (rates.bounds(one) for one in (a, a + h, a - h))
    for k in (0, 1, 3, 4):
        np.testing.assert_allclose(here[k + 1], (ahead[k] - behind[k]) / (2.0 * h), rtol=1e-6, atol=1e-4)


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
def test_a_step_is_taken_where_the_cost_falls_by_a_ten_thousandth_of_what_its_slope_says(gained, length):
    """Armijo's rule: a slope of -1, a cost that falls by `gained` of the step, and truly from a quarter of it on."""
    values = {1.0: 10.0 - gained, 0.5: 10.0 - 0.5 * min(gained, 0.5e-4), 0.25: 9.9}
    solver = SimpleNamespace(
        mu=1e-3,
        v=[np.zeros(1)],
        y=np.zeros(1),
        boxes=[Free()],
        filter=[],
        slope=lambda at, step, dy: -1.0,
        linearize=lambda v, y: float(v[0][0]),
        merit=lambda v, y, at: (0.0, values.get(float(v[0][0]), 10.0)),
    )
    assert Solver.advance(solver, 0.0, [np.ones(1)], np.zeros(1)) == length
    assert solver.taken == length
    assert solver.v[0] == length
    assert solver.filter == []
