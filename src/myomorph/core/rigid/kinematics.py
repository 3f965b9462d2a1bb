"""Poses, velocities, accelerations and Jacobians of bodies over frames, and where markers are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.model import Marker, Model
from myomorph.core.model.series import Markers, Motion
from myomorph.core.model.spatial import Transform
from myomorph.core.rigid.coordinates import Ints, evaluate_at, function_rates
from myomorph.core.rigid.frames import run_frames
from myomorph.core.rigid.kernels import bare, inner, kernel
from myomorph.core.rigid.tree import ROTATION, Tree, compile_tree
from myomorph.core.rigid.vectors import (
    about,
    along,
    cross,
    matrix,
    minus,
    plus,
    product,
    put_matrix,
    put_vector,
    turned,
    vector,
)


@inner
def pose_room(T):
    """Arrays R, p, w, o and dphi that `body_poses` fills, for one frame."""
    bodies = T.parent.shape[0]
    axes = T.axis_kind.shape[0]
    w = np.empty((axes, 3))
    o = np.empty((axes, 3))
    dphi = np.empty((axes, 2))
    return np.empty((bodies, 3, 3)), np.empty((bodies, 3)), w, o, dphi


@bare
def body_poses(T, c, R, p, w, o, dphi):
    """Poses of all bodies and the moving axes in ground, for one frame.
    `c` (coordinates,) all coordinates, dependent ones consistent; `R`, `p` (bodies, 3, 3), (bodies,
    3) filled with poses in ground; `w`, `o` (axes, 3) filled with each axis's direction and a point
    on it, in ground; `dphi` (axes, 2) filled with the derivative of the axis's motion in its two
    coordinates.
    """
    put_matrix(R, 0, (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0))
    put_vector(p, 0, (0.0, 0.0, 0.0))
    for b in range(1, T.parent.shape[0]):
        r = matrix(R, T.parent[b])
        x = vector(p, T.parent[b])
        for axis in range(T.axis_start[b], T.axis_start[b + 1]):
            x = plus(x, turned(r, vector(T.pre_p, axis)))
            if not T.pre_is_shift[axis]:
                r = product(r, matrix(T.pre_R, axis))
            i = T.axis_coordinate[axis, 0]
            j = T.axis_coordinate[axis, 1]
            q, d1, d2, _, _, _ = evaluate_at(T.functions, T.axis_function[axis], i, j, c)
            dphi[axis, 0] = d1
            dphi[axis, 1] = d2
            u = vector(T.axis_vector, axis)
            direction = turned(r, u)
            put_vector(w, axis, direction)
            put_vector(o, axis, x)
            if T.axis_kind[axis] == ROTATION:
                r = product(r, about(u, q))
            else:
                x = along(x, q, direction)
        put_vector(p, b, plus(x, turned(r, vector(T.post_p, b))))
        put_matrix(R, b, product(r, matrix(T.post_R, b)))


@bare
def body_rates(T, c, cdot, cddot, p, w, o, omega, v, alpha, a):
    """Angular and linear velocity and acceleration of all body frames in ground, for one frame.
    Gravity is not included. `p`, `w`, `o` come from `body_poses`; omega, v, alpha, a (bodies, 3)
    are filled: [rad/s], [m/s] of the body's origin, [rad/s^2], [m/s^2].
    """
    zero = (0.0, 0.0, 0.0)
    for rates in (omega, v, alpha, a):
        put_vector(rates, 0, zero)
    for b in range(1, T.parent.shape[0]):
        h = T.parent[b]
        # Angular rates W, E of the moving frame, and rates V, B of its point that coincides with x.
        x = vector(p, h)
        W = vector(omega, h)
        E = vector(alpha, h)
        V = vector(v, h)
        B = vector(a, h)
        for index in range(T.axis_start[b], T.axis_start[b + 1]):
            V, B = carried(W, E, V, B, minus(vector(o, index), x))
            x = vector(o, index)
            i = T.axis_coordinate[index, 0]
            j = T.axis_coordinate[index, 1]
            # Of the axis's motion: Phi cdot and Phi cddot + Phidot cdot.
            q1, q2 = function_rates(T.functions, T.axis_function[index], i, j, c, cdot, cddot)
            u = vector(w, index)
            turning = cross(W, u)
            if T.axis_kind[index] == ROTATION:
                E = along(along(E, q2, u), q1, turning)
                W = along(W, q1, u)
            else:
                # The moved frame's velocity field is the old one plus u qdot everywhere, so the
                # point at which both are compared need not move along.
                B = along(along(B, q2, u), 2.0 * q1, turning)
                V = along(V, q1, u)
        V, B = carried(W, E, V, B, minus(vector(p, b), x))
        put_vector(omega, b, W)
        put_vector(alpha, b, E)
        put_vector(v, b, V)
        put_vector(a, b, B)


@bare
def carried(W, E, V, B, r):
    """Velocity and acceleration of the point r further on in a frame with angular rates W, E."""
    turning = cross(W, r)
    return plus(V, turning), plus(B, plus(cross(E, r), cross(W, turning)))


@dataclass(frozen=True, eq=False)
class Poses:
    """Poses of all bodies in ground; body 0 is the ground."""

    tree: Tree
    rotations: Array  # (frames, bodies, 3, 3)
    origins: Array  # (frames, bodies, 3) [m]
    # axis_directions, axis_points: (frames, axes, 3) of the tree's moving axes
    axis_directions: Array
    axis_points: Array
    axis_slopes: Array  # (frames, axes, 2) d(axis motion)/d(its coordinates)

    def points(self, bodies: Ints, locations: Array) -> Array:
        """Points fixed to bodies, in ground.
        `bodies` (points,) body numbers; `locations` (points, 3) in the bodies' frames [m]. Returns
        (frames, points, 3) [m].
        """
        return (
            np.einsum("fpij,pj->fpi", self.rotations[:, bodies], locations)
            + self.origins[:, bodies]
        )

    def markers(self, markers: Sequence[Marker]) -> Array:
        """Places of markers in ground, (frames, markers, 3) [m]."""
        bodies = np.array([self.tree.body_number(marker.body) for marker in markers], np.int64)
        return self.points(bodies, np.array([marker.location for marker in markers]).reshape(-1, 3))

    def transforms(self, frame: int = 0) -> dict[str, Transform]:
        """Pose in ground of the ground and of every body, by name, in a frame."""
        rotations = self.rotations[frame]
        origins = self.origins[frame]
        return {
            body: Transform(rotations[number], origins[number])
            for body, number in self.tree.body_index.items()
        }

    def jacobian(self, body: int, points: Array) -> Array:
        """d(twist)/d(coordinates) of a body, (frames, 6, coordinates): angular, then linear at
        points. All rows are in ground; `points` (frames, 3) or (3,) in ground [m]. Dependent
        coordinates keep columns of their own.
        """
        arrays = self.tree.arrays
        columns = np.zeros((len(self.origins), 6, len(self.tree.model.coordinates)))
        for support in np.flatnonzero(self.tree.supports[body]):
            w = self.axis_directions[:, support]
            if arrays.axis_kind[support] == ROTATION:
                twist = np.concatenate(
                    [w, np.cross(w, points - self.axis_points[:, support])], axis=1
                )
            else:
                twist = np.concatenate([np.zeros_like(w), w], axis=1)
            for s, j in enumerate(arrays.axis_coordinate[support]):
                if j >= 0:
                    columns[:, :, j] += self.axis_slopes[:, support, s, None] * twist
        return columns


def forward_kinematics(tree: Tree, coordinates: Array) -> Poses:
    """Poses of all bodies.
    `coordinates` (frames, coordinates) in the model's order [rad or m], dependent ones consistent
    (`Tree.coordinates_of` makes them so).
    """
    # A copy, because a kernel is compiled anew for an array that is read-only.
    coordinates = np.array(coordinates, dtype=np.float64, order="C")
    arrays = tree.arrays
    frames = len(coordinates)
    bodies = len(arrays.parent)
    axes = len(arrays.axis_kind)
    R = np.empty((frames, bodies, 3, 3))
    p = np.empty((frames, bodies, 3))
    w = np.empty((frames, axes, 3))
    o = np.empty((frames, axes, 3))
    dphi = np.empty((frames, axes, 2))
    run_frames(_poses, (arrays,), coordinates, R, p, w, o, dphi)
    return Poses(
        tree=tree, rotations=R, origins=p, axis_directions=w, axis_points=o, axis_slopes=dphi
    )


def standing_poses(model: Model, values: Mapping[str, float] | None = None) -> dict[str, Transform]:
    """Pose in ground of the ground and of every body at given coordinates [rad or m], the others at
    their defaults.
    """
    values = values or {}
    for name in values:
        model.coordinate(name)
    posture = Motion(
        np.zeros(1),
        tuple(values),
        np.array([list(values.values())], dtype=np.float64).reshape(1, -1),
    )
    tree = compile_tree(model)
    return forward_kinematics(tree, tree.coordinates_of(posture)).transforms()


@kernel
def _poses(T, c, R, p, w, o, dphi):
    for frame in range(c.shape[0]):
        body_poses(T, c[frame], R[frame], p[frame], w[frame], o[frame], dphi[frame])


def center_of_mass(tree: Tree, poses: Poses) -> Array:
    """Center of mass of the whole model in ground, (frames, 3) [m]."""
    arrays = tree.arrays
    centers = poses.points(np.arange(len(arrays.mass)), arrays.mass_center)
    return np.einsum("b,fbi->fi", arrays.mass, centers) / arrays.mass.sum()


def marker_positions(model: Model, motion: Motion) -> Markers:
    """Positions of a model's markers in a motion, as a camera system without errors would record
    them.

    Source: Featherstone 2008, forward kinematics.

    Parameters
    ----------
    model : with markers
    motion : coordinates over time; what it lacks stands at the model's default

    Returns
    -------
    positions (frames, markers, 3) in ground [m], at the motion's times

    Raises
    ------
    UnknownName : where the motion has a coordinate that the model does not have

    Examples
    --------
    >>> import myomorph as mm
    >>> model = mm.read_model("arm.osim")
    >>> markers = mm.marker_positions(model, mm.read_motion("reach.mot", model))
    >>> markers.names, markers.values.shape
    (('UA1', 'UA2', 'FA1', 'FA2'), (61, 4, 3))
    """
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.coordinates_of(motion))
    return Markers(motion.time, model.marker_names, poses.markers(model.markers))


@read_only
class BodyMotion:
    """How bodies move; body 0 is the ground, and every vector is in ground."""

    rotations: Array  # (frames, bodies, 3, 3) poses [m]
    origins: Array  # (frames, bodies, 3) poses [m]
    angular_velocities: Array  # (frames, bodies, 3) [rad/s]
    angular_accelerations: Array  # (frames, bodies, 3) [rad/s^2]
    velocities: Array  # (frames, bodies, 3) of the bodies' origins, gravity not included [m/s]
    accelerations: Array  # (frames, bodies, 3) of the bodies' origins, gravity not included [m/s^2]

    def of_points(self, bodies: Ints, places: Array) -> tuple[Array, Array, Array]:
        """Place, velocity and acceleration (frames, points, 3) of points fixed to bodies.

            v = v_0 + w x r,   a = a_0 + e x r + w x (w x r)

        `bodies` (points,) body numbers; `places` (points, 3) in the bodies' frames [m].
        """
        r = np.einsum("fpij,pj->fpi", self.rotations[:, bodies], places)
        turning = np.cross(self.angular_velocities[:, bodies], r)
        accelerations = np.cross(self.angular_accelerations[:, bodies], r)
        accelerations += np.cross(self.angular_velocities[:, bodies], turning)
        return (
            self.origins[:, bodies] + r,
            self.velocities[:, bodies] + turning,
            self.accelerations[:, bodies] + accelerations,
        )


def body_motion(tree: Tree, c: Array, cdot: Array, cddot: Array) -> BodyMotion:
    """Poses, velocities and accelerations of all bodies."""
    frames = len(c)
    bodies = len(tree.arrays.parent)
    arrays = [np.array(values, dtype=np.float64, order="C") for values in (c, cdot, cddot)]
    R = np.empty((frames, bodies, 3, 3))
    p, omega, v, alpha, a = (np.empty((frames, bodies, 3)) for _ in range(5))
    run_frames(_body_motion, (tree.arrays,), *arrays, R, p, omega, v, alpha, a)
    return BodyMotion(
        rotations=R,
        origins=p,
        angular_velocities=omega,
        angular_accelerations=alpha,
        velocities=v,
        accelerations=a,
    )


@kernel
def _body_motion(T, c, cdot, cddot, R, p, omega, v, alpha, a):
    _, _, w, o, dphi = pose_room(T)
    for frame in range(c.shape[0]):
        body_poses(T, c[frame], R[frame], p[frame], w, o, dphi)
        body_rates(
            T,
            c[frame],
            cdot[frame],
            cddot[frame],
            p[frame],
            w,
            o,
            omega[frame],
            v[frame],
            alpha[frame],
            a[frame],
        )
