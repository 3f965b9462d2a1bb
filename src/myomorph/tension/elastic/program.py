"""The elastic problem of some muscles over some frames, as arrays.

    minimise    sum_j w_j psi(a_j) + sum_k w_k psi(x_k) + SMOOTH sum_k |f_k+1 - f_k|^2
    subject to  G(f_k, f_k+1, a_j) = 0                      equilibrium of fibers and tendon between two frames
                B_k f_k + A_k x_k = b_k                     balance of torques at the frames
                a_j + dt lowest(a) <= a_j+1 <= a_j + dt highest(a)
                bounds of a, f and x

with f normalized tendon forces at the frames, a activations between frames and x whatever else the tension problem
has: controls of actuators, amplitudes of contacts, activations of muscles on rigid tendons, unknowns of rows. psi is
the cost of the tension problem, w |.|^p + k dist(., [l, h])^2. The solver begins at activations whose rates are
possible, and the forces that they lead to.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from myomorph.model.arrays import Array
from myomorph.muscles.hill_arrays import ElasticArrays
from myomorph.tension.elastic.elements import integrate

MIN_FORCE, MAX_FORCE = 2.5e-4, 4.0  # Bounds of the normalized tendon force
SMOOTH = 1e-4
"""Cost of a squared change of the normalized tendon force from frame to frame; it keeps forces from alternating."""


@dataclass(eq=False)
class Costs:
    """sum w |v|^p + k dist(v, [l, h])^2 of unknowns (columns) over points of time (rows), and bounds."""

    # weight, exponent, lower, upper: (columns,)
    weight: Array
    exponent: Array
    lower: Array
    upper: Array
    penalty: Array  # (3, rows, columns) l, h and k
    share: Array  # (rows, 1) part of the time that a row stands for

    def terms(self, v: Array) -> tuple[float, Array, Array]:
        """The cost, its slopes and its curvatures."""
        size = np.abs(v)
        low, high, pull = self.penalty
        over = v - np.clip(v, low, high)
        if np.all(self.exponent == 2.0):
            cost, slope, bend = self.weight * v * v, 2.0 * self.weight * v, np.broadcast_to(2.0 * self.weight, v.shape)
        else:
            p, w = self.exponent, self.weight
            cost, slope = w * size**p, p * w * np.sign(v) * size ** (p - 1.0)
            bend = p * (p - 1.0) * w * np.maximum(size, 1e-3) ** (p - 2.0)
        cost, slope = cost + pull * over * over, slope + 2.0 * pull * over
        bend = bend + 2.0 * pull * (over != 0.0)
        return float((self.share * cost).sum()), self.share * slope, self.share * bend


@dataclass(eq=False)
class Rates:
    """Bounds of the rate of activation [1/s], and how the class of each muscle makes them.
    Excitation from 0 to 1 lets activation change by -low(a) to high(a): (1 - a) / (tau_a (0.5 + 1.5 a)) and
    a (0.5 + 1.5 a) / tau_d (Thelen 2003 after Winters 1995); smoothly switched by De Groote's class between the two.
    """

    rise: Array
    fall: Array
    smooth: NDArray[np.bool_]

    def bounds(self, a: Array) -> tuple[Array, Array, Array, Array, Array, Array]:
        """Highest rate, its slope and curvature over a; lowest rate (below 0), its slope and curvature."""
        slow = 0.5 + 1.5 * a
        up, down = 1.0 / (self.rise * slow), slow / self.fall
        up1, down1 = -1.5 * up / slow, 1.5 / self.fall
        up2 = 4.5 * up / slow**2
        at_one = np.where(self.smooth, 0.5 * np.tanh(10.0 * (1.0 - a)), 0.5)
        at_zero = np.where(self.smooth, -0.5 * np.tanh(10.0 * a), -0.5)
        one1 = np.where(self.smooth, -5.0 * (1.0 - 4.0 * at_one**2), 0.0)
        zero1 = np.where(self.smooth, -5.0 * (1.0 - 4.0 * at_zero**2), 0.0)

        def rate(f: Array, f1: Array, e: float) -> tuple[Array, Array, Array]:
            speed = (0.5 + f) * up + (0.5 - f) * down
            speed1 = f1 * (up - down) + (0.5 + f) * up1 + (0.5 - f) * down1
            speed2 = 40.0 * f * f1 * (up - down) + 2.0 * f1 * (up1 - down1) + (0.5 + f) * up2
            return speed * (e - a), speed1 * (e - a) - speed, speed2 * (e - a) - 2.0 * speed1

        return *rate(at_one, one1, 1.0), *rate(at_zero, zero1, 0.0)


@dataclass(eq=False)
class Program:
    """All that the solver reads."""

    # arrays, own: of the muscles, and the numbers in it of those of the columns
    arrays: ElasticArrays
    own: NDArray[np.int64]
    steps: Array  # (frames - 1,) [s]
    lengths: Array  # (frames - 1, muscles) of the paths between frames [m]
    speeds: Array  # (frames - 1, muscles) of the paths between frames [m/s]
    # pulls, columns: B (frames, rows, muscles) and A (frames, rows, others)
    pulls: Array
    columns: Array
    right: Array  # (frames, rows) b
    # activation, other: costs and bounds of a and x
    activation: Costs
    other: Costs
    rates: Rates | None  # None where activation may jump


@dataclass(eq=False)
class Point:
    """Where the solver stands: forces (frames, muscles), activations (frames - 1, muscles), others (frames, others)."""

    f: Array
    a: Array
    x: Array


START_ROOM = 0.02  # How far from its bounds an activation begins at least, in shares of their distance


def possible(program: Program, a: Array) -> Array:
    """Activations (frames - 1, muscles) well inside their bounds, and with rates that are possible."""
    low, high = program.activation.lower, program.activation.upper
    room = START_ROOM * (high - low)
    a = np.clip(a, low + room, high - room)
    if program.rates is None:
        return a
    between = 0.5 * (program.steps[1:] + program.steps[:-1])
    for index, dt in enumerate(between):
        up, _, _, down, _, _ = program.rates.bounds(a[index])
        # Half of the rate at the beginning of the step, so that at its middle it is possible too.
        a[index + 1] = np.clip(
            a[index + 1],
            a[index] + 0.5 * np.maximum(dt * down, -a[index]),
            a[index] + 0.5 * np.minimum(dt * up, 1.0 - a[index]),
        )
    return a


def integrated(program: Program, a: Array) -> Array:
    """Normalized tendon forces (frames, muscles) that activations lead to."""
    f = np.empty((len(a) + 1, a.shape[1]))
    inputs = (program.lengths, program.speeds, program.steps)
    integrate(program.arrays, program.own, a, *inputs, 2.0 * MIN_FORCE, 0.5 * MAX_FORCE, f)
    return f
