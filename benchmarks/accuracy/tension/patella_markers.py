"""Markers on patellae: how far these lie from the knees' axes, and what knees then carry.

People are made by OpenSim and a bone's mesh, with known distances; the walks are of the man with an
instrumented left knee, to whose force nothing is fitted.
"""

from __future__ import annotations

import csv
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import myomorph as mm
from benchmarks.accuracy.tension.knee import (
    BODY_WEIGHT,
    PARTS,
    STRIDES,
    STUDY,
    command,
    measured,
)
from benchmarks.errors import rms
from benchmarks.results import Row
from myomorph.core.model.arrays import Array
from myomorph.core.motion.protocols import recognize
from myomorph.core.muscles.patella import patella_of
from myomorph.core.muscles.patella_distance import middle_of_paths
from myomorph.core.rigid.kinematics import standing_poses
from myomorph.core.rigid.knees import knee_joints
from myomorph.lab.analyze.generic_model import generic_model
from tests.truths.patella_person import (
    FLEXION,
    WAY,
    PatellaPerson,
    Traits,
    recorded_person,
)

RAJAGOPAL = "rajagopal-walk-emg/raw/Rajagopal2016.osim"
PATELLA = "bones-opensim-rajagopal/Geometry/r_patella.vtp"
FIRST_SEED = 700
"""Those below 100 were looked at while the estimate was made."""
CONTACT_FORCES = "joint_contact_forces.sto"


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
    Group(name="as drawn", people=24, traits=Traits()),
    Group(name="patellae 8 mm farther", people=6, traits=Traits(farther=0.008)),
    Group(name="patellae 8 mm nearer", people=6, traits=Traits(farther=-0.008)),
    Group(name="skin of 12 mm", people=6, traits=Traits(farther=0.0, skin=0.012)),
    Group(name="as the model", people=6, traits=Traits(farther=0.0)),
)


def measure_people(folder: Path) -> Iterator[Row]:
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
    """True and estimated distances of a person [m]."""
    with tempfile.TemporaryDirectory() as work:
        here = Path(work)
        model, _ = generic_model(recognize(person.walk.names).sites)
        mm.write_model(model, here / "generic.osim")
        mm.write_trc(person.walk, here / "walk.trc")
        mm.write_trc(person.static, here / "static.trc")
        files = ("--markers", here / "walk.trc", "--static", here / "static.trc")
        reaches = []
        for name, settings in (("with", ()), ("without", ("--no-patellae",))):
            out = here / f"{name}.osim"
            command("calibrate", "--model", here / "generic.osim", *files, "--out", out, *settings)
            reaches.append(reach(mm.read_model(out)))
        row = _patellae(here / "with_calibration")
    return {
        "farther": person.farther,
        "found": 1e-3 * float(row["farther_mm"]),
        "low": 1e-3 * float(row["lowest_mm"]),
        "high": 1e-3 * float(row["highest_mm"]),
        "share": float(row["share"]),
        "shown": float(row["shown"] == "True"),
        "reach": person.reach,
        "reach with": reaches[0],
        "reach without": reaches[1],
    }


def _patellae(tables: Path) -> Mapping[str, str]:
    """Read the line on patellae of a calibration."""
    with (tables / "patellae.csv").open(encoding="utf-8", newline="") as stream:
        return next(csv.DictReader(stream))


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


def measure(folder: Path) -> Iterator[Row]:
    """Error of the left knee's force by one `analyze` of both walks' C3D files.

    Rows are of the markers on patellae left out, and used.
    """
    for name, dropped in (("left out", True), ("used", False)):
        with tempfile.TemporaryDirectory() as work:
            here = Path(work)
            recordings = [folder / STUDY / f"{stride}.c3d" for stride in STRIDES]
            settings: tuple[object, ...] = ()
            if dropped:
                labels = here / "labels.csv"
                labels.write_text("recorded,model\nLPatella,\nRPatella,\n", encoding="utf-8")
                settings = ("--labels", labels)
            command("analyze", *recordings, "--mass", 75, *settings, "--out", here / "out")
            row = {} if dropped else _patellae(here / "out" / "calibration")
            for stride in STRIDES:
                yield {"markers on patellae": name, "stride": stride} | _errors(
                    folder, here / "out" / stride, stride, row
                )


def _errors(folder: Path, results: Path, stride: str, patellae: Mapping[str, str]) -> Row:
    """Errors of total, medial and lateral force in body weights, and the patellae's distance."""
    truth, clock = measured(folder, stride)
    forces = mm.read_sto(results / CONTACT_FORCES)
    start = _start(folder / STUDY / f"{stride}.trc")
    row: Row = {}
    for number, part in enumerate(PARTS):
        values = np.interp(clock + start, forces.time, _of_left_knee(forces, part))
        row[f"{part} [BW]"] = rms(values - truth[:, number]) / BODY_WEIGHT
        if part == "total":
            row["peak [BW]"] = float(values.max()) / BODY_WEIGHT
            row["measured peak [BW]"] = float(truth[:, number].max()) / BODY_WEIGHT
    for name in ("farther_mm", "lowest_mm", "highest_mm"):
        title = name.replace("_mm", " [mm]")
        row[title] = float(patellae[name]) if patellae else None
    return row


def _of_left_knee(forces: mm.Series, part: str) -> Array:
    """(frames,) force of a part of the left knee [N]."""
    name = next(
        name
        for name in forces.names
        if name.startswith(part) and "knee" in name and name.endswith("_l")
    )
    return np.asarray(forces[name])


def _start(path: Path) -> float:
    """When the study's table begins on the clock of the C3D file [s]."""
    with path.open(encoding="utf-8") as lines:
        head = [next(lines).split() for _ in range(3)]
    stated = dict(zip(head[1], head[2], strict=True))
    return (float(stated["OrigDataStartFrame"]) - 1.0) / float(stated["OrigDataRate"])
