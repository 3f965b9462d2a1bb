"""The equation of motion of one coordinate while all others move as measured, and its swing.

    M(q, t) q'' + c_2(q, t) q'^2 + c_1(q, t) q' + c_0(q, t) = tau(q, q')

Inverse dynamics is of this form for any tree of bodies. M and the c are polynomials of q in every
frame, so that a swing costs microseconds and can be fitted.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion
from myomorph.core.rigid.coordinates import gather_dependents
from myomorph.core.rigid.dynamics import inverse_dynamics
from myomorph.core.rigid.kernels import inner, kernel
from myomorph.core.rigid.tree import compile_tree
from myomorph.swings.viscosity.trust.law import PassiveLaw

DEGREE = 8  # Of the polynomials: a sine over 140 degrees is met to 1e-6.
# How far the polynomials go beyond half of what was measured, as the swings of a search may.
BEYOND = 1.2
STEP = 0.005  # Longest step of the integration [s].


@read_only
class SwingEquation:
    """M, c_0, c_1, c_2 of every frame as polynomials of x = (q - middle) / half.

    Attributes
    ----------
    time : (frames,) at equal steps [s]
    middle, half : of the angles [rad]
    terms : (frames, 4, degree + 1)
    """

    time: Array
    middle: float
    half: float
    terms: Array

    def torque(self, angles: Array, rates: Array, accelerations: Array) -> Array:
        """Find the torque of the joint in a motion of the coordinate.

        Parameters
        ----------
        angles, rates, accelerations : (frames,) [rad], [rad/s], [rad/s^2]

        Returns
        -------
        (frames,) [N m]
        """
        x = (angles - self.middle) / self.half
        M, c0, c1, c2 = np.einsum("ftd,fd->tf", self.terms, x[:, None] ** np.arange(DEGREE + 1))
        return M * accelerations + c0 + (c1 + c2 * rates) * rates

    def scaled(self, inertia: float, gravity: float) -> SwingEquation:
        """Make the equation of a limb of other inertia and weight.

        Parameters
        ----------
        inertia : factor of the inertia
        gravity : factor of mass times the center's distance
        """
        return replace(
            self, terms=self.terms * np.array([inertia, gravity, inertia, inertia])[:, None]
        )

    def swing(self, start: int, stop: int, angle: float, rate: float, law: PassiveLaw) -> Array:
        """Swing from a state at a frame, by Runge-Kutta of order 4.

        Parameters
        ----------
        start, stop : frames
        angle, rate : at the start [rad], [rad/s]
        law : of the joint

        Returns
        -------
        (stop - start,) angles [rad]
        """
        coefficients = np.array([*law.coefficients[:5], law.width])
        step = float(self.time[1] - self.time[0])
        angles = np.empty(stop - start)
        _swing(
            self.terms[start:stop], self.middle, self.half, step, angle, rate, coefficients, angles
        )
        return angles


def swing_equation(model: Model, coordinate: str, motion: Motion) -> SwingEquation:
    """Make the equation of a coordinate of a model in a motion.

    Parameters
    ----------
    model : with masses
    coordinate : that swings
    motion : with derivatives; that of the coordinate itself only says how far the polynomials reach

    Raises
    ------
    BadData : frames are not at equal steps
    """
    steps = np.diff(motion.time)
    if len(steps) < 2 or steps.max() - steps.min() > 0.01 * steps.mean():
        raise BadData("a swing needs frames at equal steps of time: resample the recording")
    column = motion.names.index(coordinate)
    seen = motion.values[:, column]
    middle = 0.5 * (np.nanmax(seen) + np.nanmin(seen))
    half = 0.5 * BEYOND * max(float(np.ptp(seen)), 0.1)
    nodes = np.cos(np.pi * (np.arange(DEGREE + 1) + 0.5) / (DEGREE + 1))
    torques = np.array(
        [
            [_torque(model, motion, column, middle + half * x, *rates) for x in nodes]
            for rates in RATES
        ]
    )
    resting, forwards, backwards, accelerated = torques
    terms = np.array(
        [
            accelerated - resting,
            resting,
            0.5 * (forwards - backwards),
            0.5 * (forwards + backwards) - resting,
        ]
    )
    powers = np.linalg.inv(nodes[:, None] ** np.arange(DEGREE + 1))
    return SwingEquation(
        time=motion.time,
        middle=float(middle),
        half=float(half),
        terms=np.einsum("dn,tnf->ftd", powers, terms),
    )


RATES = ((0.0, 0.0), (1.0, 0.0), (-1.0, 0.0), (0.0, 1.0))
"""Rate and acceleration [rad/s], [rad/s^2] from whose torques the terms of the equation follow."""


def _torque(
    model: Model, motion: Motion, column: int, angle: float, rate: float, acceleration: float
) -> Array:
    """Find the torque of a coordinate that stands or moves so, all others as they did.

    Parameters
    ----------
    column : of the coordinate in the motion
    angle, rate, acceleration : the same in every frame [rad], [rad/s], [rad/s^2]

    Returns
    -------
    (frames,) [N m]
    """
    assert motion.velocities is not None
    assert motion.accelerations is not None
    values = np.array(motion.values)
    values[:, column] = angle
    velocities = np.array(motion.velocities)
    velocities[:, column] = rate
    accelerations = np.array(motion.accelerations)
    accelerations[:, column] = acceleration
    moved = Motion(
        time=motion.time,
        names=motion.names,
        values=values,
        velocities=velocities,
        accelerations=accelerations,
    )
    torques = np.array(inverse_dynamics(model, moved).values)
    tree = compile_tree(model)
    for frame, pose in enumerate(tree.coordinates_of(moved)):
        gather_dependents(tree.arrays, pose, torques[frame : frame + 1])
    return torques[:, model.coordinate_names.index(motion.names[column])]


@inner(fastmath=True)
def _acceleration(terms, share, frame, middle, half, angle, rate, law):
    """Find q'' at a share of the way from a frame to the next."""
    x = min(max((angle - middle) / half, -1.0), 1.0)
    M = 0.0
    c0 = 0.0
    c1 = 0.0
    c2 = 0.0
    for i in range(1 if share == 0.0 else 2):
        at = terms[min(frame + i, terms.shape[0] - 1)]
        m = 0.0
        b0 = 0.0
        b1 = 0.0
        b2 = 0.0
        for d in range(terms.shape[2] - 1, -1, -1):
            m = m * x + at[0, d]
            b0 = b0 * x + at[1, d]
            b1 = b1 * x + at[2, d]
            b2 = b2 * x + at[3, d]
        part = share if i == 1 else 1.0 - share
        M = M + part * m
        c0 = c0 + part * b0
        c1 = c1 + part * b1
        c2 = c2 + part * b2
    tau = -law[0] * rate - law[1] * angle + law[2]
    tau -= law[3] * rate / np.sqrt(rate * rate + law[5] * law[5]) + law[4] * abs(rate) * rate
    return (tau - c0 - (c1 + c2 * rate) * rate) / M


@kernel(fastmath=True)
def _swing(terms, middle, half, step, angle, rate, law, angles):
    """Fill angles (frames,) of the swing from its first frame."""
    count = max(1, int(np.ceil(step / STEP)))
    h = step / count
    angles[0] = angle
    for frame in range(len(angles) - 1):
        for i in range(count):
            s = i / count
            m = s + 0.5 / count
            e = s + 1.0 / count
            a1 = _acceleration(terms, s, frame, middle, half, angle, rate, law)
            r2 = rate + 0.5 * h * a1
            a2 = _acceleration(terms, m, frame, middle, half, angle + 0.5 * h * rate, r2, law)
            r3 = rate + 0.5 * h * a2
            a3 = _acceleration(terms, m, frame, middle, half, angle + 0.5 * h * r2, r3, law)
            r4 = rate + h * a3
            a4 = _acceleration(terms, e, frame, middle, half, angle + h * r3, r4, law)
            angle += h * (rate + 2.0 * r2 + 2.0 * r3 + r4) / 6.0
            rate += h * (a1 + 2.0 * a2 + 2.0 * a3 + a4) / 6.0
        angles[frame + 1] = angle
