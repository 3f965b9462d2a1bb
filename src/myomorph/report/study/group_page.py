"""The page on two groups: who was in them, strides, curves over the cycle, effect sizes and what was corrected."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from myomorph.analysis.groups import Comparison, CurveDifference
from myomorph.model.provenance import Estimate
from myomorph.report.charts.axis import number
from myomorph.report.charts.curves import CycleCurve, cycle_chart
from myomorph.report.charts.rows import interval_rows
from myomorph.report.page.page import Tile, rendered
from myomorph.report.page.parts import Figure, Grid, Note, PageHead, Section
from myomorph.report.page.references import cited

TESTS = ("nichols2002", "tusher2001", "holm1979", "benjamini1995", "hedges1981", "zeni2008")
"""References of the statistics."""

STYLES = ("left", "right")
"""Of the first group and of the second."""

MAX_EFFECT = 10.0
"""Effect sizes along the cycle are drawn up to this."""

MAX_OPEN = 24
"""Curves of a family that are shown at once; the rest is folded away."""


def group_page(found: Comparison, given: PageHead) -> str:
    """One self-contained HTML page, as text.

    Parameters
    ----------
    given : title, notes, sources, date and version
    """
    notes = tuple(Note("warning", one) for one in found.notes)
    page = replace(given, notes=(*given.notes, *notes))
    parts = [*_scalar_sections(found), *(_family_section(found, one) for one in found.families)]
    return rendered(page, [_who(found), *parts], cited(*TESTS), facts=_facts(found), tiles=_tiles(found))


def _facts(found: Comparison) -> list[tuple[str, str]]:
    rows = [
        (name, f"{len(animals)} animals or subjects, {sum(count for _, count in animals)} strides")
        for name, animals in zip(found.names, found.animals, strict=True)
    ]
    if found.tested:
        how = "all permutations" if found.exact else f"{found.options.permutations} random permutations"
        rows.append(("Test", f"permutation of animals, {how}; smallest possible p {number(found.floor)}"))
    else:
        rows.append(("Test", "none: too few animals"))
    rows.append(("Intervals", f"{100 * found.options.confidence:.0f} %"))
    return rows


def _tiles(found: Comparison) -> list[Tile]:
    if not found.tested:
        return []
    alpha = f"p < {found.options.alpha:g}"
    different = sum(one.holm < found.options.alpha for one in found.scalars)
    curves = sum(1 for one in found.curves if one.regions)
    return [
        Tile(f"{different} of {len(found.scalars)}", f"parameters differ (Holm {alpha})", "ok"),
        Tile(f"{curves} of {len(found.curves)}", f"curves differ somewhere (corrected {alpha})", "ok"),
    ]


def _who(found: Comparison) -> Section:
    rows = [
        (group, ", ".join(f"{name} ({count})" for name, count in animals))
        for group, animals in zip(found.names, found.animals, strict=True)
    ]
    lead = (
        f"Differences are {found.names[0]} minus {found.names[1]}. The animal is the unit: the mean of its strides "
        "represents it, so that more strides do not count as more animals."
    )
    return Section("animals", "Groups", lead, grids=(Grid(("Group", "Animals (strides)"), tuple(rows)),))


def _scalar_sections(found: Comparison) -> list[Section]:
    if not found.scalars:
        return []
    lead = "Mean ± standard deviation of the animals."
    if found.tested:
        lead += (
            " p by permuting animals. Holm’s correction controls the chance of any false positive among the "
            "parameters, q the false discovery rate."
        )
    figure = effect_figure(found)
    return [Section("strides", "Strides", lead, figures=(figure,), grids=(scalar_grid(found),))]


def effect_figure(found: Comparison) -> Figure:
    """Effect size of every parameter with its interval, filled where the corrected p is small."""
    drawn = interval_rows(
        "Effect size",
        "Hedges’ g",
        [one.name for one in found.scalars],
        [Estimate(one.g, one.g_low, one.g_high) for one in found.scalars],
        solid=[one.holm < found.options.alpha for one in found.scalars],
        signed=True,
    )
    return Figure(drawn, "wide", "Filled where Holm’s p is small.")


def difference_chart(one: CurveDifference, unit: str, labels: tuple[str, str], styles: tuple[str, str] = STYLES) -> str:
    """Both groups' means with their intervals, every animal's own curve, and bars below where they differ."""
    curves = [
        CycleCurve(group.mean, style, label, (group.low, group.high), each=each)
        for group, style, label, each in zip((one.first, one.second), styles, labels, one.each, strict=True)
    ]
    shown = [*one.each[0], *one.each[1], *(end for group in (one.first, one.second) for end in (group.low, group.high))]
    return cycle_chart(one.name, unit, curves, shown, _regions(one))


def effect_chart(one: CurveDifference) -> str:
    """Hedges' g along the cycle with its interval."""
    curve = CycleCurve(one.g, "middle", "g", (one.g_low, one.g_high))
    shown = [np.clip(one.g_low, -MAX_EFFECT, MAX_EFFECT), np.clip(one.g_high, -MAX_EFFECT, MAX_EFFECT), np.zeros(1)]
    return cycle_chart(one.name, "Hedges’ g", [curve], shown, _regions(one), 190)


def _regions(one: CurveDifference) -> list[tuple[float, float, str]]:
    """Where the groups differ, with what is shown under the pointer."""
    p = f"smallest p {number(one.least_p)}"
    return [(start, stop, f"differs from {start:.0f} to {stop:.0f} %, {p}") for start, stop in one.regions]


def scalar_grid(found: Comparison, title: str = "") -> Grid:
    """Parameters of both groups, their differences and tests."""
    first, second = found.names
    size = "Effect size" if found.paired else "Hedges’ g"
    head = ("Parameter", first, second, "Difference", size, "p", "p, Holm", "q")
    rows = [
        (
            one.name,
            mean_words(one.first),
            mean_words(one.second),
            _with_interval(one.difference, one.low, one.high),
            _with_interval(one.g, one.g_low, one.g_high),
            *(_probability(p) for p in (one.p, one.holm, one.q)),
        )
        for one in found.scalars
    ]
    return Grid(head, tuple(rows), title)


def _family_section(found: Comparison, family: str) -> Section:
    curves, (name, unit) = found.family(family), name_and_unit(family)
    shown = different_first(curves) if found.tested else list(curves)
    figures = [Figure(difference_chart(one, unit, found.names)) for one in shown[:MAX_OPEN]]
    figures += [Figure(difference_chart(one, unit, found.names), folded=one.name) for one in shown[MAX_OPEN:]]
    figures += [Figure(effect_chart(one), folded=f"{one.name}: effect size") for one in shown[:MAX_OPEN]]
    lead = (
        "Mean of the animals’ means over the stride from foot strike to foot strike, with "
        f"{100 * found.options.confidence:.0f} % intervals sample by sample; thin lines are animals."
    )
    if found.tested:
        lead += (
            f" Bars below mark where groups differ (p < {found.options.alpha:g}, corrected for the whole stride and "
            f"all {len(curves)} curves here by the maximum statistic); curves that differ come first."
        )
    legend = tuple(zip(STYLES, found.names, strict=True))
    return curve_section(name, lead, legend, figures, (curve_grid(shown),))


def name_and_unit(family: str) -> tuple[str, str]:
    """What the curves of a family are and their unit: of "angle [°]" angle and °."""
    name, _, unit = family.partition(" [")
    return name, unit.removesuffix("]")


def different_first(curves: Sequence[CurveDifference]) -> list[CurveDifference]:
    """Curves that differ before the others, those of the smallest p first."""
    return sorted(curves, key=lambda one: (not one.regions, one.least_p if np.isfinite(one.least_p) else 2.0))


def curve_section(
    name: str,
    lead: str,
    legend: tuple[tuple[str, str], ...],
    figures: Sequence[Figure],
    grids: tuple[Grid, ...] = (),
) -> Section:
    """The section of one family of curves."""
    key = "".join(letter if letter.isalnum() else "-" for letter in name.lower())
    return Section(f"curves-{key}", f"{name[:1].upper()}{name[1:]}", lead, legend, tuple(figures), grids)


def curve_grid(curves: Sequence[CurveDifference], title: str = "All curves: statistics") -> Grid:
    """Where along the cycle the effect is largest, and where the groups differ."""
    rows = []
    for one in curves:
        known = np.isfinite(one.g)
        at = int(np.argmax(np.where(known, np.abs(one.g), -1.0)))
        size = _with_interval(float(one.g[at]), float(one.g_low[at]), float(one.g_high[at]))
        largest = f"{size} at {100.0 * at / max(len(one.g) - 1, 1):.0f} %" if known.any() else "–"
        where = ", ".join(f"{a:.0f}–{b:.0f} %" for a, b in one.regions) or "–"
        rows.append((one.name, largest, _probability(one.least_p), where))
    return Grid(("Curve", "Maximum effect size", "Minimum p", "Differs"), tuple(rows), title, True)


def mean_words(words: tuple[float, float, int]) -> str:
    """Mean ± standard deviation, where it is known, and the number of values."""
    mean, spread, count = words
    return number(mean) + (f" ± {number(spread)}" if np.isfinite(spread) else "") + f" (n = {count})"


def _with_interval(value: float, low: float, high: float) -> str:
    return f"{number(value)} ({number(low)} to {number(high)})" if np.isfinite(low) else number(value)


def _probability(p: float) -> str:
    return "–" if not np.isfinite(p) else f"{p:.4f}" if p < 0.01 else f"{p:.3f}"
