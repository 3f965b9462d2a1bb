"""The elastic problem of some muscles over some frames, as arrays.

    minimise    sum_j w_j psi(a_j) + sum_k w_k psi(x_k) + SMOOTH sum_k |f_k+1 - f_k|^2
    subject to  G(f_k, f_k+1, a_j) = 0                      equilibrium between two frames
                B_k f_k + A_k x_k = b_k                     balance of torques at the frames
                a_j + dt lowest(a) <= a_j+1 <= a_j + dt highest(a)
                bounds of a, f and x

with f normalized tendon forces at the frames, a activations between frames and x whatever else the
tension problem has: controls of actuators, amplitudes of contacts, activations of muscles on rigid
tendons, unknowns of rows. psi is the cost of the tension problem, w |.|^p + k dist(., [l, h])^2.
The solver begins at activations whose rates are possible, and the forces that they lead to.
Equilibrium of fibers and tendon is that of

    G(f_k, f_k+1, a) = (f_k + f_k+1) / 2 - P(x, u, a)
    x = L - L_S (s(f_k) + s(f_k+1)) / 2          u = V - L_S (s(f_k+1) - s(f_k)) / dt

with L and V length and velocity of the path between the frames, s(f) the tendon's stretch and P
what the fibers pull with (`muscles.fiber_jets`). The tendon's velocity is the difference of its own
lengths, so that over any time it is as long as its speeds say. Linear systems are banded over
frames and dense in the muscles of a frame.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from myomorph.core.model.arrays import Array
from myomorph.core.muscles.fiber_jets import fiber_jet, tendon_jet
from myomorph.core.muscles.hill import ElasticArrays
from myomorph.core.rigid.kernels import kernel

VALUE = 0
BY_FIRST = 1
BY_SECOND = 2
BY_A = 3
"""Positions in `elements`: G, its slopes over f_k, f_k+1 and a; then kk, kn, nn, ka, na, aa."""


MIN_FORCE = 2.5e-4
MAX_FORCE = 4.0
"""Bounds of the normalized tendon force."""
SMOOTH = 1e-4
"""Cost of a squared change of the normalized tendon force from frame to frame; it keeps forces from
alternating.
"""
START_ROOM = 0.02
"""How far from its bounds an activation begins at least, in shares of their distance."""
NEAR = 1e-2
"""How far from its bounds, in shares of their distance, an unknown begins at least."""


@kernel
def elements(  # page: arrays of a part, and a residual with nine derivatives
    E, own, f, a, lengths, speeds, steps, out
):
    """Fill G and its derivatives of all elements.

    With k and n for the derivatives in f_k and f_k+1 = f_n, and P of `fiber_jet` at (x, u, a), the
    chain rule gives of

        G = (f_k + f_n) / 2 - P,   x_k = -L_S s'(f_k) / 2,   u_k = L_S s'(f_k) / dt,
        x_n = -L_S s'(f_n) / 2,   u_n = -L_S s'(f_n) / dt

        G_k  = 1/2 - P_x x_k - P_u u_k,   G_a = -P_a
        G_kk = -(P_xx x_k^2 + 2 P_xu x_k u_k + P_uu u_k^2 + L_S s''(f_k) (P_u / dt - P_x / 2))
        G_kn = -(P_xx x_k x_n + P_xu (x_k u_n + x_n u_k) + P_uu u_k u_n)
        G_ka = -(P_xa x_k + P_ua u_k),   G_aa = -P_aa

    and likewise in f_n, where P_u / dt has the other sign.

    Parameters
    ----------
    E, own : `ElasticArrays`, and (muscles,) the numbers in it of the muscles of the columns
    f, a : (frames, muscles), (frames - 1, muscles) normalized forces, activations
    lengths, speeds : (frames - 1, muscles) of the paths between frames [m], [m/s]
    steps : (frames - 1,) time between frames [s]
    out : (frames - 1, muscles, 10) filled: G, its slopes over f_k, f_k+1 and a, and its second
        derivatives kk, kn, nn, ka, na, aa
    """
    P = np.empty(10)
    for m in range(own.shape[0]):
        i = own[m]
        slack = E.hill.tendon[i]
        s0, s1, s2 = tendon_jet(E, i, f[0, m])
        for index in range(a.shape[0]):
            n0, n1, n2 = tendon_jet(E, i, f[index + 1, m])
            dt = steps[index]
            x = lengths[index, m] - 0.5 * slack * (s0 + n0)
            u = speeds[index, m] - slack * (n0 - s0) / dt
            fiber_jet(E, i, x, u, a[index, m], P)
            xk = -0.5 * slack * s1
            xn = -0.5 * slack * n1
            uk = slack * s1 / dt
            un = -slack * n1 / dt
            g = out[index, m]
            g[0] = 0.5 * (f[index, m] + f[index + 1, m]) - P[0]
            g[1] = 0.5 - P[1] * xk - P[2] * uk
            g[2] = 0.5 - P[1] * xn - P[2] * un
            g[3] = -P[3]
            bent_k = slack * s2 * (P[2] / dt - 0.5 * P[1])
            bent_n = slack * n2 * (-P[2] / dt - 0.5 * P[1])
            g[4] = -(P[4] * xk * xk + 2.0 * P[5] * xk * uk + P[6] * uk * uk + bent_k)
            g[5] = -(P[4] * xk * xn + P[5] * (xk * un + xn * uk) + P[6] * uk * un)
            g[6] = -(P[4] * xn * xn + 2.0 * P[5] * xn * un + P[6] * un * un + bent_n)
            g[7] = -(P[7] * xk + P[8] * uk)
            g[8] = -(P[7] * xn + P[8] * un)
            g[9] = -P[9]
            s0 = n0
            s1 = n1
            s2 = n2


@kernel
def integrate(  # page: arrays of a part, as of `elements`
    E, own, a, lengths, speeds, steps, least, most, f
):
    """Integrate normalized tendon forces of known activations, by implicit Euler steps.

    They are a start for the solver.

    Parameters
    ----------
    E, own, a, lengths, speeds, steps : as of `elements`
    least, most : bounds of the force
    f : (frames, muscles) filled; the first frame is in equilibrium with a tendon at rest
    """
    P = np.empty(10)
    for m in range(own.shape[0]):
        i = own[m]
        slack = E.hill.tendon[i]
        force = 0.2
        s0 = 0.0
        for index in range(-1, a.shape[0]):
            j = max(index, 0)
            rate = 0.0 if index < 0 else 1.0 / steps[j]
            low = least
            high = most
            for _ in range(30):
                s, s1, _ = tendon_jet(E, i, force)
                fiber_jet(
                    E,
                    i,
                    lengths[j, m] - slack * s,
                    speeds[j, m] - slack * (s - s0) * rate,
                    a[j, m],
                    P,
                )
                left = force - P[0]
                if left > 0.0:
                    high = force
                else:
                    low = force
                slope = 1.0 + slack * s1 * (P[1] + P[2] * rate)
                new = force - left / slope if slope > 0.0 else low
                if not low < new < high:
                    new = 0.5 * (low + high)
                done = abs(new - force) < 1e-3
                force = new
                if done:
                    break
            f[index + 1, m] = force
            s0, _, _ = tendon_jet(E, i, force)


class CostTerms(NamedTuple):
    """The cost at a point, and its slopes and curvatures, (rows, columns) each."""

    cost: float
    slope: Array
    bend: Array


@dataclass(eq=False)
class Costs:
    """sum w |v|^p + k dist(v, [l, h])^2 of unknowns (columns) at points of time (rows).

    Attributes
    ----------
    weight, exponent, lower, upper : (columns,)
    penalty : (3, rows, columns) l, h and k
    share : (rows, 1) part of the time that a row stands for
    """

    weight: Array
    exponent: Array
    lower: Array
    upper: Array
    penalty: Array
    share: Array

    def terms(self, v: Array) -> CostTerms:
        """Cost, slopes and curvatures at a point.

        Parameters
        ----------
        v : (rows, columns)

        Returns
        -------
        (rows, columns) slopes and curvatures, with the cost
        """
        size = np.abs(v)
        low, high, pull = self.penalty
        over = v - np.clip(v, low, high)
        if np.all(self.exponent == 2.0):
            cost = self.weight * v * v
            slope = 2.0 * self.weight * v
            bend = np.broadcast_to(2.0 * self.weight, v.shape)
        else:
            p = self.exponent
            w = self.weight
            cost = w * size**p
            slope = p * w * np.sign(v) * size ** (p - 1.0)
            bend = p * (p - 1.0) * w * np.maximum(size, 1e-3) ** (p - 2.0)
        cost = cost + pull * over * over
        slope = slope + 2.0 * pull * over
        bend = bend + 2.0 * pull * (over != 0.0)
        return CostTerms(
            cost=float((self.share * cost).sum()),
            slope=self.share * slope,
            bend=self.share * bend,
        )


class RateBounds(NamedTuple):
    """Bounds of the rate of activation, with slopes and curvatures over a; as a, each.

    Attributes
    ----------
    high, high_slope, high_bend : highest rate [1/s]
    low, low_slope, low_bend : lowest rate, below 0 [1/s]
    """

    high: Array
    high_slope: Array
    high_bend: Array
    low: Array
    low_slope: Array
    low_bend: Array


@dataclass(eq=False)
class Rates:
    """Bounds of the rate of activation, and how the class of each muscle makes them.

    Excitation e from 0 to 1 lets activation change by -low(a) to high(a),

        high = (1 - a) / (tau_a (0.5 + 1.5 a)),   low = a (0.5 + 1.5 a) / tau_d

    (Thelen 2003 after Winters 1995); smoothly switched by De Groote's class between the two.

    Attributes
    ----------
    rise, fall : (muscles,) tau_a, tau_d [s]
    smooth : (muscles,) whether the two are switched smoothly
    """

    rise: Array
    fall: Array
    smooth: NDArray[np.bool_]

    def bounds(self, a: Array) -> RateBounds:
        """Highest and lowest rates at activations.

        Parameters
        ----------
        a : (..., muscles)

        Returns
        -------
        rates [1/s], their slopes and curvatures, (..., muscles) each
        """
        slow = 0.5 + 1.5 * a
        up = 1.0 / (self.rise * slow)
        down = slow / self.fall
        up1 = -1.5 * up / slow
        down1 = 1.5 / self.fall
        up2 = 4.5 * up / slow**2
        # Of the switch f the share up is 0.5 + f.
        at_one = np.where(self.smooth, 0.5 * np.tanh(10.0 * (1.0 - a)), 0.5)
        at_zero = np.where(self.smooth, -0.5 * np.tanh(10.0 * a), -0.5)

        def rate(f: Array, e: float) -> tuple[Array, Array, Array]:
            f1 = np.where(self.smooth, -5.0 * (1.0 - 4.0 * f**2), 0.0)
            speed = (0.5 + f) * up + (0.5 - f) * down
            speed1 = f1 * (up - down) + (0.5 + f) * up1 + (0.5 - f) * down1
            speed2 = 40.0 * f * f1 * (up - down) + 2.0 * f1 * (up1 - down1) + (0.5 + f) * up2
            return speed * (e - a), speed1 * (e - a) - speed, speed2 * (e - a) - 2.0 * speed1

        high, high_slope, high_bend = rate(at_one, 1.0)
        low, low_slope, low_bend = rate(at_zero, 0.0)
        return RateBounds(
            high=high,
            high_slope=high_slope,
            high_bend=high_bend,
            low=low,
            low_slope=low_slope,
            low_bend=low_bend,
        )


@dataclass(eq=False)
class Program:
    """The problem of one part, as the solver reads it.

    Attributes
    ----------
    arrays, own : of the muscles, and the numbers in it of those of the columns
    steps : (frames - 1,) [s]
    lengths, speeds : (frames - 1, muscles) of the paths between frames [m], [m/s]
    pulls, columns : B (frames, rows, muscles) and A (frames, rows, others)
    right : (frames, rows) b
    activation, other : costs and bounds of a and x
    rates : None where activation may jump
    """

    arrays: ElasticArrays
    own: NDArray[np.int64]
    steps: Array
    lengths: Array
    speeds: Array
    pulls: Array
    columns: Array
    right: Array
    activation: Costs
    other: Costs
    rates: Rates | None


@dataclass(eq=False)
class Point:
    """A point of the solver.

    Attributes
    ----------
    f : (frames, muscles) normalized tendon forces
    a : (frames - 1, muscles) activations
    x : (frames, others) other unknowns
    """

    f: Array
    a: Array
    x: Array


def possible(program: Program, a: Array) -> Array:
    """Move activations well inside their bounds, and to rates that are possible.

    Parameters
    ----------
    program : the problem of a part
    a : (frames - 1, muscles)

    Returns
    -------
    (frames - 1, muscles)
    """
    low = program.activation.lower
    high = program.activation.upper
    room = START_ROOM * (high - low)
    a = np.clip(a, low + room, high - room)
    if program.rates is None:
        return a
    between = 0.5 * (program.steps[1:] + program.steps[:-1])
    for index, dt in enumerate(between):
        bounds = program.rates.bounds(a[index])
        # Half of the rate at the beginning of the step, so that at its middle it is possible too.
        a[index + 1] = np.clip(
            a[index + 1],
            a[index] + 0.5 * np.maximum(dt * bounds.low, -a[index]),
            a[index] + 0.5 * np.minimum(dt * bounds.high, 1.0 - a[index]),
        )
    return a


def integrated(program: Program, a: Array) -> Array:
    """Integrate the tendon forces that activations lead to.

    Parameters
    ----------
    program : the problem of a part
    a : (frames - 1, muscles)

    Returns
    -------
    (frames, muscles) normalized
    """
    f = np.empty((len(a) + 1, a.shape[1]))
    inputs = (program.lengths, program.speeds, program.steps)
    integrate(program.arrays, program.own, a, *inputs, 2.0 * MIN_FORCE, 0.5 * MAX_FORCE, f)
    return f


class Distances(NamedTuple):
    """Distances of unknowns from their lower and upper bounds, 1 of an infinite one."""

    down: Array
    up: Array


class Box:
    """Unknowns between bounds, which may be infinite, with multipliers.

    Arrays have the shape of the unknowns v.

    Attributes
    ----------
    low, high : bounds
    z, w : multipliers of the lower and the upper bound, 0 of an infinite one
    """

    def __init__(self, low: Array, high: Array, v: Array, mu: float):
        """Begin with the barrier's own multipliers; low and high are broadcast to v."""
        self.low = np.broadcast_to(low, v.shape)
        self.high = np.broadcast_to(high, v.shape)
        self.below = np.isfinite(self.low)
        self.above = np.isfinite(self.high)
        self._both = bool(self.below.all() and self.above.all())
        self._known: list[tuple[Array, Distances]] = []
        down, up = self._distances(v)
        self.z = np.where(self.below, mu / down, 0.0)
        self.w = np.where(self.above, mu / up, 0.0)

    def _distances(self, v: Array) -> Distances:
        """Distances to the bounds; of the last two points they are kept."""
        for known, distances in self._known:
            if known is v:
                return distances
        down = v - self.low
        up = self.high - v
        if not self._both:
            down = np.where(self.below, down, 1.0)
            up = np.where(self.above, up, 1.0)
        distances = Distances(down, up)
        self._known = [*self._known[-1:], (v, distances)]
        return distances

    @staticmethod
    def inside(low: Array, high: Array, v: Array) -> Array:
        """Move values off their bounds.

        Parameters
        ----------
        low, high : bounds, broadcast to v
        v : values

        Returns
        -------
        as v
        """
        span = np.where(np.isfinite(high - low), high - low, 1.0)
        gap = np.minimum(NEAR * np.maximum(1.0, np.abs(v)), NEAR * span)
        return np.where(v - low < gap, low + gap, np.where(high - v < gap, high - gap, v))

    def force(self) -> Array:
        """Add the bounds' multipliers up, as they stand in the gradient of the Lagrangian.

        Returns
        -------
        as v
        """
        return self.w - self.z

    def barrier(self, v: Array, mu: float) -> tuple[Array, Array]:
        """Gradient of the barrier, and the curvature of a primal-dual step.

        Parameters
        ----------
        v : the unknowns
        mu : barrier parameter

        Returns
        -------
        as v, both
        """
        distances = self._distances(v)
        down = 1.0 / distances.down
        up = 1.0 / distances.up
        pushed = up - down if self._both else up * self.above - down * self.below
        return mu * pushed, self.z * down + self.w * up

    def logs(self, v: Array) -> float:
        """Sum of the logarithms of the distances to the bounds.

        Parameters
        ----------
        v : the unknowns

        Returns
        -------
        -inf outside the bounds
        """
        down, up = self._distances(v)
        if not (down.min(initial=1.0) > 0.0 and up.min(initial=1.0) > 0.0):
            return -np.inf
        return float(np.log(down).sum() + np.log(up).sum())

    def complementarity(self, v: Array, mu: float) -> float:
        """Greatest difference of a multiplier times its distance from the barrier parameter.

        Parameters
        ----------
        v : the unknowns
        mu : barrier parameter

        Returns
        -------
        0 at the barrier's own multipliers
        """
        down, up = self._distances(v)
        at_low = np.abs(self.z * down - mu)
        at_high = np.abs(self.w * up - mu)
        if not self._both:
            at_low = at_low * self.below
            at_high = at_high * self.above
        return float(max(at_low.max(initial=0.0), at_high.max(initial=0.0)))

    def changes(self, v: Array, dv: Array, mu: float) -> tuple[Array, Array]:
        """Newton steps of the multipliers z and w.

        Parameters
        ----------
        v, dv : the unknowns and their step
        mu : barrier parameter

        Returns
        -------
        as v, both
        """
        down, up = self._distances(v)
        dz = (mu - self.z * dv) / down - self.z
        dw = (mu + self.w * dv) / up - self.w
        if self._both:
            return dz, dw
        return np.where(self.below, dz, 0.0), np.where(self.above, dw, 0.0)

    def reach(self, v: Array, dv: Array, share: float) -> float:
        """Longest step that keeps a share of the distance to the bounds.

        Parameters
        ----------
        v, dv : the unknowns and their step
        share : of the distance that may be used up

        Returns
        -------
        0 to 1
        """
        down, up = self._distances(v)
        to_low = dv / down
        to_high = dv / up
        if not self._both:
            to_low = to_low * self.below
            to_high = to_high * self.above
        worst = max(-float(to_low.min(initial=0.0)), float(to_high.max(initial=0.0)))
        return min(1.0, share / worst) if worst > 0.0 else 1.0

    def dual_reach(self, dz: Array, dw: Array, share: float) -> float:
        """Longest step that keeps a share of the multipliers.

        Parameters
        ----------
        dz, dw : steps of the multipliers
        share : of the multipliers that may be used up

        Returns
        -------
        0 to 1
        """
        if self._both:
            worst = -min(
                float((dz / self.z).min(initial=0.0)), float((dw / self.w).min(initial=0.0))
            )
        else:
            worst = max(
                float((-dz / np.where(self.z > 0.0, self.z, 1.0)).max(initial=0.0)),
                float((-dw / np.where(self.w > 0.0, self.w, 1.0)).max(initial=0.0)),
            )
        return min(1.0, share / worst) if worst > 0.0 else 1.0

    def keep_near(self, v: Array, mu: float) -> None:
        """Clip multipliers into a wide corridor about the barrier's own.

        Parameters
        ----------
        v : the unknowns
        mu : barrier parameter
        """
        distances = self._distances(v)
        down = mu / distances.down
        up = mu / distances.up
        self.z = np.clip(self.z, down / 1e10, down * 1e10)
        self.w = np.clip(self.w, up / 1e10, up * 1e10)
        if not self._both:
            self.z = np.where(self.below, self.z, 0.0)
            self.w = np.where(self.above, self.w, 0.0)


@kernel
def _fill(d, e, g, C, band):
    """Fill the transpose of the lower band of the matrix.

    Parameters
    ----------
    d, e, g : (frames, muscles), (frames - 1, muscles), (frames - 2, muscles) diagonals of the
        blocks within a frame, between neighbours and between second neighbours
    C : (frames, rows, muscles) whose C^T C is added within frames
    band : (unknowns, width + 1) filled
    """
    frames, count = d.shape
    rows = C.shape[1]
    for index in range(frames):
        for i in range(count):
            column = band[index * count + i]
            for j in range(column.shape[0]):
                column[j] = 0.0
            for r in range(rows):
                left = C[index, r, i]
                if left != 0.0:
                    for j in range(i, count):
                        column[j - i] += left * C[index, r, j]
            column[0] += d[index, i]
            if index + 1 < frames:
                column[count] += e[index, i]
            if index + 2 < frames and g.shape[0] > 0:
                column[2 * count] += g[index, i]


class BandSystem:
    """A matrix over frames and muscles, factorized.

    Its blocks between frames are diagonal, d, e and g of `factorize`; those within a frame have C^T
    C besides.
    """

    def __init__(self, frames: int, muscles: int, second: bool):
        self.shape = (frames, muscles)
        width = min((2 if second else 1) * muscles, max(frames - 1, 0) * muscles)
        self._band = np.empty((frames * muscles, width + 1))
        self._factor = self._band.T

    def factorize(self, d: Array, e: Array, g: Array, C: Array) -> bool:
        """Factorize the matrix; tells whether it is positive definite.

        Parameters
        ----------
        d, e, g, C : as of `_fill`

        Returns
        -------
        whether it can be solved with
        """
        _fill(d, e, g, C, self._band)
        self._factor, info = scipy.linalg.lapack.dpbtrf(self._band.T, lower=1, overwrite_ab=1)
        return bool(info == 0)

    def solve(self, right: Array) -> Array:
        """Solve with the factor.

        Parameters
        ----------
        right : (frames, muscles)

        Returns
        -------
        (frames, muscles)
        """
        result, _ = scipy.linalg.lapack.dpbtrs(self._factor, right.reshape(-1), lower=1)
        return result.reshape(self.shape)
