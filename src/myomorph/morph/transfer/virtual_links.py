"""Virtual links: bodies without a bone on which muscles branch, mapped by the bones around them ([D] chapter 2).

Where the bones' maps put a branching point, its lines of action need not hold it: it is moved to where their tensions
balance.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.errors import BadData, check_name
from myomorph.model.frozen_map import FrozenMap
from myomorph.model.model import GROUND, Model
from myomorph.model.spatial import Transform
from myomorph.morph.maps.fields import BoneMap, FeaturePoints, fit_map, neighbors_of
from myomorph.morph.maps.linear import procrustes
from myomorph.morph.transfer.body_transfer import Transfer, Transfers
from myomorph.morph.transfer.branch_points import BranchLoad, Riders, branch_load, branch_places, riders_of
from myomorph.muscles.kinematics import default_path_lengths

FEATURES = 60  # Of each bone around a virtual link count, spread over those it has.


def bones_around(
    model: Model, bones: Mapping[str, BoneMap], stated: Mapping[str, Sequence[str]] | None = None
) -> dict[str, tuple[str, ...]]:
    """The bones that surround each virtual link: those given, and those found in the tree. A body is taken for a
    virtual link where it has muscle points, but neither a mesh nor a bone of the target, and lies between at least two
    bones.
    """
    result: dict[str, tuple[str, ...]] = {}
    for link, around in (stated or {}).items():
        for name in (link, *around):
            check_name("body", name, model.body_names)
        missing = [name for name in around if name not in bones]
        if missing or len(around) < 2:
            raise BadData(
                f"virtual link '{link}' needs at least two bones around it, but got {list(around)}"
                + (f", of which {missing} have no map" if missing else "")
            )
        result[link] = tuple(around)
    used = {point.body for muscle in model.muscles for point in muscle.path.points}
    for body in model.bodies:
        if body.name in used and body.name not in bones and body.name not in result and not body.meshes:
            around = _nearest_bones(model, body.name, bones)
            if len(around) > 1:
                result[body.name] = around
    return result


def _nearest_bones(model: Model, body: str, bones: Mapping[str, BoneMap]) -> tuple[str, ...]:
    """Bones that are reached from a body through the tree without passing another."""
    ties = neighbors_of(model)
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
    transfers: Transfers,
    source: Mapping[str, Transform],
    target: Mapping[str, Transform],
) -> BoneMap:
    """The map of a virtual link, whose points are fixed to `there`, from the features of the bones around it, each
    where it lies in one posture of both models.
    """
    names: list[str] = []
    before, after = [], []
    for bone in around:
        features = _features(transfers, bone)
        names += [f"{bone} {name}" for name in features.names]
        before.append((source[link].inverse() @ source[bone]).apply(features.source))
        after.append((target[there].inverse() @ target[transfers[bone].body]).apply(features.target))
    features = FeaturePoints(tuple(names), np.concatenate(before), np.concatenate(after))
    return BoneMap(
        link,
        there,
        fit_map(features),
        procrustes(features.source, features.target, True),
        "surrounding",
        features=features,
        notes=(f"mapped by {len(features)} features of {', '.join(around)}",),
    )


def _features(transfers: Transfers, bone: str) -> FeaturePoints:
    """Features of a bone, at most `FEATURES`; of a bone that has none, points of it and where they go."""
    features = transfers[bone].bone.features
    if features is None or len(features) < 3:
        places = transfers[bone].samples
        features = FeaturePoints(tuple(str(i) for i in range(len(places))), places, transfers[bone].points(places))
    chosen = np.unique(np.linspace(0, len(features) - 1, min(FEATURES, len(features))).round().astype(int))
    return features.at(chosen)


FURTHEST = 0.25  # A branching point is moved no further than by this share of the mean length of its lines of action.
PASSES = 20  # Of moving several links, which may pull at each other.
SETTLED = 1e-7  # Links rest that move by less [m].


def link_carriers(
    links: Mapping[str, Sequence[str]],
    transfers: Transfers,
    source: Mapping[str, Transform],
    target: Mapping[str, Transform],
    targets: Mapping[str, str],
) -> dict[str, Transfer]:
    """Transfers of virtual links onto `targets`, by the bones around each as they lie in a pose of both models."""
    return {
        link: Transfer(surrounded_map(link, targets[link], around, transfers, source, target), targets[link])
        for link, around in links.items()
    }


def balanced_links(
    source: Model, links: Mapping[str, Sequence[str]], transfers: Transfers, transferred: Callable[[Transfers], Model]
) -> dict[str, Transfer]:
    """The transfers, those of links moved to where their line tensions balance in the target as in the source, both in
    the posture in which bones are compared; `transferred`: the target with the source's muscles.
    """
    result = dict(transfers)
    branches = {link: riders_of(source, link).points for link in links}
    strong = {muscle.name for muscle in source.muscles if muscle.max_isometric_force > 0.0}
    loads = {link: branch_load(source, link) for link, names in branches.items() if names and strong >= names.keys()}
    moved = dict.fromkeys(loads, np.zeros(3))
    rests = dict.fromkeys(loads, True)
    for _ in range(PASSES):
        target, furthest = transferred(result), 0.0
        for link, load in loads.items():
            there = result[link]
            shift, rests[link] = _to_balance(source, target, there, load)
            moved[link] = moved[link] + shift
            result[link] = Transfer(there.bone.shifted(shift), there.body)
            furthest = max(furthest, float(np.linalg.norm(shift)))
        if furthest < SETTLED or len(loads) < 2:
            break
    lengths = dict(zip(source.muscle_names, default_path_lengths(source), strict=True))
    for link, load in loads.items():
        size = transfers[link].size * float(np.mean([lengths[name] for name in load.muscles]))
        away = float(np.linalg.norm(moved[link]))
        kept = rests[link] and away <= FURTHEST * size
        result[link] = _with_balance(result[link] if kept else transfers[link], load, away, kept)
    return result


def link_notes(bones: Mapping[str, BoneMap]) -> list[str]:
    """One line on each thing to know of a virtual link."""
    return [
        f"virtual link '{body}': {note}"
        for body, bone in bones.items()
        if bone.basis == "surrounding"
        for note in bone.notes
    ]


def _to_balance(source: Model, target: Model, there: Transfer, load: BranchLoad) -> tuple[Array, bool]:
    """(3,) how far the link's points have to move in the target body's frame [m], and whether they can rest there."""
    link_riders = riders_of(source, load.link)
    known = frozenset(item.name for item in target.wrap_objects)
    # On a body of its own everything rides that the body has; on another's only what came from the link.
    riders = (
        riders_of(target, there.body)
        if there.body == load.link
        else Riders(link_riders.points, link_riders.wraps & known, {})
    )
    if not set(load.muscles) <= set(target.muscle_names):
        return np.zeros(3), False
    turned = replace(load, link=there.body, rest=there.rotation @ load.rest)
    places, balanced = branch_places(target, turned, riders=riders)
    return (places[0], True) if balanced[0] else (np.zeros(3), False)


def _with_balance(transfer: Transfer, load: BranchLoad, away: float, kept: bool) -> Transfer:
    """The transfer with what is to be known of its balance in measures and notes."""
    tensions = f"the tensions of its {len(load.muscles)} lines of action"
    rest = f"{100.0 * load.share:.0f} % of them is held by no line of action, in the source too"
    if kept:
        note = f"moved by {1e3 * away:.2g} mm to where {tensions} balance ({rest})"
    else:
        note = f"left where its bones put it, as {tensions} balance nowhere near ({rest})"
    measures = {"moved to balance [m]": away if kept else 0.0, "held by no line of action": load.share}
    bone = transfer.bone
    return Transfer(
        replace(bone, measures=FrozenMap({**bone.measures, **measures}), notes=(*bone.notes, note)), transfer.body
    )
