"""A limb that swings freely on a ball or a hinge, forward in time.

Swings that were left out of a fit are predicted so.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.inertia import inertia_matrices
from myomorph.core.rigid.kernels import inner, kernel
from myomorph.core.rigid.vectors import (
    along,
    cross,
    dot,
    matrix,
    minus,
    norm,
    plus,
    product,
    put_matrix,
    put_vector,
    turned,
    turned_back,
    unit,
    vector,
)
from myomorph.swings.viscosity.swings.recording import SwingRecording
from myomorph.swings.viscosity.swings.sums import SwingSums, free_directions
from myomorph.swings.viscosity.trust.law import SINGULAR, PassiveLaw

# Largest product of step and the law's fastest rate of decay; RK4 is stable to 2.8.
DECAY_A_STEP = 0.25


@read_only
class SwingMotion:
    """A window of a swing, measured or predicted.

    Attributes
    ----------
    time : (frames,) [s]
    rotations : (frames, 3, 3) of the limb's first body in ground
    rates : (frames, 3) in that body's axes [rad/s]
    wrench : (frames, 6) on the base, about the joint's center and in ground axes [N m], [N]
    """

    time: Array
    rotations: Array
    rates: Array
    wrench: Array


def swing_forward(
    recording: SwingRecording, frames: slice, parameters: Array, law: PassiveLaw
) -> SwingMotion:
    """Swing a rigid limb with a passive law from the state of a window's first frame.

        I w' + w x I w - h x R^T g = tau(angles, w),    R' = R [w]x

    about the joint's center in the limb's axes, h = m c (Newton-Euler); a hinge keeps the component
    along its axis. Runge-Kutta of order 4, each frame (of equal steps of time) in as many steps as
    the law needs. Moment arms, where the law has muscles, are those of the measured pose of the
    same moment.

    Parameters
    ----------
    recording : with the window
    frames : of the window
    parameters : (10,) of the limb
    law : of the joint

    Returns
    -------
    the window as it would have swung

    Raises
    ------
    BadData : frames are not at equal steps, or the inertia is not positive
    """
    time = recording.time[frames]
    steps = np.diff(time)
    if len(time) < 2 or steps.max() - steps.min() > 1e-3 * steps.mean():
        raise BadData(
            f"swing '{recording.name}': a prediction needs at least 2 frames at equal steps of time"
        )
    inertia = inertia_matrices(parameters)
    axis = hinge_axis(recording)
    least = float(axis @ inertia @ axis) if axis.any() else float(np.linalg.eigvalsh(inertia)[0])
    if not least > 0.0:
        raise BadData(
            f"swing '{recording.name}': the limb's identified inertia, {least:.2g} kg m^2, is not"
            " positive"
        )
    turn = axis[:, None] if axis.any() else np.eye(3)
    hinges = recording.hinges if len(recording.hinges) else np.zeros((2, 3))
    fastest = (
        law.fastest(float(np.abs(recording.rates[frames]).max()), recording.lengthening[frames])
        / least
    )
    substeps = max(1, int(np.ceil(steps.mean() * fastest / DECAY_A_STEP)))
    first = recording.rotations[frames][0]
    rest = first @ Rotation.from_rotvec(turn @ recording.angles[frames][0]).as_matrix().T
    rotations, rates, accelerations = _forward(
        float(steps.mean()),
        substeps,
        np.stack([first, rest, inertia, np.linalg.inv(inertia)]),
        np.stack(
            [turn @ recording.rates[frames][0], parameters[1:4], recording.gravity, axis, *hinges]
        ),
        law.values(axis),
        recording.lengthening[frames] @ turn.T,
    )
    wrench = base_wrench(rotations, rates, accelerations, parameters, recording.gravity)
    return SwingMotion(
        time=time, rotations=rotations, rates=rates, wrench=sense(recording) * wrench
    )


def measured_motion(recording: SwingRecording, frames: slice) -> SwingMotion:
    """Take a window as it was measured."""
    axis = hinge_axis(recording)
    turn = axis[:, None] if axis.any() else np.eye(3)
    rates = recording.rates[frames] @ turn.T
    return SwingMotion(
        time=recording.time[frames],
        rotations=recording.rotations[frames],
        rates=rates,
        wrench=recording.wrench[frames],
    )


def base_wrench(
    rotations: Array, rates: Array, accelerations: Array, parameters: Array, gravity: Array
) -> Array:
    """Find the wrench that carries a moving limb.

    Parameters
    ----------
    rotations : (frames, 3, 3) of the limb
    rates, accelerations : (frames, 3) along the limb's axes [rad/s], [rad/s^2]
    parameters : (10,) of the limb
    gravity : (3,) in ground [m/s^2]

    Returns
    -------
    (frames, 6) moment about its center of rotation, force, in ground axes [N m], [N]
    """
    inertia = inertia_matrices(parameters)
    first_moment = parameters[1:4]
    mass = parameters[0]
    moment = accelerations @ inertia + np.cross(rates, rates @ inertia)
    force = np.cross(accelerations, first_moment) + np.cross(rates, np.cross(rates, first_moment))
    ground = np.einsum("fij,fj->fi", rotations, moment) - np.cross(
        rotations @ first_moment, gravity
    )
    return np.hstack([ground, np.einsum("fij,fj->fi", rotations, force) - mass * gravity])


def sense(recording: SwingRecording) -> float:
    """Return 1 where a wrench is what carries the limb, -1 where it acts on the limb's base."""
    return float(np.sign(-np.mean(recording.wrench_rows[:, 3:, 0], axis=0) @ recording.gravity))


def hinge_axis(recording: SwingRecording) -> Array:
    """Find the unit axis of a hinge in the limb's axes.

    Parameters
    ----------
    recording : of a swing

    Returns
    -------
    (3,) zeros for a ball
    """
    if len(recording.axes) != 1:
        return np.zeros(3)
    axis = free_directions([recording])[0]
    return axis / np.linalg.norm(axis)


def angles_apart(a: Array, b: Array) -> Array:
    """Find the angles of the rotations between two series of rotations.

    Parameters
    ----------
    a, b : (frames, 3, 3)

    Returns
    -------
    (frames,) [rad]
    """
    return Rotation.from_matrix(np.swapaxes(a, 1, 2) @ b).magnitude()


@kernel
def _forward(step, substeps, matrices, vectors, law, lengthening):  # page: four stages of a step
    """Fill rotations, rates and accelerations of every frame.

    `matrices` are the first pose, the pose at rest, inertia and its inverse; `vectors` the first
    rates, first moment, gravity, axis of the hinge or zeros, first and last of three.
    """
    frames = len(lengthening)
    rotations = np.empty((frames, 3, 3))
    rates = np.empty((frames, 3))
    accelerations = np.empty((frames, 3))
    r = matrix(matrices, 0)
    w = vector(vectors, 0)
    h = step / substeps
    for i in range(frames):
        put_matrix(rotations, i, r)
        put_vector(rates, i, w)
        put_vector(
            accelerations, i, _acceleration(r, w, float(i), matrices, vectors, law, lengthening)
        )
        for s in range(substeps if i < frames - 1 else 0):
            at = i + s / substeps
            a1 = _acceleration(r, w, at, matrices, vectors, law, lengthening)
            t1 = _turning(r, w)
            r2 = _added(r, 0.5 * h, t1)
            w2 = along(w, 0.5 * h, a1)
            middle = at + 0.5 / substeps
            a2 = _acceleration(r2, w2, middle, matrices, vectors, law, lengthening)
            t2 = _turning(r2, w2)
            r3 = _added(r, 0.5 * h, t2)
            w3 = along(w, 0.5 * h, a2)
            a3 = _acceleration(r3, w3, middle, matrices, vectors, law, lengthening)
            t3 = _turning(r3, w3)
            r4 = _added(r, h, t3)
            w4 = along(w, h, a3)
            end = at + 1.0 / substeps
            a4 = _acceleration(r4, w4, end, matrices, vectors, law, lengthening)
            t4 = _turning(r4, w4)
            w = along(along(w, h / 6.0, plus(a1, a4)), h / 3.0, plus(a2, a3))
            r = _added(
                _added(_added(_added(r, h / 6.0, t1), h / 3.0, t2), h / 3.0, t3), h / 6.0, t4
            )
            r = _orthonormal(r)
    return rotations, rates, accelerations


@inner
def _acceleration(r, w, at, matrices, vectors, law, lengthening):  # page: tuples in a kernel
    """Find the angular acceleration at a time counted in frames.

    The order of `law` is that of `PassiveLaw.values`.
    """
    speed = norm(w)
    friction = law[9] / math.sqrt(speed * speed + law[10] * law[10]) + law[11] * speed
    angles = _rotation_vector(product(_transposed(matrix(matrices, 1)), r))
    tx = law[6] - (law[0] + friction) * w[0] - law[3] * angles[0]
    ty = law[7] - (law[1] + friction) * w[1] - law[4] * angles[1]
    tz = law[8] - (law[2] + friction) * w[2] - law[5] * angles[2]
    i = min(int(at), len(lengthening) - 2)
    x = at - i
    for m in range(lengthening.shape[1] if law[12] != 0.0 else 0):
        arm = vector(lengthening[i], m)
        arm = along(arm, x, minus(vector(lengthening[i + 1], m), arm))
        pull = law[12] * dot(arm, w)
        tx = tx - pull * arm[0]
        ty = ty - pull * arm[1]
        tz = tz - pull * arm[2]
    if law[13] != 0.0 or law[14] != 0.0 or law[15] != 0.0:
        first = turned_back(r, vector(vectors, 4))
        last = vector(vectors, 5)
        middle = cross(last, first)
        volume = norm(middle)
        middle = unit(middle)
        damped = (0.0, 0.0, 0.0)
        damped = along(damped, law[13] * dot(cross(middle, last), w), cross(middle, last))
        damped = along(damped, law[14] * dot(cross(last, first), w), cross(last, first))
        damped = along(damped, law[15] * dot(cross(first, middle), w), cross(first, middle))
        scale = 1.0 / max(volume, SINGULAR) ** 2
        tx = tx - scale * damped[0]
        ty = ty - scale * damped[1]
        tz = tz - scale * damped[2]
    inertia = matrix(matrices, 2)
    u = vector(vectors, 3)
    torque = plus((tx, ty, tz), cross(vector(vectors, 1), turned_back(r, vector(vectors, 2))))
    torque = plus(torque, cross(turned(inertia, w), w))
    if u[0] != 0.0 or u[1] != 0.0 or u[2] != 0.0:
        about = dot(u, torque) / dot(u, turned(inertia, u))
        return about * u[0], about * u[1], about * u[2]
    return turned(matrix(matrices, 3), torque)


@inner
def _turning(r, w):
    """Find R [w]x."""
    return (
        r[1] * w[2] - r[2] * w[1],
        r[2] * w[0] - r[0] * w[2],
        r[0] * w[1] - r[1] * w[0],
        r[4] * w[2] - r[5] * w[1],
        r[5] * w[0] - r[3] * w[2],
        r[3] * w[1] - r[4] * w[0],
        r[7] * w[2] - r[8] * w[1],
        r[8] * w[0] - r[6] * w[2],
        r[6] * w[1] - r[7] * w[0],
    )


@inner
def _added(r, s, d):
    """Find the matrix r + s d."""
    return (
        r[0] + s * d[0],
        r[1] + s * d[1],
        r[2] + s * d[2],
        r[3] + s * d[3],
        r[4] + s * d[4],
        r[5] + s * d[5],
        r[6] + s * d[6],
        r[7] + s * d[7],
        r[8] + s * d[8],
    )


@inner
def _transposed(r):
    return r[0], r[3], r[6], r[1], r[4], r[7], r[2], r[5], r[8]


@inner
def _orthonormal(r):
    """Find the rotation beside a matrix that is nearly one."""
    x = unit((r[0], r[1], r[2]))
    y = (r[3], r[4], r[5])
    y = unit(along(y, -dot(x, y), x))
    z = cross(x, y)
    return x[0], x[1], x[2], y[0], y[1], y[2], z[0], z[1], z[2]


@inner
def _rotation_vector(r):
    """Find axis times angle of a rotation by less than half a turn."""
    twice_sine = (r[7] - r[5], r[2] - r[6], r[3] - r[1])
    cosine = 0.5 * (r[0] + r[4] + r[8] - 1.0)
    sine = 0.5 * norm(twice_sine)
    scale = 0.5 * math.atan2(sine, cosine) / sine if sine > 1e-9 else 0.5
    return scale * twice_sine[0], scale * twice_sine[1], scale * twice_sine[2]


@read_only
class Window:
    """Whole swings of one recording that follow each other.

    Attributes
    ----------
    recording : with the swings
    frames : of it
    blocks : (swings,) their numbers in the sums of all
    """

    recording: SwingRecording
    frames: slice
    blocks: np.ndarray

    def training(self, blocks: int) -> Array:
        """Count every swing but those of the window.

        Parameters
        ----------
        blocks : how many swings there are

        Returns
        -------
        (blocks,) 1, or 0 for swings of the window
        """
        counts = np.ones(blocks)
        counts[self.blocks] = 0.0
        return counts

    @property
    def measured(self) -> SwingMotion:
        """As it was measured."""
        return measured_motion(self.recording, self.frames)

    def errors(self, predicted: SwingMotion, free_offset: bool) -> Array:
        """Compare a prediction with what was measured.

        Parameters
        ----------
        predicted : of this window
        free_offset : compare changes of the wrench only

        Returns
        -------
        (3,) mean square of angle, moment, force [rad^2, (N m)^2, N^2]
        """
        measured = self.measured
        wrench = measured.wrench - predicted.wrench
        if free_offset:
            wrench = wrench - wrench.mean(axis=0)
        angle = np.mean(angles_apart(measured.rotations, predicted.rotations) ** 2)
        square = np.square(wrench)
        return np.array([angle, square[:, :3].sum(axis=1).mean(), square[:, 3:].sum(axis=1).mean()])


def windows(
    recordings: Sequence[SwingRecording], sums: SwingSums, horizon: float, count: int
) -> list[Window]:
    """Choose windows spread over the recordings, whose sums have single swings as blocks.

    Where no two are so long, single swings; where there are no two of these either, none.

    Parameters
    ----------
    recordings : of one condition
    sums : over single swings
    horizon : that a window lasts at least [s]
    count : of windows at most
    """
    for least in (horizon, 0.0):
        spans = _every(recordings, sums, least)
        if len(spans) > 1:
            chosen = np.unique(
                np.linspace(0, len(spans) - 1, min(count, len(spans))).round().astype(int)
            )
            return [spans[i] for i in chosen]
    return []


def _every(recordings: Sequence[SwingRecording], sums: SwingSums, least: float) -> list[Window]:
    """List the windows of all recordings that last at least so long [s]."""
    windows: list[Window] = []
    joined: list[int] = []
    for block, (number, use) in enumerate(zip(sums.trial, sums.uses, strict=True)):
        follows = (
            joined and sums.trial[joined[-1]] == number and sums.uses[joined[-1]][-1] + 1 == use[0]
        )
        joined = [*joined, block] if follows else [block]
        if use[-1] - use[0] + 1 != len(use):
            joined = []
            continue
        recording = recordings[number]
        frames = slice(int(sums.uses[joined[0]][0]), int(use[-1]) + 1)
        if (
            frames.stop - frames.start > 1
            and recording.time[frames.stop - 1] - recording.time[frames.start] >= least
        ):
            windows.append(Window(recording, frames, np.array(joined)))
            joined = []
    return windows
