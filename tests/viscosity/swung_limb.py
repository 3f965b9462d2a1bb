"""Limbs with passive laws, swung by a plain integrator.

They are written as the equations that identification takes.
"""

from __future__ import annotations

from collections.abc import Sequence
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


def swung(
    laws: Sequence[PassiveLaw],
    starts: Sequence[Array],
    rates: Sequence[Array],
    *,
    axis: Array | None = None,
    seconds: float = 7.0,
    rate: float = 100.0,
    muscles: bool = True,
) -> list[SwingRecording]:
    """Simulate exact recordings of limbs let go at rotation vectors from hanging.

    Rates are along their axes. All are simulated at once: the classical Runge-Kutta method of order
    4 on quaternions, steps of 5 ms.
    """
    inertia = inertia_matrices(LIMB)
    h = LIMB[1:4]
    gravity = np.array(GRAVITY)
    hanging = Rotation.align_vectors([gravity], [h])[0]
    upright = hanging.inv()
    turn = np.eye(3) if axis is None else axis[None]
    coefficients = np.array([one.coefficients for one in laws])

    def arms(angles: Array) -> Array:
        return moment_arms(angles) @ turn.T if muscles else np.zeros((len(angles), 0, len(turn)))

    def acceleration(q: Array, w: Array) -> Array:
        rotation = Rotation.from_quat(q)
        angles = (upright * rotation).as_rotvec()
        slopes = hinge_slopes(rotation.as_matrix(), HINGES) if axis is None else None
        columns = resistances(angles @ turn.T, w @ turn.T, arms(angles), laws[0].width, slopes)
        torque = -np.einsum("fac,fc->fa", columns, coefficients) @ turn
        torque = (
            torque + np.cross(h, rotation.apply(gravity, inverse=True)) - np.cross(w, w @ inertia)
        )
        if axis is None:
            return torque @ np.linalg.inv(inertia)
        return np.outer(torque @ axis / (axis @ inertia @ axis), axis)

    def slope(state: Array) -> Array:
        vector = state[:, :3]
        scalar = state[:, 3:4]
        w = state[:, 4:]
        turning = np.hstack(
            [scalar * w + np.cross(vector, w), -np.sum(vector * w, axis=1, keepdims=True)]
        )
        return np.hstack([0.5 * turning, acceleration(state[:, :4], w)])

    every = round(200.0 / rate)
    state = np.hstack(
        [(hanging * Rotation.from_rotvec(np.array(starts))).as_quat(), np.array(rates, dtype=float)]
    )
    states = []
    for i in range(round(200.0 * seconds)):
        if i % every == 0:
            states.append(state)
        a = slope(state)
        b = slope(state + 0.0025 * a)
        c = slope(state + 0.0025 * b)
        d = slope(state + 0.005 * c)
        state = state + 0.005 / 6.0 * (a + 2.0 * b + 2.0 * c + d)
    time = np.arange(len(states)) / rate
    made = []
    for number, path in enumerate(np.swapaxes(states, 0, 1)):
        coefficients = np.tile(laws[number].coefficients, (len(path), 1))
        q = path[:, :4]
        w = path[:, 4:]
        rotations = Rotation.from_quat(q)
        moment, force = moment_rows(rotations.as_matrix(), w, acceleration(q, w), gravity)
        rows = [np.einsum("fij,fjp->fip", rotations.as_matrix(), one) for one in (moment, force)]
        wrench_rows = np.concatenate(rows, axis=1)
        angles = (upright * rotations).as_rotvec()
        period = 2.0 * np.pi * np.sqrt(inertia[0, 0] / (np.linalg.norm(h) * 9.81))
        made.append(
            SwingRecording(
                name=f"release {number + 1}",
                time=time,
                wrench_rows=wrench_rows,
                wrench=wrench_rows @ LIMB,
                torque_rows=np.einsum("ai,fip->fap", turn, moment),
                rates=w @ turn.T,
                angles=angles @ turn.T,
                axes=("x", "y", "z") if axis is None else ("flexion",),
                muscles=MUSCLES if muscles else (),
                lengthening=arms(angles),
                rotations=rotations.as_matrix(),
                gravity=np.array(gravity),
                swing=np.floor(time / period).astype(int),
                hinges=HINGES if axis is None else np.zeros((0, 3)),
            )
        )
    return made
