"""The page of a simulation, or of two side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.surface import Surface
from myomorph.forward.page_run import KINETIC, POTENTIAL, RESIDUAL, WORK, PageRun
from myomorph.forward.shown import ShownRun
from myomorph.lab.report.charts.axis import number
from myomorph.lab.report.charts.curves import Line, time_plot
from myomorph.lab.report.page.page import Instant, Summary, rendered
from myomorph.lab.report.page.parts import Figure, Grid, PageHead, Section, cited
from myomorph.lab.report.scene.pictures import frames_to_play, pictures, player
from myomorph.lab.report.scene.scene import Acting, make_scene

STYLES = ("first", "second")
MAX_CHARTS = 12
MAX_MUSCLES = 8
INSTANTS = 5
DEGREES = 180.0 / np.pi


def simulation_page(
    head: PageHead,
    runs: Sequence[PageRun],
    together: ShownRun,
    surfaces: Mapping[str, Surface],
) -> str:
    """Write one self-contained HTML page.

    Parameters
    ----------
    head : of the page
    runs : one, or two at the same times
    together : the bodies of all, to be played
    surfaces : meshes, by `Mesh.file`
    """
    instants, motion = _in_motion(together, surfaces)
    sections = [
        section
        for section in (
            _coordinates(runs),
            _muscles(runs),
            _energy(runs),
            _feedback(runs),
        )
        if section is not None
    ]
    return rendered(
        head,
        sections,
        cited("featherstone2008", "opensim"),
        Summary(
            facts=_facts(runs),
            instants=instants,
            motion=motion,
            muscles_colored=bool(together.activations.names),
            arrows="" if together.wrenches is None else "contact",
        ),
    )


def _in_motion(shown: ShownRun, surfaces: Mapping[str, Surface]) -> tuple[list[Instant], str]:
    """Pictures at some instants, and the body to play."""
    frames = len(shown.motion)
    few = np.unique(np.linspace(0, frames - 1, INSTANTS).round().astype(int))
    still = make_scene(
        shown.model, shown.motion, list(few), surfaces, Acting(shown.activations, shown.wrenches)
    )
    drawn = pictures(still)
    instants = [
        Instant(f"{number(float(shown.motion.time[frame]), 0.01)} s", side, front)
        for frame, side, front in zip(few, drawn[: len(few)], drawn[len(few) :], strict=True)
    ]
    points = sum(len(muscle.path.points) for muscle in shown.model.muscles)
    count = frames_to_play(frames, points, len(shown.model.bodies))
    many = np.unique(np.linspace(0, frames - 1, count).round().astype(int))
    scene = make_scene(
        shown.model, shown.motion, list(many), surfaces, Acting(shown.activations, shown.wrenches)
    )
    return instants, player(scene)


def _facts(runs: Sequence[PageRun]) -> list[tuple[str, str]]:
    model = runs[0].shown.model
    facts = [
        (
            "Model",
            f"{model.name}: {len(model.bodies)} bodies, {len(model.coordinates)} coordinates,"
            f" {len(model.muscles)} muscles, {number(model.mass)} kg",
        )
    ]
    for run in runs:
        of = f" ({run.shown.name})" if len(runs) > 1 else ""
        facts += [(f"{name}{of}", text) for name, text in run.facts]
    return facts


def _legend(runs: Sequence[PageRun]) -> tuple[tuple[str, str], ...]:
    if len(runs) < 2:
        return ()
    return tuple((style, run.shown.name) for style, run in zip(STYLES, runs, strict=False))


def _charts(
    runs: Sequence[PageRun], names: Sequence[str], columns: Sequence[Mapping[str, Array]], unit: str
) -> tuple[Figure, ...]:
    """Draw a chart of every name, with a line of every run."""
    span = (float(runs[0].motion.time[0]), float(runs[0].motion.time[-1]))
    figures = []
    for name in names:
        lines = [
            Line(
                time=run.motion.time,
                values=values[name],
                style=style,
                label=run.shown.name if len(runs) > 1 else name,
            )
            for run, values, style in zip(runs, columns, STYLES, strict=False)
        ]
        figures.append(Figure(time_plot(name, unit, lines, span)))
    return tuple(figures)


def _coordinates(runs: Sequence[PageRun]) -> Section:
    """Section of the coordinates that move, or differ, most."""
    names = runs[0].motion.names
    moves = [_moves(runs, column) for column in range(len(names))]
    order = np.argsort(moves)[::-1][:MAX_CHARTS]
    chosen = [column for column in sorted(order) if moves[column] > 0.0]
    figures: list[Figure] = []
    kinds = runs[0].shown.model.motion_kinds
    for column in chosen:
        turns = kinds[names[column]] == "rotational"
        scale = DEGREES if turns else 1.0
        columns = [{names[column]: scale * run.motion.values[:, column]} for run in runs]
        figures += _charts(runs, [names[column]], columns, "°" if turns else "m")
    left_out = len(names) - len(chosen)
    lead = f"{left_out} coordinates that move less are in coordinates.mot." if left_out else ""
    return Section("coordinates", "Coordinates", lead, legend=_legend(runs), figures=tuple(figures))


def _moves(runs: Sequence[PageRun], column: int) -> float:
    """Range of a coordinate, or of two runs the largest difference too."""
    values = [run.motion.values[:, column] for run in runs]
    widest = max(float(np.ptp(series)) for series in values)
    apart = float(np.abs(values[0] - values[-1]).max(initial=0.0))
    return widest + 10.0 * apart


def _muscles(runs: Sequence[PageRun]) -> Section | None:
    """Section of the muscles with the largest forces."""
    names = runs[0].forces.names
    if not names:
        return None
    largest = [
        max(float(np.ptp(run.forces.values[:, column])) for run in runs)
        for column in range(len(names))
    ]
    order = np.argsort(largest)[::-1][:MAX_MUSCLES]
    chosen = [names[column] for column in sorted(order)]
    columns = [
        {name: run.forces.values[:, run.forces.names.index(name)] for name in chosen}
        for run in runs
    ]
    lead = "Muscles whose forces vary most. All are in forces.sto."
    figures = _charts(runs, chosen, columns, "N")
    return Section("muscles", "Muscle forces", lead, legend=_legend(runs), figures=figures)


def _energy(runs: Sequence[PageRun]) -> Section:
    """Section of the energy's balance."""
    names = [KINETIC, POTENTIAL, RESIDUAL]
    columns = [
        {name: run.energy.values[:, run.energy.names.index(name)] for name in names} for run in runs
    ]
    works = list(
        dict.fromkeys(name for run in runs for name in run.energy.names if name.startswith(WORK))
    )
    rows = []
    for name in works:
        cells = [
            number(float(run.energy.values[-1, run.energy.names.index(name)]))
            if name in run.energy.names
            else "0"
            for run in runs
        ]
        rows.append((name.removeprefix(WORK), *cells))
    head = ("Sources of work", *(f"{run.shown.name} [J]" for run in runs))
    return Section(
        "energy",
        "Energy",
        "Kinetic and potential energy change by the work of forces alone. The residual is the error"
        " of the integration.",
        legend=_legend(runs),
        figures=_charts(runs, names, columns, "J"),
        grids=(Grid(head=head, rows=tuple(rows), title="Work until the end"),),
    )


def _feedback(runs: Sequence[PageRun]) -> Section | None:
    """Section of what feedback added."""
    if not any(run.feedback.names for run in runs):
        return None
    rows = []
    for name in runs[0].feedback.names:
        cells = [
            number(float(np.sqrt(np.mean(run.feedback.values[:, column] ** 2))))
            for run in runs
            for column in [run.feedback.names.index(name)]
        ]
        rows.append((name, *cells))
    head = ("Coordinate", *(f"{run.shown.name}, RMS [N m or N]" for run in runs))
    lead = "Generalized forces that keep the body at the motion it follows."
    grid = Grid(head=head, rows=tuple(rows))
    return Section("feedback", "Feedback", lead, grids=(grid,))
