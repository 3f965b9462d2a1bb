"""Multipliers of closed loops: which variables count as at a bound.

Also which are held there, and what the ties add.
"""

from __future__ import annotations

import numpy as np
import pytest

from looped import four_bar, four_bar_angles
from myomorph.core.motion.ik import InverseKinematicsOptions, pose_problem
from myomorph.core.motion.tasks.loops import close, multipliers, new_closing, ties_at, ties_of
from myomorph.core.motion.tasks.task import new_work
from myomorph.core.rigid.kernels import kernel
from myomorph.core.rigid.tree import compile_tree

MODEL = four_bar()
TREE = compile_tree(MODEL)
CLOSED = four_bar_angles(np.array([1.0]))[0]
FREE = np.full(3, np.inf)
NAMES = MODEL.marker_names
PROBLEM = pose_problem(TREE, NAMES, np.ones(len(NAMES)), InverseKinematicsOptions())._replace(
    ties=ties_of(TREE)
)


@kernel
def at_closed(T, K, c, gradient):
    """Return the values of closed loops at c.

    They are held variables, given ones, multipliers, derivatives of the gaps and what is added to
    the Hessian.
    """
    n = c.shape[0]
    work = new_work(T, n)
    closing = new_closing(K.ties, n, n)
    closed = close(T, K, c, work, closing)
    for i in range(n):
        work.g[i] = gradient[i]
        for j in range(n):
            work.H[i, j] = 0.0
    for k in range(work.curvature.shape[0]):
        # The axes move in proportion to their coordinates.
        for d in range(3):
            work.curvature[k, d] = 0.0
    multipliers(T, K, c, work, closing)
    return closed, work.held, closing.dependent, closing.push, closing.G, work.H


@kernel
def slopes_at(T, K, c):
    """Return derivatives of the gaps at c."""
    work = new_work(T, c.shape[0])
    closing = new_closing(K.ties, c.shape[0], c.shape[0])
    ties_at(T, K, c, work, closing)
    return closing.G


def solved(gradient=(0.0, 0.0, 0.0), lower=-FREE, upper=FREE):
    K = PROBLEM._replace(lower=np.array(lower), upper=np.array(upper))
    closed, *found = at_closed(TREE.arrays, K, CLOSED.copy(), np.array(gradient))
    assert closed
    return found


def bound(i, value, of):
    limits = of.copy()
    limits[i] = value
    return limits


def slack(i):
    return 1e-12 * (1.0 + abs(CLOSED[i]))


def test_the_multipliers_balance_the_gradient_of_the_variables_that_the_ties_give():
    gradient = np.array([0.7, -1.3, 0.4])
    _, given, push, G, _ = solved(gradient)
    assert given.sum() == 2
    np.testing.assert_allclose((gradient + push @ G)[given], 0.0, atol=1e-12)


def test_the_curvature_is_that_of_the_gaps():
    gradient = np.array([0.7, -1.3, 0.4])
    *_, push, _, added = solved(gradient)
    step = 1e-6
    expected = np.empty((3, 3))
    for j in range(3):
        d = step * np.eye(3)[j]
        ahead = slopes_at(TREE.arrays, PROBLEM, (CLOSED + d))
        behind = slopes_at(TREE.arrays, PROBLEM, (CLOSED - d))
        expected[j] = push @ (ahead - behind) / (2.0 * step)
    assert np.abs(expected).max() > 0.1
    np.testing.assert_allclose(added, expected, atol=1e-8)


@pytest.mark.parametrize("i", range(3))
def test_a_variable_at_a_bound_is_not_moved_to_close_the_loop_while_others_can_be(i):
    natural = solved()[1]
    others = ~np.eye(3, dtype=bool)[i]
    for share in (0.0, 0.98):
        below = CLOSED[i] - share * slack(i)
        above = CLOSED[i] + share * slack(i)
        np.testing.assert_array_equal(solved(lower=bound(i, below, -FREE))[1], others)
        np.testing.assert_array_equal(solved(upper=bound(i, above, FREE))[1], others)
    # Farther than the slack it is as good as any other.
    below = CLOSED[i] - 1.01 * slack(i)
    above = CLOSED[i] + 1.01 * slack(i)
    np.testing.assert_array_equal(solved(lower=bound(i, below, -FREE))[1], natural)
    np.testing.assert_array_equal(solved(upper=bound(i, above, FREE))[1], natural)


@pytest.mark.parametrize("i", range(3))
def test_exactly_the_slack_from_a_bound_is_still_at_it(i):
    limit = CLOSED[i] - slack(i)
    while limit + slack(i) < CLOSED[i]:
        limit = np.nextafter(limit, np.inf)
    assert limit + slack(i) == CLOSED[i]
    assert not solved(lower=bound(i, limit, -FREE))[1][i]
    limit = CLOSED[i] + slack(i)
    while limit - slack(i) > CLOSED[i]:
        limit = np.nextafter(limit, -np.inf)
    assert limit - slack(i) == CLOSED[i]
    assert not solved(upper=bound(i, limit, FREE))[1][i]


@pytest.mark.parametrize("i", range(3))
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_what_is_pushed_outwards_at_a_bound_is_held(i, sign):
    gradient = sign * np.array([0.7, -1.3, 0.4])
    for share in (0.0, 0.98):
        low = solved(gradient, lower=bound(i, CLOSED[i] - share * slack(i), -FREE))
        high = solved(gradient, upper=bound(i, CLOSED[i] + share * slack(i), FREE))
        # The cost rises with the variable: it would go down, out of its lower bound.
        rises = (gradient + low[2] @ low[3])[i] > 0.0
        assert abs((gradient + low[2] @ low[3])[i]) > 0.01
        assert bool(low[0][i]) == rises
        assert bool(high[0][i]) != rises
        assert not np.delete(low[0], i).any()
        assert not np.delete(high[0], i).any()
