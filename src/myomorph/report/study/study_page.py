"""The page on a whole study: what was done, how good it is, curves of every condition, and what differs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from myomorph.analysis.conditions import FAR, Condition
from myomorph.analysis.groups import Comparison
from myomorph.analysis.selection import COORDINATE_ORDER, major_muscles
from myomorph.model.sides import split_side
from myomorph.report.charts.axis import number
from myomorph.report.charts.curves import CycleCurve, cycle_chart
from myomorph.report.charts.points import rank_plot
from myomorph.report.page.page import Tile, rendered
from myomorph.report.page.parts import Figure, Grid, Link, Note, PageHead, Section
from myomorph.report.page.quantity import Quantity
from myomorph.report.page.references import cited
from myomorph.report.study.group_page import (
    TESTS,
    curve_grid,
    curve_section,
    difference_chart,
    different_first,
    effect_figure,
    mean_words,
    name_and_unit,
    scalar_grid,
)
from myomorph.report.study.study_given import (
    Described,
    Outlier,
    StudyInput,
    TrialLine,
    TrialState,
    ValueDifference,
)

MAX_OPEN, MAX_FOLDED = 12, 36
"""Curves of a family that are shown, and that are folded away; the tables have all."""
STYLES = ("right", "left", "third", "second", "fourth", "middle")
"""Of the conditions in their order; more of them take these again."""

MAX_DIFFERENT = 12
"""Curves of a comparison that are drawn."""
MAX_VALUES = 24
"""Differences of values that are shown of a pair of conditions."""
LONG = 60
"""Rows from which on a table is folded away at first."""
MAX_LISTED = 3
"""Trials or values that a line names one by one."""
SHOWN_LIMITS = (
    (Quantity.MARKER_RMS, "Markers"),
    (Quantity.RESIDUAL_FORCE_PEAK, "Residual force"),
    (Quantity.RESIDUAL_MOMENT_PEAK, "Residual moment"),
    (Quantity.RESERVES, "Reserves"),
)
REFERENCES = ("hicks2015", "opensim", *TESTS, "iglewicz1993")
UNSOLVED = (Quantity.NOT_CONVERGED, Quantity.NOT_OPTIMAL)


def study_page(given: StudyInput) -> str:
    """One self-contained HTML page, as text; it links to the report of every trial."""
    notes = tuple(Note("warning", one) for one in given.notes)
    page = PageHead(given.name, given.date, given.version, notes)
    families = dict.fromkeys(name for one in given.conditions for name, own in one.curves.items() if own.names)
    parts = [
        *_gone(given),
        *_changes(given),
        *_quality(given),
        *_described(given),
        *(_family(given, family) for family in families),
        *(_comparison(one, k, given) for k, one in enumerate(given.comparisons)),
        *_differences(given),
        *_outliers(given),
        *_trials(given),
        *_files(given),
    ]
    sources = cited(*REFERENCES) if given.conditions else ()
    return rendered(page, parts, sources, facts=_facts(given), tiles=_tiles(given))


def _facts(given: StudyInput) -> list[tuple[str, str]]:
    subjects = dict.fromkeys(one.subject for one in given.trials)
    rows = [("Subjects", str(len(subjects))), ("Trials", _counted(given))]
    if len(given.conditions) > 1 or any(one.name for one in given.conditions):
        rows.append(("Conditions", ", ".join(f"{_title(one)} ({one.trials})" for one in given.conditions)))
    return rows


def _title(one: Condition) -> str:
    return one.name or "all trials"


def _whole_trials(given: StudyInput, state: TrialState) -> tuple[TrialLine, ...]:
    """Trials in a state, without the lines of steps that are about a whole subject."""
    return tuple(one for one in given.in_state(state) if one.trial)


def _counted(given: StudyInput) -> str:
    parts = [f"{len(_whole_trials(given, 'done'))} done"]
    for state, own in (("failed", _whole_trials(given, "failed")), ("left out", given.in_state("left out"))):
        parts += [f"{len(own)} {state}"] if own else []
    return ", ".join(parts)


def _tiles(given: StudyInput) -> list[Tile]:
    done, failed = _whole_trials(given, "done"), _whole_trials(given, "failed")
    over = sum(one.over > 0 for one in done)
    state = "over" if given.in_state("failed") else "ok"
    tiles = [Tile(f"{len(done)} / {len(done) + len(failed)}", "trials done", state)]
    if any(one.judged for one in done):
        tiles.append(Tile(f"{over} of {len(done)}", "trials with a quantity over its limit", "note" if over else "ok"))
    if given.outliers:
        named = len({(one.subject, one.trial) for one in given.outliers})
        tiles.append(Tile(str(named), "trials with outliers", "note"))
    for one in given.comparisons:
        if one.tested:
            curves, words = sum(1 for each in one.curves if each.regions), " and ".join(one.names)
            tiles.append(Tile(f"{curves} of {len(one.curves)}", f"curves differ, {words}", "ok"))
    return tiles


def _gone(given: StudyInput) -> list[Section]:
    failed, left = given.in_state("failed"), given.in_state("left out")
    grids = []
    for lines, title, head in ((failed, "Failed", "Why"), (left, "Excluded by the study file", "Reason")):
        if lines:
            rows = tuple((one.subject, one.trial or "all", one.condition, one.reason) for one in lines)
            grids.append(Grid(("Subject", "Trial", "Condition", head), rows, title, len(rows) > LONG))
    return [Section("gone", "Failed and excluded", grids=tuple(grids))] if grids else []


def _changes(given: StudyInput) -> list[Section]:
    if not given.changes:
        return []
    rows = tuple((text, _named(trials)) for text, trials in given.changes)
    lead = "Why steps of an earlier run were computed again."
    return [Section("changes", "Changes since the last run", lead, grids=(Grid(("Change", "Trials"), rows),))]


def _named(names: Sequence[str]) -> str:
    words = "; ".join(names[:MAX_LISTED])
    return words + (f"; and {len(names) - MAX_LISTED} more" if len(names) > MAX_LISTED else "")


def _quality(given: StudyInput) -> list[Section]:
    """Trials by rank beside each limit, and what is beyond limits how often."""
    done = [one for one in given.in_state("done") if one.judged]
    if not done:
        return []
    figures = []
    for quantity, title in SHOWN_LIMITS:
        own = [(one, one.judged[quantity]) for one in done if quantity in one.judged]
        own = [(one, judged) for one, judged in own if judged.limit]
        if len(own) > 1:
            names = [f"{one.subject}, {one.trial}" for one, _ in own]
            values = np.array([judged.value / (judged.limit or 1.0) for _, judged in own])
            chart = rank_plot(title, "times its limit", "trials in ascending order", names, values, [(1.0, "limit")])
            figures.append(Figure(chart, "medium"))
    quantities = dict.fromkeys(name for one in done for name in one.judged)
    rows = []
    for name in quantities:
        own = [(one, one.judged[name]) for one in done if name in one.judged]
        over = [(one, judged) for one, judged in own if judged.state == "over"]
        if over:
            worst, most = max(over, key=lambda pair: pair[1].value)
            # Of counts the unit says of how many.
            size = f"{most.value:.0f}" if most.unit.startswith("of ") else number(most.value)
            words = f"{size} {most.unit}: {worst.subject}, {worst.trial}"
            rows.append((name, f"{len(over)} of {len(own)}", words))
    grids = (Grid(("Quantity", "Trials over the limit", "Worst"), tuple(rows), "Over the limit"),) if rows else ()
    lead = "Marker errors, residuals and reserves beside the community’s limits; one dot a trial."
    return [Section("quality", "Quality", lead, figures=tuple(figures), grids=grids)]


def _described(given: StudyInput) -> list[Section]:
    if not given.described:
        return []
    unit = given.conditions[0].unit if given.conditions else "subjects"
    names = tuple(_title(one) for one in given.conditions)
    first = [one for one in given.described if one.quantity.startswith(("stride ", "speed", "duty", "track"))]
    rest = [one for one in given.described if one not in first]
    grids = [
        Grid(("Quantity", *names), tuple(_described_row(one) for one in part), title, folded)
        for part, title, folded in (
            (first, "Strides", False),
            (rest, f"All {len(rest)}{' others' if first else ''}", True),
        )
        if part
    ]
    each = "subjects, each the mean of its trials" if unit == "subjects" else "trials: there is one subject"
    lead = f"Mean ± standard deviation of {each}."
    return [Section("values", "Values", lead, grids=tuple(grids))]


def _described_row(one: Described) -> tuple[str, ...]:
    unit = "" if one.unit == "1" else f" [{one.unit}]"
    return (f"{one.quantity}{unit}", *(mean_words(words) if words[2] else "–" for words in one.conditions))


def _differences(given: StudyInput) -> list[Section]:
    """Values that differ most beside what is open, with the draws' errors in their intervals."""
    grids = []
    for pair in dict.fromkeys((one.first, one.second) for one in given.differences):
        own = [one for one in given.differences if (one.first, one.second) == pair and one.high_all > one.low_all]
        own.sort(key=lambda one: -abs(one.difference) / (one.high_all - one.low_all))
        rows = tuple(_difference_row(one) for one in own[:MAX_VALUES])
        head = ("Quantity", pair[0], pair[1], "Difference", "95 %, spread alone", "95 %, with errors", "SD of errors")
        if rows:
            grids.append(Grid(head, rows, " minus ".join(pair)))
    if not grids:
        return []
    lead = (
        "Differences whose errors were drawn, those that are largest beside their interval first; "
        "value_differences.csv has all. Errors that a subject's trials share cancel as far as both conditions "
        "have them. The spread of several subjects holds the errors of each; that of one subject's trials does "
        "not hold what they share, which is added."
    )
    return [Section("differences", "Differences with their errors", lead, grids=tuple(grids))]


def _difference_row(one: ValueDifference) -> tuple[str, ...]:
    unit = "" if one.unit == "1" else f" [{one.unit}]"
    spread = f"{number(one.low)} to {number(one.high)}" if np.isfinite(one.low) else "–"
    whole = f"{number(one.low_all)} to {number(one.high_all)}"
    means = (number(one.means[0]), number(one.means[1]))
    return (f"{one.quantity}{unit}", *means, number(one.difference), spread, whole, number(one.measured_sd))


def _family(given: StudyInput, family: str) -> Section:
    names = _ordered(given.conditions, family)
    figures = [
        Figure(condition_chart(given.conditions, family, name), folded=name if k >= MAX_OPEN else "")
        for k, name in enumerate(names[: MAX_OPEN + MAX_FOLDED])
    ]
    own = [one for one in given.conditions if family in one.curves]
    words = {True: "strides, from foot strike to foot strike", False: "whole trials"}
    cycles = list(dict.fromkeys(words[one.cycle == "stride"] for one in own))
    units = " and ".join(dict.fromkeys(one.unit for one in own))
    lead = (
        f"Over {' or '.join(cycles)}. Lines are means of {units}, bands their 95 % intervals sample by sample, faint "
        "bands ± one standard deviation."
    )
    if len(names) > MAX_OPEN + MAX_FOLDED:
        lead += f" {len(names) - MAX_OPEN - MAX_FOLDED} more are in condition_curves.csv."
    # A percent of a stride is not a percent of a trial: curves that share a chart say which they are over.
    over = {True: " (over the stride)", False: " (over the whole trial)"} if len(cycles) > 1 else {}
    legend = [(style, _title(one) + over.get(one.cycle == "stride", "")) for style, one in styled(given.conditions)]
    return curve_section(name_and_unit(family)[0], lead, tuple(legend), figures)


def condition_chart(conditions: Sequence[Condition], family: str, name: str) -> str:
    """One curve in all conditions: its mean, the interval of it, and fainter one standard deviation."""
    drawn = []
    for style, one in styled(conditions):
        curves = one.curves.get(family)
        if curves is not None and name in curves.names:
            k = curves.names.index(name)
            mean, deviation = curves.mean[:, k], curves.deviation[:, k]
            spread = mean - deviation, mean + deviation
            drawn.append(CycleCurve(mean, style, one.name, (curves.low[:, k], curves.high[:, k]), spread))
    shown = [part for one in drawn for part in (one.mean, *(one.spread or ()))]
    return cycle_chart(name, name_and_unit(family)[1], drawn, shown)


def styled(conditions: Sequence[Condition]) -> list[tuple[str, Condition]]:
    """Conditions with the style of their lines."""
    return [(STYLES[k % len(STYLES)], one) for k, one in enumerate(conditions)]


def _ordered(conditions: Sequence[Condition], family: str) -> list[str]:
    """Names of a family's curves: usual coordinates and leg muscles first, the others by how far they move."""
    reach: dict[str, float] = {}
    for one in conditions:
        curves = one.curves.get(family)
        for k, name in enumerate(curves.names if curves is not None else ()):
            column = curves.mean[:, k] if curves is not None else np.zeros(1)
            known = column[np.isfinite(column)]
            reach[name] = max(reach.get(name, 0.0), float(np.ptp(known)) if len(known) else 0.0)
    names = list(reach)
    usual = [name for pair in major_muscles(names) for name in pair.names] if family.startswith("muscle") else []

    def rank(name: str) -> tuple[int, float, bool]:
        base, side = split_side(name)
        base = base.lower()
        if name in usual:
            return usual.index(name), 0.0, False
        if base in COORDINATE_ORDER:
            return len(usual) + COORDINATE_ORDER.index(base), 0.0, side == "left"
        return len(usual) + len(COORDINATE_ORDER), -reach[name], False

    return sorted(names, key=rank)


def _comparison(found: Comparison, index: int, given: StudyInput) -> Section:
    first, second = found.names
    colors = {one.name: style for style, one in styled(given.conditions)}
    styles = colors[first], colors[second]
    pairs = len(given.comparisons)
    lead = f"Differences are {first} minus {second}. "
    if found.paired:
        lead += (
            f"{len(found.animals[0])} subjects have both and are compared within themselves; the effect size is the "
            "mean difference over the standard deviation of differences. "
        )
    else:
        counts = " and ".join(str(len(one)) for one in found.animals)
        lead += f"No subject has both: groups of {counts} subjects; the effect size is Hedges’ g. "
    if found.tested:
        how = "all" if found.exact else f"{found.options.permutations} random"
        turned = "sign changes of the differences" if found.paired else "permutations of subjects"
        lead += f"Tested by {how} {turned}; smallest possible p {number(found.floor)}. "
        lead += f"Bars below mark where curves differ (p < {number(found.options.alpha)}"
        lead += f", which is 0.05 over {pairs} pairs of conditions" if pairs > 1 else ""
        lead += "; corrected for the whole cycle and all curves of a kind by the maximum statistic)."
    else:
        lead += "Too few subjects for a test: described only."
    lead = " ".join([lead, *(f"{one[:1].upper()}{one[1:]}." for one in found.notes)])
    figures = []
    if any(np.isfinite(one.g) for one in found.scalars):
        least = found.floor * sum(np.isfinite(one.p) for one in found.scalars)
        if found.tested and least > found.options.alpha:
            lead += f" So few subjects cannot bring Holm’s p of that many parameters below {number(min(least, 1.0))}."
        figures.append(effect_figure(found))
    grids = [scalar_grid(found)] if found.scalars else []
    for family in found.families:
        curves, (name, unit) = different_first(found.family(family)), name_and_unit(family)
        different = [one for one in curves if one.regions]
        figures += [Figure(difference_chart(one, unit, found.names, styles)) for one in different[:MAX_DIFFERENT]]
        grids.append(curve_grid(curves, f"{name}: {len(different)} of {len(curves)} differ"))
    legend = tuple(zip(styles, found.names, strict=True))
    return Section(f"pair-{index + 1}", f"{first} and {second}", lead, legend, tuple(figures), tuple(grids))


def _outliers(given: StudyInput) -> list[Section]:
    if not given.outliers:
        return []
    own: dict[tuple[str, str], list[Outlier]] = {}
    for one in given.outliers:
        own.setdefault((one.subject, one.trial), []).append(one)
    rows = []
    for lines in sorted(own.values(), key=lambda each: -max(abs(one.score) for one in each)):
        lines.sort(key=lambda one: -abs(one.score))
        words = "; ".join(
            f"{one.quantity} {number(one.value)}{'' if one.unit == '1' else f' {one.unit}'} "
            f"(median {number(one.middle)}, score {number(one.score)})"
            for one in lines[:MAX_LISTED]
        )
        rows.append((lines[0].subject, lines[0].trial, lines[0].condition, str(len(lines)), words))
    lead = (
        "Values whose modified z-score, 0.6745 (x − median) / median absolute deviation, in the trials of a condition "
        f"is beyond {FAR:g}; curves by their distance to the mean of the condition. Outliers are to be inspected: "
        "nothing is excluded because of them. All are in outliers.csv."
    )
    grid = Grid(("Subject", "Trial", "Condition", "Values", "Most extreme"), tuple(rows), "", len(rows) > LONG)
    return [Section("outliers", "Outliers", lead, grids=(grid,))]


def _trials(given: StudyInput) -> list[Section]:
    limits = tuple(title for _, title in SHOWN_LIMITS)
    head = ("Subject", "Trial", "Condition", "Steps", "Frames", *limits, "Unsolved", "Over limits", "Warnings")
    done = given.in_state("done")
    if not done:
        return []
    rows = tuple(_trial_row(one) for one in done)
    lead = "Names of trials link to their reports. Markers: RMS of the worst frame; residuals and reserves: peaks."
    grid = Grid(head, rows, f"{len(rows)} trials", len(rows) > 4 * LONG)
    return [Section("trials", "All trials", lead, grids=(grid,))]


def _trial_row(one: TrialLine) -> tuple[str | Link, ...]:
    cells = []
    for quantity, _ in SHOWN_LIMITS:
        judged = one.judged.get(quantity)
        cells.append("" if judged is None else f"{number(judged.value)} {judged.unit.partition(' ')[0]}")
    unsolved = [one.judged[name].value for name in UNSOLVED if name in one.judged]
    return (
        one.subject,
        Link(one.trial or "(model)", one.report) if one.report else one.trial or "(model)",
        one.condition,
        " ".join(one.steps),
        str(one.frames) if one.frames else "",
        *cells,
        f"{sum(unsolved):.0f}" if unsolved else "",
        str(one.over) if one.judged else "",
        str(one.warnings) if one.warnings else "",
    )


def _files(given: StudyInput) -> list[Section]:
    if not given.files:
        return []
    rows = tuple((Link(place, place), words) for place, words in given.files)
    return [Section("files", "Tables", "Beside this page.", grids=(Grid(("File", "Content"), rows),))]
