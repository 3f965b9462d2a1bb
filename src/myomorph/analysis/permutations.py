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
from collections.abc import Callable
from dataclasses import dataclass
from math import comb
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq
from scipy.stats import nct
from scipy.stats import t as student

from myomorph.model.arrays import Array, read_only
from myomorph.model.errors import BadData

FEWEST = 3
"""Members of a group from which on it is tested."""
SAME = 1e-9
"""Two |t| are equal within this share."""


@read_only
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
    return _largest(
        rows, values.shape[1], known, shape, exact, p_floor(len(one), len(other), most),
        lambda part: _statistics(values[:, known], part, curve),
    )  # fmt: skip


def _largest(
    rows: NDArray[Any],
    count: int,
    known: NDArray[np.bool_],
    shape: tuple[int, ...],
    exact: bool,
    floor: float,
    statistics: Callable[[NDArray[Any]], Array],
) -> PermutationTest:
    """The largest |t| of every row of relabellings against the first row's, number by number."""
    observed = statistics(rows[:1])[0]
    largest = np.empty(len(rows))
    alone = np.zeros(int(known.sum()))
    for start in range(0, len(rows), 256):
        sizes = np.abs(statistics(rows[start : start + 256]))
        largest[start : start + 256] = sizes.max(axis=1, initial=0.0)
        alone += (sizes >= np.abs(observed) * (1.0 - SAME)).sum(axis=0)
    ordered = np.sort(largest)
    reached = len(rows) - np.searchsorted(ordered, np.abs(observed) * (1.0 - SAME), side="left")
    found = [np.full(count, np.nan) for _ in range(3)]
    for table, part in zip(found, (observed, reached / len(rows), alone / len(rows)), strict=True):
        table[known] = part
    statistic, p, single = (table.reshape(shape) for table in found)
    return PermutationTest(statistic, p, single, len(rows), exact, floor)


def signs(members: int, most: int = 10000, seed: int = 0) -> tuple[Array, bool]:
    """Every way to turn differences round (ways, members) of 1 and -1, as they are first, and whether these are all."""
    if 2**members <= most:
        ways = np.arange(2**members)[:, None] >> np.arange(members) & 1
        return np.where(ways, -1.0, 1.0), True
    rng = np.random.default_rng(seed)
    rows: Array = np.where(rng.random((most, members)) < 0.5, -1.0, 1.0)
    rows[0] = 1.0
    return rows, False


def paired_floor(members: int, most: int = 10000) -> float:
    """Least p that can come out of pairs: all differences turned round together give the same |t|."""
    return max(2.0 / 2.0**members, 1.0 / most if 2**members > most else 0.0)


def paired_test(differences: ArrayLike, most: int = 10000, seed: int = 0) -> PermutationTest:
    """Largest-statistic test of differences within pairs: under no difference each is as likely turned round.

    Parameters
    ----------
    differences : (pairs,) numbers, (pairs, samples) a curve or (pairs, curves, samples) several; a number that is NaN
        for any pair is left out
    most : ways to turn them round above which random ones are drawn
    seed : of these

    Raises
    ------
    BadData : fewer than three pairs
    """
    given = np.asarray(differences, dtype=np.float64)
    if len(given) < FEWEST:
        raise BadData(f"{len(given)} pairs: a test needs {FEWEST} or more")
    shape = given.shape[1:]
    values = given.reshape(len(given), -1)
    known: NDArray[np.bool_] = np.asarray(np.isfinite(values).all(axis=0))
    curve = None if not shape else np.repeat(np.arange(int(np.prod(shape[:-1]))), shape[-1])[known]
    rows, exact = signs(len(given), most, seed)
    return _largest(
        rows, values.shape[1], known, shape, exact, paired_floor(len(given), most),
        lambda part: _paired_statistics(values[:, known], part, curve),
    )  # fmt: skip


def _paired_statistics(values: Array, rows: Array, curve: NDArray[np.int64] | None) -> Array:
    """The statistic (ways, numbers) of differences (pairs, numbers); `curve` (numbers,) tells whose each is."""
    n = float(len(values))
    whole = (values**2).sum(axis=0)
    mean = rows @ values / n
    error = np.sqrt(np.maximum(whole - n * mean**2, 0.0) / (n - 1.0) / n)
    floor = np.maximum(error, 1e-9 * np.sqrt(np.maximum(whole, 1e-300)))
    if curve is not None:
        _add_medians(floor, error, curve)
    t: Array = mean / floor
    return t


def _add_medians(floor: Array, error: Array, curve: NDArray[np.int64]) -> None:
    """Add to every standard error the median of those along its curve."""
    edges = np.flatnonzero(np.diff(np.concatenate([[-1], curve, [-1]])))
    for start, stop in itertools.pairwise(edges):
        floor[:, start:stop] += np.median(error[:, start:stop], axis=1, keepdims=True)


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
        _add_medians(floor, error, curve)
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


def paired_g(differences: ArrayLike) -> Array:
    """Mean of differences within pairs over their standard deviation, without its bias in small groups.

    Parameters
    ----------
    differences : (pairs, ...); NaN where unknown

    Returns
    -------
    (...), NaN with fewer than two pairs or without any spread
    """
    given = np.asarray(differences, dtype=np.float64)
    if len(given) < 2:
        return np.full(given.shape[1:], np.nan)
    spread = given.std(axis=0, ddof=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        d = np.where(spread > 0.0, given.mean(axis=0) / spread, np.nan)
    found: Array = d * _unbiased(len(given) - 1)
    return found


def g_interval(g: float, first: int, second: int, confidence: float = 0.95) -> tuple[float, float]:
    """Interval of Hedges' g by the noncentral t distribution of the statistic, two-sided."""
    if not np.isfinite(g) or min(first, second) < 2:
        return float("nan"), float("nan")
    return _noncentral(g, first + second - 2, float(np.sqrt(first * second / (first + second))), confidence)


def paired_g_interval(g: float, pairs: int, confidence: float = 0.95) -> tuple[float, float]:
    """The same of the effect size within pairs."""
    if not np.isfinite(g) or pairs < 2:
        return float("nan"), float("nan")
    return _noncentral(g, pairs - 1, float(np.sqrt(pairs)), confidence)


def _noncentral(g: float, freedom: int, scale: float, confidence: float) -> tuple[float, float]:
    """Interval of the effect whose statistic is `scale` times as large, from its estimate without bias.

    It is exact for the effect itself, so that the ends are not corrected for the bias of the estimate.
    """
    t = g / _unbiased(freedom) * scale
    tail = 0.5 - 0.5 * confidence
    reach = 8.0 * np.sqrt(1.0 + t**2 / (2.0 * freedom))

    def below(shift: float) -> float:
        """Chance of a statistic up to the observed one; far out, where the series does not converge, 0 or 1."""
        chance = float(nct.cdf(t, freedom, shift))
        return chance if np.isfinite(chance) else float(shift < t)

    def end(share: float) -> float:
        shift = brentq(lambda shift: below(shift) - share, t - reach, t + reach)
        return float(shift / scale)

    return end(1.0 - tail), end(tail)


def g_curve_interval(g: Array, first: int, second: int, confidence: float = 0.95) -> tuple[Array, Array]:
    """Interval of Hedges' g along a curve, by its variance in large groups (Hedges and Olkin 1985)."""
    if min(first, second) < 2:
        return np.full_like(g, np.nan), np.full_like(g, np.nan)
    error = np.sqrt((first + second) / (first * second) + g**2 / (2.0 * (first + second)))
    half = student.ppf(0.5 + 0.5 * confidence, first + second - 2) * error
    return g - half, g + half


def paired_g_curve_interval(g: Array, pairs: int, confidence: float = 0.95) -> tuple[Array, Array]:
    """The same of the effect size within pairs."""
    if pairs < 2:
        return np.full_like(g, np.nan), np.full_like(g, np.nan)
    half = student.ppf(0.5 + 0.5 * confidence, pairs - 1) * np.sqrt(1.0 / pairs + g**2 / (2.0 * pairs))
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
