"""Recorded walks in MuJoCo under our activations.

Compared are the forces of its muscles with ours, and where its steps lead. The steps of a recording
give angles, torques and activations; the model is exported. MuJoCo's copy gets the recorded ground
forces, our reserves and our activations, as they are and without dynamics of its own, and computes
the forces of its muscles itself.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
from scipy.interpolate import CubicHermiteSpline, CubicSpline

import myomorph as mm
from benchmarks.recordings import RECORDINGS, read_markers
from myomorph.core.io.loads import read_external_loads
from myomorph.core.io.mjcf.compile import silent_mujoco
from myomorph.core.model.arrays import Array
from myomorph.core.muscles.model_paths import compile_paths
from myomorph.core.rigid.dynamics import values_and_rates
from myomorph.core.rigid.tree import compile_tree
from myomorph.core.tension.tension import Tension, TensionOptions
from myomorph.exchange.mujoco.copy import MujocoCopy
from myomorph.exchange.mujoco.export import in_copy, mujoco_model
from myomorph.exchange.mujoco.muscle_forces import mujoco_muscles

Row = dict[str, object]
WALKS = {"gait2354": (0.5, 1.6), "rajagopal": (0.6, 1.6), "opencap-walk": (0.3, 1.2)}
"""Recordings, and the part in which plates catch all steps [s]."""
CUTOFF = 6.0
WINDOWS = (0.05, 0.1)
"""Steps without correction [s], from starts this far apart."""
BETWEEN = 0.1
STIFFNESS = (300.0, 2e4)
DAMPING = (15.0, 1e3)
"""Of the correction, for angles and for the pelvis' place [N m/rad], [N m s/rad] and [N/m], [N
s/m].
"""
IDLE = int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
TRANSLATIONS = ("pelvis_tx", "pelvis_ty", "pelvis_tz")
COORDINATES = (
    "hip_flexion_r",
    "hip_adduction_r",
    "hip_rotation_r",
    "knee_angle_r",
    "ankle_angle_r",
)


class Activations(NamedTuple):
    """Activations of some muscles, and the torques that those muscles give with them.

    The torques are by our formulas.
    """

    of: str
    tension: Tension
    torques: Array


@dataclass(frozen=True)
class Walk:
    """A walk and the model's copy.

    Its coordinates are `there` and their rates `rates` (frames, coordinates), our moment arms
    `arms` (frames, muscles, free).
    """

    motion: mm.Motion
    wrenches: mm.Wrenches
    activations: tuple[Activations, ...]
    copy: MujocoCopy
    there: Array
    rates: Array
    arms: Array


def measure(folder: Path) -> Iterator[Row]:
    """Yield a row for each walk and choice of activations.

    It has torques of muscles, and errors of MuJoCo's steps.
    """
    for name, walk in _walks(folder):
        yield _row(walk, name, "none, torques of our muscles", walk.activations[0], False)
        for choice in walk.activations:
            yield _row(walk, name, choice.of, choice, True)


def measure_torques(folder: Path) -> Iterator[Row]:
    """Yield a row for each walk and coordinate.

    It has torques of MuJoCo's muscles less those of ours, by the choice of activations.
    """
    for name, walk in _walks(folder):
        theirs = [_mujoco_torques(walk, choice.tension) for choice in walk.activations]
        for coordinate in COORDINATES:
            column = walk.copy.free.index(coordinate)
            ours = walk.activations[0].torques[:, column]
            row: Row = {
                "walk": name,
                "coordinate": coordinate,
                "ours, range [N m]": float(np.ptp(ours)),
            }
            for choice, torques in zip(walk.activations, theirs, strict=True):
                off = _rms(torques[:, column] - choice.torques[:, column])
                row |= {
                    f"{choice.of}, RMS [N m]": off,
                    f"{choice.of} [% of range]": 100.0 * off / float(np.ptp(ours)),
                }
            yield row


def _walks(folder: Path) -> Iterator[tuple[str, Walk]]:
    for name in WALKS:
        if (folder / RECORDINGS[name].model).exists():
            yield name, _walk(folder, name)


@lru_cache(maxsize=len(WALKS))
def _walk(folder: Path, name: str) -> Walk:
    files = RECORDINGS[name]
    model = mm.read_model(folder / files.model)
    whole = mm.differentiate(
        mm.inverse_kinematics(model, read_markers(folder / files.markers)).motion, CUTOFF
    )
    start, end = WALKS[name]
    motion = whole.frames((whole.time >= start) & (whole.time <= end))
    wrenches = mm.resample_wrenches(read_external_loads(folder / files.loads), motion.time, CUTOFF)
    torques = mm.inverse_dynamics(model, motion, wrenches)
    with tempfile.TemporaryDirectory() as temporary:
        path = Path(temporary) / "walk.xml"
        mm.write_mjcf(model, path)
        copied = mujoco_model(model)[0]
        copy = MujocoCopy(path, copied)
    there, rates = _in_copy(model, copied, motion)
    arms = _arms(model, motion, copy.free)
    return Walk(
        motion=motion,
        wrenches=wrenches,
        activations=tuple(_activations(model, motion, torques, arms)),
        copy=copy,
        there=there,
        rates=rates,
        arms=arms,
    )


def _in_copy(model: mm.Model, copied: mm.Model, motion: mm.Motion) -> tuple[Array, Array]:
    """Return a motion's coordinates and their rates (frames, coordinates) in the exported model."""
    coordinates, speeds = values_and_rates(compile_tree(model), motion)
    there = in_copy(copied, model, coordinates)
    rates = np.zeros_like(there)
    rates[:, [copied.coordinate_names.index(column) for column in model.coordinate_names]] = speeds
    moving = mm.Motion(motion.time, copied.coordinate_names, there, rates)
    return there, values_and_rates(compile_tree(copied), moving)[1]


def _arms(model: mm.Model, motion: mm.Motion, free: Sequence[str]) -> Array:
    """Return our moment arms (frames, muscles, free) about free coordinates."""
    paths = compile_paths(model)
    coordinates, _ = values_and_rates(compile_tree(model), motion)
    _, _, pairs = paths.evaluate(coordinates)
    arms = np.zeros((len(motion), len(model.muscles), len(model.coordinates)))
    arms[:, paths.arm_muscle, paths.arm_coordinate] = pairs
    return arms[:, :, [model.coordinate_names.index(column) for column in free]]


def _activations(
    model: mm.Model, motion: mm.Motion, torques: mm.Series, arms: Array
) -> Iterator[Activations]:
    """Yield the activations of each choice of muscles that give some torques."""
    for of, muscles, passive in (
        ("of our muscles", model.muscles, False),
        ("of our muscles with passive force", model.muscles, True),
        ("of MuJoCo's muscles", mujoco_muscles(model), True),
    ):
        tension = mm.solve_tension(
            replace(model, muscles=muscles), motion, torques, TensionOptions(passive=passive)
        )
        yield Activations(of, tension, np.einsum("fmc,fm->fc", arms, tension.muscle_force))


def _mujoco_torques(walk: Walk, tension: Tension) -> Array:
    """(frames, free) what MuJoCo's muscles give in the recorded states [N m or N]."""
    copy = walk.copy
    torques = np.empty(walk.arms.shape[::2])
    # Wrapping muscles remember their side: each frame is reached from the one before.
    route = np.arange(-1, len(walk.motion) - 1)
    arms = copy.lengths_and_arms(walk.there, route)[1]
    for frame in range(len(walk.motion)):
        _start(walk, frame)
        copy.d.act[:] = tension.activation[frame]
        mujoco.mj_forward(copy.m, copy.d)
        torques[frame] = -copy.d.actuator_force[: len(tension.muscles)] @ arms[frame]
    return torques


def _start(walk: Walk, frame: int, muscles: bool = True) -> None:
    """Put MuJoCo's copy into the recorded state of a frame.

    Its muscles are idle where they are not wanted.
    """
    copy = walk.copy
    flags = copy.m.opt.disableflags & ~IDLE
    copy.m.opt.disableflags = flags if muscles else flags | IDLE
    mujoco.mj_resetData(copy.m, copy.d)
    copy.place(walk.there[frame])
    copy.d.qvel[copy.dofs] = walk.rates[frame, copy.columns]


def _row(walk: Walk, name: str, title: str, choice: Activations, muscles: bool) -> Row:
    joints = _joints(walk.copy)
    row: Row = {"walk": name, "activations": title}
    if muscles:
        off = _mujoco_torques(walk, choice.tension) - choice.torques
        row["muscle torques, RMS [N m]"] = _rms(off[:, joints])
        row["of our muscle torques [%]"] = (
            100.0 * _rms(off[:, joints]) / _rms(choice.torques[:, joints])
        )
    time = walk.motion.time
    for seconds in WINDOWS:
        starts = np.searchsorted(time, np.arange(time[0], time[-1] - seconds, BETWEEN))
        ends = [
            _forward(walk, choice, muscles, int(start), seconds, False)[0][-1] for start in starts
        ]
        row[f"after {1e3 * seconds:.0f} ms, RMS [deg]"] = _rms(np.array(ends))
    angles, corrections = _forward(walk, choice, muscles, 0, float(time[-1] - time[0]), True)
    row["corrected, RMS [deg]"] = _rms(angles)
    row["correction, RMS [N m]"] = _rms(corrections)
    row["correction [% of muscle torques]"] = (
        100.0 * _rms(corrections) / _rms(choice.torques[:, joints])
    )
    return row


def _forward(
    walk: Walk, choice: Activations, muscles: bool, start: int, seconds: float, corrected: bool
) -> tuple[Array, Array]:
    """Errors of angles [deg] and corrections (steps, joints) of MuJoCo's steps from a frame on.

    `muscles`: whether MuJoCo's pull; else our muscles' torques act; `corrected`: whether springs
    and dampers help.
    """
    copy = walk.copy
    m = copy.m
    d = copy.d
    recorded = _recorded(walk, choice, muscles)
    begin = walk.motion.time[start]
    _start(walk, start, muscles)
    free = [copy.simple[name][0] for name in copy.free]
    stiffness, damping = _springs(copy, corrected)
    # Taken implicitly by MuJoCo's integrator, as feet are light.
    m.dof_damping[copy.free_dofs] = damping
    errors = []
    corrections = []
    with silent_mujoco():
        for step in range(round(seconds / m.opt.timestep)):
            now = begin + step * m.opt.timestep
            # Loads act at points of the laboratory: bodies are where this step finds them.
            mujoco.mj_step1(m, d)
            gap = recorded.path(now) - d.qpos[free]
            rate = recorded.speed(now) - d.qvel[copy.free_dofs]
            corrections.append(stiffness * gap + damping * rate)
            d.qfrc_applied[copy.free_dofs] = (
                recorded.torques(now) + corrections[-1] + damping * d.qvel[copy.free_dofs]
            )
            recorded.drive(d, now)
            mujoco.mj_step2(m, d)
            errors.append(
                np.degrees(d.qpos[free] - recorded.path(begin + (step + 1) * m.opt.timestep))
            )
    joints = _joints(copy)
    return np.array(errors)[:, joints], np.array(corrections)[:, joints]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Recorded:
    """What was recorded, and what acts with it, as functions of time [s].

    Attributes
    ----------
    path, speed : (free,) coordinates [rad or m] and their rates
    torques : (free,) beside those of muscles [N m or N]
    activation : (muscles,)
    forces, moments : (loads, 3) ground forces [N], and their moments about the ground's origin
    bodies : numbers of the bodies that the loads act on
    """

    path: CubicHermiteSpline
    speed: CubicHermiteSpline
    torques: CubicSpline
    activation: CubicSpline
    forces: CubicSpline
    moments: CubicSpline
    bodies: Sequence[int]

    def drive(self, d: mujoco.MjData, now: float) -> None:
        """Set activations and ground forces of a time."""
        d.act[:] = np.clip(self.activation(now), 0.0, 1.0)
        d.ctrl[: len(d.act)] = d.act
        d.xfrc_applied[:] = 0.0
        for i, body in enumerate(self.bodies):
            force = self.forces(now)[i]
            d.xfrc_applied[body, :3] += force
            d.xfrc_applied[body, 3:] += self.moments(now)[i] - np.cross(d.xipos[body], force)


def _recorded(walk: Walk, choice: Activations, muscles: bool) -> _Recorded:
    copy = walk.copy
    time = walk.motion.time
    tension = choice.tension
    loads = walk.wrenches
    columns = [copy.model.coordinate_names.index(name) for name in copy.free]
    needed = tension.balanced_torque[:, [tension.coordinates.index(name) for name in copy.free]]
    path = CubicHermiteSpline(time, walk.there[:, columns], walk.rates[:, columns])
    moments = loads.torques + np.cross(np.nan_to_num(loads.points), loads.forces)
    return _Recorded(
        path=path,
        speed=path.derivative(),
        torques=CubicSpline(time, needed - choice.torques if muscles else needed),
        activation=CubicSpline(time, tension.activation),
        forces=CubicSpline(time, loads.forces),
        moments=CubicSpline(time, moments),
        bodies=[mujoco.mj_name2id(copy.m, mujoco.mjtObj.mjOBJ_BODY, body) for body in loads.bodies],
    )


def _springs(copy: MujocoCopy, corrected: bool) -> tuple[Array, Array]:
    """Return stiffness and damping (free,) of springs at the coordinates, 0 without correction."""
    translating = np.array([name in TRANSLATIONS for name in copy.free])
    stiffness = corrected * np.where(translating, STIFFNESS[1], STIFFNESS[0])
    damping = corrected * np.where(translating, DAMPING[1], DAMPING[0])
    return stiffness, damping


def _joints(copy: MujocoCopy) -> list[int]:
    """Numbers of the free coordinates between bodies; in these models all of them are angles."""
    return [i for i, name in enumerate(copy.free) if not name.startswith("pelvis")]


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
