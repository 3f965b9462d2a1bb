"""Inertial sensors: the orientation filter against optics, and joint angles.

Joint angles are compared with OpenSim's tool and with known truth.

Recordings from outside lie in a folder that the environment variable MYOMORPH_INERTIAL names:
`broad/` has the files of data_mat of dlaidig/broad, `opensense/` those of OpenSim's tutorial
(model, placement and walking orientations), `vicon/` the walk with sensors of
AnyBody/vicon-mocap-examples. Without them the tables of simulated sensors remain.
"""

from __future__ import annotations

import json
import os
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from scipy.io import loadmat
from tests.truths.simulated_sensors import SensorErrors, SimulatedSensors, simulated_sensors

import myomorph as mm
from benchmarks.accuracy.tension.knee import command
from benchmarks.recordings import RECORDINGS
from myomorph.body.sensors.sensor_kinematics import sensor_kinematics
from myomorph.body.sensors.sensor_recording import SensorRecording, TrackedMarkers
from myomorph.core.io.inertial.read import read_inertial
from myomorph.core.model.inertial_sensors import InertialSensors
from myomorph.core.model.spatial import (
    axis_rotation,
    quaternion_from_rotation,
    rotation_from_quaternion,
    vector_from_rotation,
)
from myomorph.core.motion.ik import KinematicsFit, inverse_kinematics
from myomorph.core.motion.sensors.mounting import SensorOptions, with_orientations
from myomorph.core.motion.sync import cut
from myomorph.core.rigid.kinematics import marker_positions
from myomorph.core.rigid.tree import compile_tree
from myomorph.lab.store.results import read_result
from myomorph.lab.store.stored import get_markers
from myomorph.lab.uncertainty.sources import Sources
from sensor_files import write_orientations

Row = dict[str, object]
FOLDER = "MYOMORPH_INERTIAL"
WALK = "treadmill"
"""Of `recordings.toml`: a minute of walking, whose coordinates are the truth of simulated sensors.
"""
BODIES = ("pelvis", "torso", "femur_r", "tibia_r", "calcn_r", "femur_l", "tibia_l", "calcn_l")
JOINTS = {"hip": "hip_", "knee": "knee_angle_", "ankle": "ankle_angle_"}
SEEDS = range(5)
SECONDS = 30.0
"""Of the walk that is used where nothing else is said [s]."""
SLIP = np.radians(20.0)
Z_90 = 1.6449
"""Of a normal distribution: so many standard deviations either way hold 90 %."""
LOWER_LEG = ("tibia", "talus", "calcn", "toes")


def outside(name: str) -> Path | None:
    """Return a folder of recordings that are not in the collection, None where it is absent."""
    home = os.environ.get(FOLDER)
    folder = None if home is None else Path(home) / name
    return folder if folder is not None and folder.is_dir() else None


def measure_filter() -> Iterator[Row]:
    """Measure errors of BROAD's trials while the sensor moves.

    They are with magnetometer and without, next to published ones.
    """
    folder = outside("broad")
    if folder is None:
        return
    published = {
        name: json.loads((folder / f"results_{name}_average_rmse.json").read_text())
        for name in PUBLISHED
    }
    for path in sorted(folder.glob("*.mat")):
        data = loadmat(path, squeeze_me=True)
        clock = np.arange(len(data["imu_gyr"])) / data["sampling_rate"]
        raw = InertialSensors(
            time=clock,
            names=("sensor",),
            angular_velocities=data["imu_gyr"][:, None],
            accelerations=data["imu_acc"][:, None],
            magnetic_fields=data["imu_mag"][:, None],
        )
        optics = data["opt_quat"] / np.linalg.norm(data["opt_quat"], axis=1, keepdims=True)
        moving = data["movement"].astype(bool) & np.isfinite(optics).all(axis=1)
        row: Row = {"trial": path.stem}
        for name, magnetometer in (("9D", True), ("6D", False)):
            found = with_orientations(raw, magnetometer).orientations[moving, 0]
            total, heading, inclination = _errors(found, optics[moving], magnetometer)
            row |= {
                f"{name} total [deg]": total,
                f"{name} heading [deg]": heading,
                f"{name} inclination [deg]": inclination,
            }
            if magnetometer:
                row["within 90 % limits of sensor_noise"] = _within(found, optics[moving])
        for name, results in published.items():
            trial = results["trials"].get(path.stem)
            row[f"{name} (published) [deg]"] = (
                trial["tagp_parameters"]["total_rmse_deg"] if trial else ""
            )
        yield row


PUBLISHED = ("madgwick", "mahony")
"""Filters whose errors are among BROAD's own results, with the parameters that suit all its trials
best.
"""


def _errors(found: np.ndarray, optics: np.ndarray, headed: bool) -> tuple[float, float, float]:
    """RMS of the whole error, of heading and of inclination [deg], as BROAD computes them.

    `headed`: else the heading of the filter begins anywhere, and its mean error is taken off.
    """
    error = rotation_from_quaternion(found) @ np.swapaxes(rotation_from_quaternion(optics), 1, 2)
    q = quaternion_from_rotation(error)
    angle = 2.0 * np.arctan2(q[:, 3], q[:, 0])
    if not headed:
        angle = np.angle(np.exp(1j * (angle - np.angle(np.exp(1j * angle).mean()))))
    angle = np.angle(np.exp(1j * angle))
    inclination = 2.0 * np.arccos(np.clip(np.hypot(q[:, 0], q[:, 3]), 0.0, 1.0))
    total = 2.0 * np.arccos(np.clip(np.cos(0.5 * angle) * np.cos(0.5 * inclination), 0.0, 1.0))
    return tuple(
        float(np.degrees(np.sqrt(np.mean(part**2)))) for part in (total, angle, inclination)
    )


def _within(found: np.ndarray, optics: np.ndarray) -> float:
    """Return the share of errors about the three axes that the 90 % interval holds.

    The interval is that of the source `sensor_noise`.
    """
    error = vector_from_rotation(
        rotation_from_quaternion(found) @ np.swapaxes(rotation_from_quaternion(optics), 1, 2)
    )
    return float(np.mean(np.abs(error) < Z_90 * Sources().sensor_noise))


def measure_opensense() -> Iterator[Row]:
    """Compare OpenSim's tool and ours on its walk with eight sensors.

    Placement and orientations are the same.
    """
    folder = outside("opensense")
    if folder is None:
        return
    from benchmarks import opensim_tools

    with tempfile.TemporaryDirectory() as name:
        placed = Path(name) / "placed.osim"
        pose = folder / "placement_orientations.sto"
        opensim_tools.imu_placement(
            folder / "Rajagopal2015_opensense.osim", pose, ("torso_imu", "z"), placed
        )
        walking = folder / "walking_orientations.sto"
        theirs = opensim_tools.imu_inverse_kinematics(placed, walking, (10.5, 17.0), Path(name))
        model = mm.read_model(placed)
    walking = read_inertial(folder / "walking_orientations.sto").between(10.5, 17.0)
    recording = SensorRecording(walking, sizes=SensorOptions(imu_mounting="model"))
    sensor_kinematics(model, recording)
    began = time.process_time()
    fit = sensor_kinematics(model, recording).fit
    seconds = time.process_time() - began
    for joint, start in JOINTS.items():
        names = [
            one for one in model.coordinate_names if one.startswith(start) and "beta" not in one
        ]
        ours = np.column_stack(
            [np.degrees(np.interp(theirs.time, fit.motion.time, fit.motion[one])) for one in names]
        )
        other = theirs.values[:, [theirs.names.index(one) for one in names]]
        yield {
            "joint": joint,
            "RMS difference [deg]": float(np.sqrt(np.mean((ours - other) ** 2))),
            "largest [deg]": float(np.abs(ours - other).max()),
            "ours [ms/frame]": 1e3 * seconds / len(fit.motion),
            "OpenSim [ms/frame]": 1e3 * theirs.seconds / len(theirs.time),
        }


@lru_cache(maxsize=1)
def _walk(folder: Path) -> tuple[mm.Model, mm.Motion]:
    files = RECORDINGS[WALK]
    model = mm.read_model(folder / files.model)
    motion = mm.read_motion(folder / files.motion, model)
    return model, mm.Motion(
        motion.time, model.coordinate_names, compile_tree(model).coordinates_of(motion)
    )


def _longer(motion: mm.Motion, seconds: float) -> mm.Motion:
    """Repeat a motion forwards and backwards, so that it goes on for longer."""
    step = float(np.median(np.diff(motion.time)))
    both = np.concatenate([motion.values, motion.values[-2:0:-1]])
    count = int(seconds / step)
    values = np.tile(both, (-(-count // len(both)), 1))[:count]
    return mm.Motion(step * np.arange(count), motion.names, values)


def joint_errors(fit: KinematicsFit, motion: mm.Motion, frames: slice = slice(None)) -> Row:
    """RMS of the angles of each joint against the truth [deg]."""
    row: Row = {}
    for joint, start in JOINTS.items():
        names = [one for one in motion.names if one.startswith(start) and "beta" not in one]
        away = np.array([fit.motion[one][frames] - motion[one][frames] for one in names])
        row[f"{joint} [deg]"] = float(np.degrees(np.sqrt(np.mean(away**2))))
    return row


def _changed(
    made: SimulatedSensors, body: str, turned: np.ndarray | None, from_frame: int = 0
) -> SimulatedSensors:
    """One sensor turned on its body by a rotation (3, 3), or silent (None), from a frame on."""
    index = BODIES.index(body)
    quaternions = np.array(made.sensors.orientations)
    if turned is None:
        quaternions[from_frame:, index] = np.nan
    else:
        about = made.rotations[index].T @ turned @ made.rotations[index]
        earth = rotation_from_quaternion(quaternions[from_frame:, index])
        quaternions[from_frame:, index] = quaternion_from_rotation(earth @ about)
    return replace(made, sensors=replace(made.sensors, orientations=quaternions))


def measure_angles(folder: Path) -> Iterator[Row]:
    """Compare joint angles by simulated sensors on a walk with the truth.

    The rows are by how the mounting is found.
    """
    model, motion = _walk(folder)
    short = cut(motion, motion.time[0], motion.time[0] + SECONDS)
    long = _longer(motion, 600.0)
    slip = axis_rotation((0.0, 1.0, 0.0), SLIP)
    cases = {
        "as they come": (short, SensorErrors(), lambda made: made),
        "shank sensor turned by 20 degrees after the pose": (
            short,
            SensorErrors(),
            lambda made: _changed(made, "tibia_r", slip),
        ),
        "thigh sensor turned by 20 degrees after the pose": (
            short,
            SensorErrors(),
            lambda made: _changed(made, "femur_r", slip),
        ),
        "right shank sensor lost half way": (
            short,
            SensorErrors(),
            lambda made: _changed(made, "tibia_r", None, len(short) // 2),
        ),
        "10 minutes, headings drift by 2 degrees a minute": (
            long,
            SensorErrors(drift=np.radians(2.0)),
            lambda made: made,
        ),
    }
    for case, (truth, errors, change) in cases.items():
        for mounting in ("pose", "recording"):
            rows = []
            seconds = 0.0
            for seed in SEEDS:
                made = change(simulated_sensors(model, truth, BODIES, errors, seed))
                began = time.process_time()
                recording = SensorRecording(
                    made.sensors, pose=made.pose, sizes=SensorOptions(imu_mounting=mounting)
                )
                fit = sensor_kinematics(model, recording).fit
                seconds += (time.process_time() - began) / len(SEEDS) / len(truth)
                rows.append(joint_errors(fit, truth))
            means = {
                key: float(np.sqrt(np.mean([float(row[key]) ** 2 for row in rows])))
                for key in rows[0]
            }
            yield {"sensors": case, "mounting by": mounting, **means, "ms/frame": 1e3 * seconds}


def measure_fusion(folder: Path) -> Iterator[Row]:
    """Markers of both shanks and feet hidden for two seconds: with and without sensors on them."""
    model, motion = _walk(folder)
    truth = cut(motion, motion.time[0], motion.time[0] + SECONDS)
    plain = marker_positions(model, truth)
    lower = _on_lower_legs(model, plain.names)
    start = int(np.searchsorted(truth.time, truth.time[0] + 14.0))
    gap = slice(start, int(np.searchsorted(truth.time, truth.time[start] + 2.0)))
    rows: dict[str, list[Row]] = {}
    for seed in SEEDS:
        made = simulated_sensors(model, truth, BODIES, SensorErrors(axes=0.0), seed)
        rng = np.random.default_rng(seed)
        whole = replace(plain, values=plain.values + 0.003 * rng.normal(size=plain.values.shape))
        recording = SensorRecording(made.sensors, same_clock=True)
        hidden = np.array(whole.values)
        hidden[gap, lower] = np.nan
        fits = _with_gap(model, recording, replace(plain, values=hidden))
        fits = {"no marker hidden": inverse_kinematics(model, whole), **fits}
        for name, fit in fits.items():
            rows.setdefault(name, []).append(joint_errors(fit, truth, gap))
    for name, each in rows.items():
        yield {"recorded": name} | {
            key: float(np.sqrt(np.mean([float(row[key]) ** 2 for row in each]))) for key in each[0]
        }


def _on_lower_legs(model: mm.Model, names: Sequence[str]) -> np.ndarray:
    """Return whether each marker (markers,) is on a shank or a foot of the model."""
    bodies = {marker.name: marker.body for marker in model.markers}
    return np.array([bodies.get(name, "").startswith(LOWER_LEG) for name in names])


def _with_gap(
    model: mm.Model, recording: SensorRecording, shown: mm.Markers
) -> dict[str, KinematicsFit]:
    """Fit markers of which some are hidden, without and with sensors."""
    alone = inverse_kinematics(model, shown)
    fused = sensor_kinematics(model, recording, TrackedMarkers(markers=shown, fit=alone))
    return {"markers alone": alone, "markers and sensors": fused.fit}


def measure_intervals(folder: Path) -> Iterator[Row]:
    """Measure the coverage of true joint angles by the intervals of `ik --imu --draws`.

    The rows have the widths of the intervals too.
    """
    model_file = folder / RECORDINGS[WALK].model
    model, motion = _walk(folder)
    truth = cut(motion, motion.time[0], motion.time[0] + 12.0)
    counts: dict[tuple[str, str], list[tuple[float, float]]] = {}
    for seed in SEEDS:
        made = simulated_sensors(model, truth, BODIES, SensorErrors(), seed)
        for name, more in (("pose", ()), ("recording", ()), ("markers", ("markers",))):
            for joint, parts in _limits(model_file, model, truth, made, name, more, seed).items():
                counts.setdefault((name, joint), []).append(parts)
    for (name, joint), parts in counts.items():
        within, width = np.mean(parts, axis=0)
        yield {
            "mounting by": name,
            "joint": joint,
            "within [%]": 100.0 * float(within),
            "width [deg]": float(width),
        }


def _limits(
    model_file: Path,
    model: mm.Model,
    truth: mm.Motion,
    made: SimulatedSensors,
    kind: str,
    more: Sequence[str],
    seed: int,
) -> dict[str, tuple[float, float]]:
    """By joint, the share of true angles within the limits and the mean width of these [deg]."""
    with tempfile.TemporaryDirectory() as name:
        home = Path(name)
        write_orientations(home / "walk.sto", made.sensors)
        write_orientations(home / "pose.sto", made.pose)
        options = [
            "--imu-pose",
            home / "pose.sto",
            "--imu-mounting",
            "pose" if kind == "pose" else "recording",
        ]
        if more:
            plain = marker_positions(made.person, truth)
            noise = 0.003 * np.random.default_rng(seed).normal(size=plain.values.shape)
            mm.write_trc(replace(plain, values=plain.values + noise), home / "walk.trc")
            options = ["--markers", home / "walk.trc"]
        sensors = ("--imu", home / "walk.sto", *options)
        command("ik", "--model", model_file, *sensors, "--draws", 40, "--out", home / "q.mot")
        low = mm.read_motion(home / "q_low.mot", model)
        high = mm.read_motion(home / "q_high.mot", model)
        result = {}
        for joint, start in JOINTS.items():
            names = [one for one in truth.names if one.startswith(start) and "beta" not in one]
            inside = [(low[one] <= truth[one]) & (truth[one] <= high[one]) for one in names]
            widths = [np.degrees(high[one] - low[one]) for one in names]
            result[joint] = float(np.mean(inside)), float(np.mean(widths))
        return result


def measure_hidden() -> Iterator[Row]:
    """Estimate knees while markers below them are hidden for a second.

    The recorded walk has markers and a sensor on each shank. The truth is inverse kinematics of all
    markers.
    """
    folder = outside("vicon")
    if folder is None:
        return
    files = [folder / "Cal 01.c3d", folder / "Walking 01.c3d"]
    bodies = {"imu": "tibia_r", "imu_2": "tibia_l"}
    with tempfile.TemporaryDirectory() as name:
        command("analyze", *files, "--mass", 75, "--workers", 1, "--out", Path(name) / "out")
        model = mm.read_model(Path(name) / "out" / "calibrated.osim")
        markers = get_markers(read_result(next((Path(name) / "out").rglob("Walking_01.nc"))))
    assert markers is not None
    truth = inverse_kinematics(model, markers).motion
    below = _on_lower_legs(model, markers.names)
    recording = SensorRecording(read_inertial(files[1]), bodies, same_clock=True)
    for start in np.arange(markers.time[0] + 0.5, markers.time[-1] - 1.5, 0.5):
        gap = (markers.time >= start) & (markers.time < start + 1.0)
        values = np.array(markers.values)
        values[np.ix_(gap, below)] = np.nan
        fits = _with_gap(model, recording, replace(markers, values=values))
        row: Row = {"hidden from [s]": float(start)}
        for title, fit in fits.items():
            row[f"knee, {title} [deg]"] = _knee_error(fit.motion, truth, gap)
        sensor_error = fits["markers and sensors"].sensor_error
        row["sensors to bodies [deg]"] = float(
            np.degrees(np.sqrt(np.nanmean(sensor_error[~gap] ** 2)))
        )
        yield row


def _knee_error(motion: mm.Motion, truth: mm.Motion, gap: np.ndarray) -> float:
    """Return the root mean square error of both knees in some frames [deg]."""
    knees = [name for name in truth.names if name in ("knee_angle_r", "knee_angle_l")]
    away = np.array([(motion[knee] - truth[knee])[gap] for knee in knees])
    return float(np.degrees(np.sqrt(np.mean(away**2))))
