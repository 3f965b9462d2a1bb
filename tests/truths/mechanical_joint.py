"""A mechanical joint whose inertia, damping and stiffness are known, swung in MuJoCo.

MuJoCo is an engine that is not ours. A bent limb about as large as an arm hangs on a base by a
hinge or a ball joint with a damper and a spring, is let go several times, and is measured as in a
laboratory: markers and the wrench on the base, each with noise and on its own clock. [S] names this
experiment as the check that it is missing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import mujoco
import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

import myomorph as mm
from myomorph.core.io.mjcf.read import model_from_mujoco
from myomorph.core.io.mjcf.write import text
from myomorph.core.model.arrays import Array
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.inertia import inertia_matrices
from myomorph.core.model.spatial import axis_rotation
from myomorph.swings.simulate.laboratory import (
    SENSORS,
    Instruments,
    Noise,
    Sampled,
    VirtualTrial,
    inertial,
    measured_markers,
    measured_wrench,
    simulate,
)
from myomorph.swings.viscosity.swings.motion import angular_motion, continuous
from myomorph.swings.viscosity.swings.recording import PARAMETERS, SwingRecording


def on_true_clock(wrenches: mm.Wrenches, noise: Noise) -> mm.Wrenches:
    """Return what a plate measured, at the true times of its samples."""
    return replace(wrenches, time=(wrenches.time - noise.offset) / (1.0 + noise.drift))


def poses_of(seen: Array, places: Array, axis: Array | None) -> Array:
    """Return quaternions that rotate marker positions onto the observed ones.

    Parameters
    ----------
    seen : (frames, markers, 3) observed, from the joint's center [m]
    places : (markers, 3) in the limb's frame [m]
    axis : (3,) of a hinge, None for a ball joint

    Returns
    -------
    (frames, 4) w first, continuous over frames
    """
    if axis is not None:
        angle = np.arctan2(
            np.einsum("fmi,mi->f", seen, np.cross(axis, places)),
            np.einsum("fmi,mi->f", seen, places - np.outer(places @ axis, axis)),
        )
        half = 0.5 * np.unwrap(angle)[:, None]
        return np.concatenate([np.cos(half), np.sin(half) * axis], axis=1)
    left, _, right = np.linalg.svd(np.einsum("fmi,mj->fij", seen, places))
    left[:, :, 2] *= np.linalg.det(left @ right)[:, None]
    return continuous(Rotation.from_matrix(left @ right).as_quat(scalar_first=True))


def moment_rows(
    rotations: Array, rates: Array, accelerations: Array, gravity: Array
) -> tuple[Array, Array]:
    """Return moment about a fixed point of the body and force that unit parameters need.

    n = I alpha + omega x I omega - m c x g,  f = -m g + alpha x m c + omega x (omega x m c).

    Parameters
    ----------
    rotations : (frames, 3, 3) of the body in ground
    rates : (frames, 3) angular velocities in the body's axes [rad/s]
    accelerations : (frames, 3) angular accelerations in the body's axes [rad/s^2]
    gravity : (3,) in ground [m/s^2]

    Returns
    -------
    moment and force, each (frames, 3, 10), in the body's axes
    """
    weight = np.einsum("fji,j->fi", rotations, gravity)
    moment, force = np.zeros((2, len(rates), 3, PARAMETERS))
    turning = _skew(rates)
    moment[:, :, 1:4] = _skew(weight)
    moment[:, :, 4:] = _inertia_columns(accelerations) + turning @ _inertia_columns(rates)
    force[:, :, 0] = -weight
    force[:, :, 1:4] = _skew(accelerations) + turning @ turning
    return moment, force


def _skew(vectors: Array) -> Array:
    """Matrices (frames, 3, 3) that cross these vectors (frames, 3) with others."""
    table = np.zeros((len(vectors), 3, 3))
    table[:, 2, 1], table[:, 0, 2], table[:, 1, 0] = vectors.T
    return table - np.swapaxes(table, 1, 2)


def _inertia_columns(vectors: Array) -> Array:
    """(frames, 3, 6) with columns I_xx, I_yy, I_zz, I_yz, I_zx, I_xy of I @ vector."""
    x, y, z = vectors.T
    table = np.zeros((len(vectors), 3, 6))
    table[:, 0, 0] = x
    table[:, 1, 1] = y
    table[:, 2, 2] = z
    table[:, 1, 3] = z
    table[:, 2, 3] = y
    table[:, 2, 4] = x
    table[:, 0, 4] = z
    table[:, 0, 5] = y
    table[:, 1, 5] = x
    return table


Kind = Literal["hinge", "ball"]
GRAVITY = np.array([0.0, 0.0, -9.81])
CENTER = np.array([0.1, -0.2, 1.4])
"""Of the joint, in ground [m]."""
PLATE = np.array([0.1, -0.2, 1.7])
"""Origin of the plate that carries the base, in ground [m]."""
BASE_MARKERS: Mapping[str, Array] = FrozenMap(
    {
        f"base_{i}": np.array(one)
        for i, one in enumerate(((0.06, 0.0, 0.08), (-0.04, 0.05, 0.1), (-0.04, -0.05, 0.06)))
    }
)
"""From the joint's center, in ground [m]."""
AT_BASE = {name: CENTER + place for name, place in BASE_MARKERS.items()}
"""In ground [m]."""
LIMB_MARKERS: Mapping[str, Array] = FrozenMap(
    {
        f"limb_{i}": np.array(one)
        for i, one in enumerate(
            (
                (0.08, 0.0, -0.12),
                (-0.04, 0.07, -0.15),
                (-0.04, -0.07, -0.09),
                (0.12, 0.02, -0.5),
                (0.0, 0.08, -0.55),
                (0.02, -0.07, -0.45),
            )
        )
    }
)
"""Two clusters of three, from the joint's center, in the limb's frame [m]."""
FREE = '<freejoint name="base"/><inertial pos="0 0 0.05" mass="1" diaginertia="0.003 0.003 0.003"/>'
STEP = 1e-3
"""Of the integrator [s]: what the damper takes is what the energy loses, to 1e-5 of it (tests)."""


@dataclass(frozen=True, eq=False)
class JointTruth:
    """What the virtual joint is made of.

    Attributes
    ----------
    damping : of each axis [N m s/rad]
    stiffness : of each axis [N m/rad]
    rest : (axes,) where the spring is slack, angle or rotation vector from hanging [rad]
    axis : (3,) of a hinge in the limb's frame; None of a ball joint
    parameters : (10,) inertial parameters of the limb about the joint's center, in the limb's frame
    """

    kind: Kind
    damping: float
    stiffness: float
    rest: Array
    axis: Array | None
    parameters: Array

    @property
    def mass(self) -> float:
        """[kg]."""
        return float(self.parameters[0])

    @property
    def mass_center(self) -> Array:
        """(3,) in the limb's frame, from the joint's center [m]."""
        return self.parameters[1:4] / self.parameters[0]

    @property
    def com(self) -> float:
        """Distance of the mass center from the joint's center [m]."""
        return float(np.linalg.norm(self.mass_center))

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the free axes."""
        return ("x", "y", "z") if self.axis is None else ("hinge",)

    @property
    def directions(self) -> Array:
        """(axes, 3) free axes in the limb's frame."""
        return np.eye(3) if self.axis is None else self.axis[None]

    def angles(self, rotations: Array) -> Array:
        """Return the rotation vector or angle from hanging.

        Parameters
        ----------
        rotations : (frames, 3, 3) of the limb from hanging

        Returns
        -------
        (frames, axes) [rad]
        """
        vectors = Rotation.from_matrix(rotations).as_rotvec()
        return vectors if self.axis is None else np.unwrap(vectors @ self.axis)[:, None]

    def passive_torque(self, angles: Array, rates: Array) -> Array:
        """Return the torque of damper and spring.

        A ball joint's spring pulls along the rotation vector from its rest, here equal to `angles -
        rest` only where the rest is hanging.

        Parameters
        ----------
        angles : (frames, axes) from hanging [rad]
        rates : (frames, axes) [rad/s]

        Returns
        -------
        (frames, axes) [N m]
        """
        return -self.damping * rates - self.stiffness * (angles - self.rest)


@dataclass(frozen=True, eq=False)
class VirtualJoint:
    """A virtual joint and its recordings.

    Attributes
    ----------
    places : (3,) of each of the limb's markers in its frame, from the joint's center [m]
    """

    truth: JointTruth
    trials: tuple[VirtualTrial, ...]
    noise: Noise
    mjcf: str
    places: Mapping[str, Array]

    @cached_property
    def model(self) -> mm.Model:
        """The same joint as a model: the base free in ground, markers on base and limb."""
        text = self.mjcf.replace("<!--free-->", FREE)
        return model_from_mujoco(
            mujoco.MjModel.from_xml_string(text),
            name="virtual joint",
            marker_sites=r"(base|limb)_\d",
        )

    def swings(self, cutoff: float = 10.0) -> tuple[SwingRecording, ...]:
        """Every trial as equations, from noisy markers and wrench, with a known joint center."""
        return tuple(self._swing(trial, cutoff) for trial in self.trials)

    def exact_swings(self, rate: float = 200.0) -> tuple[SwingRecording, ...]:
        """Every trial as equations, without noise, filter or difference quotient."""
        every = round(1.0 / (STEP * rate))
        return tuple(
            _equations(trial.name, self.truth, trial.exact.every(every)) for trial in self.trials
        )

    def _swing(self, trial: VirtualTrial, cutoff: float) -> SwingRecording:
        time = trial.markers.time
        seen = np.stack([trial.markers[name] for name in self.places], axis=1) - CENTER
        quaternions = poses_of(seen, np.array(list(self.places.values())), self.truth.axis)
        motion = mm.differentiate(mm.Motion(time, ("w", "x", "y", "z"), quaternions), cutoff)
        assert motion.velocities is not None
        assert motion.accelerations is not None
        turns, rates, accelerations = angular_motion(
            motion.values, motion.velocities, motion.accelerations
        )
        found = mm.resample_wrenches(on_true_clock(trial.wrenches, self.noise), time, cutoff)
        force = found.forces[:, 0]
        moment = found.torques[:, 0] + np.cross(found.points[:, 0] - CENTER, force)
        wrench = np.concatenate([moment, force], axis=1)
        seen = Sampled(
            time=time,
            rotations=turns.as_matrix(),
            rates=rates,
            accelerations=accelerations,
            wrench=wrench,
            lengthening=np.zeros((len(time), 0)),
        )
        return _equations(trial.name, self.truth, seen, 2.0 / cutoff)


@dataclass(frozen=True, kw_only=True, eq=False)
class JointExperiment:
    """How a virtual joint is built beyond damper and spring, released and measured.

    Attributes
    ----------
    seconds : length of a trial [s]
    trials : number of releases
    rest : (axes,) angle or rotation vector from hanging at which the spring is slack [rad]; hanging
        itself by default
    noise : of markers and plate; usual by default
    swing : size of the releases; 1 for 0.5 to 1.1 rad
    spin : size of the push of a ball's limb about its long axis; 1 for 3 to 6 rad/s
    friction : dry, of every axis [N m]
    axis : (3,) of a hinge, level; drawn by default
    """

    seconds: float = 30.0
    trials: int = 2
    rest: ArrayLike | None = None
    noise: Noise | None = None
    swing: float = 1.0
    spin: float = 1.0
    friction: float = 0.0
    axis: ArrayLike | None = None


def mechanical_joint(
    kind: Kind,
    damping: float,
    stiffness: float,
    seed: int = 0,
    experiment: JointExperiment | None = None,
) -> VirtualJoint:
    """Make a virtual mechanical joint, released several times.

    Parameters
    ----------
    kind : "hinge" (level axis) or "ball"
    damping : of every axis [N m s/rad]
    stiffness : of the spring towards `rest`, every axis [N m/rad]
    seed : of the limb's shape, the releases and the noise
    experiment : releases, noise, rest of the spring, friction and axis

    Raises
    ------
    BadData : damping or stiffness is negative, or the kind is unknown
    """
    if kind not in ("hinge", "ball"):
        raise mm.BadData(f"a virtual joint of kind '{kind}': try 'hinge' or 'ball'")
    if damping < 0.0 or stiffness < 0.0:
        raise mm.BadData(
            f"damping {damping} and stiffness {stiffness} of a virtual joint must not be negative"
        )
    experiment = experiment or JointExperiment()
    random = np.random.default_rng(seed)
    noise = experiment.noise or Noise()
    limb = _limb(random)
    hinge = None
    if kind == "hinge":
        given = experiment.axis
        hinge = _level(random) if given is None else np.asarray(given, np.float64)
    slack = np.zeros(3 if hinge is None else 1)
    if experiment.rest is not None:
        slack = np.asarray(experiment.rest, dtype=np.float64)
    truth = JointTruth(
        kind=kind,
        damping=float(damping),
        stiffness=float(stiffness),
        rest=slack,
        axis=hinge,
        parameters=limb,
    )
    text = _mjcf(truth, BASE_MARKERS, LIMB_MARKERS)
    compiled = mujoco.MjModel.from_xml_string(text)
    if hinge is None:
        compiled.qpos_spring[:] = Rotation.from_rotvec(slack).as_quat(scalar_first=True)
    compiled.dof_frictionloss[:] = experiment.friction
    instruments = Instruments(noise, random)
    made = []
    for number in range(experiment.trials):
        qpos, rates = _release(truth, experiment.swing, experiment.spin, random)
        if hinge is None:
            qpos = Rotation.from_rotvec(qpos).as_quat(scalar_first=True)
        exact = simulate(compiled, qpos, rates, experiment.seconds, STEP)
        made.append(
            VirtualTrial(
                name=f"release {number + 1}",
                markers=measured_markers(exact, CENTER, AT_BASE, LIMB_MARKERS, instruments),
                wrenches=measured_wrench(exact, CENTER, PLATE, "base", instruments),
                exact=exact,
            )
        )
    return VirtualJoint(
        truth=truth, trials=tuple(made), noise=noise, mjcf=text, places=LIMB_MARKERS
    )


def _limb(random: np.random.Generator) -> Array:
    """Return inertial parameters (10,) of two thick rods, upper arm and bent forearm.

    They hang with the center of mass below.
    """
    bend = np.deg2rad(random.uniform(30.0, 70.0))
    turn = axis_rotation((0.0, 0.0, 1.0), random.uniform(0.0, 2.0 * np.pi))
    upper = np.array([0.0, 0.0, -1.0])
    fore = turn @ np.array([np.sin(bend), 0.0, -np.cos(bend)])
    lengths = random.uniform((0.28, 0.36), (0.34, 0.44))
    masses = random.uniform((1.0, 0.8), (1.3, 1.1))
    radius = 0.04
    centers = np.stack([0.5 * lengths[0] * upper, lengths[0] * upper + 0.5 * lengths[1] * fore])
    first = masses @ centers
    level = _turn_onto(first, upper)
    inertia = np.zeros((3, 3))
    for mass, center, along, length in zip(masses, centers, (upper, fore), lengths, strict=True):
        thin = 0.5 * mass * radius**2
        thick = mass * (radius**2 / 4.0 + length**2 / 12.0)
        inertia += thick * np.eye(3) + (thin - thick) * np.outer(along, along)
        inertia += mass * (center @ center * np.eye(3) - np.outer(center, center))
    inertia = level @ inertia @ level.T
    first = level @ first
    off = (inertia[1, 2], inertia[2, 0], inertia[0, 1])
    return np.array([masses.sum(), *first, *np.diag(inertia), *off])


def _turn_onto(vector: Array, unit: Array) -> Array:
    """Return the shortest rotation that rotates a vector onto a unit vector."""
    start = vector / np.linalg.norm(vector)
    axis = np.cross(start, unit)
    sine = float(np.linalg.norm(axis))
    return (
        axis_rotation(axis / sine, float(np.arctan2(sine, start @ unit)))
        if sine > 1e-12
        else np.eye(3)
    )


def _level(random: np.random.Generator) -> Array:
    azimuth = random.uniform(0.0, 2.0 * np.pi)
    return np.array([np.cos(azimuth), np.sin(azimuth), 0.0])


def _release(
    truth: JointTruth, swing: float, spin: float, random: np.random.Generator
) -> tuple[Array, Array]:
    """Return where and how fast the limb is let go.

    They are (axes,) angle or rotation vector and rates along the limb's axes. A ball joint gets a
    push across the swing, which makes it conical, and one about its long axis.
    """
    size = swing * random.uniform(0.5, 1.1) * random.choice((-1.0, 1.0))
    if truth.axis is not None:
        return np.array([size]), np.zeros(1)
    along = _level(random)
    push = swing * random.uniform(0.5, 1.5) * np.cross((0.0, 0.0, 1.0), along)
    twist = (
        spin * swing * np.array([0.0, 0.0, random.uniform(3.0, 6.0) * random.choice((-1.0, 1.0))])
    )
    return size * along + 0.1 * twist, push + twist


def _mjcf(truth: JointTruth, base: Mapping[str, Array], limb: Mapping[str, Array]) -> str:
    """Return the joint as MJCF; the base is fixed, and free where `<!--free-->` becomes a joint."""
    hinge = (
        ""
        if truth.axis is None
        else f'axis="{text(truth.axis)}" springref="{text(np.rad2deg(truth.rest))}"'
    )
    sites = [
        [
            f'<site name="{name}" pos="{text(place)}" size="0.0045"/>'
            for name, place in places.items()
        ]
        for places in (base, limb)
    ]
    return f"""<mujoco model="virtual joint">
  <option gravity="{text(GRAVITY)}"/>
  <worldbody>
    <body name="base" pos="{text(CENTER)}"><!--free-->
      <site name="plate"/>
      {"".join(sites[0])}
      <body name="limb">
        <joint name="joint" type="{truth.kind}" damping="{truth.damping!r}"
          stiffness="{truth.stiffness!r}" {hinge}/>
        {inertial(truth.parameters)}
        <site name="center"/>
        {"".join(sites[1])}
      </body>
    </body>
  </worldbody>{SENSORS.format(body="limb")}
</mujoco>"""


def _equations(name: str, truth: JointTruth, seen: Sampled, ends: float = 0.0) -> SwingRecording:
    """Return a swing as the linear equations of its limb's parameters.

    As many seconds as `ends` are not used at either end.
    """
    moment, force = moment_rows(seen.rotations, seen.rates, seen.accelerations, GRAVITY)
    rows = [np.einsum("fij,fjp->fip", seen.rotations, one) for one in (moment, force)]
    p = truth.parameters
    along = truth.directions
    about = along @ inertia_matrices(p) @ along.T
    rate = np.sqrt((truth.mass * truth.com * -GRAVITY[2] + truth.stiffness) / about[0, 0])
    number = np.floor((seen.time - seen.time[0]) * rate / (2.0 * np.pi)).astype(np.int64)
    number[(seen.time < seen.time[0] + ends) | (seen.time > seen.time[-1] - ends)] = -1
    return SwingRecording(
        name=name,
        time=seen.time,
        wrench_rows=np.concatenate(rows, axis=1),
        wrench=seen.wrench,
        torque_rows=np.einsum("ai,fip->fap", along, moment),
        rates=seen.rates @ along.T,
        angles=truth.angles(seen.rotations),
        axes=truth.axes,
        muscles=(),
        lengthening=np.zeros((len(seen.time), 0, len(along))),
        rotations=seen.rotations,
        gravity=GRAVITY,
        swing=number,
    )
