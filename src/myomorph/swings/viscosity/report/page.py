"""The page on a cohort of swinging limbs: tables I and II of [S], figures, and what to trust; and
on relaxed limbs.
"""

from __future__ import annotations

from collections.abc import Mapping

from myomorph.lab.report.charts.marks import Level
from myomorph.lab.report.page.page import Tile, rendered
from myomorph.lab.report.page.parts import Note, PageHead, Section, cited
from myomorph.swings.viscosity.cohort import STROEVE_TOTAL_VISCOSITY, CohortLine, cohort
from myomorph.swings.viscosity.relaxed.drops import SILENT
from myomorph.swings.viscosity.relaxed.identify import UNITS
from myomorph.swings.viscosity.report.limb_report import limb_section
from myomorph.swings.viscosity.report.sections import cohort_section, specimen_sections
from myomorph.swings.viscosity.report.specimen_report import ViscosityInput
from myomorph.swings.viscosity.report.tables import scientific, table_section, with_interval


def viscosity_page(viscosity_input: ViscosityInput) -> str:
    """One self-contained HTML page on all specimens, as HTML text."""
    shown = viscosity_input
    parts = [("specimen", specimen) for specimen in shown.specimens] + [
        ("limb", limb) for limb in shown.limbs
    ]
    failed = (
        Note("warning", f"{kind.capitalize()} {part.name} could not be done: {part.failure}")
        for kind, part in parts
        if part.failure
    )
    warnings = tuple(
        f"{kind} {part.name}: {note}"
        for kind, part in parts
        for note in part.notes
        if note != SILENT
    )
    # What each limb's swings may not be believed for comes first: muscles whose silence is unknown,
    # swings left out.
    first = [(limb.name, note) for limb in shown.limbs for note in limb.notes]
    limbs = (
        Note("real" if note == SILENT else "warning", f"Limb {name}: {note}.")
        for name, note in first
    )
    notes = (*failed, *limbs, *shown.notes)
    page = PageHead(
        title=shown.title,
        date=shown.date,
        version=shown.version,
        notes=notes,
        sources=shown.sources,
        steps=shown.steps,
        warnings=warnings,
    )
    lines = {
        line.quantity.name: line
        for line in cohort([specimen.row for specimen in viscosity_input.done])
    }
    literature = (
        ("stroeve1999",) if any(specimen.shoulder for specimen in viscosity_input.done) else ()
    )
    specimens = ("murai2016", *literature, "cameron2008") if shown.specimens else ()
    sources = cited(*specimens, *(("wartenberg1951", "degroote2018") if shown.limbs else ()))
    tiles = _tiles(lines) + [
        Tile(
            with_interval(limb.row[name]),
            f"{limb.name}: {name} of {limb.coordinate} [{UNITS[name]}]",
            "ok",
        )
        for limb in shown.limbs
        for name in ("viscosity", "stiffness")
        if name in limb.row
    ]
    return rendered(page, _sections(shown, lines), sources, facts=_facts(shown), tiles=tiles)


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
        rows.append(
            ("Swings", f"{swings} in {trials} trials, {sum(part.seconds for part in parts):.0f} s")
        )
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
        if line.count > 1
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
