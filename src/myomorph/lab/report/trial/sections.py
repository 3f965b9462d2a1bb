"""The parts of the page in order: heading, figures, tables, or a note on what is missing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from myomorph.core.model.errors import few
from myomorph.core.model.quantity import Quantity
from myomorph.core.model.series import Motion, Series
from myomorph.core.model.series_quantities import COORDINATE_VALUE
from myomorph.core.model.units import MotionKind, shown_unit
from myomorph.core.rigid.quantities import GENERALIZED_FORCE
from myomorph.core.tension.quantities import GENERALIZED_FORCE_WITH_CONTACTS
from myomorph.lab.analysis.columns import extremes
from myomorph.lab.analysis.selection import Pair, coordinate_pairs
from myomorph.lab.report.charts.axis import number
from myomorph.lab.report.page.parts import SIDES_LEGEND, Figure, Grid, Section
from myomorph.lab.report.trial import figures as drawings
from myomorph.lab.report.trial import muscle_sections
from myomorph.lab.report.trial.analysis_sections import analysis_sections
from myomorph.lab.report.trial.identification import identification_sections
from myomorph.lab.report.trial.joint_load_section import joint_load_section
from myomorph.lab.report.trial.muscle_sections import fiber_section
from myomorph.lab.report.trial.prepared import Prepared
from myomorph.lab.report.trial.report_input import Truth
from myomorph.lab.report.trial.tables import residuals
from myomorph.lab.report.trial.validation import truth_section, uncertainty_section

BANDS = " Bands hold 90 % of the draws (see Uncertainty)."


def sections(prepared: Prepared) -> tuple[list[Section], list[str]]:
    """All sections that what was given allows, and a sentence on each that it does not."""
    results = prepared.results
    made = (
        []
        if results.identification is None
        else identification_sections(results.identification, results.surfaces)
    )
    missing: list[str] = []
    motion = results.kinematics.motion
    wrenches = results.dynamics.wrenches
    if made and motion is None and results.kinematics.markers is None and wrenches is None:
        return made, missing
    made += analysis_sections(prepared)
    for make, absent in (
        (
            marker_section,
            (
                "Marker errors: no inverse kinematics. Specify a marker file (TRC or C3D) and the"
                " step “ik”."
            ),
        ),
        (force_section, ""),
        (
            joint_section,
            "Joint angles and moments: no motion. Specify the step “ik”, or a motion file.",
        ),
        (
            muscle_sections.activation_section,
            "Muscle activations: not solved. Specify the steps “muscles” and “tension”.",
        ),
        (muscle_sections.tension_section, ""),
        (fiber_section, ""),
        (joint_load_section, ""),
        (muscle_sections.emg_conflict_section, ""),
        (muscle_sections.emg_section, "EMG: no channels."),
        (muscle_sections.length_section, ""),
        (muscle_sections.length_cycle_section, ""),
        (uncertainty_section, ""),
        (truth_section, ""),
    ):
        section = make(prepared)
        if section is not None:
            made.append(section)
        elif absent and not (
            make is muscle_sections.emg_section and muscle_sections.matched_emg(prepared)
        ):
            missing.append(absent)
    if wrenches is None:
        missing.append(
            "Ground forces: none. Specify the plates of the C3D or an external-loads file."
        )
    if motion is not None and results.dynamics.torques is None:
        missing.append(
            "Joint moments and residuals: no inverse dynamics. Specify external forces and the step"
            " “id”."
        )
    return [*made, *results.more], missing


def marker_section(prepared: Prepared) -> Section | None:
    """Marker errors over time and one by one."""
    fit = prepared.results.kinematics.fit
    if fit is None or not len(fit.motion) or not np.isfinite(fit.marker_error).any():
        return None
    over_time, *bars = drawings.marker_figures(fit, prepared.span, prepared.events, prepared.scale)
    text = f"{len(fit.marker_names)} markers were followed"
    if fit.unused_markers:
        text += f"; recorded, but not in the model: {few(fit.unused_markers, 8)}"
    if fit.missing_markers:
        text += f"; in the model, but not recorded: {few(fit.missing_markers, 8)}"
    text += (
        ". The error is the distance between a recorded marker and the same marker on the model."
    )
    legend = (("first", "RMS"), ("second", "largest"), ("limit", "limit"))
    figures = (Figure(over_time, "full"), *(Figure(bar, "medium") for bar in bars))
    return Section(key="markers", title="Marker errors", lead=text, legend=legend, figures=figures)


def force_section(prepared: Prepared) -> Section | None:
    """Ground forces, center of pressure, center of mass and residuals."""
    results = prepared.results
    wrenches = results.dynamics.wrenches
    events = prepared.events
    drawn: list[str] = []
    if wrenches is not None and len(wrenches.names):
        drawn += drawings.force_figures(
            wrenches, prepared.up, prepared.detail, events, prepared.weight
        )
        drawn.append(drawings.pressure_figure(wrenches, results.recorded.plates, prepared.up))
    # The first of the forces is the vertical one.
    first = len(drawn) > 0
    if prepared.centroid is not None:
        drawn += drawings.centroid_figures(prepared.centroid, prepared.up, prepared.detail, events)
    charts, lead = _residuals(prepared)
    figures = [
        Figure(chart, "medium" if first and i == 0 else "small")
        for i, chart in enumerate([*drawn, *charts])
        if chart
    ]
    if not figures:
        return None
    # Those of a movement with a section of its own stand there, of forces as measured.
    measures = prepared.ground.measures if prepared.movement_numbers is None else ()
    rows = tuple((each.name, f"{number(each.value)} {each.unit}", each.source) for each in measures)
    grids = (Grid(("Measure", "Value", "From"), rows, "The movement in numbers"),)
    title = "Ground forces and center of mass" if wrenches is not None else "Center of mass"
    legend: tuple[tuple[str, str], ...] = ()
    if wrenches is not None:
        legend = (*SIDES_LEGEND, ("middle", "both or neither"), ("limit", "limit, body weight"))
    return Section(
        key="forces", title=title, lead=lead, legend=legend, figures=tuple(figures), grids=grids
    )


def _residuals(prepared: Prepared) -> tuple[list[str], str]:
    """Draw the residuals at the root, and explain them or why there are none."""
    results = prepared.results
    wrenches = results.dynamics.wrenches
    torques = results.dynamics.torques
    if wrenches is None or torques is None or results.model is None:
        return [], ""
    if results.dynamics.root_note:
        return [], results.dynamics.root_note
    left = residuals(results.model, torques)
    if left is None or not np.isfinite(prepared.center_height):
        return [], ""
    force, moment = left
    net = np.linalg.norm(np.nan_to_num(wrenches.forces).sum(axis=1), axis=1)
    charts = drawings.residual_figures(
        drawings.Residuals(
            time=torques.time,
            force=force,
            moment=moment,
            peak=float(net.max(initial=0.0)),
            height=prepared.center_height,
        ),
        prepared.span,
        prepared.events,
    )
    return charts, (
        "Residuals are the forces at the model's root that the motion would need besides the"
        " measured ones."
    )


def joint_section(prepared: Prepared) -> Section | None:
    """Angles and moments of the joints that move, right and left together."""
    results = prepared.results
    motion = results.kinematics.motion
    if motion is None or not len(motion) or results.model is None:
        return None
    ranges = {extreme.name: extreme.high - extreme.low for extreme in extremes(motion)}
    chosen = coordinate_pairs(results.model, ranges)
    if not chosen:
        return None
    torques = results.dynamics.torques
    moving = sum(1 for span in ranges.values() if span > 1e-6)
    lead = (
        f"The {len(chosen)} joints shown are the usual ones and those that move most, of {moving}"
        " coordinates that "
    )
    lead += "move; all are in the table." + (
        " Vertical lines are events." if prepared.events else ""
    )
    banded = COORDINATE_VALUE.name in results.uncertainty.spreads
    lead += prepared.detail_note + (BANDS if banded else "")
    legend = SIDES_LEGEND + ((("truth", "truth"),) if results.recorded.truth else ())
    title = "Joint angles and moments" if torques is not None else "Joint angles"
    return Section(
        key="joints",
        title=title,
        lead=lead,
        legend=legend,
        figures=_joint_figures(prepared, motion, chosen),
        grids=tuple(_joint_grids(prepared, motion)),
    )


def _joint_figures(
    prepared: Prepared, motion: Motion, chosen: Sequence[Pair]
) -> tuple[Figure, ...]:
    """Draw the angles of pairs of coordinates, and their moments below."""
    results = prepared.results
    torques = results.dynamics.torques
    truth = results.recorded.truth or Truth()
    spreads = results.uncertainty.spreads
    mass = 0.0 if results.model is None or results.dynamics.root_note else results.model.mass
    scale = (1.0 / mass, "N·m/kg") if mass > 0.0 else None
    shown = (prepared.detail, prepared.events)
    angles = drawings.PairSeries(
        series=motion,
        unit="°",
        factor=180 / np.pi,
        truth=truth.motion,
        spread=spreads.get(COORDINATE_VALUE.name),
    )
    margin = 36 if scale and torques is not None else 8
    moments = None
    if torques is not None:
        moments = drawings.PairSeries(
            series=torques,
            unit="N·m",
            second=scale,
            truth=truth.torques,
            spread=spreads.get(
                GENERALIZED_FORCE_WITH_CONTACTS.name, spreads.get(GENERALIZED_FORCE.name)
            ),
        )
    figures = []
    for pair in chosen:
        base = pair.label.removesuffix(" angle")
        drawing = drawings.pair_panel(f"{base} angle", pair, angles, shown, margin)
        if moments is not None and any(name in moments.series.names for name in pair.names):
            drawing += drawings.pair_panel(f"{base} moment", pair, moments, shown)
        figures.append(Figure(drawing))
    return tuple(figures)


def _joint_grids(prepared: Prepared, motion: Series) -> list[Grid]:
    results = prepared.results
    model = results.model
    assert model is not None
    turning = {
        coordinate.name for coordinate in model.coordinates if coordinate.motion == "rotational"
    }
    torques = results.dynamics.torques

    def grid(series: Series, quantity: Quantity, last: str, what: str) -> Grid:
        rows = []
        for extreme in extremes(
            series, dict.fromkeys(turning, 180 / np.pi) if series is motion else None
        ):
            motion_kind: MotionKind = "rotational" if extreme.name in turning else "translational"
            unit = shown_unit(quantity.unit_of(motion_kind))
            ends = [f"{number(value)} {unit}" for value in (extreme.low, extreme.high)]
            times = [f"{number(time, 0.001)} s" for time in (extreme.low_time, extreme.high_time)]
            size = f"{number(extreme.high - extreme.low)} {unit}"
            if series is torques:
                peak = max(abs(extreme.low), abs(extreme.high))
                size = f"{number(peak / model.mass)} {unit}/kg" if model.mass > 0 else "–"
            rows.append((extreme.name, ends[0], times[0], ends[1], times[1], size))
        head = ("Coordinate", "Smallest", "at", "Largest", "at", last)
        return Grid(head=head, rows=tuple(rows), title=f"All {len(rows)} {what}", folded=True)

    grids = [grid(motion, COORDINATE_VALUE, "Range", "coordinates")]
    if torques is not None:
        grids.append(grid(torques, GENERALIZED_FORCE, "Peak per body mass", "generalized forces"))
    return grids
