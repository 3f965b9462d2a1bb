"""One person's body from measurements, as a folder of files: `myomorph body`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from myomorph.body.shape.body_segments import SegmentMass, segment_masses
from myomorph.body.shape.people import Sex
from myomorph.body.shape.shape import Shape, body_shape
from myomorph.core.io.mesh import write_obj
from myomorph.lab.report.body_page import (
    INTERVAL,
    body_page,
    mass_interval,
    measurement_sheet,
    segment_sheet,
)
from myomorph.lab.report.page.parts import Note, PageHead
from myomorph.lab.store.results import provenance_of
from myomorph.lab.study.step.folder_steps import result_folder


@dataclass(frozen=True)
class Measured:
    """What is measured of a person, as `body_shape` takes it.

    Attributes
    ----------
    height, chest : [m]
    mass : [kg]
    sex : of the person
    age : [years]
    """

    height: float
    chest: float | None = None
    mass: float | None = None
    sex: Sex | None = None
    age: float | None = None


def make_body(out: Path, person: Measured) -> tuple[Shape, list[SegmentMass]]:
    """Find a person's body and write it, whole or not at all.

    Parameters
    ----------
    out : folder
    person : measurements [m], [kg], [years]

    Returns
    -------
    the shape, and its segments

    Raises
    ------
    BadData : as `body_shape`
    """
    options = asdict(person)
    shape = body_shape(**options)
    mass = shape.reached["mass"] if person.mass is None else person.mass
    segments = segment_masses(shape, mass)
    made = provenance_of("body", (), options)
    note = Note("assumed", "A statistical body (anny); what was not measured is of people alike.")
    head = PageHead.of("Body of a person", made, (note,), shape.notes)
    with result_folder(out, made, shape.notes) as folder:
        write_obj(shape.skin.surface, folder / "skin.obj")
        for name, sheet in (
            ("segments.csv", segment_sheet(segments)),
            ("measurements.csv", measurement_sheet(shape)),
        ):
            (folder / name).write_text(sheet.csv(), encoding="utf-8")
        page = body_page(shape, segments, head)
        (folder / "report.html").write_text(page, encoding="utf-8")
    return shape, segments


def body_lines(shape: Shape, segments: Sequence[SegmentMass]) -> list[str]:
    """Write what the command prints: the mass, and the segments with their 95 % intervals."""
    known = "measured" if "mass" in shape.measured else mass_interval(shape).strip()
    lines = [f"mass {shape.reached['mass']:.1f} kg {known}".rstrip()]
    for part in segments:
        if part.segment.side == "left":
            continue
        sides = " each" if part.segment.side else ""
        spread = f" +- {100.0 * INTERVAL * part.sd:.0f} %" if part.sd == part.sd else ""
        lines.append(f"{part.segment.name.replace('_', ' ')}{sides} {part.mass:.2f} kg{spread}")
    return lines
