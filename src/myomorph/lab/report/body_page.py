"""The page of one person's body: a picture, and what was measured and what follows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from myomorph.body.shape.body_segments import SegmentMass, skin_owners
from myomorph.body.shape.shape import Shape
from myomorph.lab.report.page.page import Summary, rendered
from myomorph.lab.report.page.parts import Figure, PageHead, Section, Sheet
from myomorph.lab.report.scene.image import data_uri, png
from myomorph.lab.report.scene.raster import Canvas, View
from myomorph.lab.report.scene.shapes import normals

HEIGHT = 620  # Of the picture [pixels]
SHRINK = 2
MARGIN = 1.04  # Of the picture over the body
COLORS: Mapping[str, tuple[float, float, float]] = {
    "head": (0.93, 0.80, 0.68),
    "upper_trunk": (0.62, 0.76, 0.86),
    "lower_trunk": (0.73, 0.68, 0.85),
    "upper_arm": (0.62, 0.80, 0.64),
    "lower_arm": (0.91, 0.68, 0.55),
    "hand": (0.93, 0.84, 0.58),
    "thigh": (0.62, 0.80, 0.64),
    "shank": (0.91, 0.68, 0.55),
    "foot": (0.93, 0.84, 0.58),
}
"""Of segments in the picture: neighbors differ, both sides are alike."""
VIEWS = ("front", "side")
INTERVAL = 1.96  # Standard deviations on both sides of a 95 % interval


def segment_sheet(segments: Sequence[SegmentMass]) -> Sheet:
    """Table of the segments: masses with 95 % intervals, mass centers and inertias."""
    return Sheet(
        (
            "segment",
            "mass [kg]",
            "95 % low [kg]",
            "95 % high [kg]",
            *(f"center {axis} [m]" for axis in "xyz"),
            *(f"I_{axes} [kg m^2]" for axes in ("xx", "yy", "zz", "xy", "xz", "yz")),
        ),
        [
            (
                " ".join((part.segment.side, part.segment.name.replace("_", " "))).strip(),
                part.mass,
                *_interval(part.mass, part.sd),
                *map(float, part.center),
                *(float(part.inertia[i, i]) for i in range(3)),
                *(float(part.inertia[i, j]) for i, j in ((0, 1), (0, 2), (1, 2))),
            )
            for part in segments
        ],
    )


def measurement_sheet(shape: Shape) -> Sheet:
    """Table of what was measured, and of what people alike have, with 95 % intervals."""
    rows: list[tuple[str | float | None, ...]] = []
    for name, value in shape.measured.items():
        rows.append((_with_unit(name), "measured", value, None, None, shape.reached[name]))
    if shape.alike is not None:
        for name in shape.alike.names:
            middle = shape.alike.expected(name)
            low, high = _interval(middle, shape.alike.sd(name))
            row = (
                _with_unit(name),
                "of similar people",
                middle,
                low,
                high,
                shape.reached.get(name),
            )
            rows.append(row)
    return Sheet(("measurement", "source", "value", "95 % low", "95 % high", "of this body"), rows)


def body_page(shape: Shape, segments: Sequence[SegmentMass], head: PageHead) -> str:
    """One page with the body drawn, its measurements and its segments; HTML text."""
    mass = shape.reached["mass"]
    sheet = segment_sheet(segments)
    few = Sheet(sheet.head[:4], [row[:4] for row in sheet.rows])
    facts = [("Height", f"{shape.reached['height']:.3f} m")]
    facts.append(("Chest", f"{shape.reached['chest']:.3f} m"))
    known = "" if "mass" in shape.measured else mass_interval(shape)
    facts.append(("Mass", f"{mass:.1f} kg{known}"))
    section = Section(
        key="body",
        title="The body",
        lead="From the front and from the right; segments are cut at the joints.",
        figures=(Figure(svg=picture(shape), size="wide"),),
        grids=(
            few.grid("Masses of segments"),
            measurement_sheet(shape).grid("Measurements [m], [kg]"),
            sheet.grid("Mass centers and inertias about them", folded=True),
        ),
    )
    return rendered(head, (section,), (), Summary(facts=facts))


def mass_interval(shape: Shape) -> str:
    """Write the 95 % interval of a mass that was not measured, in parentheses; "" where unknown."""
    if shape.alike is None or "mass" not in shape.alike.names:
        return ""
    low, high = _interval(shape.alike.expected("mass"), shape.alike.sd("mass"))
    return f" ({low:.1f} to {high:.1f} kg)"


def picture(shape: Shape) -> str:
    """Draw the body from two sides, each segment in a color: SVG text."""
    vertices = shape.skin.surface.vertices
    scale = HEIGHT / (MARGIN * float(np.ptp(vertices[:, 1])))
    shading = normals(shape.skin.surface)
    owners = skin_owners(shape)
    faces = shape.skin.surface.faces
    images = []
    at = 0
    for view in VIEWS:
        across = np.array([0.0, 0.0, -1.0]) if view == "front" else np.array([1.0, 0.0, 0.0])
        towards = np.array([1.0, 0.0, 0.0]) if view == "front" else np.array([0.0, 0.0, 1.0])
        axes = np.stack([across, [0.0, 1.0, 0.0], towards])
        wide = int(MARGIN * float(np.ptp(vertices @ across)) * scale) + 1
        canvas = Canvas(
            View(
                axes=axes,
                center=0.5 * (vertices.min(axis=0) + vertices.max(axis=0)),
                scale=scale * SHRINK,
                width=wide * SHRINK,
                height=HEIGHT * SHRINK,
            )
        )
        for i, segment in enumerate(shape.segments):
            part = faces[owners[faces[:, 0]] == i]
            canvas.surface(vertices, shading, part, COLORS[segment.name])
        address = data_uri(png(canvas.picture(SHRINK)))
        images.append(
            f'<image x="{at}" y="0" width="{wide}" height="{HEIGHT}" href="{address}">'
            f"<title>The body from the {view}</title></image>"
        )
        at += wide + 20
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {at} {HEIGHT}" role="img"'
        f' aria-label="The body from two sides">{"".join(images)}</svg>'
    )


def _interval(value: float, sd: float) -> tuple[float | None, float | None]:
    """Return a 95 % interval of what has a relative standard deviation; None where unknown."""
    if not np.isfinite(sd):
        return None, None
    return value * float(np.exp(-INTERVAL * sd)), value * float(np.exp(INTERVAL * sd))


def _with_unit(name: str) -> str:
    """Write a measurement with its unit."""
    unit = "kg" if name == "mass" else "m"
    return f"{name}, {unit}"
