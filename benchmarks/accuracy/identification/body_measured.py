"""The body from height and chest beside measured people, and beside the average ones of a table."""

from __future__ import annotations

import contextlib
import importlib.util
import io
import warnings
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple
from unittest.mock import patch

import numpy as np
from tests.data_collection import data_folder

from benchmarks.results import Row
from myomorph.body.shape import likely_traits
from myomorph.body.shape import shape as shape_of_person
from myomorph.body.shape.body_segments import SegmentMass, segment_masses
from myomorph.body.shape.people import Sex
from myomorph.body.shape.shape import body_shape

PERSONS = ("female1", "male1", "male2", "male3", "male4", "JasonYeadonMeas")
"""Measured people of the package yeadon. male3 and JasonYeadonMeas are one set of measurements, the
second with the mass that was weighed, in clothes, helmet and shoes.
"""
ANKLE = 0.039
"""Height of the ankle over that of the body (Drillis and Contini 1966), which is not measured."""
PARTS: Mapping[str, tuple[str, ...]] = {
    "trunk and head": ("head", "upper_trunk", "lower_trunk"),
    "upper arm": ("upper_arm",),
    "forearm and hand": ("lower_arm", "hand"),
    "thigh": ("thigh",),
    "shank and foot": ("shank", "foot"),
}
AVERAGE: Mapping[Sex, tuple[float, float, Mapping[str, float]]] = {
    "male": (
        1.741,
        73.0,
        {
            "head": 6.94,
            "trunk": 43.46,
            "upper_arm": 2.71,
            "lower_arm": 1.62,
            "hand": 0.61,
            "thigh": 14.16,
            "shank": 4.33,
            "foot": 1.37,
        },
    ),
    "female": (
        1.735,
        61.9,
        {
            "head": 6.68,
            "trunk": 42.57,
            "upper_arm": 2.55,
            "lower_arm": 1.38,
            "hand": 0.56,
            "thigh": 14.78,
            "shank": 4.81,
            "foot": 1.29,
        },
    ),
}
"""Height [m], mass [kg] and segments [% of the mass] of de Leva 1996."""


class Person(NamedTuple):
    """A measured person.

    Attributes
    ----------
    height, chest, mass : [m], [m], [kg]
    parts : masses, of paired ones the mean of both sides [kg]
    """

    height: float
    chest: float
    mass: float
    parts: dict[str, float]


def person(name: str) -> Person:
    """Read a person's tape and the masses of Yeadon's solids."""
    import yeadon

    path = data_folder() / "anthropometry-yeadon" / f"{name}.txt"
    with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()):
        warnings.simplefilter("ignore")
        human = yeadon.Human(str(path))
    tape = human.meas
    leg = 0.5 * (tape["Lj5L"] + tape["Lk5L"])
    height = (leg + tape["Ls5L"] + tape["Ls8L"]) / (1.0 - ANKLE)
    trunk = human.P.mass + human.T.mass + human.C.mass
    pairs = ((human.A1, human.B1), (human.A2, human.B2), (human.J1, human.K1), (human.J2, human.K2))
    masses = (trunk, *(0.5 * (left.mass + right.mass) for left, right in pairs))
    return Person(
        height=float(height),
        chest=float(tape["Ls3p"]),
        mass=float(human.mass),
        parts={part: float(mass) for part, mass in zip(PARTS, masses, strict=True)},
    )


def measured_rows() -> Iterator[Row]:
    """Errors of the body of six measured people, and whether 95 % intervals hold."""
    if importlib.util.find_spec("yeadon") is None:
        return
    held: list[bool] = []
    for name in PERSONS:
        truth = person(name)
        for mass in (None, truth.mass):
            with without_survey():
                yield _row(name, truth, mass, "statistical body alone", [])
            yield _row(name, truth, mass, "with people alike", held)
    yield {"person": "95 % intervals that hold", "given": f"{sum(held)} of {len(held)}"}


@contextlib.contextmanager
def without_survey() -> Iterator[None]:
    """Bodies as they were before people alike were asked."""
    with (
        patch.object(likely_traits, "YOUNGEST", np.inf),
        patch.object(shape_of_person, "YOUNGEST", np.inf),
    ):
        yield


def _row(name: str, truth: Person, mass: float | None, way: str, held: list[bool]) -> Row:
    """Errors of one body; `held` takes whether intervals hold."""
    sex: Sex = "female" if name.startswith("female") else "male"
    shape = body_shape(truth.height, truth.chest, mass, sex)
    segments = segment_masses(shape, shape.reached["mass"])
    sd = np.nan if mass is not None or shape.alike is None else shape.alike.sd("mass")
    row: Row = {
        "person": name,
        "height [m]": truth.height,
        "chest [m]": truth.chest,
        "mass [kg]": truth.mass,
        "given": "height, chest" if mass is None else "height, chest, mass",
        "body": way,
        "mass": "given" if mass is not None else _error(shape.reached["mass"], truth.mass, sd),
    }
    if np.isfinite(sd):
        held.append(_holds(shape.reached["mass"], truth.mass, sd))
    for part, kinds in PARTS.items():
        found, sd = _part(segments, kinds)
        row[part] = _error(found, truth.parts[part], sd)
        held.append(_holds(found, truth.parts[part], sd))
    return row


def average_rows() -> Iterator[Row]:
    """Segments of the average man and woman beside de Leva's."""
    errors = []
    for sex, (height, mass, parts) in AVERAGE.items():
        segments = segment_masses(body_shape(height, None, mass, sex), mass)
        for part, share in parts.items():
            kinds = ("upper_trunk", "lower_trunk") if part == "trunk" else (part,)
            found = 100.0 * _part(segments, kinds)[0] / mass
            errors.append(found / share - 1.0)
            yield {
                "sex": sex,
                "segment": part.replace("_", " "),
                "de Leva 1996 [% of the mass]": share,
                "statistical body [% of the mass]": found,
                "difference [%]": 100.0 * errors[-1],
            }
    yield {
        "sex": "both",
        "segment": "root mean square",
        "difference [%]": 100.0 * float(np.sqrt(np.mean(np.square(errors)))),
        "de Leva 1996 [% of the mass]": "",
        "statistical body [% of the mass]": "",
    }


def _part(segments: Sequence[SegmentMass], kinds: Sequence[str]) -> tuple[float, float]:
    """Mass of a part [kg], of paired ones on one side, and its relative standard deviation."""
    mine = [one for one in segments if one.segment.name in kinds and one.segment.side != "left"]
    total = sum(one.mass for one in mine)
    return total, sum(one.mass * one.sd for one in mine) / total


def _holds(found: float, true: float, sd: float) -> bool:
    """Whether a 95 % interval holds the truth; always where there is none."""
    return not abs(np.log(found / true)) >= 1.96 * sd


def _error(found: float, true: float, sd: float) -> str:
    """Write an error in percent, in brackets where the 95 % interval misses the truth."""
    text = f"{100.0 * (found / true - 1.0):+.0f} %"
    return text if _holds(found, true, sd) else f"[{text}]"
