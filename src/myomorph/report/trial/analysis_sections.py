"""A motion on one time axis: pictures, height, contacts and muscles, as figures 5.2 to 5.8 of [D]."""

from __future__ import annotations

import numpy as np

from myomorph.analysis.contact_states import graph_rows
from myomorph.model.errors import BadData
from myomorph.model.series import Series
from myomorph.report.charts.axis import scaled_unit
from myomorph.report.charts.curves import Line
from myomorph.report.charts.marks import Level
from myomorph.report.charts.pictures import even_times, fitting, nearest_frames, picture_strip
from myomorph.report.charts.tracks import Backdrop, contact_graph, draw_track, phase_names, row_title, time_axis
from myomorph.report.page.parts import Figure, Section
from myomorph.report.scene.scene import make_scene
from myomorph.report.trial.center_section import center_section
from myomorph.report.trial.contact_panel import between_tracks, contact_force_section
from myomorph.report.trial.estimated_forces import acting_forces
from myomorph.report.trial.figures import STYLE
from myomorph.report.trial.motion_analysis import (
    MotionAnalysis,
    Person,
    analyse,
    column_name,
    person_legend,
    person_styles,
)
from myomorph.report.trial.muscle_sections import emg_of
from myomorph.report.trial.prepared import Prepared
from myomorph.report.trial.relation_tables import correlation_section, cut_words, phase_section

MUSCLE_ROW = 31
TOPS = (0.1, 0.2, 0.3, 0.5, 0.75, 1.0)


def score_section(prepared: Prepared, analysis: MotionAnalysis, behind: Backdrop) -> Section:
    """Pictures, height, contacts and muscles under each other, as figures 5.2 to 5.8 of [D]."""
    rows = [phase_names(behind), _pictures(prepared, analysis, behind)]
    if analysis.persons:
        rows.append(_heights(analysis, behind))
    rows += between_tracks(prepared, behind, analysis.who)
    graph = graph_rows(analysis.contacts, analysis.who) if analysis.contacts is not None else ()
    rows.append(contact_graph(graph, behind, analysis.who))
    for person in analysis.persons:
        rows += _muscles(prepared, analysis, person, behind)
    rows.append(time_axis(behind))
    legend = []
    if analysis.activations is not None or any(row.side for row in graph):
        legend = [("right", "right"), ("left dotted", "left")]
    if len(analysis.persons) > 1:
        legend += person_legend(analysis)
    if any(_measured(prepared, person) for person in analysis.persons):
        legend.append(("emg", "EMG"))
    return Section(
        "analysis",
        f"{analysis.preset.title}: pictures, contacts and muscles",
        _lead(analysis, bool(graph)),
        tuple(legend),
        (Figure("".join(rows), "full"),),
    )


def _lead(analysis: MotionAnalysis, graph: bool) -> str:
    lines = ["One time axis for all rows."]
    if analysis.activations is not None:
        lines.append(f"Activations from 0 to {_top(analysis.activations):g}.")
    if graph and analysis.contacts is not None:
        lines.append("Lines are contact intervals: a filled dot at the start, an open dot at the end.")
        if any(interval.source == "sound" for interval in analysis.contacts.intervals):
            lines.append("Impacts: ✳ right hand, + left hand, ○ right foot, × left foot.")
    lines.append(cut_words(analysis))
    if analysis.persons and analysis.activations is not None:
        lacking = tuple(dict.fromkeys(name for person in analysis.persons for name in person.lacking))
        if lacking:
            lines.append(f"The model lacks: {'; '.join(lacking)}.")
    if not analysis.chosen:
        lines.append(f"The preset “{analysis.preset.name}” was chosen automatically.")
    return " ".join(line for line in lines if line)


def _pictures(prepared: Prepared, analysis: MotionAnalysis, behind: Backdrop) -> str:
    """The body at even times, or at those asked for."""
    results, motion = prepared.results, prepared.results.kinematics.motion
    if results.model is None or motion is None or not results.model.bodies:
        return ""
    good = np.flatnonzero(np.isfinite(motion.values).all(axis=1))
    if not len(good):
        return ""
    (first, last), wanted = behind.span, results.analysis.times
    if not wanted:
        frames = nearest_frames(motion.time, good, even_times(behind.span, analysis.preset.pictures))
        count = fitting(make_scene(results.model, motion, frames, results.surfaces), analysis.preset.pictures)
        wanted = even_times(behind.span, count)
    inside = [time for time in wanted if first - 1e-6 <= time <= last + 1e-6]
    if not inside:
        times = ", ".join(f"{time:g}" for time in wanted)
        raise BadData(f"no picture at {times} s: the motion lasts from {first:g} to {last:g} s")
    frames = nearest_frames(motion.time, good, inside)
    scene = make_scene(results.model, motion, frames, results.surfaces, results.activations, acting_forces(results))
    return picture_strip(scene, behind)


def _heights(analysis: MotionAnalysis, behind: Backdrop) -> str:
    """Height of every person's center of gravity, of a single one with that of its first rest."""
    factor, unit = scaled_unit("m", *(person.center.values[:, 0] for person in analysis.persons))
    lines = [
        Line(person.center.time, factor * person.center.values[:, 0], style, person.who.name or "height")
        for person, style in zip(analysis.persons, person_styles(analysis), strict=True)
    ]
    still = analysis.persons[0].still if len(analysis.persons) == 1 else float("nan")
    levels = [Level(factor * still, "at rest", "middle")] if np.isfinite(still) else []
    return draw_track(behind, "Height of COG", unit, lines, 86, levels=levels)


def _measured(prepared: Prepared, person: Person) -> bool:
    return any(emg_of(prepared, pair) for pair in person.muscles)


def _muscles(prepared: Prepared, analysis: MotionAnalysis, person: Person, behind: Backdrop) -> list[str]:
    """One row a muscle, right solid and left dotted, EMG as areas behind."""
    series = analysis.activations
    if series is None or not person.muscles:
        return []
    rows = []
    if person.who.name:
        rows.append(row_title(f"Muscles of {person.who.name}"))
    peak = _top(series)
    for pair in person.muscles:
        lines = [
            Line(time, values, f"emg {STYLE[side]}", f"EMG {side}".strip(), True)
            for side, time, values in emg_of(prepared, pair)
        ]
        for side in pair.members:
            name = column_name(person, pair, side)
            if name in series.names:
                style = f"{STYLE[side]} dotted" if side == "left" else STYLE[side]
                lines.append(Line(series.time, series[name], style, side or "activation"))
        rows.append(draw_track(behind, pair.label, "", lines, MUSCLE_ROW, low=0.0, high=peak, small=True))
    return rows


def _top(series: Series) -> float:
    """Top of the muscles' rows: a round number over the largest activation, 1 or less where they are activations."""
    largest = float(np.nanmax(series.values, initial=0.0)) if np.isfinite(series.values).any() else 1.0
    return next((top for top in TOPS if top >= largest), largest)


MAX_SCORE_TIME = 120.0
MAX_STRIPES = 60


def analysis_sections(prepared: Prepared) -> list[Section]:
    """The sections on the motion that the results allow."""
    analysis = analyse(prepared)
    if analysis is None:
        return []
    behind = _backdrop(prepared, analysis)
    sections = (
        score_section(prepared, analysis, behind),
        center_section(prepared, analysis, behind),
        phase_section(analysis),
        contact_force_section(prepared, behind, analysis.who),
        correlation_section(analysis),
    )
    return [section for section in sections if section is not None]


def _backdrop(prepared: Prepared, analysis: MotionAnalysis) -> Backdrop:
    """The whole motion, or of a very long one the part that other charts show."""
    long = prepared.span[1] - prepared.span[0] > MAX_SCORE_TIME
    span = prepared.detail if long else prepared.span
    phases = tuple(phase for phase in analysis.cutting.phases if phase.stop > span[0] and phase.start < span[1])
    events = prepared.events if analysis.cutting.by in ("events", "given") else ()
    return Backdrop(span, phases if len(phases) <= MAX_STRIPES else (), events)
