"""Kalman smoother of coordinates, whose accelerations have white jerk and are drawn to nothing.

    d/dt [q, v, a] = [v, a, -d a + w],    y = q + n

with white w and n. Away from the ends and without d it is a low-pass filter without lag,

    H(f) = 1 / (1 + (f / fc)^6),    (2 pi fc)^6 = density of w over density of n

as a Butterworth filter of third order both ways, but it needs no values beyond the ends and bridges
gaps as the acceleration goes on. Time is in units of 1 / (2 pi fc) and the variance of n is 1.

Sources: Singer 1970 (the motion), Van Loan 1978 (its steps), Rauch, Tung and Striebel 1965
(smoothing).
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.rigid.kernels import bare, kernel

DIFFUSE = 1e8  # Variance of the first state, that of the noise being 1
TERMS = 40  # Of the exponential of a step: steps are at most a few time units long


class Steps(NamedTuple):
    """How states go on from frame to frame.

    Attributes
    ----------
    transition : (columns, 3, 3)
    spread : (columns, 3, 3) covariance that a step adds
    """

    transition: Array
    spread: Array


class Smoothing(NamedTuple):
    """Smoothed states, in units of the filter's time.

    Attributes
    ----------
    mean : (frames, columns, 3) q, v and a
    variance : (frames, columns, 3) over that of the noise
    """

    mean: Array
    variance: Array


class Gains(NamedTuple):
    """How measurements enter the states of columns that are seen in the same frames.

    Attributes
    ----------
    update : (frames, 4) first column of P before a measurement, and the variance of its innovation
    back : (frames, 3, 3) gains of smoothing
    variance : (frames, 3) of the smoothed states
    covariance : (frames, 3, 3) P of each frame; scratch
    """

    update: Array
    back: Array
    variance: Array
    covariance: Array

    @staticmethod
    def room(frames: int) -> Gains:
        """Make room for so many frames."""
        return Gains(
            update=np.zeros((frames, 4)),
            back=np.zeros((frames, 3, 3)),
            variance=np.empty((frames, 3)),
            covariance=np.empty((frames, 3, 3)),
        )


def smoothed_states(values: Array, step: float, decay: Array) -> Smoothing:
    """Smooth columns, NaN where not seen.

    Parameters
    ----------
    values : (frames, columns)
    step : between frames, times 2 pi fc [-]
    decay : (columns,) d with which accelerations are drawn to nothing [-]

    Returns
    -------
    means and variances of all frames
    """
    frames, columns = values.shape
    seen = np.isfinite(values)
    first = np.argmax(seen, axis=0)
    offset = np.nan_to_num(values[first, np.arange(columns)])
    measured = np.where(seen, values - offset, 0.0)
    steps = _steps(step, decay)
    mean = np.empty((frames, columns, 3))
    variance = np.empty_like(mean)
    room = Gains.room(frames)
    for chosen in _seen_alike(seen, decay):
        column = chosen[0]
        transition = steps.transition[column]
        seen_there = np.ascontiguousarray(seen[:, column])
        _gains(seen_there, transition, steps.spread[column], *room)
        own = np.empty((frames, len(chosen), 3))
        values_there = np.ascontiguousarray(measured[:, chosen])
        _means(values_there, seen_there, transition, room.update, room.back, own)
        mean[:, chosen] = own
        variance[:, chosen] = room.variance[:, None]
    mean[:, :, 0] += offset
    return Smoothing(mean=mean, variance=variance)


def _seen_alike(seen: np.ndarray, decay: Array) -> Iterable[list[int]]:
    """Group columns that share gains: gains do not depend on what was measured.

    Parameters
    ----------
    seen : (frames, columns)
    decay : (columns,)
    """
    groups: dict[tuple[float, bytes], list[int]] = {}
    for column in range(seen.shape[1]):
        pattern = (float(decay[column]), seen[:, column].tobytes())
        groups.setdefault(pattern, []).append(column)
    return groups.values()


def _steps(step: float, decay: Array) -> Steps:
    """Integrate the motion over a step.

        exp([[-F, Q], [0, F^T]] h) = [[., G], [0, Phi^T]],    spread = Phi G

    Parameters
    ----------
    step : h [-]; it is the density of the jerk too, where the noise has variance 1
    decay : (columns,)
    """
    block = np.zeros((len(decay), 6, 6))
    block[:, [0, 1], [1, 2]] = -step
    block[:, [4, 5], [3, 4]] = step
    block[:, 2, 2] = step * decay
    block[:, 5, 5] = -step * decay
    block[:, 2, 5] = step**2
    whole = np.broadcast_to(np.eye(6), block.shape).copy()
    term = whole.copy()
    for order in range(1, TERMS):
        term = term @ block / order
        whole += term
    transition = np.ascontiguousarray(whole[:, 3:, 3:].transpose(0, 2, 1))
    return Steps(transition=transition, spread=transition @ whole[:, :3, 3:])


@kernel
def _gains(seen, F, Q, update, back, variance, covariance):
    """Find the gains of a filter forwards and a smoother backwards.

    With the covariance P of a frame by what came before and itself, that of the next frame as
    predicted, P' = F P F^T + Q, and as smoothed V',

        C = P F^T P'^-1,    V = P + C (V' - P') C^T

    Parameters
    ----------
    seen : (frames,)
    F, Q : (3, 3) transition and spread of a step
    update, back, variance, covariance : as of `Gains`, filled
    """
    P = np.zeros((3, 3))
    product = np.empty((3, 3))
    V = np.empty((3, 3))
    for i in range(3):
        P[i, i] = DIFFUSE
    started = False
    frames = seen.shape[0]
    for k in range(frames):
        # Before the first value nothing is known, and nothing less a frame later.
        if started:
            _predict_covariance(F, Q, P, product)
        if seen[k]:
            started = True
            for i in range(3):
                update[k, i] = P[i, 0]
            update[k, 3] = P[0, 0] + 1.0
            _update_covariance(update[k], P)
        covariance[k] = P
    V[:] = P
    for k in range(frames - 1, -1, -1):
        if k < frames - 1:
            P[:] = covariance[k]
            _predict_covariance(F, Q, P, product)
            _gain_back(F, P, covariance[k], product, back[k])
            _variance_back(back[k], covariance[k], P, V, product)
        for i in range(3):
            variance[k, i] = V[i, i]


@kernel
def _means(y, seen, F, update, back, mean):
    """Filter each column forwards and smooth it backwards with gains that are known.

    With the mean x of a frame by what came before and itself, x' = F x as predicted for the next
    and X' as smoothed, X = x + C (X' - x').

    Parameters
    ----------
    y : (frames, columns) measured less an offset, 0 where not seen
    seen : (frames,)
    F : (3, 3) transition of a step
    update, back : as of `Gains`
    mean : (frames, columns, 3) filled
    """
    x = np.empty(3)
    X = np.empty(3)
    frames = y.shape[0]
    for j in range(y.shape[1]):
        x[:] = 0.0
        started = False
        for k in range(frames):
            if started:
                _predict_mean(F, x)
            if seen[k]:
                started = True
                e = y[k, j] - x[0]
                for i in range(3):
                    x[i] += update[k, i] * e / update[k, 3]
            mean[k, j] = x
        X[:] = x
        for k in range(frames - 2, -1, -1):
            x[:] = mean[k, j]
            _predict_mean(F, x)
            for i in range(3):
                x[i] = X[i] - x[i]
            for i in range(3):
                X[i] = (
                    mean[k, j, i]
                    + back[k, i, 0] * x[0]
                    + back[k, i, 1] * x[1]
                    + back[k, i, 2] * x[2]
                )
            mean[k, j] = X


@bare
def _predict_mean(F, x):
    """Advance a mean x (3,) by a step: F x."""
    a = F[0, 0] * x[0] + F[0, 1] * x[1] + F[0, 2] * x[2]
    b = F[1, 0] * x[0] + F[1, 1] * x[1] + F[1, 2] * x[2]
    c = F[2, 0] * x[0] + F[2, 1] * x[1] + F[2, 2] * x[2]
    x[0] = a
    x[1] = b
    x[2] = c


@bare
def _predict_covariance(F, Q, P, product):
    """Advance a covariance P (3, 3) by a step: F P F^T + Q."""
    for i in range(3):
        for m in range(3):
            product[i, m] = F[i, 0] * P[0, m] + F[i, 1] * P[1, m] + F[i, 2] * P[2, m]
    for i in range(3):
        for m in range(i, 3):
            value = product[i, 0] * F[m, 0] + product[i, 1] * F[m, 1] + product[i, 2] * F[m, 2]
            P[i, m] = value + Q[i, m]
            P[m, i] = P[i, m]


@bare
def _update_covariance(update, P):
    """Take a measurement into a covariance P (3, 3); `update` (4,) as of `Gains`."""
    p0 = update[0]
    p1 = update[1]
    p2 = update[2]
    s = update[3]
    P[0, 0] = p0 / s
    P[0, 1] = p1 / s
    P[1, 0] = P[0, 1]
    P[0, 2] = p2 / s
    P[2, 0] = P[0, 2]
    P[1, 1] -= p1 * p1 / s
    P[1, 2] -= p1 * p2 / s
    P[2, 1] = P[1, 2]
    P[2, 2] -= p2 * p2 / s


@bare
def _gain_back(F, ahead, P, root, back):
    """Fill the gain C = P F^T P'^-1 of smoothing by the Cholesky factor of P'.

    Parameters
    ----------
    F : (3, 3)
    ahead : (3, 3) P'
    P : (3, 3)
    root : (3, 3) filled with the factor
    back : (3, 3) filled with C
    """
    for i in range(3):
        for m in range(i + 1):
            total = ahead[i, m]
            for n in range(m):
                total -= root[i, n] * root[m, n]
            root[i, m] = np.sqrt(total) if i == m else total / root[m, m]
    for row in range(3):
        # P' c = F P, of which P and P' are symmetric
        for i in range(3):
            total = F[i, 0] * P[0, row] + F[i, 1] * P[1, row] + F[i, 2] * P[2, row]
            for n in range(i):
                total -= root[i, n] * back[row, n]
            back[row, i] = total / root[i, i]
        for i in range(2, -1, -1):
            total = back[row, i]
            for n in range(i + 1, 3):
                total -= root[n, i] * back[row, n]
            back[row, i] = total / root[i, i]


@bare
def _variance_back(back, covariance, ahead, V, product):
    """Smooth the covariance of a frame by that of the one after it, see `_gains`.

    Parameters
    ----------
    back : (3, 3) C
    covariance : (3, 3) P of the frame
    ahead : (3, 3) P' as predicted for the next; overwritten
    V : (3, 3) of the next as smoothed; overwritten by that of the frame
    product : (3, 3) scratch
    """
    for i in range(3):
        for m in range(3):
            ahead[i, m] = V[i, m] - ahead[i, m]
    for i in range(3):
        for m in range(3):
            product[i, m] = (
                back[i, 0] * ahead[0, m] + back[i, 1] * ahead[1, m] + back[i, 2] * ahead[2, m]
            )
    for i in range(3):
        for m in range(i, 3):
            value = (
                product[i, 0] * back[m, 0] + product[i, 1] * back[m, 1] + product[i, 2] * back[m, 2]
            )
            V[i, m] = covariance[i, m] + value
            V[m, i] = V[i, m]
