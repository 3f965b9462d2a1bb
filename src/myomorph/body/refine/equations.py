"""The cost of the problem of motion, body and masses, and its normal equations about a point."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from myomorph.body.identify.pseudo_inertia import tangents
from myomorph.body.refine.frame_kernels import difference_frames
from myomorph.body.refine.problem import WIDTH, Problem, Rates, TrialData, Unknowns
from myomorph.core.fit.banded import BandedEquations
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.series import Motion
from myomorph.core.rigid.coordinates import Ints
from myomorph.core.rigid.frames import over_frames
from myomorph.core.rigid.regressor import regressor_blocks
from myomorph.core.rigid.tree import TreeArrays, compile_tree

# How far a coordinate may lie from where inverse kinematics put it [rad, or m on a human body]
POSTURE_SD = 0.2
# How much a coordinate's acceleration may change [rad/s^2, or m/s^2 on a human body]
ACCELERATION_SD = 20.0
BOUND_SD = 0.01  # How far a coordinate goes beyond its bounds [rad or m]
MASS_SD = 1e-4  # Of the whole body's mass, of itself: it is known
LENGTH_STEP = 1e-5
UNEXPLAINED = 2.0
"""A frame whose residual is so many times the usual one, after motions alone were refined, loses
weight: something that no plate measures, as a chair, carries a part of the body there.
"""


@read_only
class Equations:
    """Normal equations of all unknowns: H step = -g.

    Attributes
    ----------
    trials : of each trial
    H, g : (shared, shared), (shared,) of the shared unknowns
    """

    trials: tuple[BandedEquations, ...]
    H: Array
    g: Array


def cost(problem: Problem, at: Unknowns) -> float:
    """Sum squares of all residuals and priors, in standard deviations.

    The objective of `refine`, with bounds of coordinates as soft limits.

    Parameters
    ----------
    problem : with what is unknown
    at : point

    Returns
    -------
    the sum
    """
    total = float(sum(miss @ miss for _, _, miss in prior_rows(problem, at)))
    return total + data_cost(problem, at)


def data_cost(problem: Problem, at: Unknowns) -> float:
    """Sum squares of what recordings leave, in standard deviations.

    Parameters
    ----------
    problem : with what is unknown
    at : point

    Returns
    -------
    the sum, with what is known of motions
    """
    tree = problem.arrays(at)
    locations = problem.placed(at.factors, at.shifts)
    total = 0.0
    for trial, coefficients in zip(problem.trials, at.motions, strict=True):
        rates = problem.rates(trial, coefficients)
        errors, residual = problem.predict(tree, locations, trial, rates)
        weights = _weights(problem, trial)
        total += weights.marker * float(
            np.einsum("fmi,fmi,m->", errors, errors, problem.pose.markers.weight)
        )
        total += weights.share * float(
            trial.trust @ np.sum((residual / problem.residual_sd) ** 2, axis=1)
        )
        free = problem.pose.free
        moved = coefficients - _start(trial, tuple(free.tolist()))
        for nu, weight in ((0, weights.value), (2, weights.acceleration)):
            total += float(np.sum(weight * trial.basis.at(moved, nu) ** 2))
        total += float(np.sum(weights.bound * _beyond(problem, rates[0][:, free]) ** 2))
    return total


@read_only
class _Weights:
    """Weights of one frame's squares.

    A frame counts for its share of the time over which errors are alike.

    Attributes
    ----------
    marker : of a marker along one axis [1 / m^2]
    share : of the root's residual in standard deviations
    value, acceleration : (free,) of a coordinate's departure from inverse kinematics
    bound : of what a coordinate goes beyond its bounds
    """

    marker: float
    share: float
    value: Array
    acceleration: Array
    bound: float


def _weights(problem: Problem, trial: TrialData) -> _Weights:
    options = problem.options
    step = float(np.median(np.diff(trial.time)))
    share = min(1.0, step / options.marker_time)
    unit = problem.pose.unit[problem.pose.free]
    return _Weights(
        share / problem.marker_variance,
        min(1.0, 2.0 * options.cutoff * step),
        share / (POSTURE_SD * unit) ** 2,
        share / (ACCELERATION_SD * unit) ** 2,
        share / BOUND_SD**2,
    )


@lru_cache(maxsize=64)
def _start(trial: TrialData, free: tuple[int, ...]) -> Array:
    """Fit splines to inverse kinematics: the same for every point of a search.

    Returns
    -------
    (coefficients, free)
    """
    return trial.basis.fitted(trial.start[:, list(free)])


def _beyond(problem: Problem, values: Array) -> Array:
    """Compute how far coordinates are beyond their bounds, 0 inside.

    Parameters
    ----------
    values : (frames, free) [rad or m]

    Returns
    -------
    (frames, free)
    """
    low = problem.pose.lower
    high = problem.pose.upper
    return np.where(values > high, values - high, np.where(values < low, values - low, 0.0))


def prior_rows(problem: Problem, at: Unknowns) -> list[tuple[slice, Array, Array]]:
    """Build what is known of the shared unknowns before.

    Parameters
    ----------
    problem : with what is unknown
    at : point

    Returns
    -------
    columns among the shared unknowns, (rows, columns) and (rows,) misses, in standard deviations
    """
    lengths, places, masses = problem.columns()
    rows = []
    if problem.body:
        length_sd = problem.options.length_sd
        marker_sd = problem.marker_sd
        rows.append((lengths, np.eye(len(at.factors)) / length_sd, (at.factors - 1.0) / length_sd))
        rows.append((places, np.eye(at.shifts.size) / marker_sd, at.shifts.ravel() / marker_sd))
    if problem.masses:
        prior = problem.prior
        T = tangents(at.parameters[prior.moved])
        blocks = np.zeros((10 * len(T) + 1, 10 * len(T)))
        for index, block in enumerate(prior.rows @ T):
            blocks[10 * index : 10 * index + 10, 10 * index : 10 * index + 10] = block
        total = MASS_SD * prior.reference[:, 0].sum()
        blocks[-1] = T[:, 0].ravel() / total
        miss = (at.parameters[:, 0].sum() - prior.reference[:, 0].sum()) / total
        rows.append((masses, blocks, np.append(prior.misses(at.parameters).ravel(), miss)))
    return rows


def with_trust(problem: Problem, at: Unknowns) -> Problem:
    """Weigh frames by the residuals at a point.

    The weight is 1 up to `UNEXPLAINED` times the usual residual, and falls with its square beyond.

    Parameters
    ----------
    problem : with what is unknown
    at : point, at which motions alone were refined

    Returns
    -------
    the problem with the weights of its frames
    """
    tree = problem.arrays(at)
    locations = problem.placed(at.factors, at.shifts)
    trials = []
    for trial, coefficients in zip(problem.trials, at.motions, strict=True):
        residual = problem.predict(tree, locations, trial, problem.rates(trial, coefficients))[1]
        sizes = np.linalg.norm(residual / problem.residual_sd, axis=1)
        usual = max(1.0, float(np.median(sizes[trial.use]))) if trial.use.any() else 1.0
        trust = (UNEXPLAINED * usual / np.maximum(sizes, UNEXPLAINED * usual)) ** 2
        trials.append(replace(trial, trust=trust))
    return replace(problem, trials=tuple(trials))


def linearize(problem: Problem, at: Unknowns) -> Equations:
    """Build the normal equations at a point.

    Parameters
    ----------
    problem : with what is unknown
    at : point

    Returns
    -------
    bands of each trial's coefficients, cross terms and shared unknowns
    """
    data = linearize_data(problem, at)
    H = data.H.copy()
    g = data.g.copy()
    for columns, rows, miss in prior_rows(problem, at):
        H[columns, columns] += rows.T @ rows
        g[columns] += rows.T @ miss
    return Equations(data.trials, H, g)


def linearize_data(problem: Problem, at: Unknowns) -> Equations:
    """Build the normal equations of what was recorded at a point.

    Parameters
    ----------
    problem : with what is unknown
    at : point

    Returns
    -------
    as `linearize`, without what is known of shared unknowns before
    """
    tree = problem.arrays(at)
    locations = problem.placed(at.factors, at.shifts)
    p = problem.count
    H = np.zeros((p, p))
    g = np.zeros(p)
    nearby = _neighbors(problem, at)
    trials = tuple(
        _trial_equations(problem, at, trial, coefficients, tree, locations, nearby, H, g)
        for trial, coefficients in zip(problem.trials, at.motions, strict=True)
    )
    return Equations(trials, H, g)


def _neighbors(problem: Problem, at: Unknowns) -> list[tuple[TreeArrays, Array]]:
    """Build trees and marker positions with each length a little longer.

    Returns
    -------
    for each length its tree, and (markers, 3) positions [m]
    """
    result = []
    tree = problem.arrays(at)
    for i in range(len(at.factors) if problem.body else 0):
        factors = at.factors.copy()
        factors[i] += LENGTH_STEP
        pre, post, coefficients = _length_slopes(problem)[i]
        longer = tree._replace(
            pre_p=tree.pre_p + LENGTH_STEP * pre,
            post_p=tree.post_p + LENGTH_STEP * post,
            functions=tree.functions._replace(
                coefficients=tree.functions.coefficients + LENGTH_STEP * coefficients
            ),
        )
        result.append((longer, problem.placed(factors, at.shifts)))
    return result


@lru_cache(maxsize=4)
def _length_slopes(problem: Problem) -> list[tuple[Array, Array, Array]]:
    """Differentiate the tree's constants in each length: nearly linear, so once is enough."""
    unstretched = compile_tree(problem.model).arrays
    result = []
    for i in range(len(problem.lengths)):
        factors = np.ones(len(problem.lengths))
        factors[i] += LENGTH_STEP
        longer = compile_tree(problem.stretched(factors)).arrays
        pre = (longer.pre_p - unstretched.pre_p) / LENGTH_STEP
        post = (longer.post_p - unstretched.post_p) / LENGTH_STEP
        of_functions = longer.functions.coefficients - unstretched.functions.coefficients
        coefficients = of_functions / LENGTH_STEP
        result.append((pre, post, coefficients))
    return result


@read_only
class _Slopes:
    """Derivatives of a trial's frames.

    Attributes
    ----------
    rates : (3, frames, 6, free) of the residual in values, rates and accelerations
    moved : (frames, free, 3 markers) of the markers
    lengths_of_markers : (frames, 3 markers, lengths)
    lengths_of_residual : (frames, 6, lengths)
    turned : (frames, markers, 3, 3) of each marker in its own position
    masses : (frames, 6, 10 links moved)
    """

    rates: Array
    moved: Array
    lengths_of_markers: Array
    lengths_of_residual: Array
    turned: Array
    masses: Array


def slopes(
    problem: Problem,
    at: Unknowns,
    trial: TrialData,
    rates: Rates,
    nearby: list[tuple[TreeArrays, Array]],
) -> _Slopes:
    """Differentiate markers and residuals of all frames in all unknowns.

    Parameters
    ----------
    problem : with what is unknown
    at : point
    trial : one of the problem's
    rates : (frames, coordinates) each, consistent with the couplers
    nearby : trees and marker positions with each length a little longer

    Returns
    -------
    derivatives; those of the residual are 0 where it is not used
    """
    free = problem.pose.free
    frames = len(trial.time)
    m = len(problem.locations)
    tree = problem.arrays(at)
    locations = problem.placed(at.factors, at.shifts)
    of_rates = np.empty((3, frames, 6, len(free)))
    moved = np.empty((frames, len(free), 3 * m))
    wrench = trial.wrench

    def part(start: int, stop: int) -> None:
        s = slice(start, stop)
        difference_frames(
            tree,
            problem.pose.markers.body,
            locations,
            free,
            *(rate[s] for rate in rates),
            wrench[s],
            of_rates[0, s],
            of_rates[1, s],
            of_rates[2, s],
            moved[s],
        )

    over_frames(part, frames)
    of_rates[:, ~trial.use] = 0.0
    errors, residual = problem.predict(tree, locations, trial, rates)
    by_length = np.empty((frames, 3 * m, len(nearby)))
    residual_by_length = np.empty((frames, 6, len(nearby)))
    for i, (other, places) in enumerate(nearby):
        longer, more = problem.predict(other, places, trial, rates)
        by_length[:, :, i] = (longer - errors).reshape(frames, -1) / LENGTH_STEP
        residual_by_length[:, :, i] = (more - residual) / LENGTH_STEP
    turned = np.empty((frames, m, 3, 3))
    for i in range(3 if problem.body else 0):
        turned[:, :, :, i] = (
            problem.predict(tree, locations + np.eye(3)[i], trial, rates)[0] - errors
        )
    by_mass = np.zeros((frames, 6, 0))
    if problem.masses:
        by_mass = _by_mass(problem, at, trial, rates)
    return _Slopes(of_rates, moved, by_length, residual_by_length, turned, by_mass)


def _by_mass(problem: Problem, at: Unknowns, trial: TrialData, rates: Rates) -> Array:
    """Differentiate residuals in the changes of pseudo-inertias.

    Returns
    -------
    (frames, 6, 10 links moved)
    """
    moved = problem.prior.moved
    model = problem.stretched(at.factors)
    T = tangents(at.parameters[moved])
    result = np.zeros((len(trial.time), 6, 10 * len(moved)))
    motion = Motion(
        time=trial.time,
        names=problem.model.coordinate_names,
        values=rates[0].copy(),
        velocities=rates[1].copy(),
        accelerations=rates[2].copy(),
    )
    for block in regressor_blocks(model, motion):
        by_link = block.rows.reshape(len(block.rows), 6, -1, 10)[:, :, moved]
        result[block.frames] = np.einsum("fqli,lij->fqlj", by_link, T, optimize=True).reshape(
            len(by_link), 6, -1
        )
    result[~trial.use] = 0.0
    return result


def _trial_equations(
    problem: Problem,
    at: Unknowns,
    trial: TrialData,
    coefficients: Array,
    tree: TreeArrays,
    locations: Array,
    nearby: list[tuple[TreeArrays, Array]],
    H: Array,
    g: Array,
) -> BandedEquations:
    """Build the normal equations of a trial, and add its part of the shared unknowns to H, g.

    Parameters
    ----------
    coefficients : (coefficients, free) of its splines
    tree, locations : of the point; (markers, 3) [m]
    nearby : trees and marker positions with each length a little longer
    H, g : (shared, shared), (shared,), changed in place
    """
    n = len(problem.pose.free)
    p = problem.count
    basis = trial.basis
    rates = problem.rates(trial, coefficients)
    errors, residual = problem.predict(tree, locations, trial, rates)
    of = slopes(problem, at, trial, rates, nearby)
    weights = _weights(problem, trial)
    seen = np.isfinite(trial.observed).all(axis=2)
    marker_root = np.sqrt(
        np.repeat(np.where(seen, weights.marker * problem.pose.markers.weight, 0.0), 3, axis=1)
    )
    residual_root = np.sqrt(weights.share * trial.trust)[:, None] / problem.residual_sd
    misses = marker_root * errors.reshape(len(errors), -1)
    beyond = _beyond(problem, rates[0][:, problem.pose.free])
    departed = coefficients - _start(trial, tuple(problem.pose.free.tolist()))
    values = basis.at(departed)
    bends = basis.at(departed, 2)
    window = WIDTH * n
    band = np.zeros((window, basis.count * n))
    right = np.zeros(basis.count * n)
    cross = np.zeros((basis.count * n, p))
    row, column = np.tril_indices(window)
    # Markers do not feel masses, which come last.
    shared = problem.columns()[2].start
    alphas = problem.alphas
    for first in np.unique(basis.first):
        f = np.flatnonzero(basis.first == first)
        w0 = basis.weights[0, f]
        w1 = basis.weights[1, f]
        w2 = basis.weights[2, f]
        # Residual rows depend on the window through values, rates and accelerations.
        A = sum(
            w[:, None, :, None] * of.rates[nu, f][:, :, None, :]
            for nu, w in enumerate((w0, w1, w2))
        )
        A = (A * residual_root[f][:, :, None, None]).reshape(6 * len(f), window)
        b = (residual_root[f] * residual[f]).ravel()
        M = of.moved[f] * marker_root[f, None]
        shared_markers, shared_residual = _shared_rows(problem, of, f, marker_root, residual_root)
        block = A.T @ A
        per_frame = np.einsum("fir,fjr->fij", M, M, optimize=True)
        if problem.tissue is not None:
            # Markers depend on the window through values less alpha times accelerations.
            soft = alphas * per_frame
            mixed = np.einsum("fa,fb,fij->aibj", w0, w2, soft, optimize=True).reshape(
                window, window
            )
            both = np.einsum("fa,fb,fij->aibj", w2, w2, alphas[:, None] * soft, optimize=True)
            block += both.reshape(window, window) - mixed - mixed.T
        diagonal = weights.value + weights.bound * (beyond[f] != 0.0)
        per_frame[:, np.arange(n), np.arange(n)] += diagonal
        block += np.einsum("fa,fb,fij->aibj", w0, w0, per_frame, optimize=True).reshape(
            window, window
        )
        bend = np.einsum("fa,fb->ab", w2, w2)
        block += np.kron(bend, np.diag(weights.acceleration))
        seen = np.einsum("fir,fr->fi", M, misses[f])
        pull = seen + weights.value * values[f] + weights.bound * beyond[f]
        bent = weights.acceleration * bends[f] - alphas * seen
        gradient = np.einsum("fa,fi->ai", w0, pull) + np.einsum("fa,fi->ai", w2, bent)
        span = slice(first * n, first * n + window)
        band[row - column, first * n + column] += block[row, column]
        right[span] += gradient.ravel() + A.T @ b
        if p:
            joined = np.einsum("fir,frp->fip", M, shared_markers, optimize=True)
            parts = (
                [(w0, joined)]
                if problem.tissue is None
                else [(w0, joined), (w2, -alphas[:, None] * joined)]
            )
            for w, of_coordinates in parts:
                crossed = np.einsum("fa,fip->aip", w, of_coordinates, optimize=True)
                cross[span, :shared] += crossed.reshape(window, shared)
            cross[span] += A.T @ shared_residual
            flat = shared_markers.reshape(len(f) * errors[0].size, shared)
            H[:shared, :shared] += flat.T @ flat
            H += shared_residual.T @ shared_residual
            g[:shared] += flat.T @ misses[f].ravel()
            g += shared_residual.T @ b
    return BandedEquations(band, right, cross)


def _shared_rows(
    problem: Problem, of: _Slopes, frames: Ints, marker_root: Array, residual_root: Array
) -> tuple[Array, Array]:
    """Build weighted rows in the shared unknowns.

    Parameters
    ----------
    frames : (chosen,) numbers
    marker_root : (frames, 3 markers) roots of weights
    residual_root : (frames, 6) roots of weights

    Returns
    -------
    (chosen, 3 markers, shared less masses) of markers, and (6 chosen, shared) of residuals
    """
    lengths, places, masses = problem.columns()
    m = len(problem.locations)
    markers = np.zeros((len(frames), 3 * m, masses.start))
    residual = np.zeros((len(frames), 6, problem.count))
    if problem.body:
        markers[:, :, lengths] = of.lengths_of_markers[frames]
        blocks = markers[:, :, places].reshape(len(frames), m, 3, m, 3)
        blocks[:, np.arange(m), :, np.arange(m)] = np.swapaxes(of.turned[frames], 0, 1)
        markers[:, :, places] = blocks.reshape(len(frames), 3 * m, 3 * m)
        residual[:, :, lengths] = of.lengths_of_residual[frames]
    if problem.masses:
        residual[:, :, masses] = of.masses[frames]
    markers *= marker_root[frames][:, :, None]
    residual *= residual_root[frames][:, :, None]
    return markers, residual.reshape(6 * len(frames), problem.count)
