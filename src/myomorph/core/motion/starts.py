"""Poses from which inverse kinematics starts, found without any knowledge of the first.

Every `SCOUT`-th frame is solved in turn. Where the fit is suddenly poor, several headings of the
whole body and both branches of ball joints are tried.
"""

from __future__ import annotations

from itertools import product
from operator import itemgetter

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.motion.newton import SCOUT, Settings, SolvedPoses, frames_shown, solve_chunk
from myomorph.core.motion.pose_problem import PoseProblem
from myomorph.core.motion.turns import nearest_turn, other_branch
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.loops import close_loops
from myomorph.core.rigid.tree import Tree

# Last step of such a pose, in units of the coordinates: a start need not be exact
SCOUT_TOLERANCE = 1e-3
# Headings of the whole body, the best by themselves, from which the whole pose is solved
HEADINGS_TRIED = 4
AT_BOUND = 1e-9  # A coordinate that is nearer to its bound lies at it [rad]
SAME_ROTATION = 1e-6  # Entries of rotation matrices that differ by less are those of one rotation


def scout_poses(tree: Tree, problem: PoseProblem, settings: Settings) -> Array:
    """Solve every `SCOUT`-th frame, each from the pose before it.

    The first frame, and a frame whose cost is more than four times the usual one, is solved again
    from several headings of the whole body, and the best pose is kept, so that a bad first frame or
    a long gap does not spoil what follows. A joint that then lies at a bound is tried from inside
    its range, because the angles of a ball joint have two branches.

    Parameters
    ----------
    tree : the compiled model
    problem : of all frames
    settings : weight of the posture, tolerance (replaced by `SCOUT_TOLERANCE`) and most steps

    Returns
    -------
    (poses, coordinates) [rad or m]; where a frame is not shown, the pose before it
    """
    rest = closed_defaults(tree)
    root = root_coordinates(tree)
    turning = _turning(tree, problem, root)
    whole_body = _only(problem, root)
    shown = frames_shown(problem)
    posture_weight, _, max_steps = settings
    frames = len(shown)
    solved = SolvedPoses(
        values=np.empty((frames, len(rest))),
        cost=np.empty(frames),
        converged=np.empty(frames, np.bool_),
        iterations=np.empty(frames, np.int64),
    )

    def settle(problem: PoseProblem, frame: int, start: Array) -> tuple[float, Array]:
        """Solve one frame from a pose (coordinates,): its cost and its pose."""
        solved.values[frame] = start
        solve_chunk(
            tree.arrays,
            problem,
            frame,
            frame + 1,
            posture_weight,
            SCOUT_TOLERANCE,
            max_steps,
            True,
            solved.values,
            solved.cost,
            solved.converged,
            solved.iterations,
        )
        return float(solved.cost[frame]), solved.values[frame].copy()

    poses = np.empty((-(-frames // SCOUT), len(rest)))
    pose = rest.copy()
    usual = 0.0
    for frame in range(0, frames, SCOUT):
        if shown[frame]:
            cost, pose = settle(problem, frame, pose)
            if usual == 0.0 or cost > 4.0 * usual:
                turned = sorted(
                    (settle(whole_body, frame, start) for start in _headings(rest, turning)),
                    key=itemgetter(0),
                )
                others = [settle(problem, frame, start) for _, start in turned[:HEADINGS_TRIED]]
                best, other = min(others, key=itemgetter(0))
                if best < 0.999 * cost:
                    cost = best
                    pose = nearest_turns(tree, turning, other, rest if usual == 0.0 else pose)
                for joint in _at_bounds(tree, problem, pose):
                    others = [settle(problem, frame, start) for start in _within(tree, joint, pose)]
                    best, other = min(others, key=itemgetter(0))
                    if best < 0.999 * cost:
                        cost = best
                        pose = other
            usual = cost if usual == 0.0 else 0.8 * usual + 0.2 * cost
        poses[frame // SCOUT] = pose
    return poses


def closed_defaults(tree: Tree) -> Array:
    """Return the default pose with its loops closed.

    Parameters
    ----------
    tree : the compiled model

    Returns
    -------
    (coordinates,) [rad or m]
    """
    return close_loops(tree, tree.defaults[None])[0] if tree.model.loops else tree.defaults.copy()


def _at_bounds(tree: Tree, problem: PoseProblem, pose: Array) -> list[list[int]]:
    """Find joints of two or three free rotations of which one lies at its bound.

    Such a joint may be on the wrong branch. Those with an infinite bound are left out.

    Parameters
    ----------
    pose : (coordinates,) [rad or m]

    Returns
    -------
    numbers of the free rotations of each such joint
    """
    place = {int(j): i for i, j in enumerate(problem.free)}
    result = []
    for joint in tree.model.joints:
        angles = [tree.model.coordinate_names.index(name) for name in joint.coordinates]
        angles = [
            j for j in angles if j in place and tree.model.coordinates[j].motion == "rotational"
        ]
        if not 2 <= len(angles) <= 3:
            continue
        low = np.array([problem.lower[place[j]] for j in angles])
        high = np.array([problem.upper[place[j]] for j in angles])
        stuck = (pose[angles] <= low + AT_BOUND) | (pose[angles] >= high - AT_BOUND)
        if np.isfinite(high - low).all() and stuck.any():
            result.append(angles)
    return result


def _within(tree: Tree, joint: list[int], pose: Array) -> list[Array]:
    """Put a joint's coordinates at a quarter or three quarters of their ranges in all combinations.

    Parameters
    ----------
    joint : numbers of the joint's coordinates
    pose : (coordinates,) [rad or m]

    Returns
    -------
    2^n poses (coordinates,) for n coordinates
    """
    ranges = np.array([tree.model.coordinates[j].range for j in joint])
    poses = []
    for shares in product((0.25, 0.75), repeat=len(joint)):
        other = pose.copy()
        other[joint] = ranges[:, 0] + np.array(shares) * np.ptp(ranges, axis=1)
        poses.append(other)
    return poses


def _only(problem: PoseProblem, coordinates: list[int]) -> PoseProblem:
    """Free only some coordinates of a problem."""
    kept = np.isin(problem.free, coordinates)
    return problem._replace(
        free=problem.free[kept], lower=problem.lower[kept], upper=problem.upper[kept]
    )


def root_coordinates(tree: Tree) -> list[int]:
    """Find the coordinates of joints to the ground.

    Parameters
    ----------
    tree : the compiled model

    Returns
    -------
    their numbers, ascending
    """
    on_ground = np.flatnonzero(tree.arrays.parent == 0)
    used = tree.arrays.axis_coordinate[np.isin(tree.arrays.axis_body, on_ground)]
    return [int(j) for j in np.unique(used[used >= 0])]


def _turning(tree: Tree, problem: PoseProblem, root: list[int]) -> list[int]:
    """Find root coordinates that rotate without bounds."""
    free = set(problem.free[np.isinf(problem.lower) & np.isinf(problem.upper)])
    return [j for j in root if j in free and tree.model.coordinates[j].motion == "rotational"]


def nearest_turns(tree: Tree, turning: list[int], pose: Array, reference: Array) -> Array:
    """Choose, among all angles of the root that give a pose, those nearest to a reference.

    Without bounds a search from several headings may end in any of them. Angles may differ by whole
    turns, and three in a row about axes each perpendicular to the next have a second triple,

        (a, b, c) and (a + pi, pi - b, c + pi)

    which is taken where it gives the same rotations and lies nearer.

    Parameters
    ----------
    tree : the compiled model
    turning : numbers of the root rotations without bounds
    pose : (coordinates,) [rad or m]
    reference : (coordinates,) [rad or m]

    Returns
    -------
    (coordinates,) [rad or m]
    """
    result = _without_turns(pose, turning, reference)
    names = tree.model.coordinate_names
    for joint in tree.model.joints:
        used = [name for axis in joint.axes if axis.kind == "rotation" for name in axis.coordinates]
        angles = [names.index(name) for name in dict.fromkeys(used)]
        if len(angles) != 3 or not set(angles) <= set(turning):
            continue
        other = result.copy()
        other[angles] = other_branch(result[angles])
        other = _without_turns(other, angles, reference)
        poses = forward_kinematics(tree, np.array([result, other]))
        same = np.allclose(poses.rotations[0], poses.rotations[1], atol=SAME_ROTATION)
        if same and np.sum((other - reference)[angles] ** 2) < np.sum(
            (result - reference)[angles] ** 2
        ):
            result = other
    return result


def _without_turns(pose: Array, turning: list[int], reference: Array) -> Array:
    """Remove from angles `turning` of a pose (coordinates,) whole turns away from a reference."""
    result = pose.copy()
    result[turning] = nearest_turn(pose[turning], reference[turning])
    return result


def _headings(rest: Array, turning: list[int]) -> list[Array]:
    """Rotate a pose by quarter turns about each root rotation in turn.

    Parameters
    ----------
    rest : (coordinates,) [rad or m]
    turning : numbers of the root rotations without bounds

    Returns
    -------
    the pose itself, then three (coordinates,) for each rotation: a quarter, a half, three quarters
    """
    poses = [rest.copy()]
    for j in turning:
        for quarter in (1, 2, 3):
            pose = rest.copy()
            pose[j] += quarter * np.pi / 2.0
            poses.append(pose)
    return poses
