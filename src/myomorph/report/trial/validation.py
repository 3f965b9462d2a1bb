"""The part of the page on a motion that identification did not see, [D] figure 3.3."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from myomorph.analysis.columns import Comparison, compared
from myomorph.identify.validation import COMPONENTS, CrossValidation
from myomorph.motion.calibration import Calibration, root_mean_square
from myomorph.report.charts.axis import number
from myomorph.report.charts.curves import Line, time_plot
from myomorph.report.charts.rows import dot_plot
from myomorph.report.page.parts import Figure, Grid, Section
from myomorph.report.trial.prepared import Prepared

UNITS = ("N·m",) * 3 + ("N",) * 3  # Of the components of a wrench.
STYLES = ("first", "second", "third", "fourth", "left", "middle")  # Of the methods' lines, in their order.
FORCE_FIRST = (3, 4, 5, 0, 1, 2)
MAX_TIME = 10.0  # Charts show so much of a motion that is twice as long, or longer [s].


def validation_section(trial: str, check: CrossValidation, styles: Mapping[str, str], order: int = 0) -> Section | None:
    """Six components of the base wrench, measured and by every method, and their errors. `trial`: its name; `styles`:
    of each method's line; `order`: of the motion among those that were not used, 0 for the first.
    """
    if not len(check.time) or not check.predicted:
        return None
    styles = {name: styles.get(name, STYLES[i % len(STYLES)]) for i, name in enumerate(check.predicted)}
    span = _busiest(check)
    seen = int(np.isfinite(check.measured).all(axis=1).sum())
    lead = (
        f"The wrench on the base link, {trial or 'a motion that was not used'}: {number(seen, 1.0)} frames. "
        "Errors are predicted minus measured. Moments are about the base link's origin, in ground axes."
    )
    if span[1] - span[0] < float(check.time[-1] - check.time[0]) - 1e-9:
        lead += f" Charts show the {number(span[1] - span[0])} s with the largest changes; the tables cover all of it."
    return Section(
        f"cross-validation-{order + 1}" if order else "cross-validation",
        f"Cross-validation: {trial or order + 1}" if order else "Cross-validation",
        lead,
        (("measured", "measured"), *((style, name) for name, style in styles.items())),
        tuple(Figure(_chart(check, component, styles, span)) for component in FORCE_FIRST),
        _grids(check),
    )


def _chart(check: CrossValidation, component: int, styles: Mapping[str, str], span: tuple[float, float]) -> str:
    lines = [Line(check.time, check.measured[:, component], "measured", "measured")]
    # The first method is drawn last, over the others.
    for name in reversed(list(check.predicted)):
        lines.append(Line(check.time, check.predicted[name][:, component], styles[name], name))
    return time_plot(COMPONENTS[component], UNITS[component], lines, span, height=200)


def _grids(check: CrossValidation) -> tuple[Grid, ...]:
    methods, errors = tuple(check.predicted), check.table()

    def grid(title: str, of: str, folded: bool = False, percent: bool = False) -> Grid:
        rows = []
        for component in FORCE_FIRST:
            name = COMPONENTS[component] if percent else f"{COMPONENTS[component]} [{UNITS[component]}]"
            values = (number(float(errors[method][of][component])) if method in errors else "–" for method in methods)
            rows.append((name, *(f"{value} %" if percent and value != "–" else value for value in values)))
        return Grid(("Component", *methods), tuple(rows), title, folded)

    return (
        grid("Error, root mean square", "rms"),
        grid("Error, mean absolute", "mean"),
        grid("Error, mean", "bias", folded=True),
        grid("Error, maximum", "peak", folded=True),
        grid("Error, root mean square, over body weight (moments: × 1 m)", "percent", folded=True, percent=True),
    )


def _busiest(check: CrossValidation) -> tuple[float, float]:
    """The whole time, or of a long motion the part in which the measured wrench changes most [s]."""
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
    """Lengths, markers and marker errors before and after kinematic identification. `recordings`: names of those that
    were used, in their order, the static one last.
    """
    lengths = [
        (length.length.name, length.generic, length.value, length.generic * length.sd) for length in calibration.lengths
    ]
    lead = "Segment lengths and marker positions that fit the recordings"
    frames = sum(len(chosen) for chosen in calibration.frames)
    lead += f", from {number(frames, 1.0)} frames." if frames else "."
    lead += f" {'Converged' if calibration.converged else 'NOT converged'} after {calibration.steps} steps, "
    lead += f"last change {calibration.last_change:.1g} of a length or a meter."
    lead += " Bars are ± one standard deviation." if any(sd for *_, sd in lengths) else ""
    figures = []
    if lengths:
        names = [name for name, *_ in lengths]
        change = np.array([1000.0 * (after - before) for _, before, after, _ in lengths])
        sd = np.array([1000.0 * sd for *_, sd in lengths])
        figures.append(dot_plot("Change of lengths", "mm", names, [change], ("first",), ("change",), 520, sd))
    if calibration.markers:
        shifts = ((marker.name, float(np.linalg.norm(marker.shift))) for marker in calibration.markers)
        moved = dict(sorted(shifts, key=lambda shift: -shift[1])[:MAX_MARKERS])
        far = [1000.0 * np.array(list(moved.values()))]
        figures.append(dot_plot("Marker displacements", "mm", list(moved), far, ("third",), ("moved",), 520))
    errors = tuple(
        (name, *(_millimetres(root_mean_square((distances,))) for distances in pair))
        for name, *pair in zip(recordings, calibration.before, calibration.after, strict=True)
    )
    length_rows = tuple((name, *map(_millimetres, values)) for name, *values in lengths)
    zeros = tuple(
        (
            zero.coordinate,
            f"{number(np.degrees(zero.offset))}°",
            " to ".join(f"{number(np.degrees(limit))}°" for limit in zero.interval),
            zero.source,
        )
        for zero in calibration.zero_angles
    )
    grids = (
        Grid(("Trial", "RMS before", "RMS after"), errors, "Marker errors before and after"),
        Grid(
            ("Length", "Before", "After", "Standard deviation"),
            length_rows,
            "Lengths",
            len(lengths) > MAX_OPEN_ROWS,
        ),
        Grid(
            ("Coordinate", "Zero against the generic model's", "90 % interval", "Fixed by"),
            zeros,
            "Zero angles",
            len(zeros) > MAX_OPEN_ROWS,
        ),
        Grid(("Note",), tuple((text,) for text in calibration.notes), "Notes of the calibration"),
    )
    return Section(
        "calibration",
        "Lengths and markers",
        lead,
        (),
        tuple(Figure(figure, "medium") for figure in figures),
        tuple(grid for grid in grids if grid.rows),
    )


def _millimetres(value: float) -> str:
    return f"{number(1000.0 * value)} mm"


def truth_section(prepared: Prepared) -> Section | None:
    """Estimate beside truth, for captures that were simulated."""
    results = prepared.results
    truth = results.recorded.truth
    if truth is None:
        return None
    model, grids = results.model, []
    no_angles: set[str] = set()
    turning = (
        {coordinate.name for coordinate in model.coordinates if coordinate.motion == "rotational"} if model else set()
    )
    for title, estimate, known, rotations, units in (
        ("Angles and translations", results.kinematics.motion, truth.motion, turning, ("°", "m")),
        ("Joint moments", results.dynamics.torques, truth.torques, turning, ("N·m", "N")),
        ("Activations", results.activations, truth.activations, no_angles, ("", "")),
    ):
        if estimate is not None and known is not None:
            grids.append(_compared_grid(title, compared(estimate, known), rotations, *units))
    shown = tuple(grid for grid in grids if grid.rows)
    if not shown:
        return None
    summary = "; ".join(f"{grid.title.lower()}: {grid.rows[0][1]} RMS in all" for grid in shown)
    return Section(
        "truth",
        "Estimate and truth",
        "The capture was simulated, so the true values are known and drawn dashed above. "
        f"{summary[:1].upper()}{summary[1:]}.",
        (),
        (),
        shown,
    )


def _compared_grid(title: str, rows: Sequence[Comparison], turning: set[str], unit: str, other: str) -> Grid:
    def told(value: float, name: str) -> str:
        if unit == "°" and name in turning:
            return f"{number(float(np.rad2deg(value)))} °"
        return f"{number(value)} {unit if name in turning or not other else other}".strip()

    def group(text: str, chosen: list[Comparison], name: str) -> tuple[str, ...]:
        rms = float(np.sqrt(np.mean([row.rmse**2 for row in chosen])))
        return text, told(rms, name), told(max(row.worst for row in chosen), name), "", ""

    turned = [row for row in rows if row.name in turning] or list(rows)
    lines: list[tuple[str, ...]]
    lines = [group("all" if len(turned) == len(rows) else "all rotations", turned, turned[0].name)] if rows else []
    for row in rows:
        values = (told(value, row.name) for value in (row.rmse, row.worst, row.span))
        lines.append((row.name, *values, number(row.correlation)))
    head = ("", "RMS difference", "Maximum", "Range of the truth", "Correlation")
    return Grid(head, tuple(lines), title, len(lines) > 14)
