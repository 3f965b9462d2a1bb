"""Virtual links: bodies without a bone on which muscles branch, mapped by the bones around them ([D] chapter 2)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from myomorph.model.errors import BadData, UnknownName
from myomorph.model.model import GROUND, Model
from myomorph.model.series import Motion
from myomorph.model.spatial import Transform
from myomorph.morph.bone_map import BoneMap
from myomorph.morph.carrier import Carriers
from myomorph.morph.fields import FeaturePoints, MapOptions, fit_map
from myomorph.morph.procrustes import procrustes
from myomorph.rigid.kinematics import forward_kinematics
from myomorph.rigid.tree import compile_tree

FEATURES = 60
"""Of each bone around a virtual link count, spread over those it has."""


def bones_around(
    model: Model, bones: Mapping[str, BoneMap], given: Mapping[str, Sequence[str]] | None = None
) -> dict[str, tuple[str, ...]]:
    """The bones that surround each virtual link: those given, and those found in the tree.

    A body is taken for a virtual link where it has muscle points, but neither a mesh nor a bone of the target, and lies
    between at least two bones.

    Raises
    ------
    UnknownName : a body that the model does not have
    BadData : a bone that has no map, or fewer than two of them
    """
    found: dict[str, tuple[str, ...]] = {}
    for link, around in (given or {}).items():
        for name in (link, *around):
            if name not in model.body_names:
                raise UnknownName("body", name, model.body_names)
        missing = [name for name in around if name not in bones]
        if missing or len(around) < 2:
            raise BadData(
                f"virtual link '{link}' needs at least two bones around it, but got {list(around)}"
                + (f", of which {missing} have no map" if missing else "")
            )
        found[link] = tuple(around)
    used = {point.body for muscle in model.muscles for point in muscle.path.points}
    for body in model.bodies:
        if body.name in used and body.name not in bones and body.name not in found and not body.meshes:
            around = _nearest_bones(model, body.name, bones)
            if len(around) > 1:
                found[body.name] = around
    return found


def _nearest_bones(model: Model, body: str, bones: Mapping[str, BoneMap]) -> tuple[str, ...]:
    """Bones that are reached from a body through the tree without passing another."""
    ties: dict[str, list[str]] = {name: [] for name in (GROUND, *model.body_names)}
    for joint in model.joints:
        ties[joint.parent].append(joint.child)
        ties[joint.child].append(joint.parent)
    reached: list[str] = []
    open_, seen = [body], {body, GROUND}
    while open_:
        for name in ties[open_.pop(0)]:
            if name in seen:
                continue
            seen.add(name)
            (reached if name in bones else open_).append(name)
    return tuple(reached)


def surrounded_map(
    link: str,
    there: str,
    around: Sequence[str],
    carriers: Carriers,
    source: Mapping[str, Transform],
    target: Mapping[str, Transform],
    options: MapOptions | None = None,
) -> BoneMap:
    """The map of a virtual link from the features of several bones, each where it lies in one posture.

    Parameters
    ----------
    there : the target body that the link's points are fixed to
    carriers : of the bones around it
    source, target : poses of bodies in ground, of both models
    """
    names: list[str] = []
    before, after = [], []
    for bone in around:
        features = _features(carriers, bone)
        names += [f"{bone} {name}" for name in features.names]
        before.append((source[link].inverse() @ source[bone]).apply(features.source))
        after.append((target[there].inverse() @ target[carriers[bone].body]).apply(features.target))
    features = FeaturePoints(tuple(names), np.concatenate(before), np.concatenate(after))
    return BoneMap(
        link,
        there,
        fit_map(features, options),
        procrustes(features.source, features.target, True),
        "surrounding",
        features=features,
        notes=(f"mapped by {len(features)} features of {', '.join(around)}",),
    )


def standing_poses(model: Model, values: Mapping[str, float] | None = None) -> dict[str, Transform]:
    """Poses in ground of all bodies and of the ground at given coordinates, the others at their defaults."""
    tree = compile_tree(model)
    values = values or {}
    posture = Motion(np.zeros(1), tuple(values), np.array([list(values.values())], dtype=np.float64).reshape(1, -1))
    poses = forward_kinematics(tree, tree.coordinates_of(posture))
    return {body: Transform(poses.rotations[0, i], poses.origins[0, i]) for body, i in tree.body_index.items()}


def _features(carriers: Carriers, bone: str) -> FeaturePoints:
    """Features of a bone, at most `FEATURES`; of a bone that has none, points of it and where they go."""
    given = carriers[bone].bone.features
    if given is None or len(given) < 3:
        places = carriers[bone].samples
        given = FeaturePoints(tuple(str(i) for i in range(len(places))), places, carriers[bone].points(places))
    chosen = np.unique(np.linspace(0, len(given) - 1, min(FEATURES, len(given))).round().astype(int))
    return FeaturePoints(tuple(given.names[i] for i in chosen), given.source[chosen], given.target[chosen])
