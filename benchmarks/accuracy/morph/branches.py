"""Where a branching point goes in other bones: by the bones around it, and by the balance of its strands' tensions."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

import myomorph as mm
from benchmarks.accuracy.morph.laws import sheared, similar
from myomorph.io.osim.read import read_osim
from myomorph.morph.maps.fields import BoneMap
from myomorph.morph.morphed import Morph, MorphOptions
from myomorph.morph.transfer.branch_points import branch_load

MODEL = "fullbody-many-muscles/cyclistFullBodyMuscle.osim"
LINK = "Abdomen"
AROUND = ("pelvis", "lumbar5", "lumbar1", "thoracic12", "rib10_R", "rib10_L")
SIZE = 1.15
"""Of a stretch along one axis, of a twin, and of the thorax that alone is larger."""
ABOUT = ("L1_L2_FE", "L1_L2_LB", "L1_L2_AR")
"""Coordinates of the trunk, in which the strands' moment arms are compared."""
STRETCHED = {
    "the same": (1.0, 1.0, 1.0),
    "a larger twin": (SIZE, SIZE, SIZE),
    "deeper": (SIZE, 1.0, 1.0),
    "taller": (1.0, SIZE, 1.0),
    "wider": (1.0, 1.0, SIZE),
}
"""Factors along x (forward), y (up) and z (right)."""


def measure(folder: Path) -> Iterator[dict[str, object]]:
    """A row for each trunk: how far the balance is from where the bones put the link, and what that changes."""
    if not (folder / MODEL).is_file():
        return
    model = read_osim(folder / MODEL)
    load = branch_load(model, LINK)
    cases = {name: sheared(model, np.diag(factors)) for name, factors in STRETCHED.items()}
    cases["larger thorax alone"] = similar(model, 1.0) | {
        name: bone for name, bone in similar(model, SIZE).items() if name.startswith(("rib", "thoracic", "sternum"))
    }
    for name, maps in cases.items():
        bones = {body: bone for body, bone in maps.items() if body != LINK}
        mapped, balanced = (_morphed(model, bones, on) for on in (False, True))
        link = balanced.bones[LINK]
        lengths, arms = _changed(mapped.model, balanced.model, load.muscles)
        yield {
            "trunk": name,
            "strands": len(load.muscles),
            "held by no line of action [% of tensions]": 100.0 * link.measures["held by no line of action"],
            "moved to balance [mm]": 1e3 * link.measures["moved to balance [m]"],
            "strands' lengths changed, rms [mm]": 1e3 * float(np.sqrt(np.mean(lengths**2))),
            "at most [mm]": 1e3 * float(np.abs(lengths).max()),
            "moment arms about the trunk changed, rms [mm]": 1e3 * float(np.sqrt(np.mean(arms**2))),
            "they at most [mm]": 1e3 * float(np.abs(arms).max()),
        }


def _morphed(model: mm.Model, bones: dict[str, BoneMap], balance: bool) -> Morph:
    options = MorphOptions(joints="mapped", clear=False, fibers="keep", force="keep", balance=balance)
    return mm.morph_model(model, bones, options, surrounding={LINK: AROUND})


def _changed(before: mm.Model, after: mm.Model, strands: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
    found = []
    for model in (before, after):
        own = replace(model, muscles=tuple(model.muscle(name) for name in strands))
        found.append(mm.muscle_kinematics(own, mm.Motion(np.zeros(1), (), np.zeros((1, 0))), velocities=False))
    columns = [found[0].coordinates.index(name) for name in ABOUT]
    arms = found[1].moment_arms[0][:, columns] - found[0].moment_arms[0][:, columns]
    return found[1].lengths[0] - found[0].lengths[0], arms
