"""Which norm a walk is held against: the adults that come along, or the control group of the user's
own results.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.resources import files
from pathlib import Path

import numpy as np

from myomorph.core.model.errors import BadFile, listing
from myomorph.core.model.model import Model
from myomorph.core.rigid.kinematics import standing_poses
from myomorph.lab.analysis.gait_curves import KEYS, SAMPLES, GaitCurves, joined_curves
from myomorph.lab.analysis.gait_parameters import UNITS
from myomorph.lab.analysis.gait_scores import GaitNorm, control_norm

ADULTS = "adults"
NO_NORM = "none"
SOURCE = (
    "healthy men and women of 30 to 39 years at comfortable speed on a treadmill (Normative 3D gait"
    " data of healthy adults, Maastricht UMC+, doi 10.17605/OSF.IO/T72CW, CC BY 4.0; both sexes as"
    " one group by Myomorph)"
)
LEG = 0.491
ADULT = 1.5
"""Thigh and shank as a share of stature (Drillis and Contini 1966); below this stature [m] adults
are no norm.
"""


@cache
def adult_norm() -> GaitNorm:
    """Mean and deviation of adults' curves and parameters; variables that are not in its source are
    NaN.
    """
    mean, deviation = np.full((2, SAMPLES, len(KEYS)), np.nan)
    parameters = {}
    text = (files("myomorph.lab.study.trial") / "data" / "gait_norm_adults.csv").read_text("utf-8")
    rows = csv.DictReader(line for line in text.splitlines() if not line.startswith("#"))
    for row in rows:
        numbers = float(row["mean"]), float(row["sd"])
        if row["variable"] in UNITS:
            parameters[row["variable"]] = numbers
        else:
            at = int(row["percent"]) // 2, KEYS.index(row["variable"])
            mean[at], deviation[at] = numbers
    return GaitNorm(
        mean=mean,
        deviation=deviation,
        persons=0,
        source=SOURCE,
        parameters=parameters,
        same_definitions=False,
    )


def checked_norms(norms: Sequence[str]) -> tuple[str, ...]:
    """`norms` as they are: "adults" or "none" alone, or folders; raises `BadFile`."""
    if len(norms) == 1 and norms[0] in (ADULTS, NO_NORM):
        return tuple(norms)
    for name in norms:
        if not Path(name).is_dir():
            raise BadFile(
                name,
                "is no norm",
                "give folders of results of a control group, or"
                f" {listing(name, (ADULTS, NO_NORM))}",
            )
    return tuple(norms)


def norm_of(
    norms: Sequence[str], model: Model, person: str, controls: Mapping[str, Sequence[GaitCurves]]
) -> tuple[GaitNorm | None, str]:
    """The norm for a person, and a note where there is none. Controls are by person; nobody is the
    own control.
    """
    if norms == (NO_NORM,):
        return None, "No norm was asked for."
    if norms and norms != (ADULTS,):
        others = [joined_curves(parts) for name, parts in controls.items() if name != person]
        return (
            control_norm(
                others, f"own control group, {', '.join(Path(name).name for name in norms)}"
            ),
            "",
        )
    stature = _leg(model) / LEG
    if not norms and stature < ADULT:
        return (
            None,
            (
                f"No norm: legs of a body of about {stature:.2f} m, and the norm that comes along"
                " is of adults. myomorph report --norms FOLDER takes the results of a control"
                " group; --norms adults draws adults."
            ),
        )
    return adult_norm(), ""


def _leg(model: Model) -> float:
    """Length of thigh and shank, from hip to ankle [m]; the length of an adult's where the model
    has no such joints.
    """
    poses = standing_poses(model)
    places = []
    for beginning in ("ankle_", "hip_flexion"):
        moved = (
            joint.child
            for joint in model.joints
            if any(name.startswith(beginning) for name in joint.coordinates)
        )
        places += [poses[child].translation for child in list(moved)[:1]]
    return float(np.linalg.norm(places[1] - places[0])) if len(places) == 2 else LEG * ADULT
