"""One A4 page on a walk for the clinic: curves of both sides in bands of a norm, scores,
spatio-temporal parameters.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.interval import Interval
from myomorph.lab.analysis.cycles import band
from myomorph.lab.analysis.gait_curves import (
    ANGLES,
    KEYS,
    SIDES,
    VARIABLES,
    GaitCurves,
    GaitVariable,
)
from myomorph.lab.analysis.gait_parameters import UNITS, gait_parameters
from myomorph.lab.analysis.gait_scores import LEVEL, GaitNorm, GaitScores, gait_scores
from myomorph.lab.report.charts.axis import number
from myomorph.lab.report.charts.curves import CycleCurve, cycle_chart
from myomorph.lab.report.page.page import page_text
from myomorph.lab.report.page.parts import Grid
from myomorph.lab.report.trial.prepared import Prepared

GAIT_PAGE = "gait.html"
HEIGHT = 152  # Of a chart, so that six rows of them stand on the page
MIN_SPAN = {"angle": 20.0, "moment": 0.5, "power": 1.0, "force": 1.0}
"""What a chart shows at least, so that small differences look small."""


def gait_page(prepared: Prepared, curves: GaitCurves, norm: GaitNorm | None, note: str = "") -> str:
    """The page as HTML text that needs nothing else; a browser prints it on one sheet. `note`: why
    there is no norm.
    """
    errors = prepared.results.uncertainty.gait or None
    scores = None if norm is None else gait_scores(curves, norm, errors)
    charts = tuple(
        _chart(index, variable, curves, norm, errors) for index, variable in enumerate(VARIABLES)
    )
    head = prepared.results.head
    facts = [("Strides", ", ".join(f"{len(curves.strides[side])} {side}" for side in SIDES))]
    facts += [
        *prepared.results.recorded.facts.items(),
        ("Date", head.date[:10]),
        ("Myomorph", head.version),
    ]
    return page_text(
        "gait.html.j2",
        head=head,
        facts=facts,
        charts=[chart for chart in charts if chart],
        legend=_legend(norm, errors, curves),
        grids=[
            grid
            for grid in (_parameters(prepared, norm), _scores(scores, norm))
            if grid is not None
        ],
        notes=_notes(prepared, curves, norm, note, scores),
    )


def _chart(
    index: int,
    variable: GaitVariable,
    curves: GaitCurves,
    norm: GaitNorm | None,
    errors: Mapping[str, Array] | None,
) -> str:
    """Both sides over the norm, "" where neither is known."""
    drawn = []
    lift = []
    if norm is not None and np.isfinite(norm.mean[:, index]).any():
        mean = norm.mean[:, index]
        deviation = norm.deviation[:, index]
        drawn.append(
            CycleCurve(
                mean=mean, style="norm", label="norm", interval=(mean - deviation, mean + deviation)
            )
        )
    known = False
    for side in SIDES:
        mean = curves.mean(side)[:, index]
        if not np.isfinite(mean).any():
            continue
        known = True
        limits = _limits(
            curves.of(side)[:, :, index], None if errors is None else errors[side][:, :, index]
        )
        drawn.append(CycleCurve(mean=mean, style=side, label=side, interval=limits))
        duties = [stride.duty for stride in curves.strides[side] if np.isfinite(stride.duty)]
        lift += [(100.0 * float(np.mean(duties)), side)] if duties else []
    if not known:
        return ""
    shown = [part for curve in drawn for part in (curve.mean, *(curve.interval or ()))]
    finite = np.concatenate([part[np.isfinite(part)] for part in shown])
    middle = 0.5 * (finite.min() + finite.max())
    half = 0.5 * MIN_SPAN[variable.kind]
    shown.append(np.array([middle - half, middle + half]))
    return cycle_chart(variable.title, variable.unit, drawn, shown, height=HEIGHT, upright=lift)


def _limits(strides: Array, errors: Array | None) -> tuple[Array, Array] | None:
    """Interval of 90 % of a mean curve: of draws, else of the strides; None for a single stride
    without draws.
    """
    if errors is not None and np.isfinite(errors).any():
        mean = band(strides).mean
        low, high = np.nanquantile(errors, (0.5 - 0.5 * LEVEL, 0.5 + 0.5 * LEVEL), axis=0)
        return mean + low, mean + high
    limits = band(strides, LEVEL)
    return (limits.low, limits.high) if np.isfinite(limits.low).any() else None


def _legend(
    norm: GaitNorm | None, errors: Mapping[str, Array] | None, curves: GaitCurves
) -> list[tuple[str, str]]:
    legend = [("right", "right"), ("left", "left")]
    if errors is not None:
        legend.append(("band", "90 % of the draws of errors"))
    elif max(len(strides) for strides in curves.strides.values()) > 1:
        legend.append(("band", "90 % interval of the mean over the strides"))
    return legend if norm is None else [*legend, ("norm", "norm, mean ± 1 SD")]


def _parameters(prepared: Prepared, norm: GaitNorm | None) -> Grid | None:
    if prepared.strides is None:
        return None
    rows = []
    for name, sides in gait_parameters(prepared.strides).items():
        if sides:
            usual = None if norm is None else norm.parameters.get(name)
            of_norm = "" if usual is None else f"{number(usual[0])} ± {number(usual[1])}"
            row = (f"{name} [{UNITS[name]}]", *(_words(sides.get(side)) for side in SIDES))
            rows.append(row if norm is None else (*row, of_norm))
    head = ("Parameter", "Right", "Left")
    return Grid(
        head if norm is None else (*head, "Norm"), tuple(rows), "Spatio-temporal parameters"
    )


def _scores(scores: GaitScores | None, norm: GaitNorm | None) -> Grid | None:
    """Movement analysis profile and gait profile score, of which Baker et al. give the names."""
    if scores is None or norm is None:
        return None
    keys = {key for _, key in scores.profile}
    known = [variable for variable in VARIABLES[:ANGLES] if variable.key in keys]
    rows = [
        (each.title, *(_words(scores.profile.get((side, each.key))) for side in SIDES))
        for each in known
    ]
    title = f"Gait profile score of {scores.variables} variables"
    rows.append((title, *(_words(scores.score[side]) for side in SIDES)))
    rows.append(("Gait profile score, both sides", _words(scores.score["both"]), ""))
    if scores.scaled:
        rows.append(
            ("Scaled score (GDI*), 100 ± 10", *(_words(scores.scaled[side]) for side in SIDES))
        )
    what = (
        "Difference from the norm"
        if norm.same_definitions
        else "Difference in shape, without offsets"
    )
    return Grid((f"{what}, RMS [°]", "Right", "Left"), tuple(rows), "Movement analysis profile")


def _words(estimate: Interval | None) -> str:
    """A value with its interval: "5.1 (4.2–6.3)"."""
    if estimate is None or not np.isfinite(estimate.value):
        return "–"
    if not np.isfinite(estimate.low):
        return number(estimate.value)
    return f"{number(estimate.value)} ({number(estimate.low)}–{number(estimate.high)})"


def _notes(
    prepared: Prepared,
    curves: GaitCurves,
    norm: GaitNorm | None,
    note: str,
    scores: GaitScores | None,
) -> list[str]:
    """Context of the page: who the norm is, what is missing, and the report's warnings."""
    notes = []
    if norm is not None:
        persons = f"; {norm.persons} persons" if norm.persons else ""
        notes.append(f"Norm: {norm.source}{persons}.")
    notes += [note] if note else []
    if norm is not None:
        if not norm.same_definitions:
            text = (
                "The norm has the marker set and angles of another laboratory: offsets of pelvis"
                " and hip by ten or"
            )
            notes.append(
                f"{text} twenty degrees are definitions. Scores are of shape, not those of the"
                " literature."
            )
        means = zip(VARIABLES[:ANGLES], norm.mean.T, strict=False)
        absent = [variable.title for variable, mean in means if not np.isfinite(mean).any()]
        notes += [f"The norm lacks: {'; '.join(absent)}."] if absent else []
    for side in SIDES:
        whole = len(curves.strides[side])
        count = int(np.isfinite(curves.of(side)[:, 0, KEYS.index("knee_moment")]).sum())
        if count < whole:
            part = f"moments of {count} of {whole} strides"
            notes.append(f"{side.capitalize()}: {part}, those whose foot stood on a plate.")
    if scores is not None and not scores.scaled:
        notes.append(
            "No scaled score (GDI*): it takes a control group of five or more (--norms FOLDER)."
        )
    head = prepared.results.head
    notes += [
        f"{part.kind.capitalize()}: {part.text}" for part in head.notes if part.kind == "simulated"
    ]
    over = sum(verdict.state == "over" for verdict in prepared.verdicts)
    if over or head.warnings:
        notes.append(
            f"report.html has {over} quantities over their limits and {len(head.warnings)}"
            " warnings."
        )
    return notes
