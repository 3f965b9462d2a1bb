"""Closed kinematic loops: errors of closure, coordinates and rates that keep them closed, and who
follows whom.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion, Series
from myomorph.core.rigid.coordinates import (
    Ints,
    couple_frames,
    couple_rates_frames,
    gather_dependents,
)
from myomorph.core.rigid.dynamics import motion_arrays
from myomorph.core.rigid.frames import run_frames
from myomorph.core.rigid.loop_kernels import loop_frames, loop_rate_frames
from myomorph.core.rigid.tree import Tree, compile_tree

CLOSED = 1e-10  # A loop is closed when no error is larger [m or rad]
# A direction of a Jacobian counts where its singular value is at least this share of the largest
RANK = 1e-8
NEAREST = 1e-9  # A projection has arrived when its last step is shorter [rad or m, weighted]
STEPS = 200  # Steps of a projection
ELSEWHERE = 30  # Random poses from which a loop is closed that does not close from where it is
FRAMES_AT_ONCE = 256


def closure(tree: Tree, coordinates: Array) -> Array:
    """How far the loops stand open, (frames, rows).
    Of every loop the second tied frame is seen from the first. A point constraint has three rows,
    the second point [m]; a weld has before them three of turning, 2 sin(angle / 2) axis [rad]. What
    moves both bodies together changes nothing. `coordinates` (frames, coordinates) in the model's
    order, dependent ones consistent [rad or m].
    """
    return _closures(tree, coordinates)[0]


def closure_jacobian(tree: Tree, coordinates: Array) -> Array:
    """Derivatives of `closure` in the coordinates, (frames, rows, coordinates).
    Columns of independent coordinates include what reaches the loop through the coordinates that
    follow them; columns of those stand as they are by themselves (`gather_dependents`).
    """
    return _closures(tree, coordinates)[1]


def closure_rates(
    tree: Tree, coordinates: Array, velocities: Array, accelerations: Array
) -> tuple[Array, Array]:
    """First and second time derivative of `closure`: G qdot and G qddot + Gdot qdot, (frames, rows)
    each. `coordinates`, `velocities`, `accelerations` (frames, coordinates), dependent ones
    consistent.
    """
    c = _copy(coordinates)
    cdot = _copy(velocities)
    cddot = _copy(accelerations)
    first, second = np.empty((2, len(c), tree.loops.row[-1]))
    run_frames(loop_rate_frames, (tree.arrays, tree.loops), c, cdot, cddot, first, second)
    return first, second


def close_loops(tree: Tree, coordinates: Array) -> Array:
    """The coordinates nearest to those given that close every loop.
    min sum_j (c_j - given_j)^2 so that closure(c) = 0, by gradient projection.
    Locked and prescribed coordinates stay, coupled ones follow; ranges are not looked at.
    `coordinates` (frames, coordinates) [rad or m]; frames that hold NaN stay as they are.
    """
    targets = _copy(coordinates)
    couple_frames(tree.arrays, targets)
    if not tree.model.loops:
        return targets
    free = free_coordinates(tree)
    closed = targets.copy()
    good = np.flatnonzero(np.isfinite(targets).all(axis=1))
    for start in range(0, len(good), FRAMES_AT_ONCE):
        frames = good[start : start + FRAMES_AT_ONCE]
        closed[frames] = _project(tree, targets[frames], free)
    error = np.abs(closure(tree, closed[good]))
    if error.size and error.max() > CLOSED:
        worst, row = np.unravel_index(int(np.argmax(error)), error.shape)
        loop = tree.model.loops[int(np.searchsorted(tree.loops.row, row, side="right")) - 1]
        before = float(np.abs(closure(tree, targets[good[worst]][None])).max())
        raise BadData(
            f"frame {good[worst]}: {loop.kind} '{loop.name}' cannot be closed,"
            f" {error[worst, row]:.2g} are left of {before:.2g} m or rad; do the coordinates belong"
            f" to this model, and is enough of {', '.join(_movers(tree))} free to move?"
        )
    return closed


def project_rates(
    tree: Tree, coordinates: Array, velocities: Array, accelerations: Array
) -> tuple[Array, Array]:
    """Velocities and accelerations nearest to those given with which closed loops stay closed.
    G qdot = 0 and G qddot + Gdot qdot = 0, changed as little as possible. Locked and prescribed
    coordinates keep their rates, coupled ones follow. `coordinates`, `velocities`, `accelerations`
    (frames, coordinates), the coordinates closed (`close_loops`). Returns `velocities`,
    `accelerations` (frames, coordinates).
    """
    c = _copy(coordinates)
    v = _copy(velocities)
    a = _copy(accelerations)
    couple_rates_frames(tree.arrays, c, v, a)
    good = np.isfinite(c + v + a).all(axis=1)
    if not tree.model.loops or not good.any():
        return v, a
    free = free_coordinates(tree)
    inverse = _pseudo_inverse(closure_jacobian(tree, c[good])[:, :, free])
    for order, rates in enumerate((v, a)):
        wrong = closure_rates(tree, c[good], v[good], a[good])[order]
        rates[np.ix_(good, free)] -= np.einsum("fjr,fr->fj", inverse, wrong)
        couple_rates_frames(tree.arrays, c, v, a)
        left = np.abs(closure_rates(tree, c[good], v[good], a[good])[order])
        if left.max() > 1e-9 * (1.0 + np.abs(wrong).max() + np.abs(rates[good]).max()):
            raise BadData(
                f"rates cannot keep the loops closed: {left.max():.2g} are left of"
                f" {np.abs(wrong).max():.2g}; is enough of {', '.join(_movers(tree))} free to move?"
            )
    return v, a


@dataclass(frozen=True, eq=False)
class LoopBasis:
    """Which coordinates follow which where loops stay closed: qdot[dependent] = slopes @
    qdot[independent].
    """

    # independent, dependent: indices of coordinates, together all that were free
    independent: Ints
    dependent: Ints
    slopes: Array  # (frames, dependent, independent)
    rank: int  # how many directions the loops take, over all frames (dependent coordinates)
    # (frames,) smallest singular value of the dependent columns relative to the largest of all free
    # columns; near 0 the choice is singular and the slopes are large
    margin: Array


def loop_basis(
    tree: Tree, coordinates: Array, free: Sequence[int] | Ints | None = None
) -> LoopBasis:
    """Dependent and independent coordinates of closed loops, the same in all frames, and the slopes
    between them. One dependent coordinate after the other is taken, each the one whose column of
    the Jacobian stays largest in the frame where it is smallest, after the columns taken before are
    projected off (QR with column pivoting over all frames at once); a clamped coordinate counts
    half, so that it rather stays independent. `coordinates` (frames, coordinates), closed; frames
    that hold NaN get slopes of NaN; `free`: indices of the coordinates that may move, by default
    all that are neither coupled, locked nor prescribed.
    """
    free = free_coordinates(tree) if free is None else np.asarray(free, np.int64)
    good = np.isfinite(coordinates).all(axis=1)
    G = closure_jacobian(tree, coordinates[good])[:, :, free]
    chosen = _pivots(tree, G, free)
    rest = np.setdiff1d(np.arange(len(free)), chosen)
    slopes = np.full((len(coordinates), len(chosen), len(rest)), np.nan)
    margin = np.full(len(coordinates), np.nan)
    if len(chosen):
        slopes[good] = -_pseudo_inverse(G[:, :, chosen]) @ G[:, :, rest]
        largest = np.linalg.svd(G, compute_uv=False)[:, 0]
        margin[good] = np.linalg.svd(G[:, :, chosen], compute_uv=False)[:, -1] / np.maximum(
            largest, 1e-300
        )
    return LoopBasis(
        independent=free[rest],
        dependent=free[chosen],
        slopes=slopes,
        rank=len(chosen),
        margin=margin,
    )


def free_coordinates(tree: Tree) -> Ints:
    """Indices of the coordinates that are neither coupled, locked nor prescribed."""
    stays = [
        coordinate.locked or coordinate.prescribed is not None
        for coordinate in tree.model.coordinates
    ]
    return np.array([j for j in tree.independent if not stays[j]], np.int64)


def _closures(tree: Tree, coordinates: Array) -> tuple[Array, Array]:
    c = _copy(coordinates)
    rows = int(tree.loops.row[-1])
    errors = np.empty((len(c), rows))
    jacobian = np.empty((len(c), rows, c.shape[1]))
    if rows:
        run_frames(loop_frames, (tree.arrays, tree.loops), c, errors, jacobian)
    return errors, jacobian


def _copy(array: Array) -> Array:
    """A copy, because a kernel is compiled anew for an array that is read-only."""
    return np.array(array, dtype=np.float64, order="C")


def _pseudo_inverse(G: Array) -> Array:
    """(frames, n, rows) Moore-Penrose inverse of (frames, rows, n), directions below `RANK` left
    out.
    """
    return np.asarray(np.linalg.pinv(G, rcond=RANK), np.float64)


def _project(tree: Tree, targets: Array, free: Ints) -> Array:
    """Nearest closed coordinates: steps towards those given along the constraint, closed again
    after each.
    """
    c = _shut(tree, targets, free)
    for frame in np.flatnonzero(np.abs(closure(tree, c)).max(axis=1) > CLOSED):
        c[frame] = _elsewhere(tree, targets[frame], free)
        if np.abs(closure(tree, c[frame : frame + 1])).max() > CLOSED:
            return c
    share = np.ones(len(c))
    moving = np.flatnonzero(np.abs(closure(tree, c)).max(axis=1) <= CLOSED)
    for _ in range(STEPS):
        now = c[moving]
        back = targets[moving][:, free] - now[:, free]
        G = closure_jacobian(tree, now)[:, :, free]
        along = back - np.einsum("fjr,frk,fk->fj", _pseudo_inverse(G), G, back)
        trial = now.copy()
        trial[:, free] += share[moving, None] * along
        trial = _shut(tree, trial, free)
        left = (targets[moving][:, free] - trial[:, free]) ** 2
        nearer = (left.sum(axis=1) < (back**2).sum(axis=1)) & (
            np.abs(closure(tree, trial)).max(axis=1) <= CLOSED
        )
        c[moving[nearer]] = trial[nearer]
        share[moving] = np.where(nearer, np.minimum(1.0, 2.0 * share[moving]), 0.25 * share[moving])
        moving = moving[share[moving] * np.abs(along).max(axis=1, initial=0.0) > NEAREST]
        if not len(moving):
            break
    return c


def _elsewhere(tree: Tree, target: Array, free: Ints) -> Array:
    """The nearest of the closed poses that the default and random poses lead to, where the given
    one leads to none.
    """
    starts = np.tile(target, (ELSEWHERE + 1, 1))
    starts[:, free] = tree.defaults[free]
    shares = np.random.default_rng(0).random((ELSEWHERE, len(free)))
    for i, j in enumerate(free):
        coordinate = tree.model.coordinates[j]
        reach = np.pi if coordinate.motion == "rotational" else 0.5
        low = max(coordinate.range[0], coordinate.default - reach)
        high = min(coordinate.range[1], coordinate.default + reach)
        starts[1:, j] = low + (high - low) * shares[:, i]
    shut = _shut(tree, starts, free)
    far = ((shut - target)[:, free] ** 2).sum(axis=1)
    return shut[
        int(np.argmin(np.where(np.abs(closure(tree, shut)).max(axis=1) <= CLOSED, far, np.inf)))
    ]


def _shut(tree: Tree, start: Array, free: Ints) -> Array:
    """Newton steps of least norm on the closure, each as long as it lowers it, until loops close or
    none does.
    """
    c = start.copy()
    moving = np.arange(len(c))
    for _ in range(STEPS):
        couple_frames(tree.arrays, c)
        error, G = _closures(tree, c[moving])
        size = np.abs(error).max(axis=1)
        open_ = size > 1e-3 * CLOSED
        moving = moving[open_]
        error = error[open_]
        G = G[open_]
        size = size[open_]
        if not len(moving):
            break
        step = -np.einsum("fjr,fr->fj", _pseudo_inverse(G[:, :, free]), error)
        step /= np.maximum(1.0, np.abs(step).max(axis=1, initial=0.0))[:, None]
        better = np.zeros(len(moving), np.bool_)
        for share in (1.0, 0.3, 0.1, 0.01):
            trial = c[moving]
            trial[:, free] += share * step
            couple_frames(tree.arrays, trial)
            gained = ~better & (np.abs(closure(tree, trial)).max(axis=1) < size)
            c[moving[gained]] = trial[gained]
            better |= gained
            if better.all():
                break
        moving = moving[better]
        if not len(moving):
            break
    return c


def _pivots(tree: Tree, G: Array, free: Ints) -> Ints:
    """Columns of (frames, rows, free) that span its range in every frame, best conditioned first."""
    left = G.copy()
    favour = np.array([0.5 if tree.model.coordinates[j].clamped else 1.0 for j in free])
    size = np.sqrt((G**2).sum(axis=(1, 2))).max(initial=0.0)
    chosen: list[int] = []
    while len(chosen) < min(G.shape[1:]):
        norms = np.sqrt((left**2).sum(axis=1))
        usual = np.median(norms, axis=0)
        if not usual.max(initial=0.0) > RANK * size:
            break
        column = int(np.argmax(favour * (norms.min(axis=0) + 1e-3 * usual)))
        unit = left[:, :, column] / np.maximum(norms[:, column], 1e-300)[:, None]
        for _ in range(2):
            left -= unit[:, :, None] * np.einsum("fr,frj->fj", unit, left)[:, None]
        left[:, :, column] = 0.0
        chosen.append(column)
    return np.array(sorted(chosen), np.int64)


def _movers(tree: Tree) -> list[str]:
    """Names of the free coordinates that move a loop's closure at the default pose."""
    defaults = tree.defaults[None].copy()
    couple_frames(tree.arrays, defaults)
    moved = np.abs(closure_jacobian(tree, defaults)[0]).max(axis=0)
    return [tree.model.coordinate_names[j] for j in free_coordinates(tree) if moved[j] > RANK]


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
            f"the motion holds {loop.kind} '{loop.name}' open by up to {worst:.3g} m or rad: at"
            f" most {OPEN:g} are closed by projection; does the motion belong to this model?"
            " Inverse kinematics gives one that does"
        )
    return worst


def closed_motion(model: Model, motion: Motion) -> tuple[Motion, tuple[str, ...]]:
    """The motion nearest to the one given that keeps every loop closed, and what it took.
    Coordinates, velocities and accelerations move as little as possible in the plain norm over
    [rad] and [m]; locked and prescribed ones stay. A model without loops gets its motion back.
    `motion`: with or without velocities and accelerations; what it lacks rests at the model's
    default. Returns `motion`: of all the model's coordinates where there are loops; `notes`: one
    line where loops stood open by more than `TOLD`.
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
    """Generalized forces of the coordinates that follow no other, couplers' and loops' share handed
    on.
    """

    # (frames, independent coordinates) tau_ind + (d dependent / d independent)^T tau_dep [N m or N]
    torques: Series
    dependent: tuple[str, ...]  # names of the coordinates that a loop makes follow
    margin: Array  # (frames,) how well the choice of those is conditioned, see `LoopBasis`


def loop_torques(model: Model, motion: Motion, torques: Series) -> LoopTorques:
    """What has to act at the independent coordinates to make the model move, loops closed.

    A closed loop carries forces of its own, so the torque of one of its coordinates alone means
    nothing: any tau + G^T lambda moves the model alike (G derivative of the closure). Folding
    through the null space of G,

        tau_ind + slopes^T tau_dep,   qdot_dep = slopes qdot_ind,

    leaves what does not depend on lambda. Forces that hold locked and prescribed coordinates stay
    as they are.

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
    """(frames, dependents, coordinates) derivatives of what loops make follow, 0 columns where
    nothing leads.
    """
    count = 0 if basis is None else len(basis.dependent)
    slopes = np.zeros((len(coordinates), count, coordinates.shape[1]))
    if basis is not None:
        slopes[:, :, basis.independent] = basis.slopes
    return slopes
