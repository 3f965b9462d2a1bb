"""The parts of the page on an identified body.

They are its picture, masses, segments, base parameters and cross-validation.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from myomorph.body.identify.base import BaseFit
from myomorph.body.identify.subject import Identification
from myomorph.body.identify.validation import COMPONENTS
from myomorph.core.model.arrays import Array
from myomorph.core.model.frozen_map import grouped
from myomorph.core.model.model import Model
from myomorph.core.model.segments import SEGMENTS
from myomorph.core.model.series import DEFAULT_POSE
from myomorph.core.model.surface import Surface
from myomorph.lab.analysis.presets import plain_words, segment_words
from myomorph.lab.report.charts.axis import number
from myomorph.lab.report.charts.pictures import Scale, picture_row
from myomorph.lab.report.charts.points import Ranked, rank_plot
from myomorph.lab.report.charts.rows import Rows, dot_plot
from myomorph.lab.report.page.parts import Figure, Grid, Section, Sheet
from myomorph.lab.report.scene.image import LEVEL, level_color
from myomorph.lab.report.scene.pictures import pictures
from myomorph.lab.report.scene.scene import make_scene
from myomorph.lab.report.trial import identification_tables as tables
from myomorph.lab.report.trial.report_input import IdentificationInput
from myomorph.lab.report.trial.validation import (
    STYLES,
    UNITS,
    calibration_section,
    validation_section,
)

WELL_KNOWN = 0.1  # Relative standard deviation under which a base parameter counts as well known.
MAX_OPEN_ROWS = 30
# Share of the body's mass under which a link of a model of many links is left out of a chart.
LIGHT = 0.002


def identification_sections(
    body: IdentificationInput, surfaces: Mapping[str, Surface]
) -> list[Section]:
    """Make the sections of what was identified and calibrated.

    `surfaces` are meshes for the picture, by `Mesh.file`.
    """
    identification = body.identification
    checks = body.validation
    made = [body_section(body.model, identification, surfaces)]
    if identification is not None:
        styles = dict(zip(identification.parameters, STYLES, strict=False))
        made += [
            mass_section(identification),
            *segment_section(identification),
            base_section(identification),
        ]
        sections = (
            validation_section(trial, check, styles, i)
            for i, (trial, check) in enumerate(checks.items())
        )
        made += [section for section in sections if section is not None]
    if body.calibration is not None:
        made.append(calibration_section(body.calibration, body.recordings))
    return made


def body_section(
    model: Model, identification: Identification | None, surfaces: Mapping[str, Surface]
) -> Section:
    """Draw the body colored by how much of each link is known from the data.

    Notes of the identification stand below.
    """
    share = None if identification is None else identification.link_shares
    figures = [Figure(body_picture(model, share, surfaces), "medium")] if model.bodies else []
    lead = f"{number(model.mass)} kg in {len(model.bodies)} links"
    if identification is None or share is None:
        return Section(
            key="body-identified",
            title="The body",
            lead=f"{lead}.",
            legend=(),
            figures=tuple(figures),
        )
    masses = np.array([body.mass for body in model.bodies])
    order = np.argsort(-np.nan_to_num(share, nan=-1.0), kind="stable")
    order = order[masses[order] >= LIGHT * masses.sum()] if len(order) > MAX_OPEN_ROWS else order
    names = [model.body_names[i] for i in order]
    plot = dot_plot(
        "Information from the data",
        "%",
        Rows(names=names, values=[100.0 * share[order]], styles=["first"], labels=["share"]),
        520,
    )
    figures.append(Figure(plot, "medium"))
    lead += f", masses “{identification.chosen}”"
    lead += f"; mass points: {identification.points.source}" if identification.points.source else ""
    lead += (
        ". Colors: how much of the information on a link comes from motion and forces (blue) rather"
        " than from the shape of the body (red)."
    )
    consistency = identification.consistency[identification.chosen]
    wrong = consistency.faulty
    count = len(consistency.links)
    words = "; ".join(f"{check.name}, {', '.join(check.faults)}" for check in wrong[:5])
    lead += f" {len(wrong)} of {count} links are not physically possible: {words}." if wrong else ""
    lead += "" if wrong else f" All {count} links are physically possible."
    frames = sum(recording.frames for recording in identification.recordings)
    left_out = identification.left_out.items()
    lost = tuple(
        (reason, number(left, 1.0), f"{number(100.0 * left / frames)} %")
        for reason, left in left_out
    )
    grids = (
        Grid(("Reason", "Frames", "Of all"), lost, "Frames excluded"),
        Grid(
            ("Note",),
            tuple((text,) for text in identification.notes),
            "Notes of the identification",
        ),
    )
    return Section(
        key="body-identified",
        title="The identified body",
        lead=lead,
        legend=(),
        figures=tuple(figures),
        grids=grids,
    )


def body_picture(model: Model, share: Array | None, surfaces: Mapping[str, Surface]) -> str:
    """Draw the model from its right side and from the front as one drawing.

    Parameters
    ----------
    model : that was identified
    share : (bodies,) from 0 to 1 how much of each link is known from the data; None for no colors
    surfaces : meshes, by `Mesh.file`

    Returns
    -------
    The drawing, with its scale of colors where there are any
    """
    scene = make_scene(replace(model, muscles=()), DEFAULT_POSE, [0], surfaces)
    shown = np.full(len(model.bodies), np.nan) if share is None else share
    colors = np.vstack([[0.72, 0.72, 0.72], level_color(shown)])
    drawn = pictures(scene, (560, 560), colors)
    known = Scale(palette=LEVEL, ends=("from the shape", "half", "from the data"))
    return picture_row("The identified body", drawn, scale=None if share is None else known)


def mass_section(identification: Identification) -> Section:
    """Masses per link by method, their spread along the spine, and whether links are possible."""
    masses = identification.masses
    bodies = identification.model.body_names
    heavy = np.argsort(-next(iter(masses.values())), kind="stable")
    shown = [i for i in heavy if max(mass[i] for mass in masses.values()) >= 0.001]
    names = [bodies[i] for i in shown]
    values = [mass[shown] for mass in masses.values()]
    plot = dot_plot(
        "Mass of each link",
        "kg",
        Rows(names=names, values=values, styles=STYLES[: len(masses)], labels=list(masses)),
        880,
    )
    sheet = tables.link_sheet(identification)
    keep = [sheet.head.index(name) for name in ("link", "mass [kg]", "share from the data")] + [
        5,
        6,
        7,
    ]
    cut = Sheet(
        tuple(sheet.head[i] for i in keep), tuple(tuple(row[i] for i in keep) for row in sheet.rows)
    )
    grids = (
        tables.mass_sheet(identification).grid(
            "Mass of each link [kg]", len(bodies) > MAX_OPEN_ROWS, " [kg]"
        ),
        tables.spine_sheet(bodies, masses).grid(
            "Spread of the vertebrae's masses: population standard deviation [kg]", unit=" [kg]"
        ),
        cut.grid(f"Physical consistency of {len(sheet.rows)} links", True, " [kg]"),
    )
    left = len(bodies) - len(shown)
    lead = "Every method's mass of every link, heaviest first."
    lead += f" {left} links below one gram are only in the table." if left else ""
    lead += f" {evidence_sentence(identification)}"
    legend = tuple(zip(STYLES, masses, strict=False))
    return Section(
        key="masses",
        title="Mass of each link",
        lead=lead,
        legend=legend,
        figures=(Figure(plot, "full"),),
        grids=grids,
    )


def evidence_sentence(identification: Identification) -> str:
    """Say which masses the forces show to be other ones than the shape's."""
    evidence = identification.mass_evidence
    named = [name for name, word in evidence.items() if word != "not shown"]
    others = len(evidence) - len(named)
    if not named:
        return f"The data identify no other mass than the shape's for any of {others} links."
    return (
        f"The data identify another mass than the shape's for {', '.join(named)}, and not for the"
        f" {others} other links."
    )


def segment_section(identification: Identification) -> list[Section]:
    """Compare shares of the body's mass with athletes', with the links of each segment.

    The result is [] without segments.
    """
    model = identification.model
    masses = identification.masses
    chosen = identification.chosen
    segments = tables.named_segments(model)
    if not segments:
        return []
    rows = tuple(_segment_row(identification, name) for name in tables.ATHLETES)
    head = ("Segment", "Athletes [%]", *(f"{name} [%]" for name in masses), f"{chosen}, left [%]")
    members = grouped(
        (segment_words(segment).capitalize(), body) for body, segment in segments.items()
    )
    links = tuple((segment, ", ".join(bodies)) for segment, bodies in members.items())
    lead = (
        "Percent of the body's mass, limbs of the right side, as in table 3.4 of [D], compared with"
        " Japanese male athletes. That table prints 45.9 for the athletes' body; its two"
        " parts sum to 48.9, and only with 48.9 do all segments sum to 100."
    )
    present = {segment.name for segment in segments.values()}
    absent = [plain_words(name) for name in SEGMENTS if name not in present]
    if absent:
        lead += (
            f" This model has no separate link for {', '.join(absent)}: their mass is part of other"
            " links."
        )
    grids = (
        Grid(head, rows, "Segments"),
        Grid(head=("Segment", "Links"), rows=links, title="Links of each segment", folded=True),
    )
    return [
        Section(
            key="segments",
            title="Segments of the body",
            lead=lead,
            legend=(),
            figures=(),
            grids=grids,
        )
    ]


def _segment_row(identification: Identification, name: str) -> tuple[str, ...]:
    """List a segment's share of athletes, of the right side by every method, and of the left."""
    model = identification.model
    masses = identification.masses
    right = [tables.segment_share(model, mass, name, "right") for mass in masses.values()]
    left = tables.segment_share(model, masses[identification.chosen], name, "left")
    paired = left is not None and name not in ("Head", "Body", "Upper body", "Lower body")
    label = name.replace(" ", "\u00a0")
    athletes = number(tables.ATHLETES[name])
    return (label, athletes, *map(_words, right), _words(left) if paired else "")


def base_section(identification: Identification) -> Section:
    """How well the base parameters are known, and what no motion, or not this one, shows."""
    base = identification.base
    names = base.base.names
    identifiable = base.identifiable
    words = ("Relative standard deviation", "of the value", "base parameters, best known first")
    ranked = Ranked(
        names=names,
        values=base.relative_sd,
        levels=[(WELL_KNOWN, "10 %"), (1.0, "as large as the parameter")],
        strong=identifiable,
    )
    plot = rank_plot(*words, ranked, 880)
    residual = tuple(
        f"{number(float(rms))} {unit}" for unit, rms in zip(UNITS, base.residual_rms, strict=True)
    )
    rows = tuple(
        (
            name,
            number(float(value)),
            f"{number(100 * float(relative))} %",
            "" if known else "not identifiable",
        )
        for name, value, relative, known in zip(
            names, base.estimate, base.relative_sd, identifiable, strict=True
        )
    )
    head = ("Base parameter", "Estimate", "Relative standard deviation", "")
    from_shape = tuple(
        (link, ", ".join(parameters)) for link, parameters in identification.from_shape.items()
    )
    unseen = tuple(name for name, known in zip(names, identifiable, strict=True) if not known)
    misfit = "Residual of the base wrench in the frames used, root mean square of its norm"
    grids = [
        tables.misfit_sheet(identification).grid(misfit),
        Grid(COMPONENTS, (residual,), "Residual of the base parameters, root mean square"),
        Grid(head=head, rows=rows, title=f"All {len(rows)} base parameters", folded=True),
        Grid(
            head=("Link", "Parameters"),
            rows=from_shape,
            title="Parameters that come from the shape of the body",
            folded=True,
        ),
    ]
    for motion, parameters in (("this", unseen), ("any", base.base.never)):
        title = f"Not identifiable from {motion} motion"
        grids.append(
            Grid(
                head=(title,),
                rows=tuple((name,) for name in parameters),
                title=f"{title}: {len(parameters)}",
                folded=True,
            )
        )
    legend = (("first", "identifiable"), ("middle", "not identifiable"))
    return Section(
        key="base",
        title="Base parameters",
        lead=_base_lead(base),
        legend=legend,
        figures=(Figure(plot, "full"),),
        grids=tuple(grids),
    )


def _base_lead(base: BaseFit) -> str:
    """Write how many base parameters are identifiable, and how well."""
    identifiable = base.identifiable
    well = int(np.sum(identifiable & (base.relative_sd < WELL_KNOWN)))
    lead = (
        f"{int(identifiable.sum())} of {len(base.base.names)} base parameters are identifiable from"
        " this motion"
    )
    lead += f", {well} of them within {100 * WELL_KNOWN:g} % (one standard deviation)"
    lead += f"; {number(base.frames, 1.0)} frames"
    lead += f", condition number {number(base.condition)}" if np.isfinite(base.condition) else ""
    return lead + ("." if identifiable.all() else ". The others come from the shape of the body.")


def _words(value: float | None) -> str:
    return "–" if value is None else number(value)
