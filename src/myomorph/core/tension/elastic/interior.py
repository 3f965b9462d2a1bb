"""The elastic problem by an interior-point method with exact curvature, each step by its structure.

Activations, slacks and all other unknowns of a frame are eliminated from the Newton system, and
with them the multipliers of the balance; what is left are the tendon forces, f (frames, muscles),
whose matrix is banded over frames. The curvature of each equilibrium counts as far as it is not
negative, so that every step descends; a filter accepts steps (Waechter and Biegler 2006;
primal-dual interior-point methods: Nocedal and Wright 2006, ch. 19).

Letters are those of `program.py`: G the equilibrium between frames k and n = k + 1 with slopes over
f_k, f_n and a; lam its multipliers, y those of the balance. Where equilibrium is linearized, the
step of an activation follows from those of the forces,

    da = c + p_k df_k + p_n df_n,   c = -G / G_a,  p_k = -G_k / G_a,  p_n = -G_n / G_a.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.tension.elastic.program import (
    MAX_FORCE,
    MIN_FORCE,
    NEAR,
    SMOOTH,
    BandSystem,
    Box,
    Point,
    Program,
    elements,
    integrated,
    possible,
)

SLACK = 1e-6
"""Slack of the balance per multiplier: where no activation can balance, torques are missed least.
"""
FIRST = 1e-2
LAST = 1e-6
"""Barrier parameter at first and at last, in units of the effort a^2 of one muscle."""
TOLERANCE = (5e-4, 1e-5, 1e-5)
"""Residuals of the gradient, of bounds and of constraints at which the problem is solved."""
ENOUGH = 50.0
"""Residual, in units of the barrier parameter, at which that is made smaller."""
NEAR_SLOPE = 1.0
"""Residual of the gradient from which on the curvature of the rates' bounds counts."""
MAX_STEPS = 500
STUCK = 1.0
"""Weight on keeping the forces from which on no step will be found: constraints contradict each
other there.
"""
MAX_RESTARTS = 6
"""How often the solver begins anew from the forces that its activations lead to."""
MAX_HALVINGS = 14
"""How often a step is halved until the filter accepts it."""


class Outcome(NamedTuple):
    """How the solver ended.

    Attributes
    ----------
    residual : greatest KKT residual
    equilibrium : greatest difference of tendon and fiber force, normalized
    steps : iterations
    solved : whether the tolerance was met
    far : root mean square distance of activations and of forces from another start's, NaN without
        one
    """

    residual: float
    equilibrium: float
    steps: int
    solved: bool
    far: tuple[float, float] = (np.nan, np.nan)


class RateRoom(NamedTuple):
    """Room of activations to the bounds of their rates: upper, lower.

    Attributes
    ----------
    room : (2, frames - 2, muscles)
    slopes : (2, 2, frames - 2, muscles) over the activations before and after
    bends : (2, frames - 2, muscles) curvatures over their sum
    """

    room: Array
    slopes: Array
    bends: Array


class Merit(NamedTuple):
    """What the filter compares: what constraints miss, and the cost with the barrier."""

    missed: float
    value: float


class Residuals(NamedTuple):
    """Residuals of the gradient (over the mean slope of the cost), bounds and constraints."""

    gradient: float
    bounds: float
    constraints: float


class Blocks(NamedTuple):
    """Second derivatives of each element over f_k and f_n, (frames - 1, muscles) each."""

    kk: Array
    kn: Array
    nn: Array


class Trial(NamedTuple):
    """A point that a step leads to, and the problem there."""

    v: list[Array]
    y: Array
    at: Linearized


class NewtonStep(NamedTuple):
    """Step of f, a, x and slacks, and of the multipliers y."""

    v: list[Array]
    y: Array


@dataclass(eq=False)
class Linearized:
    """The problem at a point: what a step is made of.

    Attributes
    ----------
    g : (frames - 1, muscles, 10) equilibrium and its derivatives, as of `elements`
    cost : without the barrier
    slope_a, bend_a : (frames - 1, muscles) slopes and curvatures of the cost over a
    slope_x, bend_x : (frames, others) the same over x
    balance : (frames, rows) torques that are missed
    rate : (2, frames - 2, muscles) room to the rates' bounds, less the slacks
    rate_slopes, rate_bends : as of `RateRoom`
    """

    g: Array
    cost: float
    slope_a: Array
    bend_a: Array
    slope_x: Array
    bend_x: Array
    balance: Array
    rate: Array
    rate_slopes: Array
    rate_bends: Array


class Solver:
    """One program, solved from one start.

    Attributes
    ----------
    v : forces f, activations a, others x, and slacks s of the rates' bounds where these count
    boxes : their bounds with multipliers
    y : (frames, rows) multipliers of the balance
    mu : barrier parameter
    bent : how often the curvature had to be made positive
    taken : length of the last step
    """

    def __init__(self, program: Program, start: Point, y: Array):
        p = program
        self.p = p
        self.frames, self.muscles = start.f.shape
        self.second = p.rates is not None and self.frames > 2
        self.between = 0.5 * (p.steps[1:] + p.steps[:-1])[:, None]
        self.y = y.copy()
        self._begin(start)
        self.band = BandSystem(self.frames, self.muscles, self.second)
        self.row_scale = 1.0 / np.maximum(np.abs(p.pulls).max(axis=(0, 2), initial=0.0), 1.0)
        self.bent = 0
        self.taken = 0.0
        self.near = False

    def _begin(self, start: Point) -> None:
        """Go to a point, with multipliers of the barrier's own."""
        p = self.p
        # Where much of the torque is left to reserves, bounds press as hard, and the barrier has to
        # begin as wide.
        cost = p.activation.terms(start.a).cost + p.other.terms(start.x).cost
        effort = cost / len(start.f)
        self.mu = FIRST * float(np.clip(effort, 1.0, 1e3))
        self.v: list[Array] = []
        self.boxes: list[Box] = []
        self._add_box(np.asarray(MIN_FORCE), np.asarray(MAX_FORCE), start.f)
        self._add_box(p.activation.lower, p.activation.upper, start.a)
        self._add_box(p.other.lower, p.other.upper, start.x)
        if self.second:
            s = np.maximum(self._rates(self.v[1]).room, NEAR)
            self.v.append(s)
            self.boxes.append(Box(np.asarray(0.0), np.asarray(np.inf), s, mu=self.mu))
        self.filter: list[tuple[float, float]] = []

    def _add_box(self, low: Array, high: Array, v: Array) -> None:
        """Add unknowns, moved off their bounds."""
        inside = Box.inside(low, high, v)
        self.v.append(inside)
        self.boxes.append(Box(low, high, inside, mu=self.mu))

    def _rates(self, a: Array) -> RateRoom:
        """Room to the rates' bounds, with slopes and curvatures.

        Parameters
        ----------
        a : (frames - 1, muscles)
        """
        assert self.p.rates is not None
        bounds = self.p.rates.bounds(0.5 * (a[1:] + a[:-1]))
        dt = self.between
        change = a[1:] - a[:-1]
        half_up = 0.5 * dt * bounds.high_slope
        half_low = 0.5 * dt * bounds.low_slope
        return RateRoom(
            room=np.stack([dt * bounds.high - change, change - dt * bounds.low]),
            slopes=np.stack(
                [
                    np.stack([half_up + 1.0, half_up - 1.0]),
                    np.stack([-half_low - 1.0, 1.0 - half_low]),
                ]
            ),
            bends=0.25 * np.stack([dt * bounds.high_bend, -dt * bounds.low_bend]),
        )

    def _balance(self, f: Array, x: Array, y: Array) -> Array:
        """Torques that are missed, b - B f - A x - slack y.

        Parameters
        ----------
        f, x, y : (frames, muscles), (frames, others), (frames, rows)

        Returns
        -------
        (frames, rows) [N m or N]
        """
        p = self.p
        held = (
            np.matmul(p.pulls, f[:, :, None])[..., 0] + np.matmul(p.columns, x[:, :, None])[..., 0]
        )
        return p.right - held - SLACK * y

    def linearize(self, v: list[Array], y: Array) -> Linearized:
        """Linearize the problem at a point.

        Parameters
        ----------
        v : f, a, x and slacks
        y : (frames, rows) multipliers of the balance

        Returns
        -------
        equilibrium, cost and balance there
        """
        p = self.p
        f, a, x = v[:3]
        g = np.empty((*a.shape, 10))
        elements(p.arrays, p.own, f, a, p.lengths, p.speeds, p.steps, g)
        of_a = p.activation.terms(a)
        of_x = p.other.terms(x)
        rates = RateRoom(np.zeros((2, 0, 0)), np.zeros((2, 2, 0, 0)), np.zeros((2, 0, 0)))
        rate = rates.room
        if self.second:
            rates = self._rates(a)
            rate = rates.room - v[3]
        return Linearized(
            g=g,
            cost=of_a.cost + of_x.cost + SMOOTH * float((np.diff(f, axis=0) ** 2).sum()),
            slope_a=of_a.slope,
            bend_a=of_a.bend,
            slope_x=of_x.slope,
            bend_x=of_x.bend,
            balance=self._balance(f, x, self.y),
            rate=rate,
            rate_slopes=rates.slopes,
            rate_bends=rates.bends,
        )

    def multipliers(self, at: Linearized) -> tuple[Array, Array]:
        """Slope of the Lagrangian without equilibrium over a, and the multipliers of equilibrium.

        Parameters
        ----------
        at : the problem at the present point

        Returns
        -------
        (frames - 1, muscles) both
        """
        slope = at.slope_a + self.boxes[1].force()
        if self.second:
            z = self.boxes[3].z
            slope[:-1] -= (at.rate_slopes[:, 0] * z).sum(axis=0)
            slope[1:] -= (at.rate_slopes[:, 1] * z).sum(axis=0)
        return slope, -slope / at.g[..., 3]

    def _smooth_slope(self, f: Array) -> Array:
        """Slope of the smoothness of forces over f (frames, muscles), as f."""
        change = 2.0 * SMOOTH * np.diff(f, axis=0)
        result = np.zeros_like(f)
        result[1:] += change
        result[:-1] -= change
        return result

    def errors(self, at: Linearized, mu: float) -> Residuals:
        """Residuals at a point, of the problem with a barrier parameter."""
        pulled = self._pulled()
        dual = self._smooth_slope(self.v[0]) + self.boxes[0].force() - pulled
        _, multiplier = self.multipliers(at)
        dual[:-1] += multiplier * at.g[..., 1]
        dual[1:] += multiplier * at.g[..., 2]
        of_balance = np.matmul(self.y[:, None], self.p.columns)[:, 0]
        dual_x = at.slope_x + self.boxes[2].force() - of_balance
        greatest = max(
            np.abs(dual).max(initial=0.0),
            np.abs(dual_x / (1.0 + np.sqrt(at.bend_x))).max(initial=0.0),
        )
        boxes = zip(self.boxes, self.v, strict=True)
        return Residuals(
            gradient=float(greatest) / (1.0 + float(np.abs(pulled).mean())),
            bounds=max(box.complementarity(v, mu) for box, v in boxes),
            constraints=max(float(part.max(initial=0.0)) for part in self._violations(at)),
        )

    def _pulled(self) -> Array:
        """Multipliers of the balance on the forces, y^T B (frames, muscles)."""
        return np.matmul(self.y[:, None], self.p.pulls)[:, 0]

    def _violations(self, at: Linearized) -> list[Array]:
        """How far each constraint is missed: equilibrium, scaled balance, rates."""
        missed = (at.g[..., 0], at.balance * self.row_scale, at.rate)
        return [np.abs(values) for values in missed]

    def step(self, at: Linearized, shift: float) -> NewtonStep | None:
        """Newton step at the present point; None where the matrix is not positive definite.

        Parameters
        ----------
        at : the problem there
        shift : weight on keeping the forces, added to the matrix
        """
        follow = _Following.of(at)
        gradient, matrix = self._force_parts(self.v[0], shift)
        rates = self._add_rates(at, follow, gradient, matrix) if self.second else None
        blocks = self._add_elements(at, follow, gradient)
        others = self._eliminated(at)
        if not self._factorized(matrix, blocks, rates, others.C):
            return None
        df = self.band.solve(np.matmul(others.t[:, None], others.C)[:, 0] - gradient)
        left = others.t - np.matmul(others.C, df[:, :, None])[..., 0]
        dy = np.linalg.solve(others.lower.transpose(0, 2, 1), left[:, :, None])[..., 0]
        da = follow.c + follow.pk * df[:-1] + follow.pn * df[1:]
        of_balance = np.matmul(dy[:, None], self.p.columns)[:, 0]
        dx = (of_balance - others.gradient) / others.curvature
        step = [df, da, dx]
        if self.second:
            step.append(at.rate + at.rate_slopes[:, 0] * da[:-1] + at.rate_slopes[:, 1] * da[1:])
        return NewtonStep(step, dy)

    def _eliminated(self, at: Linearized) -> _Eliminated:
        """Eliminate x and the multipliers of the balance from each frame."""
        columns = self.p.columns
        barrier, bend = self.boxes[2].barrier(self.v[2], self.mu)
        curvature = at.bend_x + bend + 1e-12
        gradient = at.slope_x + barrier - np.matmul(self.y[:, None], columns)[:, 0]
        soft = np.matmul(columns / curvature[:, None], columns.transpose(0, 2, 1))
        soft += SLACK * np.eye(soft.shape[1])
        lower = np.linalg.cholesky(soft)
        missed = at.balance + np.matmul(columns, (gradient / curvature)[:, :, None])[..., 0]
        both = np.concatenate([self.p.pulls, missed[:, :, None]], axis=2)
        reduced = np.linalg.solve(lower, both)
        return _Eliminated(
            gradient=gradient,
            curvature=curvature,
            lower=lower,
            C=reduced[:, :, :-1],
            t=reduced[:, :, -1],
        )

    def _force_parts(self, f: Array, shift: float) -> tuple[Array, _Matrix]:
        """Gradient and matrix over f (frames, muscles) of barrier, smoothness and balance."""
        barrier, d = self.boxes[0].barrier(f, self.mu)
        gradient = self._smooth_slope(f) + barrier - self._pulled()
        d = d + shift + 4.0 * SMOOTH
        d[0] -= 2.0 * SMOOTH
        d[-1] -= 2.0 * SMOOTH
        e = np.full((self.frames - 1, self.muscles), -2.0 * SMOOTH)
        return gradient, _Matrix(d=d, e=e, g=np.zeros((0, 0)))

    def _add_elements(self, at: Linearized, follow: _Following, gradient: Array) -> Blocks:
        """Add activations and equilibrium to the gradient over forces; returns their curvature.

        Parameters
        ----------
        gradient : (frames, muscles) over forces, added to
        """
        g = at.g
        c, pk, pn = follow
        _, lam = self.multipliers(at)
        barrier, bend = self.boxes[1].barrier(self.v[1], self.mu)
        da = at.bend_a + bend
        reduced = at.slope_a + barrier + (da + lam * g[..., 9]) * c
        gradient[:-1] += pk * reduced + lam * g[..., 7] * c
        gradient[1:] += pn * reduced + lam * g[..., 8] * c
        mixed = g[..., 5] + g[..., 7] * pn + g[..., 8] * pk + g[..., 9] * pk * pn
        return Blocks(
            kk=da * pk * pk + lam * (g[..., 4] + (2.0 * g[..., 7] + g[..., 9] * pk) * pk),
            kn=da * pk * pn + lam * mixed,
            nn=da * pn * pn + lam * (g[..., 6] + (2.0 * g[..., 8] + g[..., 9] * pn) * pn),
        )

    def _factorized(
        self, matrix: _Matrix, blocks: Blocks, rates: _Squares | None, C: Array
    ) -> bool:
        """Factorize with the exact curvature, or with that of each constraint as far as it is >= 0.

        Parameters
        ----------
        matrix : over forces, without curvature of constraints
        blocks : curvature of equilibrium
        rates : curvature of the rates' bounds, None without these
        C : (frames, rows, muscles) of the balance
        """
        clipped = None
        if rates is not None:
            clipped = _Squares(np.maximum(rates.weight, 0.0), rates.terms)
        for (kk, kn, nn), bent in ((blocks, rates), (_not_negative(blocks), clipped)):
            d = matrix.d.copy()
            e = matrix.e + kn
            second = matrix.g
            d[:-1] += kk
            d[1:] += nn
            if bent is not None:
                second = second + _add_squares(bent, d, e)
            if self.band.factorize(d, e, second, C):
                return True
            self.bent += 1
        return False

    def _add_rates(
        self, at: Linearized, follow: _Following, gradient: Array, matrix: _Matrix
    ) -> _Squares:
        """Add the rates' part to the gradient and to the matrix over forces.

        Returns
        -------
        curvature of the bounds
        """
        c, pk, pn = follow
        s = self.v[3]
        z = self.boxes[3].z
        stiff = z / s
        # By multipliers that are not yet right, curvature would mislead.
        bend = -(z * at.rate_bends).sum(axis=0, keepdims=True) * self.near
        before = at.rate_slopes[:, 0]
        after = at.rate_slopes[:, 1]
        # The gradient at c = 0 of a; the step of the elements adds what c is to their own part
        # alone.
        pull = stiff * (before * c[:-1] + after * c[1:]) - (self.mu / s - stiff * at.rate)
        drift = bend[0] * (c[:-1] + c[1:])
        first = (before * pull).sum(axis=0) + drift
        last = (after * pull).sum(axis=0) + drift
        gradient[:-2] += pk[:-1] * first
        gradient[1:-1] += pn[:-1] * first + pk[1:] * last
        gradient[2:] += pn[1:] * last
        slopes = np.stack([before * pk[:-1], before * pn[:-1] + after * pk[1:], after * pn[1:]])
        matrix.g = _add_squares(_Squares(stiff, slopes), matrix.d, matrix.e)
        return _Squares(bend, np.stack([pk[:-1], pn[:-1] + pk[1:], pn[1:]])[:, None])

    def merit(self, v: list[Array], y: Array, at: Linearized) -> Merit:
        """Miss of the constraints, and cost with the barrier.

        Parameters
        ----------
        v : f, a, x and slacks
        y : (frames, rows) multipliers of the balance
        at : the problem there

        Returns
        -------
        infinite where a bound is passed
        """
        logs = sum(box.logs(item) for box, item in zip(self.boxes, v, strict=True))
        missed = float(sum(part.sum() for part in self._violations(at)))
        if not np.isfinite(missed + at.cost + logs):
            return Merit(np.inf, np.inf)
        # The slack of the balance has its own cost, which the multipliers stand for.
        return Merit(missed, at.cost - self.mu * logs + 0.5 * SLACK * float((y * y).sum()))

    def slope(self, at: Linearized, step: NewtonStep) -> float:
        """Slope of the cost with the barrier along a step."""
        grads = [self._smooth_slope(self.v[0]), at.slope_a, at.slope_x, np.zeros(1)]
        total = SLACK * float((self.y * step.y).sum())
        for box, v, dv, grad in zip(self.boxes, self.v, step.v, grads, strict=False):
            total += float(((grad + box.barrier(v, self.mu)[0]) * dv).sum())
        return total

    def advance(self, at: Linearized, step: NewtonStep) -> Linearized | None:
        """Take a step as far as the filter accepts; None where it accepts none.

        Returns
        -------
        the problem at the new point
        """
        share = max(0.99, 1.0 - self.mu)
        trial = self._accepted(at, step, share)
        if trial is None:
            return None
        changes = [
            box.changes(v, dv, self.mu)
            for box, v, dv in zip(self.boxes, self.v, step.v, strict=True)
        ]
        dual = min(
            box.dual_reach(dz, dw, share) for box, (dz, dw) in zip(self.boxes, changes, strict=True)
        )
        self.v = trial.v
        self.y = trial.y
        for box, (dz, dw), v in zip(self.boxes, changes, self.v, strict=True):
            box.z = box.z + dual * dz
            box.w = box.w + dual * dw
            box.keep_near(v, self.mu)
        return trial.at

    def _accepted(self, at: Linearized, step: NewtonStep, share: float) -> Trial | None:
        """Halve a step until the filter accepts it; None where it accepts none.

        Parameters
        ----------
        share : of the distance to the bounds that may be used up
        """
        here = self.merit(self.v, self.y, at)
        slope = self.slope(at, step)
        length = min(
            box.reach(v, dv, share) for box, v, dv in zip(self.boxes, self.v, step.v, strict=True)
        )
        for _ in range(MAX_HALVINGS):
            v = [item + length * dv for item, dv in zip(self.v, step.v, strict=True)]
            y = self.y + length * step.y
            there = self.linearize(v, y)
            if self._accepts(here, self.merit(v, y, there), length, slope):
                self.taken = length
                return Trial(v, y, there)
            length *= 0.5
        return None

    def _accepts(self, here: Merit, there: Merit, length: float, slope: float) -> bool:
        """Tell whether the filter accepts a point; it remembers steps that lower what is missed.

        Parameters
        ----------
        length : of the step
        slope : of the cost with the barrier along it
        """
        rounding = 1e-12 * (1.0 + abs(here.value))
        ahead = all(
            there.missed <= (1.0 - 1e-5) * missed or there.value <= value - 1e-5 * missed + rounding
            for missed, value in self.filter
        )
        if not (np.isfinite(there.value) and ahead):
            return False
        if slope < 0.0 and here.missed <= 1e-4 and length * -slope > here.missed:
            # Armijo's rule: near what is feasible, the cost has to fall.
            return there.value <= here.value + 1e-4 * length * slope + rounding
        nearer = there.missed <= (1.0 - 1e-5) * here.missed + 1e-14
        if nearer or there.value <= here.value - 1e-5 * here.missed:
            self.filter.append((here.missed, here.value))
            return True
        return False

    def solve(self) -> tuple[Point, Outcome]:
        """Follow the barrier down to the solution, and tell how near it is."""
        shift = 0.0
        steps = 0
        restarts = 0
        errors = Residuals(np.inf, np.inf, np.inf)
        at = self.linearize(self.v, self.y)
        for _ in range(MAX_STEPS):
            steps += 1
            errors = self._lowered(at)
            self.near = errors.gradient < NEAR_SLOPE
            if self.mu <= LAST and _solved(errors):
                break
            step = self.step(at, shift)
            there = None if step is None else self.advance(at, step)
            if there is not None:
                shift = shift / 4.0 if shift > 1e-4 else 0.0
                at = there
                continue
            shift = max(4.0 * shift, 1e-4)
            if shift > STUCK and restarts == MAX_RESTARTS:
                break
            if shift > STUCK:
                # Equilibrium and rates of activation want different steps: both hold on the way
                # that is integrated.
                shift = 0.0
                restarts = restarts + 1
                a = possible(self.p, self.v[1])
                self._begin(Point(f=integrated(self.p, a), a=a, x=self.v[2]))
                at = self.linearize(self.v, self.y)
        residual = max(self.errors(at, 0.0).gradient, errors.constraints)
        f, a, x = self.v[:3]
        outcome = Outcome(
            residual=max(residual, errors.bounds),
            equilibrium=float(np.abs(at.g[..., 0]).max(initial=0.0)),
            steps=steps,
            solved=_solved(errors),
        )
        return Point(f=f, a=a, x=x), outcome

    def _lowered(self, at: Linearized) -> Residuals:
        """Lower the barrier parameter as far as the residuals allow, and return these."""
        while True:
            errors = self.errors(at, self.mu)
            if max(errors) > ENOUGH * self.mu or self.mu <= LAST:
                return errors
            self.mu = max(LAST, min(0.2 * self.mu, self.mu**1.5))
            self.filter = []


class _Following(NamedTuple):
    """How activations follow forces: da = c + pk df_k + pn df_n, (frames - 1, muscles) each."""

    c: Array
    pk: Array
    pn: Array

    @staticmethod
    def of(at: Linearized) -> _Following:
        """From linearized equilibrium."""
        by_a = at.g[..., 3]
        return _Following(c=-at.g[..., 0] / by_a, pk=-at.g[..., 1] / by_a, pn=-at.g[..., 2] / by_a)


class _Eliminated(NamedTuple):
    """x and the balance of each frame, with L L^T = A D^-1 A^T + slack.

    Attributes
    ----------
    gradient, curvature : (frames, others) over x; the curvature is D
    lower : (frames, rows, rows) L
    C : (frames, rows, muscles) L^-1 B
    t : (frames, rows) L^-1 of what is missed
    """

    gradient: Array
    curvature: Array
    lower: Array
    C: Array
    t: Array


class _Squares(NamedTuple):
    """Weighted squares of sums over the forces of three frames.

    Attributes
    ----------
    weight : (squares, frames - 2, muscles)
    terms : (3, squares, frames - 2, muscles) slopes of the sums over the forces of each frame
    """

    weight: Array
    terms: Array


@dataclass(eq=False)
class _Matrix:
    """Diagonals of blocks within a frame, between neighbours and between second neighbours."""

    d: Array
    e: Array
    g: Array


def _solved(errors: Residuals) -> bool:
    """Tell whether all residuals are within the tolerance."""
    return all(error <= bound for error, bound in zip(errors, TOLERANCE, strict=True))


def _add_squares(squares: _Squares, d: Array, e: Array) -> Array:
    """Add squares to the blocks of a matrix.

    Parameters
    ----------
    d, e : (frames, muscles) and (frames - 1, muscles) added to

    Returns
    -------
    (frames - 2, muscles) second blocks beside
    """
    weight = squares.weight
    first, second, third = squares.terms
    d[:-2] += (weight * first * first).sum(axis=0)
    d[1:-1] += (weight * second * second).sum(axis=0)
    d[2:] += (weight * third * third).sum(axis=0)
    e[:-1] += (weight * first * second).sum(axis=0)
    e[1:] += (weight * second * third).sum(axis=0)
    return np.asarray((weight * first * third).sum(axis=0))


def _not_negative(blocks: Blocks) -> Blocks:
    """Nearest symmetric 2 x 2 matrices without a negative eigenvalue."""
    kk, kn, nn = blocks
    mean = 0.5 * (kk + nn)
    half = 0.5 * (kk - nn)
    root = np.sqrt(half * half + kn * kn)
    low = mean - root
    high = mean + root
    bad = low < 0.0
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = np.where(bad, np.where(high > 0.0, high / (high - low), 0.0), 1.0)
    shift = np.where(bad, low, 0.0)
    return Blocks(kk=scale * (kk - shift), kn=scale * kn, nn=scale * (nn - shift))
