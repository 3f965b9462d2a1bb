"""The page on a morphed model: warnings, source beside target, bones, moment arms, muscles, joints."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from myomorph.model.frozen_map import FrozenMap
from myomorph.model.model import Model
from myomorph.model.provenance import Provenance
from myomorph.morph.checks.warnings import MorphChecks
from myomorph.morph.morphed import Morph
from myomorph.report.charts.axis import number
from myomorph.report.morph.sections import morphing_sections
from myomorph.report.page.page import Tile, rendered
from myomorph.report.page.parts import Note, PageHead, Section, SourceFile, Step, cited

__all__ = ["morph_page"]

SOURCES = (
    "morphing", "umeyama1991", "shepard1968", "lewis2000", "carr2001", "amberg2007", "modenese2016", "barill2018",
    "pellikaan2014",
)  # fmt: skip
"""Keys of the sources that the page cites."""


def morph_page(
    morph: Morph,
    checks: MorphChecks,
    made: Provenance,
    warnings: Sequence[str] = (),
    *,
    title: str = "",
    notes: Sequence[Note] = (),
    further: Sequence[Section] = (),
) -> str:
    """One self-contained HTML page on a morphed model, as HTML text. `notes`: what is real, assumed or simulated, shown
    first; `further`: sections that come after the warnings, as of errors against a known truth.
    """
    title = title or f"{morph.model.name}: muscles of {morph.source.name}"
    page = PageHead(
        title=title,
        date=made.date,
        version=made.version,
        notes=(*notes, *_assumed(morph)),
        sources=tuple(SourceFile(source.role, Path(source.name).name, source.sha256) for source in made.sources),
        steps=(Step("morph", FrozenMap({name: _printed(value) for name, value in made.options.items()})),),
        warnings=tuple(dict.fromkeys([*warnings, *morph.notes, *checks.notes])),
    )
    sections = morphing_sections(morph, checks)
    return rendered(
        page,
        [*sections[:1], *further, *sections[1:]],
        cited(*SOURCES),
        facts=_facts(morph),
        tiles=_tiles(morph, checks),
    )


def _assumed(morph: Morph) -> list[Note]:
    """What no bone told."""
    result = []
    by = {
        "landmarks": "mapped by landmarks alone",
        "neighbors": "without a bone in the target: scaled as their neighbors",
        "surrounding": "virtual links, mapped by the bones around",
    }
    touched = {point.body for point in morph.points}
    for basis, words in by.items():
        bodies = [bone.body for bone in morph.bones.values() if bone.basis == basis and bone.body in touched]
        if bodies:
            result.append(Note("assumed", f"{', '.join(bodies)}: {words}."))
    result.append(
        Note(
            "assumed",
            "The same muscles run the same way around the same bones in source and target; how a muscle differs from "
            "the source's by more than its bones do is not seen.",
        )
    )
    return result


def _facts(morph: Morph) -> list[tuple[str, str]]:
    def printed(model: Model) -> str:
        return f"{model.name}: {len(model.bodies)} bodies, {len(model.muscles)} muscles, {number(model.mass)} kg"

    points, bases = len(morph.points), Counter(bone.basis for bone in morph.bones.values())
    owners = len({point.owner for point in morph.points})
    return [
        ("Source", printed(morph.source)),
        ("Target", printed(morph.model)),
        ("Transferred", f"{points} points of {owners} muscles and ligaments"),
        ("Bones", ", ".join(f"{count} by {basis}" for basis, count in bases.items())),
    ]


def _tiles(morph: Morph, checks: MorphChecks) -> list[Tile]:
    """The few numbers to see first."""
    tiles = [_count(len(checks.warnings), "warnings")]
    through = [penetration for penetration in checks.penetrations if penetration.increase > 0.0]
    worst = max((path.increase for path in through), default=0.0)
    deep = len(checks.of("bone"))
    tiles.append(
        Tile(f"{number(1e3 * worst)} mm", f"deeper through bone than source, worst; {deep} warnings",
             "note" if deep else "ok")
    )  # fmt: skip
    tiles.append(_count(len(checks.of("sign")), "moment arms of opposite sign"))
    tiles.append(_count(len(checks.of("jump")), "moment arms with new jumps"))
    residuals = [bone.measures["residual [m]"] for bone in morph.bones.values() if "residual [m]" in bone.measures]
    if residuals:
        tiles.append(Tile(f"{number(1e3 * max(residuals))} mm", "residual of the worst bone", "ok"))
    tiles.append(_count(len(checks.folded), "points where the map is inverted"))
    sizes = [bone.whole.scale for bone in morph.bones.values() if bone.basis in ("bone", "landmarks")]
    if sizes:
        tiles.append(Tile(f"{number(float(np.median(sizes)))}", "size relative to the source, median of bones", "ok"))
    return tiles


def _count(count: int, name: str) -> Tile:
    return Tile(str(count), name, "note" if count else "ok")


def _printed(value: object) -> str:
    if value is None:
        return "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:g}" if isinstance(value, float) else str(value)
