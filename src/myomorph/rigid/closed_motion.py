"""Motions of models that close loops: kept on the loops, and torques of the coordinates that can be chosen freely."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from myomorph.model.arrays import Array, read_only
from myomorph.model.errors import BadData
from myomorph.model.model import Model
from myomorph.model.series import Motion, Series
from myomorph.rigid.coordinates import couple_rates_frames, gather_dependents
from myomorph.rigid.dynamics import motion_arrays
from myomorph.rigid.loops import LoopBasis, close_loops, closure, loop_basis, project_rates
from myomorph.rigid.tree import Tree, compile_tree

OPEN = 0.01  # A motion whose loops stand open by more belongs to another model [m or rad]
TOLD = 1e-4  # A motion whose loops stand open by less is closed without a word [m or rad]


def refuse_open(tree: Tree, coordinates: Array) -> float:
    """How far loops stand open in the worst frame [m or rad], where that is bearable."""
    if not tree.model.loops:
        return 0.0
    good = np.isfinite(coordinates).all(axis=1)
    if not good.any():
        raise BadData("no frame of the motion has all coordinates: closed loops need them")
    errors = np.abs(closure(tree, coordinates[good]))
    worst = float(errors.max(initial=0.0))
    if worst > OPEN:
        row = int(np.argmax(errors.max(axis=0)))
        loop = tree.model.loops[int(np.searchsorted(tree.loops.row, row, side="right")) - 1]
        raise BadData(
            f"the motion holds {loop.kind} '{loop.name}' open by up to {worst:.3g} m or rad: at most {OPEN:g} are "
            "closed by projection; does the motion belong to this model? Inverse kinematics gives one that does"
        )
    return worst


def closed_motion(model: Model, motion: Motion) -> tuple[Motion, tuple[str, ...]]:
    """The motion nearest to the one given that keeps every loop closed, and what it took.
    Coordinates, velocities and accelerations move as little as possible in the plain norm over [rad] and [m];
    locked and prescribed ones stay. A model without loops gets its motion back.
    `motion`: with or without velocities and accelerations; what it lacks rests at the model's default. Returns
    `motion`: of all the model's coordinates where there are loops; `notes`: one line where loops stood open by more
    than `TOLD`.
    """
    if not model.loops:
        return motion, ()
    tree = compile_tree(model)
    values = tree.coordinates_of(motion)
    worst = refuse_open(tree, values)
    coordinates = close_loops(tree, values)
    moved = float(np.nanmax(np.abs(coordinates - values), initial=0.0))
    velocities, accelerations = tree.rates_of(motion)
    couple_rates_frames(tree.arrays, coordinates, velocities, accelerations)
    velocities, accelerations = project_rates(tree, coordinates, velocities, accelerations)
    closed = replace(
        motion,
        names=model.coordinate_names,
        values=coordinates,
        velocities=None if motion.velocities is None else velocities,
        accelerations=None if motion.accelerations is None else accelerations,
    )
    if worst <= TOLD:
        return closed, ()
    named = ", ".join(f"'{loop.name}'" for loop in model.loops)
    note = f"loops ({named}) stood open by up to {worst:.2g} m or rad"
    return closed, (f"{note}: coordinates moved by up to {moved:.2g} to close them",)


@read_only
class LoopTorques:
    """Generalized forces of the coordinates that follow no other, couplers' and loops' share handed on."""

    torques: Series  # (frames, independent coordinates) tau_ind + (d dependent / d independent)^T tau_dep [N m or N]
    dependent: tuple[str, ...]  # names of the coordinates that a loop makes follow
    margin: Array  # (frames,) how well the choice of those is conditioned, see `LoopBasis`


def loop_torques(model: Model, motion: Motion, torques: Series) -> LoopTorques:
    """What has to act at the independent coordinates to make the model move, loops closed.

    A closed loop carries forces of its own, so the torque of one of its coordinates alone means nothing: any
    tau + G^T lambda moves the model alike (G derivative of the closure). Folding through the null space of G,

        tau_ind + slopes^T tau_dep,   qdot_dep = slopes qdot_ind,

    leaves what does not depend on lambda. Forces that hold locked and prescribed coordinates stay as they are.

    `torques`: of `inverse_dynamics`, a column for every coordinate.
    """
    tree = compile_tree(model)
    c, _, _ = motion_arrays(tree, motion)
    refuse_open(tree, c)
    tau = np.array(torques.values)
    for frame in range(len(tau)):
        gather_dependents(tree.arrays, c[frame], tau[frame : frame + 1])
    basis = loop_basis(tree, c)
    tau[:, basis.independent] += np.einsum("fdi,fd->fi", basis.slopes, tau[:, basis.dependent])
    names = model.coordinate_names
    kept = [int(j) for j in tree.independent if j not in basis.dependent]
    folded = Series(torques.time, tuple(names[j] for j in kept), tau[:, kept])
    return LoopTorques(folded, tuple(names[j] for j in basis.dependent), basis.margin)


def loop_slopes(basis: LoopBasis | None, coordinates: Array) -> Array:
    """(frames, dependents, coordinates) derivatives of what loops make follow, 0 columns where nothing leads."""
    count = 0 if basis is None else len(basis.dependent)
    slopes = np.zeros((len(coordinates), count, coordinates.shape[1]))
    if basis is not None:
        slopes[:, :, basis.independent] = basis.slopes
    return slopes
