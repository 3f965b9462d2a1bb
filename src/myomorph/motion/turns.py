"""Angles that give the same pose: whole turns, and the two triples of a ball joint; and those of a floating body.

A body floats in the laboratory by coordinates whose bounds say nothing about it. A motion keeps to the nearest angles,
from poses in which it starts that are found without any knowledge of the first.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise, product

import numpy as np

from myomorph.model.arrays import Array, runs
from myomorph.model.model import GROUND, Joint, Model
from myomorph.model.spatial import axis_rotation
from myomorph.motion.newton import SCOUT, Settings, SolvedFrames, frames_shown, solve_frames
from myomorph.motion.pose_problem import PoseProblem
from myomorph.rigid.kinematics import forward_kinematics
from myomorph.rigid.loops import close_loops
from myomorph.rigid.tree import Tree

SAME_POSE = 1e-6  # Entries of poses that differ by less are those of one pose [1 or m]
JUMP = 0.5 * np.pi  # Change of an angle from frame to frame beyond which another branch is looked for [rad]
SLACK = 1e-9  # Of an angle, that counts as none [rad]
MASSLESS = 1e-6  # A body lighter than this share of the whole is a link on the way from the ground


def floating_coordinates(model: Model) -> tuple[str, ...]:
    """Coordinates of the joints that let a body float: at least two translations and one rotation against the ground. A
    joint to the ground that only turns (an arm fixed at the shoulder) or only slides (a sled) is part of the body or of
    a rig, and its bounds count. Massless links between ground and body belong to the root joint.
    """
    result: list[str] = []
    for chain in _root_chains(model):
        axes = [(axis.kind, name) for joint in chain for axis in joint.axes for name in axis.coordinates]
        turns = {name for kind, name in axes if kind == "rotation"}
        # Old files call the translations of a custom joint coupled; a rotation may bring a translation along.
        slides = {name for kind, name in axes if kind == "translation"} - turns
        if len(slides) >= 2 and turns:
            result += dict.fromkeys(name for _, name in axes)
    return tuple(result)


def of_one_turn(tree: Tree, problem: PoseProblem, values: Array) -> Array:
    """Coordinates (frames, coordinates) whose angles begin, and go on after every gap (NaN), on the turn that is
    nearest. Frames are solved in stretches from poses that were found apart, which may differ by whole turns. Angles
    that would leave their bounds, or that a task pulls at, stay.
    """
    values = values.copy()
    for index, low, high in zip(problem.free, problem.lower, problem.upper, strict=True):
        if problem.coordinates.weight[index] or not _turns_whole(tree.model, tree.model.coordinates[index].name):
            continue
        column, last = values[:, index].copy(), tree.defaults[index]
        for start, stop in runs(np.isfinite(column)):
            column[start:stop] = np.unwrap(column[start:stop])
            column[start:stop] -= 2.0 * np.pi * np.round((column[start] - last) / (2.0 * np.pi))
            last = column[stop - 1]
        if np.nanmin(column) >= low and np.nanmax(column) <= high:
            values[:, index] = column
    return values


def _turns_whole(model: Model, name: str) -> bool:
    """Whether an angle gives the same pose a turn later: one axis turns by it, one to one."""
    turning = [axis for joint in model.joints for axis in joint.axes if name in axis.coordinates]
    coupled = any(name in coupler.independents for coupler in model.couplers)
    if coupled or len(turning) != 1 or turning[0].kind != "rotation" or turning[0].function.arity != 1:
        return False
    zero, half, whole = (float(turning[0].function(np.array(angle))) for angle in (0.0, np.pi, 2.0 * np.pi))
    return abs(abs(whole - zero) - 2.0 * np.pi) < SLACK and abs(abs(half - zero) - np.pi) < SLACK


def _root_chains(model: Model) -> Iterator[list[Joint]]:
    """Joints between the ground and each body that hangs on it."""
    light = MASSLESS * max(model.mass, 1e-12)
    for joint in model.joints:
        if joint.parent != GROUND:
            continue
        chain = [joint]
        while model.body(chain[-1].child).mass < light:
            after = [following for following in model.joints if following.parent == chain[-1].child]
            if len(after) != 1:
                break
            chain += after
        yield chain


def of_one_branch(tree: Tree, problem: PoseProblem, values: Array) -> Array:
    """The same poses (frames, coordinates), with the angles of every joint of three nearest to those of the frame
    before.

    Two triples of angles about three axes turn a body alike. Frames are solved in stretches from poses that were found
    apart, and may begin on either. Where the nearer angles are out of bounds, or a task pulls at them, they stay; so do
    those of a floating root, which may come back turned around.
    """
    values = values.copy()
    seen = np.flatnonzero(np.isfinite(values).all(axis=1))
    place = {int(j): i for i, j in enumerate(problem.free)}
    for triple, axes in _triples(tree):
        steps = np.abs(np.diff(values[seen][:, triple], axis=0))
        if not all(j in place for j in triple) or not (steps > JUMP).any() or problem.coordinates.weight[triple].any():
            continue
        if not _turns_alike(tree, values[seen[0]], triple, axes):
            continue
        low, high = (np.array([bound[place[j]] for j in triple]) for bound in (problem.lower, problem.upper))
        for before, frame in pairwise(seen):
            last, here = values[before, triple], values[frame, triple]
            if np.abs(here - last).max() > JUMP:
                alike = (here, nearest_turn(here, last), nearest_turn(other_angles(here, axes), last))
                inside = [angles for angles in alike if ((low <= angles) & (angles <= high)).all()]
                tried = np.array(inside or [here])
                values[frame, triple] = tried[np.argmin(np.sum((tried - last) ** 2, axis=1))]
    return values


def other_branch(angles: Array) -> Array:
    """(3,) the other angles of the same rotation, about axes each perpendicular to the next [rad]."""
    return np.array([angles[0] + np.pi, np.pi - angles[1], angles[2] + np.pi])


def other_angles(angles: Array, axes: Array) -> Array:
    """(3,) the other angles of the same rotation about any three axes, unit vectors, one a row [rad]. The last axis w
    after the second rotation makes an angle with the first axis u that depends on cos(b - beta) alone, so the middle
    angle may be 2 beta - b; the others follow from where u and w come to lie (Davenport angles).
    """
    first, second, last = axes
    beta = np.arctan2(first @ np.cross(second, last), first @ last - (first @ second) * (second @ last))
    middle = 2.0 * beta - angles[1]
    here, there = (axis_rotation(second, angle) for angle in (angles[1], middle))
    before = _angle_about(first, there @ last, here @ last)
    after = _angle_about(last, there.T @ first, here.T @ first)
    return np.array([angles[0] + before, middle, angles[2] - after])


def _angle_about(axis: Array, start: Array, end: Array) -> float:
    """By which a vector turns about an axis to another [rad]."""
    return float(np.arctan2(axis @ np.cross(start, end), start @ end - (axis @ start) * (axis @ end)))


def nearest_turn(angles: Array, reference: Array) -> Array:
    """Angles without whole turns away from a reference [rad]."""
    return np.asarray(angles - 2.0 * np.pi * np.round((angles - reference) / (2.0 * np.pi)))


def _triples(tree: Tree) -> Iterator[tuple[list[int], Array]]:
    """The three angles of each joint that turns by three, and their axes (3, 3), but for a floating root's."""
    floating = set(floating_coordinates(tree.model))
    for joint in tree.model.joints:
        turning = [axis for axis in joint.axes if axis.kind == "rotation" and axis.coordinates]
        names = [name for axis in turning for name in axis.coordinates]
        if len(turning) == len(set(names)) == 3 and not floating.intersection(names):
            signs = [float(axis.function(np.array(1.0)) - axis.function(np.array(0.0))) for axis in turning]
            axes = np.array([sign * axis.vector for sign, axis in zip(signs, turning, strict=True)])
            yield [tree.model.coordinate_names.index(name) for name in names], axes


def _turns_alike(tree: Tree, pose: Array, triple: list[int], axes: Array) -> bool:
    """Whether the other branch of three angles, and whole turns of each, give every body the same pose."""
    poses = np.tile(pose, (5, 1))
    poses[1, triple] = other_angles(pose[triple], axes)
    poses[[2, 3, 4], triple] += 2.0 * np.pi
    turned = forward_kinematics(tree, poses)
    return all(np.ptp(entries, axis=0).max() < SAME_POSE for entries in (turned.rotations, turned.origins))


SCOUT_TOLERANCE = 1e-3  # Last step of such a pose, in units of the coordinates: a start need not be exact
HEADINGS_TRIED = 4  # Headings of the whole body, the best by themselves, from which the whole pose is solved


AT_BOUND = 1e-9  # A coordinate that is nearer to its bound lies at it [rad]
SAME_ROTATION = 1e-6  # Entries of rotation matrices that differ by less are those of one rotation


def scout_poses(tree: Tree, problem: PoseProblem, settings: Settings) -> Array:
    """Pose of every `SCOUT`-th frame (poses, coordinates), tracked in turn; where it is not shown, that before it. The
    first frame, and a frame whose cost jumps, is solved again from several headings of the whole body, and the best
    pose is kept, so that a bad first frame or a long gap does not spoil what follows. A joint that then lies at a bound
    is tried from inside its range: angles of a ball joint have two branches.
    """
    rest = closed_defaults(tree)
    root = root_coordinates(tree)
    turning = _turning(tree, problem, root)
    whole_body = _only(problem, root)
    shown = frames_shown(problem)
    posture_weight, _, max_steps = settings
    frames = len(shown)
    solved = SolvedFrames(
        np.empty((frames, len(rest))), np.empty(frames), np.empty(frames, np.bool_), np.empty(frames, np.int64)
    )

    def settle(problem: PoseProblem, frame: int, start: Array) -> tuple[float, Array]:
        solved.values[frame] = start
        solve_frames(
            tree.arrays, problem, frame, frame + 1, posture_weight, SCOUT_TOLERANCE, max_steps, True,
            solved.values, solved.cost, solved.converged, solved.iterations,
        )  # fmt: skip
        return float(solved.cost[frame]), solved.values[frame].copy()

    poses = np.empty((-(-frames // SCOUT), len(rest)))
    pose, usual = rest.copy(), 0.0
    for frame in range(0, frames, SCOUT):
        if shown[frame]:
            cost, pose = settle(problem, frame, pose)
            if usual == 0.0 or cost > 4.0 * usual:
                turned = sorted((settle(whole_body, frame, start) for start in _headings(rest, turning)), key=_cost)
                others = [settle(problem, frame, start) for _, start in turned[:HEADINGS_TRIED]]
                best, other = min(others, key=_cost)
                if best < 0.999 * cost:
                    cost, pose = best, nearest_turns(tree, turning, other, rest if usual == 0.0 else pose)
                for joint in _at_bounds(tree, problem, pose):
                    others = [settle(problem, frame, start) for start in _within(tree, joint, pose)]
                    best, other = min(others, key=_cost)
                    if best < 0.999 * cost:
                        cost, pose = best, other
            usual = cost if usual == 0.0 else 0.8 * usual + 0.2 * cost
        poses[frame // SCOUT] = pose
    return poses


def closed_defaults(tree: Tree) -> Array:
    """The default pose, loops closed."""
    return close_loops(tree, tree.defaults[None])[0] if tree.model.loops else tree.defaults.copy()


def _at_bounds(tree: Tree, problem: PoseProblem, pose: Array) -> list[list[int]]:
    """The free rotations of every joint of two or three of which one lies at its bound: it may be on a wrong branch."""
    place = {int(j): i for i, j in enumerate(problem.free)}
    result = []
    for joint in tree.model.joints:
        angles = [tree.model.coordinate_names.index(name) for name in joint.coordinates]
        angles = [j for j in angles if j in place and tree.model.coordinates[j].motion == "rotational"]
        if not 2 <= len(angles) <= 3:
            continue
        low, high = (np.array([bound[place[j]] for j in angles]) for bound in (problem.lower, problem.upper))
        stuck = (pose[angles] <= low + AT_BOUND) | (pose[angles] >= high - AT_BOUND)
        if np.isfinite(high - low).all() and stuck.any():
            result.append(angles)
    return result


def _within(tree: Tree, joint: list[int], pose: Array) -> list[Array]:
    """The pose with a joint's coordinates at a quarter or three quarters of their ranges, in every combination."""
    ranges = np.array([tree.model.coordinates[j].range for j in joint])
    poses = []
    for shares in product((0.25, 0.75), repeat=len(joint)):
        other = pose.copy()
        other[joint] = ranges[:, 0] + np.array(shares) * np.ptp(ranges, axis=1)
        poses.append(other)
    return poses


def _cost(solved: tuple[float, Array]) -> float:
    return solved[0]


def _only(problem: PoseProblem, coordinates: list[int]) -> PoseProblem:
    """The same problem with only these coordinates free."""
    kept = np.isin(problem.free, coordinates)
    return problem._replace(free=problem.free[kept], lower=problem.lower[kept], upper=problem.upper[kept])


def root_coordinates(tree: Tree) -> list[int]:
    """The coordinates of joints to the ground."""
    on_ground = np.flatnonzero(tree.arrays.parent == 0)
    used = tree.arrays.axis_coordinate[np.isin(tree.arrays.axis_body, on_ground)]
    return [int(j) for j in np.unique(used[used >= 0])]


def _turning(tree: Tree, problem: PoseProblem, root: list[int]) -> list[int]:
    """Root coordinates that may turn all the way round."""
    free = set(problem.free[np.isinf(problem.lower) & np.isinf(problem.upper)])
    return [j for j in root if j in free and tree.model.coordinates[j].motion == "rotational"]


def nearest_turns(tree: Tree, turning: list[int], pose: Array, reference: Array) -> Array:
    """The same pose, of all angles of the root (rotations `turning` may turn all the way round) those nearest to a
    reference. Angles may be larger by a turn, and three in a row (a, b, c) about perpendicular axes give the same
    rotation as (a + pi, pi - b, c + pi). Without bounds a search from several headings may end in either.
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
        if same and np.sum((other - reference)[angles] ** 2) < np.sum((result - reference)[angles] ** 2):
            result = other
    return result


def _without_turns(pose: Array, turning: list[int], reference: Array) -> Array:
    """The pose without whole turns away from a reference."""
    result = pose.copy()
    result[turning] = nearest_turn(pose[turning], reference[turning])
    return result


def _headings(rest: Array, turning: list[int]) -> list[Array]:
    """A pose, and the same with each root rotation turned by a quarter, half and three quarters."""
    poses = [rest.copy()]
    for j in turning:
        for quarter in (1, 2, 3):
            pose = rest.copy()
            pose[j] += quarter * np.pi / 2.0
            poses.append(pose)
    return poses
