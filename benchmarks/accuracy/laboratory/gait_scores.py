"""Scaled scores of gait of made healthy people: 100 whatever their strides differ by."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from benchmarks.results import Row
from myomorph.core.model.arrays import Array
from myomorph.lab.analysis.cycles import Cycles
from myomorph.lab.analysis.gait_curves import KEYS, SAMPLES, SIDES, GaitCurves
from myomorph.lab.analysis.gait_scores import control_norm, gait_scores

BETWEEN = 4.0
"""Standard deviation between people, of offsets and of each harmonic together [°]."""
HARMONICS = 4
GROUPS = 40
"""Made control groups of a row, each with as many patients."""
CYCLE = np.linspace(0.0, 2.0 * np.pi, SAMPLES)
SHAPES = np.concatenate(
    [np.ones((1, SAMPLES))]
    + [[np.cos(k * CYCLE), np.sin(k * CYCLE)] for k in range(1, HARMONICS + 1)]
)
"""(2 HARMONICS + 1, SAMPLES) that curves are made of, with unit variance together."""
SHAPES[1:] *= np.sqrt(2.0)
SHAPES /= np.sqrt(len(SHAPES))
USUAL = 20.0 * np.sin(CYCLE)[:, None] + np.arange(len(KEYS))


def noise(rng: np.random.Generator, count: int, sd: float) -> Array:
    """Make smooth random curves.

    Parameters
    ----------
    rng : random numbers
    count : of curves
    sd : standard deviation [°]

    Returns
    -------
    (count, SAMPLES, variables) [°]
    """
    weights = sd * rng.standard_normal((count, len(SHAPES), len(KEYS)))
    curves: Array = np.einsum("nsk,sp->npk", weights, SHAPES)
    return curves


def person(rng: np.random.Generator, strides: int, stride_sd: float) -> GaitCurves:
    """Somebody healthy, whose strides differ."""
    shared = noise(rng, 1, BETWEEN / np.sqrt(2.0))
    sides = [
        Cycles(
            KEYS,
            USUAL + shared + noise(rng, 1, BETWEEN / np.sqrt(2.0)) + noise(rng, strides, stride_sd),
        )
        for _ in SIDES
    ]
    return GaitCurves(sides[0], sides[1], dict.fromkeys(SIDES, ()))


def mean_stride(curves: GaitCurves) -> GaitCurves:
    """One stride in the place of a person's: their mean, of which the scale was before."""
    sides = [Cycles(KEYS, curves.mean(side)[None]) for side in SIDES]
    return GaitCurves(sides[0], sides[1], dict.fromkeys(SIDES, ()))


def measure() -> Iterator[Row]:
    """Scaled scores of healthy people by controls, strides, and how much these differ."""
    for controls, control_strides, strides in (
        (5, 10, 10),
        (10, 10, 10),
        (30, 10, 10),
        (10, 10, 3),
    ):
        for stride_sd in (1.0, 2.0, 3.0):
            rng = np.random.default_rng(4600 + 10 * controls + strides + int(stride_sd))
            found: dict[str, list[float]] = {"side": [], "both": [], "of mean curves": []}
            for _ in range(GROUPS):
                people = [person(rng, control_strides, stride_sd) for _ in range(controls)]
                norm = control_norm(people, "made")
                of_curves = control_norm([mean_stride(each) for each in people], "made")
                for _ in range(10):
                    patient = person(rng, strides, stride_sd)
                    scaled = gait_scores(patient, norm).scaled
                    found["side"] += [scaled[side].value for side in SIDES]
                    found["both"].append(scaled["both"].value)
                    before = gait_scores(patient, of_curves).scaled
                    found["of mean curves"] += [before[side].value for side in SIDES]
            yield {
                "controls": controls,
                "strides of a patient": strides,
                "SD between strides [°]": stride_sd,
                "scaled score of a side, mean": round(float(np.mean(found["side"])), 1),
                "SD": round(float(np.std(found["side"])), 1),
                "of both sides, mean": round(float(np.mean(found["both"])), 1),
                "a side, norm of mean curves": round(float(np.mean(found["of mean curves"])), 1),
            }
