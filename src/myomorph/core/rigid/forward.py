"""Forward dynamics over frames: accelerations that given forces cause, and what holds closed loops."""

from __future__ import annotations

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.rigid.coordinates import Ints, couple_rates_frames, gather_dependents
from myomorph.core.rigid.dynamics import joint_wrenches
from myomorph.core.rigid.kernels import kernel
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.loops import RANK, closure_jacobian, closure_rates, free_coordinates
from myomorph.core.rigid.tree import Tree


def gathered(tree: Tree, coordinates: Array, forces: Array) -> Array:
    """Generalized forces (frames, coordinates) with the share of coordinates that follow handed on
    to what leads.
    """
    result = np.array(forces, dtype=np.float64, order="C")
    _gather(tree.arrays, np.array(coordinates, dtype=np.float64, order="C"), result)
    return result


@kernel
def _gather(T, c, rows):
    if T.coupler_coordinate.shape[0] == 0:
        return
    for frame in range(c.shape[0]):
        gather_dependents(T, c[frame], rows[frame : frame + 1])


def forward_accelerations(
    tree: Tree, c: Array, cdot: Array, cddot: Array, applied: Array, generalized: Array
) -> tuple[Array, Array]:
    """Accelerations under given forces, couplers and closed loops kept.

        [M  -G^T] [cddot ]   [generalized - h(c, cdot, applied)]
        [G    0 ] [lambda] = [      - Gdot cdot                ]

    on the coordinates that neither follow, nor are locked or prescribed.

    `c`, `cdot` (frames, coordinates) consistent; `cddot` (frames, coordinates) of which those of
    prescribed coordinates are read; locked ones have none; `applied` (frames, bodies, 6) as of
    `joint_wrenches`; `generalized` (frames, coordinates) other forces along coordinates, `gathered`
    [N m or N]. Returns `accelerations` (frames, coordinates); `multipliers` (frames, rows of loops)
    forces that hold the loops closed, see `loop_wrenches`.
    """
    free = free_coordinates(tree)
    base = np.array(cddot, dtype=np.float64)
    base[:, free] = 0.0
    base[:, [coordinate.locked for coordinate in tree.model.coordinates]] = 0.0
    rest = _consistent(tree, c, cdot, base)
    bias = _needed(tree, c, cdot, rest, applied)[:, free]
    M = _mass_matrix(tree, c, free)
    right = generalized[:, free] - bias
    x = np.linalg.solve(M, right[..., None])[..., 0]
    multipliers = np.zeros((len(c), int(tree.loops.row[-1])))
    if multipliers.size:
        G = closure_jacobian(tree, c)[:, :, free]
        wanted = -closure_rates(tree, c, cdot, rest)[1] - np.einsum("frj,fj->fr", G, x)
        softness = np.linalg.solve(M, np.swapaxes(G, 1, 2))
        inverse = _pseudo_inverse(G @ softness)
        multipliers = np.einsum("frs,fs->fr", inverse, wanted)
        x += np.einsum("fjr,fr->fj", softness, multipliers)
    accelerations = base.copy()
    accelerations[:, free] = x
    return _consistent(tree, c, cdot, accelerations), multipliers


def _mass_matrix(tree: Tree, c: Array, free: Ints) -> Array:
    """M (frames, free, free), column by column from what unit accelerations need at rest."""
    still = np.zeros_like(c)
    nothing = np.zeros((len(c), len(tree.arrays.parent), 6))
    weight = _needed(tree, c, still, still, nothing)[:, free]
    M = np.empty((len(c), len(free), len(free)))
    for column, j in enumerate(free):
        unit = still.copy()
        unit[:, j] = 1.0
        M[:, :, column] = (
            _needed(tree, c, still, _consistent(tree, c, still, unit), nothing)[:, free] - weight
        )
    return M


def balancing_multipliers(
    tree: Tree, c: Array, cdot: Array, cddot: Array, applied: Array, generalized: Array
) -> Array:
    """Forces (frames, rows of loops) that loops carry in a motion that is given: the least that
    explain its balance.
    """
    if not tree.model.loops:
        return np.zeros((len(c), 0))
    free = free_coordinates(tree)
    missing = (_needed(tree, c, cdot, cddot, applied) - generalized)[:, free]
    G = closure_jacobian(tree, c)[:, :, free]
    return np.einsum("frj,fj->fr", _pseudo_inverse(np.swapaxes(G, 1, 2)), missing)


def _pseudo_inverse(matrices: Array) -> Array:
    """Moore-Penrose inverses of (frames, m, n); NaN where a frame is."""
    result = np.full((len(matrices), matrices.shape[2], matrices.shape[1]), np.nan)
    good = np.isfinite(matrices).all(axis=(1, 2))
    result[good] = np.linalg.pinv(matrices[good], rcond=RANK)
    return result


def loop_wrenches(tree: Tree, c: Array, multipliers: Array) -> Array:
    """What closed loops do to the bodies they tie, (frames, bodies, 6) as of `joint_wrenches`.
    A multiplier is a force [N] or moment [N m] on the second body along the axes of the first tied
    frame.
    """
    poses = forward_kinematics(tree, c)
    L = tree.loops
    result = np.zeros((len(c), len(tree.arrays.parent), 6))
    for i in range(len(L.body_1)):
        b1 = L.body_1[i]
        b2 = L.body_2[i]
        turn = poses.rotations[:, b1] @ L.turn_1[i]
        point = poses.origins[:, b2] + poses.rotations[:, b2] @ L.point_2[i]
        rows = multipliers[:, L.row[i] : L.row[i + 1]]
        force = np.einsum("fij,fj->fi", turn, rows[:, -3:])
        moment = np.cross(point, force)
        if rows.shape[1] == 6:
            moment += np.einsum("fij,fj->fi", turn, rows[:, :3])
        wrench = np.concatenate([force, moment], axis=1)
        result[:, b2] += wrench
        result[:, b1] -= wrench
    return result


def _consistent(tree: Tree, c: Array, cdot: Array, cddot: Array) -> Array:
    """Accelerations with those of coordinates that follow set."""
    values = np.array(c, dtype=np.float64, order="C")
    rates = np.array(cdot, dtype=np.float64, order="C")
    result = np.array(cddot, dtype=np.float64, order="C")
    couple_rates_frames(tree.arrays, values, rates, result)
    return result


def _needed(tree: Tree, c: Array, cdot: Array, cddot: Array, applied: Array) -> Array:
    """Generalized forces (frames, coordinates), gathered, that the accelerations need beside what
    is applied.
    """
    return gathered(tree, c, joint_wrenches(tree, c, cdot, cddot, applied).torques)
