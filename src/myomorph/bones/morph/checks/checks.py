"""Checks of a morphed model: paths through bones, moment arms, folds, surfaces, fibers, joints.

No value is judged by itself: a source model has faults of its own, so every check compares the
target with the source, scaled to the target's size.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
import scipy

from myomorph.bones.causes import ATTACHMENTS
from myomorph.bones.morph.checks.moment_arms import (
    CoordinatePair,
    CoordinateTable,
    MomentArms,
    compare_moment_arms,
    compared_coordinates,
    paired_values,
)
from myomorph.bones.morph.checks.penetration import (
    NOWHERE,
    Penetration,
    Solid,
    path_depths,
    range_poses,
)
from myomorph.bones.morph.checks.warnings import (
    KINDS,
    CheckOptions,
    MorphChecks,
    arm_warnings,
    bone_warnings,
    fiber_warnings,
    joint_warnings,
    order_warnings,
    surface_warnings,
)
from myomorph.bones.morph.maps.fields import BoneMap, inverted, muscle_sizes
from myomorph.bones.morph.morphed import Morph
from myomorph.core.model.findings import Finding
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.surface import Surface

PARTS = 4  # Of which progress is reported.


def check_morph(
    morph: Morph,
    options: CheckOptions | None = None,
    coordinates: CoordinateTable | None = None,
    progress: Callable[[float], None] | None = None,
) -> MorphChecks:
    """Hold a morphed model against its source.

    Parameters
    ----------
    morph : of `morph_model`
    options : limits of the checks; see `CheckOptions`
    coordinates : by coordinate of the source the target's, factor and offset, as of
        `graft_muscles`; None for those of the same name
    progress : called with 1 after each of `PARTS` parts

    Returns
    -------
    paths through bones [m], moment arms [m], folds, and warnings

    Raises
    ------
    UnknownName : the table names a coordinate that its model does not have

    Examples
    --------
    >>> import myomorph as mm
    >>> model = mm.read_model("arm.osim")
    >>> import numpy as np
    >>> places = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.3, 0.0], [0.0, 0.0, 0.05]])
    >>> pairs = mm.morph.FeaturePoints(("a", "b", "c", "d"), places, 1.2 * places)
    >>> fore = mm.map_bone("fore", None, None, pairs)
    >>> checks = mm.morph.check_morph(mm.morph_model(model, {"fore": fore}))
    >>> [warning.kind for warning in checks.warnings], len(checks.arms)
    ([], 2)
    """
    options = options or CheckOptions()
    pairs = compared_coordinates(morph.source, morph.model, coordinates)
    advance = progress or (lambda _: None)
    arms = compare_moment_arms(morph.source, morph.model, pairs)
    advance(1.0)
    notes: list[str] = []
    ours, theirs = _solids(morph, notes)
    advance(1.0)
    deep = _penetrations(morph, pairs, ours, theirs, options)
    advance(1.0)
    longest = max((solid.length for solid in theirs.values()), default=np.inf)
    checks = MorphChecks(
        penetrations=tuple(sorted(deep, key=lambda penetration: -penetration.increase)),
        arms=arms,
        order=FrozenMap({arm.pair.source: _rank_correlation(arm) for arm in arms}),
        folded=_folded(morph),
        warnings=(),
        options=options,
        notes=tuple(notes),
    )
    warnings = sorted(
        _warnings(morph, checks, longest),
        key=lambda warning: (list(KINDS).index(warning.kind), -warning.size, warning.place),
    )
    advance(1.0)
    return replace(checks, warnings=tuple(warnings))


def _warnings(morph: Morph, checks: MorphChecks, longest: float) -> list[Finding]:
    """Return what is beyond the limits of the checks; `longest`: bone of the target [m]."""
    options = checks.options
    sizes = muscle_sizes(morph.source, morph.bones)
    sliding = {
        coordinate.name
        for coordinate in morph.model.coordinates
        if coordinate.motion == "translational"
    }
    folds = (
        Finding(
            "fold",
            m,
            ATTACHMENTS.message(f"{m}: the map of {body} inverts space at {p}"),
        )
        for m, p, body in checks.folded
    )
    return [
        *bone_warnings(checks.penetrations, longest, options, sliding),
        *arm_warnings(morph.source, checks.arms, sizes, options),
        *order_warnings(checks.arms, checks.order, options),
        *folds,
        *surface_warnings(morph, longest, options),
        *fiber_warnings(morph, options),
        *joint_warnings(morph, longest, options),
    ]


def distinct_bones(morph: Morph) -> tuple[BoneMap, ...]:
    """Return the bones, but of bodies that share one surface the first alone.

    Bodies share a surface where bones are fused in the target.
    """
    bone_maps: list[BoneMap] = []
    for bone in morph.bones.values():
        ours = bone.source
        known = [
            map_.source
            for map_ in bone_maps
            if map_.target_body == bone.target_body and map_.source is not None
        ]
        if ours is None or not any(np.array_equal(ours.faces, surface.faces) for surface in known):
            bone_maps.append(bone)
    return tuple(bone_maps)


def target_surface(bone: BoneMap) -> Surface | None:
    """Return the target's bone, or the source's as its map transfers it where the target has none.

    None without both.
    """
    if bone.target is not None:
        return bone.target
    return (
        None
        if bone.source is None
        else Surface(bone.map.apply(bone.source.vertices), bone.source.faces)
    )


def _solids(morph: Morph, notes: list[str]) -> tuple[dict[str, Solid], dict[str, Solid]]:
    """Bones of source and target, by their bodies' names, where both are known."""
    ours: dict[str, Solid] = {}
    theirs: dict[str, Solid] = {}
    lacking = []
    touched = {point.body for point in morph.points}
    for bone in distinct_bones(morph):
        target = target_surface(bone)
        if bone.source is None or target is None:
            lacking += [bone.body] if bone.body in touched else []
            continue
        # Bones that became one in the target are looked at as one there.
        source_solid = Solid(bone.source)
        target_solid = Solid(target)
        ours[bone.body] = source_solid
        theirs[bone.body] = target_solid
        for solid, whose, name in (
            (ours, "source", bone.body),
            (theirs, "target", bone.target_body),
        ):
            turned = solid[bone.body].turned
            if solid[bone.body].open:
                notes.append(
                    f"{name}: the {whose}'s bone is open, its inside is determined by winding"
                    " numbers"
                )
            if turned > 0.5:
                notes.append(
                    f"{name}: the {whose}'s bone looks inward; its faces were turned outward"
                )
            elif turned > 0.05:
                notes.append(
                    f"{name}: {100 * turned:.0f} % of the faces of the {whose}'s bone looked"
                    " inward: turned"
                )
    if lacking:
        notes.append(
            f"paths are not checked against {', '.join(lacking)}: no bones of both source and"
            " target"
            " are known"
        )
    return ours, theirs


def _penetrations(
    morph: Morph,
    pairs: Sequence[CoordinatePair],
    ours: Mapping[str, Solid],
    theirs: Mapping[str, Solid],
    options: CheckOptions,
) -> list[Penetration]:
    if not ours or not morph.source.muscles:
        return []
    values, target_values = paired_values(morph.source, morph.model, pairs, options.poses)
    before = path_depths(
        morph.source, ours, range_poses(morph.source, [pair.source for pair in pairs], values)
    )
    poses = range_poses(morph.model, [pair.target for pair in pairs], target_values)
    bodies = {bone.body: bone.target_body for bone in morph.bones.values()}
    merged: dict[str, Solid] = {bodies[body]: solid for body, solid in theirs.items()}
    after = path_depths(morph.model, merged, poses)
    result = []
    for muscle, body in dict.fromkeys([*((m, bodies[b]) for m, b in before), *after]):
        depth = after.get((muscle, body), NOWHERE)
        # Of several source bones that became one, the deepest counts.
        was = {our: before.get((muscle, our), NOWHERE).depth for our in ours if bodies[our] == body}
        grown = max(morph.bones[our].whole.scale * deep for our, deep in was.items())
        name = poses.moved[depth.pose]
        value = (
            float(poses.coordinates[depth.pose, morph.model.coordinate_names.index(name)])
            if name
            else 0.0
        )
        increase = depth.depth - grown
        length = merged[body].length
        result.append(
            Penetration(
                muscle=muscle,
                body=body,
                source=max(was.values()),
                target=depth.depth,
                increase=increase,
                coordinate=name,
                value=value,
                length=length,
            )
        )
    return result


def _rank_correlation(moment_arms: MomentArms) -> float:
    """Spearman's, of the muscles' mean moment arms; NaN of fewer than four muscles."""
    if len(moment_arms.muscles) < 4:
        return float("nan")
    return float(
        scipy.stats.spearmanr(
            moment_arms.source.mean(axis=0), moment_arms.target.mean(axis=0)
        ).statistic
    )


def _folded(morph: Morph) -> tuple[tuple[str, str, str], ...]:
    """Muscle points at which the map of their bone does not keep orientation."""
    folded = []
    for body, bone in morph.bones.items():
        points = [point for point in morph.points if point.body == body]
        if points:
            turned = inverted(bone.map, np.array([point.source for point in points]))
            folded += [
                (point.owner, point.name, body)
                for point, bad in zip(points, turned, strict=True)
                if bad
            ]
    return tuple(folded)
