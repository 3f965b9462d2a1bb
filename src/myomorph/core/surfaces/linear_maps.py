"""One transform for all points of a bone: rigid, similarity, affine, by weighted least squares."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from myomorph.core.model.arrays import Array, freeze, frozen_array, read_only
from myomorph.core.model.causes import BONES
from myomorph.core.model.errors import BadData
from myomorph.core.model.messages import Message
from myomorph.core.model.spatial import Transform

# A pick this many times further from where the others put it than they are from each other is
# named.
WRONG = 4.0
LEAST_WRONG = 0.004  # And at least that far [m].
# Share of the residual that a mirrored fit leaves where one side was taken for the other.
MIRRORED = 0.3


@read_only
class Similarity:
    """y = scale rotation x + translation.

    Attributes
    ----------
    scale : factor of all lengths
    rotation : (3, 3)
    translation : (3,) [m]
    """

    rotation: Array
    translation: Array
    scale: float = 1.0

    def __post_init__(self) -> None:
        freeze(self, rotation=(3, 3), translation=(3,))

    def apply(self, points: ArrayLike) -> Array:
        """Map points, y = scale rotation x + translation.

        Parameters
        ----------
        points : (..., 3) [m]

        Returns
        -------
        (..., 3) [m]
        """
        return (
            self.scale * (np.asarray(points, dtype=np.float64) @ self.rotation.T) + self.translation
        )

    def inverse(self) -> Similarity:
        """Invert the map."""
        back = self.rotation.T
        return Similarity(back, -(back @ self.translation) / self.scale, 1.0 / self.scale)

    @property
    def rigid(self) -> Transform:
        """Rigid map to a target resized by 1 / scale."""
        return Transform(self.rotation, self.translation / self.scale)


@read_only
class PointFit:
    """Picked points laid on others.

    Attributes
    ----------
    similarity : from the source's frame to the target's
    residuals : (points,) distances that remain [m]
    left_out : (points,) distances when the pick itself is left out [m]; NaN with three points
    notes : wrong picks and mirrored sides, one line each
    """

    similarity: Similarity
    residuals: Array
    left_out: Array
    notes: tuple[Message, ...] = ()

    @property
    def rms(self) -> float:
        """Root mean square of the residuals [m]."""
        return float(np.sqrt(np.mean(self.residuals**2)))


def procrustes(
    source: Array, target: Array, scale: bool = False, weights: Array | None = None
) -> Similarity:
    """Fit the similarity that brings points onto others with least squares.

        min sum_i w_i |s R x_i + t - y_i|^2

    With the centered points, sum_i w_i y_i x_i^T = U D V^T and S = diag(1, 1, det(U V^T)),

        R = U S V^T,   s = tr(D S) / sum_i w_i |x_i|^2,   t = mean y - s R mean x

    Source: Kabsch 1976, Umeyama 1991.

    Parameters
    ----------
    source : (points, 3) x [m]
    target : (points, 3) y [m]
    scale : find a size too; else s = 1
    weights : (points,) w; None weighs all alike

    Returns
    -------
    the map from source to target, without a reflection

    Raises
    ------
    BadData : fewer than three pairs, points that are not finite, or that lie on a line
    """
    source = np.asarray(source, dtype=np.float64)
    target = np.asarray(target, dtype=np.float64)
    if source.shape != target.shape or source.ndim != 2 or len(source) < 3:
        raise BadData(
            f"expected at least three pairs of points, but got {source.shape} and {target.shape}"
        )
    if not (np.isfinite(source).all() and np.isfinite(target).all()):
        raise BadData("a point is not finite: leave it out")
    share = np.ones(len(source)) if weights is None else np.asarray(weights, dtype=np.float64)
    share = (share / share.sum())[:, None]
    middle = (share * source).sum(axis=0)
    goal = (share * target).sum(axis=0)
    x = source - middle
    y = target - goal
    for points in (x, y):
        spread = np.linalg.svd(points, compute_uv=False)
        if spread[1] < 0.02 * spread[0] or spread[0] == 0:
            raise BadData(
                "the points lie on a line, so the rotation about it is unknown: pick one beside it"
            )
    u, d, vt = np.linalg.svd((share * y).T @ x)
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    rotation = (u * signs) @ vt
    size = float(d @ signs / np.sum(share * x**2)) if scale else 1.0
    return Similarity(rotation, goal - size * rotation @ middle, size)


def fit_points(names: Sequence[str], source: Array, target: Array, scale: bool = False) -> PointFit:
    """Fit picked points by `procrustes`, and find what looks wrong.

    A pick that the others contradict, or a mirrored side.

    Parameters
    ----------
    names : of the points
    source, target : (points, 3) [m]
    scale : find a size too

    Returns
    -------
    the similarity with its residuals and notes

    Raises
    ------
    BadData : see `procrustes`
    """
    source = np.asarray(source, dtype=np.float64)
    target = np.asarray(target, dtype=np.float64)
    fit = procrustes(source, target, scale)
    residuals = np.linalg.norm(fit.apply(source) - target, axis=1)
    left_out = np.full(len(names), np.nan)
    of_others = np.full(len(names), np.nan)
    notes: list[Message] = []
    if len(names) > 3:
        for index in range(len(names)):
            rest = np.delete(np.arange(len(names)), index)
            other = procrustes(source[rest], target[rest], scale and len(names) > 4)
            apart = np.linalg.norm(other.apply(source) - target, axis=1)
            left_out[index] = apart[index]
            of_others[index] = float(np.sqrt(np.mean(apart[rest] ** 2)))
        notes = _warnings(names, source, target, scale, residuals, left_out, of_others)
    return PointFit(
        similarity=fit,
        residuals=frozen_array(residuals),
        left_out=frozen_array(left_out),
        notes=tuple(notes),
    )


def _warnings(
    names: Sequence[str],
    source: Array,
    target: Array,
    scale: bool,
    residuals: Array,
    left_out: Array,
    of_others: Array,
) -> list[Message]:
    """Name a mirrored side or the wrong pick.

    Parameters
    ----------
    names : of the points
    source, target : (points, 3) [m]
    scale : a size is found too
    residuals : (points,) of all points [m]
    left_out : (points,) distance of each from where the others put it [m]
    of_others : (points,) root mean square of the others' residuals then [m]
    """
    rms = float(np.sqrt(np.mean(residuals**2)))
    mirrored = procrustes(source * [-1.0, 1.0, 1.0], target, scale)
    beside = np.linalg.norm(mirrored.apply(source * [-1.0, 1.0, 1.0]) - target, axis=1)
    if rms > LEAST_WRONG and float(np.sqrt(np.mean(beside**2))) < MIRRORED * rms:
        return [
            BONES.message(
                f"the picked points fit {rms / np.sqrt(np.mean(beside**2)):.0f} times better"
                " mirrored: is it a bone of the other side?"
            )
        ]
    worst = int(np.argmin(of_others))
    if (
        left_out[worst] > max(WRONG * of_others[worst], LEAST_WRONG)
        and of_others[worst] < 0.5 * rms
    ):
        return [
            BONES.message(
                f"picked point '{names[worst]}' lies {1e3 * left_out[worst]:.1f} mm from where the"
                f" others put it (they agree within {1e3 * of_others[worst]:.1f} mm): was it picked"
                " wrongly, or named as another?"
            )
        ]
    return []


FLAT = 0.02
"""Points whose spread along a direction is below this share of their greatest show nothing about
that direction.
"""

FOLDS = 24  # Parts in which many features are left out in turn.


@read_only
class AffineMap:
    """An affine map, y = matrix x + offset.

    Attributes
    ----------
    matrix : (3, 3) [-]
    offset : (3,) [m]
    """

    matrix: Array
    offset: Array

    def __post_init__(self) -> None:
        freeze(self, matrix=(3, 3), offset=(3,))

    @staticmethod
    def from_similarity(similarity: Similarity) -> AffineMap:
        """Convert a similarity: matrix = scale rotation."""
        return AffineMap(similarity.scale * similarity.rotation, similarity.translation)

    def apply(self, points: ArrayLike) -> Array:
        """Map points, y = matrix x + offset.

        Parameters
        ----------
        points : (..., 3) [m]

        Returns
        -------
        (..., 3) [m]
        """
        return np.asarray(points, dtype=np.float64) @ self.matrix.T + self.offset

    def jacobian(self, points: ArrayLike) -> Array:
        """Repeat the matrix for each point, as the derivative of the map there.

        Parameters
        ----------
        points : (..., 3) [m]

        Returns
        -------
        (..., 3, 3) [-]
        """
        shape = np.shape(np.asarray(points, dtype=np.float64))[:-1]
        return np.broadcast_to(self.matrix, (*shape, 3, 3)).copy()

    def inverse(self) -> AffineMap:
        """Invert the map.

        Raises
        ------
        BadData : the matrix is singular
        """
        try:
            back = np.linalg.inv(self.matrix).astype(np.float64)
        except np.linalg.LinAlgError:
            raise BadData("a singular affine map has no inverse") from None
        offset: Array = -back @ self.offset
        return AffineMap(back, offset)


def fit_affine(source: Array, target: Array, weights: Array | None = None) -> AffineMap:
    """Fit the affine map that brings points nearest to others.

    Along directions of which the points show nothing it is a similarity: points in a plane (three
    always are) fix the map in that plane alone, and across it the map is that of `procrustes` with
    scale. Four points that are not in a plane are reproduced exactly.

    Parameters
    ----------
    source, target : (points, 3) [m]
    weights : (points,); None weighs all alike

    Returns
    -------
    the map from source to target

    Raises
    ------
    BadData : see `procrustes`
    """
    start = AffineMap.from_similarity(procrustes(source, target, True, weights))
    share = np.ones(len(source)) if weights is None else np.asarray(weights, dtype=np.float64)
    share = share / share.sum()
    known = _spanned(source, share)
    rest = target - start.apply(source)
    middle = share @ source
    goal = share @ rest
    along = (source - middle) @ known.T
    root = np.sqrt(share)[:, None]
    slopes = np.linalg.lstsq(root * along, root * (rest - goal), rcond=None)[0]
    turned: Array = slopes.T @ known
    offset: Array = start.offset + goal - turned @ middle
    return AffineMap(start.matrix + turned, offset)


def fit_whole(source: Array, target: Array, weights: Array | None = None) -> AffineMap:
    """Mix the similarity and the affine map of a bone by how well each predicts held-out features.

    A few landmarks show little of how thick a long bone is and of its shear, and an affine map
    makes the most of their errors, far more so away from the bone. With E the sum of squares of the
    errors at features left out in turn, the affine map counts

        1 - E_affine / E_similarity,

    the similarity the rest: features that an affine map moves exactly are reproduced exactly, from
    five on. Four leave nothing to check: they make a similarity.

    Parameters
    ----------
    source, target : (points, 3) features of both bones [m]
    weights : (points,); None weighs all alike

    Returns
    -------
    the map from source to target

    Raises
    ------
    BadData : see `procrustes`
    """
    affine = fit_affine(source, target, weights)
    similarity = AffineMap.from_similarity(procrustes(source, target, True, weights))
    of_affine = of_similarity = 0.0
    fold = np.arange(len(source)) % FOLDS
    flat = len(unknown_directions(source))
    for index in range(min(len(source), FOLDS)):
        rest = fold != index
        out = fold == index
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
    """Find directions along which points have no extent.

    Parameters
    ----------
    source : (points, 3) [m]

    Returns
    -------
    (k, 3) unit vectors: none, or the normal of the plane that the points are in
    """
    share = np.full(len(source), 1.0 / len(source))
    known = _spanned(np.asarray(source, dtype=np.float64), share)
    if len(known) == 3:
        return np.empty((0, 3))
    return np.linalg.svd(known)[2][len(known) :]


def _spanned(source: Array, share: Array) -> Array:
    """Find orthonormal directions in which points spread by more than 2 % of the greatest spread.

    Parameters
    ----------
    source : (points, 3) [m]
    share : (points,) weights of sum 1

    Returns
    -------
    (k, 3)
    """
    _, spread, rows = np.linalg.svd(
        np.sqrt(share)[:, None] * (source - share @ source), full_matrices=False
    )
    return rows[spread > FLAT * spread[0]]
