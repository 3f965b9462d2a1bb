"""What a passive joint may do: damping, stiffness and friction, along the joint's free axes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from myomorph.model.arrays import Array

WIDTH = 0.1
"""Angular velocity within which Coulomb friction turns its sign [rad/s]: about what the rate changes by at a turn in
the 20 ms over which a low-pass of 8 Hz spreads the jump of the measured torque."""


@dataclass(frozen=True, eq=False)
class PassiveLaw:
    """Torque of a joint from its angles and rates.

        tau = -d w - k theta + s - c w / sqrt(|w|^2 + width^2) - e |w| w - d_M J_M^T J_M w

    For a ball w and theta have three components and friction acts against the direction of w; d and k may
    differ by axis. The spring is linear in the rotation vector from wherever angles are counted.

    Attributes
    ----------
    viscosity : d (axes,) [N m s/rad]
    stiffness : k (axes,) [N m/rad]
    rest_moment : s = k theta_0 (axes,), theta_0 the angle where the spring is at rest [N m]
    coulomb : c [N m]
    quadratic : e [N m s^2/rad^2]
    muscle : d_M, the same for every muscle [N s/m]
    width : [rad/s]
    """

    viscosity: Array
    stiffness: Array
    rest_moment: Array
    coulomb: float
    quadratic: float
    muscle: float
    width: float = WIDTH

    @classmethod
    def of(cls, coefficients: Array, width: float = WIDTH) -> PassiveLaw:
        """The law with coefficients (3 axes + 3,) in the order of its attributes."""
        *first, c, e, muscle = np.asarray(coefficients, dtype=np.float64)
        d, k, s = np.reshape(first, (3, -1))
        return cls(d, k, s, float(c), float(e), float(muscle), width)

    @property
    def coefficients(self) -> Array:
        """(3 axes + 3,) the attributes in their order, without the width."""
        last = [self.coulomb, self.quadratic, self.muscle]
        return np.concatenate([self.viscosity, self.stiffness, self.rest_moment, last])

    def torque(self, angles: Array, rates: Array, lengthening: Array) -> Array:
        """Torque (frames, axes) [N m] at angles and rates (frames, axes), lengthening (frames, muscles, axes)."""
        return -resistances(angles, rates, lengthening, self.width) @ self.coefficients

    def values(self, axis: Array) -> Array:
        """(13,) numbers of the law in the limb's axes; `axis` (3,) of a hinge, zeros for a ball."""
        each = [np.broadcast_to(one, (3,)) for one in (self.viscosity, self.stiffness)]
        rest = self.rest_moment * axis if axis.any() else self.rest_moment
        return np.concatenate([*each, rest, [self.coulomb, self.width, self.quadratic, self.muscle]])

    def fastest(self, rate: float, lengthening: Array) -> float:
        """A bound of the slope of torque against rate [N m s/rad] at rates up to `rate` [rad/s]."""
        arms = float(np.square(lengthening).sum(axis=(1, 2)).max(initial=0.0))
        slope = self.coulomb / self.width + 2.0 * self.quadratic * rate + self.muscle * arms
        return float(self.viscosity.max()) + slope


def resistances(angles: Array, rates: Array, lengthening: Array, width: float) -> Array:
    """(frames, axes, 3 axes + 3) what each coefficient of a law adds to the torque against the motion."""
    frames, axes = rates.shape
    columns = np.zeros((frames, axes, 3 * axes + 3))
    speed = np.linalg.norm(rates, axis=1)[:, None]
    each = np.arange(axes)
    columns[:, each, each] = rates
    columns[:, each, axes + each] = angles
    columns[:, each, 2 * axes + each] = -1.0
    columns[:, :, -3] = rates / np.hypot(speed, width)
    columns[:, :, -2] = speed * rates
    speeds = np.einsum("fma,fa->fm", lengthening, rates)
    columns[:, :, -1] = np.einsum("fma,fm->fa", lengthening, speeds)
    return columns
