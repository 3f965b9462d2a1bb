"""Inertial sensors of recordings: files, bodies that they are on, the pose that calibrates them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from myomorph.body.sensors.first_guess import speeds_of
from myomorph.body.sensors.mounting_search import STILL, STILL_TIME
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.inertial_sensors import InertialSensors
from myomorph.core.model.model import Model
from myomorph.core.model.spatial import rotation_from_quaternion
from myomorph.core.motion.sensors.mounting import named_bodies
from myomorph.lab.study.inputs.imu import ImuFiles

QUIET = 90.0  # Percentile of the speeds of rotation that are slow while somebody stands still.


def speeds_of_rotation(sensors: InertialSensors) -> Array:
    """Speeds with which sensors rotate.

    Parameters
    ----------
    sensors : of a recording

    Returns
    -------
    (frames, sensors) [rad/s]
    """
    if sensors.orientations is None:
        assert sensors.angular_velocities is not None
        return np.asarray(np.linalg.norm(sensors.angular_velocities, axis=2))
    return speeds_of(sensors.time, rotation_from_quaternion(sensors.orientations), sensors.time)


def is_still(sensors: InertialSensors) -> bool:
    """Whether somebody stands still throughout."""
    return len(sensors) > 2 and bool(np.nanpercentile(speeds_of_rotation(sensors), QUIET) < STILL)


def starts_still(sensors: InertialSensors) -> bool:
    """Whether somebody stands still at the start, so that it is the calibration pose."""
    start = sensors.time < sensors.time[0] + STILL_TIME
    return bool(start.sum() > 1) and bool(np.nanmax(speeds_of_rotation(sensors)[start]) < STILL)


def placed_sensors(
    sensors: InertialSensors, files: Sequence[Path], model: Model, asked: ImuFiles, alone: bool
) -> tuple[ImuFiles, list[str]]:
    """Put the sensors of a recording on bodies, and leave out those without one.

    Parameters
    ----------
    sensors : of the recording
    files : that they come from
    model : whose bodies they are on
    asked : settings of the user
    alone : sensors are all there is

    Returns
    -------
    the settings, and sentences on them

    Raises
    ------
    BadData : sensors are all there is (`alone`), and none is on a body
    """
    known = named_bodies(model, sensors.names) | dict(asked.imu_bodies)
    lost = [name for name in sensors.names if name not in known]
    used = [f"{name} on {known[name]}" for name in sensors.names if known.get(name, "-") != "-"]
    where = files[0].name
    if not used:
        text = (
            f"{where}: none of its {len(sensors.names)} inertial sensors ({', '.join(lost)}) has"
            " the name of a body or segment"
        )
        if alone:
            raise BadData(f"{text}: name the body of each (--imu-bodies '{lost[0]}=BODY' ...)")
        return replace(asked, imu=()), [f"{text}: not used (--imu-bodies '{lost[0]}=BODY' ...)."]
    if sensors.orientations is None and find_spec("vqf") is None and not alone:
        return replace(asked, imu=()), [
            f"{where}: its raw inertial sensors need the package vqf: not used."
        ]
    texts = [f"Inertial sensors of {where}: {', '.join(used)}."]
    if lost:
        texts.append(
            f"Sensors without a body in {model.name}, which are not used: {', '.join(lost)}."
        )
    bodies = FrozenMap({**asked.imu_bodies, **dict.fromkeys(lost, "-")})
    return replace(asked, imu=tuple(files), imu_bodies=bodies), texts
