"""Forces in hips of recordings with plates, compared with those of instrumented hips.

They are by the commands that users have. Ten people with instrumented hips (Bergmann et al. 2016),
each person's mean force at its peak in % of body weight, in the frame of the femur's shaft, as
Fischer et al. (2021) list them (RWTHmediTEC/HipJointForceModel, OrthoLoad data).
"""

from __future__ import annotations

import csv
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import myomorph as mm
from benchmarks.accuracy.tension.knee import command
from myomorph.core.model.motion_errors import MotionErrors
from myomorph.lab.store.quantities import get_value
from myomorph.lab.store.results import read_result

Row = dict[str, object]
PUBLISHED = {
    "walking": (247.1, 20.3, 16.0, 2.9, -5.7, 3.5),
    "rising": (215.0, 68.5, 23.5, 4.4, -6.8, 4.5),
}
"""Mean and standard deviation over the people of the force [%], and of its angles to the femur's
shaft, lateral and forward [degrees].
"""
SHAFT = 6.0
"""Angle between the femur's shaft and the line from hip to knee, which models' frames have
[degrees].
"""
SPREAD = 2.0
"""A person lies inside within so many standard deviations."""
OPENCAP = "opencap-subject4-multitask"
RAJAGOPAL = "rajagopal-walk-emg"
KNEE = "knee-implant-walk"
GAIT = "opensim-gait-subject01/experiment"
OWN = {
    "walk, Rajagopal": (
        "walking",
        f"{RAJAGOPAL}/subject_walk_scaled.osim",
        f"{RAJAGOPAL}/coordinates.sto",
        f"{RAJAGOPAL}/grf_walk.xml",
        "rl",
    ),
    "walk, OpenCap": (
        "walking",
        f"{OPENCAP}/models/manually_scaled.osim",
        f"{OPENCAP}/ik_manual_scaling/walking1_ik.mot",
        f"{OPENCAP}/grf/walking1_external_forces.xml",
        "rl",
    ),
    "walk, instrumented knee": (
        "walking",
        f"{KNEE}/nominal.osim",
        f"{KNEE}/walk3_ik.mot",
        f"{KNEE}/walk3_grf.xml",
        "l",
    ),
}
"""Activity, model, coordinates, forces, and the legs whose feet stand on plates all the time."""
RAW = {
    "walk, Rajagopal": ("walking", (f"{RAJAGOPAL}/markers_walk.trc",), 85.27, "rl"),
    "walk, gait2354": ("walking", (f"{GAIT}/subject01_walk1.trc",), 72.6, "rl"),
    "walk, OpenCap": (
        "walking",
        (f"{OPENCAP}/markers/walking1.trc", f"{OPENCAP}/markers/static1.trc"),
        62.6,
        "rl",
    ),
    "walk, instrumented knee": ("walking", (f"{KNEE}/walk3.c3d",), 75.0, "l"),
    "sit to stand, OpenCap": (
        "rising",
        (f"{OPENCAP}/markers/STS1.trc", f"{OPENCAP}/markers/static1.trc"),
        62.6,
        "rl",
    ),
}
"""Activity, recordings, mass of the body [kg] and legs."""


HIPS = ("hip_r", "walker_hip_r")
"""How models call the right hip."""
LEAST = ("--joint-load", "10", "--reserve", "1")
"""Of `tension`: hips' loads count more than all effort, and reserves cost more than either, so that
what comes out is about the least force that any muscles with these moment arms can give.
"""


PASSIVE = ("--joint-tissue", "hips")


def measure(folder: Path) -> Iterator[Row]:
    """Yield rows of each leg: the peak force and its direction.

    They are while muscles flex the hip, and while they extend it.
    """
    for name, (activity, *files, legs) in OWN.items():
        model_file, motion_file, loads_file = files
        model = str(folder / model_file)
        motion = str(folder / motion_file)
        loads = str(folder / loads_file)
        read = mm.read_model(model)
        hip = next(joint.name for joint in read.joints if joint.name in HIPS)
        hips = ("--joint-load-joints", f"{hip},{hip[:-1]}l")
        ways = {"default": (), "least force": (*LEAST, *hips), "passive hips": PASSIVE}
        for way, more in ways.items():
            with tempfile.TemporaryDirectory() as home:
                typed = ("--model", model, "--motion", motion, "--loads", loads)
                command("tension", *typed, "--reactions", "child", "--out", home, *more)
                command("id", *typed, "--out", f"{home}/torques.sto")
                yield from _rows(name, "the set's", way, activity, Path(home), read.mass, legs)
    for name, (activity, recordings, mass, legs) in RAW.items():
        with tempfile.TemporaryDirectory() as home:
            files = [str(folder / file) for file in recordings]
            more = ("--mass", str(mass), "--reactions", "child", "--out", home, "--workers", "1")
            command("analyze", *files, *more)
            trial = next(Path(home).glob("*/joint_reactions.sto")).parent
            yield from _rows(name, "generic, analyze", "default", activity, trial, mass, legs)


def _rows(
    name: str, model: str, way: str, activity: str, home: Path, mass: float, legs: str
) -> Iterator[Row]:
    size, size_sd, lateral, lateral_sd, forward, forward_sd = PUBLISHED[activity]
    loads = mm.read_sto(home / "joint_reactions.sto")
    torques = mm.read_sto(home / "torques.sto")
    for leg in legs:
        column = next(
            title for title in loads.names if f"_on_femur_{leg}_in_femur_{leg}_fx" in title
        )
        force = np.stack([loads[column[:-1] + axis] for axis in "xyz"], axis=1)
        moment = np.interp(loads.time, torques.time, torques[f"hip_flexion_{leg}_moment"]) / mass
        share = 100.0 * np.linalg.norm(force, axis=1) / (9.80665 * mass)
        share[~_measured(home, leg, loads.time)] = np.nan
        for start, stop in _less_sure(home):
            share[(loads.time >= start - 1e-6) & (loads.time <= stop + 1e-6)] = np.nan
        for way_bent, frames in {"extended": moment < 0.0, "flexed": moment > 0.0}.items():
            if activity == "rising" and way_bent == "flexed":
                continue
            frame = int(np.nanargmax(np.where(frames, share, np.nan)))
            outward = force[frame, 2] if leg == "r" else -force[frame, 2]
            angles = np.degrees(np.arctan2([outward, force[frame, 0]], -force[frame, 1])) + (
                SHAFT,
                0.0,
            )
            yield {
                "recording": name,
                "model": model,
                "settings": way,
                "activity": activity,
                "leg": {"r": "right", "l": "left"}[leg],
                "while the hip is": way_bent,
                "flexion moment [N m/kg]": moment[frame],
                "peak [% weight]": share[frame],
                "lateral [degrees]": angles[0],
                "forward [degrees]": angles[1],
                "measured peak": f"{size:.0f} ± {size_sd:.0f}",
                "measured lateral": f"{lateral:.0f} ± {lateral_sd:.0f}",
                "measured forward": f"{forward:.0f} ± {forward_sd:.0f}",
                "peak inside": bool(abs(share[frame] - size) < SPREAD * size_sd),
                "direction inside": bool(
                    abs(angles[0] - lateral) < SPREAD * lateral_sd
                    and abs(angles[1] - forward) < SPREAD * forward_sd
                ),
            }


def _less_sure(home: Path) -> tuple[tuple[float, float], ...]:
    """List times that a result file marks: ends of the recording, and beside long gaps [s]."""
    files = list(home.glob("*.nc"))
    errors = get_value(read_result(files[0]), MotionErrors) if files else None
    return () if errors is None else errors.less_sure


def _measured(home: Path, leg: str, time: np.ndarray) -> np.ndarray:
    """(frames,) whether no force under a leg's foot had to be estimated; all where nothing was."""
    result = np.ones(len(time), dtype=bool)
    if (home / "contacts.csv").exists():
        with (home / "contacts.csv").open(encoding="utf-8") as file:
            for row in csv.DictReader(file):
                if row["site"].endswith(f"_{leg}") and row["source"] != "plates":
                    result &= (time < float(row["start"])) | (time > float(row["stop"]))
    return result
