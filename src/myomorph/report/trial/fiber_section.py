"""The section on fibers and tendons: lengths, strains and powers, and muscles whose tendons were taken as rigid."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from myomorph.analysis.selection import Pair, major_muscles
from myomorph.model.arrays import Array
from myomorph.report.charts.axis import number
from myomorph.report.charts.curves import Line, time_plot
from myomorph.report.page.parts import Figure, Grid, Section
from myomorph.report.trial.prepared import Prepared
from myomorph.report.trial.report_input import ShownTension
from myomorph.tension.fibers import Fibers

STYLES = ("first", "second")
HEAD = ("Muscle", "From", "Normalized fiber length", "Reason")
SHOWN = 8  # Pairs of muscles that are drawn.


def fiber_section(prepared: Prepared) -> Section | None:
    """Normalized fiber lengths, tendon strains, and powers of fiber and tendon of the major muscles."""
    tension = prepared.results.tension
    if tension is None or tension.fibers is None or not len(tension.time) or prepared.results.model is None:
        return None
    fibers = tension.fibers
    mean = np.nan_to_num(tension.forces).mean(axis=0)
    elastic = [name for name in tension.muscles if name not in fibers.rigid]
    by_name = dict(zip(tension.muscles, mean, strict=True))
    pairs = major_muscles(elastic, np.array([by_name[name] for name in elastic]))[:SHOWN] if elastic else ()
    figures = tuple(Figure(chart) for pair in pairs for chart in _charts(prepared, tension, fibers, pair))
    lead = (
        "Fibers and tendons as elastic tendons let them move. A tendon's power is positive where it gives back what it "
        "stored. Thin lines: frames near an end, where what came before or comes after can be felt."
    )
    certificate = fibers.certificate
    lead += f" Optimality conditions hold within {number(certificate.residual)}"
    if np.isfinite(certificate.second_activations):
        lead += f"; another start ends {number(certificate.second_activations)} away in activation"
    lead += "."
    if fibers.bridged.any():
        lead += f" In {int(fibers.bridged.sum())} frames torques or coordinates were missing and interpolated."
    legend = (("first", "right, or fiber"), ("second", "left, or tendon"))
    return Section("fibers", "Fibers and tendons", lead, legend, figures, _grids(tension, fibers))


def _charts(prepared: Prepared, tension: ShownTension, fibers: Fibers, pair: Pair) -> Iterator[str]:
    """Length and strain of both sides, and powers of the first."""
    model = prepared.results.model
    assert model is not None
    columns = [(names[0], tension.muscles.index(names[0])) for names in pair.members.values()][: len(STYLES)]
    optimal = [model.muscle(name).optimal_fiber_length for name, _ in columns]
    normal = [fibers.lengths[:, m] / optimum for (_, m), optimum in zip(columns, optimal, strict=True)]
    strains = [100.0 * fibers.tendon_strains[:, m] for _, m in columns]
    names = [name for name, _ in columns]
    first, at = columns[0]
    powers = [fibers.fiber_powers[:, at], fibers.tendon_powers[:, at]]
    charts = (
        # Longer headings, "Biceps femoris, long head: fiber length", run into that of the chart beside.
        (f"{pair.label}: fiber", "optimal lengths", normal, names, 1.0),
        (f"{pair.label}: tendon strain", "%", strains, names, 0.0),
        (f"{first}: power", "W", powers, ["fiber", "tendon"], 0.0),
    )
    for title, unit, values, labels, low in charts:
        lines = _lines(tension.time, values, labels, fibers.transient)
        yield time_plot(title, unit, lines, prepared.detail, prepared.events, low=low)


def _lines(time: Array, values: list[Array], labels: list[str], ends: np.ndarray) -> list[Line]:
    """Lines of what may be believed, and thinner ones of the ends."""
    result = []
    for value, label, style in zip(values, labels, STYLES, strict=False):
        result.append(Line(time, np.where(ends, np.nan, value), style, label))
        if ends.any():
            # One frame more on the inner side, so that the lines meet.
            wide = ends.copy()
            wide[1:] |= ends[:-1]
            wide[:-1] |= ends[1:]
            result.append(Line(time, np.where(wide, value, np.nan), f"{style} thin", f"{label}, near an end"))
    return result


def _grids(tension: ShownTension, fibers: Fibers) -> tuple[Grid, ...]:
    """Muscles on rigid tendons: those that cannot reach with place and size, the others by name."""
    rows = []
    for unreachable in fibers.unreachable:
        why = "path shorter than the slack tendon" if unreachable.worst <= 0.0 else "fibers too long"
        rows.append(
            (unreachable.muscle, f"{number(tension.time[unreachable.frame], 0.001)} s", number(unreachable.worst), why)
        )
    cannot = {unreachable.muscle for unreachable in fibers.unreachable}
    rows += [(name, "", "", "rigid in the model, or without curves") for name in fibers.rigid if name not in cannot]
    return (Grid(HEAD, tuple(rows), "Muscles on rigid tendons", len(rows) > 12),) if rows else ()
