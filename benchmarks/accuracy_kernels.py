"""Kernels against Pinocchio and MuJoCo on random trees, and where OpenSim's own torques lose power."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin

from myomorph.io.models import read_model
from myomorph.model.series import Motion
from myomorph.rigid.dynamics import inverse_dynamics
from myomorph.rigid.kinematics import forward_kinematics
from myomorph.rigid.tree import compile_tree

TESTS = Path(__file__).resolve().parents[1] / "tests"
# The tests' own comparisons, run here on more cases.
sys.path[:0] = [str(TESTS), str(TESTS / "rigid"), str(TESTS / "muscles")]

from test_tendons import compare  # noqa: E402
from trees import random_tree, to_mujoco, to_pinocchio  # noqa: E402

from mujoco_models import MYO_SIM, load, random_motion  # noqa: E402

TREES = 20


def measure() -> Iterator[dict[str, object]]:
    """Largest differences over random trees of 12 hinges and slides."""
    differences: dict[str, list[float]] = {
        "pose against Pinocchio [m]": [],
        "inverse dynamics against Pinocchio [N m, N]": [],
        "inverse dynamics against MuJoCo [N m, N]": [],
    }
    largest = 0.0
    for seed in range(TREES):
        model = random_tree(seed)
        rng = np.random.default_rng(seed)
        q, v, a = rng.normal(size=(3, 1, len(model.coordinates)))
        tau = inverse_dynamics(model, Motion(np.zeros(1), model.coordinate_names, q, v, a)).values[0]
        largest = max(largest, float(np.abs(tau).max()))
        theirs, ids = to_pinocchio(model)
        data = theirs.createData()
        expected = pin.rnea(theirs, data, q[0], v[0], a[0])
        differences["inverse dynamics against Pinocchio [N m, N]"].append(np.abs(tau - expected).max())
        pin.forwardKinematics(theirs, data, q[0])
        origins = forward_kinematics(compile_tree(model), q).origins[0, 1:]
        placed = np.array([data.oMi[ids[body.name]].translation for body in model.bodies])
        differences["pose against Pinocchio [m]"].append(np.abs(origins - placed).max())
        compiled = to_mujoco(model)
        state = mujoco.MjData(compiled)
        order = [compiled.joint(joint.name).dofadr[0] for joint in model.joints]
        state.qpos[order], state.qvel[order], state.qacc[order] = q[0], v[0], a[0]
        mujoco.mj_inverse(compiled, state)
        differences["inverse dynamics against MuJoCo [N m, N]"].append(np.abs(tau - state.qfrc_inverse[order]).max())
    for name, values in differences.items():
        yield {"quantity": name, "trees": TREES, "largest difference": float(max(values)), "largest torque": largest}


def measure_curved_knee(folder: Path) -> Iterator[dict[str, object]]:
    """Rate of energy of a swinging leg against the power of the torques, OpenSim's and ours."""
    import opensim

    opensim.Logger.setLevelString("Off")
    path = folder / "rajagopal-walk-emg/subject_walk_scaled.osim"
    theirs = opensim.Model(str(path))
    theirs.updForceSet().clearAndDestroy()
    state = theirs.initSystem()
    solver = opensim.InverseDynamicsSolver(theirs)
    coordinates = theirs.getCoordinateSet()
    names = [coordinates.get(i).getName() for i in range(coordinates.getSize())]
    for i, name in enumerate(names):
        coordinates.get(name).setLocked(state, False)
        coordinates.get(name).setSpeedValue(state, i + 1.0)
    speeds = state.getU()
    place = {names[round(speeds[i]) - 1]: i for i in range(len(names))}
    rates = {"knee_angle_r": 3.0, "hip_flexion_r": 2.0}
    start = {"knee_angle_r": 0.9, "hip_flexion_r": 0.0}

    def energy(time: float) -> float:
        for name in names:
            coordinates.get(name).setValue(state, start.get(name, 0.0) + rates.get(name, 0.0) * time, False)
            coordinates.get(name).setSpeedValue(state, rates.get(name, 0.0))
        theirs.realizeVelocity(state)
        return float(theirs.calcKineticEnergy(state) + theirs.calcPotentialEnergy(state))

    h = 1e-4
    rate = (energy(-2 * h) - 8 * energy(-h) + 8 * energy(h) - energy(2 * h)) / (12 * h)
    energy(0.0)
    torque = solver.solve(state, opensim.Vector(len(names), 0.0))
    power = sum(speed * torque[place[name]] for name, speed in rates.items())
    model = replace(read_model(path), couplers=())
    q, v = np.zeros((1, len(names))), np.zeros((1, len(names)))
    for name, speed in rates.items():
        q[0, model.coordinate_names.index(name)] = start[name]
        v[0, model.coordinate_names.index(name)] = speed
    tau = inverse_dynamics(model, Motion(np.zeros(1), model.coordinate_names, q, v, np.zeros_like(q)))
    ours = sum(speed * tau[name][0] for name, speed in rates.items())
    yield {"quantity": "rate of OpenSim's own kinetic and potential energy [W]", "value": f"{rate:.6f}"}
    yield {"quantity": "power of OpenSim's torques [W]", "value": f"{power:.6f}"}
    yield {"quantity": "power of ours [W]", "value": f"{ours:.6f}"}


def measure_tendons(poses: int = 20) -> Iterator[dict[str, object]]:
    """Lengths, moment arms and speeds of every muscle at random poses, against MuJoCo."""
    for name in ("MyoFullBody", *MYO_SIM):
        compiled, model = load(name, None)
        length, arm, speed = compare(compiled, model, random_motion(model, poses))
        yield {
            "model": name,
            "muscles": len(model.muscles),
            "coordinates": len(model.coordinates),
            "poses": poses,
            "length [m]": float(length),
            "moment arm [m/rad]": float(arm),
            "speed [m/s]": float(speed),
        }
