"""Two groups, or the same subjects in two conditions: differences of strides and curves.

Each difference comes with its interval and its chance. The animal or subject is the unit: the mean
of its strides stands for it, however many they are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import comb

import numpy as np
import scipy

from myomorph.core.model.arrays import Array, read_only, runs
from myomorph.core.model.errors import BadData, check_name
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.messages import Message
from myomorph.lab.analysis import permutations
from myomorph.lab.analysis.cycles import Band, Cycles, band
from myomorph.lab.causes import GROUPS


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
                raise BadData(
                    f"{name} is {getattr(self, name):g}: expected a share between 0 and 1"
                )
        if self.permutations < 100:
            raise BadData(f"{self.permutations} permutations: expected 100 or more")


@read_only
class Animal:
    """One animal or subject."""

    name: str
    # by parameter, one value a stride, NaN where unknown
    scalars: Mapping[str, Array] = field(default_factory=lambda: FrozenMap({}))
    # by family ("angle [°]", "muscle length [mm]"), signals over the cycles
    curves: Mapping[str, Cycles] = field(default_factory=lambda: FrozenMap({}))
    strides: int = 0  # how many

    def curve(self, family: str, name: str) -> Array:
        """Average a curve over the cycles of the animal.

        Parameters
        ----------
        family : of curves, a key of `curves`
        name : of the curve

        Returns
        -------
        (samples,) NaN where no cycle is known
        """
        cycles = self.curves[family]
        return band(cycles.values[:, :, cycles.names.index(name)]).mean

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
    """One parameter of two groups, animals' means."""

    name: str
    # first, second: mean, standard deviation (of animals, ddof = 1) and number of animals
    first: tuple[float, float, int]
    second: tuple[float, float, int]
    # difference, low, high: first less second and its interval (Welch)
    difference: float
    low: float
    high: float
    # g, g_low, g_high: Hedges' g, spreads not pooled, and its interval
    g: float
    g_low: float
    g_high: float
    p: float = float("nan")  # of this parameter alone; holm, q : corrected for all parameters
    holm: float = float("nan")
    q: float = float("nan")


@read_only
class CurveDifference:
    """One signal of two groups over the cycle, animals' means."""

    family: str
    name: str
    # first, second: mean and interval of each group
    first: Band
    second: Band
    each: tuple[Array, Array]  # by group, (animals, samples)
    # difference, low, high: (samples,) first less second and its interval (Welch, sample by sample)
    difference: Array
    low: Array
    high: Array
    # g, g_low, g_high: (samples,) Hedges' g
    g: Array
    g_low: Array
    g_high: Array
    # (samples,) corrected for all samples of all signals of the family; NaN where not tested
    p: Array
    regions: tuple[tuple[float, float], ...]  # parts of the cycle that differ, (start, stop) [%]

    @property
    def least_p(self) -> float:
        """Smallest corrected p along the cycle."""
        return float(np.nanmin(self.p)) if np.isfinite(self.p).any() else float("nan")


@dataclass(frozen=True, eq=False)
class Comparison:
    """Two groups side by side."""

    names: tuple[str, str]  # of the groups, first and second
    # by group, name and number of strides of each
    animals: tuple[tuple[tuple[str, int], ...], tuple[tuple[str, int], ...]]
    scalars: tuple[ScalarDifference, ...]
    curves: tuple[CurveDifference, ...]
    options: GroupOptions
    tested: bool  # whether the groups are large enough
    exact: bool  # whether all relabellings were taken
    floor: float  # least p that these groups can reach
    notes: tuple[
        Message, ...
    ] = ()  # what should be known before anything is believed, one line each
    paired: bool = False  # whether both groups are the same animals or subjects, each beside itself

    def curve(self, name: str) -> CurveDifference:
        """Find the difference of a curve by its name; raises `UnknownName`."""
        known = {curve.name: curve for curve in self.curves}
        check_name("curve", name, known, "the comparison")
        return known[name]

    def family(self, name: str) -> tuple[CurveDifference, ...]:
        """Curves of one family."""
        return tuple(curve for curve in self.curves if curve.family == name)

    @property
    def families(self) -> tuple[str, ...]:
        """Names of the families of curves."""
        return tuple(dict.fromkeys(curve.family for curve in self.curves))


def compare_groups(first: Group, second: Group, options: GroupOptions | None = None) -> Comparison:
    """Compare parameters and curves of two groups, with intervals, effect sizes and tests.

    Parameters are tested one by one by relabelling and corrected for their number (Holm; Benjamini
    and Hochberg beside it); the curves of a family together by the largest statistic over all of
    them and the whole cycle. With fewer than three subjects in a group nothing is tested.

    Parameters
    ----------
    first, second : of which each subject counts once, however many strides it has
    options : confidence, alpha and number of relabellings; see `GroupOptions`

    Returns
    -------
    differences of the first from the second, with intervals, effect sizes and p

    Raises
    ------
    BadData : a group has nobody, or a subject is in both

    Examples
    --------
    >>> import numpy as np
    >>> import myomorph as mm
    >>> def group(name, high):
    ...     members = [mm.groups.member(f"{name}{k}", {}, {"speed": high + k}) for k in range(4)]
    ...     return mm.groups.Group(name, tuple(members))
    >>> compared = mm.groups.compare_groups(group("fast", 10.0), group("slow", 1.0))
    >>> compared.scalars[0].difference, round(compared.scalars[0].p, 3)
    (9.0, 0.029)
    """
    options = options or GroupOptions()
    for group in (first, second):
        if not group.animals:
            raise BadData(f"group '{group.name}' has no animals")
    both = {animal.name for animal in first.animals} & {animal.name for animal in second.animals}
    if both:
        raise BadData(f"'{min(both)}' is in both groups")
    n = len(first.animals)
    m = len(second.animals)
    few = GROUPS.message(
        f"groups of {n} and {m} are described, not tested: a test needs {permutations.MIN_SUBJECTS}"
        " or more in each"
    )
    blunt = GROUPS.message(
        f"groups of {n} and {m} cannot reach a p below {{:.3g}}: no difference can be significant"
        " at"
        " {:.3g}"
    )
    return _compared(first, second, options, (n, m), (few, blunt))


def compare_paired(first: Group, second: Group, options: GroupOptions | None = None) -> Comparison:
    """Compare parameters and curves of subjects in two conditions, each beside itself.

    As `compare_groups`, but of the differences within subjects, so that what differs between
    subjects drops out: the interval is that of their mean (Student's t), the effect size their mean
    over their standard deviation with Hedges' correction, and the test turns differences round
    instead of exchanging subjects.

    Parameters
    ----------
    first, second : the same subjects, by name; those that only one has are left out and named
    options : confidence, alpha and number of relabellings; see `GroupOptions`

    Returns
    -------
    differences of the first from the second, with intervals, effect sizes and p

    Raises
    ------
    BadData : no subject has both

    Examples
    --------
    >>> import myomorph as mm
    >>> def condition(name, higher):
    ...     members = [
    ...         mm.groups.member(f"s{k}", {}, {"speed": k + higher + 0.1 * k}) for k in range(6)
    ...     ]
    ...     return mm.groups.Group(name, tuple(members))
    >>> compared = mm.groups.compare_paired(condition("after", 2.0), condition("before", 0.0))
    >>> round(compared.scalars[0].difference, 2), compared.paired
    (2.0, True)
    """
    options = options or GroupOptions()
    by_name = {animal.name: animal for animal in second.animals}
    pairs = [(animal, by_name[animal.name]) for animal in first.animals if animal.name in by_name]
    if not pairs:
        raise BadData(f"no subject has both '{first.name}' and '{second.name}'")
    both = {animal.name for animal, _ in pairs}
    alone = [animal.name for animal in (*first.animals, *second.animals) if animal.name not in both]
    notes = (
        [
            GROUPS.message(
                f"without '{first.name}' or without '{second.name}', and left out:"
                f" {', '.join(alone)}"
            )
        ]
        if alone
        else []
    )
    n = len(pairs)
    few = GROUPS.message(
        f"{n} subjects with both are described, not tested: a test needs"
        f" {permutations.MIN_SUBJECTS} or more"
    )
    blunt = GROUPS.message(
        f"{n} subjects cannot reach a p below {{:.3g}}: no difference can be significant at"
        f" {{:.3g}}"
    )
    firsts, seconds = zip(*pairs, strict=True)
    former = Group(name=first.name, animals=firsts)
    other = Group(name=second.name, animals=seconds)
    return _compared(former, other, options, (n,), (few, blunt), notes)


def _compared(
    first: Group,
    second: Group,
    options: GroupOptions,
    sizes: Sequence[int],
    words: tuple[Message, Message],
    notes: Sequence[Message] = (),
) -> Comparison:
    """Compare two groups, or pairs in one order, of `sizes`.

    `words` stand where they are too few to be tested, or to be called.
    """
    tested = min(sizes) >= permutations.MIN_SUBJECTS
    paired = len(sizes) == 1
    floor = permutations.p_floor(*sizes, most=options.permutations) if tested else float("nan")
    lines = [*notes, *([] if tested else words[:1])]
    if floor > options.alpha:
        lines.append(words[1].changed(words[1].format(floor, options.alpha)))
    members = [
        tuple((animal.name, animal.strides) for animal in group.animals)
        for group in (first, second)
    ]
    exact = (2 ** sizes[0] if paired else comb(sum(sizes), sizes[0])) <= options.permutations
    scalars = _scalars(first, second, options, tested, paired, lines)
    curves = _curves(first, second, options, tested, paired, lines)
    names = (first.name, second.name)
    animals = (members[0], members[1])
    return Comparison(
        names=names,
        animals=animals,
        scalars=scalars,
        curves=curves,
        options=options,
        tested=tested,
        exact=exact,
        floor=floor,
        notes=tuple(lines),
        paired=paired,
    )


def _common_names(
    names: Sequence[Sequence[str]], what: str, notes: list[Message]
) -> tuple[str, ...]:
    """Names that all animals have, in the first one's order."""
    shared = [name for name in names[0] if all(name in listed for listed in names)]
    lost = sorted({name for listed in names for name in listed} - set(shared))
    if lost:
        listed = ", ".join(lost[:6]) + (", ..." if len(lost) > 6 else "")
        notes.append(
            GROUPS.message(f"{what} that are missing for some animals are left out: {listed}")
        )
    return tuple(shared)


def _scalars(
    first: Group,
    second: Group,
    options: GroupOptions,
    tested: bool,
    paired: bool,
    notes: list[Message],
) -> tuple[ScalarDifference, ...]:
    animals = (*first.animals, *second.animals)
    scalars = []
    for name in _common_names([tuple(animal.scalars) for animal in animals], "parameters", notes):
        former, other = _known_scalars(first, second, name, paired)
        samples = (former - other,) if paired else (former, other)
        effect = permutations.effect_size(*samples)
        p = float("nan")
        if tested and min(map(len, samples)) >= permutations.MIN_SUBJECTS:
            p = float(
                permutations.permutation_test(
                    *samples, most=options.permutations, seed=options.seed
                ).p
            )
        mean, low, high = map(float, _mean_interval(samples, options.confidence))
        g_low, g_high = permutations.effect_interval(effect, options.confidence)
        scalars.append(
            ScalarDifference(
                name=name,
                first=_described(former),
                second=_described(other),
                difference=mean,
                low=low,
                high=high,
                g=float(effect.g),
                g_low=g_low,
                g_high=g_high,
                p=p,
            )
        )
    alone = np.array([scalar.p for scalar in scalars])
    corrected = permutations.holm(alone)
    q = permutations.benjamini_hochberg(alone)
    return tuple(
        replace(scalar, holm=float(corrected[i]), q=float(q[i])) for i, scalar in enumerate(scalars)
    )


def _known_scalars(first: Group, second: Group, name: str, paired: bool) -> tuple[Array, Array]:
    """Return the known values of a parameter in both groups, of pairs where both are known."""
    former = np.array([animal.scalar(name) for animal in first.animals])
    other = np.array([animal.scalar(name) for animal in second.animals])
    known = np.isfinite(former)
    others = np.isfinite(other)
    if paired:
        known = others = known & others
    return former[known], other[others]


def _described(values: Array) -> tuple[float, float, int]:
    """Mean, standard deviation (ddof = 1) and number of values."""
    spread = float(values.std(ddof=1)) if len(values) > 1 else float("nan")
    return float(values.mean()) if len(values) else float("nan"), spread, len(values)


def _mean_interval(samples: Sequence[Array], confidence: float) -> tuple[Array, Array, Array]:
    """Estimate the difference of two groups' means, or the mean of one sample, with its interval.

    The two groups have spreads of their own (Welch 1947).
    """
    nothing = np.full(samples[0].shape[1:], np.nan)
    if not all(len(sample) for sample in samples):
        return nothing, nothing, nothing
    means = [sample.mean(axis=0) for sample in samples]
    difference = means[0] - means[1] if len(means) > 1 else means[0]
    if min(len(sample) for sample in samples) < 2:
        return difference, nothing, nothing
    errors = [sample.var(axis=0, ddof=1) / len(sample) for sample in samples]
    with np.errstate(divide="ignore", invalid="ignore"):
        parts = sum(
            error**2 / (len(sample) - 1) for sample, error in zip(samples, errors, strict=True)
        )
        freedom = sum(errors) ** 2 / parts
    deviations = scipy.special.stdtrit(
        np.where(np.isfinite(freedom), freedom, 1.0), 0.5 + 0.5 * confidence
    )
    half = deviations * np.sqrt(sum(errors))
    return difference, difference - half, difference + half


def _curves(
    first: Group,
    second: Group,
    options: GroupOptions,
    tested: bool,
    paired: bool,
    notes: list[Message],
) -> tuple[CurveDifference, ...]:
    animals = (*first.animals, *second.animals)
    curve_differences: list[CurveDifference] = []
    for family in _common_names(
        [tuple(animal.curves) for animal in animals], "kinds of curves", notes
    ):
        names = _common_names(
            [animal.curves[family].names for animal in animals], f"{family}: curves", notes
        )
        if not names:
            continue
        former = np.stack(
            [[animal.curve(family, name) for name in names] for animal in first.animals]
        )
        other = np.stack(
            [[animal.curve(family, name) for name in names] for animal in second.animals]
        )
        samples = (former - other,) if paired else (former, other)
        p = np.full(former.shape[1:], np.nan)
        if tested:
            p = permutations.permutation_test(
                *samples, most=options.permutations, seed=options.seed
            ).p
        effect = permutations.effect_size(*samples)
        difference, low, high = _mean_interval(samples, options.confidence)
        g_low, g_high = permutations.effect_curve_interval(effect, options.confidence)
        for index, name in enumerate(names):
            first_band = band(former[:, index], options.confidence)
            second_band = band(other[:, index], options.confidence)
            curve_differences.append(
                CurveDifference(
                    family=family,
                    name=name,
                    first=first_band,
                    second=second_band,
                    each=(former[:, index], other[:, index]),
                    difference=difference[index],
                    low=low[index],
                    high=high[index],
                    g=effect.g[index],
                    g_low=g_low[index],
                    g_high=g_high[index],
                    p=p[index],
                    regions=regions(p[index] < options.alpha),
                )
            )
    return tuple(curve_differences)


def regions(differs: np.ndarray) -> tuple[tuple[float, float], ...]:
    """Find every run of samples that differ.

    Parameters
    ----------
    differs : (samples,) whether the curves differ at each sample from 0 to 100 %

    Returns
    -------
    Start and stop of each run [%]
    """
    step = 100.0 / max(len(differs) - 1, 1)
    return tuple((float(a * step), float((b - 1) * step)) for a, b in runs(differs))
