"""Picked points of one shape laid on those of another: rotation, translation and, if wanted, scale."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from myomorph.model.arrays import Array, frozen_array
from myomorph.model.errors import BadData
from myomorph.model.spatial import Transform

WRONG = 4.0
"""A pick this many times further from where the others put it than they are from each other is named."""

LEAST_WRONG = 0.004
"""And at least that far [m]."""

MIRRORED = 0.3
"""Share of the residual that a mirrored fit leaves where one side was taken for the other."""


@dataclass(frozen=True, eq=False)
class Similarity:
    """y = scale rotation x + translation.

    Attributes
    ----------
    rotation : (3, 3)
    translation : (3,) [m]
    """

    rotation: Array
    translation: Array
    scale: float = 1.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "rotation", frozen_array(self.rotation, (3, 3)))
        object.__setattr__(self, "translation", frozen_array(self.translation, (3,)))

    def apply(self, points: ArrayLike) -> Array:
        """Points (..., 3) carried over."""
        moved: Array = self.scale * (np.asarray(points, dtype=np.float64) @ self.rotation.T) + self.translation
        return moved

    def inverse(self) -> Similarity:
        """The way back."""
        back = self.rotation.T
        return Similarity(back, -(back @ self.translation) / self.scale, 1.0 / self.scale)

    @property
    def rigid(self) -> Transform:
        """The same without scale: of a target resized by 1 / scale."""
        return Transform(self.rotation, self.translation / self.scale)


@dataclass(frozen=True, eq=False)
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
    notes: tuple[str, ...] = ()

    @property
    def rms(self) -> float:
        """Root mean square of the residuals [m]."""
        return float(np.sqrt(np.mean(self.residuals**2)))


def procrustes(source: Array, target: Array, scale: bool = False, weights: Array | None = None) -> Similarity:
    """The similarity that brings points onto others with least squares (Kabsch 1976, Umeyama 1991).

    Parameters
    ----------
    source, target : (points, 3), at least three that are not on a line [m]
    weights : (points,)

    Raises
    ------
    BadData : fewer than three points, or points on a line
    """
    source, target = np.asarray(source, dtype=np.float64), np.asarray(target, dtype=np.float64)
    if source.shape != target.shape or source.ndim != 2 or len(source) < 3:
        raise BadData(f"expected at least three pairs of points, but got {source.shape} and {target.shape}")
    if not (np.isfinite(source).all() and np.isfinite(target).all()):
        raise BadData("a point is not finite: leave it out")
    share = np.ones(len(source)) if weights is None else np.asarray(weights, dtype=np.float64)
    share = (share / share.sum())[:, None]
    middle, goal = (share * source).sum(axis=0), (share * target).sum(axis=0)
    x, y = source - middle, target - goal
    for points in (x, y):
        spread = np.linalg.svd(points, compute_uv=False)
        if spread[1] < 0.02 * spread[0] or spread[0] == 0:
            raise BadData("the points lie on a line, about which nothing is known: pick one beside it")
    u, d, vt = np.linalg.svd((share * y).T @ x)
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    rotation = (u * signs) @ vt
    size = float(d @ signs / np.sum(share * x**2)) if scale else 1.0
    return Similarity(rotation, goal - size * rotation @ middle, size)


def fit_points(names: Sequence[str], source: Array, target: Array, scale: bool = False) -> PointFit:
    """`procrustes` with its residuals, and what looks wrong: a pick that the others contradict, a mirrored side.

    Parameters
    ----------
    names : of the points, for messages
    source, target : (points, 3) [m]

    Raises
    ------
    BadData : as `procrustes`
    """
    source, target = np.asarray(source, dtype=np.float64), np.asarray(target, dtype=np.float64)
    found = procrustes(source, target, scale)
    residuals = np.linalg.norm(found.apply(source) - target, axis=1)
    left_out, of_others = np.full(len(names), np.nan), np.full(len(names), np.nan)
    notes: list[str] = []
    if len(names) > 3:
        for k in range(len(names)):
            rest = np.delete(np.arange(len(names)), k)
            other = procrustes(source[rest], target[rest], scale and len(names) > 4)
            apart = np.linalg.norm(other.apply(source) - target, axis=1)
            left_out[k], of_others[k] = apart[k], float(np.sqrt(np.mean(apart[rest] ** 2)))
        notes = _doubts(names, source, target, scale, residuals, left_out, of_others)
    return PointFit(found, frozen_array(residuals), frozen_array(left_out), tuple(notes))


def _doubts(
    names: Sequence[str],
    source: Array,
    target: Array,
    scale: bool,
    residuals: Array,
    left_out: Array,
    of_others: Array,
) -> list[str]:
    rms = float(np.sqrt(np.mean(residuals**2)))
    mirrored = procrustes(source * [-1.0, 1.0, 1.0], target, scale)
    beside = np.linalg.norm(mirrored.apply(source * [-1.0, 1.0, 1.0]) - target, axis=1)
    if rms > LEAST_WRONG and float(np.sqrt(np.mean(beside**2))) < MIRRORED * rms:
        return [
            f"the picked points fit {rms / np.sqrt(np.mean(beside**2)):.0f} times better mirrored: is it a bone of the "
            "other side?"
        ]
    worst = int(np.argmin(of_others))
    if left_out[worst] > max(WRONG * of_others[worst], LEAST_WRONG) and of_others[worst] < 0.5 * rms:
        return [
            f"picked point '{names[worst]}' lies {1e3 * left_out[worst]:.1f} mm from where the others put it (they "
            f"agree within {1e3 * of_others[worst]:.1f} mm): wrongly picked, or named after another"
        ]
    return []
