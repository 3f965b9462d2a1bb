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
from functools import lru_cache

import numpy as np

from myomorph.core.fit.cones import Cone, Cones
from myomorph.core.fit.linear import LinearMinimum, minimize_linear
from myomorph.core.fit.problem import Problem
from myomorph.core.fit.residuals import Condensed
from myomorph.core.fit.unknowns import Block, Unknown, Unknowns
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.inertia import parameters_of, pseudo_inertias

TRIANGLE = tuple((i, j) for j in range(4) for i in range(j + 1))
"""Entries of a symmetric 4 x 4 matrix in the order of the solver: columns of the upper triangle."""
CHANGES = "changes of pseudo-inertias"
CLOSED_FORM = "closed form"
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
    options = options or PseudoInertiaOptions()
    changes = _Changes.of(A, b, reference, mass, options)
    return changes.fit(minimize_linear(changes.problem, changes.cones, options.tolerance))


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
    changes = _Changes.of(A, b, reference, mass, options or PseudoInertiaOptions())
    return changes.fit(minimize_linear(changes.problem, changes.total))


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


@read_only
@dataclass(frozen=True, eq=False, kw_only=True)
class _Changes:
    """The problem in the changes E of the moved links, ten scaled entries each.

    They are counted from the reference.

    Attributes
    ----------
    A, b : (rows, 10 links), (rows,) as given
    reference : (links, 10)
    moved : (moved,) links that may change
    basis : (moved, 10, 10) parameters of a unit of each entry
    mass : total [kg]; None leaves it free
    options : as given
    """

    A: Array
    b: Array
    reference: Array
    moved: np.ndarray
    basis: Array
    mass: float | None
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
        moved = np.flatnonzero(reference[:, 0] > SMALLEST_SHARE * reference[:, 0].sum())
        _refuse_no_body(reference, moved)
        return _Changes(
            A=A,
            b=b,
            reference=reference,
            moved=moved,
            basis=tangents(reference[moved]),
            mass=mass,
            options=options,
        )

    @property
    def problem(self) -> Problem:
        """What was measured, and the prior of the changes, as a problem of core/fit."""
        count = 10 * len(self.moved)
        by_link = self.A.reshape(len(self.A), len(self.reference), 10)[:, self.moved]
        rows = np.einsum("rli,lij->rlj", by_link, self.basis, optimize=True)
        measured = Condensed(
            name="measured parameters",
            blocks=(CHANGES,),
            rows=rows.reshape(len(self.A), count),
            right=self.b - self.A @ self.reference.ravel(),
        )
        return Problem(_unknowns(tuple(self.moved.tolist()), self.options.mass_sd), (measured,))

    @property
    def total(self) -> Cones | None:
        """The equation of the whole mass; None where it is free."""
        if self.mass is None:
            return None
        return Cones(
            rows=self.basis[:, 0].reshape(1, -1),
            right=np.array([self.mass - self.reference[:, 0].sum()]),
            cones=(Cone("zero", 1),),
        )

    @property
    def cones(self) -> Cones:
        """The whole mass, and I + E - margin I positive semidefinite for every moved link."""
        links = len(self.moved)
        unit = [1.0 - self.options.margin if i == j else 0.0 for i, j in TRIANGLE]
        rows = -np.eye(10 * links)
        right = np.tile(unit, links)
        cones = (Cone("semidefinite", 4),) * links
        total = self.total
        if total is None:
            return Cones(rows=rows, right=right, cones=cones)
        return Cones(
            rows=np.vstack([total.rows, rows]),
            right=np.concatenate([total.right, right]),
            cones=(*total.cones, *cones),
        )

    def fit(self, found: LinearMinimum) -> PseudoInertiaFit:
        """Build the fit of changes that were found.

        Parameters
        ----------
        found : minimum of the problem
        """
        changes = found.solution.x.reshape(-1, 10)
        parameters = self.reference.copy()
        parameters[self.moved] += np.einsum("lij,lj->li", self.basis, changes)
        smallest = np.full(len(parameters), np.nan)
        smallest[self.moved] = 1.0 + np.linalg.eigvalsh(symmetric(changes))[:, 0]
        kept = np.ones(len(parameters), bool)
        kept[self.moved] = False
        missed = self.b - self.A @ parameters.ravel()
        conic = found.conic
        return PseudoInertiaFit(
            parameters=parameters,
            misfit=float(missed @ missed),
            smallest=smallest,
            kept=kept,
            status=CLOSED_FORM if conic is None else conic.status,
            converged=found.solution.search.converged,
            residual=0.0 if conic is None else conic.residual,
            iterations=0 if conic is None else conic.iterations,
            options=self.options,
        )


@lru_cache(maxsize=64)
def _unknowns(moved: tuple[int, ...], mass_sd: float) -> Unknowns:
    """List the changes of links, made once for all that is tried.

    Parameters
    ----------
    moved : numbers of the links that may change
    mass_sd : standard deviation of each entry
    """
    names = [f"link {link} E_{i + 1}{j + 1}" for link in moved for i, j in TRIANGLE]
    changes = [Unknown(name=name, sd=mass_sd, scale=mass_sd) for name in names]
    return Unknowns((Block(name=CHANGES, unknowns=tuple(changes)),))


def _refuse_no_body(reference: Array, moved: np.ndarray) -> None:
    """Refuse a reference that no distribution of mass can have.

    Parameters
    ----------
    reference : (links, 10)
    moved : (moved,) links that may change

    Raises
    ------
    BadData : a pseudo-inertia of these links is not positive definite
    """
    P = pseudo_inertias(reference)[moved]
    scale = np.sqrt(np.diagonal(P, axis1=1, axis2=2).clip(min=1e-300))
    least = np.linalg.eigvalsh(P / scale[:, :, None] / scale[:, None])[:, 0]
    if len(least) and least.min() < 1e-9:
        worst = moved[int(least.argmin())]
        raise BadData(
            f"the reference of link {worst} is not physically possible: its pseudo-inertia is not"
            " positive"
            " definite; give it an inertia that a body of its mass can have, or pass it"
            " through `possible_reference`"
        )


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
