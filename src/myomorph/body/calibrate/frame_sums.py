"""All frames at their best angles, and the normal equations that they leave of shared unknowns."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from myomorph.body.calibrate.shared_problem import FrameSet, Point, Reduced, SharedProblem
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.motion.frame_blocks import (
    FRAMES_AT_ONCE,
    BlockSums,
    StretchedProblem,
    frame_blocks,
)
from myomorph.core.motion.newton import Settings, solve_poses
from myomorph.core.motion.pose_problem import PoseProblem
from myomorph.core.motion.starts import closed_defaults
from myomorph.core.motion.stretch import Stretch, with_travel
from myomorph.core.motion.tasks.loops import ties_of
from myomorph.core.motion.tasks.markers import MarkerArrays
from myomorph.core.rigid.frames import over_frames
from myomorph.core.rigid.loops import loop_basis
from myomorph.core.rigid.tree import Tree, compile_tree

SETTLED = 1e-6  # A frame is settled when its last step moves no coordinate further [rad or m]
MAX_STEPS = 50  # Of a frame
MIN_IMPROVEMENT = 0.01  # Share by which the cost from another frame's angles must be lower
RESTARTS = 8  # Frames from whose angles all others are tried
# Partial sums over frames: memory does not grow with frames, and the order of summation is always
# the same
SLOTS = 16


def settle(problem: SharedProblem, x: Array, angles: Sequence[Array], variance: float) -> Point:
    """Solve inverse kinematics of all frames on the model that x makes.

    Parameters
    ----------
    problem : with the recordings
    x : (unknowns,)
    angles : of each recording, where its frames begin (frames, coordinates) [rad or m]
    variance : of a marker along one axis [m^2]

    Returns
    -------
    the unknowns with every frame at its best angles
    """
    return settle_on(compile_tree(problem.stretched(x)), problem, x, angles, variance)


def settle_on(
    tree: Tree, problem: SharedProblem, x: Array, angles: Sequence[Array], variance: float
) -> Point:
    """Solve inverse kinematics of all frames on a model that was compiled before.

    Parameters
    ----------
    tree : of the model that x makes
    problem : with the recordings
    x : (unknowns,)
    angles : of each recording, where its frames begin (frames, coordinates) [rad or m]
    variance : of a marker along one axis [m^2]

    Returns
    -------
    the unknowns with every frame at its best angles
    """
    settings = Settings(
        posture_weight=problem.posture_weight, tolerance=SETTLED, max_steps=MAX_STEPS, chained=False
    )
    poses = []
    solutions = []
    costs = []
    converged = 0
    for group, start in zip(problem.sets, angles, strict=True):
        pose = _pose_of(problem, x, group, variance, tree)
        solved = solve_poses(tree, pose, start, settings)
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
        settled=converged / frames,
    )


def _pose_of(
    problem: SharedProblem, x: Array, group: FrameSet, variance: float, tree: Tree
) -> PoseProblem:
    """Set up inverse kinematics of a recording on the model of x; known coordinates are tasks.

    Parameters
    ----------
    x : (unknowns,)
    group : frames of the recording
    variance : of a marker along one axis [m^2]
    tree : of the model that x makes
    """
    seen = _seen_weight(problem, group)
    # Markers count as a mean, and tasks beside it.
    usual_weight = float(np.median(seen)) if len(seen) else 1.0
    weight = group.known * variance / max(usual_weight, 1e-12)
    errors = np.empty(group.observed.shape[:2])
    moved = problem.pose.with_markers(
        location=problem.placed(x), observed=group.observed, errors=errors
    )
    return moved.with_coordinates(weight=weight, value=group.targets)._replace(
        fixed=group.targets, posture=problem.posture[None], ties=ties_of(tree)
    )


def _seen_weight(problem: SharedProblem, group: FrameSet) -> Array:
    """Sum the weights of the markers that are seen.

    Returns
    -------
    (frames,)
    """
    seen = np.isfinite(group.observed).all(axis=2)
    weight = np.where(seen, problem.pose.markers.weight, 0.0)
    return np.asarray(weight.sum(axis=1))


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
    """Make the normal equations of the shared unknowns at a point, with the angles eliminated.

    The angles of a frame move the residuals r of that frame alone. With the slopes J_s of its
    weighted residuals in the shared unknowns s, and J_q in its angles,

        (H - sum E^T E) ds = -(g - sum E^T e),   [E e] = L^-1 J_q^T [J_s r],   L L^T = J_q^T J_q

    with sums over all frames (Schur complement). The overall size, last among the unknowns, moves
    no marker: its row and column are 0.

    Parameters
    ----------
    problem : of all frames
    at : point at which frames are settled

    Returns
    -------
    (unknowns, unknowns) and (unknowns,), angles eliminated and at fixed angles, with errors of the
        markers [m]
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
    """Sum over the frames of one recording.

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
    stretched = StretchedProblem(
        pose=pose,
        stretch=stretch,
        tied=tied,
        tied_stretch=tied_stretch,
        posture_weight=problem.posture_weight,
    )

    def add(first: int, last: int) -> None:
        slot = first // block
        for start in range(first, last, FRAMES_AT_ONCE):
            stop = min(start + FRAMES_AT_ONCE, last)
            eliminated = np.empty((len(problem.pose.free) * (stop - start), shared + 1))
            sums = BlockSums(H=fixed_H[slot], g=fixed_g[slot], eliminated=eliminated, errors=errors)
            frame_blocks(tree.arrays, stretched, (start, stop), angles, sums)
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
    """Try every frame from the angles of other frames too, and keep the best.

    A frame may rest in a wrong valley (an arm turned half round), where it would draw the markers
    along; frames that do not know the way out from there start beyond it. The whole body keeps its
    own position.

    Parameters
    ----------
    problem : of all frames
    at : point at which frames are settled
    root : coordinates of the whole body, which stay those of each frame
    variance : of a marker along one axis [m^2]

    Returns
    -------
    the same unknowns, every frame at the best angles found
    """
    angles = np.concatenate(at.angles)
    if len(angles) < 2:
        return at
    ends = np.cumsum([len(part) for part in at.angles])[:-1]
    by_cost = np.argsort(np.concatenate(at.data))
    best = angles.copy()
    least = np.concatenate(at.data)
    for restart in range(min(RESTARTS, len(angles))):
        other = by_cost[restart * len(by_cost) // RESTARTS]
        start = np.repeat(angles[other][None], len(angles), axis=0)
        start[:, list(root)] = angles[:, list(root)]
        settled = settle_on(at.tree, problem, at.x, np.split(start, ends), variance)
        cost = np.concatenate(settled.data)
        better = cost < (1.0 - MIN_IMPROVEMENT) * least
        best[better] = np.concatenate(settled.angles)[better]
        least[better] = cost[better]
    return settle_on(at.tree, problem, at.x, np.split(best, ends), variance)
