"""A written model as MuJoCo has it.

Lengths, moment arms and generalized forces are at our coordinates.
"""

from __future__ import annotations

import os
from typing import Any

import mujoco
import numpy as np

from myomorph.core.io.mjcf.compile import silent_mujoco
from myomorph.core.model.arrays import Array
from myomorph.core.model.model import Joint, Model
from myomorph.core.model.spatial import quaternion_from_rotation, rotation_from_euler_xyz

NEWTON_STEPS = 8
CLOSED = 1e-10
STRIDE = 0.1  # By which leaders move at most while followers go on from where they were [rad or m]
FOLLOWING = (int(mujoco.mjtEq.mjEQ_JOINT), int(mujoco.mjtEq.mjEQ_TENDON))


class MujocoCopy:
    """MuJoCo's copy of a model, from the file that was written of it."""

    def __init__(self, path: str | os.PathLike[str], model: Model):
        with silent_mujoco():
            self.m: Any = mujoco.MjModel.from_xml_path(os.fspath(path))
        self.d: Any = mujoco.MjData(self.m)
        # Rows of constraints are dense then, and only those of equalities are there.
        self.m.opt.jacobian = int(mujoco.mjtJacobian.mjJAC_DENSE)
        self.m.opt.disableflags |= int(
            mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
        )
        self.model = model
        self.held = model.dependent_coordinates
        self.simple: dict[str, tuple[int, int]] = {}
        self.turning: list[tuple[int, int, int, Array]] = []
        start = 0
        for joint in model.joints:
            start = self._add_joint(joint, start)
        order = {name: i for i, name in enumerate(model.coordinate_names)}
        self.columns = np.array([order[name] for name in self.simple], np.int64)
        addresses = np.array(list(self.simple.values()), np.int64).reshape(-1, 2)
        self.qpos, self.dofs = addresses.T
        follows = np.array([name in self.held for name in self.simple], np.bool_)
        self.followers = self.dofs[follows]
        self.follower_qpos = self.qpos[follows]
        self.free = [name for name in self.simple if name not in self.held]
        self.free_dofs = self.dofs[~follows]
        led = {name for coupler in self.held.values() for name in coupler.independents}
        self.leaders = np.array([order[name] for name in led - set(self.held)], np.int64)
        kind = mujoco.mjtObj.mjOBJ_TENDON
        self.tendons = [
            mujoco.mj_name2id(self.m, kind, f"{name}_tendon") for name in model.muscle_names
        ]

    def _add_joint(self, joint: Joint, start: int) -> int:
        """Find a joint's coordinates in MuJoCo's arrays.

        `start`: index of the first of its coordinates in the model. Returns that of the next joint.
        """
        names = list(joint.coordinates)
        for kind in joint.kind.split("+"):
            if kind in ("hinge", "slide"):
                self.simple[names[0]] = self._address(names[0])
                start += 1
                names = names[1:]
            elif kind in ("free", "ball"):
                rotation = joint.child_frame.rotation.T if kind == "free" else np.eye(3)
                adr, dof = self._address(names[0].rsplit("_", 1)[0])
                if kind == "free":
                    for i in range(3):
                        self.simple[names[i]] = adr + i, dof + i
                    adr = adr + 3
                    start += 3
                    names = names[3:]
                self.turning.append((adr, dof, start, rotation))
                start += 3
                names = names[3:]
        return start

    def _address(self, name: str) -> tuple[int, int]:
        number = mujoco.mj_name2id(self.m, mujoco.mjtObj.mjOBJ_JOINT, name)
        return int(self.m.jnt_qposadr[number]), int(self.m.jnt_dofadr[number])

    def place(self, coordinates: Array) -> None:
        """Put MuJoCo's copy into a pose.

        Followers are where its own constraints hold them nearest to the model's.

        Parameters
        ----------
        coordinates : (coordinates,) [rad or m]
        """
        self._put(coordinates)
        self._close()

    def move(self, start: Array, stop: Array) -> None:
        """Move MuJoCo's copy from one pose, in which it is, to another.

        Followers go on from where they were. So those that fold back on the way are where MuJoCo
        has them, which `place` would not see.

        Parameters
        ----------
        start, stop : (coordinates,) [rad or m]
        """
        steps = max(1, int(np.ceil(np.abs(stop - start)[self.leaders].max(initial=0.0) / STRIDE)))
        for share in np.linspace(0.0, 1.0, steps + 1)[1:]:
            followers = self.d.qpos[self.follower_qpos].copy()
            self._put(start + share * (stop - start))
            self.d.qpos[self.follower_qpos] = followers
            self._close()

    def _close(self) -> None:
        """Move followers until their constraints hold."""
        d = self.d
        for _ in range(NEWTON_STEPS):
            mujoco.mj_fwdPosition(self.m, d)
            rows, gap = self._following()
            if not len(gap) or np.abs(gap).max() < CLOSED:
                break
            d.qpos[self.follower_qpos] -= np.linalg.lstsq(rows[:, self.followers], gap, rcond=None)[
                0
            ]

    def _put(self, coordinates: Array) -> None:
        d = self.d
        d.qpos[:] = self.m.qpos0
        d.qpos[self.qpos] = coordinates[self.columns]
        for adr, _, at, start in self.turning:
            d.qpos[adr : adr + 4] = quaternion_from_rotation(
                rotation_from_euler_xyz(coordinates[at : at + 3]) @ start
            )

    def _following(self) -> tuple[Array, Array]:
        """Rows (constraints, dofs) and errors (constraints,) of what holds followers."""
        d = self.d
        count = int(self.d.ne)
        kinds = self.m.eq_type[d.efc_id[:count]]
        used = np.isin(kinds, FOLLOWING)
        rows = np.reshape(d.efc_J, (-1, self.m.nv))[:count]
        return np.array(rows[used]), np.array(d.efc_pos[:count][used])

    def lengths_and_arms(self, coordinates: Array, route: np.ndarray) -> tuple[Array, Array]:
        """Lengths and moment arms in poses that are reached by continuous movement.

        Parameters
        ----------
        coordinates : (poses, coordinates) [rad or m]
        route : (poses,) number of the pose before, from which each is reached; -1 for the default
            one

        Returns
        -------
        (poses, muscles) [m] and (poses, muscles, `free`) [m/rad or m/m]
        """
        lengths = np.empty((len(coordinates), len(self.tendons)))
        arms = np.empty((len(coordinates), len(self.tendons), len(self.free)))
        default = np.array([coordinate.default for coordinate in self.model.coordinates])
        reached = np.empty((len(coordinates), self.m.nq))
        # MuJoCo warns of poses in which two axes of a joint are in line.
        with silent_mujoco():
            self.place(default)
            start = self.d.qpos.copy()
            for pose in np.argsort(_depths(route), kind="stable"):
                before = int(route[pose])
                self.d.qpos[:] = start if before < 0 else reached[before]
                self.move(default if before < 0 else coordinates[before], coordinates[pose])
                reached[pose] = self.d.qpos
                lengths[pose] = self.d.ten_length[self.tendons]
                arms[pose] = self._arms()
        return lengths, arms

    def _arms(self) -> Array:
        """Moment arms (muscles, `free`) in the pose in which it is [m/rad or m/m]."""
        jacobian = tendon_jacobian(self.m, self.d)[self.tendons]
        arms = -jacobian[:, self.free_dofs]
        rows, _ = self._following()
        if len(rows):
            slopes = -np.linalg.lstsq(rows[:, self.followers], rows[:, self.free_dofs], rcond=None)[
                0
            ]
            arms -= jacobian[:, self.followers] @ slopes
        return np.asarray(arms)

    def muscle_forces(self, lengths: Array, speeds: Array) -> tuple[Array, Array]:
        """Return active forces of full activation and passive forces.

        Parameters
        ----------
        lengths : (samples, muscles) of tendons [m]
        speeds : (samples, muscles) of tendons [m/s]

        Returns
        -------
        (samples, muscles) active, and (samples, muscles) passive [N]
        """
        forces = np.zeros((2, *lengths.shape))
        for i in range(lengths.shape[1]):
            bounds = self.m.actuator_lengthrange[i]
            strength = self.m.actuator_acc0[i]
            values = self.m.actuator_gainprm[i]
            for sample, length in enumerate(lengths[:, i]):
                gain = mujoco.mju_muscleGain(
                    length, speeds[sample, i], bounds, strength, values[:9]
                )
                bias = mujoco.mju_muscleBias(length, bounds, strength, values[:9])
                forces[:, sample, i] = -gain, -bias
        return forces[0], forces[1]

    def generalized_forces(self, coordinates: Array, speeds: Array, accelerations: Array) -> Array:
        """Return what moves MuJoCo's copy so, by `mj_inverse` without constraints and armature.

        The motion is consistent; free and ball joints do not rotate.

        Parameters
        ----------
        coordinates : (frames, coordinates) [rad or m]
        speeds : (frames, coordinates) [rad/s or m/s]
        accelerations : (frames, coordinates) [rad/s^2 or m/s^2]

        Returns
        -------
        (frames, `simple`) generalized forces [N m or N]
        """
        m = self.m
        flags = int(m.opt.disableflags)
        armature = m.dof_armature.copy()
        m.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
        m.dof_armature[:] = 0.0
        result = np.empty((len(coordinates), len(self.dofs)))
        # MuJoCo warns of bodies whose mass is next to nothing.
        with silent_mujoco():
            for frame, row in enumerate(coordinates):
                self._put(row)
                self.d.qvel[:] = 0.0
                self.d.qacc[:] = 0.0
                self.d.qvel[self.dofs] = speeds[frame, self.columns]
                self.d.qacc[self.dofs] = accelerations[frame, self.columns]
                mujoco.mj_inverse(m, self.d)
                result[frame] = self.d.qfrc_inverse[self.dofs]
        m.opt.disableflags = flags
        m.dof_armature[:] = armature
        return result

    def steps(self, count: int) -> bool:
        """Return whether MuJoCo takes steps from the default pose.

        All values must stay finite, and no coordinate be lost.
        """
        with silent_mujoco():
            mujoco.mj_resetData(self.m, self.d)
            for _ in range(count):
                mujoco.mj_step(self.m, self.d)
        lost = int(self.d.warning[int(mujoco.mjtWarning.mjWARN_BADQACC)].number)
        return bool(np.isfinite(self.d.qpos).all() and np.isfinite(self.d.qvel).all() and not lost)


def _depths(route: np.ndarray) -> np.ndarray:
    """How many poses (poses,) are passed on the way to each, see `lengths_and_arms`."""
    depths = np.zeros(len(route), np.int64)
    waiting = np.array(route)
    while (waiting >= 0).any():
        depths[waiting >= 0] += 1
        waiting = np.where(waiting >= 0, np.asarray(route)[waiting], -1)
    return depths


def tendon_jacobian(m: Any, d: Any) -> Array:
    """Return the Jacobian of tendon lengths, from MuJoCo's rows.

    Rows are dense in small models before 3.6, where the pattern moved to the model.

    Parameters
    ----------
    m : MuJoCo's model
    d : its data, of a pose for which tendons were evaluated

    Returns
    -------
    (tendons, nv) [m/rad, or m/m]
    """
    if not hasattr(m, "ten_J_rownnz") and not mujoco.mj_isSparse(m):
        return np.array(np.reshape(d.ten_J, (m.ntendon, m.nv)))
    home = m if hasattr(m, "ten_J_rownnz") else d
    values = np.ravel(d.ten_J)
    columns = np.ravel(home.ten_J_colind)
    jacobian = np.zeros((m.ntendon, m.nv))
    for t in range(m.ntendon):
        start = home.ten_J_rowadr[t]
        count = home.ten_J_rownnz[t]
        jacobian[t, columns[start : start + count]] = values[start : start + count]
    return jacobian
