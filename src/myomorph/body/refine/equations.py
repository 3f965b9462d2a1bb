"""The cost of what was recorded, and its normal equations about a point.

With the motion of a recording in the coefficients of its splines, a frame sees a window of them
through values, rates and accelerations,

    q = w_0 c,   q' = w_1 c,   q'' = w_2 c

so that equations of the motion are banded. All sums run over windows: the frames between two knots.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from myomorph.body.refine.frame_kernels import RateSlopes, Setting, difference_frames
from myomorph.body.refine.kind import Here, KindSlopes
from myomorph.body.refine.point import Point
from myomorph.body.refine.problem import Problem
from myomorph.body.refine.spline_basis import WIDTH, Basis
from myomorph.body.refine.trial import Predicted, TrialData, TrialState
from myomorph.core.fit.banded import BandedEquations
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.rigid.coordinates import Ints
from myomorph.core.rigid.frames import over_frames

# How far a coordinate may lie from where inverse kinematics put it [rad, or m on a human body]
POSTURE_SD = 0.2
# How much a coordinate's acceleration may change [rad/s^2, or m/s^2 on a human body]
ACCELERATION_SD = 20.0
BOUND_SD = 0.01  # How far a coordinate goes beyond its bounds [rad or m]
UNEXPLAINED = 2.0
"""A frame whose residual is so many times the usual one, after motions alone were refined, loses
weight: something that no plate measures, as a chair, carries a part of the body there.
"""


@read_only
class Equations:
    """Normal equations of all unknowns: H step = -g.

    Attributes
    ----------
    trials : of each trial's motion
    H, g : (shared, shared), (shared,) of the shared unknowns
    """

    trials: tuple[BandedEquations, ...]
    H: Array
    g: Array


@read_only
class _Weights:
    """Weights of one frame's squares.

    A frame counts for its share of the time over which errors are alike.

    Attributes
    ----------
    marker : of a marker along one axis [1 / m^2]
    residual : of the root's residual in standard deviations
    value, acceleration : (free,) of a coordinate's departure from inverse kinematics
    bound : of what a coordinate goes beyond its bounds
    """

    marker: float
    residual: float
    value: Array
    acceleration: Array
    bound: float


def _weights(problem: Problem, trial: TrialData) -> _Weights:
    """Weigh the squares of a frame of a recording."""
    options = problem.options
    step = float(np.median(np.diff(trial.time)))
    share = min(1.0, step / options.marker_time)
    unit = problem.pose.unit[problem.pose.free]
    return _Weights(
        marker=share / problem.marker_variance,
        residual=min(1.0, 2.0 * options.cutoff * step),
        value=share / (POSTURE_SD * unit) ** 2,
        acceleration=share / (ACCELERATION_SD * unit) ** 2,
        bound=share / BOUND_SD**2,
    )


@read_only
class _Departure:
    """How far a motion is from what is known of it before.

    Attributes
    ----------
    values, accelerations : (frames, free) less those by inverse kinematics
    beyond : (frames, free) how far coordinates are beyond their bounds, 0 inside
    """

    values: Array
    accelerations: Array
    beyond: Array


def _departure(problem: Problem, state: TrialState, coefficients: Array) -> _Departure:
    """Compare a motion (coefficients, free) with inverse kinematics and bounds."""
    free = problem.pose.free
    basis = state.data.basis
    departed = coefficients - state.data.start_coefficients[:, free]
    values = state.rates.c[:, free]
    low = problem.pose.lower
    high = problem.pose.upper
    above = np.where(values > high, values - high, 0.0)
    return _Departure(
        values=basis.at(departed),
        accelerations=basis.at(departed, 2),
        beyond=np.where(values < low, values - low, above),
    )


def data_cost(problem: Problem, point: Point) -> float:
    """Sum squares of what recordings leave, in standard deviations.

    Bounds of coordinates are soft limits.

    Parameters
    ----------
    problem : with what is unknown
    point : where

    Returns
    -------
    the sum, with what is known of motions
    """
    setting = problem.setting(point)
    return sum(
        _trial_cost(problem, setting, problem.state(point, number), motion)
        for number, motion in enumerate(point.motions)
    )


def _trial_cost(
    problem: Problem, setting: Setting, state: TrialState, coefficients: Array
) -> float:
    """Sum squares of one recording, whose motion is (coefficients, free)."""
    trial = state.data
    errors, residual = problem.predict(setting, state)
    weights = _weights(problem, trial)
    marker_squares = np.einsum("fmi,fmi,m->", errors, errors, problem.pose.markers.weight)
    residual_squares = trial.trust @ np.sum((residual / problem.residual_sd) ** 2, axis=1)
    departure = _departure(problem, state, coefficients)
    total = weights.marker * float(marker_squares)
    total += weights.residual * float(residual_squares)
    total += float(np.sum(weights.value * departure.values**2))
    total += float(np.sum(weights.acceleration * departure.accelerations**2))
    total += float(np.sum(weights.bound * departure.beyond**2))
    return total


def with_trust(problem: Problem, point: Point) -> Problem:
    """Weigh frames by the residuals at a point.

    The weight is 1 up to `UNEXPLAINED` times the usual residual, and falls with its square beyond.

    Parameters
    ----------
    problem : with what is unknown
    point : at which motions alone were refined

    Returns
    -------
    the problem with the weights of its frames
    """
    setting = problem.setting(point)
    trials = []
    for number, trial in enumerate(problem.trials):
        residual = problem.predict(setting, problem.state(point, number)).residual
        sizes = np.linalg.norm(residual / problem.residual_sd, axis=1)
        usual = max(1.0, float(np.median(sizes[trial.use]))) if trial.use.any() else 1.0
        trust = (UNEXPLAINED * usual / np.maximum(sizes, UNEXPLAINED * usual)) ** 2
        trials.append(replace(trial, trust=trust))
    return replace(problem, trials=tuple(trials))


class _SharedSums(NamedTuple):
    """Normal equations of the shared unknowns, to which windows are added.

    Attributes
    ----------
    H, g : (shared, shared), (shared,)
    """

    H: Array
    g: Array


def linearize_data(problem: Problem, point: Point) -> Equations:
    """Build the normal equations of what was recorded at a point.

    Parameters
    ----------
    problem : with what is unknown
    point : where

    Returns
    -------
    bands of each trial's coefficients, cross terms and shared unknowns; without what is known of
        shared unknowns before
    """
    setting = problem.setting(point)
    count = problem.count
    sums = _SharedSums(H=np.zeros((count, count)), g=np.zeros(count))
    trials = []
    for number, motion in enumerate(point.motions):
        state = problem.state(point, number)
        predicted = problem.predict(setting, state)
        here = Here(problem=problem, point=point, setting=setting, state=state, predicted=predicted)
        trials.append(_trial_equations(_rows_of(problem, here, motion), sums))
    return Equations(trials=tuple(trials), H=sums.H, g=sums.g)


@read_only
@dataclass(frozen=True, eq=False, kw_only=True)
class _Rows:
    """Residuals of a recording with their slopes, and the roots of their weights.

    Attributes
    ----------
    problem : with the count of shared unknowns
    basis : of the motion's splines
    predicted : errors of markers and residual of the root
    slopes : in coordinates and rates
    kinds : slopes in each fitted kind
    marker_root : (frames, 3 markers) of the weights of markers, 0 where unseen
    residual_root : (frames, 6) of the weights of the residual
    weights : of the squares of a frame
    departure : of the motion from what is known of it
    """

    problem: Problem
    basis: Basis
    predicted: Predicted
    slopes: RateSlopes
    kinds: tuple[KindSlopes, ...]
    marker_root: Array
    residual_root: Array
    weights: _Weights
    departure: _Departure

    @property
    def free(self) -> int:
        """How many coordinates are free."""
        return len(self.problem.pose.free)

    def marker_misses(self, frames: Ints) -> Array:
        """Return weighted errors (chosen, 3 markers) of markers in frames (chosen,)."""
        errors = self.predicted.errors[frames].reshape(len(frames), -1)
        return self.marker_root[frames] * errors

    def residual_misses(self, frames: Ints) -> Array:
        """Return the weighted residual (6 chosen,) in frames (chosen,)."""
        return (self.residual_root[frames] * self.predicted.residual[frames]).ravel()


def _rows_of(problem: Problem, here: Here, coefficients: Array) -> _Rows:
    """Differentiate a recording at a point in all unknowns.

    Parameters
    ----------
    problem : with what is unknown
    here : the recording at the point
    coefficients : (coefficients, free) of its motion
    """
    trial = here.state.data
    weights = _weights(problem, trial)
    of_markers = np.where(trial.seen, weights.marker * problem.pose.markers.weight, 0.0)
    of_residual = np.sqrt(weights.residual * trial.trust)
    return _Rows(
        problem=problem,
        basis=trial.basis,
        predicted=here.predicted,
        slopes=_rate_slopes(problem, here),
        kinds=tuple(kind.slopes(here) for kind in problem.fitted),
        marker_root=np.sqrt(np.repeat(of_markers, 3, axis=1)),
        residual_root=of_residual[:, None] / problem.residual_sd,
        weights=weights,
        departure=_departure(problem, here.state, coefficients),
    )


def _rate_slopes(problem: Problem, here: Here) -> RateSlopes:
    """Differentiate markers and residual of all frames in coordinates and rates."""
    state = here.state
    free = problem.pose.free
    frames = len(state.data.time)
    slopes = RateSlopes(
        by_value=np.empty((frames, 6, len(free))),
        by_rate=np.empty((frames, 6, len(free))),
        by_acceleration=np.empty((frames, 6, len(free))),
        markers=np.empty((frames, len(free), 3 * len(problem.locations))),
    )

    def part(start: int, stop: int) -> None:
        chosen = slice(start, stop)
        difference_frames(
            here.setting,
            free,
            state.rates.frames(chosen),
            state.wrench[chosen],
            slopes.frames(chosen),
        )

    over_frames(part, frames)
    unused = ~state.data.use
    slopes.by_value[unused] = 0.0
    slopes.by_rate[unused] = 0.0
    slopes.by_acceleration[unused] = 0.0
    return slopes


class _Window(NamedTuple):
    """Frames that depend on the same coefficients.

    Attributes
    ----------
    first : number of the first coefficient
    frames : (chosen,) numbers
    value, rate, acceleration : (chosen, WIDTH) weights w_0, w_1, w_2 of the coefficients
    """

    first: int
    frames: Ints
    value: Array
    rate: Array
    acceleration: Array


def _windows(basis: Basis) -> Iterator[_Window]:
    """List the windows of splines."""
    for first in np.unique(basis.first):
        frames = np.flatnonzero(basis.first == first)
        yield _Window(
            first=int(first),
            frames=frames,
            value=basis.weights[0, frames],
            rate=basis.weights[1, frames],
            acceleration=basis.weights[2, frames],
        )


class _OwnRows(NamedTuple):
    """Weighted slopes in the motion of a window's frames.

    Attributes
    ----------
    markers : (chosen, free, 3 markers) in the coordinates that markers show
    residual : (6 chosen, WIDTH free) in the window's coefficients
    """

    markers: Array
    residual: Array


def _own_rows(rows: _Rows, window: _Window) -> _OwnRows:
    """Take the slopes of a window's frames in its coefficients.

        dr/dc = dr/dq w_0 + dr/dq' w_1 + dr/dq'' w_2

    Parameters
    ----------
    rows : of the recording
    window : some of its frames
    """
    frames = window.frames
    slopes = rows.slopes
    by_order = (slopes.by_value, slopes.by_rate, slopes.by_acceleration)
    by_window = (window.value, window.rate, window.acceleration)
    by_coefficient = sum(
        weights[:, None, :, None] * slope[frames][:, :, None, :]
        for weights, slope in zip(by_window, by_order, strict=True)
    )
    weighted = by_coefficient * rows.residual_root[frames][:, :, None, None]
    return _OwnRows(
        markers=slopes.markers[frames] * rows.marker_root[frames, None],
        residual=weighted.reshape(6 * len(frames), WIDTH * rows.free),
    )


def _window_block(rows: _Rows, window: _Window, own: _OwnRows) -> Array:
    """Build the window's part of the normal equations' matrix.

    With the slopes M of a frame's markers in the coordinates q - alpha q'' that they show, A of the
    residual, and the weights v, b, a of value, bounds and acceleration,

        A^T A + sum_f [ (w_0 - alpha w_2)^T M^T M (w_0 - alpha w_2)
                        + w_0^T (v + b) w_0 + w_2^T a w_2 ]

    Returns
    -------
    (WIDTH free, WIDTH free)
    """
    free = rows.free
    size = WIDTH * free
    value = window.value
    acceleration = window.acceleration
    weights = rows.weights
    block = own.residual.T @ own.residual
    per_frame = np.einsum("fir,fjr->fij", own.markers, own.markers, optimize=True)
    if rows.problem.tissue is not None:
        block += _soft_block(window, rows.problem.alphas, per_frame)
    beyond = rows.departure.beyond[window.frames] != 0.0
    each = np.arange(free)
    per_frame[:, each, each] += weights.value + weights.bound * beyond
    of_values = np.einsum("fa,fb,fij->aibj", value, value, per_frame, optimize=True)
    block += of_values.reshape(size, size)
    bends = np.einsum("fa,fb->ab", acceleration, acceleration)
    block += np.kron(bends, np.diag(weights.acceleration))
    return block


def _soft_block(window: _Window, alphas: Array, per_frame: Array) -> Array:
    """Build what soft tissue adds to a window's part of the matrix.

        sum_f [ w_2^T alpha M^T M alpha w_2 - w_0^T M^T M alpha w_2 - w_2^T alpha M^T M w_0 ]

    Parameters
    ----------
    window : frames
    alphas : (free,) [s^2]
    per_frame : (chosen, free, free) M^T M

    Returns
    -------
    (WIDTH free, WIDTH free)
    """
    size = WIDTH * len(alphas)
    bend = window.acceleration
    soft = alphas * per_frame
    softer = alphas[:, None] * soft
    mixed = np.einsum("fa,fb,fij->aibj", window.value, bend, soft, optimize=True)
    mixed = mixed.reshape(size, size)
    twice = np.einsum("fa,fb,fij->aibj", bend, bend, softer, optimize=True)
    return np.asarray(twice.reshape(size, size) - mixed - mixed.T)


def _window_gradient(rows: _Rows, window: _Window, own: _OwnRows) -> Array:
    """Build the window's part of the gradient, with the letters of `_window_block`.

    Returns
    -------
    (WIDTH free,)
    """
    frames = window.frames
    weights = rows.weights
    departure = rows.departure
    of_markers = np.einsum("fir,fr->fi", own.markers, rows.marker_misses(frames))
    pull = of_markers + weights.value * departure.values[frames]
    pull = pull + weights.bound * departure.beyond[frames]
    bend = weights.acceleration * departure.accelerations[frames]
    bend = bend - rows.problem.alphas * of_markers
    gradient = np.einsum("fa,fi->ai", window.value, pull)
    gradient = gradient + np.einsum("fa,fi->ai", window.acceleration, bend)
    return gradient.ravel() + own.residual.T @ rows.residual_misses(frames)


class _SharedRows(NamedTuple):
    """Weighted slopes of a window's frames in the shared unknowns.

    Attributes
    ----------
    markers : (chosen, 3 markers, those that move markers)
    residual : (6 chosen, shared)
    """

    markers: Array
    residual: Array


def _shared_rows(rows: _Rows, window: _Window) -> _SharedRows:
    """Take the slopes of a window's frames in all fitted kinds."""
    problem = rows.problem
    frames = window.frames
    markers = np.zeros((len(frames), rows.marker_root.shape[1], problem.marker_count))
    residual = np.zeros((len(frames), 6, problem.count))
    for kind, slopes in zip(problem.fitted, rows.kinds, strict=True):
        columns = problem.columns[kind.name]
        of_markers = slopes.markers_in(frames)
        if of_markers is not None:
            markers[:, :, columns] = of_markers
        if slopes.residual is not None:
            residual[:, :, columns] = slopes.residual[frames]
    markers *= rows.marker_root[frames][:, :, None]
    residual *= rows.residual_root[frames][:, :, None]
    return _SharedRows(markers=markers, residual=residual.reshape(6 * len(frames), problem.count))


def _trial_equations(rows: _Rows, sums: _SharedSums) -> BandedEquations:
    """Sum the normal equations of a recording over its windows.

    Parameters
    ----------
    rows : of the recording
    sums : of the shared unknowns, to which the recording's part is added
    """
    problem = rows.problem
    free = rows.free
    size = WIDTH * free
    coefficients = rows.basis.count * free
    band = np.zeros((size, coefficients))
    right = np.zeros(coefficients)
    cross = np.zeros((coefficients, problem.count))
    row, column = np.tril_indices(size)
    for window in _windows(rows.basis):
        own = _own_rows(rows, window)
        start = window.first * free
        span = slice(start, start + size)
        band[row - column, start + column] += _window_block(rows, window, own)[row, column]
        right[span] += _window_gradient(rows, window, own)
        if problem.count:
            shared = _shared_rows(rows, window)
            _add_cross(rows, window, own, shared, cross[span])
            _add_shared(rows, window, shared, sums)
    return BandedEquations(band=band, right=right, cross=cross)


def _add_cross(
    rows: _Rows, window: _Window, own: _OwnRows, shared: _SharedRows, cross: Array
) -> None:
    """Add the products of a window's slopes in motion and in shared unknowns.

    Parameters
    ----------
    rows, window : of the recording
    own, shared : slopes of the window's frames
    cross : (WIDTH free, shared) changed in place
    """
    count = rows.problem.marker_count
    joined = np.einsum("fir,frp->fip", own.markers, shared.markers, optimize=True)
    parts = [(window.value, joined)]
    if rows.problem.tissue is not None:
        parts.append((window.acceleration, -rows.problem.alphas[:, None] * joined))
    for weights, of_coordinates in parts:
        crossed = np.einsum("fa,fip->aip", weights, of_coordinates, optimize=True)
        cross[:, :count] += crossed.reshape(len(cross), count)
    cross += own.residual.T @ shared.residual


def _add_shared(rows: _Rows, window: _Window, shared: _SharedRows, sums: _SharedSums) -> None:
    """Add a window's part to the normal equations of the shared unknowns, J^T J and J^T r."""
    count = rows.problem.marker_count
    frames = window.frames
    misses = rows.marker_misses(frames).ravel()
    markers = shared.markers.reshape(len(misses), count)
    sums.H[:count, :count] += markers.T @ markers
    sums.H[:] += shared.residual.T @ shared.residual
    sums.g[:count] += markers.T @ misses
    sums.g[:] += shared.residual.T @ rows.residual_misses(frames)
