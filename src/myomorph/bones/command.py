"""`morph`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from myomorph.bones.morph.maps.fields import MapOptions
from myomorph.bones.morph.morphed import MorphOptions
from myomorph.bones.morph.registration.smooth import MatchOptions
from myomorph.bones.study.morph_files import MorphFiles, Unit
from myomorph.core.model.errors import BadData
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.lab.cli.options import Threads, documented, options_class, settings_dict, use_threads
from myomorph.lab.cli.output import made, said

if TYPE_CHECKING:
    from myomorph.bones.study.species_morphing import SpeciesFiles

MorphSettings = options_class(MatchOptions, MapOptions, MorphOptions)


@documented
@dataclass(frozen=True, kw_only=True)
class TargetFlags:
    """Bones that get the muscles: a subject's, or the skeleton of another species.

    Attributes
    ----------
    bones : folder of the target's bones, one mesh per body: BODY.obj, .stl, .ply or .vtp
    landmarks : pairs of corresponding points (.csv: body, name, source_x, source_y, source_z,
        target_x, ... [m])
    geometry : folder of the source model's meshes, if they are not next to the model
    skin : closed surface of the target's skin, which determines its masses
    mass : body mass of the target [kg]
    unit : length unit of the target's bones and skin
    together : the target's bones share one frame, as in one scan, so their joints must meet
    mirror : mirror this side to obtain the bones, or with --target the muscles, of the other side
    across : axis of ground perpendicular to the source's plane of symmetry, for --mirror
    link : LINK=BONE,BONE: a body without a bone on which muscles branch, and the bones that
        determine its position
    species : correspondence of bones between two species (a name or a .toml file), instead of
        --bones
    target : model of the other species' skeleton, which keeps its joints and masses
    target_geometry : folder of the skeleton's meshes, if they are not next to the model
    beside : keep the muscles that the skeleton already has
    protocol : with --target, marker table of the species, whose recordings the model can then
        follow
    postures : with --target, motions of the animal (.mot, .sto), to whose postures tendons and
        fibers are adapted
    """

    bones: Path | None = None
    landmarks: Path | None = None
    geometry: Path | None = None
    skin: Path | None = None
    mass: float | None = None
    unit: Unit = "m"
    together: bool = False
    mirror: bool = False
    across: Literal["x", "y", "z"] = "z"
    link: list[str] | None = None
    species: str = ""
    target: Path | None = None
    target_geometry: Path | None = None
    beside: bool = False
    protocol: str = ""
    postures: list[Path] | None = None

    @property
    def is_species(self) -> bool:
        """Whether the target is the skeleton of another species."""
        return bool(self.species) or self.target is not None

    def species_files(self, source: Path) -> SpeciesFiles:
        """Return the files of a morph to another species; raises `BadData`."""
        from myomorph.bones.study.species_morphing import SpeciesFiles

        if self.bones is not None or self.target is None:
            raise BadData(
                "another species takes --target SKELETON.xml (and --species TABLE), and no --bones"
            )
        mine = (
            ("landmarks", self.landmarks),
            ("together", self.together),
            ("link", self.link or None),
        )
        _not_given(mine, "goes with --bones: another species' skeleton keeps its joints")
        return SpeciesFiles(
            source=source,
            target=self.target,
            species=self.species or "human-mouse",
            geometry=self.geometry,
            target_geometry=self.target_geometry,
            beside=self.beside,
            mirror=self.mirror,
            mass=self.mass,
            skin=self.skin,
            unit=self.unit,
            protocol=self.protocol,
            postures=tuple(self.postures or ()),
        )

    def bone_files(self, source: Path) -> MorphFiles:
        """Return the files of a morph to a subject's bones; raises `BadData`."""
        if self.bones is None:
            raise BadData(
                "expected --bones FOLDER of the target's bones, or --target with the skeleton of"
                " another species"
            )
        theirs = (
            ("target-geometry", self.target_geometry),
            ("beside", self.beside),
            ("protocol", self.protocol or None),
            ("postures", self.postures or None),
        )
        _not_given(theirs, "goes with --target")
        return MorphFiles(
            source=source,
            bones=self.bones,
            landmarks=self.landmarks,
            geometry=self.geometry,
            skin=self.skin,
            unit=self.unit,
            mass=self.mass,
            together=self.together,
            mirror=self.mirror,
            across=self.across,
            links=_links(self.link or []),
        )


TargetOptions = Annotated[TargetFlags, Parameter(name="*")]
NO_TARGET = TargetFlags()
SourceModel = Annotated[
    Path,
    Parameter(
        help=(
            "Model whose muscles are transferred (.osim, .xml; myo-sim:myoarm and others of that"
            " package)."
        )
    ),
]
MorphedModel = Annotated[
    Path,
    Parameter(
        help="Model to write (.osim); bones, tables and a report go into folders next to it."
    ),
]


@documented
def morph_command(
    *,
    source: SourceModel,
    out: MorphedModel,
    target: TargetOptions = NO_TARGET,
    options: MorphSettings | None = None,  # type: ignore[valid-type]
    threads: Threads = None,
) -> int:
    """Transfer a model's muscles to other bones: those of a subject, or of another species.

    A subject's bones come from a scan or a shape model.
    """
    from myomorph.bones.study import morphing
    from myomorph.lab.study.subject.subjects import tables_folder
    from myomorph.lab.study.trial.reporting import REPORT

    use_threads(threads)
    read = (source, target.target, target.bones, target.geometry, target.target_geometry)
    tables = tables_folder(out, morphing.STEP.tables, read)
    settings = morphing.MorphSettings.of(settings_dict(options))
    drawn = None
    if target.is_species:
        files = target.species_files(source)
        from myomorph.bones.study.species_morphing import species_files

        morphed, drawn = species_files(files, settings)
    else:
        morphed = morphing.morph_files(target.bone_files(source), settings)
    lost = morphing.write_morphed(morphed, out, tables, drawn)
    notes = dict.fromkeys(
        (*morphed.warnings, *morphed.morph.notes, *morphing.bone_notes(morphed), *lost)
    )
    return made(
        out, tables, morphing.summary(morphed), tuple(notes), f"{tables / REPORT} lists them"
    )


def run_demo(name: str, out: Path) -> int:
    """Carry the muscles of the deformed leg, and say how far they miss; the exit status."""
    from myomorph.bones.demo import run_morph_demo, summary

    demo = run_morph_demo(out)
    for line in summary(demo):
        said(line)
    said(f"report: {demo.report.resolve()}")
    return 0


def _links(words: list[str]) -> Mapping[str, tuple[str, ...]]:
    """Virtual links and the bones around each, of LINK=BONE,BONE."""
    links = {}
    for word in words:
        name, equals, around = word.partition("=")
        bones = tuple(bone.strip() for bone in around.split(",") if bone.strip())
        if not equals or not name.strip() or len(bones) < 2:
            raise BadData(
                f"--link '{word}': expected LINK=BONE,BONE with two bones or more around it"
            )
        links[name.strip()] = bones
    return FrozenMap(links)


def _not_given(options: tuple[tuple[str, object], ...], why: str) -> None:
    given_too = [f"--{name}" for name, value in options if value is not None and value is not False]
    if given_too:
        raise BadData(f"{given_too[0]} {why}")
