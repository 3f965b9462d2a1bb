"""Attachments that differ between orders of mammals, from a relative's anatomy.

A map of bones takes a point to where the same shape is, but muscles wander over bones between
orders of mammals: a rodent's vasti begin at the hip, man's half way to the knee. A species table
has the landmarks and attachments of a relative of the target; its attachments go through its
landmarks to the target's bone, onto the surface.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np

from myomorph.bones.morph.maps.fields import BoneMap, FeaturePoints, MapOptions, fit_map
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData
from myomorph.core.model.model import Body, Joint, Model
from myomorph.core.model.paths import Muscle, PathPoint
from myomorph.core.model.spatial import Transform
from myomorph.core.surfaces.surface_points import Shape

MIN_COUNT = 4  # Landmarks that a relative's bone needs in common with the target's.
Point: TypeAlias = tuple[float, float, float]


@dataclass(frozen=True)
class Attachment:
    """Where muscles begin or end on a bone of a relative."""

    muscles: tuple[str, ...]  # of the source; all go to the same place
    end: Literal["first", "last"]  # "first" or "last" point of their paths
    at: Point  # in the frame of the relative's bone [m]

    def __post_init__(self) -> None:
        if self.end not in ("first", "last"):
            raise BadData(
                f"attachment of {', '.join(self.muscles)}: end is '{self.end}': expected first or"
                " last"
            )
        if len(self.at) != 3:
            raise BadData(
                f"attachment of {', '.join(self.muscles)}: expected three numbers at 'at'"
            )


@dataclass(frozen=True, eq=False)
class RelativeBone:
    """Landmarks and attachments on a bone of a relative of the target."""

    body: str  # of the source, whose bone corresponds
    # by the names of that bone's rules, in a frame of the relative's bone [m]
    landmarks: Mapping[str, Point]
    attachments: tuple[Attachment, ...]  # in the same frame
    citation: str = ""  # whose

    def __post_init__(self) -> None:
        wrong = [name for name, at in self.landmarks.items() if len(at) != 3]
        if wrong:
            raise BadData(f"relative's '{self.body}': expected three numbers at '{wrong[0]}'")


def with_attachments(
    source: Model, bones: Mapping[str, BoneMap], relatives: Sequence[RelativeBone]
) -> tuple[Model, Mapping[str, BoneMap], tuple[str, ...]]:
    """Add a body to the source for each point that is moved.

    Returns the source, the maps of all, and what was moved, in lines. A point whose path would then
    go back and forth along that bone stays where the map puts it.
    """
    muscles = {muscle.name: muscle for muscle in source.muscles}
    result = dict(bones)
    parts: list[tuple[str, str]] = []
    kept: list[str] = []
    for relative in relatives:
        bone = bones.get(relative.body)
        if bone is None:
            continue
        # How surely the attachment is known is not known.
        features = None if bone.features is None else replace(bone.features, radii=None)
        for each, goal in zip(relative.attachments, _places(relative, bone), strict=True):
            index = 0 if each.end == "first" else -1
            for name in each.muscles:
                point = muscles[name].path.points[index] if name in muscles else None
                if not isinstance(point, PathPoint) or point.body != relative.body:
                    continue
                if _doubles_back(muscles[name], each, bone, goal):
                    kept.append(name)
                    continue
                part = f"{relative.body} {name} {each.end}"
                parts.append((part, relative.body))
                moved = bone.shifted(goal - bone.map.apply(point.location))
                result[part] = replace(moved, body=part, features=features)
                muscles[name] = _with_end(muscles[name], index, replace(point, body=part))
    notes = _notes(len(parts), kept, relatives)
    return with_parts(source, parts, list(muscles.values())), result, notes


def _notes(count: int, kept: Sequence[str], relatives: Sequence[RelativeBone]) -> tuple[str, ...]:
    """Report how many attachments were moved, and muscles of which they were kept."""
    notes = []
    if count:
        citations = (relative.citation for relative in relatives if relative.citation)
        by = ", ".join(dict.fromkeys(citations))
        notes.append(
            f"{count} attachments lie on their bones where {by or 'the species table'} has them"
        )
    if kept:
        notes.append(
            "attachments stay where the map has them, as paths would double back:"
            f" {', '.join(kept)}"
        )
    return tuple(notes)


def with_parts(source: Model, parts: Sequence[tuple[str, str]], muscles: Sequence[Muscle]) -> Model:
    """Add weightless bodies to the source, and muscles.

    Each body has its name and the body that it is fixed to.
    """
    still = Transform.identity()
    return replace(
        source,
        bodies=(
            *source.bodies,
            *(
                Body(name=part, mass=0.0, mass_center=np.zeros(3), inertia=np.zeros((3, 3)))
                for part, _ in parts
            ),
        ),
        joints=(
            *source.joints,
            *(
                Joint(
                    name=part,
                    kind="WeldJoint",
                    parent=body,
                    child=part,
                    parent_frame=still,
                    child_frame=still,
                )
                for part, body in parts
            ),
        ),
        muscles=tuple(muscles),
    )


def straightened(source: Model, names: Sequence[str]) -> Model:
    """Keep only the first and last points of some muscles' paths, which wrap around nothing."""
    return replace(
        source,
        muscles=tuple(
            (
                replace(
                    muscle,
                    path=replace(
                        muscle.path,
                        points=(muscle.path.points[0], muscle.path.points[-1]),
                        wraps=(),
                    ),
                )
                if muscle.name in names
                else muscle
            )
            for muscle in source.muscles
        ),
    )


def _with_end(muscle: Muscle, index: int, point: PathPoint) -> Muscle:
    """Give a muscle another first (0) or last (-1) point."""
    points = list(muscle.path.points)
    points[index] = point
    return replace(muscle, path=replace(muscle.path, points=tuple(points)))


def _places(relative: RelativeBone, bone: BoneMap) -> Array:
    """(attachments, 3) on the target's bone, in its body's frame [m]."""
    marks = bone.features
    theirs = {} if marks is None else dict(zip(marks.names, marks.target, strict=True))
    names = tuple(name for name in relative.landmarks if name in theirs)
    if len(names) < MIN_COUNT:
        raise BadData(
            f"relative's '{relative.body}': {len(names)} landmarks in common with the target's bone"
            f" ({', '.join(names)}): expected four or more"
        )
    pairs = FeaturePoints(
        names,
        np.array([relative.landmarks[name] for name in names]),
        np.array([theirs[name] for name in names]),
    )
    goals = fit_map(pairs, MapOptions("affine")).apply(
        np.array([attachment.at for attachment in relative.attachments])
    )
    if bone.target is not None and len(bone.target.faces):
        goals = Shape(bone.target).closest(goals)[0]
    return goals


def _doubles_back(muscle: Muscle, each: Attachment, bone: BoneMap, goal: Array) -> bool:
    """Return whether the path doubles back at the attachment.

    Its next point on that bone would lie the other way from the attachment than before.
    """
    points = muscle.path.points if each.end == "first" else muscle.path.points[::-1]
    ends = [
        point
        for point in points[:2]
        if isinstance(point, PathPoint) and point.body == points[0].body
    ]
    if len(ends) < 2:
        return False
    before_end, after_end = ends
    before = bone.map.apply(before_end.location)
    after = bone.map.apply(after_end.location)
    return bool((after - before) @ (after - goal) < 0.0)
