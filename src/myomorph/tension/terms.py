"""Terms of the tension problem, and the one problem they add up to.

    minimise  1/2 x^T H x + c^T x   subject to  A x = b,  G x <= h,  lower <= x <= upper

A cost term gives (H, c), a constraint gives (A, b) or (G, h); a new term is a new function here
or in a file of its own, and nothing else changes. Diagonal H is kept as a vector: without
inequalities the problem then separates, and the solver of `myomorph.tension.dual` takes it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from myomorph.model.arrays import Array
from myomorph.model.contacts import Cone
from myomorph.model.errors import BadData
from myomorph.tension.contact_columns import tangents
from myomorph.tension.dual import INFEASIBLE, OPTIMAL, STALLED, STATUS_NAMES, solve_separable
from myomorph.tension.separable import Separable, no_links, no_wells, pattern

Cost: TypeAlias = tuple[Array, Array]
"""(H, c): H (n,) its diagonal or (n, n), c (n,)."""

Constraint: TypeAlias = tuple[Array, Array]
"""(A, b) of A x = b, or (G, h) of G x <= h."""


def effort(weights: ArrayLike) -> Cost:
    """sum_i weights_i x_i^2: muscles and reserves share the work, strong effort costs most."""
    weights = np.asarray(weights, dtype=np.float64)
    return 2.0 * weights, np.zeros_like(weights)


def nearness(targets: ArrayLike, weights: ArrayLike) -> Cost:
    """sum_i weights_i (x_i - targets_i)^2 less its constant: stay near measured or earlier values.

    A weight of 0 leaves a variable alone, and its target may then be NaN.
    """
    weights = np.asarray(weights, dtype=np.float64)
    wanted = np.where(weights == 0.0, 0.0, np.asarray(targets, dtype=np.float64))
    return 2.0 * weights, -2.0 * weights * wanted


def balance(directions: ArrayLike, torques: ArrayLike) -> Constraint:
    """Equation of motion: directions (rows, n) of unit variables add up to the torques (rows,)."""
    return np.asarray(directions, dtype=np.float64), np.asarray(torques, dtype=np.float64)


def emg_target(emg: ArrayLike, weight: float, variables: int) -> Cost:
    """Soft target weight (a_m - emg_m)^2 of the first variables, activations; NaN asks for nothing.

    Parameters
    ----------
    emg : (muscles,) measured activations
    variables : n, of which the activations come first
    """
    wanted = np.full(variables, np.nan)
    wanted[: len(np.asarray(emg))] = emg
    return nearness(wanted, np.where(np.isnan(wanted), 0.0, weight))


def emg_equality(emg: ArrayLike, slack: float, first: int, variables: int) -> Constraint:
    """|a_m - excess_m - emg_m| <= slack: (G, h) with variables of excess that a cost of their own keeps small.

    Parameters
    ----------
    emg : (muscles,) measured activations, NaN where unknown
    first : number of the first variable of excess, one for every muscle that is known
    """
    emg = np.asarray(emg, dtype=np.float64)
    known = np.flatnonzero(np.isfinite(emg))
    difference = np.zeros((len(known), variables))
    difference[np.arange(len(known)), known] = 1.0
    difference[np.arange(len(known)), first + np.arange(len(known))] = -1.0
    return np.vstack([difference, -difference]), np.concatenate([slack + emg[known], slack - emg[known]])


def contact_regularisation(compliance: float, cost: ArrayLike) -> Cost:
    """Add compliance sum_g cost_g z_g^2: of forces that physics leaves open, the ones spread most evenly."""
    return effort(compliance * np.asarray(cost, dtype=np.float64))


def shared_wrench(sums: ArrayLike, measured: ArrayLike, sd: ArrayLike, weight: float = 1.0) -> Cost:
    """Soft target weight |(S x - measured) / sd|^2: what several contacts carry together was measured.

    Parameters
    ----------
    sums : (rows, n) S, which adds the contact forces' components up
    measured, sd : (rows,) NaN where unknown; standard deviations
    """
    sums, measured = np.asarray(sums, dtype=np.float64), np.asarray(measured, dtype=np.float64)
    known = np.isfinite(measured)
    S = sums[known] / np.broadcast_to(sd, measured.shape)[known, None]
    m = measured[known] / np.broadcast_to(sd, measured.shape)[known]
    return 2.0 * weight * S.T @ S, -2.0 * weight * S.T @ m


def direction_limit(direction: ArrayLike, forces: ArrayLike) -> Constraint:
    """A push or a pull to one side only: -direction . f <= 0 with f = forces x (3, n)."""
    return -(np.asarray(direction, dtype=np.float64) @ np.asarray(forces))[None], np.zeros(1)


def most(direction: ArrayLike, greatest: float, forces: ArrayLike) -> Constraint:
    """Greatest force: direction . f <= greatest with f = forces x (3, n)."""
    return (np.asarray(direction, dtype=np.float64) @ np.asarray(forces))[None], np.array([float(greatest)])


def friction_cone(cone: Cone, forces: ArrayLike) -> Constraint:
    """Faces of the linearised cone of a force f = forces x (3, n), in the axes of the cone's frame.

    m_k . t . f <= friction cos(pi / edges) d . f for the outward normals m_k between two edges. The tension problem
    itself keeps a cone by its edges (`contact_columns.cone_edges`); both are one cone.
    """
    if cone.direction is None:
        return np.zeros((0, np.shape(forces)[1])), np.zeros(0)
    if np.isinf(cone.friction):
        return direction_limit(cone.direction, forces)
    one, other = tangents(cone.direction)
    angles = 2.0 * np.pi * (np.arange(cone.edges) + 0.5) / cone.edges
    normals = np.cos(angles)[:, None] * one + np.sin(angles)[:, None] * other
    faces = normals - cone.friction * np.cos(np.pi / cone.edges) * cone.direction
    return faces @ np.asarray(forces), np.zeros(cone.edges)


@dataclass(frozen=True, eq=False)
class Program:
    """The sum of all terms.

    Attributes
    ----------
    H : (n,) diagonal or (n, n)
    c : (n,)
    A, b : (rows, n), (rows,)
    G, h : (more rows, n), (more rows,)
    lower, upper : (n,)
    variables, rows : names of x and of the rows of A, where they have any
    """

    H: Array
    c: Array
    A: Array
    b: Array
    G: Array
    h: Array
    lower: Array
    upper: Array
    variables: tuple[str, ...] = ()
    rows: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Solution:
    """What a solver found, and how well it fulfils the conditions of an optimum.

    Attributes
    ----------
    x : (n,)
    multipliers : (rows,) of A x = b
    status : "optimal", "infeasible" or "not converged"
    violation : greatest violation of a constraint
    stationarity : greatest |gradient of the Lagrangian| that no bound explains
    """

    x: Array
    multipliers: Array
    status: str
    violation: float
    stationarity: float = field(default=0.0)

    @property
    def optimal(self) -> bool:
        """Whether the solver reached its tolerance."""
        return self.status == STATUS_NAMES[OPTIMAL]


def program(
    costs: Sequence[Cost],
    equalities: Sequence[Constraint] = (),
    inequalities: Sequence[Constraint] = (),
    lower: ArrayLike = -np.inf,
    upper: ArrayLike = np.inf,
) -> Program:
    """Add terms up.

    Raises
    ------
    BadData
        without any cost, or where terms differ in the number of variables
    """
    if not costs:
        raise BadData("a tension problem needs at least one cost term, such as effort(...)")
    n = len(costs[0][1])
    widths = [len(c) for _, c in costs] + [A.shape[1] for A, _ in (*equalities, *inequalities)]
    if set(widths) != {n}:
        raise BadData(f"terms of the tension problem have {sorted(set(widths))} variables: all must have the same")
    dense = any(H.ndim == 2 for H, _ in costs)
    H = sum((np.diag(one) if dense and one.ndim == 1 else one for one, _ in costs), np.zeros((n, n) if dense else n))
    stacked = [np.vstack([A for A, _ in group] or [np.zeros((0, n))]) for group in (equalities, inequalities)]
    right = [np.concatenate([b for _, b in group] or [np.zeros(0)]) for group in (equalities, inequalities)]
    low, high = (np.broadcast_to(np.asarray(one, dtype=np.float64), (n,)).copy() for one in (lower, upper))
    c = np.sum([one for _, one in costs], axis=0)
    return Program(H, c, stacked[0], right[0], stacked[1], right[1], low, high)


def solve_program(problem: Program) -> Solution:
    """The least cost within the constraints.

    A diagonal, positive H without inequalities goes to the separable dual solver; everything else
    to piqp (Schwan, Jiang, Kuhn and Jones 2023), an interior-point method for dense problems.
    """
    separable = problem.H.ndim == 1 and len(problem.G) == 0 and bool(np.all(problem.H > 0.0))
    return _certified(problem, *(_separable(problem) if separable else _general(problem)))


def _separable(problem: Program) -> tuple[Array, Array, Array, int]:
    rows, columns = np.nonzero(problem.A)
    shape = pattern(rows, columns, problem.A.shape)
    count, n = len(problem.b), len(problem.c)
    fixed = Separable(
        shape.start, shape.row, shape.first, 0.5 * problem.H, np.full(n, 2.0), problem.lower, problem.upper
    )
    values = np.empty((1, len(rows)))
    values[0, shape.place] = problem.A[rows, columns]
    x, y, warm = np.empty((1, n)), np.empty((1, count)), np.zeros(count)
    imbalance, iterations, status = np.empty(1), np.empty(1, np.int64), np.empty(1, np.int8)
    target = -(problem.c / problem.H)[None]
    right = problem.b[None, shape.order]
    wells, links = no_wells(n), no_links()
    solve_separable(fixed, values, right, target, wells, links, warm, x, y, imbalance, iterations, status)
    multipliers = np.empty(count)
    multipliers[shape.order] = y[0]
    return x[0], multipliers, np.zeros(0), int(status[0])


def _general(problem: Program) -> tuple[Array, Array, Array, int]:
    try:
        import piqp
    except ImportError:
        raise BadData("this tension problem has a full cost matrix or inequalities: install piqp to solve it") from None

    solver = piqp.DenseSolver()
    solver.settings.eps_abs = solver.settings.eps_rel = 1e-10
    solver.settings.eps_duality_gap_abs = solver.settings.eps_duality_gap_rel = 1e-10
    H = np.diag(problem.H) if problem.H.ndim == 1 else problem.H
    A, G = (np.asfortranarray(one) if len(one) else None for one in (problem.A, problem.G))
    solver.setup(
        np.asfortranarray(H),
        problem.c,
        A,
        problem.b if A is not None else None,
        G,
        None,
        problem.h if G is not None else None,
        problem.lower,
        problem.upper,
    )
    found = solver.solve()
    status = {piqp.PIQP_SOLVED: OPTIMAL, piqp.PIQP_PRIMAL_INFEASIBLE: INFEASIBLE}.get(found, STALLED)
    return np.array(solver.result.x), -np.array(solver.result.y), np.array(solver.result.z_u), status


def _certified(problem: Program, x: Array, y: Array, z: Array, status: int) -> Solution:
    """The solution with residuals that do not rely on the solver's own; z are the multipliers of G x <= h."""
    curvature = problem.H * x if problem.H.ndim == 1 else problem.H @ x
    gradient = curvature + problem.c - problem.A.T @ y + problem.G.T @ z
    violated = np.concatenate(
        [
            np.abs(problem.A @ x - problem.b),
            np.maximum(problem.G @ x - problem.h, 0.0),
            np.maximum(problem.lower - x, 0.0),
            np.maximum(x - problem.upper, 0.0),
        ]
    )
    # On a bound the gradient may point out of it.
    near = 1e-7 * (1.0 + np.abs(x))
    inward = np.where(x <= problem.lower + near, np.minimum(gradient, 0.0), gradient)
    inward = np.where(x >= problem.upper - near, np.maximum(inward, 0.0), inward)
    return Solution(
        x, y, STATUS_NAMES[status], float(violated.max(initial=0.0)), float(np.abs(inward).max(initial=0.0))
    )
