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
from myomorph.core.rigid.bushings import angular_velocities
from myomorph.core.rigid.coordinates import Ints, gather_dependents
from myomorph.core.rigid.loops import RANK, closure_jacobian
from myomorph.core.rigid.tree import Tree

STILL = 1e-9  # A coordinate whose part in its own projection is less cannot move
TURNING = ("ScapulothoracicJoint", "EllipsoidJoint", "BallJoint", "FreeJoint")
"""Joints whose speeds in OpenSim are angular velocities instead of rates of their three angles."""


@dataclass(frozen=True, eq=False)
class LoopGroup:
    """Coordinates that loops tie together, with those that couplers tie to them."""

    coordinates: Ints  # indices, ascending
    leading: Ints  # those among `coordinates` that no coupler drives, as places in it
    stays: np.ndarray  # (coordinates,) whether each is locked or prescribed


def loop_groups(tree: Tree) -> tuple[LoopGroup, ...]:
    """Groups of coordinates that cannot move without each other because a loop is closed."""
    arrays = tree.arrays
    model = tree.model
    sets: list[set[int]] = []
    for i in range(len(tree.loops.body_1)):
        between = tree.supports[tree.loops.body_1[i]] ^ tree.supports[tree.loops.body_2[i]]
        sets.append({int(j) for j in arrays.axis_coordinate[between].ravel() if j >= 0})
    ties = [
        {int(j), *(int(source) for source in sources if source >= 0)}
        for j, sources in zip(arrays.coupler_coordinate, arrays.coupler_source, strict=True)
    ]
    groups: list[set[int]] = []
    for members_here in sets:
        grown = members_here
        while more := [tie for tie in (*ties, *groups) if tie & grown and not tie <= grown]:
            grown = grown.union(*more)
        groups = [group for group in groups if not group <= grown] + [grown]
    driven = set(arrays.coupler_coordinate.tolist())
    results = []
    for group in groups:
        members = np.array(sorted(group), np.int64)
        stays = [
            model.coordinates[j].locked or model.coordinates[j].prescribed is not None
            for j in members
        ]
        leading = np.array(
            [place for place, j in enumerate(members) if int(j) not in driven], np.int64
        )
        results.append(LoopGroup(members, leading, np.array(stays, bool)))
    return tuple(results)


def loop_couplings(tree: Tree, group: LoopGroup, coordinates: Array) -> Array:
    """How fast a group's leading coordinates move per unit speed of each of its coordinates.
    `coordinates` (frames, coordinates) consistent values. Returns (frames, leading, group) column k
    holds P e_k / (P e_k)_k of the formula above, of what leads; where k cannot move, its own motion
    alone.
    """
    members = group.coordinates
    leading = group.leading
    frames = len(coordinates)
    n = len(members)
    G = closure_jacobian(tree, coordinates)[:, :, members[leading]]
    T = _leads(tree, group, coordinates)
    _turn(tree, group, coordinates, T)
    result = np.zeros((frames, len(leading), n))
    places = {int(place): i for i, place in enumerate(leading)}
    for index in range(n):
        free = ~group.stays[leading]
        if index in places:
            free[places[index]] = True
        # Least |T v - e_k| over speeds v that keep the loops closed.
        inverse = np.linalg.inv(np.einsum("fni,fnj->fij", T[:, :, free], T[:, :, free]))
        wanted = np.einsum("fij,fj->fi", inverse, T[:, index][:, free])
        g = G[:, :, free]
        metric = np.einsum("fri,fij,fsj->frs", g, inverse, g)
        force = np.einsum(
            "frs,fsi,fi->fr", np.linalg.pinv(metric, rcond=RANK, hermitian=True), g, wanted
        )
        v = wanted - np.einsum("fij,frj,fr->fi", inverse, g, force)
        own = np.einsum("fi,fi->f", T[:, index][:, free], v)
        moves = own > STILL
        result[np.ix_(moves, np.flatnonzero(free), np.array([index]))] = (
            v[moves] / own[moves, None]
        )[:, :, None]
        if index in places:
            result[~moves, places[index], index] = 1.0
    return result


def _leads(tree: Tree, group: LoopGroup, coordinates: Array) -> Array:
    """(frames, group, leading) derivatives of a group's coordinates in those of them that lead."""
    n = len(group.coordinates)
    leads = np.zeros((len(coordinates), n, len(group.leading)))
    leads[:, group.leading, np.arange(len(group.leading))] = 1.0
    if n == len(group.leading):
        return leads
    rows = np.zeros((n, len(tree.model.coordinates)))
    for frame, c in enumerate(np.array(coordinates)):
        rows[:] = 0.0
        rows[np.arange(n), group.coordinates] = 1.0
        gather_dependents(tree.arrays, c, rows)
        leads[frame] = rows[:, group.coordinates[group.leading]]
    return leads


def _turn(tree: Tree, group: LoopGroup, coordinates: Array, leads: Array) -> None:
    """Make angular velocities of the rates of three angles turned about body-fixed axes, in
    `TURNING` joints.
    """
    names = tree.model.coordinate_names
    places = {int(j): place for place, j in enumerate(group.coordinates)}
    for joint in tree.model.joints:
        turns = [axis for axis in joint.axes if axis.kind == "rotation" and axis.function.arity][:3]
        if joint.kind not in TURNING or any(len(axis.coordinates) != 1 for axis in turns):
            continue
        members = [names.index(axis.coordinates[0]) for axis in turns]
        if not places.keys() >= set(members):
            continue
        rows = [places[j] for j in members]
        turn = angular_velocities(coordinates[:, members[0]], coordinates[:, members[1]])
        leads[:, rows] = turn @ leads[:, rows]
