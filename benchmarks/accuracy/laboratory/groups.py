"""Groups, conditions and outliers.

Measured is how often differences are found that do not exist, and that do.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache

import numpy as np
from scipy import stats

from myomorph.core.model.arrays import Array
from myomorph.lab.analysis.conditions import OUTLIER_SCORE, modified_z
from myomorph.lab.analysis.permutations import (
    effect_interval,
    effect_size,
    holm,
    p_floor,
    permutation_test,
)

Row = dict[str, object]
ALPHA = 0.05
PERCENT = np.linspace(0.0, 100.0, 101)
PARAMETERS = 12
CURVES = 4
CENTER = 60.0
WIDTH = 8.0
"""Where groups differ in the curves that do, and how widely [%]."""


@lru_cache(maxsize=1)
def _root() -> Array:
    """(101, 101) root of the covariance of a smooth curve of unit spread at every sample."""
    lags = PERCENT[:, None] - PERCENT
    root: Array = np.linalg.cholesky(
        np.exp(-0.5 * (lags / 10.0) ** 2) + 1e-6 * np.eye(len(PERCENT))
    )
    return root


def animals(rng: np.random.Generator, count: int, curves: int) -> Array:
    """Draw curves, smooth as a joint's angle and related to each other.

    Parameters
    ----------
    rng : to draw with
    count : of animals
    curves : of each animal

    Returns
    -------
    (animals, curves, 101) with mean 0 and variance near 1
    """
    own = rng.standard_normal((count, curves, len(PERCENT))) @ _root().T
    shared = rng.standard_normal((count, 1, len(PERCENT))) @ _root().T
    found: Array = np.sqrt(0.6) * own + np.sqrt(0.4) * shared
    return found


def measure_false() -> Iterator[Row]:
    """Share of made studies without any difference in which one is called."""
    for n, m, repeats, most in (
        (3, 3, 1000, 10000),
        (4, 4, 1000, 10000),
        (4, 6, 1000, 10000),
        (6, 6, 400, 10000),
        (10, 10, 400, 1000),
    ):
        rng = np.random.default_rng(n * 100 + m)
        called = {"curves": 0, "alone": 0, "t": 0, "scalars": 0, "raw": 0}
        for k in range(repeats):
            one = animals(rng, n, CURVES)
            other = animals(rng, m, CURVES)
            test = permutation_test(one, other, most=most, seed=k)
            called["curves"] += bool(np.nanmin(test.p) < ALPHA)
            called["alone"] += bool(np.nanmin(test.alone) < ALPHA)
            called["t"] += bool(stats.ttest_ind(one, other).pvalue.min() < ALPHA)
            p = np.array(
                [
                    permutation_test(
                        rng.standard_normal(n), rng.standard_normal(m), most=most, seed=k
                    ).p
                    for _ in range(PARAMETERS)
                ]
            )
            called["scalars"] += bool(holm(p).min() < ALPHA)
            called["raw"] += bool(p.min() < ALPHA)
        yield {
            "animals": f"{n} and {m}",
            "studies": repeats,
            "smallest possible p": p_floor(n, m, most=most),
            f"{CURVES} curves, corrected [%]": share(called["curves"], repeats),
            "curves, each sample alone [%]": share(called["alone"], repeats),
            "curves, t test of each sample [%]": share(called["t"], repeats),
            f"{PARAMETERS} parameters, Holm [%]": share(called["scalars"], repeats),
            "parameters, uncorrected [%]": share(called["raw"], repeats),
        }


def share(count: int, of: int) -> str:
    """Return a share [%] with its 95 % interval (Wilson)."""
    low, high = stats.binomtest(count, of).proportion_ci(method="wilson")
    return f"{100 * count / of:.1f} ({100 * low:.1f} to {100 * high:.1f})"


def measure_power() -> Iterator[Row]:
    """Measure the share of simulated studies in which a true difference is found.

    It is in one of the curves and in one parameter.
    """
    for n, repeats, most in ((4, 300, 10000), (6, 200, 10000), (10, 100, 1000)):
        for effect in (1.0, 2.0, 3.0):
            rng = np.random.default_rng(n)
            bump = effect * np.exp(-0.5 * ((PERCENT - CENTER) / WIDTH) ** 2)
            found = 0
            elsewhere = 0
            parameter = 0
            centers = []
            for k in range(repeats):
                one = animals(rng, n, CURVES)
                other = animals(rng, n, CURVES)
                one[:, 0] += bump
                p = permutation_test(one, other, most=most, seed=k).p
                differs = p[0] < ALPHA
                found += bool(differs[np.abs(PERCENT - CENTER) < 2 * WIDTH].any())
                elsewhere += bool(
                    (p[1:] < ALPHA).any() or differs[np.abs(PERCENT - CENTER) > 3 * WIDTH].any()
                )
                centers += [float(PERCENT[differs].mean())] if differs.any() else []
                values = permutation_test(
                    rng.standard_normal(n) + effect, rng.standard_normal(n), most=most, seed=k
                ).p
                parameter += bool(values < ALPHA)
            yield {
                "animals in each group": n,
                "effect [SD]": effect,
                "studies": repeats,
                "curve, found [%]": share(found, repeats),
                "its middle, mean [% of cycle]": float(np.mean(centers))
                if centers
                else float("nan"),
                "elsewhere, falsely [%]": share(elsewhere, repeats),
                "parameter, found [%]": share(parameter, repeats),
                "t test would find [%]": 100.0 * _t_power(effect, n),
            }


def _t_power(effect: float, n: int) -> float:
    """Power of Student's t test of one parameter."""
    freedom = 2 * n - 2
    shift = effect * np.sqrt(n / 2.0)
    limit = stats.t.ppf(1.0 - ALPHA / 2.0, freedom)
    return float(stats.nct.sf(limit, freedom, shift) + stats.nct.cdf(-limit, freedom, shift))


SPREADS = (
    (4, 12, 3.0),
    (5, 15, 3.0),
    (3, 10, 3.0),
    (12, 4, 3.0),
    (8, 8, 3.0),
    (10, 30, 2.0),
    (6, 18, 1.0),
)
"""Members of two groups, and the spread of the first by that of the second."""
RELABELLINGS = 400


def pooled_p(first: Array, second: Array, rng: np.random.Generator) -> Array:
    """Return p by relabelling with pooled variance, corrected for all: the earlier rule.

    Parameters
    ----------
    first : (animals, ...) numbers of one group
    second : (animals, ...) numbers of the other
    rng : to relabel with

    Returns
    -------
    (numbers,)
    """
    values = np.concatenate([first, second]).reshape(len(first) + len(second), -1)
    largest = []
    for way in range(RELABELLINGS):
        order = np.arange(len(values)) if way == 0 else rng.permutation(len(values))
        labelled = values[order]
        one = labelled[: len(first)]
        other = labelled[len(first) :]
        freedom = len(values) - 2.0
        squares = one.var(axis=0) * len(one) + other.var(axis=0) * len(other)
        error = np.sqrt(squares / freedom * (1.0 / len(one) + 1.0 / len(other)))
        if values.shape[1] > 1:
            by_curve = error.reshape(-1, len(PERCENT))
            error = (by_curve + np.median(by_curve, axis=1, keepdims=True)).ravel()
        largest.append(np.abs(one.mean(axis=0) - other.mean(axis=0)) / error)
    found = np.array(largest)
    shares: Array = (found.max(axis=1)[:, None] >= found[0] * (1.0 - 1e-9)).mean(axis=0)
    return shares


def measure_spreads() -> Iterator[Row]:
    """Share of made studies called different where groups differ in spread alone, not in means."""
    for n, m, ratio in SPREADS:
        rng = np.random.default_rng(7000 + 100 * n + m)
        counts = dict.fromkeys(("number", "pooled", "curves", "pooled curves", "covered"), 0)
        repeats = 300
        for k in range(repeats):
            one = ratio * rng.standard_normal(n)
            other = rng.standard_normal(m)
            test = permutation_test(one, other, most=RELABELLINGS, seed=k)
            counts["number"] += bool(test.p <= ALPHA)
            counts["pooled"] += bool(pooled_p(one, other, rng) <= ALPHA)
            low, high = effect_interval(effect_size(one, other))
            counts["covered"] += low <= 0.0 <= high
            curves = ratio * animals(rng, n, 2)
            others = animals(rng, m, 2)
            test = permutation_test(curves, others, most=RELABELLINGS, seed=k)
            counts["curves"] += bool(np.nanmin(test.p) <= ALPHA)
            counts["pooled curves"] += bool(pooled_p(curves, others, rng).min() <= ALPHA)
        yield {
            "members": f"{n} and {m}",
            "spread of the first": ratio,
            "studies": repeats,
            "parameter [%]": share(counts["number"], repeats),
            "with pooled variance [%]": share(counts["pooled"], repeats),
            "2 curves [%]": share(counts["curves"], repeats),
            "curves, pooled variance [%]": share(counts["pooled curves"], repeats),
            "interval of the effect holds 0 [%]": share(counts["covered"], repeats),
        }
    for n, ratio in ((6, 3.0), (8, 3.0), (12, 3.0)):
        yield _pairs_that_spread(n, ratio)


def _pairs_that_spread(n: int, ratio: float) -> Row:
    """Pairs, in one condition of which subjects spread more."""
    rng = np.random.default_rng(7900 + n)
    repeats = 300
    number = curves = covered = 0
    for k in range(repeats):
        differences = ratio * rng.standard_normal(n) - rng.standard_normal(n)
        test = permutation_test(differences, most=RELABELLINGS, seed=k)
        number += bool(test.p <= ALPHA)
        low, high = effect_interval(effect_size(differences))
        covered += low <= 0.0 <= high
        made = ratio * animals(rng, n, 2) - animals(rng, n, 2)
        of_curves = permutation_test(made, most=RELABELLINGS, seed=k)
        curves += bool(np.nanmin(of_curves.p) <= ALPHA)
    return {
        "members": f"{n} pairs",
        "spread of the first": ratio,
        "studies": repeats,
        "parameter [%]": share(number, repeats),
        "with pooled variance [%]": "",
        "2 curves [%]": share(curves, repeats),
        "curves, pooled variance [%]": "",
        "interval of the effect holds 0 [%]": share(covered, repeats),
    }


EFFECT = 1.5
BETWEEN = 3.0
"""Spread between subjects, in those of differences within them."""


def measure_within() -> Iterator[Row]:
    """Simulate studies of the same subjects twice.

    The rows have differences called falsely and found, and the coverage of intervals.
    """
    for n, repeats, most in (
        (5, 1000, 4000),
        (6, 1000, 4000),
        (8, 600, 4000),
        (12, 200, 2000),
        (20, 200, 1000),
    ):
        rng = np.random.default_rng(n)
        counts = dict.fromkeys(("curves", "each", "parameters", "found", "groups", "covered"), 0)
        bump = EFFECT * np.exp(-0.5 * ((PERCENT - CENTER) / WIDTH) ** 2)
        near = np.abs(PERCENT - CENTER) < 2 * WIDTH
        for k in range(repeats):
            noise = animals(rng, n, CURVES)
            test = permutation_test(noise, most=most, seed=k)
            counts["curves"] += bool(np.nanmin(test.p) < ALPHA)
            counts["each"] += bool(np.nanmin(test.alone) < ALPHA)
            p = np.array(
                [
                    permutation_test(rng.standard_normal(n), most=most, seed=k).p
                    for _ in range(PARAMETERS)
                ]
            )
            counts["parameters"] += bool(holm(p).min() < ALPHA)
            shifted = noise[:, 0] + bump
            counts["found"] += bool(
                (permutation_test(shifted, most=most, seed=k).p[near] < ALPHA).any()
            )
            subjects = BETWEEN * animals(rng, n, 1)[:, 0]
            apart = permutation_test(subjects + shifted, subjects, most=min(most, 1000), seed=k).p
            counts["groups"] += bool((apart[near] < ALPHA).any())
            differences = 1.0 + rng.standard_normal(n)
            low, high = effect_interval(effect_size(differences))
            counts["covered"] += low <= 1.0 <= high
        yield {
            "subjects": n,
            "studies": repeats,
            "smallest possible p": p_floor(n, most=most),
            f"{CURVES} curves, falsely [%]": share(counts["curves"], repeats),
            "each sample alone, falsely [%]": share(counts["each"], repeats),
            f"{PARAMETERS} parameters, Holm, falsely [%]": share(counts["parameters"], repeats),
            f"difference of {EFFECT:g} SD, found [%]": share(counts["found"], repeats),
            "taken as groups, found [%]": share(counts["groups"], repeats),
            "interval of the effect covers it [%]": share(counts["covered"], repeats),
        }


def measure_outliers() -> Iterator[Row]:
    """Simulate trials, some of them six spreads away.

    They are named by the modified z-score, and by mean and standard deviation.
    """
    for n, wrong, repeats in (
        (6, 1, 4000),
        (12, 1, 4000),
        (12, 4, 4000),
        (100, 1, 1000),
        (100, 30, 1000),
    ):
        rng = np.random.default_rng(n + wrong)
        good = 0
        found = 0
        plain = 0
        skewed = 0
        for _ in range(repeats):
            values = rng.standard_normal(n)
            values[:wrong] += 6.0
            called = np.abs(modified_z(values)) > OUTLIER_SCORE
            good += int(called[wrong:].sum())
            found += int(called[:wrong].sum())
            plain += int((np.abs(stats.zscore(values, ddof=1)) > OUTLIER_SCORE)[:wrong].sum())
            skewed += int(
                (np.abs(modified_z(np.exp(0.5 * rng.standard_normal(n)))) > OUTLIER_SCORE).sum()
            )
        yield {
            "trials": n,
            "of them 6 SD away": wrong,
            "studies": repeats,
            "named of these [%]": 100.0 * found / (repeats * wrong),
            "by mean and SD [%]": 100.0 * plain / (repeats * wrong),
            "good trials named [%]": 100.0 * good / (repeats * (n - wrong)),
            "of a skewed (lognormal) value [%]": 100.0 * skewed / (repeats * n),
        }
