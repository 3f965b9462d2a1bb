"""Digits: a tendon belongs to one ray, from its metatarsal to its toe.

It passes their joint on its own side. A source whose toes are one body does not show which toe a
tendon goes to, and on a small foot the nearest toe is another one for every point. So a species
table names the ray of each muscle, and whether it extends or flexes. What lies on the toes, or
beside their joint on the foot, goes to that ray: about the joint, along the ray, in the size of its
toe. Extensors stay dorsal of the joint by half of the toe's thickness, flexors plantar; the foot's
points stay behind it and the toe's in front (a source whose via points lie beyond the joint has the
signs of its moment arms wrong there: Rajagopal's long extensor of the toes flexes them).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from myomorph.bones.morph.maps.fields import BoneMap
from myomorph.bones.morph.species.attachments import with_parts
from myomorph.bones.morph.species.counterparts import (
    BoneHomology,
    Posed,
    Ray,
    SpeciesTable,
    part_name,
)
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData, UnknownName, check_name
from myomorph.core.model.model import Joint, Model
from myomorph.core.model.paths import Muscle, PathPoint
from myomorph.core.surfaces.linear_maps import Similarity

# A toe of the source is what lies within this share of the bone's width beside the muscles' points.
BESIDE = 0.2
REACH = 0.4
"""Points of the foot within this share of the toe's length from the joint go to the ray; others go
with the foot.
"""

AT_JOINT = 0.25  # A toe's thickness is taken over this share of its length next to the joint.
CLEAR = 0.1  # Points keep this share of the toe's length from the joint, along the ray.
# A joint's axis with this much of the direction to the right tells where the joint is on each toe.
OBLIQUE = 0.5


@dataclass(frozen=True, eq=False)
class Rays:
    """What the rays of one bone make of a source."""

    source: Model  # with a body for each part of a ray, and the muscles' points on them
    bones: Mapping[str, BoneMap]  # maps of these bodies


@read_only
class SidedMap:
    """A similarity whose points stay on one side of a joint.

    Along a ray they lie at least `ahead`, dorsal at least `above`.
    """

    whole: Similarity  # the similarity
    center: Array  # (3,) of the joint, in the target body [m]
    # along, dorsal: (3,) unit vectors away from the joint on this body, and to the side of the
    # tendon
    along: Array
    dorsal: Array
    # ahead, above: distances [m]
    ahead: float
    above: float

    def apply(self, points: ArrayLike) -> Array:
        """Map points of the source's frame into the target's.

        Parameters
        ----------
        points : (..., 3) in the source's frame [m]

        Returns
        -------
        (..., 3) in the target's frame [m]
        """
        result = self.whole.apply(points)
        for axis, least in ((self.along, self.ahead), (self.dorsal, self.above)):
            lacking = np.maximum(least - (result - self.center) @ axis, 0.0)
            result = result + lacking[..., None] * axis
        return result

    def jacobian(self, points: ArrayLike) -> Array:
        """Return the derivatives of the mapped points with the points.

        Parameters
        ----------
        points : (..., 3) in the source's frame [m]

        Returns
        -------
        (..., 3, 3) derivatives [m/m]
        """
        at = self.whole.apply(points) - self.center
        result = np.broadcast_to(self.whole.scale * self.whole.rotation, (*at.shape, 3)).copy()
        for axis, least in ((self.along, self.ahead), (self.dorsal, self.above)):
            held = (at @ axis < least)[..., None, None]
            result -= held * (axis[:, None] @ (axis @ result)[..., None, :])
        return result


def put_on_rays(
    source: Model, bone: BoneHomology, table: SpeciesTable, posed: tuple[Posed, Posed]
) -> Rays:
    """Put the muscles of a bone's rays on them.

    What else lies on that bone is left as it is. `bone`: with rays; its first source is the toes,
    whose parent in the source is the foot; `posed`: source and target.
    """
    toes = bone.sources[0]
    joint = next((candidate for candidate in source.joints if candidate.child == toes), None)
    if joint is None:
        raise UnknownName("body", toes, source.body_names)
    new = []
    maps = {}
    moved = {muscle.name: muscle for muscle in source.muscles}
    for ray in bone.rays:
        for name in (ray.toe, ray.metatarsal):
            check_name("body", name, posed[1].model.body_names)
        for muscles, side in ((ray.extensors, "dorsal"), (ray.flexors, "plantar")):
            points = _points(source, muscles, (toes, joint.parent), posed[0], toes)
            if not points:
                continue
            laid = _Laid(
                bone, ray, table, posed, joint, np.array([place for _, place in points.values()])
            )
            near = {key for key, (body, place) in points.items() if laid.owns(body, place)}
            parts = {}
            for body, target in ((toes, ray.toe), (joint.parent, ray.metatarsal)):
                part = parts[body] = f"{part_name(body, target)} {side}"
                maps[part] = replace(laid.map_of(body, target, side), body=part)
                new.append((part, body))
            for name in muscles:
                if name in moved:
                    moved[name] = _on_parts(moved[name], parts, near)
    return Rays(with_parts(source, new, list(moved.values())), maps)


def _points(
    source: Model, muscles: Sequence[str], bodies: Sequence[str], here: Posed, toes: str
) -> dict[tuple[str, str], tuple[str, Array]]:
    """By muscle and point: its body, and its place in the toes' frame [m]."""
    return {
        (muscle.name, point.name): (point.body, here.within(point.body, toes).apply(point.location))
        for muscle in source.muscles
        if muscle.name in muscles
        for point in muscle.path.points
        if isinstance(point, PathPoint) and point.body in bodies
    }


def _on_parts(muscle: Muscle, parts: Mapping[str, str], near: set[tuple[str, str]]) -> Muscle:
    points = tuple(
        replace(point, body=parts[point.body])
        if (muscle.name, point.name) in near and point.body in parts
        else point
        for point in muscle.path.points
    )
    return replace(muscle, path=replace(muscle.path, points=points))


class _Laid:
    """A ray of the target beside the source's toe.

    `knuckle`: (3,) where the source's joint is on that toe, in the toes' frame [m]; `forward`: (3,)
    along the source's toes; `length`: of the source's toe from the joint [m].
    """

    def __init__(
        self,
        bone: BoneHomology,
        ray: Ray,
        table: SpeciesTable,
        posed: tuple[Posed, Posed],
        joint: Joint,
        points: Array,
    ):
        self._bone = bone
        self._ray = ray
        self._posed = posed
        here, there = posed
        self._ours, self._theirs = table.frames(bone)
        self._toes = bone.sources[0]
        if ray.toe not in there.surfaces or self._toes not in here.surfaces:
            raise BadData(f"ray {ray.toe}: it or '{self._toes}' has no bone to measure it by")
        self.forward = self._ours.axes[1]
        right = self._ours.axes[2]
        center = joint.child_frame.translation
        beside = float(np.median((points - center) @ right))
        turns = next(
            (axis.vector for axis in joint.axes if axis.kind == "rotation" and axis.coordinates),
            right,
        )
        axis = joint.child_frame.rotation @ turns
        if abs(axis @ right) < OBLIQUE * np.linalg.norm(axis):
            axis = right
        self.knuckle = center + beside / float(axis @ right) * axis
        vertices = here.surfaces[self._toes].vertices
        across = (vertices - self.knuckle) @ right
        alike = np.abs(across) < BESIDE * np.ptp(across)
        toe = vertices[alike] if alike.any() else vertices
        self.length = float(((toe - self.knuckle) @ self.forward).max())
        joint_of_toe = there.joints(ray.toe)[ray.toe]
        bones = there.surfaces[ray.toe].vertices - joint_of_toe
        self._tip = bones[int(np.argmax(np.linalg.norm(bones, axis=1)))]
        self._size = float(np.linalg.norm(self._tip)) / self.length
        axes = _axes(
            self._tip, there.within(bone.targets[0], ray.toe).rotation @ self._theirs.axes[2]
        )
        next_to = np.abs(bones @ axes[1]) < AT_JOINT * np.linalg.norm(self._tip)
        self._half = 0.5 * float(np.ptp(bones[next_to] @ axes[0]))

    def owns(self, body: str, place: Array) -> bool:
        """Return whether a point (3,) [m] is on the toes, or beside their joint on the foot."""
        beside = abs((place - self.knuckle) @ self.forward) <= REACH * self.length
        return body == self._toes or bool(beside)

    def map_of(self, body: str, target: str, side: str) -> BoneMap:
        """Return the map of toes or foot to the ray's toe or metatarsal."""
        here, there = self._posed
        knuckles = there.joints(target)
        joint = knuckles[self._ray.toe]
        on_toe = body == self._toes
        along = self._tip if on_toe else joint - knuckles[self._ray.metatarsal]
        axes = _axes(
            along, there.within(self._bone.targets[0], target).rotation @ self._theirs.axes[2]
        )
        turn = axes.T @ self._ours.axes @ here.within(body, self._toes).rotation
        start = here.within(self._toes, body).apply(self.knuckle)
        whole = Similarity(turn, joint - self._size * turn @ start, self._size)
        dorsal = axes[0] if side == "dorsal" else -axes[0]
        ahead = CLEAR * self._size * self.length
        sided = SidedMap(
            whole=whole,
            center=joint,
            along=axes[1] if on_toe else -axes[1],
            dorsal=dorsal,
            ahead=ahead,
            above=self._half,
        )
        return BoneMap(
            body=body,
            target_body=target,
            map=sided,
            whole=whole,
            basis="given",
            overall=whole.scale * whole.rotation,
            source=here.surfaces.get(body),
            target=there.surfaces.get(target),
        )


def _axes(along: Array, right: Array) -> Array:
    """Return (3, 3) rows proximal (here dorsal), anterior (along the ray) and right.

    Their determinant is -1.
    """
    anterior = along / np.linalg.norm(along)
    side = right - anterior * (right @ anterior)
    side /= np.linalg.norm(side)
    return np.stack([np.cross(side, anterior), anterior, side])
