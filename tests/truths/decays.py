"""Frequency, damping and inertia of a body from the decay of its free swing about one axis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares
from scipy.signal import periodogram

import myomorph as mm
from myomorph.core.fit.correlation import variance_samples
from myomorph.core.model.arrays import Array

DAMPINGS = ("viscous", "coulomb", "quadratic")
LAWS: tuple[tuple[str, ...], ...] = (
    ("viscous",),
    ("coulomb",),
    ("quadratic",),
    ("viscous", "coulomb"),
    ("viscous", "quadratic"),
    ("viscous", "coulomb", "quadratic"),
)
STEPS = 40
"""Steps a period in which the amplitude is integrated."""


@dataclass(frozen=True, eq=False)
class Decay:
    """A decaying oscillation: signal = offset + A cos(phase), slowly changing.

        A' = -(viscous A + coulomb + quadratic A^2),   phase' = 2 pi / period (1 - bend A^2)

    which is the first order of averaging for resistance that is constant, linear or quadratic in
    the rate (Nayfeh and Mook 1979, section 2.3). A pendulum's bend is 1 / 16 over the square of
    signal per radian.

    Attributes
    ----------
    terms : of the law of damping
    offset, amplitude, phase : in the signal's unit, of A at the first sample, and there [rad]
    period : at small amplitudes [s]
    period_sd : its standard error, residuals of each period taken as one observation [s]
    period_sd_white : the same were all residuals independent [s]
    viscous : [1/s], coulomb : [unit/s], quadratic : [1/(unit s)]
    viscous_sd : standard error of `viscous`, as `period_sd` [1/s]
    bend : [1/unit^2]
    residual : root mean square, in the signal's unit
    effective : independent samples of the residual
    free : number of parameters
    """

    terms: tuple[str, ...]
    offset: float
    amplitude: float
    phase: float
    period: float
    period_sd: float
    period_sd_white: float
    viscous: float
    coulomb: float
    quadratic: float
    viscous_sd: float
    bend: float
    residual: float
    effective: float
    free: int

    def judged(self, samples: float) -> Decay:
        """Return the same with another number of independent samples, that of the compared law."""
        return replace(self, effective=samples)

    @property
    def bic(self) -> float:
        """Schwarz's criterion, likewise."""
        return (
            2.0 * self.effective * float(np.log(self.residual))
            + float(np.log(self.effective)) * self.free
        )

    @property
    def damping_ratio(self) -> float:
        """Of the viscous part, over critical damping."""
        omega = 2.0 * np.pi / self.period
        return float(self.viscous / np.hypot(self.viscous, omega))

    def decrement(self, amplitude: float) -> float:
        """Logarithmic decrement of one period from an amplitude on."""
        return float(
            (self.viscous + self.coulomb / amplitude + self.quadratic * amplitude) * self.period
        )

    def viscosity(self, inertia: float) -> float:
        """Return the d of I theta'' = -d theta' that makes the viscous part [N m s/rad].

        The inertia is about the axis.
        """
        return 2.0 * self.viscous * inertia

    def friction(self, stiffness: float) -> float:
        """Return the torque of constant friction that makes the Coulomb part [N m].

        It is of a pendulum of stiffness m g l. A swing loses 4 torque / stiffness of its angle
        every period.
        """
        return self.coulomb / self.signal_per_radian() * stiffness * self.period / 4.0

    def signal_per_radian(self) -> float:
        """Return the signal's amplitude at a swing of 1 rad, if the bend is that of a pendulum.

        It is infinite without a bend.
        """
        return float(0.25 / np.sqrt(self.bend)) if self.bend > 0.0 else float("inf")


def fit_decay(
    time: Array, signal: Array, terms: Sequence[str] = ("viscous",), bend: bool = True
) -> Decay:
    """Fit a decaying oscillation to a signal of an angle or a rate by least squares.

    Parameters
    ----------
    time : (frames,) at equal steps [s]
    signal : (frames,) in any unit
    terms : among `DAMPINGS`, coefficients of at least 0
    bend : let the period depend on the amplitude

    Returns
    -------
    Decay with its residual and the number of independent samples

    Raises
    ------
    BadData
        fewer than three periods
    UnknownName
        a term that does not exist
    """
    for term in terms:
        if term not in DAMPINGS:
            raise mm.UnknownName("term", term, DAMPINGS, "the decay of a pendulum")
    since = time - time[0]
    start, period = _start(since, signal)
    if not since[-1] > 3.0 * period:
        raise mm.BadData(
            f"a decay needs three periods or more, but the signal holds {since[-1] / period:.1f}"
        )
    chosen = np.flatnonzero([True] * 4 + [name in terms for name in DAMPINGS] + [bend])
    unit = _units(float(np.std(signal)), period)

    def whole(x: Array) -> Array:
        full = np.zeros(8)
        full[chosen] = x * unit[chosen]
        return full

    lower = np.where(np.arange(8) < 4, -np.inf, 0.0)[chosen]
    fit = least_squares(
        lambda x: _signal(since, whole(x)) - signal,
        np.maximum((start / unit)[chosen], lower + 1e-6),
        bounds=(lower, np.inf),
        x_scale="jac",
    )
    fitted = _Oscillation._make(whole(fit.x).tolist())
    sandwich, white = _covariances(fit.jac, fit.fun, np.floor(since / period).astype(int))
    deviations, plain = np.zeros((2, 8))
    deviations[chosen] = np.sqrt(np.diag(sandwich)) * unit[chosen]
    plain[chosen] = np.sqrt(np.diag(white)) * unit[chosen]
    period = 2.0 * np.pi / fitted.omega
    return Decay(
        terms=tuple(terms),
        offset=fitted.offset,
        amplitude=fitted.amplitude,
        phase=fitted.phase,
        period=period,
        period_sd=float(period * deviations[3] / fitted.omega),
        period_sd_white=float(period * plain[3] / fitted.omega),
        viscous=fitted.viscous,
        coulomb=fitted.coulomb,
        quadratic=fitted.quadratic,
        viscous_sd=float(deviations[4]),
        bend=fitted.bend,
        residual=float(np.sqrt(np.mean(np.square(fit.fun)))),
        effective=variance_samples([fit.fun[:, None]]),
        free=len(chosen),
    )


class _Oscillation(NamedTuple):
    """Parameters of a signal, in the order of their vector."""

    offset: float
    amplitude: float
    phase: float
    omega: float
    viscous: float
    coulomb: float
    quadratic: float
    bend: float


def _units(size: float, period: float) -> Array:
    """Return (8,) about the sizes of the parameters, for a signal of a size and a period [s]."""
    return np.array(
        [
            size,
            size,
            1.0,
            2.0 * np.pi / period / 100.0,
            0.01,
            0.01 * size,
            0.01 / size,
            1e-3 / size**2,
        ]
    )


def _covariances(jacobian: Array, residuals: Array, blocks: Array) -> tuple[Array, Array]:
    """Return covariances (parameters, parameters) by blocks of residuals, and of white noise.

    Parameters
    ----------
    jacobian : (frames, parameters)
    residuals : (frames,)
    blocks : (frames,) number of the block of each
    """
    inverse = np.linalg.pinv(jacobian.T @ jacobian)
    scores = np.stack(
        [
            (jacobian[blocks == i] * residuals[blocks == i, None]).sum(axis=0)
            for i in np.unique(blocks)
        ]
    )
    count = jacobian.shape[1]
    sandwich = inverse @ (scores.T @ scores) @ inverse * len(scores) / max(len(scores) - count, 1)
    white = inverse * float(residuals @ residuals) / (len(residuals) - count)
    return sandwich, white


def compare_decays(
    time: Array, signal: Array, laws: Sequence[tuple[str, ...]] = LAWS
) -> tuple[Decay, ...]:
    """Fit every law of damping.

    Criteria count the independent samples of the best law's residual.

    Parameters
    ----------
    time : (frames,) at equal steps [s]
    signal : (frames,) in any unit
    laws : terms of each law, among `DAMPINGS`

    Returns
    -------
    the fit of each law, in their order
    """
    fits = [fit_decay(time, signal, terms) for terms in laws]
    samples = min(fits, key=lambda one: one.residual).effective
    return tuple(one.judged(samples) for one in fits)


def compound_inertia(mass: float, gravity: float, distance: float, period: float) -> float:
    """Return the inertia about the center of mass of a body that swings about an axis [kg m^2].

    I = m g l (T / 2 pi)^2 - m l^2, T the period at small amplitudes without damping, l the distance
    of the axis.
    """
    return mass * gravity * distance * (period / (2.0 * np.pi)) ** 2 - mass * distance**2


def torsional_inertia(rod: float, rod_period: float, period: float) -> float:
    """Return the inertia of a body about the wire on which it hangs [kg m^2].

    A rod of known inertia had a known period on the same wire.
    """
    return rod * (period / rod_period) ** 2


def _signal(since: Array, parameters: Array) -> Array:
    """Return the signal (frames,) of parameters (8,).

    They are offset, amplitude, phase, angular frequency, three dampings and bend.
    """
    offset, amplitude, phase, omega, a, b, q, bend = parameters
    count = 2 * max(int(np.ceil(since[-1] * omega / (2.0 * np.pi) * STEPS / 2.0)), 4) + 1
    grid = np.linspace(0.0, since[-1], count)
    A = _amplitudes(amplitude, a, b, q, grid)
    turned = CubicSpline(grid, omega * (1.0 - bend * A**2)).antiderivative()(since)
    return offset + CubicSpline(grid, A)(since) * np.cos(phase + turned)


def _amplitudes(first: float, a: float, b: float, q: float, grid: Array) -> Array:
    """Return A on a grid of even times, at least 0: Runge-Kutta of order 4."""
    h = float(grid[1] - grid[0])
    A = abs(first)
    found = np.empty(len(grid))
    for i in range(len(grid)):
        found[i] = A
        k1 = b + A * (a + q * A)
        x = A - 0.5 * h * k1
        k2 = b + x * (a + q * x)
        x = A - 0.5 * h * k2
        k3 = b + x * (a + q * x)
        x = A - h * k3
        A = max(A - h / 6.0 * (k1 + 2.0 * (k2 + k3) + b + x * (a + q * x)), 0.0)
    return np.copysign(found, first)


def _start(since: Array, signal: Array) -> tuple[Array, float]:
    """First (8,) parameters, and the period, from the spectrum and its first periods."""
    frequency, power = periodogram(signal - signal.mean(), 1.0 / float(since[1] - since[0]), "hann")
    peak = int(power.argmax())
    near = slice(max(peak - 1, 1), peak + 2)
    omega = 2.0 * np.pi * float(np.average(frequency[near], weights=power[near]))
    early = since < 6.0 * np.pi / omega
    columns = np.stack(
        [np.ones(early.sum()), np.cos(omega * since[early]), np.sin(omega * since[early])], axis=1
    )
    offset, x, y = np.linalg.lstsq(columns, signal[early], rcond=None)[0]
    decay = 0.01 * omega / (2.0 * np.pi)
    start = [
        offset,
        np.hypot(x, y),
        np.arctan2(-y, x),
        omega,
        decay,
        0.1 * decay * np.hypot(x, y),
        0.0,
        0.0,
    ]
    return np.array(start), 2.0 * np.pi / omega
