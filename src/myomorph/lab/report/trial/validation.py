"""The sections on validation: held-out motions, calibration, truth, uncertainty.

Held-out motions are shown as in [D] figure 3.3.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from myomorph.body.calibrate.calibration import Calibration, ZeroAngle, root_mean_square
from myomorph.body.identify.validation import COMPONENTS, CrossValidation
from myomorph.core.model.model import Model
from myomorph.core.model.quantity import Quantity
from myomorph.core.model.series_quantities import COORDINATE_VALUE
from myomorph.core.model.units import shown_unit
from myomorph.core.rigid.quantities import GENERALIZED_FORCE
from myomorph.core.tension.load_quantities import LOADS
from myomorph.core.tension.quantities import ACTIVATION
from myomorph.lab.analysis.columns import Comparison, compared
from myomorph.lab.report.charts.axis import number
from myomorph.lab.report.charts.curves import Line, TimeLook, time_plot
from myomorph.lab.report.charts.rows import Rows, dot_plot
from myomorph.lab.report.page.parts import Figure, Grid, Section
from myomorph.lab.report.trial.prepared import Prepared
from myomorph.lab.uncertainty.sources import SourceSize
from myomorph.lab.uncertainty.spread import Shares, Spread

UNITS = ("N·m",) * 3 + ("N",) * 3  # Of the components of a wrench.
# Of the methods' lines, in their order.
STYLES = ("first", "second", "third", "fourth", "left", "middle")
FORCE_FIRST = (3, 4, 5, 0, 1, 2)
MAX_TIME = 10.0  # Charts show so much of a motion that is twice as long, or longer [s].


def validation_section(
    trial: str, check: CrossValidation, styles: Mapping[str, str], order: int = 0
) -> Section | None:
    """Compare the six components of the base wrench, measured and by every method.

    Their errors stand below.

    Parameters
    ----------
    trial : its name
    check : wrenches of a motion that was not used
    styles : of each method's line
    order : of the motion among those that were not used, 0 for the first
    """
    if not len(check.time) or not check.predicted:
        return None
    styles = {
        name: styles.get(name, STYLES[i % len(STYLES)]) for i, name in enumerate(check.predicted)
    }
    span = _busiest(check)
    seen = int(np.isfinite(check.measured).all(axis=1).sum())
    lead = (
        f"The wrench on the base link, {trial or 'a motion that was not used'}: {number(seen, 1.0)}"
        " frames. Errors are predicted minus measured. Moments are about the base link's origin,"
        " in ground axes."
    )
    if span[1] - span[0] < float(check.time[-1] - check.time[0]) - 1e-9:
        lead += (
            f" Charts show the {number(span[1] - span[0])} s with the largest changes; the tables"
            " cover all of it."
        )
    key = "cross-validation"
    title = "Cross-validation"
    if order:
        key = f"{key}-{order + 1}"
        title = f"{title}: {trial or order + 1}"
    legend = (("measured", "measured"), *((style, name) for name, style in styles.items()))
    figures = tuple(Figure(_chart(check, component, styles, span)) for component in FORCE_FIRST)
    return Section(
        key=key, title=title, lead=lead, legend=legend, figures=figures, grids=_grids(check)
    )


def _chart(
    check: CrossValidation, component: int, styles: Mapping[str, str], span: tuple[float, float]
) -> str:
    lines = [
        Line(
            time=check.time, values=check.measured[:, component], style="measured", label="measured"
        )
    ]
    # The first method is drawn last, over the others.
    for name in reversed(list(check.predicted)):
        lines.append(
            Line(
                time=check.time,
                values=check.predicted[name][:, component],
                style=styles[name],
                label=name,
            )
        )
    return time_plot(COMPONENTS[component], UNITS[component], lines, span, TimeLook(height=200))


def _grids(check: CrossValidation) -> tuple[Grid, ...]:
    methods = tuple(check.predicted)
    errors = check.table()

    def grid(title: str, of: str, folded: bool = False, percent: bool = False) -> Grid:
        rows = []
        for component in FORCE_FIRST:
            name = (
                COMPONENTS[component]
                if percent
                else f"{COMPONENTS[component]} [{UNITS[component]}]"
            )
            values = (
                number(float(errors[method][of][component])) if method in errors else "–"
                for method in methods
            )
            rows.append(
                (name, *(f"{value} %" if percent and value != "–" else value for value in values))
            )
        return Grid(head=("Component", *methods), rows=tuple(rows), title=title, folded=folded)

    return (
        grid("Error, root mean square", "rms"),
        grid("Error, mean absolute", "mean"),
        grid("Error, mean", "bias", folded=True),
        grid("Error, maximum", "peak", folded=True),
        grid(
            "Error, root mean square, over body weight (moments: × 1 m)",
            "percent",
            folded=True,
            percent=True,
        ),
    )


def _busiest(check: CrossValidation) -> tuple[float, float]:
    """Find the part of a long motion whose measured wrench changes most [s].

    Of a short one it is the whole time.
    """
    time = check.time
    if time[-1] - time[0] <= 2.0 * MAX_TIME:
        return float(time[0]), float(time[-1])
    measured = np.nan_to_num(check.measured)
    size = np.maximum(np.abs(measured).max(axis=0), 1e-12)
    change = np.concatenate([[0.0], np.abs(np.diff(measured / size, axis=0)).sum(axis=1).cumsum()])
    last = np.minimum(np.searchsorted(time, time + MAX_TIME), len(time) - 1)
    start = int(np.argmax(np.where(time + MAX_TIME <= time[-1], change[last] - change, -1.0)))
    return float(time[start]), float(time[start] + MAX_TIME)


MAX_MARKERS = 40  # Markers in the chart, those that moved furthest.
MAX_OPEN_ROWS = 30


def calibration_section(calibration: Calibration, recordings: Sequence[str]) -> Section:
    """Show lengths, markers and marker errors before and after kinematic identification.

    `recordings` are names of those that were used, in their order, the static one last.
    """
    lengths = [
        (length.length.name, length.generic, length.value, length.generic * length.sd)
        for length in calibration.lengths
    ]
    lead = _calibration_lead(calibration)
    lead += " Bars are ± one standard deviation." if any(sd for *_, sd in lengths) else ""
    errors = tuple(
        (name, *(_millimetres(root_mean_square((distances,))) for distances in pair))
        for name, *pair in zip(recordings, calibration.before, calibration.after, strict=True)
    )
    length_rows = tuple((name, *map(_millimetres, values)) for name, *values in lengths)
    zeros = tuple(map(_zero_row, calibration.zero_angles))
    head = ("Coordinate", "Zero against the generic model's", "90 % interval", "Fixed by")
    grids = (
        Grid(("Trial", "RMS before", "RMS after"), errors, "Marker errors before and after"),
        Grid(
            head=("Length", "Before", "After", "Standard deviation"),
            rows=length_rows,
            title="Lengths",
            folded=len(lengths) > MAX_OPEN_ROWS,
        ),
        Grid(head=head, rows=zeros, title="Zero angles", folded=len(zeros) > MAX_OPEN_ROWS),
        *_patella_grid(calibration),
        Grid(("Note",), tuple((text,) for text in calibration.notes), "Notes of the calibration"),
    )
    charts = [*_length_chart(lengths), *_marker_chart(calibration)]
    return Section(
        key="calibration",
        title="Lengths and markers",
        lead=lead,
        legend=(),
        figures=tuple(Figure(chart, "medium") for chart in charts),
        grids=grids,
    )


def _patella_grid(calibration: Calibration) -> Iterator[Grid]:
    """Yield the distance of patellae where markers on them inform it."""
    found = calibration.patella
    if found is not None:
        interval = found.interval
        limits = f"{number(1e3 * interval.low)} to {number(1e3 * interval.high)} mm"
        share = f"{number(100.0 * found.share)} %"
        shown = "yes" if found.shown else "no"
        row = (_millimetres(interval.value), limits, ", ".join(found.markers), share, shown)
        head = ("Beyond the model's", "90 % interval", "Markers", "Their share", "Shown")
        yield Grid(head=head, rows=(row,), title="Distance of patellae from the knees' axes")


def _calibration_lead(calibration: Calibration) -> str:
    """Write how many frames were used, and whether the fit converged."""
    lead = "Segment lengths and marker positions that fit the recordings"
    frames = sum(len(chosen) for chosen in calibration.frames)
    lead += f", from {number(frames, 1.0)} frames." if frames else "."
    status = "Converged" if calibration.converged else "NOT converged"
    lead += f" {status} after {calibration.steps} steps, "
    return lead + f"last change {calibration.last_change:.1g} of a length or a meter."


def _length_chart(lengths: Sequence[tuple[str, float, float, float]]) -> Iterator[str]:
    """Yield the change of lengths (name, before, after, standard deviation) if there are any."""
    if lengths:
        names = [name for name, *_ in lengths]
        change = np.array([1000.0 * (after - before) for _, before, after, _ in lengths])
        sd = np.array([1000.0 * sd for *_, sd in lengths])
        yield dot_plot(
            "Change of lengths",
            "mm",
            Rows(names=names, values=[change], styles=("first",), labels=("change",)),
            520,
            sd,
        )


def _marker_chart(calibration: Calibration) -> Iterator[str]:
    """Yield the displacements of the markers that moved most, if there are any."""
    if calibration.markers:
        shifts = (
            (marker.name, float(np.linalg.norm(marker.shift))) for marker in calibration.markers
        )
        moved = dict(sorted(shifts, key=lambda shift: -shift[1])[:MAX_MARKERS])
        far = [1000.0 * np.array(list(moved.values()))]
        yield dot_plot(
            "Marker displacements",
            "mm",
            Rows(names=list(moved), values=far, styles=("third",), labels=("moved",)),
            520,
        )


def _zero_row(zero: ZeroAngle) -> tuple[str, ...]:
    limits = " to ".join(f"{number(np.degrees(limit))}°" for limit in zero.interval)
    return zero.coordinate, f"{number(np.degrees(zero.offset))}°", limits, zero.source


def _millimetres(value: float) -> str:
    return f"{number(1000.0 * value)} mm"


def truth_section(prepared: Prepared) -> Section | None:
    """Estimate beside truth, for captures that were simulated."""
    results = prepared.results
    truth = results.recorded.truth
    if truth is None:
        return None
    model = results.model
    grids = []
    no_angles: set[str] = set()
    turning = (
        {coordinate.name for coordinate in model.coordinates if coordinate.motion == "rotational"}
        if model
        else set()
    )
    for title, estimate, known, rotations, quantity in (
        (
            "Angles and translations",
            results.kinematics.motion,
            truth.motion,
            turning,
            COORDINATE_VALUE,
        ),
        ("Joint moments", results.dynamics.torques, truth.torques, turning, GENERALIZED_FORCE),
        ("Activations", results.activations, truth.activations, no_angles, ACTIVATION),
    ):
        if estimate is not None and known is not None:
            units = (
                shown_unit(quantity.unit_of("rotational")),
                shown_unit(quantity.unit_of("translational")),
            )
            grids.append(_compared_grid(title, compared(estimate, known), rotations, *units))
    shown = tuple(grid for grid in grids if grid.rows)
    if not shown:
        return None
    summary = "; ".join(f"{grid.title.lower()}: {grid.rows[0][1]} RMS in all" for grid in shown)
    lead = "The capture was simulated, so the true values are known and drawn dashed above. "
    return Section(
        "truth", "Estimate and truth", f"{lead}{summary[:1].upper()}{summary[1:]}.", grids=shown
    )


def _compared_grid(
    title: str, rows: Sequence[Comparison], turning: set[str], unit: str, other: str
) -> Grid:
    def told(value: float, name: str) -> str:
        if unit == "°" and name in turning:
            return f"{number(float(np.rad2deg(value)))} °"
        shown_unit = unit if name in turning or not other else other
        return f"{number(value)} {shown_unit}".strip()

    def group(text: str, chosen: list[Comparison], name: str) -> tuple[str, ...]:
        rms = float(np.sqrt(np.mean([row.rmse**2 for row in chosen])))
        return text, told(rms, name), told(max(row.worst for row in chosen), name), "", ""

    turned = [row for row in rows if row.name in turning] or list(rows)
    lines: list[tuple[str, ...]]
    lines = (
        [group("all" if len(turned) == len(rows) else "all rotations", turned, turned[0].name)]
        if rows
        else []
    )
    for row in rows:
        values = (told(value, row.name) for value in (row.rmse, row.worst, row.span))
        lines.append((row.name, *values, number(row.correlation)))
    head = ("", "RMS difference", "Maximum", "Range of the truth", "Correlation")
    return Grid(head=head, rows=tuple(lines), title=title, folded=len(lines) > 14)


PLACES = re.compile(r"_p[xyz]$")
MOMENTS = re.compile(r"_m[xyz]$|torque_?[xyz]$")
"""What columns of loads end in that are points and moments."""
SHOWN_COLUMNS = 12  # Columns of a table that are shown, those that are least sure first.
MAX_SOURCES = 3
MIN_SHARE = 0.01  # Sources named for a column, and the share of the variance from which one is.


def uncertainty_section(prepared: Prepared) -> Section | None:
    """For each table its least sure columns, and which sources of error matter most there."""
    uncertainty = prepared.results.uncertainty
    if not uncertainty.spreads:
        return None
    grids = []
    for name, spread in uncertainty.spreads.items():
        quantity = spread.quantity
        title = name.replace("_", " ").capitalize() if quantity is None else quantity.words
        units = [unit_of(quantity, column, prepared.results.model) for column in spread.names]
        grids.append(_spread_grid(title, units, spread, uncertainty.shares.get(name)))
    if uncertainty.sizes:
        grids.append(_size_grid(uncertainty.sizes))
    lead = (
        f"{uncertainty.draws - uncertainty.failed} of {uncertainty.draws} inputs, drawn with stated"
        f" or usual error sizes, have a solution; {uncertainty.summary}."
        " They are as accurate as these sizes. Of each table the columns with the widest limits"
        " are shown; uncertainty.csv has all."
    )
    return Section(
        key="uncertainty", title="Uncertainty", lead=lead, legend=(), figures=(), grids=tuple(grids)
    )


def unit_of(quantity: Quantity | None, column: str, model: Model | None) -> str:
    """Return the unit in which a column of a drawn quantity is shown.

    Of loads the end of the column's name decides.
    """
    if quantity is None or quantity.unit == LOADS:
        if PLACES.search(column):
            return "m"
        if MOMENTS.search(column):
            return "N·m"
        return "N"
    known = model is not None and column in model.coordinate_names
    motion = model.coordinate(column).motion if model is not None and known else "rotational"
    return shown_unit(quantity.unit_of(motion))


def _spread_grid(title: str, units: list[str], spread: Spread, shares: Shares | None) -> Grid:
    scales = np.where([unit == "°" for unit in units], 180.0 / np.pi, 1.0)
    widths = scales * np.nanmean(spread.high - spread.low, axis=0)
    deviations = scales * np.sqrt(np.nanmean(spread.deviation**2, axis=0))
    order = np.argsort(-np.nan_to_num(widths))[:SHOWN_COLUMNS]
    rows = []
    for column in order:
        printed = (
            f"{number(values[column])} {units[column]}".strip() for values in (widths, deviations)
        )
        further = () if shares is None else (_main_sources(shares, int(column)),)
        rows.append((spread.names[column], *printed, *further))
    head = ("Column", "Mean width of the limits", "Standard deviation")
    return Grid(head if shares is None else (*head, "Main sources"), tuple(rows), title)


def _size_grid(sizes: tuple[SourceSize, ...]) -> Grid:
    """How large sources of error were taken to be, those that are left out not."""
    rows = []
    for size in sizes:
        if not size.size:
            continue
        origin = (
            f"{size.origin}, {size.items} sizes, {number(size.least)} to {number(size.greatest)}"
        )
        rows.append(
            (size.source, size.group, number(size.size), origin if size.items else size.origin)
        )
    return Grid(("Source", "Group", "Standard deviation", "From"), tuple(rows), "Sizes of errors")


def _main_sources(shares: Shares, column: int) -> str:
    """Name the groups of sources that contribute most, with their shares of the variance."""
    total = np.nan_to_num(shares.total[:, column])
    leading = [g for g in np.argsort(-total)[:MAX_SOURCES] if total[g] > MIN_SHARE]
    return ", ".join(f"{shares.groups[g]} {100 * total[g]:.0f} %" for g in leading)
