"""Maps between the bones of two species, and muscles of one on the skeleton of the other."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from myomorph.bones.morph.checks.moment_arms import CoordinateTable
from myomorph.bones.morph.maps.fields import (
    STAYS,
    BoneMap,
    FeaturePoints,
    MapOptions,
    PlacedMap,
    fit_map,
)
from myomorph.bones.morph.morphed import Architecture, Morph, MorphOptions, TransferredPoint
from myomorph.bones.morph.registration.map_bone import BoneMapOptions, map_bone
from myomorph.bones.morph.registration.smooth import MatchOptions
from myomorph.bones.morph.species import counterparts
from myomorph.bones.morph.species.architecture import (
    ArchitectureTable,
    Size,
    architectures,
    scaled_architectures,
)
from myomorph.bones.morph.species.attachments import straightened, with_attachments
from myomorph.bones.morph.species.landmarks import MarkedBone, landmarks_by_rules
from myomorph.bones.morph.species.rays import put_on_rays
from myomorph.bones.morph.transfer.model import Graft, graft_muscles
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData
from myomorph.core.model.model import Model
from myomorph.core.model.surface import Surface
from myomorph.core.surfaces.linear_maps import AffineMap, fit_affine, procrustes

MEASURED_IN_METERS = "[m]"

MIN_COUNT = 4  # Landmarks that a bone needs.
STEEPEST = 3.0
"""Two landmarks may be so many times farther apart in the target, in the source's proportions, than
in the source.
"""


@dataclass(frozen=True, eq=False)
class SpeciesBones:
    """Bones of the source with their maps to the target's."""

    # the model; a body whose muscle points go to several bones has parts of it as bodies of their
    # own
    source: Model
    bones: Mapping[str, BoneMap]  # by body of `source`
    notes: tuple[str, ...] = ()  # what was assumed or looks wrong, one line each


@dataclass(frozen=True, eq=False, kw_only=True)
class SpeciesOptions:
    """Options of muscles on the skeleton of another species.

    Attributes
    ----------
    morph : what is transferred how
    map : how the space around a bone is mapped
    match : how dense correspondence is found, for bones of which the table wants it; "landmarks"
        maps all by landmarks
    beside : keep the target's own muscles too
    name : of the new model; by default the target's
    """

    morph: MorphOptions | None = None
    map: MapOptions | None = None
    match: MatchOptions | None = None
    beside: bool = False
    name: str = ""


def species_bones(
    source: counterparts.Skeleton,
    target: counterparts.Skeleton,
    table: counterparts.SpeciesTable,
    options: SpeciesOptions | None = None,
    progress: Callable[[str], None] | None = None,
) -> SpeciesBones:
    """Map every bone of a species table whose bodies both models have.

    The target's bone is first given the source's proportions, by the affine map nearest to the
    landmarks, compared, and the map then brought to its own: so surfaces meet although one is
    slender and the other stout, and lengths of options and of checks mean the same for a mouse as
    for a man. `progress`: called with a bone's name before it is mapped.
    """
    options = options or SpeciesOptions()
    here = counterparts.Posed(source.model, table.posture, source.surfaces)
    there = counterparts.Posed(target.model, table.target_posture, target.surfaces)
    bones: dict[str, BoneMap] = {}
    notes: list[str] = []
    parts: dict[str, tuple[str, ...]] = {}
    for bone in table.bones:
        missing = _missing_bodies(bone, source.model, target.model)
        if missing:
            notes.append(
                f"{bone.sources[0]} to {bone.targets[0]}: left out, no body '{missing[0]}'"
            )
            continue
        if progress is not None:
            progress(bone.sources[0])
        first, notes_of_bone = _map(bone, table, (here, there), options)
        notes += notes_of_bone
        riders = counterparts.riders(first, bone, here)
        bones |= riders
        if bone.spread:
            bones |= _seated(riders, bone, there)
            targets = tuple(name for name in bone.targets if name in target.model.body_names)
            parts |= dict.fromkeys(bone.sources, targets)
    model, bones = _with_rays(source.model, bones, table, (here, there))
    if parts:
        digits = frozenset(body for bone in table.bones if bone.rays for body in bone.sources)
        model = counterparts.spread_over_targets(model, parts, bones, there, digits)
    model, placed, moved = with_attachments(
        straightened(model, table.straight), bones, table.relatives
    )
    return SpeciesBones(model, placed, (*notes, *moved))


def _missing_bodies(bone: counterparts.BoneHomology, source: Model, target: Model) -> list[str]:
    """Return the first bodies of a pair of bones that the models lack."""
    missing = [name for name in bone.sources[:1] if name not in source.body_names]
    return missing + [name for name in bone.targets[:1] if name not in target.body_names]


def _with_rays(
    source: Model,
    bones: dict[str, BoneMap],
    table: counterparts.SpeciesTable,
    posed: tuple[counterparts.Posed, counterparts.Posed],
) -> tuple[Model, dict[str, BoneMap]]:
    """Put muscles on the rays of all bones that have some; returns the source and all maps."""
    for bone in table.bones:
        if bone.rays and bone.sources[0] in bones:
            rays = put_on_rays(source, bone, table, posed)
            source = rays.source
            bones = {**bones, **rays.bones}
    return source, bones


def _seated(
    riders: Mapping[str, BoneMap], bone: counterparts.BoneHomology, there: counterparts.Posed
) -> dict[str, BoneMap]:
    """Map each source body of a bone to the bone's further targets, as parts of the body."""
    return {
        counterparts.part_name(body, name): counterparts.seated(rider, body, bone, number, there)
        for number, name in enumerate(bone.targets[1:], start=1)
        if name in there.model.body_names
        for body, rider in riders.items()
    }


def _map(
    bone: counterparts.BoneHomology,
    table: counterparts.SpeciesTable,
    posed: tuple[counterparts.Posed, counterparts.Posed],
    options: SpeciesOptions,
) -> tuple[BoneMap, tuple[str, ...]]:
    """Map a pair's first bodies."""
    pair = f"{bone.sources[0]} to {bone.targets[0]}"
    points, shapes, notes = _common_landmarks(bone, table, posed)
    if bone.match == "similarity" or any(rule.rule == "box" for rule in bone.landmarks):
        return _by_landmarks(bone, points, shapes, options), tuple(notes)
    names, ours, theirs, steep = _consistent(points.names, points.source, points.target)
    notes += [f"{pair}: {line}" for line in steep]
    scaling = fit_affine(theirs, ours)
    if np.linalg.det(scaling.matrix) <= 0.0:
        raise BadData(
            f"{pair}: the landmarks turn right into left: is one of the bones of the other side?"
        )
    match = options.match or MatchOptions()
    points = FeaturePoints(names, ours, scaling.apply(theirs))
    # What rules found on a bone need not be checked against it.
    surfaces: tuple[Surface | None, Surface | None] = (None, None)
    if match.features == "dense" and bone.match == "dense":
        surfaces = (
            shapes[0],
            Surface(scaling.apply(shapes[1].vertices), shapes[1].faces),
        )
    chosen = BoneMapOptions(
        map=options.map or MapOptions(), match=match, target_body=bone.targets[0]
    )
    bone_map = map_bone(bone.sources[0], *surfaces, points, chosen)
    return _stretched(bone_map, shapes[0], shapes[1], scaling.inverse()), tuple(notes)


def _common_landmarks(
    bone: counterparts.BoneHomology,
    table: counterparts.SpeciesTable,
    posed: tuple[counterparts.Posed, counterparts.Posed],
) -> tuple[FeaturePoints, tuple[Surface, Surface], list[str]]:
    """Find the landmarks that rules find on both bones of a pair.

    Returns them with the bones' surfaces, and notes on rules that found none.
    """
    pair = f"{bone.sources[0]} to {bone.targets[0]}"
    frames = table.frames(bone)
    places = []
    shapes = []
    notes: list[str] = []
    for index, (bodies, side) in enumerate(zip((bone.sources, bone.targets), posed, strict=True)):
        shape = side.surface(tuple(name for name in bodies if name in side.model.body_names))
        marked = MarkedBone(
            surface=shape,
            frame=frames[index],
            joints=side.joints(bodies[0]),
            of_source=index == 0,
            half=bone.half,
        )
        marks, lost = landmarks_by_rules(bone.landmarks, marked)
        shapes.append(shape)
        places.append(marks)
        notes += [f"{pair}: {line}" for line in lost]
    ours, theirs = places
    names = tuple(name for name in ours if name in theirs)
    if len(names) < MIN_COUNT:
        raise BadData(
            f"{pair}: {len(names)} landmarks in common ({', '.join(names)}): expected four or more"
        )
    points = FeaturePoints(
        names,
        np.array([ours[name] for name in names]),
        np.array([theirs[name] for name in names]),
    )
    return points, (shapes[0], shapes[1]), notes


def _by_landmarks(
    bone: counterparts.BoneHomology,
    points: FeaturePoints,
    shapes: tuple[Surface, Surface],
    options: SpeciesOptions,
) -> BoneMap:
    """Map a bone by its landmarks alone.

    The corners of a box are not on the bone: nothing about them can be checked against its surface.
    """
    kind = MapOptions("similarity") if bone.match == "similarity" else options.map
    return BoneMap(
        body=bone.sources[0],
        target_body=bone.targets[0],
        map=fit_map(points, kind),
        whole=procrustes(points.source, points.target, True),
        basis="landmarks",
        source=shapes[0],
        target=shapes[1],
        features=points,
    )


def _consistent(
    names: tuple[str, ...], ours: Array, theirs: Array
) -> tuple[tuple[str, ...], Array, Array, tuple[str, ...]]:
    """Leave out landmarks that lie together in the source but not in the target.

    Returns the others, and which these are. Rules that look for extremes may find one position
    twice on a bone and two positions on another's; a map through both would tear the space between
    them.
    """
    goal = fit_affine(theirs, ours).apply(theirs)
    kept = list(range(len(names)))
    dropped: list[str] = []
    while len(kept) > MIN_COUNT:
        apart = np.linalg.norm(ours[kept][:, None] - ours[kept], axis=2)
        wanted = np.linalg.norm(goal[kept][:, None] - goal[kept], axis=2)
        torn = (wanted > STEEPEST * apart) & (wanted > 0.0)
        if not torn.any():
            break
        # The one that most others contradict; of equals the later in the table.
        worst = len(kept) - 1 - int(np.argmax(torn.sum(axis=1)[::-1]))
        dropped.append(names[kept.pop(worst)])
    notes = (
        f"landmarks left out, as beside them others lie in the source alone: {', '.join(dropped)}",
    )
    return tuple(names[i] for i in kept), ours[kept], theirs[kept], notes if dropped else ()


def _stretched(bone: BoneMap, source: Surface, target: Surface, back: AffineMap) -> BoneMap:
    """Return the same map with the target's bone in its own proportions."""
    marks = bone.features
    assert marks is not None
    size = float(np.cbrt(np.linalg.det(back.matrix)))
    radii = None if marks.radii is None else size * marks.radii
    marks = replace(marks, target=back.apply(marks.target), radii=radii)
    return replace(
        bone,
        map=PlacedMap(STAYS, bone.map, back),
        whole=procrustes(marks.source, marks.target, True, marks.weights),
        source=source,
        target=target,
        features=marks,
        measures={
            name: size * value if name.endswith(MEASURED_IN_METERS) else value
            for name, value in bone.measures.items()
        },
    )


def species_morph(
    source: counterparts.Skeleton,
    target: counterparts.Skeleton,
    table: counterparts.SpeciesTable,
    options: SpeciesOptions | None = None,
    progress: Callable[[str], None] | None = None,
) -> Morph:
    """Put the source's muscles on the target's skeleton, which keeps its own joints and masses.

    Its `source` is that model with parts of bodies as bodies of their own where the table spreads
    one over several. `progress`: called with a bone's name before it is mapped, and with "muscles".
    """
    options = options or SpeciesOptions()
    bones = species_bones(source, target, table, options, progress)
    if not bones.bones:
        wanted = ", ".join(
            f"'{bone.sources[0]}' and '{bone.targets[0]}'" for bone in table.bones[:3]
        )
        raise BadData(
            f"species table '{table.name}': no pair of its bodies is in the models: it wants"
            f" {wanted}, ..."
        )
    if progress is not None:
        progress("muscles")
    known = None
    if options.morph is None or options.morph.architecture == "tables":
        known = _known_architecture(source.model, target, table, bones.bones)
    graft = Graft(
        coordinates=coordinate_table(table, source.model, target.model),
        postures=(table.posture, table.target_posture),
        beside=options.beside,
        name=options.name,
        architecture=known,
    )
    morph = graft_muscles(bones.source, target.model, bones.bones, options.morph, graft)
    points = _less_sure(morph.points, table.unlike, target.surfaces)
    return replace(morph, points=points, notes=(*bones.notes, *morph.notes))


def _known_architecture(
    source: Model,
    target: counterparts.Skeleton,
    table: counterparts.SpeciesTable,
    bones: Mapping[str, BoneMap],
) -> Mapping[str, Architecture] | None:
    """Return fibers and forces of the muscles that are transferred, as the table knows them."""
    transferred = [
        muscle.name
        for muscle in source.muscles
        if all(point.body in bones for point in muscle.path.points)
    ]
    if table.architecture:
        sizes = [
            size_over(architecture, table, target.model, target.surfaces)
            for architecture in table.architecture
        ]
        return architectures(source, table.architecture, sizes, transferred)
    if table.scaling is not None:
        theirs = joint_distances(table.scaling.bones, table, target.model, "target")
        ours = joint_distances(table.scaling.bones, table, source, "source")
        return scaled_architectures(source, table.scaling, theirs / ours, transferred)
    return None


def _less_sure(
    points: tuple[TransferredPoint, ...], unlike: float, surfaces: counterparts.Surfaces
) -> tuple[TransferredPoint, ...]:
    """Widen the intervals of points by how differently species attach their muscles.

    Before, they held only how bones were matched.
    """
    if not unlike:
        return points
    lengths = {
        body: float(np.ptp(surface.vertices, axis=0).max()) for body, surface in surfaces.items()
    }
    return tuple(
        (
            replace(
                point,
                within=float(
                    np.hypot(np.nan_to_num(point.within), unlike * lengths[point.target_body])
                ),
            )
            if point.target_body in lengths
            else point
        )
        for point in points
    )


def size_over(
    of: ArchitectureTable,
    table: counterparts.SpeciesTable,
    target: Model,
    surfaces: counterparts.Surfaces,
) -> Size:
    """How the target animal compares with those of a table of architecture."""
    if of.measured == "joints":
        ours = joint_distances(of.lengths, table, target, "target")
    else:
        there = counterparts.Posed(target, table.target_posture, surfaces)
        ours = 0.0
        for body in of.lengths:
            points = there.surface(_bone_of(body, table).targets).vertices
            points = points - points.mean(axis=0)
            shaft = np.linalg.svd(points, full_matrices=False)[2][0]
            ours += float(np.ptp(points @ shaft))
    length = ours / sum(of.lengths.values()) if of.lengths else 1.0
    mass = target.mass / of.body_mass if of.body_mass and target.mass > 0.0 else None
    return Size(length, mass)


def joint_distances(
    bodies: Iterable[str],
    table: counterparts.SpeciesTable,
    model: Model,
    whose: Literal["source", "target"],
) -> float:
    """Sum over bones the distance between the two joints that a species table has of each [m].

    `bodies`: of the source, one of each bone; `model`: the source or the target, as `whose` states.
    """
    posed = counterparts.Posed(model, table.posture if whose == "source" else table.target_posture)
    total = 0.0
    for body in bodies:
        bone = _bone_of(body, table)
        joints = posed.joints(getattr(bone, f"{whose}s")[0])
        ends = [
            joints[getattr(rule, f"{whose}_joint")]
            for rule in bone.landmarks
            if rule.rule == "joint"
        ]
        if len(ends) < 2:
            raise BadData(
                f"species table '{table.name}': the landmarks of '{body}' lack two joints to"
                " measure it by"
            )
        total += float(np.linalg.norm(ends[1] - ends[0]))
    return total


def _bone_of(body: str, table: counterparts.SpeciesTable) -> counterparts.BoneHomology:
    for bone in table.bones:
        if body in bone.sources:
            return bone
    raise BadData(
        f"species table '{table.name}': it has no bone of '{body}', by which its muscles are scaled"
    )


def coordinate_table(
    table: counterparts.SpeciesTable, source: Model, target: Model
) -> CoordinateTable:
    """Coordinates of a species table that both models have."""
    return {
        coordinate.source: (coordinate.target, coordinate.factor, coordinate.offset)
        for coordinate in table.coordinates
        if coordinate.source in source.coordinate_names
        and coordinate.target in target.coordinate_names
    }
