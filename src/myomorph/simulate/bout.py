"""A bout: two simulated fighters moved through a plan by their muscles, and every force that passed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from myomorph.model.arrays import Array
from myomorph.simulate.control import Controller, Wanted
from myomorph.simulate.fighter import Build, sole_points
from myomorph.simulate.mat import PARTS, SLEEVE_DAMPING, SLEEVE_LENGTH, SLEEVE_STIFFNESS, STEP
from myomorph.simulate.plan import Plan

FEET = tuple(f"{part}_foot_{side}" for part in PARTS for side in "rl")
GRIPS = ("lapel", "sleeve")
CONTROL = 4
"""Steps of the integrator between choices of activations."""
LAG = 0.01
"""Time constant of activations after them [s]."""


@dataclass(frozen=True, eq=False)
class Run:
    """What happened, step by step.

    Attributes
    ----------
    time : (steps,) [s]
    qpos : (steps, nq)
    activations, tensions : (steps, muscles) [1, N]
    forces, moments : (steps, contacts, 3) on tori (of soles: on the foot), moments about the ground's origin, of the
        four feet and the two grips [N], [N m]
    places : (steps, grips, 3) where the grips' forces act [m]
    strayed : (steps,) greatest distance of a joint from the plan [rad]
    """

    time: Array
    qpos: Array
    activations: Array
    tensions: Array
    forces: Array
    moments: Array
    places: Array
    strayed: Array


def simulate_bout(
    compiled: Any, builds: Mapping[str, Build], plan: Plan, weight: Array, tone: Array, until: float = np.inf
) -> Run:
    """Move both fighters through a plan.

    Parameters
    ----------
    compiled : mujoco.MjModel of the pair, muscles with their fibers
    weight, tone : (muscles,) of the fighters' own criterion, see `virtual_control`
    until : end of the bout, where the plan is not over sooner [s]
    """
    m = compiled
    data = mujoco.MjData(m)
    data.qpos[:] = plan.poses[0]
    controller = Controller(m, weight, tone)
    steps = round(min(plan.duration, until) / STEP)
    found = _room(m, steps)
    anchors: dict[str, list[tuple[int, Array, Array]]] = {}
    activation, chosen = tone.copy(), tone
    error = np.empty(m.nv)
    for k in range(steps):
        mujoco.mj_step1(m, data)
        if k % CONTROL == 0:
            standing = _standing(m, data, builds, plan, k * STEP, anchors)
            q, rates, accelerations = plan.at(m, k * STEP)
            mujoco.mj_differentiatePos(m, error, 1.0, data.qpos, q)
            found.strayed[k : k + CONTROL] = np.abs(error).max()
            stiff = controller.drives.stiffness
            aim = accelerations + stiff * error + 2.0 * np.sqrt(stiff) * (rates - data.qvel)
            lapel, sleeve = plan.pulls(k * STEP)
            chosen = controller.activations(data, Wanted(aim, standing, np.array([lapel, 0.0, 0.0]), sleeve))
        activation = activation + (chosen - activation) * (1.0 - np.exp(-STEP / LAG))
        data.ctrl[:] = activation
        found.time[k], found.qpos[k], found.activations[k] = k * STEP, data.qpos, activation
        mujoco.mj_step2(m, data)
        found.tensions[k] = -data.actuator_force
        _record_forces(m, data, found, k)
    return found


def _room(m: Any, steps: int) -> Run:
    contacts = len(FEET) + len(GRIPS)
    return Run(
        np.empty(steps), np.empty((steps, m.nq)), np.empty((steps, m.nu)), np.empty((steps, m.nu)),
        np.zeros((steps, contacts, 3)), np.zeros((steps, contacts, 3)), np.zeros((steps, len(GRIPS), 3)),
        np.zeros(steps),
    )  # fmt: skip


def _standing(
    m: Any,
    data: Any,
    builds: Mapping[str, Build],
    plan: Plan,
    time: float,
    anchors: dict[str, list[tuple[int, Array, Array]]],
) -> list[tuple[int, Array, Array]]:
    """Corners of the soles that should stand, and where each was when its foot came down."""
    off, on = plan.lifted
    if off < time < on:
        anchors.pop("tori_foot_r", None)
    for foot in FEET:
        if foot in anchors or (foot == "tori_foot_r" and off < time < on):
            continue
        body = m.body(foot).id
        size = builds[foot.partition("_")[0]].size
        corners = [size * point for point in sole_points(foot[-1]).values()]
        places = [data.xpos[body] + data.xmat[body].reshape(3, 3) @ point for point in corners]
        anchors[foot] = [(body, one, at * (1.0, 0.0, 1.0)) for one, at in zip(corners, places, strict=True)]
    return [one for corners in anchors.values() for one in corners]


def _record_forces(m: Any, data: Any, found: Run, k: int) -> None:
    mat, lapel, sleeve = m.geom("mat").id, len(FEET), len(FEET) + 1
    feet = {m.body(name).id: c for c, name in enumerate(FEET)}
    count = int(data.ncon)
    forces, owners, wrench = np.empty((count, 3)), np.empty(count, int), np.empty(6)
    for i in range(count):
        contact = data.contact[i]
        mujoco.mj_contactForce(m, data, i, wrench)
        below = contact.geom1 == mat
        forces[i] = contact.frame.reshape(3, 3).T @ wrench[:3] * (1.0 if below else -1.0)
        owners[i] = feet[int(m.geom_bodyid[contact.geom2 if below else contact.geom1])]
    np.add.at(found.forces[k], owners, forces)
    np.add.at(found.moments[k], owners, np.cross(data.contact.pos.reshape(-1, 3), forces))
    rows = (data.efc_type == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)) & (data.efc_id == m.equality("lapel").id)
    found.places[k, 0] = data.site_xpos[m.site("tori_grip_r").id]
    found.forces[k, lapel] = data.efc_force[rows]
    fist, cuff = (data.site_xpos[m.site(name).id] for name in ("tori_grip_l", "cuff"))
    t = m.tendon("sleeve").id
    stretch = float(data.ten_length[t]) - SLEEVE_LENGTH
    tension = (SLEEVE_STIFFNESS * stretch if stretch > 0.0 else 0.0) + SLEEVE_DAMPING * float(data.ten_velocity[t])
    found.places[k, 1] = fist
    found.forces[k, sleeve] = tension * (cuff - fist) / np.linalg.norm(cuff - fist)
    found.moments[k, lapel:] = np.cross(found.places[k], found.forces[k, lapel:])
