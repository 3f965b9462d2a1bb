"""Moment arms about coordinates that closed loops tie together, as OpenSim defines them.

A coordinate of a loop cannot move alone. OpenSim's moment arm about coordinate k is the length that
the path gains per unit of motion of k while the others follow as little as the loop lets them: with
P the orthogonal projection of speeds onto those that keep loops closed and couplers true,

    arm_k = (P e_k)^T r / (P e_k)_k,     r_j = -dl/dq_j with every coordinate moved alone

(Sherman, Seth and Delp 2013; `MomentArmSolver` of OpenSim). Locked coordinates stay, except k
itself. What is "as little" hangs on the speeds that are counted. OpenSim counts the rates of most
coordinates, but for the three rotations of a `ScapulothoracicJoint`, `EllipsoidJoint`, `BallJoint`
and `FreeJoint` the angular velocity along the joint's axes, which stands under the coordinate's
name; so are ours where a loop is closed. Sums of these arms do not balance torques, for each holds
the others' share: muscle forces take the null space instead, see `rigid.closed_motion`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.shapes import Coordinates
from myomorph.core.rigid.bushings import angular_velocities
from myomorph.core.rigid.coordinates import Ints, gather_dependents
from myomorph.core.rigid.loops import RANK, closure_jacobian
from myomorph.core.rigid.tree import Flags, Tree

MIN_SHARE = 1e-9  # Of its own projection in a coordinate; one that has less cannot move
ANGULAR_SPEEDS = ("ScapulothoracicJoint", "EllipsoidJoint", "BallJoint", "FreeJoint")
"""Joints whose speeds in OpenSim are angular velocities instead of rates of their three angles."""


@dataclass(frozen=True, eq=False)
class LoopGroup:
    """Coordinates that loops tie together, with those that couplers tie to them.

    Attributes
    ----------
    coordinates : ascending indices
    leading : positions in `coordinates` of those that no coupler drives
    stays : (coordinates,) whether each is locked or prescribed
    """

    coordinates: Ints
    leading: Ints
    stays: Flags


def loop_groups(tree: Tree) -> tuple[LoopGroup, ...]:
    """Find the groups of coordinates that cannot move without each other where loops are closed.

    A loop ties the coordinates between its two bodies, a coupler those that it takes and sets; what
    has a coordinate in common is one group.
    """
    arrays = tree.arrays
    couplers = zip(arrays.coupler_coordinate, arrays.coupler_source, strict=True)
    tied_by_couplers = [
        {int(dependent), *(int(source) for source in sources if source >= 0)}
        for dependent, sources in couplers
    ]
    groups: list[set[int]] = []
    for body_1, body_2 in zip(tree.loops.body_1, tree.loops.body_2, strict=True):
        between = tree.supports[body_1] ^ tree.supports[body_2]
        group = {int(j) for j in arrays.axis_coordinate[between].ravel() if j >= 0}
        group = _grown(group, [*tied_by_couplers, *groups])
        groups = [other for other in groups if not other <= group] + [group]
    return tuple(_loop_group(tree, group) for group in groups)


def _grown(group: set[int], ties: list[set[int]]) -> set[int]:
    """Add all sets of tied coordinates that share one with a group."""
    while more := [tie for tie in ties if tie & group and not tie <= group]:
        group = group.union(*more)
    return group


def _loop_group(tree: Tree, coordinates: set[int]) -> LoopGroup:
    """Sort the coordinates of a group."""
    members = np.array(sorted(coordinates), np.int64)
    driven = set(tree.arrays.coupler_coordinate.tolist())
    leading = [position for position, j in enumerate(members) if int(j) not in driven]
    stays = [not tree.model.coordinates[j].is_free for j in members]
    return LoopGroup(
        coordinates=members,
        leading=np.array(leading, np.int64),
        stays=np.array(stays, bool),
    )


def loop_couplings(tree: Tree, group: LoopGroup, coordinates: Coordinates) -> Array:
    """Speeds of a group's leading coordinates per unit speed of each of its coordinates.

    With T the speeds that count, as of `_counted_speeds`, the projection P e_k is the v of

        min |T v - e_k|^2 so that G v = 0

    Parameters
    ----------
    tree : the compiled model
    group : of the tree
    coordinates : (frames, coordinates) consistent [rad or m]

    Returns
    -------
    (frames, leading, group) column k holds P e_k / (P e_k)_k of the formula above, of the leading
    coordinates; where k cannot move, its own motion alone
    """
    leading = group.leading
    G = closure_jacobian(tree, coordinates)[:, :, group.coordinates[leading]]
    T = _counted_speeds(tree, group, coordinates)
    result = np.zeros((len(coordinates), len(leading), len(group.coordinates)))
    position_in_leading = {int(position): i for i, position in enumerate(leading)}
    for k in range(len(group.coordinates)):
        free = ~group.stays[leading]
        if k in position_in_leading:
            free[position_in_leading[k]] = True
        v = _projected(T[:, :, free], G[:, :, free], k)
        own_speed = np.einsum("fi,fi->f", T[:, k][:, free], v)
        moves = own_speed > MIN_SHARE
        speeds = v[moves] / own_speed[moves, None]
        result[np.ix_(moves, np.flatnonzero(free), np.array([k]))] = speeds[:, :, None]
        if k in position_in_leading:
            result[~moves, position_in_leading[k], k] = 1.0
    return result


def _projected(T: Array, G: Array, k: int) -> Array:
    """Nearest speeds to the unit speed of coordinate k that keep loops closed.

    With A = (T^T T)^-1 and the free projection u = A T^T e_k,

        v = u - A G^T (G A G^T)^+ G u

    Parameters
    ----------
    T : (frames, group, free) speeds that count per unit speed of free leading coordinates
    G : (frames, rows, free) Jacobian of the loops' closure
    k : row of T

    Returns
    -------
    (frames, free)
    """
    inverse = np.linalg.inv(np.einsum("fni,fnj->fij", T, T))
    unconstrained = np.einsum("fij,fj->fi", inverse, T[:, k])
    metric = np.einsum("fri,fij,fsj->frs", G, inverse, G)
    metric_inverse = np.linalg.pinv(metric, rcond=RANK, hermitian=True)
    force = np.einsum("frs,fsi,fi->fr", metric_inverse, G, unconstrained)
    return unconstrained - np.einsum("fij,frj,fr->fi", inverse, G, force)


def _counted_speeds(tree: Tree, group: LoopGroup, coordinates: Coordinates) -> Array:
    """Speeds that OpenSim counts of a group, per unit speed of its leading coordinates.

    Parameters
    ----------
    coordinates : (frames, coordinates) consistent

    Returns
    -------
    (frames, group, leading) rates of coordinates, and angular velocities in the joints of
    `ANGULAR_SPEEDS`
    """
    speeds = _rates(tree, group, coordinates)
    names = tree.model.coordinate_names
    positions = {int(j): position for position, j in enumerate(group.coordinates)}
    for joint in tree.model.joints:
        rotations = [axis for axis in joint.axes if axis.kind == "rotation" and axis.function.arity]
        angles = rotations[:3]
        if joint.kind not in ANGULAR_SPEEDS or any(len(axis.coordinates) != 1 for axis in angles):
            continue
        members = [names.index(axis.coordinates[0]) for axis in angles]
        if not positions.keys() >= set(members):
            continue
        rows = [positions[j] for j in members]
        E = angular_velocities(coordinates[:, members[0]], coordinates[:, members[1]])
        speeds[:, rows] = E @ speeds[:, rows]
    return speeds


def _rates(tree: Tree, group: LoopGroup, coordinates: Coordinates) -> Array:
    """Differentiate a group's coordinates by its leading ones.

    Returns
    -------
    (frames, group, leading)
    """
    size = len(group.coordinates)
    count = len(group.leading)
    result = np.zeros((len(coordinates), size, count))
    result[:, group.leading, np.arange(count)] = 1.0
    if size == count:
        return result
    rows = np.zeros((size, len(tree.model.coordinates)))
    for frame, c in enumerate(np.array(coordinates)):
        rows[:] = 0.0
        rows[np.arange(size), group.coordinates] = 1.0
        gather_dependents(tree.arrays, c, rows)
        result[frame] = rows[:, group.coordinates[group.leading]]
    return result
