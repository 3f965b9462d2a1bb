"""The page on a whole study: what was done, how good it is, curves of every condition.

It ends with what differs between conditions.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice

import numpy as np

from myomorph.core.model.frozen_map import grouped
from myomorph.core.model.message_groups import grouped_messages
from myomorph.core.model.messages import Severity
from myomorph.lab.analysis.conditions import OUTLIER_SCORE, Condition
from myomorph.lab.analysis.groups import Comparison
from myomorph.lab.report.charts.axis import number
from myomorph.lab.report.charts.points import Ranked, rank_plot
from myomorph.lab.report.page.page import Summary, Tile, rendered
from myomorph.lab.report.page.parts import (
    Figure,
    Grid,
    Link,
    Note,
    PageHead,
    Quantity,
    Section,
    cited,
)
from myomorph.lab.report.study import group_page
from myomorph.lab.report.study.study_input import (
    Described,
    Outlier,
    StudyInput,
    TrialLine,
    TrialState,
    ValueDifference,
)

MAX_OPEN = 12
MAX_FOLDED = 36  # Curves of a family that are shown, and that are folded away; the tables have all.
MAX_DIFFERENT = 12  # Curves of a comparison that are drawn.
MAX_VALUES = 24  # Differences of values that are shown of a pair of conditions.
LONG = 60  # Rows from which on a table is folded away at first.
MAX_LISTED = 3  # Trials or values that a line names one by one.
SHOWN_LIMITS = (
    (Quantity.MARKER_RMS, "Markers"),
    (Quantity.RESIDUAL_FORCE_PEAK, "Residual force"),
    (Quantity.RESIDUAL_MOMENT_PEAK, "Residual moment"),
    (Quantity.RESERVES, "Reserves"),
)
REFERENCES = ("hicks2015", "opensim", *group_page.TESTS, "iglewicz1993")
UNSOLVED = (Quantity.NOT_CONVERGED, Quantity.NOT_OPTIMAL)


def study_page(study: StudyInput) -> str:
    """One self-contained HTML page, as text; it links to the report of every trial."""
    notes = tuple(Note("warning", note) for note in study.notes)
    page = PageHead(title=study.name, date=study.date, version=study.version, notes=notes)
    curves = (pair for condition in study.conditions for pair in condition.curves.items())
    families = dict.fromkeys(name for name, curve in curves if curve.names)
    parts = [
        part
        for sections in (_gone, _changes, _causes, _quality, _described)
        for part in sections(study)
    ]
    parts += [_family(study, family) for family in families]
    parts += [
        _comparison(comparison, index, study) for index, comparison in enumerate(study.comparisons)
    ]
    parts += [
        part for sections in (_differences, _outliers, _trials, _files) for part in sections(study)
    ]
    sources = cited(*REFERENCES) if study.conditions else ()
    return rendered(page, parts, sources, Summary(facts=_facts(study), tiles=_tiles(study)))


def _facts(study: StudyInput) -> list[tuple[str, str]]:
    subjects = dict.fromkeys(trial.subject for trial in study.trials)
    rows = [("Subjects", str(len(subjects))), ("Trials", _counted(study))]
    if len(study.conditions) > 1 or any(condition.name for condition in study.conditions):
        titles = (f"{_title(condition)} ({condition.trials})" for condition in study.conditions)
        rows.append(("Conditions", ", ".join(titles)))
    return rows


def _title(condition: Condition) -> str:
    return condition.name or "all trials"


def _whole_trials(study: StudyInput, state: TrialState) -> tuple[TrialLine, ...]:
    """Trials in a state, without the lines of steps that are about a whole subject."""
    return tuple(trial for trial in study.in_state(state) if trial.trial)


def _counted(study: StudyInput) -> str:
    parts = [f"{len(_whole_trials(study, 'done'))} done"]
    for state, counted in (
        ("failed", _whole_trials(study, "failed")),
        ("left out", study.in_state("left out")),
    ):
        parts += [f"{len(counted)} {state}"] if counted else []
    return ", ".join(parts)


def _tiles(study: StudyInput) -> list[Tile]:
    done = _whole_trials(study, "done")
    failed = _whole_trials(study, "failed")
    over = sum(trial.over > 0 for trial in done)
    state = "over" if study.in_state("failed") else "ok"
    tiles = [Tile(f"{len(done)} / {len(done) + len(failed)}", "trials done", state)]
    if any(trial.judged for trial in done):
        tiles.append(
            Tile(
                f"{over} of {len(done)}",
                "trials with a quantity over its limit",
                "note" if over else "ok",
            )
        )
    if study.outliers:
        named = len({(outlier.subject, outlier.trial) for outlier in study.outliers})
        tiles.append(Tile(str(named), "trials with outliers", "note"))
    for comparison in study.comparisons:
        if comparison.tested:
            curves = sum(1 for each in comparison.curves if each.regions)
            words = " and ".join(comparison.names)
            tiles.append(
                Tile(f"{curves} of {len(comparison.curves)}", f"curves differ, {words}", "ok")
            )
    return tiles


def _gone(study: StudyInput) -> list[Section]:
    failed = study.in_state("failed")
    left = study.in_state("left out")
    grids = []
    for lines, title, head in (
        (failed, "Failed", "Why"),
        (left, "Excluded by the study file", "Reason"),
    ):
        if lines:
            rows = tuple(
                (line.subject, line.trial or "all", line.condition, line.reason) for line in lines
            )
            grids.append(
                Grid(
                    head=("Subject", "Trial", "Condition", head),
                    rows=rows,
                    title=title,
                    folded=len(rows) > LONG,
                )
            )
    return [Section("gone", "Failed and excluded", grids=tuple(grids))] if grids else []


def _changes(study: StudyInput) -> list[Section]:
    if not study.changes:
        return []
    rows = tuple((text, _named(trials)) for text, trials in study.changes)
    lead = "Why steps of an earlier run were computed again."
    return [
        Section(
            "changes", "Changes since the last run", lead, grids=(Grid(("Change", "Trials"), rows),)
        )
    ]


def _causes(study: StudyInput) -> list[Section]:
    """Warnings of all trials by their cause, the most severe first."""
    trials: dict[tuple[Severity, str], list[str]] = {}
    for trial, messages in study.messages:
        for message in dict.fromkeys((each.severity, each.cause_title) for each in messages):
            trials.setdefault(message, []).append(trial)
    groups = grouped_messages(message for _, messages in study.messages for message in messages)
    rows = tuple(
        (
            group.severity,
            group.cause.title,
            _named(trials[group.severity, group.cause.title]),
            group.messages[0].text,
            f"{group.cause.effect} {group.cause.remedy}".strip(),
        )
        for group in groups
        if group.is_warning
    )
    if not rows:
        return []
    head = ("Effect", "Cause", "Trials", "Largest, as written", "Effect, and what to do")
    lead = "Each trial's page has where and how much; messages.csv has every message."
    return [Section("causes", "Warnings by cause", lead, grids=(Grid(head, rows),))]


def _named(names: Sequence[str]) -> str:
    words = "; ".join(names[:MAX_LISTED])
    return words + (f"; and {len(names) - MAX_LISTED} more" if len(names) > MAX_LISTED else "")


def _quality(study: StudyInput) -> list[Section]:
    """Trials by rank beside each limit, and what is beyond limits how often."""
    done = [trial for trial in study.in_state("done") if trial.judged]
    if not done:
        return []
    charts = [_rank_chart(done, quantity, title) for quantity, title in SHOWN_LIMITS]
    figures = tuple(Figure(chart, "medium") for chart in charts if chart)
    quantities = dict.fromkeys(name for trial in done for name in trial.judged)
    rows = tuple(filter(None, (_over_limit(done, name) for name in quantities)))
    grids = (Grid(("Quantity", "Trials over the limit", "Worst"), rows, "Over the limit"),)
    lead = "Marker errors, residuals and reserves beside the community’s limits; one dot a trial."
    return [Section("quality", "Quality", lead, figures=figures, grids=grids)]


def _rank_chart(trials: Sequence[TrialLine], quantity: str, title: str) -> str:
    """Draw a quantity of all trials over its limit; "" where fewer than two have it."""
    with_value = [(trial, trial.judged[quantity]) for trial in trials if quantity in trial.judged]
    with_value = [(trial, judged) for trial, judged in with_value if judged.limit]
    if len(with_value) < 2:
        return ""
    return rank_plot(
        title,
        "times its limit",
        "trials in ascending order",
        Ranked(
            names=[f"{trial.subject}, {trial.trial}" for trial, _ in with_value],
            values=np.array([judged.value / (judged.limit or 1.0) for _, judged in with_value]),
            levels=[(1.0, "limit")],
        ),
    )


def _over_limit(trials: Sequence[TrialLine], name: str) -> tuple[str, str, str] | None:
    """Write in how many trials a quantity is over its limit, and the worst; None for no trial."""
    with_value = [(trial, trial.judged[name]) for trial in trials if name in trial.judged]
    over = [(trial, judged) for trial, judged in with_value if judged.state == "over"]
    if not over:
        return None
    worst, most = max(over, key=lambda pair: pair[1].value)
    # Of counts the unit says of how many.
    size = f"{most.value:.0f}" if most.unit.startswith("of ") else number(most.value)
    words = f"{size} {most.unit}: {worst.subject}, {worst.trial}"
    return name, f"{len(over)} of {len(with_value)}", words


def _outlier_words(outlier: Outlier) -> str:
    """Describe an outlier: "step width 0.3 m (median 0.1, score 5)"."""
    unit = "" if outlier.unit == "1" else f" {outlier.unit}"
    median = number(outlier.middle)
    score = number(outlier.score)
    return f"{outlier.quantity} {number(outlier.value)}{unit} (median {median}, score {score})"


def _described(study: StudyInput) -> list[Section]:
    if not study.described:
        return []
    unit = study.conditions[0].unit if study.conditions else "subjects"
    names = tuple(_title(condition) for condition in study.conditions)
    of_strides = ("stride ", "speed", "duty", "track")
    first = [
        described for described in study.described if described.quantity.startswith(of_strides)
    ]
    rest = [described for described in study.described if described not in first]
    which = f"{len(rest)} others" if first else str(len(rest))
    parts = ((first, "Strides", False), (rest, f"All {which}", True))
    grids = tuple(
        Grid(
            head=("Quantity", *names),
            rows=tuple(map(_described_row, part)),
            title=title,
            folded=folded,
        )
        for part, title, folded in parts
    )
    each = (
        "subjects, each the mean of its trials"
        if unit == "subjects"
        else "trials: there is one subject"
    )
    lead = f"Mean ± standard deviation of {each}."
    return [Section("values", "Values", lead, grids=grids)]


def _described_row(described: Described) -> tuple[str, ...]:
    unit = "" if described.unit == "1" else f" [{described.unit}]"
    words = (group_page.mean_words(words) if words[2] else "–" for words in described.conditions)
    return f"{described.quantity}{unit}", *words


def _differences(study: StudyInput) -> list[Section]:
    """Values that differ most beside what is open, with the draws' errors in their intervals."""
    grids = []
    for pair in dict.fromkeys(
        (difference.first, difference.second) for difference in study.differences
    ):
        known = [
            each
            for each in study.differences
            if (each.first, each.second) == pair and each.high_all > each.low_all
        ]
        known.sort(key=lambda each: -abs(each.difference) / (each.high_all - each.low_all))
        rows = tuple(map(_difference_row, known[:MAX_VALUES]))
        head = (
            "Quantity",
            pair[0],
            pair[1],
            "Difference",
            "95 %, spread alone",
            "95 %, with errors",
            "SD of errors",
        )
        if rows:
            grids.append(Grid(head, rows, " minus ".join(pair)))
    if not grids:
        return []
    lead = (
        "Differences whose errors were drawn, those that are largest beside their interval first;"
        " value_differences.csv has all. Errors that a subject's trials share cancel as far as both"
        " conditions have them. The spread of several subjects holds the errors of each; that of"
        " one subject's trials does not hold what they share, which is added."
    )
    return [Section("differences", "Differences with their errors", lead, grids=tuple(grids))]


def _difference_row(difference: ValueDifference) -> tuple[str, ...]:
    unit = "" if difference.unit == "1" else f" [{difference.unit}]"
    spread = (
        f"{number(difference.low)} to {number(difference.high)}"
        if np.isfinite(difference.low)
        else "–"
    )
    whole = f"{number(difference.low_all)} to {number(difference.high_all)}"
    means = (number(value) for value in (*difference.means, difference.difference))
    return f"{difference.quantity}{unit}", *means, spread, whole, number(difference.measured_sd)


def _family(study: StudyInput, family: str) -> Section:
    names = group_page.ordered(study.conditions, family)
    figures = [
        Figure(
            group_page.condition_chart(study.conditions, family, name),
            folded=name if index >= MAX_OPEN else "",
        )
        for index, name in enumerate(names[: MAX_OPEN + MAX_FOLDED])
    ]
    with_curves = [condition for condition in study.conditions if family in condition.curves]
    words = {True: "strides, from foot strike to foot strike", False: "whole trials"}
    cycles = list(dict.fromkeys(words[condition.cycle == "stride"] for condition in with_curves))
    units = " and ".join(dict.fromkeys(condition.unit for condition in with_curves))
    lead = (
        f"Over {' or '.join(cycles)}. Lines are means of {units}, bands their 95 % intervals sample"
        " by sample, faint bands ± one standard deviation."
    )
    if len(names) > MAX_OPEN + MAX_FOLDED:
        lead += f" {len(names) - MAX_OPEN - MAX_FOLDED} more are in condition_curves.csv."
    # A percent of a stride is not a percent of a trial: curves that share a chart say which they
    # are over.
    over = {True: " (over the stride)", False: " (over the whole trial)"} if len(cycles) > 1 else {}
    legend = [
        (style, _title(condition) + over.get(condition.cycle == "stride", ""))
        for style, condition in group_page.styled(study.conditions)
    ]
    return group_page.curve_section(
        group_page.name_and_unit(family)[0], lead, tuple(legend), figures
    )


def _comparison(comparison: Comparison, index: int, study: StudyInput) -> Section:
    first, second = comparison.names
    colors = {condition.name: style for style, condition in group_page.styled(study.conditions)}
    styles = colors[first], colors[second]
    lead = _lead(comparison, len(study.comparisons))
    figures = []
    if any(np.isfinite(scalar.g) for scalar in comparison.scalars):
        lead += _least_p(comparison)
        figures.append(group_page.effect_figure(comparison))
    grids = [group_page.scalar_grid(comparison)] if comparison.scalars else []
    for family in comparison.families:
        curves = group_page.different_first(comparison.family(family))
        name, unit = group_page.name_and_unit(family)
        different = [curve for curve in curves if curve.regions]
        drawn = (
            group_page.difference_chart(curve, unit, comparison.names, styles)
            for curve in different
        )
        figures += [Figure(chart) for chart in islice(drawn, MAX_DIFFERENT)]
        grids.append(
            group_page.curve_grid(curves, f"{name}: {len(different)} of {len(curves)} differ")
        )
    return Section(
        key=f"pair-{index + 1}",
        title=f"{first} and {second}",
        lead=lead,
        legend=tuple(zip(styles, comparison.names, strict=True)),
        figures=tuple(figures),
        grids=tuple(grids),
    )


def _lead(comparison: Comparison, pairs: int) -> str:
    """Write how two conditions are compared, beside so many pairs."""
    first, second = comparison.names
    lead = f"Differences are {first} minus {second}. "
    if comparison.paired:
        lead += (
            f"{len(comparison.animals[0])} subjects have both and are compared within themselves;"
            " the effect size is the mean difference over the standard deviation of differences. "
        )
    else:
        counts = " and ".join(str(len(animal)) for animal in comparison.animals)
        lead += f"No subject has both: groups of {counts} subjects; the effect size is Hedges’ g. "
    lead += _test(comparison, pairs)
    return " ".join([lead, *(f"{note[:1].upper()}{note[1:]}." for note in comparison.notes)])


def _test(comparison: Comparison, pairs: int) -> str:
    """Write how the differences are tested, if they are."""
    if not comparison.tested:
        return "Too few subjects for a test: described only."
    how = "all" if comparison.exact else f"{comparison.options.permutations} random"
    turned = "sign changes of the differences" if comparison.paired else "permutations of subjects"
    text = f"Tested by {how} {turned}; smallest possible p {number(comparison.floor)}. "
    text += f"Bars below mark where curves differ (p < {number(comparison.options.alpha)}"
    text += f", which is 0.05 over {pairs} pairs of conditions" if pairs > 1 else ""
    return text + (
        "; corrected for the whole cycle and all curves of a kind by the maximum statistic)."
    )


def _least_p(comparison: Comparison) -> str:
    """Warn where Holm's p of the parameters cannot become small enough; else ""."""
    least = comparison.floor * sum(np.isfinite(scalar.p) for scalar in comparison.scalars)
    if not (comparison.tested and least > comparison.options.alpha):
        return ""
    return (
        " So few subjects cannot bring Holm’s p of that many parameters below"
        f" {number(min(least, 1.0))}."
    )


def _outliers(study: StudyInput) -> list[Section]:
    if not study.outliers:
        return []
    by_trial = grouped(((outlier.subject, outlier.trial), outlier) for outlier in study.outliers)
    rows = []
    for lines in sorted(
        by_trial.values(), key=lambda each: -max(abs(outlier.score) for outlier in each)
    ):
        lines.sort(key=lambda outlier: -abs(outlier.score))
        words = "; ".join(map(_outlier_words, lines[:MAX_LISTED]))
        rows.append((lines[0].subject, lines[0].trial, lines[0].condition, str(len(lines)), words))
    lead = (
        "Values whose modified z-score, 0.6745 (x − median) / median absolute deviation, in the"
        f" trials of a condition is beyond {OUTLIER_SCORE:g}; curves by their distance to the mean"
        " of the condition. Outliers are to be inspected: nothing is excluded because of them. All"
        " are in outliers.csv."
    )
    grid = Grid(
        head=("Subject", "Trial", "Condition", "Values", "Most extreme"),
        rows=tuple(rows),
        title="",
        folded=len(rows) > LONG,
    )
    return [Section("outliers", "Outliers", lead, grids=(grid,))]


def _trials(study: StudyInput) -> list[Section]:
    limits = tuple(title for _, title in SHOWN_LIMITS)
    head = (
        "Subject",
        "Trial",
        "Condition",
        "Steps",
        "Frames",
        *limits,
        "Unsolved",
        "Over limits",
        "Warnings",
    )
    done = study.in_state("done")
    if not done:
        return []
    rows = tuple(_trial_row(trial) for trial in done)
    lead = (
        "Names of trials link to their reports. Markers: RMS of the worst frame; residuals and"
        " reserves: peaks."
    )
    grid = Grid(head=head, rows=rows, title=f"{len(rows)} trials", folded=len(rows) > 4 * LONG)
    return [Section("trials", "All trials", lead, grids=(grid,))]


def _trial_row(trial: TrialLine) -> tuple[str | Link, ...]:
    cells = []
    for quantity, _ in SHOWN_LIMITS:
        judged = trial.judged.get(quantity)
        cells.append(
            "" if judged is None else f"{number(judged.value)} {judged.unit.partition(' ')[0]}"
        )
    unsolved = [trial.judged[name].value for name in UNSOLVED if name in trial.judged]
    return (
        trial.subject,
        Link(trial.trial or "(model)", trial.report) if trial.report else trial.trial or "(model)",
        trial.condition,
        " ".join(trial.steps),
        str(trial.frames) if trial.frames else "",
        *cells,
        f"{sum(unsolved):.0f}" if unsolved else "",
        str(trial.over) if trial.judged else "",
        str(trial.warnings) if trial.warnings else "",
    )


def _files(study: StudyInput) -> list[Section]:
    if not study.files:
        return []
    rows = tuple((Link(place, place), words) for place, words in study.files)
    return [
        Section("files", "Tables", "Beside this page.", grids=(Grid(("File", "Content"), rows),))
    ]
