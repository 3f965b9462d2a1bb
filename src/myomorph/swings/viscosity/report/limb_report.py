"""The part of the page on a relaxed living limb, and its rows of `limbs.csv`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.series import Event
from myomorph.lab.report.charts.axis import number
from myomorph.lab.report.charts.curves import Line, TimeLook, time_plot
from myomorph.lab.report.page.parts import Figure, Grid, Section
from myomorph.swings.viscosity.relaxed.identify import UNITS, LimbResult, swung
from myomorph.swings.viscosity.report.specimen_report import DropCurves, LimbReport
from myomorph.swings.viscosity.report.tables import LACKING, with_interval

LABELS = {
    "viscosity": "Viscosity",
    "stiffness": "Stiffness",
    "zero_torque": "Torque at angle 0",
    "rest_angle": "Rest angle of the spring",
    "coulomb": "Dry friction",
}
SOURCES = ("swings", "mass", "mass center", "inertia")
COLUMNS = (
    "coordinate",
    "quantity",
    "value",
    "low",
    "high",
    "unit",
    *(f"sd of {source}" for source in SOURCES),
)


def limb_report(name: str, coordinate: str, result: LimbResult, notes: Sequence[str]) -> LimbReport:
    """Collect what is shown of an identified limb."""
    curves = []
    for drop, fitted in zip(result.drops, swung(result), strict=True):
        part = slice(max(int(drop.turns[0]) - 20, 0), int(drop.turns[-1]) + 1)
        time = drop.equation.time
        curves.append(
            DropCurves(
                name=drop.name,
                time=time[part],
                measured=drop.measured[part],
                fitted=fitted[part],
                turns=time[drop.turns],
            )
        )
    laws = {
        " + ".join(terms): float(verdict.rms(verdict.estimate)[0])
        for terms, verdict in result.held_out.items()
    }
    errors = FrozenMap({source: FrozenMap(dict(of)) for source, of in result.shares.items()})
    chosen = " + ".join(result.fit.terms)
    alike = tuple(" + ".join(terms) for terms in result.alike)
    row = FrozenMap(dict(result.estimates))
    return LimbReport(
        name=name,
        coordinate=coordinate,
        row=row,
        errors=errors,
        laws=FrozenMap(laws),
        chosen=chosen,
        alike=alike,
        drops=tuple(curves),
        notes=tuple(notes),
    )


def limb_rows(limb: LimbReport) -> Iterator[tuple[object, ...]]:
    """Yield the rows of `limbs.csv`.

    A row has a quantity, its value, interval, unit and the standard deviation that each source
    adds.
    """
    for name, value in limb.row.items():
        spread = (limb.errors.get(source, {}).get(name, "") for source in SOURCES)
        yield limb.coordinate, name, value.value, value.low, value.high, UNITS[name], *spread


def limb_section(limb: LimbReport, order: int) -> Section:
    """Show values, laws and drops of a limb."""
    head = ["Quantity", "Value (95 % interval)", *(f"SD: {source}" for source in SOURCES)]
    rows = []
    for name, value in limb.row.items():
        spread = (
            number(limb.errors[source][name]) if source in limb.errors else LACKING
            for source in SOURCES
        )
        rows.append([f"{LABELS[name]} [{UNITS[name]}]", with_interval(value), *spread])
        if limb.truth:
            rows[-1].append(number(limb.truth[name]) if name in limb.truth else LACKING)
    grids = [
        Grid(
            (*head, *(["Truth"] if limb.truth else [])),
            tuple(map(tuple, rows)),
            f"Passive torque at {limb.coordinate}",
        )
    ]
    laws = tuple(
        (law + (" (chosen)" if law == limb.chosen else ""), f"{number(float(np.rad2deg(error)))}°")
        for law, error in limb.laws.items()
    )
    grids.append(
        Grid(
            ("Law", "Error of held-out swings"),
            laws,
            "Laws of the passive torque, the simplest first",
        )
    )
    lead = (
        "The passive torque is what the joint supplies beyond gravity and inertia of the model's"
        " bodies; forces of the model's muscles, passive ones included, are no part of either and"
        " so are in it. The simplest law is chosen whose error is near the least. The mass, its"
        " center and its inertia are the model's: intervals hold their errors, as the standard"
        " deviations show."
    )
    legend = (("measured", "measured"), ("first", "swung by the chosen law; a gap is left out"))
    figures = tuple(Figure(drop_plot(drop), "full") for drop in limb.drops)
    return Section(
        key=f"limb-{order}",
        title=f"Limb {limb.name}",
        lead=lead,
        legend=legend,
        figures=figures,
        grids=tuple(grids),
    )


def drop_plot(drop: DropCurves) -> str:
    """Draw the angle of a drop, measured and swung by the law, with a line at every second turn."""
    lines = [
        Line(time=drop.time, values=np.rad2deg(drop.measured), style="measured", label="measured"),
        Line(time=drop.time, values=np.rad2deg(drop.fitted), style="first", label="swung"),
    ]
    events = [Event(float(time), str(i + 1)) for i, time in enumerate(drop.turns[:-1:2])]
    span = float(drop.time[0]), float(drop.time[-1])
    return time_plot(
        f"Angle, {drop.name}",
        "°",
        lines,
        span,
        TimeLook(events=events, width=1040, height=190, name_events=True),
    )
