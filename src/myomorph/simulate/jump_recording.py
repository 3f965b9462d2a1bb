"""The recorded jump: where it lies, its quiet standing, its phases, and what is mirrored for the left leg."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.errors import BadData
from myomorph.model.model import Model
from myomorph.model.series import Event, Markers, Trial, Wrenches

RECORDING = "tests/datasets/vicon_CMJ_kinem_kinet_emg.c3d"
QUIET = (1.5, 3.0)
"""When the jumper stands still [s]."""
PELVIS_MARKERS = ("LASI", "RASI", "LASIMID", "RASIMID", "LPSI", "RPSI")
LEG_MARKERS = {
    "Right_MusloPS": "femur_r",
    "Right_MusloAS": "femur_r",
    "Right_MusloAI": "femur_r",
    "Right_MusloPI": "femur_r",
    "Right_PiernaPS": "tibia_r",
    "Right_PiernaAS": "tibia_r",
    "Right_PiernaAI": "tibia_r",
    "Right_PiernaPI": "tibia_r",
    "Right_TalonSup": "calcn_r",
    "Right_TalonInf": "calcn_r",
    "Right_Meta": "calcn_r",
}
SHOULDER = "Right_Hombro"


def recording_path() -> Path:
    """The jump's C3D file in the installed package `biomdp`."""
    found = importlib.util.find_spec("biomdp")
    path = Path(found.origin).parent / RECORDING if found is not None and found.origin else None
    if path is None or not path.exists():
        raise BadData("the recording of the jump comes with the package 'biomdp': install it (pip install biomdp)")
    return path


def standing_mass(trial: Trial, model: Model) -> float:
    """Mass of the jumper [kg]: mean vertical force of plate 1 in quiet standing over gravity."""
    still = (trial.plate_time >= QUIET[0]) & (trial.plate_time <= QUIET[1])
    return float(trial.plates[0].forces[still, 1].mean() / np.linalg.norm(model.gravity))


def with_mirrored(markers: Markers) -> Markers:
    """The recording with the right leg's markers mirrored in the pelvis' middle plane, for a left leg."""
    middle, side = middle_plane(markers)
    used = (*PELVIS_MARKERS, SHOULDER, *LEG_MARKERS)
    columns = [markers[name] for name in used]
    columns += [middle + mirrored(markers[name] - middle, side) for name in LEG_MARKERS]
    names = (*used, *(mirrored_name(name) for name in LEG_MARKERS))
    return Markers(markers.time, names, np.stack(columns, axis=1))


def middle_plane(markers: Markers) -> tuple[Array, Array]:
    """A point (frames, 3) and the unit normal (frames, 3) of the upright plane that halves the pelvis.

    It lies halfway between the spines of the pelvis, across the level part of the line from left to
    right: upright, so that the mirror image of a foot on the floor stands on the floor.
    """
    side = markers["RASI"] - markers["LASI"] + markers["RPSI"] - markers["LPSI"]
    side[:, 1] = 0.0
    middle = 0.25 * (markers["RASI"] + markers["LASI"] + markers["RPSI"] + markers["LPSI"])
    return middle, side / np.linalg.norm(side, axis=1, keepdims=True)


def mirrored(vectors: Array, side: Array) -> Array:
    """Vectors (frames, 3) mirrored in planes through the origin with unit normals `side`."""
    image: Array = vectors - 2.0 * np.sum(vectors * side, axis=1, keepdims=True) * side
    return image


def mirrored_name(name: str) -> str:
    """Name of the mirror image of a right marker."""
    return name.replace("Right_", "Left_") + " (mirrored)"


def shared_wrenches(trial: Trial) -> tuple[Wrenches, Array]:
    """Half of plate 1 on the right foot, its mirror image on the left, and the share that the plate tells.

    The force on the right foot acts as far forward as the center of pressure of the plate, on the line
    from the heel through the ankle's center. Were the left foot as far from the middle of the hips as
    the right one, the center of pressure would divide their distance by the shares of the feet.
    """
    plate, markers = trial.plates[0], trial.markers
    assert markers is not None
    clock = trial.plate_time
    center = plate.points
    loaded = np.isfinite(center[:, 0])
    heel, ankle, left, right = (
        _at(clock, markers.time, markers[name]) for name in ("Right_TalonInf", "RAJC", "LHJC", "RHJC")
    )
    still = (clock >= QUIET[0]) & (clock <= QUIET[1])
    run = (ankle - heel)[still].mean(axis=0)
    point = center.copy()
    point[:, 2] = ankle[:, 2] + (center[:, 0] - ankle[:, 0]) * run[2] / run[0]
    force = np.where(loaded[:, None], 0.5 * plate.forces, 0.0)
    torque = 0.5 * np.nan_to_num(plate.torques)
    middle, side = (_at(clock, markers.time, one) for one in middle_plane(markers))
    side = side / np.linalg.norm(side, axis=1, keepdims=True)
    forces = np.stack([force, mirrored(force, side)], axis=1)
    points = np.stack([point, middle + mirrored(point - middle, side)], axis=1)
    # A torque is an axial vector: its mirror image turns the other way.
    torques = np.stack([torque, -mirrored(torque, side)], axis=1)
    wrenches = Wrenches(clock, ("right_foot", "left_foot"), ("calcn_r", "calcn_l"), forces, points, torques)
    hips = 0.5 * (left + right)[:, 2]
    share = 0.5 + 0.5 * (center[:, 2] - hips) / (point[:, 2] - hips)
    return wrenches, np.where(loaded, share, np.nan)


def _at(clock: Array, time: Array, column: Array) -> Array:
    return np.column_stack([np.interp(clock, time, one) for one in column.T])


def events_of(trial: Trial) -> tuple[Event, ...]:
    """Phases of the jump, read off the vertical force of plate 1.

    Start: the force leaves quiet standing by five of its standard deviations for good; lowest: the
    pelvis markers are lowest before take-off; take-off and landing: the plate is unloaded and loaded
    again; peak: the largest force after landing.
    """
    plate, markers, clock = trial.plates[0], trial.markers, trial.plate_time
    assert markers is not None
    force = plate.forces[:, 1]
    loaded = np.isfinite(plate.points).all(axis=1)
    flight = np.flatnonzero(~loaded & (clock > QUIET[1]))
    if not len(flight):
        raise BadData("plate 1 is never unloaded: this is no jump")
    takeoff, landing = clock[flight[0]], clock[flight[-1]]
    still = (clock >= QUIET[0]) & (clock <= QUIET[1])
    level, spread = force[still].mean(), force[still].std()
    before = np.flatnonzero((np.abs(force - level) < 5.0 * spread) & (clock < takeoff - 0.5))
    height = np.mean([markers[name][:, 1] for name in PELVIS_MARKERS], axis=0)
    early = markers.time < takeoff
    lowest = markers.time[early][np.argmin(height[early])]
    start = clock[before[-1]]
    peak = clock[np.argmax(np.where(clock >= landing, force, 0.0))]
    found = {"Start": start, "Lowest": lowest, "Take-off": takeoff, "Landing": landing, "Peak": peak}
    return tuple(Event(float(time), label) for label, time in found.items())
