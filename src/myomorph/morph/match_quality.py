"""How good a dense correspondence is: what is left, what is reached, what is folded or stretched."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.surface import Surface
from myomorph.morph.surface_points import Samples, Shape

COVERED, AGREES, FOLDED, STRETCHED = 0.95, 0.9, 0.01, 4.0
"""Below this coverage and agreement, above this share folded and this ratio of areas, a match is doubted."""

ASKED = 4000
"""Points of the target of which it is asked whether they are reached."""

ALIKE = 0.5
"""Cosine between normals that agree: 60 degrees."""


@dataclass(frozen=True)
class MatchQuality:
    """Lengths are shares of the target's length, so that bones of all sizes compare.

    Attributes
    ----------
    residual : root mean square distance between the smooth deformation and the surface
    residual95 : 95 % of the source's area is nearer than that
    symmetric : root mean square distance from the target's points to the matched source
    coverage : share of the target's area that the matched source comes near
    agreement : share of the source's area whose normals agree with the target's within 60 degrees
    folded : share of the source's area turned over
    shrunk, grown : 1 % of the area changes by less than `shrunk` or more than `grown`, over the change of the whole
    """

    residual: float
    residual95: float
    symmetric: float
    coverage: float
    agreement: float
    folded: float
    shrunk: float
    grown: float

    def measures(self, length: float) -> dict[str, float]:
        """By name with its unit, for a target of that length [m]."""
        return {
            "residual [m]": self.residual * length,
            "residual 95 % [m]": self.residual95 * length,
            "symmetric residual [m]": self.symmetric * length,
            "coverage": self.coverage,
            "agreement": self.agreement,
            "folded": self.folded,
            "area shrunk": self.shrunk,
            "area grown": self.grown,
        }

    def doubts(self, tolerance: float) -> tuple[str, ...]:
        """What looks wrong, one line each."""
        found = []
        if self.residual95 > tolerance:
            found.append(
                f"5 % of the bone stay more than {100 * self.residual95:.1f} % of its length from the other's surface "
                "where it deforms smoothly: other shapes, or not the same bone?"
            )
        if self.coverage < COVERED:
            found.append(
                f"{100 * (1 - self.coverage):.0f} % of the target's surface have no counterpart: more of the bone, or "
                "parts grown to it?"
            )
        if self.agreement < AGREES:
            found.append(f"the surfaces face different ways on {100 * (1 - self.agreement):.0f} % of the bone")
        if self.folded > FOLDED:
            found.append(f"the match folds {100 * self.folded:.1f} % of the surface over: few features are taken there")
        return tuple(found)


def match_quality(ours: Shape, deformed: Shape, goal: Shape, found: Samples, tolerance: float) -> MatchQuality:
    """Judge a match: the source, the same deformed, the target, and where the vertices are on it."""
    share = _vertex_areas(ours)
    away = np.linalg.norm(found.points - deformed.vertices, axis=1)
    order = np.argsort(away)
    at95 = int(np.searchsorted(np.cumsum(share[order]), 0.95))
    matched = Shape(Surface(found.points, ours.faces))
    asked = goal.samples(ASKED).points
    beside = np.linalg.norm(matched.nearest(asked, fine=True).points - asked, axis=1)
    normals = vertex_normals(deformed)
    alike = np.einsum("ij,ij->i", normals, found.normals) > ALIKE
    turned = np.einsum("ij,ij->i", matched.normals, deformed.normals) < 0
    weights = ours.areas / ours.area
    ratio = matched.areas / np.maximum(ours.areas, 1e-12 * ours.area) / (matched.area / ours.area)
    low, high = _quantiles(ratio, weights, (0.01, 0.99))
    return MatchQuality(
        residual=float(np.sqrt(share @ away**2)),
        residual95=float(away[order[min(at95, len(order) - 1)]]),
        symmetric=float(np.sqrt(np.mean(beside**2))),
        coverage=float(np.mean(beside <= tolerance)),
        agreement=float(share @ alike),
        folded=float(weights @ turned),
        shrunk=low,
        grown=high,
    )


def vertex_normals(shape: Shape) -> Array:
    """Unit normals (vertices, 3), the faces' weighted by their areas."""
    normals = np.zeros_like(shape.vertices)
    for corner in shape.faces.T:
        np.add.at(normals, corner, shape.areas[:, None] * shape.normals)
    sizes = np.linalg.norm(normals, axis=1, keepdims=True)
    unit: Array = normals / np.where(sizes > 0, sizes, 1.0)
    return unit


def _vertex_areas(shape: Shape) -> Array:
    """Shares (vertices,) of the area, a third of every face for each of its corners."""
    count = len(shape.vertices)
    share = sum(np.bincount(corner, shape.areas, count) for corner in shape.faces.T)
    areas: Array = np.asarray(share) / (3.0 * shape.area)
    return areas


def _quantiles(values: Array, weights: Array, shares: tuple[float, ...]) -> tuple[float, ...]:
    order = np.argsort(values)
    at = np.searchsorted(np.cumsum(weights[order]), shares)
    return tuple(float(values[order[min(int(k), len(order) - 1)]]) for k in at)
