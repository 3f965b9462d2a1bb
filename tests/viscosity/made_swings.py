"""Swings of a made limb on a hinge or a ball, integrated here, as recordings with known truth."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from myomorph.core.model.inertia import inertia_matrices, parameters_of
from myomorph.swings.viscosity.swings.recording import SwingRecording

STEP = 0.01
GRAVITY = np.array([0.0, -9.81, 0.0])
MUSCLES = tuple(f"muscle {i}" for i in range(11))


@dataclass(frozen=True)
class Made:
    """A limb: damping and stiffness of every axis, viscosities of the muscles and how they pull."""

    damping: float = 0.05
    stiffness: float = 0.0
    viscosity: np.ndarray = field(default_factory=lambda: np.zeros(0))
    arms: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    bend: float = 0.0
    axis: np.ndarray | None = None
    mass: float = 2.0

    @property
    def parameters(self) -> np.ndarray:
        c = np.array([0.03, -0.42, 0.02])
        spread = np.array([[0.004, 0.001, 0.0], [0.001, 0.05, 0.002], [0.0, 0.002, 0.003]])
        pseudo = self.mass * np.block(
            [[spread + np.outer(c, c), c[:, None]], [c[None], np.ones((1, 1))]]
        )
        return parameters_of(pseudo)

    def lengthening(self, angles: np.ndarray) -> np.ndarray:
        """Return moment arms that change with the pose.

        Parameters
        ----------
        angles : (..., 3) [rad]

        Returns
        -------
        (..., muscles, 3) d(length)/d(angle) [m/rad]
        """
        turn = self.bend * np.roll(self.arms, 1, axis=1) * np.arange(1, len(self.arms) + 1)[:, None]
        return (
            self.arms
            + np.einsum(
                "...a,ma->...m", angles, np.cos(np.arange(3 * len(self.arms))).reshape(-1, 3)
            )[..., None]
            * turn
        )

    def passive(self, angles: np.ndarray, rates: np.ndarray) -> np.ndarray:
        """Return the torque of dampers, springs and viscous muscles.

        Parameters
        ----------
        angles : (..., 3) [rad]
        rates : (..., 3) [rad/s]

        Returns
        -------
        (..., 3) [N m]
        """
        J = self.lengthening(angles)
        speeds = np.einsum("...ma,...a->...m", J, rates)
        return (
            -self.damping * rates
            - self.stiffness * angles
            - np.einsum("...ma,m,...m->...a", J, self.viscosity, speeds)
        )


def skew(x: np.ndarray) -> np.ndarray:
    """Return the matrices of cross products with vectors.

    Parameters
    ----------
    x : (..., 3)

    Returns
    -------
    (..., 3, 3)
    """
    zero = np.zeros(x.shape[:-1])
    rows = [
        [zero, -x[..., 2], x[..., 1]],
        [x[..., 2], zero, -x[..., 0]],
        [-x[..., 1], x[..., 0], zero],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def inertia_columns(x: np.ndarray) -> np.ndarray:
    """Return I x as a linear function of I_xx, I_yy, I_zz, I_yz, I_zx, I_xy.

    Parameters
    ----------
    x : (..., 3)

    Returns
    -------
    (..., 3, 6)
    """
    zero = np.zeros(x.shape[:-1])
    a, b, c = np.moveaxis(x, -1, 0)
    rows = [[a, zero, zero, zero, c, b], [zero, b, zero, c, zero, a], [zero, zero, c, b, a, zero]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def limb_rows(
    rotations: np.ndarray, rates: np.ndarray, accelerations: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the rows of wrench and moment of the limb's inertial parameters.

    Parameters
    ----------
    rotations : (frames, 3, 3) of the limb in ground
    rates : (frames, 3) angular velocities in the limb [rad/s]
    accelerations : (frames, 3) angular accelerations in the limb [rad/s^2]

    Returns
    -------
    wrench (frames, 6, 10), moment and force in ground, and moment (frames, 3, 10) in the limb
    """
    frames = len(rotations)
    g = np.einsum("fji,j->fi", rotations, GRAVITY)
    force = np.zeros((frames, 3, 10))
    moment = np.zeros((frames, 3, 10))
    force[:, :, 0] = -g
    force[:, :, 1:4] = skew(accelerations) + skew(rates) @ skew(rates)
    moment[:, :, 1:4] = skew(g)
    moment[:, :, 4:] = inertia_columns(accelerations) + skew(rates) @ inertia_columns(rates)
    return np.concatenate([rotations @ moment, rotations @ force], axis=1), moment


def swing(
    made: Made, start: np.ndarray, rate: np.ndarray, seconds: float
) -> tuple[SwingRecording, ...]:
    """Simulate releases at 100 Hz.

    Accelerations are those of the states, so the equations hold exactly; the states are Runge and
    Kutta's.

    Parameters
    ----------
    made : limb and joint
    start : (releases, 3) rotation vectors [rad]
    rate : (releases, 3) angular velocities in the limb [rad/s]
    seconds : length of each release [s]

    Returns
    -------
    the recording of each release
    """
    I = inertia_matrices(made.parameters)
    h = made.parameters[1:4]
    inverse = np.linalg.inv(I)

    def acceleration(q, w):
        R = Rotation.from_quat(q)
        torque = made.passive(R.as_rotvec(), w) + np.cross(h, GRAVITY @ R.as_matrix())
        if made.axis is not None:
            return np.outer(torque @ made.axis / (made.axis @ I @ made.axis), made.axis)
        return (torque - np.cross(w, w @ I)) @ inverse

    def derivative(state):
        q = state[:, :4]
        w = state[:, 4:]
        turning = 0.5 * np.concatenate(
            [q[:, 3:] * w + np.cross(q[:, :3], w), -np.sum(q[:, :3] * w, 1)[:, None]], 1
        )
        return np.concatenate([turning, acceleration(q, w)], axis=1)

    time = np.arange(0.0, seconds, STEP)
    step = STEP
    state = np.concatenate([Rotation.from_rotvec(start).as_quat(), rate], axis=1)
    states = []
    for _ in time:
        states.append(state)
        first = derivative(state)
        second = derivative(state + 0.5 * step * first)
        third = derivative(state + 0.5 * step * second)
        fourth = derivative(state + step * third)
        state = state + step / 6.0 * (first + 2.0 * second + 2.0 * third + fourth)
    all_states = np.stack(states, axis=1)
    return tuple(
        _recorded(
            made,
            f"release {i}",
            time,
            Rotation.from_quat(one[:, :4]).as_matrix(),
            one[:, 4:],
            acceleration(one[:, :4], one[:, 4:]),
        )
        for i, one in enumerate(all_states)
    )


def _recorded(made, name, time, rotations, rates, accelerations, wrench=None) -> SwingRecording:
    """Equations of a motion; the wrench that it needs where none was measured."""
    rows, moments = limb_rows(rotations, rates, accelerations)
    angles = Rotation.from_matrix(rotations).as_rotvec()
    directions = np.eye(3) if made.axis is None else made.axis[None]
    turned = angles @ directions.T
    # A swing ends where the limb turns round, every second time.
    speed = rates @ (rates[len(rates) // 50] / np.linalg.norm(rates[len(rates) // 50]))
    turns = np.concatenate([[False], (speed[1:] > 0.0) != (speed[:-1] > 0.0)])
    return SwingRecording(
        name=name,
        time=time,
        wrench_rows=rows,
        wrench=rows @ made.parameters if wrench is None else wrench,
        torque_rows=directions @ moments,
        rates=rates @ directions.T,
        angles=turned,
        axes=("x", "y", "z") if made.axis is None else ("hinge",),
        muscles=MUSCLES[: len(made.arms)],
        lengthening=made.lengthening(angles) @ directions.T,
        rotations=rotations,
        gravity=GRAVITY.copy(),
        swing=np.cumsum(turns) // 2,
    )


def eleven(random: np.random.Generator, bend: float = 0.3) -> dict:
    """Muscles that pull every way."""
    return {
        "arms": 0.02 * random.normal(size=(11, 3)),
        "viscosity": np.full(11, 120.0),
        "bend": bend,
    }


def three_releases(made: Made, seconds: float = 6.0) -> tuple[SwingRecording, ...]:
    if made.axis is not None:
        return swing(made, np.outer([0.7, 1.0, -0.8], made.axis), np.zeros((3, 3)), seconds)
    starts = np.array([[0.7, 0.1, 0.2], [0.1, 0.3, 0.8], [-0.5, -0.4, 0.5]])
    return swing(
        made, starts, np.array([[0.2, 1.5, 0.1], [0.1, -2.0, 0.2], [0.0, 1.0, -0.2]]), seconds
    )
