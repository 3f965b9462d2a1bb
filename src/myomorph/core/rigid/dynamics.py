"""Inverse dynamics over frames: generalized forces from motion and external wrenches.

Beside them, the forces and moments that joints transmit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from myomorph.core.model.arguments import check_argument
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData
from myomorph.core.model.joint_torques import JointTorques
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion, Wrenches
from myomorph.core.model.shapes import (
    BodyRotations,
    BodyVectors,
    BodyWrenches,
    Coordinates,
    GeneralizedForces,
)
from myomorph.core.rigid.coordinates import Ints, State, couple_rates_frames
from myomorph.core.rigid.frames import run_frames
from myomorph.core.rigid.kernels import bare, in_place, kernel
from myomorph.core.rigid.kinematics import (
    PoseArrays,
    body_poses,
    body_rates,
    pose_room,
    rate_room,
    rates_at,
)
from myomorph.core.rigid.quantities import GENERALIZED_FORCE
from myomorph.core.rigid.tree import ROTATION, Tree, compile_tree
from myomorph.core.rigid.vectors import (
    along,
    cross,
    dot,
    matrix,
    minus,
    plus,
    put_vector,
    turned,
    turned_back,
    vector,
)

MAX_CLOCK_DIFFERENCE = 1e-6  # Between times of a motion and of external forces [s]


class MotionArrays(NamedTuple):
    """A motion in the model's order, couplers kept.

    Attributes
    ----------
    values : (frames, coordinates) [rad or m]
    velocities : (frames, coordinates) [rad/s or m/s]
    accelerations : (frames, coordinates) [rad/s^2 or m/s^2]
    """

    values: Coordinates
    velocities: Coordinates
    accelerations: Coordinates


class ExternalForces(NamedTuple):
    """External wrenches, in ground, as the kernels read them.

    Attributes
    ----------
    bodies : (wrenches,) numbers of the bodies that they act on
    forces : (frames, wrenches, 3) [N]
    points : (frames, wrenches, 3) of application [m]
    torques : (frames, wrenches, 3) free moments [N m]
    """

    bodies: Ints
    forces: Array
    points: Array
    torques: Array


def inverse_dynamics(
    model: Model, motion: Motion, wrenches: Wrenches | None = None
) -> JointTorques:
    """Generalized forces that make the model move as it does.

        tau = Phi^T (M a + h - gravity - external)

    with M the inertia of the bodies, a their accelerations, h their gyroscopic and centrifugal
    forces, and Phi = dphi/dc the slopes of the motions phi of the axes in the coordinates c. It is
    computed by the recursive Newton-Euler algorithm (Featherstone 2008, ch. 5) over elementary
    axes. As in OpenSim's tool, every coordinate has its own column, and couplers and closed loops
    transmit no force; `loops.loop_torques` folds the dependent ones in.

    Parameters
    ----------
    model : the body that moves, mass in [kg]
    motion : with velocities and accelerations; coordinates it lacks rest at their default
    wrenches : external forces in ground at the motion's times, each with its body's name

    Returns
    -------
    (frames, coordinates) [N m or N], NaN in frames where the motion is NaN, with the wrenches

    Raises
    ------
    BadData : where derivatives are missing, or the wrenches' clock is not the motion's
    UnknownName : where a wrench acts on a body that the model does not have

    Examples
    --------
    >>> import myomorph as mm
    >>> model = mm.read_model("arm.osim")
    >>> motion = mm.differentiate(mm.read_motion("reach.mot", model), cutoff=6.0)
    >>> torques = mm.inverse_dynamics(model, motion)
    >>> torques.names, torques.values.shape
    (('shoulder_flexion', 'elbow_flexion'), (61, 2))
    """
    check_argument("model", model, Model)
    check_argument("motion", motion, Motion)
    if wrenches is not None:
        check_argument("wrenches", wrenches, Wrenches)
    tree = compile_tree(model)
    c, cdot, cddot = motion_arrays(tree, motion)
    bodies, forces, points, torques = external_arrays(tree, motion, wrenches)
    tau = np.empty_like(c)
    arrays = (c, cdot, cddot, forces, points, torques, tau)
    run_frames(inverse_dynamics_frames, (tree.arrays, bodies), *arrays)
    return JointTorques(
        time=motion.time,
        names=model.coordinate_names,
        values=tau,
        quantity=GENERALIZED_FORCE,
        motion_kinds=model.motion_kinds,
        wrenches=wrenches,
    )


def motion_arrays(tree: Tree, motion: Motion) -> MotionArrays:
    """Values, velocities and accelerations of a motion in the model's order.

    Parameters
    ----------
    tree : the compiled model
    motion : coordinates that it lacks rest at their default; dependent ones are set

    Raises
    ------
    BadData : the motion has no velocities or no accelerations
    """
    if motion.velocities is None or motion.accelerations is None:
        raise BadData(
            "inverse dynamics needs velocities and accelerations: differentiate the motion first"
        )
    c = tree.coordinates_of(motion)
    cdot, cddot = tree.rates_of(motion)
    couple_rates_frames(tree.arrays, c, cdot, cddot)
    return MotionArrays(values=c, velocities=cdot, accelerations=cddot)


def values_and_rates(tree: Tree, motion: Motion) -> tuple[Coordinates, Coordinates]:
    """Values and velocities of a motion in the model's order, dependent ones consistent.

    Parameters
    ----------
    tree : the compiled model
    motion : coordinates that it lacks rest at their default

    Returns
    -------
    values : (frames, coordinates) [rad or m]
    velocities : (frames, coordinates) [rad/s or m/s]

    Raises
    ------
    BadData : the motion has no velocities
    """
    if motion.velocities is None:
        raise BadData("this needs the motion's velocities: differentiate the motion first")
    still = replace(motion, accelerations=np.zeros_like(motion.velocities))
    coordinates, rates, _ = motion_arrays(tree, still)
    return coordinates, rates


def external_arrays(tree: Tree, motion: Motion, wrenches: Wrenches | None) -> ExternalForces:
    """External wrenches as flat arrays, with the numbers of the bodies that they act on.

    Parameters
    ----------
    tree : the compiled model
    motion : whose times the wrenches have
    wrenches : None for none

    Raises
    ------
    BadData : the wrenches' clock is not the motion's
    UnknownName : a wrench acts on a body that the model does not have
    """
    if wrenches is None:
        empty = np.zeros((len(motion), 0, 3))
        no_bodies = np.zeros(0, np.int64)
        return ExternalForces(bodies=no_bodies, forces=empty, points=empty, torques=empty)
    if not _same_times(wrenches, motion):
        raise BadData(
            f"external forces have {len(wrenches)} frames from {wrenches.time[:1]} s, the motion"
            f" {len(motion)} from {motion.time[:1]} s: resample the forces to the motion's times"
            " first"
        )
    bodies = np.array([tree.body_number(body) for body in wrenches.bodies], np.int64)
    # A point of application is unknown (NaN) where nothing touches, and then does not matter.
    no_force = (wrenches.forces == 0.0).all(axis=2)[..., None]
    points = np.where(np.isnan(wrenches.points) & no_force, 0.0, wrenches.points)
    # Copies, because a kernel is compiled anew for arrays that are read-only.
    return ExternalForces(
        bodies=bodies,
        forces=wrenches.forces.copy(),
        points=points,
        torques=wrenches.torques.copy(),
    )


def _same_times(wrenches: Wrenches, motion: Motion) -> bool:
    """Whether wrenches have the frames of a motion."""
    if len(wrenches) != len(motion):
        return False
    differences = np.abs(wrenches.time - motion.time)
    return bool(np.max(differences, initial=0.0) <= MAX_CLOCK_DIFFERENCE)


@kernel
def inverse_dynamics_frames(  # page: arrays over frames, of which each call takes a part
    T, bodies, c, cdot, cddot, forces, points, torques, tau
):
    """Inverse dynamics of frames, with external wrenches.

    Parameters
    ----------
    T : `TreeArrays`
    bodies : (wrenches,) numbers of the bodies that wrenches act on
    c, cdot, cddot : (frames, coordinates) consistent
    forces, points, torques : (frames, wrenches, 3) as of `ExternalForces`
    tau : (frames, coordinates) filled [N m or N]
    """
    pose = pose_room(T)
    rates = rate_room(T)
    f = np.empty((T.parent.shape[0], 3))
    m = np.empty((T.parent.shape[0], 3))
    for frame in range(c.shape[0]):
        body_poses(T, c[frame], pose)
        body_rates(T, State(c=c[frame], cdot=cdot[frame], cddot=cddot[frame]), pose, rates)
        body_wrenches(T, pose, rates, f, m)
        for wrench in range(bodies.shape[0]):
            b = bodies[wrench]
            force = vector(forces[frame], wrench)
            lever = vector(points[frame], wrench)
            moment = plus(vector(torques[frame], wrench), cross(lever, force))
            put_vector(f, b, minus(vector(f, b), force))
            put_vector(m, b, minus(vector(m, b), moment))
        project(T, pose, f, m, tau[frame])


@in_place
def body_wrenches(T, pose, rates, f, m):
    """Force and moment that the motion of each body needs, gravity taken off.

    With the center of mass c, its acceleration a_c, and the inertia I about it,

        f = mass (a_c - gravity),   m = c x f + I E + W x (I W)

    where W and E are the angular velocity and acceleration.

    Parameters
    ----------
    T : `TreeArrays`
    pose, rates : of `body_poses` and `body_rates`
    f, m : (bodies, 3) filled with force [N] and moment about the ground's origin [N m], in ground
    """
    gravity = (T.gravity[0], T.gravity[1], T.gravity[2])
    for b in range(T.parent.shape[0]):
        r = matrix(pose.R, b)
        W = vector(rates.omega, b)
        E = vector(rates.alpha, b)
        # The moment equation in the body's frame, where the inertia is constant.
        I = matrix(T.inertia, b)
        spin = turned_back(r, W)
        moment = turned(r, plus(turned(I, turned_back(r, E)), cross(spin, turned(I, spin))))
        center = turned(r, vector(T.mass_center, b))
        _, acceleration = rates_at(W, E, W, vector(rates.a, b), center)
        force = along((0.0, 0.0, 0.0), T.mass[b], minus(acceleration, gravity))
        put_vector(f, b, force)
        put_vector(m, b, plus(moment, cross(plus(vector(pose.p, b), center), force)))


@bare
def project(T, pose, f, m, tau):
    """Generalized forces of wrenches on the bodies, summed from the leaves to the ground.

    A rotation about w through o takes w . (m - o x f), a translation along w takes w . f.

    Parameters
    ----------
    T : `TreeArrays`
    pose : of `body_poses`
    f, m : (bodies, 3) force [N] and moment about the ground's origin [N m], in ground; added up to
        those of a body and all that it carries
    tau : (coordinates,) filled [N m or N]
    """
    for j in range(tau.shape[0]):
        tau[j] = 0.0
    for b in range(T.parent.shape[0] - 1, 0, -1):
        for axis in range(T.axis_start[b], T.axis_start[b + 1]):
            acts = vector(f, b)
            if T.axis_kind[axis] == ROTATION:
                acts = minus(vector(m, b), cross(vector(pose.o, axis), vector(f, b)))
            t = dot(vector(pose.w, axis), acts)
            for slot in range(2):
                j = T.axis_coordinate[axis, slot]
                if j >= 0:
                    tau[j] += pose.dphi[axis, slot] * t
        h = T.parent[b]
        put_vector(f, h, plus(vector(f, h), vector(f, b)))
        put_vector(m, h, plus(vector(m, h), vector(m, b)))


class OnlineDynamics:
    """Generalized forces of one frame after the other, as `inverse_dynamics` gives them.

    Parameters
    ----------
    model : that moves
    bodies : names of those that external wrenches act on

    Attributes
    ----------
    coordinates, rates, accelerations : (1, coordinates) of the last frame, dependent ones set
    torques : (1, coordinates) of the last frame [N m or N]

    Raises
    ------
    UnknownName : a body that the model does not have
    """

    def __init__(self, model: Model, bodies: Sequence[str]):
        self._tree = compile_tree(model)
        self._bodies = np.array([self._tree.body_number(body) for body in bodies], np.int64)
        n = len(model.coordinates)
        wrenches = len(bodies)
        self.coordinates, self.rates, self.accelerations = np.zeros((3, 1, n))
        self.torques = np.zeros((1, n))
        self._forces, self._points, self._torques = np.zeros((3, 1, wrenches, 3))

    def solve(
        self, values: Array, velocities: Array, accelerations: Array, wrenches: Array
    ) -> Array:
        """Torques of one frame; the array is used again by the next.

        Parameters
        ----------
        values, velocities, accelerations : (coordinates,) in the model's order
        wrenches : (bodies, 6) moment about the ground's origin [N m] and force [N], in ground

        Returns
        -------
        (coordinates,) [N m or N]
        """
        self.coordinates[0] = values
        self.rates[0] = velocities
        self.accelerations[0] = accelerations
        couple_rates_frames(self._tree.arrays, self.coordinates, self.rates, self.accelerations)
        self._torques[0] = wrenches[:, :3]
        self._forces[0] = wrenches[:, 3:]
        inverse_dynamics_frames(
            self._tree.arrays,
            self._bodies,
            self.coordinates,
            self.rates,
            self.accelerations,
            self._forces,
            self._points,
            self._torques,
            self.torques,
        )
        return self.torques[0]

    def joint_forces(self) -> Array:
        """Find what joints transmit in the last frame without muscles and bushings, in ground.

        They are what the motion of a joint's child and of all that it carries needs, gravity and
        external forces taken off.

        Returns
        -------
        (bodies, 3) that the parent exerts on each body [N]
        """
        applied = np.zeros((1, len(self._tree.arrays.parent), 6))
        np.add.at(applied[0, :, :3], self._bodies, self._forces[0])
        np.add.at(applied[0, :, 3:], self._bodies, self._torques[0])
        motion = (self.coordinates, self.rates, self.accelerations)
        return joint_wrenches(self._tree, *motion, applied).forces[0]


@dataclass(frozen=True, eq=False)
class JointWrenches:
    """Force and moment that the parent exerts on each body through their joint, in ground.

    Attributes
    ----------
    forces : (frames, bodies, 3) those of the ground are what the whole model needs [N]
    moments : (frames, bodies, 3) about the ground's origin [N m]
    torques : (frames, coordinates) their part along each coordinate's own motion [N m or N]
    rotations : (frames, bodies, 3, 3) of the bodies
    origins : (frames, bodies, 3) of the bodies [m]
    """

    forces: BodyVectors
    moments: BodyVectors
    torques: GeneralizedForces
    rotations: BodyRotations
    origins: BodyVectors


def joint_wrenches(
    tree: Tree,
    c: Coordinates,
    cdot: Coordinates,
    cddot: Coordinates,
    applied: BodyWrenches,
) -> JointWrenches:
    """Wrenches that joints transmit, by Newton's and Euler's equations.

        wrench of a joint = sum of (rate of momentum - gravity - applied)

    over the joint's child and all bodies that it carries.

    Parameters
    ----------
    tree : the compiled model
    c, cdot, cddot : (frames, coordinates) consistent, as of `motion_arrays`
    applied : (frames, bodies, 6) force [N] and its moment about the ground's origin [N m] on each
        body, the ground first, in ground: all but gravity and what joints transmit

    Returns
    -------
    wrenches of as many frames
    """
    frames = len(c)
    bodies = len(tree.arrays.parent)
    f = np.empty((frames, bodies, 3))
    m = np.empty((frames, bodies, 3))
    R = np.empty((frames, bodies, 3, 3))
    p = np.empty((frames, bodies, 3))
    tau = np.empty_like(c)
    run_frames(_joint_wrenches, (tree.arrays,), c, cdot, cddot, applied, f, m, tau, R, p)
    return JointWrenches(forces=f, moments=m, torques=tau, rotations=R, origins=p)


@kernel
def _joint_wrenches(  # page: arrays over frames, of which each call takes a part
    T, c, cdot, cddot, applied, f, m, tau, R, p
):
    """`joint_wrenches` of frames; f, m, tau, R and p are filled, frames first."""
    axes = pose_room(T)
    rates = rate_room(T)
    for frame in range(c.shape[0]):
        pose = PoseArrays(R=R[frame], p=p[frame], w=axes.w, o=axes.o, dphi=axes.dphi)
        body_poses(T, c[frame], pose)
        body_rates(T, State(c=c[frame], cdot=cdot[frame], cddot=cddot[frame]), pose, rates)
        body_wrenches(T, pose, rates, f[frame], m[frame])
        for b in range(T.parent.shape[0]):
            wrench = applied[frame, b]
            force = (wrench[0], wrench[1], wrench[2])
            moment = (wrench[3], wrench[4], wrench[5])
            put_vector(f[frame], b, minus(vector(f[frame], b), force))
            put_vector(m[frame], b, minus(vector(m[frame], b), moment))
        project(T, pose, f[frame], m[frame], tau[frame])
