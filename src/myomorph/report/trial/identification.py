"""The parts of the page on an identified body: picture, masses, segments, base parameters, cross-validation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from myomorph.analysis.presets import plain_words, segment_words
from myomorph.model.segments import SEGMENTS
from myomorph.model.series import Motion
from myomorph.report.charts.axis import number
from myomorph.report.charts.pictures import picture_row
from myomorph.report.charts.points import rank_plot
from myomorph.report.charts.rows import dot_plot
from myomorph.report.page.parts import Figure, Grid, Section
from myomorph.report.scene.image import LEVEL, level_color
from myomorph.report.scene.pictures import pictures
from myomorph.report.scene.scene import make_scene
from myomorph.report.trial.identification_tables import (
    ATHLETES,
    Cell,
    Sheet,
    link_sheet,
    mass_sheet,
    misfit_sheet,
    segment_share,
    segments_given,
    spine_sheet,
)
from myomorph.report.trial.identified import COMPONENTS, UNITS, IdentificationInput, IdentifiedBase
from myomorph.report.trial.validation import STYLES, calibration_section, validation_section

WELL_KNOWN = 0.1
"""Relative standard deviation under which a base parameter counts as well known."""

MAX_OPEN_ROWS = 30
LIGHT = 0.002
"""Share of the body's mass under which a link of a model of many links is left out of a chart."""


def identification_sections(identified: IdentificationInput) -> list[Section]:
    """All sections that what was given allows."""
    styles = dict(zip(identified.parameters, STYLES, strict=False))
    made = (
        body_section(identified),
        mass_section(identified),
        segment_section(identified),
        base_section(identified),
        *(validation_section(check, styles, i) for i, check in enumerate(identified.validation)),
        calibration_section(identified),
    )
    return [section for section in made if section is not None]


def body_section(identified: IdentificationInput) -> Section:
    """The body colored by how much of each link is known from the data, and what identification had to say."""
    figures = [Figure(body_picture(identified), "medium")] if identified.model.bodies else []
    if len(identified.share):
        masses = np.array([body.mass for body in identified.model.bodies])
        order = np.argsort(-np.nan_to_num(identified.share, nan=-1.0), kind="stable")
        order = order[masses[order] >= LIGHT * masses.sum()] if len(order) > MAX_OPEN_ROWS else order
        names = [identified.model.body_names[i] for i in order]
        share = [100.0 * identified.share[order]]
        plot = dot_plot("Information from the data", "%", names, share, ["first"], ["share"], 520)
        figures.append(Figure(plot, "medium"))
    lead = f"{number(identified.model.mass)} kg in {len(identified.model.bodies)} links"
    lead += f", masses “{identified.chosen}”" if identified.chosen else ""
    lead += f"; mass points: {identified.source}" if identified.source else ""
    lead += "."
    if len(identified.share):
        lead += (
            " Colors: how much of the information on a link comes from motion and forces (blue) rather than from "
            "the shape of the body (red)."
        )
    wrong = [check for check in identified.checks if not check.ok]
    if identified.checks:
        words = "; ".join(f"{check.name}, {', '.join(check.faults)}" for check in wrong[:5])
        count = len(identified.checks)
        lead += f" {len(wrong)} of {count} links are not physically possible: {words}." if wrong else ""
        lead += "" if wrong else f" All {count} links are physically possible."
    grids = []
    if identified.left_out:
        frames = identified.frames or sum(identified.left_out.values())
        lost = identified.left_out.items()
        rows = tuple((why, number(count, 1.0), f"{number(100.0 * count / frames)} %") for why, count in lost)
        grids.append(Grid(("Reason", "Frames", "Of all"), rows, "Frames excluded"))
    if identified.notes:
        grids.append(Grid(("Note",), tuple((text,) for text in identified.notes), "Notes of the identification"))
    title = "The identified body" if identified.parameters else "The body"
    return Section("body-identified", title, lead, (), tuple(figures), tuple(grids))


def body_picture(identified: IdentificationInput) -> str:
    """The model from its right side and from the front as one drawing with its scale of colors."""
    model = replace(identified.model, muscles=())
    pose = Motion(np.zeros(1), (), np.zeros((1, 0)))
    scene = make_scene(model, pose, [0], identified.surfaces)
    share = identified.share if len(identified.share) else np.full(len(model.bodies), np.nan)
    colors = np.vstack([[0.72, 0.72, 0.72], level_color(share)])
    drawn = pictures(scene, 560, 560, colors)
    palette, ends = (LEVEL, ("from the shape", "half", "from the data")) if len(identified.share) else (None, ())
    return picture_row("The identified body", drawn, palette=palette, ends=ends)


def mass_section(identified: IdentificationInput) -> Section | None:
    """Masses per link by method, their spread along the spine, and whether each link is possible."""
    if not identified.parameters:
        return None
    masses = identified.masses
    heavy = np.argsort(-next(iter(masses.values())), kind="stable")
    shown = [i for i in heavy if max(mass[i] for mass in masses.values()) >= 0.001]
    names, values = [identified.model.body_names[i] for i in shown], [mass[shown] for mass in masses.values()]
    plot = dot_plot("Mass of each link", "kg", names, values, STYLES[: len(masses)], list(masses), 880)
    grids = [_grid(mass_sheet(identified), "Mass of each link [kg]", len(identified.model.bodies) > MAX_OPEN_ROWS)]
    spine = spine_sheet(identified)
    if spine.rows:
        grids.append(_grid(spine, "Spread of the vertebrae's masses: population standard deviation [kg]"))
    if identified.checks:
        sheet = link_sheet(identified)
        printed = ("link", "mass [kg]", "share from the data", sheet.head[5], "possible", "reason")
        keep = [sheet.head.index(name) for name in printed]
        cut = Sheet(tuple(sheet.head[i] for i in keep), tuple(tuple(row[i] for i in keep) for row in sheet.rows))
        grids.append(_grid(cut, f"Physical consistency of {len(identified.checks)} links", True))
    left = len(identified.model.bodies) - len(shown)
    lead = "Every method's mass of every link, heaviest first."
    lead += f" {left} links below one gram are only in the table." if left else ""
    legend = tuple(zip(STYLES, masses, strict=False))
    return Section("masses", "Mass of each link", lead, legend, (Figure(plot, "full"),), tuple(grids))


def segment_section(identified: IdentificationInput) -> Section | None:
    """Shares of the body's mass beside athletes', and which link counts to which segment."""
    if not identified.parameters or not segments_given(identified):
        return None
    masses = identified.masses
    chosen = identified.chosen if identified.chosen in masses else next(iter(masses))
    rows = []
    for name, athletes in ATHLETES.items():
        right = [segment_share(identified, mass, name, "right") for mass in masses.values()]
        left = segment_share(identified, masses[chosen], name, "left")
        paired = left is not None and name not in ("Head", "Body", "Upper body", "Lower body")
        label = name.replace(" ", "\u00a0")
        rows.append((label, number(athletes), *map(_words, right), _words(left) if paired else ""))
    head = ("Segment", "Athletes [%]", *(f"{name} [%]" for name in masses), f"{chosen}, left [%]")
    segments = segments_given(identified)
    members: dict[str, list[str]] = {}
    for body in identified.model.body_names:
        if body in segments:
            members.setdefault(segment_words(segments[body]).capitalize(), []).append(body)
    links = tuple((segment, ", ".join(bodies)) for segment, bodies in members.items())
    lead = (
        "Percent of the body's mass, limbs of the right side, as table 3.4 of [D] sets it out beside Japanese male "
        "athletes. That table prints 45.9 for the athletes' body; its two parts sum to 48.9, and only with 48.9 do all "
        "segments sum to 100."
    )
    present = {segment.name for segment in segments.values()}
    absent = [plain_words(name) for name in SEGMENTS if name not in present]
    if absent:
        lead += f" This model has no separate link for {', '.join(absent)}: their mass is part of other links."
    grids = (Grid(head, tuple(rows), "Segments"), Grid(("Segment", "Links"), links, "Links of each segment", True))
    return Section("segments", "Segments of the body", lead, (), (), grids)


def base_section(identified: IdentificationInput) -> Section | None:
    """How well the base parameters are known, and what no motion, or not this one, shows."""
    base = identified.base
    if base is None:
        return None
    well = int(np.sum(base.shown & (base.relative_sd < WELL_KNOWN)))
    lead = f"{int(base.shown.sum())} of {len(base.names)} base parameters are identifiable from this motion"
    lead += f", {well} of them within {100 * WELL_KNOWN:g} % (one standard deviation)"
    lead += f"; {number(base.frames, 1.0)} frames" if base.frames else ""
    lead += f", condition number {number(base.condition)}" if np.isfinite(base.condition) else ""
    lead += ". The others come from the shape of the body." if not base.shown.all() else "."
    limits = [(WELL_KNOWN, "10 %"), (1.0, "as large as the parameter")]
    words = ("Relative standard deviation", "of the value", "base parameters, best known first")
    plot = rank_plot(*words, base.names, base.relative_sd, limits, base.shown, 880)
    grids = [_base_grid(base)]
    if np.isfinite(base.residual).any():
        cells = tuple(f"{number(float(residual))} {unit}" for unit, residual in zip(UNITS, base.residual, strict=True))
        grids.insert(0, Grid(COMPONENTS, (cells,), "Residual of the base parameters, root mean square"))
    misfit = misfit_sheet(identified)
    if misfit.rows:
        grids.insert(0, _grid(misfit, "Residual of the base wrench in the frames used, root mean square of its norm"))
    if identified.from_shape:
        rows = tuple((link, ", ".join(names)) for link, names in identified.from_shape.items())
        grids.append(Grid(("Link", "Parameters"), rows, "Parameters that come from the shape of the body", True))
    for title, names in (
        ("Not identifiable from this motion", identified.not_shown),
        ("Not identifiable from any motion", identified.never_shown),
    ):
        if names:
            grids.append(Grid((title,), tuple((name,) for name in names), f"{title}: {len(names)}", True))
    legend = (("first", "identifiable"), ("middle", "not identifiable"))
    return Section("base", "Base parameters", lead, legend, (Figure(plot, "full"),), tuple(grids))


def _base_grid(base: IdentifiedBase) -> Grid:
    rows = tuple(
        (name, number(float(value)), f"{number(100 * float(relative))} %", "" if shown else "not identifiable")
        for name, value, relative, shown in zip(base.names, base.estimate, base.relative_sd, base.shown, strict=True)
    )
    head = ("Base parameter", "Estimate", "Relative standard deviation", "")
    return Grid(head, rows, f"All {len(rows)} base parameters", True)


def _words(value: float | None) -> str:
    return "–" if value is None else number(value)


def _grid(sheet: Sheet, title: str, folded: bool = False) -> Grid:
    """A table of numbers for print: about three digits."""

    def words(cell: Cell) -> str:
        if cell is None:
            return "–"
        return number(cell) if isinstance(cell, float) else str(cell)

    head = tuple(_short(name) for name in sheet.head)
    return Grid(head, tuple(tuple(words(cell) for cell in row) for row in sheet.rows), title, folded)


def _short(name: str) -> str:
    """A column's name without its unit, which the table's title tells."""
    plain = name.removesuffix(" [kg]")
    return plain[:1].upper() + plain[1:]
