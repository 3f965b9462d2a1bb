"""Limbs with passive laws, swung by a plain integrator.

They are written as the equations that identification takes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.spatial.transform import Rotation

from myomorph.core.model.arrays import Array
from myomorph.core.model.inertia import inertia_matrices
from myomorph.swings.viscosity.swings.recording import SwingRecording
from myomorph.swings.viscosity.trust.law import PassiveLaw, hinge_slopes, resistances
from truths.mechanical_joint import moment_rows

GRAVITY = np.array([0.0, -9.81, 0.0])
LIMB = np.array([2.4, 0.05, -0.95, 0.03, 0.47, 0.012, 0.468, 0.018, 0.002, 0.021])
"""Mass, first moment and inertia about the joint of something like an arm that hangs along -y."""
LAWS: dict[str, dict[str, float | Array]] = {
    "viscosity": {"viscosity": 0.06},
    "axes": {"viscosity": np.array([0.03, 0.05, 0.09])},
    "spring": {"viscosity": 0.04, "stiffness": 1.5},
    "friction": {"viscosity": 0.03, "coulomb": 0.04},
    "drag": {"viscosity": 0.03, "quadratic": 0.02},
    "muscles": {"viscosity": 0.03, "muscle": 90.0},
    "hinges": {"hinges": np.array([0.03, 0.08, 0.05])},
}
HINGES = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""First axis in ground, last in the limb."""
STARTS = ([0.8, 0.2, 0.3], [-0.3, 0.5, 0.9])
RATES = ([0.5, 2.0, 0.0], [1.0, -3.0, 0.4])
MUSCLES = ("deltoid", "supraspinatus", "teres", "biceps")


def law(axes: int = 3, **terms: float | Array) -> PassiveLaw:
    """Make a law of the given terms, all others zero."""
    return PassiveLaw(
        viscosity=np.broadcast_to(terms.get("viscosity", 0.0), (axes,)),
        stiffness=np.broadcast_to(terms.get("stiffness", 0.0), (axes,)),
        rest_moment=np.broadcast_to(terms.get("rest_moment", 0.0), (axes,)),
        coulomb=float(terms.get("coulomb", 0.0)),
        quadratic=float(terms.get("quadratic", 0.0)),
        muscle=float(terms.get("muscle", 0.0)),
        hinges=np.asarray(terms.get("hinges", np.zeros(3))),
    )


@lru_cache(maxsize=1)
def released() -> dict[str, list[SwingRecording]]:
    """Two releases under each of `LAWS`."""
    each = [law(**terms) for terms in LAWS.values() for _ in STARTS]
    made = swung(each, len(LAWS) * STARTS, len(LAWS) * RATES)
    return {name: made[2 * i : 2 * i + 2] for i, name in enumerate(LAWS)}


def moment_arms(angles: Array) -> Array:
    """Return moment arms that change with the pose.

    Parameters
    ----------
    angles : (frames, 3) [rad]

    Returns
    -------
    (frames, muscles, 3) d(length)/d(angle) [m/rad]
    """
    level = np.array(
        [
            [0.02, 0.004, -0.012],
            [-0.015, 0.006, 0.018],
            [0.011, -0.013, 0.008],
            [-0.008, 0.01, -0.016],
        ]
    )
    return level + 0.004 * np.sin(angles[:, None, :] + np.arange(4)[:, None])


@dataclass(frozen=True, kw_only=True, eq=False)
class Setup:
    """How limbs swing.

    Attributes
    ----------
    axis : (3,) of a hinge, None for a ball joint
    seconds : length of a recording [s]
    rate : of its frames, a divisor of 200 [Hz]
    muscles : whether the limbs have the four of `MUSCLES`
    """

    axis: Array | None = None
    seconds: float = 7.0
    rate: float = 100.0
    muscles: bool = True

    @property
    def directions(self) -> Array:
        """(axes, 3) about which the limb turns."""
        return np.eye(3) if self.axis is None else self.axis[None]

    def arms(self, angles: Array) -> Array:
        """Return moment arms about the axes.

        Parameters
        ----------
        angles : (frames, 3) [rad]

        Returns
        -------
        (frames, muscles, axes) [m/rad]
        """
        if not self.muscles:
            return np.zeros((len(angles), 0, len(self.directions)))
        return moment_arms(angles) @ self.directions.T


BALL = Setup()


def swung(
    laws: Sequence[PassiveLaw],
    starts: Sequence[Array],
    rates: Sequence[Array],
    setup: Setup = BALL,
) -> list[SwingRecording]:
    """Simulate exact recordings of limbs let go at rotation vectors from hanging.

    All are simulated at once: the classical Runge-Kutta method of order 4 on quaternions, steps of
    5 ms.

    Parameters
    ----------
    laws : of each limb
    starts : (3,) rotation vector of each from hanging [rad]
    rates : (3,) angular velocity of each along the limb's axes [rad/s]
    setup : axis, muscles and sampling

    Returns
    -------
    the recording of each limb
    """
    limbs = _Limbs(laws, setup)
    quaternions = (limbs.hanging * Rotation.from_rotvec(np.array(starts))).as_quat()
    states = _integrated(limbs, np.hstack([quaternions, np.array(rates, dtype=float)]))
    return [
        _recording(number, limbs, path) for number, path in enumerate(np.swapaxes(states, 0, 1))
    ]


class _Limbs:
    """Equations of motion of limbs with different laws, side by side.

    Attributes
    ----------
    hanging : the rotation in which the limb hangs
    """

    def __init__(self, laws: Sequence[PassiveLaw], setup: Setup) -> None:
        self.setup = setup
        self.width = laws[0].width
        self.coefficients = np.array([one.coefficients for one in laws])
        self.inertia = inertia_matrices(LIMB)
        self.hanging = Rotation.align_vectors([np.array(GRAVITY)], [LIMB[1:4]])[0]

    def angles(self, rotation: Rotation) -> Array:
        """Return rotation vectors (frames, 3) from hanging [rad]."""
        return (self.hanging.inv() * rotation).as_rotvec()

    def acceleration(self, q: Array, w: Array, coefficients: Array) -> Array:
        """Return angular accelerations in the limb.

        Parameters
        ----------
        q, w : (rows, 4) quaternions and (rows, 3) angular velocities [rad/s]
        coefficients : (rows, terms) of the law of each row

        Returns
        -------
        (rows, 3) [rad/s^2]
        """
        axis = self.setup.axis
        turn = self.setup.directions
        rotation = Rotation.from_quat(q)
        angles = self.angles(rotation)
        slopes = hinge_slopes(rotation.as_matrix(), HINGES) if axis is None else None
        columns = resistances(
            angles @ turn.T, w @ turn.T, self.setup.arms(angles), self.width, slopes
        )
        torque = -np.einsum("fac,fc->fa", columns, coefficients) @ turn
        weight = np.cross(LIMB[1:4], rotation.apply(np.array(GRAVITY), inverse=True))
        torque = torque + weight - np.cross(w, w @ self.inertia)
        if axis is None:
            return torque @ np.linalg.inv(self.inertia)
        return np.outer(torque @ axis / (axis @ self.inertia @ axis), axis)

    def slope(self, state: Array) -> Array:
        """Return the derivative of states (limbs, 7), quaternion and angular velocity."""
        vector = state[:, :3]
        scalar = state[:, 3:4]
        w = state[:, 4:]
        turning = np.hstack(
            [scalar * w + np.cross(vector, w), -np.sum(vector * w, axis=1, keepdims=True)]
        )
        return np.hstack([0.5 * turning, self.acceleration(state[:, :4], w, self.coefficients)])


def _integrated(limbs: _Limbs, state: Array) -> list[Array]:
    """Return states (limbs, 7) at each frame from the first one."""
    every = round(200.0 / limbs.setup.rate)
    states = []
    for i in range(round(200.0 * limbs.setup.seconds)):
        if i % every == 0:
            states.append(state)
        a = limbs.slope(state)
        b = limbs.slope(state + 0.0025 * a)
        c = limbs.slope(state + 0.0025 * b)
        d = limbs.slope(state + 0.005 * c)
        state = state + 0.005 / 6.0 * (a + 2.0 * b + 2.0 * c + d)
    return states


def _recording(number: int, limbs: _Limbs, path: Array) -> SwingRecording:
    """Write the states (frames, 7) of a limb as equations."""
    setup = limbs.setup
    turn = setup.directions
    w = path[:, 4:]
    rotations = Rotation.from_quat(path[:, :4])
    law_terms = np.tile(limbs.coefficients[number], (len(path), 1))
    accelerations = limbs.acceleration(path[:, :4], w, law_terms)
    moment, force = moment_rows(rotations.as_matrix(), w, accelerations, np.array(GRAVITY))
    rows = [np.einsum("fij,fjp->fip", rotations.as_matrix(), one) for one in (moment, force)]
    wrench_rows = np.concatenate(rows, axis=1)
    angles = limbs.angles(rotations)
    time = np.arange(len(path)) / setup.rate
    period = 2.0 * np.pi * np.sqrt(limbs.inertia[0, 0] / (np.linalg.norm(LIMB[1:4]) * 9.81))
    return SwingRecording(
        name=f"release {number + 1}",
        time=time,
        wrench_rows=wrench_rows,
        wrench=wrench_rows @ LIMB,
        torque_rows=np.einsum("ai,fip->fap", turn, moment),
        rates=w @ turn.T,
        angles=angles @ turn.T,
        axes=("x", "y", "z") if setup.axis is None else ("flexion",),
        muscles=MUSCLES if setup.muscles else (),
        lengthening=setup.arms(angles),
        rotations=rotations.as_matrix(),
        gravity=np.array(GRAVITY),
        swing=np.floor(time / period).astype(int),
        hinges=HINGES if setup.axis is None else np.zeros((0, 3)),
    )
