"""The page on a morphed model: warnings, bones, moment arms, muscles and joints."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from myomorph.bones.morph.checks.warnings import KINDS, MorphChecks
from myomorph.bones.morph.maps.fields import BoneMap, muscle_sizes
from myomorph.bones.morph.morphed import Morph
from myomorph.bones.report import tables
from myomorph.bones.report.figures import arm_figure, body_figure, bone_figures, name_of
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.messages import unique
from myomorph.core.model.model import Model
from myomorph.core.model.provenance import Provenance
from myomorph.lab.report.charts.axis import number
from myomorph.lab.report.charts.rows import Rows, dot_plot
from myomorph.lab.report.page.page import Summary, Tile, rendered
from myomorph.lab.report.page.parts import (
    Figure,
    Grid,
    Note,
    PageHead,
    Section,
    Step,
    cited,
    option_text,
)

SOURCES = (
    "morphing",
    "umeyama1991",
    "shepard1968",
    "lewis2000",
    "carr2001",
    "amberg2007",
    "modenese2016",
    "barill2018",
    "pellikaan2014",
)
"""Keys of the sources that the page cites."""

ARM_COLUMNS = (
    "Coordinate",
    "Muscle",
    "Source mean [mm]",
    "Minimum",
    "Maximum",
    "Target mean [mm]",
    "Minimum",
    "Maximum",
    "Ratio to scaled source",
    "Same sign",
    "Jump, source [mm]",
    "Jump, target [mm]",
    "Within, 90 % [mm]",
)


@dataclass(frozen=True, kw_only=True)
class PageParts:
    """Parts of a page on a morphed model that belong to one study.

    Attributes
    ----------
    title : of the page; by default the names of both models
    notes : what is real, assumed or simulated, shown first
    further : sections that come after the warnings, as of errors against a known truth
    """

    title: str = ""
    notes: Sequence[Note] = ()
    further: Sequence[Section] = ()


def morph_page(
    morph: Morph,
    checks: MorphChecks,
    made: Provenance,
    warnings: Sequence[str] = (),
    parts: PageParts | None = None,
) -> str:
    """Write one self-contained HTML page on a morphed model."""
    parts = parts or PageParts()
    title = parts.title or f"{morph.model.name}: muscles of {morph.source.name}"
    step = Step(
        "morph", FrozenMap({name: option_text(value) for name, value in made.options.items()})
    )
    lines = unique([*warnings, *morph.notes, *checks.notes])
    head = PageHead.of(title, made, (*parts.notes, *_assumed(morph)), lines)
    first, *others = morphing_sections(morph, checks)
    return rendered(
        replace(head, steps=(step,)),
        [first, *parts.further, *others],
        cited(*SOURCES),
        Summary(
            facts=_facts(morph),
            tiles=_tiles(morph, checks),
        ),
    )


def _assumed(morph: Morph) -> list[Note]:
    """List what no bone showed."""
    result = []
    by = {
        "landmarks": "mapped by landmarks alone",
        "neighbors": "without a bone in the target: scaled as their neighbors",
        "surrounding": "virtual links, mapped by the bones around",
    }
    touched = {point.body for point in morph.points}
    for basis, words in by.items():
        bodies = [
            bone.body
            for bone in morph.bones.values()
            if bone.basis == basis and bone.body in touched
        ]
        if bodies:
            result.append(Note("assumed", f"{', '.join(bodies)}: {words}."))
    text = (
        "The same muscles run the same way around the same bones in source and target; differences"
        " of a muscle from the source's beyond those of its bones are not modelled."
    )
    return [*result, Note("assumed", text)]


def _facts(morph: Morph) -> list[tuple[str, str]]:
    def printed(model: Model) -> str:
        return (
            f"{model.name}: {len(model.bodies)} bodies, {len(model.muscles)} muscles,"
            f" {number(model.mass)} kg"
        )

    points = len(morph.points)
    bases = Counter(bone.basis for bone in morph.bones.values())
    owners = len({point.owner for point in morph.points})
    return [
        ("Source", printed(morph.source)),
        ("Target", printed(morph.model)),
        ("Transferred", f"{points} points of {owners} muscles and ligaments"),
        ("Bones", ", ".join(f"{count} by {basis}" for basis, count in bases.items())),
    ]


def _tiles(morph: Morph, checks: MorphChecks) -> list[Tile]:
    """Return the few numbers to see first."""
    tiles = [_count(len(checks.warnings), "warnings")]
    through = [penetration for penetration in checks.penetrations if penetration.increase > 0.0]
    worst = max((path.increase for path in through), default=0.0)
    deep = len(checks.of("bone"))
    words = f"deeper through bone than source, worst; {deep} warnings"
    tiles.append(Tile(f"{number(1e3 * worst)} mm", words, "note" if deep else "ok"))
    tiles.append(_count(len(checks.of("sign")), "moment arms of opposite sign"))
    tiles.append(_count(len(checks.of("jump")), "moment arms with new jumps"))
    residuals = [
        bone.measures["residual [m]"]
        for bone in morph.bones.values()
        if "residual [m]" in bone.measures
    ]
    if residuals:
        tiles.append(Tile(f"{number(1e3 * max(residuals))} mm", "residual of the worst bone", "ok"))
    tiles.append(_count(len(checks.folded), "points where the map is inverted"))
    sizes = [
        bone.whole.scale for bone in morph.bones.values() if bone.basis in ("bone", "landmarks")
    ]
    if sizes:
        tiles.append(
            Tile(
                f"{number(float(np.median(sizes)))}",
                "size relative to the source, median of bones",
                "ok",
            )
        )
    return tiles


def _count(count: int, name: str) -> Tile:
    return Tile(str(count), name, "note" if count else "ok")


FIRST_ARMS = 6  # Coordinates whose curves are open at first.
FIRST_WARNINGS = 8  # Of each kind, seen at first.
MAX_OPEN_ROWS = 30
MAX_ROWS = 1000  # Of a folded table.


def morphing_sections(morph: Morph, checks: MorphChecks) -> list[Section]:
    """All parts, warnings first."""
    made = (
        warning_section(checks),
        body_section(morph),
        bone_section(morph),
        arm_section(morph, checks),
        muscle_section(morph),
        path_section(morph, checks),
        joint_section(morph),
        mass_section(morph),
        method_section(morph),
    )
    return [section for section in made if section is not None]


def warning_section(checks: MorphChecks) -> Section:
    """List what looks wrong, the worst of each kind first."""
    rows = tuple((KINDS[warning.kind][0], warning.text) for warning in checks.warnings)
    worst = (warning for kind in KINDS for warning in checks.of(kind)[:FIRST_WARNINGS])
    first = tuple((KINDS[warning.kind][0], warning.text) for warning in worst)
    limits = checks.options
    count = f"{len(rows)} warnings" if rows else "No warning"
    lead = f"{count} compared with the source scaled to the target. "
    lead += (
        "Checked: paths that run deeper through a bone than the source's by"
        f" {100 * limits.deeper:g} % of the longest bone, anywhere in the range of a coordinate;"
        " moment arms of opposite sign, with a jump that the source does not have, or"
        f" {limits.ratio:g} times the size of the bones; points where the map is inverted;"
        f" attachments {100 * limits.off_surface:g} % of the longest bone further from their"
        f" surface; fiber lengths that leave the source's range by {limits.fiber:g} of their"
        f" optimal length; joint centers that parent and child place {100 * limits.gap:g} % of the"
        " longest bone apart. Faults that the source has too give no warning."
    )
    grids = [Grid(("Kind", "Warning"), first)] if rows else []
    if len(rows) > len(first):
        grids.append(
            Grid(
                head=("Kind", "Warning"), rows=rows, title=f"All {len(rows)} warnings", folded=True
            )
        )
    return Section(
        key="warnings", title="Warnings", lead=lead, legend=(), figures=(), grids=tuple(grids)
    )


def body_section(morph: Morph) -> Section:
    """Source and target side by side."""
    lead = "Both in their default pose with their bones and muscle paths."
    return Section(
        key="bodies",
        title="Source and target",
        lead=lead,
        legend=(),
        figures=(Figure(body_figure(morph), "full"),),
    )


def bone_section(morph: Morph) -> Section:
    """How well the source's bones, as they are carried, fit the target's."""
    figures = bone_figures(morph)
    touched = {point.body for point in morph.points}
    bones = [
        bone for bone in morph.bones.values() if bone.basis != "neighbors" or bone.body in touched
    ]
    noted = tuple((bone.body, text) for bone in bones for text in bone.notes)
    lead = (
        "The target's bones, colored by the distance of the source's mapped bones: blue where the"
        " target lies inside, red where outside. Size is the scale of the target relative to the"
        " source."
    )
    return Section(
        key="bones",
        title="Bones and their maps",
        lead=lead,
        legend=(),
        figures=tuple(Figure(svg) for svg in figures),
        grids=(_map_grid(bones), Grid(("Bone", "Note"), noted, "Notes of the maps")),
    )


def _map_grid(bones: Sequence[BoneMap]) -> Grid:
    """Tabulate the maps of bones with their measures."""
    measured = dict.fromkeys(name for bone in bones for name in bone.measures)
    measures = [name for name in measured if name != "features"]
    rows = []
    for bone in bones:
        known = [_measured(name, bone.measures.get(name)) for name in measures]
        count = "" if bone.features is None else str(len(bone.features))
        name = bone.body if bone.body == bone.target_body else f"{bone.body} → {bone.target_body}"
        rows.append((name, bone.basis, number(bone.whole.scale), count, *known))
    printed = [name.replace("[m]", "[mm]").replace("_", " ") for name in measures]
    head = ("Bone", "Basis", "Size", "Features", *(name[:1].upper() + name[1:] for name in printed))
    return Grid(
        head=head, rows=tuple(rows), title="Maps of the bones", folded=len(rows) > MAX_OPEN_ROWS
    )


def _measured(name: str, value: float | None) -> str:
    if value is None:
        return "–"
    return number(1e3 * value if "[m]" in name else float(value))


def arm_section(morph: Morph, checks: MorphChecks) -> Section | None:
    """Moment arms over the joints' ranges, as curves and as a table."""
    if not checks.arms:
        return None
    order = tuple(
        (name_of(arms.pair), str(len(arms.muscles)), number(checks.order[arms.pair.source], 0.001))
        for arms in checks.arms
    )
    grids = (
        Grid(("Coordinate", "Muscles", "Rank correlation"), order, "Order of mean moment arms"),
        _arm_grid(morph, checks),
    )
    lead = (
        "Moment arms r = −dl/dq over each coordinate's range, the other coordinates at their"
        " defaults. The source's are scaled by the size of the bones that each muscle attaches to."
        " Names of muscles with a warning are red. About translations, moment arms have no unit."
    )
    if any(arms.within is not None for arms in checks.arms):
        lead += (
            " Bands are 90 % intervals that follow from those of the points on matched bones and of"
            " mapped joints; muscles with a point whose interval is not known have none."
        )
    legend = (("first", "target"), ("truth", "source, scaled to the target"))
    return Section(
        key="arms",
        title="Moment arms",
        lead=lead,
        legend=legend,
        figures=_arm_figures(morph, checks),
        grids=grids,
    )


def _arm_figures(morph: Morph, checks: MorphChecks) -> tuple[Figure, ...]:
    """Draw the moment arms about each coordinate; only the first are open."""
    sizes = muscle_sizes(morph.source, morph.bones)
    figures = []
    for i, arm in enumerate(checks.arms):
        flagged = {
            w.place
            for w in checks.warnings
            if w.kind in ("sign", "jump", "arm") and arm.pair.target in w.text
        }
        folded = "" if i < FIRST_ARMS else f"About {arm.pair.target}: {len(arm.muscles)} muscles"
        figures.append(Figure(arm_figure(arm, sizes, flagged), "full", folded=folded))
    return tuple(figures)


def _arm_grid(morph: Morph, checks: MorphChecks) -> Grid:
    """Tabulate moment arms; of too many rows, those with a warning."""
    rows = tables.arm_summary_rows(morph, checks).rows
    printed = [
        (
            str(pair),
            str(muscle),
            *(number(1e3 * arm) for arm in arms[:6]),
            number(arms[6]),
            f"{100 * arms[7]:.0f} %",
            *(number(1e3 * arm) for arm in arms[8:]),
        )
        for pair, muscle, *numbers in rows
        for arms in [np.array(numbers, float).tolist()]
    ]
    title = f"All {len(rows)} pairs of muscle and coordinate"
    if len(printed) > MAX_ROWS:
        printed = [
            row
            for row in printed
            if any(w.place == row[1] and row[0] in w.text for w in checks.warnings)
        ]
        printed = printed[:MAX_ROWS]
        title = (
            f"Those of {len(rows)} pairs of muscle and coordinate with a warning; all are in the"
            " table of the file"
        )
    return Grid(head=ARM_COLUMNS, rows=tuple(printed), title=title, folded=True)


def muscle_section(morph: Morph) -> Section | None:
    """Report changes of fibers, tendons and forces."""
    if not morph.muscles:
        return None
    names = [muscle.name for muscle in morph.muscles]
    styles = ("first", "second", "third")
    words = ("optimal fiber length", "tendon slack length", "maximum isometric force")
    figures: tuple[Figure, ...] = ()
    if len(names) <= 3 * MAX_OPEN_ROWS:
        values = np.array(
            [(muscle.fiber, muscle.tendon, muscle.force) for muscle in morph.muscles]
        ).T
        figures = (
            Figure(
                dot_plot(
                    "Target over source",
                    "",
                    Rows(names=names, values=list(values), styles=styles, labels=words),
                    880,
                ),
                "full",
            ),
        )
    rows = []
    for muscle in morph.muscles:
        ratios = map(number, (muscle.path, muscle.fiber, muscle.tendon, muscle.force))
        turned = f"{np.degrees(muscle.pennation):+.1f}°".replace("-", "−")
        ranges = (
            "{:.2f} to {:.2f}".format(*ends) for ends in (muscle.range_source, muscle.range_target)
        )
        rows.append((muscle.name, *ratios, turned, *ranges))
    head = (
        "Muscle",
        "Path",
        "Fiber",
        "Tendon",
        "Force",
        "Pennation",
        "Fiber range, source",
        "Fiber range, target",
    )
    options = morph.options
    lead = (
        f"Parameters of the target over those of the source. Fibers: “{options.fibers}”; force:"
        f" “{options.force}”; pennation: “{options.pennation}”. Fiber ranges are normalized fiber"
        " lengths over the joints' ranges of motion."
    )
    legend = tuple(zip(styles, words, strict=True))
    title = f"Parameters of {len(rows)} muscles, target over source"
    grids = (Grid(head=head, rows=tuple(rows), title=title, folded=len(rows) > MAX_OPEN_ROWS),)
    return Section(
        key="muscles",
        title="Fibers, tendons and forces",
        lead=lead,
        legend=legend,
        figures=figures,
        grids=grids,
    )


def path_section(morph: Morph, checks: MorphChecks) -> Section:
    """Attachments on the surface, and paths through bones."""
    lifted = np.array([point.lifted for point in morph.points if point.lifted > 0.0])
    lead = f"{len(morph.points)} points were transferred"
    if len(lifted):
        lead += (
            f", {len(lifted)} of them projected onto their bone's surface: by"
            f" {number(1e3 * float(np.median(lifted)))} mm in the median,"
            f" {number(1e3 * float(lifted.max()))} mm at most"
        )
    lead += (
        f". {len(checks.penetrations)} pairs of a muscle and a bone have the path below the bone's"
        " surface somewhere in the joints' ranges, in source or target."
    )
    grids = (
        Grid(("Part", "Reason"), tuple(morph.left_out.items()), "Excluded"),
        tables.penetration_rows(checks).grid(
            "Paths below the surface of bones, largest increase first", True
        ),
        tables.point_rows(morph).grid(f"All {len(morph.points)} points", True),
        tables.wrap_rows(checks).grid("Wrap objects and the certainty of their positions", True),
    )
    return Section(key="paths", title="Muscle paths", lead=lead, legend=(), figures=(), grids=grids)


def joint_section(morph: Morph) -> Section | None:
    """Joint centers."""
    if not morph.joints:
        return None
    grid = tables.joint_rows(morph).grid("Centers in the target's bones")
    fitted = sum(1 for joint in morph.joints if joint.method in ("sphere", "cylinder"))
    lead = (
        f"{fitted} of {len(morph.joints)} joint centers come from spheres and cylinders fitted to"
        " the target's articular surfaces, the others from the maps. The gap is between the"
        " centers from parent and child, known where the target's bones lie in one frame."
    )
    return Section(key="joints", title="Joints", lead=lead, legend=(), figures=(), grids=(grid,))


def mass_section(morph: Morph) -> Section:
    """Masses of the bodies."""
    title = "Masses, centers of mass and principal moments of inertia"
    lead = f"{number(morph.model.mass)} kg, the source {number(morph.source.mass)} kg."
    notes = [f"{note[:1].upper()}{note[1:]}." for note in morph.notes if note.startswith("masses")]
    grid = tables.mass_rows(morph).grid(title)
    return Section(
        key="masses",
        title="Masses",
        lead=" ".join([lead, *notes]),
        legend=(),
        figures=(),
        grids=(grid,),
    )


def method_section(morph: Morph) -> Section:
    """Describe what was done, in the order it was done."""
    options = morph.options
    near = (
        f"Points within {100 * options.surface_within:g} % of bone length of the source's surface"
    )
    rows = (
        (
            "Features",
            (
                "Pairs of points of source and target bone: landmarks, and those of the non-rigid"
                " registration."
            ),
        ),
        (
            "Maps",
            (
                "One map a bone from its features alone; virtual links move with all the bones"
                " around them."
            ),
        ),
        (
            "Points",
            (
                "Path points, wrap objects, markers and joint frames go by the map of their body,"
                " with its turns."
            ),
        ),
        ("Surfaces", f"{near} are placed at the same height over the target's, in its size."),
        ("Joints", f"Centers “{options.joints}”."),
        (
            "Muscles",
            f"Fibers “{options.fibers}”, force “{options.force}”, pennation “{options.pennation}”.",
        ),
    )
    return Section(
        key="method",
        title="Method",
        lead="",
        legend=(),
        figures=(),
        grids=(Grid(("Step", "Description"), rows),),
    )
