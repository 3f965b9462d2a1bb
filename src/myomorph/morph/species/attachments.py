"""Attachments along a shaft that differ between species, from a relative's anatomy.

A map of bones takes a point to where the same shape is, but muscles wander along shafts between orders of mammals: a
rodent's vasti begin at the hip, man's half way to the knee. A species table says where along the bone, from its
proximal to its distal joint, such a muscle begins or ends in the target or its relatives; it then goes around the shaft
where the map puts it, on the surface.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.errors import BadData
from myomorph.model.model import Body, Joint, Model
from myomorph.model.paths import Muscle, PathPoint
from myomorph.model.spatial import Transform
from myomorph.morph.maps.fields import BoneMap
from myomorph.morph.maps.linear import AffineMap
from myomorph.morph.shapes.surface_points import Shape
from myomorph.morph.species.counterparts import PlacedMap, Posed, SpeciesTable
from myomorph.morph.species.table_rows import Attachment


def with_attachments(
    source: Model, bones: Mapping[str, BoneMap], attachments: Sequence[Attachment], table: SpeciesTable, there: Posed
) -> tuple[Model, Mapping[str, BoneMap], tuple[str, ...]]:
    """The source with a body for each point that is moved, the maps of all, and what was moved, in lines.

    A point whose path would then go back and forth along that bone stays where the map puts it.

    Raises
    ------
    BadData : a bone that has no two joints among its landmarks
    """
    muscles = {one.name: one for one in source.muscles}
    found = dict(bones)
    bodies, joints, kept, moved = [], [], [], 0
    for each in attachments:
        if each.body not in bones:
            continue
        start, way = _shaft(each.body, table, bones[each.body], there)
        for name in each.muscles:
            muscle = muscles.get(name)
            index = 0 if each.end == "first" else -1
            point = None if muscle is None else muscle.path.points[index]
            if muscle is None or not isinstance(point, PathPoint) or point.body != each.body:
                continue
            part = f"{each.body} {name} {each.end}"
            made = _shifted(bones[each.body], part, point.location, start, way, each.along)
            if _doubles_back(muscle, each, bones[each.body], made, way):
                kept.append(name)
                continue
            found[part] = made
            points = list(muscle.path.points)
            points[index] = replace(point, body=part)
            muscles[name] = replace(muscle, path=replace(muscle.path, points=tuple(points)))
            bodies.append(Body(part, 0.0, np.zeros(3), np.zeros((3, 3))))
            joints.append(Joint(part, "WeldJoint", each.body, part, Transform.identity(), Transform.identity()))
            moved += 1
    notes = []
    if moved:
        by = ", ".join(dict.fromkeys(one.citation for one in attachments if one.citation))
        notes.append(f"{moved} attachments lie along their bones where {by or 'the species table'} has them")
    if kept:
        notes.append(f"attachments stay where the map has them, as paths would double back: {', '.join(kept)}")
    changed = replace(
        source,
        bodies=(*source.bodies, *bodies),
        joints=(*source.joints, *joints),
        muscles=tuple(muscles[one.name] for one in source.muscles),
    )
    return changed, found, tuple(notes)


def _shaft(body: str, table: SpeciesTable, bone: BoneMap, there: Posed) -> tuple[Array, Array]:
    """Proximal joint (3,) in the target's body, and the way from there to the distal one [m]."""
    pair = next((one for one in table.bones if body in one.sources), None)
    rules = () if pair is None else tuple(rule for rule in pair.landmarks if rule.rule == "joint")
    if len(rules) < 2:
        raise BadData(f"attachments on '{body}': its landmarks have no two joints to measure along")
    joints = there.joints(bone.target_body)
    first, last = (joints[rule.target_joint] for rule in rules[:2])
    return first, last - first


def _shifted(bone: BoneMap, part: str, point: Array, start: Array, way: Array, along: float) -> BoneMap:
    """The bone's map for one point, which goes so far along the shaft and back onto the surface."""
    here = bone.map.apply(point)
    share = float((here - start) @ way / (way @ way))
    goal = here + (along - share) * way
    if bone.target is not None and len(bone.target.faces):
        goal = Shape(bone.target).closest(goal[None])[0][0]
    shift = AffineMap(np.eye(3), goal - here)
    whole = replace(bone.whole, translation=bone.whole.translation + goal - here)
    return replace(bone, body=part, map=PlacedMap(Transform.identity(), bone.map, shift), whole=whole)


def _doubles_back(muscle: Muscle, each: Attachment, bone: BoneMap, made: BoneMap, way: Array) -> bool:
    """Whether the path's next point on that bone would lie on the other side along it than before."""
    points = muscle.path.points if each.end == "first" else muscle.path.points[::-1]
    if len(points) < 2 or points[1].body != each.body or not all(isinstance(one, PathPoint) for one in points[:2]):
        return False
    end, after = (one.location for one in points[:2] if isinstance(one, PathPoint))
    next_to = bone.map.apply(after)
    before, now = (next_to - one.map.apply(end) for one in (bone, made))
    return bool((before @ way) * (now @ way) < 0.0)
