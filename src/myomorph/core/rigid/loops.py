"""Closed kinematic loops: closure errors, coordinates and rates that keep loops closed.

Beside them, which coordinates become dependent where loops stay closed, and what that does to
generalized forces.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.causes import LOOPS
from myomorph.core.model.errors import BadData
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Loop, Model
from myomorph.core.model.series import Motion, Series
from myomorph.core.model.shapes import Coordinates, LoopJacobian, LoopRows
from myomorph.core.rigid.coordinates import (
    Ints,
    couple_frames,
    couple_rates_frames,
    gather_dependents,
)
from myomorph.core.rigid.dynamics import motion_arrays
from myomorph.core.rigid.frames import run_frames
from myomorph.core.rigid.loop_kernels import loop_frames, loop_rate_frames
from myomorph.core.rigid.tree import Flags, Rates, Tree, compile_tree

CLOSED = 1e-10  # Largest error of a closed loop [m or rad]
MIN_ERROR = 1e-3 * CLOSED  # Error that Newton steps lower no further [m or rad]
# Least singular value of a direction of a Jacobian that counts, relative to the largest
RANK = 1e-8
MIN_STEP = 1e-9  # Last step of a projection that has converged [rad or m]
MAX_STEPS = 200  # Of a projection, and of closing a loop
MAX_ROTATION_STEP = 1.0  # Of a Newton step [rad or m]
SHORTENED = (1.0, 0.3, 0.1, 0.01)  # Shares of a Newton step that are tried
RANDOM_POSES = 30  # From which a loop is closed that does not close from where it is
MAX_RANDOM_TRANSLATION = 0.5  # Of a random pose from the default [m]
FRAMES_AT_ONCE = 256
MAX_RATE_ERROR = 1e-9  # Of rates that keep loops closed, relative
CLAMPED_PREFERENCE = 0.5  # How readily a clamped coordinate becomes dependent, others 1
MAX_OPENING = 0.01  # Of a motion's loops; beyond, the motion is another model's [m or rad]
REPORTED_OPENING = 1e-4  # A motion whose loops are open by less is closed silently [m or rad]


class Closure(NamedTuple):
    """Closure of loops and its derivatives.

    Attributes
    ----------
    errors : (frames, rows) [m or rad], see `closure`
    jacobian : (frames, rows, coordinates)
    """

    errors: LoopRows
    jacobian: LoopJacobian


@dataclass(frozen=True, eq=False)
class LoopBasis:
    """Dependent coordinates where loops stay closed.

        qdot[dependent] = slopes @ qdot[independent]

    Attributes
    ----------
    independent, dependent : indices of coordinates, together all that were free
    slopes : (frames, dependent, independent)
    rank : number of dependent coordinates: of directions that loops take, over all frames
    margin : (frames,) smallest singular value of the dependent columns relative to the largest of
        all free columns; near 0 the choice is singular and the slopes are large
    """

    independent: Ints
    dependent: Ints
    slopes: Array
    rank: int
    margin: Array


@read_only
class LoopTorques:
    """Generalized forces of independent coordinates, the share of couplers and loops handed on.

    Attributes
    ----------
    torques : (frames, independent coordinates) tau_ind + (d dependent / d independent)^T tau_dep
        [N m or N]
    dependent : names of the coordinates that a loop makes dependent
    margin : (frames,) conditioning of their choice, see `LoopBasis`
    """

    torques: Series
    dependent: tuple[str, ...]
    margin: Array


def closure(tree: Tree, coordinates: Coordinates) -> LoopRows:
    """Closure errors of all loops.

    Of every loop the second tied frame is seen from the first. A point constraint has three rows,
    the second point [m]. A weld has before them three of rotation, 2 sin(angle / 2) axis [rad].
    What moves both bodies together changes nothing.

    Parameters
    ----------
    tree : the compiled model
    coordinates : (frames, coordinates) in the model's order, dependent ones consistent [rad or m]

    Returns
    -------
    (frames, rows) [m or rad]
    """
    return _closures(tree, coordinates).errors


def closure_jacobian(tree: Tree, coordinates: Coordinates) -> LoopJacobian:
    """Differentiate `closure` by the coordinates.

    Columns of independent coordinates include what reaches the loop through the coordinates that
    follow them. Columns of dependent ones hold their own share (`gather_dependents`).

    Parameters
    ----------
    tree, coordinates : as of `closure`

    Returns
    -------
    (frames, rows, coordinates)
    """
    return _closures(tree, coordinates).jacobian


def closure_rates(
    tree: Tree, coordinates: Coordinates, velocities: Coordinates, accelerations: Coordinates
) -> tuple[LoopRows, LoopRows]:
    """First and second time derivative of `closure`: G qdot and G qddot + Gdot qdot.

    Parameters
    ----------
    tree : the compiled model
    coordinates, velocities, accelerations : (frames, coordinates), dependent ones consistent

    Returns
    -------
    first, second : (frames, rows) each
    """
    c = _copy(coordinates)
    cdot = _copy(velocities)
    cddot = _copy(accelerations)
    first, second = np.empty((2, len(c), tree.loops.row[-1]))
    run_frames(loop_rate_frames, (tree.arrays, tree.loops), c, cdot, cddot, first, second)
    return first, second


def close_loops(tree: Tree, coordinates: Coordinates) -> Coordinates:
    """Find the nearest coordinates that close every loop, by gradient projection.

        min sum_j (c_j - target_j)^2 so that closure(c) = 0

    Locked and prescribed coordinates stay, coupled ones follow; ranges are not looked at.

    Parameters
    ----------
    tree : the compiled model
    coordinates : (frames, coordinates) targets [rad or m]; frames that hold NaN stay as they are

    Returns
    -------
    (frames, coordinates) [rad or m]

    Raises
    ------
    BadData : loops cannot be closed; the error names the frame and the loop
    """
    targets = _copy(coordinates)
    couple_frames(tree.arrays, targets)
    if not tree.model.loops:
        return targets
    free = free_coordinates(tree)
    closed = targets.copy()
    known = np.flatnonzero(np.isfinite(targets).all(axis=1))
    for start in range(0, len(known), FRAMES_AT_ONCE):
        frames = known[start : start + FRAMES_AT_ONCE]
        closed[frames] = _project(tree, targets[frames], free)
    errors = np.abs(closure(tree, closed[known]))
    if errors.size and errors.max() > CLOSED:
        worst, row = np.unravel_index(int(np.argmax(errors)), errors.shape)
        loop = _loop_of_row(tree, int(row))
        before = float(_largest_errors(tree, targets[known[worst]][None])[0])
        raise BadData(
            f"frame {known[worst]}: {loop.kind} '{loop.name}' cannot be closed,"
            f" {errors[worst, row]:.2g} are left of {before:.2g} m or rad; do the coordinates"
            f" belong to this model, and is enough of {', '.join(_movers(tree))} free to move?"
        )
    return closed


def project_rates(
    tree: Tree, coordinates: Coordinates, velocities: Coordinates, accelerations: Coordinates
) -> Rates:
    """Find the nearest velocities and accelerations with which closed loops stay closed.

        G qdot = 0,   G qddot + Gdot qdot = 0

    Locked and prescribed coordinates keep their rates, coupled ones follow.

    Parameters
    ----------
    tree : the compiled model
    coordinates : (frames, coordinates) closed, as of `close_loops` [rad or m]
    velocities, accelerations : (frames, coordinates) to be changed as little as possible

    Returns
    -------
    velocities and accelerations, (frames, coordinates) each

    Raises
    ------
    BadData : coordinates that keep their rates open a loop
    """
    c = _copy(coordinates)
    v = _copy(velocities)
    a = _copy(accelerations)
    couple_rates_frames(tree.arrays, c, v, a)
    known = np.isfinite(c + v + a).all(axis=1)
    if not tree.model.loops or not known.any():
        return Rates(velocities=v, accelerations=a)
    free = free_coordinates(tree)
    inverse = _pseudo_inverse(closure_jacobian(tree, c[known])[:, :, free])
    # Velocities before accelerations, whose errors depend on them.
    for order, rates in enumerate((v, a)):
        errors = closure_rates(tree, c[known], v[known], a[known])[order]
        rates[np.ix_(known, free)] -= np.einsum("fjr,fr->fj", inverse, errors)
        couple_rates_frames(tree.arrays, c, v, a)
        left = np.abs(closure_rates(tree, c[known], v[known], a[known])[order]).max()
        before = np.abs(errors).max()
        if left > MAX_RATE_ERROR * (1.0 + before + np.abs(rates[known]).max()):
            raise BadData(
                f"rates cannot keep the loops closed: {left:.2g} are left of"
                f" {before:.2g}; is enough of {', '.join(_movers(tree))} free to move?"
            )
    return Rates(velocities=v, accelerations=a)


def loop_basis(
    tree: Tree, coordinates: Coordinates, free: Sequence[int] | Ints | None = None
) -> LoopBasis:
    """Choose dependent coordinates of closed loops, the same in all frames, with their slopes.

    From G_dep qdot_dep + G_ind qdot_ind = 0 with the Jacobian G of `closure`,

        slopes = -G_dep^+ G_ind

    Parameters
    ----------
    tree : the compiled model
    coordinates : (frames, coordinates), closed; frames that hold NaN get slopes of NaN
    free : indices of the coordinates that may move, by default `free_coordinates`

    Returns
    -------
    the basis
    """
    free = free_coordinates(tree) if free is None else np.asarray(free, np.int64)
    known = np.isfinite(coordinates).all(axis=1)
    G = closure_jacobian(tree, coordinates[known])[:, :, free]
    chosen = _pivots(tree, G, free)
    rest = np.setdiff1d(np.arange(len(free)), chosen)
    slopes = np.full((len(coordinates), len(chosen), len(rest)), np.nan)
    margin = np.full(len(coordinates), np.nan)
    if len(chosen):
        slopes[known] = -_pseudo_inverse(G[:, :, chosen]) @ G[:, :, rest]
        largest = np.linalg.svd(G, compute_uv=False)[:, 0]
        smallest = np.linalg.svd(G[:, :, chosen], compute_uv=False)[:, -1]
        margin[known] = smallest / np.maximum(largest, 1e-300)
    return LoopBasis(
        independent=free[rest],
        dependent=free[chosen],
        slopes=slopes,
        rank=len(chosen),
        margin=margin,
    )


def free_coordinates(tree: Tree) -> Ints:
    """Find the coordinates that are neither coupled, locked nor prescribed.

    Parameters
    ----------
    tree : the compiled model

    Returns
    -------
    (free,) ascending indices
    """
    coordinates = tree.model.coordinates
    return np.array([j for j in tree.independent if coordinates[j].is_free], np.int64)


def refuse_open(tree: Tree, coordinates: Coordinates) -> float:
    """Check that no loop is open by more than `MAX_OPENING`.

    Parameters
    ----------
    tree : the compiled model
    coordinates : (frames, coordinates) consistent; frames that hold NaN do not count

    Returns
    -------
    closure error of the worst frame [m or rad], 0 of a model without loops

    Raises
    ------
    BadData : a loop is open, or no frame has all coordinates
    """
    if not tree.model.loops:
        return 0.0
    known = np.isfinite(coordinates).all(axis=1)
    if not known.any():
        raise BadData("no frame of the motion has all coordinates: closed loops need them")
    errors = np.abs(closure(tree, coordinates[known]))
    worst = float(errors.max(initial=0.0))
    if worst > MAX_OPENING:
        loop = _loop_of_row(tree, int(np.argmax(errors.max(axis=0))))
        raise BadData(
            f"the motion holds {loop.kind} '{loop.name}' open by up to {worst:.3g} m or rad: at"
            f" most {MAX_OPENING:g} are closed by projection; does the motion belong to this model?"
            " Inverse kinematics gives one that does"
        )
    return worst


def closed_motion(model: Model, motion: Motion) -> tuple[Motion, tuple[Message, ...]]:
    """Find the nearest motion that keeps every loop closed.

    Coordinates, velocities and accelerations move as little as possible in the plain norm over
    [rad] and [m]. Locked and prescribed ones stay. A model without loops gets its motion back.

    Parameters
    ----------
    model : with or without loops
    motion : with or without velocities and accelerations; what it lacks rests at the default

    Returns
    -------
    motion : of all the model's coordinates where there are loops
    notes : one line where loops were open by more than `REPORTED_OPENING`

    Raises
    ------
    BadData : loops are open by more than `MAX_OPENING`, or cannot be closed
    """
    if not model.loops:
        return motion, ()
    tree = compile_tree(model)
    values = tree.coordinates_of(motion)
    worst = refuse_open(tree, values)
    coordinates = close_loops(tree, values)
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
    if worst <= REPORTED_OPENING:
        return closed, ()
    moved = float(np.nanmax(np.abs(coordinates - values), initial=0.0))
    loop_names = ", ".join(f"'{loop.name}'" for loop in model.loops)
    note = f"loops ({loop_names}) stood open by up to {worst:.2g} m or rad"
    return closed, (LOOPS.message(f"{note}: coordinates moved by up to {moved:.2g} to close them"),)


def loop_torques(model: Model, motion: Motion, torques: Series) -> LoopTorques:
    """Find the generalized forces that move the independent coordinates, loops closed.

    A closed loop carries forces of its own, so the torque of one of its coordinates alone means
    nothing: any tau + G^T lambda moves the model alike (G derivative of the closure). Folding
    through the null space of G,

        tau_ind + slopes^T tau_dep,   qdot_dep = slopes qdot_ind,

    leaves what does not depend on lambda. Forces that hold locked and prescribed coordinates stay
    as they are.

    Parameters
    ----------
    model : with or without loops
    motion : with velocities and accelerations
    torques : of `inverse_dynamics`, a column for every coordinate

    Raises
    ------
    BadData : loops are open by more than `MAX_OPENING`
    """
    tree = compile_tree(model)
    c = motion_arrays(tree, motion).values
    refuse_open(tree, c)
    tau = np.array(torques.values)
    for frame in range(len(tau)):
        gather_dependents(tree.arrays, c[frame], tau[frame : frame + 1])
    basis = loop_basis(tree, c)
    tau[:, basis.independent] += np.einsum("fdi,fd->fi", basis.slopes, tau[:, basis.dependent])
    names = model.coordinate_names
    independent = [int(j) for j in tree.independent if j not in basis.dependent]
    return LoopTorques(
        torques=Series(torques.time, tuple(names[j] for j in independent), tau[:, independent]),
        dependent=tuple(names[j] for j in basis.dependent),
        margin=basis.margin,
    )


def loop_slopes(basis: LoopBasis | None, coordinates: Coordinates) -> Array:
    """Differentiate dependent coordinates of loops by all coordinates.

    Parameters
    ----------
    basis : None where there are no loops
    coordinates : (frames, coordinates)

    Returns
    -------
    (frames, dependent, coordinates), 0 in columns of coordinates that are not independent
    """
    count = 0 if basis is None else len(basis.dependent)
    slopes = np.zeros((len(coordinates), count, coordinates.shape[1]))
    if basis is not None:
        slopes[:, :, basis.independent] = basis.slopes
    return slopes


def _closures(tree: Tree, coordinates: Coordinates) -> Closure:
    """Closure errors of all loops and their derivatives in the coordinates."""
    c = _copy(coordinates)
    rows = int(tree.loops.row[-1])
    errors = np.empty((len(c), rows))
    jacobian = np.empty((len(c), rows, c.shape[1]))
    if rows:
        run_frames(loop_frames, (tree.arrays, tree.loops), c, errors, jacobian)
    return Closure(errors=errors, jacobian=jacobian)


def _largest_errors(tree: Tree, coordinates: Coordinates) -> Array:
    """(frames,) largest closure error of each frame [m or rad]."""
    return np.abs(closure(tree, coordinates)).max(axis=1)


def _loop_of_row(tree: Tree, row: int) -> Loop:
    """Find the loop that a row of `closure` belongs to."""
    return tree.model.loops[int(np.searchsorted(tree.loops.row, row, side="right")) - 1]


def _copy(array: Array) -> Array:
    """Copy an array, because a kernel is compiled anew for one that is read-only."""
    return np.array(array, dtype=np.float64, order="C")


def _pseudo_inverse(G: Array) -> Array:
    """Moore-Penrose inverses (frames, n, rows) of (frames, rows, n), up to `RANK`."""
    return np.asarray(np.linalg.pinv(G, rcond=RANK), np.float64)


def _project(tree: Tree, targets: Coordinates, free: Ints) -> Coordinates:
    """Find the nearest closed coordinates, by steps along the constraint.

    With d = target - c, a step goes along d - G^+ G d, and loops are closed again after it. A step
    that brings c no nearer is shortened.

    Parameters
    ----------
    targets : (frames, coordinates) without NaN
    free : (free,) indices of the coordinates that may move

    Returns
    -------
    (frames, coordinates); not all closed where a loop cannot be closed
    """
    c = _closed_from(tree, targets, free)
    for frame in np.flatnonzero(_largest_errors(tree, c) > CLOSED):
        c[frame] = _closed_from_elsewhere(tree, targets[frame], free)
        if _largest_errors(tree, c[frame : frame + 1])[0] > CLOSED:
            return c
    share = np.ones(len(c))
    moving = np.flatnonzero(_largest_errors(tree, c) <= CLOSED)
    for _ in range(MAX_STEPS):
        current = c[moving]
        to_target = targets[moving][:, free] - current[:, free]
        G = closure_jacobian(tree, current)[:, :, free]
        along = to_target - np.einsum("fjr,frk,fk->fj", _pseudo_inverse(G), G, to_target)
        trial = current.copy()
        trial[:, free] += share[moving, None] * along
        trial = _closed_from(tree, trial, free)

        distances = ((targets[moving][:, free] - trial[:, free]) ** 2).sum(axis=1)
        is_nearer = distances < (to_target**2).sum(axis=1)
        accepted = is_nearer & (_largest_errors(tree, trial) <= CLOSED)
        c[moving[accepted]] = trial[accepted]
        longer = np.minimum(1.0, 2.0 * share[moving])
        share[moving] = np.where(accepted, longer, 0.25 * share[moving])
        steps = share[moving] * np.abs(along).max(axis=1, initial=0.0)
        moving = moving[steps > MIN_STEP]
        if not len(moving):
            break
    return c


def _closed_from_elsewhere(tree: Tree, target: Array, free: Ints) -> Array:
    """Find the nearest closed pose that the default and random poses lead to.

    Parameters
    ----------
    target : (coordinates,) from which no closed pose was reached

    Returns
    -------
    (coordinates,)
    """
    starts = np.tile(target, (RANDOM_POSES + 1, 1))
    starts[:, free] = tree.defaults[free]
    shares = np.random.default_rng(0).random((RANDOM_POSES, len(free)))
    for column, j in enumerate(free):
        coordinate = tree.model.coordinates[j]
        reach = np.pi if coordinate.motion == "rotational" else MAX_RANDOM_TRANSLATION
        low = max(coordinate.range[0], coordinate.default - reach)
        high = min(coordinate.range[1], coordinate.default + reach)
        starts[1:, j] = low + (high - low) * shares[:, column]
    poses = _closed_from(tree, starts, free)
    distances = ((poses - target)[:, free] ** 2).sum(axis=1)
    distances = np.where(_largest_errors(tree, poses) <= CLOSED, distances, np.inf)
    return poses[int(np.argmin(distances))]


def _closed_from(tree: Tree, start: Coordinates, free: Ints) -> Coordinates:
    """Close loops from a pose, by Newton steps of least norm on the closure.

    A step is shortened until it lowers the error. A frame is left where it is once its loops close
    or no share of a step helps.

    Parameters
    ----------
    start : (frames, coordinates)
    free : (free,) indices of the coordinates that may move

    Returns
    -------
    (frames, coordinates)
    """
    c = start.copy()
    moving = np.arange(len(c))
    for _ in range(MAX_STEPS):
        couple_frames(tree.arrays, c)
        errors, G = _closures(tree, c[moving])
        largest = np.abs(errors).max(axis=1)
        is_open = largest > MIN_ERROR
        moving = moving[is_open]
        if not len(moving):
            break
        inverse = _pseudo_inverse(G[is_open][:, :, free])
        step = -np.einsum("fjr,fr->fj", inverse, errors[is_open])
        longest = np.abs(step).max(axis=1, initial=0.0)
        step /= np.maximum(MAX_ROTATION_STEP, longest)[:, None]
        moving = moving[_advance(tree, c, moving, step, free, largest[is_open])]
        if not len(moving):
            break
    return c


def _advance(
    tree: Tree, c: Coordinates, moving: Ints, step: Array, free: Ints, largest: Array
) -> Flags:
    """Take the longest share of a step that lowers the closure error, in place.

    Parameters
    ----------
    c : (frames, coordinates) changed in place
    moving : (moving,) frames that take a step
    step : (moving, free)
    largest : (moving,) largest errors before

    Returns
    -------
    (moving,) whether some share helped
    """
    improved = np.zeros(len(moving), np.bool_)
    for share in SHORTENED:
        trial = c[moving]
        trial[:, free] += share * step
        couple_frames(tree.arrays, trial)
        accepted = ~improved & (_largest_errors(tree, trial) < largest)
        c[moving[accepted]] = trial[accepted]
        improved |= accepted
        if improved.all():
            break
    return improved


def _pivots(tree: Tree, G: LoopJacobian, free: Ints) -> Ints:
    """Choose columns of a Jacobian that span its range in every frame, best conditioned first.

    QR with column pivoting over all frames at once: the next column is the one whose norm stays
    largest in the frame where it is smallest, after the columns before it are projected off. A
    clamped coordinate counts `CLAMPED_PREFERENCE`, so that it rather stays independent.

    Parameters
    ----------
    G : (frames, rows, free)
    free : (free,) indices of the coordinates

    Returns
    -------
    (chosen,) ascending columns
    """
    left = G.copy()
    clamped = np.array([tree.model.coordinates[j].clamped for j in free], np.bool_)
    preference = np.where(clamped, CLAMPED_PREFERENCE, 1.0)
    scale = np.sqrt((G**2).sum(axis=(1, 2))).max(initial=0.0)
    chosen: list[int] = []
    while len(chosen) < min(G.shape[1:]):
        norms = np.sqrt((left**2).sum(axis=1))
        medians = np.median(norms, axis=0)
        if not medians.max(initial=0.0) > RANK * scale:
            break
        column = int(np.argmax(preference * (norms.min(axis=0) + 1e-3 * medians)))
        unit = left[:, :, column] / np.maximum(norms[:, column], 1e-300)[:, None]
        # Twice, as one projection leaves rounding errors of the size of small columns.
        for _ in range(2):
            left -= unit[:, :, None] * np.einsum("fr,frj->fj", unit, left)[:, None]
        left[:, :, column] = 0.0
        chosen.append(column)
    return np.array(sorted(chosen), np.int64)


def _movers(tree: Tree) -> list[str]:
    """Names of the free coordinates that move a loop's closure at the default pose."""
    defaults = tree.defaults[None].copy()
    couple_frames(tree.arrays, defaults)
    largest = np.abs(closure_jacobian(tree, defaults)[0]).max(axis=0)
    return [tree.model.coordinate_names[j] for j in free_coordinates(tree) if largest[j] > RANK]
