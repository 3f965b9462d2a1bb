"""Forces from inertial sensors alone against force plates.

The sensors are simulated on walks whose plates were recorded.
"""

from __future__ import annotations

import contextlib
import io
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from tests.sensor_files import write_orientations
from tests.truths.simulated_sensors import Mounting, SensorErrors, SimulatedSensors, mounted_sensors

import myomorph as mm
from benchmarks.errors import rms
from benchmarks.hidden_plates import (
    CASES,
    Hidden,
    HiddenCase,
    estimated,
    feet_of,
    foot_wrench,
    opened,
    tracked,
)
from myomorph.body.sensors.sensor_kinematics import sensor_kinematics
from myomorph.body.sensors.sensor_recording import SensorRecording
from myomorph.core.contact.site_motion import rest_on_floor, walked
from myomorph.core.contact.sites import foot_sites
from myomorph.core.contact.states import ActivationOptions, ContactStateOptions, contact_activations
from myomorph.core.motion.sensors.mounting import trunk_acceleration
from myomorph.core.motion.sync import cut
from myomorph.core.tension.contact_setting import all_loads
from myomorph.lab.cli import main

Row = dict[str, object]
WALKS = tuple(case for case in CASES if case.name.startswith("walk"))
BODIES = ("pelvis", "torso", "femur_r", "tibia_r", "calcn_r", "femur_l", "tibia_l", "calcn_l")
SEEDS = range(5)
AXES = ("fore-aft", "vertical", "lateral")
KNEES = {"right": "knee_angle_r", "left": "knee_angle_l"}


def measure(folder: Path) -> Iterator[Row]:
    """Measure errors of each foot's force and knee's torque without plates.

    They are estimated by markers, and by sensors alone.
    """
    for case in WALKS:
        hidden = opened(folder, case)
        yield from _rows(hidden, "markers", [hidden])
        for how, used in (("orientations", False), ("orientations and accelerations", True)):
            yield from _rows(
                hidden, how, [by_sensors(folder, case, seed, used)[0] for seed in SEEDS]
            )


def by_sensors(
    folder: Path, case: HiddenCase, seed: int, accelerations: bool = True
) -> tuple[Hidden, SimulatedSensors]:
    """Return the recording as sensors alone show it, with the sensors.

    Those are joint angles, and where the feet have carried the body, with the pelvis sensor's
    accelerations or without.
    """
    hidden = opened(folder, case)
    model = hidden.model
    truth = tracked(folder, case, hidden.model)
    made = mounted_sensors(
        model, truth, Mounting(bodies=BODIES, accelerometers=True), SensorErrors(), seed
    )
    found = sensor_kinematics(model, SensorRecording(made.sensors, pose=made.pose))
    felt = (
        trunk_acceleration(model, found.mounting, found.sensors, truth.time)
        if accelerations
        else None
    )
    whole = mm.differentiate(walked(model, found.fit.motion, felt), hidden.cutoff)
    standing = walked(model, whole)
    feet, floor = rest_on_floor(model, standing, foot_sites(model))
    contacts = mm.find_contacts(model, standing, feet, ContactStateOptions(floor=floor.height))
    ready = contact_activations(
        model, standing, feet, contacts, ActivationOptions(floor=floor.height)
    )
    motion = cut(whole, hidden.motion.time[0], hidden.motion.time[-1])
    used = np.isin(whole.time, motion.time)
    shown = mm.Series(motion.time, ready.names, ready.values[used])
    return replace(
        hidden, motion=motion, sites=feet, contacts=contacts, activations=shown, floor=floor.height
    ), made


def _rows(hidden: Hidden, how: str, tries: list[Hidden]) -> Iterator[Row]:
    """Yield root mean square errors over the tries, foot by foot.

    Only frames count in which the plates measure all contacts.
    """
    measured = mm.inverse_dynamics(hidden.model, hidden.motion, hidden.measured)
    errors: dict[str, list[np.ndarray]] = {}
    torques: dict[str, list[np.ndarray]] = {}
    speeds = []
    for each in tries:
        tension = estimated(each)
        assert tension.contacts is not None
        carried = mm.inverse_dynamics(each.model, each.motion, all_loads(None, tension.contacts))
        speeds.append(_speed(each))
        for side, force, _ in feet_of(hidden):
            errors.setdefault(side, []).append((foot_wrench(tension, side)[0] - force)[hidden.use])
            knee = KNEES[side]
            torques.setdefault(side, []).append((carried[knee] - measured[knee])[hidden.use])
    for side, force, _ in feet_of(hidden):
        spread = np.ptp(force[hidden.use], axis=0)
        knee = measured[KNEES[side]][hidden.use]
        row: Row = {"recording": hidden.case.name, "by": how, "foot": side}
        for axis in (1, 0, 2):
            row[f"{AXES[axis]} [% range]"] = (
                100.0 * rms(np.array(errors[side])[..., axis]) / float(spread[axis])
            )
        for axis in (1, 0, 2):
            row[f"{AXES[axis]} [% weight]"] = (
                100.0 * rms(np.array(errors[side])[..., axis]) / hidden.weight
            )
        row["knee torque [N m/kg]"] = rms(np.array(torques[side])) / hidden.model.mass
        row["knee torque [% range]"] = 100.0 * rms(np.array(torques[side])) / float(np.ptp(knee))
        row["speed [m/s]"] = float(np.mean(speeds))
        yield row


def _speed(hidden: Hidden) -> float:
    """Of the pelvis along x, in the mean [m/s]."""
    way = hidden.motion["pelvis_tx"]
    time = hidden.motion.time
    return float((way[-1] - way[0]) / (time[-1] - time[0]))


def measure_intervals(folder: Path) -> Iterator[Row]:
    """Measure how much of what plates measured lies within the intervals of sensors alone.

    The intervals are those that a study writes; their widths stand in the rows too. Only samples
    count in which the foot carries 5 % of the weight, or may.
    """
    for case in WALKS:
        hidden = opened(folder, case)
        low, high = _limits(hidden, by_sensors(folder, case, SEEDS[0])[1])
        torques = mm.inverse_dynamics(hidden.model, hidden.motion, hidden.measured)
        row: Row = {"recording": case.name}
        parts: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {}
        for side, force, _ in feet_of(hidden):
            foot = f"foot_{side[0]}_f"
            knee = f"{KNEES[side]}_moment"
            loaded = np.maximum(force[:, 1], high[f"{foot}y"]) > 0.05 * hidden.weight
            truths = {
                f"{AXES[axis]} [% weight]": (f"{foot}{letter}", force[:, axis])
                for axis, letter in ((1, "y"), (0, "x"), (2, "z"))
            }
            truths["knee torque [N m/kg]"] = (knee, torques[KNEES[side]])
            for name, (column, truth) in truths.items():
                unit = hidden.model.mass if "kg" in name else hidden.weight / 100.0
                inside = (low[column] <= truth) & (truth <= high[column])
                use = hidden.use & loaded
                parts.setdefault(name, []).append(
                    (inside[use], (high[column] - low[column])[use] / unit)
                )
        for name, both in parts.items():
            what, unit = name.split(" [")
            row[f"{what}, inside [%]"] = 100.0 * float(
                np.mean(np.concatenate([part[0] for part in both]))
            )
            row[f"{what}, width [{unit}"] = float(
                np.mean(np.concatenate([part[1] for part in both]))
            )
        yield row


STUDY = """
[study]
name = "sensors"
[options.id]
cutoff = {cutoff}
[uncertainty]
draws = 30
[[subject]]
name = "subject"
model = "model.osim"
steps = ["ik", "id", "muscles", "tension"]
[[subject.trials]]
name = "walk"
imu = ["walk.sto"]
imu_pose = ["pose.sto"]
contacts = "auto"
"""


def _limits(hidden: Hidden, made: SimulatedSensors) -> list[dict[str, np.ndarray]]:
    """Lower and upper limits of feet's forces and torques at the times of the plates, by column."""
    with tempfile.TemporaryDirectory() as name:
        home = Path(name)
        write_orientations(home / "walk.sto", made.sensors)
        write_orientations(home / "pose.sto", made.pose)
        mm.write_osim(hidden.model, home / "model.osim")
        (home / "study.toml").write_text(STUDY.format(cutoff=hidden.cutoff))
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            assert (
                main(
                    ["run", str(home / "study.toml"), "--out", str(home / "out"), "--workers", "1"]
                )
                == 0
            )
        tables = [
            [
                mm.read_sto(next((home / "out").rglob(f"{what}_{end}.sto")))
                for what in ("contact_groups", "torques_with_contacts")
            ]
            for end in ("low", "high")
        ]
    time = hidden.motion.time
    return [
        {
            column: np.interp(time, table.time, table[column])
            for table in both
            for column in table.names
        }
        for both in tables
    ]
