"""Tests of two groups by relabelling their members, corrected for all that is looked at.

Where groups do not differ, the labels are exchangeable. Each relabelling gives a statistic of every
number looked at; the share of relabellings whose largest statistic anywhere reaches the observed
one is the chance of seeing any such difference (Nichols and Holmes 2002). All relabellings are
taken while they are few, else random ones with the observed among them.

Groups that differ in spread and not in means are not exchangeable, and a statistic with pooled
variance calls them different. So a difference is divided by the standard error of Welch (1947),
each group with its own variance s^2, which makes the test right for large groups (Janssen 1997),

    t = (mean_1 - mean_2) / sqrt(e_1 + e_2),   e_k = s_k^2 / n_k
    nu = (e_1 + e_2)^2 / (e_1^2 / (n_1 - 1) + e_2^2 / (n_2 - 1))

and t becomes the normal deviate of Student's distribution with nu degrees of freedom, which makes
it nearly right for small ones: in a relabelling spreads are alike, so that its t is less extreme
(prepivoting, Beran 1988). Where the labels are exchangeable, the test is exact all the same.

Along a curve a few animals that happen to agree somewhere in the cycle would set the largest t
there, and hide what is different elsewhere. So half the divisor is the median of the standard
errors along the curve, after Tusher et al. (2001), and nu is the geometric mean of that of the
sample and that of the curve, whose e_k are means along it.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from math import comb
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData

MIN_SUBJECTS = 3  # Members of a group from which on it is tested
SAME = 1e-9  # Two statistics are equal within this share
AT_ONCE = 256  # Relabellings that are computed together
Curves = NDArray[np.int64] | None
"""(numbers,) to which curve each number belongs; None for numbers that are no curves."""


@read_only
class PermutationTest:
    """What relabelling shows.

    Attributes
    ----------
    statistic : (...) t of the first group less the second (Welch), or of differences (Student)
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


class Labellings(NamedTuple):
    """Relabellings.

    Attributes
    ----------
    rows : (labellings, members) whether a member is in the first group, or the sign of a
        difference; as observed in the first row
    exact : whether they are all there are
    """

    rows: NDArray[Any]
    exact: bool


def labellings(first: int, second: int, most: int = 10000, seed: int = 0) -> Labellings:
    """Choose who is in the first group, in every way while these are few, else at random.

    Parameters
    ----------
    first, second : members of the groups
    most : ways above which random ones are drawn
    seed : of these
    """
    count = first + second
    if comb(count, first) <= most:
        chosen = list(itertools.combinations(range(count), first))
        rows = np.zeros((len(chosen), count), np.bool_)
        rows[np.arange(len(chosen))[:, None], np.array(chosen).reshape(len(chosen), first)] = True
        return Labellings(rows, True)
    rng = np.random.default_rng(seed)
    rows = np.zeros((most, count), np.bool_)
    rows[0, :first] = True
    members = np.argsort(rng.random((most - 1, count)), axis=1)[:, :first]
    rows[np.arange(1, most)[:, None], members] = True
    return Labellings(rows, False)


def signs(members: int, most: int = 10000, seed: int = 0) -> Labellings:
    """Turn differences round, in every way while these are few, else at random.

    Parameters
    ----------
    members : pairs
    most : ways above which random ones are drawn
    seed : of these

    Returns
    -------
    rows of 1 and -1
    """
    if 2**members <= most:
        ways = np.arange(2**members)[:, None] >> np.arange(members) & 1
        return Labellings(np.where(ways, -1.0, 1.0), True)
    rng = np.random.default_rng(seed)
    rows: Array = np.where(rng.random((most, members)) < 0.5, -1.0, 1.0)
    rows[0] = 1.0
    return Labellings(rows, False)


def p_floor(first: int, second: int | None = None, *, most: int = 10000) -> float:
    """Find the least p that can come out of two groups, or of pairs.

    All exchanged, or turned round, give the same |t|.

    Parameters
    ----------
    first, second : members of the groups; `first` alone of pairs
    most : relabellings above which random ones are drawn
    """
    total = 2**first if second is None else comb(first + second, first)
    symmetric = 2.0 if second in (None, first) else 1.0
    return max(symmetric / total, 1.0 / most if total > most else 0.0)


def permutation_test(
    first: ArrayLike, second: ArrayLike | None = None, *, most: int = 10000, seed: int = 0
) -> PermutationTest:
    """Largest-statistic test of two groups, or of differences within pairs.

    Groups are relabelled; differences within pairs are turned round: without a difference each is
    as likely to be. A number that is NaN for any member is left out.

    Parameters
    ----------
    first, second : (members,) numbers, (members, samples) a curve or (members, curves, samples)
        several; without `second`, differences within pairs
    most : relabellings above which random ones are drawn
    seed : of these

    Raises
    ------
    BadData : shapes differ but for members, or a group has fewer than `MIN_SUBJECTS`
    """
    groups = _groups(first, second)
    sizes = [len(group) for group in groups]
    shape = groups[0].shape[1:]
    values = np.concatenate(groups).reshape(sum(sizes), -1)
    known = np.asarray(np.isfinite(values).all(axis=0))
    values = values[:, known]
    curves = _curves(shape)[known] if shape else None
    paired = second is None
    ways = signs(sizes[0], most, seed) if paired else labellings(sizes[0], sizes[1], most, seed)
    statistics = _paired_statistics if paired else _group_statistics
    result = np.full((3, len(known)), np.nan)
    result[:, known] = _counted(ways.rows, lambda rows: statistics(values, rows, curves))
    result[0, known] = _student(values) if paired else _welch(values, sizes[0])
    statistic, p, single = result.reshape(3, *shape)
    return PermutationTest(
        statistic=statistic,
        p=p,
        alone=single,
        relabellings=len(ways.rows),
        exact=ways.exact,
        floor=p_floor(*sizes, most=most),
    )


def _curves(shape: tuple[int, ...]) -> np.ndarray:
    """Return the index of the curve of each value, of (curves, samples) or (samples,)."""
    return np.repeat(np.arange(int(np.prod(shape[:-1]))), shape[-1])


def _groups(first: ArrayLike, second: ArrayLike | None) -> list[Array]:
    """Check groups, or differences within pairs; errors are those of `permutation_test`."""
    groups = [
        np.asarray(sample, dtype=np.float64) for sample in (first, second) if sample is not None
    ]
    if groups[-1].shape[1:] != groups[0].shape[1:]:
        raise BadData(
            f"groups of shapes {groups[0].shape} and {groups[1].shape}: expected the same but for"
            " members"
        )
    sizes = [len(group) for group in groups]
    if min(sizes) < MIN_SUBJECTS:
        who = f"{sizes[0]} pairs" if second is None else f"groups of {sizes[0]} and {sizes[1]}"
        where = "" if second is None else " in each"
        raise BadData(f"{who}: a test needs {MIN_SUBJECTS} or more{where}")
    return groups


class Counted(NamedTuple):
    """Observed statistics (numbers,), and shares of relabellings that reach them.

    Attributes
    ----------
    reached : by their largest statistic
    alone : by that of the number itself
    """

    observed: Array
    reached: Array
    alone: Array


def _counted(rows: NDArray[Any], statistics: Callable[[NDArray[Any]], Array]) -> Counted:
    """Count the relabellings whose statistics reach the observed ones.

    Parameters
    ----------
    rows : (labellings, members)
    statistics : gives (ways, numbers) of some of these
    """
    observed = statistics(rows[:1])[0]
    limits = np.abs(observed) * (1.0 - SAME)
    largest = np.empty(len(rows))
    alone = np.zeros(len(observed))
    for start in range(0, len(rows), AT_ONCE):
        part = np.abs(statistics(rows[start : start + AT_ONCE]))
        largest[start : start + AT_ONCE] = part.max(axis=1, initial=0.0)
        alone += (part >= limits).sum(axis=0)
    reached = len(rows) - np.searchsorted(np.sort(largest), limits, side="left")
    return Counted(observed, reached / len(rows), alone / len(rows))


def _student(values: Array) -> Array:
    """(numbers,) Student's t of differences (pairs, numbers)."""
    return _divided(values.mean(axis=0), values.std(axis=0, ddof=1) / np.sqrt(len(values)))


def _welch(values: Array, count: int) -> Array:
    """(numbers,) Welch's t of values (members, numbers), of whom `count` are the first group."""
    parts = values[:count], values[count:]
    squares = sum(part.var(axis=0, ddof=1) / len(part) for part in parts)
    return _divided(parts[0].mean(axis=0) - parts[1].mean(axis=0), np.sqrt(squares))


def _divided(difference: Array, error: Array) -> Array:
    """Quotient, infinite where nothing spreads and means differ."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(difference / error)


def _paired_statistics(values: Array, rows: NDArray[Any], curves: Curves) -> Array:
    """Statistics of differences turned round.

    Parameters
    ----------
    values : (pairs, numbers)
    rows : (ways, pairs) of 1 and -1
    curves : of the numbers

    Returns
    -------
    (ways, numbers)
    """
    n = float(len(values))
    squares = (values**2).sum(axis=0)
    mean = rows @ values / n
    error = np.sqrt(np.maximum(squares - n * mean**2, 0.0) / (n - 1.0) / n)
    return mean / _with_medians(_not_zero(error, squares), curves)


def _group_statistics(values: Array, rows: NDArray[Any], curves: Curves) -> Array:
    """Statistics of groups relabelled.

    Parameters
    ----------
    values : (members, numbers)
    rows : (labellings, members) whether a member is in the first group
    curves : of the numbers

    Returns
    -------
    (labellings, numbers) normal deviates
    """
    inside = rows.astype(np.float64)
    n = float(inside[0].sum())
    m = float(len(values) - n)
    # Means taken off first: sums of squares of large numbers would swallow small spreads.
    centered = values - values.mean(axis=0)
    sums = inside @ centered
    squares = inside @ centered**2
    all_squares = (centered**2).sum(axis=0)
    mean = sums / n
    other = -sums / m
    # Squared standard errors of both means
    of_first = np.maximum(squares - n * mean**2, 0.0) / (n - 1.0) / n
    of_second = np.maximum(all_squares - squares - m * other**2, 0.0) / (m - 1.0) / m
    freedom = welch_freedom(of_first, of_second, (n, m))
    if curves is not None:
        first_along = _along_curves(of_first, curves, np.mean)
        second_along = _along_curves(of_second, curves, np.mean)
        freedom = np.sqrt(freedom * welch_freedom(first_along, second_along, (n, m)))
    error = _not_zero(np.sqrt(of_first + of_second), all_squares)
    return _normal_deviate((mean - other) / _with_medians(error, curves), freedom)


def _not_zero(error: Array, squares: Array) -> Array:
    """Bound standard errors from below by the rounding of the numbers.

    `squares` are the sums of squares of these numbers.
    """
    return np.maximum(error, 1e-9 * np.sqrt(np.maximum(squares, 1e-300)))


def _with_medians(error: Array, curves: Curves) -> Array:
    """Mean of each standard error and the median of those along its curve.

    Parameters
    ----------
    error : (ways, numbers)
    curves : of the numbers; None leaves errors as they are

    Returns
    -------
    (ways, numbers)
    """
    if curves is None:
        return error
    return 0.5 * (error + _along_curves(error, curves, np.median))


def _along_curves(values: Array, curves: NDArray[np.int64], middle: Callable[..., Array]) -> Array:
    """Mean or median along the curve of each number.

    Parameters
    ----------
    values : (ways, numbers)
    curves : of the numbers
    middle : `np.mean` or `np.median`

    Returns
    -------
    (ways, numbers)
    """
    result = np.empty_like(values)
    edges = np.flatnonzero(np.diff(np.concatenate([[-1], curves, [-1]])))
    for start, stop in itertools.pairwise(edges):
        result[:, start:stop] = middle(values[:, start:stop], axis=1, keepdims=True)
    return result


def welch_freedom(first: Array, second: Array, sizes: tuple[float, float]) -> Array:
    """Degrees of freedom of a difference of means (Welch 1947).

    nu = (e_1 + e_2)^2 / (e_1^2 / (n_1 - 1) + e_2^2 / (n_2 - 1))

    Parameters
    ----------
    first, second : squared standard errors e of both means
    sizes : n of both groups

    Returns
    -------
    as of the errors; n_1 + n_2 - 2 where both are 0
    """
    parts = first**2 / (sizes[0] - 1.0) + second**2 / (sizes[1] - 1.0)
    whole = (first + second) ** 2
    return np.divide(whole, parts, out=np.full_like(whole, sum(sizes) - 2.0), where=parts > 0.0)


def _normal_deviate(t: Array, freedom: Array) -> Array:
    """Convert Student's t to the normal deviate of nearly the same chance.

    z = (8 nu + 1) / (8 nu + 3) sqrt(nu ln(1 + t^2 / nu))

    Source: Wallace 1959.

    Parameters
    ----------
    t, freedom : (ways, numbers)

    Returns
    -------
    (ways, numbers) with the sign of t
    """
    factor = (8.0 * freedom + 1.0) / (8.0 * freedom + 3.0)
    return np.copysign(factor * np.sqrt(freedom * np.log1p(t**2 / freedom)), t)


class EffectSize(NamedTuple):
    """Standardized difference of means, and what its interval needs.

    Attributes
    ----------
    g : (...) without bias, NaN where it is not known
    spread : (...) standard deviation in which it is
    error : (...) standard error of the difference itself
    freedom : (...) degrees of freedom of g
    freedom_of_error : (...) of the standard error
    """

    g: Array
    spread: Array
    error: Array
    freedom: Array
    freedom_of_error: Array


def effect_size(first: ArrayLike, second: ArrayLike | None = None) -> EffectSize:
    """Effect size without its bias in small groups (Hedges 1981), spreads not pooled.

    Of two groups it is their difference of means over the root mean square of their standard
    deviations, each group with its own (Delacre et al. 2021); of differences within pairs, given
    alone, their mean over their standard deviation.

    Parameters
    ----------
    first, second : (members, ...) NaN where unknown

    Returns
    -------
    NaN with fewer than two members in a group, fewer than three pairs, or without any spread
    """
    groups = [
        np.asarray(sample, dtype=np.float64) for sample in (first, second) if sample is not None
    ]
    sizes = [len(group) for group in groups]
    # One degree of freedom has no unbiased estimate.
    if min(sizes) < 2 or sum(sizes) - len(sizes) < 2:
        nothing = np.full(groups[0].shape[1:], np.nan)
        return EffectSize(
            g=nothing, spread=nothing, error=nothing, freedom=nothing, freedom_of_error=nothing
        )
    means = [group.mean(axis=0) for group in groups]
    variances = [np.asarray(group.var(axis=0, ddof=1)) for group in groups]
    errors = [variance / size for variance, size in zip(variances, sizes, strict=True)]
    spread = np.sqrt(sum(variances) / len(groups))
    if len(groups) == 1:
        difference = means[0]
        freedom = freedom_of_error = np.full(np.shape(difference), sizes[0] - 1.0)
    else:
        difference = means[0] - means[1]
        ends = (float(sizes[0]), float(sizes[1]))
        freedom = _effect_freedom(variances[0], variances[1], ends)
        freedom_of_error = welch_freedom(errors[0], errors[1], ends)
    d = np.where(spread > 0.0, _divided(difference, spread), np.nan)
    return EffectSize(
        g=d * _unbiased(freedom),
        spread=spread,
        error=np.sqrt(sum(errors)),
        freedom=freedom,
        freedom_of_error=freedom_of_error,
    )


def _effect_freedom(first: Array, second: Array, sizes: tuple[float, float]) -> Array:
    """Degrees of freedom of the mean of two variances.

    nu = (v_1 + v_2)^2 / (v_1^2 / (n_1 - 1) + v_2^2 / (n_2 - 1)), with v^2 (n - 1) / (n + 1) for the
    square of each, which of an estimated variance is too large by the inverse of that.

    Parameters
    ----------
    first, second : (...) variances v
    sizes : n of both groups

    Returns
    -------
    (...) at most n_1 + n_2 - 2
    """
    square = first**2 * (sizes[0] - 1.0) / (sizes[0] + 1.0)
    other = second**2 * (sizes[1] - 1.0) / (sizes[1] + 1.0)
    parts = square / (sizes[0] - 1.0) + other / (sizes[1] - 1.0)
    most = np.full_like(parts, sum(sizes) - 2.0)
    whole = square + other + 2.0 * first * second
    return np.minimum(np.divide(whole, parts, out=most.copy(), where=parts > 0.0), most)


def _unbiased(freedom: Array) -> Array:
    """Hedges' factor against the bias of few degrees of freedom."""
    return np.asarray(1.0 - 3.0 / (4.0 * freedom - 1.0))


def effect_interval(effect: EffectSize, confidence: float = 0.95) -> tuple[float, float]:
    """Interval of the effect size of one number, by the noncentral t distribution, two-sided.

    It holds 0 where the interval of the difference itself does. It is of the effect, so that the
    ends are not corrected for the bias of the estimate.

    Parameters
    ----------
    effect : of one number
    confidence : of the interval

    Returns
    -------
    low, high
    """
    if not np.isfinite(effect.g):
        return float("nan"), float("nan")
    freedom = float(effect.freedom_of_error)
    ratio = float(effect.error / effect.spread)
    t = float(effect.g / _unbiased(effect.freedom)) / ratio
    tail = 0.5 - 0.5 * confidence
    search_range = 8.0 * np.sqrt(1.0 + t**2 / (2.0 * freedom))

    def below(shift: float) -> float:
        """Chance of a statistic up to the observed one.

        Far out, where the series does not converge, it is 0 or 1.
        """
        chance = float(scipy.special.nctdtr(freedom, shift, t))
        return chance if np.isfinite(chance) else float(shift < t)

    def end(share: float) -> float:
        ends = (t - search_range, t + search_range)
        return float(scipy.optimize.brentq(lambda shift: below(shift) - share, *ends)) * ratio

    return end(1.0 - tail), end(tail)


def effect_curve_interval(effect: EffectSize, confidence: float = 0.95) -> tuple[Array, Array]:
    """Interval of the effect size along a curve, for large groups (Hedges and Olkin 1985).

    Parameters
    ----------
    effect : (...) along the curve
    confidence : of the interval

    Returns
    -------
    (...) low, high
    """
    error = np.sqrt(
        _divided(effect.error, effect.spread) ** 2 + effect.g**2 / (2.0 * effect.freedom)
    )
    half = scipy.special.stdtrit(effect.freedom_of_error, 0.5 + 0.5 * confidence) * error
    return effect.g - half, effect.g + half


def holm(p: ArrayLike) -> Array:
    """Correct several p for their number by Holm (1979).

    Parameters
    ----------
    p : (n,) in any order; NaN stays out

    Returns
    -------
    (n,) in the given order
    """
    return _corrected(p, lambda raw: np.maximum.accumulate(raw * (len(raw) - np.arange(len(raw)))))


def benjamini_hochberg(p: ArrayLike) -> Array:
    """Compute the q of several p: the share of false calls among all with a q as small.

    Source: Benjamini and Hochberg 1995.

    Parameters
    ----------
    p : (n,) in any order; NaN stays out

    Returns
    -------
    (n,) in the given order
    """
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
