"""Muscles of one species on another's skeleton, from files: two models with their bones, and a species table."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from myomorph.model.errors import BadFile
from myomorph.model.provenance import Source
from myomorph.model.surface import Surface
from myomorph.morph.checks.checks import check_morph
from myomorph.morph.species.maps import coordinate_table, species_morph
from myomorph.store.progress import progress
from myomorph.store.results import file_source, provenance_of
from myomorph.study.subject.morph_files import source_bones
from myomorph.study.subject.morphing import Morphed, MorphSettings
from myomorph.study.subject.species_table import read_species
from myomorph.study.trial import inputs


@dataclass(frozen=True)
class SpeciesFiles:
    """What a morph to another species is made from.

    Attributes
    ----------
    source : model whose muscles are carried over
    target : model of the other species' skeleton, whose joints and masses stay
    species : name of a table that comes with Myomorph, or a TOML file
    geometry, target_geometry : folders of the models' meshes, None to look beside the models
    beside : keep the target's own muscles too
    """

    source: Path
    target: Path
    species: str = "human-mouse"
    geometry: Path | None = None
    target_geometry: Path | None = None
    beside: bool = False

    def sources(self) -> tuple[Source, ...]:
        """The files by their hashes."""
        given = [("model", self.source), ("skeleton", self.target)]
        if Path(self.species).is_file():
            given.append(("species", Path(self.species)))
        return tuple(file_source(role, path) for role, path in given)


def species_files(files: SpeciesFiles, settings: MorphSettings) -> tuple[Morphed, Mapping[str, Surface]]:
    """The source's muscles on the target's skeleton, and the target's bones by body, to be written beside the model.

    Raises
    ------
    MyomorphError
        where a file cannot be read, or the table does not fit the models
    """
    if files.target.suffix.lower() not in (".xml", ".mjcf", ".osim"):
        raise BadFile(files.target, "is no model", "give the skeleton of the other species as .osim or .xml")
    table = read_species(files.species)
    warnings: list[str] = []
    models, bones = [], []
    for path, folder in ((files.source, files.geometry), (files.target, files.target_geometry)):
        models.append(inputs.open_model(path))
        warnings += models[-1].warnings
        with inputs.about(path):
            bones.append(source_bones(models[-1], folder, warnings))
    source, target = models
    with progress("bones", len(table.bones) + 1, "bones") as advance:
        morph = species_morph(
            source,
            bones[0],
            target,
            bones[1],
            table,
            settings.morph,
            settings.map,
            settings.match,
            beside=files.beside,
            progress=lambda _: advance(1.0),
        )
    told = {"species": table.name, "beside": files.beside}
    made = provenance_of("morph", files.sources(), settings.plain() | told)
    checks = check_morph(morph, coordinates=coordinate_table(table, source, target))
    return Morphed(morph, checks, made, tuple(dict.fromkeys(warnings))), bones[1]
