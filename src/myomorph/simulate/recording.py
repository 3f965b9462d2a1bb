"""A limb that swings in MuJoCo, and what markers and a force plate see of it: noise, rates and clocks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np
from mujoco import rollout
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline

from myomorph.model.arrays import Array
from myomorph.model.inertia import inertia_matrices
from myomorph.model.series import Markers, Wrenches

MARKER_RATE, FORCE_RATE = 200.0, 2000.0
"""Of [S] section III [Hz]."""
SENSORS = """
  <sensor>
    <framequat name="pose" objtype="xbody" objname="{body}"/>
    <gyro name="rates" site="center"/>
    <frameangacc name="accelerations" objtype="xbody" objname="{body}"/>
    <torque name="torque" site="plate"/>
    <force name="force" site="plate"/>
  </sensor>"""
"""What a swing needs. The limb's first body `body` has a site "center" at the joint, along its axes; the base, which
weighs nothing, carries it, and has a site "plate" there along the ground's. Speeds of tendons come after these."""


@dataclass(frozen=True)
class Noise:
    """How badly a swing is measured; all noise is white and normal.

    Attributes
    ----------
    marker : standard deviation of each marker's coordinates [m]
    force : of each component of the plate's force [N]
    lever : of each component of its moment about the plate's origin, over `force` [m]
    offset, drift : the plate's clock reads offset + (1 + drift) t [s], [s/s]
    """

    marker: float = 3e-4
    force: float = 0.3
    lever: float = 0.2
    offset: float = 0.0
    drift: float = 0.0

    def on_true_clock(self, wrenches: Wrenches) -> Wrenches:
        """What the plate measured, at the true times of its samples."""
        return replace(wrenches, time=(wrenches.time - self.offset) / (1.0 + self.drift))


@dataclass(frozen=True, eq=False)
class Sampled:
    """A simulated swing, exact but for the integrator.

    Attributes
    ----------
    time : (frames,) [s]
    rotations : (frames, 3, 3) of the limb's first body in ground
    rates, accelerations : (frames, 3) angular, along the limb's axes [rad/s], [rad/s^2]
    wrench : (frames, 6) of the base on the limb, moment about the joint's center, in ground [N m], [N]
    lengthening : (frames, tendons) speed of each tendon [m/s]
    """

    time: Array
    rotations: Array
    rates: Array
    accelerations: Array
    wrench: Array
    lengthening: Array

    def every(self, number: int) -> Sampled:
        """Every so many-th frame."""
        return Sampled(*(getattr(self, name)[::number] for name in self.__dataclass_fields__))


@dataclass(frozen=True, eq=False)
class VirtualTrial:
    """One release: what was measured of it, and what truly happened.

    Attributes
    ----------
    markers : 200 Hz, with noise
    wrenches : of the plate on the base, 2000 Hz on its own clock, with noise: force, point, torque
    exact : the simulation at the forces' instants, without noise, on the true clock
    """

    name: str
    markers: Markers
    wrenches: Wrenches
    exact: Sampled


def simulate(compiled: Any, qpos: Array, qvel: Array, seconds: float, step: float) -> Sampled:
    """The swing of a compiled model with the `SENSORS` from a state, by the Runge-Kutta method of order 4.

    That method leaves joint and tendon dampers as they are; MuJoCo's others treat them implicitly, by which
    a step of finite length alters them.
    """
    compiled.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    compiled.opt.timestep = step
    data = mujoco.MjData(compiled)
    data.qpos[:], data.qvel[:] = qpos, qvel
    whole = int(mujoco.mjtState.mjSTATE_FULLPHYSICS)
    start = np.empty(mujoco.mj_stateSize(compiled, whole))
    mujoco.mj_getState(compiled, data, start, whole)
    steps = round(seconds / step) + 1
    _, sensed = rollout.rollout(compiled, data, start, nstep=steps)
    return sampled(compiled, np.arange(steps, dtype=np.float64) * step, sensed[0])


def sampled(compiled: Any, time: Array, sensed: Array) -> Sampled:
    """The sensors' values (frames, sensors) as arrays in our order and frames."""

    def values(name: str) -> Array:
        sensor = compiled.sensor(name)
        return sensed[:, sensor.adr[0] : sensor.adr[0] + sensor.dim[0]]

    rotations = matrices(values("pose"))
    wrench = np.concatenate([values("torque"), values("force")], axis=1)
    accelerations = np.einsum("fji,fj->fi", rotations, values("accelerations"))
    speeds = sensed[:, sensed.shape[1] - compiled.ntendon :]
    return Sampled(time, rotations, values("rates"), accelerations, wrench, speeds)


def matrices(quaternions: Array) -> Array:
    """(frames, 3, 3) of unit quaternions (frames, 4), w first."""
    w, x, y, z = quaternions.T
    rows = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def measured_markers(
    exact: Sampled,
    center: Array,
    base: Mapping[str, Array],
    limb: Mapping[str, Array],
    noise: Noise,
    random: np.random.Generator,
) -> Markers:
    """Markers at rest in ground (`base`) and on the limb (`limb`, from the joint's center), with noise."""
    seen = exact.every(round(1.0 / (MARKER_RATE * (exact.time[1] - exact.time[0]))))
    fixed = np.broadcast_to(np.array(list(base.values())), (len(seen.time), len(base), 3))
    moving = center + np.einsum("fij,mj->fmi", seen.rotations, np.array(list(limb.values())))
    places = np.concatenate([fixed, moving], axis=1)
    return Markers(seen.time, (*base, *limb), places + noise.marker * random.standard_normal(places.shape))


def measured_wrench(
    exact: Sampled, center: Array, plate: Array, body: str, noise: Noise, random: np.random.Generator
) -> Wrenches:
    """The wrench on `body` as the plate measures it on its own clock: force and moment at its origin `plate`."""
    scale = 1.0 + noise.drift
    first, last = (noise.offset + scale * time for time in (exact.time[0], exact.time[-1]))
    clock = np.arange(np.ceil(first * FORCE_RATE), np.floor(last * FORCE_RATE) + 1.0) / FORCE_RATE
    wrench = exact.wrench
    true = np.clip((clock - noise.offset) / scale, exact.time[0], exact.time[-1])
    if len(true) != len(exact.time) or not np.allclose(true, exact.time, atol=1e-9, rtol=0.0):
        wrench = CubicSpline(exact.time, wrench)(true)
    force = wrench[:, 3:] + noise.force * random.standard_normal((len(true), 3))
    moment = wrench[:, :3] + np.cross(center - plate, wrench[:, 3:])
    moment += noise.force * noise.lever * random.standard_normal(moment.shape)
    points = np.broadcast_to(plate, (len(true), 1, 3))
    return Wrenches(clock, ("plate",), (body,), force[:, None], points, moment[:, None])


def inertial(parameters: Array) -> str:
    """MJCF of inertial parameters (10,) about the body's origin, [D] order."""
    center = parameters[1:4] / parameters[0]
    about = inertia_matrices(parameters) - parameters[0] * (center @ center * np.eye(3) - np.outer(center, center))
    full = (about[0, 0], about[1, 1], about[2, 2], about[0, 1], about[0, 2], about[1, 2])
    return f'<inertial pos="{words(center)}" mass="{float(parameters[0])!r}" fullinertia="{words(full)}"/>'


def words(numbers: ArrayLike) -> str:
    """Numbers as MJCF writes them, to the last digit."""
    return " ".join(repr(float(one)) for one in np.asarray(numbers))
