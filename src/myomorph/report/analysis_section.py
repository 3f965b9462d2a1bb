"""The sections that tell a motion as chapter 5 of [D] tells those of experts."""

from __future__ import annotations

import numpy as np

from myomorph.model.series import Series
from myomorph.model.spatial import Array
from myomorph.report.chart import Limit, Line, number, scaled_unit
from myomorph.report.contact_graph import contact_graph, graph_rows
from myomorph.report.contact_panel import between_tracks, contact_force_section
from myomorph.report.estimated_forces import acting_forces
from myomorph.report.figures import STYLE
from myomorph.report.maps import floor_plot
from myomorph.report.motion_analysis import MotionAnalysis, Person, analyse, column_name, leveled
from myomorph.report.muscle_sections import emg_of
from myomorph.report.periodicity import Periodicity
from myomorph.report.prepared import Prepared
from myomorph.report.relation_tables import phase_section, relation_section
from myomorph.report.scene import make_scene
from myomorph.report.section import Figure, Grid, Section
from myomorph.report.strip import even_times, fitting, nearest_frames, picture_strip
from myomorph.report.tracks import WIDTH, Backdrop, Track, draw_track, phase_names, time_axis

LONGEST_SCORE = 120.0
MOST_STRIPES = 60
MUSCLE_ROW = 31
THIN = 8.0
TOPS = (0.1, 0.2, 0.3, 0.5, 0.75, 1.0)
ORDINAL = ("first", "second", "third", "fourth")
PERSONS = ("third", "second", "fourth")
CUT_WORDS = {
    "given": "Phases are those given.",
    "events": "Phases lie between events.",
    "contacts": "Phases are cut where the contacts change; what always touches is not named.",
    "cycles": "Phases are the periods of the center of gravity.",
    "parts": "Nothing cuts this motion, so phases are four equal parts.",
}


SECOND_CAPTION = "Straight lines of both are taken off, and each axis has a scale of its own."


def analysis_sections(prepared: Prepared) -> list[Section]:
    """The panels of the motion's preset that what was given allows."""
    analysis = analyse(prepared)
    if analysis is None:
        return []
    behind = _backdrop(prepared, analysis)
    found: list[Section | None] = []
    for panel in analysis.preset.panels:
        if panel == "score":
            found.append(_score(prepared, analysis, behind))
        elif panel == "center":
            found.append(_center(prepared, analysis, behind))
        elif panel == "phases":
            found.append(phase_section(analysis, CUT_WORDS.get(analysis.cutting.by, "")))
        elif panel == "contact forces":
            found.append(contact_force_section(prepared, behind, analysis.who))
        else:
            found.append(relation_section(analysis))
    return [one for one in found if one is not None]


def _backdrop(prepared: Prepared, analysis: MotionAnalysis) -> Backdrop:
    """The whole motion, or of a very long one the part that other charts show."""
    long = prepared.span[1] - prepared.span[0] > LONGEST_SCORE
    span = prepared.detail if long else prepared.span
    phases = tuple(one for one in analysis.cutting.phases if one.stop > span[0] and one.start < span[1])
    events = prepared.events if analysis.cutting.by in ("events", "given") else ()
    return Backdrop(span, phases if len(phases) <= MOST_STRIPES else (), events)


def _score(prepared: Prepared, analysis: MotionAnalysis, behind: Backdrop) -> Section:
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
    if analysis.activations is not None or any(one.side for one in graph):
        legend = [("right", "right"), ("left dotted", "left")]
    if len(analysis.persons) > 1:
        legend += _names(analysis)
    if any(_measured(prepared, person) for person in analysis.persons):
        legend.append(("emg", "EMG"))
    return Section(
        "analysis",
        f"{analysis.preset.title}: pictures, contacts and muscles",
        _lead(prepared, analysis, bool(graph)),
        tuple(legend),
        (Figure("".join(rows), "full"),),
    )


def _lead(prepared: Prepared, analysis: MotionAnalysis, graph: bool) -> str:
    told = ["One time axis for all rows."]
    if analysis.activations is not None:
        told.append(f"Activations from 0 to {_top(analysis.activations):g}.")
    if graph and analysis.contacts is not None:
        told.append("A line is a site that touches, a full dot where it begins and an open one where it ends.")
        if any(one.source == "sound" for one in analysis.contacts.touches):
            told.append("Strokes: ✳ right hand, + left hand, ○ right foot, × left foot.")
    told.append(CUT_WORDS.get(analysis.cutting.by, ""))
    if analysis.persons and analysis.activations is not None:
        lacking = tuple(dict.fromkeys(name for one in analysis.persons for name in one.lacking))
        if lacking:
            told.append(f"The model has no muscle for: {'; '.join(lacking)}.")
    if not analysis.chosen:
        told.append(f"The preset “{analysis.preset.name}” was chosen by what the recording shows.")
    return " ".join(one for one in told if one)


def _pictures(prepared: Prepared, analysis: MotionAnalysis, behind: Backdrop) -> str:
    """The body at even times, or at those asked for."""
    given, motion = prepared.given, prepared.given.kinematics
    if given.model is None or motion is None or not given.model.bodies:
        return ""
    good = np.flatnonzero(np.isfinite(motion.values).all(axis=1))
    if not len(good):
        return ""
    wanted = given.times or even_times(behind.span, analysis.preset.pictures)
    if not given.times:
        frames = nearest_frames(motion.time, good, wanted)
        count = fitting(make_scene(given.model, motion, frames, given.surfaces), analysis.preset.pictures)
        wanted = even_times(behind.span, count)
    wanted = tuple(one for one in wanted if behind.span[0] - 1e-6 <= one <= behind.span[1] + 1e-6)
    if not wanted:
        return ""
    activations = None
    if given.tension is not None:
        activations = Series(given.tension.time, given.tension.muscles, given.tension.activations)
    frames = nearest_frames(motion.time, good, wanted)
    scene = make_scene(given.model, motion, frames, given.surfaces, activations, acting_forces(given))
    return picture_strip(scene, behind)


def _heights(analysis: MotionAnalysis, behind: Backdrop) -> str:
    """Height of every person's center of gravity, of a single one with that of its first rest."""
    factor, unit = scaled_unit("m", *(one.center.values[:, 0] for one in analysis.persons))
    lines = [
        Line(one.center.time, factor * one.center.values[:, 0], style, one.who.name or "height")
        for one, style in zip(analysis.persons, _styles(analysis), strict=True)
    ]
    still = analysis.persons[0].still if len(analysis.persons) == 1 else float("nan")
    levels = [Limit(factor * still, "at rest")] if np.isfinite(still) else []
    return draw_track(Track("Height of COG", unit, lines, 86, levels=levels), behind)


def _styles(analysis: MotionAnalysis) -> list[str]:
    """Style of every person's lines."""
    return [PERSONS[i % 3] for i in range(len(analysis.persons))] if len(analysis.persons) > 1 else ["middle"]


def _measured(prepared: Prepared, person: Person) -> bool:
    return any(emg_of(prepared, pair) for pair in person.muscles)


def _muscles(prepared: Prepared, analysis: MotionAnalysis, person: Person, behind: Backdrop) -> list[str]:
    """One row a muscle, right solid and left dotted, EMG as areas behind."""
    series = analysis.activations
    if series is None or not person.muscles:
        return []
    rows = []
    if person.who.name:
        rows.append(
            f'<svg class="chart" viewBox="0 0 {WIDTH} 20" role="presentation"><text class="block start" x="2" y="15">'
            f"Muscles of {person.who.name}</text></svg>"
        )
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
        rows.append(draw_track(Track(pair.label, "", lines, MUSCLE_ROW, low=0.0, high=peak, small=True), behind))
    return rows


def _top(series: Series) -> float:
    """Top of the muscles' rows: a round number over the largest activation, 1 or less where they are activations."""
    largest = float(np.nanmax(series.values, initial=0.0)) if np.isfinite(series.values).any() else 1.0
    return next((one for one in TOPS if one >= largest), largest)


def _center(prepared: Prepared, analysis: MotionAnalysis, behind: Backdrop) -> Section | None:
    """Center of gravity in three axes, its path on the ground and whether it repeats."""
    if not analysis.persons:
        return None
    drawn = []
    for k, axis in enumerate(analysis.axes):
        lines = [
            Line(one.center.time, one.center.values[:, k], style, one.who.name or axis)
            for one, style in zip(analysis.persons, _styles(analysis), strict=True)
        ]
        drawn.append(draw_track(Track(axis.capitalize(), "m", lines, 84), behind))
    figures = [Figure("".join([phase_names(behind), *drawn, time_axis(behind)]), "full")]
    for path in (_path(prepared, analysis), _upright_path(analysis)):
        if path:
            figures.append(Figure(path, "medium", _path_caption(analysis) if len(figures) == 1 else SECOND_CAPTION))
    return Section(
        "center-of-gravity",
        "Center of gravity",
        " ".join(_told(analysis, person) for person in analysis.persons),
        tuple(_names(analysis)) if len(analysis.persons) > 1 else (),
        tuple(figures),
        (_center_grid(analysis),),
    )


def _names(analysis: MotionAnalysis) -> list[tuple[str, str]]:
    return [(style, one.who.name) for one, style in zip(analysis.persons, _styles(analysis), strict=True)]


def _path(prepared: Prepared, analysis: MotionAnalysis) -> str:
    """The way over the ground from above, its origin where it starts (figure 5.7 of [D])."""
    k = int(np.argmax(np.abs(prepared.up)))
    flip = -1.0 if k == 1 else 1.0
    first, second = [i for i in range(3) if i != k]
    # Columns of `center`: vertical, then the two axes of the ground in order.
    center, phases = analysis.persons[0].center, analysis.cutting.phases
    begun = center.time >= (phases[0].start if phases else center.time[0]) - 1e-9
    start = center.values[begun, 1:]
    start = start[np.isfinite(start).all(axis=1)]
    if not len(start):
        return ""
    paths = _by_stage(
        analysis, [(person.center.values[:, 1:] - start[0]) * np.array([1.0, flip]) for person in analysis.persons]
    )
    letters = "xyz"
    across = (letters[first], ("−" if flip < 0 else "") + letters[second])
    factor, unit = (
        (1.0, "m") if float(_extent(np.concatenate([one for _, _, one in paths])).max()) > 0.5 else (1e3, "mm")
    )
    shown = [(label, style, factor * one) for label, style, one in paths]
    title, level = "Path over the ground, from above", not _thin([one for _, _, one in paths])
    return floor_plot(title, across, shown, width=505, height=300, unit=unit, level=level)


def _thin(paths: list[Array]) -> bool:
    """Whether paths (frames, 2) together are so long and thin that one scale would hide their width."""
    extent = _extent(np.concatenate(paths))
    return bool(extent.max() > THIN * extent.min() > 0.0)


def _extent(points: Array) -> Array:
    """Largest less smallest of every column (columns,), over the rows that are known; 0 where none is."""
    known = points[np.isfinite(points).all(axis=1)]
    found: Array = np.ptp(known, axis=0) if len(known) else np.zeros(points.shape[1])
    return found


def _upright_path(analysis: MotionAnalysis) -> str:
    """Height over the horizontal axis along which less is gone, straight lines of both taken off [mm]."""
    found = []
    k = 1 + int(np.argmin(np.sum([_extent(one.center.values) for one in analysis.persons], axis=0)[1:]))
    for person in analysis.persons:
        level = leveled(person.center).values
        found.append(1000.0 * np.stack([level[:, k], level[:, 0]], axis=1))
    across = (analysis.axes[k], analysis.axes[0])
    title = f"Height over {analysis.axes[k]}"
    return floor_plot(title, across, _by_stage(analysis, found), width=505, height=300, unit="mm", level=False)


def _by_stage(analysis: MotionAnalysis, points: list[Array]) -> list[tuple[str, str, Array]]:
    """Paths (frames, 2) of all persons; of a single one, a color a stage where there are few."""
    stages = analysis.cutting.stages
    if len(points) > 1 or not 2 <= len(stages) <= len(ORDINAL):
        return [
            (person.who.name or "center of gravity", "first" if len(points) == 1 else PERSONS[i % 3], one)
            for i, (person, one) in enumerate(zip(analysis.persons, points, strict=True))
        ]
    time = analysis.persons[0].center.time
    return [
        (stage.name, ORDINAL[j], np.where(_reaching(stage.inside(time))[:, None], points[0], np.nan))
        for j, stage in enumerate(stages)
    ]


def _reaching(inside: np.ndarray) -> np.ndarray:
    """Frames and the one after each stretch, so that the parts of a line meet."""
    found = inside.copy()
    found[1:] |= inside[:-1]
    return found


def _path_caption(analysis: MotionAnalysis) -> str:
    stages = analysis.cutting.stages
    told = "Its origin is where the first phase starts."
    if _thin([one.center.values[:, 1:] for one in analysis.persons]):
        told += " The way is long and thin: each axis has a scale of its own."
    if len(analysis.persons) == 1 and 2 <= len(stages) <= len(ORDINAL):
        words = ("blue", "violet", "green", "ochre")
        told += " Phases: " + ", ".join(f"{one.name} {word}" for one, word in zip(stages, words, strict=False)) + "."
    return told


def _told(analysis: MotionAnalysis, person: Person) -> str:
    """How low a center of gravity is, and which of its axes repeat, as one sentence."""
    rest, mean = person.standing
    told = []
    if np.isfinite(mean) and rest > 0.1 * mean:
        less = 100 * (mean - rest)
        told.append(
            f"on average {number(100 * mean, 0.1)} cm over the lowest joint, {number(abs(less), 0.1)} cm "
            f"{'lower' if less < 0 else 'higher'} than in the model's default posture"
        )
    if np.isfinite(person.still):
        less = 1000 * (float(np.nanmean(person.center.values[:, 0])) - person.still)
        told.append(f"{number(abs(less), 1.0)} mm {'below' if less < 0 else 'above'} the rest at the start")
    repeats = [
        f"{axis} every {number(one.period)} s ({number(one.cycles)} periods, {_sure(one)} sure)"
        for axis, one in zip(analysis.axes, person.periods, strict=True)
        if one.periodic
    ]
    told.append(f"repeating along {' and '.join(repeats)}" if repeats else "without a period along any axis")
    sentence = (f"{person.who.name}: " if person.who.name else "") + "; ".join(told) + "."
    return sentence[:1].upper() + sentence[1:]


def _sure(one: Periodicity) -> str:
    return "over 99.9 %" if one.confidence > 0.999 else f"{100 * one.confidence:.3g} %"


def _center_grid(analysis: MotionAnalysis) -> Grid:
    rows = []
    for person in analysis.persons:
        for k, axis in enumerate(analysis.axes):
            values = person.center.values[:, k]
            values = values[np.isfinite(values)]
            one = person.periods[k]
            if not len(values):
                continue
            rows.append(
                (
                    ", ".join(word for word in (person.who.name, axis) if word),
                    f"{number(float(values.mean()))} m",
                    f"{number(1000 * float(np.ptp(values)))} mm",
                    f"{number(1e6 * float(values.var()))} mm²",
                    f"{number(one.period)} s" if one.periodic else "no period",
                    number(one.cycles) if one.periodic else "–",
                    number(one.likeness) if np.isfinite(one.period) else "–",
                    _sure(one) if np.isfinite(one.period) else "–",
                )
            )
    head = ("Axis", "Mean", "Range", "Variance", "Period", "Periods", "Likeness one period later", "Confidence")
    return Grid(head, tuple(rows), "Center of gravity in numbers")
