"""A model in other bones, from files.

Bones are laid on bones, muscles transferred, and the model of that body written.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from myomorph.bones.morph.arm_intervals import DRAWS, with_arm_intervals
from myomorph.bones.morph.checks.checks import check_morph
from myomorph.bones.morph.checks.moment_arms import COUNT
from myomorph.bones.morph.checks.warnings import MorphChecks
from myomorph.bones.morph.maps.fields import BoneMap, FeaturePoints, MapOptions
from myomorph.bones.morph.mirror.model import with_mirrored_bones
from myomorph.bones.morph.morphed import Morph, MorphOptions
from myomorph.bones.morph.registration.bone_checks import bone_length, check_exchange, check_units
from myomorph.bones.morph.registration.map_bone import BoneMapOptions, map_bone
from myomorph.bones.morph.registration.neighbors import start_by_neighbors
from myomorph.bones.morph.registration.smooth import MatchOptions
from myomorph.bones.morph.transfer.model import MorphTarget, morph_model
from myomorph.bones.report.morph_summary import morph_lines
from myomorph.bones.study.morph_files import (
    BonesTable,
    MorphFiles,
    bones_of,
    read_bones,
    resized,
    source_bones,
    spread,
)
from myomorph.bones.study.morphed_errors import morphed_errors
from myomorph.core.io.landmarks import read_landmark_pairs
from myomorph.core.io.mesh import read_mesh, write_obj
from myomorph.core.model.errors import BadData, UnknownName
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.model import Mesh, Model
from myomorph.core.model.provenance import Provenance
from myomorph.core.model.spatial import Transform
from myomorph.core.model.surface import Surface
from myomorph.core.rigid.kinematics import standing_poses
from myomorph.core.surfaces.linear_maps import Similarity
from myomorph.lab.store.progress import progress
from myomorph.lab.store.results import provenance_of
from myomorph.lab.store.settings import SettingGroup
from myomorph.lab.study.inputs import reading
from myomorph.lab.study.inputs.error_size_tables import write_error_sizes
from myomorph.lab.study.step.folder_steps import FolderOutput
from myomorph.lab.study.step.own_table import OwnTable
from myomorph.lab.study.step.step import Step
from myomorph.lab.study.subject.subject_files import SubjectInputs, recordings_provenance
from myomorph.lab.study.subject.subjects import ModelOutput, write_made_model

# Agreement of a bone's normals with the target's below which another bone is tried.
POOR_AGREEMENT = 0.95


@dataclass(frozen=True)
class MorphSettings(SettingGroup):
    """Settings of a morph's steps: match of bones, map of space, and parameters of muscles."""

    match: MatchOptions = field(default_factory=MatchOptions)
    map: MapOptions = field(default_factory=MapOptions)
    morph: MorphOptions = field(default_factory=MorphOptions)


@dataclass(frozen=True, eq=False)
class Morphed:
    """A morph, its checks, what it was made from, and warnings of the files."""

    morph: Morph
    checks: MorphChecks
    provenance: Provenance
    warnings: tuple[str, ...]


def morph_files(files: MorphFiles, settings: MorphSettings, model: Model | None = None) -> Morphed:
    """Transfer the source model to the target's bones."""
    model = reading.open_model(files.source) if model is None else model
    warnings = list(model.warnings)
    with reading.about(files.source):
        ours = source_bones(model, files.geometry, warnings)
    theirs = read_bones(files.bones, model.body_names, files.unit, warnings)
    skin = None if files.skin is None else resized(read_mesh(files.skin), files.unit)
    if files.mass is not None and not (np.isfinite(files.mass) and files.mass > 0.0):
        raise BadData(f"a mass of {files.mass:g} kg: expected above 0")
    pairs = {} if files.landmarks is None else _landmarks(files.landmarks, model)
    target = TargetBones(surfaces=theirs, landmarks=pairs, together=files.together)
    bones = map_bones(model, ours, target, settings)
    if files.mirror:
        bones = with_mirrored_bones(model, bones, ours, files.together, files.across)
    with reading.about(files.source), progress("muscles", 2 * (COUNT + 1), "postures") as advance:
        morph = morph_model(
            model,
            bones,
            settings.morph,
            MorphTarget(
                mass=files.mass, together=files.together, surrounding=files.links or FrozenMap({})
            ),
            advance,
        )
    if files.mass is not None or skin is not None:
        from myomorph.bones.study.morph_masses import with_morphed_masses

        weighed, notes = with_morphed_masses(morph, files.mass, skin)
        morph = replace(morph, model=weighed, notes=(*morph.notes, *notes))
    made = provenance_of("morph", files.sources(), settings.plain() | files.options())
    checks = check_morph(morph)
    with progress("intervals", DRAWS, "models") as advance:
        checks = with_arm_intervals(morph, checks, advance)
    return Morphed(
        morph=morph, checks=checks, provenance=made, warnings=tuple(dict.fromkeys(warnings))
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class TargetBones:
    """Bones of a target, by the source's bodies.

    Attributes
    ----------
    surfaces : of the bones [m]
    landmarks : on source and target
    together : the surfaces share one frame
    """

    surfaces: Mapping[str, Surface]
    landmarks: Mapping[str, FeaturePoints] = field(default_factory=lambda: FrozenMap({}))
    together: bool = False


def map_bones(
    model: Model, ours: Mapping[str, Surface], target: TargetBones, settings: MorphSettings
) -> dict[str, BoneMap]:
    """Map every bone that the target has a surface or landmarks of, by body; the largest first.

    `ours`: surfaces of the source. Bones that share a frame with those that were found show where
    the next one lies.
    """
    theirs = target.surfaces
    wanted = [body for body in model.body_names if body in theirs or body in target.landmarks]
    wanted.sort(key=lambda body: -spread(theirs[body]) if body in theirs else 0.0)
    _check_units(ours, theirs)
    poses = standing_poses(model) if target.together else {}
    maps: dict[str, BoneMap] = {}
    with progress("bones", len(wanted), "bones") as advance:
        for body in wanted:
            start = start_by_neighbors(model, body, maps, poses) if target.together else None
            with reading.about(body):
                maps[body] = _map(body, ours, target, settings, start)
            advance(1.0)
    return {body: maps[body] for body in model.body_names if body in maps}


def _check_units(ours: Mapping[str, Surface], theirs: Mapping[str, Surface]) -> None:
    """Refuse bones that are in other units than meters together."""
    both = [body for body in theirs if body in ours]
    check_units([(bone_length(theirs[body]), bone_length(ours[body])) for body in both])


def _map(
    body: str,
    ours: Mapping[str, Surface],
    target: TargetBones,
    settings: MorphSettings,
    start: Similarity | None,
) -> BoneMap:
    """Map one bone; one without landmarks that fits poorly is compared with the other bones."""
    surface = target.surfaces.get(body)
    points = target.landmarks.get(body)
    options = BoneMapOptions(map=settings.map, match=settings.match, start=start)
    bone = map_bone(body, ours.get(body), surface, points, options)
    alike = bone.measures.get("agreement", 1.0)
    if surface is not None and points is None and alike < POOR_AGREEMENT:
        check_exchange(body, surface, ours)
    return bone


def _landmarks(path: Path, model: Model) -> dict[str, FeaturePoints]:
    result: dict[str, FeaturePoints] = {}
    for body, points in read_landmark_pairs(path).items():
        if body not in model.body_names:
            with reading.about(path):
                raise UnknownName("body", body, model.body_names)
        result[body] = FeaturePoints(points.names, points.source, points.target)
    return result


def morph_subject(subject: SubjectInputs, output: FolderOutput) -> Morphed:
    """Run the step `morph` of a study: a subject's bones into its model and tables."""
    files = subject.files.own[MorphFiles]
    settings = MorphSettings.of(subject.settings.get("morph", {}))
    morphed = morph_files(files, settings, subject.model)
    morphed = replace(morphed, provenance=output.made)
    write_morphed(morphed, output.path("model"), output.tables)
    return morphed


def write_morphed(
    morphed: Morphed,
    out: Path,
    tables: Path,
    bones: Mapping[str, Surface] | None = None,
    page: str = "",
) -> tuple[str, ...]:
    """Write the model, and beside it a folder with its bones, tables and report.

    It is written whole or not at all. The bones are by default those that the maps lead to; `page`:
    report where it shows more than the morph alone. Returns what the model's file could not hold.
    """
    from myomorph.bones.report.morph_page import morph_page
    from myomorph.bones.report.tables import morphing_tables
    from myomorph.lab.study.trial.reporting import REPORT

    if bones is None:
        bones = {
            bone.target_body: bone.target
            for bone in morphed.morph.bones.values()
            if bone.target is not None
        }

    files = _bone_files(bones)

    def fill(folder: Path) -> None:
        for body, surface in bones.items():
            write_obj(surface, folder / files[body])
        for name, sheet in morphing_tables(morphed.morph, morphed.checks).items():
            (folder / name).write_text(sheet.csv(digits=6), encoding="utf-8", newline="")
        write_error_sizes(folder, STEP.name, morphed_errors(morphed.morph))
        text = page or morph_page(
            morphed.morph, morphed.checks, morphed.provenance, morphed.warnings
        )
        (folder / REPORT).write_text(text, encoding="utf-8")

    drawn = with_bones(
        morphed.morph.model, {body: f"{tables.name}/{file}" for body, file in files.items()}
    )
    return write_made_model(drawn, morphed.provenance, ModelOutput(out, tables), fill)


def with_bones(model: Model, files: Mapping[str, str]) -> Model:
    """Draw the model's bodies by these files, which lie in the bodies' frames."""
    bodies = tuple(
        (
            replace(body, meshes=(Mesh(files[body.name], Transform.identity(), np.ones(3)),))
            if body.name in files
            else body
        )
        for body in model.bodies
    )
    return replace(model, bodies=bodies)


def _bone_files(bodies: Iterable[str]) -> dict[str, str]:
    """Name a file for each body, whose own name may hold anything.

    No two names are equal, whatever the case.
    """
    result: dict[str, str] = {}
    for body in bodies:
        stem = name = re.sub(r"[^\w.-]", "_", body).lstrip(".") or "bone"
        taken = {file.lower() for file in result.values()}
        count = 1
        while f"{name}.obj".lower() in taken:
            count += 1
            name = f"{stem}_{count}"
        result[body] = f"{name}.obj"
    return result


def summary(morphed: Morphed) -> Iterable[str]:
    """Yield findings as lines of text.

    All measures of a bone are in the report and in bones.csv.
    """
    morph = morphed.morph
    for body, bone in morph.bones.items():
        text = f"size {bone.whole.scale:.3f}"
        if "residual [m]" in bone.measures:
            share = 100.0 * bone.measures.get("coverage", float("nan"))
            text += f", {1e3 * bone.measures['residual [m]']:.3g} mm apart, {share:.0f} % reached"
        yield f"  {body:<12} by {bone.basis}: {text}"
    yield from morph_lines(morph, morphed.checks)


def bone_notes(morphed: Morphed) -> tuple[str, ...]:
    """Return the notes of the maps of the target's bones, one line each, with the bone's name."""
    measured = {
        body: bone
        for body, bone in morphed.morph.bones.items()
        if bone.basis in ("bone", "landmarks")
    }
    return tuple(
        note if f"'{body}'" in note else f"'{body}': {note}"
        for body, bone in measured.items()
        for note in bone.notes
    )


def _made_from(subject: SubjectInputs) -> Provenance:
    files = subject.files.own.get(MorphFiles)
    if files is None:
        return recordings_provenance("morph", subject)
    return provenance_of(
        "morph", files.sources(), files.options() | dict(subject.settings.get("morph", {}))
    )


STEP = Step(
    name="morph",
    scope="subject",
    title="muscles in other bones",
    options=(MatchOptions, MapOptions, MorphOptions),
    tables="morph",
    leaves=FrozenMap({"model": "morphed.osim", "meshes": "morphed.osim"}),
    run=morph_subject,
    made_from=_made_from,
    own_table=OwnTable(
        key="bones",
        table=BonesTable,
        read=bones_of,
        content="the folder of the subject's bones",
    ),
)
