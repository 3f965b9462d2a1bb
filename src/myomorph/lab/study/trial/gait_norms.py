"""The norm that a walk is compared with.

It is of bundled adults, a file of norms, or the control group of the user's own results.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import NamedTuple

import numpy as np

from myomorph.core.io.parsing.named_file import is_named_file
from myomorph.core.model.errors import BadFile, listing
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.model import Model
from myomorph.core.rigid.kinematics import standing_poses
from myomorph.lab.analysis.gait_parameters import gait_parameters
from myomorph.lab.analysis.gait_scores import GaitNorm
from myomorph.lab.report.trial.prepared import Prepared
from myomorph.lab.study.trial.control_group import ControlPerson, group_norm
from myomorph.lab.study.trial.norm_file import SPEED, read_norms

ADULTS = "adults"
NO_NORM = "none"
TABLE = ".csv"
USUAL = "adults of 30 to 39 years"
"""Group that stands for adults whose age is not stated."""
LEG = 0.491
ADULT = 1.5
"""Thigh and shank as a share of stature (Drillis and Contini 1966); below this stature [m] adults
are no norm.
"""
YEAR = 1.0
"""Somebody of 39.9 years is 39."""


class ChosenNorm(NamedTuple):
    """A norm, None where none fits, and a sentence on why, or on how well it fits."""

    norm: GaitNorm | None
    note: str = ""


@dataclass(frozen=True, kw_only=True)
class Walker:
    """Whose walk it is.

    Attributes
    ----------
    person : name
    age : [years], None where it is not stated
    speed : of the walk [m/s], None where it is not known
    stature : by the legs of the model [m]
    """

    person: str
    age: float | None
    speed: float | None
    stature: float


@dataclass(frozen=True)
class GaitNorms:
    """What walks are held against.

    Attributes
    ----------
    names : as they were asked for: folders, a file, or a word
    controls : people of folders, by name
    groups : of a file
    """

    names: tuple[str, ...] = ()
    controls: Mapping[str, ControlPerson] = field(default_factory=lambda: FrozenMap({}))
    groups: tuple[GaitNorm, ...] = ()


@cache
def adult_norms() -> tuple[GaitNorm, ...]:
    """Return the adults that come along, by age; variables that are not in their source are NaN."""
    home = files("myomorph.lab.study.trial") / "data" / "gait_norm_adults.csv"
    return read_norms(Path(str(home)))


def adult_norm() -> GaitNorm:
    """Return adults of an age that stands for others."""
    return next(norm for norm in adult_norms() if norm.group == USUAL)


def checked_norms(norms: Sequence[str]) -> tuple[str, ...]:
    """Return `norms` as they are: "adults" or "none" alone, a file alone, or folders.

    Raises
    ------
    BadFile : one is none of these
    """
    names = tuple(norms)
    if names in ((ADULTS,), (NO_NORM,)) or is_table(names):
        return names
    for name in names:
        if not Path(name).is_dir():
            raise BadFile(
                name,
                "is no norm",
                "give folders of results of a control group, a file of 'myomorph norms', or"
                f" {listing(name, (ADULTS, NO_NORM))}",
            )
    return names


def is_table(names: tuple[str, ...]) -> bool:
    """Whether a norm is a file."""
    return len(names) == 1 and names[0].lower().endswith(TABLE) and is_named_file(Path(names[0]))


def walker_of(prepared: Prepared) -> Walker:
    """Return whose walk results are of."""
    model = prepared.results.model
    assert model is not None
    recorded = prepared.results.recorded
    speeds = [] if prepared.strides is None else gait_parameters(prepared.strides)[SPEED].values()
    speed = float(np.mean([side.mean for side in speeds])) if speeds else None
    return Walker(person=recorded.subject, age=recorded.age, speed=speed, stature=_leg(model) / LEG)


def norm_of(norms: GaitNorms, walker: Walker) -> ChosenNorm:
    """Return the norm that fits a walker in age and speed; nobody is the own control."""
    if norms.names == (NO_NORM,):
        return ChosenNorm(None, "No norm was requested.")
    if norms.groups:
        return _fitting(norms.groups, walker)
    if norms.names and norms.names != (ADULTS,):
        others = [person for name, person in norms.controls.items() if name != walker.person]
        names = ", ".join(Path(name).name for name in norms.names)
        return _fitting((group_norm(others, f"own control group, {names}"),), walker)
    if norms.names:
        return _asked_for(walker)
    if walker.age is None and walker.stature < ADULT:
        return ChosenNorm(
            None,
            f"No norm: legs of a body of about {walker.stature:.2f} m, and the bundled norm is of"
            " adults. myomorph report --norms FOLDER takes the results of a control"
            " group; --norms adults draws adults.",
        )
    return _fitting(adult_norms(), walker)


def _asked_for(walker: Walker) -> ChosenNorm:
    """Return adults whatever the walker's age and speed, and what does not fit."""
    fitting = _fitting(adult_norms(), walker)
    if fitting.norm is not None:
        return fitting
    why = fitting.note.removeprefix("No norm: ")
    return ChosenNorm(adult_norm(), f"The requested norm does not fit: {why}")


def _fitting(norms: Sequence[GaitNorm], walker: Walker) -> ChosenNorm:
    """Return the first norm that fits, or a sentence on what fits none."""
    of_age, note = _of_age(norms, walker)
    if not of_age:
        return ChosenNorm(None, note)
    if walker.speed is None:
        return ChosenNorm(of_age[0], note)
    for norm in of_age:
        slowest, fastest = norm.speeds
        if slowest <= walker.speed <= fastest:
            return ChosenNorm(norm, note)
    slowest, fastest = of_age[0].speeds
    return ChosenNorm(
        None,
        f"No norm: the walk has {walker.speed:.2f} m/s, and the norm is of {slowest:.2f} to"
        f" {fastest:.2f} m/s.",
    )


def _of_age(norms: Sequence[GaitNorm], walker: Walker) -> tuple[list[GaitNorm], str]:
    """Return norms that fit the age, and a sentence where that is not known or none does."""
    limited = [norm for norm in norms if np.isfinite(norm.ages[1])]
    if walker.age is None:
        usual = [norm for norm in norms if norm.group == USUAL] or list(norms)
        doubt = "The age is not stated, so whether the norm applies is unknown." if limited else ""
        return usual, doubt
    fitting = [norm for norm in norms if norm.ages[0] <= walker.age < norm.ages[1] + YEAR]
    if fitting:
        return fitting, ""
    youngest = min(norm.ages[0] for norm in norms)
    oldest = max(norm.ages[1] for norm in norms)
    text = (
        f"No norm: {walker.age:g} years, and the norm is of {youngest:g} to {oldest:g} years."
        " myomorph report --norms FOLDER takes the results of a control group."
    )
    return [], text


def _leg(model: Model) -> float:
    """Return the length of thigh and shank, from hip to ankle [m].

    It is that of an adult where the model has no such joints.
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
