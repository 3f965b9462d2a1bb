"""The center of gravity of a motion: three axes, its path, whether it repeats, and how low it is."""

from __future__ import annotations

import numpy as np

from myomorph.analysis.cycles import Periodicity
from myomorph.model.arrays import Array
from myomorph.report.charts.axis import number
from myomorph.report.charts.curves import Line
from myomorph.report.charts.points import floor_plot
from myomorph.report.charts.tracks import Backdrop, draw_track, phase_names, time_axis
from myomorph.report.page.parts import Figure, Grid, Section
from myomorph.report.trial.figures import Ground
from myomorph.report.trial.motion_analysis import MotionAnalysis, Person, leveled, person_legend, person_styles
from myomorph.report.trial.prepared import Prepared

THIN = 8.0
ORDINAL = ("first", "second", "third", "fourth")
SECOND_CAPTION = "Both are detrended; each axis has its own scale."


def center_section(prepared: Prepared, analysis: MotionAnalysis, behind: Backdrop) -> Section | None:
    """Center of gravity in three axes, its path on the ground and whether it repeats."""
    if not analysis.persons:
        return None
    drawn = []
    for index, axis in enumerate(analysis.axes):
        lines = [
            Line(person.center.time, person.center.values[:, index], style, person.who.name or axis)
            for person, style in zip(analysis.persons, person_styles(analysis), strict=True)
        ]
        drawn.append(draw_track(behind, axis.capitalize(), "m", lines))
    figures = [Figure("".join([phase_names(behind), *drawn, time_axis(behind)]), "full")]
    for path in (_path(prepared, analysis), _upright_path(analysis)):
        if path:
            figures.append(Figure(path, "medium", _path_caption(analysis) if len(figures) == 1 else SECOND_CAPTION))
    return Section(
        "center-of-gravity",
        "Center of gravity",
        " ".join(_printed(analysis, person) for person in analysis.persons),
        tuple(person_legend(analysis)) if len(analysis.persons) > 1 else (),
        tuple(figures),
        (_center_grid(analysis),),
    )


def _path(prepared: Prepared, analysis: MotionAnalysis) -> str:
    """The way over the ground from above, its origin where it starts (figure 5.7 of [D])."""
    ground = Ground.under(prepared.up)
    # Columns of `center`: vertical, then the two axes of the ground in order.
    center, phases = analysis.persons[0].center, analysis.cutting.phases
    begun = center.time >= (phases[0].start if phases else center.time[0]) - 1e-9
    start = center.values[begun, 1:]
    start = start[np.isfinite(start).all(axis=1)]
    if not len(start):
        return ""
    paths = _by_stage(
        analysis, [(person.center.values[:, 1:] - start[0]) * ground.signs for person in analysis.persons]
    )
    far = _extent(np.concatenate([path for _, _, path in paths])).max() > 0.5
    factor, unit = (1.0, "m") if far else (1e3, "mm")
    shown = [(label, style, factor * path) for label, style, path in paths]
    title, level = "Path over the ground, from above", not _thin([path for _, _, path in paths])
    return floor_plot(title, ground.axes, shown, width=505, height=300, unit=unit, one_scale=level)


def _thin(paths: list[Array]) -> bool:
    """Whether paths (frames, 2) together are so long and thin that one scale would hide their width."""
    extent = _extent(np.concatenate(paths))
    return bool(extent.max() > THIN * extent.min() > 0.0)


def _extent(points: Array) -> Array:
    """Largest less smallest of every column (columns,), over the rows that are known; 0 where none is."""
    known = points[np.isfinite(points).all(axis=1)]
    return np.ptp(known, axis=0) if len(known) else np.zeros(points.shape[1])


def _upright_path(analysis: MotionAnalysis) -> str:
    """Height over the horizontal axis along which less is gone, straight lines of both taken off [mm]."""
    axis = 1 + int(np.argmin(np.sum([_extent(person.center.values) for person in analysis.persons], axis=0)[1:]))
    paths = [1000.0 * leveled(person.center).values[:, [axis, 0]] for person in analysis.persons]
    across = (analysis.axes[axis], analysis.axes[0])
    title = f"Height over {analysis.axes[axis]}"
    return floor_plot(title, across, _by_stage(analysis, paths), width=505, height=300, unit="mm", one_scale=False)


def _by_stage(analysis: MotionAnalysis, points: list[Array]) -> list[tuple[str, str, Array]]:
    """Paths (frames, 2) of all persons; of a single one, a color a stage where there are few."""
    stages = analysis.cutting.stages
    if len(points) > 1 or not 2 <= len(stages) <= len(ORDINAL):
        styles = ["first"] if len(points) == 1 else person_styles(analysis)
        names = [person.who.name or "center of gravity" for person in analysis.persons]
        return list(zip(names, styles, points, strict=True))
    time = analysis.persons[0].center.time
    return [
        (stage.name, ORDINAL[j], np.where(_reaching(stage.inside(time))[:, None], points[0], np.nan))
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
        words = ("blue", "violet", "green", "ochre")
        printed += (
            " Phases: " + ", ".join(f"{stage.name} {word}" for stage, word in zip(stages, words, strict=False)) + "."
        )
    return printed


def _printed(analysis: MotionAnalysis, person: Person) -> str:
    """How low a center of gravity is, and which of its axes repeat, as one sentence."""
    rest, mean = person.standing
    printed = []
    if np.isfinite(mean) and rest > 0.1 * mean:
        less = 100 * (mean - rest)
        printed.append(
            f"on average {number(100 * mean, 0.1)} cm above the lowest joint, {number(abs(less), 0.1)} cm "
            f"{'lower' if less < 0 else 'higher'} than in the model's default posture"
        )
    if np.isfinite(person.still):
        less = 1000 * (float(np.nanmean(person.center.values[:, 0])) - person.still)
        printed.append(
            f"{number(abs(less), 1.0)} mm {'below' if less < 0 else 'above'} its height at rest at the start"
        )
    repeats = [
        f"{axis} every {number(period.period)} s ({number(period.cycles)} periods, confidence {_sure(period)})"
        for axis, period in zip(analysis.axes, person.periods, strict=True)
        if period.periodic
    ]
    printed.append(f"periodic along {' and '.join(repeats)}" if repeats else "not periodic along any axis")
    sentence = (f"{person.who.name}: " if person.who.name else "") + "; ".join(printed) + "."
    return sentence[:1].upper() + sentence[1:]


def _sure(periodicity: Periodicity) -> str:
    return "over 99.9 %" if periodicity.confidence > 0.999 else f"{100 * periodicity.confidence:.3g} %"


def _center_grid(analysis: MotionAnalysis) -> Grid:
    rows = []
    for person in analysis.persons:
        for index, axis in enumerate(analysis.axes):
            values, periodicity = person.center.values[:, index], person.periods[index]
            values = values[np.isfinite(values)]
            if not len(values):
                continue
            name = ", ".join(word for word in (person.who.name, axis) if word)
            size = f"{number(1000 * float(np.ptp(values)))} mm", f"{number(1e6 * float(values.var()))} mm²"
            period = (
                (f"{number(periodicity.period)} s", number(periodicity.cycles))
                if periodicity.periodic
                else ("no period", "–")
            )
            sure = (number(periodicity.likeness), _sure(periodicity)) if np.isfinite(periodicity.period) else ("–", "–")
            rows.append((name, f"{number(float(values.mean()))} m", *size, *period, *sure))
    head = ("Axis", "Mean", "Range", "Variance", "Period", "Periods", "Autocorrelation after one period", "Confidence")
    return Grid(head, tuple(rows), "Center of gravity: statistics")
