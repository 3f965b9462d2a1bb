"""How far patellae lie from the knees' axes, by markers on them.

People are made by OpenSim and a bone's mesh, with known distances.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from tests.truths.patella_person import (
    FLEXION,
    WAY,
    PatellaPerson,
    Traits,
    recorded_person,
)

import myomorph as mm
from benchmarks.accuracy.tension.knee import command
from benchmarks.accuracy.tension.patella_markers import patella_line
from benchmarks.errors import rms
from benchmarks.results import Row
from myomorph.core.motion.protocols import recognize
from myomorph.core.muscles.patella import patella_of
from myomorph.core.muscles.patella_distance import (
    middle_of_paths,
    patella_directions,
    with_patellae_farther,
)
from myomorph.core.rigid.kinematics import standing_poses
from myomorph.core.rigid.knees import knee_joints
from myomorph.lab.analyze.generic_model import generic_model

RAJAGOPAL = "rajagopal-walk-emg/raw/Rajagopal2016.osim"
PATELLA = "bones-opensim-rajagopal/Geometry/r_patella.vtp"
FIRST_SEED = 700
"""Those below 100 were looked at while the estimate was made."""


@dataclass(frozen=True, kw_only=True)
class Group:
    """People who were drawn alike.

    Attributes
    ----------
    name : in the table
    people : how many
    traits : what is not drawn
    """

    name: str
    people: int
    traits: Traits


GROUPS = (
    Group(name="as drawn", people=20, traits=Traits()),
    Group(name="patellae 8 mm farther", people=5, traits=Traits(farther=0.008)),
    Group(name="patellae 8 mm nearer", people=5, traits=Traits(farther=-0.008)),
    Group(name="skin of 12 mm", people=5, traits=Traits(farther=0.0, skin=0.012)),
    Group(name="as the model", people=5, traits=Traits(farther=0.0)),
)


def measure(folder: Path) -> Iterator[Row]:
    """Errors of the estimated distance, by `myomorph calibrate`, a row for each group."""
    seed = FIRST_SEED
    for group in GROUPS:
        found = []
        for _ in range(group.people):
            person = recorded_person(folder / RAJAGOPAL, folder / PATELLA, seed, group.traits)
            found.append(_of_person(person))
            seed += 1
        yield {"people": group.name, "count": group.people} | _summary(found)


def _of_person(person: PatellaPerson) -> Mapping[str, float]:
    """Compare true and estimated distances of a person [m]."""
    with tempfile.TemporaryDirectory() as work:
        here = Path(work)
        model, _ = generic_model(recognize(person.walk.names).sites)
        mm.write_osim(model, here / "generic.osim")
        mm.write_trc(person.walk, here / "walk.trc")
        mm.write_trc(person.static, here / "static.trc")
        files = ("--markers", here / "walk.trc", "--static", here / "static.trc")
        out = here / "person.osim"
        command("calibrate", "--model", here / "generic.osim", *files, "--out", out)
        found = mm.read_model(out)
        row = patella_line(here / "person_calibration")
    back = dict.fromkeys(patella_directions(found), -1e-3 * float(row["farther_mm"]))
    return {
        "farther": person.farther,
        "found": 1e-3 * float(row["farther_mm"]),
        "low": 1e-3 * float(row["lowest_mm"]),
        "high": 1e-3 * float(row["highest_mm"]),
        "share": float(row["share"]),
        "shown": float(row["shown"] == "True"),
        "reach": person.reach,
        "reach with": reach(found),
        "reach without": reach(with_patellae_farther(found, back)),
    }


def reach(model: mm.Model) -> float:
    """Mean distance of the muscle paths on the patella from the knee's center [m].

    Along the way out, where the knees are bent by `FLEXION`.
    """
    poses = standing_poses(model, {"knee_angle_r": FLEXION, "knee_angle_l": FLEXION})
    found = []
    for knee in knee_joints(model):
        patella = patella_of(model, knee)
        assert patella is not None
        middle = middle_of_paths(model, patella)
        assert middle is not None
        center = poses[knee.child].apply(knee.child_frame.translation)
        way = poses[patella].rotation @ WAY
        found.append(float((poses[patella].apply(middle) - center) @ way))
    return float(np.mean(found))


def _summary(found: Sequence[Mapping[str, float]]) -> Row:
    """Errors of all people of a group [mm]."""
    values = {name: np.array([one[name] for one in found]) for name in found[0]}
    truth = values["farther"]
    inside = (values["low"] <= truth) & (truth <= values["high"])
    error = values["found"] - truth
    return {
        "error of the prior [mm]": 1e3 * rms(truth),
        "error [mm]": 1e3 * rms(error),
        "mean error [mm]": 1e3 * float(error.mean()),
        "in the 90 % interval [%]": 100.0 * float(inside.mean()),
        "by the markers [%]": 100.0 * float(values["share"].mean()),
        "shown": int(values["shown"].sum()),
        "error of the lever without [mm]": 1e3 * rms(values["reach without"] - values["reach"]),
        "error of the lever with [mm]": 1e3 * rms(values["reach with"] - values["reach"]),
    }
