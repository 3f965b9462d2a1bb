"""Measurements of people: means and covariances of a survey, and what follows from some of them."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from functools import lru_cache
from importlib import resources
from typing import Literal

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import UnknownName

Sex = Literal["female", "male"]
FILE = "people.csv"
YOUNGEST = 17.0  # Of the survey [years]
TAPE = {"height": 0.005, "chest": 0.015, "mass": 0.5}
"""Standard deviation of what is measured by hand [m], [m], [kg]; a chest moves as it breathes."""


@read_only
class People:
    """Normal distribution of the logarithms of measurements.

    Attributes
    ----------
    names : of the measurements, as in the file
    mean : (names,) of the logarithms of measurements in SI units
    covariance : (names, names)
    between : standard deviation of the logarithms by which people of other surveys differ beyond it
    """

    names: tuple[str, ...]
    mean: Array
    covariance: Array
    between: float

    def given(self, measured: Mapping[str, float]) -> People:
        """Compute the distribution of the others where some measurements are known.

        Parameters
        ----------
        measured : by name [m], [kg]; each with the error `TAPE`

        Returns
        -------
        the others, in their order; people of other surveys included

        Raises
        ------
        UnknownName : a measurement is none of the survey's
        """
        for name in measured:
            if name not in self.names:
                raise UnknownName(
                    "measurement", name, existing=self.names, where="the survey of people"
                )
        known = [self.names.index(name) for name in measured]
        others = [i for i in range(len(self.names)) if i not in known]
        errors = [TAPE[name] / value for name, value in measured.items()]
        among = self.covariance[np.ix_(known, known)] + np.diag(np.square(errors))
        slopes = np.linalg.solve(among, self.covariance[np.ix_(known, others)]).T
        away = np.log(list(measured.values())) - self.mean[known]
        rest = (
            self.covariance[np.ix_(others, others)]
            - slopes @ self.covariance[np.ix_(known, others)]
        )
        return People(
            names=tuple(self.names[i] for i in others),
            mean=self.mean[others] + slopes @ away,
            covariance=rest + self.between**2 * np.eye(len(others)),
            between=0.0,
        )

    def of(self, names: Sequence[str]) -> People:
        """Choose measurements, in the order of their names."""
        index = [self.names.index(name) for name in names]
        return People(
            names=tuple(names),
            mean=self.mean[index],
            covariance=self.covariance[np.ix_(index, index)],
            between=self.between,
        )

    def expected(self, name: str) -> float:
        """Return the median of a measurement [m], [kg]."""
        return float(np.exp(self.mean[self.names.index(name)]))

    def sd(self, name: str) -> float:
        """Return the standard deviation of the logarithm of a measurement."""
        i = self.names.index(name)
        return float(np.sqrt(self.covariance[i, i]))


@lru_cache(maxsize=3)
def people(sex: Sex | None) -> People:
    """Read what a survey measured: 4,082 men and 1,986 women of ANSUR II (Gordon et al. 2014).

    Arms are relaxed ones, and lengths of limbs those between joint centers; how both follow from
    what the survey measured stands in `benchmarks/accuracy/identification/people.py`, which made
    the file.

    Parameters
    ----------
    sex : one half of each where it is not given

    Returns
    -------
    distribution of the logarithms of measurements
    """
    text = resources.files(__package__).joinpath("data", FILE).read_text("utf-8")
    rows = list(csv.DictReader(text.splitlines()))
    if sex is not None:
        return _one_sex(rows, sex)
    women = _one_sex(rows, "female")
    men = _one_sex(rows, "male")
    half = 0.5 * (women.mean - men.mean)
    return People(
        names=men.names,
        mean=0.5 * (women.mean + men.mean),
        covariance=0.5 * (women.covariance + men.covariance) + np.outer(half, half),
        between=men.between,
    )


def _one_sex(rows: Sequence[Mapping[str, str]], sex: Sex) -> People:
    """Read the rows of one sex."""
    mine = [row for row in rows if row["sex"] == sex]
    names = tuple(row["measurement"] for row in mine)
    sizes = np.array([float(row["sd"]) for row in mine])
    correlation = np.array([[float(row[name]) for name in names] for row in mine])
    return People(
        names=names,
        mean=np.array([float(row["mean"]) for row in mine]),
        covariance=correlation * sizes[:, None] * sizes,
        between=float(mine[0]["between"]),
    )
