"""Posture of a trunk that no marker shows: upright in the world, heading as the pelvis does."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.model import Joint, Model
from myomorph.core.model.segments import segments_if_human
from myomorph.core.model.sides import mirror_names, split_side
from myomorph.core.model.spatial import (
    axis_rotation,
    quaternion_from_rotation,
    rotation_from_vector,
    vector_from_rotation,
)
from myomorph.core.motion.pose_problem import PoseProblem
from myomorph.core.rigid.coordinates import Ints, couple_frames
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import Tree

SLOW = 0.35
"""Standard deviation of the Gaussian in time within which the pelvis' rotations are not the trunk's
[s]: a stride's are not, those of who turns or bends are.
"""
BENT = 0.25
"""Tilt of the pelvis of which the trunk takes half [rad]. A smaller one is the pelvis' own, as its
markers lie differently on every person; a larger one is of a person who bends, sits or lies.
"""
AHEAD = 0.18
"""Lean of an upright trunk forward from the model's default pose [rad]: mean of seven walkers, of
4.3 degrees standard deviation between them (`python -m benchmarks.validation unseen_posture`).
"""
STANDING = 0.9  # Cosine of the angle to the vertical within which a default pose stands upright
STEPS = 6  # Of the search for the joints' angles
STEP = 1e-6  # Of differences [rad]
RIDGE = 1e-6  # Of the joints' least change, relative to the orientation
FINE = 50.0  # Rotations of the pelvis are smoothed at so many frames a second at most [Hz]
ALONE = 1e-9  # Share of the squared width that the times around a frame spread at least, for a line


@dataclass(frozen=True, kw_only=True)
class Chain:
    """Joints that no marker shows between a body that markers show and the trunk.

    Attributes
    ----------
    name : of the segment at the end
    base : body that is shown
    body : at the end, the heaviest of its segment
    variables : coordinates of the joints between them, by place among the free ones
    """

    name: str
    base: int
    body: int
    variables: tuple[int, ...]


@read_only
class UprightTrunk:
    """Angles of a chain that hold its end upright.

    Attributes
    ----------
    chain : whose they are
    values : (frames, variables of the chain) [rad]
    shapes : (3, variables of the chain) changes by which the end leans forward or back, leans to a
        side, and turns about the vertical by 1 rad
    tilt : (frames,) how far the shown body is tilted, slowly, from its default pose [rad]
    """

    chain: Chain
    values: Array
    shapes: Array
    tilt: Array


def upright_chains(tree: Tree, problem: PoseProblem, hidden: np.ndarray) -> tuple[Chain, ...]:
    """Find the trunk, else the head, where no marker shows it and one shows the body that it is on.

    Parameters
    ----------
    tree : the compiled model
    problem : with the free coordinates
    hidden : (variables,) which of them no marker shows

    Returns
    -------
    at most one chain; none for a model that names no trunk, and without gravity
    """
    model = tree.model
    if not np.linalg.norm(model.gravity) > 0.0:
        return ()
    segments = segments_if_human(model)
    for name in ("upper_trunk", "head"):
        bodies = [body for body in model.bodies if body.name in segments]
        heaviest = [body for body in bodies if segments[body.name].name == name]
        if not heaviest:
            continue
        end = max(heaviest, key=lambda body: body.mass).name
        chain = _chain(tree, problem, hidden, name, end)
        if chain is not None:
            return (chain,)
    return ()


def _chain(
    tree: Tree, problem: PoseProblem, hidden: np.ndarray, name: str, end: str
) -> Chain | None:
    """Go from a body towards the ground as far as no marker shows the joints."""
    place = {int(j): i for i, j in enumerate(problem.free)}
    joints = {joint.child: joint for joint in tree.model.joints}
    variables: list[int] = []
    body = end
    while body in joints:
        free = [place[j] for j in _driving(tree.model, joints[body]) if j in place]
        if any(not hidden[i] for i in free):
            break
        variables += [i for i in free if i not in variables and _turns(tree.model, problem, i)]
        body = joints[body].parent
    if not variables or body not in tree.body_index or tree.body_index[body] == 0:
        return None
    return Chain(
        name=name,
        base=tree.body_index[body],
        body=tree.body_index[end],
        variables=tuple(variables),
    )


def _driving(model: Model, joint: Joint) -> list[int]:
    """Numbers of the coordinates that move a joint, those that drive its own among them."""
    drivers = {coupler.dependent: coupler.independents for coupler in model.couplers}
    names = [name for own in joint.coordinates for name in drivers.get(own, (own,))]
    return [model.coordinate_names.index(name) for name in dict.fromkeys(names)]


def _turns(model: Model, problem: PoseProblem, variable: int) -> bool:
    return model.coordinates[problem.free[variable]].motion == "rotational"


def upright_trunk(
    tree: Tree, problem: PoseProblem, chain: Chain, time: Array, values: Array
) -> UprightTrunk:
    """Find the angles of a chain that hold its end upright, above a body that markers show.

    With the rotation of the shown body from its default pose, Q = T S, T about the vertical by the
    heading h and S the tilt with the rotation vector s, the end is rotated from its default pose by

        T(h') exp(p s') A,   p = |s'|^2 / (|s'|^2 + BENT^2)

    where h' and s' are h and s without what is faster than `SLOW`, and A leans a trunk that stands
    in the default pose `AHEAD`. So it does not swing with the pelvis, stays upright above one that
    is tilted a little, and goes with one that is tilted far.

    Parameters
    ----------
    tree : the compiled model
    problem : with bounds of the coordinates
    chain : of joints that no marker shows
    time : (frames,) [s]
    values : (frames, coordinates) poses, NaN where the body is not shown [rad or m]

    Returns
    -------
    angles of the chain, NaN where the body is not shown
    """
    known = np.flatnonzero(np.isfinite(values).all(axis=1))
    up = -tree.model.gravity / np.linalg.norm(tree.model.gravity)
    rest = forward_kinematics(tree, tree.defaults[None]).rotations[0]
    shown = forward_kinematics(tree, values[known]).rotations[:, chain.base]
    heading, tilt = heading_and_tilt(shown @ rest[chain.base].T, up)
    slow = smoothed(time[known], np.column_stack([heading, tilt]), SLOW)
    angle = np.linalg.norm(slow[:, 1:], axis=1)
    share = angle**2 / (angle**2 + BENT**2)
    turned = rotation_from_vector(slow[:, :1] * up) @ rotation_from_vector(
        share[:, None] * slow[:, 1:]
    )
    leaning = _leaning(tree, chain, up)
    search = _ChainSearch(tree=tree, problem=problem, chain=chain)
    angles = np.full((len(values), len(chain.variables)), np.nan)
    angles[known] = search.angles(values[known], turned @ leaning @ rest[chain.body])
    tilts = np.full(len(values), np.nan)
    tilts[known] = angle
    return UprightTrunk(chain=chain, values=angles, shapes=search.shapes(up), tilt=tilts)


def _leaning(tree: Tree, chain: Chain, up: Array) -> Array:
    """Rotation (3, 3) that leans a standing trunk ahead; none of an animal on four feet, or a head.

    A trunk stands where its center of mass is above the body that it is on.
    """
    poses = forward_kinematics(tree, tree.defaults[None])
    center = tree.model.body(tree.model.body_names[chain.body - 1]).mass_center
    trunk = poses.rotations[0, chain.body] @ center + poses.origins[0, chain.body]
    along = trunk - poses.origins[0, chain.base]
    stands = along @ up > STANDING * np.linalg.norm(along)
    if chain.name != "upper_trunk" or not stands:
        return np.eye(3)
    return axis_rotation(np.cross(up, forward_axis(tree, up)), AHEAD)


def heading_and_tilt(rotations: Array, up: Array) -> tuple[Array, Array]:
    """Separate rotations into one about the vertical, and a tilt before it.

    Of the quaternion (w, u) of Q, h = 2 atan2(u . up, w), and S = T(h)^T Q rotates about a
    horizontal axis.

    Parameters
    ----------
    rotations : (frames, 3, 3)
    up : (3,) unit vector

    Returns
    -------
    (frames,) heading without jumps of whole turns [rad], and (frames, 3) rotation vectors of the
    tilt [rad]
    """
    quaternions = quaternion_from_rotation(rotations)
    heading = np.unwrap(2.0 * np.arctan2(quaternions[:, 1:] @ up, quaternions[:, 0]))
    tilt = vector_from_rotation(rotation_from_vector(-heading[:, None] * up) @ rotations)
    return heading, tilt


def smoothed(time: Array, values: Array, width: float) -> Array:
    """Smooth columns by lines through what lies around, weighted by a Gaussian in time.

    A line at every time, and not a mean, keeps what grows steadily at the ends as well.

    Parameters
    ----------
    time : (frames,) [s]
    values : (frames, columns)
    width : standard deviation of the Gaussian [s]

    Returns
    -------
    (frames, columns)
    """
    if len(time) < 3:
        return values.copy()
    span = float(time[-1] - time[0])
    count = min(len(time), max(3, int(np.ceil(span * FINE)) + 1))
    even = np.linspace(time[0], time[-1], count)
    coarse = np.column_stack([np.interp(even, time, column) for column in values.T])
    lines = _lines_around(coarse, even[1] - even[0], width)
    return np.column_stack([np.interp(time, even, line) for line in lines.T])


def _lines_around(values: Array, step: float, width: float) -> Array:
    """Value at every sample of the line through what lies around it.

    Parameters
    ----------
    values : (samples, columns), evenly spaced
    step : from sample to sample [s]
    width : standard deviation of the Gaussian [s]

    Returns
    -------
    (samples, columns)
    """
    count = len(values)
    reach = min(int(np.ceil(4.0 * width / step)), count - 1)
    offsets = step * np.arange(-reach, reach + 1)
    kernel = np.exp(-0.5 * (offsets / width) ** 2)

    def around(column: Array, power: int) -> Array:
        """Sum of a column, weighted, times the time from here to the power."""
        weights = (kernel * offsets**power)[::-1]
        return np.convolve(column, weights, "full")[reach : reach + count]

    ones = np.ones(count)
    total = around(ones, 0)
    first = around(ones, 1)
    second = around(ones, 2)
    spread = total * second - first**2
    # Samples far apart have nothing around them that a line could go through.
    alone = spread < ALONE * (width * total) ** 2
    lines = np.empty_like(values)
    for column, given in enumerate(values.T):
        mean = around(given, 0) / total
        line = second * around(given, 0) - first * around(given, 1)
        lines[:, column] = np.where(alone, mean, line / np.where(alone, 1.0, spread))
    return lines


@dataclass(frozen=True, kw_only=True, eq=False)
class _ChainSearch:
    """Search for the angles of a chain that give its end an orientation."""

    tree: Tree
    problem: PoseProblem
    chain: Chain

    @property
    def _columns(self) -> Ints:
        """Numbers of the chain's coordinates in the model."""
        return self.problem.free[list(self.chain.variables)]

    def angles(self, values: Array, wanted: Array) -> Array:
        """Find the angles nearest to the default ones, within their bounds, by Gauss-Newton steps.

        Parameters
        ----------
        values : (frames, coordinates) poses [rad or m]
        wanted : (frames, 3, 3) orientation of the end

        Returns
        -------
        (frames, variables of the chain) [rad]
        """
        columns = self._columns
        variables = list(self.chain.variables)
        lower = self.problem.lower[variables]
        upper = self.problem.upper[variables]
        default = self.tree.defaults[columns]
        poses = values.copy()
        poses[:, columns] = np.clip(default, lower, upper)
        for _ in range(STEPS):
            rotation, slopes = self._slopes(poses)
            error = vector_from_rotation(wanted @ np.swapaxes(rotation, 1, 2))
            away = default - poses[:, columns]
            # Least squares of the orientation, and by a little of the way from the default angles.
            normal = np.swapaxes(slopes, 1, 2) @ slopes + RIDGE * np.eye(len(columns))
            right = np.einsum("fia,fi->fa", slopes, error) + RIDGE * away
            step = np.linalg.solve(normal, right[..., None])[..., 0]
            poses[:, columns] = np.clip(poses[:, columns] + step, lower, upper)
            if np.abs(step).max(initial=0.0) < STEP:
                break
        return poses[:, columns]

    def _slopes(self, poses: Array) -> tuple[Array, Array]:
        """Orientation of the end (frames, 3, 3), and its slopes (frames, 3, variables)."""
        stacked = np.repeat(poses[None], len(self._columns) + 1, axis=0)
        for index, column in enumerate(self._columns):
            stacked[index + 1, :, column] += STEP
        flat = np.ascontiguousarray(stacked.reshape(-1, poses.shape[1]))
        couple_frames(self.tree.arrays, flat)
        rotations = forward_kinematics(self.tree, flat).rotations[:, self.chain.body]
        rotations = rotations.reshape(len(self._columns) + 1, len(poses), 3, 3)
        steps = vector_from_rotation(rotations[1:] @ np.swapaxes(rotations[0], 1, 2)) / STEP
        return rotations[0], np.moveaxis(steps, 0, 2)

    def shapes(self, up: Array) -> Array:
        """Find changes (3, variables) that lean the end by 1 rad ahead, to a side, and turn it."""
        _, slopes = self._slopes(self.tree.defaults[None])
        ahead = forward_axis(self.tree, up)
        axes = np.stack([np.cross(up, ahead), ahead, up])
        return np.asarray((np.linalg.pinv(slopes[0], rcond=1e-3) @ axes.T).T)


def forward_axis(tree: Tree, up: Array) -> Array:
    """Guess which horizontal axis a model faces in its default pose.

    Across is where right and left bodies lie apart most; forward, from left to right, is

        ahead = up x across

    Parameters
    ----------
    tree : the compiled model
    up : (3,) unit vector

    Returns
    -------
    (3,) unit vector; x, or where that is vertical y, of a model without sides
    """
    names = tree.model.body_names
    origins = forward_kinematics(tree, tree.defaults[None]).origins[0]
    pairs = mirror_names(names)
    right = [name for name in pairs if split_side(name)[1] == "right"]
    across = sum(
        (origins[tree.body_index[name]] - origins[tree.body_index[pairs[name]]] for name in right),
        np.zeros(3),
    )
    ahead = np.cross(up, across)
    if np.linalg.norm(ahead) < 1e-6:
        first = np.eye(3)[0] if abs(up[0]) < 0.9 else np.eye(3)[1]
        ahead = first - (first @ up) * up
    return np.asarray(ahead / np.linalg.norm(ahead))
