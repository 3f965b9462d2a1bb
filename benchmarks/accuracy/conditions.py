"""Conditions within subjects, and outliers: how often either is called where there is none, and where there is one."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy import stats

from benchmarks.accuracy.groups import ALPHA, CENTER, CURVES, PARAMETERS, PERCENT, WIDTH, animals, share
from myomorph.analysis.conditions import FAR, modified_z
from myomorph.analysis.permutations import (
    g_interval,
    hedges_g,
    holm,
    p_floor,
    permutation_test,
)

Row = dict[str, object]
EFFECT = 1.5
BETWEEN = 3.0
"""Spread between subjects, in those of differences within them."""


def measure_within() -> Iterator[Row]:
    """Made studies of the same subjects twice: differences called falsely and found, intervals that cover the truth."""
    for n, repeats, most in ((5, 1000, 4000), (6, 1000, 4000), (8, 600, 4000), (12, 200, 2000), (20, 200, 1000)):
        rng = np.random.default_rng(n)
        counts = dict.fromkeys(("curves", "each", "parameters", "found", "groups", "covered"), 0)
        bump = EFFECT * np.exp(-0.5 * ((PERCENT - CENTER) / WIDTH) ** 2)
        near = np.abs(PERCENT - CENTER) < 2 * WIDTH
        for k in range(repeats):
            noise = animals(rng, n, CURVES)
            test = permutation_test(noise, most=most, seed=k)
            counts["curves"] += bool(np.nanmin(test.p) < ALPHA)
            counts["each"] += bool(np.nanmin(test.alone) < ALPHA)
            p = np.array([permutation_test(rng.standard_normal(n), most=most, seed=k).p for _ in range(PARAMETERS)])
            counts["parameters"] += bool(holm(p).min() < ALPHA)
            shifted = noise[:, 0] + bump
            counts["found"] += bool((permutation_test(shifted, most=most, seed=k).p[near] < ALPHA).any())
            subjects = BETWEEN * animals(rng, n, 1)[:, 0]
            apart = permutation_test(subjects + shifted, subjects, most=min(most, 1000), seed=k).p
            counts["groups"] += bool((apart[near] < ALPHA).any())
            differences = 1.0 + rng.standard_normal(n)
            low, high = g_interval(float(hedges_g(differences)), n)
            counts["covered"] += low <= 1.0 <= high
        yield {
            "subjects": n,
            "studies": repeats,
            "least p": p_floor(n, most=most),
            f"{CURVES} curves, falsely [%]": share(counts["curves"], repeats),
            "each sample alone, falsely [%]": share(counts["each"], repeats),
            f"{PARAMETERS} parameters, Holm, falsely [%]": share(counts["parameters"], repeats),
            f"difference of {EFFECT:g} SD, found [%]": share(counts["found"], repeats),
            "taken as groups, found [%]": share(counts["groups"], repeats),
            "interval of the effect covers it [%]": share(counts["covered"], repeats),
        }


def measure_outliers() -> Iterator[Row]:
    """Made trials, some of them six spreads away: named by the modified z-score, and by mean and standard deviation."""
    for n, wrong, repeats in ((6, 1, 4000), (12, 1, 4000), (12, 4, 4000), (100, 1, 1000), (100, 30, 1000)):
        rng = np.random.default_rng(n + wrong)
        good, found, plain, skewed = 0, 0, 0, 0
        for _ in range(repeats):
            values = rng.standard_normal(n)
            values[:wrong] += 6.0
            called = np.abs(modified_z(values)) > FAR
            good += int(called[wrong:].sum())
            found += int(called[:wrong].sum())
            plain += int((np.abs(stats.zscore(values, ddof=1)) > FAR)[:wrong].sum())
            skewed += int((np.abs(modified_z(np.exp(0.5 * rng.standard_normal(n)))) > FAR).sum())
        yield {
            "trials": n,
            "of them 6 SD away": wrong,
            "studies": repeats,
            "named of these [%]": 100.0 * found / (repeats * wrong),
            "by mean and SD [%]": 100.0 * plain / (repeats * wrong),
            "good trials named [%]": 100.0 * good / (repeats * (n - wrong)),
            "of a skewed (lognormal) value [%]": 100.0 * skewed / (repeats * n),
        }
