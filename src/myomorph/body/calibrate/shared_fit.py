"""Least squares over all frames at once: lengths and marker positions shared, angles eliminated
frame by frame.

The search for them begins at a prior and goes in stages of noise, all at once or in turn.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from myomorph.body.calibrate.angle_slopes import angle_slopes
from myomorph.body.calibrate.calibration import CalibrationOptions, Distances, SideEstimate
from myomorph.body.calibrate.priors import (
    calibration_prior,
    side_differences,
    symmetric_posture,
    usual_shifts,
)
from myomorph.body.calibrate.shared_problem import FrameSet, Point, Reduced, SharedProblem
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.motion.newton import solve_poses
from myomorph.core.motion.pose_problem import PoseProblem
from myomorph.core.motion.starts import closed_defaults, root_coordinates
from myomorph.core.motion.stretch import FRAMES_AT_ONCE, Stretch, frame_blocks, with_travel
from myomorph.core.motion.tasks.loops import ties_of
from myomorph.core.motion.tasks.markers import MarkerArrays
from myomorph.core.rigid.frames import over_frames
from myomorph.core.rigid.loops import loop_basis
from myomorph.core.rigid.tree import Tree, compile_tree

Bools = NDArray[np.bool_]

LEAST_GAIN = 1e-7  # A step that lowers the cost by a smaller share is the last
SETTLED = 1e-6  # A frame is settled when its last step moves no coordinate further [rad or m]
KINK = 1e-4
"""Where no step lowers the cost although one promised at most this share, angles at their bounds
bend it there.
"""

RESTARTS = 8  # Frames from whose angles all others are tried
# Partial sums over frames: memory does not grow with frames, and the order of summation is always
# the same
SLOTS = 16


def settle(
    problem: SharedProblem, x: Array, angles: Sequence[Array], variance: float, most: int = 50
) -> Point:
    """Inverse kinematics of all frames on the model that x makes."""
    tree = compile_tree(problem.stretched(x))
    poses = []
    solutions = []
    costs = []
    converged = 0
    for group, start in zip(problem.sets, angles, strict=True):
        pose = _pose_of(problem, x, group, variance, tree)
        solved = solve_poses(
            tree, pose, start, (problem.posture_weight, SETTLED, most), chained=False, chunk=16
        )
        poses.append(pose)
        solutions.append(solved.values)
        costs.append(solved.cost * _seen_weight(problem, group))
        converged += int(solved.converged.sum())
    frames = max(sum(len(values) for values in solutions), 1)
    return Point(
        x=x,
        tree=tree,
        poses=tuple(poses),
        angles=tuple(solutions),
        data=tuple(costs),
        prior=problem.prior_cost(x, solutions),
        settled=converged / frames,
    )


def _pose_of(
    problem: SharedProblem, x: Array, group: FrameSet, variance: float, tree: Tree
) -> PoseProblem:
    """Inverse kinematics of one recording on the model of x; known coordinates are tasks."""
    seen = _seen_weight(problem, group)
    # Markers count as a mean, and tasks beside it.
    weight = group.known * variance / max(float(np.median(seen)) if len(seen) else 1.0, 1e-12)
    errors = np.empty(group.observed.shape[:2])
    moved = problem.pose.with_markers(
        location=problem.placed(x), observed=group.observed, errors=errors
    )
    return moved.with_coordinates(weight=weight, value=group.targets)._replace(
        fixed=group.targets, posture=problem.posture, ties=ties_of(tree)
    )


def _seen_weight(problem: SharedProblem, group: FrameSet) -> Array:
    """(frames,) sum of the weights of the markers that are seen."""
    seen: Array = np.where(
        np.isfinite(group.observed).all(axis=2), problem.pose.markers.weight, 0.0
    ).sum(axis=1)
    return seen


@read_only
class SetSums:
    """Sums over the frames of one recording, of which the normal equations are made.

    Attributes
    ----------
    fixed_H, fixed_g : (shared, shared), lower triangle, and (shared,) at fixed angles
    taken_H, taken_g : sums of E^T E and E^T e, what the angles take away, see `reduce`
    angles_free : angles of all frames that are not at a bound
    errors : (frames, markers) distances [m], NaN where unseen
    """

    fixed_H: Array
    fixed_g: Array
    taken_H: Array
    taken_g: Array
    angles_free: int
    errors: Array


def reduce(problem: SharedProblem, at: Point) -> Reduced:
    """Normal equations of the shared unknowns at a point, with the angles eliminated.

    The angles of a frame move the residuals r of that frame alone. With the slopes J_s of its
    weighted residuals in the shared unknowns s, and J_q in its angles,

        (H - sum E^T E) ds = -(g - sum E^T e),   [E e] = L^-1 J_q^T [J_s r],   L L^T = J_q^T J_q

    with sums over all frames (Schur complement). The overall size, last among the unknowns, moves
    no marker: its row and column are 0.
    """
    shared = len(at.x) - 1
    stretch = with_travel(problem.stretch, problem.model, at.x[: len(problem.lengths)])
    tied, tied_stretch = problem.tied(at.tree, stretch)
    unstretched = compile_tree(problem.model)
    defaults = closed_defaults(unstretched)[None]
    angles_closed = loop_basis(unstretched, defaults, problem.pose.free).rank

    fixed_H = np.zeros((shared, shared))
    fixed_g = np.zeros(shared)
    taken_H = np.zeros((shared, shared))
    taken_g = np.zeros(shared)
    errors = []
    angles_free = 0
    for pose, angles in zip(at.poses, at.angles, strict=True):
        sums = _set_sums(problem, at.tree, pose, angles, stretch, tied, tied_stretch, shared)
        fixed_H += sums.fixed_H
        fixed_g += sums.fixed_g
        taken_H += sums.taken_H
        taken_g += sums.taken_g
        errors.append(sums.errors)
        # Of each frame, as many angles as loops close follow from the others.
        angles_free += sums.angles_free - len(angles) * angles_closed
    fixed_H = np.tril(fixed_H) + np.tril(fixed_H, -1).T
    return Reduced(
        H=np.pad(fixed_H - taken_H, (0, 1)),
        g=np.pad(fixed_g - taken_g, (0, 1)),
        fixed_H=np.pad(fixed_H, (0, 1)),
        fixed_g=np.pad(fixed_g, (0, 1)),
        errors=tuple(errors),
        angles_free=angles_free,
    )


def _set_sums(
    problem: SharedProblem,
    tree: Tree,
    pose: PoseProblem,
    angles: Array,
    stretch: Stretch,
    tied: MarkerArrays,
    tied_stretch: Stretch,
    shared: int,
) -> SetSums:
    """Sums over the frames of one recording.

    Frames are summed in slots, each by one thread, and the slots one after the other: the result
    does not depend on how many threads there are.

    Parameters
    ----------
    pose, angles : of the recording, (frames, coordinates) [rad or m]
    stretch, tied_stretch : how markers, and points that loops tie, move with the lengths
    shared : number of shared unknowns, without the overall size
    """
    frames = len(angles)
    block = max(1, math.ceil(frames / SLOTS))
    slots = math.ceil(frames / block)
    fixed_H = np.zeros((slots, shared, shared))
    fixed_g = np.zeros((slots, shared))
    taken_H = np.zeros((slots, shared, shared))
    taken_g = np.zeros((slots, shared))
    angles_free = np.zeros(slots, np.int64)
    errors = np.empty(pose.markers.observed.shape[:2])

    def add(first: int, last: int) -> None:
        slot = first // block
        for start in range(first, last, FRAMES_AT_ONCE):
            stop = min(start + FRAMES_AT_ONCE, last)
            eliminated = np.empty((len(problem.pose.free) * (stop - start), shared + 1))
            frame_blocks(
                tree.arrays,
                pose,
                stretch,
                tied,
                tied_stretch,
                start,
                stop,
                problem.posture_weight,
                angles,
                fixed_H[slot],
                fixed_g[slot],
                eliminated,
                errors,
            )
            E = eliminated[:, :-1]
            e = eliminated[:, -1]
            taken_H[slot] += E.T @ E
            taken_g[slot] += E.T @ e
            # Rows of angles at a bound are 0.
            angles_free[slot] += int(eliminated.any(axis=1).sum())

    over_frames(add, frames, chunk=block)
    return SetSums(
        fixed_H=fixed_H.sum(axis=0),
        fixed_g=fixed_g.sum(axis=0),
        taken_H=taken_H.sum(axis=0),
        taken_g=taken_g.sum(axis=0),
        angles_free=int(angles_free.sum()),
        errors=errors,
    )


def settle_anew(problem: SharedProblem, at: Point, root: Sequence[int], variance: float) -> Point:
    """The same unknowns, every frame also tried from the angles of other frames, the best of each
    kept. A frame may rest in a wrong valley (an arm turned half round), where it would draw the
    markers along; frames that do not know the way out from there start beyond it. The whole body
    keeps its own place.
    """
    every = np.concatenate(at.angles)
    if len(every) < 2:
        return at
    ends = np.cumsum([len(angle) for angle in at.angles])[:-1]
    order = np.argsort(np.concatenate(at.data))
    best = [angle.copy() for angle in at.angles]
    cost = [costs.copy() for costs in at.data]
    for index in range(min(RESTARTS, len(every))):
        start = np.repeat(every[order[index * len(order) // RESTARTS]][None], len(every), axis=0)
        start[:, list(root)] = every[:, list(root)]
        settled = settle(problem, at.x, np.split(start, ends), variance)
        for mine, theirs, least, other in zip(
            best, settled.angles, cost, settled.data, strict=True
        ):
            better = other < 0.99 * least
            mine[better], least[better] = theirs[better], other[better]
    return settle(problem, at.x, best, variance)


@dataclass(frozen=True, eq=False)
class Minimum:
    """Where the search ended: normal equations without priors, costs, and the largest change in the
    last step.
    """

    point: Point
    reduced: Reduced
    converged: bool
    costs: tuple[float, ...]
    change: float = 0.0


def minimise(
    problem: SharedProblem,
    start: Point,
    variance: float,
    free: NDArray[np.bool_],
    iterations: int,
    tolerance: float = 1e-5,
    after_step: Callable[[], None] | None = None,
) -> Minimum:
    """Levenberg-Marquardt steps of the `free` shared unknowns, frames settled again after each, to
    the tolerance.
    """
    point = replace(start, prior=problem.prior_cost(start.x, start.angles))
    costs = [start.cost(variance)]
    damping = 1e-6
    change = float("inf")
    lengths = len(problem.lengths)
    units = np.ones(len(free))
    units[lengths:-1] = problem.unit
    units = units[free]
    for _ in range(iterations):
        reduced = reduce(problem, point)
        H, g = _with_priors(problem, point, reduced, variance, free)
        accepted = False
        small = False
        promised = 1.0  # share of the cost that the step should take off, by the quadratic model
        # Frames settle to a tolerance of their own, so that the cost of the last small step is
        # noise.
        while not accepted and not small and damping < 1e6 and promised > LEAST_GAIN:
            step = -np.linalg.solve(H + damping * np.diag(np.diag(H)), g)
            change = float(np.abs(step / units).max(initial=0.0))
            small = damping <= 1e-6 and change <= tolerance
            promised = -float(2.0 * g @ step + step @ H @ step) / max(point.cost(variance), 1e-300)
            x = point.x.copy()
            x[free] += step
            # Beyond, lengths vanish and the quadratic model says nothing.
            if x[:lengths].min(initial=1.0) > 0.1 and change < 1.0:
                trial = settle(problem, x, point.angles, variance)
                accepted = trial.cost(variance) <= point.cost(variance) * (1.0 + 1e-12)
            damping = max(damping * 0.1, 1e-9) if accepted else damping * 10.0
        if after_step:
            after_step()
        if not accepted:
            return Minimum(
                point=point,
                reduced=reduced,
                converged=small or promised <= KINK,
                costs=tuple(costs),
                change=change,
            )
        gained = 1.0 - trial.cost(variance) / max(point.cost(variance), 1e-300)
        point = trial
        costs.append(point.cost(variance))
        if change <= tolerance or gained < LEAST_GAIN:
            return Minimum(
                point=point,
                reduced=reduce(problem, point),
                converged=True,
                costs=tuple(costs),
                change=change,
            )
    return Minimum(
        point=point,
        reduced=reduce(problem, point),
        converged=False,
        costs=tuple(costs),
        change=change,
    )


def _with_priors(
    problem: SharedProblem, point: Point, reduced: Reduced, variance: float, free: Bools
) -> tuple[Array, Array]:
    """Hessian and gradient of half the cost over the free unknowns, priors included."""
    prior = problem.prior
    rows = prior.rows[:, free]
    H = reduced.H[np.ix_(free, free)] + variance * rows.T @ rows
    g = reduced.g[free] + variance * rows.T @ (prior.rows @ point.x - prior.right)
    posture = problem.mean_posture
    if posture is not None:
        slopes = posture.rows @ angle_slopes(problem, point).mean[:, free]
        H += variance * slopes.T @ slopes
        g += variance * slopes.T @ posture.misfit(point.angles)
    return H, g


def place_at_fixed_angles(
    problem: SharedProblem, at: Minimum, variance: float, free: NDArray[np.bool_]
) -> Array:
    """[D] 3.2.1 (c): the unknowns, the free ones of which fit best while all angles stay."""
    rows = problem.prior.rows[:, free]
    H = at.reduced.fixed_H[np.ix_(free, free)] + variance * rows.T @ rows
    g = at.reduced.fixed_g[free] + variance * rows.T @ (
        problem.prior.rows @ at.point.x - problem.prior.right
    )
    x = at.point.x.copy()
    x[free] -= np.linalg.solve(H, g)
    return x


NOISE_UNKNOWN = 0.005
NOISE_LEAST = 1e-4
NOISE_AT_FIRST = 0.02
"""Of a marker along one axis: where the residual cannot show it, at least, and of the first stage
[length units].
"""

SIDE_REPEATS = 3  # Stages done again where the last one shows other sides that differ
TAIL = 3.0  # Degrees of freedom of Student's t, of which shifts of markers are a sample


@dataclass(frozen=True, eq=False)
class Search:
    """Where the search ended (`found`, with the prior of the last stage), and how it came there.
    `noise` is the standard deviation of a marker along one axis [m], `steps` counts those of all
    stages, `free` (unknowns,) says what was searched for, `sides` which pairs of lengths the prior
    lets differ.
    """

    problem: SharedProblem
    found: Minimum
    noise: float
    noise_found: bool
    steps: int
    free: Bools
    sides: tuple[SideEstimate, ...] = ()


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
    noise = distances.noise or NOISE_UNKNOWN * distances.unit
    at_first = NOISE_AT_FIRST * distances.unit
    if distances.noise:
        noise *= float(np.sqrt(max(1.0, frames / options.independent_frames)))
    root = root_coordinates(compile_tree(problem.model))
    # Trusting the model more at first keeps markers from following frames that are still turned
    # wrongly.
    stages = [noise] if noise >= at_first else [at_first, noise]
    point = settle(problem, x, angles, stages[0] ** 2)
    if not np.isfinite(point.cost(0.0)):
        raise BadData(
            f"calibration: the loops of model '{problem.model.name}' cannot be closed at {size:.3g}"
            " its size"
        )
    known = True
    usual = usual_shifts(problem.model, names, distances)
    repeats = 0
    sides: tuple[SideEstimate, ...] = ()
    landmark = np.array([problem.model.marker(name).fixed for name in names])
    differing: frozenset[tuple[str, str]] = frozenset()
    if options.method == "joint":
        tree = compile_tree(problem.model)
        problem = replace(
            problem,
            mean_posture=symmetric_posture(
                tree, problem.pose.free, point.angles, options.posture_sd
            ),
        )
    stages.append(noise)
    while stages:
        noise = stages.pop(0)
        point = settle_anew(problem, point, root, noise**2)
        left = max(1, options.iterations - steps)
        if options.method == "joint":
            minimum = minimise(
                problem, point, noise**2, free, left, 1e-3 if stages else 1e-5, one_more
            )
        else:
            minimum = _alternate(problem, point, noise**2, lengths, shifts, left, one_more)
        point = minimum.point
        if noise < at_first:
            sides = side_differences(
                problem.lengths, point.x, minimum.reduced.H / noise**2, problem.prior, options
            )
            # What was set free stays so: a thigh and its shank freed in turn would never settle.
            now = differing | {(side.first, side.second) for side in sides if side.differs}
            # A side set free shows in the others' evidence: the last stage is done again.
            if (
                not stages
                and now != differing
                and repeats < SIDE_REPEATS
                and steps < options.iterations
            ):
                stages = [noise]
                repeats = repeats + 1
            differing = now if stages else differing
        if stages:
            # The variance that Student's t gives each marker: one that lies far off is no longer
            # pulled back.
            shifts_now = np.linalg.norm(point.x[len(problem.lengths) : -1].reshape(-1, 3), axis=1)
            released = usual * np.sqrt((TAIL + (shifts_now / usual) ** 2) / (TAIL + 3.0))
            # One on a bony landmark is not let go: it holds the zero angles of its body.
            released = np.where(landmark, usual, released)
            prior = calibration_prior(problem.lengths, released, options, size, differing)
            problem = replace(problem, prior=prior)
        if not stages and not distances.noise:
            shown_noise, known = _noise(problem, minimum, free, noise**2)
            if abs(shown_noise - noise) > 0.05 * noise and steps < options.iterations:
                stages = [shown_noise]
    sides = tuple(replace(side, differs=(side.first, side.second) in differing) for side in sides)
    return Search(
        problem=problem,
        found=minimum,
        noise=noise,
        noise_found=known,
        steps=steps,
        free=free,
        sides=sides,
    )


def _may_move(
    problem: SharedProblem, names: Sequence[str], options: CalibrationOptions
) -> tuple[Bools, Bools]:
    """Which unknowns are lengths or the size, and which are shifts of markers that may move."""
    n = len(problem.lengths)
    total = problem.prior.rows.shape[1]
    lengths = np.zeros(total, np.bool_)
    shifts = np.zeros(total, np.bool_)
    lengths[:n] = lengths[-1] = True
    for m, name in enumerate(names):
        shifts[n + 3 * m : n + 3 * m + 3] = name not in options.fixed_markers
    return lengths, shifts


def _noise(
    problem: SharedProblem, minimum: Minimum, free: Bools, variance: float
) -> tuple[float, bool]:
    """Standard deviation of a marker along one axis from what the fit leaves, and whether that can
    be known.
    """
    squares = 0.0
    seen = 0
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
    """[D] 3.2.1: (b) angles and lengths, (c) marker positions at fixed angles, in turn, until
    neither moves.
    """
    costs: list[float] = []
    for _ in range(most):
        minimum = minimise(problem, point, variance, lengths, 3)
        x = place_at_fixed_angles(problem, minimum, variance, shifts)
        point = settle(problem, x, minimum.point.angles, variance)
        costs.append(point.cost(variance))
        after_step()
        if len(costs) > 1 and costs[-2] - costs[-1] <= 1e-5 * costs[-1]:
            return Minimum(
                point=point, reduced=reduce(problem, point), converged=True, costs=tuple(costs)
            )
    return Minimum(point=point, reduced=reduce(problem, point), converged=False, costs=tuple(costs))
