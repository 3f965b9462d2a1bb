"""The sections on a motion, all on one time axis, and on its center of gravity.

They follow figures 5.2 to 5.8 of [D].
"""

from __future__ import annotations

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData
from myomorph.lab.analysis.contact_states import graph_rows
from myomorph.lab.analysis.cycles import Periodicity
from myomorph.lab.report.charts.axis import number, scaled_unit
from myomorph.lab.report.charts.curves import Line
from myomorph.lab.report.charts.marks import Level
from myomorph.lab.report.charts.pictures import even_times, fitting, nearest_frames, picture_strip
from myomorph.lab.report.charts.points import FloorLook, floor_plot
from myomorph.lab.report.charts.tracks import (
    Backdrop,
    TrackLook,
    contact_graph,
    draw_track,
    phase_names,
    row_title,
    time_axis,
)
from myomorph.lab.report.page.parts import Figure, Grid, Section
from myomorph.lab.report.scene.scene import Acting, make_scene
from myomorph.lab.report.trial import motion_analysis
from myomorph.lab.report.trial.contact_panel import between_tracks, contact_force_section
from myomorph.lab.report.trial.estimated_forces import acting_forces
from myomorph.lab.report.trial.figures import ORDINAL, STYLE, Ground
from myomorph.lab.report.trial.motion_analysis import MotionAnalysis, Person
from myomorph.lab.report.trial.muscle_sections import emg_of
from myomorph.lab.report.trial.prepared import Prepared
from myomorph.lab.report.trial.relation_tables import correlation_section, cut_words, phase_section

THIN = 8.0
SECOND_CAPTION = "Both are detrended; each axis has its own scale."


def center_section(
    prepared: Prepared, analysis: MotionAnalysis, behind: Backdrop
) -> Section | None:
    """Center of gravity in three axes, its path on the ground and whether it repeats."""
    if not analysis.persons:
        return None
    drawn = []
    for index, axis in enumerate(analysis.axes):
        lines = [
            Line(
                time=person.center.time,
                values=person.center.values[:, index],
                style=style,
                label=person.who.name or axis,
            )
            for person, style in zip(
                analysis.persons, motion_analysis.person_styles(analysis), strict=True
            )
        ]
        drawn.append(draw_track(behind, axis.capitalize(), "m", lines))
    figures = [Figure("".join([phase_names(behind), *drawn, time_axis(behind)]), "full")]
    for path in (_path(prepared, analysis), _upright_path(analysis)):
        if path:
            figures.append(
                Figure(
                    path, "medium", _path_caption(analysis) if len(figures) == 1 else SECOND_CAPTION
                )
            )
    lead = " ".join(_printed(analysis, person) for person in analysis.persons)
    legend = tuple(motion_analysis.person_legend(analysis)) if len(analysis.persons) > 1 else ()
    grids = (_center_grid(analysis),)
    return Section(
        key="center-of-gravity",
        title="Center of gravity",
        lead=lead,
        legend=legend,
        figures=tuple(figures),
        grids=grids,
    )


def _path(prepared: Prepared, analysis: MotionAnalysis) -> str:
    """Draw the way over the ground from above, its origin where it starts (figure 5.7 of [D])."""
    ground = Ground.under(prepared.up)
    # Columns of `center`: vertical, then the two axes of the ground in order.
    center = analysis.persons[0].center
    phases = analysis.cutting.phases
    begun = center.time >= (phases[0].start if phases else center.time[0]) - 1e-9
    start = center.values[begun, 1:]
    start = start[np.isfinite(start).all(axis=1)]
    if not len(start):
        return ""
    moved = [(person.center.values[:, 1:] - start[0]) * ground.signs for person in analysis.persons]
    paths = _by_stage(analysis, moved)
    far = _extent(np.concatenate([path for _, _, path in paths])).max() > 0.5
    factor, unit = (1.0, "m") if far else (1e3, "mm")
    shown = [(label, style, factor * path) for label, style, path in paths]
    title = "Path over the ground, from above"
    level = not _thin([path for _, _, path in paths])
    return floor_plot(
        title, ground.axes, shown, look=FloorLook(width=505, height=300, unit=unit, one_scale=level)
    )


def _thin(paths: list[Array]) -> bool:
    """Check whether paths (frames, 2) together are too long and thin for one scale.

    One scale would hide their width.
    """
    extent = _extent(np.concatenate(paths))
    return bool(extent.max() > THIN * extent.min() > 0.0)


def _extent(points: Array) -> Array:
    """Find the largest less the smallest of every column (columns,), over the known rows.

    It is 0 where none is known.
    """
    known = points[np.isfinite(points).all(axis=1)]
    return np.ptp(known, axis=0) if len(known) else np.zeros(points.shape[1])


def _upright_path(analysis: MotionAnalysis) -> str:
    """Draw the height over the horizontal axis along which less is gone [mm].

    Straight lines of both are taken off.
    """
    axis = 1 + int(
        np.argmin(
            np.sum([_extent(person.center.values) for person in analysis.persons], axis=0)[1:]
        )
    )
    paths = [
        1000.0 * motion_analysis.leveled(person.center).values[:, [axis, 0]]
        for person in analysis.persons
    ]
    across = (analysis.axes[axis], analysis.axes[0])
    title = f"Height over {analysis.axes[axis]}"
    return floor_plot(
        title,
        across,
        _by_stage(analysis, paths),
        look=FloorLook(width=505, height=300, unit="mm", one_scale=False),
    )


def _by_stage(analysis: MotionAnalysis, points: list[Array]) -> list[tuple[str, str, Array]]:
    """Paths (frames, 2) of all persons; of a single one, a color a stage where there are few."""
    stages = analysis.cutting.stages
    if len(points) > 1 or not 2 <= len(stages) <= len(ORDINAL):
        styles = ["first"] if len(points) == 1 else motion_analysis.person_styles(analysis)
        names = [person.who.name or "center of gravity" for person in analysis.persons]
        return list(zip(names, styles, points, strict=True))
    time = analysis.persons[0].center.time
    return [
        (
            stage.name,
            ORDINAL[j],
            np.where(_reaching(stage.inside(time))[:, None], points[0], np.nan),
        )
        for j, stage in enumerate(stages)
    ]


def _reaching(inside: np.ndarray) -> np.ndarray:
    """Frames and the one after each stretch, so that the parts of a line meet."""
    result = inside.copy()
    result[1:] |= inside[:-1]
    return result


def _path_caption(analysis: MotionAnalysis) -> str:
    stages = analysis.cutting.stages
    printed = "The origin is the start of the first phase."
    if _thin([person.center.values[:, 1:] for person in analysis.persons]):
        printed += " Each axis has its own scale."
    if len(analysis.persons) == 1 and 2 <= len(stages) <= len(ORDINAL):
        colors = zip(stages, ("blue", "violet", "green", "ochre"), strict=False)
        phases = ", ".join(f"{stage.name} {color}" for stage, color in colors)
        printed += f" Phases: {phases}."
    return printed


def _printed(analysis: MotionAnalysis, person: Person) -> str:
    """How low a center of gravity is, and which of its axes repeat, as one sentence."""
    rest, mean = person.standing
    printed = []
    if np.isfinite(mean) and rest > 0.1 * mean:
        less = 100 * (mean - rest)
        way = "lower" if less < 0 else "higher"
        than = f"{number(abs(less), 0.1)} cm {way} than in the model's default posture"
        printed.append(f"on average {number(100 * mean, 0.1)} cm above the lowest joint, {than}")
    if np.isfinite(person.still):
        less = 1000 * (float(np.nanmean(person.center.values[:, 0])) - person.still)
        where = "below" if less < 0 else "above"
        printed.append(f"{number(abs(less), 1.0)} mm {where} its height at rest at the start")
    repeats = []
    for axis, period in zip(analysis.axes, person.periods, strict=True):
        if period.periodic:
            sure = f"{number(period.cycles)} periods, confidence {_sure(period)}"
            repeats.append(f"{axis} every {number(period.period)} s ({sure})")
    printed.append(
        f"periodic along {' and '.join(repeats)}" if repeats else "not periodic along any axis"
    )
    sentence = (f"{person.who.name}: " if person.who.name else "") + "; ".join(printed) + "."
    return sentence[:1].upper() + sentence[1:]


def _sure(periodicity: Periodicity) -> str:
    return (
        "over 99.9 %" if periodicity.confidence > 0.999 else f"{100 * periodicity.confidence:.3g} %"
    )


def _center_grid(analysis: MotionAnalysis) -> Grid:
    rows = []
    for person in analysis.persons:
        for index, axis in enumerate(analysis.axes):
            values = person.center.values[:, index]
            periodicity = person.periods[index]
            values = values[np.isfinite(values)]
            if not len(values):
                continue
            name = ", ".join(word for word in (person.who.name, axis) if word)
            size = (
                f"{number(1000 * float(np.ptp(values)))} mm",
                f"{number(1e6 * float(values.var()))} mm²",
            )
            period = ("no period", "–")
            sure = ("–", "–")
            if periodicity.periodic:
                period = (f"{number(periodicity.period)} s", number(periodicity.cycles))
            if np.isfinite(periodicity.period):
                sure = (number(periodicity.likeness), _sure(periodicity))
            rows.append((name, f"{number(float(values.mean()))} m", *size, *period, *sure))
    head = (
        "Axis",
        "Mean",
        "Range",
        "Variance",
        "Period",
        "Periods",
        "Autocorrelation after one period",
        "Confidence",
    )
    return Grid(head, tuple(rows), "Center of gravity: statistics")


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
    if _top(analysis) is not None or any(row.side for row in graph):
        legend = [("right", "right"), ("left dotted", "left")]
    if len(analysis.persons) > 1:
        legend += motion_analysis.person_legend(analysis)
    if any(emg_of(prepared, pair) for person in analysis.persons for pair in person.muscles):
        legend.append(("emg", "EMG"))
    title = f"{analysis.preset.title}: pictures, contacts and muscles"
    figure = Figure("".join(rows), "full")
    return Section(
        key="analysis",
        title=title,
        lead=_lead(analysis, bool(graph)),
        legend=tuple(legend),
        figures=(figure,),
    )


def _lead(analysis: MotionAnalysis, graph: bool) -> str:
    lines = ["One time axis for all rows."]
    top = _top(analysis)
    if top is not None:
        lines.append(f"Activations from 0 to {top:g}.")
    if graph and analysis.contacts is not None:
        lines.append(
            "Lines are contact intervals: a filled dot at the start, an open dot at the end."
        )
        if any(interval.source == "sound" for interval in analysis.contacts.intervals):
            lines.append("Impacts: ✳ right hand, + left hand, ○ right foot, × left foot.")
    lines.append(cut_words(analysis))
    if top is not None:
        lacking = tuple(
            dict.fromkeys(name for person in analysis.persons for name in person.lacking)
        )
        if lacking:
            lines.append(f"Missing in the model: {'; '.join(lacking)}.")
    if not analysis.chosen:
        lines.append(f"The preset “{analysis.preset.name}” was chosen automatically.")
    return " ".join(line for line in lines if line)


def _pictures(prepared: Prepared, analysis: MotionAnalysis, behind: Backdrop) -> str:
    """Draw the body at even times, or at the requested ones."""
    results = prepared.results
    motion = prepared.results.kinematics.motion
    if results.model is None or motion is None or not results.model.bodies:
        return ""
    good = np.flatnonzero(np.isfinite(motion.values).all(axis=1))
    if not len(good):
        return ""
    first, last = behind.span
    wanted = results.analysis.times
    if not wanted:
        frames = nearest_frames(
            motion.time, good, even_times(behind.span, analysis.preset.pictures)
        )
        count = fitting(
            make_scene(results.model, motion, frames, results.surfaces), analysis.preset.pictures
        )
        wanted = even_times(behind.span, count)
    inside = [time for time in wanted if first - 1e-6 <= time <= last + 1e-6]
    if not inside:
        times = ", ".join(f"{time:g}" for time in wanted)
        raise BadData(f"no picture at {times} s: the motion lasts from {first:g} to {last:g} s")
    frames = nearest_frames(motion.time, good, inside)
    scene = make_scene(
        results.model,
        motion,
        frames,
        results.surfaces,
        Acting(results.activations, acting_forces(results)),
    )
    return picture_strip(scene, behind)


def _heights(analysis: MotionAnalysis, behind: Backdrop) -> str:
    """Height of every person's center of gravity, of a single one with that of its first rest."""
    factor, unit = scaled_unit("m", *(person.center.values[:, 0] for person in analysis.persons))
    lines = [
        Line(
            time=person.center.time,
            values=factor * person.center.values[:, 0],
            style=style,
            label=person.who.name or "height",
        )
        for person, style in zip(
            analysis.persons, motion_analysis.person_styles(analysis), strict=True
        )
    ]
    still = analysis.persons[0].still if len(analysis.persons) == 1 else float("nan")
    levels = [Level(factor * still, "at rest", "middle")] if np.isfinite(still) else []
    return draw_track(behind, "Height of COG", unit, lines, TrackLook(height=86, levels=levels))


def _muscles(
    prepared: Prepared, analysis: MotionAnalysis, person: Person, behind: Backdrop
) -> list[str]:
    """One row a muscle, right solid and left dotted, EMG as areas behind."""
    top = _top(analysis)
    if top is None or not person.muscles:
        return []
    rows = []
    if person.who.name:
        rows.append(row_title(f"Muscles of {person.who.name}"))
    for pair in person.muscles:
        lines = [
            Line(
                time=time,
                values=values,
                style=f"emg {STYLE[side]}",
                label=f"EMG {side}".strip(),
                filled=True,
            )
            for side, time, values in emg_of(prepared, pair)
        ]
        for side in pair.members:
            name = motion_analysis.column_name(pair, side)
            series = person.activations
            if series is not None and name in series.names:
                style = f"{STYLE[side]} dotted" if side == "left" else STYLE[side]
                lines.append(
                    Line(
                        time=series.time,
                        values=series[name],
                        style=style,
                        label=side or "activation",
                    )
                )
        rows.append(
            draw_track(
                behind,
                pair.label,
                "",
                lines,
                TrackLook(height=MUSCLE_ROW, low=0.0, high=top, small=True),
            )
        )
    return rows


def _top(analysis: MotionAnalysis) -> float | None:
    """Find the top of the muscles' rows: a round number over the largest activation.

    It is None where no activation is known.
    """
    known = [
        person.activations.values.ravel()
        for person in analysis.persons
        if person.activations is not None
    ]
    if not known:
        return None
    values = np.concatenate(known)
    largest = float(np.nanmax(values, initial=0.0)) if np.isfinite(values).any() else 1.0
    return next((top for top in TOPS if top >= largest), largest)


MAX_SCORE_TIME = 120.0
MAX_STRIPES = 60


def analysis_sections(prepared: Prepared) -> list[Section]:
    """Make the sections on the motion that the results allow."""
    analysis = motion_analysis.analyse(prepared)
    if analysis is None:
        return []
    # Of a very long motion the part that other charts show.
    span = (
        prepared.detail if prepared.span[1] - prepared.span[0] > MAX_SCORE_TIME else prepared.span
    )
    phases = tuple(
        phase for phase in analysis.cutting.phases if phase.stop > span[0] and phase.start < span[1]
    )
    events = prepared.events if analysis.cutting.by in ("events", "given") else ()
    behind = Backdrop(span, phases if len(phases) <= MAX_STRIPES else (), events)
    score = score_section(prepared, analysis, behind)
    center = center_section(prepared, analysis, behind)
    forces = contact_force_section(prepared, behind, analysis.who)
    sections = score, center, phase_section(analysis), forces, correlation_section(analysis)
    return [section for section in sections if section is not None]
