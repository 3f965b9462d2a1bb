"""Linear least squares whose unknowns stay in convex cones, as masses that a body can have."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import clarabel
import numpy as np
import scipy

from myomorph.core.fit.residuals import NormalEquations, Rows
from myomorph.core.model.arrays import Array, read_only

SOLVED = "Solved"


@dataclass(frozen=True)
class Cone:
    """What a part of right - rows x has to be.

    Attributes
    ----------
    kind : "zero" for equations, "nonnegative", or "semidefinite" for a symmetric matrix
    size : number of rows, of a semidefinite matrix its order n: n (n + 1) / 2 rows, columns of the
        upper triangle with entries off the diagonal times the root of 2
    """

    kind: Literal["zero", "nonnegative", "semidefinite"]
    size: int

    @property
    def rows(self) -> int:
        """Number of rows that it takes."""
        return self.size * (self.size + 1) // 2 if self.kind == "semidefinite" else self.size


@read_only
class Cones:
    """right - rows x lies in the cones, one after the other.

    Attributes
    ----------
    rows : (rows, unknowns), dense or sparse
    right : (rows,)
    cones : which together take all rows
    """

    rows: Array | scipy.sparse.sparray
    right: Array
    cones: tuple[Cone, ...]

    @cached_property
    def _parts(self) -> tuple[slice, ...]:
        """Rows of each cone."""
        ends = np.cumsum([0, *(cone.rows for cone in self.cones)]).tolist()
        return tuple(map(slice, ends[:-1], ends[1:]))

    @property
    def equations(self) -> tuple[Array, Array]:
        """(equations, unknowns) and (equations,) rows x = right of cones of the kind "zero"."""
        pairs = zip(self.cones, self._parts, strict=True)
        every = np.arange(len(self.right))
        chosen = [every[part] for cone, part in pairs if cone.kind == "zero"]
        index = np.concatenate([np.zeros(0, np.int64), *chosen])
        rows = self.rows if isinstance(self.rows, np.ndarray) else self.rows.toarray()
        return rows[index], self.right[index]

    def hold(self, x: Array) -> bool:
        """Tell whether a point lies in the cones.

        Parameters
        ----------
        x : (unknowns,)

        Returns
        -------
        whether it does; equations are not looked at
        """
        rest = self.right - self.rows @ x
        matrices: defaultdict[int, list[Array]] = defaultdict(list)
        for cone, part in zip(self.cones, self._parts, strict=True):
            if cone.kind == "nonnegative" and (rest[part] < 0.0).any():
                return False
            if cone.kind == "semidefinite":
                matrices[cone.size].append(rest[part])
        return all(
            _least_eigenvalue(np.array(entries), size) >= 0.0 for size, entries in matrices.items()
        )

    def moved(self, start: Array) -> Cones:
        """Write the cones for steps from a point.

        Parameters
        ----------
        start : (unknowns,)

        Returns
        -------
        what a step has to meet so that the point after it meets these
        """
        return Cones(rows=self.rows, right=self.right - self.rows @ start, cones=self.cones)


@read_only
class ConicSolution:
    """The minimum within cones.

    Attributes
    ----------
    x : (unknowns,)
    status : the solver's word
    residual : greatest of the primal and dual residuals
    iterations : of the solver
    """

    x: Array
    status: str
    residual: float
    iterations: int

    @property
    def converged(self) -> bool:
        """Whether the solver proved the optimum."""
        return self.status == SOLVED


def minimize_in_cones(
    equations: NormalEquations, cones: Cones, tolerance: float = 1e-8
) -> ConicSolution:
    """Minimum of x . H x + 2 g . x with right - rows x in cones, by an interior-point method.

    Source: Goulart and Chen 2024, Clarabel: an interior-point solver for conic programs with
    quadratic objectives, arXiv 2405.12762.

    Parameters
    ----------
    equations : of the linear residuals about x = 0
    cones : what x has to meet
    tolerance : of the solver's residuals and gap

    Returns
    -------
    the minimum, and whether the solver proved it

    Examples
    --------
    >>> import numpy as np
    >>> import myomorph as mm
    >>> from myomorph.core.fit.cones import Cone, Cones, minimize_in_cones
    >>> from myomorph.core.fit.cones import Cones
    >>> from myomorph.core.fit.cones import Cone
    >>> nearest = mm.fit.NormalEquations(H=np.eye(2), g=np.array([-3.0, 1.0]))
    >>> positive = Cones(
    ...     rows=-np.eye(2), right=np.zeros(2), cones=(Cone("nonnegative", 2),)
    ... )
    >>> minimize_in_cones(nearest, positive).x.round(4).tolist()
    [3.0, 0.0]
    """
    # Brought to a size of 1, so that the tolerance means the same for every problem.
    scale = 1.0 / max(float(np.diagonal(equations.H).mean()), 1e-300)
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_feas = settings.tol_gap_abs = settings.tol_gap_rel = tolerance
    found = clarabel.DefaultSolver(
        scipy.sparse.csc_matrix(scipy.sparse.triu(scale * equations.H)),
        scale * equations.g,
        scipy.sparse.csc_matrix(cones.rows),
        np.asarray(cones.right, np.float64),
        [_clarabel_cone(cone) for cone in cones.cones],
        settings,
    ).solve()
    return ConicSolution(
        x=np.array(found.x),
        status=str(found.status),
        residual=float(max(found.r_prim, found.r_dual)),
        iterations=int(found.iterations),
    )


def minimize_misses_in_cones(rows: Rows, cones: Cones, tolerance: float = 1e-8) -> ConicSolution:
    """Minimum of |J x + r|^2 with right - rows x in cones, the misses as unknowns of their own.

        minimize |m|^2,    m = J x + r

    No condition number is squared, but it takes ten times longer than `minimize_in_cones`: for
    measurements that nothing in the cones can meet.

    Parameters
    ----------
    rows : residuals r and slopes J at x = 0, as many as unknowns at most
    cones : what x has to meet
    tolerance : of the solver's residuals and gap
    """
    misses, unknowns = rows.slopes.shape
    total = unknowns + misses
    H = np.zeros((total, total))
    H[unknowns:, unknowns:] = np.eye(misses)
    equations = scipy.sparse.hstack([rows.slopes, -scipy.sparse.eye_array(misses)])
    nothing = scipy.sparse.csr_array((len(cones.right), misses))
    whole = Cones(
        rows=scipy.sparse.vstack([equations, scipy.sparse.hstack([cones.rows, nothing])]),
        right=np.concatenate([-rows.residuals, cones.right]),
        cones=(Cone("zero", misses), *cones.cones),
    )
    found = minimize_in_cones(NormalEquations(H=H, g=np.zeros(total)), whole, tolerance)
    return replace(found, x=found.x[:unknowns])


def _least_eigenvalue(entries: Array, size: int) -> float:
    """Find the smallest eigenvalue of symmetric matrices.

    Parameters
    ----------
    entries : (matrices, rows of the cone) columns of the upper triangle, see `Cone`
    size : order of the matrices
    """
    columns, rows = np.tril_indices(size)
    matrices = np.zeros((len(entries), size, size))
    # Eigenvalues are found from the lower triangle alone.
    matrices[:, columns, rows] = entries * np.where(rows == columns, 1.0, np.sqrt(0.5))
    return float(np.linalg.eigvalsh(matrices)[:, 0].min())


def _clarabel_cone(cone: Cone) -> object:
    kinds = {
        "zero": clarabel.ZeroConeT,
        "nonnegative": clarabel.NonnegativeConeT,
        "semidefinite": clarabel.PSDTriangleConeT,
    }
    return kinds[cone.kind](cone.size)
