"""The page on a cohort of swinging limbs: tables I and II of [S], figures, and what to trust."""

from __future__ import annotations

from collections.abc import Mapping

from myomorph.report.charts.marks import Level
from myomorph.report.page.page import Tile, rendered
from myomorph.report.page.parts import Note, PageHead, Section
from myomorph.report.page.references import cited
from myomorph.viscosity.cohort import STROEVE_TOTAL_VISCOSITY, CohortLine, cohort
from myomorph.viscosity.report.given import ViscosityInput
from myomorph.viscosity.report.sections import cohort_section, specimen_sections
from myomorph.viscosity.report.tables import scientific, table_section, truth_grid


def viscosity_page(given: ViscosityInput) -> str:
    """One self-contained HTML page on all specimens, as HTML text."""
    lost = [one for one in given.specimens if one.failure]
    failed = (Note("warning", f"Specimen {one.name} could not be done: {one.failure}") for one in lost)
    page = PageHead(
        title=given.title,
        date=given.date,
        version=given.version,
        notes=(*failed, *given.notes),
        sources=given.sources,
        steps=given.steps,
        warnings=tuple(f"specimen {one.name}: {note}" for one in given.specimens for note in one.notes),
    )
    lines = {one.quantity.name: one for one in cohort([one.row for one in given.done])}
    literature = ("stroeve1999",) if any(one.shoulder for one in given.done) else ()
    sources = cited("murai2016", *literature, "cameron2008")
    return rendered(page, _sections(given, lines), sources, facts=_facts(given), tiles=_tiles(lines))


def _facts(given: ViscosityInput) -> list[tuple[str, str]]:
    both = sum(1 for one in given.done if one.without is not None and one.intact is not None)
    rows = [("Specimens", f"{len(given.specimens)}, {both} of them with and without muscles")]
    parts = [part for one in given.done for part in (one.without, one.intact) if part is not None]
    if parts:
        swings, trials = sum(part.swings for part in parts), sum(part.trials for part in parts)
        rows.append(("Swings", f"{swings} in {trials} trials, {sum(part.seconds for part in parts):.0f} s"))
    return rows


def _tiles(lines: Mapping[str, CohortLine]) -> list[Tile]:
    wanted = (
        ("joint_viscosity", "joint viscosity, without muscles"),
        ("total_viscosity", "total viscosity, with muscles"),
        ("muscle_viscosity", "muscle viscosity"),
    )
    found = [(lines[name], words) for name, words in wanted if name in lines]
    return [
        Tile(f"{scientific(one.mean)} ± {scientific(one.sd)}", f"{words} [{one.quantity.unit}]", "ok")
        for one, words in found
    ]


def _sections(given: ViscosityInput, lines: Mapping[str, CohortLine]) -> list[Section]:
    tables = table_section(given)
    beside = truth_grid(given.done)
    if beside is not None:
        tables = Section(tables.key, tables.title, tables.lead, grids=(*tables.grids, beside))
    levels = {name: [Level(line.mean, "", "mean", line.sd)] for name, line in lines.items() if line.count > 1}
    if any(one.shoulder and one.intact is not None for one in given.done):
        levels.setdefault("total_viscosity", []).append(Level(STROEVE_TOTAL_VISCOSITY, "Stroeve 1999"))
    found = [tables, cohort_section(given.done, levels)]
    for order, one in enumerate(given.done, 1):
        found += specimen_sections(one, order)
    return found
