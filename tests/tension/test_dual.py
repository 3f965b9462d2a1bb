"""The separable solver on problems like muscles': against piqp, and by its own conditions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from readable import balance, effort, nearness, program, solve_program

from myomorph.core.model.arrays import frozen_array
from myomorph.core.rigid.kernels import kernel
from myomorph.core.tension.dual import INFEASIBLE, MISSING, OPTIMAL, Line, _step
from myomorph.core.tension.problem import solve_frames
from myomorph.core.tension.separable import Separable, SeparableFrame, pattern


def muscles(seed: int, rows: int = 12, count: int = 40, reserve: float = 1.0, lower: float = 0.01):
    """Make directions, bounds and balanced torques.

    A third of the muscles work, reserves have no bounds.
    """
    rng = np.random.default_rng(seed)
    directions = 60.0 * rng.normal(size=(rows, count)) * (rng.random((rows, count)) < 0.3)
    low = np.full(count, lower)
    high = np.ones(count)
    if reserve:
        directions = np.hstack([directions, reserve * np.eye(rows)])
        low = np.append(low, np.full(rows, -np.inf))
        high = np.append(high, np.full(rows, np.inf))
    active = rng.uniform(0, 1, directions.shape[1]) * (rng.random(directions.shape[1]) < 0.35)
    return directions, low, high, directions @ np.clip(active, low, high)


@dataclass(frozen=True, kw_only=True, eq=False)
class Cost:
    """What unknowns cost.

    Attributes
    ----------
    exponent : of all unknowns
    weights : (unknowns,) 1 by default
    targets : (frames, unknowns) to which they are drawn, none by default
    penalties : (frames, 3, unknowns) low, high and stiffness, none by default
    capped : number of unknowns, from the first, below the greatest activation
    peak : cost of the greatest activation
    """

    exponent: float = 2.0
    weights: np.ndarray | None = None
    targets: np.ndarray | None = None
    penalties: np.ndarray | None = None
    capped: int = 0
    peak: float = 0.0


EFFORT = Cost()


def solve(directions, low, high, torques, cost=EFFORT):
    """Solve frames (torques (frames, rows)) through the kernel.

    Returned are x, status, residual, multipliers and iterations.
    """
    torques = np.atleast_2d(torques)
    rows, columns = np.nonzero(directions)
    shape = pattern(rows, columns, directions.shape)
    count = directions.shape[1]
    frames = len(torques)
    weights = np.ones(count) if cost.weights is None else cost.weights
    fixed = Separable(
        start=shape.start,
        row=shape.row,
        first=0 * shape.first if cost.capped else shape.first,
        weight=frozen_array(weights),
        exponent=frozen_array(np.full(count, cost.exponent)),
        lower=frozen_array(low),
        upper=frozen_array(high),
        capped=cost.capped,
        peak=cost.peak,
    )
    values = np.empty((frames, len(rows)))
    values[:, shape.place] = directions[rows, columns]
    right = np.ascontiguousarray(torques[:, shape.order])
    penalties = np.zeros((1, 3, count)) if cost.penalties is None else cost.penalties
    found = solve_frames(fixed, values, right, penalties, targets=cost.targets)
    multipliers = np.empty_like(found.multipliers)
    multipliers[:, shape.order] = found.multipliers
    return found.x, found.status, found.residual, multipliers, found.iterations


@pytest.mark.parametrize("reserve", [0.0, 1.0, 50.0])
@pytest.mark.parametrize("lower", [0.0, 0.01])
def test_quadratic_effort_agrees_with_an_interior_point_method(reserve, lower):
    piqp = pytest.importorskip("piqp")
    for seed in range(6):
        directions, low, high, torques = muscles(seed, reserve=reserve, lower=lower)
        x, status, residual, _, _ = solve(directions, low, high, torques)
        solver = piqp.DenseSolver()
        solver.settings.eps_abs = solver.settings.eps_rel = 1e-12
        count = len(low)
        H = np.asfortranarray(2 * np.eye(count))
        solver.setup(
            H, np.zeros(count), np.asfortranarray(directions), torques, None, None, None, low, high
        )
        assert solver.solve() == piqp.PIQP_SOLVED
        assert status[0] == OPTIMAL
        assert residual[0] < 1e-6
        np.testing.assert_allclose(x[0], solver.result.x, atol=1e-6)


@settings(max_examples=60)
@given(
    seed=st.integers(0, 10**6),
    exponent=st.sampled_from([1.2, 1.5, 2.0, 3.0, 4.0]),
    reserve=st.sampled_from([0.0, 1.0, 30.0]),
)
def test_the_conditions_of_an_optimum_hold_for_any_exponent(seed, exponent, reserve):
    directions, low, high, torques = muscles(seed, rows=8, count=30, reserve=reserve)
    weights = np.random.default_rng(seed).uniform(0.2, 5.0, len(low))
    x, status, residual, y, _ = solve(
        directions, low, high, torques, Cost(exponent=exponent, weights=weights)
    )
    assert status[0] == OPTIMAL
    scale = 1.0 + np.abs(torques).max()
    assert np.abs(directions @ x[0] - torques).max() == pytest.approx(residual[0], abs=1e-9)
    assert residual[0] < 1e-8 * scale
    assert np.all(x[0] >= low)
    assert np.all(x[0] <= high)
    slope = weights * exponent * np.sign(x[0]) * np.abs(x[0]) ** (exponent - 1.0)
    gradient = slope - directions.T @ y[0]
    size = 1.0 + np.abs(slope).max()
    assert np.all(gradient[x[0] > low] < 1e-6 * size)
    assert np.all(gradient[x[0] < high] > -1e-6 * size)


def test_the_exponent_3_is_solved_as_those_beside_it():
    """It has roots of its own; pulled to intervals, some variables lie outside these."""
    directions, low, high, torques = muscles(5)
    penalties = np.zeros((1, 3, len(low)))
    penalties[0, 0, ::2] = 0.3
    penalties[0, 1, ::2] = 0.4
    penalties[0, 2, ::2] = 2.0
    own = solve(directions, low, high, torques, Cost(exponent=3.0, penalties=penalties))[0]
    near = solve(directions, low, high, torques, Cost(exponent=3.0 + 1e-9, penalties=penalties))[0]
    np.testing.assert_allclose(own, near, atol=1e-6)
    assert ((own[0, ::2] < 0.3) | (own[0, ::2] > 0.4)).any()


def test_warm_and_cold_starts_end_in_the_same_place():
    directions, low, high, _ = muscles(3)
    torques = np.array([muscles(3)[3] * (1.0 + 0.02 * k) for k in range(12)])
    together = solve(directions, low, high, torques)
    alone = np.vstack([solve(directions, low, high, one)[0] for one in torques])
    np.testing.assert_allclose(together[0], alone, atol=1e-9)
    assert together[4][1:].mean() < solve(directions, low, high, torques[0])[4][0]
    # From its own multipliers a frame is solved before the first step.
    repeated = solve(directions, low, high, np.tile(torques[0], (3, 1)))[4]
    np.testing.assert_array_equal(repeated, [repeated[0], 0, 0])


def test_torques_beyond_all_strength_are_called_infeasible_and_missed_least():
    from scipy.optimize import lsq_linear

    directions, low, high, torques = muscles(1, reserve=0.0)
    x, status, residual, _, _ = solve(directions, low, high, 4.0 * torques)
    assert status[0] == INFEASIBLE
    assert residual[0] > 10.0
    least = lsq_linear(directions, 4.0 * torques, (low, high)).x
    missed = np.linalg.norm(directions @ x[0] - 4.0 * torques)
    assert missed < 1.1 * np.linalg.norm(directions @ least - 4.0 * torques)


def test_torques_at_the_border_of_strength_are_reached():
    """All muscles work at a bound, and multipliers are huge.

    Few frames are unresolved, and by less than 5 mN m.
    """
    tried = []
    for seed in (
        2,
        3,
        8,
        9,
        14,
        15,
        20,
        21,
        26,
        27,
        44,
        45,
        62,
        63,
        68,
        69,
        80,
        81,
        86,
        87,
        92,
        93,
    ):
        rng = np.random.default_rng(seed)
        directions, low, high, _ = muscles(
            seed, 4 + seed % 9, 12 + seed % 30, 0.0, (0.0, 0.01)[seed % 2]
        )
        middle = directions @ (0.5 * (low + high))
        most = directions @ np.where(
            directions.T @ rng.normal(size=len(directions)) > 0.0, high, low
        )
        shares = (1.0, 1.0 - 1e-12, 1.0 - 1e-9, 1.0 - 1e-6, 1.0 - 1e-4)
        for torques in (middle + share * (most - middle) for share in shares):
            x, status, residual, _, _ = solve(directions, low, high, torques, Cost(exponent=3.0))
            assert np.abs(directions @ x[0] - torques).max() == pytest.approx(residual[0], abs=1e-9)
            tried.append((status[0], residual[0]))
    status, residual = np.array(tried).T
    assert residual.max() < 5e-3
    assert np.mean(status == OPTIMAL) > 0.97
    assert not (status == INFEASIBLE).any()


def _bisected_on(wide):
    """Return the slope of a dual about a third of a step, and the step that `_step` takes.

    The dual falls by 1 within `wide`.
    """
    shape = pattern(np.zeros(1, np.int64), np.zeros(1, np.int64), (1, 1))
    fixed = Separable(
        start=shape.start,
        row=shape.row,
        first=shape.first,
        weight=np.array([0.5 * wide]),
        exponent=np.array([2.0]),
        lower=np.array([0.0]),
        upper=np.array([1.0]),
    )
    frame = SeparableFrame(
        values=np.ones(1),
        right=np.zeros(1),
        targets=np.zeros(1),
        low=np.zeros(1),
        high=np.zeros(1),
        pull=np.zeros(1),
    )
    line = Line(s=np.array([-1.0 / 3.0]), ds=np.ones(1), constant=0.5, linear=0.0)
    return _stepped(fixed, frame, line)


@kernel
def _stepped(shared, frame, line):
    """`_step`, which only kernels may call."""
    return _step(shared, frame, line)


@pytest.mark.parametrize("wide", [1e-2, 1e-6, 1e-10])
def test_a_step_ends_where_the_dual_is_level_however_sharp_its_bend(wide):
    """A muscle becomes active between s = 0 and s = `wide`.

    Half active it holds the torque: at 1/3 + `wide` / 2 of the step.
    """
    assert _bisected_on(wide) == pytest.approx(1.0 / 3.0 + 0.5 * wide, abs=0.06 * wide)


def test_frames_with_missing_input_are_marked_and_do_not_spread():
    directions, low, high, torques = muscles(2)
    frames = np.tile(torques, (4, 1))
    frames[1, 3] = np.nan
    frames[2, 0] = np.inf
    x, status, residual, _, _ = solve(directions, low, high, frames)
    np.testing.assert_array_equal(status, [OPTIMAL, MISSING, MISSING, OPTIMAL])
    assert np.all(np.isnan(x[1:3]))
    assert np.all(np.isnan(residual[1:3]))
    np.testing.assert_allclose(x[3], x[0], atol=1e-9)


def test_targets_pull_activations_towards_them():
    directions, low, high, torques = muscles(4)
    targets = np.full((1, len(low)), 0.4)
    targets[0, 40:] = 0.0
    free = solve(directions, low, high, torques)[0][0]
    pulled = solve(directions, low, high, torques, Cost(targets=targets))[0][0]
    assert np.linalg.norm(pulled[:40] - 0.4) < np.linalg.norm(free[:40] - 0.4)


def test_targets_and_weights_agree_with_an_interior_point_method():
    directions, low, high, torques = muscles(7)
    count = len(low)
    rng = np.random.default_rng(0)
    weights = rng.uniform(0, 2, count)
    targets = rng.uniform(0, 1, count)
    # |x|^2 + w (x - t)^2 is (1 + w) (x - w t / (1 + w))^2 and a constant.
    both = 1.0 + weights
    x = solve(
        directions, low, high, torques, Cost(weights=both, targets=(weights * targets / both)[None])
    )[0][0]
    costs = [effort(np.ones(count)), nearness(targets, weights)]
    equations = [balance(directions, torques)]
    np.testing.assert_allclose(
        x, solve_program(program(costs, equations, lower=low, upper=high)), atol=1e-6
    )
    H, c = costs[1]
    dense = program([costs[0], (np.diag(H), c)], equations, lower=low, upper=high)
    np.testing.assert_allclose(x, solve_program(dense), atol=1e-6)


def test_an_inequality_is_a_row_with_an_unknown_of_its_own():
    directions, low, high, torques = muscles(9)
    count = len(low)
    limit = np.zeros((1, count))
    limit[0, :40] = 1.0
    free = solve(directions, low, high, torques)[0][0]
    most = 0.9 * (limit @ free)
    equation = [balance(directions, torques)]
    held = solve_program(program([effort(np.ones(count))], equation, [(limit, most)], low, high))
    A = np.block([[directions, np.zeros((len(directions), 1))], [limit, np.ones((1, 1))]])
    x, status, _, _, _ = solve(
        A,
        np.append(low, 0.0),
        np.append(high, np.inf),
        np.append(torques, most),
        Cost(exponent=2.0, weights=np.append(np.ones(count), 1e-6)),
    )
    assert status[0] == OPTIMAL
    assert (limit @ x[0, :count])[0] <= most[0] + 1e-6
    assert np.abs(free - x[0, :count]).max() > 0.01
    np.testing.assert_allclose(x[0, :count], held, atol=1e-5)
