"""A model's muscles, and all that is fixed to its bones, in other bones ([D] chapters 2 and 6)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from myomorph.bones.morph.checks.clearance import cleared
from myomorph.bones.morph.checks.moment_arms import CoordinateTable, paired_postures
from myomorph.bones.morph.maps.fields import BoneMap
from myomorph.bones.morph.morphed import Architecture, Morph, MorphOptions
from myomorph.bones.morph.transfer.body_transfer import (
    Transfer,
    Transfers,
    neighbor_notes,
    not_transferred,
    of_mass,
    transferred_actuator,
    transferred_body,
    transferred_marker,
    transferred_mesh,
    transferred_tie,
    with_neighbors,
)
from myomorph.bones.morph.transfer.joints import CenterFinder, transferred_joints
from myomorph.bones.morph.transfer.moving_points import translated_path
from myomorph.bones.morph.transfer.muscles import MuscleTransfer, path_lengths
from myomorph.bones.morph.transfer.paths import LinesOfAction, SourceLines, transferred_lines
from myomorph.bones.morph.transfer.points import uncertain_notes
from myomorph.bones.morph.transfer.virtual_links import (
    balanced_links,
    bones_around,
    link_carriers,
    link_notes,
)
from myomorph.core.model.errors import BadData, UnknownName, quoted
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.model import GROUND, Model, index_of
from myomorph.core.model.paths import (
    Ligament,
    Muscle,
    PathPoint,
    PathWrap,
    refuse_path_functions,
)
from myomorph.core.model.scale import taut_ligaments
from myomorph.core.muscles.kinematics import default_path_lengths
from myomorph.core.rigid.kinematics import standing_poses

PosturePair = tuple[Mapping[str, float], Mapping[str, float]]
"""Postures of source and target: values of coordinates that are not at their defaults."""


@dataclass(frozen=True, kw_only=True)
class MorphTarget:
    """What is known of the new model besides the maps of its bones.

    Attributes
    ----------
    mass : of the new model [kg]; by default masses grow with the bones' volumes
    name : of the new model; by default the old one's
    together : the target's bones share one frame, as in one scan, so that parent and child must
        agree on joint centers
    surrounding : bodies that are virtual links, with the bones around each
    """

    mass: float | None = None
    name: str = ""
    together: bool = False
    surrounding: Mapping[str, Sequence[str]] = field(default_factory=lambda: FrozenMap({}))


def morph_model(
    model: Model,
    bones: Mapping[str, BoneMap],
    options: MorphOptions | None = None,
    target: MorphTarget | None = None,
    progress: Callable[[int], None] | None = None,
) -> Morph:
    """Transfer a model to other bones: joints, muscles and all that is fixed to its bodies.

    Everything fixed to one body goes by that body's map alone. A body without a map takes its
    neighbors' size; one that has no bone at all, but muscle points, is mapped by the bones around
    it (a virtual link). The new model has the coordinates of the old one: at equal values
    homologous directions of the bones lie alike.

    Source: [D], chapter 2; Modenese et al. 2016; see docs/morphing.md.

    Parameters
    ----------
    model : whose muscles, joints and markers are transferred
    bones : maps by body, "ground" among them where it holds a bone; at least one
    options : what is transferred how; see `MorphOptions`
    target : mass, name and frame of the new model; see `MorphTarget`
    progress : called with the number of postures just done, of which there are `postures.COUNT` + 1
        for each model

    Returns
    -------
    the new model, where its points came to lie [m], its muscles' lengths [m] and notes

    Raises
    ------
    UnknownName : a map, or a virtual link, of a body that the model does not have
    BadData : no map, or one that turns right into left

    Examples
    --------
    >>> import numpy as np
    >>> import myomorph as mm
    >>> places = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.3, 0.0], [0.0, 0.0, 0.05]])
    >>> pairs = mm.morph.FeaturePoints(("a", "b", "c", "d"), places, 1.2 * places)
    >>> fore = mm.map_bone("fore", None, None, pairs)
    >>> target = mm.morph.MorphTarget(mass=4.0)
    >>> found = mm.morph_model(mm.read_model("arm.osim"), {"fore": fore}, target=target)
    >>> found.model.markers[2].location[:2].round(3).tolist()
    [0.048, -0.12]
    """
    options = options or MorphOptions()
    target = target or MorphTarget()
    refuse_path_functions(model.muscles, "morphing")
    _check(model, bones)
    transfers = {body: Transfer(bone, body) for body, bone in with_neighbors(model, bones).items()}
    finder = CenterFinder(transfers, options.joints == "fitted", target.together)
    joints = transferred_joints(model, transfers, finder)
    links = bones_around(model, bones, target.surrounding or None)
    # Their joints stay where their neighbors' size puts them: the pose in which bones are compared
    # hangs on them.
    standing = (standing_poses(model), standing_poses(joints.skeleton)) if links else ({}, {})
    transfers |= link_carriers(links, transfers, *standing, {link: link for link in links})
    skeleton = replace(joints.skeleton, name=target.name or model.name, warnings=())
    whole = SourceLines.of(model)

    def transferred(by: Transfers) -> tuple[Model, LinesOfAction]:
        lines = transferred_lines(whole, by, joints.travel, options.surface_within)
        return _with_parts(skeleton, model, lines, by, target.mass), lines

    if options.balance:
        transfers = balanced_links(model, links, transfers, lambda by: transferred(by)[0])
    moved, lines = transferred(transfers)
    paths = _TransferredPaths(
        source=model,
        donor=model,
        target=moved,
        lines=lines,
        transfers=transfers,
        notes=joints.notes,
    )
    morph = _morph(paths, options, progress=progress)
    return replace(morph, joints=joints.rebuilt, notes=(*morph.notes, *not_transferred(model)))


def _with_parts(
    skeleton: Model, source: Model, lines: LinesOfAction, by: Transfers, mass: float | None
) -> Model:
    """Return transferred joints with all else that is fixed to the source's bodies.

    `mass`: of the new model [kg]; None to let masses grow with the bones' volumes.
    """
    bodies = tuple(transferred_body(body, by[body.name]) for body in source.bodies)
    return replace(
        skeleton,
        gravity=by[GROUND].rotation @ source.gravity,
        markers=tuple(transferred_marker(marker, by) for marker in source.markers),
        actuators=tuple(transferred_actuator(actuator, by) for actuator in source.actuators),
        loops=tuple(transferred_tie(loop, by) for loop in source.loops),
        frames=tuple(
            replace(frame, pose=by[frame.body].pose(frame.pose)) for frame in source.frames
        ),
        ground_meshes=tuple(transferred_mesh(mesh, by[GROUND]) for mesh in source.ground_meshes),
        bushings=tuple(transferred_tie(bushing, by) for bushing in source.bushings),
        bodies=of_mass(bodies, mass),
        muscles=lines.muscles,
        ligaments=lines.ligaments,
        wrap_objects=lines.wrap_objects,
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class _TransferredPaths:
    """Transferred paths, and what they come from.

    Attributes
    ----------
    source : the source
    donor : the source with only the muscles and ligaments that are transferred
    target : the model with the transferred paths
    lines : these paths
    transfers : of the bodies
    notes : on joints, and on points that depend on coordinates
    table : the target's coordinate of each of the source's; None where they are the same
    postures : of source and target in which their bones lie alike
    """

    source: Model
    donor: Model
    target: Model
    lines: LinesOfAction
    transfers: Transfers
    notes: Sequence[str]
    table: CoordinateTable | None = None
    postures: PosturePair = ({}, {})


def _morph(
    paths: _TransferredPaths,
    options: MorphOptions,
    architecture: Mapping[str, Architecture] | None = None,
    progress: Callable[[int], None] | None = None,
) -> Morph:
    """Complete transferred paths to a morph.

    Paths are brought out of bones, muscles get their lengths, and whatever there is to note is
    noted.
    """
    donor = paths.donor
    transfers = paths.transfers
    solid = [transfer.bone for transfer in transfers.values()] if options.clear else []
    moved, points, clearing = cleared(donor, paths.target, solid, paths.lines.points, paths.table)
    postures = paired_postures(donor, moved, paths.table, paths.postures)
    lengths = path_lengths(donor, moved, postures, progress)
    transfer = MuscleTransfer(
        source=paths.source,
        target=moved,
        transfers=transfers,
        options=options,
        architecture=architecture or {},
    )
    muscles, changes, unsure = transfer.muscles(lengths)
    taut = taut_ligaments(
        _in_posture(donor, paths.postures[0]),
        _in_posture(moved, paths.postures[1]),
        default_path_lengths,
    )
    bones = FrozenMap({body: transfer.bone for body, transfer in transfers.items()})
    return Morph(
        source=paths.source,
        model=replace(moved, muscles=muscles, ligaments=taut),
        bones=bones,
        points=points,
        joints=(),
        muscles=changes,
        options=options,
        notes=(
            *uncertain_notes(points, transfers),
            *neighbor_notes(bones),
            *link_notes(bones),
            *paths.notes,
            *paths.lines.notes,
            *clearing,
            *unsure,
        ),
    )


def _check(model: Model, bones: Mapping[str, BoneMap]) -> None:
    if not bones:
        raise BadData("no bone is given: the map of at least one body is needed")
    for body in bones:
        if body not in (GROUND, *model.body_names):
            raise UnknownName("body", body, model.body_names)


@dataclass(frozen=True, eq=False, kw_only=True)
class Graft:
    """What is known of a skeleton and of the source whose muscles it gets.

    Attributes
    ----------
    coordinates : target = factor source + offset; by default those of the same name. Conditional
        and moving points follow them, and fibers keep the range of normalized lengths over the
        ranges of these
    postures : of source and target in which their bones lie alike: virtual links are mapped in
        them, paths compared
    surrounding : virtual links, with the bones around each
    beside : keep the target's own muscles too
    name : of the new model; by default the target's
    architecture : known fiber lengths and forces, by the source's names
    """

    coordinates: CoordinateTable | None = None
    postures: PosturePair = ({}, {})
    surrounding: Mapping[str, Sequence[str]] | None = None
    beside: bool = False
    name: str = ""
    architecture: Mapping[str, Architecture] | None = None


def graft_muscles(
    source: Model,
    target: Model,
    bones: Mapping[str, BoneMap],
    options: MorphOptions | None = None,
    graft: Graft | None = None,
) -> Morph:
    """Put the source's muscles, wrap objects and markers on the target's skeleton ([D] chapter 6).

    Several bodies of the source may lead to one of the target, where bones are fused. A muscle one
    of whose bodies has no counterpart is left out, and so is a wrap object. Joints, masses and
    meshes are the target's own.
    """
    options = options or MorphOptions()
    graft = graft or Graft()
    _check(source, bones)
    table = _same_names(source, target) if graft.coordinates is None else graft.coordinates
    transfers = _onto(target, bones)
    links = bones_around(source, bones, graft.surrounding)
    standing = (
        standing_poses(source, graft.postures[0]),
        standing_poses(target, graft.postures[1]),
    )
    transfers |= link_carriers(links, transfers, *standing, _first_targets(links, transfers))
    left_out = _left_out(source, transfers)
    muscles, notes = _translated(
        source,
        [muscle for muscle in source.muscles if muscle.name not in left_out],
        transfers,
        table,
        graft.postures[0],
    )
    whole = replace(
        SourceLines.of(source),
        muscles=tuple(muscles),
        ligaments=_whole_ligaments(source, transfers),
        coordinates=(*source.coordinates, *target.coordinates),
    )

    def transferred(by: Transfers) -> tuple[Model, LinesOfAction]:
        lines = transferred_lines(whole, by, {}, options.surface_within)
        skeleton = replace(target, name=graft.name or target.name)
        return _with_lines(skeleton, lines, source, by), lines

    if options.balance:
        transfers = balanced_links(
            _in_posture(source, graft.postures[0]),
            links,
            transfers,
            lambda by: _in_posture(transferred(by)[0], graft.postures[1]),
        )
    moved, lines = transferred(transfers)
    paths = _TransferredPaths(
        source=source,
        donor=replace(
            source,
            muscles=tuple(source.muscle(muscle.name) for muscle in muscles),
            ligaments=whole.ligaments,
        ),
        target=moved,
        lines=lines,
        transfers=transfers,
        notes=notes,
        table=table,
        postures=graft.postures,
    )
    morph = _morph(paths, options, graft.architecture)
    return replace(
        morph,
        model=_beside(target, morph.model) if graft.beside else morph.model,
        left_out=FrozenMap(left_out),
    )


def _same_names(source: Model, target: Model) -> CoordinateTable:
    """Return the table of coordinates that both models have by the same name."""
    return {
        name: (name, 1.0, 0.0)
        for name in source.coordinate_names
        if name in target.coordinate_names
    }


def _first_targets(links: Mapping[str, Sequence[str]], transfers: Transfers) -> dict[str, str]:
    """Return the target of the first bone around each virtual link."""
    return {link: transfers[around[0]].body for link, around in links.items()}


def _onto(target: Model, bones: Mapping[str, BoneMap]) -> dict[str, Transfer]:
    """Return the transfers of bodies onto a target's, which must be there."""
    known = (GROUND, *target.body_names)
    for body, bone in bones.items():
        index_of("body", bone.target_body, known, f"the target of '{body}'")
    return {body: Transfer(bone, bone.target_body) for body, bone in bones.items()}


def _with_lines(target: Model, lines: LinesOfAction, source: Model, by: Transfers) -> Model:
    """Return the target with transferred paths alone, and the source's further markers."""
    # The parts of the source's file that the ligaments' forces are in.
    forces = {(ligament.kind, ligament.name) for ligament in lines.ligaments}
    kept = (part for part in source.kept if (part.kind, part.name) in forces)
    further = (
        marker
        for marker in source.markers
        if marker.body in by and marker.name not in target.marker_names
    )
    return replace(
        target,
        muscles=lines.muscles,
        ligaments=lines.ligaments,
        kept=(*target.kept, *kept),
        wrap_objects=lines.wrap_objects,
        markers=(*target.markers, *(transferred_marker(marker, by) for marker in further)),
        warnings=(),
    )


def _beside(target: Model, grown: Model) -> Model:
    """Put the target's own muscles before those that were transferred."""
    return replace(
        grown,
        muscles=(*target.muscles, *grown.muscles),
        ligaments=(*target.ligaments, *grown.ligaments),
        wrap_objects=(*target.wrap_objects, *grown.wrap_objects),
    )


def _in_posture(model: Model, values: Mapping[str, float]) -> Model:
    """Give the model other default values of its coordinates."""
    changed = (
        replace(coordinate, default=values.get(coordinate.name, coordinate.default))
        for coordinate in model.coordinates
    )
    return replace(model, coordinates=tuple(changed))


def _whole_ligaments(source: Model, transfers: Mapping[str, Transfer]) -> tuple[Ligament, ...]:
    """Return the ligaments all of whose bodies have a counterpart.

    They no longer go around surfaces that have none.
    """
    bodies = {wrap.name: wrap.body for wrap in source.wrap_objects}
    ligaments = []
    for ligament in source.ligaments:
        if all(
            isinstance(point, PathPoint) and point.body in transfers
            for point in ligament.path.points
        ):
            wraps = tuple(
                w
                for w in ligament.path.wraps
                if isinstance(w, PathWrap) and bodies[w.wrap_object] in transfers
            )
            ligaments.append(replace(ligament, path=replace(ligament.path, wraps=wraps)))
    return tuple(ligaments)


def _left_out(source: Model, transfers: Mapping[str, Transfer]) -> dict[str, str]:
    """Why each muscle that cannot be put on the target is left out."""
    result = {}
    for muscle in source.muscles:
        missing = dict.fromkeys(
            point.body for point in muscle.path.points if point.body not in transfers
        )
        if missing:
            result[muscle.name] = "the target has no counterpart of " + ", ".join(
                f"'{body}'" for body in missing
            )
    return result


def _translated(
    source: Model,
    muscles: Sequence[Muscle],
    transfers: Mapping[str, Transfer],
    table: CoordinateTable,
    posture: Mapping[str, float],
) -> tuple[list[Muscle], list[str]]:
    """Muscles in the target's coordinates, around the surfaces that the target has."""
    standing = {
        coordinate.name: posture.get(coordinate.name, coordinate.default)
        for coordinate in source.coordinates
    }
    bodies = {wrap.name: wrap.body for wrap in source.wrap_objects}
    paths = []
    frozen = []
    straight = []
    for muscle in muscles:
        path, lost = translated_path(muscle.path, table, standing)
        wraps: Any = tuple(
            wrap
            for wrap in path.wraps
            if bodies[wrap.wrap_object] in transfers
            and (isinstance(wrap, PathWrap) or wrap.side_body in ("", *transfers))
        )
        if lost:
            frozen.append(muscle.name)
        if len(wraps) < len(path.wraps):
            straight.append(muscle.name)
        paths.append(replace(muscle, path=replace(path, wraps=wraps)))
    notes = []
    if frozen:
        notes.append(
            f"points that depend on coordinates missing in the target are fixed: {quoted(frozen)}"
        )
    if straight:
        notes.append(
            "paths no longer go around surfaces of bodies that the target does not have:"
            f" {quoted(straight)}"
        )
    return paths, notes
