"""Models of the collection opened; the compiled kernels against Pinocchio, MuJoCo and OpenSim."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
import pinocchio as pin
from scipy.interpolate import CubicSpline
from test_tendons import compare

import myomorph as mm
from benchmarks.errors import rms
from mujoco_models import MYO_SIM, load, random_motion
from myomorph.core.model.arrays import Array
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


KERNELS = (
    "pose against Pinocchio [m]",
    "inverse dynamics against Pinocchio [N m, N]",
    "inverse dynamics against MuJoCo [N m, N]",
)


class _Differences(NamedTuple):
    """Largest differences on one random tree, in the order of `KERNELS`, and its largest torque."""

    pose: float
    dynamics: float
    mujoco_dynamics: float
    torque: float


def measure_kernels() -> Iterator[dict[str, object]]:
    """Largest differences over random trees of 12 hinges and slides."""
    trees = [_differences(seed) for seed in range(TREES)]
    largest = max(one.torque for one in trees)
    for k, name in enumerate(KERNELS):
        yield {
            "quantity": name,
            "trees": TREES,
            "largest difference": float(max(one[k] for one in trees)),
            "largest torque": largest,
        }


def _differences(seed: int) -> _Differences:
    model = random_tree(seed)
    rng = np.random.default_rng(seed)
    q, v, a = rng.normal(size=(3, 1, len(model.coordinates)))
    motion = mm.Motion(np.zeros(1), model.coordinate_names, q, v, a)
    tau = mm.inverse_dynamics(model, motion).values[0]

    theirs, ids = to_pinocchio(model)
    data = theirs.createData()
    expected = pin.rnea(theirs, data, q[0], v[0], a[0])
    dynamics = float(np.abs(tau - expected).max())
    pin.forwardKinematics(theirs, data, q[0])
    origins = forward_kinematics(compile_tree(model), q).origins[0, 1:]
    placed = np.array([data.oMi[ids[body.name]].translation for body in model.bodies])

    by_mujoco = _mujoco_torques(model, q[0], v[0], a[0])
    return _Differences(
        pose=float(np.abs(origins - placed).max()),
        dynamics=dynamics,
        mujoco_dynamics=float(np.abs(tau - by_mujoco).max()),
        torque=float(np.abs(tau).max()),
    )


def _mujoco_torques(model: mm.Model, q: Array, v: Array, a: Array) -> Array:
    """Return MuJoCo's inverse dynamics (joints,) of a state (joints,) each."""
    compiled = to_mujoco(model)
    state = mujoco.MjData(compiled)
    order = [compiled.joint(joint.name).dofadr[0] for joint in model.joints]
    state.qpos[order] = q
    state.qvel[order] = v
    state.qacc[order] = a
    mujoco.mj_inverse(compiled, state)
    return np.array(state.qfrc_inverse[order])


def measure_curved_knee(folder: Path) -> Iterator[dict[str, object]]:
    """Compare the power of inverse dynamics with the rate of energy in a real walk.

    The torques are OpenSim's and ours. No external loads: they would add the same to both. OpenSim
    computes the energy.
    """
    path = folder / "rajagopal-walk-emg/subject_walk_scaled.osim"
    model = mm.read_model(path)
    given = mm.read_motion(folder / "rajagopal-walk-emg/coordinates.sto", model)
    values = compile_tree(model).coordinates_of(given)
    spline = natural_spline(given.time, values)
    theirs = _EnergyOfOpenSim(path, model, spline)
    times = given.time[100:-100:50]
    moving = mm.Motion(
        times,
        model.coordinate_names,
        spline(times),
        spline.derivative()(times),
        spline.derivative(2)(times),
    )
    # Without couplers each coordinate keeps the derivatives that OpenSim is given.
    tau = mm.inverse_dynamics(replace(model, couplers=()), moving)
    off_theirs = []
    off_ours = []
    apart = []
    for frame, time in enumerate(times):
        rate = theirs.energy_rate(time)
        torques = theirs.torques(time, moving.accelerations[frame])
        off_theirs.append(torques @ moving.velocities[frame] - rate)
        off_ours.append(tau.values[frame] @ moving.velocities[frame] - rate)
        apart.append(np.abs(torques - tau.values[frame]).max())
    yield {
        "frames": len(times),
        "OpenSim's power minus its rate of energy, RMS [W]": rms(off_theirs),
        "our power minus OpenSim's rate of energy, RMS [W]": rms(off_ours),
        "largest difference of a generalized force [N m, N]": float(np.max(apart)),
    }


class _EnergyOfOpenSim:
    """Energy and torques of OpenSim's model along splines of its coordinates."""

    def __init__(self, path: Path, model: mm.Model, spline: CubicSpline) -> None:
        import opensim

        opensim.Logger.setLevelString("Off")
        self._vector = opensim.Vector
        self._spline = spline
        self._names = model.coordinate_names
        self._model = opensim.Model(str(path))
        self._model.updForceSet().clearAndDestroy()
        self._state = self._model.initSystem()
        self._solver = opensim.InverseDynamicsSolver(self._model)
        self._coordinates = self._model.getCoordinateSet()
        for i, name in enumerate(self._names):
            self._coordinates.get(name).setLocked(self._state, False)
            self._coordinates.get(name).setSpeedValue(self._state, i + 1.0)
        self._order = [round(speed) - 1 for speed in self._state.getU().to_numpy()]

    def _place(self, time: float) -> None:
        q = self._spline(time)
        v = self._spline.derivative()(time)
        for i, name in enumerate(self._names):
            self._coordinates.get(name).setValue(self._state, float(q[i]), False)
            self._coordinates.get(name).setSpeedValue(self._state, float(v[i]))
        self._model.realizeVelocity(self._state)

    def _energy(self, time: float) -> float:
        self._place(time)
        kinetic = self._model.calcKineticEnergy(self._state)
        return float(kinetic + self._model.calcPotentialEnergy(self._state))

    def energy_rate(self, time: float) -> float:
        """Return the rate of energy [W], by a central difference of fourth order."""
        h = 1e-4
        return (
            self._energy(time - 2 * h)
            - 8 * self._energy(time - h)
            + 8 * self._energy(time + h)
            - self._energy(time + 2 * h)
        ) / (12 * h)

    def torques(self, time: float, accelerations: Array) -> Array:
        """Return OpenSim's inverse dynamics.

        Parameters
        ----------
        time : [s]
        accelerations : (coordinates,) [rad/s^2 or m/s^2]

        Returns
        -------
        (coordinates,) [N m or N]
        """
        self._place(time)
        given = self._vector.createFromMat(accelerations[self._order])
        torques = np.empty(len(self._names))
        torques[self._order] = self._solver.solve(self._state, given).to_numpy()
        return torques


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
