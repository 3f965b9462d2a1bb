"""The page on a cohort of swinging limbs, and on relaxed limbs.

It has tables I and II of [S], figures, and what to trust.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from myomorph.core.model.messages import Message, as_message
from myomorph.lab.report.charts.marks import Level
from myomorph.lab.report.page.page import Summary, Tile, rendered
from myomorph.lab.report.page.parts import Note, PageHead, Reference, Section, cited
from myomorph.swings.viscosity.cohort import STROEVE_TOTAL_VISCOSITY, CohortLine, cohort
from myomorph.swings.viscosity.relaxed.drops import SILENT
from myomorph.swings.viscosity.relaxed.identify import UNITS
from myomorph.swings.viscosity.report.limb_report import limb_section
from myomorph.swings.viscosity.report.sections import cohort_section, specimen_sections
from myomorph.swings.viscosity.report.specimen_report import (
    LimbReport,
    SpecimenReport,
    ViscosityInput,
)
from myomorph.swings.viscosity.report.tables import scientific, table_section, with_interval


def viscosity_page(viscosity_input: ViscosityInput) -> str:
    """Write one self-contained HTML page on all specimens, as HTML text."""
    shown = viscosity_input
    head = PageHead(
        title=shown.title,
        date=shown.date,
        version=shown.version,
        notes=(*_failures(shown), *_limb_notes(shown), *shown.notes),
        sources=shown.sources,
        steps=shown.steps,
        warnings=_warnings(shown),
    )
    lines = {line.quantity.name: line for line in cohort([each.row for each in shown.done])}
    tiles = _tiles(lines) + _limb_tiles(shown)
    return rendered(
        head, _sections(shown, lines), _sources(shown), Summary(facts=_facts(shown), tiles=tiles)
    )


def _parts(shown: ViscosityInput) -> list[tuple[str, SpecimenReport | LimbReport]]:
    """List specimens and limbs, each with what it is."""
    specimens = [("specimen", specimen) for specimen in shown.specimens]
    return [*specimens, *(("limb", limb) for limb in shown.limbs)]


def _failures(shown: ViscosityInput) -> list[Note]:
    """Say what could not be done, and why."""
    return [
        Note("warning", f"{kind.capitalize()} {part.name} could not be done: {part.failure}")
        for kind, part in _parts(shown)
        if part.failure
    ]


def _limb_notes(shown: ViscosityInput) -> list[Note]:
    """Say first what each limb's swings may not be believed for.

    That is muscles whose silence is unknown, and swings that were left out.
    """
    return [
        Note("real" if note == SILENT else "warning", f"Limb {limb.name}: {note}.")
        for limb in shown.limbs
        for note in limb.notes
    ]


def _warnings(shown: ViscosityInput) -> tuple[Message, ...]:
    """List what was said of specimens and limbs, but for silence."""
    return tuple(
        as_message(note).within(f"{kind} {part.name}")
        for kind, part in _parts(shown)
        for note in part.notes
        if note != SILENT
    )


def _sources(shown: ViscosityInput) -> tuple[Reference, ...]:
    """Cite what the page rests on."""
    shoulders = any(specimen.shoulder for specimen in shown.done)
    literature = ("stroeve1999",) if shoulders else ()
    specimens = ("murai2016", *literature, "cameron2008") if shown.specimens else ()
    limbs = ("wartenberg1951", "degroote2018") if shown.limbs else ()
    return cited(*specimens, *limbs)


def _limb_tiles(shown: ViscosityInput) -> list[Tile]:
    """Make a tile of viscosity and stiffness of each limb."""
    return [
        Tile(
            with_interval(limb.row[name]),
            f"{limb.name}: {name} of {limb.coordinate} [{UNITS[name]}]",
            "ok",
        )
        for limb in shown.limbs
        for name in ("viscosity", "stiffness")
        if name in limb.row
    ]


def _facts(viscosity_input: ViscosityInput) -> list[tuple[str, str]]:
    both = sum(len(specimen.conditions) == 2 for specimen in viscosity_input.done)
    rows = []
    if viscosity_input.specimens:
        rows.append(
            (
                "Specimens",
                f"{len(viscosity_input.specimens)}, {both} of them with and without muscles",
            )
        )
    if viscosity_input.limbs:
        drops = sum(len(limb.drops) for limb in viscosity_input.limbs)
        rows.append(("Relaxed limbs", f"{len(viscosity_input.limbs)}, drops: {drops}"))
    parts = [part for specimen in viscosity_input.done for part in specimen.conditions.values()]
    if parts:
        swings = sum(part.swings for part in parts)
        trials = sum(part.trials for part in parts)
        seconds = sum(part.seconds for part in parts)
        rows.append(("Swings", f"{swings} in {trials} trials, {seconds:.0f} s"))
    return rows


def _tiles(lines: Mapping[str, CohortLine]) -> list[Tile]:
    wanted = {
        "joint_viscosity": "joint viscosity, without muscles",
        "total_viscosity": "total viscosity, with muscles",
        "muscle_viscosity": "muscle viscosity",
    }
    shown = [
        (line, f"{wanted[name]} [{line.quantity.unit}]")
        for name, line in lines.items()
        if name in wanted
    ]
    return [
        Tile(f"{scientific(line.mean)} ± {scientific(line.sd)}", words, "ok")
        for line, words in shown
    ]


def _sections(viscosity_input: ViscosityInput, lines: Mapping[str, CohortLine]) -> list[Section]:
    levels = {
        name: [Level(value=line.mean, label="", style="mean", spread=line.sd)]
        for name, line in lines.items()
        if line.count > 1 and np.isfinite(line.mean)
    }
    if any(specimen.shoulder and specimen.intact is not None for specimen in viscosity_input.done):
        levels.setdefault("total_viscosity", []).append(
            Level(STROEVE_TOTAL_VISCOSITY, "Stroeve 1999")
        )
    result = []
    if viscosity_input.specimens:
        result += [
            table_section(viscosity_input.done, lines),
            cohort_section(viscosity_input.done, levels),
        ]
    for order, specimen_report in enumerate(viscosity_input.done, 1):
        result += specimen_sections(specimen_report, order)
    result += [
        limb_section(limb, order) for order, limb in enumerate(viscosity_input.limbs, 1) if limb.row
    ]
    return result
