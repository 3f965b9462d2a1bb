"""Muscles of one species on another's skeleton, from files.

The files are two models with their bones, and a species table.
"""

from __future__ import annotations

import tomllib
from collections import abc
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, is_dataclass, replace
from importlib.resources import files
from inspect import Parameter, signature
from pathlib import Path
from types import UnionType
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from myomorph.bones.morph.arm_intervals import DRAWS, with_arm_intervals
from myomorph.bones.morph.checks.checks import check_morph
from myomorph.bones.morph.checks.moment_arms import CoordinatePair
from myomorph.bones.morph.mirror.model import with_other_muscles
from myomorph.bones.morph.morphed import Morph
from myomorph.bones.morph.species import masses
from myomorph.bones.morph.species.architecture import (
    DENSITY,
    SPECIFIC_TENSION,
    ArchitectureTable,
    MuscleRow,
    ScalingLaw,
)
from myomorph.bones.morph.species.attachments import RelativeBone
from myomorph.bones.morph.species.counterparts import (
    DIRECTIONS,
    AnatomicalFrame,
    BoneHomology,
    MuscleHomology,
    Skeleton,
    SpeciesTable,
)
from myomorph.bones.morph.species.maps import SpeciesOptions, coordinate_table, species_morph
from myomorph.bones.morph.species.own_postures import fitted_to_postures
from myomorph.bones.study.morph_files import Unit, resized, source_bones
from myomorph.bones.study.morph_masses import with_skin_masses
from myomorph.bones.study.morphing import Morphed, MorphSettings
from myomorph.core.io.mesh import read_mesh
from myomorph.core.io.parsing.door import content_of
from myomorph.core.io.parsing.named_file import is_named_file
from myomorph.core.model.errors import BadData, BadFile
from myomorph.core.model.messages import Message
from myomorph.core.model.provenance import Source
from myomorph.core.model.surface import Surface
from myomorph.lab.store.progress import progress
from myomorph.lab.store.results import file_sources, provenance_of
from myomorph.lab.study.inputs import reading

Table = Mapping[str, Any]
Row = TypeVar("Row")
KEYS = frozenset(
    (
        *(
            "name",
            "frames",
            "posture",
            "missing",
            "extra",
            "bone",
            "coordinate",
            "muscle",
            "architecture",
            "scaling",
        ),
        *("mass", "markers", "relative", "straight", "unlike"),
    )
)
TABLE_KEYS = frozenset(("species", "citation", "measured", "lengths", "body_mass", "muscles"))
ROW_KEYS = frozenset(("name", "sources", "force", "mass", "fiber", "pennation"))


def species_tables() -> tuple[str, ...]:
    """Names of the tables that come with Myomorph."""
    folder = files("myomorph.bones.morph") / "data"
    return tuple(
        sorted(
            path.name[:-5].replace("_", "-")
            for path in folder.iterdir()
            if path.name.endswith(".toml")
        )
    )


def read_species(table: str | Path) -> SpeciesTable:
    """Read the species table of a name, as `human-mouse`, or of a TOML file."""
    known = species_tables()
    is_known = str(table) in known
    path = (
        files("myomorph.bones.morph") / "data" / f"{str(table).replace('-', '_')}.toml"
        if is_known
        else Path(table)
    )
    if isinstance(path, Path) and (path.suffix.lower() != ".toml" or not is_named_file(path)):
        raise BadFile(
            table,
            "no such species table",
            f"there are {', '.join(known)}, or give a .toml file of your own",
        )
    try:
        text = (
            content_of(path, "settings").decode("utf-8")
            if isinstance(path, Path)
            else path.read_text("utf-8")
        )
        return _table(tomllib.loads(text), "" if is_known else Path(table).stem)
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise BadFile(table, f"not TOML: {error}") from None
    except BadData as error:
        raise BadData(f"{table}: {error}") from None
    except KeyError as error:
        raise BadData(f"{table}: {error} is missing") from None
    except (AttributeError, TypeError, ValueError) as error:
        raise BadData(f"{table}: {error}") from None


def _table(table: Table, name: str) -> SpeciesTable:
    _known(table, KEYS, "the table")
    frames = table["frames"]
    posture = table.get("posture", {})

    def rows(kind: type[Row], key: str, what: str) -> tuple[Row, ...]:
        return tuple(_row(kind, entry, what) for entry in table.get(key, ()))

    return SpeciesTable(
        name=table.get("name", name),
        source_frame=_frame(frames["source"]),
        target_frame=_frame(frames["target"]),
        bones=tuple(_row(BoneHomology, entry, "a bone") for entry in table["bone"]),
        coordinates=rows(CoordinatePair, "coordinate", "a coordinate"),
        muscles=rows(MuscleHomology, "muscle", "a muscle"),
        posture=posture.get("source", {}),
        target_posture=posture.get("target", {}),
        missing=table.get("missing", {}),
        extra=table.get("extra", {}),
        architecture=tuple(_architecture(entry) for entry in table.get("architecture", ())),
        scaling=_row(ScalingLaw, table["scaling"], "the scaling") if "scaling" in table else None,
        masses=rows(masses.SegmentShare, "mass", "a mass"),
        markers=tuple(_markers(entry) for entry in table.get("markers", ())),
        relatives=rows(RelativeBone, "relative", "a relative's bone"),
        straight=tuple(table.get("straight", {}).get("muscles", ())),
        unlike=float(table.get("unlike", {}).get("attachments", 0.0)),
    )


def _known(table: Table, keys: Iterable[str], what: str) -> None:
    for key in table:
        if key not in keys:
            raise BadData(f"{what} has '{key}': known are {', '.join(sorted(keys))}")


def _row(kind: type[Row], table: Table, what: str) -> Row:
    """Make a value of a dataclass from a table that has its fields.

    Raises `KeyError` where one is missing.
    """
    kinds = get_type_hints(kind)
    _known(table, kinds, what)
    for name, parameter in signature(kind).parameters.items():
        if parameter.default is Parameter.empty and name not in table:
            raise KeyError(name)
    return kind(**{name: _value(kinds[name], value) for name, value in table.items()})


def _value(kind: Any, value: Any) -> Any:
    """Convert a table's value to that of a field.

    Lists become tuples, numbers `float`, and tables the field's dataclasses.
    """
    kinds = get_args(kind)
    if get_origin(kind) in (Union, UnionType):
        return _value(kinds[0], value)
    if get_origin(kind) is tuple:
        return tuple(_value(kinds[0], part) for part in value)
    if get_origin(kind) is abc.Mapping:
        return {name: _value(kinds[1], part) for name, part in value.items()}
    if kind is AnatomicalFrame:
        return _frame(value)
    if kind is MuscleRow:
        return _muscle(value)
    if isinstance(kind, type) and is_dataclass(kind):
        return _row(kind, value, f"a table of {kind.__name__}")
    return float(value) if kind is float else value


def _architecture(table: Table) -> ArchitectureTable:
    what = "a table of architecture"
    _known(table, TABLE_KEYS, what)
    kept = {key: value for key, value in table.items() if key != "muscles"}
    return _row(ArchitectureTable, {**kept, "rows": table["muscles"]}, what)


def _muscle(table: Table) -> MuscleRow:
    """Read a muscle's row: `force` [N] or `mass` [kg], `fiber` [m], `pennation` [degrees]."""
    _known(table, ROW_KEYS, "a muscle of the architecture")
    if ("force" in table) == ("mass" in table):
        raise BadData(f"architecture of '{table['name']}': expected either force or mass")
    fiber = float(table["fiber"])
    strength = (
        table["force"] * fiber if "force" in table else table["mass"] / DENSITY * SPECIFIC_TENSION
    )
    pennation = float(np.deg2rad(table["pennation"])) if "pennation" in table else None
    return MuscleRow(
        name=table["name"],
        sources=tuple(table["sources"]),
        fiber=fiber,
        strength=float(strength),
        pennation=pennation,
    )


def _markers(table: Table) -> masses.MarkerTable:
    made = _row(masses.MarkerTable, {**table, "places": {}}, "a table of markers")
    places: dict[str, tuple[str, tuple[float, float, float]]] = {}
    for label, place in table["places"].items():
        if len(place["at"]) != 3:
            raise BadData(f"markers of '{table['name']}': expected three numbers at '{label}'")
        x, y, z = map(float, place["at"])
        places[label] = place["body"], (x, y, z)
    return replace(made, places=places)


def _frame(table: Table) -> AnatomicalFrame:
    """Directions such as "+y"; a table writes where the axes of the bodies' frames point."""
    axes = np.zeros((3, 3))
    for index, name in enumerate(DIRECTIONS):
        text = str(table[name]).strip()
        letter = text.lstrip("+-")
        if letter not in ("x", "y", "z"):
            raise BadData(f"{name} is '{table[name]}': expected an axis, as +x or -z")
        axes[index, "xyz".index(letter)] = -1.0 if text.startswith("-") else 1.0
    return AnatomicalFrame(axes)


@dataclass(frozen=True)
class SpeciesFiles:
    """Files and options of a morph to another species.

    These are the model whose muscles are transferred, that of the skeleton whose joints stay, and
    the name or file of a species table; folders of their meshes, by default beside them.

    `beside`: keep the target's own muscles too; `mirror`: the other side gets the mirror images of
    the muscles; segments get the species table's shares of `mass` [kg], or masses from `skin`,
    closed, in the skeleton's default pose; `protocol`: a table of markers of the species, whose
    recordings the model shall follow; `postures`: motions of the animal, whose postures tendons and
    fibers follow.
    """

    source: Path
    target: Path
    species: str = "human-mouse"
    geometry: Path | None = None
    target_geometry: Path | None = None
    beside: bool = False
    mirror: bool = False
    mass: float | None = None
    skin: Path | None = None
    unit: Unit = "m"
    protocol: str = ""
    postures: tuple[Path, ...] = ()

    def sources(self) -> tuple[Source, ...]:
        """Return the files with their hashes."""
        species = Path(self.species) if is_named_file(Path(self.species)) else None
        return file_sources(
            ("model", self.source),
            ("skeleton", self.target),
            ("species", species),
            ("skin", self.skin),
            *(("postures", path) for path in self.postures),
        )


def species_files(
    files: SpeciesFiles, settings: MorphSettings
) -> tuple[Morphed, Mapping[str, Surface]]:
    """Put the source's muscles on the target's skeleton.

    Returns the morph, and the target's bones by body, to be written beside the model.
    """
    if files.target.suffix.lower() not in (".xml", ".mjcf", ".osim"):
        raise BadFile(
            files.target, "is no model", "give the skeleton of the other species as .osim or .xml"
        )
    table = read_species(files.species)
    warnings: list[Message] = []
    models = []
    bones = []
    for path, folder in ((files.source, files.geometry), (files.target, files.target_geometry)):
        models.append(reading.open_model(path))
        warnings += models[-1].warnings
        with reading.about(path):
            bones.append(source_bones(models[-1], folder, warnings))
    source, target = models
    target, replaced = masses.with_possible_inertias(target, bones[1])
    warnings += replaced
    if files.mass is not None:
        target, _ = masses.with_segment_shares(target, table.masses, files.mass)
    with progress("bones", len(table.bones) + 1, "bones") as advance:
        morph = species_morph(
            Skeleton(source, bones[0]),
            Skeleton(target, bones[1]),
            table,
            SpeciesOptions(
                morph=settings.morph,
                map=settings.map,
                match=settings.match,
                beside=files.beside,
            ),
            progress=lambda _: advance(1.0),
        )
    fields = {
        "species": table.name,
        "beside": files.beside,
        "mirror": files.mirror,
        "unit": files.unit,
    }
    fields |= {"mass": files.mass, "protocol": files.protocol}
    made = provenance_of("morph", files.sources(), settings.plain() | fields)
    checks = check_morph(morph, coordinates=coordinate_table(table, source, target))
    with progress("intervals", DRAWS, "models") as advance:
        checks = with_arm_intervals(morph, checks, advance)
    morph = _whole_animal(morph, files, table)
    return Morphed(
        morph=morph, checks=checks, provenance=made, warnings=tuple(dict.fromkeys(warnings))
    ), bones[1]


def _whole_animal(morph: Morph, files: SpeciesFiles, table: SpeciesTable) -> Morph:
    """Add the other side, masses and the markers of a protocol to a morph."""
    model = morph.model
    notes = list(morph.notes)
    if files.mirror:
        axis = np.zeros(3)
        axis[int(np.argmax(np.abs(table.target_frame.axes[2])))] = 1.0
        model, added = with_other_muscles(model, axis)
        notes += added
    if files.skin is not None:
        model, added = with_skin_masses(
            model, resized(read_mesh(files.skin), files.unit), files.mass
        )
        notes += [*added, *masses.share_notes(model, table.masses)]
    else:
        notes += masses.share_notes(model, table.masses)
    if files.protocol:
        model, added = masses.with_markers_of(model, table.markers, files.protocol)
        notes += added
    whole = replace(morph, model=model, notes=tuple(notes))
    if not files.postures:
        return whole
    motions = [reading.read_motion(path, model) for path in files.postures]
    return fitted_to_postures(whole, motions)
