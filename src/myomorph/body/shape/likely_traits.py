"""Traits of the most likely body with some measurements, and how far they are known."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import scipy

from myomorph.body.shape.people import YOUNGEST, People, Sex, people
from myomorph.body.shape.statistical_body import (
    AROUND,
    FREE,
    LENGTHS,
    TRUNK,
    StatisticalBody,
)
from myomorph.body.shape.tape import Tape
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.surface import signed_volume

DENSITY = 985.0  # Mass of a person over the volume of the skin, with air in the lungs [kg/m^3]
# Standard deviation of a trait around the average before anything is measured, twice that of a
# part's
SPREAD = 0.15
WITH_PEOPLE = 4.0
"""Times as wide where a survey of people says what is likely, so that it decides."""
MISFIT = FrozenMap({"height": 1e-4, "chest": 5e-4, "mass": 0.05})
"""What counts as one standard deviation of each measurement [m], [m], [kg]."""
MAX_STEPS = 40
TOLERANCE = 1e-3
STEP = 1e-4  # Of a trait, for slopes
GENDER = {"female": 1.0, "male": 0.0, None: 0.5}
LEVELS = ("waist", "hips")
"""Tapes whose heights are taken as the survey's and not fitted."""
UNFITTED = (*(f"{name} height" for name in LEVELS), "ankle height")
"""The rig's ankle does not lie at the height of the malleolus."""


@read_only
class Likely:
    """Traits of a body.

    Attributes
    ----------
    vertices : (vertices, 3) of the statistical body [m]
    expected : what measurements were taken as where they were not made [m], [kg]
    alike : people with the measurements that were made; None where no survey has them
    """

    vertices: Array
    expected: Mapping[str, float]
    alike: People | None


class BodyProblem:
    """Misfit of a statistical body to one person's measurements and to people alike.

    Parameters
    ----------
    body : whose traits are searched
    age : [years]
    sex : half female and half male where it is not given
    measured : "height" [m], and "chest" [m] and "mass" [kg] where they are known
    """

    def __init__(
        self, body: StatisticalBody, age: float, sex: Sex | None, measured: Mapping[str, float]
    ):
        self._body = body
        self._age = age
        self._gender = GENDER[sex]
        self._measured = measured
        self.alike: People | None = None
        self.people: People | None = None
        self.expected: dict[str, float] = {}
        levels = None
        locals_ = tuple(TRUNK)
        if age >= YOUNGEST:
            self.people = people(sex).given(measured)
            # What is not measured is what people alike have, and their limbs go with it.
            self.expected = {
                name: self.people.expected(name)
                for name in ("chest", "mass")
                if name not in measured
            }
            self._measured = {**measured, **self.expected}
            alike = people(sex).given(self._measured)
            levels = {name: alike.expected(f"{name} height") for name in LEVELS}
            self.alike = alike.of([name for name in alike.names if name not in UNFITTED])
            self._whiten = np.linalg.inv(np.linalg.cholesky(self.alike.covariance))
            locals_ = (*TRUNK, *AROUND, *LENGTHS)
        self.tape = Tape(body, levels)
        self.names = (*FREE, *locals_)
        parts = len(locals_)
        self._average = np.array([0.5] * len(FREE) + [0.0] * parts)
        spread = SPREAD if self.alike is None else WITH_PEOPLE * SPREAD
        self._spread = spread * np.array([1.0] * len(FREE) + [2.0] * parts)
        self._lowest = np.array([0.0] * len(FREE) + [-1.0] * parts)

    def solve(self) -> Likely:
        """Find the body whose traits minimize the misfit."""
        # Measures have kinks where a trait passes an average, at which steps may shrink without
        # end.
        minimum: Any = scipy.optimize.least_squares(
            self.misfit,
            self._average,
            jac=self.slopes,
            bounds=(self._lowest, 1.0),
            x_scale=self._spread,
            xtol=TOLERANCE,
            ftol=TOLERANCE,
            max_nfev=MAX_STEPS,
        )
        return Likely(vertices=self._vertices(minimum.x), expected=self.expected, alike=self.people)

    def misfit(self, values: Array) -> Array:
        """Compute what is squared: of measurements, of the traits, and of people alike.

        Parameters
        ----------
        values : (traits,)

        Returns
        -------
        (rows,) in standard deviations
        """
        return self._rows(values, measurements(self._body, self._vertices(values), self.tape))

    def slopes(self, values: Array) -> Array:
        """Compute slopes of the misfit by differences, each tape on the edges that it touches now.

        Parameters
        ----------
        values : (traits,)

        Returns
        -------
        (rows, traits)
        """
        body = self._body
        vertices = self._vertices(values)
        heads = body.heads @ vertices
        sections = self.tape.sections(vertices, heads)
        got = measurements(body, vertices, self.tape)
        start = self._rows(values, got)
        # Towards the inside where a trait is at its upper bound.
        steps = np.where(values + STEP > 1.0, -STEP, STEP)
        moved = values + np.diag(steps)
        before = self._coefficients(values)
        changes = np.array([self._coefficients(row) for row in moved]) - before
        shifts = (changes @ body.dense).reshape(len(values), -1, 3)
        areas = _corner_areas(body, vertices)
        columns = []
        for k, shift in enumerate(shifts):
            new = self.tape.read(vertices + shift, heads + body.heads @ shift, sections)
            new["mass"] = got["mass"] + DENSITY * float(np.vdot(areas, shift))
            columns.append((self._rows(moved[k], new) - start) / steps[k])
        return np.array(columns).T

    def _rows(self, values: Array, got: Mapping[str, float]) -> Array:
        """Compare measurements [m], [kg] with what is known: (rows,) in standard deviations."""
        rows = [(got[name] - value) / MISFIT[name] for name, value in self._measured.items()]
        result = np.array([*rows, *((values - self._average) / self._spread)])
        if self.alike is None:
            return result
        logs = np.log([got[name] for name in self.alike.names])
        return np.concatenate([result, self._whiten @ (logs - self.alike.mean)])

    def _coefficients(self, values: Array) -> Array:
        """Compute shares (shapes,) of the body's shapes."""
        traits = {"gender": self._gender, **dict(zip(self.names, map(float, values), strict=True))}
        return self._body.coefficients(traits, self._age)

    def _vertices(self, values: Array) -> Array:
        """Compute the vertices (vertices, 3) of traits [m]."""
        shapes = self._coefficients(values) @ self._body.dense
        return np.asarray(self._body.template + shapes.reshape(-1, 3))


def _corner_areas(body: StatisticalBody, vertices: Array) -> Array:
    """Compute by how much the volume grows where a vertex moves: (vertices, 3) [m^2]."""
    a = vertices[body.faces[:, 0]]
    b = vertices[body.faces[:, 1]]
    c = vertices[body.faces[:, 2]]
    result = np.zeros_like(vertices)
    for i, (p, q) in enumerate(((b, c), (c, a), (a, b))):
        np.add.at(result, body.faces[:, i], np.cross(p, q) / 6.0)
    return result


def measurements(
    body: StatisticalBody, vertices: Array, tape: Tape | None = None
) -> dict[str, float]:
    """Measure a standing body.

    Parameters
    ----------
    body : with faces
    vertices : (vertices, 3) [m]
    tape : by default one for the chest alone

    Returns
    -------
    "volume" [m^3], "mass" [kg], and what the tape reads [m]
    """
    volume = signed_volume(vertices, body.faces)
    read = (tape or Tape(body)).read(vertices, body.heads @ vertices)
    return {**read, "mass": DENSITY * volume, "volume": volume}
