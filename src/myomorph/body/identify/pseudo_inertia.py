"""Inertial parameters that some positive distribution of mass can have.

A linear matrix inequality holds each link:

    minimise  1/2 |b - A phi|^2 + 1/2 d(phi, phi_ref)^2 / sd^2
    subject to  P(phi_i) >= margin P(phi_ref_i),  sum_i m_i = mass (where given)

with the pseudo-inertia P of `model.inertia.pseudo_inertias`, positive definite just where a body of
positive mass exists (Wensing, Kim, Slotine 2018). With P_ref = L L^T every link's change is written
as E = L^-1 (P - P_ref) L^-T, so that the inequality is I + E >= margin I and the distance |E|^2 =
tr((P_ref^-1 (P - P_ref))^2), which does not depend on the frame or the units (the constant
pull-back of Lee, Wensing, Park 2020, IEEE Transactions on Robotics 36(2):348; the second-order term
of their entropic divergence too).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import clarabel
import numpy as np
import scipy

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.inertia import parameters_of, pseudo_inertias

TRIANGLE = tuple((i, j) for j in range(4) for i in range(j + 1))
"""Entries of a symmetric 4 x 4 matrix in the order of the solver: columns of the upper triangle."""
SMALLEST_SHARE = 1e-6  # A link of less than this share of the whole mass stays at its reference


@dataclass(frozen=True)
class PseudoInertiaOptions:
    """Settings of `solve_pseudo_inertia` and `solve_ridge`.

    Attributes
    ----------
    mass_sd : relative standard deviation of a link's mass that the prior amounts to; a mass center
        then has mass_sd k / sqrt(2) along an axis of radius of gyration k, a second moment of mass
        mass_sd of itself
    margin : least eigenvalue of P(phi_i), relative to its reference
    tolerance : of the solver's residuals and gap
    """

    mass_sd: float = 0.15
    margin: float = 1e-3
    tolerance: float = 1e-8

    def __post_init__(self) -> None:
        for name in ("mass_sd", "tolerance"):
            if not getattr(self, name) > 0.0:
                raise BadData(
                    f"{name} of the pseudo-inertia problem is {getattr(self, name):g}: expected"
                    " above 0"
                )
        if not 0.0 <= self.margin < 1.0:
            raise BadData(
                f"the margin of the pseudo-inertia is {self.margin:g}: expected from 0 to below 1"
            )


@read_only
class PseudoInertiaFit:
    """Parameters of the links, and how far to trust the solution.

    Attributes
    ----------
    parameters : (links, 10) in the order of [D] eq. 3.4
    misfit : |b - A phi|^2 of the solution
    smallest : (links,) least eigenvalue of each link's pseudo-inertia relative to the reference's;
        NaN where kept
    kept : (links,) links that stayed at their reference because they have hardly any mass
    status : as the solver reports it
    converged : whether the solver proved the optimum
    residual : greatest of the solver's primal and dual residuals
    iterations : of the solver; 0 where the problem has a closed form
    options : as given
    """

    parameters: Array
    misfit: float
    smallest: Array
    kept: np.ndarray
    status: str
    converged: bool
    residual: float
    iterations: int
    options: PseudoInertiaOptions = field(repr=False)


def solve_pseudo_inertia(
    A: Array,
    b: Array,
    reference: Array,
    *,
    mass: float | None = None,
    options: PseudoInertiaOptions | None = None,
) -> PseudoInertiaFit:
    """Find physically possible parameters that meet measured ones near a reference.

    The problem at the head of this file. Where its least squares keep every inequality they are the
    optimum, else a conic solver finds it.

    Parameters
    ----------
    A : (rows, 10 links) what was measured of the parameters, in units of its noise (`BaseFit.rows`)
    b : (rows,)
    reference : (links, 10) parameters before anything is measured; those of massless links are kept
    mass : total [kg]; None leaves it free
    options : strength of the prior, margin and tolerance

    Returns
    -------
    parameters of the links, with the solver's report

    Raises
    ------
    BadData : a shape is wrong, a value is not finite, the mass is not above 0, or the reference of
        a link is of no body
    """
    problem = _Changes.of(A, b, reference, mass, options or PseudoInertiaOptions())
    free = _least_squares(problem, mass)
    # Changes that keep every inequality are the optimum with them too.
    if (
        1.0 + np.linalg.eigvalsh(symmetric(free.reshape(-1, 10)))[:, 0] >= problem.options.margin
    ).all():
        return problem.fit(free)
    for residuals in (False, True):
        solution = _solve(problem, mass, residuals)
        if str(solution.status) == "Solved":
            break
    return problem.fit(np.array(solution.x)[: problem.A.shape[1]], solution)


def solve_ridge(
    A: Array,
    b: Array,
    reference: Array,
    *,
    mass: float | None = None,
    options: PseudoInertiaOptions | None = None,
) -> PseudoInertiaFit:
    """Solve the same problem without the inequalities.

    These are least squares that may give parameters no body can have.

    Parameters
    ----------
    A : (rows, 10 links), in units of noise
    b : (rows,)
    reference : (links, 10) parameters before anything is measured
    mass : total [kg]; None leaves it free
    options : strength of the prior

    Returns
    -------
    parameters of the links

    Raises
    ------
    BadData : as in `solve_pseudo_inertia`
    """
    problem = _Changes.of(A, b, reference, mass, options or PseudoInertiaOptions())
    return problem.fit(_least_squares(problem, mass))


def possible_reference(reference: Array, gyration: float = 0.01) -> Array:
    """Make bodies of links with mass: repair second moments of mass that are too small.

    A principal second moment of mass about the mass center that is below m gyration^2 is lifted to
    it, everything else stays. A few mass points in a plane, and inertias that somebody rounded, are
    references of no body.

    Parameters
    ----------
    reference : (links, 10)
    gyration : least radius of gyration along a principal axis [m]

    Returns
    -------
    (links, 10)
    """
    repaired = np.array(reference, dtype=np.float64)
    for row, P in zip(repaired, pseudo_inertias(repaired), strict=True):
        if row[0] > 0.0:
            c = row[1:4] / row[0]
            values, axes = np.linalg.eigh(P[:3, :3] - row[0] * np.outer(c, c))
            lift = np.maximum(row[0] * gyration**2 - values, 0.0)
            if lift.any():
                P[:3, :3] += (axes * lift) @ axes.T
                row[:] = parameters_of(P)
    return repaired


@dataclass(eq=False)
class _Changes:
    """The problem in the changes E of the moved links, ten scaled entries each.

    They are counted from the reference.

    Attributes
    ----------
    A, b : (rows, 10 moved), (rows,) what was measured less what the reference says
    given_A, given_b : (rows, 10 links), (rows,) as given
    reference : (links, 10)
    moved : (moved,) links that may change
    basis : (moved, 10, 10) parameters of a unit of each entry
    prior : (10 moved, 10 moved) its precision
    total : (10 moved,) mass of a unit of each entry [kg]
    lacking : mass that the changes must add [kg]
    options : as given
    """

    A: Array
    b: Array
    given_A: Array
    given_b: Array
    reference: Array
    moved: np.ndarray
    basis: Array
    prior: Array
    total: Array
    lacking: float
    options: PseudoInertiaOptions

    @staticmethod
    def of(
        A: Array, b: Array, reference: Array, mass: float | None, options: PseudoInertiaOptions
    ) -> _Changes:
        """Check the inputs and set up the problem, see `solve_pseudo_inertia`."""
        A = np.asarray(A, float)
        b = np.asarray(b, float)
        reference = np.array(reference, float)
        if reference.ndim != 2 or reference.shape[1] != 10 or A.shape != (len(b), reference.size):
            raise BadData(
                "expected A (rows, 10 links), b (rows,) and a reference (links, 10), "
                f"but got {A.shape}, {b.shape} and {reference.shape}"
            )
        if not (np.isfinite(A).all() and np.isfinite(b).all() and np.isfinite(reference).all()):
            raise BadData("A, b or the reference holds a number that is not finite")
        if mass is not None and not mass > 0.0:
            raise BadData(f"the body's mass is {mass:g} kg: expected above 0")
        P = pseudo_inertias(reference)
        moved = np.flatnonzero(reference[:, 0] > SMALLEST_SHARE * reference[:, 0].sum())
        scale = np.sqrt(np.diagonal(P[moved], axis1=1, axis2=2).clip(min=1e-300))
        least = np.linalg.eigvalsh(P[moved] / scale[:, :, None] / scale[:, None])[:, 0]
        if len(least) and least.min() < 1e-9:
            worst = moved[int(least.argmin())]
            raise BadData(
                f"the reference of link {worst} is of no body: its pseudo-inertia is not positive"
                " definite; give it an inertia that a body of its mass can have, or pass it"
                " through `possible_reference`"
            )
        basis = tangents(reference[moved])
        by_link = A.reshape(len(A), len(reference), 10)[:, moved]
        reduced = np.einsum("rli,lij->rlj", by_link, basis, optimize=True).reshape(
            len(A), 10 * len(moved)
        )
        total = basis[:, 0].ravel()
        return _Changes(
            reduced,
            b - A @ reference.ravel(),
            A,
            b,
            reference,
            moved,
            basis,
            np.eye(10 * len(moved)) / options.mass_sd**2,
            total,
            0.0 if mass is None else mass - reference[:, 0].sum(),
            options,
        )

    def fit(
        self, x: Array, default_solution: clarabel.DefaultSolution | None = None
    ) -> PseudoInertiaFit:
        """Build the fit of changes, and report how the solver found them where it was needed.

        Parameters
        ----------
        x : (10 moved,)
        default_solution : of the solver; None for the closed form
        """
        changes = x.reshape(-1, 10)
        parameters = self.reference.copy()
        parameters[self.moved] += np.einsum("lij,lj->li", self.basis, changes)
        smallest = np.full(len(parameters), np.nan)
        smallest[self.moved] = 1.0 + np.linalg.eigvalsh(symmetric(changes))[:, 0]
        kept = np.ones(len(parameters), bool)
        kept[self.moved] = False
        missed = self.given_b - self.given_A @ parameters.ravel()
        return PseudoInertiaFit(
            parameters=parameters,
            misfit=float(missed @ missed),
            smallest=smallest,
            kept=kept,
            status="closed form" if default_solution is None else str(default_solution.status),
            converged=default_solution is None or str(default_solution.status) == "Solved",
            residual=(
                0.0
                if default_solution is None
                else float(max(default_solution.r_prim, default_solution.r_dual))
            ),
            iterations=0 if default_solution is None else int(default_solution.iterations),
            options=self.options,
        )


def _solve(problem: _Changes, mass: float | None, residuals: bool) -> clarabel.DefaultSolution:
    """Solve the conic program by Clarabel.

    right - rows x lies in the cones, those of the total mass and the pseudo-inertias.

    Parameters
    ----------
    problem : in the changes of the moved links
    mass : total [kg]; None leaves it free
    residuals : whether the rows' misses are variables of their own, which squares no condition
        number but takes ten times longer: for measurements that no body near the reference can meet
    """
    n = problem.A.shape[1]
    links = len(problem.moved)
    rows = -scipy.sparse.eye_array(n)
    cones = [clarabel.PSDTriangleConeT(4)] * links
    right = np.tile([1.0 - problem.options.margin if i == j else 0.0 for i, j in TRIANGLE], links)
    if mass is not None:
        rows = scipy.sparse.vstack([scipy.sparse.csr_array(problem.total[None]), rows])
        cones = [clarabel.ZeroConeT(1), *cones]
        right = np.append(problem.lacking, right)
    if residuals:
        A = problem.A
        b = problem.b
        if len(A) > n:
            Q, A = np.linalg.qr(A)
            b = Q.T @ b
        misses = scipy.sparse.hstack([scipy.sparse.csr_array(A), -scipy.sparse.eye_array(len(A))])
        rows = scipy.sparse.vstack(
            [misses, scipy.sparse.hstack([rows, scipy.sparse.csr_array((len(right), len(A)))])]
        )
        right = np.concatenate([b, right])
        cones = [clarabel.ZeroConeT(len(A)), *cones]
        H = scipy.sparse.block_diag([problem.prior, scipy.sparse.eye_array(len(A))])
        linear = np.zeros(n + len(A))
    else:
        full = problem.A.T @ problem.A + problem.prior
        scale = 1.0 / np.diagonal(full).mean()
        H = scipy.sparse.csc_array(scale * full)
        linear = -scale * (problem.A.T @ problem.b)
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_feas = settings.tol_gap_abs = settings.tol_gap_rel = problem.options.tolerance
    return clarabel.DefaultSolver(
        scipy.sparse.csc_matrix(scipy.sparse.triu(H)),
        linear,
        scipy.sparse.csc_matrix(rows),
        right,
        cones,
        settings,
    ).solve()


def _least_squares(problem: _Changes, mass: float | None) -> Array:
    """Solve without the inequalities, by QR of the stacked rows.

    Returns
    -------
    (10 moved,) changes
    """
    root = scipy.linalg.cholesky(problem.prior)
    n = len(root)
    rows = np.block([[problem.A, problem.b[:, None]], [root, np.zeros((n, 1))]])
    factor = scipy.linalg.qr(rows, mode="r")[0]
    R = factor[:n, :n]
    right = factor[:n, n]
    x: Array = scipy.linalg.solve_triangular(R, right)
    if mass is not None:
        # The least change of the total in the metric of the problem: (R^T R)^-1 total.
        toward = scipy.linalg.solve_triangular(
            R, scipy.linalg.solve_triangular(R, problem.total, trans="T")
        )
        x = x + toward * ((problem.lacking - problem.total @ x) / (problem.total @ toward))
    return x


def symmetric(entries: Array) -> Array:
    """Build symmetric matrices from scaled triangles of the same norm.

    Parameters
    ----------
    entries : (..., 10) upper triangles by columns, off the diagonal times sqrt(2)

    Returns
    -------
    (..., 4, 4)
    """
    matrices = np.zeros((*entries.shape[:-1], 4, 4))
    for q, (i, j) in enumerate(TRIANGLE):
        matrices[..., i, j] = matrices[..., j, i] = entries[..., q] * (
            1.0 if i == j else np.sqrt(0.5)
        )
    return matrices


def tangents(parameters: Array) -> Array:
    """Differentiate parameters in the scaled triangles of E, P = L (I + E) L^T.

    Parameters
    ----------
    parameters : (links, 10) of bodies with positive definite pseudo-inertia

    Returns
    -------
    (links, 10, 10) parameters by entries
    """
    L = np.linalg.cholesky(pseudo_inertias(parameters))
    return np.moveaxis(
        parameters_of(L[:, None] @ symmetric(np.eye(10)) @ np.swapaxes(L, 1, 2)[:, None]), 1, 2
    )
