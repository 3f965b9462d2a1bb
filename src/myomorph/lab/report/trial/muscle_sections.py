"""The sections on muscles: activations, tensions, EMG, lengths, elastic tendons.

Those on elastic tendons show fibers and tendons.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import few
from myomorph.core.model.series import Series
from myomorph.core.model.sides import split_side
from myomorph.core.tension.emg_conflicts import APART, BORNE, EmgConflict
from myomorph.core.tension.quantities import ACTIVATION
from myomorph.core.tension.tension import Fibers, Tension
from myomorph.lab.analysis.columns import extremes
from myomorph.lab.analysis.cycles import band
from myomorph.lab.analysis.length_analysis import RANGE_HEAD, LengthAnalysis, range_row
from myomorph.lab.analysis.muscle_names import muscle_words
from myomorph.lab.analysis.selection import Pair, major_muscles
from myomorph.lab.report.charts.axis import number
from myomorph.lab.report.charts.curves import CycleCurve, Line, TimeLook, cycle_chart, time_plot
from myomorph.lab.report.page.parts import SIDES_LEGEND, Figure, Grid, Section
from myomorph.lab.report.trial.figures import (
    Activations,
    PairSeries,
    activation_panel,
    emg_panel,
    pair_panel,
    tension_map,
)
from myomorph.lab.report.trial.prepared import Prepared

CONFLICT_HEAD = (
    "Muscle",
    "From",
    "To",
    "Largest difference at",
    "Activation from EMG",
    "Activation in the solution",
)
RESERVE_HEAD = ("Coordinate", "From", "To", "Maximum at", "Required torque", "Reserve torque")
SHOWN = 20  # Rows above which a table is folded away.


def emg_of(prepared: Prepared, pair: Pair) -> list[tuple[str, Array, Array]]:
    """Find the measured channels on the muscles of a pair.

    Parameters
    ----------
    prepared : results with the recorded EMG
    pair : of muscles

    Returns
    -------
    Side, time (samples,) [s] and envelope (samples,) of each channel
    """
    emg = prepared.results.recorded.emg
    if emg is None:
        return []
    result = []
    for channel, muscles in prepared.results.recorded.emg_muscles.items():
        if channel not in emg.names:
            continue
        for side, members in pair.members.items():
            if set(members) & set(muscles):
                result.append((side, emg.time, emg[channel]))
    return result


def matched_emg(prepared: Prepared) -> bool:
    """Whether the muscles of some EMG channel are known."""
    emg = prepared.results.recorded.emg
    return emg is not None and any(
        name in emg.names for name in prepared.results.recorded.emg_muscles
    )


def activation_section(prepared: Prepared) -> Section | None:
    """Sixteen muscles on both sides, EMG behind where it was measured on them."""
    results = prepared.results
    tension = results.tension
    series = results.activations
    if tension is None or series is None:
        return None
    mean = np.nanmean(tension.muscle_force, axis=0) if len(tension.muscle_force) else None
    chosen = major_muscles(tension.muscles, mean)
    shown = (prepared.detail, prepared.events)
    spread = results.uncertainty.spreads.get(ACTIVATION.name)
    activations = Activations(
        series=series,
        muscles=tension.muscles,
        strengths=results.strengths,
        truth=results.recorded.truth.activations if results.recorded.truth else None,
        spread=spread,
    )
    figures = []
    for pair in chosen:
        measured = emg_of(prepared, pair)
        drawn = activation_panel(pair, activations, *shown, measured)
        figures.append(Figure(drawn, "quarter"))
    several = any(len(members) > 1 for pair in chosen for members in pair.members.values())
    lead = f"{len(chosen)} of {len(tension.muscles)} muscles"
    lead += "; of a muscle in parts, the mean weighted by strength" if several else ""
    lead += "" if spread is None else "; bands hold 90 % of the draws, for muscles of one part"
    legend = SIDES_LEGEND
    if matched_emg(prepared):
        lead += (
            ". EMG envelopes have the scale of their file and are not comparable to activations in"
            " magnitude"
        )
        legend += (("emg", "EMG"),)
    if activations.truth is not None:
        legend += (("truth", "truth"),)
    return Section(
        key="activations",
        title="Muscle activations",
        lead=f"{lead}.{prepared.detail_note}",
        legend=legend,
        figures=tuple(figures),
    )


def tension_section(prepared: Prepared) -> Section | None:
    """All muscles at once, and the largest in a table."""
    tension = prepared.results.tension
    if tension is None or not len(tension.time) or not len(tension.muscles):
        return None
    drawing = tension_map(tension.time, tension.muscle_force, tension.muscles, prepared.events)
    forces = Series(tension.time, tension.muscles, tension.muscle_force)
    rows = []
    strengths = prepared.results.strengths
    for row in sorted(extremes(forces), key=lambda extreme: -extreme.high):
        active = number(float(np.nanmax(tension.activation[:, tension.muscles.index(row.name)])))
        most = strengths.get(row.name, 0.0)
        share = f"{number(100 * row.high / most)} %" if most > 0 else "–"
        mean = f"{number(float(np.nanmean(forces[row.name])))} N"
        rows.append(
            (
                muscle_words(row.name),
                f"{number(row.high)} N",
                f"{number(row.high_time, 0.001)} s",
                mean,
                share,
                active,
            )
        )
    head = (
        "Muscle",
        "Maximum tension",
        "Time",
        "Mean",
        "Share of maximum isometric force",
        "Maximum activation",
    )
    lead = (
        "Force along the tendon of every muscle, from hip to ankle on each side. In long recordings"
        " every column shows the maximum of its frames."
    )
    grid = Grid(
        head=head,
        rows=tuple(rows),
        title=f"All {len(rows)} muscles, largest tension first",
        folded=True,
    )
    return Section(
        key="tensions",
        title="Muscle tensions",
        lead=lead,
        legend=(),
        figures=(Figure(drawing, "full"),),
        grids=(grid,),
    )


def emg_section(prepared: Prepared) -> Section | None:
    """Channels whose muscle is not known, or not among those drawn above."""
    emg = prepared.results.recorded.emg
    on_muscles = prepared.results.recorded.emg_muscles
    if emg is None:
        return None
    drawn: set[str] = set()
    if prepared.results.tension is not None:
        chosen = major_muscles(prepared.results.tension.muscles, None)
        shown = {name for pair in chosen for name in pair.names}
        drawn = {channel for channel, muscles in on_muscles.items() if shown & set(muscles)}
    left = [name for name in emg.names if name not in drawn]
    if not left:
        return None
    unknown = [name for name in left if name not in on_muscles]
    lead = "Envelopes as measured."
    if unknown:
        lead += f" The recording does not specify their muscles: {few(unknown, 16)}."
    figures = []
    for name in left[:32]:
        title = name if name in unknown else f"{name} ({few(on_muscles[name], 4)})"
        chart = emg_panel(title, emg.time, emg[name], prepared.detail, prepared.events)
        figures.append(Figure(chart, "quarter"))
    return Section(key="emg", title="EMG", lead=lead, legend=(), figures=tuple(figures))


def emg_conflict_section(prepared: Prepared) -> Section | None:
    """Stretches in which muscles leave their EMG, and in which reserves bear what EMG leaves."""
    conflicts = prepared.results.emg_conflicts
    if conflicts is None:
        return None
    muscles = [conflict for conflict in conflicts if conflict.muscle]
    reserves = [conflict for conflict in conflicts if conflict.coordinate]
    lead = (
        f"Where the joint torques need an activation that is more than {APART:g} from the muscle's"
        f" EMG, or leave more than {BORNE:.0%} of a joint's largest torque to a reserve actuator:"
        " gains, the"
        " model's moment arms or the torques are wrong there, or the EMG is."
    )
    if not conflicts:
        lead = (
            "EMG and joint torques are consistent: no muscle deviates from its EMG, and no reserve"
            " replaces it."
        )
    grids = tuple(
        Grid(head, tuple(map(_conflict_row, rows)), title, folded=len(rows) > SHOWN)
        for title, head, rows in (
            ("Muscles", CONFLICT_HEAD, muscles),
            ("Reserves", RESERVE_HEAD, reserves),
        )
    )
    return Section("emg-conflicts", "EMG against joint torques", lead, grids=grids)


def _conflict_row(conflict: EmgConflict) -> tuple[str, ...]:
    times = (
        f"{number(value, 0.001)} s" for value in (conflict.start, conflict.stop, conflict.worst)
    )
    if conflict.muscle:
        values = (number(conflict.emg, 0.01), number(conflict.found, 0.01))
        return muscle_words(conflict.muscle), *times, *values
    return conflict.coordinate, *times, number(conflict.emg), number(conflict.found)


def length_section(prepared: Prepared) -> Section | None:
    """Muscle-tendon lengths, where tensions were not solved."""
    lengths = prepared.results.muscles.lengths
    if lengths is None or prepared.results.tension is not None or not len(lengths):
        return None
    figures = tuple(
        Figure(
            pair_panel(
                pair.label,
                _first_parts(pair),
                PairSeries(series=lengths, unit="mm", factor=1000.0),
                (prepared.detail, prepared.events),
            )
        )
        for pair in major_muscles(lengths.names, None)
    )
    return Section(
        key="lengths",
        title="Muscle-tendon lengths",
        lead="From origin to insertion around bones.",
        legend=SIDES_LEGEND,
        figures=figures,
    )


def _first_parts(pair: Pair) -> Pair:
    members = {side: names[:1] for side, names in pair.members.items()}
    several = any(len(names) > 1 for names in pair.members.values())
    part = split_side(next(iter(members.values()))[0])[0]
    return Pair(f"{pair.label} ({part})" if several else pair.label, members)


def length_cycle_section(prepared: Prepared) -> Section | None:
    """Muscle-tendon lengths over the stride, right and left together."""
    analysis = prepared.lengths
    if analysis is None or not analysis.ranges:
        return None
    moving = {span.muscle: span.excursion for span in analysis.ranges}
    most = np.array([moving.get(name, 0.0) for name in analysis.muscles])
    chosen = [
        pair for pair in major_muscles(analysis.muscles, most) if moving.keys() & set(pair.names)
    ]
    figures = tuple(Figure(stride_chart(analysis, pair)) for pair in chosen)
    counts = ", ".join(f"{len(stride)} of {limb}" for limb, stride in analysis.strides.items())
    lead = (
        f"From foot strike to foot strike of each muscle's own side ({counts}): as plates show it,"
        " else as events of the recording, else where the foot is farthest ahead of the trunk."
        " Thin lines are strides; the band is the 95 % interval of their mean. Velocities in the"
        " table are means of each stride's maximum, in optimal fiber lengths a second; 'standing'"
        " is the model's default pose."
    )
    rows = tuple(map(range_row, analysis.ranges))
    grid = Grid(
        head=RANGE_HEAD, rows=rows, title=f"All {len(rows)} muscles over a stride", folded=True
    )
    return Section(
        key="length_cycles",
        title="Muscle lengths over the stride",
        lead=lead,
        legend=SIDES_LEGEND,
        figures=figures,
        grids=(grid,),
    )


def stride_chart(analysis: LengthAnalysis, pair: Pair) -> str:
    """Every stride of a muscle on both sides, its mean and interval [mm]."""
    drawn = []
    for side, names in pair.members.items():
        strides = 1e3 * analysis.curves(names[0])
        mean = band(strides)
        drawn.append(
            CycleCurve(
                mean=mean.mean,
                style=side or "right",
                label=names[0],
                interval=(mean.low, mean.high),
                each=strides,
            )
        )
    several = any(len(names) > 1 for names in pair.members.values())
    title = f"{pair.label} ({split_side(drawn[0].label)[0]})" if several else pair.label
    return cycle_chart(title, "mm", drawn, [values for curve in drawn for values in curve.each])


FIBER_STYLES = ("first", "second")
RIGID_HEAD = ("Muscle", "From", "Normalized fiber length", "Reason")
FIBER_PAIRS = 8  # Pairs of muscles that are drawn.


def fiber_section(prepared: Prepared) -> Section | None:
    """Show normalized fiber lengths, tendon strains, and powers of fiber and tendon.

    They are those of the major muscles.
    """
    tension = prepared.results.tension
    if (
        tension is None
        or tension.fibers is None
        or not len(tension.time)
        or prepared.results.model is None
    ):
        return None
    fibers = tension.fibers
    mean = np.nan_to_num(tension.muscle_force).mean(axis=0)
    elastic = [name for name in tension.muscles if name not in fibers.rigid]
    by_name = dict(zip(tension.muscles, mean, strict=True))
    pairs = (
        major_muscles(elastic, np.array([by_name[name] for name in elastic]))[:FIBER_PAIRS]
        if elastic
        else ()
    )
    figures = tuple(
        Figure(chart) for pair in pairs for chart in _fiber_charts(prepared, tension, fibers, pair)
    )
    lead = (
        "Fibers and tendons as elastic tendons let them move. A tendon's power is positive where it"
        " gives back what it stored. Thin lines: frames near an end, where the unknown past or"
        " future still has an effect."
    )
    certificate = fibers.certificate
    lead += f" Optimality conditions hold within {number(certificate.residual)}"
    if np.isfinite(certificate.second_activations):
        lead += f"; another start ends {number(certificate.second_activations)} away in activation"
    lead += "."
    if fibers.bridged.any():
        lead += (
            f" In {int(fibers.bridged.sum())} frames torques or coordinates were missing and"
            " interpolated."
        )
    legend = (("first", "right, or fiber"), ("second", "left, or tendon"))
    return Section(
        key="fibers",
        title="Fibers and tendons",
        lead=lead,
        legend=legend,
        figures=figures,
        grids=_rigid_grids(tension, fibers),
    )


def _fiber_charts(
    prepared: Prepared, tension: Tension, fibers: Fibers, pair: Pair
) -> Iterator[str]:
    """Length and strain of both sides, and powers of the first."""
    model = prepared.results.model
    assert model is not None
    columns = [(names[0], tension.muscles.index(names[0])) for names in pair.members.values()][
        : len(FIBER_STYLES)
    ]
    optimal = [model.muscle(name).optimal_fiber_length for name, _ in columns]
    normal = [
        fibers.fiber_length[:, m] / optimum
        for (_, m), optimum in zip(columns, optimal, strict=True)
    ]
    strains = [100.0 * fibers.tendon_strain[:, m] for _, m in columns]
    names = [name for name, _ in columns]
    first, at = columns[0]
    powers = [fibers.fiber_power[:, at], fibers.tendon_power[:, at]]
    charts = (
        # Longer headings, "Biceps femoris, long head: fiber length", run into that of the chart
        # beside.
        (f"{pair.label}: fiber", "optimal lengths", normal, names, 1.0),
        (f"{pair.label}: tendon strain", "%", strains, names, 0.0),
        (f"{first}: power", "W", powers, ["fiber", "tendon"], 0.0),
    )
    for title, unit, values, labels, low in charts:
        lines = _fiber_lines(tension.time, values, labels, fibers.transient)
        yield time_plot(
            title, unit, lines, prepared.detail, TimeLook(events=prepared.events, low=low)
        )


def _fiber_lines(
    time: Array, values: list[Array], labels: list[str], ends: np.ndarray
) -> list[Line]:
    """Lines of what may be believed, and thinner ones of the ends."""
    result = []
    for value, label, style in zip(values, labels, FIBER_STYLES, strict=False):
        result.append(
            Line(time=time, values=np.where(ends, np.nan, value), style=style, label=label)
        )
        if ends.any():
            # One frame more on the inner side, so that the lines meet.
            wide = ends.copy()
            wide[1:] |= ends[:-1]
            wide[:-1] |= ends[1:]
            result.append(
                Line(
                    time=time,
                    values=np.where(wide, value, np.nan),
                    style=f"{style} thin",
                    label=f"{label}, near an end",
                )
            )
    return result


def _rigid_grids(tension: Tension, fibers: Fibers) -> tuple[Grid, ...]:
    """Muscles on rigid tendons: those that cannot reach with place and size, the others by name."""
    rows = []
    for unreachable in fibers.unreachable:
        why = (
            "path shorter than the slack tendon" if unreachable.worst <= 0.0 else "fibers too long"
        )
        start = f"{number(tension.time[unreachable.frame], 0.001)} s"
        rows.append((muscle_words(unreachable.muscle), start, number(unreachable.worst), why))
    cannot = {unreachable.muscle for unreachable in fibers.unreachable}
    rows += [
        (name, "", "", "rigid in the model, or without curves")
        for name in fibers.rigid
        if name not in cannot
    ]
    return (
        (
            Grid(
                head=RIGID_HEAD,
                rows=tuple(rows),
                title="Muscles on rigid tendons",
                folded=len(rows) > 12,
            ),
        )
        if rows
        else ()
    )
