"""MuJoCo as the engine of simulated subjects.

Markers and plate wrench are from coordinate values alone. Nothing of Myomorph's kernels takes part.
Velocities and accelerations are finite differences of eighth order of the poses, and MuJoCo's
recursive Newton-Euler algorithm (`mj_rne`) gives the forces.
"""

from __future__ import annotations

import copy
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

import myomorph as mm
from myomorph.core.model.arrays import Array

MARGIN = 4
"""Frames before and after the recording that finite differences of eighth order need."""
FIRST = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0.0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
SECOND = np.array([-1 / 560, 8 / 315, -1 / 5, 8 / 5, -205 / 72, 8 / 5, -1 / 5, 8 / 315, -1 / 560])

Progress = Callable[[int], None] | None


class Engine(Protocol):
    """Whatever tells markers and wrench from coordinates."""

    def measure(
        self, values: Array, rate: float, center: Array, progress: Progress = None
    ) -> tuple[Array, Array]:
        """Compute markers and wrench of a motion.

        Parameters
        ----------
        values : (frames + 2 MARGIN, coordinates) of the model, dependent ones consistent [rad or m]
        rate : of the frames [Hz]
        center : (3,) in ground, about which the moment is [m]
        progress : called with the number of frames done since the last call

        Returns
        -------
        (frames, markers, 3) [m] and (frames, 6) moment and force that the ground gives the person
        [N m; N]
        """


def rates(x: Array, rate: float) -> tuple[Array, Array]:
    """Return first and second derivatives of x in its middle frames.

    Parameters
    ----------
    x : (frames + 2 MARGIN, ...)
    rate : of the frames [Hz]

    Returns
    -------
    both (frames, ...) [1/s, 1/s^2]
    """
    frames = len(x) - 2 * MARGIN
    shifted = [x[k : k + frames] for k in range(2 * MARGIN + 1)]
    first = sum(w * part for w, part in zip(FIRST, shifted, strict=True) if w)
    second = sum(w * part for w, part in zip(SECOND, shifted, strict=True))
    return first * rate, second * rate**2


def angular_rates(rotations: Array, rate: float) -> tuple[Array, Array]:
    """Return angular velocity and acceleration in ground.

    Parameters
    ----------
    rotations : (frames + 2 MARGIN, ..., 3, 3)
    rate : of the frames [Hz]

    Returns
    -------
    both (frames, ..., 3) [rad/s, rad/s^2]
    """
    dot, ddot = rates(rotations, rate)
    turned = np.swapaxes(rotations[MARGIN:-MARGIN], -1, -2)
    return _axial(dot @ turned), _axial(ddot @ turned)


def _axial(m: Array) -> Array:
    skew = 0.5 * (m - np.swapaxes(m, -1, -2))
    return np.stack([skew[..., 2, 1], skew[..., 0, 2], skew[..., 1, 0]], axis=-1)


def put_inertia(compiled: Any, model: mm.Model) -> None:
    """Masses, mass centers and inertias of a model's bodies as of MuJoCo's bodies 1, 2, ..."""
    for b, body in enumerate(model.bodies, 1):
        moments, axes = np.linalg.eigh(body.inertia)
        axes = axes * np.sign(np.linalg.det(axes))
        compiled.body_mass[b] = body.mass
        compiled.body_ipos[b] = body.mass_center
        compiled.body_inertia[b] = moments
        compiled.body_iquat[b] = quaternions_of(axes)
    # MuJoCo spares itself work where frames coincided in the file.
    compiled.body_sameframe[:] = 0
    compiled.body_simple[:] = 0


def quaternions_of(rotations: Array) -> Array:
    """Return quaternions of rotations.

    Parameters
    ----------
    rotations : (n, 3, 3)

    Returns
    -------
    (n, 4), w first
    """
    found: Array = Rotation.from_matrix(rotations).as_quat()[..., [3, 0, 1, 2]]
    return found


class TreeEngine:
    """A MuJoCo model of a person that began as a MuJoCo model.

    It has its own kinematics and its own dynamics.

    Parameters
    ----------
    compiled : the MuJoCo model of the generic body, with one free joint, first, and hinges and
        slides
    person : our model of the person, whose lengths and inertias are put into MuJoCo's
    """

    def __init__(self, compiled: Any, person: mm.Model):
        self.person = person
        self.compiled = m = copy.copy(compiled)
        put_inertia(m, person)
        at = 0
        self.start = np.eye(3)
        for b, joint in enumerate(person.joints, 1):
            kinds = joint.kind.split("+")
            if kinds == ["free"]:
                self.start = joint.child_frame.rotation.T
                at += 6
                continue
            m.body_pos[b] = joint.parent_frame.translation
            if kinds == ["weld"]:
                continue
            for j, axis in enumerate(joint.axes, m.body_jntadr[b]):
                m.jnt_pos[j] = axis.origin
                m.qpos0[m.jnt_qposadr[j]] = person.coordinates[at].default
                at += 1
        self.data = mujoco.MjData(m)

    def _states(self, values: Array, rate: float) -> tuple[States, Array]:
        """Return MuJoCo's states of the middle frames, and rotations (frames, 3, 3) of the base."""
        turns = Rotation.from_euler("XYZ", values[:, 3:6]).as_matrix() @ self.start
        spin, turning = angular_rates(turns, rate)
        body_turns = turns[MARGIN:-MARGIN]
        first, second = rates(values, rate)
        qvel = first.copy()
        qacc = second.copy()
        qvel[:, 3:6] = np.einsum("fji,fj->fi", body_turns, spin)
        qacc[:, 3:6] = np.einsum("fji,fj->fi", body_turns, turning)
        quaternions = quaternions_of(body_turns)
        qpos = np.hstack([values[MARGIN:-MARGIN, :3], quaternions, values[MARGIN:-MARGIN, 6:]])
        return States(qpos=qpos, qvel=qvel, qacc=qacc), body_turns

    def measure(
        self, values: Array, rate: float, center: Array, progress: Progress = None
    ) -> tuple[Array, Array]:
        """Compute markers and wrench of a motion.

        Parameters
        ----------
        values : (frames + 2 MARGIN, coordinates) [rad or m]
        rate : of the frames [Hz]
        center : (3,) in ground, about which the moment is [m]
        progress : called with the number of frames done since the last call

        Returns
        -------
        as of `Engine.measure`
        """
        m = self.compiled
        d = self.data
        states, body_turns = self._states(values, rate)
        numbers = [m.body(one.body).id for one in self.person.markers]
        local = np.array([one.location for one in self.person.markers])
        frames = len(states.qpos)
        places = np.empty((frames, len(local), 3))
        wrench = np.empty((frames, 6))
        generalized = np.empty(m.nv)
        for frame in range(frames):
            inverse_dynamics(m, d, states, frame, generalized)
            places[frame] = d.xpos[numbers] + np.einsum(
                "mij,mj->mi", d.xmat[numbers].reshape(-1, 3, 3), local
            )
            force = generalized[:3]
            origin = d.xpos[1]
            wrench[frame, 3:] = force
            wrench[frame, :3] = body_turns[frame] @ generalized[3:6] + np.cross(
                origin - center, force
            )
            if progress and frame % 1000 == 999:
                progress(1000)
        return places, wrench


class States(NamedTuple):
    """States of a MuJoCo model and their rates.

    Attributes
    ----------
    qpos : (frames, nq)
    qvel, qacc : (frames, nv)
    """

    qpos: Array
    qvel: Array
    qacc: Array


def inverse_dynamics(
    model: mujoco.MjModel, data: mujoco.MjData, states: States, frame: int, generalized: Array
) -> None:
    """Run MuJoCo's recursive Newton-Euler algorithm on a frame.

    Parameters
    ----------
    model, data : of MuJoCo; the data have the frame's kinematics afterwards
    states : of all frames
    frame : number
    generalized : (nv,) forces, written
    """
    data.qpos = states.qpos[frame]
    data.qvel = states.qvel[frame]
    data.qacc = states.qacc[frame]
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_comVel(model, data)
    mujoco.mj_rne(model, data, 1, generalized)


class SimbodyEngine:
    """OpenSim's kinematics (Simbody), and MuJoCo's dynamics of each body as a free one.

    Parameters
    ----------
    person : written to a file that OpenSim opens
    """

    def __init__(self, person: mm.Model):
        import opensim

        from myomorph.core.io.osim.write import write_osim

        opensim.Logger.setLevelString("Off")
        self.person = person
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "person.osim"
            write_osim(person, path)
            self.model = opensim.Model(str(path))
        self.model.updForceSet().clearAndDestroy()
        self.model.updConstraintSet().clearAndDestroy()
        self.state = self.model.initSystem()
        coordinates = self.model.getCoordinateSet()
        if coordinates.getSize() != self.state.getNQ():
            raise ValueError("OpenSim's coordinates are not its generalized coordinates one by one")
        for i in range(coordinates.getSize()):
            coordinates.get(i).setLocked(self.state, False)
            coordinates.get(i).setValue(self.state, 1e-4 * (i + 1), False)
        order = [round(1e4 * float(q)) - 1 for q in self.state.getQ().to_numpy()]
        names = [coordinates.get(i).getName() for i in order]
        self.columns = [person.coordinate_names.index(name) for name in names]
        self.bodies = [self.model.getBodySet().get(name) for name in person.body_names]
        bodies = "".join(
            '<body><freejoint/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>'
            for _ in person.bodies
        )
        self.free = mujoco.MjModel.from_xml_string(
            f"<mujoco><worldbody>{bodies}</worldbody></mujoco>"
        )
        put_inertia(self.free, person)
        self.free.opt.gravity[:] = person.gravity

    def poses(self, values: Array, progress: Progress = None) -> tuple[Array, Array]:
        """Return poses of all bodies from Simbody.

        Parameters
        ----------
        values : (frames, coordinates) in the person's order [rad or m]
        progress : called with the number of frames done since the last call

        Returns
        -------
        rotations (frames, bodies, 3, 3) and origins (frames, bodies, 3) [m]
        """
        import opensim

        quaternions = np.empty((len(values), len(self.bodies), 4))
        origins = np.empty((len(values), len(self.bodies), 3))
        for frame, row in enumerate(values[:, self.columns]):
            self.state.setQ(opensim.Vector.createFromMat(np.ascontiguousarray(row)))
            self.model.realizePosition(self.state)
            for b, body in enumerate(self.bodies):
                pose = body.getTransformInGround(self.state)
                turn = pose.R().convertRotationToQuaternion()
                quaternions[frame, b] = turn.get(0), turn.get(1), turn.get(2), turn.get(3)
                origins[frame, b] = pose.p().to_numpy()
            if progress and frame % 1000 == 999:
                progress(1000)
        turns = Rotation.from_quat(quaternions.reshape(-1, 4)[:, [1, 2, 3, 0]]).as_matrix()
        return turns.reshape(*quaternions.shape[:2], 3, 3), origins

    def measure(
        self, values: Array, rate: float, center: Array, progress: Progress = None
    ) -> tuple[Array, Array]:
        """Compute markers and wrench of a motion.

        Parameters
        ----------
        values : (frames + 2 MARGIN, coordinates) [rad or m]
        rate : of the frames [Hz]
        center : (3,) in ground, about which the moment is [m]
        progress : called with the number of frames done since the last call

        Returns
        -------
        as of `Engine.measure`
        """
        rotations, origins = self.poses(values, progress)
        spin, turning = angular_rates(rotations, rate)
        velocity, acceleration = rates(origins, rate)
        rotations = rotations[MARGIN:-MARGIN]
        origins = origins[MARGIN:-MARGIN]
        frames, bodies = origins.shape[:2]
        back = np.swapaxes(rotations, -1, -2)

        def in_body(x: Array) -> Array:
            return (back @ x[..., None])[..., 0]

        def joined(linear: Array, angular: Array) -> Array:
            return np.concatenate([linear, angular], axis=2).reshape(frames, -1)

        quaternions = quaternions_of(rotations.reshape(-1, 3, 3)).reshape(frames, bodies, 4)
        states = States(
            qpos=joined(origins, quaternions),
            qvel=joined(velocity, in_body(spin)),
            qacc=joined(acceleration, in_body(turning)),
        )
        pairs = self._generalized(states).reshape(frames, bodies, 6)
        forces = pairs[..., :3]
        moments = (rotations @ pairs[..., 3:, None])[..., 0] + np.cross(origins - center, forces)
        wrench = np.concatenate([moments.sum(axis=1), forces.sum(axis=1)], axis=1)
        return self._markers(rotations, origins), wrench

    def _generalized(self, states: States) -> Array:
        """Return the forces (frames, 6 bodies) that free bodies need."""
        data = mujoco.MjData(self.free)
        generalized = np.empty((len(states.qpos), self.free.nv))
        for frame in range(len(generalized)):
            inverse_dynamics(self.free, data, states, frame, generalized[frame])
        return generalized

    def _markers(self, rotations: Array, origins: Array) -> Array:
        """Return markers (frames, markers, 3) in ground, of poses of all bodies."""
        numbers = [self.person.body_names.index(one.body) for one in self.person.markers]
        local = np.array([one.location for one in self.person.markers])
        return np.einsum("fmij,mj->fmi", rotations[:, numbers], local) + origins[:, numbers]
