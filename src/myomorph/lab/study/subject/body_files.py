"""One person's body from measurements, as a model and a folder of files: `myomorph body`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from myomorph.body.shape.body_model import body_model, mesh_name, segment_skins
from myomorph.body.shape.body_segments import SegmentMass, segment_masses
from myomorph.body.shape.people import Sex
from myomorph.body.shape.shape import Shape, body_shape
from myomorph.core.io.carried_meshes import GEOMETRY
from myomorph.core.io.mesh import write_obj
from myomorph.core.io.osim.write import write_osim
from myomorph.core.model.provenance import Provenance
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
from myomorph.lab.study.subject.subjects import ModelOutput, tables_folder, write_made_model

MODEL = "body"
"""Name of the model where a folder is asked for."""


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


@dataclass(frozen=True, eq=False)
class MadeBody:
    """A person's body, and where its files are.

    Attributes
    ----------
    shape : of the person
    segments : what its parts weigh
    model : file of the model
    tables : folder of skin, tables and page
    """

    shape: Shape
    segments: list[SegmentMass]
    model: Path
    tables: Path


def make_body(out: Path, person: Measured) -> MadeBody:
    """Find a person's body and write it, whole or not at all.

    Parameters
    ----------
    out : model (.osim), with a folder beside it as other commands have; or a folder for all
    person : measurements [m], [kg], [years]

    Returns
    -------
    the shape, its segments, and where they were written

    Raises
    ------
    BadData : as `body_shape`
    BadFile : a model cannot be written there
    """
    is_model = out.suffix.lower() == ".osim"
    tables = tables_folder(out, "body") if is_model else out
    options = asdict(person)
    shape = body_shape(**options)
    mass = shape.reached["mass"] if person.mass is None else person.mass
    segments = segment_masses(shape, mass)
    made = provenance_of("body", (), options)
    path = out if is_model else out / f"{MODEL}.osim"
    model = body_model(shape, segments, path.stem)
    if is_model:

        def fill(folder: Path) -> None:
            _write_tables(shape, segments, folder, made)

        write_made_model(model, made, ModelOutput(out, tables), fill, shape.notes)
        _write_skins(shape, path)
    else:
        with result_folder(out, made, shape.notes) as folder:
            _write_tables(shape, segments, folder, made)
            write_osim(model, folder / path.name)
            _write_skins(shape, folder / path.name)
    return MadeBody(shape=shape, segments=segments, model=path, tables=tables)


def _write_skins(shape: Shape, model: Path) -> None:
    """Write the surfaces that the model's bodies are drawn by, where OpenSim looks for them."""
    geometry = model.parent / GEOMETRY
    geometry.mkdir(exist_ok=True)
    for segment, surface in segment_skins(shape).items():
        write_obj(surface, geometry / mesh_name(model.stem, segment))


def _write_tables(
    shape: Shape, segments: Sequence[SegmentMass], folder: Path, made: Provenance
) -> None:
    """Write skin, tables and page."""
    note = Note(
        "assumed", "A statistical body (anny); missing measurements are those of similar people."
    )
    head = PageHead.of("Body of a person", made, (note,), shape.notes)
    write_obj(shape.skin.surface, folder / "skin.obj")
    for name, sheet in (
        ("segments.csv", segment_sheet(segments)),
        ("measurements.csv", measurement_sheet(shape)),
    ):
        (folder / name).write_text(sheet.csv(), encoding="utf-8")
    page = body_page(shape, segments, head)
    (folder / "report.html").write_text(page, encoding="utf-8")


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
