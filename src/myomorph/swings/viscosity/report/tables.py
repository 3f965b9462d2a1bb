"""Tables I and II of the swing experiment as [S] prints them.

The cohort stands beside the paper and the truth.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np

from myomorph.core.model.interval import Interval
from myomorph.lab.report.charts.axis import number
from myomorph.lab.report.page.parts import Grid, Section
from myomorph.swings.viscosity.cohort import (
    MEAN,
    QUANTITIES,
    SD,
    SPECIMENS,
    STROEVE_TOTAL_VISCOSITY,
    CohortLine,
    Quantity,
)
from myomorph.swings.viscosity.report.specimen_report import SpecimenReport

TITLES = {
    1: "Table I: joint parameters of specimens without muscles",
    2: "Table II: joint parameters of specimens with muscles",
}
COLUMNS = {
    1: ("mass_muscles_removed", "com_muscles_removed", "joint_viscosity"),
    2: (
        "mass_intact",
        "estimated_muscle_mass",
        "measured_muscle_mass",
        "com_intact",
        "total_viscosity",
        "muscle_viscosity",
    ),
}
"""In the order of [S]."""

BY_NAME = {one.name: one for one in QUANTITIES}
LACKING = "–"


def scientific(value: float) -> str:
    """Print a value with three digits and its power of ten, as [S] does: 5.33E-02."""
    return f"{value:.2E}" if np.isfinite(value) else LACKING


def with_interval(estimate: Interval | None) -> str:
    """Print a value and its interval, to the digits that the interval's width leaves.

    Of what is known as a range alone the range is printed.
    """
    if estimate is None:
        return LACKING
    if not np.isfinite(estimate.value) and np.isfinite(estimate.high):
        return span(estimate.low, estimate.high)
    if not estimate.high > estimate.low:
        return number(estimate.value)
    return (
        f"{_to(estimate.value, estimate.high - estimate.low)} ({span(estimate.low, estimate.high)})"
    )


def span(low: float, high: float) -> str:
    """Print an interval, to two digits of its width."""
    return f"{_to(low, high - low)} to {_to(high, high - low)}"


def _to(value: float, width: float) -> str:
    """Print a value to the second digit of a width."""
    if not (np.isfinite(value) and width > 0.0):
        return number(value)
    return number(value, 10.0 ** (np.floor(np.log10(width)) - 1))


def table_section(specimens: Sequence[SpecimenReport], lines: Mapping[str, CohortLine]) -> Section:
    """Show tables I and II, their means beside those of paper, literature and truth."""
    grids = [_table(specimens, lines, table, _printed) for table in (1, 2)]
    grids.append(_means(specimens, lines))
    grids += [_table(specimens, lines, table, with_interval) for table in (1, 2)]
    grids += [grid for grid in (truth_grid(specimens),) if grid is not None]
    lead = (
        "COM is the distance of the mass center from the glenohumeral center. The joint viscosity"
        " is that without muscles, the total viscosity that with them, each one value over all"
        " axes; the muscle viscosity is one value for all muscles. The estimated muscles are the"
        " mass with less the mass without. The SD is that of the population, divided by the number"
        " of specimens, as the paper's is."
    )
    return Section(
        key="tables", title="Tables I and II", lead=lead, legend=(), figures=(), grids=tuple(grids)
    )


def _printed(estimate: Interval | None) -> str:
    if estimate is None:
        return LACKING
    if not np.isfinite(estimate.value) and np.isfinite(estimate.high):
        return f"{scientific(estimate.low)} to {scientific(estimate.high)}"
    return scientific(estimate.value)


def _table(
    specimens: Sequence[SpecimenReport],
    lines: Mapping[str, CohortLine],
    table: int,
    words: Callable[[Interval | None], str],
) -> Grid:
    """Print one of the two tables; as the paper prints it, its means stand below."""
    columns = [BY_NAME[name] for name in COLUMNS[table]]
    rows = [
        (specimen.name, *(words(specimen.row.get(column.name)) for column in columns))
        for specimen in specimens
    ]
    plain = words is _printed
    if plain:
        rows += _own_means(columns, lines)
        if any(specimen.shoulder for specimen in specimens):
            rows += _published_means(columns, table)
    head = ("specimen #", *(f"{column.label} [{column.unit}]" for column in columns))
    title = TITLES[table] + ("" if plain else ", with 95 % intervals")
    return Grid(head, tuple(rows), title, folded=not plain)


def _own_means(
    columns: Sequence[Quantity], lines: Mapping[str, CohortLine]
) -> list[tuple[str, ...]]:
    """Print mean and SD of columns."""
    known = [lines.get(column.name) for column in columns]
    means = (
        LACKING if line is None else _printed(Interval(line.mean, line.low, line.high))
        for line in known
    )
    spreads = (LACKING if line is None else scientific(line.sd) for line in known)
    return [("mean", *means), ("± SD", *spreads)]


def _published_means(columns: Sequence[Quantity], table: int) -> list[tuple[str, ...]]:
    """Print the paper's mean and SD of columns, and what else is known of living shoulders."""
    rows = [
        (name, *(scientific(float(getattr(printed, column.name))) for column in columns))
        for name, printed in (("paper: mean", MEAN), ("paper: ± SD", SD))
    ]
    if table == 2:
        stroeve = {"total_viscosity": scientific(STROEVE_TOTAL_VISCOSITY)}
        cells = (stroeve.get(column.name, "") for column in columns)
        rows.append(("literature: Stroeve 1999", *cells))
    return rows


def _means(specimens: Sequence[SpecimenReport], lines: Mapping[str, CohortLine]) -> Grid:
    """Print mean and SD of every quantity: truth where it is known, the paper, the estimate."""
    known = any(specimen.truth for specimen in specimens)
    shoulders = any(specimen.shoulder for specimen in specimens)
    rows = []
    for quantity in QUANTITIES:
        truths = [
            specimen.truth[quantity.name]
            for specimen in specimens
            if quantity.name in specimen.truth
        ]
        cells = _mean_cells(quantity, lines.get(quantity.name), truths)
        if not known:
            del cells["Truth"], cells["Truth in the interval"]
        if not shoulders:
            del cells["Paper's six"]
        rows.append(cells)
    title = "Means ± population SD"
    if shoulders:
        title += ": truth, paper and estimate" if known else " beside the paper's"
    elif known:
        title += ": truth and estimate"
    return Grid(tuple(rows[0]), tuple(tuple(row.values()) for row in rows), title)


def _mean_cells(
    quantity: Quantity, line: CohortLine | None, truths: Sequence[float]
) -> dict[str, str]:
    """Print mean and SD of a quantity, by the heads of the columns."""
    unknown = line is None or not np.isfinite(line.low) or line.high == line.low
    paper = [getattr(each, quantity.name) for each in SPECIMENS]
    return {
        "Quantity": f"{where(quantity)} [{quantity.unit}]",
        "Truth": _spread(truths),
        "Paper's six": _spread(paper),
        "Estimate": (
            LACKING
            if line is None or not np.isfinite(line.mean)
            else _plus_minus(line.mean, line.sd)
        ),
        "95 % interval of the mean": (
            LACKING if unknown or line is None else span(line.low, line.high)
        ),
        "Truth in the interval": _mean_held(line, truths),
        "Specimens": LACKING if line is None else str(line.count),
    }


def _mean_held(line: CohortLine | None, truths: Sequence[float]) -> str:
    """Say whether the interval of a mean holds that of the truths, "" where it is not known."""
    if line is None or len(truths) != line.count or not line.high > line.low:
        return ""
    truth = float(np.mean(truths))
    held = "yes" if line.low <= truth <= line.high else "no"
    return f"{held}, off by {_off(line.mean, truth)}" if np.isfinite(line.mean) else held


def _spread(values: Sequence[float]) -> str:
    return _plus_minus(float(np.mean(values)), float(np.std(values))) if len(values) else LACKING


def _plus_minus(mean: float, sd: float) -> str:
    """Print to three digits of the SD, as the paper does."""
    return f"{_to(mean, 0.1 * sd)} ± {_to(sd, 0.1 * sd)}" if sd > 0.0 else f"{number(mean)} ± 0"


def _off(value: float, truth: float) -> str:
    share = 100.0 * (value / truth - 1.0) if truth else float("nan")
    return f"{share:+.1f} %".replace("-", "−")


def where(quantity: Quantity) -> str:
    """Return a quantity's label that tells the two masses apart."""
    words = quantity.label
    if quantity.name.startswith(("mass_", "com_", "first_moment_")):
        words += ", without muscles" if quantity.table == 1 else ", with muscles"
    return words[:1].upper() + words[1:] if not words.startswith("COM") else words


def truth_grid(specimens: Iterable[SpecimenReport]) -> Grid | None:
    """Print truth, paper and estimate of every specimen; None where no truth is known."""
    rows = []
    for specimen in specimens:
        for quantity in QUANTITIES:
            if quantity.name not in specimen.truth and quantity.name not in specimen.paper:
                continue
            truth = specimen.truth.get(quantity.name)
            paper = specimen.paper.get(quantity.name)
            estimate = specimen.row.get(quantity.name)
            off = ""
            if estimate is not None and truth and np.isfinite(estimate.value):
                off = _off(estimate.value, truth)
            words = (LACKING if value is None else number(value) for value in (truth, paper))
            held = ""
            if estimate is not None and truth is not None and estimate.high > estimate.low:
                held = "yes" if estimate.holds(truth) else "no"
            label = f"{where(quantity)} [{quantity.unit}]"
            rows.append((specimen.name, label, *words, with_interval(estimate), off, held))
    if not rows:
        return None
    head = (
        "Specimen",
        "Quantity",
        "Truth",
        "Paper",
        "Estimate (95 % interval)",
        "Error",
        "Truth in it",
    )
    return Grid(head, tuple(rows), "Truth, paper and estimate, one by one", folded=True)
