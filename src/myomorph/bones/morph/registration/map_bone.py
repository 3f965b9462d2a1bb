"""The map from one bone to another: checks, matching, feature points, and the map through them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import scipy

from myomorph.bones.morph.maps.fields import (
    Basis,
    BoneMap,
    FeaturePoints,
    MapOptions,
    PointMap,
    feature_warnings,
    fit_map,
    inverted,
)
from myomorph.bones.morph.registration.alignment import automatic_landmarks
from myomorph.bones.morph.registration.bone_checks import check_bone, repaired_bone
from myomorph.bones.morph.registration.nonrigid import (
    PlacedBone,
    SurfaceMatch,
    match_surfaces,
    place_bone,
)
from myomorph.bones.morph.registration.smooth import MatchOptions
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.surface import Surface
from myomorph.core.surfaces.linear_maps import Similarity, procrustes

# A surface feature nearer to a landmark than this share of the features' spacing gives way to it.
BESIDE = 0.5
STEEP = 3.0
"""So does one nearer than so many times the distance by which landmark and surface features
disagree: between them the map would fold.
"""

MIN_COUNT = 20  # Matched points below which two surfaces are not the same bone.
WRONG_SIDE = 0.7
UNSURE_SIDE = 0.9
"""Share of the distance that the mirrored source leaves, below which the bone is one of the other
side, or may be: 0.2 to 0.65 of femurs, tibias and heels of the other side, 0.8 or more of those of
the same, about 1 of a pelvis.
"""

ROUNDS = 3  # Times that features are taken out where the map folds.


@dataclass(frozen=True, eq=False, kw_only=True)
class BoneMapOptions:
    """Options of the map of one bone.

    Attributes
    ----------
    map : how the space around the bone is mapped
    match : how surfaces are matched
    target_body : name of the body in the target; that of the source where it is empty
    start : rough pose of the bone in the target, for bones without landmarks, such as the pose of
        its neighbors in bones that share a frame
    """

    map: MapOptions = field(default_factory=MapOptions)
    match: MatchOptions = field(default_factory=MatchOptions)
    target_body: str = ""
    start: Similarity | None = None


def map_bone(
    body: str,
    source: Surface | None,
    target: Surface | None,
    landmarks: FeaturePoints | None = None,
    options: BoneMapOptions | None = None,
) -> BoneMap:
    """Map what is fixed to a body to the target's bone.

    With both surfaces the map goes through points spread over them and through the landmarks; with
    one or none, or where the options say so, through the landmarks alone. If none are given then,
    they are found by rules.

    Source: Franke 1982; Duchon 1977; see docs/bone-maps.md.

    Parameters
    ----------
    body : of the source
    source, target : surfaces in their bodies' frames; None where there is none
    landmarks : of the bone, in the source's and the target's frame
    options : see `BoneMapOptions`

    Returns
    -------
    map from the source body's frame to the target's [m], what it was made from, its residuals and
    notes

    Raises
    ------
    BadData : nothing to make a map of, or bones that cannot be the same

    Examples
    --------
    >>> import numpy as np
    >>> import myomorph as mm
    >>> places = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.3, 0.0], [0.0, 0.0, 0.05]])
    >>> pairs = mm.morph.FeaturePoints(("a", "b", "c", "d"), places, 1.2 * places)
    >>> found = mm.map_bone("fore", None, None, pairs)
    >>> found.basis, round(float(found.whole.scale), 3)
    ('landmarks', 1.2)
    >>> found.map.apply(np.array([[0.1, 0.1, 0.0]])).round(3)
    array([[0.12, 0.12, 0.  ]])
    """
    options = options or BoneMapOptions()
    match = options.match
    landmarks = landmarks if landmarks is not None and len(landmarks) else None
    pair = _checked_pair(body, (source, target), landmarks, options)
    source = pair.source
    target = pair.target
    notes = list(pair.notes)
    measures: dict[str, float] = {}
    basis: Basis = "landmarks"
    if source is not None and target is not None and match.features == "dense":
        basis = "bone"
        surface_match = match_surfaces(source, target, landmarks, match, pair.placed)
        notes += surface_match.notes
        measures |= surface_match.quality.measures(surface_match.length)
        features = _features(body, surface_match, landmarks, options)
    elif landmarks is not None:
        features = landmarks
    else:
        features = _found_by_rules(body, source, target, pair.placed, notes)
    features, mapping = _unfolded(features, landmarks, source, options.map)
    notes += feature_warnings(features)
    inside_out = _inside_out(mapping, features.source if source is None else source.vertices, notes)
    measures |= {"features": float(len(features)), "map inverted": inside_out}
    return BoneMap(
        body=body,
        target_body=options.target_body or body,
        map=mapping,
        whole=procrustes(features.source, features.target, True, features.weights),
        basis=basis,
        source=source,
        target=target,
        features=features,
        measures=FrozenMap(measures),
        notes=tuple(dict.fromkeys(notes)),
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class _CheckedPair:
    """A bone's surfaces after repair, how one lies on the other where both are known, and notes."""

    source: Surface | None
    target: Surface | None
    placed: PlacedBone | None
    notes: tuple[str, ...]


def _checked_pair(
    body: str,
    surfaces: tuple[Surface | None, Surface | None],
    landmarks: FeaturePoints | None,
    options: BoneMapOptions,
) -> _CheckedPair:
    """Repair a bone's surfaces of source and target, lay them on each other and check them."""
    source, target = surfaces
    notes: list[str] = []
    if source is not None:
        source = repaired_bone(source, f"the source's bone of '{body}'", notes)
    placed = None
    if target is not None:
        target = repaired_bone(target, f"the bone of '{body}'", notes)
        lies = None
        if source is not None:
            placed = place_bone(source, target, landmarks, options.start, options.match)
            _check_side(body, placed, notes)
            lies = placed.similarity
        notes += check_bone(body, target, source, landmarks, lies)
    return _CheckedPair(source=source, target=target, placed=placed, notes=tuple(notes))


def _inside_out(mapping: PointMap, points: Array, notes: list[str]) -> float:
    """Return the share of points (n, 3) [m] at which a map turns space inside out, with a note."""
    share = float(np.mean(inverted(mapping, points)))
    if share > 0:
        notes.append(f"the map inverts space at {100 * share:.1f} % of the bone's vertices")
    return share


def _found_by_rules(
    body: str,
    source: Surface | None,
    target: Surface | None,
    placed: PlacedBone | None,
    notes: list[str],
) -> FeaturePoints:
    """Landmarks of two surfaces; raises `BadData` where there is only one of them."""
    if source is None or target is None or placed is None:
        lacking = " and ".join(
            whose for whose, known in (("source", source), ("target", target)) if known is None
        )
        raise BadData(
            f"'{body}': the {lacking} has no surface of this bone, and there are no landmarks: give"
            " one or the other (the source's meshes may lie in another folder, see --geometry)"
        )
    result = automatic_landmarks(source, target, placed.similarity)
    notes.append(
        f"{len(result)} landmarks of '{body}' were found by rules: {', '.join(result.names)}"
    )
    return result


def _check_side(body: str, placed: PlacedBone, notes: list[str]) -> None:
    if not placed.mirrored < UNSURE_SIDE:
        return
    text = (
        f"the bone of '{body}' is nearer to the mirrored bone of the source ({placed.mirrored:.2f}"
        " times the distance): is it of the other side?"
    )
    if placed.mirrored < WRONG_SIDE:
        raise BadData(f"{text} Give the bone of this side, or mirror the model first")
    notes.append(text)


def _features(
    body: str,
    surface_match: SurfaceMatch,
    landmarks: FeaturePoints | None,
    options: BoneMapOptions,
) -> FeaturePoints:
    """Return the landmarks, and the first evenly spread pairs that are not too near to one."""
    match = options.match
    if len(surface_match.pairs) < MIN_COUNT:
        raise BadData(
            f"the bones of '{body}' meet at {len(surface_match.pairs)} of {match.match_points}"
            " points: are they the same bone? Give landmarks, or leave the bone out: it is then"
            " scaled as its neighbors"
        )
    dense = surface_match.pairs.at(np.arange(min(match.feature_count, len(surface_match.pairs))))
    if landmarks is None:
        return dense
    spacing = float(np.median(scipy.spatial.cKDTree(dense.source).query(dense.source, 2)[0][:, 1]))
    apart = np.linalg.norm(
        fit_map(dense, options.map).apply(landmarks.source) - landmarks.target, axis=1
    )
    reach = np.maximum(BESIDE * spacing, STEEP * apart / surface_match.placed.similarity.scale)
    away = np.linalg.norm(dense.source[:, None] - landmarks.source, axis=2)
    return _joined(landmarks, dense.at(np.flatnonzero((away > reach).all(axis=1))))


def _unfolded(
    features: FeaturePoints,
    landmarks: FeaturePoints | None,
    source: Surface | None,
    options: MapOptions,
) -> tuple[FeaturePoints, PointMap]:
    """Fit a map without the dense features around which it would fold.

    Returns the features that it needs, and the map.
    """
    mapping = fit_map(features, options)
    first = 0 if landmarks is None else len(landmarks)
    if source is None or len(features) == first:
        return features, mapping
    for _ in range(ROUNDS):
        wrong = source.vertices[inverted(mapping, source.vertices)]
        if not len(wrong):
            break
        near = scipy.spatial.cKDTree(features.source).query(wrong, 2)[1]
        kept = np.ones(len(features), dtype=bool)
        kept[np.unique(near)] = False
        kept[:first] = True
        if kept.all() or kept.sum() < MIN_COUNT:
            break
        features = features.at(np.flatnonzero(kept))
        mapping = fit_map(features, options)
    return features, mapping


def _joined(first: FeaturePoints, then: FeaturePoints) -> FeaturePoints:
    """Landmarks, most often without radii, and features of surfaces, without weights."""
    source = np.concatenate((first.source, then.source))
    target = np.concatenate((first.target, then.target))
    unknown = np.full(len(first), np.nan) if first.radii is None else first.radii
    weights = None if first.weights is None else np.concatenate([first.weights, np.ones(len(then))])
    radii = None if then.radii is None else np.concatenate([unknown, then.radii])
    return FeaturePoints(
        names=(*first.names, *then.names),
        source=source,
        target=target,
        weights=weights,
        radii=radii,
    )
