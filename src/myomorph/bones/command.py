"""`morph`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Literal

from myomorph.bones.morph.maps.fields import MapOptions
from myomorph.bones.morph.morphed import MorphOptions
from myomorph.bones.morph.registration.smooth import MatchOptions
from myomorph.bones.study.morph_files import Unit
from myomorph.core.model.errors import BadData
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.lab.cli.options import Threads, documented, options_class, settings_dict, use_threads
from myomorph.lab.cli.output import made, said

MorphSettings = options_class(MatchOptions, MapOptions, MorphOptions)


@documented
def morph_command(
    *,
    source: Path,
    out: Path,
    bones: Path | None = None,
    landmarks: Path | None = None,
    geometry: Path | None = None,
    skin: Path | None = None,
    mass: float | None = None,
    unit: Unit = "m",
    together: bool = False,
    mirror: bool = False,
    across: Literal["x", "y", "z"] = "z",
    link: list[str] | None = None,
    species: str = "",
    target: Path | None = None,
    target_geometry: Path | None = None,
    beside: bool = False,
    protocol: str = "",
    postures: list[Path] | None = None,
    options: MorphSettings | None = None,  # type: ignore[valid-type]
    threads: Threads = None,
) -> int:
    """A model's muscles in other bones: those of a subject, from a scan or a shape model.

    Parameters
    ----------
    source : model whose muscles are carried over (.osim, .xml; myo-sim:myoarm and others of that
        package)
    out : model to write (.osim); bones, tables and report stand beside it
    bones : folder of the target's bones: one file a body, BODY.obj, .stl, .ply or .vtp
    landmarks : pairs of points (.csv): body, name, source_x, source_y, source_z, target_x, ... [m]
    geometry : folder of the source model's own meshes, where they do not lie beside it
    skin : closed surface of the target's skin, which masses are taken from
    mass : mass of the target [kg]
    unit : unit of the target's bones and skin
    together : the bones share one frame, as a scan shows them: joints must meet
    mirror : the other side's bones, or with --target muscles, are this side's mirrored
    across : axis of ground across the source's plane of symmetry, for --mirror
    link : a body without a bone on which muscles branch, and the bones that carry it:
        LINK=BONE,BONE
    species : instead of bones: which bones correspond to those of another species, a name or .toml
        file
    target : model of the other species' skeleton, whose joints and masses stay
    target_geometry : folder of the skeleton's meshes, where they do not lie beside it
    beside : keep the muscles that the skeleton has
    protocol : with --target, whose recordings the model shall follow: a marker table of the species
    postures : with --target, motions of the animal (.mot, .sto): tendons and fibers follow its own
        postures
    """
    from myomorph.bones.study import morphing
    from myomorph.bones.study.morph_files import MorphFiles
    from myomorph.lab.study.subject.subjects import tables_folder
    from myomorph.lab.study.trial.reporting import REPORT

    use_threads(threads)
    tables = tables_folder(
        out, morphing.STEP.tables, (source, target, bones, geometry, target_geometry)
    )
    settings = morphing.MorphSettings.of(settings_dict(options))
    if species or target is not None:
        if bones is not None or target is None:
            raise BadData(
                "another species takes --target SKELETON.xml (and --species TABLE), and no --bones"
            )
        mine = (("landmarks", landmarks), ("together", together), ("link", link or None))
        _not_given(mine, "goes with --bones: another species' skeleton keeps its joints")
        from myomorph.bones.study.species_morphing import SpeciesFiles, species_files

        files = SpeciesFiles(
            source=source,
            target=target,
            species=species or "human-mouse",
            geometry=geometry,
            target_geometry=target_geometry,
            beside=beside,
        )
        files = replace(files, mirror=mirror, mass=mass, skin=skin, unit=unit, protocol=protocol)
        files = replace(files, postures=tuple(postures or ()))
        morphed, drawn = species_files(files, settings)
    elif bones is None:
        raise BadData(
            "expected --bones FOLDER of the target's bones, or --target with the skeleton of"
            " another species"
        )
    else:
        _not_given(
            (
                ("target-geometry", target_geometry),
                ("beside", beside),
                ("protocol", protocol or None),
                ("postures", postures or None),
            ),
            "goes with --target",
        )
        morph_files = MorphFiles(
            source=source,
            bones=bones,
            landmarks=landmarks,
            geometry=geometry,
            skin=skin,
            unit=unit,
            mass=mass,
            together=together,
            mirror=mirror,
            across=across,
            links=_links(link or []),
        )
        morphed = morphing.morph_files(morph_files, settings)
        drawn = None
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
