"""Criteria of recruitment, exponents up to 20.

The greatest activation is compared with linear and quadratic programs.
"""

from __future__ import annotations

import numpy as np
import piqp
import pytest
from scipy.optimize import linprog
from test_dual import Cost, muscles, solve
from test_solve import needed, walk

from myomorph.core.model.errors import BadData
from myomorph.core.tension.problem import TensionInputs, TensionProblem, tension_problem
from myomorph.core.tension.recruitment import EFFORT_ALONE
from myomorph.core.tension.solve import solve_tension
from myomorph.core.tension.tension import TensionOptions
from myomorph.core.tension.terms.muscles import SECOND_STAGE

MINMAX = TensionOptions(recruitment="minmax")


def _least_greatest(A: np.ndarray, b: np.ndarray, low: np.ndarray, high: np.ndarray) -> float:
    """Return the minimum beta of scipy's linear programs.

    The constraints are A a = b and low <= a <= min(high, beta).
    """
    rows, count = A.shape
    found = linprog(
        np.append(np.zeros(count), 1.0),
        A_ub=np.hstack([np.eye(count), -np.ones((count, 1))]),
        b_ub=np.zeros(count),
        A_eq=np.hstack([A, np.zeros((rows, 1))]),
        b_eq=b,
        bounds=[*zip(low, high, strict=True), (0.0, None)],
        options={"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10},
    )
    assert found.success, found.message
    return float(found.fun)


def _least_squares_below(
    A: np.ndarray, b: np.ndarray, w: np.ndarray, low: np.ndarray, high: np.ndarray
) -> np.ndarray:
    """Return the minimum of sum w a^2 with A a = b and bounds, by piqp."""
    solver = piqp.DenseSolver()
    solver.settings.eps_abs = solver.settings.eps_rel = 1e-11
    H = np.asfortranarray(2.0 * np.diag(w))
    solver.setup(H, np.zeros(len(w)), np.asfortranarray(A), b, None, None, None, low, high)
    assert solver.solve() == piqp.PIQP_SOLVED
    return np.array(solver.result.x)


def _columns(problem: TensionProblem, frames: int) -> tuple[np.ndarray, np.ndarray]:
    """Return A (frames, rows, unknowns) and b (frames, rows) of a problem."""
    given = problem.balance(0, frames)
    shared = problem.separable
    A = np.zeros((frames, given.right.shape[1], len(shared.weight)))
    A[:, shared.row, np.repeat(np.arange(A.shape[2]), np.diff(shared.start))] = given.values
    return A, given.right


@pytest.mark.parametrize("lower", [0.0, 0.01])
def test_random_problems_have_the_least_greatest_activation_and_then_the_least_squares(lower):
    for seed in range(8):
        directions, low, high, torques = muscles(seed, rows=8, count=30, lower=lower)
        weights = np.append(np.full(30, SECOND_STAGE), np.ones(8))
        x, status, residual, _, _ = solve(
            directions, low, high, torques, Cost(weights=weights, capped=30, peak=1.0)
        )
        assert status[0] == 0
        assert residual[0] < 1e-6
        mine = directions[:, :30]
        rest = torques - directions[:, 30:] @ x[0, 30:]
        beta = _least_greatest(mine, rest, low[:30], high[:30])
        assert x[0, :30].max() == pytest.approx(beta, abs=1e-8)
        expected = _least_squares_below(mine, rest, np.ones(30), low[:30], np.full(30, beta + 1e-9))
        # The bound's 1e-9 of room is worth up to 1e-9 / SECOND_STAGE to the sum of squares.
        np.testing.assert_allclose(x[0, :30], expected, atol=1e-3)
        assert np.sum(x[0, :30] ** 2) < np.sum(expected**2) + 1e-9 / SECOND_STAGE


def test_a_walk_is_recruited_as_linear_programs_say(data):
    model, motion, torques = walk(data, 6)
    problem = tension_problem(
        TensionInputs(model=model, motion=motion, torques=torques, options=MINMAX)
    )
    problem.solve(0, 6)
    found = problem.result()
    assert found.optimal.all()
    np.testing.assert_allclose(
        needed(model, motion, torques, found), found.balanced_torque, atol=1e-5
    )
    A, b = _columns(problem, 6)
    count = len(model.muscles)
    for frame in range(6):
        rest = b[frame] - A[frame, :, count:] @ problem.x[frame, count:]
        beta = _least_greatest(
            A[frame, :, :count], rest, found.activation_lower, found.activation_upper
        )
        assert found.activation[frame].max() == pytest.approx(beta, abs=1e-7)
        capped = np.minimum(found.activation_upper, beta + 1e-9)
        expected = _least_squares_below(
            A[frame, :, :count], rest, np.ones(count), found.activation_lower, capped
        )
        np.testing.assert_allclose(found.activation[frame], expected, atol=2e-4)


def test_frames_of_minmax_do_not_depend_on_each_other(data):
    model, motion, torques = walk(data, 5)
    together = solve_tension(model, motion, torques, MINMAX)
    for k in (0, 3):
        problem = tension_problem(
            TensionInputs(model=model, motion=motion, torques=torques, options=MINMAX)
        )
        problem.solve(k, k + 1)
        np.testing.assert_allclose(
            problem.result().activation[k], together.activation[k], atol=1e-7
        )


def test_a_growing_exponent_ends_at_the_least_greatest_activation(data):
    model, motion, torques = walk(data, 6)
    limit = solve_tension(model, motion, torques, MINMAX).activation.max(axis=1)
    before = np.inf
    for exponent in (2.0, 4.0, 8.0, 12.0, 20.0):
        found = solve_tension(
            model,
            motion,
            torques,
            TensionOptions(exponent=exponent),
            recruitment=EFFORT_ALONE,
        )
        assert found.optimal.all()
        greatest = found.activation.max(axis=1)
        assert np.all(greatest > limit - 1e-6)
        assert np.all(greatest < before + 1e-6)
        before = greatest
    assert np.all(before < 1.08 * limit)


def test_strength_weighs_the_strong_muscles(data):
    model, motion, torques = walk(data, 4)
    equal = solve_tension(model, motion, torques)
    strength = solve_tension(model, motion, torques, TensionOptions(weights="strength"))
    forces = np.array([one.max_isometric_force for one in model.muscles])
    assert strength.optimal.all()
    assert np.sum(strength.activation**2 * forces) < np.sum(equal.activation**2 * forces)


def test_what_does_not_go_together_is_refused():
    with pytest.raises(BadData, match="leave the exponent out"):
        TensionOptions(recruitment="minmax", exponent=3.0)
    with pytest.raises(BadData, match="its limit is recruitment 'minmax'"):
        TensionOptions(exponent=40.0)
    with pytest.raises(BadData, match="'power', 'minmax'"):
        TensionOptions(recruitment="polynomial")  # type: ignore[arg-type]
    with pytest.raises(BadData, match="unknown min activation"):
        TensionOptions(min_activation="none")  # type: ignore[arg-type]
