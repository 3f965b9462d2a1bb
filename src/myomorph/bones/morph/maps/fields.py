"""Feature points of two bones, the map that is fitted to them, and the bone with its map.

The kinds of maps are in `linear.py` (rigid, similarity, affine) and `interpolating.py` (radial
basis functions, skeletal subspace deformation). All have one interface: points in, points and
Jacobians out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal, Protocol, TypeAlias

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from myomorph.bones.morph.maps.interpolating import fit_radial, fit_subspace
from myomorph.core.model.arrays import Array, freeze, frozen_array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.model import GROUND, Model
from myomorph.core.model.shown import shown
from myomorph.core.model.surface import Surface, connected
from myomorph.core.surfaces.linear_maps import (
    AffineMap,
    Similarity,
    fit_affine,
    fit_whole,
    procrustes,
    unknown_directions,
)

MapKind: TypeAlias = Literal["ssd", "rbf", "affine", "similarity", "rigid"]


class PointMap(Protocol):
    """What every map can do."""

    def apply(self, points: ArrayLike) -> Array:
        """Map points of the source's frame into the target's.

        Parameters
        ----------
        points : (..., 3) in the source's frame [m]

        Returns
        -------
        (..., 3) in the target's frame [m]
        """
        ...

    def jacobian(self, points: ArrayLike) -> Array:
        """Return the derivatives of the mapped points with the points.

        Parameters
        ----------
        points : (..., 3) in the source's frame [m]

        Returns
        -------
        (..., 3, 3) derivatives [m/m]: row by target axis, column by source axis
        """
        ...


STAYS = AffineMap(np.eye(3), np.zeros(3))


@dataclass(frozen=True, eq=False)
class PlacedMap:
    """A map with affine ones before and after it: y = after(map(before(x)))."""

    before: AffineMap
    map: PointMap
    after: AffineMap

    def apply(self, points: ArrayLike) -> Array:
        """Map points of the source's frame into the target's.

        Parameters
        ----------
        points : (..., 3) in the source's frame [m]

        Returns
        -------
        (..., 3) in the target's frame [m]
        """
        return self.after.apply(self.map.apply(self.before.apply(points)))

    def jacobian(self, points: ArrayLike) -> Array:
        """Return the derivatives of the mapped points with the points.

        Parameters
        ----------
        points : (..., 3) in the source's frame [m]

        Returns
        -------
        (..., 3, 3) derivatives [m/m]
        """
        inner = self.map.jacobian(self.before.apply(points))
        return self.after.matrix @ inner @ self.before.matrix


@read_only
class FeaturePoints:
    """Points of one bone and the same points of another.

    Attributes
    ----------
    names : of the points; dense ones are numbered
    source : (n, 3) in the source body's frame [m]
    target : (n, 3) in the target body's frame [m]
    weights : (n,) how much each counts in fits of the whole bone, 1 by default; maps that go
        through every point use it only for that fit
    radii : (n,) within which the target's points belong with 90 % [m]; NaN of landmarks, None where
        nothing is known
    """

    names: tuple[str, ...]
    source: Array
    target: Array
    weights: Array | None = None
    radii: Array | None = None

    def __post_init__(self) -> None:
        count = len(self.names)
        for side in ("source", "target"):
            array = frozen_array(getattr(self, side), (-1, 3))
            if array.shape != (count, 3):
                raise BadData(
                    f"{count} feature points are named, but their {side} has shape {array.shape}"
                )
            if not np.isfinite(array).all():
                raise BadData(f"a feature point's {side} is not finite: leave it out")
            object.__setattr__(self, side, array)
        freeze(self, weights=(count,), radii=(count,))

    def __len__(self) -> int:
        return len(self.names)

    def at(self, kept: np.ndarray) -> FeaturePoints:
        """Return some of the features.

        Parameters
        ----------
        kept : (n,) their indices

        Returns
        -------
        features, in the order of the indices
        """
        weights = None if self.weights is None else self.weights[kept]
        radii = None if self.radii is None else self.radii[kept]
        return FeaturePoints(
            names=tuple(self.names[i] for i in kept),
            source=self.source[kept],
            target=self.target[kept],
            weights=weights,
            radii=radii,
        )


@dataclass(frozen=True)
class MapOptions:
    """How the space around a bone is mapped.

    Attributes
    ----------
    map : map of a bone; "ssd": local transforms of the feature points, blended by distance; "rbf":
        an affine map and radial basis functions; "affine", "similarity" or "rigid": one transform
        fitted to all points
    exponent : exponent of the distance in the weights of map "ssd"
    kernel : kernel of map "rbf": the distance ("r") or its cube ("r3")
    smoothing : root mean square distance by which "ssd" and "rbf" may miss the feature points, for
        landmarks that were picked with errors [m]; 0 interpolates them
    """

    map: MapKind = "ssd"
    exponent: float = 4.0
    kernel: Literal["r", "r3"] = "r"
    smoothing: float = 0.0

    def __post_init__(self) -> None:
        if not 1.0 < self.exponent <= 16.0:
            raise BadData(
                f"exponent of the distance weights is {self.exponent:g}: expected more than 1 and"
                " at most 16"
            )
        if not 0.0 <= self.smoothing < np.inf:
            raise BadData(f"smoothing is {self.smoothing:g}: expected 0 or more meters")


# Features of the source nearer to each other than this share of the bone are one.
SAME_PLACE = 1e-6


def fit_map(features: FeaturePoints, options: MapOptions | None = None) -> PointMap:
    """Fit the map that goes through feature points, or nearest to them.

    Features at the same position are taken together. What the features do not show (across the
    plane of flat ones) is that of the similarity nearest to them; `feature_warnings` reports when.
    """
    options = options or MapOptions()
    merged = _merged(features)
    source = merged.source
    target = merged.target
    weights = merged.weights
    if options.map in ("rigid", "similarity"):
        return AffineMap.from_similarity(
            procrustes(source, target, options.map == "similarity", weights)
        )
    if options.map == "ssd":
        whole = fit_whole(source, target, weights)
        return fit_subspace(source, target, whole, options.exponent, options.smoothing)
    affine = fit_affine(source, target, weights)
    return (
        affine
        if options.map == "affine"
        else fit_radial(source, target, affine, options.kernel, options.smoothing)
    )


def feature_warnings(features: FeaturePoints) -> tuple[str, ...]:
    """Report what feature points leave open, in one line each.

    There are too few, they are flat, or two are at one position.
    """
    warnings = []
    merged = _merged(features)
    if len(merged) < len(features):
        warnings.append(
            f"{len(features) - len(merged)} of {len(features)} feature points have the same"
            " position: merged"
        )
    if len(merged) == 4:
        warnings.append(
            "four feature points do not distinguish scaling from picking errors: pick a fifth"
        )
    if len(unknown_directions(merged.source)):
        warnings.append(
            f"the {len(merged)} feature points lie in a plane: across it the bone is scaled as"
            " along it; pick one out of this plane"
        )
    return tuple(warnings)


def inverted(mapping: PointMap, points: ArrayLike) -> NDArray[np.bool_]:
    """Return where a map turns space inside out: the determinant of its Jacobian is not positive.

    Parameters
    ----------
    mapping : from one space to another
    points : (..., 3) to evaluate it at [m]

    Returns
    -------
    (...) whether it is inverted there
    """
    return np.linalg.det(mapping.jacobian(points)) <= 0.0


def _merged(features: FeaturePoints) -> FeaturePoints:
    """Features with those at one place of the source as one, in the middle of their targets."""
    if len(features) < 2:
        return features
    size = float(np.ptp(features.source, axis=0).max())
    pairs = scipy.spatial.cKDTree(features.source).query_pairs(
        SAME_PLACE * size, output_type="ndarray"
    )
    if not len(pairs):
        return features
    count = len(features)
    label = connected(count, pairs)
    groups = int(label.max()) + 1
    share = np.ones(count) if features.weights is None else features.weights
    total = np.bincount(label, share, groups).astype(np.float64)
    first = np.unique(label, return_index=True)[1]

    def mean(points: Array) -> Array:
        return np.column_stack(
            [np.bincount(label, share * column, groups) / total for column in points.T]
        )

    weights = None if features.weights is None else total
    return FeaturePoints(
        names=tuple(features.names[index] for index in first),
        source=mean(features.source),
        target=mean(features.target),
        weights=weights,
    )


AROUND = 3  # Features that say how surely a point is known.


Basis: TypeAlias = Literal["bone", "landmarks", "neighbors", "surrounding", "given"]


@shown
@read_only
class BoneMap:
    """How what is fixed to a body of the source becomes fixed to a body of the target.

    Attributes
    ----------
    body : of the source
    target_body : of the target; another name where the species have another skeleton
    map : from the source body's frame to the target body's
    whole : the similarity that the map comes nearest to: turns joint axes and wrap objects, tells
        left from right
    basis : "bone" (surfaces and their features), "landmarks" (points alone), "neighbors" (scaled as
        the bodies around), "surrounding" (a virtual link, mapped by the features of several bones),
        "given"
    source, target : surfaces in their bodies' frames, None where there is none
    features : what the map was made from
    measures : how good it is, by name with its unit ("residual [m]", "coverage", "inverted"), for
        tables
    notes : what looks wrong or was assumed, one line each
    overall : (3, 3) what becomes of the bone as a whole, where the map holds points on one side of
        a joint and so flattens the rest; None takes the affine map that is nearest to the map
    """

    body: str
    target_body: str
    map: PointMap
    whole: Similarity
    basis: Basis
    source: Surface | None = None
    target: Surface | None = None
    features: FeaturePoints | None = None
    measures: Mapping[str, float] = field(default_factory=lambda: FrozenMap({}))
    notes: tuple[str, ...] = ()
    overall: Array | None = None

    def shifted(self, by: Array) -> BoneMap:
        """Return the map to positions that lie further on in the target body.

        Parameters
        ----------
        by : (3,) vector in the target body's frame [m]

        Returns
        -------
        map
        """
        moved = PlacedMap(STAYS, self.map, AffineMap(np.eye(3), by))
        return replace(
            self, map=moved, whole=replace(self.whole, translation=self.whole.translation + by)
        )


def radii_around(places: Array, radii: Array | None, asked: Array) -> Array:
    """Return the distances within which points of a surface belong with 90 %.

    They are interpolated from the radii of the features around each point.

    Parameters
    ----------
    places : (features, 3) positions of the features [m]
    radii : (features,) of the features, NaN where unknown [m]; None where none is known
    asked : (n, 3) points of the surface [m]

    Returns
    -------
    (n,) distances; NaN where nothing is known [m]
    """
    known = np.zeros(0, dtype=np.intp) if radii is None else np.flatnonzero(np.isfinite(radii))
    if radii is None or len(known) < AROUND:
        return np.full(len(asked), np.nan)
    away, index = scipy.spatial.cKDTree(places[known]).query(asked, AROUND)
    share = 1.0 / np.maximum(away, SAME_PLACE)
    return np.asarray((share * radii[known][index]).sum(axis=1) / share.sum(axis=1))


def neighbors_of(model: Model) -> dict[str, list[str]]:
    """Of every body and of the ground the bodies that a joint ties to it."""
    ties: dict[str, list[str]] = {name: [] for name in (GROUND, *model.body_names)}
    for joint in model.joints:
        ties[joint.parent].append(joint.child)
        ties[joint.child].append(joint.parent)
    return ties


def nearest_bones(model: Model, body: str, bones: Mapping[str, BoneMap]) -> tuple[str, ...]:
    """Return bones reached from a body in the tree without passing another, nearest first."""
    ties = neighbors_of(model)
    reached: list[str] = []
    open_ = [body]
    seen = {body, GROUND}
    while open_:
        for name in ties[open_.pop(0)]:
            if name in seen:
                continue
            seen.add(name)
            (reached if name in bones else open_).append(name)
    return tuple(reached)


def muscle_sizes(source: Model, bones: Mapping[str, BoneMap]) -> dict[str, float]:
    """Return how many times larger the target is around each muscle.

    It is the mean scale of the maps of its points' bones.
    """
    result: dict[str, float] = {}
    for muscle in source.muscles:
        owners = dict.fromkeys(point.body for point in muscle.path.points)
        scales = [bones[body].whole.scale for body in owners if body in bones]
        result[muscle.name] = float(np.mean(scales)) if scales else 1.0
    return result
