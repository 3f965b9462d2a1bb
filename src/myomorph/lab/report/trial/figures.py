"""The figures of a report, each from the values it shows to SVG text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.series import Event, ForcePlate, Series, Wrenches
from myomorph.core.model.sides import split_side
from myomorph.core.motion.ik import KinematicsFit
from myomorph.lab.analysis.muscle_names import muscle_words
from myomorph.lab.analysis.phases import side_of
from myomorph.lab.analysis.selection import Pair, muscle_rows
from myomorph.lab.report.charts.axis import scaled_unit
from myomorph.lab.report.charts.cells import Columns, heat_map
from myomorph.lab.report.charts.curves import Line, TimeLook, time_plot
from myomorph.lab.report.charts.marks import Level
from myomorph.lab.report.charts.points import floor_plot
from myomorph.lab.report.charts.rows import BarLook, Rows, bar_plot
from myomorph.lab.report.trial.tables import (
    MARKER_LARGEST,
    MARKER_RMS,
    RESIDUAL_FORCE,
    RESIDUAL_MOMENT,
)
from myomorph.lab.uncertainty.spread import Spread

STYLE = {"right": "right", "left": "left", "": "middle"}
ORDINAL = ("first", "second", "third", "fourth")
MAX_BARS = 60
MAX_COLUMN_ROWS = 14
Span = tuple[float, float]


def marker_figures(
    fit: KinematicsFit, span: Span, events: Sequence[Event], scale: float
) -> list[str]:
    """Marker errors over time, and per marker, against their limits [cm]."""
    limit = 100 * MARKER_LARGEST * scale
    rms_limit = 100 * MARKER_RMS * scale
    lines = [
        Line(time=fit.motion.time, values=100 * fit.largest, style="second", label="largest"),
        Line(time=fit.motion.time, values=100 * fit.rms, style="first", label="RMS"),
    ]
    levels = [
        Level(limit, f"largest: {limit:.3g} cm"),
        Level(rms_limit, f"RMS: {rms_limit:.3g} cm"),
    ]
    look = TimeLook(
        events=events,
        levels=levels,
        low=0.0,
        high=1.05 * limit,
        width=1040,
        height=200,
        name_events=True,
    )
    over_time = time_plot("Marker errors over time", "cm", lines, span, look)
    limits = [Level(rms_limit, "RMS limit"), Level(limit, "limit of the maximum")]
    return [over_time, *_marker_bars(fit, limits)]


def _marker_bars(fit: KinematicsFit, limits: Sequence[Level]) -> list[str]:
    """Draw the errors of each marker, the largest first, in one column or two."""
    seen = np.isfinite(fit.marker_error)
    squares = np.where(seen, fit.marker_error, 0.0) ** 2
    with np.errstate(invalid="ignore"):
        rms = 100 * np.sqrt(squares.sum(axis=0) / seen.sum(axis=0))
    largest = 100 * np.max(np.where(seen, fit.marker_error, -np.inf), axis=0, initial=-np.inf)
    largest = np.where(np.isfinite(largest), largest, np.nan)
    order = np.argsort(-np.nan_to_num(rms, nan=-1.0))[:MAX_BARS]
    title = "Marker errors by marker"
    if len(fit.marker_names) > MAX_BARS:
        title = f"Marker errors: the {MAX_BARS} largest of {len(fit.marker_names)}"
    peak = float(np.nanmax(largest, initial=0.0))
    columns = np.array_split(order, 2) if len(order) > MAX_COLUMN_ROWS else [order]
    bars = []
    for place, part in enumerate(columns):
        words = (title, "cm") if place == 0 else (f"{title}, the next", "")
        names = [fit.marker_names[i] for i in part]
        bars.append(
            bar_plot(
                *words,
                Rows(
                    names=names,
                    values=[largest[part], rms[part]],
                    styles=["second", "first"],
                    labels=["largest", "RMS"],
                ),
                BarLook(levels=limits, width=505, peak=peak),
            )
        )
    return bars


def axis_names(up: Array) -> tuple[list[Array], list[str]]:
    """Find unit vectors up, along and across, the ground's own axes where they are.

    Parameters
    ----------
    up : (3,) unit vector against gravity

    Returns
    -------
    The (3,) vectors, and their printed names
    """
    vertical = int(np.argmax(np.abs(up)))
    letters = "xyz"
    others = [i for i in range(3) if i != vertical]
    vectors = [np.asarray(up, dtype=np.float64)] + [np.eye(3)[i] for i in others]
    return vectors, [
        f"vertical ({letters[vertical]})",
        *(f"horizontal ({letters[i]})" for i in others),
    ]


def wrench_styles(wrenches: Wrenches) -> list[tuple[str, str]]:
    """Label and style of each wrench: its side where one is known, else one color after another."""
    sides = [
        side_of(name, body) for name, body in zip(wrenches.names, wrenches.bodies, strict=True)
    ]
    styles = []
    for i, (name, body, side) in enumerate(
        zip(wrenches.names, wrenches.bodies, sides, strict=True)
    ):
        alone = bool(side) and sides.count(side) == 1
        if alone:
            label = side.lower()
        elif body:
            label = f"{name} on {body}"
        else:
            label = name
        styles.append((label, side.lower() if side else ORDINAL[i % len(ORDINAL)]))
    return styles


def force_figures(
    wrenches: Wrenches, up: Array, span: Span, events: Sequence[Event], weight: float | None
) -> list[str]:
    """Draw ground forces along three axes, body weight marked.

    Parameters
    ----------
    wrenches : forces of the ground [N]
    up : (3,) unit vector against gravity
    span : first and last time [s]
    events : upright lines
    weight : of the body [N], None where it is not known

    Returns
    -------
    A chart per axis, the vertical first
    """
    vectors, names = axis_names(up)
    styles = wrench_styles(wrenches)
    result = []
    factor, unit = scaled_unit("N", wrenches.forces)
    for i, (vector, name) in enumerate(zip(vectors, names, strict=True)):
        components = factor * (wrenches.forces @ vector)
        lines = [
            Line(time=wrenches.time, values=components[:, axis], style=style, label=label)
            for axis, (label, style) in enumerate(styles)
        ]
        if i == 0 and len(styles) > 1:
            total = Line(
                time=wrenches.time,
                values=np.nan_to_num(components).sum(axis=1),
                style="middle",
                label="sum",
            )
            lines.insert(0, total)
        limits = [Level(factor * weight, "body weight")] if i == 0 and weight else []
        second = (1.0 / (factor * weight), "BW") if weight else None
        look = TimeLook(events=events, levels=limits, second=second)
        if i == 0:
            look = replace(look, low=0.0, width=680, name_events=True)
        result.append(time_plot(f"Ground force, {name}", unit, lines, span, look))
    return result


@read_only
class Ground:
    """The ground seen from above: its two axes.

    The second is turned over where they and the vertical are left-handed.
    """

    columns: tuple[int, int]  # of points in ground that are to the right and upwards in the drawing
    signs: Array  # (2,) of these

    @staticmethod
    def under(up: Array) -> Ground:
        """Make the ground under a vertical.

        Parameters
        ----------
        up : (3,) unit vector against gravity

        Returns
        -------
        The ground whose axes are the other two
        """
        vertical = int(np.argmax(np.abs(up)))
        first, second = [i for i in range(3) if i != vertical]
        return Ground((first, second), np.array([1.0, -1.0 if vertical == 1 else 1.0]))

    @property
    def axes(self) -> tuple[str, str]:
        """Names of the axes."""
        return "xyz"[self.columns[0]], ("−" if self.signs[1] < 0.0 else "") + "xyz"[self.columns[1]]

    def seen(self, points: Array) -> Array:
        """Project points to the ground.

        Parameters
        ----------
        points : (n, 3) [m]

        Returns
        -------
        (n, 2) [m]
        """
        return points[:, self.columns] * self.signs


def pressure_figure(wrenches: Wrenches, plates: Sequence[ForcePlate], up: Array) -> str:
    """Draw centers of pressure on the ground seen from above [m].

    They are hidden where the load is under a twentieth of its peak.

    Parameters
    ----------
    wrenches : forces of the ground [N] and their points [m]
    plates : whose outlines are drawn
    up : (3,) unit vector against gravity

    Returns
    -------
    The chart as an `<svg>` element, "" where no point is known
    """
    ground = Ground.under(up)
    paths = []
    for i, (label, style) in enumerate(wrench_styles(wrenches)):
        load = np.nan_to_num(wrenches.forces[:, i] @ up)
        shown = load > 0.05 * max(float(load.max(initial=0.0)), 1e-12)
        paths.append(
            (label, style, np.where(shown[:, None], ground.seen(wrenches.points[:, i]), np.nan))
        )
    outlines = [(plate.name, ground.seen(plate.corners)) for plate in plates]
    return floor_plot("Center of pressure, from above", ground.axes, paths, outlines)


def centroid_figures(com: Series, up: Array, span: Span, events: Sequence[Event]) -> list[str]:
    """Draw height and vertical velocity of the center of mass.

    Parameters
    ----------
    com : (frames, 3) center of mass [m]
    up : (3,) unit vector against gravity
    span : first and last time [s]
    events : upright lines

    Returns
    -------
    A chart of the height and one of the velocity
    """
    height = com.values @ up
    speed = np.gradient(height, com.time) if len(com) > 1 else np.zeros_like(height)
    result = []
    for name, label, unit, values in (
        ("Center of mass, height", "height", "m", height),
        ("Center of mass, vertical velocity", "velocity", "m/s", speed),
    ):
        factor, unit = scaled_unit(unit, values)
        result.append(
            time_plot(
                name,
                unit,
                [Line(time=com.time, values=factor * values, style="middle", label=label)],
                span,
                TimeLook(events=events),
            )
        )
    return result


@read_only
class Residuals:
    """Residuals at the root, and what their limits depend on.

    Attributes
    ----------
    time : (frames,) [s]
    force : (frames,) norm of the residual force [N]
    moment : (frames,) norm of the residual moment [N m]
    peak : of the external force [N]
    height : of the center of mass [m]
    """

    time: Array
    force: Array
    moment: Array
    peak: float
    height: float


def residual_figures(residuals: Residuals, span: Span, events: Sequence[Event]) -> list[str]:
    """Draw residual force and moment at the root over time, against their limits.

    Parameters
    ----------
    residuals : with what their limits depend on
    span : first and last time [s]
    events : upright lines

    Returns
    -------
    A chart of the force and one of the moment
    """
    time = residuals.time
    force_limit = RESIDUAL_FORCE * residuals.peak
    moment_limit = RESIDUAL_MOMENT * residuals.peak * residuals.height
    result = []
    for what, unit, values, limit, label in (
        ("Residual force", "N", residuals.force, force_limit, "5 % of peak external force"),
        (
            "Residual moment",
            "N·m",
            residuals.moment,
            moment_limit,
            "1 % of COM height × peak force",
        ),
    ):
        factor, unit = scaled_unit(unit, values, np.array([limit]))
        lines = [Line(time=time, values=factor * values, style="first", label=what.lower())]
        levels = [Level(factor * limit, label)]
        result.append(
            time_plot(
                what,
                unit,
                lines,
                span,
                TimeLook(events=events, levels=levels, low=0.0, high=1.15 * factor * limit),
            )
        )
    return result


@dataclass(frozen=True, kw_only=True)
class PairSeries:
    """Values whose columns are drawn in pairs.

    Attributes
    ----------
    series : the values
    unit : in which they are drawn
    factor : from the unit of the series to that
    second : factor and unit of a second scale on the right
    truth : values that are known to be true
    spread : interval bounds
    """

    series: Series
    unit: str
    factor: float = 1.0
    second: tuple[float, str] | None = None
    truth: Series | None = None
    spread: Spread | None = None


def pair_panel(
    title: str,
    pair: Pair,
    values: PairSeries,
    shown: tuple[Span, Sequence[Event]],
    margin: int = 8,
) -> str:
    """Draw right and left of one quantity over each other.

    What is known to be true is dashed; interval bounds are bands.
    """
    series = values.series
    truth = values.truth
    factor = values.factor
    unit = values.unit
    second = values.second
    span, events = shown
    lines = []
    if factor == 1.0:
        factor, unit = scaled_unit(
            unit, *(series[name] for name in pair.names if name in series.names)
        )
        second = (second[0] / factor, second[1]) if second else None
    for source in (series, truth):
        for side, name in (
            (side, name) for side, members in pair.members.items() for name in members
        ):
            if source is not None and name in source.names:
                known = (f"truth {STYLE[side]}", f"{side} truth".strip())
                style, label = (STYLE[side], side or "value") if source is series else known
                ends = (None, None) if source is truth else limits_of(values.spread, [name], factor)
                low, high = ends
                lines.append(
                    Line(
                        time=source.time,
                        values=factor * source[name],
                        style=style,
                        label=label,
                        low=low,
                        high=high,
                    )
                )
    return time_plot(
        title, unit, lines, span, TimeLook(events=events, second=second, margin=margin)
    )


def limits_of(
    spread: Spread | None, names: Sequence[str], factor: float = 1.0
) -> tuple[Array | None, Array | None]:
    """Find the lower and upper interval bound of a column.

    Parameters
    ----------
    spread : bounds of all columns (frames, columns)
    names : of the columns that are drawn as one
    factor : from the columns' unit to the drawn one

    Returns
    -------
    (frames,) each; None where none are known, or several columns are drawn as one
    """
    if spread is None or len(names) != 1 or names[0] not in spread.names:
        return None, None
    column = spread.names.index(names[0])
    return factor * spread.low[:, column], factor * spread.high[:, column]


@dataclass(frozen=True, kw_only=True)
class Activations:
    """Activations of a model's muscles.

    Attributes
    ----------
    series : (frames, muscles) from 0 to 1
    muscles : of the model
    strengths : maximum isometric forces [N], by muscle
    truth : activations that are known to be true
    spread : interval bounds
    """

    series: Series
    muscles: Sequence[str]
    strengths: Mapping[str, float]
    truth: Series | None = None
    spread: Spread | None = None


def activation_panel(
    pair: Pair,
    activations: Activations,
    span: Span,
    events: Sequence[Event],
    emg: Sequence[tuple[str, Array, Array]] = (),
) -> str:
    """Draw the activation of one muscle on both sides, measured EMG as areas behind.

    The parts of a muscle are averaged by strength.

    Parameters
    ----------
    pair : of the muscle's members on both sides
    activations : of all muscles
    span : first and last time [s]
    events : upright lines
    emg : side, time (samples,) [s] and envelope (samples,) of each channel

    Returns
    -------
    The chart as an `<svg>` element
    """
    lines = [
        Line(
            time=time,
            values=values,
            style=f"emg {STYLE[side]}",
            label=f"EMG {side}".strip(),
            filled=True,
        )
        for side, time, values in emg
    ]
    series = activations.series
    truth = activations.truth
    columns = set(activations.muscles)
    strengths = activations.strengths
    for side, members in pair.members.items():
        for source, style, label in ((series, "", ""), (truth, "truth ", " truth")):
            if source is None:
                continue
            mean = weighted(
                source, [name for name in members if name in columns or source is truth], strengths
            )
            if mean is not None:
                ends = (None, None) if source is truth else limits_of(activations.spread, members)
                low, high = ends
                lines.append(
                    Line(
                        time=source.time,
                        values=mean,
                        style=f"{style}{STYLE[side]}",
                        label=(side + label).strip() or "activation",
                        low=low,
                        high=high,
                    )
                )
    parts = max(len(members) for members in pair.members.values())
    unit = f"{parts} parts" if parts > 1 else ""
    return time_plot(
        pair.label,
        unit,
        lines,
        span,
        TimeLook(events=events, low=0.0, high=1.0, width=245, height=140),
    )


def weighted(series: Series, names: Sequence[str], strengths: Mapping[str, float]) -> Array | None:
    """Average columns, weighted by muscle strength.

    Parameters
    ----------
    series : (frames, muscles)
    names : of the columns
    strengths : maximum isometric forces [N], by muscle; 1 where not known

    Returns
    -------
    (frames,) in the unit of the series; None if none of the columns exists
    """
    known = [name for name in names if name in series.names]
    if not known:
        return None
    weights = np.array([max(strengths.get(name, 1.0), 1e-12) for name in known])
    return np.stack([series[name] for name in known], axis=1) @ weights / weights.sum()


def emg_panel(name: str, time: Array, values: Array, span: Span, events: Sequence[Event]) -> str:
    """Draw one EMG channel by itself.

    Parameters
    ----------
    name : of the channel
    time : (samples,) [s]
    values : (samples,) envelope
    span : first and last time [s]
    events : upright lines

    Returns
    -------
    The chart as an `<svg>` element
    """
    peak = float(np.nanmax(values, initial=0.0)) if np.isfinite(values).any() else 1.0
    lines = [Line(time=time, values=values, style="emg middle", label="EMG", filled=True)]
    return time_plot(
        name,
        "",
        lines,
        span,
        TimeLook(events=events, low=0.0, high=peak or 1.0, width=245, height=120),
    )


def tension_map(time: Array, forces: Array, names: Sequence[str], events: Sequence[Event]) -> str:
    """Draw all muscle tensions as a heat map, one block per side, from hip to ankle.

    Parameters
    ----------
    time : (frames,) [s]
    forces : (frames, muscles) [N]
    names : of the muscles
    events : drawn over the blocks of their side

    Returns
    -------
    The chart as an `<svg>` element
    """
    factor, unit = scaled_unit("N", forces)
    return heat_map(
        "Muscle tension",
        unit,
        Columns(
            time=time,
            values=factor * forces,
            names=[muscle_words(split_side(name)[0]) for name in names],
            blocks=muscle_rows(names),
        ),
        events,
    )
