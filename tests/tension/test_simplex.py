"""Extremes of linear functions over polytopes: against HiGHS, and laws of duality."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog

from myomorph.core.tension.simplex import extremes


def polytope(seed, rows=9, n=40):
    """Random equations with a feasible point inside, on bounds, and free in some variables."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(rows, n)) * rng.choice([0.0, 1.0, 100.0], (rows, n), p=[0.4, 0.4, 0.2])
    lower = -rng.uniform(0.1, 2.0, n)
    upper = rng.uniform(0.1, 3.0, n)
    x = np.clip(rng.normal(size=n), lower, upper)
    lower[:3] = -np.inf
    upper[3:6] = np.inf
    lower[6] = x[6]
    upper[6] = x[6]
    return A, x, lower, upper, rng.normal(size=(6, n))


@pytest.mark.parametrize("seed", range(12))
def test_least_values_are_those_of_highs(seed):
    A, x, lower, upper, costs = polytope(seed, rows=5 + seed)
    found, points = extremes(A, x, lower, upper, costs)
    for cost, least, point in zip(costs, found, points, strict=True):
        theirs = linprog(
            cost, A_eq=A, b_eq=A @ x, bounds=np.column_stack([lower, upper]), method="highs"
        )
        if theirs.status == 3:
            assert least == -np.inf
            continue
        assert theirs.status == 0
        assert least == pytest.approx(theirs.fun, rel=1e-7, abs=1e-7)
        np.testing.assert_allclose(A @ point, A @ x, atol=1e-6)
        assert (point >= lower - 1e-7).all()
        assert (point <= upper + 1e-7).all()


def test_rows_that_depend_on_others_and_points_without_room_do_no_harm():
    A, x, lower, upper, costs = polytope(3)
    doubled = np.vstack([A, A[:2] + A[2:4]])
    one, _ = extremes(A, x, lower, upper, costs)
    other, _ = extremes(doubled, x, lower, upper, costs)
    np.testing.assert_allclose(other, one, rtol=1e-8)
    still, points = extremes(A, x, x, x, costs)
    np.testing.assert_allclose(still, costs @ x)
    np.testing.assert_allclose(points, np.tile(x, (6, 1)))


def test_a_simplex_has_its_corners():
    """Shares of one whole: each share is between 0 and 1, the sum of two not above 1."""
    A = np.ones((1, 5))
    x = np.full(5, 0.2)
    costs = np.vstack([np.eye(5), -np.eye(5), [[-1.0, -1.0, 0.0, 0.0, 0.0]]])
    found, _ = extremes(A, x, np.zeros(5), np.full(5, np.inf), costs)
    np.testing.assert_allclose(found, [0.0] * 5 + [-1.0] * 6, atol=1e-12)
