"""Faults of inertial sensors put into recordings: errors of the angles, and what was said.

The truth is simulated by SciPy alone (`tests/truths/sensed_person.py`), on the minute of walking of
the data collection.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from tests.truths.sensed_person import (
    SEGMENTS,
    Chain,
    PersonErrors,
    SensedPerson,
    quaternions,
    sensed_person,
)

import myomorph as mm
from benchmarks.recordings import RECORDINGS
from myomorph.body.sensors.sensor_kinematics import sensor_kinematics
from myomorph.body.sensors.sensor_recording import SensorRecording
from myomorph.core.model.inertial_sensors import InertialSensors
from myomorph.core.motion.sensors.sensor_fit import SensorFit

Row = dict[str, object]
WALK = "treadmill"
SECONDS = 14.0  # Of the walk [s]
EVERY = 2  # So many of its frames make one of the sensors
SEEDS = (100,)
"""Of persons that no threshold was chosen on."""
JOINTS = {"hip": ("hip_flexion", "hip_adduction", "hip_rotation"), "knee": ("knee_angle",)}
SHANK = SEGMENTS.index("tibia_r")
OTHER_SHANK = SEGMENTS.index("tibia_l")
LOST = slice(150, 225)
"""Frames of three seconds."""


def measure(folder: Path) -> Iterator[Row]:
    """Root mean squares of the angles' errors over persons, and whether the fault was named."""
    files = RECORDINGS[WALK]
    model = mm.read_model(folder / files.model)
    motion = mm.read_motion(folder / files.motion, model)
    used = motion.time < motion.time[0] + SECONDS
    time = motion.time[used]
    angles = {name: motion[name][used] for name in motion.names if "_t" not in name[-3:]}
    chain = Chain(folder / files.model)
    for fault, change in FAULTS.items():
        squares = dict[str, list[float]]()
        said = 0
        for seed in SEEDS:
            person = sensed_person(chain, time, angles, PersonErrors(), seed)
            fit = sensor_kinematics(model, change(_recorded(person)))
            for joint, error in _errors(fit, time, angles).items():
                squares.setdefault(joint, []).append(error**2)
            said += _is_named(fit)
        errors = {
            f"{joint} [deg]": float(np.sqrt(np.mean(parts))) for joint, parts in squares.items()
        }
        yield {"fault": fault, **errors, "named": f"{said} of {len(SEEDS)}"}


def _recorded(person: SensedPerson) -> SensorRecording:
    """Sensors and calibration pose as files hold them."""
    names = tuple(f"{body}_imu" for body in person.names)
    clock = np.arange(0.0, 1.0, 0.02)
    # Two poses that are the same would be samples that repeat.
    trembling = 1e-4 * np.random.default_rng(0).normal(size=(len(clock), len(names), 4))
    return SensorRecording(
        InertialSensors(person.time[::EVERY], names, quaternions(person.earth)[::EVERY]),
        pose=InertialSensors(clock, names, quaternions(person.pose)[None] + trembling),
    )


def _errors(fit: SensorFit, time: np.ndarray, angles: dict[str, np.ndarray]) -> dict[str, float]:
    """Root mean squares by side and joint [deg]; the knee of each leg by itself."""
    motion = fit.fit.motion
    result = dict[str, float]()
    for joint, starts in JOINTS.items():
        for side in "rl":
            parts = [f"{start}_{side}" for start in starts]
            away = [motion[name] - np.interp(motion.time, time, angles[name]) for name in parts]
            result[f"{joint} {side}"] = float(np.degrees(np.sqrt(np.nanmean(np.square(away)))))
    return result


def _is_named(fit: SensorFit) -> bool:
    """Whether a message that changes results was said of the sensors."""
    said = (*fit.mounting.notes, *fit.sensors.warnings)
    return any(note.gravity != "good to know" for note in said)


Change = Callable[[SensorRecording], SensorRecording]


def _changed(change: Callable[[np.ndarray], np.ndarray], pose: bool = True) -> Change:
    """Change quaternions (frames, sensors, 4), of the calibration pose too."""

    def of(sensors: InertialSensors) -> InertialSensors:
        return replace(sensors, orientations=change(np.array(sensors.orientations)))

    def faulty(recording: SensorRecording) -> SensorRecording:
        posed = recording.pose
        if pose and posed is not None:
            posed = of(posed)
        return replace(recording, sensors=of(recording.sensors), pose=posed)

    return faulty


def _without_shank(recording: SensorRecording) -> SensorRecording:
    kept = [name for name in recording.sensors.names if name != "tibia_r_imu"]
    assert recording.pose is not None
    return replace(recording, sensors=recording.sensors.only(kept), pose=recording.pose.only(kept))


def _shanks_exchanged(quaternion: np.ndarray) -> np.ndarray:
    pair = [SHANK, OTHER_SHANK]
    quaternion[:, pair] = quaternion[:, pair[::-1]]
    return quaternion


def _scalar_last(quaternion: np.ndarray) -> np.ndarray:
    return np.roll(quaternion, -1, axis=-1)


def _held(quaternion: np.ndarray) -> np.ndarray:
    quaternion[LOST, SHANK] = quaternion[LOST.start, SHANK]
    return quaternion


FAULTS: dict[str, Change] = {
    "none": lambda recording: recording,
    "right shank's sensor missing": _without_shank,
    "shanks exchanged": _changed(_shanks_exchanged),
    "x, y, z, w": _changed(_scalar_last),
    "right shank's last sample held for 3 s": _changed(_held, pose=False),
}
