"""Velocities and accelerations of bodies over frames, in ground."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from myomorph.model.arrays import Array, read_only
from myomorph.rigid.coordinates import Ints
from myomorph.rigid.frames import over_frames
from myomorph.rigid.kernels import kernel
from myomorph.rigid.kinematics import body_poses, body_rates
from myomorph.rigid.tree import Tree


@read_only
@dataclass(frozen=True, eq=False)
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
    """Poses, velocities and accelerations of all bodies.
    `c`, `cdot`, `cddot` (frames, coordinates) consistent, as of `rigid.dynamics.motion_arrays`.
    """
    frames, bodies = len(c), len(tree.arrays.parent)
    arrays = [np.array(values, dtype=np.float64, order="C") for values in (c, cdot, cddot)]
    R = np.empty((frames, bodies, 3, 3))
    p, omega, v, alpha, a = (np.empty((frames, bodies, 3)) for _ in range(5))

    def part(start: int, stop: int) -> None:
        s = slice(start, stop)
        _body_motion(tree.arrays, *(values[s] for values in arrays), R[s], p[s], omega[s], v[s], alpha[s], a[s])

    over_frames(part, frames)
    return BodyMotion(R, p, omega, alpha, v, a)


@kernel
def _body_motion(T, c, cdot, cddot, R, p, omega, v, alpha, a):
    axes = T.axis_kind.shape[0]
    w, o, dphi = np.empty((axes, 3)), np.empty((axes, 3)), np.empty((axes, 2))
    for frame in range(c.shape[0]):
        body_poses(T, c[frame], R[frame], p[frame], w, o, dphi)
        body_rates(
            T, c[frame], cdot[frame], cddot[frame], p[frame], w, o, omega[frame], v[frame], alpha[frame], a[frame]
        )
