"""Models of the collection opened; the compiled kernels against Pinocchio, MuJoCo and OpenSim."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
from test_tendons import compare

import myomorph as mm
from mujoco_models import MYO_SIM, load, random_motion
from myomorph.core.motion.splines import natural_spline
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from trees import random_tree, to_mujoco, to_pinocchio

DOCUMENT_ONLY = ("credits", "publications", "force_units", "length_units", "ModelVisualPreferences")
"""Parts of a model file that say something about it and change no result."""


def measure(folder: Path) -> Iterator[dict[str, object]]:
    """Yield a row for each model file: its parts, or the reason why it is not opened."""
    mjcf = (
        "mouse-arm-muscles/akira_muscle.xml",
        "mouse-skeleton-keypoints/mouse_with_meshes.xml",
        "rat-keypoints/rodent.xml",
    )
    for path in [*sorted(folder.rglob("*.osim")), *(folder / name for name in mjcf)]:
        row: dict[str, object] = {"model": str(path.relative_to(folder))}
        try:
            model = mm.read_model(path)
        except mm.MyomorphError as error:
            yield row | {"opened": f"no: {error}"}
            continue
        kept: dict[str, int] = {}
        for part in model.kept:
            if part.kind in DOCUMENT_ONLY:
                continue
            kept[part.kind] = kept.get(part.kind, 0) + 1
        yield row | {
            "opened": "yes",
            "bodies": len(model.bodies),
            "coordinates": len(model.coordinates),
            "muscles": len(model.muscles),
            "markers": len(model.markers),
            "loops": ", ".join(loop.kind for loop in model.loops) or "-",
            "kept, not modelled": ", ".join(
                f"{count} {kind}" for kind, count in sorted(kept.items())
            )
            or "-",
        }


TREES = 20


def measure_kernels() -> Iterator[dict[str, object]]:
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
        tau = mm.inverse_dynamics(
            model, mm.Motion(np.zeros(1), model.coordinate_names, q, v, a)
        ).values[0]
        largest = max(largest, float(np.abs(tau).max()))
        theirs, ids = to_pinocchio(model)
        data = theirs.createData()
        expected = pin.rnea(theirs, data, q[0], v[0], a[0])
        differences["inverse dynamics against Pinocchio [N m, N]"].append(
            np.abs(tau - expected).max()
        )
        pin.forwardKinematics(theirs, data, q[0])
        origins = forward_kinematics(compile_tree(model), q).origins[0, 1:]
        placed = np.array([data.oMi[ids[body.name]].translation for body in model.bodies])
        differences["pose against Pinocchio [m]"].append(np.abs(origins - placed).max())
        compiled = to_mujoco(model)
        state = mujoco.MjData(compiled)
        order = [compiled.joint(joint.name).dofadr[0] for joint in model.joints]
        state.qpos[order] = q[0]
        state.qvel[order] = v[0]
        state.qacc[order] = a[0]
        mujoco.mj_inverse(compiled, state)
        differences["inverse dynamics against MuJoCo [N m, N]"].append(
            np.abs(tau - state.qfrc_inverse[order]).max()
        )
    for name, values in differences.items():
        yield {
            "quantity": name,
            "trees": TREES,
            "largest difference": float(max(values)),
            "largest torque": largest,
        }


def measure_curved_knee(folder: Path) -> Iterator[dict[str, object]]:
    """Compare the power of inverse dynamics with the rate of energy in a real walk.

    The torques are OpenSim's and ours. No external loads: they would add the same to both. OpenSim
    computes the energy.
    """
    import opensim

    opensim.Logger.setLevelString("Off")
    path = folder / "rajagopal-walk-emg/subject_walk_scaled.osim"
    model = mm.read_model(path)
    given = mm.read_motion(folder / "rajagopal-walk-emg/coordinates.sto", model)
    values = compile_tree(model).coordinates_of(given)
    spline = natural_spline(given.time, values)
    theirs = opensim.Model(str(path))
    theirs.updForceSet().clearAndDestroy()
    state = theirs.initSystem()
    solver = opensim.InverseDynamicsSolver(theirs)
    coordinates = theirs.getCoordinateSet()
    names = model.coordinate_names
    for i, name in enumerate(names):
        coordinates.get(name).setLocked(state, False)
        coordinates.get(name).setSpeedValue(state, i + 1.0)
    order = [round(speed) - 1 for speed in state.getU().to_numpy()]

    def place(time: float) -> None:
        q = spline(time)
        v = spline.derivative()(time)
        for i, name in enumerate(names):
            coordinates.get(name).setValue(state, float(q[i]), False)
            coordinates.get(name).setSpeedValue(state, float(v[i]))
        theirs.realizeVelocity(state)

    def energy(time: float) -> float:
        place(time)
        return float(theirs.calcKineticEnergy(state) + theirs.calcPotentialEnergy(state))

    times = given.time[100:-100:50]
    moving = mm.Motion(
        times, names, spline(times), spline.derivative()(times), spline.derivative(2)(times)
    )
    # Without couplers each coordinate keeps the derivatives that OpenSim is given.
    tau = mm.inverse_dynamics(replace(model, couplers=()), moving)
    h = 1e-4
    off_theirs = []
    off_ours = []
    apart = []
    for frame, time in enumerate(times):
        rate = (
            energy(time - 2 * h)
            - 8 * energy(time - h)
            + 8 * energy(time + h)
            - energy(time + 2 * h)
        ) / (12 * h)
        place(time)
        found = solver.solve(
            state, opensim.Vector.createFromMat(moving.accelerations[frame][order])
        )
        torques = np.empty(len(names))
        torques[order] = found.to_numpy()
        off_theirs.append(torques @ moving.velocities[frame] - rate)
        off_ours.append(tau.values[frame] @ moving.velocities[frame] - rate)
        apart.append(np.abs(torques - tau.values[frame]).max())
    yield {
        "frames": len(times),
        "OpenSim's power minus its rate of energy, RMS [W]": float(
            np.sqrt(np.mean(np.square(off_theirs)))
        ),
        "our power minus OpenSim's rate of energy, RMS [W]": float(
            np.sqrt(np.mean(np.square(off_ours)))
        ),
        "largest difference of a generalized force [N m, N]": float(np.max(apart)),
    }


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
