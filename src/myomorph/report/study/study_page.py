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


def study_page(study_input: StudyInput) -> str:
    """One self-contained HTML page, as text; it links to the report of every trial."""
    notes = tuple(Note("warning", note) for note in study_input.notes)
    page = PageHead(study_input.name, study_input.date, study_input.version, notes)
    families = dict.fromkeys(
        name for condition in study_input.conditions for name, curve in condition.curves.items() if curve.names
    )
    parts = [
        *_gone(study_input),
        *_changes(study_input),
        *_quality(study_input),
        *_described(study_input),
        *(_family(study_input, family) for family in families),
        *(_comparison(comparison, index, study_input) for index, comparison in enumerate(study_input.comparisons)),
        *_differences(study_input),
        *_outliers(study_input),
        *_trials(study_input),
        *_files(study_input),
    ]
    sources = cited(*REFERENCES) if study_input.conditions else ()
    return rendered(page, parts, sources, facts=_facts(study_input), tiles=_tiles(study_input))


def _facts(study_input: StudyInput) -> list[tuple[str, str]]:
    subjects = dict.fromkeys(trial.subject for trial in study_input.trials)
    rows = [("Subjects", str(len(subjects))), ("Trials", _counted(study_input))]
    if len(study_input.conditions) > 1 or any(condition.name for condition in study_input.conditions):
        rows.append(
            (
                "Conditions",
                ", ".join(f"{_title(condition)} ({condition.trials})" for condition in study_input.conditions),
            )
        )
    return rows


def _title(condition: Condition) -> str:
    return condition.name or "all trials"


def _whole_trials(study_input: StudyInput, state: TrialState) -> tuple[TrialLine, ...]:
    """Trials in a state, without the lines of steps that are about a whole subject."""
    return tuple(one for one in study_input.in_state(state) if one.trial)


def _counted(study_input: StudyInput) -> str:
    parts = [f"{len(_whole_trials(study_input, 'done'))} done"]
    for state, own in (
        ("failed", _whole_trials(study_input, "failed")),
        ("left out", study_input.in_state("left out")),
    ):
        parts += [f"{len(own)} {state}"] if own else []
    return ", ".join(parts)


def _tiles(study_input: StudyInput) -> list[Tile]:
    done, failed = _whole_trials(study_input, "done"), _whole_trials(study_input, "failed")
    over = sum(one.over > 0 for one in done)
    state = "over" if study_input.in_state("failed") else "ok"
    tiles = [Tile(f"{len(done)} / {len(done) + len(failed)}", "trials done", state)]
    if any(one.judged for one in done):
        tiles.append(Tile(f"{over} of {len(done)}", "trials with a quantity over its limit", "note" if over else "ok"))
    if study_input.outliers:
        named = len({(outlier.subject, outlier.trial) for outlier in study_input.outliers})
        tiles.append(Tile(str(named), "trials with outliers", "note"))
    for comparison in study_input.comparisons:
        if comparison.tested:
            curves, words = sum(1 for each in comparison.curves if each.regions), " and ".join(comparison.names)
            tiles.append(Tile(f"{curves} of {len(comparison.curves)}", f"curves differ, {words}", "ok"))
    return tiles


def _gone(study_input: StudyInput) -> list[Section]:
    failed, left = study_input.in_state("failed"), study_input.in_state("left out")
    grids = []
    for lines, title, head in ((failed, "Failed", "Why"), (left, "Excluded by the study file", "Reason")):
        if lines:
            rows = tuple((line.subject, line.trial or "all", line.condition, line.reason) for line in lines)
            grids.append(Grid(("Subject", "Trial", "Condition", head), rows, title, len(rows) > LONG))
    return [Section("gone", "Failed and excluded", grids=tuple(grids))] if grids else []


def _changes(study_input: StudyInput) -> list[Section]:
    if not study_input.changes:
        return []
    rows = tuple((text, _named(trials)) for text, trials in study_input.changes)
    lead = "Why steps of an earlier run were computed again."
    return [Section("changes", "Changes since the last run", lead, grids=(Grid(("Change", "Trials"), rows),))]


def _named(names: Sequence[str]) -> str:
    words = "; ".join(names[:MAX_LISTED])
    return words + (f"; and {len(names) - MAX_LISTED} more" if len(names) > MAX_LISTED else "")


def _quality(study_input: StudyInput) -> list[Section]:
    """Trials by rank beside each limit, and what is beyond limits how often."""
    done = [one for one in study_input.in_state("done") if one.judged]
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


def _described(study_input: StudyInput) -> list[Section]:
    if not study_input.described:
        return []
    unit = study_input.conditions[0].unit if study_input.conditions else "subjects"
    names = tuple(_title(condition) for condition in study_input.conditions)
    first = [one for one in study_input.described if one.quantity.startswith(("stride ", "speed", "duty", "track"))]
    rest = [one for one in study_input.described if one not in first]
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


def _described_row(described: Described) -> tuple[str, ...]:
    unit = "" if described.unit == "1" else f" [{described.unit}]"
    return (f"{described.quantity}{unit}", *(mean_words(words) if words[2] else "–" for words in described.conditions))


def _differences(study_input: StudyInput) -> list[Section]:
    """Values that differ most beside what is open, with the draws' errors in their intervals."""
    grids = []
    for pair in dict.fromkeys((difference.first, difference.second) for difference in study_input.differences):
        own = [
            difference
            for difference in study_input.differences
            if (difference.first, difference.second) == pair and difference.high_all > difference.low_all
        ]
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


def _difference_row(value_difference: ValueDifference) -> tuple[str, ...]:
    unit = "" if value_difference.unit == "1" else f" [{value_difference.unit}]"
    spread = (
        f"{number(value_difference.low)} to {number(value_difference.high)}"
        if np.isfinite(value_difference.low)
        else "–"
    )
    whole = f"{number(value_difference.low_all)} to {number(value_difference.high_all)}"
    means = (number(value_difference.means[0]), number(value_difference.means[1]))
    return (
        f"{value_difference.quantity}{unit}",
        *means,
        number(value_difference.difference),
        spread,
        whole,
        number(value_difference.measured_sd),
    )


def _family(study_input: StudyInput, family: str) -> Section:
    names = _ordered(study_input.conditions, family)
    figures = [
        Figure(condition_chart(study_input.conditions, family, name), folded=name if index >= MAX_OPEN else "")
        for index, name in enumerate(names[: MAX_OPEN + MAX_FOLDED])
    ]
    own = [condition for condition in study_input.conditions if family in condition.curves]
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
    legend = [
        (style, _title(one) + over.get(one.cycle == "stride", "")) for style, one in styled(study_input.conditions)
    ]
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
    return [(STYLES[index % len(STYLES)], condition) for index, condition in enumerate(conditions)]


def _ordered(conditions: Sequence[Condition], family: str) -> list[str]:
    """Names of a family's curves: usual coordinates and leg muscles first, the others by how far they move."""
    reach: dict[str, float] = {}
    for condition in conditions:
        curves = condition.curves.get(family)
        for index, name in enumerate(curves.names if curves is not None else ()):
            column = curves.mean[:, index] if curves is not None else np.zeros(1)
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


def _comparison(comparison: Comparison, index: int, study_input: StudyInput) -> Section:
    first, second = comparison.names
    colors = {one.name: style for style, one in styled(study_input.conditions)}
    styles = colors[first], colors[second]
    pairs = len(study_input.comparisons)
    lead = f"Differences are {first} minus {second}. "
    if comparison.paired:
        lead += (
            f"{len(comparison.animals[0])} subjects have both and are compared within themselves; the effect "
            f"size is the "
            "mean difference over the standard deviation of differences. "
        )
    else:
        counts = " and ".join(str(len(animal)) for animal in comparison.animals)
        lead += f"No subject has both: groups of {counts} subjects; the effect size is Hedges’ g. "
    if comparison.tested:
        how = "all" if comparison.exact else f"{comparison.options.permutations} random"
        turned = "sign changes of the differences" if comparison.paired else "permutations of subjects"
        lead += f"Tested by {how} {turned}; smallest possible p {number(comparison.floor)}. "
        lead += f"Bars below mark where curves differ (p < {number(comparison.options.alpha)}"
        lead += f", which is 0.05 over {pairs} pairs of conditions" if pairs > 1 else ""
        lead += "; corrected for the whole cycle and all curves of a kind by the maximum statistic)."
    else:
        lead += "Too few subjects for a test: described only."
    lead = " ".join([lead, *(f"{note[:1].upper()}{note[1:]}." for note in comparison.notes)])
    figures = []
    if any(np.isfinite(scalar.g) for scalar in comparison.scalars):
        least = comparison.floor * sum(np.isfinite(scalar.p) for scalar in comparison.scalars)
        if comparison.tested and least > comparison.options.alpha:
            lead += f" So few subjects cannot bring Holm’s p of that many parameters below {number(min(least, 1.0))}."
        figures.append(effect_figure(comparison))
    grids = [scalar_grid(comparison)] if comparison.scalars else []
    for family in comparison.families:
        curves, (name, unit) = different_first(comparison.family(family)), name_and_unit(family)
        different = [curve for curve in curves if curve.regions]
        figures += [Figure(difference_chart(one, unit, comparison.names, styles)) for one in different[:MAX_DIFFERENT]]
        grids.append(curve_grid(curves, f"{name}: {len(different)} of {len(curves)} differ"))
    legend = tuple(zip(styles, comparison.names, strict=True))
    return Section(f"pair-{index + 1}", f"{first} and {second}", lead, legend, tuple(figures), tuple(grids))


def _outliers(study_input: StudyInput) -> list[Section]:
    if not study_input.outliers:
        return []
    own: dict[tuple[str, str], list[Outlier]] = {}
    for outlier in study_input.outliers:
        own.setdefault((outlier.subject, outlier.trial), []).append(outlier)
    rows = []
    for lines in sorted(own.values(), key=lambda each: -max(abs(one.score) for one in each)):
        lines.sort(key=lambda one: -abs(one.score))
        words = "; ".join(
            f"{line.quantity} {number(line.value)}{'' if line.unit == '1' else f' {line.unit}'} "
            f"(median {number(line.middle)}, score {number(line.score)})"
            for line in lines[:MAX_LISTED]
        )
        rows.append((lines[0].subject, lines[0].trial, lines[0].condition, str(len(lines)), words))
    lead = (
        "Values whose modified z-score, 0.6745 (x − median) / median absolute deviation, in the trials of a condition "
        f"is beyond {FAR:g}; curves by their distance to the mean of the condition. Outliers are to be inspected: "
        "nothing is excluded because of them. All are in outliers.csv."
    )
    grid = Grid(("Subject", "Trial", "Condition", "Values", "Most extreme"), tuple(rows), "", len(rows) > LONG)
    return [Section("outliers", "Outliers", lead, grids=(grid,))]


def _trials(study_input: StudyInput) -> list[Section]:
    limits = tuple(title for _, title in SHOWN_LIMITS)
    head = ("Subject", "Trial", "Condition", "Steps", "Frames", *limits, "Unsolved", "Over limits", "Warnings")
    done = study_input.in_state("done")
    if not done:
        return []
    rows = tuple(_trial_row(one) for one in done)
    lead = "Names of trials link to their reports. Markers: RMS of the worst frame; residuals and reserves: peaks."
    grid = Grid(head, rows, f"{len(rows)} trials", len(rows) > 4 * LONG)
    return [Section("trials", "All trials", lead, grids=(grid,))]


def _trial_row(trial_line: TrialLine) -> tuple[str | Link, ...]:
    cells = []
    for quantity, _ in SHOWN_LIMITS:
        judged = trial_line.judged.get(quantity)
        cells.append("" if judged is None else f"{number(judged.value)} {judged.unit.partition(' ')[0]}")
    unsolved = [trial_line.judged[name].value for name in UNSOLVED if name in trial_line.judged]
    return (
        trial_line.subject,
        Link(trial_line.trial or "(model)", trial_line.report) if trial_line.report else trial_line.trial or "(model)",
        trial_line.condition,
        " ".join(trial_line.steps),
        str(trial_line.frames) if trial_line.frames else "",
        *cells,
        f"{sum(unsolved):.0f}" if unsolved else "",
        str(trial_line.over) if trial_line.judged else "",
        str(trial_line.warnings) if trial_line.warnings else "",
    )


def _files(study_input: StudyInput) -> list[Section]:
    if not study_input.files:
        return []
    rows = tuple((Link(place, place), words) for place, words in study_input.files)
    return [Section("files", "Tables", "Beside this page.", grids=(Grid(("File", "Content"), rows),))]
