"""Tests of two groups by relabelling their members: exact where they are few, corrected for all that is looked at.

Under no difference the labels are exchangeable. Each relabelling gives a statistic of every number looked at; the share
of relabellings whose largest |t| anywhere reaches the observed one is the chance of seeing any such difference (Nichols
and Holmes 2002). All relabellings are taken while they are few, else random ones with the observed among them.

Of a single number the statistic is Student's t. Along a curve it is

    t(s) = (difference of means at s) / (its standard error at s + median of the standard errors along the curve):

without the constant, after Tusher et al. (2001), a few animals that happen to agree somewhere in the cycle would set
the largest t there, and hide what is different elsewhere. The test is exact with it as without.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from math import comb

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq
from scipy.stats import nct
from scipy.stats import t as student

from myomorph.model.errors import BadData
from myomorph.model.spatial import Array

FEWEST = 3
"""Members of a group from which on it is tested."""
SAME = 1e-9
"""Two |t| are equal within this share."""


@dataclass(frozen=True, eq=False)
class PermutationTest:
    """What relabelling tells.

    Attributes
    ----------
    statistic : (...) the first group less the second, see above
    p : (...) corrected for all numbers looked at together
    alone : (...) of each number, as if it were the only one
    relabellings : how many, the observed one among them
    exact : whether they are all there are
    floor : least p that groups of this size can reach
    """

    statistic: Array
    p: Array
    alone: Array
    relabellings: int
    exact: bool
    floor: float


def labellings(first: int, second: int, most: int = 10000, seed: int = 0) -> tuple[NDArray[np.bool_], bool]:
    """Who is in the first group (labellings, members), the observed one first, and whether these are all."""
    count = first + second
    if comb(count, first) <= most:
        chosen = list(itertools.combinations(range(count), first))
        rows = np.zeros((len(chosen), count), np.bool_)
        rows[np.arange(len(chosen))[:, None], np.array(chosen).reshape(len(chosen), first)] = True
        return rows, True
    rng = np.random.default_rng(seed)
    rows = np.zeros((most, count), np.bool_)
    rows[0, :first] = True
    rows[np.arange(1, most)[:, None], np.argsort(rng.random((most - 1, count)), axis=1)[:, :first]] = True
    return rows, False


def p_floor(first: int, second: int, most: int = 10000) -> float:
    """Least p that can come out: equal groups exchanged as a whole give the same |t|."""
    total = comb(first + second, first)
    return max((2.0 if first == second else 1.0) / total, 1.0 / most if total > most else 0.0)


def permutation_test(first: ArrayLike, second: ArrayLike, most: int = 10000, seed: int = 0) -> PermutationTest:
    """Largest-statistic test of two groups.

    Parameters
    ----------
    first, second : (members,) numbers, (members, samples) a curve or (members, curves, samples) several; a number that
        is NaN for any member is left out
    most : relabellings above which random ones are drawn
    seed : of these

    Raises
    ------
    BadData : shapes that differ, or a group of fewer than three
    """
    one, other = np.asarray(first, dtype=np.float64), np.asarray(second, dtype=np.float64)
    if one.shape[1:] != other.shape[1:]:
        raise BadData(f"groups of shapes {one.shape} and {other.shape}: expected the same but for their members")
    if min(len(one), len(other)) < FEWEST:
        raise BadData(f"groups of {len(one)} and {len(other)}: a test needs {FEWEST} or more in each")
    shape = one.shape[1:]
    whose = np.repeat(np.arange(int(np.prod(shape[:-1]))), shape[-1]) if shape else None
    values = np.concatenate([one, other]).reshape(len(one) + len(other), -1)
    known = np.isfinite(values).all(axis=0)
    rows, exact = labellings(len(one), len(other), most, seed)
    curve = None if whose is None else whose[known]
    observed = _statistics(values[:, known], rows[:1], curve)[0]
    largest = np.empty(len(rows))
    alone = np.zeros(int(known.sum()))
    for start in range(0, len(rows), 256):
        sizes = np.abs(_statistics(values[:, known], rows[start : start + 256], curve))
        largest[start : start + 256] = sizes.max(axis=1, initial=0.0)
        alone += (sizes >= np.abs(observed) * (1.0 - SAME)).sum(axis=0)
    ordered = np.sort(largest)
    reached = len(rows) - np.searchsorted(ordered, np.abs(observed) * (1.0 - SAME), side="left")
    found = [np.full(values.shape[1], np.nan) for _ in range(3)]
    for table, part in zip(found, (observed, reached / len(rows), alone / len(rows)), strict=True):
        table[known] = part
    statistic, p, single = (table.reshape(shape) for table in found)
    return PermutationTest(statistic, p, single, len(rows), exact, p_floor(len(one), len(other), most))


def _statistics(values: Array, rows: NDArray[np.bool_], curve: NDArray[np.int64] | None) -> Array:
    """The statistic (labellings, numbers) of values (members, numbers); `curve` (numbers,) tells whose each is."""
    inside = rows.astype(np.float64)
    n, m = float(inside[0].sum()), float(len(values) - inside[0].sum())
    # Means taken off first: sums of squares of large numbers would swallow small spreads.
    centered = values - values.mean(axis=0)
    sums, squares = inside @ centered, inside @ centered**2
    total, whole = centered.sum(axis=0), (centered**2).sum(axis=0)
    mean, other = sums / n, (total - sums) / m
    within = np.maximum(squares - n * mean**2, 0.0) + np.maximum(whole - squares - m * other**2, 0.0)
    error = np.sqrt(within / (n + m - 2.0) * (1.0 / n + 1.0 / m))
    floor = np.maximum(error, 1e-9 * np.sqrt(np.maximum(whole, 1e-300)))
    if curve is not None:
        edges = np.flatnonzero(np.diff(np.concatenate([[-1], curve, [-1]])))
        for start, stop in itertools.pairwise(edges):
            floor[:, start:stop] += np.median(error[:, start:stop], axis=1, keepdims=True)
    t: Array = (mean - other) / floor
    return t


def hedges_g(first: ArrayLike, second: ArrayLike) -> Array:
    """Difference of means over the pooled standard deviation, without its bias in small groups (Hedges 1981).

    Parameters
    ----------
    first, second : (members, ...); NaN where unknown

    Returns
    -------
    (...), NaN with fewer than two members in a group or without any spread
    """
    one, other = np.asarray(first, dtype=np.float64), np.asarray(second, dtype=np.float64)
    n, m = len(one), len(other)
    if min(n, m) < 2:
        return np.full(one.shape[1:], np.nan)
    pooled = np.sqrt(((n - 1) * one.var(axis=0, ddof=1) + (m - 1) * other.var(axis=0, ddof=1)) / (n + m - 2))
    with np.errstate(divide="ignore", invalid="ignore"):
        d = np.where(pooled > 0.0, (one.mean(axis=0) - other.mean(axis=0)) / pooled, np.nan)
    found: Array = d * _unbiased(n + m - 2)
    return found


def _unbiased(freedom: int) -> float:
    return 1.0 - 3.0 / (4.0 * freedom - 1.0)


def g_interval(g: float, first: int, second: int, confidence: float = 0.95) -> tuple[float, float]:
    """Interval of Hedges' g by the noncentral t distribution of the statistic, two-sided."""
    if not np.isfinite(g) or min(first, second) < 2:
        return float("nan"), float("nan")
    freedom = first + second - 2
    scale = np.sqrt(first * second / (first + second))
    t = g / _unbiased(freedom) * scale
    tail = 0.5 - 0.5 * confidence
    reach = 8.0 * np.sqrt(1.0 + t**2 / (2.0 * freedom))

    def below(shift: float) -> float:
        """Chance of a statistic up to the observed one; far out, where the series does not converge, 0 or 1."""
        chance = float(nct.cdf(t, freedom, shift))
        return chance if np.isfinite(chance) else float(shift < t)

    def end(share: float) -> float:
        shift = brentq(lambda shift: below(shift) - share, t - reach, t + reach)
        return float(shift / scale * _unbiased(freedom))

    return end(1.0 - tail), end(tail)


def g_curve_interval(g: Array, first: int, second: int, confidence: float = 0.95) -> tuple[Array, Array]:
    """Interval of Hedges' g along a curve, by its variance in large groups (Hedges and Olkin 1985)."""
    if min(first, second) < 2:
        return np.full_like(g, np.nan), np.full_like(g, np.nan)
    error = np.sqrt((first + second) / (first * second) + g**2 / (2.0 * (first + second)))
    half = student.ppf(0.5 + 0.5 * confidence, first + second - 2) * error
    return g - half, g + half


def holm(p: ArrayLike) -> Array:
    """Several p corrected for their number by Holm (1979), in the given order; NaN stays out."""
    given = np.asarray(p, dtype=np.float64)
    found = np.full(given.shape, np.nan)
    known = np.flatnonzero(np.isfinite(given))
    order = known[np.argsort(given[known])]
    steps = given[order] * (len(order) - np.arange(len(order)))
    found[order] = np.minimum(np.maximum.accumulate(steps), 1.0) if len(order) else steps
    return found


def benjamini_hochberg(p: ArrayLike) -> Array:
    """Several q: share of false calls among all with a q as small (Benjamini and Hochberg 1995)."""
    given = np.asarray(p, dtype=np.float64)
    found = np.full(given.shape, np.nan)
    known = np.flatnonzero(np.isfinite(given))
    order = known[np.argsort(given[known])]
    steps = given[order] * len(order) / np.arange(1, len(order) + 1)
    found[order] = np.minimum(np.minimum.accumulate(steps[::-1])[::-1], 1.0) if len(order) else steps
    return found
