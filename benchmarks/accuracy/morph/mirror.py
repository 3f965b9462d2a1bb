"""The other side of models.

Measured is what mirroring changes that it must not, and how alike both legs of real models are.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

import myomorph as mm
from mujoco_models import load
from myomorph.bones.morph.mirror.model import mirrored_motion
from myomorph.bones.morph.mirror.sides import other_side_of
from myomorph.core.model.arrays import Array
from myomorph.core.model.sides import mirror_names
from myomorph.core.muscles.kinematics import MuscleKinematics
from truths.mouse_hindlimb import mouse_hindlimb_model

Row = dict[str, object]
FRAMES = 20
OPENSIM = (
    ("gait2392", "ceinms-emg-walk/model/gait2392.osim"),
    ("Rajagopal", "rajagopal-walk-emg/raw/Rajagopal2016.osim"),
    ("Lenhart knee", "lenhart-knee-contact-walk/lenhart2015.osim"),
    ("full body of cyclists", "fullbody-many-muscles/cyclistFullBodyMuscle.osim"),
    (
        "thoracoscapular shoulder",
        "shoulder-thoracoscapular/model_cmc/TSM_subject_CMC_noWeight.osim",
    ),
    ("shoulder of Wu", "c3d-functional-joints/models/Wu_Shoulder_Model_via_points.osim"),
    ("arm26", "opensim-reference-small/arm26_bounds.osim"),
)
MUJOCO = (("myolegs", "x"), ("myofullbody", "x"), ("mouse arm", "z"))


def models(folder: Path) -> Iterator[tuple[str, mm.Model, str]]:
    """Name, model, and the axis across the plane of symmetry."""
    for name, path in OPENSIM:
        yield name, mm.read_model(folder / path), "z"
    yield (
        "mouse hindlimb",
        mouse_hindlimb_model(folder / "mouse-hindlimb-muscles/mouse_hindlimb.json"),
        "z",
    )
    for name, axis in MUJOCO:
        yield f"{name} (MuJoCo)", load(name, lambda file: folder / file)[1], axis


def measure(folder: Path) -> Iterator[Row]:
    """Yield a row for every model."""
    for name, model, axis in models(folder):
        side = other_side_of(model, axis)
        motion = _through(model)
        own = mm.muscle_kinematics(model, motion, velocities=False)
        other = mm.mirrored(model, axis)
        turned = mirrored_motion(model, motion, axis)
        there = mm.muscle_kinematics(other, turned, velocities=False)
        rows = [there.muscles.index(side.named("muscles", one)) for one in own.muscles]
        columns = [
            there.coordinates.index(side.named("coordinates", one)) for one in own.coordinates
        ]
        arms = there.moment_arm[:, rows][:, :, columns] * np.array(side.of(own.coordinates))
        twice = mm.muscle_kinematics(mm.mirrored(other, axis), motion, velocities=False)
        back = [twice.muscles.index(one) for one in own.muscles]
        yield {
            "model": name,
            "muscles": len(model.muscles),
            "lengths [m]": float(np.abs(there.muscle_length[:, rows] - own.muscle_length).max()),
            "moment arms [m]": float(np.abs(arms - own.moment_arm).max()),
            "twice, lengths [m]": float(
                np.abs(twice.muscle_length[:, back] - own.muscle_length).max()
            ),
        } | _sides(model, there, turned)


def _through(model: mm.Model) -> mm.Motion:
    """Random values within the ranges, at most 1 rad or m from 0."""
    rng = np.random.default_rng(0)
    low = np.array([max(one.range[0], -1.0) for one in model.coordinates])
    high = np.maximum(low, [min(one.range[1], 1.0) for one in model.coordinates])
    values = low + (high - low) * rng.random((FRAMES, len(low)))
    return mm.Motion(0.01 * np.arange(FRAMES), model.coordinate_names, values)


def _sides(model: mm.Model, there: MuscleKinematics, turned: mm.Motion) -> Row:
    """Compare the file's muscles of each side with those mirrored from the other side.

    They are in the same poses.
    """
    known = [
        one
        for one in model.muscle_names
        if one in there.muscles and mirror_names(model.muscle_names).get(one)
    ]
    if not known or set(model.coordinate_names) != set(there.coordinates):
        return {"pairs": 0, "sides, median [mm]": "", "sides, largest [mm]": "", "largest of": ""}
    given = mm.muscle_kinematics(model, turned, velocities=False, moment_arms=False)
    own = [given.muscles.index(name) for name in known]
    other = [there.muscles.index(name) for name in known]
    apart: Array = 1000.0 * np.abs(given.muscle_length[:, own] - there.muscle_length[:, other]).max(
        axis=0
    )
    worst = int(np.argmax(apart))
    return {
        "pairs": len(known) // 2,
        "sides, median [mm]": float(np.median(apart)),
        "sides, largest [mm]": float(apart[worst]),
        "largest of": known[worst],
    }
