"""Files of a morph: a source model with its bones, the target's bones, pairs of landmarks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np
from pydantic import Field

from myomorph.core.io.mesh import ENDINGS, read_mesh, read_surfaces
from myomorph.core.model.causes import BONES
from myomorph.core.model.errors import BadData, BadFile, listing
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Model
from myomorph.core.model.provenance import Source
from myomorph.core.model.surface import Surface
from myomorph.core.surfaces.clusters import bone_surface
from myomorph.lab.store.named_files import existing
from myomorph.lab.store.results import file_sources
from myomorph.lab.store.study_file import Strict
from myomorph.lab.study.step.own_table import TableOwner

Unit: TypeAlias = Literal["m", "cm", "mm", "in"]
METERS: Mapping[str, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}


@dataclass(frozen=True)
class MorphFiles:
    """Files and options of a morph.

    These are the model whose muscles are transferred; a folder of the target's bones, `<body>.obj`,
    `.stl`, `.ply` or `.vtp`; pairs of points, CSV; the source's own meshes, by default beside the
    model; a closed surface of the target's skin, for masses; the target's mass [kg].

    `together`: the bones lie as one scan shows them, in one frame; `mirror`: a body without a bone
    takes the mirrored one of its other side, `across` the axis of ground; `links`: bodies without a
    bone on which muscles branch, with the bones around each.
    """

    source: Path
    bones: Path
    landmarks: Path | None = None
    geometry: Path | None = None
    skin: Path | None = None
    unit: Unit = "m"
    mass: float | None = None
    together: bool = False
    mirror: bool = False
    across: Literal["x", "y", "z"] = "z"
    links: Mapping[str, tuple[str, ...]] = field(default_factory=lambda: FrozenMap({}))

    def sources(self) -> tuple[Source, ...]:
        """Return the files with their hashes."""
        bones = (("bone", path) for path in bone_files(self.bones).values())
        return file_sources(
            ("model", self.source), *bones, ("landmarks", self.landmarks), ("skin", self.skin)
        )

    def options(self) -> dict[str, object]:
        """Return the options that concern the files, for provenance."""
        told = {
            name: getattr(self, name) for name in ("unit", "mass", "together", "mirror", "across")
        }
        return told | (
            {"links": {name: list(around) for name, around in self.links.items()}}
            if self.links
            else {}
        )


class BonesTable(Strict):
    """A subject's bones, as `bones` in a study file."""

    folder: str
    landmarks: str | None = None
    geometry: str | None = None
    skin: str | None = None
    unit: Unit = "m"
    together: bool = False
    mirror: bool = False
    across: Literal["x", "y", "z"] = "z"
    links: dict[str, list[str]] = Field(default_factory=dict)


def bones_of(table: BonesTable, subject: TableOwner) -> MorphFiles:
    """Return the files that a subject's table of bones names.

    What does not exist is a problem of the table.
    """
    folder = subject.place.folder
    where = subject.place.where
    problems = subject.place.notes.problems
    for role, name in (("folder", table.folder), ("geometry", table.geometry)):
        if name is not None and not (folder / name).is_dir():
            problems.append(f"{where}: bones: {role} '{name}' is no folder")
    landmarks = existing(folder, table.landmarks, f"{where}: bones: landmarks", problems)
    skin = existing(folder, table.skin, f"{where}: bones: skin", problems)
    geometry = None if table.geometry is None else folder / table.geometry
    home = folder / table.folder
    links = FrozenMap({name: tuple(around) for name, around in table.links.items()})
    return MorphFiles(
        source=subject.model,
        bones=home,
        landmarks=landmarks,
        geometry=geometry,
        skin=skin,
        unit=table.unit,
        mass=subject.mass,
        together=table.together,
        mirror=table.mirror,
        across=table.across,
        links=links,
    )


def bone_files(folder: Path) -> dict[str, Path]:
    """Mesh files of a folder by their stems."""
    if not folder.is_dir():
        raise BadFile(
            folder,
            "is not a folder",
            f"give the folder of the target's bones, <body>{ENDINGS[1]} and so on",
        )
    result: dict[str, Path] = {}
    for path in sorted(folder.iterdir()):
        if path.suffix.lower() not in ENDINGS or not path.is_file():
            continue
        twice = [
            earlier.name for stem, earlier in result.items() if stem.lower() == path.stem.lower()
        ]
        if twice:
            raise BadFile(folder, f"holds both {twice[0]} and {path.name}", "keep one file a bone")
        result[path.stem] = path
    if not result:
        raise BadFile(folder, "holds no bones", f"expected files <body>{', <body>'.join(ENDINGS)}")
    return result


def read_bones(
    folder: Path, bodies: Sequence[str], unit: Unit, notes: list[Message]
) -> dict[str, Surface]:
    """Read the target's bones [m] by the body of the model that each file is named after.

    Files of no body are reported in the notes.
    """
    files = bone_files(folder)
    by_name = {body.lower(): body for body in bodies}
    unknown = [path.name for stem, path in files.items() if stem.lower() not in by_name]
    if len(unknown) == len(files):
        raise BadFile(
            folder,
            f"holds no bone named after a body: {listing('', unknown)}",
            f"bodies are {listing('', bodies)}",
        )
    if unknown:
        notes.append(
            BONES.message(
                f"{folder.name}: not used, named after no body of the model: {', '.join(unknown)}",
                severity="good to know",
            )
        )
    result: dict[str, Surface] = {}
    for stem, path in files.items():
        body = by_name.get(stem.lower())
        if body is not None:
            result[body] = resized(read_mesh(path), unit)
    return result


def resized(surface: Surface, unit: Unit) -> Surface:
    """Convert a surface to meters."""
    return surface if unit == "m" else Surface(surface.vertices * METERS[unit], surface.faces)


def source_bones(
    model: Model, geometry: Path | None = None, notes: list[Message] | None = None
) -> dict[str, Surface]:
    """Read the bones of a model in their bodies' frames, by body, as far as their meshes are found.

    Parameters
    ----------
    model : read from a file, or composed by `myo-sim`
    geometry : folder that holds the meshes; None to look beside the model's file, and in `Geometry`
        there
    notes : takes up what was not found, one line each

    Returns
    -------
    surfaces [m]

    Raises
    ------
    BadFile
        where `geometry` is no folder
    BadData
        where no mesh is found

    Examples
    --------
    >>> import myomorph as mm
    >>> bones = mm.source_bones(mm.demo_recording("jump").model)
    >>> "femur_r" in bones, bones["femur_r"].vertices.shape[1]
    (True, 3)
    """
    if geometry is not None and not geometry.is_dir():
        raise BadFile(geometry, "is not a folder", "give the folder of the source model's meshes")
    beside = Path(model.source).parent
    folders = (
        [geometry] if geometry is not None else [beside, beside / "Geometry", beside / "geometry"]
    )
    surfaces, warnings = read_surfaces(model, [folder for folder in folders if folder.is_dir()])
    if notes is not None:
        notes += warnings
    result = {}
    for body in model.bodies:
        if any(mesh.file in surfaces for mesh in body.meshes):
            result[body.name] = bone_surface(body, surfaces)
    if not result:
        looked = ", ".join(str(folder) for folder in folders)
        raise BadData(
            f"none of the bones' meshes is in {looked}: give the folder that holds them (geometry)"
        )
    return result


def spread(surface: Surface) -> float:
    """Greatest extent along an axis [m]."""
    return float(np.ptp(surface.vertices, axis=0).max())
