"""The base-link regressor: what external wrench a motion needs, linear in the inertial parameters."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion, Wrenches
from myomorph.core.rigid.dynamics import external_arrays, motion_arrays
from myomorph.core.rigid.frames import run_frames
from myomorph.core.rigid.kernels import in_place, kernel
from myomorph.core.rigid.kinematics import body_poses, body_rates, pose_room
from myomorph.core.rigid.tree import compile_tree
from myomorph.core.rigid.vectors import (
    cross,
    matrix,
    minus,
    plus,
    put_vector,
    turned,
    turned_back,
    vector,
)

WRENCH = ("M_x", "M_y", "M_z", "F_x", "F_y", "F_z")
"""The rows of a base wrench: moment about the reference point [N m] and force [N], ground axes."""
BLOCK = 512  # Frames a block of `regressor_blocks`: 512 frames of 80 bodies are 20 MB


class RegressorBlock(NamedTuple):
    """The regressor in some frames."""

    frames: slice  # which
    rows: Array  # (frames, 6, 10 bodies) moment and force of unit parameters
    reference: Array  # (frames, 3) the point that moments are about, in ground [m]


def base_regressor(model: Model, motion: Motion, reference: ArrayLike | None = None) -> Array:
    """(frames, 6, 10 bodies) the six base rows Y of the equation of motion, [D] eq. 3.1.
    Y @ inertial_parameters(model).ravel() is the total external wrench that the motion needs,
    gravity taken off: moment about the reference point [N m], then force [N], in ground axes.
    `motion`: with velocities and accelerations; coordinates it lacks rest at their default;
    `reference` (3,) a point fixed in ground, e.g. of a force plate [m]; None for the origin of the
    first body, the base, in each frame.
    """
    rows = np.empty((len(motion), 6, 10 * len(model.bodies)))
    for block in regressor_blocks(model, motion, reference):
        rows[block.frames] = block.rows
    return rows


def regressor_blocks(
    model: Model, motion: Motion, reference: ArrayLike | None = None, frames: int = BLOCK
) -> Iterator[RegressorBlock]:
    """`base_regressor` block by block, which bounds memory: every block uses the arrays of the one
    before again.
    """
    tree = compile_tree(model)
    fixed = _fixed_point(reference)
    size = min(frames, len(motion))
    rows = np.empty((size, 6, 10 * len(model.bodies)))
    points = np.empty((size, 3))
    for start in range(0, len(motion), frames):
        span = slice(start, min(start + frames, len(motion)))
        length = span.stop - span.start
        if fixed is not None:
            points[:] = fixed
        c, cdot, cddot = motion_arrays(tree, motion.frames(span))
        run_frames(
            _base_regressor,
            (tree.arrays, fixed is None),
            c,
            cdot,
            cddot,
            points[:length],
            rows[:length],
        )
        yield RegressorBlock(span, rows[:length], points[:length])


def base_wrench(
    model: Model, motion: Motion, wrenches: Wrenches | None, reference: ArrayLike | None = None
) -> Array:
    """(frames, 6) the external wrench that was measured, in the rows of `base_regressor`.
    NaN in frames where a force is missing. A wrench on the ground does not count.
    `motion`, `reference`: as in `base_regressor`; the reference point moves with the motion's base;
    `wrenches`: at the motion's times; None for no external force.
    """
    return sum_of_wrenches(model, motion, wrenches, reference_points(model, motion, reference))


def sum_of_wrenches(
    model: Model, motion: Motion, wrenches: Wrenches | None, points: Array
) -> Array:
    """(frames, 6) moment about points (frames, 3) and force of all wrenches that act on the model."""
    bodies, forces, places, torques = external_arrays(compile_tree(model), motion, wrenches)
    counted = bodies != 0
    forces = forces[:, counted]
    places = places[:, counted]
    torques = torques[:, counted]
    moments = torques + np.cross(places - points[:, None], forces)
    return np.concatenate([moments.sum(axis=1), forces.sum(axis=1)], axis=1)


def reference_points(model: Model, motion: Motion, reference: ArrayLike | None = None) -> Array:
    """(frames, 3) the point that moments are about: the base body's origin, or one fixed in ground
    [m].
    """
    fixed = _fixed_point(reference)
    if fixed is not None:
        return np.tile(fixed, (len(motion), 1))
    tree = compile_tree(model)
    c = tree.coordinates_of(motion)
    points = np.empty((len(c), 3))
    run_frames(_base_origins, (tree.arrays,), c, points)
    return points


def _fixed_point(reference: ArrayLike | None) -> Array | None:
    if reference is None:
        return None
    point = np.asarray(reference, dtype=np.float64)
    if point.shape != (3,) or not np.isfinite(point).all():
        raise BadData(
            f"expected a reference point (3,) in ground, but got {np.asarray(reference).tolist()}"
        )
    return point


@kernel
def _base_origins(T, c, points):
    R, p, w, o, dphi = pose_room(T)
    for frame in range(c.shape[0]):
        body_poses(T, c[frame], R, p, w, o, dphi)
        put_vector(points, frame, vector(p, 1))


@kernel
def _base_regressor(T, moving, c, cdot, cddot, points, rows):
    R, p, w, o, dphi = pose_room(T)
    omega = np.empty_like(p)
    v = np.empty_like(p)
    alpha = np.empty_like(p)
    a = np.empty_like(p)
    gravity = (T.gravity[0], T.gravity[1], T.gravity[2])
    for frame in range(c.shape[0]):
        body_poses(T, c[frame], R, p, w, o, dphi)
        body_rates(T, c[frame], cdot[frame], cddot[frame], p, w, o, omega, v, alpha, a)
        if moving:
            put_vector(points, frame, vector(p, 1))
        about = vector(points, frame)
        for b in range(1, T.parent.shape[0]):
            r = matrix(R, b)
            lift = turned_back(r, minus(vector(a, b), gravity))
            W = turned_back(r, vector(omega, b))
            E = turned_back(r, vector(alpha, b))
            body_columns(r, minus(vector(p, b), about), lift, W, E, rows[frame], 10 * (b - 1))


@in_place
def body_columns(r, arm, lift, W, E, rows, first):
    """Ten columns of one body: rows (6, columns) of moment about a point and force, in ground.
    In the body's frame, with h = m c, acceleration of the origin less gravity `lift`, angular rates
    W, E: force = m lift + E x h + W x (W x h),  moment about the origin = h x lift + I E + W x (I
    W). `arm` leads from the point to the origin, in ground; r turns the body's frame into ground.
    """
    zero = (0.0, 0.0, 0.0)
    for parameter in range(10):
        force = zero
        moment = zero
        if parameter == 0:
            force = lift
        elif parameter < 4:
            e = (
                1.0 if parameter == 1 else 0.0,
                1.0 if parameter == 2 else 0.0,
                1.0 if parameter == 3 else 0.0,
            )
            force = plus(cross(E, e), cross(W, cross(W, e)))
            moment = cross(e, lift)
        else:
            moment = plus(_inertia_column(parameter, E), cross(W, _inertia_column(parameter, W)))
        force = turned(r, force)
        moment = turned(r, moment)
        if parameter < 4:
            moment = plus(moment, cross(arm, force))
        for i in range(3):
            rows[i, first + parameter] = moment[i]
            rows[3 + i, first + parameter] = force[i]


@kernel(inline="always")
def _inertia_column(parameter, x):
    """I x where parameter k of the inertia is 1 and all others are 0."""
    if parameter == 4:
        return x[0], 0.0, 0.0
    if parameter == 5:
        return 0.0, x[1], 0.0
    if parameter == 6:
        return 0.0, 0.0, x[2]
    if parameter == 7:
        return 0.0, x[2], x[1]
    if parameter == 8:
        return x[2], 0.0, x[0]
    return x[1], x[0], 0.0
