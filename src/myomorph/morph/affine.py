"""One transform for all points of a bone: rigid, similarity, affine, by weighted least squares."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from myomorph.model.arrays import Array, frozen_array
from myomorph.model.errors import BadData
from myomorph.morph.procrustes import Similarity, procrustes

FLAT = 0.02
"""Points whose spread along a direction is below this share of their greatest tell nothing about that direction."""

FOLDS = 24
"""Parts in which many features are left out in turn."""


@dataclass(frozen=True, eq=False)
class AffineMap:
    """y = matrix x + offset.

    Attributes
    ----------
    matrix : (3, 3)
    offset : (3,) [m]
    """

    matrix: Array
    offset: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "matrix", frozen_array(self.matrix, (3, 3)))
        object.__setattr__(self, "offset", frozen_array(self.offset, (3,)))

    @staticmethod
    def from_similarity(similarity: Similarity) -> AffineMap:
        """The same map."""
        return AffineMap(similarity.scale * similarity.rotation, similarity.translation)

    def apply(self, points: ArrayLike) -> Array:
        """Points (..., 3) carried over [m]."""
        moved: Array = np.asarray(points, dtype=np.float64) @ self.matrix.T + self.offset
        return moved

    def jacobian(self, points: ArrayLike) -> Array:
        """The matrix (..., 3, 3), once a point."""
        shape = np.shape(np.asarray(points, dtype=np.float64))[:-1]
        return np.broadcast_to(self.matrix, (*shape, 3, 3)).copy()

    def inverse(self) -> AffineMap:
        """The way back.

        Raises
        ------
        BadData : a matrix that flattens space
        """
        try:
            back = np.linalg.inv(self.matrix).astype(np.float64)
        except np.linalg.LinAlgError:
            raise BadData("an affine map that flattens space has no way back") from None
        offset: Array = -back @ self.offset
        return AffineMap(back, offset)


def fit_affine(source: Array, target: Array, weights: Array | None = None) -> AffineMap:
    """The affine map that brings points nearest to others, a similarity along directions of which they tell nothing.

    Four points that are not in a plane are reproduced exactly. Points in a plane (three always are) fix the map in
    that plane alone; across it the map is that of `procrustes` with scale.

    Parameters
    ----------
    source, target : (points, 3), at least three that are not on a line [m]
    weights : (points,)

    Raises
    ------
    BadData : fewer than three points, or points on a line
    """
    start = AffineMap.from_similarity(procrustes(source, target, True, weights))
    share = np.ones(len(source)) if weights is None else np.asarray(weights, dtype=np.float64)
    share = share / share.sum()
    known = _spanned(source, share)
    rest = target - start.apply(source)
    middle, goal = share @ source, share @ rest
    along = (source - middle) @ known.T
    root = np.sqrt(share)[:, None]
    slopes = np.linalg.lstsq(root * along, root * (rest - goal), rcond=None)[0]
    turned: Array = slopes.T @ known
    offset: Array = start.offset + goal - turned @ middle
    return AffineMap(start.matrix + turned, offset)


def fit_whole(source: Array, target: Array, weights: Array | None = None) -> AffineMap:
    """Between the similarity and the affine map of a bone, by how well each foresees features that it did not see.

    A few landmarks tell little of how thick a long bone is and of its shear, and an affine map makes the most of their
    errors, far more so beside the bone. With E the squares of the errors at features left out in turn, the affine map
    counts 1 - E_affine / E_similarity, the similarity the rest: features that an affine map moves exactly are
    reproduced exactly, from five on. Four leave nothing to check: they make a similarity.

    Parameters
    ----------
    source, target : (points, 3), at least three that are not on a line [m]
    weights : (points,)

    Raises
    ------
    BadData : fewer than three points, or points on a line
    """
    affine = fit_affine(source, target, weights)
    similarity = AffineMap.from_similarity(procrustes(source, target, True, weights))
    of_affine = of_similarity = 0.0
    fold = np.arange(len(source)) % FOLDS
    flat = len(unknown_directions(source))
    for k in range(min(len(source), FOLDS)):
        rest, out = fold != k, fold == k
        seen = None if weights is None else weights[rest]
        try:
            if len(unknown_directions(source[rest])) != flat:
                continue
            tried = fit_affine(source[rest], target[rest], seen)
            other = procrustes(source[rest], target[rest], True, seen)
        except BadData:
            continue
        of_affine += float(np.sum((target[out] - tried.apply(source[out])) ** 2))
        of_similarity += float(np.sum((target[out] - other.apply(source[out])) ** 2))
    share = max(0.0, 1.0 - of_affine / of_similarity) if of_similarity > 0.0 else 0.0
    matrix: Array = share * affine.matrix + (1.0 - share) * similarity.matrix
    offset: Array = share * affine.offset + (1.0 - share) * similarity.offset
    return AffineMap(matrix, offset)


def unknown_directions(source: Array) -> Array:
    """Unit vectors (k, 3) along which points have no extent: none, or the normal of the plane they are in."""
    share = np.full(len(source), 1.0 / len(source))
    known = _spanned(np.asarray(source, dtype=np.float64), share)
    if len(known) == 3:
        return np.empty((0, 3))
    rows: Array = np.linalg.svd(known)[2][len(known) :]
    return rows


def _spanned(source: Array, share: Array) -> Array:
    """Orthonormal directions (k, 3) in which points spread."""
    _, spread, rows = np.linalg.svd(np.sqrt(share)[:, None] * (source - share @ source), full_matrices=False)
    known: Array = rows[spread > FLAT * spread[0]]
    return known
