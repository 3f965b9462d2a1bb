"""The mass-point problem of [D] eq. 3.10 to 3.13.

Base parameters are met by positive masses of points near a reference.

    minimise  W_phi / 2 |b - A phi(rho)|^2 + 1/2 sum_j (rho_j - rho_ref_j)^2 / v_j
    subject to  rho_j >= eps_j,  sum_j rho_j = mass (where given)

with phi(rho) = W rho, eq. 3.5, and v_j = 1 / W_rho in the paper. The matrix of eq. 3.12 is of low
rank beside its diagonal. With y = b - A W rho (W_phi = 1) and a multiplier of the mass,

    rho_j(y) = max(eps_j, rho_ref_j + v_j (W^T A^T y)_j)

so bounds and stationarity hold by construction and y alone is left to find: a semismooth Newton on
the concave dual (Qi and Sun 1993), whose systems I + A W D W^T A^T, D = v_j where a mass is free
and 0 on its bound, are of the size of the base parameters whatever the number of points.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
import scipy

from myomorph.body.shape.point_sums import PointMasses, PointSums
from myomorph.body.shape.points import MassPoints
from myomorph.body.shape.weights import checked_weights
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData

SLACKS = (1.0, 1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 0.0)
"""Softness of the rows, relative to their stiffness, where no plain iteration settles."""


@dataclass(frozen=True)
class MassPointOptions:
    """Settings of `solve_mass_points`.

    Attributes
    ----------
    prior : "relative": v_j such that every link's mass has the standard deviation `mass_sd` of
        itself before anything is measured, whatever the grid (`prior_variances`); "paper": v_j = 1
        / W_rho, which counts each point, so a finer grid weighs less against the same measurement
    mass_sd : relative standard deviation of a link's mass, for (A, b) in units of noise
    W_phi, W_rho : weights of [D] eq. 3.10; W_rho acts with prior "paper" only
    floor : least mass of a point, eps_j, as a share of the mean reference mass
    tolerance : greatest residual of the conditions of the optimum (`Optimality`) of a fit that
        counts as converged
    iterations : most Newton steps, before rows are softened and at each softness
    """

    prior: Literal["relative", "paper"] = "relative"
    mass_sd: float = 0.15
    W_phi: float = 1.0
    W_rho: float = 1.0
    floor: float = 1e-3
    tolerance: float = 1e-6
    iterations: int = 60

    def __post_init__(self) -> None:
        for name in ("mass_sd", "W_phi", "W_rho", "tolerance"):
            if not getattr(self, name) > 0.0:
                raise BadData(
                    f"{name} of the mass-point problem is {getattr(self, name):g}: expected above 0"
                )
        if self.prior not in ("relative", "paper"):
            raise BadData(f"unknown prior '{self.prior}': there are 'relative', 'paper'")
        if not 0.0 < self.floor < 1.0:
            raise BadData(
                f"the least mass of a point is {self.floor:g} of the mean: expected between 0 and 1"
            )


@dataclass(frozen=True)
class Optimality:
    """Residuals of the conditions of the optimum (Karush, Kuhn, Tucker).

    They are those of masses rho and misses y.

    Attributes
    ----------
    balance : greatest |sqrt(W_phi) (b - A W rho) - y| [units of noise], over the greatest miss
        where that is above 1; the duality gap is half the square of this residual
    stationarity : greatest |rho_j - rho_ref_j - v_j (W^T A^T y + multiplier)_j| of free points,
        over the mean reference mass
    complementarity : the same where a point on its bound would rather leave it, 0 if none would
    positivity : greatest bound minus mass, over the mean; 0 if no mass is below its bound
    total : |sum rho - mass| / mass, 0 without a given mass
    distance : no mass is farther than this from the optimum of the same total, over the mean: the
        problem is strongly convex, so sum_j (rho_j - optimum_j)^2 / v_j is at most the squared norm
        of the residual
    """

    balance: float
    stationarity: float
    complementarity: float
    positivity: float
    total: float
    distance: float

    @property
    def worst(self) -> float:
        """The greatest residual of the five conditions.

        `distance` bounds what it means for the masses.
        """
        return max(
            self.balance, self.stationarity, self.complementarity, self.positivity, self.total
        )


@read_only
class MassPointFit:
    """Masses of points, their inertial parameters, and the certificate of the optimum.

    Attributes
    ----------
    masses : (points,) rho [kg]
    parameters : (links, 10) W rho, in the order of [D] eq. 3.4
    misfit : |b - A phi|^2 of the solution
    link_sd : (links,) standard deviation of each link's mass that the prior amounts to [kg]
    optimality : residuals of the optimality conditions at `masses`
    on_bound : how many points have the least mass
    iterations : Newton steps
    converged : whether the masses are proven to be the optimum within the tolerance
    options : as given
    """

    masses: Array
    parameters: Array
    misfit: float
    link_sd: Array
    optimality: Optimality
    on_bound: int
    iterations: int
    converged: bool
    options: MassPointOptions = field(repr=False)


def prior_variances(points: MassPoints, options: MassPointOptions | None = None) -> Array:
    """Compute the variance of each point's mass before anything is measured.

    With "relative", v_j = sd^2 rho_ref_j sum_i w_ij a_i. Points are independent, so the variance of
    link i's mass is sum_j w_ij^2 v_j; where every point has one link and a_i is the link's mass m_i
    that is (sd m_i)^2 for any grid, because sum_j rho_ref_j = m_i, and its mass center has the SD
    sd times the radius of gyration. Where links share points, a_i is found by iteration so that
    sum_j w_ij^2 v_j = (sd m_i)^2. Where a survey says how far links of people differ, sd is that of
    a typical link, and each has its own (`MassPoints.relative_spread`).

    Parameters
    ----------
    points : with weights and reference masses
    options : kind of prior and its strength

    Returns
    -------
    (points,) v_j [kg^2]
    """
    options = options or MassPointOptions()
    if options.prior == "paper":
        return np.full(len(points.points), 1.0 / options.W_rho)
    W = points.weights
    reference = np.maximum(points.reference, 1e-6 * points.reference.mean())
    squared = _squares(W)
    mass = W.T @ reference
    present = mass > 0.0
    wanted = np.square(mass * points.relative_spread)
    spread = squared.T @ reference
    a = np.divide(wanted, spread, out=np.zeros_like(mass), where=present)
    for _ in range(20):
        variance = squared.T @ (reference * (W @ a))
        change = np.divide(wanted, variance, out=np.ones_like(mass), where=present)
        a = a * change
        if np.abs(change - 1.0).max() < 0.01:
            break
    return options.mass_sd**2 * reference * (W @ a)


def solve_mass_points(
    points: MassPoints,
    A: Array,
    b: Array,
    *,
    mass: float | None = None,
    options: MassPointOptions | None = None,
) -> MassPointFit:
    """Find positive masses of points that meet measured parameters near a reference.

    [D] eq. 3.10 to 3.13, by Newton on the dual; see the head of this file. The paper's setting is A
    = Z and b = phi_B.

    Parameters
    ----------
    points : with weights and reference masses
    A : (rows, 10 links) what was measured of the parameters, in units of its noise (`BaseFit.rows`)
    b : (rows,)
    mass : total that the points must have [kg]; None leaves it free
    options : prior, weights and tolerance; see `MassPointOptions`

    Returns
    -------
    masses of the points [kg] and parameters of the links, with the residuals of the conditions of
        the optimum

    Raises
    ------
    BadData : A or b has another shape or a value that is not finite, a reference mass is negative
        or all are 0, the total is less than the least masses of the points, or A is too badly
        scaled
    """
    options = options or MassPointOptions()
    problem = _Problem.of(points, np.asarray(A, float), np.asarray(b, float), mass, options)
    y, iterations = problem.solve()
    return problem.result(y, iterations)


class Ascent(NamedTuple):
    """Where Newton steps on the dual ended.

    Attributes
    ----------
    y : (rows,) multipliers
    steps : that were taken
    settled : whether the rows balance
    """

    y: Array
    steps: int
    settled: bool


class FreeSums:
    """Sums over the free points of `PointSums.pairs`, of which each call changes a few."""

    def __init__(self, sums: PointSums, points: int):
        self.sums = sums
        self.factors = np.zeros(points)
        self.blocks = np.zeros_like(sums.pairs(self.factors))

    def of(self, factors: Array) -> Array:
        """Sum with other factors.

        Parameters
        ----------
        factors : (points,) 0 for points that are not free

        Returns
        -------
        sums of products of the moments of the links that share points
        """
        changed = factors != self.factors
        if np.count_nonzero(changed) < np.count_nonzero(factors):
            self.blocks += self.sums.pairs(factors - self.factors)
        else:
            self.blocks = self.sums.pairs(factors)
        self.factors = factors
        return self.blocks


@dataclass(eq=False)
class _Problem:
    """The problem in the moments of the links: B = C G with G of `PointSums`.

    Masses are counted from the reference, so that little is lost by rounding. The total is the last
    row.

    Attributes
    ----------
    points : with weights and reference masses
    sums : products with G
    A, b : (rows, 10 links), (rows,) as given
    C : (rows, 10 links) rows in the links' moments, at most as many as columns, and the total
    target : (rows,) what the reference leaves to do
    soft : (rows,) 1 for a row that may miss its target, 0 for the total, which may not
    reference : (points,) masses [kg]
    freedom : (points,) v_j [kg^2]
    floor : (points,) least masses [kg]
    mass : total [kg]; None leaves it free
    options : as given
    """

    points: MassPoints
    sums: PointSums
    A: Array
    b: Array
    C: Array
    target: Array
    soft: Array
    reference: Array
    freedom: Array
    floor: Array
    mass: float | None
    options: MassPointOptions

    @staticmethod
    def of(
        points: MassPoints, A: Array, b: Array, mass: float | None, options: MassPointOptions
    ) -> _Problem:
        """Check the inputs and set up the problem, see `solve_mass_points`."""
        links = len(points.links.names)
        reference = np.array(points.reference)
        if A.ndim != 2 or A.shape[1] != 10 * links or b.shape != (len(A),):
            raise BadData(
                f"expected A (rows, {10 * links}) and b (rows,), but got {A.shape} and {b.shape}"
            )
        if not (np.isfinite(A).all() and np.isfinite(b).all()):
            raise BadData("A or b holds a number that is not finite")
        if (
            not len(reference)
            or not np.isfinite(reference).all()
            or (reference < 0.0).any()
            or not reference.any()
        ):
            raise BadData(
                "expected at least one mass point, with reference masses that are finite and not"
                " negative"
            )
        checked_weights(points.weights, points.points, points.links)
        floor = np.full(len(reference), options.floor * reference.mean())
        if mass is not None and not (np.isfinite(mass) and mass > floor.sum()):
            raise BadData(
                f"the body's mass is {mass:g} kg: expected more than {floor.sum():.3g} kg"
            )
        sums = PointSums.of(points)
        target = b - A @ points.parameters(reference).ravel()
        rows, target = _fewer_rows(np.sqrt(options.W_phi) * A, np.sqrt(options.W_phi) * target)
        soft = np.ones(len(rows))
        C = np.einsum(
            "rli,lij->rlj",
            rows.reshape(len(rows), links, 10),
            points.places @ sums.shift,
            optimize=True,
        )
        C = C.reshape(len(rows), 10 * links)
        if mass is not None:
            row = np.zeros((links, 10))
            row[:, 0] = 1.0
            C = np.vstack([C, row.ravel()])
            target = np.append(target, mass - reference.sum())
            soft = np.append(soft, 0.0)
        return _Problem(
            points=points,
            sums=sums,
            A=A,
            b=b,
            C=C,
            target=target,
            soft=soft,
            reference=reference,
            freedom=prior_variances(points, options),
            floor=floor,
            mass=mass,
            options=options,
        )

    def solve(self) -> tuple[Array, int]:
        """Find the multipliers, and count the Newton steps they took.

        Where the plain iteration does not settle, rows are made soft in proportion to their
        stiffness and then harder from one solution to the next.

        Returns
        -------
        (rows,) multipliers y, and number of steps
        """
        most = self.options.iterations
        none = np.zeros(len(self.C))
        ascent = self._ascend(none, self.soft, most)
        if ascent.settled:
            return ascent.y, ascent.steps
        taken = ascent.steps
        stiffness = np.square(self.C).sum(axis=1) * self.freedom.mean() * len(self.freedom)
        y = none
        for slack in SLACKS:
            ascent = self._ascend(y, self.soft + slack * stiffness, most)
            y = ascent.y
            taken += ascent.steps
        return y, taken

    def _ascend(self, y: Array, soft: Array, most: int) -> Ascent:
        """Take Newton steps on the dual until the rows balance or no step gains anything.

        Parameters
        ----------
        y : (rows,) to begin with
        soft : (rows,) softness of each row, 0 for one that must be met
        most : at most so many steps
        """
        y = y.copy()
        s = self.sums.pull(self.C.T @ y)
        size = np.abs(self.target).max(initial=0.0) + 1e-300
        free_sums = FreeSums(self.sums, len(s))
        best = np.inf
        before = np.inf
        taken = 0
        while True:
            free, change = self._masses(s)
            left = self.target - soft * y - self.C @ self.sums.push(change)
            best = min(best, before)
            before = np.abs(left).max(initial=0.0)
            # Near the optimum steps end in rounding: stop where they gain nothing any more.
            settled = before <= 1e-13 * size or (before <= 1e-7 * size and before > 0.3 * best)
            if settled or taken == most:
                return Ascent(y=y, steps=taken, settled=bool(settled))
            taken += 1
            blocks = free_sums.of(np.where(free, self.freedom, 0.0))
            direction = self._newton(blocks, soft, left)
            ds = self.sums.pull(self.C.T @ direction)
            t = self._step(y, s, soft, direction, ds)
            y += t * direction
            s = s + t * ds if taken % 5 else self.sums.pull(self.C.T @ y)

    def _masses(self, s: Array) -> tuple[np.ndarray, Array]:
        """Find which masses are free at s = B^T y, and all masses minus the reference.

        Parameters
        ----------
        s : (points,)

        Returns
        -------
        (points,) whether the mass is above its bound, and (points,) change [kg]
        """
        change = self.freedom * s
        low = self.floor - self.reference
        free = change > low
        return free, np.where(free, change, low)

    def _newton(self, blocks: Array, soft: Array, left: Array) -> Array:
        """Solve for the Newton direction in y: (softness + B D B^T) direction = left.

        Parameters
        ----------
        blocks : sums over the free points (`PointSums.pairs`)
        soft : (rows,)
        left : (rows,) gradient of the dual

        Returns
        -------
        (rows,)

        Raises
        ------
        BadData : A is too badly scaled to have a direction
        """
        H = self.C @ self.sums.matrix(blocks) @ self.C.T
        H[np.diag_indices_from(H)] += soft
        # Where no mass is free, nothing holds the multiplier of the total: a little of its
        # stiffness does.
        hard = soft == 0.0
        H[hard, hard] += 1e-13 * self.freedom.sum()
        scale = 1.0 / np.sqrt(np.diag(H))
        H *= scale[:, None] * scale
        for ridge in (0.0, 1e-14, 1e-12, 1e-10, 1e-8):
            try:
                factor = scipy.linalg.cho_factor(
                    H + ridge * np.eye(len(H)), lower=True, check_finite=False
                )
            except scipy.linalg.LinAlgError:
                continue
            return scale * scipy.linalg.cho_solve(factor, scale * left, check_finite=False)
        raise BadData("the mass-point problem has no Newton direction: A is too badly scaled")

    def _step(self, y: Array, s: Array, soft: Array, direction: Array, ds: Array) -> float:
        """Find the step length that maximizes the dual along a direction.

        The slope there is at most 10 % of that at the start.

        Parameters
        ----------
        y, soft, direction : (rows,)
        s, ds : (points,) B^T y and its change with a step of 1
        """
        constant = float(self.target @ direction - (soft * y) @ direction)
        linear = float((soft * direction) @ direction)
        masses = PointMasses(reference=self.reference, freedom=self.freedom, floor=self.floor)
        t = 0.0
        low = 0.0
        high = np.inf
        enough = 0.0
        for trial in range(60):
            total, stiffness = self.sums.respond(masses, s, ds, t)
            slope = constant - t * linear - total
            curvature = linear + stiffness
            if trial == 0:
                enough = 0.1 * abs(slope)
                t = 1.0
                continue
            if abs(slope) <= enough:
                break
            low, high = (t, high) if slope > 0.0 else (low, t)
            newton = t + slope / curvature if curvature > 0.0 else np.inf
            inside = low < newton < high and newton < 1e3 * max(t, 1.0)
            if inside:
                t = newton
            elif high == np.inf:
                t = 4.0 * t
            else:
                t = 0.5 * (low + high)
        return t

    def result(self, y: Array, iterations: int) -> MassPointFit:
        """Build the fit at multipliers, with the residuals of the conditions of the optimum.

        Parameters
        ----------
        y : (rows,) multipliers
        iterations : Newton steps that they took

        Returns
        -------
        masses [kg], parameters and certificate
        """
        s = self.sums.pull(self.C.T @ y)
        free, change = self._masses(s)
        masses = np.where(free, np.maximum(self.reference + change, self.floor), self.floor)
        residual = self.soft * (self.target - self.C @ self.sums.push(masses - self.reference) - y)
        gap = self.freedom * s - (masses - self.reference)
        mean = float(self.reference.mean())
        largest_miss = np.abs(self.soft * y).max(initial=1.0)
        off_total = 0.0
        if self.mass is not None:
            off_total = abs(float(masses.sum()) - self.mass) / self.mass
        optimality = Optimality(
            balance=float(np.abs(residual).max(initial=0.0) / largest_miss),
            stationarity=float(np.abs(gap[free]).max(initial=0.0)) / mean,
            complementarity=float(gap[~free].max(initial=0.0)) / mean,
            positivity=max(float((self.floor - masses).max()), 0.0) / mean,
            total=off_total,
            distance=float(np.sqrt(self.freedom.max()) * np.linalg.norm(residual)) / mean,
        )
        parameters = self.points.parameters(masses)
        missed = self.b - self.A @ parameters.ravel()
        return MassPointFit(
            masses=masses,
            parameters=parameters,
            misfit=float(missed @ missed),
            link_sd=np.sqrt(_squares(self.points.weights).T @ self.freedom),
            optimality=optimality,
            on_bound=int((~free).sum()),
            iterations=iterations,
            converged=optimality.worst <= self.options.tolerance,
            options=self.options,
        )


def _squares(W: scipy.sparse.csr_array) -> scipy.sparse.csr_array:
    return scipy.sparse.csr_array((W.data**2, W.indices, W.indptr), shape=W.shape)


def _fewer_rows(A: Array, b: Array) -> tuple[Array, Array]:
    """Reduce rows to as many as A has columns, with the same |A x - b|^2 but for a constant.

    Parameters
    ----------
    A, b : (rows, columns), (rows,)

    Returns
    -------
    (at most columns, columns) and (at most columns,)
    """
    if len(A) <= A.shape[1]:
        return A, b
    n = A.shape[1]
    R = scipy.linalg.qr(np.column_stack([A, b]), mode="r")[0]
    return R[:n, :n], R[:n, n]
