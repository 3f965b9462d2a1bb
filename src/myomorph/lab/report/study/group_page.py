"""The page on two groups.

It shows who was in them, strides, curves over the cycle, effect sizes and corrections.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from myomorph.core.model.interval import Interval
from myomorph.core.model.sides import split_side
from myomorph.lab.analysis.conditions import Condition
from myomorph.lab.analysis.groups import Comparison, CurveDifference
from myomorph.lab.analysis.selection import COORDINATE_ORDER, major_muscles
from myomorph.lab.report.charts.axis import number
from myomorph.lab.report.charts.curves import CycleCurve, CycleLook, cycle_chart
from myomorph.lab.report.charts.rows import IntervalLook, interval_rows, with_interval
from myomorph.lab.report.page.page import Summary, Tile, rendered
from myomorph.lab.report.page.parts import Figure, Grid, Note, PageHead, Section, cited

# References.
TESTS: tuple[str, ...] = (
    "nichols2002",
    "tusher2001",
    "holm1979",
    "benjamini1995",
    "hedges1981",
    "zeni2008",
)
STYLES = ("left", "right")  # Of the first group and of the second.
CONDITION_STYLES = ("right", "left", "third", "second", "fourth", "middle")
"""Of the conditions in their order; more of them take these again."""

MAX_EFFECT = 10.0  # Effect sizes along the cycle are drawn up to this.
MAX_OPEN = 24  # Curves of a family that are shown at once; the rest is folded away.


def group_page(comparison: Comparison, page_head: PageHead) -> str:
    """One self-contained HTML page, as text; `page_head` has title, notes, sources and date."""
    notes = tuple(Note("warning", note) for note in comparison.notes)
    page = replace(page_head, notes=(*page_head.notes, *notes))
    parts = [
        *_scalar_sections(comparison),
        *(_family_section(comparison, family) for family in comparison.families),
    ]
    return rendered(
        page,
        [_who(comparison), *parts],
        cited(*TESTS),
        Summary(facts=_facts(comparison), tiles=_tiles(comparison)),
    )


def _facts(comparison: Comparison) -> list[tuple[str, str]]:
    rows = []
    for name, animals in zip(comparison.names, comparison.animals, strict=True):
        strides = sum(count for _, count in animals)
        rows.append((name, f"{len(animals)} animals or subjects, {strides} strides"))
    if comparison.tested:
        how = (
            "all permutations"
            if comparison.exact
            else f"{comparison.options.permutations} random permutations"
        )
        rows.append(
            (
                "Test",
                f"permutation of animals, {how}; smallest possible p {number(comparison.floor)}",
            )
        )
    else:
        rows.append(("Test", "none: too few animals"))
    rows.append(("Intervals", f"{100 * comparison.options.confidence:.0f} %"))
    return rows


def _tiles(comparison: Comparison) -> list[Tile]:
    if not comparison.tested:
        return []
    alpha = f"p < {comparison.options.alpha:g}"
    different = sum(scalar.holm < comparison.options.alpha for scalar in comparison.scalars)
    curves = sum(1 for curve in comparison.curves if curve.regions)
    return [
        Tile(
            f"{different} of {len(comparison.scalars)}", f"parameters differ (Holm {alpha})", "ok"
        ),
        Tile(
            f"{curves} of {len(comparison.curves)}",
            f"curves differ somewhere (corrected {alpha})",
            "ok",
        ),
    ]


def _who(comparison: Comparison) -> Section:
    rows = [
        (group, ", ".join(f"{name} ({count})" for name, count in animals))
        for group, animals in zip(comparison.names, comparison.animals, strict=True)
    ]
    lead = (
        f"Differences are {comparison.names[0]} minus {comparison.names[1]}. The animal is the"
        " unit: the mean of its strides represents it, so that more strides do not count as more"
        " animals."
    )
    return Section(
        "animals", "Groups", lead, grids=(Grid(("Group", "Animals (strides)"), tuple(rows)),)
    )


def _scalar_sections(comparison: Comparison) -> list[Section]:
    if not comparison.scalars:
        return []
    lead = "Mean ± standard deviation of the animals."
    if comparison.tested:
        lead += (
            " p by permuting animals. Holm’s correction controls the chance of any false positive"
            " among the parameters, q the false discovery rate."
        )
    figure = effect_figure(comparison)
    return [
        Section("strides", "Strides", lead, figures=(figure,), grids=(scalar_grid(comparison),))
    ]


def effect_figure(comparison: Comparison) -> Figure:
    """Effect size of every parameter with its interval, filled where the corrected p is small."""
    drawn = interval_rows(
        "Effect size",
        "Hedges’ g",
        [scalar.name for scalar in comparison.scalars],
        [Interval(scalar.g, scalar.g_low, scalar.g_high) for scalar in comparison.scalars],
        IntervalLook(
            solid=[scalar.holm < comparison.options.alpha for scalar in comparison.scalars],
            signed=True,
        ),
    )
    return Figure(drawn, "wide", "Filled where Holm’s p is small.")


def difference_chart(
    curve_difference: CurveDifference,
    unit: str,
    labels: tuple[str, str],
    styles: tuple[str, str] = STYLES,
) -> str:
    """Draw both groups' means with their intervals, and every animal's own curve.

    Bars below show where the means differ.
    """
    groups = (curve_difference.first, curve_difference.second)
    each = curve_difference.each
    curves = [
        CycleCurve(
            mean=group.mean,
            style=style,
            label=label,
            interval=(group.low, group.high),
            each=animals,
        )
        for group, style, label, animals in zip(groups, styles, labels, each, strict=True)
    ]
    shown = [*each[0], *each[1], *(end for group in groups for end in (group.low, group.high))]
    return cycle_chart(
        curve_difference.name, unit, curves, shown, CycleLook(differs=_regions(curve_difference))
    )


def effect_chart(curve_difference: CurveDifference) -> str:
    """Hedges' g along the cycle with its interval."""
    ends = curve_difference.g_low, curve_difference.g_high
    shown = [np.zeros(1), *np.clip(ends, -MAX_EFFECT, MAX_EFFECT)]
    curves = [CycleCurve(mean=curve_difference.g, style="middle", label="g", interval=ends)]
    return cycle_chart(
        curve_difference.name,
        "Hedges’ g",
        curves,
        shown,
        CycleLook(differs=_regions(curve_difference), height=190),
    )


def _regions(curve_difference: CurveDifference) -> list[tuple[float, float, str]]:
    """Where the groups differ, with what is shown under the pointer."""
    p = f"smallest p {number(curve_difference.least_p)}"
    return [
        (start, stop, f"differs from {start:.0f} to {stop:.0f} %, {p}")
        for start, stop in curve_difference.regions
    ]


def scalar_grid(comparison: Comparison) -> Grid:
    """Parameters of both groups, their differences and tests."""
    first, second = comparison.names
    size = "Effect size" if comparison.paired else "Hedges’ g"
    head = ("Parameter", first, second, "Difference", size, "p", "p, Holm", "q")
    rows = []
    for scalar in comparison.scalars:
        effect = Interval(scalar.g, scalar.g_low, scalar.g_high)
        intervals = map(
            with_interval, (Interval(scalar.difference, scalar.low, scalar.high), effect)
        )
        means = map(mean_words, (scalar.first, scalar.second))
        chances = map(_probability, (scalar.p, scalar.holm, scalar.q))
        rows.append((scalar.name, *means, *intervals, *chances))
    return Grid(head, tuple(rows))


def _family_section(comparison: Comparison, family: str) -> Section:
    curves = comparison.family(family)
    name, unit = name_and_unit(family)
    shown = different_first(curves) if comparison.tested else list(curves)
    figures = [
        Figure(
            difference_chart(curve, unit, comparison.names),
            folded=curve.name if index >= MAX_OPEN else "",
        )
        for index, curve in enumerate(shown)
    ]
    figures += [
        Figure(effect_chart(curve), folded=f"{curve.name}: effect size")
        for curve in shown[:MAX_OPEN]
    ]
    lead = (
        "Mean of the animals’ means over the stride from foot strike to foot strike, with"
        f" {100 * comparison.options.confidence:.0f} % intervals sample by sample; thin lines are"
        " animals."
    )
    if comparison.tested:
        lead += (
            f" Bars below mark where groups differ (p < {comparison.options.alpha:g}, corrected for"
            f" the whole stride and all {len(curves)} curves here by the maximum statistic); curves"
            " that differ come first."
        )
    legend = tuple(zip(STYLES, comparison.names, strict=True))
    return curve_section(name, lead, legend, figures, (curve_grid(shown),))


def name_and_unit(family: str) -> tuple[str, str]:
    """Split a family of curves into what they are and their unit: "angle [°]" is angle and °."""
    name, _, unit = family.partition(" [")
    return name, unit.removesuffix("]")


def different_first(curves: Sequence[CurveDifference]) -> list[CurveDifference]:
    """Curves that differ before the others, those of the smallest p first."""
    return sorted(
        curves,
        key=lambda curve: (not curve.regions, curve.least_p if np.isfinite(curve.least_p) else 2.0),
    )


def curve_section(
    name: str,
    lead: str,
    legend: tuple[tuple[str, str], ...],
    figures: Sequence[Figure],
    grids: tuple[Grid, ...] = (),
) -> Section:
    """Make the section of one family of curves."""
    key = "".join(letter if letter.isalnum() else "-" for letter in name.lower())
    return Section(
        key=f"curves-{key}",
        title=f"{name[:1].upper()}{name[1:]}",
        lead=lead,
        legend=legend,
        figures=tuple(figures),
        grids=grids,
    )


def curve_grid(curves: Sequence[CurveDifference], title: str = "All curves: statistics") -> Grid:
    """Where along the cycle the effect is largest, and where the groups differ."""
    rows = []
    for curve in curves:
        known = np.isfinite(curve.g)
        at = int(np.argmax(np.where(known, np.abs(curve.g), -1.0)))
        size = with_interval(
            Interval(
                value=float(curve.g[at]), low=float(curve.g_low[at]), high=float(curve.g_high[at])
            )
        )
        largest = f"{size} at {100.0 * at / max(len(curve.g) - 1, 1):.0f} %" if known.any() else "–"
        where = ", ".join(f"{a:.0f}–{b:.0f} %" for a, b in curve.regions) or "–"
        rows.append((curve.name, largest, _probability(curve.least_p), where))
    return Grid(
        head=("Curve", "Maximum effect size", "Minimum p", "Differs"),
        rows=tuple(rows),
        title=title,
        folded=True,
    )


def mean_words(words: tuple[float, float, int]) -> str:
    """Mean ± standard deviation, where it is known, and the number of values."""
    mean, spread, count = words
    return (
        number(mean) + (f" ± {number(spread)}" if np.isfinite(spread) else "") + f" (n = {count})"
    )


def _probability(p: float) -> str:
    if not np.isfinite(p):
        return "–"
    if p < 0.01:
        return f"{p:.4f}"
    return f"{p:.3f}"


def condition_chart(conditions: Sequence[Condition], family: str, name: str) -> str:
    """Draw one curve in all conditions: its mean and the interval of it.

    One standard deviation is drawn fainter.
    """
    drawn = []
    for style, condition in styled(conditions):
        curves = condition.curves.get(family)
        if curves is not None and name in curves.names:
            column = curves.names.index(name)
            mean = curves.mean[:, column]
            deviation = curves.deviation[:, column]
            interval = (curves.low[:, column], curves.high[:, column])
            spread = (mean - deviation, mean + deviation)
            drawn.append(
                CycleCurve(
                    mean=mean, style=style, label=condition.name, interval=interval, spread=spread
                )
            )
    shown = [part for curve in drawn for part in (curve.mean, *(curve.spread or ()))]
    return cycle_chart(name, name_and_unit(family)[1], drawn, shown)


def styled(conditions: Sequence[Condition]) -> list[tuple[str, Condition]]:
    """Conditions with the style of their lines."""
    return [
        (CONDITION_STYLES[index % len(CONDITION_STYLES)], condition)
        for index, condition in enumerate(conditions)
    ]


def ordered(conditions: Sequence[Condition], family: str) -> list[str]:
    """Order the names of a family's curves.

    Usual coordinates and leg muscles come first, the others by how far they move.
    """
    reach: dict[str, float] = {}
    for condition in conditions:
        curves = condition.curves.get(family)
        for index, name in enumerate(curves.names if curves is not None else ()):
            column = curves.mean[:, index] if curves is not None else np.zeros(1)
            known = column[np.isfinite(column)]
            reach[name] = max(reach.get(name, 0.0), float(np.ptp(known)) if len(known) else 0.0)
    names = list(reach)
    usual = (
        [name for pair in major_muscles(names) for name in pair.names]
        if family.startswith("muscle")
        else []
    )

    def rank(name: str) -> tuple[int, float, bool]:
        base, side = split_side(name)
        base = base.lower()
        if name in usual:
            return usual.index(name), 0.0, False
        if base in COORDINATE_ORDER:
            return len(usual) + COORDINATE_ORDER.index(base), 0.0, side == "left"
        return len(usual) + len(COORDINATE_ORDER), -reach[name], False

    return sorted(names, key=rank)
