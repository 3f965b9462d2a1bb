"""The base-link regressor: the wrench that a motion needs, linear in inertial parameters."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion, Wrenches
from myomorph.core.model.shapes import FrameVectors, Regressor, Wrenches6
from myomorph.core.rigid.coordinates import State
from myomorph.core.rigid.dynamics import external_arrays, motion_arrays
from myomorph.core.rigid.frames import run_frames
from myomorph.core.rigid.kernels import in_place, kernel
from myomorph.core.rigid.kinematics import body_poses, body_rates, pose_room, rate_room
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
BLOCK = 512  # Frames of a block of `regressor_blocks`: 512 frames of 80 bodies are 20 MB


class RegressorBlock(NamedTuple):
    """The regressor in some frames.

    Attributes
    ----------
    frames : of the motion
    rows : (frames, 6, 10 bodies) moment and force of unit parameters
    reference : (frames, 3) the point that moments are about, in ground [m]
    """

    frames: slice
    rows: Regressor
    reference: FrameVectors


def base_regressor(model: Model, motion: Motion, reference: ArrayLike | None = None) -> Regressor:
    """Six base rows Y of the equation of motion, linear in the inertial parameters phi.

        Y(q, qdot, qddot) phi = total external wrench that the motion needs, gravity taken off

    with phi = `inertial_parameters(model).ravel()`, ten of each body.

    Source: [D] eq. 3.1.

    Parameters
    ----------
    model : whose bodies move
    motion : with velocities and accelerations; coordinates it lacks rest at their default
    reference : (3,) a point fixed in ground that moments are about, e.g. of a force plate [m]; None
        for the origin of the first body, the base, in each frame

    Returns
    -------
    (frames, 6, 10 bodies) moment [N m], then force [N], in ground axes, of unit parameters
    """
    rows = np.empty((len(motion), 6, 10 * len(model.bodies)))
    for block in regressor_blocks(model, motion, reference):
        rows[block.frames] = block.rows
    return rows


def regressor_blocks(
    model: Model, motion: Motion, reference: ArrayLike | None = None, frames: int = BLOCK
) -> Iterator[RegressorBlock]:
    """`base_regressor` block by block, which bounds memory.

    Parameters
    ----------
    model, motion, reference : as of `base_regressor`
    frames : of a block

    Yields
    ------
    blocks, each of which uses the arrays of the one before again
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
        arrays = (*motion_arrays(tree, motion.frames(span)), points[:length], rows[:length])
        run_frames(_base_regressor, (tree.arrays, fixed is None), *arrays)
        yield RegressorBlock(frames=span, rows=rows[:length], reference=points[:length])


def base_wrench(
    model: Model, motion: Motion, wrenches: Wrenches | None, reference: ArrayLike | None = None
) -> Wrenches6:
    """External wrench that was measured, in the rows of `base_regressor`.

    A wrench on the ground does not count.

    Parameters
    ----------
    model, motion, reference : as of `base_regressor`
    wrenches : at the motion's times; None for no external force

    Returns
    -------
    (frames, 6) moment [N m], then force [N]; NaN in frames where a force is missing
    """
    return sum_of_wrenches(model, motion, wrenches, reference_points(model, motion, reference))


def sum_of_wrenches(
    model: Model, motion: Motion, wrenches: Wrenches | None, points: FrameVectors
) -> Wrenches6:
    """Sum of all wrenches that act on the model.

    Parameters
    ----------
    model, motion : as of `base_regressor`
    wrenches : at the motion's times; None for no external force
    points : (frames, 3) that moments are about, in ground [m]

    Returns
    -------
    (frames, 6) moment [N m], then force [N], in ground
    """
    external = external_arrays(compile_tree(model), motion, wrenches)
    on_model = external.bodies != 0
    forces = external.forces[:, on_model]
    levers = external.points[:, on_model] - points[:, None]
    moments = external.torques[:, on_model] + np.cross(levers, forces)
    return np.concatenate([moments.sum(axis=1), forces.sum(axis=1)], axis=1)


def reference_points(
    model: Model, motion: Motion, reference: ArrayLike | None = None
) -> FrameVectors:
    """Points that moments are about: the base body's origin, or one fixed in ground.

    Parameters
    ----------
    model, motion, reference : as of `base_regressor`

    Returns
    -------
    (frames, 3) in ground [m]
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
    """Check a reference point (3,) in ground [m]; None stays None."""
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
    """Fill points (frames, 3) with the origin of the first body, from c (frames, coordinates)."""
    pose = pose_room(T)
    for frame in range(c.shape[0]):
        body_poses(T, c[frame], pose)
        put_vector(points, frame, vector(pose.p, 1))


@kernel
def _base_regressor(T, moving, c, cdot, cddot, points, rows):
    """Fill the base regressor of frames.

    Parameters
    ----------
    T : `TreeArrays`
    moving : whether the reference is the base body's origin, which then fills `points`
    c, cdot, cddot : (frames, coordinates) consistent
    points : (frames, 3) in ground [m]
    rows : (frames, 6, 10 bodies) filled
    """
    pose = pose_room(T)
    rates = rate_room(T)
    gravity = (T.gravity[0], T.gravity[1], T.gravity[2])
    for frame in range(c.shape[0]):
        body_poses(T, c[frame], pose)
        body_rates(T, State(c=c[frame], cdot=cdot[frame], cddot=cddot[frame]), pose, rates)
        if moving:
            put_vector(points, frame, vector(pose.p, 1))
        about = vector(points, frame)
        for b in range(1, T.parent.shape[0]):
            r = matrix(pose.R, b)
            arm = minus(vector(pose.p, b), about)
            lift = turned_back(r, minus(vector(rates.a, b), gravity))
            W = turned_back(r, vector(rates.omega, b))
            E = turned_back(r, vector(rates.alpha, b))
            _put_body_columns(r, arm, lift, W, E, rows[frame], 10 * (b - 1))


@in_place
def _put_body_columns(r, arm, lift, W, E, rows, first):
    """Store ten columns of one body: moment about a point and force, of unit parameters.

    In the body's frame, with mass m, first moment h = m c, inertia I about the origin, angular
    velocity W and acceleration E, and the acceleration a of the origin less gravity,

        force = m a + E x h + W x (W x h)
        moment about the origin = h x a + I E + W x (I W)

    Parameters
    ----------
    r : rotation from the body's axes to ground
    arm : from the reference point to the body's origin, in ground [m]
    lift : a in the body's axes [m/s^2]
    W, E : in the body's axes [rad/s, rad/s^2]
    rows : (6, columns) filled: moment, then force, in ground
    first : column of `rows` from which on they are filled
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
    """Product I x, where one parameter of the inertia is 1 and all others are 0.

    In the order of [D]: 4 to 9 are I_xx, I_yy, I_zz, I_yz, I_zx, I_xy.
    """
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
