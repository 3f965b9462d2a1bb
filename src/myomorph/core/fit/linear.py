"""Linear least squares by QR, also within cones: the search of estimates whose rows are linear."""

from __future__ import annotations

import numpy as np
import scipy

from myomorph.core.fit.cones import (
    Cones,
    ConicSolution,
    minimize_in_cones,
    minimize_misses_in_cones,
)
from myomorph.core.fit.problem import Problem
from myomorph.core.fit.residuals import Evaluation, Rows
from myomorph.core.fit.solver import CONVERGED, NO_LOWER, Search, Solution
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData


@read_only
class LinearMinimum:
    """Where linear residuals are least.

    Attributes
    ----------
    solution : the point, its equations, how the search ended
    conic : what the conic solver reported; None where the minimum has a closed form, because it
        lies in the cones without them
    """

    solution: Solution
    conic: ConicSolution | None


def minimize_linear(
    problem: Problem, cones: Cones | None = None, tolerance: float = 1e-8
) -> LinearMinimum:
    """Find the values of the unknowns that explain linear measurements and priors best.

        minimize |J x - b|^2,    right - rows x in cones

    By a QR decomposition of all rows, so that no condition number is squared. Where this minimum,
    with the cones' equations, lies in the cones, it is the answer. Else a conic solver finds it.

    Parameters
    ----------
    problem : unknowns, of which none is fixed, and residuals with rows that do not change
    cones : what the unknowns have to meet
    tolerance : of the conic solver

    Returns
    -------
    the minimum

    Raises
    ------
    BadData : residuals of the problem have no rows

    Examples
    --------
    >>> import numpy as np
    >>> import myomorph as mm
    >>> from myomorph.core.fit.cones import Cone, Cones
    >>> from myomorph.core.fit.linear import minimize_linear
    >>> from myomorph.core.fit.residuals import Condensed
    >>> masses = mm.fit.Block(
    ...     name="masses", unknowns=(mm.fit.Unknown(name="arm"), mm.fit.Unknown(name="hand"))
    ... )
    >>> scale = Condensed(
    ...     name="scale",
    ...     blocks=("masses",),
    ...     rows=np.array([[1.0, 1.0], [1.0, -1.0]]),
    ...     right=np.array([3.0, 5.0]),
    ... )
    >>> problem = mm.fit.Problem(mm.fit.Unknowns((masses,)), (scale,))
    >>> minimize_linear(problem).solution.x.round(6).tolist()
    [4.0, -1.0]
    >>> positive = Cones(rows=-np.eye(2), right=np.zeros(2), cones=(Cone("nonnegative", 2),))
    >>> minimize_linear(problem, positive).solution.x.round(4).tolist()
    [4.0, 0.0]
    """
    at = problem.at()
    conic: ConicSolution | None = None
    condensed = _condensed(at.parts)
    if cones is None:
        step = _minimum(condensed)
    else:
        steps = cones.moved(at.x)
        step = _meeting(condensed, *steps.equations)
        if not steps.hold(step):
            equations = at.equations.all
            conic = minimize_in_cones(equations, steps, tolerance)
            if not conic.converged:
                conic = minimize_misses_in_cones(condensed, steps, tolerance)
            step = conic.x
    end = problem.at(at.x + step)
    proven = conic is None or conic.converged
    search = Search(status=CONVERGED if proven else NO_LOWER, costs=(at.cost, end.cost), change=0.0)
    free = np.ones(len(at.x), np.bool_)
    return LinearMinimum(solution=Solution(x=end.x, free=free, at=end, search=search), conic=conic)


def _condensed(parts: tuple[Evaluation, ...]) -> Rows:
    """Condense all rows to a triangular factor (unknowns, unknowns), the misfit but for a constant.

    Parameters
    ----------
    parts : residuals at the start

    Raises
    ------
    BadData : one of them has no rows
    """
    rows = [part for part in parts if isinstance(part, Rows)]
    if len(rows) < len(parts):
        raise BadData("residuals without rows are not linear: use `minimize`")
    slopes = np.vstack([part.slopes for part in rows])
    right = np.concatenate([-part.residuals for part in rows])
    count = slopes.shape[1]
    R = scipy.linalg.qr(np.column_stack([slopes, right]), mode="r")[0]
    return Rows(residuals=-R[:count, count], slopes=R[:count, :count])


def _minimum(rows: Rows) -> Array:
    """Find the minimum (unknowns,) of triangular rows."""
    x: Array = scipy.linalg.solve_triangular(rows.slopes, -rows.residuals)
    return x


def _meeting(rows: Rows, equations: Array, right: Array) -> Array:
    """Find the minimum of |R x - z|^2 that meets equations E x = e.

        x = x_0 + T (E T)^-1 (e - E x_0),    T = (R^T R)^-1 E^T

    Parameters
    ----------
    rows : triangular R, and z
    equations, right : (equations, unknowns) E and (equations,) e

    Returns
    -------
    (unknowns,)
    """
    x = _minimum(rows)
    if not len(right):
        return x
    R = rows.slopes
    half = scipy.linalg.solve_triangular(R, equations.T, trans="T")
    toward = scipy.linalg.solve_triangular(R, half)
    return np.asarray(x + toward @ np.linalg.solve(equations @ toward, right - equations @ x))
