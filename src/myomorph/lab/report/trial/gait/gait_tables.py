"""Tables of the gait page: parameters, extremes of the curves, scores."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from myomorph.core.model.interval import Interval
from myomorph.lab.analysis.gait_curves import (
    ANGLES,
    SIDES,
    VARIABLES,
    GaitCurves,
    GaitVariable,
)
from myomorph.lab.analysis.gait_extremes import EXTREMES, gait_extremes
from myomorph.lab.analysis.gait_parameters import UNITS, ParameterTable
from myomorph.lab.analysis.gait_scores import BOTH, GaitNorm, GaitScores
from myomorph.lab.analysis.stride_spread import MIN_STRIDES, StrideSpread
from myomorph.lab.report.charts.axis import number
from myomorph.lab.report.page.parts import Grid

UNKNOWN = "–"
NO_BREAK = "\u00a0"


def spread_words(spread: StrideSpread | None) -> str:
    """Write a mean with its standard deviation and number of strides: "1.21 ± 0.03 (12)".

    One stride has neither: "1.21 (1)".
    """
    if spread is None or not np.isfinite(spread.mean):
        return UNKNOWN
    step = _step(spread)
    value = number(spread.mean, step)
    deviation = f"{NO_BREAK}±{NO_BREAK}{number(spread.sd, step)}" if np.isfinite(spread.sd) else ""
    return f"{value}{deviation} ({spread.count})"


def _step(spread: StrideSpread) -> float | None:
    """Return the step of printed digits, None where nothing spreads.

    Two digits of the standard deviation are printed, but no more than four of the mean.
    """
    if not spread.sd > 0.0:
        return None
    of_sd = np.floor(np.log10(spread.sd)) - 1.0
    of_mean = np.floor(np.log10(max(abs(spread.mean), spread.sd))) - 3.0
    return float(10.0 ** max(of_sd, of_mean))


def interval_words(spread: StrideSpread | None) -> str:
    """Write the interval of a mean: "1.19 to 1.23"; a dash for few strides."""
    if spread is None or not np.isfinite(spread.low):
        return UNKNOWN
    step = _step(spread)
    return f"{number(spread.low, step)} to {number(spread.high, step)}"


def parameter_grid(parameters: ParameterTable, norm: GaitNorm | None) -> Grid | None:
    """Return spatio-temporal parameters of both sides; None where there are none."""
    rows = []
    for name, sides in parameters.items():
        if not sides:
            continue
        row = (f"{name} [{UNITS[name]}]", *_cells(sides))
        if norm is not None:
            row = (*row, _usual(norm, name))
        rows.append(row)
    if not rows:
        return None
    head = _head("Parameter", rows)
    last = () if norm is None else ("Norm",)
    return Grid((*head, *last), _without_intervals(rows, head), "Spatio-temporal parameters")


def extreme_grid(curves: GaitCurves, variables: Sequence[GaitVariable]) -> Grid | None:
    """Return largest and smallest values and ranges of curves; None where none is known."""
    tables = {side: gait_extremes(curves, side) for side in SIDES}
    rows = []
    for variable in variables:
        for extreme in EXTREMES:
            spreads = {
                side: table[variable.key, extreme]
                for side, table in tables.items()
                if (variable.key, extreme) in table
            }
            if spreads:
                rows.append((f"{variable.title}, {extreme} [{variable.unit}]", *_cells(spreads)))
    if not rows:
        return None
    head = _head("Of each stride", rows)
    return Grid(head, _without_intervals(rows, head), "Extremes of the curves")


def _cells(spreads: Mapping[str, StrideSpread]) -> tuple[str, ...]:
    """Return means of both sides, then their intervals."""
    means = [spread_words(spreads.get(side)) for side in SIDES]
    intervals = [interval_words(spreads.get(side)) for side in SIDES]
    return (*means, *intervals)


def _head(first: str, rows: Sequence[tuple[str, ...]]) -> tuple[str, ...]:
    """Return the heading; without columns of intervals where no row has one."""
    means = (first, "Right, mean ± SD (n)", "Left, mean ± SD (n)")
    if all(row[3] == row[4] == UNKNOWN for row in rows):
        return means
    return (*means, "Right, 90 % of the mean", "Left, 90 % of the mean")


def _without_intervals(
    rows: Sequence[tuple[str, ...]], head: tuple[str, ...]
) -> tuple[tuple[str, ...], ...]:
    """Return the rows; without columns of intervals where the heading has none."""
    if len(head) > 3:
        return tuple(rows)
    return tuple((*row[:3], *row[5:]) for row in rows)


def _usual(norm: GaitNorm, name: str) -> str:
    """Write what a norm has of a parameter, "" for nothing."""
    known = norm.parameters.get(name)
    if known is None:
        return ""
    return f"{number(known[0])}{NO_BREAK}±{NO_BREAK}{number(known[1])}"


def score_grid(scores: GaitScores | None, norm: GaitNorm | None) -> Grid | None:
    """Return scores against a norm, by the names of Baker et al. where they are what these name.

    These are movement analysis profile, gait profile score and GDI*: of nine angles, with their
    offsets. Of fewer angles, or of their shape alone, they are differences from the norm.
    """
    if scores is None or norm is None:
        return None
    keys = {key for _, key in scores.profile}
    known = [variable for variable in VARIABLES[:ANGLES] if variable.key in keys]
    rows = [
        (each.title, *(_score_words(scores.profile.get((side, each.key))) for side in SIDES))
        for each in known
    ]
    title = f"Root mean square of {scores.variables} angles"
    scaled_title = "Scaled difference"
    caption = "Difference from the norm"
    if scores.is_gait_profile_score:
        title = "Gait profile score"
        scaled_title = "Scaled score (GDI*)"
        caption = "Movement analysis profile"
    rows.append((title, *(_score_words(scores.score[side]) for side in SIDES)))
    rows.append((f"{title}, both sides", _score_words(scores.score[BOTH]), ""))
    if scores.scaled:
        scaled = [_score_words(scores.scaled[side]) for side in SIDES]
        rows.append((f"{scaled_title}, 100 ± 10", *scaled))
        rows.append((f"{scaled_title}, both sides", _score_words(scores.scaled[BOTH]), ""))
    what = "Difference from the norm"
    if not scores.offsets:
        what = "Difference in shape, without offsets"
    return Grid((f"{what}, RMS [°]", "Right", "Left"), tuple(rows), caption)


def _score_words(estimate: Interval | None) -> str:
    """Write a score with its interval: "5.1 (4.2–6.3)"."""
    if estimate is None or not np.isfinite(estimate.value):
        return UNKNOWN
    if not np.isfinite(estimate.low):
        return number(estimate.value)
    return f"{number(estimate.value)} ({number(estimate.low)}–{number(estimate.high)})"


def interval_note(strides: int) -> str:
    """Say what intervals of means are, or from how many strides on there are any."""
    if strides < MIN_STRIDES:
        return f"Intervals of means are given from {MIN_STRIDES} strides of a side on."
    return (
        "SD: between strides. 90 % of the mean: by Student's t, for strides that do not depend on"
        " each other; no error of measurement is in it."
    )
