"""Faults of inertial sensors put into recordings: errors of the angles, and messages.

The truth is simulated by SciPy alone (`tests/truths/sensed_person.py`), on the minute of walking of
the data collection.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation
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
THIGH = SEGMENTS.index("femur_r")
LOST = slice(150, 225)
"""Frames of three seconds."""
LOOSE = 3.0  # Frames over which the swing of a loose sensor is correlated
MAGNET = 12.0  # Frames in which a magnetic field changes


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
    """Return whether a message on the sensors changes results."""
    said = (*fit.mounting.notes, *fit.sensors.warnings)
    return any(note.severity != "good to know" for note in said)


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


def _exchanged(first: int, second: int) -> Change:
    """Two sensors have each other's labels."""
    pair = [first, second]

    def change(quaternion: np.ndarray) -> np.ndarray:
        quaternion[:, pair] = quaternion[:, pair[::-1]]
        return quaternion

    return _changed(change)


def _scalar_last(quaternion: np.ndarray) -> np.ndarray:
    return np.roll(quaternion, -1, axis=-1)


def _conjugate(quaternion: np.ndarray) -> np.ndarray:
    return quaternion * np.array([1.0, -1.0, -1.0, -1.0])


def _held(*sensors: int) -> Change:
    """Sensors repeat their last sample for three seconds."""

    def change(quaternion: np.ndarray) -> np.ndarray:
        quaternion[LOST, sensors] = quaternion[LOST.start, sensors]
        return quaternion

    return _changed(change, pose=False)


def _lost(quaternion: np.ndarray) -> np.ndarray:
    quaternion[LOST, SHANK] = np.nan
    return quaternion


def _turned(quaternion: np.ndarray, sensor: int, vectors: np.ndarray, earth: bool) -> np.ndarray:
    """Turn a sensor by rotation vectors (frames, 3) [rad], in the earth or on its body."""
    recorded = Rotation.from_quat(np.roll(quaternion[:, sensor], -1, axis=-1))
    by = Rotation.from_rotvec(vectors)
    turned = by * recorded if earth else recorded * by
    quaternion[:, sensor] = np.roll(turned.as_quat(), 1, axis=-1)
    return quaternion


def _loose(*sensors: int) -> Change:
    """Sensors swing on their bodies by 15 degrees."""

    def change(quaternion: np.ndarray) -> np.ndarray:
        rng = np.random.default_rng(7)
        for sensor in sensors:
            swing = gaussian_filter1d(rng.normal(size=(len(quaternion), 3)), LOOSE, axis=0)
            vectors = np.radians(15.0) * swing / swing.std(axis=0)
            quaternion = _turned(quaternion, sensor, vectors, earth=False)
        return quaternion

    return _changed(change, pose=False)


def _slipped_once(sensor: int) -> Change:
    """Turn a sensor by 20 degrees on its body half way."""

    def change(quaternion: np.ndarray) -> np.ndarray:
        vectors = np.zeros((len(quaternion), 3))
        axis = np.random.default_rng(9).normal(size=3)
        vectors[len(vectors) // 2 :] = np.radians(20.0) * axis / np.linalg.norm(axis)
        return _turned(quaternion, sensor, vectors, earth=False)

    return _changed(change, pose=False)


def _late(quaternion: np.ndarray) -> np.ndarray:
    """Set the clock of a sensor behind by a frame, 40 ms."""
    quaternion[1:, SHANK] = quaternion[:-1, SHANK].copy()
    return quaternion


def _magnet(quaternion: np.ndarray) -> np.ndarray:
    """Turn the heading of a sensor by 30 degrees in the middle half."""
    count = len(quaternion)
    off = np.zeros(count)
    off[count // 4 : 3 * count // 4] = np.radians(30.0)
    vectors = np.zeros((count, 3))
    vectors[:, 2] = gaussian_filter1d(off, MAGNET)
    return _turned(quaternion, SHANK, vectors, earth=True)


FAULTS: dict[str, Change] = {
    "none": lambda recording: recording,
    "right shank's sensor missing": _without_shank,
    "shanks exchanged": _exchanged(SHANK, OTHER_SHANK),
    "right thigh and shank exchanged": _exchanged(THIGH, SHANK),
    "x, y, z, w": _changed(_scalar_last),
    "from the earth to the sensor": _changed(_conjugate),
    "right shank's last sample held for 3 s": _held(SHANK),
    "both shanks' last samples held for 3 s": _held(SHANK, OTHER_SHANK),
    "right shank lost for 3 s": _changed(_lost, pose=False),
    "right shank loose": _loose(SHANK),
    "both shanks loose": _loose(SHANK, OTHER_SHANK),
    "right thigh slips by 20 degrees half way": _slipped_once(THIGH),
    "right shank slips by 20 degrees half way": _slipped_once(SHANK),
    "right shank 40 ms late": _changed(_late, pose=False),
    "right shank's heading off by 30 degrees for half of the time": _changed(_magnet, pose=False),
}
