"""Inertial parameters that no motion can tell apart.

They may move from a body to its parent unseen.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import scipy

from myomorph.core.model.arrays import Array
from myomorph.core.model.inertia import parameters_of, pseudo_inertias
from myomorph.core.model.model import Model, index_of
from myomorph.core.model.series import Motion
from myomorph.core.rigid.coordinates import couple_frames, couple_rates_frames
from myomorph.core.rigid.kinematics import Poses, forward_kinematics
from myomorph.core.rigid.regressor import base_regressor
from myomorph.core.rigid.tree import ROTATION, Tree, compile_tree

LENGTH = 0.3  # Typical size of a segment, so that masses, first moments and inertias compare [m]
# Size of the ten parameters of a body of 1 kg
SCALE = np.array([1.0, *[LENGTH] * 3, *[LENGTH**2] * 6])
# Singular values below this share of the largest are zero: poses are exact to about 1e-14
TOLERANCE = 1e-9
PREFERENCE = np.array([9.0, *[3.0] * 3, *[1.0] * 6])
"""Masses go to the parent rather than first moments, and those rather than inertias."""


class NullSpace(NamedTuple):
    """Changes of the inertial parameters that no base wrench shows.

    Attributes
    ----------
    vectors : (10 bodies, k) a basis; vectors[dependent] is invertible
    dependent : (k,) the standard parameters that are left out, their part given to others
    gap : by random states, the smallest pivot that counts and the largest that does not, relative
        to the largest of all; the tolerance lies between
    """

    vectors: Array
    dependent: np.ndarray
    gap: tuple[float, float] = (1.0, 0.0)


class JointMotion(NamedTuple):
    """Random states of a model.

    Attributes
    ----------
    poses : of (frames,)
    twists : (frames, axes, 6) what each axis adds to the twist of the bodies beyond it: angular
        velocity, and velocity of the point at the ground's origin [rad/s], [m/s]
    """

    poses: Poses
    twists: Array


class BodyInAncestor(NamedTuple):
    """Unit parameters of a body, in the frame of the body that its cluster hangs on.

    Attributes
    ----------
    parameters : (frames, 10, 10) L, what they are there
    momentum : (frames, 6, 10) what the joints between both give them: angular momentum about the
        ancestor's origin and linear momentum
    """

    parameters: Array
    momentum: Array


class Exchange(NamedTuple):
    """Parameters that bodies of a cluster may give to their ancestor.

    Attributes
    ----------
    leaving : (10 cluster bodies, k) what goes
    received : (10, k) what the ancestor receives
    """

    leaving: Array
    received: Array


class Cluster(NamedTuple):
    """Bodies whose joints share coordinates, so that they must be looked at together.

    Attributes
    ----------
    bodies : numbers in the tree's arrays (the ground is 0)
    ancestor : the one body they all hang on
    """

    bodies: tuple[int, ...]
    ancestor: int


def tree_null_space(model: Model, held: Mapping[str, float] | None = None) -> NullSpace:
    """Find the null space of the base rows from the tree alone: a direct sum over the joints.

    Parameters v of a body may go to its parent where the parent cannot tell them from its own: L(X)
    v is the same in every configuration X of the joint, and the joint's own velocity S gives v no
    momentum, M(v) S = 0. For a hinge these are 3 (a rod on the axis), for a slide 6, for a ball
    joint 1, for a weld 10. Joints that share coordinates through couplers are one cluster, whose
    bodies are taken together. The sum is the whole null space where the base is free to move; where
    it is not, more is hidden (`base_parameters` finds that from random states).

    Parameters
    ----------
    model : whose joints count, not its masses
    held : coordinates that do not move, with their values [rad or m]; by default those that are
        locked, at theirs

    Returns
    -------
    a basis of the null space

    Raises
    ------
    UnknownName : a held coordinate is not the model's
    """
    tree = compile_tree(model)
    fixed = held_values(model, held)
    together = clusters(tree, fixed)
    largest = max(len(cluster.bodies) for cluster in together)
    states = random_states(model, fixed, frames=24 + 4 * largest)
    poses = forward_kinematics(tree, np.array(states.values))
    twists = _twists(poses, np.array(states.velocities))
    motion = JointMotion(poses=poses, twists=twists)

    size = 10 * len(model.bodies)
    vectors = [np.zeros((size, 0))]
    dependent = [np.zeros(0, np.int64)]
    for cluster in together:
        if cluster.ancestor == 0:
            continue
        exchange = _exchange(motion, cluster)
        if exchange.leaving.shape[1]:
            part = _null_space_of(exchange, cluster, size)
            vectors.append(part.vectors)
            dependent.append(part.dependent)
    return NullSpace(np.hstack(vectors), np.concatenate(dependent))


def numerical_null_space(
    model: Model,
    held: Mapping[str, float] | None = None,
    columns: np.ndarray | None = None,
    tolerance: float = TOLERANCE,
) -> NullSpace:
    """Find the null space of the base rows from random states, by QR with column pivoting.

    Parameters
    ----------
    model : whose joints count, not its masses
    held : as in `tree_null_space`
    columns : (k,) the standard parameters to look at; all by default
    tolerance : diagonal entries of R below this share of the largest are zero, columns scaled to
        length 1

    Returns
    -------
    a basis of the null space, and the gap that the tolerance lies in
    """
    size = 10 * len(model.bodies)
    looked_at = np.arange(size) if columns is None else np.asarray(columns)
    states = random_states(model, held_values(model, held), frames=64 + len(looked_at) // 3)
    rows = base_regressor(model, states).reshape(-1, size)[:, looked_at]
    length = np.linalg.norm(rows, axis=0)
    # A column that is nothing but rounding (the inertia of a body that never turns) must not be
    # scaled up.
    silent = length <= tolerance * (length / SCALE[looked_at % 10]).max() * SCALE[looked_at % 10]
    length[silent] = np.inf
    R, order = scipy.linalg.qr(rows / length, mode="r", pivoting=True, overwrite_a=True)
    diagonal = np.abs(np.diag(R))
    rank = int(np.sum(diagonal > tolerance * diagonal[0]))
    vectors = np.zeros((size, len(looked_at) - rank))
    length[silent] = 1.0
    vectors[looked_at[order[:rank]]] = (
        -np.linalg.solve(R[:rank, :rank], R[:rank, rank:]) / length[order[:rank], None]
    )
    vectors[looked_at[order[rank:]]] = np.diag(1.0 / length[order[rank:]])
    relative = np.append(diagonal, 0.0) / max(diagonal[0], 1e-300)
    gap = (float(relative[rank - 1]) if rank else 1.0, float(relative[rank]))
    return NullSpace(vectors * length[order[rank:]], looked_at[order[rank:]], gap)


def held_values(model: Model, held: Mapping[str, float] | None) -> dict[str, float]:
    """Return coordinates that do not move, with their values; by default the locked ones.

    Parameters
    ----------
    model : with the coordinates
    held : name to value [rad or m]; None for the locked ones at their defaults

    Returns
    -------
    name to value [rad or m]

    Raises
    ------
    UnknownName : a held coordinate is not the model's
    """
    if held is None:
        return {
            coordinate.name: coordinate.default
            for coordinate in model.coordinates
            if coordinate.locked
        }
    for name in held:
        index_of("coordinate", name, model.coordinate_names)
    return dict(held)


def random_states(model: Model, held: Mapping[str, float], frames: int, seed: int = 0) -> Motion:
    """Draw positions, velocities and accelerations independently, each coordinate in its range.

    Held coordinates rest, dependent ones follow their couplers.

    Parameters
    ----------
    model : whose coordinates are drawn
    held : name to value [rad or m]
    frames : number of states
    seed : of the random numbers

    Returns
    -------
    one state a frame
    """
    tree = compile_tree(model)
    rng = np.random.default_rng(seed)
    values = np.empty((frames, len(model.coordinates)))
    velocities, accelerations = 3.0 * rng.normal(size=(2, frames, len(model.coordinates)))
    for j, coordinate in enumerate(model.coordinates):
        reach = 0.3 if coordinate.motion == "translational" else 1.5
        low = max(coordinate.range[0], coordinate.default - reach)
        high = min(coordinate.range[1], coordinate.default + reach)
        if not low < high:
            low = coordinate.default - 0.1 * reach
            high = coordinate.default + 0.1 * reach
        values[:, j] = rng.uniform(low, high, frames)
        if coordinate.name in held:
            values[:, j] = held[coordinate.name]
            velocities[:, j] = 0.0
            accelerations[:, j] = 0.0
    couple_frames(tree.arrays, values)
    couple_rates_frames(tree.arrays, values, velocities, accelerations)
    return Motion(
        time=np.arange(float(frames)),
        names=model.coordinate_names,
        values=values,
        velocities=velocities,
        accelerations=accelerations,
    )


def clusters(tree: Tree, held: Mapping[str, float]) -> list[Cluster]:
    """Group bodies that hang on one body and share no moving coordinate with others.

    Parameters
    ----------
    tree : of the model
    held : coordinates that do not move

    Returns
    -------
    clusters that together hold every body once
    """
    parent = tree.arrays.parent
    moved_by = _moving_coordinates(tree, held)
    groups: list[tuple[set[int], set[int]]] = []
    for b in range(1, len(parent)):
        bodies = {b}
        coordinates = set(moved_by[b])
        while True:
            between, _ = _hanging(bodies, parent)
            joined = [group for group in groups if group[0] & between or group[1] & coordinates]
            if not joined:
                break
            groups = [group for group in groups if group not in joined]
            bodies = bodies.union(*(group[0] for group in joined))
            coordinates = coordinates.union(*(group[1] for group in joined))
        groups.append((bodies, coordinates))
    return [Cluster(tuple(sorted(bodies)), _hanging(bodies, parent)[1]) for bodies, _ in groups]


def _hanging(bodies: set[int], parent: np.ndarray) -> tuple[set[int], int]:
    """Find the nearest body that all of some bodies hang on.

    Returns
    -------
    bodies between those named and that body, and that body
    """

    def above(b: int) -> list[int]:
        chain = []
        while b:
            b = int(parent[b])
            chain.append(b)
        return chain

    chains = [above(b) for b in bodies]
    shared = set.intersection(*(set(chain) for chain in chains))
    ancestor = next(b for b in chains[0] if b in shared)
    between = {b for chain in chains for b in chain[: chain.index(ancestor)]}
    return between, ancestor


def _moving_coordinates(tree: Tree, held: Mapping[str, float]) -> list[set[int]]:
    """List the independent coordinates that move each body's joint."""
    arrays = tree.arrays
    names = tree.model.coordinate_names
    sources: dict[int, set[int]] = {j: {j} for j in range(len(names))}
    for coupler, dependent in enumerate(arrays.coupler_coordinate):
        sources[int(dependent)] = set().union(
            *(sources[int(j)] for j in arrays.coupler_source[coupler] if j >= 0)
        )
    moved: list[set[int]] = [set() for _ in arrays.parent]
    for coupler, b in enumerate(arrays.axis_body):
        for j in arrays.axis_coordinate[coupler]:
            if j >= 0:
                moved[b] |= {i for i in sources[int(j)] if names[i] not in held}
    return moved


def _twists(poses: Poses, cdot: Array) -> Array:
    """Compute what each axis adds to the twist of the bodies beyond it.

    Parameters
    ----------
    poses : of (frames,)
    cdot : (frames, coordinates) [rad/s or m/s]

    Returns
    -------
    (frames, axes, 6) angular velocity, and velocity of the point at the ground's origin [rad/s],
        [m/s]
    """
    arrays = poses.tree.arrays
    speeds = np.zeros(poses.axis_slopes.shape[:2])
    for s in range(2):
        j = arrays.axis_coordinate[:, s]
        speeds += np.where(j >= 0, poses.axis_slopes[:, :, s] * cdot[:, np.maximum(j, 0)], 0.0)
    w = poses.axis_directions * speeds[..., None]
    turns = (arrays.axis_kind == ROTATION)[:, None]
    angular = np.where(turns, w, 0.0)
    linear = np.where(turns, np.cross(poses.axis_points, w), w)
    return np.concatenate([angular, linear], axis=2)


def _exchange(motion: JointMotion, cluster: Cluster) -> Exchange:
    """Find parameters v of a cluster that may go to its ancestor unseen.

        (L(X) - L(X_0)) v = 0,   M S v = 0

    for all states X: the ancestor receives the same in each of them, and the joints' own velocities
    S give them no momentum.

    Parameters
    ----------
    motion : random states
    cluster : of the model
    """
    moved = [_body_in_ancestor(motion, body, cluster.ancestor) for body in cluster.bodies]
    L = np.concatenate([one.parameters for one in moved], axis=2)
    momentum = np.concatenate([one.momentum for one in moved], axis=2)

    changes = (L[1:] - L[:1]) / SCALE[:, None]
    scale = np.tile(SCALE, len(cluster.bodies))
    conditions = np.concatenate([changes, momentum[1:] / LENGTH], axis=1)
    conditions = conditions.reshape(-1, len(scale)) * scale
    R = np.linalg.qr(conditions, mode="r")
    _, values, right = np.linalg.svd(R)
    # A weld meets no condition at all; the unit of comparison is then the size of L itself.
    rank = int(np.sum(values > TOLERANCE * max(values[0], 1.0)))
    leaving = right[rank:].T * scale[:, None]
    return Exchange(leaving=leaving, received=L[0] @ leaving)


def _body_in_ancestor(motion: JointMotion, body: int, ancestor: int) -> BodyInAncestor:
    """Bring unit parameters of a body into the frame of its cluster's ancestor.

    Parameters
    ----------
    motion : random states
    body, ancestor : numbers in the tree's arrays
    """
    poses = motion.poses
    tree = poses.tree
    back = poses.rotations[:, ancestor].transpose(0, 2, 1)
    rotation = back @ poses.rotations[:, body]
    offset = poses.origins[:, body] - poses.origins[:, ancestor]
    parameters = parameters_in_parent(rotation, _turned(back, offset))

    between = tree.supports[body] & ~tree.supports[ancestor]
    twist = motion.twists[:, between].sum(axis=1)
    angular = twist[:, :3]
    # About the ancestor's origin and along its axes.
    linear = twist[:, 3:] + np.cross(angular, poses.origins[:, ancestor])
    velocity = np.concatenate([_turned(back, angular), _turned(back, linear)], axis=1)
    return BodyInAncestor(parameters=parameters, momentum=momentum_rows(velocity) @ parameters)


def _null_space_of(exchange: Exchange, cluster: Cluster, size: int) -> NullSpace:
    """Write what a cluster may give away as changes of all standard parameters.

    Parameters
    ----------
    exchange : of the cluster, with something that may go
    cluster : with the numbers of its bodies
    size : number of standard parameters of the model
    """
    columns = np.concatenate([10 * (b - 1) + np.arange(10) for b in cluster.bodies])
    chosen = _nicest(exchange.leaving)
    vectors = np.zeros((size, exchange.leaving.shape[1]))
    vectors[columns] = exchange.leaving
    vectors[10 * (cluster.ancestor - 1) : 10 * cluster.ancestor] -= exchange.received
    vectors = vectors @ np.linalg.inv(exchange.leaving[chosen])
    vectors[np.abs(vectors) < 1e-11 * np.abs(vectors).max()] = 0.0
    return NullSpace(vectors, columns[chosen])


def _turned(rotations: Array, vectors: Array) -> Array:
    return np.einsum("fij,fj->fi", rotations, vectors)


def _nicest(vectors: Array) -> np.ndarray:
    """Choose rows that make an invertible matrix, masses before moments before inertias.

    Parameters
    ----------
    vectors : (10 n, k)

    Returns
    -------
    (k,) row numbers, ascending
    """
    bodies = len(vectors) // 10
    scale = np.tile(SCALE, bodies)[:, None]
    preference = np.tile(PREFERENCE, bodies)[:, None]
    scaled = (vectors / scale) * preference
    _, order = scipy.linalg.qr(scaled.T, mode="r", pivoting=True)
    return np.sort(order[: vectors.shape[1]])


def parameters_in_parent(rotation: Array, origin: Array) -> Array:
    """Build L: inertial parameters in a parent's frame from those in a child's.

    Parameters
    ----------
    rotation : (..., 3, 3) from the child to the parent
    origin : (..., 3) of the child in the parent [m]

    Returns
    -------
    (..., 10, 10)
    """
    pose = np.zeros((*rotation.shape[:-2], 4, 4))
    pose[..., :3, :3] = rotation
    pose[..., :3, 3] = origin
    pose[..., 3, 3] = 1.0
    unit = pseudo_inertias(np.eye(10))
    moved = np.einsum("...ij,njk,...lk->...nil", pose, unit, pose)
    return np.ascontiguousarray(np.swapaxes(parameters_of(moved), -1, -2))


def momentum_rows(twist: Array) -> Array:
    """Build the momentum of unit parameters.

        l = I w + h x v,  p = m v + w x h

    Parameters
    ----------
    twist : (..., 6) angular velocity w [rad/s] and velocity v of the origin [m/s]

    Returns
    -------
    (..., 6, 10) angular momentum about the origin and linear momentum
    """
    w = twist[..., :3]
    v = twist[..., 3:]
    rows = np.zeros((*twist.shape[:-1], 6, 10))
    for axis, e in enumerate(np.eye(3)):
        rows[..., :3, 1 + axis] = np.cross(e, v)
        rows[..., 3:, 1 + axis] = np.cross(w, e)
        rows[..., axis, 4 + axis] = w[..., axis]
    rows[..., 3:, 0] = v
    for i, a, b in ((7, 1, 2), (8, 2, 0), (9, 0, 1)):
        rows[..., a, i] = w[..., b]
        rows[..., b, i] = w[..., a]
    return rows
