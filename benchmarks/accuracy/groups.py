"""How often two groups are called different when they are not, and when they are: made animals, the truth is known."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache

import numpy as np
from scipy import stats

from myomorph.analysis.permutations import holm, p_floor, permutation_test
from myomorph.model.arrays import Array

Row = dict[str, object]
ALPHA = 0.05
PERCENT = np.linspace(0.0, 100.0, 101)
PARAMETERS = 12
CURVES = 4
CENTER, WIDTH = 60.0, 8.0
"""Where groups differ in the curves that do, and how widely [%]."""


@lru_cache(maxsize=1)
def _root() -> Array:
    """(101, 101) root of the covariance of a smooth curve of unit spread at every sample."""
    lags = PERCENT[:, None] - PERCENT
    root: Array = np.linalg.cholesky(np.exp(-0.5 * (lags / 10.0) ** 2) + 1e-6 * np.eye(len(PERCENT)))
    return root


def animals(rng: np.random.Generator, count: int, curves: int) -> Array:
    """Curves (animals, curves, 101), smooth as a joint's angle and related to each other."""
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
            one, other = animals(rng, n, CURVES), animals(rng, m, CURVES)
            test = permutation_test(one, other, most=most, seed=k)
            called["curves"] += bool(np.nanmin(test.p) < ALPHA)
            called["alone"] += bool(np.nanmin(test.alone) < ALPHA)
            called["t"] += bool(stats.ttest_ind(one, other).pvalue.min() < ALPHA)
            p = np.array(
                [
                    permutation_test(rng.standard_normal(n), rng.standard_normal(m), most=most, seed=k).p
                    for _ in range(PARAMETERS)
                ]
            )
            called["scalars"] += bool(holm(p).min() < ALPHA)
            called["raw"] += bool(p.min() < ALPHA)
        yield {
            "animals": f"{n} and {m}",
            "studies": repeats,
            "least p": p_floor(n, m, most=most),
            f"{CURVES} curves, corrected [%]": share(called["curves"], repeats),
            "curves, each sample alone [%]": share(called["alone"], repeats),
            "curves, t test of each sample [%]": share(called["t"], repeats),
            f"{PARAMETERS} parameters, Holm [%]": share(called["scalars"], repeats),
            "parameters, uncorrected [%]": share(called["raw"], repeats),
        }


def share(count: int, of: int) -> str:
    """A share [%] with its 95 % interval (Wilson)."""
    low, high = stats.binomtest(count, of).proportion_ci(method="wilson")
    return f"{100 * count / of:.1f} ({100 * low:.1f} to {100 * high:.1f})"


def measure_power() -> Iterator[Row]:
    """Share of made studies in which a difference is found that is there, in one of the curves and in one parameter."""
    for n, repeats, most in ((4, 300, 10000), (6, 200, 10000), (10, 100, 1000)):
        for effect in (1.0, 2.0, 3.0):
            rng = np.random.default_rng(n)
            bump = effect * np.exp(-0.5 * ((PERCENT - CENTER) / WIDTH) ** 2)
            found, elsewhere, parameter, centers = 0, 0, 0, []
            for k in range(repeats):
                one, other = animals(rng, n, CURVES), animals(rng, n, CURVES)
                one[:, 0] += bump
                p = permutation_test(one, other, most=most, seed=k).p
                differs = p[0] < ALPHA
                found += bool(differs[np.abs(PERCENT - CENTER) < 2 * WIDTH].any())
                elsewhere += bool((p[1:] < ALPHA).any() or differs[np.abs(PERCENT - CENTER) > 3 * WIDTH].any())
                centers += [float(PERCENT[differs].mean())] if differs.any() else []
                values = permutation_test(rng.standard_normal(n) + effect, rng.standard_normal(n), most=most, seed=k).p
                parameter += bool(values < ALPHA)
            yield {
                "animals in each group": n,
                "effect [SD]": effect,
                "studies": repeats,
                "curve, found [%]": share(found, repeats),
                "its middle, mean [% of cycle]": float(np.mean(centers)) if centers else float("nan"),
                "elsewhere, falsely [%]": share(elsewhere, repeats),
                "parameter, found [%]": share(parameter, repeats),
                "t test would find [%]": 100.0 * _t_power(effect, n),
            }


def _t_power(effect: float, n: int) -> float:
    """Power of Student's t test of one parameter."""
    freedom, shift = 2 * n - 2, effect * np.sqrt(n / 2.0)
    limit = stats.t.ppf(1.0 - ALPHA / 2.0, freedom)
    return float(stats.nct.sf(limit, freedom, shift) + stats.nct.cdf(-limit, freedom, shift))
