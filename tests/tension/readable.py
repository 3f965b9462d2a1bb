"""One frame of the tension problem as a quadratic program with full matrices.

It is for solvers that share nothing with ours.

    minimize  1/2 x^T H x + c^T x   subject to  A x = b,  G x <= h,  lower <= x <= upper

Where the package adds unknowns to stay separable (`terms.contacts`, `terms.emg`), this form has
full cost matrices and inequalities; both have one solution. Smoothness between frames has no place
in it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
import piqp
from numpy.typing import ArrayLike

from myomorph.core.model.arrays import Array
from myomorph.core.model.contacts import Cone, tangents
from myomorph.core.tension.problem import TensionProblem
from myomorph.core.tension.terms.contacts import MEASURED_COST
from myomorph.core.tension.terms.emg import STIFFNESS, EmgTarget

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
    """Return the soft target weight (a_m - t_m)^2 of the first variables, activations.

    NaN adds nothing. With the effort a^2 the cost is (1 + weight) (a - emg (weight + s) / (1 +
    weight))^2
    but for a constant, where t = emg (1 + s / weight): of the effort of a firm target nothing is
    left, s = weight / (1 + weight).

    Parameters
    ----------
    emg : (muscles,) measured activations
    weight : of the target, against 1 of the effort
    variables : n, of which the activations come first
    """
    wanted = np.full(variables, np.nan)
    wanted[: len(np.asarray(emg))] = np.asarray(emg) * (1.0 + 1.0 / (1.0 + weight))
    return nearness(wanted, np.where(np.isnan(wanted), 0.0, weight))


def emg_equality(emg: ArrayLike, slack: float, first: int, variables: int) -> Constraint:
    """Return (G, h) of |a_m - excess_m - emg_m| <= slack.

    Variables of excess have a cost of their own that keeps them small.

    Parameters
    ----------
    emg : (muscles,) measured activations, NaN where unknown
    slack : of each equality
    first : number of the first variable of excess, one for every muscle that is known
    variables : number of all variables

    Returns
    -------
    rows of the known muscles' upper bounds, then of their lower ones
    """
    emg = np.asarray(emg, dtype=np.float64)
    known = np.flatnonzero(np.isfinite(emg))
    difference = np.zeros((len(known), variables))
    difference[np.arange(len(known)), known] = 1.0
    difference[np.arange(len(known)), first + np.arange(len(known))] = -1.0
    return np.vstack([difference, -difference]), np.concatenate(
        [slack + emg[known], slack - emg[known]]
    )


def contact_regularisation(compliance: float, cost: ArrayLike) -> Cost:
    """Add compliance sum_g cost_g z_g^2.

    Of forces that physics leaves indeterminate, the most evenly distributed ones are chosen.
    """
    return effort(compliance * np.asarray(cost, dtype=np.float64))


def shared_wrench(sums: ArrayLike, measured: ArrayLike, sd: ArrayLike, weight: float = 1.0) -> Cost:
    """Return the soft target weight |(S x - measured) / sd|^2.

    It is for what several contacts carry together and a device measured.

    Parameters
    ----------
    sums : (rows, n) S, which adds the contact forces' components up
    measured, sd : (rows,) NaN where unknown; standard deviations
    weight : of the squares
    """
    sums = np.asarray(sums, dtype=np.float64)
    measured = np.asarray(measured, dtype=np.float64)
    known = np.isfinite(measured)
    S = sums[known] / np.broadcast_to(sd, measured.shape)[known, None]
    m = measured[known] / np.broadcast_to(sd, measured.shape)[known]
    return 2.0 * weight * S.T @ S, -2.0 * weight * S.T @ m


def direction_limit(direction: ArrayLike, forces: ArrayLike) -> Constraint:
    """Limit a push or a pull to one side: -direction . f <= 0 with f = forces x (3, n)."""
    return -(np.asarray(direction, dtype=np.float64) @ np.asarray(forces))[None], np.zeros(1)


def most(direction: ArrayLike, greatest: float, forces: ArrayLike) -> Constraint:
    """Greatest force: direction . f <= greatest with f = forces x (3, n)."""
    return (np.asarray(direction, dtype=np.float64) @ np.asarray(forces))[None], np.array(
        [float(greatest)]
    )


def friction_cone(cone: Cone, forces: ArrayLike) -> Constraint:
    """Faces of the linearised cone of a force f = forces x (3, n), in the axes of the cone's frame.

    m_k . t . f <= friction cos(pi / edges) d . f for the outward normals m_k between two
    generators. The package keeps a cone by its generators (`terms.cones.cone_generators`); both are
    one cone.
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


def program(
    costs: Sequence[Cost],
    equalities: Sequence[Constraint] = (),
    inequalities: Sequence[Constraint] = (),
    lower: ArrayLike = -np.inf,
    upper: ArrayLike = np.inf,
) -> Program:
    """Add terms up."""
    n = len(costs[0][1])
    dense = any(H.ndim == 2 for H, _ in costs)
    H = sum(
        (np.diag(one) if dense and one.ndim == 1 else one for one, _ in costs),
        np.zeros((n, n) if dense else n),
    )
    stacked = [
        np.vstack([A for A, _ in group] or [np.zeros((0, n))])
        for group in (equalities, inequalities)
    ]
    right = [
        np.concatenate([b for _, b in group] or [np.zeros(0)])
        for group in (equalities, inequalities)
    ]
    low = np.broadcast_to(np.asarray(lower, dtype=np.float64), (n,)).copy()
    high = np.broadcast_to(np.asarray(upper, dtype=np.float64), (n,)).copy()
    c = np.sum([one for _, one in costs], axis=0)
    return Program(
        H=H, c=c, A=stacked[0], b=right[0], G=stacked[1], h=right[1], lower=low, upper=high
    )


def solve_program(problem: Program) -> Array:
    """Solve a quadratic program by piqp.

    It is an interior-point method (Schwan, Jiang, Kuhn and Jones 2023).

    Parameters
    ----------
    problem : with n variables

    Returns
    -------
    (n,) the x of minimum cost within the constraints
    """
    solver = piqp.DenseSolver()
    solver.settings.eps_abs = solver.settings.eps_rel = 1e-10
    solver.settings.eps_duality_gap_abs = solver.settings.eps_duality_gap_rel = 1e-10
    H = np.diag(problem.H) if problem.H.ndim == 1 else problem.H
    A = np.asfortranarray(problem.A) if len(problem.A) else None
    G = np.asfortranarray(problem.G) if len(problem.G) else None
    b = problem.b if len(problem.b) else None
    h = problem.h if len(problem.h) else None
    solver.setup(np.asfortranarray(H), problem.c, A, b, G, None, h, problem.lower, problem.upper)
    assert solver.solve() == piqp.PIQP_SOLVED
    return np.array(solver.result.x)


def frame_program(problem: TensionProblem, frame: int) -> Program:
    """Return the quadratic program of one frame.

    Returns
    -------
    Program whose variables are the activations, the controls of reserves and residuals, the
    amplitudes of contacts' cone generators [weights of the body], and the excess of each activation
    that an EMG equality names; its rows are the equations of motion [N m or N]
    """
    assert problem.options.exponent == 2.0, "no quadratic program"
    fast = problem.separable
    matrix, right, sums, measured = _matrices(problem, frame)
    names = _variable_names(problem, frame)
    controls = len(problem.assembly.tree.model.muscle_names) + len(problem.actuators.actuators)
    widen = _Widened(len(names))
    costs: list[Cost] = [effort(widen.values(fast.weight[:controls]))]
    limits: list[Constraint] = []
    if problem.contacts is not None:
        costs += _contact_costs(problem, controls, widen)
        more_costs, limits = _shared_rows(problem, widen.rows(sums), measured)
        costs += more_costs
    emg_costs, emg_limits = _emg_terms(problem, frame, len(names))
    base = len(names) - len(_excess_names(problem, frame))
    whole = program(
        costs + emg_costs,
        [balance(widen.rows(matrix), right)],
        limits + emg_limits,
        widen.values(fast.lower[:base], -np.inf),
        widen.values(fast.upper[:base], np.inf),
    )
    return replace(whole, variables=tuple(names), rows=problem.assembly.coordinates)


@dataclass(frozen=True)
class _Widened:
    """Vectors and rows of the first variables, made as wide as all of them."""

    count: int

    def values(self, values: Array, fill: float = 0.0) -> Array:
        return np.concatenate([values, np.full(self.count - len(values), fill)])

    def rows(self, rows: Array) -> Array:
        return np.hstack([rows, np.zeros((len(rows), self.count - rows.shape[1]))])


def _variable_names(problem: TensionProblem, frame: int) -> list[str]:
    names = list(problem.assembly.tree.model.muscle_names)
    names += [one.name for one in problem.actuators.actuators]
    if problem.contacts is not None:
        names += problem.contacts.generators.names
    return names + _excess_names(problem, frame)


def _excess_names(problem: TensionProblem, frame: int) -> list[str]:
    """Name the excess over each measured activation, where EMG drives muscles."""
    known = _emg_target(problem)
    if known is None or known.mode != "driven":
        return []
    muscles = problem.assembly.tree.model.muscle_names
    emg = _emg(problem, known, frame)
    return [f"{muscles[m]} excess" for m in np.flatnonzero(np.isfinite(emg))]


def _emg_target(problem: TensionProblem) -> EmgTarget | None:
    return next((one for one in problem.terms if isinstance(one, EmgTarget)), None)


def _contact_costs(problem: TensionProblem, controls: int, widen: _Widened) -> list[Cost]:
    """Return the cost of the amplitudes, which stand behind the controls."""
    contacts = problem.contacts
    assert contacts is not None
    # A contact costs the same whatever number of sites it is made of.
    groups = [contacts.task.sites[k].group for k in contacts.generators.site]
    many = [len({one.name for one in contacts.task.sites if one.group == name}) for name in groups]
    cost = np.concatenate([np.zeros(controls), many * contacts.generators.cost])
    return [contact_regularisation(contacts.task.options.compliance, widen.values(cost))]


def _shared_rows(
    problem: TensionProblem, sums: Array, measured: Array
) -> tuple[list[Cost], list[Constraint]]:
    """Return costs of rows that contacts add and were measured, and bounds of the others."""
    told = np.array([one.measured for one in problem.added_rows for _ in one.names], dtype=bool)
    unit = np.concatenate([np.zeros(0), *(one.unit for one in problem.added_rows)])
    costs: list[Cost] = []
    if told.any():
        costs.append(shared_wrench(sums[told], measured[told], unit[told], MEASURED_COST))
    return costs, [(sums[~told], unit[~told]), (-sums[~told], unit[~told])]


def _emg_terms(problem: TensionProblem, frame: int, n: int) -> tuple[list[Cost], list[Constraint]]:
    """Return costs and limits of EMG among n variables, the excess last."""
    known = _emg_target(problem)
    if known is None:
        return [], []
    emg = _emg(problem, known, frame)
    if known.mode != "driven":
        return [emg_target(emg, known.weight, n)], []
    base = n - int(np.isfinite(emg).sum())
    excess = effort(np.where(np.arange(n) >= base, STIFFNESS, 0.0))
    return [excess], [emg_equality(emg, known.slack, base, n)]


def _matrices(problem: TensionProblem, frame: int) -> tuple[Array, Array, Array, Array]:
    """Return A and b of the equations of motion, and S and the sum of the shared rows.

    S is of the rows that contacts add.
    """
    given = problem.balance(frame, frame + 1)
    pattern = problem.assembly.pattern
    extra = problem.assembly.extra_row
    variables = len(problem.separable.weight)
    matrix = np.zeros((len(pattern.order), variables))
    matrix[pattern.row, np.repeat(np.arange(variables), np.diff(pattern.start))] = given.values[0]
    shared = variables - len(extra)
    mine = problem.assembly.coordinate_row
    return (
        matrix[mine, :shared],
        given.right[0, mine],
        matrix[extra, :shared],
        given.right[0, extra],
    )


def _emg(problem: TensionProblem, emg: EmgTarget | None, frame: int) -> Array:
    """(muscles,) what EMG tells of a frame, NaN where it tells nothing."""
    names = problem.assembly.tree.model.muscle_names
    told = np.full(len(names), np.nan)
    if emg is not None:
        told[[names.index(one) for one in emg.muscles]] = emg.activations[frame]
    return told
