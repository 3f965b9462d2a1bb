"""The elastic problem by an interior-point method with exact curvature, each step exploiting its
structure.

Activations, slacks and all other unknowns of a frame are eliminated from the Newton system, and
with them the multipliers of the balance; what is left are the tendon forces, f (frames, muscles),
whose matrix is banded over frames. The curvature of each equilibrium counts as far as it is not
negative, so that every step descends; a filter accepts steps (Waechter and Biegler 2006;
primal-dual interior-point methods: Nocedal and Wright 2006, ch. 19).
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

# Slack of the balance per multiplier: where no activation can balance, torques are missed least
SLACK = 1e-6
FIRST = 1e-2
# Barrier parameter at the beginning and at the end, in units of the effort a^2 of one muscle
LAST = 1e-6
# Residuals of the gradient, of bounds and of constraints at which the problem is solved
TOLERANCE = (5e-4, 1e-5, 1e-5)
ENOUGH = 50.0  # Residual, in units of the barrier parameter, at which that is made smaller
NEAR_SLOPE = 1.0  # Residual of the gradient from which on the curvature of the rates' bounds counts
STEPS = 500
# Weight on keeping the forces from which on no step will be found: constraints contradict each
# other there
STUCK = 1.0
RESTARTS = 6  # How often the solver begins anew from the forces that its activations lead to


class Outcome(NamedTuple):
    """How the solver ended."""

    residual: float  # greatest KKT residual
    equilibrium: float  # greatest difference of tendon and fiber force, normalized
    # steps, solved: iterations, whether the tolerance was met
    steps: int
    solved: bool
    # root mean square distance of activations and of forces from another start's, NaN where none
    # was asked for
    far: tuple[float, float] = (np.nan, np.nan)


@dataclass(eq=False)
class Linearized:
    """The problem at a point: what a step is made of."""

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
    """One program, solved from one start."""

    def __init__(self, program: Program, start: Point, y: Array):
        p = self.p = program
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
        effort = (p.activation.terms(start.a)[0] + p.other.terms(start.x)[0]) / len(start.f)
        mu = self.mu = FIRST * float(np.clip(effort, 1.0, 1e3))
        forces = (np.asarray(MIN_FORCE), np.asarray(MAX_FORCE))
        bounds = (forces, (p.activation.lower, p.activation.upper), (p.other.lower, p.other.upper))
        self.v = [
            Box.inside(*ends, v)
            for ends, v in zip(bounds, (start.f, start.a, start.x), strict=True)
        ]
        self.boxes = [Box(*ends, v, mu) for ends, v in zip(bounds, self.v, strict=True)]
        if self.second:
            s = np.maximum(self._rates(self.v[1])[0], NEAR)
            self.v.append(s)
            self.boxes.append(Box(np.asarray(0.0), np.asarray(np.inf), s, mu))
        self.filter: list[tuple[float, float]] = []

    def _rates(self, a: Array) -> tuple[Array, Array, Array]:
        """Room to the rates' bounds (2, frames - 2, muscles), slopes (2, 2, ...) over both a, bends
        over their sum.
        """
        assert self.p.rates is not None
        up, up1, up2, low, low1, low2 = self.p.rates.bounds(0.5 * (a[1:] + a[:-1]))
        dt = self.between
        change = a[1:] - a[:-1]
        room = np.stack([dt * up - change, change - dt * low])
        half_up = 0.5 * dt * up1
        half_low = 0.5 * dt * low1
        slopes = np.stack(
            [np.stack([half_up + 1.0, half_up - 1.0]), np.stack([-half_low - 1.0, 1.0 - half_low])]
        )
        return room, slopes, 0.25 * np.stack([dt * up2, -dt * low2])

    def _balance(self, f: Array, x: Array, y: Array) -> Array:
        p = self.p
        held = (
            np.matmul(p.pulls, f[:, :, None])[..., 0] + np.matmul(p.columns, x[:, :, None])[..., 0]
        )
        return p.right - held - SLACK * y

    def linearize(self, v: list[Array], y: Array) -> Linearized:
        """The problem at a point."""
        p = self.p
        f, a, x = v[:3]
        g = np.empty((*a.shape, 10))
        elements(p.arrays, p.own, f, a, p.lengths, p.speeds, p.steps, g)
        cost_a, slope_a, bend_a = p.activation.terms(a)
        cost_x, slope_x, bend_x = p.other.terms(x)
        none = (np.zeros((2, 0, 0)), np.zeros((2, 2, 0, 0)), np.zeros((2, 0, 0)))
        rate, *rate_curves = self._rates(a) if self.second else none
        if self.second:
            rate = rate - v[3]
        cost = cost_a + cost_x + SMOOTH * float((np.diff(f, axis=0) ** 2).sum())
        return Linearized(
            g,
            cost,
            slope_a,
            bend_a,
            slope_x,
            bend_x,
            self._balance(f, x, self.y),
            rate,
            *rate_curves,
        )

    def multipliers(self, at: Linearized) -> tuple[Array, Array]:
        """Slope of the Lagrangian without equilibrium over a, and the multipliers of equilibrium."""
        slope = at.slope_a + self.boxes[1].force()
        if self.second:
            z = self.boxes[3].z
            slope[:-1] -= (at.rate_slopes[:, 0] * z).sum(axis=0)
            slope[1:] -= (at.rate_slopes[:, 1] * z).sum(axis=0)
        return slope, -slope / at.g[..., 3]

    def _smooth_slope(self, f: Array) -> Array:
        change = 2.0 * SMOOTH * np.diff(f, axis=0)
        result = np.zeros_like(f)
        result[1:] += change
        result[:-1] -= change
        return result

    def errors(self, at: Linearized, mu: float) -> tuple[float, float, float]:
        """Residuals of the gradient (relative to the mean slope of the cost over forces), of
        bounds, of constraints.
        """
        f = self.v[0]
        _, multiplier = self.multipliers(at)
        pulled = np.matmul(self.y[:, None], self.p.pulls)[:, 0]
        dual = self._smooth_slope(f) + self.boxes[0].force() - pulled
        dual[:-1] += multiplier * at.g[..., 1]
        dual[1:] += multiplier * at.g[..., 2]
        dual_x = (
            at.slope_x + self.boxes[2].force() - np.matmul(self.y[:, None], self.p.columns)[:, 0]
        )
        both = max(
            np.abs(dual).max(initial=0.0),
            np.abs(dual_x / (1.0 + np.sqrt(at.bend_x))).max(initial=0.0),
        )
        scale = 1.0 + float(np.abs(pulled).mean())
        complementarity = max(
            box.complementarity(v, mu) for box, v in zip(self.boxes, self.v, strict=True)
        )
        return (
            float(both) / scale,
            complementarity,
            self._infeasible(at.g[..., 0], at.balance, at.rate)[1],
        )

    def _infeasible(self, g: Array, balance: Array, rate: Array) -> tuple[float, float]:
        """Sum and greatest of what the constraints miss."""
        parts = [np.abs(values) for values in (g, balance * self.row_scale, rate)]
        return float(sum(part.sum() for part in parts)), float(
            max(part.max(initial=0.0) for part in parts)
        )

    def step(self, at: Linearized, shift: float) -> tuple[list[Array], Array] | None:
        """Newton step of f, a, x and slacks, and of y; None where the matrix is not positive
        definite.
        """
        p = self.p
        mu = self.mu
        f, a, x = self.v[:3]
        g = at.g
        _, lam = self.multipliers(at)
        barrier_a, bend_a = self.boxes[1].barrier(a, mu)
        ga = at.slope_a + barrier_a
        da = at.bend_a + bend_a
        c = -g[..., 0] / g[..., 3]
        pk = -g[..., 1] / g[..., 3]
        pn = -g[..., 2] / g[..., 3]
        barrier_f, d = self.boxes[0].barrier(f, mu)
        gf = self._smooth_slope(f) + barrier_f - np.matmul(self.y[:, None], p.pulls)[:, 0]
        d = d + shift + 4.0 * SMOOTH
        d[0] -= 2.0 * SMOOTH
        d[-1] -= 2.0 * SMOOTH
        e = np.full((self.frames - 1, self.muscles), -2.0 * SMOOTH)
        second = np.zeros((0, 0))
        bent_rates = None
        if self.second:
            second, bent_rates = self._add_rates(at, (c, pk, pn), gf, d, e)
        kk = da * pk * pk + lam * (g[..., 4] + (2.0 * g[..., 7] + g[..., 9] * pk) * pk)
        kn = da * pk * pn + lam * (
            g[..., 5] + g[..., 7] * pn + g[..., 8] * pk + g[..., 9] * pk * pn
        )
        nn = da * pn * pn + lam * (g[..., 6] + (2.0 * g[..., 8] + g[..., 9] * pn) * pn)
        reduced = ga + (da + lam * g[..., 9]) * c
        gf[:-1] += pk * reduced + lam * g[..., 7] * c
        gf[1:] += pn * reduced + lam * g[..., 8] * c
        barrier_x, bend_x = self.boxes[2].barrier(x, mu)
        dx = at.bend_x + bend_x + 1e-12
        gx = at.slope_x + barrier_x - np.matmul(self.y[:, None], p.columns)[:, 0]
        soft = np.matmul(p.columns / dx[:, None], p.columns.transpose(0, 2, 1))
        soft += SLACK * np.eye(soft.shape[1])
        lower = np.linalg.cholesky(soft)
        missed = at.balance + np.matmul(p.columns, (gx / dx)[:, :, None])[..., 0]
        both = np.linalg.solve(lower, np.concatenate([p.pulls, missed[:, :, None]], axis=2))
        C = both[:, :, :-1]
        t = both[:, :, -1]
        if not self._factorized((d, e, second), (kk, kn, nn), bent_rates, C):
            return None
        df = self.band.solve(np.matmul(t[:, None], C)[:, 0] - gf)
        left = t - np.matmul(C, df[:, :, None])[..., 0]
        dy = np.linalg.solve(lower.transpose(0, 2, 1), left[:, :, None])[..., 0]
        da_ = c + pk * df[:-1] + pn * df[1:]
        step = [df, da_, (np.matmul(dy[:, None], p.columns)[:, 0] - gx) / dx]
        if self.second:
            step.append(at.rate + at.rate_slopes[:, 0] * da_[:-1] + at.rate_slopes[:, 1] * da_[1:])
        return step, dy

    def _factorized(
        self,
        matrix: tuple[Array, Array, Array],
        bends: tuple[Array, Array, Array],
        rates: tuple[Array, Array] | None,
        C: Array,
    ) -> bool:
        """Factorize with the exact curvature, or with that of each constraint as far as it is not
        negative.
        """
        clipped = None if rates is None else (np.maximum(rates[0], 0.0), rates[1])
        for (kk, kn, nn), bent in ((bends, rates), (_not_negative(*bends), clipped)):
            d = matrix[0].copy()
            e = matrix[1] + kn
            second = matrix[2]
            d[:-1] += kk
            d[1:] += nn
            if bent is not None:
                second = second + _add_squares(bent[0], bent[1], d, e)
            if self.band.factorize(d, e, second, C):
                return True
            self.bent += 1
        return False

    def _add_rates(
        self, at: Linearized, by_force: tuple[Array, Array, Array], gf: Array, d: Array, e: Array
    ) -> tuple[Array, tuple[Array, Array]]:
        """Add the rates' part of the gradient to gf and of the matrix to d and e.
        Returns the second blocks beside, and weights and terms of `_add_squares` for the curvature
        of the bounds.
        """
        c, pk, pn = by_force
        s = self.v[3]
        z = self.boxes[3].z
        stiff = z / s
        # By multipliers that are not yet right, curvature would mislead.
        bend = -(z * at.rate_bends).sum(axis=0, keepdims=True) * self.near
        one = at.rate_slopes[:, 0]
        other = at.rate_slopes[:, 1]
        # The gradient at c = 0 of a; the step of the elements adds what c is to their own part
        # alone.
        pull = stiff * (one * c[:-1] + other * c[1:]) - (self.mu / s - stiff * at.rate)
        drift = bend[0] * (c[:-1] + c[1:])
        first = (one * pull).sum(axis=0) + drift
        last = (other * pull).sum(axis=0) + drift
        gf[:-2] += pk[:-1] * first
        gf[1:-1] += pn[:-1] * first + pk[1:] * last
        gf[2:] += pn[1:] * last
        second = _add_squares(
            stiff, np.stack([one * pk[:-1], one * pn[:-1] + other * pk[1:], other * pn[1:]]), d, e
        )
        return second, (bend, np.stack([pk[:-1], pn[:-1] + pk[1:], pn[1:]])[:, None])

    def merit(self, v: list[Array], y: Array, at: Linearized) -> tuple[float, float]:
        """What the constraints miss, and the cost with the barrier."""
        logs = sum(box.logs(item) for box, item in zip(self.boxes, v, strict=True))
        missed = self._infeasible(at.g[..., 0], at.balance, at.rate)[0]
        if not np.isfinite(missed + at.cost + logs):
            return np.inf, np.inf
        # The slack of the balance has its own cost, which the multipliers stand for.
        return missed, at.cost - self.mu * logs + 0.5 * SLACK * float((y * y).sum())

    def slope(self, at: Linearized, step: list[Array], dy: Array) -> float:
        """Slope of the cost with the barrier along a step."""
        grads = [self._smooth_slope(self.v[0]), at.slope_a, at.slope_x, np.zeros(1)]
        total = SLACK * float((self.y * dy).sum())
        for box, v, dv, grad in zip(self.boxes, self.v, step, grads, strict=False):
            total += float(((grad + box.barrier(v, self.mu)[0]) * dv).sum())
        return total

    def advance(self, at: Linearized, step: list[Array], dy: Array) -> Linearized | None:
        """Take a step as far as the filter accepts: the problem there, None where it accepts none."""
        share = max(0.99, 1.0 - self.mu)
        top = min(
            box.reach(v, dv, share) for box, v, dv in zip(self.boxes, self.v, step, strict=True)
        )
        missed, value = self.merit(self.v, self.y, at)
        slope = self.slope(at, step, dy)
        length = top
        result = None
        rounding = 1e-12 * (1.0 + abs(value))
        for _ in range(14):
            v = [item + length * dv for item, dv in zip(self.v, step, strict=True)]
            y = self.y + length * dy
            there = self.linearize(v, y)
            now_missed, now = self.merit(v, y, there)
            ahead = all(
                now_missed <= (1.0 - 1e-5) * t or now <= p - 1e-5 * t + rounding
                for t, p in self.filter
            )
            if np.isfinite(now) and ahead:
                armijo = slope < 0.0 and missed <= 1e-4 and length * -slope > missed
                if armijo and now <= value + 1e-4 * length * slope + rounding:
                    result = v, y, there
                    break
                if not armijo and (
                    now_missed <= (1.0 - 1e-5) * missed + 1e-14 or now <= value - 1e-5 * missed
                ):
                    self.filter.append((missed, value))
                    result = v, y, there
                    break
            length *= 0.5
        if result is None:
            return None
        pairs = [
            box.changes(v, dv, self.mu) for box, v, dv in zip(self.boxes, self.v, step, strict=True)
        ]
        dual = min(
            box.dual_reach(*pair, share) for box, pair in zip(self.boxes, pairs, strict=True)
        )
        self.v, self.y, there = result
        for box, (dz, dw), item in zip(self.boxes, pairs, self.v, strict=True):
            box.z = box.z + dual * dz
            box.w = box.w + dual * dw
            box.keep_near(item, self.mu)
        self.taken = length
        return there

    def solve(self) -> tuple[Point, Outcome]:
        """Follow the barrier down to the solution: forces, activations and others, and how near
        they are to it.
        """
        shift = 0.0
        steps = 0
        restarts = 0
        errors = (np.inf, np.inf, np.inf)
        at = self.linearize(self.v, self.y)
        for _ in range(STEPS):
            steps += 1
            while True:
                errors = self.errors(at, self.mu)
                if max(errors) > ENOUGH * self.mu or self.mu <= LAST:
                    break
                self.mu = max(LAST, min(0.2 * self.mu, self.mu**1.5))
                self.filter = []
            self.near = errors[0] < NEAR_SLOPE
            if self.mu <= LAST and _solved(errors):
                break
            result = self.step(at, shift)
            there = None if result is None else self.advance(at, *result)
            if there is None:
                shift = max(4.0 * shift, 1e-4)
                if shift > STUCK and restarts == RESTARTS:
                    break
                if shift > STUCK:
                    # Equilibrium and rates of activation want different steps: both hold on the way
                    # that is integrated.
                    shift = 0.0
                    restarts = restarts + 1
                    a = possible(self.p, self.v[1])
                    self._begin(Point(integrated(self.p, a), a, self.v[2]))
                    at = self.linearize(self.v, self.y)
                continue
            shift = shift / 4.0 if shift > 1e-4 else 0.0
            at = there
        residual = max(self.errors(at, 0.0)[0], errors[2])
        equilibrium = float(np.abs(at.g[..., 0]).max(initial=0.0))
        return Point(*self.v[:3]), Outcome(
            residual=max(residual, errors[1]),
            equilibrium=equilibrium,
            steps=steps,
            solved=_solved(errors),
        )


def _solved(errors: tuple[float, float, float]) -> bool:
    return all(error <= most for error, most in zip(errors, TOLERANCE, strict=True))


def _add_squares(weight: Array, terms: Array, d: Array, e: Array) -> Array:
    """Add weighted squares of sums over the forces of three frames to the blocks of a matrix; its
    second blocks beside. `weight` (squares, frames - 2, muscles); `terms` (3, squares, frames - 2,
    muscles) slopes of the sums over the forces of each frame.
    """
    one, two, three = terms
    d[:-2] += (weight * one * one).sum(axis=0)
    d[1:-1] += (weight * two * two).sum(axis=0)
    d[2:] += (weight * three * three).sum(axis=0)
    e[:-1] += (weight * one * two).sum(axis=0)
    e[1:] += (weight * two * three).sum(axis=0)
    return np.asarray((weight * one * three).sum(axis=0))


def _not_negative(kk: Array, kn: Array, nn: Array) -> tuple[Array, Array, Array]:
    """The nearest symmetric 2 x 2 matrices without a negative eigenvalue."""
    mean = 0.5 * (kk + nn)
    half = 0.5 * (kk - nn)
    root = np.sqrt(half * half + kn * kn)
    low = mean - root
    high = mean + root
    bad = low < 0.0
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = np.where(bad, np.where(high > 0.0, high / (high - low), 0.0), 1.0)
    shift = np.where(bad, low, 0.0)
    return scale * (kk - shift), scale * kn, scale * (nn - shift)
