"""The same subjects in two conditions: every subject beside itself, so that what differs between subjects drops out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import t as student

from myomorph.analysis.groups import (
    Animal,
    Comparison,
    CurveDifference,
    Group,
    GroupOptions,
    ScalarDifference,
    common_names,
    curve_difference,
    described,
)
from myomorph.analysis.permutations import (
    FEWEST,
    benjamini_hochberg,
    holm,
    paired_floor,
    paired_g,
    paired_g_curve_interval,
    paired_g_interval,
    paired_test,
)
from myomorph.model.arrays import Array
from myomorph.model.errors import BadData


def compare_paired(first: Group, second: Group, options: GroupOptions | None = None) -> Comparison:
    """Parameters and curves of subjects in two conditions, with intervals, effect sizes and tests.

    As `compare_groups`, but of the differences within subjects: the interval is that of their mean (Student's t), the
    effect size their mean over their standard deviation with Hedges' correction, and the test turns differences round
    instead of exchanging subjects. Subjects that only one of the conditions has are left out, by name.

    Raises
    ------
    BadData : no subject has both
    """
    options = options or GroupOptions()
    notes: list[str] = []
    own = {one.name: one for one in second.animals}
    pairs = [(one, own[one.name]) for one in first.animals if one.name in own]
    if not pairs:
        raise BadData(f"no subject has both '{first.name}' and '{second.name}'")
    both = {one.name for one, _ in pairs}
    alone = [one.name for one in (*first.animals, *second.animals) if one.name not in both]
    if alone:
        notes.append(f"without '{first.name}' or without '{second.name}', and left out: {', '.join(alone)}")
    tested = len(pairs) >= FEWEST
    floor = paired_floor(len(pairs), options.permutations) if tested else float("nan")
    if not tested:
        notes.append(f"{len(pairs)} subjects with both are described, not tested: a test needs {FEWEST} or more")
    elif floor > options.alpha:
        notes.append(
            f"{len(pairs)} subjects cannot reach a p below {floor:.3g}: no difference can be called so at "
            f"{options.alpha:.3g}"
        )
    scalars = _scalars(pairs, options, tested, notes)
    curves = _curves(pairs, options, tested, notes)
    members = tuple(tuple((pair[k].name, pair[k].strides) for pair in pairs) for k in (0, 1))
    return Comparison(
        (first.name, second.name),
        (members[0], members[1]),
        scalars,
        curves,
        options,
        tested,
        2 ** len(pairs) <= options.permutations,
        floor,
        tuple(notes),
        paired=True,
    )


Pairs = Sequence[tuple[Animal, Animal]]


def _scalars(pairs: Pairs, options: GroupOptions, tested: bool, notes: list[str]) -> tuple[ScalarDifference, ...]:
    names = common_names([tuple(one.scalars) for pair in pairs for one in pair], "parameters", notes)
    found = []
    for name in names:
        values = np.array([[one.scalar(name) for one in pair] for pair in pairs])
        values = values[np.isfinite(values).all(axis=1)]
        difference = values[:, 0] - values[:, 1]
        mean, low, high = _interval(difference, options.confidence)
        g = float(paired_g(difference))
        enough = tested and len(difference) >= FEWEST
        p = float(paired_test(difference, options.permutations, options.seed).p) if enough else float("nan")
        found.append(
            ScalarDifference(
                name,
                described(values[:, 0]),
                described(values[:, 1]),
                float(mean),
                float(low),
                float(high),
                g,
                *paired_g_interval(g, len(difference), options.confidence),
                p,
            )
        )
    alone = np.array([one.p for one in found])
    corrected, q = holm(alone), benjamini_hochberg(alone)
    return tuple(replace(one, holm=float(corrected[i]), q=float(q[i])) for i, one in enumerate(found))


def _interval(differences: Array, confidence: float) -> tuple[Array, Array, Array]:
    """Mean of differences (pairs, ...) and its interval by Student's t."""
    n = len(differences)
    if not n:
        nothing = np.full(differences.shape[1:], np.nan)
        return nothing, nothing, nothing
    mean: Array = differences.mean(axis=0)
    if n < 2:
        nothing = np.full(mean.shape, np.nan)
        return mean, nothing, nothing
    half = student.ppf(0.5 + 0.5 * confidence, n - 1) * differences.std(axis=0, ddof=1) / np.sqrt(n)
    return mean, mean - half, mean + half


def _curves(pairs: Pairs, options: GroupOptions, tested: bool, notes: list[str]) -> tuple[CurveDifference, ...]:
    subjects = [one for pair in pairs for one in pair]
    families = common_names([tuple(one.curves) for one in subjects], "kinds of curves", notes)
    found: list[CurveDifference] = []
    for family in families:
        names = common_names([one.curves[family].names for one in subjects], f"{family}: curves", notes)
        if not names:
            continue
        one, other = (np.stack([[pair[k].curve(family, name) for name in names] for pair in pairs]) for k in (0, 1))
        p = np.full(one.shape[1:], np.nan)
        if tested:
            p = paired_test(one - other, options.permutations, options.seed).p
        found += [_curve(family, name, one[:, k], other[:, k], p[k], options) for k, name in enumerate(names)]
    return tuple(found)


def _curve(family: str, name: str, one: Array, other: Array, p: Array, options: GroupOptions) -> CurveDifference:
    g = paired_g(one - other)
    bounds = paired_g_curve_interval(g, len(one), options.confidence)
    return curve_difference(
        (family, name), one, other, _interval(one - other, options.confidence), (g, *bounds), p, options
    )
