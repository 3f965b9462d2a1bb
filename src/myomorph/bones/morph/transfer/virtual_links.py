"""Virtual links: bodies without a bone on which muscles branch ([D] chapter 2).

They are mapped by the bones around them. Where the bones' maps put a branching point, its lines of
action need not hold it: it is moved to where their tensions balance.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy

from myomorph.bones.morph.maps.fields import BoneMap, FeaturePoints, fit_map, nearest_bones
from myomorph.bones.morph.transfer.body_transfer import Transfer, Transfers
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData, check_name
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.functions import linear
from myomorph.core.model.model import Axis, Body, Coordinate, Joint, Model
from myomorph.core.model.paths import Muscle, TendonWrap
from myomorph.core.model.series import DEFAULT_POSE, Motion
from myomorph.core.model.spatial import Transform
from myomorph.core.muscles.kinematics import default_path_lengths
from myomorph.core.muscles.model_paths import compile_paths
from myomorph.core.surfaces.linear_maps import procrustes

FREE = "free branch"
"""Of the names of the body and the coordinates that a branching point moves by while its balance is
looked for.
"""

MIN_SHARE = 0.1
MAX_SHARE = 10.0
"""Tensions may become so many times what equal activation gives, to hold the source's link in
balance.
"""

STIFF = 10.0  # How much more the balance counts than that tensions stay as they are.
ROUNDS = 60
# Newton's steps end when no point moves by more than this share of the length of its lines of
# action.
BALANCED = 1e-10
STEP = 1e-5  # Of the derivative of the forces, as a share of the lengths of the lines of action.
FLAT = 1e-4
"""A direction in which the stiffness of the lines of action is less than this share of the greatest
holds nothing.
"""


@dataclass(frozen=True)
class Riders:
    """What rides on a branching point."""

    points: Mapping[str, tuple[int, ...]]  # by muscle, the numbers of its path points
    wraps: frozenset[str]  # names of wrap objects
    # by muscle, the numbers of its wraps whose side site rides
    sides: Mapping[str, tuple[int, ...]]


@read_only
class BranchLoad:
    """What holds a branching point."""

    link: str  # the body
    muscles: tuple[str, ...]  # its lines of action
    tensions: Array  # (lines of action,) [N]
    rest: Array  # (3,) force that no line of action holds, in the link's frame [N]

    @property
    def share(self) -> float:
        """Of the line tensions, that they do not hold among themselves."""
        return float(np.linalg.norm(self.rest) / self.tensions.sum())


def riders_of(model: Model, link: str) -> Riders:
    """All that is fixed to a body and that muscle paths meet."""
    check_name("body", link, model.body_names)

    def of_muscles(parts: Callable[[Muscle], Iterable[str]]) -> Mapping[str, tuple[int, ...]]:
        riders = {
            muscle.name: tuple(index for index, body in enumerate(parts(muscle)) if body == link)
            for muscle in model.muscles
        }
        return FrozenMap({name: numbers for name, numbers in riders.items() if numbers})

    return Riders(
        of_muscles(lambda muscle: (point.body for point in muscle.path.points)),
        frozenset(item.name for item in model.wrap_objects if item.body == link),
        of_muscles(lambda muscle: (getattr(wrap, "side_body", "") for wrap in muscle.path.wraps)),
    )


def branch_load(model: Model, link: str) -> BranchLoad:
    """Return the tensions that hold a branching point `link` where the model has it.

    They are the nearest to those of equal activation.
    """
    freed = _FreeLink(model, link, riders_of(model, link))
    force = np.array([model.muscle(name).max_isometric_force for name in freed.muscles])
    if not len(force) or not np.all(force > 0.0):
        raise BadData(
            f"branching point '{link}': it needs muscles with a maximum isometric force above 0"
        )
    slopes = freed.slopes(np.zeros((1, 3)))[1][0]
    # The last of the stiff rows keeps the tensions' sum: less of all of them is no balance.
    rows = np.concatenate(
        [STIFF * np.vstack([slopes, np.ones(len(force))]) * force / force.sum(), np.eye(len(force))]
    )
    wanted = np.concatenate([np.zeros(3), [STIFF], np.ones(len(force))])
    tensions = force * scipy.optimize.lsq_linear(rows, wanted, (MIN_SHARE, MAX_SHARE)).x
    return BranchLoad(link=link, muscles=freed.muscles, tensions=tensions, rest=slopes @ tensions)


def branch_places(
    model: Model, load: BranchLoad, motion: Motion | None = None, riders: Riders | None = None
) -> tuple[Array, Array]:
    """Return how far a branching point moves until its lines of action balance.

    Source: [D] chapter 2, virtual links; the balance is that of a massless body (see
    docs/bone-maps.md).

    Parameters
    ----------
    model : with the link
    load : tensions of the lines of action, and what holds the point at rest
    motion : frames to balance in; the default pose by default
    riders : parts of the model that move with the link; by default all that the body has

    Returns
    -------
    (frames, 3) from where the model has it, in the link's frame, NaN where there is no balance [m],
    and (frames,) whether there is one
    """
    for name in load.muscles:
        check_name("muscle", name, model.muscle_names)
    riding = riders or riders_of(model, load.link)
    branches = {name: numbers for name, numbers in riding.points.items() if name in load.muscles}
    freed = _FreeLink(model, load.link, replace(riding, points=FrozenMap(branches)), motion)
    order = [load.muscles.index(name) for name in freed.muscles]
    tensions = load.tensions[order]
    moved = np.zeros((freed.frames, 3))
    size = float(np.mean(freed.slopes(moved)[0]))
    energy, force, stiffness = _state(freed, moved, tensions, load.rest, size)
    for _ in range(ROUNDS):
        step = _newton_step(force, stiffness, 0.25 * size)
        share = np.ones(len(moved))
        for _ in range(12):
            trial = _state(freed, moved + share[:, None] * step, tensions, load.rest, size)
            worse = trial[0] > energy + 1e-14 * np.abs(energy)
            if not worse.any():
                break
            share = np.where(worse, 0.5 * share, share)
        step = np.where(worse, 0.0, share)[:, None] * step
        moved = moved + step
        energy, force, stiffness = _state(freed, moved, tensions, load.rest, size)
        if np.linalg.norm(step, axis=1).max() < BALANCED * size:
            break
    balanced = _firm(stiffness) & (np.linalg.norm(force, axis=1) < 1e-6 * tensions.sum())
    return np.where(balanced[:, None], moved, np.nan), balanced


def _newton_step(force: Array, stiffness: Array, longest: float) -> Array:
    """Return Newton's step (frames, 3), 0 where the point is not held firmly.

    It may pass a line of action's far end, so it is no longer than `longest` [m].
    """
    sound = _firm(stiffness)
    step = np.zeros_like(force)
    step[sound] = -np.linalg.solve(stiffness[sound], force[sound][..., None])[..., 0]
    norm = np.maximum(np.linalg.norm(step, axis=1), 1e-300)
    return step * np.minimum(1.0, longest / norm)[:, None]


def _state(
    freed: _FreeLink, moved: Array, tensions: Array, rest: Array, size: float
) -> tuple[Array, Array, Array]:
    """Return energy (frames,), its slope (frames, 3) and second derivatives (frames, 3, 3).

    The derivatives are with the point's position.
    """
    steps = STEP * size * np.concatenate([np.zeros((1, 3)), np.eye(3), -np.eye(3)])
    lengths, slopes = freed.slopes((moved[:, None] + steps).reshape(-1, 3), len(steps))
    pulls = (slopes @ tensions).reshape(-1, 7, 3)
    energy = (lengths @ tensions).reshape(-1, 7)[:, 0] - moved @ rest
    stiffness = (pulls[:, 1:4] - pulls[:, 4:]) / (2.0 * STEP * size)
    return energy, pulls[:, 0] - rest, 0.5 * (stiffness + np.swapaxes(stiffness, 1, 2))


def _firm(stiffness: Array) -> Array:
    """(frames,) whether a point is held against every direction."""
    values = np.linalg.eigvalsh(stiffness)
    firm: Array = values[:, 0] > FLAT * np.abs(values).max(axis=1)
    return firm


class _FreeLink:
    """A model whose points on one link ride on a body that slides along the link's axes."""

    def __init__(self, model: Model, link: str, riders: Riders, motion: Motion | None = None):
        names = tuple(f"{FREE} {letter}" for letter in "xyz")
        still = Transform.identity()
        axes = tuple(
            Axis(kind="translation", vector=row, function=linear(1.0), coordinates=(name,))
            for row, name in zip(np.eye(3), names, strict=True)
        )
        freed = replace(
            model,
            bodies=(
                *model.bodies,
                Body(name=FREE, mass=0.0, mass_center=np.zeros(3), inertia=np.zeros((3, 3))),
            ),
            joints=(
                *model.joints,
                Joint(
                    name=FREE,
                    kind="CustomJoint",
                    parent=link,
                    child=FREE,
                    parent_frame=still,
                    child_frame=still,
                    axes=axes,
                    coordinates=names,
                ),
            ),
            coordinates=(
                *model.coordinates,
                *(Coordinate(name, "translational") for name in names),
            ),
            muscles=tuple(
                _riding(muscle, riders) for muscle in model.muscles if muscle.name in riders.points
            ),
            wrap_objects=tuple(
                replace(item, body=FREE) if item.name in riders.wraps else item
                for item in model.wrap_objects
            ),
        )
        self.muscles = freed.muscle_names
        self._paths = compile_paths(freed)
        self._values = self._paths.tree.coordinates_of(DEFAULT_POSE if motion is None else motion)
        self._columns = [freed.coordinate_names.index(name) for name in names]
        self.frames = len(self._values)

    def slopes(self, moved: Array, each: int = 1) -> tuple[Array, Array]:
        """Return lengths (frames, lines) and their derivatives (frames, 3, lines).

        The derivatives are with the point's position in the link. `moved`: (frames x each, 3)
        positions, `each` of them per frame [m].
        """
        values = np.repeat(self._values, each, axis=0)
        values[:, self._columns] = moved
        lengths, _, arms = self._paths.evaluate(values)
        result = np.zeros((len(values), 3, len(self.muscles)))
        for axis, column in enumerate(self._columns):
            pairs = self._paths.arm_coordinate == column
            # A moment arm is positive where the muscle shortens.
            result[:, axis, self._paths.arm_muscle[pairs]] = -arms[:, pairs]
        return lengths, result


def _riding(muscle: Muscle, riders: Riders) -> Muscle:
    path = muscle.path
    points = tuple(
        replace(point, body=FREE) if index in riders.points[muscle.name] else point
        for index, point in enumerate(path.points)
    )
    turned = riders.sides.get(muscle.name, ())
    wraps: Any = tuple(
        replace(wrap, side_body=FREE) if index in turned and isinstance(wrap, TendonWrap) else wrap
        for index, wrap in enumerate(path.wraps)
    )
    return replace(muscle, path=replace(path, points=points, wraps=wraps))


FEATURES = 60  # Of each bone around a virtual link count, spread over those it has.


def bones_around(
    model: Model, bones: Mapping[str, BoneMap], stated: Mapping[str, Sequence[str]] | None = None
) -> dict[str, tuple[str, ...]]:
    """Return the bones that surround each virtual link: those given, and those found in the tree.

    A body is taken for a virtual link where it has muscle points, but neither a mesh nor a bone of
    the target, and lies between at least two bones.
    """
    result = _stated_links(model, bones, stated or {})
    used = {point.body for muscle in model.muscles for point in muscle.path.points}
    for body in model.bodies:
        if (
            body.name in used
            and body.name not in bones
            and body.name not in result
            and not body.meshes
        ):
            around = nearest_bones(model, body.name, bones)
            if len(around) > 1:
                result[body.name] = around
    return result


def _stated_links(
    model: Model, bones: Mapping[str, BoneMap], stated: Mapping[str, Sequence[str]]
) -> dict[str, tuple[str, ...]]:
    """Return virtual links as a user states them, with at least two bones around each."""
    result: dict[str, tuple[str, ...]] = {}
    for link, around in stated.items():
        for name in (link, *around):
            check_name("body", name, model.body_names)
        missing = [name for name in around if name not in bones]
        if missing or len(around) < 2:
            raise BadData(
                f"virtual link '{link}' needs at least two bones around it, but got {list(around)}"
                + (f", of which {missing} have no map" if missing else "")
            )
        result[link] = tuple(around)
    return result


def _surrounded_map(
    link: str,
    there: str,
    around: Sequence[str],
    transfers: Transfers,
    source: Mapping[str, Transform],
    target: Mapping[str, Transform],
) -> BoneMap:
    """Map a virtual link from the features of the bones around it.

    Its points are fixed to `there`. Each feature counts where it lies in one posture of both
    models.
    """
    names: list[str] = []
    before = []
    after = []
    for bone in around:
        features = _features(transfers, bone)
        names += [f"{bone} {name}" for name in features.names]
        before.append((source[link].inverse() @ source[bone]).apply(features.source))
        after.append(
            (target[there].inverse() @ target[transfers[bone].body]).apply(features.target)
        )
    features = FeaturePoints(tuple(names), np.concatenate(before), np.concatenate(after))
    return BoneMap(
        body=link,
        target_body=there,
        map=fit_map(features),
        whole=procrustes(features.source, features.target, True),
        basis="surrounding",
        features=features,
        notes=(f"mapped by {len(features)} features of {', '.join(around)}",),
    )


def _features(transfers: Transfers, bone: str) -> FeaturePoints:
    """Return features of a bone, at most `FEATURES`.

    Of a bone that has none, points of it and where they go.
    """
    features = transfers[bone].bone.features
    if features is None or len(features) < 3:
        places = transfers[bone].samples
        features = FeaturePoints(
            tuple(str(i) for i in range(len(places))), places, transfers[bone].points(places)
        )
    chosen = np.unique(
        np.linspace(0, len(features) - 1, min(FEATURES, len(features))).round().astype(int)
    )
    return features.at(chosen)


# A branching point is moved no further than by this share of the mean length of its lines of
# action.
FURTHEST = 0.25
PASSES = 20  # Of moving several links, which may pull at each other.
SETTLED = 1e-7  # Links rest that move by less [m].


def link_carriers(
    links: Mapping[str, Sequence[str]],
    transfers: Transfers,
    source: Mapping[str, Transform],
    target: Mapping[str, Transform],
    targets: Mapping[str, str],
) -> dict[str, Transfer]:
    """Return transfers of virtual links onto `targets`.

    They go by the bones around each as these lie in a pose of both models.
    """
    return {
        link: Transfer(
            _surrounded_map(link, targets[link], around, transfers, source, target), targets[link]
        )
        for link, around in links.items()
    }


def balanced_links(
    source: Model,
    links: Mapping[str, Sequence[str]],
    transfers: Transfers,
    transferred: Callable[[Transfers], Model],
) -> dict[str, Transfer]:
    """Move links to where their line tensions balance in the target as in the source.

    Returns the transfers. Both balances are those of the posture in which bones are compared;
    `transferred`: the target with the source's muscles.
    """
    result = dict(transfers)
    branches = {link: riders_of(source, link).points for link in links}
    strong = {muscle.name for muscle in source.muscles if muscle.max_isometric_force > 0.0}
    loads = {
        link: branch_load(source, link)
        for link, names in branches.items()
        if names and strong >= names.keys()
    }
    moved = dict.fromkeys(loads, np.zeros(3))
    rests = dict.fromkeys(loads, True)
    for _ in range(PASSES):
        target = transferred(result)
        furthest = 0.0
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


def _to_balance(
    source: Model, target: Model, there: Transfer, load: BranchLoad
) -> tuple[Array, bool]:
    """Return how far the link's points have to move, (3,) in the target body's frame [m].

    The second value is whether they can rest there.
    """
    link_riders = riders_of(source, load.link)
    known = frozenset(item.name for item in target.wrap_objects)
    # On a body of its own everything rides that the body has; on another's only what came from the
    # link.
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
    """Add the measures and notes of its balance to a transfer."""
    tensions = f"the tensions of its {len(load.muscles)} lines of action"
    rest = f"{100.0 * load.share:.0f} % of them is held by no line of action, in the source too"
    if kept:
        note = f"moved by {1e3 * away:.2g} mm to where {tensions} balance ({rest})"
    else:
        note = f"left where its bones put it, as {tensions} balance nowhere near ({rest})"
    measures = {
        "moved to balance [m]": away if kept else 0.0,
        "held by no line of action": load.share,
    }
    bone = transfer.bone
    return Transfer(
        replace(bone, measures=FrozenMap({**bone.measures, **measures}), notes=(*bone.notes, note)),
        transfer.body,
    )
