"""Dense correspondence of two bones: which point of the target each point of the source becomes.

An affine map first (by the moments of both hulls, from many starts, of which a deformation
chooses), then a smooth displacement, then the nearest point of the target's surface that faces the
same way. All sizes are shares of the bones' lengths, so a mouse and a man are matched alike.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from myomorph.bones.morph.maps.fields import FeaturePoints
from myomorph.bones.morph.registration.affine import lay_affinely, unit
from myomorph.bones.morph.registration.alignment import align_bones, mirrored_share
from myomorph.bones.morph.registration.smooth import (
    FACING,
    MatchOptions,
    SmoothFit,
    SurfacePair,
    fit_smoothly,
    match_radii,
    onto,
    spread_points,
)
from myomorph.core.model.arrays import Array, frozen_array, read_only
from myomorph.core.model.surface import Surface
from myomorph.core.surfaces.linear_maps import AffineMap, Similarity
from myomorph.core.surfaces.surface_points import Samples, Shape

COVERED = 0.95
AGREES = 0.9
INVERTED = 0.01
STRETCHED = 4.0
"""Below this coverage and agreement, above this share inverted and this ratio of areas, a match is
questioned.
"""

ASKED = 4000  # Points of the target of which it is asked whether they are reached.
ALIKE = 0.5  # Cosine between normals that agree: 60 degrees.


@dataclass(frozen=True)
class MatchQuality:
    """Lengths are shares of the target's length, so that bones of all sizes compare."""

    residual: float  # root mean square distance between the smooth deformation and the surface
    residual95: float  # 95 % of the source's area is nearer than that
    symmetric: float  # root mean square distance from the target's points to the matched source
    coverage: float  # share of the target's area that the matched source comes near
    # share of the source's area whose normals agree with the target's within 60 degrees
    agreement: float
    inverted: float  # share of the source's area turned over
    # shrunk, grown: 1 % of the area changes by less than `shrunk` or more than `grown`, over the
    # change of the whole
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
            "inverted": self.inverted,
            "area shrunk": self.shrunk,
            "area grown": self.grown,
        }

    def warnings(self, tolerance: float) -> tuple[str, ...]:
        """Report what looks wrong, one line each."""
        texts = []
        if self.residual95 > tolerance:
            texts.append(
                f"5 % of the bone stay more than {100 * self.residual95:.1f} % of its length from"
                " the other's surface where it deforms smoothly: other shapes, or not the same"
                " bone?"
            )
        if self.coverage < COVERED:
            texts.append(
                f"{100 * (1 - self.coverage):.0f} % of the target's surface have no counterpart:"
                " more of the bone, or parts grown to it?"
            )
        if self.agreement < AGREES:
            texts.append(
                f"the surfaces face different ways on {100 * (1 - self.agreement):.0f} % of the"
                " bone"
            )
        if self.inverted > INVERTED:
            texts.append(
                f"the match inverts {100 * self.inverted:.1f} % of the surface: few features are"
                " taken there"
            )
        return tuple(texts)


def match_quality(
    ours: Shape, deformed: Shape, goal: Shape, samples: Samples, tolerance: float
) -> MatchQuality:
    """Judge a match from source, deformed source, target and the vertices' positions on it."""
    # A third of every face for each of its corners.
    corners = sum(np.bincount(corner, ours.areas, len(ours.vertices)) for corner in ours.faces.T)
    share = np.asarray(corners) / (3.0 * ours.area)
    away = np.linalg.norm(samples.points - deformed.vertices, axis=1)
    matched = Shape(Surface(samples.points, ours.faces))
    asked = goal.samples(ASKED).points
    beside = np.linalg.norm(matched.nearest(asked, fine=True).points - asked, axis=1)
    normals = vertex_normals(deformed)
    alike = np.einsum("ij,ij->i", normals, samples.normals) > ALIKE
    turned = np.einsum("ij,ij->i", matched.normals, deformed.normals) < 0
    weights = ours.areas / ours.area
    ratio = matched.areas / np.maximum(ours.areas, 1e-12 * ours.area) / (matched.area / ours.area)
    low, high = _quantiles(ratio, weights, (0.01, 0.99))
    return MatchQuality(
        residual=float(np.sqrt(share @ away**2)),
        residual95=_quantiles(away, share, (0.95,))[0],
        symmetric=float(np.sqrt(np.mean(beside**2))),
        coverage=float(np.mean(beside <= tolerance)),
        agreement=float(share @ alike),
        inverted=float(weights @ turned),
        shrunk=low,
        grown=high,
    )


def vertex_normals(shape: Shape) -> Array:
    """Return unit normals of vertices, the faces' weighted by their areas.

    Parameters
    ----------
    shape : surface with vertices and faces

    Returns
    -------
    (vertices, 3)
    """
    normals = np.zeros_like(shape.vertices)
    for corner in shape.faces.T:
        np.add.at(normals, corner, shape.areas[:, None] * shape.normals)
    return unit(normals)


def _quantiles(values: Array, weights: Array, shares: tuple[float, ...]) -> tuple[float, ...]:
    order = np.argsort(values)
    at = np.searchsorted(np.cumsum(weights[order]), shares)
    return tuple(float(values[order[min(int(number), len(order) - 1)]]) for number in at)


@dataclass(frozen=True, eq=False)
class PlacedBone:
    """A bone laid on another before it deforms."""

    similarity: Similarity  # from the source's frame to the target's [m]
    # the same with its stretches [m]; None where only the similarity is known
    affine: AffineMap | None = None
    # share of the distance that the mirrored source leaves; NaN where landmarks said how the bones
    # lie
    mirrored: float = float("nan")
    notes: tuple[str, ...] = ()  # what looks wrong, one line each


@read_only
class SurfaceMatch:
    """Points of a surface and where they are on another."""

    points: Array  # (vertices, 3) on the target, one for every vertex of the source [m]
    # points spread evenly over the source, and where they are on the target, the matched ones alone
    # [m]
    pairs: FeaturePoints
    placed: PlacedBone  # how the source lay before it was deformed
    length: float  # of the target along its longest axis [m]
    quality: MatchQuality  # residuals, coverage, folds
    notes: tuple[str, ...] = ()  # what looks wrong, one line each


def place_bone(
    source: Surface,
    target: Surface,
    landmarks: FeaturePoints | None = None,
    start: Similarity | None = None,
    options: MatchOptions | None = None,
) -> PlacedBone:
    """Lay a whole bone on another, which may be cut off.

    Three or more landmarks that are not on a line define the pose; else it is that in which the
    bone's shape, or its mirrored shape, fits best. `start`: where the source roughly lies, for want
    of such landmarks.
    """
    ours = _Unit(source)
    goal = _Unit(target)
    pulls = None if landmarks is None else _in_units(landmarks, ours, goal)
    near = None if start is None else _between_units(start, 1.0 / ours.length, 1.0 / goal.length)
    aligned = align_bones(ours.surface, goal.surface, pulls, near, options)
    mirrored = float("nan")
    if landmarks is None:
        mirrored = mirrored_share(ours.surface, goal.surface, aligned.left, options)
    return PlacedBone(
        similarity=_between_units(aligned.similarity, ours.length, goal.length),
        affine=_grown(aligned.affine, 1.0 / ours.length, goal.length),
        mirrored=mirrored,
        notes=aligned.warnings(),
    )


def match_surfaces(
    source: Surface,
    target: Surface,
    landmarks: FeaturePoints | None = None,
    options: MatchOptions | None = None,
    placed: PlacedBone | None = None,
) -> SurfaceMatch:
    """Find for every point of a whole bone the same point of another's, which may be cut off.

    Three landmarks that are not on a line define how the bones lie; fewer only pull. `placed`: what
    `place_bone` finds, where it is known already.
    """
    options = options or MatchOptions()
    placed = placed or place_bone(source, target, landmarks, None, options)
    ours = _Unit(source)
    goal = _Unit(target)
    pulls = None if landmarks is None else _in_units(landmarks, ours, goal)
    surfaces = SurfacePair(ours.shape, goal.shape, pulls)
    smooth = fit_smoothly(surfaces, _begun(placed, ours, goal, pulls), options)
    deformed = Shape(Surface(smooth.apply(ours.shape.vertices), source.faces))
    closest = onto(goal.shape, deformed.vertices, vertex_normals(deformed))
    quality = match_quality(ours.shape, deformed, goal.shape, closest, options.match_tolerance)
    return SurfaceMatch(
        points=frozen_array(closest.points * goal.length),
        pairs=_pairs(ours, goal, smooth, deformed, pulls, options),
        placed=placed,
        length=goal.length,
        quality=quality,
        notes=(*placed.notes, *quality.warnings(options.match_tolerance)),
    )


class _Unit:
    """A surface in units of its length, the extent along its longest principal axis."""

    def __init__(self, surface: Surface):
        samples = Shape(surface).samples(2000).points
        longest = np.linalg.svd(samples - samples.mean(axis=0), full_matrices=False)[2][0]
        self.length = float(np.ptp(surface.vertices @ longest))
        self.surface = Surface(surface.vertices / self.length, surface.faces)
        self.shape = Shape(self.surface)


def _in_units(landmarks: FeaturePoints, ours: _Unit, goal: _Unit) -> FeaturePoints:
    return FeaturePoints(
        landmarks.names, landmarks.source / ours.length, landmarks.target / goal.length
    )


def _between_units(similarity: Similarity, ours: float, theirs: float) -> Similarity:
    """Return the same similarity between bones scaled by factors."""
    return Similarity(
        similarity.rotation, similarity.translation * theirs, similarity.scale * theirs / ours
    )


def _begun(placed: PlacedBone, ours: _Unit, goal: _Unit, pulls: FeaturePoints | None) -> AffineMap:
    """Return the affine map of a bone in units of its length."""
    if placed.affine is not None:
        return _grown(placed.affine, ours.length, 1.0 / goal.length)
    start = _between_units(placed.similarity, 1.0 / ours.length, 1.0 / goal.length)
    return lay_affinely(ours.shape, goal.shape, AffineMap.from_similarity(start), pulls).affine


def _grown(affine: AffineMap, ours: float, theirs: float) -> AffineMap:
    """Return the same map with the source's lengths times a factor before, the target's after."""
    return AffineMap(theirs * ours * affine.matrix, theirs * affine.offset)


def _pairs(
    ours: _Unit,
    goal: _Unit,
    fit: SmoothFit,
    deformed: Shape,
    pulls: FeaturePoints | None,
    options: MatchOptions,
) -> FeaturePoints:
    """Return the evenly spread points of the source that have a position on the target.

    Each has a weight and a radius.
    """
    samples = spread_points(ours.shape, options.match_points)
    smooth = fit.apply(samples)
    normals = deformed.nearest(smooth, fine=True).normals
    closest = onto(goal.shape, smooth, normals)
    near = np.linalg.norm(closest.points - smooth, axis=1) <= options.match_tolerance
    kept = near & ~closest.rim & (np.einsum("ij,ij->i", closest.normals, normals) > FACING)
    names = tuple(f"surface {index + 1}" for index in np.flatnonzero(kept))
    surfaces = SurfacePair(ours.shape, goal.shape, pulls)
    radii = goal.length * match_radii(surfaces, fit, samples[kept], options)
    return FeaturePoints(
        names=names,
        source=samples[kept] * ours.length,
        target=closest.points[kept] * goal.length,
        weights=None,
        radii=radii,
    )
