"""Bodies of two species in their postures: what rides on a bone, and bones that are several in the other species."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from myomorph.model.arrays import Array
from myomorph.model.errors import BadData, UnknownName
from myomorph.model.model import Body, Joint, Model
from myomorph.model.paths import Muscle, PathPoint
from myomorph.model.series import Motion
from myomorph.model.spatial import Transform
from myomorph.model.surface import Surface
from myomorph.morph.affine import AffineMap
from myomorph.morph.bone_map import BoneMap
from myomorph.morph.fields import PointMap
from myomorph.morph.procrustes import Similarity
from myomorph.morph.species import BoneHomology
from myomorph.morph.surface_points import Shape
from myomorph.rigid.kinematics import forward_kinematics
from myomorph.rigid.tree import compile_tree

Surfaces = Mapping[str, Surface]


@dataclass(frozen=True, eq=False)
class PlacedMap:
    """A map with a rigid transform before it and an affine one after it: y = after(map(before(x)))."""

    before: Transform
    map: PointMap
    after: AffineMap

    def apply(self, points: ArrayLike) -> Array:
        """Points (..., 3) of the source's frame in the target's [m]."""
        return self.after.apply(self.map.apply(self.before.apply(points)))

    def jacobian(self, points: ArrayLike) -> Array:
        """Derivatives (..., 3, 3) of the mapped points."""
        inner = self.map.jacobian(self.before.apply(points))
        found: Array = self.after.matrix @ inner @ self.before.rotation
        return found


class Posed:
    """A model in one posture: where bodies and joints are.

    Raises
    ------
    UnknownName : a coordinate of the posture that the model lacks
    """

    def __init__(self, model: Model, posture: Mapping[str, float]):
        for name in posture:
            model.coordinate(name)
        tree = compile_tree(model)
        at = Motion(np.zeros(1), tuple(posture), np.array([list(posture.values())], dtype=np.float64).reshape(1, -1))
        poses = forward_kinematics(tree, tree.coordinates_of(at).astype(np.float64))
        self.model = model
        self._pose = {
            name: Transform(poses.rotations[0, i], poses.origins[0, i]) for name, i in tree.body_index.items()
        }

    def within(self, body: str, other: str) -> Transform:
        """Pose of one body in another's frame."""
        for name in (body, other):
            if name not in self._pose:
                raise UnknownName("body", name, self.model.body_names)
        return self._pose[other].inverse() @ self._pose[body]

    def joints(self, body: str) -> dict[str, Array]:
        """Centers (3,) of all joints, by the body that hangs on them, in a body's frame [m]."""
        return {
            joint.child: self.within(joint.child, body).apply(joint.child_frame.translation)
            for joint in self.model.joints
        }

    def surface(self, bodies: tuple[str, ...], surfaces: Surfaces) -> Surface:
        """Surfaces of several bodies as one, in the frame of the first.

        Raises
        ------
        BadData : none of them has a surface
        """
        vertices, faces, count = [], [], 0
        for body in bodies:
            if body in surfaces:
                vertices.append(self.within(body, bodies[0]).apply(surfaces[body].vertices))
                faces.append(surfaces[body].faces + count)
                count += len(vertices[-1])
        if not vertices:
            raise BadData(f"no surface of {' or '.join(bodies)}: give the bone's mesh")
        return Surface(np.vstack(vertices), np.vstack(faces))


def riders(bone: BoneMap, pair: BoneHomology, here: Posed) -> dict[str, BoneMap]:
    """The map of the first body, and those of the bodies that are one bone with it or ride on it."""
    found = {bone.body: bone}
    for name in (*pair.sources[1:], *pair.carried):
        if name in here.model.body_names:
            found[name] = _moved(bone, name, here.within(name, bone.body))
    return found


def _moved(bone: BoneMap, body: str, pose: Transform) -> BoneMap:
    """The map of what is fixed at a pose of a bone's source body."""
    whole = bone.whole
    back = pose.inverse()
    marks = bone.features
    return replace(
        bone,
        body=body,
        map=PlacedMap(pose, bone.map, AffineMap(np.eye(3), np.zeros(3))),
        whole=Similarity(whole.rotation @ pose.rotation, whole.apply(pose.translation), whole.scale),
        source=None if bone.source is None else Surface(back.apply(bone.source.vertices), bone.source.faces),
        features=None if marks is None else replace(marks, source=back.apply(marks.source)),
    )


def part_name(body: str, target: str) -> str:
    """Name of the part of a source body whose points go to one of several targets."""
    return f"{body}@{target}"


def seated(bone: BoneMap, body: str, pair: BoneHomology, number: int, there: Posed) -> BoneMap:
    """The map of a source body to another of its targets."""
    name = pair.targets[number]
    pose = there.within(pair.targets[0], name)
    after = AffineMap(pose.rotation, pose.translation)
    whole, marks, target = bone.whole, bone.features, bone.target
    return replace(
        bone,
        body=part_name(body, name),
        target_body=name,
        map=PlacedMap(Transform.identity(), bone.map, after),
        whole=Similarity(pose.rotation @ whole.rotation, pose.apply(whole.translation), whole.scale),
        target=None if target is None else Surface(pose.apply(target.vertices), target.faces),
        features=None if marks is None else replace(marks, target=pose.apply(marks.target)),
    )


def spread_points(
    source: Model,
    parts: Mapping[str, tuple[str, ...]],
    bones: Mapping[str, BoneMap],
    there: Posed,
    surfaces: Surfaces,
) -> Model:
    """The source with a body for every target that a body's muscle points go to."""
    shapes = {
        (targets[0], name): Shape(there.surface((targets[0], name), {name: surfaces[name]}))
        for targets in parts.values()
        for name in targets
        if name in surfaces
    }

    def nearest(body: str, place: Array) -> str:
        targets = parts[body]
        mapped = bones[body].map.apply(place)[None]
        known = [name for name in targets if (targets[0], name) in shapes]
        apart = [
            float(np.linalg.norm(shapes[targets[0], name].nearest(mapped, True).points - mapped)) for name in known
        ]
        best = known[int(np.argmin(apart))]
        return body if best == targets[0] else part_name(body, best)

    def carried(muscle: Muscle) -> Muscle:
        points = tuple(
            replace(one, body=nearest(one.body, one.location))
            if isinstance(one, PathPoint) and one.body in parts
            else one
            for one in muscle.path.points
        )
        return replace(muscle, path=replace(muscle.path, points=points))

    new = [(part_name(body, name), body) for body, targets in parts.items() for name in targets[1:]]
    bodies = tuple(Body(name, 0.0, np.zeros(3), np.zeros((3, 3))) for name, _ in new)
    still = Transform.identity()
    joints = tuple(Joint(name, "WeldJoint", body, name, still, still) for name, body in new)
    return replace(
        source,
        bodies=(*source.bodies, *bodies),
        joints=(*source.joints, *joints),
        muscles=tuple(carried(one) for one in source.muscles),
    )
