"""Poses, velocities, accelerations and Jacobians of bodies over frames, and where markers are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from myomorph.core.model.arguments import check_argument
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.model import Marker, Model
from myomorph.core.model.series import Markers, Motion
from myomorph.core.model.shapes import (
    BodyJacobian,
    BodyRotations,
    BodyVectors,
    Coordinates,
    FixedPoints,
    FrameVectors,
    Points,
)
from myomorph.core.model.spatial import Transform
from myomorph.core.rigid.coordinates import Ints, State, evaluate_at, function_rates
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


class PoseArrays(NamedTuple):
    """Poses of all bodies and moving axes in ground, of one frame.

    Attributes
    ----------
    R : (bodies, 3, 3) rotation from each body's axes to ground
    p : (bodies, 3) origin of each body [m]
    w : (axes, 3) direction of each axis, a unit vector
    o : (axes, 3) a point on each axis [m]
    dphi : (axes, 2) slopes of an axis's motion in its two coordinates
    """

    R: Array
    p: Array
    w: Array
    o: Array
    dphi: Array


class RateArrays(NamedTuple):
    """Velocities and accelerations of all body frames in ground, of one frame.

    Attributes
    ----------
    omega : (bodies, 3) angular velocity [rad/s]
    v : (bodies, 3) velocity of the origin [m/s]
    alpha : (bodies, 3) angular acceleration [rad/s^2]
    a : (bodies, 3) acceleration of the origin, gravity not included [m/s^2]
    """

    omega: Array
    v: Array
    alpha: Array
    a: Array


@inner
def pose_room(T):
    """Make the `PoseArrays` that `body_poses` fills."""
    bodies = T.parent.shape[0]
    axes = T.axis_kind.shape[0]
    return PoseArrays(
        R=np.empty((bodies, 3, 3)),
        p=np.empty((bodies, 3)),
        w=np.empty((axes, 3)),
        o=np.empty((axes, 3)),
        dphi=np.empty((axes, 2)),
    )


@inner
def rate_room(T):
    """Make the `RateArrays` that `body_rates` fills."""
    bodies = T.parent.shape[0]
    return RateArrays(
        omega=np.empty((bodies, 3)),
        v=np.empty((bodies, 3)),
        alpha=np.empty((bodies, 3)),
        a=np.empty((bodies, 3)),
    )


@bare
def body_poses(T, c, pose):
    """Poses of all bodies and the moving axes in ground, for one frame.

    Parameters
    ----------
    T : `TreeArrays`
    c : (coordinates,) all coordinates, dependent ones consistent
    pose : `PoseArrays`, filled
    """
    R = pose.R
    p = pose.p
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
            pose.dphi[axis, 0] = d1
            pose.dphi[axis, 1] = d2
            u = vector(T.axis_vector, axis)
            direction = turned(r, u)
            put_vector(pose.w, axis, direction)
            put_vector(pose.o, axis, x)
            if T.axis_kind[axis] == ROTATION:
                r = product(r, about(u, q))
            else:
                x = along(x, q, direction)
        put_vector(p, b, plus(x, turned(r, vector(T.post_p, b))))
        put_matrix(R, b, product(r, matrix(T.post_R, b)))


@bare
def body_rates(T, state, pose, rates):
    """Velocities and accelerations of all body frames in ground, for one frame.

    From each parent outwards, over its axes (Featherstone 2008, ch. 5); gravity is not included. An
    axis moves by phi(c), so with the slopes Phi = dphi/dc at the rate and acceleration

        Phi cdot,   Phi cddot + Phidot cdot

    Parameters
    ----------
    T : `TreeArrays`
    state : `State`, dependent coordinates consistent
    pose : of `body_poses`
    rates : `RateArrays`, filled
    """
    zero = (0.0, 0.0, 0.0)
    for array in rates:
        put_vector(array, 0, zero)
    for b in range(1, T.parent.shape[0]):
        h = T.parent[b]
        # Angular rates W, E of the moving frame, and rates V, B of its point that coincides with x.
        x = vector(pose.p, h)
        W = vector(rates.omega, h)
        E = vector(rates.alpha, h)
        V = vector(rates.v, h)
        B = vector(rates.a, h)
        for axis in range(T.axis_start[b], T.axis_start[b + 1]):
            V, B = rates_at(W, E, V, B, minus(vector(pose.o, axis), x))
            x = vector(pose.o, axis)
            i = T.axis_coordinate[axis, 0]
            j = T.axis_coordinate[axis, 1]
            # Phi cdot and Phi cddot + Phidot cdot.
            q1, q2 = function_rates(T.functions, T.axis_function[axis], i, j, state)
            u = vector(pose.w, axis)
            turning = cross(W, u)
            if T.axis_kind[axis] == ROTATION:
                E = along(along(E, q2, u), q1, turning)
                W = along(W, q1, u)
            else:
                # The moved frame's velocity field is the old one plus u qdot everywhere, so the
                # point at which both are compared need not move along.
                B = along(along(B, q2, u), 2.0 * q1, turning)
                V = along(V, q1, u)
        V, B = rates_at(W, E, V, B, minus(vector(pose.p, b), x))
        put_vector(rates.omega, b, W)
        put_vector(rates.alpha, b, E)
        put_vector(rates.v, b, V)
        put_vector(rates.a, b, B)


@bare
def rates_at(W, E, V, B, r):
    """Compute velocity and acceleration of a point at r from one that has V and B.

    V + W x r,   B + E x r + W x (W x r)

    Both are fixed to a frame with the angular velocity W and acceleration E.
    """
    turning = cross(W, r)
    return plus(V, turning), plus(B, plus(cross(E, r), cross(W, turning)))


@dataclass(frozen=True, eq=False)
class Poses:
    """Poses of all bodies in ground; body 0 is the ground.

    Attributes
    ----------
    tree : the compiled model
    rotations : (frames, bodies, 3, 3) from the body's axes to ground
    origins : (frames, bodies, 3) in ground [m]
    axis_directions : (frames, axes, 3) unit vectors along the tree's moving axes, in ground
    axis_points : (frames, axes, 3) a point on each, in ground [m]
    axis_slopes : (frames, axes, 2) derivatives of an axis's motion in its coordinates
    """

    tree: Tree
    rotations: BodyRotations
    origins: BodyVectors
    axis_directions: Array
    axis_points: Array
    axis_slopes: Array

    def points(self, bodies: Ints, locations: FixedPoints) -> Points:
        """Positions in ground of points that are fixed to bodies.

        Parameters
        ----------
        bodies : (points,) body numbers
        locations : (points, 3) in the bodies' frames [m]

        Returns
        -------
        (frames, points, 3) [m]
        """
        return (
            np.einsum("fpij,pj->fpi", self.rotations[:, bodies], locations)
            + self.origins[:, bodies]
        )

    def markers(self, markers: Sequence[Marker]) -> Points:
        """Positions of markers in ground.

        Parameters
        ----------
        markers : of the tree's bodies

        Returns
        -------
        (frames, markers, 3) [m]
        """
        bodies = np.array([self.tree.body_number(marker.body) for marker in markers], np.int64)
        locations = np.array([marker.location for marker in markers]).reshape(-1, 3)
        return self.points(bodies, locations)

    def transforms(self, frame: int = 0) -> dict[str, Transform]:
        """Pose in ground of the ground and of every body, by name, in a frame."""
        rotations = self.rotations[frame]
        origins = self.origins[frame]
        return {
            body: Transform(rotations[number], origins[number])
            for body, number in self.tree.body_index.items()
        }

    def jacobian(self, body: int, points: Array) -> BodyJacobian:
        """Differentiate a body's twist by the coordinates.

        A rotation about the unit vector w through o moves a point x by w x (x - o), a translation
        along w by w. Dependent coordinates keep columns of their own.

        Parameters
        ----------
        body : its number
        points : (frames, 3) or (3,) at which linear rows hold, in ground [m]

        Returns
        -------
        (frames, 6, coordinates) rows angular, then linear, all in ground
        """
        arrays = self.tree.arrays
        columns = np.zeros((len(self.origins), 6, len(self.tree.model.coordinates)))
        for axis in np.flatnonzero(self.tree.supports[body]):
            w = self.axis_directions[:, axis]
            if arrays.axis_kind[axis] == ROTATION:
                linear = np.cross(w, points - self.axis_points[:, axis])
                twist = np.concatenate([w, linear], axis=1)
            else:
                twist = np.concatenate([np.zeros_like(w), w], axis=1)
            for slot, j in enumerate(arrays.axis_coordinate[axis]):
                if j >= 0:
                    columns[:, :, j] += self.axis_slopes[:, axis, slot, None] * twist
        return columns


def forward_kinematics(tree: Tree, coordinates: Coordinates) -> Poses:
    """Poses of all bodies.

    Parameters
    ----------
    tree : the compiled model
    coordinates : (frames, coordinates) in the model's order [rad or m], dependent ones consistent
        (`Tree.coordinates_of` makes them so)

    Returns
    -------
    poses of as many frames
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
    """Pose in ground of the ground and of every body, by name.

    Parameters
    ----------
    model : whose bodies stand
    values : by coordinate [rad or m]; the others have their defaults

    Raises
    ------
    UnknownName : the model has no such coordinate
    """
    values = values or {}
    for name in values:
        model.coordinate(name)
    posture = Motion(
        time=np.zeros(1),
        names=tuple(values),
        values=np.array([list(values.values())], dtype=np.float64).reshape(1, -1),
    )
    tree = compile_tree(model)
    return forward_kinematics(tree, tree.coordinates_of(posture)).transforms()


@kernel
def _poses(T, c, R, p, w, o, dphi):
    """`body_poses` of frames: every array has its frames first."""
    for frame in range(c.shape[0]):
        pose = PoseArrays(R=R[frame], p=p[frame], w=w[frame], o=o[frame], dphi=dphi[frame])
        body_poses(T, c[frame], pose)


def center_of_mass(tree: Tree, poses: Poses) -> FrameVectors:
    """Center of mass of the whole model.

    Parameters
    ----------
    tree : the compiled model
    poses : of its bodies

    Returns
    -------
    (frames, 3) in ground [m]
    """
    arrays = tree.arrays
    centers = poses.points(np.arange(len(arrays.mass)), arrays.mass_center)
    return np.einsum("b,fbi->fi", arrays.mass, centers) / arrays.mass.sum()


def marker_positions(model: Model, motion: Motion) -> Markers:
    """Positions of a model's markers in a motion, as cameras without errors would record them.

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
    check_argument("model", model, Model)
    check_argument("motion", motion, Motion)
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.coordinates_of(motion))
    return Markers(motion.time, model.marker_names, poses.markers(model.markers))


class PointMotion(NamedTuple):
    """Motion of points in ground.

    Attributes
    ----------
    positions : (frames, points, 3) [m]
    velocities : (frames, points, 3) [m/s]
    accelerations : (frames, points, 3) gravity not included [m/s^2]
    """

    positions: Points
    velocities: Points
    accelerations: Points


@read_only
class BodyMotion:
    """Motion of bodies; body 0 is the ground, and every vector is in ground.

    Attributes
    ----------
    rotations : (frames, bodies, 3, 3) from the body's axes to ground
    origins : (frames, bodies, 3) [m]
    angular_velocities : (frames, bodies, 3) [rad/s]
    angular_accelerations : (frames, bodies, 3) [rad/s^2]
    velocities : (frames, bodies, 3) of the origins [m/s]
    accelerations : (frames, bodies, 3) of the origins, gravity not included [m/s^2]
    """

    rotations: BodyRotations
    origins: BodyVectors
    angular_velocities: BodyVectors
    angular_accelerations: BodyVectors
    velocities: BodyVectors
    accelerations: BodyVectors

    def of_points(self, bodies: Ints, places: FixedPoints) -> PointMotion:
        """Motion of points that are fixed to bodies.

            v = v_0 + w x r,   a = a_0 + e x r + w x (w x r)

        with r from the body's origin to the point, w and e the angular velocity and acceleration.

        Parameters
        ----------
        bodies : (points,) body numbers
        places : (points, 3) in the bodies' frames [m]

        Returns
        -------
        positions, velocities and accelerations, (frames, points, 3) each
        """
        r = np.einsum("fpij,pj->fpi", self.rotations[:, bodies], places)
        turning = np.cross(self.angular_velocities[:, bodies], r)
        accelerations = np.cross(self.angular_accelerations[:, bodies], r)
        accelerations += np.cross(self.angular_velocities[:, bodies], turning)
        return PointMotion(
            positions=self.origins[:, bodies] + r,
            velocities=self.velocities[:, bodies] + turning,
            accelerations=self.accelerations[:, bodies] + accelerations,
        )


def body_motion(tree: Tree, c: Coordinates, cdot: Coordinates, cddot: Coordinates) -> BodyMotion:
    """Poses, velocities and accelerations of all bodies.

    Parameters
    ----------
    tree : the compiled model
    c, cdot, cddot : (frames, coordinates) values and their time derivatives, dependent ones
        consistent [rad or m, per s, per s^2]

    Returns
    -------
    motion of as many frames
    """
    frames = len(c)
    bodies = len(tree.arrays.parent)
    arrays = [np.array(values, dtype=np.float64, order="C") for values in (c, cdot, cddot)]
    R = np.empty((frames, bodies, 3, 3))
    p = np.empty((frames, bodies, 3))
    omega = np.empty_like(p)
    v = np.empty_like(p)
    alpha = np.empty_like(p)
    a = np.empty_like(p)
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
def _body_motion(  # page: arrays over frames, of which each call takes a part
    T, c, cdot, cddot, R, p, omega, v, alpha, a
):
    """`body_poses` and `body_rates` of frames: every array has its frames first."""
    axes = pose_room(T)
    for frame in range(c.shape[0]):
        pose = PoseArrays(R=R[frame], p=p[frame], w=axes.w, o=axes.o, dphi=axes.dphi)
        rates = RateArrays(omega=omega[frame], v=v[frame], alpha=alpha[frame], a=a[frame])
        body_poses(T, c[frame], pose)
        body_rates(T, State(c=c[frame], cdot=cdot[frame], cddot=cddot[frame]), pose, rates)
