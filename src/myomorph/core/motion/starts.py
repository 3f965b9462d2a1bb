"""Poses from which inverse kinematics starts, found without any knowledge of the first.

Every `SCOUT`-th frame is solved in turn. Where the fit is suddenly poor, several headings of the
whole body and both branches of ball joints are tried.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from itertools import product
from operator import attrgetter
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from myomorph.core.model.arrays import Array, runs
from myomorph.core.model.model import Joint
from myomorph.core.motion.newton import SCOUT, PoseRoom, Settings, frames_shown, solve_chunk
from myomorph.core.motion.pose_problem import PoseProblem
from myomorph.core.motion.turns import nearest_turn, other_branch
from myomorph.core.rigid.coordinates import Ints
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.loops import close_loops
from myomorph.core.rigid.tree import Tree

# Last step of such a pose, in units of the coordinates: a start need not be exact
SCOUT_TOLERANCE = 1e-3
# Headings of the whole body, the best by themselves, from which the whole pose is solved
HEADINGS_TRIED = 4
FORWARD = 1.05
"""Of two solutions whose costs are nearer than that, the one whose hinge bends forward is taken."""
MIN_GAIN = 0.999  # Of the cost, for another pose to be taken
BACK = 0.2  # Share of a hinge's range on the side to which it does not bend, but goes too far
MAX_TURNED = 3  # Rotations of a ball joint
AT_BOUND = 1e-9  # A coordinate that is nearer to its bound lies at it [rad]
SAME_ROTATION = 1e-6  # Entries of rotation matrices that differ by less are those of one rotation


def scout_poses(tree: Tree, problem: PoseProblem, settings: Settings) -> Array:
    """Solve every `SCOUT`-th frame, each from the pose before it.

    The first frame, and a frame whose cost is more than four times the usual one, is solved again
    from several headings of the whole body, and the best pose is kept, so that a bad first frame or
    a long gap does not spoil what follows. A joint that then lies at a bound is tried from inside
    its range, because the angles of a ball joint have two branches. A hinge that bends back, where
    the joint above could turn the limb round, is tried so in every such frame: an arm whose elbow
    is seen by its center alone fits nearly as well the wrong way round.

    Parameters
    ----------
    tree : the compiled model
    problem : of all frames
    settings : weight of the posture, tolerance (replaced by `SCOUT_TOLERANCE`) and most steps

    Returns
    -------
    (poses, coordinates) [rad or m]; where a frame is not shown, the pose before it
    """
    search = _ScoutSearch(tree, problem, settings)
    poses = np.empty((-(-len(search.shown) // SCOUT), len(search.rest)))
    pose = search.rest.copy()
    usual = 0.0
    for number, frame in enumerate(range(0, len(search.shown), SCOUT)):
        if search.shown[frame]:
            solved = search.solved(problem, frame, pose)
            if usual == 0.0 or solved.cost > 4.0 * usual:
                near = search.rest if usual == 0.0 else solved.values
                solved = search.turned(frame, solved, near)
                solved = search.off_bounds(frame, solved)
            else:
                solved = search.bent_back(frame, solved)
            pose = solved.values
            usual = solved.cost if usual == 0.0 else 0.8 * usual + 0.2 * solved.cost
        poses[number] = pose
    return poses


def unbent_poses(
    tree: Tree, problem: PoseProblem, settings: Settings, values: Array
) -> Array | None:
    """Turn limbs round that bend back, where that fits about as well.

    An arm that passes through straight may go on the wrong way until poses are found anew. In each
    stretch in which a hinge bends back, the frame in which it does so most is solved with the hinge
    inside its range, and its neighbors from there as long as they fit so.

    Parameters
    ----------
    tree : the compiled model
    problem : of all frames
    settings : as of `scout_poses`
    values : (frames, coordinates) as they were solved [rad or m]

    Returns
    -------
    (frames, coordinates) to solve again from, None where no limb is to be turned round
    """
    search = _ScoutSearch(tree, problem, settings)
    result = values.copy()
    found = False
    for limb in search.turning_limbs():
        bounds = tree.model.coordinates[limb[-1]].range
        for start, stop in runs(_bends_back(*bounds, values[:, limb[-1]]) & search.shown):
            worst = start + int(np.argmax(np.abs(values[start:stop, limb[-1]])))
            found |= search.unbend(result, worst, limb)
    return result if found else None


class _Solved(NamedTuple):
    """A frame that was solved from one start.

    Attributes
    ----------
    cost : of all tasks and the posture [m^2]
    values : (coordinates,) its pose [rad or m]
    """

    cost: float
    values: Array


def _same(one: _Solved, other: _Solved) -> bool:
    """Whether two solutions are one."""
    return bool(np.abs(one.values - other.values).max() < 10.0 * SCOUT_TOLERANCE)


class _BoundedJoints(NamedTuple):
    """Joints of up to three free rotations, all of which have bounds, and their angles.

    A ball joint is asked by all of its angles, a hinge by its own.

    Attributes
    ----------
    joints : numbers of the free rotations of each, of a hinge those above it before it
    angles : (angles,) their numbers, joint by joint
    owner : (angles,) of which joint each is
    hinge : (angles,) whether it is the only one of its joint
    low, high : (angles,) bounds [rad]
    """

    joints: list[list[int]]
    angles: Ints
    owner: Ints
    hinge: NDArray[np.bool_]
    low: Array
    high: Array

    @classmethod
    def of(cls, tree: Tree, problem: PoseProblem) -> Self:
        """Find the joints of a model of which a problem leaves the rotations free."""
        place = {int(j): i for i, j in enumerate(problem.free)}
        joints = _bounded_joints(tree, problem)
        # Of a hinge the rotations above it stand before it, and are not asked.
        asked = [
            joint[-1:] if len(joint) > MAX_TURNED or _is_chain(tree, joint) else joint
            for joint in joints
        ]
        angles = [j for angles in asked for j in angles]
        places = [place[j] for j in angles]
        return cls(
            joints=joints,
            angles=np.array(angles, dtype=np.int64),
            owner=np.repeat(np.arange(len(joints)), [len(angles) for angles in asked]),
            hinge=np.array([len(angles) == 1 for angles in asked for _ in angles], dtype=np.bool_),
            low=problem.lower[places],
            high=problem.upper[places],
        )

    def at_bounds(self, pose: Array) -> list[list[int]]:
        """Find joints that may be on a wrong branch, as a free rotation lies at its bound.

        The angles of a joint of two or three rotations have two branches. A hinge bends the other
        way where the joint above it turns the limb round, as an elbow with the shoulder: both are
        tried. Rotations with an infinite bound are left out.

        Parameters
        ----------
        pose : (coordinates,) [rad or m]

        Returns
        -------
        numbers of the free rotations of each such joint, of a hinge those above it too
        """
        values = pose[self.angles]
        stuck = (values <= self.low + AT_BOUND) | (values >= self.high - AT_BOUND)
        back = _bends_back(self.low, self.high, values) & self.hinge
        return [self.joints[number] for number in np.unique(self.owner[stuck | back])]


class _ScoutSearch:
    """Tries frames from several starts.

    Attributes
    ----------
    shown : (frames,) whether any task has a measurement
    rest : (coordinates,) default pose with its loops closed [rad or m]
    """

    def __init__(self, tree: Tree, problem: PoseProblem, settings: Settings):
        self._tree = tree
        self._problem = problem
        self._settings = settings._replace(tolerance=SCOUT_TOLERANCE, chained=True)
        root = root_coordinates(tree)
        self._turning = _turning(tree, problem, root)
        self._whole_body = _only(problem, root)
        self._bounded = _BoundedJoints.of(tree, problem)
        self.shown = frames_shown(problem)
        self.rest = closed_defaults(tree)
        self._room = PoseRoom.of(np.empty((len(self.shown), len(self.rest))))

    def solved(self, problem: PoseProblem, frame: int, start: Array) -> _Solved:
        """Solve one frame from a pose.

        Parameters
        ----------
        problem : of all frames
        frame : number of it
        start : (coordinates,) [rad or m]
        """
        self._room.values[frame] = start
        span = (frame, frame + 1)
        solve_chunk(self._tree.arrays, problem, span, self._settings, self._room)
        return _Solved(cost=float(self._room.cost[frame]), values=self._room.values[frame].copy())

    def _best(self, frame: int, starts: Iterable[Array]) -> _Solved:
        """Solve a frame from several poses (coordinates,), and keep the pose of the least cost."""
        return min(
            (self.solved(self._problem, frame, start) for start in starts), key=attrgetter("cost")
        )

    def turned(self, frame: int, solved: _Solved, near: Array) -> _Solved:
        """Solve a frame from several headings of the whole body, too.

        Parameters
        ----------
        frame : number of it
        solved : kept where no heading is better
        near : (coordinates,) whose full turns are taken [rad or m]
        """
        headings = sorted(
            (
                self.solved(self._whole_body, frame, start)
                for start in _headings(self.rest, self._turning)
            ),
            key=attrgetter("cost"),
        )
        best = self._best(frame, [heading.values for heading in headings[:HEADINGS_TRIED]])
        if not best.cost < MIN_GAIN * solved.cost:
            return solved
        return best._replace(values=nearest_turns(self._tree, self._turning, best.values, near))

    def turning_limbs(self) -> list[list[int]]:
        """List hinges that may bend the wrong way, each with the rotations above it.

        Returns
        -------
        numbers of the coordinates of each, the hinge last
        """
        return [limb for limb in self._bounded.joints if _turns_round(self._tree, limb)]

    def unbend(self, values: Array, frame: int, limb: list[int]) -> bool:
        """Solve a frame with a hinge inside its range, and its neighbors from there.

        Parameters
        ----------
        values : (frames, coordinates), changed in frames that fit better [rad or m]
        frame : at which it begins
        limb : coordinates of the hinge and of what is above it

        Returns
        -------
        whether the frame fits better so
        """
        best = self._best(frame, _within(self._tree, limb, values[frame]))
        now = self.solved(self._problem, frame, values[frame])
        if not best.cost < FORWARD * now.cost or _same(best, now):
            return False
        values[frame] = best.values
        for way in (range(frame + 1, len(values)), range(frame - 1, -1, -1)):
            pose = best.values
            for number in way:
                other = self.solved(self._problem, number, pose)
                now = self.solved(self._problem, number, values[number])
                if not other.cost < FORWARD * now.cost or _same(other, now):
                    break
                pose = other.values
                values[number] = pose
        return True

    def bent_back(self, frame: int, solved: _Solved) -> _Solved:
        """Solve a frame with each hinge that bends back where its limb may be turned round."""
        return self._inside(frame, solved, lambda joint: _turns_round(self._tree, joint))

    def off_bounds(self, frame: int, solved: _Solved) -> _Solved:
        """Solve a frame with each joint that lies at a bound inside its range, too."""
        return self._inside(frame, solved, lambda joint: True)

    def _inside(self, frame: int, solved: _Solved, tried: Callable[[list[int]], bool]) -> _Solved:
        """Solve a frame with some of the joints that lie at a bound inside their ranges.

        Parameters
        ----------
        frame : number of it
        solved : kept where no other pose is better
        tried : whether a joint is tried, by the numbers of its coordinates
        """
        for joint in filter(tried, self._bounded.at_bounds(solved.values)):
            best = self._best(frame, _within(self._tree, joint, solved.values))
            if best.cost < MIN_GAIN * solved.cost:
                solved = best
        return solved


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


def _is_chain(tree: Tree, joint: list[int]) -> bool:
    """Whether rotations are those of several joints."""
    names = {tree.model.coordinate_names[j] for j in joint}
    return not any(names <= set(one.coordinates) for one in tree.model.joints)


def _bounded_joints(tree: Tree, problem: PoseProblem) -> list[list[int]]:
    """Find joints of up to three free rotations, all of which have bounds.

    Returns
    -------
    numbers of the free rotations of each, of a hinge those above it before it
    """
    place = {int(j): i for i, j in enumerate(problem.free)}
    rotations = {joint.child: _free_rotations(tree, place, joint) for joint in tree.model.joints}
    bounded = np.isfinite(problem.upper - problem.lower)
    result = []
    for child, angles in rotations.items():
        if not 1 <= len(angles) <= MAX_TURNED:
            continue
        tried = angles if len(angles) > 1 else [*_above(tree, rotations, child), *angles]
        if len(tried) > 1 and bounded[[place[j] for j in tried]].all():
            result.append(tried)
    return result


def _bends_back(low: Array | float, high: Array | float, values: Array) -> np.ndarray:
    """Whether hinges bend the way in which they go less far than the other.

    Parameters
    ----------
    low, high : (hinges,) their bounds, or those of one hinge [rad]
    values : (hinges,), or (frames,) of one [rad]

    Returns
    -------
    (hinges,) or (frames,)
    """
    back = (values < 0.0) & (-low < BACK * (high - low))
    return np.asarray(back | ((values > 0.0) & (high < BACK * (high - low))))


def _free_rotations(tree: Tree, place: Mapping[int, int], joint: Joint) -> list[int]:
    """Numbers of a joint's rotations that are free, by `place` among the free coordinates."""
    numbers = [tree.model.coordinate_names.index(name) for name in joint.coordinates]
    return [j for j in numbers if j in place and tree.model.coordinates[j].motion == "rotational"]


def _above(tree: Tree, rotations: Mapping[str, list[int]], child: str) -> list[int]:
    """Collect free rotations that carry a joint, up to those of a whole ball joint.

    A ball joint may be one joint, or a chain of hinges on bodies that only carry axes.

    Parameters
    ----------
    rotations : of the joint of each body
    child : body of the joint

    Returns
    -------
    numbers of the rotations, those nearest to the ground first
    """
    parents = {joint.child: joint.parent for joint in tree.model.joints}
    found: list[int] = []
    body = parents[child]
    while body in parents and len(found) + len(rotations[body]) <= MAX_TURNED:
        found = [*rotations[body], *found]
        body = parents[body]
    return found


def _turns_round(tree: Tree, joint: list[int]) -> bool:
    """Whether a hinge, the last of the coordinates, hangs on a joint that turns by half a turn."""
    ranges = [np.ptp(tree.model.coordinates[j].range) for j in joint[:-1]]
    return len(joint) > MAX_TURNED and max(ranges) > np.pi


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
