"""What every joint transmits: force and moment between a body and its parent, from motion and what acts on bodies."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from myomorph.model.arrays import Array
from myomorph.rigid.dynamics import body_wrenches, project
from myomorph.rigid.frames import over_frames
from myomorph.rigid.kernels import kernel
from myomorph.rigid.kinematics import body_poses, body_rates
from myomorph.rigid.tree import Tree
from myomorph.rigid.vectors import minus, put_vector, vector


@dataclass(frozen=True, eq=False)
class JointWrenches:
    """Force and moment that the parent puts on each body through their joint."""

    forces: Array  # (frames, bodies, 3) in ground [N]; those of the ground are what the whole model needs
    moments: Array  # (frames, bodies, 3) about the ground's origin, in ground [N m]
    torques: Array  # (frames, coordinates) their part along each coordinate's own motion [N m or N]
    rotations: Array  # (frames, bodies, 3, 3) poses of the bodies in ground [m]
    origins: Array  # (frames, bodies, 3) poses of the bodies in ground [m]


def joint_wrenches(tree: Tree, c: Array, cdot: Array, cddot: Array, applied: Array) -> JointWrenches:
    """Newton's and Euler's equations of each body and all it carries.

        wrench of joint = sum over the body and its descendants of (rate of momentum - gravity - applied)

    `c`, `cdot`, `cddot` (frames, coordinates) consistent, as of `rigid.dynamics.motion_arrays`; `applied` (frames,
    bodies, 6) force and its moment about the ground's origin on each body, the ground first, in ground [N], [N m]: all
    but gravity and what joints transmit.
    """
    frames, bodies = len(c), len(tree.arrays.parent)
    f, m = np.empty((frames, bodies, 3)), np.empty((frames, bodies, 3))
    R, p, tau = np.empty((frames, bodies, 3, 3)), np.empty((frames, bodies, 3)), np.empty_like(c)

    def part(start: int, stop: int) -> None:
        s = slice(start, stop)
        _joint_wrenches(tree.arrays, c[s], cdot[s], cddot[s], applied[s], f[s], m[s], tau[s], R[s], p[s])

    over_frames(part, frames)
    return JointWrenches(f, m, tau, R, p)


@kernel
def _joint_wrenches(T, c, cdot, cddot, applied, f, m, tau, R, p):
    n, axes = T.parent.shape[0], T.axis_kind.shape[0]
    w, o, dphi = np.empty((axes, 3)), np.empty((axes, 3)), np.empty((axes, 2))
    omega, v, alpha, a = np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3))
    for frame in range(c.shape[0]):
        body_poses(T, c[frame], R[frame], p[frame], w, o, dphi)
        body_rates(T, c[frame], cdot[frame], cddot[frame], p[frame], w, o, omega, v, alpha, a)
        body_wrenches(T, R[frame], p[frame], omega, alpha, a, f[frame], m[frame])
        for b in range(n):
            wrench = applied[frame, b]
            put_vector(f[frame], b, minus(vector(f[frame], b), (wrench[0], wrench[1], wrench[2])))
            put_vector(m[frame], b, minus(vector(m[frame], b), (wrench[3], wrench[4], wrench[5])))
        project(T, w, o, dphi, f[frame], m[frame], tau[frame])
