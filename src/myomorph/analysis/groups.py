"""Two groups of animals or subjects: how their strides and curves over the cycle differ, and how sure that is.

The animal is the unit: the mean of its strides stands for it, however many they are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import comb

import numpy as np
from scipy.stats import t as student

from myomorph.analysis.cycles import Band, Cycles, band
from myomorph.analysis.permutations import (
    FEWEST,
    benjamini_hochberg,
    g_curve_interval,
    g_interval,
    hedges_g,
    holm,
    p_floor,
    permutation_test,
)
from myomorph.model.arrays import Array, read_only
from myomorph.model.errors import BadData
from myomorph.model.frozen_map import FrozenMap


@dataclass(frozen=True)
class GroupOptions:
    """How groups are compared.

    Attributes
    ----------
    confidence : of all intervals
    alpha : differences are called so below this corrected p
    permutations : relabellings above which random ones are drawn
    seed : of these
    """

    confidence: float = 0.95
    alpha: float = 0.05
    permutations: int = 10000
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("confidence", "alpha"):
            if not 0.0 < getattr(self, name) < 1.0:
                raise BadData(f"{name} is {getattr(self, name):g}: expected a share between 0 and 1")
        if self.permutations < 100:
            raise BadData(f"{self.permutations} permutations: expected 100 or more")


@read_only
@dataclass(frozen=True, eq=False)
class Animal:
    """One animal or subject.

    Attributes
    ----------
    scalars : by parameter, one value a stride, NaN where unknown
    curves : by family ("angle [°]", "muscle length [mm]"), signals over the cycles
    strides : how many
    """

    name: str
    scalars: Mapping[str, Array] = field(default_factory=lambda: FrozenMap({}))
    curves: Mapping[str, Cycles] = field(default_factory=lambda: FrozenMap({}))
    strides: int = 0

    def curve(self, family: str, name: str) -> Array:
        """(samples,) mean over its cycles, NaN where no cycle is known."""
        cycles = self.curves[family]
        values = cycles.values[:, :, cycles.names.index(name)]
        known = np.isfinite(values)
        count = known.sum(axis=0)
        mean: Array = np.where(count > 0, np.where(known, values, 0.0).sum(axis=0) / np.maximum(count, 1), np.nan)
        return mean

    def scalar(self, name: str) -> float:
        """Mean over its strides."""
        values = self.scalars[name]
        return float(np.nanmean(values)) if np.isfinite(values).any() else float("nan")


@dataclass(frozen=True, eq=False)
class Group:
    """Animals of one kind."""

    name: str
    animals: tuple[Animal, ...]


@dataclass(frozen=True)
class ScalarDifference:
    """One parameter of two groups, animals' means.

    Attributes
    ----------
    first, second : mean, standard deviation (of animals, ddof = 1) and number of animals
    difference, low, high : first less second and its interval (Welch)
    g, g_low, g_high : Hedges' g and its interval
    p : of this parameter alone; holm, q : corrected for all parameters
    """

    name: str
    first: tuple[float, float, int]
    second: tuple[float, float, int]
    difference: float
    low: float
    high: float
    g: float
    g_low: float
    g_high: float
    p: float = float("nan")
    holm: float = float("nan")
    q: float = float("nan")


@read_only
@dataclass(frozen=True, eq=False)
class CurveDifference:
    """One signal of two groups over the cycle, animals' means.

    Attributes
    ----------
    first, second : mean and interval of each group
    each : by group, (animals, samples)
    difference, low, high : (samples,) first less second and its interval (Welch, sample by sample)
    g, g_low, g_high : (samples,) Hedges' g
    p : (samples,) corrected for all samples of all signals of the family; NaN where not tested
    regions : parts of the cycle that differ, (start, stop) [%]
    """

    family: str
    name: str
    first: Band
    second: Band
    each: tuple[Array, Array]
    difference: Array
    low: Array
    high: Array
    g: Array
    g_low: Array
    g_high: Array
    p: Array
    regions: tuple[tuple[float, float], ...]

    @property
    def least_p(self) -> float:
        """Smallest corrected p along the cycle."""
        return float(np.nanmin(self.p)) if np.isfinite(self.p).any() else float("nan")


@dataclass(frozen=True, eq=False)
class Comparison:
    """Two groups side by side.

    Attributes
    ----------
    names : of the groups, first and second
    animals : by group, name and number of strides of each
    tested : whether the groups are large enough
    exact : whether all relabellings were taken
    floor : least p that these groups can reach
    notes : what should be known before anything is believed, one line each
    paired : whether both groups are the same animals or subjects, each beside itself
    """

    names: tuple[str, str]
    animals: tuple[tuple[tuple[str, int], ...], tuple[tuple[str, int], ...]]
    scalars: tuple[ScalarDifference, ...]
    curves: tuple[CurveDifference, ...]
    options: GroupOptions
    tested: bool
    exact: bool
    floor: float
    notes: tuple[str, ...] = ()
    paired: bool = False

    def family(self, name: str) -> tuple[CurveDifference, ...]:
        """Curves of one family."""
        return tuple(one for one in self.curves if one.family == name)

    @property
    def families(self) -> tuple[str, ...]:
        """Names of the families of curves."""
        return tuple(dict.fromkeys(one.family for one in self.curves))


def compare_groups(first: Group, second: Group, options: GroupOptions | None = None) -> Comparison:
    """Parameters and curves of two groups, with intervals, effect sizes and tests.

    Parameters are tested one by one by relabelling and corrected for their number (Holm; Benjamini and Hochberg beside
    it); the curves of a family together by the largest statistic over all of them and the whole cycle. With fewer than
    three animals in a group nothing is tested.

    Raises
    ------
    BadData : an empty group, or an animal in both
    """
    options = options or GroupOptions()
    for group in (first, second):
        if not group.animals:
            raise BadData(f"group '{group.name}' has no animals")
    both = {one.name for one in first.animals} & {one.name for one in second.animals}
    if both:
        raise BadData(f"'{min(both)}' is in both groups")
    n, m = len(first.animals), len(second.animals)
    tested = min(n, m) >= FEWEST
    notes: list[str] = []
    floor = p_floor(n, m, options.permutations) if tested else float("nan")
    if not tested:
        notes.append(f"groups of {n} and {m} are described, not tested: a test needs {FEWEST} or more in each")
    elif floor > options.alpha:
        notes.append(
            f"groups of {n} and {m} cannot reach a p below {floor:.3g}: no difference can be called so at "
            f"{options.alpha:g}"
        )
    scalars = _scalars(first, second, options, tested, notes)
    curves = _curves(first, second, options, tested, notes)
    exact = comb(n + m, n) <= options.permutations
    members = tuple(tuple((one.name, one.strides) for one in group.animals) for group in (first, second))
    return Comparison(
        (first.name, second.name),
        (members[0], members[1]),
        scalars,
        curves,
        options,
        tested,
        exact,
        floor,
        tuple(notes),
    )


def common_names(names: Sequence[Sequence[str]], what: str, notes: list[str]) -> tuple[str, ...]:
    """Names that all animals have, in the first one's order."""
    shared = [name for name in names[0] if all(name in own for own in names)]
    lost = sorted({name for own in names for name in own} - set(shared))
    if lost:
        told = ", ".join(lost[:6]) + (", ..." if len(lost) > 6 else "")
        notes.append(f"{what} that some animals lack are left out: {told}")
    return tuple(shared)


def _scalars(
    first: Group, second: Group, options: GroupOptions, tested: bool, notes: list[str]
) -> tuple[ScalarDifference, ...]:
    animals = (*first.animals, *second.animals)
    names = common_names([tuple(one.scalars) for one in animals], "parameters", notes)
    found = []
    for name in names:
        one, other = (
            np.array([value for value in (animal.scalar(name) for animal in group.animals) if np.isfinite(value)])
            for group in (first, second)
        )
        found.append(_scalar(name, one, other, options, tested))
    p = np.array([one.p for one in found])
    corrected, q = holm(p), benjamini_hochberg(p)
    return tuple(replace(one, holm=float(corrected[i]), q=float(q[i])) for i, one in enumerate(found))


def _scalar(name: str, one: Array, other: Array, options: GroupOptions, tested: bool) -> ScalarDifference:
    difference, low, high = _welch(one, other, options.confidence)
    g = float(hedges_g(one, other))
    enough = tested and min(len(one), len(other)) >= FEWEST
    p = float(permutation_test(one, other, options.permutations, options.seed).p) if enough else float("nan")
    return ScalarDifference(
        name,
        described(one),
        described(other),
        float(difference),
        float(low),
        float(high),
        g,
        *g_interval(g, len(one), len(other), options.confidence),
        p,
    )


def described(values: Array) -> tuple[float, float, int]:
    """Mean, standard deviation (ddof = 1) and number of values."""
    spread = float(values.std(ddof=1)) if len(values) > 1 else float("nan")
    return float(values.mean()) if len(values) else float("nan"), spread, len(values)


def _welch(one: Array, other: Array, confidence: float) -> tuple[Array, Array, Array]:
    """Difference of means and its interval, with spreads of their own (Welch 1947)."""
    n, m = len(one), len(other)
    if not n or not m:
        nothing = np.full(one.shape[1:], np.nan)
        return nothing, nothing, nothing
    difference = one.mean(axis=0) - other.mean(axis=0)
    if min(n, m) < 2:
        nothing = np.full(np.shape(difference), np.nan)
        return difference, nothing, nothing
    a, b = one.var(axis=0, ddof=1) / n, other.var(axis=0, ddof=1) / m
    with np.errstate(divide="ignore", invalid="ignore"):
        freedom = (a + b) ** 2 / (a**2 / (n - 1) + b**2 / (m - 1))
    half = student.ppf(0.5 + 0.5 * confidence, np.where(np.isfinite(freedom), freedom, 1.0)) * np.sqrt(a + b)
    return difference, difference - half, difference + half


def _curves(
    first: Group, second: Group, options: GroupOptions, tested: bool, notes: list[str]
) -> tuple[CurveDifference, ...]:
    animals = (*first.animals, *second.animals)
    families = common_names([tuple(one.curves) for one in animals], "kinds of curves", notes)
    found: list[CurveDifference] = []
    for family in families:
        names = common_names([one.curves[family].names for one in animals], f"{family}: curves", notes)
        if not names:
            continue
        one, other = (
            np.stack([[animal.curve(family, name) for name in names] for animal in group.animals])
            for group in (first, second)
        )
        p = np.full(one.shape[1:], np.nan)
        if tested:
            p = permutation_test(one, other, options.permutations, options.seed).p
        found += [_curve(family, name, one[:, k], other[:, k], p[k], options) for k, name in enumerate(names)]
    return tuple(found)


def _curve(family: str, name: str, one: Array, other: Array, p: Array, options: GroupOptions) -> CurveDifference:
    g = hedges_g(one, other)
    bounds = g_curve_interval(g, len(one), len(other), options.confidence)
    return curve_difference(
        (family, name), one, other, _welch(one, other, options.confidence), (g, *bounds), p, options
    )


def curve_difference(
    named: tuple[str, str],
    one: Array,
    other: Array,
    difference: tuple[Array, Array, Array],
    effect: tuple[Array, Array, Array],
    p: Array,
    options: GroupOptions,
) -> CurveDifference:
    """A curve of two groups or conditions beside each other.

    Parameters
    ----------
    named : family and name
    one, other : (animals, samples)
    difference, effect : (samples,) each, with its lower and its upper bound
    p : (samples,) corrected
    """
    return CurveDifference(
        *named,
        band(one, options.confidence),
        band(other, options.confidence),
        (one, other),
        *difference,
        *effect,
        p,
        regions(p < options.alpha),
    )


def regions(differs: np.ndarray) -> tuple[tuple[float, float], ...]:
    """Start and stop [%] of every run of samples that differ."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], differs, [False]]).astype(np.int8)))
    step = 100.0 / max(len(differs) - 1, 1)
    return tuple((float(a * step), float((b - 1) * step)) for a, b in edges.reshape(-1, 2))
