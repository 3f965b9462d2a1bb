"""Measured ground forces that are hidden and estimated.

All plates are hidden, some, or one plate under both feet.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

import myomorph as mm
from benchmarks.accuracy.tension.knee import command
from benchmarks.errors import rms
from benchmarks.hidden_plates import CASES, Hidden, estimated, feet_of, foot_wrench, opened
from myomorph.core.contact.plate_forces import PlateForces
from myomorph.core.contact.shared import shared_wrenches
from myomorph.core.contact.spells import hysteresis, steady
from myomorph.core.contact.states import ActivationOptions, ContactStateOptions, contact_activations
from myomorph.core.model.arrays import Array
from myomorph.core.model.series import Table
from myomorph.core.tension.tension import Tension

AXES = ("fore-aft", "vertical", "lateral")
LOADED = 0.05
UNLOADED = 0.03
"""Shares of the weight between which a measured foot begins and ceases to carry."""


def measure(folder: Path) -> Iterator[dict[str, object]]:
    """Errors of every foot's force with all plates hidden, by both formulations."""
    for case in CASES:
        hidden = opened(folder, case)
        for formulation in ("simultaneous", "sequential"):
            tension = estimated(hidden, formulation)
            for side, force, moment in feet_of(hidden):
                found = foot_wrench(tension, side)
                yield {
                    "recording": case.name,
                    "formulation": formulation,
                    "foot": side,
                    **force_errors(hidden, force, found[0]),
                    **center_errors(hidden, (force, moment), found),
                }


def measure_parts(folder: Path) -> Iterator[dict[str, object]]:
    """Split the errors into those of the whole ground force and of its sharing between the feet.

    The rows have times of contact too. Of errors e_r and e_l of the feet, the whole's is e_r + e_l,
    of masses and accelerations alone, and that of the sharing, while both carry, (e_r - e_l) / 2.
    """
    for case in CASES:
        hidden = opened(folder, case)
        if case.seated:
            continue
        tension = estimated(hidden)
        measured = np.array([(force, moment) for _, force, moment in feet_of(hidden)])
        found = np.array([foot_wrench(tension, side) for side, _, _ in feet_of(hidden)])
        errors = (found - measured)[:, 0]
        whole = errors.sum(axis=0)
        between = 0.5 * (errors[0] - errors[-1])
        row: dict[str, object] = {"recording": case.name, "low-pass [Hz]": hidden.cutoff}
        both = hidden.use & (measured[:, 0, :, 1] > UNLOADED * hidden.weight).all(axis=0)
        row |= {"frames": int(hidden.use.sum()), "on both feet": int(both.sum())}
        for axis in (1, 0, 2):
            row[f"whole, {AXES[axis]} [% weight]"] = (
                100.0 * rms(whole[hidden.use, axis]) / hidden.weight
            )
        for axis in (1, 0, 2):
            shared = 100.0 * rms(between[both, axis]) / hidden.weight if both.any() else ""
            row[f"sharing, {AXES[axis]} [% weight]"] = shared
        center = center_errors(hidden, tuple(measured.sum(axis=0)), tuple(found.sum(axis=0)))
        yield {**row, "whole COP, RMS [mm]": center["COP, RMS [mm]"], **timing(hidden)}


def measure_partial(folder: Path) -> Iterator[dict[str, object]]:
    """Estimate forces in the walk with three plates from part of what they measure.

    Known are the times of contact, one foot's force, or both feet's force only together.
    """
    hidden = opened(folder, CASES[0])
    right = [k for k, one in enumerate(hidden.measured.bodies) if one == "calcn_r"]
    known = _chosen(hidden.measured, right)
    ready = _without(hidden, "foot_r")
    ways = {
        "nothing": estimated(hidden),
        "times of contact": estimated(hidden, ready=_timed(hidden)),
        "right foot's force": estimated(hidden, known=known, ready=ready),
        "right foot's force, soft": estimated(hidden, shared=_shared(hidden, known)),
        "both feet's force together": estimated(
            hidden, shared=_shared(hidden, summed(hidden.measured))
        ),
    }
    for name, tension in ways.items():
        for side, force, moment in feet_of(hidden):
            if name == "right foot's force" and side == "right":
                continue
            found = foot_wrench(tension, side)
            yield {
                "known": name,
                "foot": side,
                **force_errors(hidden, force, found[0]),
                **center_errors(hidden, (force, moment), found),
            }


def force_errors(hidden: Hidden, force: np.ndarray, found: np.ndarray) -> dict[str, object]:
    """Return the root mean square error of each component [%].

    It is divided by the component's peak-to-peak range, and by the weight.

    Parameters
    ----------
    hidden : recording, with the frames that count
    force : (frames, 3) measured [N]
    found : (frames, 3) estimated [N]

    Returns
    -------
    Both ratios of the three components [%], by column
    """
    use = hidden.use
    errors = np.sqrt(np.mean((found - force)[use] ** 2, axis=0))
    spread = np.ptp(force[use], axis=0)
    row: dict[str, object] = {}
    for axis in (1, 0, 2):
        row[f"{AXES[axis]} [% range]"] = float(100.0 * errors[axis] / spread[axis])
    for axis in (1, 0, 2):
        row[f"{AXES[axis]} [% weight]"] = float(100.0 * errors[axis] / hidden.weight)
    return row


def center_errors(
    hidden: Hidden, measured: tuple[np.ndarray, np.ndarray], found: tuple[np.ndarray, np.ndarray]
) -> dict[str, object]:
    """Return the distance of the centers of pressure while both forces carry 5 % of the weight.

    Parameters
    ----------
    hidden : recording, with the frames that count
    measured : (frames, 3) force [N], and (frames, 3) moment about the ground's origin [N m]
    found : the same, estimated

    Returns
    -------
    Root mean square and median of the distance [mm], by column
    """
    use = (
        hidden.use
        & (measured[0][:, 1] > LOADED * hidden.weight)
        & (found[0][:, 1] > LOADED * hidden.weight)
    )
    apart = np.linalg.norm(_center(*found)[use] - _center(*measured)[use], axis=1)
    return {"COP, RMS [mm]": 1e3 * rms(apart), "COP, median [mm]": float(1e3 * np.median(apart))}


def _center(force: np.ndarray, moment: np.ndarray) -> np.ndarray:
    """Where the wrench meets the floor at height 0, (frames, 2)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.column_stack([moment[:, 2] / force[:, 1], -moment[:, 0] / force[:, 1]])


def timing(hidden: Hidden) -> dict[str, object]:
    """Compare foot strike and foot off of the estimated contacts with those of the plates [ms].

    The row has mean and standard deviation of their delay.
    """
    states = hidden.contacts.states(hidden.motion.time)
    found: dict[str, list[float]] = {"touchdown": [], "lift-off": []}
    for side, body in (("right", "calcn_r"), ("left", "calcn_l")):
        mine = [k for k, one in enumerate(hidden.raw.bodies) if one == body]
        load = hidden.raw.forces[:, mine, 1].sum(axis=1)
        on = hysteresis(load > LOADED * hidden.weight, load < UNLOADED * hidden.weight)
        plates = _events(steady(on, hidden.raw.time, 0.03), hidden.raw.time)
        columns = [k for k, one in enumerate(hidden.sites) if one.group == f"foot_{side[0]}"]
        ours = _events((states.values[:, columns] > 0.0).any(axis=1), hidden.motion.time)
        inside = hidden.motion.time[hidden.use]
        for what, theirs, guesses in zip(found, plates, ours, strict=True):
            for time in theirs:
                near = guesses[np.abs(guesses - time) < 0.15] if len(guesses) else guesses
                if inside[0] < time < inside[-1] and len(near):
                    found[what].append(1e3 * float(near[np.argmin(np.abs(near - time))] - time))
    row: dict[str, object] = {}
    for what, late in found.items():
        row[f"{what} [ms]"] = (
            f"{np.mean(late):.0f} ± {np.std(late):.0f} ({len(late)})" if late else ""
        )
    return row


def _events(state: np.ndarray, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the times at which a state (frames,) begins, and at which it has ended."""
    change = np.diff(state.astype(np.int8))
    return time[1:][change > 0], time[1:][change < 0]


def _chosen(wrenches: mm.Wrenches, columns: list[int]) -> mm.Wrenches:
    names = tuple(wrenches.names[k] for k in columns)
    bodies = tuple(wrenches.bodies[k] for k in columns)
    return mm.Wrenches(
        wrenches.time,
        names,
        bodies,
        wrenches.forces[:, columns],
        wrenches.points[:, columns],
        wrenches.torques[:, columns],
    )


def _timed(hidden: Hidden) -> mm.Series:
    """Activations whose touches begin and end when the plates are loaded and unloaded."""
    plates = mm.resample_wrenches(hidden.raw, hidden.motion.time, 3.0 * hidden.cutoff)
    told = mm.find_contacts(
        hidden.model,
        hidden.motion,
        hidden.sites,
        ContactStateOptions(floor=hidden.floor),
        plates=plates,
    )
    return contact_activations(
        hidden.model, hidden.motion, hidden.sites, told, ActivationOptions(floor=hidden.floor)
    )


def _without(hidden: Hidden, group: str) -> mm.Series:
    """Activations with none at one foot, whose force is known."""
    values = np.array(hidden.activations.values)
    values[:, [k for k, one in enumerate(hidden.sites) if one.group == group]] = 0.0
    return replace(hidden.activations, values=values)


def summed(wrenches: mm.Wrenches) -> mm.Wrenches:
    """All wrenches as one plate that carries everything, acting on no known body."""
    force = wrenches.forces.sum(axis=1)
    moment = (wrenches.torques + np.cross(wrenches.points, wrenches.forces)).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        point = np.column_stack(
            [moment[:, 2] / force[:, 1], np.zeros(len(force)), -moment[:, 0] / force[:, 1]]
        )
    point = np.where(np.isfinite(point), point, 0.0)
    torque = moment - np.cross(point, force)
    return mm.Wrenches(
        wrenches.time, ("one plate",), ("",), force[:, None], point[:, None], torque[:, None]
    )


def _shared(hidden: Hidden, plates: mm.Wrenches):
    # A plate without an outline: whoever touches may stand on it.
    return shared_wrenches(
        hidden.model,
        hidden.motion,
        hidden.sites,
        hidden.contacts,
        PlateForces(plates),
        reach=2.0,
    )


def tension_of(folder: Path, number: int) -> tuple[Hidden, Tension]:
    """One recording and its simultaneous estimate, for figures."""
    hidden = opened(folder, CASES[number])
    return hidden, estimated(hidden)


OPENCAP = "opencap-subject4-multitask"
RAJAGOPAL = "rajagopal-walk-emg"
ONE_PLATE_CASES = {
    "walk, Rajagopal": (
        f"{RAJAGOPAL}/subject_walk_scaled.osim",
        f"{RAJAGOPAL}/coordinates.sto",
        f"{RAJAGOPAL}/grf_walk.xml",
        (0.6, 1.4),
    ),
    "walk, OpenCap": (
        f"{OPENCAP}/models/manually_scaled.osim",
        f"{OPENCAP}/ik_manual_scaling/walking1_ik.mot",
        f"{OPENCAP}/grf/walking1_external_forces.xml",
        (0.3, 1.2),
    ),
    "sit to stand, OpenCap": (
        f"{OPENCAP}/models/manually_scaled.osim",
        f"{OPENCAP}/ik_manual_scaling/STS1_ik.mot",
        f"{OPENCAP}/grf/STS1_external_forces.xml",
        (1.0, 6.0),
    ),
}
"""Model, coordinates, forces of two plates, and the time [s]."""
WAYS = {"nearest foot": (), "shared": ("--contacts", "auto", "--measured", "shared")}
FOOT_LOADED = 20.0
"""Force from which on there is a center of pressure [N]."""


def measure_one_plate(folder: Path) -> Iterator[dict[str, object]]:
    """Rows: errors of each foot's force and of activations, against those of two plates."""
    for name, (model_file, motion_file, loads_file, span) in ONE_PLATE_CASES.items():
        model = mm.read_model(folder / model_file)
        motion = mm.read_motion(folder / motion_file, model)
        plates = mm.read_loads(folder / loads_file, model, motion)
        common = (
            "--model",
            folder / model_file,
            "--motion",
            folder / motion_file,
            "--cutoff",
            6,
            "--time",
            *span,
        )
        with tempfile.TemporaryDirectory() as place:
            home = Path(place)
            one = home / "one.mot"
            mm.write_sto(_added(plates), one)
            truth = _tension(home / "truth", *common, "--loads", folder / loads_file)
            for way, more in WAYS.items():
                activations = _tension(home / "found", *common, "--loads", one, *more)
                found = mm.read_loads(
                    home / "found" / "contact_forces.xml" if more else one, model, motion
                )
                row: dict[str, object] = {"recording": name, "one plate's force": way}
                for side in ("right", "left"):
                    error = _foot(found, side, truth.time) - _foot(plates, side, truth.time)
                    row[f"{side}, vertical, RMS [N]"] = float(np.sqrt(np.mean(error[:, 1] ** 2)))
                    row[f"{side}, fore-aft, RMS [N]"] = float(np.sqrt(np.mean(error[:, 0] ** 2)))
                away = activations.values - truth.values
                known = away[np.isfinite(away)]
                row["activations, RMS"] = float(np.sqrt(np.mean(known**2))) if len(known) else ""
                row["not determined [%]"] = 100.0 * (1.0 - len(known) / away.size)
                yield row


def _tension(out: Path, *typed: object) -> Table:
    """Activations of the command."""
    command("tension", "--out", out, *typed)
    return mm.read_sto(out / "activations.sto")


def _added(plates: mm.Wrenches) -> Table:
    """Add the forces of all plates, as one plate at height 0 would have measured them."""
    forces = np.nan_to_num(plates.forces)
    points = np.nan_to_num(plates.points)
    torques = np.nan_to_num(plates.torques)
    force = forces.sum(axis=1)
    moment = (torques + np.cross(points, forces)).sum(axis=1)
    loaded = force[:, 1] > FOOT_LOADED
    vertical = np.where(loaded, force[:, 1], 1.0)
    center = np.stack(
        [moment[:, 2] / vertical, np.zeros(len(force)), -moment[:, 0] / vertical], axis=1
    )
    values = np.hstack([force, center, moment - np.cross(center, force)]) * loaded[:, None]
    names = [f"ground_{part}{axis}" for part in ("force_v", "force_p", "torque_") for axis in "xyz"]
    return Table(plates.time, tuple(names), values)


def _foot(wrenches: mm.Wrenches, side: str, time: Array) -> Array:
    """(frames, 3) force on a foot [N]."""
    columns = [k for k, body in enumerate(wrenches.bodies) if body.endswith(f"_{side[0]}")]
    force = np.nan_to_num(wrenches.forces[:, columns]).sum(axis=1)
    return np.stack([np.interp(time, wrenches.time, part) for part in force.T], axis=1)
