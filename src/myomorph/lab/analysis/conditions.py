"""Conditions of a study: mean curves with their spread, comparisons of all pairs, outliers."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import ArrayLike

from myomorph.core.model.arrays import Array, read_only
from myomorph.lab.analysis.groups import (
    Animal,
    Comparison,
    Group,
    GroupOptions,
    compare_groups,
    compare_paired,
)
from myomorph.lab.analysis.permutations import MIN_SUBJECTS
from myomorph.lab.causes import GROUPS


@read_only
class MeanCurves:
    """Signals over the cycle, as the mean of several subjects or trials."""

    names: tuple[str, ...]
    # mean, deviation, low, high: (samples, names); standard deviation with ddof = 1, and the
    # interval of the mean; NaN with fewer than two
    mean: Array
    deviation: Array
    low: Array
    high: Array
    count: Array  # (samples, names) subjects or trials that are known there


@dataclass(frozen=True, eq=False)
class Condition:
    """One condition of a study."""

    name: str
    subjects: tuple[Animal, ...]  # each with the means of its trials
    trials: int  # how many went well
    cycle: str  # what curves go over: "stride" or "trial"
    unit: str  # what the curves' spread is of: "subjects", or "trials" where there is one subject
    curves: Mapping[str, MeanCurves]  # by family


def mean_curves(names: Sequence[str], count: Array, mean: Array, squares: Array) -> MeanCurves:
    """Compute mean curves with their spread from running sums.

    Parameters
    ----------
    names : of the curves
    count : (samples, names) how many values are known
    mean : (samples, names) their mean
    squares : (samples, names) their sum of squared deviations from the mean

    Returns
    -------
    MeanCurves of (samples, names); a mean is NaN where nothing is known, a standard deviation and
        the 95 % interval of the mean (Student's t) where fewer than two values are
    """
    some = count > 0
    freedom = np.maximum(count - 1.0, 1.0)
    deviation = np.where(count > 1, np.sqrt(squares / freedom), np.nan)
    half = scipy.special.stdtrit(freedom, 0.975) * deviation / np.sqrt(np.maximum(count, 1.0))
    mean = np.where(some, mean, np.nan)
    return MeanCurves(
        names=tuple(names),
        mean=mean,
        deviation=deviation,
        low=mean - half,
        high=mean + half,
        count=count,
    )


def compare_conditions(
    conditions: Sequence[Condition], options: GroupOptions | None = None
) -> list[Comparison]:
    """Compare every pair of conditions; alpha is divided by the number of pairs (Bonferroni).

    Where subjects have both conditions these are compared within subjects. Where none has, they are
    compared as groups, also where fewer than three have both and three or more of each have only
    one. Conditions whose curves go over different cycles are compared in numbers only.
    """
    options = options or GroupOptions()
    pairs = list(
        itertools.combinations([condition for condition in conditions if condition.subjects], 2)
    )
    corrected = replace(options, alpha=options.alpha / max(len(pairs), 1))
    result = []
    for first_condition, other in pairs:
        first = Group(first_condition.name, first_condition.subjects)
        second = Group(other.name, other.subjects)
        if first_condition.cycle != other.cycle:
            first = _without_curves(first)
            second = _without_curves(second)
        result.append(_compared(first, second, corrected))
    return result


def _compared(first: Group, second: Group, options: GroupOptions) -> Comparison:
    """Compare two conditions within subjects where some have both, else as groups.

    A few subjects with both are left out of large groups.
    """
    shared = {animal.name for animal in first.animals} & {animal.name for animal in second.animals}
    if not shared:
        return compare_groups(first, second, options)
    alone = [
        tuple(each for each in group.animals if each.name not in shared)
        for group in (first, second)
    ]
    if len(shared) >= MIN_SUBJECTS or min(map(len, alone)) < MIN_SUBJECTS:
        return compare_paired(first, second, options)
    comparison = compare_groups(Group(first.name, alone[0]), Group(second.name, alone[1]), options)
    note = GROUPS.message(
        "in both conditions, too few to be compared within subjects, and left out:"
        f" {', '.join(sorted(shared))}"
    )
    return replace(comparison, notes=(*comparison.notes, note))


def _without_curves(group: Group) -> Group:
    return Group(group.name, tuple(replace(animal, curves={}) for animal in group.animals))


# Modified z-score from which a value is called an outlier (Iglewicz and Hoaglin 1993)
OUTLIER_SCORE = 3.5
MIN_VALUES = 5  # Values of a kind from which on any is judged
# Values that differ by less, as a share of their median, are equal: what is left is rounding
ROUNDED = 1e-6
TO_DEVIATION = 0.6745  # Median absolute deviation of a normal distribution, in standard deviations


def modified_z(values: ArrayLike) -> Array:
    """Compute the modified z-scores of values, 0.6745 (x - median) / median absolute deviation.

    Parameters
    ----------
    values : (n,) in any unit; NaN stays out of the median and the deviation

    Returns
    -------
    (n,) NaN where the value is, and all NaN with fewer than five known values or where more than
        half of them are equal but for rounding
    """
    samples = np.asarray(values, dtype=np.float64)
    known = samples[np.isfinite(samples)]
    if len(known) < MIN_VALUES:
        return np.full(samples.shape, np.nan)
    middle = np.median(known)
    spread = float(np.median(np.abs(known - middle)))
    if not spread > ROUNDED * abs(float(middle)):
        return np.full(samples.shape, np.nan)
    return TO_DEVIATION * (samples - middle) / spread
