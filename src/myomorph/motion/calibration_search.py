"""The search for the lengths and marker places of a body, from a prior: stages of noise, joint or alternating."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from myomorph.model.arrays import Array
from myomorph.model.errors import BadData
from myomorph.motion.body.priors import (
    SideDifference,
    calibration_prior,
    side_differences,
    symmetric_posture,
    usual_shifts,
)
from myomorph.motion.body.shared_fit import Minimum, minimise, place_at_fixed_angles, reduce, settle, settle_anew
from myomorph.motion.body.shared_problem import Point, SharedProblem
from myomorph.motion.calibration import CalibrationOptions, Distances
from myomorph.motion.starts import root_coordinates
from myomorph.rigid.tree import compile_tree

Bools = NDArray[np.bool_]

NOISE_UNKNOWN, NOISE_LEAST, NOISE_AT_FIRST = 0.005, 1e-4, 0.02
"""Of a marker along one axis: where the residual cannot show it, at least, and of the first stage [length units]."""

SIDE_REPEATS = 3
"""Stages done again where the last one shows other sides that differ."""

TAIL = 3.0
"""Degrees of freedom of Student's t, of which shifts of markers are a sample."""


@dataclass(frozen=True, eq=False)
class Search:
    """Where the search ended (`found`, with the prior of the last stage), and how it came there. `noise` is the
    standard deviation of a marker along one axis [m], `costs` are of the last stage's steps, `steps` counts those of
    all stages, `free` (unknowns,) says what was searched for, `differing` pairs of lengths the prior lets differ.
    """

    problem: SharedProblem
    found: Minimum
    start: Point
    noise: float
    noise_found: bool
    costs: tuple[float, ...]
    steps: int
    free: Bools
    sides: tuple[SideDifference, ...] = ()
    differing: tuple[tuple[int, int], ...] = ()


def search_minimum(
    problem: SharedProblem,
    names: Sequence[str],
    size: float,
    angles: Sequence[Array],
    options: CalibrationOptions,
    distances: Distances,
    progress: Callable[[int], None] | None,
) -> Search:
    """Minimum of the problem, the noise taken from its residual until both agree."""
    lengths, shifts = _may_move(problem, names, options)
    free = lengths | shifts
    x = np.zeros(problem.prior.rows.shape[1])
    x[lengths] = size
    steps = 0

    def one_more() -> None:
        nonlocal steps
        steps += 1
        if progress and steps <= options.iterations:
            progress(1)

    frames = sum(len(angle) for angle in angles)
    noise, at_first = distances.noise or NOISE_UNKNOWN * distances.unit, NOISE_AT_FIRST * distances.unit
    if distances.noise:
        noise *= float(np.sqrt(max(1.0, frames / options.independent_frames)))
    root = root_coordinates(compile_tree(problem.model))
    # Trusting the model more at first keeps markers from following frames that are still turned wrongly.
    stages = [noise] if noise >= at_first else [at_first, noise]
    start = point = settle(problem, x, angles, stages[0] ** 2)
    if not np.isfinite(point.cost(0.0)):
        raise BadData(f"calibration: the loops of model '{problem.model.name}' cannot be closed at {size:.3g} its size")
    known, usual, repeats = True, usual_shifts(problem.model, names, distances), 0
    sides: tuple[SideDifference, ...] = ()
    landmark = np.array([problem.model.marker(name).fixed for name in names])
    differing: frozenset[tuple[int, int]] = frozenset()
    if options.method == "joint":
        tree = compile_tree(problem.model)
        problem = replace(
            problem, mean_posture=symmetric_posture(tree, problem.pose.free, point.angles, options.posture_sd)
        )
    stages.append(noise)
    while stages:
        noise = stages.pop(0)
        point = settle_anew(problem, point, root, noise**2)
        left = max(1, options.iterations - steps)
        if options.method == "joint":
            minimum = minimise(problem, point, noise**2, free, left, 1e-3 if stages else 1e-5, one_more)
        else:
            minimum = _alternate(problem, point, noise**2, lengths, shifts, left, one_more)
        point = minimum.point
        if noise < at_first:
            sides = side_differences(problem.lengths, point.x, minimum.reduced.H / noise**2, problem.prior, options)
            # What was set free stays so: a thigh and its shank freed in turn would never settle.
            now = differing | {(side.first, side.second) for side in sides if side.differs}
            # A side set free shows in the others' evidence: the last stage is done again.
            if not stages and now != differing and repeats < SIDE_REPEATS and steps < options.iterations:
                stages, repeats = [noise], repeats + 1
            differing = now if stages else differing
        if stages:
            # The variance that Student's t gives each marker: one that lies far off is no longer pulled back.
            shifts_now = np.linalg.norm(point.x[len(problem.lengths) : -1].reshape(-1, 3), axis=1)
            released = usual * np.sqrt((TAIL + (shifts_now / usual) ** 2) / (TAIL + 3.0))
            # One on a bony landmark is not let go: it holds the zero angles of its body.
            released = np.where(landmark, usual, released)
            prior = calibration_prior(problem.lengths, released, options, size, tuple(differing))
            problem = replace(problem, prior=prior)
        if not stages and not distances.noise:
            shown_noise, known = _noise(problem, minimum, free, noise**2)
            if abs(shown_noise - noise) > 0.05 * noise and steps < options.iterations:
                stages = [shown_noise]
    return Search(problem, minimum, start, noise, known, minimum.costs, steps, free, sides, tuple(differing))


def _may_move(problem: SharedProblem, names: Sequence[str], options: CalibrationOptions) -> tuple[Bools, Bools]:
    """Which unknowns are lengths or the size, and which are shifts of markers that may move."""
    n, total = len(problem.lengths), problem.prior.rows.shape[1]
    lengths, shifts = np.zeros(total, np.bool_), np.zeros(total, np.bool_)
    lengths[:n] = lengths[-1] = True
    for m, name in enumerate(names):
        shifts[n + 3 * m : n + 3 * m + 3] = name not in options.fixed_markers
    return lengths, shifts


def _noise(problem: SharedProblem, minimum: Minimum, free: Bools, variance: float) -> tuple[float, bool]:
    """Standard deviation of a marker along one axis from what the fit leaves, and whether that can be known."""
    squares, seen = 0.0, 0
    for errors in minimum.reduced.errors:
        squares += float(np.nansum(problem.pose.markers.weight * errors**2))
        seen += 3 * int(np.isfinite(errors).sum())
    rows = problem.prior.rows[:, free]
    H = minimum.reduced.H[np.ix_(free, free)]
    used = float(np.trace(np.linalg.solve(H + variance * rows.T @ rows, H)))
    left = seen - minimum.reduced.angles_free - used
    if left < 0.2 * seen:
        return NOISE_UNKNOWN * problem.unit, False
    return max(float(np.sqrt(squares / left)), NOISE_LEAST * problem.unit), True


def _alternate(
    problem: SharedProblem,
    point: Point,
    variance: float,
    lengths: Bools,
    shifts: Bools,
    most: int,
    after_step: Callable[[], None],
) -> Minimum:
    """[D] 3.2.1: (b) angles and lengths, (c) marker positions at fixed angles, in turn, until neither moves."""
    costs: list[float] = []
    for _ in range(most):
        minimum = minimise(problem, point, variance, lengths, 3)
        x = place_at_fixed_angles(problem, minimum, variance, shifts)
        point = settle(problem, x, minimum.point.angles, variance)
        costs.append(point.cost(variance))
        after_step()
        if len(costs) > 1 and costs[-2] - costs[-1] <= 1e-5 * costs[-1]:
            return Minimum(point, reduce(problem, point), True, tuple(costs))
    return Minimum(point, reduce(problem, point), False, tuple(costs))
