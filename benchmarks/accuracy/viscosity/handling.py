"""Faults of the setup on the plate itself.

They are a load of the base, a clamp that gives way, and a cluster that slips on its bone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from myomorph.core.io.mjcf.write import text
from myomorph.core.model.arrays import Array
from myomorph.core.model.series import Markers
from myomorph.swings.simulate.laboratory import Sampled, sampled
from myomorph.swings.simulate.limb import BaseLoad, HeldLimb, SwungLimb
from myomorph.swings.viscosity.trust.law import hinge_slopes

ANCHOR = (-0.055, 0.0, -0.06)
"""Where the base is clamped, from the joint's center, in the base's frame: the middle of the
shoulder blade [m].
"""
STIFF = 30.0
RATIO = 0.2
"""Of the clamp: stiffness at which its search begins [N m/rad], share of critical damping."""
SEARCHED = 4
FIXTURE = (0.005, 0.005, 0.005)
"""Inertia of what clamps the base, which turns with it [kg m^2]."""
CARRIED = 0.02
"""Inertia of what a clamp carries about its anchor, for its damping [kg m^2]."""


def base_load(limb: HeldLimb, mass: float, random: np.random.Generator) -> BaseLoad:
    """Draw a mass within 2 cm per axis of the mass center of the base's bone."""
    bone = limb.specimen.model.body(limb.specimen.base)
    x, y, z = np.asarray(bone.mass_center) + random.uniform(-0.02, 0.02, 3)
    return BaseLoad(mass, (float(x), float(y), float(z)))


def resting_wrench(limb: HeldLimb, load: BaseLoad) -> Array:
    """Return the wrench that carries a load at rest.

    Parameters
    ----------
    limb : on the plate
    load : of its base

    Returns
    -------
    (6,) moment about the joint's center [N m] and force [N], in ground
    """
    specimen = limb.specimen
    force = -load.mass * np.asarray(specimen.model.gravity)
    return np.concatenate(
        [np.cross(specimen.stand.rotation @ (np.array(load.place) - specimen.center), force), force]
    )


def still(wrench: Array, seconds: float, step: float) -> Sampled:
    """Return a wrench that does not change, as the simulation gives it.

    Parameters
    ----------
    wrench : (6,) moment [N m] and force [N]
    seconds : of the result
    step : between samples [s]

    Returns
    -------
    Samples of a limb at rest with this wrench
    """
    time = np.arange(round(seconds / step) + 1) * step
    nothing = np.zeros((len(time), 3))
    turns = np.broadcast_to(np.eye(3), (len(time), 3, 3))
    return Sampled(
        time=time,
        rotations=turns,
        rates=nothing,
        accelerations=nothing,
        wrench=np.tile(wrench, (len(time), 1)),
        lengthening=np.zeros((len(time), 0)),
    )


class Gimbal:
    """Three hinges one after another.

    They are along axes of the limb where it is at `rest` (3, 3) in ground.
    """

    def __init__(self, limb: HeldLimb, rest: Array, damping: Sequence[float]) -> None:
        (joint,) = [
            joint for joint in limb.specimen.model.joints if joint.child == limb.specimen.first
        ]
        self.rest = rest
        self.damping = damping
        # Two level axes, then the limb's length, which is the middle one of the specimen's own.
        self.axes = np.array([joint.axes[number].vector for number in (0, 2, 1)])
        self.in_base = limb.specimen.stand.rotation.T @ rest @ self.axes[0]

    @property
    def mjcf(self) -> str:
        """Its joints."""
        return "".join(
            f'<joint name="hinge{number}" type="hinge" axis="{text(axis)}"'
            f' damping="{float(damping)!r}"/>'
            for number, (axis, damping) in enumerate(zip(self.axes, self.damping, strict=True))
        )

    def state(self, turn: Array, rates: Array) -> tuple[Array, Array]:
        """Return angles and rates of the hinges.

        Parameters
        ----------
        turn : (3,) rotation vector from rest, in the limb [rad]
        rates : (3,) its rates there [rad/s]

        Returns
        -------
        (3,) angles [rad], and (3,) rates [rad/s]
        """
        rotation = Rotation.from_rotvec(turn)
        order = "".join("XYZ"[int(np.argmax(axis))] for axis in self.axes)
        slopes = hinge_slopes(rotation.as_matrix()[None], self.axes[[0, 2]])[0]
        return rotation.as_euler(order), slopes @ rates


class Clamp:
    """Three springs about a point of the base, slack where the limb hangs at rest."""

    def __init__(self, limb: HeldLimb, parameters: Array, load: BaseLoad) -> None:
        specimen = limb.specimen
        gravity = np.asarray(specimen.model.gravity)
        self.anchor = specimen.stand.rotation @ np.array(ANCHOR)
        weight = parameters[0] * gravity
        carried = resting_wrench(limb, load)
        # What gravity turns about the anchor: the limb hangs below the joint's center.
        self.moment = (
            np.cross(-self.anchor, weight) - carried[:3] + np.cross(self.anchor, carried[3:])
        )

    def mjcf(self, stiffness: float) -> str:
        """Its joints, of a stiffness [N m/rad]."""
        damping = 2.0 * RATIO * float(np.sqrt(stiffness * CARRIED))
        joints = "".join(
            f'<joint type="hinge" pos="{text(self.anchor)}" axis="{text(axis)}"'
            f' stiffness="{stiffness!r}" damping="{damping!r}"'
            f' springref="{float(-moment / stiffness)!r}"/>'
            for axis, moment in zip(np.eye(3), self.moment, strict=True)
        )
        return (
            f'{joints}<inertial pos="{text(self.anchor)}" mass="0.001"'
            f' diaginertia="{text(FIXTURE)}"/>'
        )

    def swings(
        self,
        swung: SwungLimb,
        starts: list[tuple[Array, Array]],
        sway: float,
        seconds: float,
        step: float,
    ) -> list[tuple[Sampled, Array]]:
        """Simulate swings over a base that gives way.

        It has the stiffness at which the base turns by `sway` between its extremes about some axis.

        Parameters
        ----------
        swung : the limb; its clamp is replaced
        starts : positions and velocities of each swing at its start
        sway : between the extremes of the base [rad]
        seconds : of each swing
        step : between samples [s]

        Returns
        -------
        Each swing, and (frames, 3, 3) rotations of the base in it
        """
        stiffness = STIFF
        for _ in range(SEARCHED):
            compiled = mujoco.MjModel.from_xml_string(
                replace(swung, clamp=self.mjcf(stiffness)).mjcf
            )
            compiled.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
            compiled.opt.timestep = step
            swings = [_rolled(compiled, *start, seconds, step) for start in starts]
            widest = max(float(np.ptp(angles, axis=0).max()) for _, angles in swings)
            if abs(widest / sway - 1.0) < 0.05:
                break
            stiffness *= widest / sway
        return [(exact, Rotation.from_euler("XYZ", angles).as_matrix()) for exact, angles in swings]

    def moved(self, markers: Markers, turns: Array, center: Array, on_base: int) -> Markers:
        """Return markers of a fixed base as they are where it turns.

        Parameters
        ----------
        markers : the first of them on the base
        turns : (frames, 3, 3) rotations of the base
        center : (3,) of the rotations [m]
        on_base : number of markers on the base

        Returns
        -------
        Markers
        """
        values = np.array(markers.values)
        anchor = center + self.anchor
        values[:, :on_base] = anchor + np.einsum(
            "fij,fmj->fmi", turns, values[:, :on_base] - anchor
        )
        values[:, on_base:] += (turns @ -self.anchor + self.anchor)[:, None]
        return replace(markers, values=values)


def _rolled(
    compiled: mujoco.MjModel, qpos: Array, qvel: Array, seconds: float, step: float
) -> tuple[Sampled, Array]:
    """Return a swing, and the angles of the clamp's three joints (frames, 3) [rad]."""
    data = mujoco.MjData(compiled)
    data.qpos[3:] = qpos
    data.qvel[3:] = qvel
    angles = []
    sensed = []
    time = np.arange(round(seconds / step) + 1) * step
    for _ in time:
        angles.append(data.qpos[:3].copy())
        mujoco.mj_step(compiled, data)
        sensed.append(data.sensordata.copy())
    return sampled(compiled, time, np.array(sensed)), np.array(angles)


def slipped(
    markers: Markers, columns: list[int], rotations: Array, by: Array, time: float
) -> Markers:
    """Return the markers with those of a cluster moved from a time.

    Parameters
    ----------
    markers : to change
    columns : of the cluster's markers
    rotations : (frames, 3, 3) of the bone
    by : (3,) displacement in the bone's frame [m]
    time : from which they are moved [s]

    Returns
    -------
    Markers, the others unchanged
    """
    values = np.array(markers.values)
    later = markers.time >= time
    values[np.ix_(later, columns)] += (rotations[later] @ by)[:, None]
    return replace(markers, values=values)
