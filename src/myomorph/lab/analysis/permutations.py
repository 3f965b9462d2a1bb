"""Tests of two groups by relabelling their members: exact where they are few, corrected for all
that is looked at.

Under no difference the labels are exchangeable. Each relabelling gives a statistic of every number
looked at; the share of relabellings whose largest |t| anywhere reaches the observed one is the
chance of seeing any such difference (Nichols and Holmes 2002). All relabellings are taken while
they are few, else random ones with the observed among them.

Of a single number the statistic is Student's t. Along a curve it is

    t(s) = (difference of means at s)
           / (its standard error at s + median of the standard errors along the curve):

without the constant, after Tusher et al. (2001), a few animals that happen to agree somewhere in
the cycle would set the largest t there, and hide what is different elsewhere. The test is exact
with it as without.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from math import comb
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData

MIN_SUBJECTS = 3  # Members of a group from which on it is tested
SAME = 1e-9  # Two |t| are equal within this share


@read_only
class PermutationTest:
    """What relabelling shows."""

    statistic: Array  # (...) the first group less the second, see above
    p: Array  # (...) corrected for all numbers looked at together
    alone: Array  # (...) of each number, as if it were the only one
    relabellings: int  # how many, the observed one among them
    exact: bool  # whether they are all there are
    floor: float  # least p that groups of this size can reach


def labellings(
    first: int, second: int, most: int = 10000, seed: int = 0
) -> tuple[NDArray[np.bool_], bool]:
    """Who is in the first group (labellings, members), the observed one first, and whether these
    are all.
    """
    count = first + second
    if comb(count, first) <= most:
        chosen = list(itertools.combinations(range(count), first))
        rows = np.zeros((len(chosen), count), np.bool_)
        rows[np.arange(len(chosen))[:, None], np.array(chosen).reshape(len(chosen), first)] = True
        return rows, True
    rng = np.random.default_rng(seed)
    rows = np.zeros((most, count), np.bool_)
    rows[0, :first] = True
    rows[
        np.arange(1, most)[:, None], np.argsort(rng.random((most - 1, count)), axis=1)[:, :first]
    ] = True
    return rows, False


def p_floor(first: int, second: int | None = None, *, most: int = 10000) -> float:
    """Least p that can come out of two groups, or of pairs: all exchanged, or turned round, give
    the same |t|.
    """
    total = 2**first if second is None else comb(first + second, first)
    return max(
        (2.0 if second in (None, first) else 1.0) / total, 1.0 / most if total > most else 0.0
    )


def permutation_test(
    first: ArrayLike, second: ArrayLike | None = None, *, most: int = 10000, seed: int = 0
) -> PermutationTest:
    """Largest-statistic test of two groups, or of differences within pairs.
    Groups are relabelled; differences within pairs are turned round: under no difference each is as
    likely to be. `first`, `second` (members,) numbers, (members, samples) a curve or (members,
    curves, samples) several; without `second`, differences within pairs; a number that is NaN for
    any member is left out; `most`: relabellings above which random ones are drawn; `seed`: of
    these.
    """
    groups = [
        np.asarray(sample, dtype=np.float64) for sample in (first, second) if sample is not None
    ]
    sizes = [len(group) for group in groups]
    shape = groups[0].shape[1:]
    if groups[-1].shape[1:] != shape:
        raise BadData(
            f"groups of shapes {groups[0].shape} and {groups[1].shape}: expected the same but for"
            " members"
        )
    if min(sizes) < MIN_SUBJECTS:
        who = f"{sizes[0]} pairs" if second is None else f"groups of {sizes[0]} and {sizes[1]}"
        raise BadData(
            f"{who}: a test needs {MIN_SUBJECTS} or more{'' if second is None else ' in each'}"
        )
    values = np.concatenate(groups).reshape(sum(sizes), -1)
    known = np.isfinite(values).all(axis=0)
    curve = np.repeat(np.arange(int(np.prod(shape[:-1]))), shape[-1])[known] if shape else None
    rows: NDArray[Any]
    rows, exact = (
        signs(sizes[0], most, seed)
        if second is None
        else labellings(sizes[0], sizes[1], most, seed)
    )
    statistics = _paired_statistics if second is None else _statistics
    observed = statistics(values[:, known], rows[:1], curve)[0]
    largest = np.empty(len(rows))
    alone = np.zeros(int(known.sum()))
    for start in range(0, len(rows), 256):
        part = np.abs(statistics(values[:, known], rows[start : start + 256], curve))
        largest[start : start + 256] = part.max(axis=1, initial=0.0)
        alone += (part >= np.abs(observed) * (1.0 - SAME)).sum(axis=0)
    reached = len(rows) - np.searchsorted(
        np.sort(largest), np.abs(observed) * (1.0 - SAME), side="left"
    )
    result = np.full((3, values.shape[1]), np.nan)
    result[:, known] = observed, reached / len(rows), alone / len(rows)
    statistic, p, single = result.reshape(3, *shape)
    return PermutationTest(
        statistic=statistic,
        p=p,
        alone=single,
        relabellings=len(rows),
        exact=exact,
        floor=p_floor(*sizes, most=most),
    )


def signs(members: int, most: int = 10000, seed: int = 0) -> tuple[Array, bool]:
    """Every way to turn differences round (ways, members) of 1 and -1, as they are first, and
    whether these are all.
    """
    if 2**members <= most:
        ways = np.arange(2**members)[:, None] >> np.arange(members) & 1
        return np.where(ways, -1.0, 1.0), True
    rng = np.random.default_rng(seed)
    rows: Array = np.where(rng.random((most, members)) < 0.5, -1.0, 1.0)
    rows[0] = 1.0
    return rows, False


def _paired_statistics(values: Array, rows: NDArray[Any], curve: NDArray[np.int64] | None) -> Array:
    """The statistic (ways, numbers) of differences (pairs, numbers); `curve` (numbers,) tells whose
    each is.
    """
    n = float(len(values))
    whole = (values**2).sum(axis=0)
    mean = rows @ values / n
    error = np.sqrt(np.maximum(whole - n * mean**2, 0.0) / (n - 1.0) / n)
    return _over_error(mean, error, whole, curve)


def _statistics(values: Array, rows: NDArray[Any], curve: NDArray[np.int64] | None) -> Array:
    """The statistic (labellings, numbers) of values (members, numbers); `curve` (numbers,) tells
    whose each is.
    """
    inside = rows.astype(np.float64)
    n = float(inside[0].sum())
    m = float(len(values) - inside[0].sum())
    # Means taken off first: sums of squares of large numbers would swallow small spreads.
    centered = values - values.mean(axis=0)
    sums = inside @ centered
    squares = inside @ centered**2
    total = centered.sum(axis=0)
    whole = (centered**2).sum(axis=0)
    mean = sums / n
    other = (total - sums) / m
    within = np.maximum(squares - n * mean**2, 0.0) + np.maximum(
        whole - squares - m * other**2, 0.0
    )
    error = np.sqrt(within / (n + m - 2.0) * (1.0 / n + 1.0 / m))
    return _over_error(mean - other, error, whole, curve)


def _over_error(
    difference: Array, error: Array, whole: Array, curve: NDArray[np.int64] | None
) -> Array:
    """Differences over their standard errors, to each of which the median of those along its curve
    is added.
    """
    floor = np.maximum(error, 1e-9 * np.sqrt(np.maximum(whole, 1e-300)))
    if curve is not None:
        edges = np.flatnonzero(np.diff(np.concatenate([[-1], curve, [-1]])))
        for start, stop in itertools.pairwise(edges):
            floor[:, start:stop] += np.median(error[:, start:stop], axis=1, keepdims=True)
    return difference / floor


def hedges_g(first: ArrayLike, second: ArrayLike | None = None) -> Array:
    """Effect size without its bias in small groups (Hedges 1981).
    Of two groups the difference of means over the pooled standard deviation; of differences within
    pairs, given alone, their mean over their standard deviation. `first`, `second` (members, ...);
    NaN where unknown. Returns (...), NaN with fewer than two members in a group, fewer than three
    pairs, or without any spread.
    """
    groups = [
        np.asarray(sample, dtype=np.float64) for sample in (first, second) if sample is not None
    ]
    freedom = sum(len(group) - 1 for group in groups)
    # One degree of freedom has no unbiased estimate.
    if min(len(group) for group in groups) < 2 or freedom < 2:
        return np.full(groups[0].shape[1:], np.nan)
    spread = np.sqrt(
        sum((len(group) - 1) * group.var(axis=0, ddof=1) for group in groups) / freedom
    )
    difference = groups[0].mean(axis=0) - (groups[1].mean(axis=0) if second is not None else 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        d = np.where(spread > 0.0, difference / spread, np.nan)
    return d * _unbiased(freedom)


def _unbiased(freedom: int) -> float:
    return 1.0 - 3.0 / (4.0 * freedom - 1.0)


def g_interval(g: float, *sizes: int, confidence: float = 0.95) -> tuple[float, float]:
    """Interval of Hedges' g by the noncentral t distribution of the statistic, two-sided.
    It is exact for the effect itself, so that the ends are not corrected for the bias of the
    estimate. `g`: estimate without bias; `sizes`: of the two groups, or the number of pairs.
    """
    if not np.isfinite(g) or min(sizes) < 2:
        return float("nan"), float("nan")
    freedom = sum(sizes) - len(sizes)
    scale = float(np.sqrt(1.0 / sum(1.0 / size for size in sizes)))
    t = g / _unbiased(freedom) * scale
    tail = 0.5 - 0.5 * confidence
    reach = 8.0 * np.sqrt(1.0 + t**2 / (2.0 * freedom))

    def below(shift: float) -> float:
        """Chance of a statistic up to the observed one; far out, where the series does not
        converge, 0 or 1.
        """
        chance = float(scipy.special.nctdtr(freedom, shift, t))
        return chance if np.isfinite(chance) else float(shift < t)

    def end(share: float) -> float:
        shift = scipy.optimize.brentq(lambda shift: below(shift) - share, t - reach, t + reach)
        return float(shift / scale)

    return end(1.0 - tail), end(tail)


def g_curve_interval(g: Array, *sizes: int, confidence: float = 0.95) -> tuple[Array, Array]:
    """Interval of Hedges' g along a curve in large groups (Hedges and Olkin 1985)."""
    if min(sizes) < 2:
        return np.full_like(g, np.nan), np.full_like(g, np.nan)
    error = np.sqrt(sum(1.0 / size for size in sizes) + g**2 / (2.0 * sum(sizes)))
    half = scipy.special.stdtrit(sum(sizes) - len(sizes), 0.5 + 0.5 * confidence) * error
    return g - half, g + half


def holm(p: ArrayLike) -> Array:
    """Several p corrected for their number by Holm (1979), in the given order; NaN stays out."""
    return _corrected(p, lambda raw: np.maximum.accumulate(raw * (len(raw) - np.arange(len(raw)))))


def benjamini_hochberg(p: ArrayLike) -> Array:
    """Several q: share of false calls among all with a q as small (Benjamini and Hochberg 1995)."""
    return _corrected(
        p,
        lambda raw: (
            np.minimum.accumulate((raw / np.arange(1, len(raw) + 1))[::-1])[::-1] * len(raw)
        ),
    )


def _corrected(p: ArrayLike, correct: Callable[[Array], Array]) -> Array:
    """Several p, those that are known corrected in ascending order."""
    raw = np.asarray(p, dtype=np.float64)
    result = np.full(raw.shape, np.nan)
    known = np.flatnonzero(np.isfinite(raw))
    order = known[np.argsort(raw[known])]
    result[order] = np.minimum(correct(raw[order]), 1.0)
    return result
