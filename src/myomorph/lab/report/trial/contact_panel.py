"""Contact forces, estimated beside measured and what is left open."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.model import GROUND
from myomorph.lab.analysis.selection import Subject
from myomorph.lab.report.charts.axis import number
from myomorph.lab.report.charts.curves import Line
from myomorph.lab.report.charts.marks import Level, drawing, mark, text
from myomorph.lab.report.charts.points import FloorLook, floor_plot
from myomorph.lab.report.charts.tracks import (
    WIDTH,
    Backdrop,
    Band,
    TrackLook,
    draw_track,
    named_lines,
    time_axis,
)
from myomorph.lab.report.page.parts import Figure, Grid, Section
from myomorph.lab.report.trial.contact_tables import impact_grids, plate_grids
from myomorph.lab.report.trial.estimated_forces import (
    SITUATIONS,
    Group,
    compared_with_plates,
    group_forces,
    groups_of,
    situation_of,
)
from myomorph.lab.report.trial.figures import ORDINAL, Ground, axis_names
from myomorph.lab.report.trial.prepared import Prepared

RARE = 2.5
NEAR_FLOOR = 0.2


def contact_force_section(
    prepared: Prepared, behind: Backdrop, who: Sequence[Subject] = ()
) -> Section | None:
    """Three components of every group's force, the center of pressure and what was measured."""
    results = prepared.results
    forces = results.contacts.forces
    if forces is None or not len(forces) or not forces.sites:
        return None
    comparisons = compared_with_plates(results)
    groups = groups_of(forces, comparisons, who)
    blocks = tuple(dict.fromkeys(group.block for group in groups))
    figures = [
        Figure(
            _components(
                prepared, block, [group for group in groups if group.block == block], behind, who
            ),
            "full",
        )
        for block in blocks
    ]
    floor = _floor(prepared, groups)
    if floor:
        figures.append(Figure(floor, "full"))
    lost = tuple(
        (f"{number(each.time, 0.001)} s", each.relaxation or "none")
        for each in results.contacts.infeasible
    )
    words = f"{len(lost)} infeasible contact frames"
    infeasible = Grid(
        head=("Time", "Smallest relaxation that is feasible"), rows=lost, title=words, folded=True
    )
    legend = [(group.style, group.label) for group in groups] if len(blocks) == 1 else []
    if any(group.measured is not None for group in groups):
        legend.append(("measured", "measured"))
    grids = (
        _grid(prepared, groups, who),
        *plate_grids(prepared, groups, comparisons),
        *impact_grids(prepared, who),
        infeasible,
    )
    return Section(
        key="contact-forces",
        title="Contact forces",
        lead=_lead(prepared, groups),
        legend=tuple(legend),
        figures=tuple(figures),
        grids=grids,
    )


def between_tracks(prepared: Prepared, behind: Backdrop, who: Sequence[Subject]) -> list[str]:
    """Size of the forces that pass between bodies, a row for all of them; none where none does."""
    forces = prepared.results.contacts.forces
    if forces is None or all(site.against == GROUND for site in forces.sites):
        return []
    groups = (group for group in groups_of(forces, who=who) if group.against != GROUND)
    lines = [
        Line(
            time=forces.time,
            values=np.linalg.norm(group.forces, axis=1),
            style=ORDINAL[i % len(ORDINAL)],
            label=group.label,
        )
        for i, group in enumerate(groups)
    ]
    title = lines[0].label if len(lines) == 1 else "Forces between bodies"
    return [draw_track(behind, title, "N", lines, TrackLook(height=66, low=0.0))]


def _floor(prepared: Prepared, groups: Sequence[Group]) -> str:
    """Centers of pressure from above, those measured in grey beneath those estimated."""
    results = prepared.results
    forces = results.contacts.forces
    assert forces is not None
    ground = Ground.under(prepared.up)
    paths: list[tuple[str, str, Array]] = []
    labels = {group.name: (group.label, group.style) for group in groups if group.against == GROUND}
    for measured, wrenches in ((True, results.dynamics.wrenches), (False, group_forces(forces))):
        if wrenches is None:
            continue
        for i, name in enumerate(wrenches.names):
            if not measured and name not in labels:
                continue
            load = np.linalg.norm(np.nan_to_num(wrenches.forces[:, i]), axis=1)
            shown = load > 0.05 * max(float(load.max(initial=0.0)), 1e-12)
            if measured:
                shown &= np.abs(wrenches.points[:, i] @ prepared.up - prepared.floor) < NEAR_FLOOR
            label, style = ("measured", "measured") if measured else labels[name]
            paths.append(
                (label, style, np.where(shown[:, None], ground.seen(wrenches.points[:, i]), np.nan))
            )
    outlines = [(plate.name, ground.seen(plate.corners)) for plate in results.recorded.plates]
    return floor_plot(
        "Centers of pressure, from above",
        ground.axes,
        paths,
        outlines,
        look=FloorLook(width=1040, height=250),
    )


def _lead(prepared: Prepared, groups: Sequence[Group]) -> str:
    results = prepared.results
    lines = [SITUATIONS[situation_of(results)]] if situation_of(results) else []
    pairs = [group for group in groups if group.against != GROUND]
    if pairs:
        lines.append(
            "Between two bodies, the force on the first is shown; the force on the second is its"
            " opposite."
        )
    if any(group.measured is not None for group in groups):
        lines.append("Plate measurements are grey, shown where no other contact is on the plate.")
    if results.contacts.intervals is not None:
        shape = "Bars" if _at_instants(prepared) else "Bands"
        allow = "equations of motion, friction cones and muscles permit every force within"
        lines.append(f"{shape} are the forces that the data allow: {allow}.")
    if results.contacts.infeasible:
        lines.append(f"Red marks: {len(results.contacts.infeasible)} infeasible contact frames.")
    return " ".join(lines)


def _components(
    prepared: Prepared,
    block: str,
    groups: Sequence[Group],
    behind: Backdrop,
    who: Sequence[Subject],
) -> str:
    """Draw rows for the three components of some groups' forces.

    They stand under the names of their lines where there are more.
    """
    forces = prepared.results.contacts.forces
    assert forces is not None
    vectors, names = axis_names(prepared.up)
    heights = (118, 92, 92) if not block else (92, 74, 74)
    rows = [named_lines([(group.style, group.label) for group in groups])] if block else []
    for i, (vector, name) in enumerate(zip(vectors, names, strict=True)):
        measured = (
            (group.label, group.measured @ vector) for group in groups if group.measured is not None
        )
        lines = [
            Line(time=forces.time, values=values, style="measured", label=f"{label}, measured")
            for label, values in measured
        ]
        lines += [
            Line(
                time=forces.time, values=group.forces @ vector, style=group.style, label=group.label
            )
            for group in groups
        ]
        levels = _weight(prepared, block, who) if i == 0 else []
        known = prepared.results.contacts.intervals
        names_known = () if known is None else known.names
        open_ = [
            _interval(prepared, group, vector) for group in groups if group.name in names_known
        ]
        wide, upright = ((), open_) if _at_instants(prepared) else (open_, ())
        drawn = draw_track(
            behind,
            name.capitalize(),
            "N",
            lines,
            TrackLook(height=heights[i], bands=wide, bars=upright, levels=levels),
        )
        rows.append(drawn)
    return "".join([*rows, _marks(prepared, behind), time_axis(behind)])


def _weight(prepared: Prepared, block: str, who: Sequence[Subject]) -> list[Level]:
    """Weight of whom a block's forces carry; none between bodies, or where it is not known."""
    model = prepared.results.model
    if not block:
        return (
            [Level(prepared.weight, "body weight", "middle")]
            if prepared.weight and len(who) < 2
            else []
        )
    subject = next((person for person in who if person.name == block), None)
    if subject is None or model is None:
        return []
    mass = sum(model.body(name).mass for name in subject.bodies)
    return [
        Level(mass * float(np.linalg.norm(model.gravity)), f"weight of {subject.name}", "middle")
    ]


def _at_instants(prepared: Prepared) -> bool:
    """Whether intervals are known so seldom that nothing can be drawn between them."""
    intervals = prepared.results.contacts.intervals
    forces = prepared.results.contacts.forces
    if intervals is None or forces is None or len(intervals.time) < 2 or len(forces) < 2:
        return True
    return float(np.median(np.diff(intervals.time))) > RARE * float(np.median(np.diff(forces.time)))


def _interval(prepared: Prepared, group: Group, vector: Array) -> Band:
    intervals = prepared.results.contacts.intervals
    assert intervals is not None
    column = intervals.names.index(group.name)
    ends = np.stack([intervals.lower[:, column] * vector, intervals.upper[:, column] * vector])
    return Band(
        time=intervals.time,
        low=ends.min(axis=0).sum(axis=1),
        high=ends.max(axis=0).sum(axis=1),
        style=group.style,
    )


def _marks(prepared: Prepared, behind: Backdrop) -> str:
    """Draw a row of marks at infeasible contact frames; "" where there are none."""
    if not prepared.results.contacts.infeasible:
        return ""
    along = behind.frame(0.0, 12.0).x
    marks = [
        mark(
            "path",
            "infeasible",
            f"{number(contact.time, 0.001)} s",
            d=f"M{float(along.at(contact.time)):.1f} 1v10",
        )
        for contact in prepared.results.contacts.infeasible
        if behind.span[0] <= contact.time <= behind.span[1]
    ]
    words = text(2, 10, "infeasible", "tick end")
    return drawing("", "Infeasible contact frames", (WIDTH, 12), words, *marks, unit=None)


def _grid(prepared: Prepared, groups: Sequence[Group], who: Sequence[Subject]) -> Grid:
    """Mean and peak of every group."""
    up = axis_names(prepared.up)[0][0]
    rows = []
    for group in groups:
        vertical = f"{number(float(np.nanmean(group.forces @ up)))} N"
        largest = float(np.nanmax(np.linalg.norm(group.forces, axis=1)))
        share = "".join(
            f" ({largest / weight.value:.2f} BW)" for weight in _weight(prepared, group.block, who)
        )
        rows.append((group.label, vertical, f"{number(largest)} N{share}"))
    head = ("Contact", "Mean vertical", "Largest")
    return Grid(head, tuple(rows), "Estimated contact forces")
