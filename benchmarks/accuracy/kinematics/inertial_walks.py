"""Inertial sensors beside markers: steps of two persons, and ten minutes of one.

Recordings lie in the folder that `MYOMORPH_INERTIAL` names: `steps/example_data.h5` of
TheOne-1/KAM_and_KFM_Estimation (eight sensors, markers and a plate, ten steps of each of two
persons on a treadmill) and `tasks/` of vaishak236/IMU_Kinematics_2023 (files of eight sensors over
eleven minutes, and the left knee's angle by markers).
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np

import myomorph as mm
from benchmarks.accuracy.kinematics.inertial import Row, outside
from benchmarks.accuracy.tension.knee import command
from benchmarks.recordings import RECORDINGS
from myomorph.body.sensors.sensor_kinematics import sensor_kinematics
from myomorph.body.sensors.sensor_recording import SensorRecording, TrackedMarkers
from myomorph.core.io.sto import read_sto
from myomorph.core.model.inertial_sensors import InertialSensors
from myomorph.core.model.model import Frame
from myomorph.core.model.spatial import (
    Transform,
    axis_rotation,
    quaternion_from_rotation,
    rotation_from_quaternion,
)
from myomorph.core.motion.ik import inverse_kinematics
from sensor_files import write_orientations

RATE = 100.0
BODIES = {
    "pelvis": "WAIST",
    "torso": "CHEST",
    "femur_r": "R_THIGH",
    "tibia_r": "R_SHANK",
    "calcn_r": "R_FOOT",
    "femur_l": "L_THIGH",
    "tibia_l": "L_SHANK",
    "calcn_l": "L_FOOT",
}
"""Of Rajagopal's model, as OpenSim's tool wants sensors named, and what the recording calls its
sensors.
"""
MARKERS = tuple(
    f"{side}{landmark}"
    for side in "LR"
    for landmark in (
        "FCC",
        "FM5",
        "FM2",
        "TAM",
        "FAL",
        "SK",
        "TT",
        "FME",
        "FLE",
        "TH",
        "FT",
        "IPS",
        "IAS",
        "AC",
    )
) + ("MAI", "SXS", "SJN", "CV7")
APART = 2.0
"""From the start of a step to that of the next, where all are one recording [s]."""
GRAVITY = 9.81
SLIP = np.radians(20.0)


def measure_steps() -> Iterator[Row]:
    """Compare joint angles of two persons' steps by sensors alone with those by markers.

    The rows are of ours and of OpenSim's tool.
    """
    for name, known, unseen, columns in _people():
        with tempfile.TemporaryDirectory() as home:
            for row in _compared(known, unseen, columns, Path(home)):
                yield {"person": name, **row}


def measure_forces() -> Iterator[Row]:
    """Compare the vertical force under the right foot in the same steps with the measured one.

    It is estimated by sensors alone and by markers alone, by a study with default options, and
    measured by the treadmill's right plate.
    """
    for name, known, unseen, columns in _people():
        with tempfile.TemporaryDirectory() as place:
            home = Path(place)
            _, walking = _placed(known, unseen, columns, home)
            study = [
                (
                    '[study]\nname = "steps"\n[options.ik]\nimu_mounting ='
                    ' "model"\n[[subject]]\nname = "person"'
                ),
                (
                    'model = "placed.osim"\nmass ='
                    f' {known[0][0, columns.index("body weight")]}\ncontacts = "auto"'
                ),
                'steps = ["ik", "id", "tension"]',
            ]
            for index, step in enumerate(unseen):
                start = APART * index
                write_orientations(
                    home / f"sensors{index}.sto", walking.between(start, start + 0.75 * APART)
                )
                mm.write_trc(_markers([step], columns), home / f"markers{index}.trc")
                study.append(
                    f'[[subject.trials]]\nname = "sensors{index}"\nimu = ["sensors{index}.sto"]'
                )
                study.append(
                    f'[[subject.trials]]\nname = "markers{index}"\nmarkers = "markers{index}.trc"'
                )
            (home / "study.toml").write_text("\n".join(study) + "\n", encoding="utf-8")
            command("run", home / "study.toml", "--workers", 1, "--out", home / "out")
            for kind in ("sensors", "markers"):
                pairs = [
                    _right_foot(home / "out" / "person" / f"{kind}{index}")
                    for index in range(len(unseen))
                ]
                plates = [
                    -step[: len(force), columns.index("plate_2_force_z")]
                    for step, force in zip(unseen, pairs, strict=True)
                ]
                ours = np.concatenate(pairs)
                theirs = np.concatenate(plates)
                weight = GRAVITY * known[0][0, columns.index("body weight")]
                yield {
                    "person": name,
                    "by": f"{kind} alone",
                    "RMS error [% of weight]": (
                        100.0 * float(np.sqrt(np.mean((ours - theirs) ** 2))) / weight
                    ),
                    "correlation": float(np.corrcoef(ours, theirs)[0, 1]),
                    "peak, mean [% of weight]": (
                        100.0 * float(np.mean([force.max() for force in pairs])) / weight
                    ),
                    "of the plate [% of weight]": (
                        100.0 * float(np.mean([force.max() for force in plates])) / weight
                    ),
                }


def _right_foot(folder: Path) -> np.ndarray:
    table = read_sto(folder / "contact_forces.sto")
    return sum(table[f"{body}_force_vy"] for body in ("calcn_r", "toes_r"))


def _people() -> Iterator[tuple[str, list[np.ndarray], list[np.ndarray], list[str]]]:
    """Each person's name, five known steps, five held-out steps, and the column names."""
    folder = outside("steps")
    if folder is None:
        return
    with h5py.File(folder / "example_data.h5") as file:
        columns = json.loads(file.attrs["columns"])
        people = {name: np.asarray(file[name], dtype=np.float64) for name in file}
    for name, steps in people.items():
        recorded = [step[step[:, columns.index("Quat1_WAIST")] != 0.0] for step in steps]
        yield name, recorded[: len(steps) // 2], recorded[len(steps) // 2 :], columns


def _placed(
    known: list[np.ndarray], unseen: list[np.ndarray], columns: list[str], home: Path
) -> tuple[mm.Model, InertialSensors]:
    """Return the model that `analyze` makes of markers of known steps, with frames of the sensors.

    The markers show mountings and headings of the sensors. `placed.osim` also has the frames. The
    sensors of the held-out steps are returned with these headings.
    """
    files = [home / f"step{index}.trc" for index in range(len(known))]
    for step, file in zip(known, files, strict=True):
        mm.write_trc(_markers([step], columns), file)
    mass = float(known[0][0, columns.index("body weight")])
    height = float(known[0][0, columns.index("body height")])
    command(
        "analyze",
        *files,
        "--mass",
        mass,
        "--height",
        height,
        "--workers",
        1,
        "--out",
        home / "first",
    )
    model = mm.read_model(home / "first" / "calibrated.osim")
    markers = _markers(known, columns)
    recording = SensorRecording(_sensors(known, columns), same_clock=True)
    tracked = TrackedMarkers(markers=markers, fit=inverse_kinematics(model, markers))
    mounting = sensor_kinematics(model, recording, tracked).mounting
    frames = [
        Frame(sensor, body, Transform(rotation, np.zeros(3)))
        for sensor, body, rotation in zip(
            mounting.sensors, mounting.bodies, mounting.rotations, strict=True
        )
    ]
    mm.write_osim(replace(model, frames=(*model.frames, *frames)), home / "placed.osim")
    return model, _turned(
        _sensors(unseen, columns), mounting.sensors, mounting.headings.mean(axis=0), ahead=True
    )


def _compared(
    known: list[np.ndarray], unseen: list[np.ndarray], columns: list[str], home: Path
) -> Iterator[Row]:
    from benchmarks import opensim_tools

    model, walking = _placed(known, unseen, columns, home)
    # OpenSim's tool cannot assemble this model's knees.
    opensim_tools.without_couplers(home / "placed.osim", home / "hinges.osim")
    truth = inverse_kinematics(model, _markers(unseen, columns)).motion
    for case, changed in {
        "as they come": walking,
        "right shank's turned by 20 degrees": _turned(walking, ("tibia_r_imu",), [SLIP]),
        "right shank's lost half way": _lost(walking, "tibia_r_imu"),
    }.items():
        write_orientations(home / "walk.sto", changed)
        choice = ("--imu", home / "walk.sto", "--imu-mounting", "model")
        command("ik", "--model", home / "placed.osim", *choice, "--out", home / "q.mot")
        yield {"sensors": case, "by": "ours"} | _errors(
            mm.read_motion(home / "q.mot", model), truth
        )
        if "lost" not in case:
            span = (float(walking.time[0]), float(walking.time[-1]))
            theirs = opensim_tools.imu_inverse_kinematics(
                home / "hinges.osim", home / "walk.sto", span, home
            )
            table = mm.Motion(theirs.time, theirs.names, np.radians(theirs.values))
            yield {"sensors": case, "by": "OpenSim"} | _errors(table, truth)


def _times(steps: list[np.ndarray]) -> np.ndarray:
    return np.concatenate(
        [APART * index + np.arange(len(step)) / RATE for index, step in enumerate(steps)]
    )


def _markers(steps: list[np.ndarray], columns: list[str]) -> mm.Markers:
    """Markers with y up and x forward."""
    rows = np.concatenate(steps)
    values = [[rows[:, columns.index(f"{marker}_{axis}")] for axis in "YZX"] for marker in MARKERS]
    return mm.Markers(_times(steps), MARKERS, 1e-3 * np.moveaxis(np.array(values), 2, 0))


def _sensors(steps: list[np.ndarray], columns: list[str]) -> InertialSensors:
    rows = np.concatenate(steps)
    values = [
        [rows[:, columns.index(f"Quat{part}_{where}")] for part in (1, 2, 3, 4)]
        for where in BODIES.values()
    ]
    names = tuple(f"{body}_imu" for body in BODIES)
    return InertialSensors(_times(steps), names, np.moveaxis(np.array(values), 2, 0))


def _turned(
    sensors: InertialSensors, names: Sequence[str], angles: Sequence[float], ahead: bool = False
) -> InertialSensors:
    """Rotate sensors about their own y axis, along the segment.

    With `ahead`, their earths are rotated about the vertical.
    """
    quaternions = np.array(sensors.orientations)
    for name, angle in zip(names, angles, strict=True):
        index = sensors.names.index(name)
        rotations = rotation_from_quaternion(quaternions[:, index])
        turned = axis_rotation(np.eye(3)[2 if ahead else 1], angle)
        quaternions[:, index] = quaternion_from_rotation(
            turned @ rotations if ahead else rotations @ turned
        )
    return replace(sensors, orientations=quaternions)


def _lost(sensors: InertialSensors, name: str) -> InertialSensors:
    quaternions = np.array(sensors.orientations)
    quaternions[len(sensors) // 2 :, sensors.names.index(name)] = np.nan
    return replace(sensors, orientations=quaternions)


ANGLES = {
    "hip": ("hip_flexion", "hip_adduction", "hip_rotation"),
    "knee": ("knee_angle",),
    "ankle": ("ankle_angle",),
}


def _errors(ours: mm.Series, truth: mm.Series) -> Row:
    """RMS of the angles of each joint, left and right, against those by markers [deg]."""
    row: Row = {}
    for joint, starts in ANGLES.items():
        names = [f"{start}_{side}" for start in starts for side in "rl"]
        away = np.array(
            [np.interp(truth.time, ours.time, ours[name]) - truth[name] for name in names]
        )
        row[f"{joint} [deg]"] = float(np.degrees(np.sqrt(np.mean(away**2))))
    return row


DRIFT = {
    "torso": "00B4D7D4",
    "pelvis": "00B4D7D3",
    "femur_r": "00B4D6D1",
    "tibia_r": "00B4D7FB",
    "calcn_r": "00B4D7FE",
    "femur_l": "00B4D7FD",
    "tibia_l": "00B4D7CE",
    "calcn_l": "00B4D7FF",
}
"""Sensors of the eleven minutes, by body."""
STANDS = (21.6, 23.8)
"""Of the sensors' clock [s]."""
BEHIND = 2.9
KNEE_RATE = 40.0
"""The sensors' clock against that of the markers [s], and the rate of both [Hz]."""
PARTS = {"first": (50.0, 88.0), "after 5 min": (290.0, 329.0), "after 10 min": (600.0, 636.0)}
"""In which the person sits down and stands up, on the markers' clock [s]."""


def measure_minutes(folder: Path) -> Iterator[Row]:
    """Compare the left knee by sensors with that by markers, over eleven minutes.

    A person stands up and sits down, jumps, walks and sits. The sensors stood still once, at the
    start. `drift` is the mean error less that of the first part.
    """
    home = outside("tasks")
    if home is None:
        return
    marked = np.load(home / "mocap_left_knee.npy", allow_pickle=False)
    names = [f"{sensor}={body}" for body, sensor in DRIFT.items()]
    files = [home / f"MT_01200E04_001-000_{sensor}.txt" for sensor in DRIFT.values()]
    with tempfile.TemporaryDirectory() as made:
        raw = [_without_orientation(file, Path(made)) for file in files]
        for kind, paths in (("Xsens' orientations", files), ("raw signals", raw)):
            for mounting in ("recording", "pose"):
                choice = (
                    "--imu-bodies",
                    *names,
                    "--imu-pose-time",
                    *STANDS,
                    "--imu-mounting",
                    mounting,
                )
                out = Path(made) / "q.mot"
                model_file = folder / RECORDINGS["rajagopal"].model
                command("ik", "--model", model_file, "--imu", *paths, *choice, "--out", out)
                motion = mm.read_motion(out, mm.read_model(model_file))
                knee = np.degrees(
                    np.interp(
                        np.arange(len(marked)) / KNEE_RATE + BEHIND,
                        motion.time,
                        motion["knee_angle_l"],
                    )
                )
                clock = np.arange(len(marked)) / KNEE_RATE
                first = None
                for part, (start, end) in PARTS.items():
                    error = (knee - marked)[(clock > start) & (clock < end)]
                    first = float(error.mean()) if first is None else first
                    yield {
                        "sensors": kind,
                        "mounting by": mounting,
                        "part": part,
                        "mean error [deg]": float(error.mean()),
                        "drift [deg]": float(error.mean()) - first,
                        "standard deviation [deg]": float(error.std()),
                    }


def _without_orientation(file: Path, folder: Path) -> Path:
    """Write the same export with raw signals alone."""
    lines = file.read_text(encoding="utf-8").splitlines()
    head = next(index for index, line in enumerate(lines) if line.startswith("PacketCounter"))
    width = lines[head].split("\t").index("Quat_q0")
    rows = ["\t".join(line.split("\t")[:width]) for line in lines[head:]]
    out = folder / file.name
    out.write_text("\n".join([*lines[:head], *rows]) + "\n", encoding="utf-8")
    return out
