"""Knees that bend: moment arms and patellar ratios compared with published ones.

Forces in squats, rises, landings and walks are computed too. Nothing here has a measured force;
published ranges are those of instrumented knees of other people.
"""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from unittest.mock import patch

import numpy as np

import myomorph as mm
from benchmarks.accuracy.tension.knee import Row, command
from myomorph.core.io.loads import read_external_loads
from myomorph.core.io.mjcf.composed import composed_model
from myomorph.core.model.arrays import Array
from myomorph.core.muscles.model_paths import compile_paths
from myomorph.core.muscles.patella import extensors, tendon_arms
from myomorph.core.muscles.published_arms import BANDS, knee_arms
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.knees import flexion_coordinate, knee_joints
from myomorph.core.rigid.tree import compile_tree
from myomorph.core.tension.reaction import JointReactions
from myomorph.core.tension.recruitment import (
    EFFORT_ALONE,
    RecruitmentOptions,
    recruitment_terms,
)
from myomorph.core.tension.tension import Tension
from myomorph.core.tension.terms.actuators import RESERVE_FORCE, default_reserves
from myomorph.lab.analyze import generic_model as shipped

OPENCAP = "opencap-subject4-multitask"
SQUATS = "opencap-subject4-squats"
MASS = 62.6
"""Of the person [kg]."""
CUTOFF = 6.0
"""Of coordinates and ground forces [Hz]."""
EVERY = 3
"""Frames between two that are solved."""
FLEXIONS = (60.0, 80.0, 90.0, 100.0)
BUFF = {10.0: 1.0 / 0.86, 70.0: 1.0 / 1.55}
"""Tension of the patellar tendon over that of quadriceps by flexion [deg], eight knees (Buff et al.
1988).
"""


@dataclass(frozen=True)
class Activity:
    """A recording of the person.

    `implants`: greatest force in instrumented knees, mean of five persons [BW] (Kutzner et al.
    2010); "" for none.
    """

    name: str
    folder: str
    file: str
    implants: object = ""


ACTIVITIES = (
    Activity(name="five squats", folder=SQUATS, file="squats1", implants=2.53),
    Activity(name="rising from a chair", folder=OPENCAP, file="STS1", implants=2.46),
    Activity("landing from a box", OPENCAP, "DJ1"),
    Activity(name="walking", folder=OPENCAP, file="walking1", implants=2.61),
)
ALONG = "comes along"
BEFORE = "comes along, knees and muscles of myo-sim"
EXPERT = "by an expert (Lai and Arnold)"
LIKE_BEFORE = "one tension, effort alone"
LEVER = "patella as a lever"
DEFAULT = "default"
WAYS: Mapping[str, tuple[str, RecruitmentOptions, bool]] = {
    LIKE_BEFORE: ("string", RecruitmentOptions(0.0), False),
    LEVER: ("lever", RecruitmentOptions(0.0), False),
    "with rotators of the hip": ("lever", RecruitmentOptions(0.0), True),
    DEFAULT: ("lever", RecruitmentOptions(), True),
}
"""Patella, costs beside the effort, whether reserves stand in for rotators of the hip."""


def measure_arms(folder: Path) -> Iterator[Row]:
    """Measure quadriceps, its tendon, and the ratio of their forces, on the right knee of models.

    The rows have what was measured by others.
    """
    models = {
        "comes along": shipped.generic_model({})[0],
        "myo-sim as it is": composed_model("myolegs"),
        "Rajagopal 2016": mm.read_model(folder / "rajagopal-walk-emg/raw/Rajagopal2016.osim"),
        "Lai and Arnold 2017, polynomials": mm.read_model(
            folder / OPENCAP / "models/unscaled_generic.osim"
        ),
        "by an expert (Lai and Arnold)": mm.read_model(
            folder / OPENCAP / "models/manually_scaled.osim"
        ),
    }
    quadriceps = BANDS[0]
    tendon = BANDS[1]
    for name, model in models.items():
        knee = next(
            one for one in knee_joints(model) if one.name.endswith("_r") or one.child.endswith("_r")
        )
        flexion = np.array([0.0, 10.0, 30.0, 50.0, 70.0, 90.0, 110.0, 120.0])
        motion = mm.Motion(
            flexion, (flexion_coordinate(model, knee),), np.radians(flexion)[:, None]
        )
        paths = compile_paths(model)
        values = paths.tree.coordinates_of(motion)
        group = next(one for one in extensors(paths) if one.knee.name == knee.name)
        arms = tendon_arms(paths, group, values, *paths.pulls(values))
        outside = {one.name for one in knee_arms(model) if one.text}
        for number, angle in enumerate(flexion):
            ends = [band.ends(np.array([angle]), 1.0) for band in (quadriceps, tendon)]
            yield {
                "model": name,
                "flexion [deg]": angle,
                "quadriceps, mean [cm]": -100.0 * float(arms.path[number].mean()),
                "measured": (
                    f"{100 * float(ends[0][0][0]):.1f} ... {100 * float(ends[0][1][0]):.1f}"
                ),
                "patellar tendon [cm]": -100.0 * float(arms.tendon[number].mean()),
                "measured there": (
                    f"{100 * float(ends[1][0][0]):.1f} ... {100 * float(ends[1][1][0]):.1f}"
                ),
                "ratio of their forces": float(arms.ratio[number].mean()),
                "measured ratio": BUFF.get(angle, ""),
                "named by info": len(outside),
            }


def measure_forces(folder: Path) -> Iterator[Row]:
    """Force of both knees, the mean, by model and way to solve."""
    for model_name in (BEFORE, ALONG, EXPERT):
        for activity in ACTIVITIES:
            if not (folder / activity.folder).is_dir():
                print(f"{activity.name}: the recording '{activity.folder}' is absent")
                continue
            for way in WAYS:
                if model_name == BEFORE and way != LIKE_BEFORE:
                    continue
                yield _row(folder, activity, model_name, way)


def _row(folder: Path, activity: Activity, model_name: str, way: str) -> Row:
    model, motion, wrenches = inputs(folder, activity, model_name)
    found, reactions = _solved(model, motion, wrenches, way)
    total = np.linalg.norm(reactions.forces, axis=2) / model.weight
    # What a seat or a box carries is not measured: only frames count in which the feet carry the
    # person.
    standing = wrenches.forces[:, :, 1].sum(axis=1) > 0.9 * model.weight
    knees = [one.name for one in knee_joints(model)]
    bend = np.degrees(np.stack([motion[f"knee_angle_{name[-1]}"] for name in knees], axis=1))
    row: Row = {
        "activity": activity.name,
        "model": model_name,
        "solved": way,
        "frames": int(standing.sum()),
    }
    row["maximum flexion [deg]"] = float(bend[standing].max())
    for angle in FLEXIONS:
        near = standing[:, None] & (np.abs(bend - angle) < 5.0)
        row[f"total at {angle:g} deg [BW]"] = float(total[near].mean()) if near.any() else ""
    row["maximum, mean of both knees [BW]"] = float(total[standing].max(axis=0).mean())
    row["maximum in implants [BW]"] = activity.implants
    row["vastus lateralis over medialis"] = _share(found, standing)
    row["not optimal"] = int((~found.optimal).sum())
    return row


def _solved(
    model: mm.Model, motion: mm.Motion, wrenches: mm.Wrenches, way: str
) -> tuple[Tension, JointReactions]:
    """Return tensions by one of `WAYS`, and the reactions of the knees with them."""
    patella, costs, rotators = WAYS[way]
    torques = mm.inverse_dynamics(model, motion, wrenches)
    reserves = default_reserves(model)
    if not rotators:
        reserves = tuple(
            replace(one, optimal_force=RESERVE_FORCE) if one.kind == "coordinate" else one
            for one in reserves
        )
    options = mm.TensionOptions()
    terms = recruitment_terms(model, motion, torques, wrenches, costs.settled(model, options, True))
    found = mm.solve_tension(
        model, motion, torques, options, reserves, recruitment=EFFORT_ALONE, terms=terms
    )
    reactions = mm.joint_reactions(
        model,
        motion,
        found,
        wrenches,
        [one.name for one in knee_joints(model)],
        actuators=reserves,
        patella=patella,  # type: ignore[arg-type]
    )
    return found, reactions


def _share(found: mm.Tension, frames: Array) -> float:
    lateral = sum(
        found.muscle_force[frames, found.muscles.index(f"vaslat_{side}")].sum() for side in "rl"
    )
    medial = sum(
        found.muscle_force[frames, found.muscles.index(f"vasmed_{side}")].sum() for side in "rl"
    )
    return float(lateral / medial)


@cache
def inputs(
    folder: Path, activity: Activity, model_name: str
) -> tuple[mm.Model, mm.Motion, mm.Wrenches]:
    """Model, motion and wrenches on the feet that they are under, every so many frames."""
    here = folder / activity.folder
    if model_name == EXPERT:
        model = mm.read_model(folder / OPENCAP / "models/manually_scaled.osim")
        motion = mm.read_motion(here / f"ik_manual_scaling/{activity.file}_ik.mot", model)
    else:
        path = _calibrated(folder, model_name == BEFORE)
        model = mm.read_model(path)
        table = path.with_name(f"{activity.file}.mot")
        command(
            "ik",
            "--model",
            path,
            "--markers",
            here / f"markers/{activity.file}.trc",
            "--out",
            table,
        )
        motion = mm.read_motion(table, model)
    moving = mm.differentiate(motion, CUTOFF)
    assert moving.velocities is not None
    assert moving.accelerations is not None
    parts = (moving.values[::EVERY], moving.velocities[::EVERY], moving.accelerations[::EVERY])
    few = mm.Motion(moving.time[::EVERY], moving.names, *parts)
    loads = read_external_loads(here / f"grf/{activity.file}_external_forces.xml")
    wrenches = mm.resample_wrenches(loads, few.time, cutoff=CUTOFF)
    return model, few, replace(wrenches, bodies=feet_under(model, few, wrenches))


def feet_under(model: mm.Model, motion: mm.Motion, wrenches: mm.Wrenches) -> tuple[str, ...]:
    """Return the foot nearest to each force: the study's files put all of them on one talus."""
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.coordinates_of(motion))
    feet = {name: poses.origins[:, tree.body_index[name]] for name in ("calcn_r", "calcn_l")}
    bodies = []
    for number in range(wrenches.points.shape[1]):
        loaded = wrenches.forces[:, number, 1] > 100.0
        away = {
            name: (
                float(np.linalg.norm((wrenches.points[:, number] - at)[loaded], axis=1).mean())
                if loaded.any()
                else 0.0
            )
            for name, at in feet.items()
        }
        bodies.append(min(away, key=lambda name: away[name]))
    return tuple(bodies)


@cache
def _calibrated(folder: Path, plain: bool) -> Path:
    """Return the bundled model, fitted to the person by `analyze`.

    The plain one has knees and muscles as in myo-sim.
    """
    out = Path(tempfile.mkdtemp())
    here = folder / OPENCAP
    names = ("with_anatomical_knees", "with_cylinders", "with_architecture")
    with contextlib.ExitStack() as stack:
        if plain:
            for name in names:
                stack.enter_context(patch.object(shipped, name, lambda model: model))
        shipped._generic.cache_clear()
        files = (here / "markers/walking1.trc", "--static", here / "markers/static1.trc")
        loads = ("--loads", here / "grf/walking1_external_forces.xml", "--mass", MASS)
        command("analyze", *files, *loads, "--out", out)
    shipped._generic.cache_clear()
    return out / "calibrated.osim"
