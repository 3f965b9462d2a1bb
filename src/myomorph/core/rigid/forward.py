"""Forward dynamics over frames: accelerations that forces cause, and what holds closed loops."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.shapes import (
    BodyWrenches,
    Coordinates,
    GeneralizedForces,
    LoopRows,
)
from myomorph.core.rigid.coordinates import Ints, couple_rates_frames, gather_dependents
from myomorph.core.rigid.dynamics import MotionArrays, joint_wrenches
from myomorph.core.rigid.frames import run_frames
from myomorph.core.rigid.kernels import kernel
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.loops import RANK, closure_jacobian, closure_rates, free_coordinates
from myomorph.core.rigid.mass_matrix import mass_matrix_frames
from myomorph.core.rigid.tree import Tree


class Acceleration(NamedTuple):
    """Result of forward dynamics.

    Attributes
    ----------
    accelerations : (frames, coordinates) [rad/s^2 or m/s^2]
    multipliers : (frames, rows of loops) forces [N] and moments [N m] that hold the loops closed,
        see `loop_wrenches`
    """

    accelerations: Coordinates
    multipliers: LoopRows


def gathered(tree: Tree, coordinates: Coordinates, forces: GeneralizedForces) -> GeneralizedForces:
    """Hand the forces of dependent coordinates on to those they follow.

    Parameters
    ----------
    tree : the compiled model
    coordinates : (frames, coordinates) consistent [rad or m]
    forces : (frames, coordinates) [N m or N]

    Returns
    -------
    (frames, coordinates) whose columns of dependent coordinates are left as they were [N m or N]
    """
    result = np.array(forces, dtype=np.float64, order="C")
    _gather(tree.arrays, np.array(coordinates, dtype=np.float64, order="C"), result)
    return result


@kernel
def _gather(T, c, rows):
    """`gather_dependents` of frames: c and rows (frames, coordinates), rows in place."""
    if T.coupler_coordinate.shape[0] == 0:
        return
    for frame in range(c.shape[0]):
        gather_dependents(T, c[frame], rows[frame : frame + 1])


def forward_accelerations(
    tree: Tree, motion: MotionArrays, applied: BodyWrenches, generalized: GeneralizedForces
) -> Acceleration:
    """Accelerations that forces cause, couplers and closed loops kept.

        [M  -G^T] [cddot ]   [generalized - h(c, cdot, applied)]
        [G    0 ] [lambda] = [      - Gdot cdot                ]

    on the coordinates that are neither dependent, locked nor prescribed. With x = M^-1 (generalized
    - h), the accelerations of opened loops, and the compliance S = M^-1 G^T,

        lambda = (G S)^+ (-Gdot cdot - G x),   cddot = x + S lambda

    Parameters
    ----------
    tree : the compiled model
    motion : c and cdot, consistent; of the accelerations those of prescribed coordinates are read
    applied : (frames, bodies, 6) as of `joint_wrenches`
    generalized : (frames, coordinates) other forces along coordinates, `gathered` [N m or N]

    Returns
    -------
    accelerations and multipliers of as many frames
    """
    c, cdot, cddot = motion
    free = free_coordinates(tree)
    prescribed = np.array(cddot, dtype=np.float64)
    prescribed[:, free] = 0.0
    prescribed[:, [coordinate.locked for coordinate in tree.model.coordinates]] = 0.0
    base = _consistent(tree, c, cdot, prescribed)

    bias = _required_forces(tree, c, cdot, base, applied)[:, free]
    M = _mass_matrix(tree, c, free)
    x = np.linalg.solve(M, (generalized[:, free] - bias)[..., None])[..., 0]

    multipliers = np.zeros((len(c), int(tree.loops.row[-1])))
    if multipliers.size:
        G = closure_jacobian(tree, c)[:, :, free]
        missing = -closure_rates(tree, c, cdot, base)[1] - np.einsum("frj,fj->fr", G, x)
        compliance = np.linalg.solve(M, np.swapaxes(G, 1, 2))
        multipliers = np.einsum("frs,fs->fr", _pseudo_inverse(G @ compliance), missing)
        x += np.einsum("fjr,fr->fj", compliance, multipliers)

    accelerations = prescribed.copy()
    accelerations[:, free] = x
    return Acceleration(
        accelerations=_consistent(tree, c, cdot, accelerations), multipliers=multipliers
    )


def _mass_matrix(tree: Tree, c: Coordinates, free: Ints) -> Array:
    """Mass matrix of the free coordinates.

    Parameters
    ----------
    c : (frames, coordinates) consistent
    free : (free,) indices of coordinates

    Returns
    -------
    (frames, free, free)
    """
    coordinates = np.array(c, dtype=np.float64, order="C")
    M = np.empty((len(c), c.shape[1], c.shape[1]))
    run_frames(mass_matrix_frames, (tree.arrays,), coordinates, M)
    return M[:, free][:, :, free]


def balancing_multipliers(
    tree: Tree, motion: MotionArrays, applied: BodyWrenches, generalized: GeneralizedForces
) -> LoopRows:
    """Find the loop forces of least norm that balance a known motion.

        min |lambda| so that G^T lambda = required forces - generalized

    Parameters
    ----------
    tree : the compiled model
    motion : consistent
    applied, generalized : as of `forward_accelerations`

    Returns
    -------
    (frames, rows of loops) [N or N m], see `loop_wrenches`
    """
    if not tree.model.loops:
        return np.zeros((len(motion.values), 0))
    free = free_coordinates(tree)
    missing = (_required_forces(tree, *motion, applied) - generalized)[:, free]
    G = closure_jacobian(tree, motion.values)[:, :, free]
    return np.einsum("frj,fj->fr", _pseudo_inverse(np.swapaxes(G, 1, 2)), missing)


def _pseudo_inverse(matrices: Array) -> Array:
    """Moore-Penrose inverses (frames, n, m) of matrices (frames, m, n); NaN where a frame is."""
    result = np.full((len(matrices), matrices.shape[2], matrices.shape[1]), np.nan)
    finite = np.isfinite(matrices).all(axis=(1, 2))
    result[finite] = np.linalg.pinv(matrices[finite], rcond=RANK)
    return result


def loop_wrenches(tree: Tree, c: Coordinates, multipliers: LoopRows) -> BodyWrenches:
    """Wrenches that closed loops exert on the bodies they connect.

    A multiplier is a force or moment on the second body along the axes of the loop's frame on the
    first. The first body takes the opposite.

    Parameters
    ----------
    tree : the compiled model
    c : (frames, coordinates) consistent [rad or m]
    multipliers : (frames, rows of loops) [N or N m]

    Returns
    -------
    (frames, bodies, 6) as of `joint_wrenches`
    """
    poses = forward_kinematics(tree, c)
    loops = tree.loops
    result = np.zeros((len(c), len(tree.arrays.parent), 6))
    for i in range(len(loops.body_1)):
        body_1 = loops.body_1[i]
        body_2 = loops.body_2[i]
        rotation = poses.rotations[:, body_1] @ loops.turn_1[i]
        point = poses.origins[:, body_2] + poses.rotations[:, body_2] @ loops.point_2[i]
        rows = multipliers[:, loops.row[i] : loops.row[i + 1]]
        force = np.einsum("fij,fj->fi", rotation, rows[:, -3:])
        moment = np.cross(point, force)
        if rows.shape[1] == 6:
            moment += np.einsum("fij,fj->fi", rotation, rows[:, :3])
        wrench = np.concatenate([force, moment], axis=1)
        result[:, body_2] += wrench
        result[:, body_1] -= wrench
    return result


def _consistent(tree: Tree, c: Coordinates, cdot: Coordinates, cddot: Coordinates) -> Coordinates:
    """Accelerations (frames, coordinates) with those of dependent coordinates set."""
    values = np.array(c, dtype=np.float64, order="C")
    rates = np.array(cdot, dtype=np.float64, order="C")
    result = np.array(cddot, dtype=np.float64, order="C")
    couple_rates_frames(tree.arrays, values, rates, result)
    return result


def _required_forces(
    tree: Tree, c: Coordinates, cdot: Coordinates, cddot: Coordinates, applied: BodyWrenches
) -> GeneralizedForces:
    """Generalized forces, gathered, that a motion needs beside the wrenches on its bodies.

    Parameters
    ----------
    c, cdot, cddot : (frames, coordinates) consistent
    applied : (frames, bodies, 6) as of `joint_wrenches`

    Returns
    -------
    (frames, coordinates) [N m or N]
    """
    return gathered(tree, c, joint_wrenches(tree, c, cdot, cddot, applied).torques)
