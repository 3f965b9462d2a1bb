"""The parts of the page on one specimen: its swings, the fits, and how far to trust them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from myomorph.body.identify.validation import COMPONENTS
from myomorph.core.model.arrays import Array
from myomorph.core.model.interval import Interval
from myomorph.core.model.series import Event
from myomorph.lab.report.charts.axis import number
from myomorph.lab.report.charts.curves import Line, TimeLook, time_plot
from myomorph.lab.report.charts.marks import Level
from myomorph.lab.report.charts.points import Cloud, CloudLook, xy_plot
from myomorph.lab.report.charts.rows import Beside, IntervalLook, interval_bars, interval_rows
from myomorph.lab.report.page.parts import Figure, Grid, Section
from myomorph.lab.report.trial.validation import UNITS
from myomorph.swings.viscosity.identification.identify import MuscleViscosity
from myomorph.swings.viscosity.identification.instruments import SHOWN_IN
from myomorph.swings.viscosity.report import specimen_report
from myomorph.swings.viscosity.report.specimen_report import SpecimenReport
from myomorph.swings.viscosity.report.tables import BY_NAME, LACKING, where, with_interval

AXES = ("first", "second", "third")
MODELS = ("first", "second", "third", "fourth", "left", "middle")
TITLES = {"without": "without muscles", "with": "with muscles"}
SCANNED = {
    "without muscles": ("joint_viscosity", "com_muscles_removed", "mass_muscles_removed"),
    "with muscles": ("total_viscosity", "com_intact", "mass_intact"),
}
MAX_TIME = 12.0  # Charts over time show so much of a trial [s].
MAX_MODELS = 4  # Alternatives printed of each condition.

FORCE_FIRST = (3, 4, 5, 0, 1, 2)


def specimen_sections(specimen: SpecimenReport, order: int) -> list[Section]:
    """Show swings and fits of a specimen, its muscles, and what its values depend on."""
    parts = [
        _swings(specimen, order),
        _muscles(specimen, order),
        _trust(specimen, order),
        _scans(specimen, order),
    ]
    return [section for section in parts if section is not None]


def _swings(specimen: SpecimenReport, order: int) -> Section | None:
    conditions = list(specimen.conditions.items())
    if not conditions:
        return None
    figures = [
        Figure(
            swing_plot(condition.curves, f"Angles {TITLES[name]}, trial {condition.curves.trial}"),
            "full",
        )
        for name, condition in conditions
    ]
    figures += [
        Figure(
            torque_plot(condition, index, TITLES[name]),
            "small" if len(condition.axes) > 1 else "medium",
        )
        for name, condition in conditions
        for index in range(len(condition.axes))
    ]
    figures += [
        Figure(wrench_plot(condition.curves, component, TITLES[name]))
        for name, condition in conditions
        for component in FORCE_FIRST
    ]
    lead = "".join(
        f"{TITLES[name].capitalize()}: {condition.swings} swings in {condition.trials} trials, "
        f"{number(condition.seconds)} s. "
        for name, condition in conditions
    )
    lead += (
        "Vertical lines separate swings; frames outside them are not used. A passive torque opposes"
        " its velocity, so the fitted line falls with slope −d; the paper prints the opposite sign."
    )
    for name, condition in conditions:
        if condition.by_trial:
            lead += (
                f" Trials {TITLES[name]} differ by more than their swings explain: intervals of "
            )
            lead += f"{', '.join(condition.by_trial)} are drawn by trial."
    axes = conditions[0][1].axes
    legend = (
        *((style, f"axis {axis}") for style, axis in zip(AXES, axes, strict=False)),
        ("measured", "wrench, measured"),
        ("left", "fit, or predicted by the inertial parameters"),
    )
    misfits = []
    for name, condition in conditions:
        cells = (
            f"{number(float(condition.residual[component]))} {UNITS[component]}"
            for component in FORCE_FIRST
        )
        misfits.append((TITLES[name], *cells))
    head = ("Condition", *(COMPONENTS[component] for component in FORCE_FIRST))
    misfit = Grid(head, tuple(misfits), "Wrench, measured minus predicted, root mean square")
    grids = (_axis_grid(specimen), misfit)
    return Section(
        key=f"specimen-{order}",
        title=f"Specimen {specimen.name}",
        lead=lead,
        legend=legend,
        figures=tuple(figures),
        grids=grids,
    )


def swing_plot(curves: specimen_report.SwingCurves, title: str) -> str:
    """Draw angles of the free axes over time [degrees], a line where a swing begins."""
    span = _span(curves.time)
    begins = np.flatnonzero((np.diff(curves.swing, prepend=-1) != 0) & (curves.swing >= 0))
    events = [Event(float(curves.time[i]), str(int(curves.swing[i]) + 1)) for i in begins]
    lines = [
        Line(
            time=curves.time,
            values=np.rad2deg(curves.angles[:, column]),
            style=AXES[column % 3],
            label=f"about {axis}",
        )
        for column, axis in enumerate(curves.axes)
    ]
    return time_plot(
        title, "°", lines, span, TimeLook(events=events, width=1040, height=190, name_events=True)
    )


def _span(time: np.ndarray) -> tuple[float, float]:
    return float(time[0]), float(min(time[-1], time[0] + MAX_TIME))


def torque_plot(shown_condition: specimen_report.ShownCondition, axis: int, title: str) -> str:
    """Draw torque by inverse dynamics against velocity about one axis, and both estimates."""
    curves = shown_condition.curves
    used = curves.swing >= 0
    rates = curves.rates[used, axis]
    torque = curves.torque[used, axis]
    ends = np.array([rates.min(), rates.max()]) if len(rates) else np.zeros(2)
    clouds = [Cloud(x=rates, y=torque, style=AXES[axis % 3], label="torque by inverse dynamics")]
    lines = [("left", "all axes", shown_condition.viscosity.value)]
    if shown_condition.excited[axis]:
        lines.append(("middle", "this axis", shown_condition.axis_viscosity[axis].value))
    for style, words, value in lines:
        clouds.append(
            Cloud(
                x=ends,
                y=-value * ends,
                style=style,
                label=f"{words}: {number(value)} Nms/rad",
                joined=True,
            )
        )
    width = 330 if len(shown_condition.axes) > 1 else 505
    return xy_plot(
        f"Torque, axis {shown_condition.axes[axis]}, {title}",
        "N·m",
        "velocity [rad/s]",
        clouds,
        CloudLook(width=width),
    )


def wrench_plot(curves: specimen_report.SwingCurves, component: int, title: str) -> str:
    """Draw one component of the wrench on the base, measured and predicted."""
    lines = [
        Line(
            time=curves.time, values=curves.wrench[:, component], style="measured", label="measured"
        ),
        Line(
            time=curves.time, values=curves.predicted[:, component], style="left", label="predicted"
        ),
    ]
    return time_plot(
        f"{COMPONENTS[component]} {title}",
        UNITS[component],
        lines,
        _span(curves.time),
        TimeLook(height=170),
    )


def _axis_grid(specimen: SpecimenReport) -> Grid:
    rows = []
    for name, condition in specimen.conditions.items():
        rows.append((TITLES[name], "all", with_interval(condition.viscosity), ""))
        if condition.plate_viscosity is not None:
            words = "from the moment on the plate alone, a check"
            rows.append((TITLES[name], "all", with_interval(condition.plate_viscosity), words))
        for axis, value, excited in zip(
            condition.axes, condition.axis_viscosity, condition.excited, strict=True
        ):
            words = with_interval(value) if excited else LACKING
            rows.append(
                (TITLES[name], axis, words, "" if excited else "the swings hardly excite this axis")
            )
    head = ("Condition", "Axis", "Viscosity [Nms/rad] (95 % interval)", "")
    return Grid(head, tuple(rows), "Viscosity about each axis")


def _muscles(specimen: SpecimenReport, order: int) -> Section | None:
    muscles = specimen.muscles
    if muscles is None or not muscles.muscles:
        return None
    truth = specimen.truth.get("muscle_viscosity")
    levels = [Level(muscles.common.value, "common value", "left")]
    if truth is not None:
        levels.append(Level(truth, "truth", "truth"))
    by_pcsa = muscles.by_pcsa.value * muscles.pcsa
    title = "Viscosity of each muscle, regularised"
    beside = (Beside("scaled by PCSA", "third", by_pcsa),)
    rows = interval_rows(
        title,
        "Ns/m",
        muscles.muscles,
        muscles.by_muscle,
        IntervalLook(beside=beside, levels=levels),
    )
    known = muscles.resolved
    resolved = "" if known is None else f", {known} of them to better than their size"
    lead = (
        f"One value for all muscles: {with_interval(muscles.common)} Ns/m; in proportion to their"
        f" cross-sections, mean {with_interval(muscles.by_pcsa)} Ns/m. The swings determine"
        f" {muscles.rank} of {len(muscles.muscles)} independent combinations{resolved}: the values"
        " of single muscles also come from the regularisation that draws them to the common value."
    )
    legend = [
        ("first", "regularised, with interval"),
        ("third", "in proportion to PCSA"),
        ("left", "common value"),
    ]
    legend += [] if truth is None else [("truth", "truth")]
    return Section(
        key=f"muscles-{order}",
        title=f"Muscles of specimen {specimen.name}",
        lead=lead,
        legend=tuple(legend),
        figures=(Figure(rows, "wide"), Figure(_rank_plot(muscles.singular_values))),
        grids=(_muscle_grid(muscles),),
        listed=False,
    )


def _rank_plot(singular_values: Array) -> str:
    """Draw singular values (muscles,), descending."""
    size = singular_values / max(float(singular_values[0]), 1e-300)
    numbers = np.arange(1.0, len(size) + 1.0)
    height = np.log10(np.maximum(size, 1e-16))
    values = Cloud(x=numbers, y=height, style="first", label="singular values", dotted=True)
    across = "combination of muscles, best known first"
    return xy_plot(
        "Singular values",
        "log₁₀ of the share of the largest",
        across,
        [values],
        CloudLook(zero=False),
    )


def _muscle_grid(muscles: MuscleViscosity) -> Grid:
    """List the values of each muscle."""
    by_pcsa = muscles.by_pcsa.value * muscles.pcsa
    cells = tuple(
        (muscle, with_interval(value), number(float(share)), number(float(scaled)))
        for muscle, value, share, scaled in zip(
            muscles.muscles, muscles.by_muscle, muscles.pcsa, by_pcsa, strict=True
        )
    )
    head = (
        "Muscle",
        "Viscosity [Ns/m] (95 % interval)",
        "PCSA, mean 1",
        "In proportion to PCSA [Ns/m]",
    )
    return Grid(head, cells, "Values of each muscle", folded=True)


def _trust(specimen: SpecimenReport, order: int) -> Section | None:
    """Show how far to trust the values of a specimen; None where nothing tells it."""
    figures = _trust_figures(specimen)
    grids = [
        *_model_grids(specimen),
        *_arm_grid(specimen.arms),
        *_error_grid(specimen),
        *_instrument_grid(specimen),
        *_calibration_grid(specimen),
    ]
    if not figures and not grids:
        return None
    return Section(
        key=f"trust-{order}",
        title=f"Sensitivity: specimen {specimen.name}",
        lead=_trust_lead(specimen),
        legend=_trust_legend(specimen),
        figures=tuple(figures),
        grids=tuple(grids),
        listed=False,
    )


def _trust_figures(specimen: SpecimenReport) -> list[Figure]:
    """Draw swings held out, and what other filters and moment arms would give."""
    figures = [Figure(text) for held in specimen.held_out for text in held_out_plots(held)]
    if specimen.cutoff is not None:
        figures += [Figure(text) for text in cutoff_plots(specimen.cutoff)]
    if specimen.arms is not None:
        figures.append(Figure(arm_plot(specimen.arms, specimen.truth.get("muscle_viscosity"))))
    return figures


def _calibration_grid(specimen: SpecimenReport) -> list[Grid]:
    """List what plate, clocks and bones leave."""
    if not specimen.calibration:
        return []
    rows = tuple(
        (line.what, f"{number(line.value)} {line.unit}", line.detail)
        for line in specimen.calibration
    )
    return [Grid(("Quantity", "Residual", ""), rows, "Calibration")]


def _trust_lead(specimen: SpecimenReport) -> str:
    """Say what was compared."""
    lead = []
    if specimen.models:
        lead.append(
            "Omitted stiffness or dry friction would bias the viscosity, so models with them are"
            " fitted too; an information criterion less by 10 or more is strong evidence."
        )
    if specimen.cutoff is not None and specimen.cutoff.reason:
        lead.append(specimen.cutoff.reason)
    if specimen.arms is not None:
        draws = f"{specimen.arms.draws} times at each level of error"
        lead.append(f"Moment arms were perturbed {draws}; the outer lines hold 95 % of the values.")
    return " ".join(lead)


def _trust_legend(specimen: SpecimenReport) -> tuple[tuple[str, str], ...]:
    """Name the lines of held-out swings and of the scan of cut-offs."""
    names = list(dict.fromkeys(name for held in specimen.held_out for name in held.predicted))
    legend = [("measured", "measured"), *zip(MODELS, names, strict=False)] if names else []
    if specimen.cutoff is not None:
        kinds = ("viscosity", "COM", "mass")
        legend += [(style, f"cut-off: {words}") for style, words in zip(AXES, kinds, strict=True)]
    return tuple(legend)


def _scans(specimen: SpecimenReport, order: int) -> Section | None:
    if not specimen.scans:
        return None
    lead = (
        "Each scanned bone where it lies on the bone of the model, seen from two sides: red places"
        " lie outside it, blue ones inside. The scale of each holds 95 % of its places."
    )
    title = f"CT of specimen {specimen.name}"
    return Section(f"scans-{order}", title, lead, figures=specimen.scans, listed=False)


def held_out_plots(held: specimen_report.HeldOutSwing) -> list[str]:
    """Draw angles of a held-out swing, measured and as each model predicts them [degrees]."""
    span = (float(held.time[0]), float(held.time[-1]))
    result = []
    for column, axis in enumerate(held.axes):
        lines = [
            Line(
                time=held.time,
                values=np.rad2deg(held.measured[:, column]),
                style="measured",
                label="measured",
            )
        ]
        lines += [
            Line(
                time=held.time,
                values=np.rad2deg(values[:, column]),
                style=MODELS[i % len(MODELS)],
                label=name,
            )
            for i, (name, values) in enumerate(held.predicted.items())
        ]
        title = f"Held-out swing {TITLES[held.condition]}, axis {axis}"
        result.append(time_plot(title, "°", lines, span))
    return result


def cutoff_plots(scan: specimen_report.CutoffScan) -> list[str]:
    """Draw how quantities change with the cut-off of the filter, against the chosen one [%]."""
    result = []
    for words, kinds in SCANNED.items():
        clouds = []
        for name, style in zip(kinds, AXES, strict=True):
            if name in scan.values:
                known = np.isfinite(scan.values[name])
                at = np.interp(scan.chosen, scan.cutoffs[known], scan.values[name][known])
                change = 100.0 * (scan.values[name] / at - 1.0)
                clouds.append(
                    Cloud(
                        x=scan.cutoffs,
                        y=change,
                        style=style,
                        label=BY_NAME[name].label,
                        dotted=True,
                    )
                )
        if clouds:
            heights = np.concatenate([cloud.y[np.isfinite(cloud.y)] for cloud in clouds])
            ends = np.array([heights.min(), heights.max()])
            name = f"chosen: {number(scan.chosen)} Hz"
            clouds.append(
                Cloud(x=np.full(2, scan.chosen), y=ends, style="left", label=name, joined=True)
            )
            result.append(xy_plot(f"Change with the cut-off, {words}", "%", "cut-off [Hz]", clouds))
    return result


def arm_plot(arms: specimen_report.ArmSpread, truth: float | None) -> str:
    """Draw the common muscle viscosity against the error of the moment arms."""
    across = 100.0 * arms.errors
    clouds = [
        Cloud(x=across, y=arms.high, style="second", label="97.5 % of the draws", joined=True),
        Cloud(x=across, y=arms.median, style="first", label="median of the draws", dotted=True),
        Cloud(x=across, y=arms.low, style="second", label="2.5 % of the draws", joined=True),
    ]
    if truth is not None:
        clouds.append(
            Cloud(x=across[[0, -1]], y=np.full(2, truth), style="truth", label="truth", joined=True)
        )
    return xy_plot(
        "Muscle viscosity, moment arms in error",
        "Ns/m",
        "standard deviation of their error [%]",
        clouds,
    )


def _model_grids(specimen: SpecimenReport) -> list[Grid]:
    """List of each condition the models that come nearest, and always plain viscosity."""
    grids = []
    head = (
        "Model",
        "Values",
        "AIC over best",
        "BIC over best",
        "Held-out angle",
        "Held-out moment",
    )
    for condition, words in TITLES.items():
        models = sorted(
            (model for model in specimen.models if model.condition == condition),
            key=lambda model: model.bic,
        )
        near = [
            model
            for i, model in enumerate(models)
            if i < MAX_MODELS or model.chosen or model.terms == "viscosity"
        ]
        rows = []
        for model in near:
            errors = (float(np.rad2deg(model.angle_error)), "°"), (model.wrench_error, "N·m")
            told = (
                f"{number(error)} {unit}" if np.isfinite(error) else LACKING
                for error, unit in errors
            )
            terms = model.terms + (" (chosen)" if model.chosen else "")
            rows.append((terms, model.values, _signed(model.aic), _signed(model.bic), *told))
        if rows:
            left = (
                f"; {len(models) - len(near)} more are in models.csv"
                if len(near) < len(models)
                else ""
            )
            grids.append(
                Grid(head, tuple(rows), f"Models of the passive torque {words}, best first{left}")
            )
    return grids


def _arm_grid(arms: specimen_report.ArmSpread | None) -> list[Grid]:
    if arms is None or not arms.kinds:
        return []
    rows = []
    for kind in arms.kinds:
        percent = f"{100.0 * kind.sd:.1f} %", f"{100.0 * kind.bias:+.1f} %".replace("-", "−")
        rows.append(
            (
                kind.kind,
                kind.size,
                *percent,
                with_interval(Interval(kind.median, kind.low, kind.high)),
            )
        )
    head = (
        "Error of the moment arms",
        "Its SD",
        "SD of the viscosity",
        "Bias",
        "Viscosity [Ns/m] (95 % of draws)",
    )
    return [Grid(head, tuple(rows), "Muscle viscosity with moment arms in error")]


def _error_grid(specimen: SpecimenReport) -> list[Grid]:
    """List what swings, instruments and model add to each result, and which adds most."""
    quantities = list(dict.fromkeys(each.quantity for each in specimen.errors))
    sources = list(dict.fromkeys(each.source for each in specimen.errors))
    if not quantities:
        return []
    share = {(each.quantity, each.source): each.share for each in specimen.errors}
    rows = []
    for quantity in quantities:
        shares = [share.get((quantity, source), 0.0) for source in sources]
        most = sources[int(np.argmax(shares))].replace("_", " ")
        rows.append((where(BY_NAME[quantity]), *(f"{100.0 * part:.0f} %" for part in shares), most))
    head = ("Result", *(source.replace("_", " ") for source in sources), "Adds most")
    return [
        Grid(head, tuple(rows), "Error budget: share of each source in the variance of each result")
    ]


def _instrument_grid(specimen: SpecimenReport) -> list[Grid]:
    """List errors of instruments as assumed and as the swings show them."""
    if specimen.instruments is None:
        return []
    rows = []
    for source, axis, prior, error, left in specimen.instruments.rows:
        factor, unit = SHOWN_IN[source]
        # Added to 0, what is rounded to it loses its sign.
        shown = (
            f"{round(factor * value, 2) + 0.0:.2f}".replace("-", "−")
            for value in (prior, error, left)
        )
        rows.append((source.replace("_", " "), axis, unit, *shown))
    head = ("Source", "Axis", "Unit", "SD assumed", "From the swings, taken off", "SD left")
    return [Grid(head, tuple(rows), "Errors of instruments, and their estimates from the swings")]


def _signed(value: float) -> str:
    if value == 0.0:
        return "best"
    if np.isfinite(value):
        return f"+{number(value)}"
    return LACKING


def _known_beside(specimens: Sequence[SpecimenReport], name: str) -> list[Beside]:
    """Take true and printed values of a quantity, of kinds that any specimen has."""
    beside = []
    for kind in ("truth", "paper"):
        known = [getattr(specimen, kind) for specimen in specimens]
        if any(known):
            values = np.array([values.get(name, np.nan) for values in known])
            beside.append(Beside(kind, kind, values))
    return beside


def cohort_section(specimens: Sequence[SpecimenReport], levels: dict[str, list[Level]]) -> Section:
    """Show every quantity as bars with intervals, with the paper's and the true values."""
    names = [specimen.name for specimen in specimens]
    figures = []
    for name, quantity in BY_NAME.items():
        values = [specimen.row.get(name) for specimen in specimens]
        if not any(value is not None for value in values):
            continue
        beside = _known_beside(specimens, name)
        bars = interval_bars(
            where(quantity),
            quantity.unit,
            names,
            values,
            IntervalLook(beside=beside, levels=levels.get(name, [])),
        )
        figures.append(Figure(bars))
    legend = [("first", "estimate, with its 95 % interval"), ("mean", "mean and population SD")]
    legend += [("truth", "truth")] if any(specimen.truth for specimen in specimens) else []
    legend += (
        [("paper", "paper, the same specimen")]
        if any(specimen.paper for specimen in specimens)
        else []
    )
    literature = any(mark.style == "limit" for each in levels.values() for mark in each)
    legend += [("limit", "literature")] if literature else []
    return Section(
        key="cohort", title="All specimens", lead="", legend=tuple(legend), figures=tuple(figures)
    )
