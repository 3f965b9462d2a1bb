"""People who took no part in the regression: folds of a survey, and surveys in each other's place.

What is judged is what `identify --height --chest [--mass]` takes as its prior: the mass where it is
not given, circumferences, and limbs, whose mass goes with the squares of these and with lengths.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from benchmarks.accuracy.identification.people import (
    ANSUR,
    between_surveys,
    men_of_a_third,
    surveys,
)
from benchmarks.results import Row
from myomorph.body.shape.body_segments import GIRTHS_OF
from myomorph.body.shape.people import People, Sex
from myomorph.core.model.arrays import Array

FOLDS = 10
SEED = 20  # Of the order in which people fall into folds
LEVEL = 1.96
GIVEN = (("height", "chest"), ("height", "chest", "mass"))
SHARED = ("wrist", "hips", "thigh", "calf", "ankle", "upper arm")
"""Circumferences whose sites surveys share; the third has neither calves nor flexed arms."""
LENGTHS: Mapping[str, Mapping[str, float]] = {
    "upper_arm": {"upper arm length": 1.0},
    "lower_arm": {"forearm length": 1.0},
    "shank": {"knee height": 1.0},
}
"""Lengths of limbs that the survey measured; a thigh's is a difference of two heights."""
COLUMNS: Mapping[str, str] = {
    "mass": "weight",
    "chest": "chest_girth",
    "height": "height",
    "wrist": "wrist_girth",
    "hips": "hip_girth",
    "thigh": "thigh_girth",
    "calf": "calf_girth",
    "ankle": "ankle_girth",
    "upper arm": "bicep_girth",
}
"""Columns of the other two surveys, [kg] and [cm]."""


class Survey(NamedTuple):
    """People of one sex, as logarithms of measurements in SI units.

    Attributes
    ----------
    name : of the survey
    sex : of the people
    names : of the measurements
    logs : (people, measurements)
    """

    name: str
    sex: Sex
    names: tuple[str, ...]
    logs: Array

    def of(self, names: Sequence[str]) -> Array:
        """Choose measurements.

        Parameters
        ----------
        names : of measurements

        Returns
        -------
        logarithms (people, names)
        """
        return self.logs[:, [self.names.index(name) for name in names]]

    def regression(self, names: Sequence[str], between: float) -> People:
        """Distribution of some measurements.

        Parameters
        ----------
        names : of the measurements
        between : by how much people of other surveys differ beyond it
        """
        table = self.of(names)
        return People(
            names=tuple(names),
            mean=table.mean(axis=0),
            covariance=np.cov(table.T),
            between=between,
        )


@dataclass(frozen=True, kw_only=True)
class Judged:
    """Errors of quantities of people who were held out.

    Attributes
    ----------
    errors : (people, quantities) of logarithms
    sds : (people, quantities) as they are used
    """

    errors: Array
    sds: Array


def predicted(
    regression: People,
    people: Survey,
    given: Sequence[str],
    rows: Mapping[str, Mapping[str, float]],
) -> Judged:
    """Compare people with what some of their measurements say.

    Parameters
    ----------
    regression : made without them
    people : held out
    given : measurements that are known
    rows : of each quantity the slopes of its logarithm over those of measurements

    Returns
    -------
    errors and their standard deviations
    """
    known = np.exp(people.of(given))
    errors = []
    sds = []
    truth = people.of(regression.names)
    for person, measured in enumerate(known):
        rest = regression.given(dict(zip(given, measured.tolist(), strict=True)))
        slopes = np.array([[row.get(name, 0.0) for name in rest.names] for row in rows.values()])
        column = [regression.names.index(name) for name in rest.names]
        errors.append(slopes @ (truth[person, column] - rest.mean))
        sds.append(np.sqrt(np.einsum("qi,ij,qj->q", slopes, rest.covariance, slopes)))
    return Judged(errors=np.array(errors), sds=np.array(sds))


def limb_rows() -> dict[str, dict[str, float]]:
    """Slopes of the logarithms of limbs' masses, as the prior has them."""
    return {
        limb: {**dict.fromkeys(GIRTHS_OF[limb], 2.0 / len(GIRTHS_OF[limb])), **length}
        for limb, length in LENGTHS.items()
    }


def in_folds(survey: Survey, given: Sequence[str]) -> dict[str, Judged]:
    """Predict each tenth of a survey by the rest.

    Parameters
    ----------
    survey : with all measurements of the package's file
    given : measurements that are known

    Returns
    -------
    by kind of quantity
    """
    order = np.random.default_rng(SEED).permutation(len(survey.logs))
    kinds = _kinds(survey.names, given)
    found: dict[str, list[Judged]] = {kind: [] for kind in kinds}
    for fold in range(FOLDS):
        out = order[fold::FOLDS]
        rest = survey._replace(logs=np.delete(survey.logs, out, axis=0))
        people = survey._replace(logs=survey.logs[out])
        regression = rest.regression(survey.names, 0.0)
        for kind, rows in kinds.items():
            found[kind].append(predicted(regression, people, given, rows))
    return {
        kind: Judged(
            errors=np.concatenate([each.errors for each in parts]),
            sds=np.concatenate([each.sds for each in parts]),
        )
        for kind, parts in found.items()
    }


def _kinds(names: Sequence[str], given: Sequence[str]) -> dict[str, dict[str, dict[str, float]]]:
    """Quantities by kind: mass unless given, circumferences, limbs where lengths are known."""
    kinds: dict[str, dict[str, dict[str, float]]] = {}
    if "mass" not in given:
        kinds["mass"] = {"mass": {"mass": 1.0}}
    kinds["circumferences"] = {name: {name: 1.0} for name in SHARED if name in names}
    if "upper arm length" in names:
        kinds["limbs"] = limb_rows()
    return kinds


def all_surveys() -> list[Survey]:
    """Read the surveys; none where files are absent."""
    logs, others = surveys()
    if not logs:
        return []
    result = [
        Survey(name="ANSUR II", sex=sex, names=tuple(ANSUR), logs=table)
        for sex, table in logs.items()
    ]
    result += [_other("Heinz et al. 2003", sex, others) for sex in logs]
    men = men_of_a_third()
    if men:
        result.append(_other("Johnson 1996", "male", men))
    return result


def _other(name: str, sex: Sex, rows: Sequence[Mapping[str, str]]) -> Survey:
    """Take people of one sex from another survey, with the measurements that it has."""
    mine = [row for row in rows if row["sex"].lower() == sex]
    names = [key for key, column in COLUMNS.items() if column in mine[0]]
    values = [
        [float(row[COLUMNS[key]]) * (1.0 if key == "mass" else 0.01) for key in names]
        for row in mine
    ]
    return Survey(name=name, sex=sex, names=tuple(names), logs=np.log(values))


def measure() -> Iterator[Row]:
    """Rows of folds within surveys, then of surveys that others were made without."""
    every = all_surveys()
    for survey in every:
        for given in GIVEN:
            for kind, judged in in_folds(survey, given).items():
                yield _row((survey, "none", survey), "tenths", given, kind, judged)
    men = {survey.name: survey for survey in every if survey.sex == "male"}
    women = {survey.name: survey for survey in every if survey.sex == "female"}
    for group in (men, women):
        yield from _across(list(group.values()))


def _across(group: Sequence[Survey]) -> Iterator[Row]:
    """Predict each survey by another one, with the spread between surveys that a third shows."""
    for made in group:
        for third in group:
            for people in group:
                if len({made.name, third.name, people.name}) < 3:
                    continue
                names = [name for name in made.names if name in third.names + people.names]
                between = _between(made, third)
                regression_names = [name for name in names if name in people.names]
                regression = made.regression(regression_names, between)
                for given in GIVEN:
                    for kind, rows in _kinds(regression_names, given).items():
                        judged = predicted(regression, people, given, rows)
                        yield _row((made, third.name, people), "surveys", given, kind, judged)


def _between(made: Survey, third: Survey) -> float:
    """Spread between two surveys beyond that of people, as the package's file has it."""
    names = [name for name in made.names if name in third.names]
    regression = made.regression(names, 0.0)
    rows = {"mass": {"mass": 1.0}} | {name: {name: 1.0} for name in SHARED if name in names}
    judged = predicted(regression, third, GIVEN[0], rows)
    pairs = np.stack([judged.errors, judged.sds], axis=2)
    return between_surveys(
        {(name, third.sex): pairs[:, column] for column, name in enumerate(rows)}
    )


def _row(
    surveys_of: tuple[Survey, str, Survey],
    parted: str,
    given: Sequence[str],
    kind: str,
    judged: Judged,
) -> Row:
    """Judge a kind of quantities, all of them together."""
    made, third, people = surveys_of
    errors = judged.errors
    return {
        "held out": parted,
        "made from": made.name,
        "between surveys by": third,
        "people of": people.name,
        "sex": people.sex,
        "given": ", ".join(given),
        "of": kind,
        "people": len(errors),
        "mean error [%]": 100.0 * float(errors.mean()),
        "error RMS [%]": 100.0 * float(np.sqrt(np.mean(np.square(errors)))),
        "SD as used [%]": 100.0 * float(np.sqrt(np.mean(np.square(judged.sds)))),
        "in 95 % intervals": f"{100.0 * np.mean(np.abs(errors) < LEVEL * judged.sds):.1f} %",
    }
