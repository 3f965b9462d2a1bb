"""Pose of one whole bone on another before it deforms, and landmarks by one rule on both.

The alignment comes from landmarks, from a rough start, or from shape alone. Automatic landmarks are
where both bones end in given directions, and centers of round surfaces: the target is laid on the
source by a similarity first, so that a direction means the same on both, and a landmark is kept
only where the rule gives one position on both bones, and about the same.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from myomorph.bones.morph.maps.fields import FeaturePoints
from myomorph.bones.morph.registration.affine import (
    EXACT,
    STRAIN,
    WAYS,
    Way,
    affine_ways,
    lay_affinely,
)
from myomorph.bones.morph.registration.smooth import (
    MatchOptions,
    SmoothFit,
    SurfacePair,
    fit_smoothly,
    onto,
)
from myomorph.bones.morph.shapes.articular import articular_sphere, spherical_patches, warning_of
from myomorph.bones.morph.shapes.quadrics import SphereFit
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData
from myomorph.core.model.surface import Surface
from myomorph.core.surfaces.linear_maps import AffineMap, Similarity, procrustes
from myomorph.core.surfaces.rigid_registration import SurfaceOptions, rough_fits
from myomorph.core.surfaces.surface_points import Shape

TURNED = 60.0  # Angle from a rough start beyond which another way to lie is not believed [degrees].
APART = 20.0  # Angle between two ways to lie that are not the same [degrees].
HOPELESS = 3.0
"""Ways to lie that leave more than so many times the best one's distance are not tried with a
deformation.
"""

AMBIGUOUS = 2.0
"""A second way to lie that costs less than so many times the first might be the right one. Of 26
patellas of LLP26 laid by the mean of the others in any frame one lies upside down, at 1.4 times; of
the others one is nearer than twice.
"""

UPRIGHT = 30.0
"""Of ways that may be right, one that turns the frame by less than this is taken: files of bones
often keep the body's frame [degrees].
"""

LINE = 0.05
"""Landmarks whose spread across their line is below this share of that along it do not say how a
bone is turned.
"""

QUICK = 500  # Points in the deformations that only choose between ways to lie.
ROUGH = (0.01, 0.004, 0.002, 0.001)  # Exactness of the planes in each of their steps.
MIRRORED_WAYS = 2  # Ways of the mirrored source that are tried with a deformation.
# Squares of a deformation's coefficients that make a way as unlikely as a distance e times as
# large.
BENT = 1000.0
# Share of the bone's length that a deformation leaves where the hulls do not say how the bones lie.
UNLIKE = 0.01
MIRROR = np.array([1.0, 1.0, -1.0])

RIGID = SurfaceOptions(mirror=False)


@dataclass(frozen=True, eq=False)
class Alignment:
    """A whole bone laid on another."""

    affine: AffineMap  # from the source's frame to the target's
    similarity: Similarity  # nearest to it over the source's bone
    # that remains after a quick deformation, more where that is unlikely [m]
    distance: float = float("nan")
    left: float = float("nan")  # that remains, however unlikely the deformation is [m]
    # other ways to lie, with their distances, the nearest first
    others: tuple[tuple[Similarity, float], ...] = ()

    def warnings(self) -> tuple[str, ...]:
        """Another way to lie that may be the right one."""
        for other, distance in self.others:
            if distance < AMBIGUOUS * max(self.distance, EXACT):
                return (
                    (
                        "the bone fits nearly as well turned by"
                        f" {turn_between(other, self.similarity):.0f} degrees"
                        f" ({distance / max(self.distance, EXACT):.2f} times the distance):"
                        " landmarks would determine its orientation"
                    ),
                )
        return ()


def align_bones(
    source: Surface,
    target: Surface,
    landmarks: FeaturePoints | None = None,
    start: Similarity | None = None,
    options: MatchOptions | None = None,
) -> Alignment:
    """Find the affine map from a whole bone to another of about unit length, maybe only a part.

    Every pose that fits, and lies near the landmarks or the start where there are some, is tried
    with a deformation. Of those that fit about equally well one that keeps the frame's axes is
    chosen, if nothing else defines the pose.
    """
    ours = Shape(source)
    goal = Shape(target)
    if (
        landmarks is not None
        and spans_a_plane(landmarks.source)
        and spans_a_plane(landmarks.target)
    ):
        start = procrustes(landmarks.source, landmarks.target, scale=True)
    tried = _tried(ours, goal, start, landmarks, options or MatchOptions())
    chosen = tried[0]
    if start is not None:
        return chosen
    equal = [way for way in tried if way.distance < AMBIGUOUS * max(chosen.distance, EXACT)]
    chosen = next((way for way in equal if turned_by(way.similarity) < UPRIGHT), chosen)
    apart = [
        way
        for way in tried
        if way is not chosen and turn_between(way.similarity, chosen.similarity) > APART
    ]
    return replace(chosen, others=tuple((way.similarity, way.distance) for way in apart))


def mirrored_share(
    source: Surface, target: Surface, left: float, options: MatchOptions | None = None
) -> float:
    """Return the distance that the mirrored source leaves at its likeliest, over the source's.

    Below 1 the mirrored one fits better. How unlikely both deformations are does not count: between
    two persons' tali one is a thousand times as unlikely as the other where the distances are
    alike.
    """
    mirrored = Shape(Surface(source.vertices * MIRROR, source.faces[:, ::-1]))
    tried = _tried(mirrored, Shape(target), None, None, options or MatchOptions(), MIRRORED_WAYS)
    return max(tried[0].left, EXACT) / max(left, EXACT)


def _tried(
    ours: Shape,
    goal: Shape,
    start: Similarity | None,
    landmarks: FeaturePoints | None,
    options: MatchOptions,
    most: int = WAYS,
) -> list[Alignment]:
    """Return poses that fit, the nearest after a deformation first.

    Where hulls do not lead to a good one, as those of a part, similarities are tried.
    """
    points = ours.samples(ASKED).points
    quick = replace(options, match_points=min(QUICK, options.match_points))
    surfaces = SurfacePair(ours, goal, landmarks)

    def deformed(ways: list[Way]) -> list[Alignment]:
        """Return the likeliest poses after a deformation."""
        laid = [(way, procrustes(points, way.affine.apply(points), scale=True)) for way in ways]
        if start is not None:
            laid = [
                (way, similarity)
                for way, similarity in laid
                if turn_between(similarity, start) < TURNED
            ]
            if not laid:
                near = lay_affinely(ours, goal, AffineMap.from_similarity(start), landmarks)
                laid.append((near, procrustes(points, near.affine.apply(points), scale=True)))
        laid.sort(key=lambda way: way[0].cost)
        tried: list[Alignment] = []
        for way, similarity in laid:
            if len(tried) == most or way.cost > HOPELESS * laid[0][0].cost:
                break
            if any(turn_between(similarity, other.similarity) < APART for other in tried):
                continue
            fit = fit_smoothly(surfaces, way.affine, quick, ROUGH)
            unlikely = fit.bending / BENT + 0.5 * (way.strain / STRAIN) ** 2
            left = _distance(ours, goal, fit)
            tried.append(
                Alignment(
                    affine=way.affine,
                    similarity=similarity,
                    distance=left * float(np.exp(unlikely)),
                    left=left,
                )
            )
        return sorted(tried, key=lambda way: way.distance)

    ways = affine_ways(ours, goal)
    tried = deformed(ways)
    if most == WAYS and (not tried or tried[0].distance > UNLIKE):
        tried = deformed([*ways, *_similar_ways(ours, goal)])
    return tried


def _similar_ways(ours: Shape, goal: Shape) -> list[Way]:
    """Return poses of a bone that may be a part.

    The registration expects something whole, on which it lays the part.
    """
    theirs = Surface(goal.vertices, goal.faces)
    source = Surface(ours.vertices, ours.faces)
    starts = (fit.similarity.inverse() for fit in rough_fits(theirs, source, RIGID))
    return [lay_affinely(ours, goal, AffineMap.from_similarity(start)) for start in starts]


def spans_a_plane(points: Array) -> bool:
    """Return whether points are three or more and not on a line.

    Parameters
    ----------
    points : (n, 3)

    Returns
    -------
    whether they are
    """
    if len(points) < 3:
        return False
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(spread[1] > LINE * spread[0])


def turned_by(similarity: Similarity) -> float:
    """Angle of a rotation [degrees]."""
    return turn_between(similarity, Similarity(np.eye(3), np.zeros(3)))


def turn_between(similarity: Similarity, other: Similarity) -> float:
    """Angle between two rotations [degrees]."""
    cosine = 0.5 * (np.trace(similarity.rotation.T @ other.rotation) - 1.0)
    return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))


def _distance(ours: Shape, goal: Shape, fit: SmoothFit) -> float:
    """Return the root mean square distance both ways after a deformation.

    It is taken between points that face the same way.
    """
    deformed = Shape(Surface(fit.apply(ours.vertices), ours.faces))
    away = []
    for asked, other in ((deformed.samples(ASKED), goal), (goal.samples(ASKED), deformed)):
        away.append(
            np.sum((onto(other, asked.points, asked.normals).points - asked.points) ** 2, axis=1)
        )
    if goal.is_open:
        away = away[1:]
    return float(np.sqrt(np.mean(np.concatenate(away))))


ASKED = 1500  # Points of either surface whose distance to the other is asked.
POINTS = 20000  # Spread over each surface, among which its ends are looked for.
# The end of a bone in a direction is what lies within this share of its length of the utmost point.
DEPTH = 0.004
SHARP = 0.02
"""An end spread wider than this share of the length, or that moves so far when the direction turns
by `TILT`, is flat: no landmark.
"""

TILT = np.radians(5.0)

NEAR = 0.05
"""A landmark further from its counterpart, after the similarity, than this share of the length is
another place.
"""

MIN_SEPARATION = 0.03  # Landmarks nearer to each other than this share of the length are one.
RADII = 1.35
"""A round surface of the target has a radius up to so many times that of the source, apart from the
whole's size.
"""

SHIFT = 0.2
STEADY = 0.1
"""A sphere found from starts beside it by so much of its radius must stay in place within so much
of it.
"""


def automatic_landmarks(
    source: Surface, target: Surface, start: Similarity | None = None, rounds: bool = True
) -> FeaturePoints:
    """Find landmarks of two bones of one kind by rule, without a hand, in the bones' frames.

    The surfaces face outward. Landmarks are ends along the source's principal axes ("axis 1 +") and
    its body's ("+x"), centers of heads ("head 1") and sockets ("socket 1"); none twice, may be few.
    `start`: from source to target, roughly; found from the surfaces if they show it.
    """
    if start is None:
        aligned = align_bones(source, target)
        if aligned.warnings():
            raise BadData(f"landmarks cannot be found by rules: {aligned.warnings()[0]}")
        start = aligned.similarity
    laid = Surface(start.inverse().apply(target.vertices), target.faces)
    length = float(np.linalg.norm(np.ptp(source.vertices, axis=0)))
    landmarks: list[tuple[str, Array, Array]] = []
    proposed = list(_ends(source, laid, length)) + (
        list(_rounds(source, laid, length)) if rounds else []
    )
    for name, ours, theirs in proposed:
        if np.linalg.norm(ours - theirs) > NEAR * length:
            continue
        if any(np.linalg.norm(ours - other) < MIN_SEPARATION * length for _, other, _ in landmarks):
            continue
        landmarks.append((name, ours, theirs))
    return FeaturePoints(
        tuple(name for name, _, _ in landmarks),
        np.array([ours for _, ours, _ in landmarks]).reshape(-1, 3),
        start.apply(np.array([theirs for _, _, theirs in landmarks]).reshape(-1, 3)),
    )


def _ends(source: Surface, target: Surface, length: float) -> Iterator[tuple[str, Array, Array]]:
    """Yield ends of both bones along the source's axes."""
    ours = Shape(source).samples(POINTS).points
    theirs = Shape(target).samples(POINTS).points
    axes = np.linalg.svd(ours - ours.mean(axis=0), full_matrices=False)[2]
    ways = {
        f"axis {index + 1} {sign}": float(f"{sign}1") * axes[index]
        for index in range(3)
        for sign in "+-"
    }
    ways |= {
        f"{sign}{'xyz'[index]}": float(f"{sign}1") * np.eye(3)[index]
        for index in range(3)
        for sign in "+-"
    }
    for name, direction in ways.items():
        places = [_utmost(points, direction, length) for points in (ours, theirs)]
        if places[0] is not None and places[1] is not None:
            yield name, places[0], places[1]


def _utmost(points: Array, direction: Array, length: float) -> Array | None:
    """Return the middle of what lies furthest in a direction.

    None where that is a flat stretch rather than a point.
    """
    across = np.linalg.svd(direction[None])[2][1:]
    middles = []
    for tilt in ((0.0, 0.0), (1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)):
        along = points @ (direction + np.tan(TILT) * (tilt[0] * across[0] + tilt[1] * across[1]))
        middles.append(points[along > along.max() - DEPTH * length])
    here = middles[0].mean(axis=0)
    spread = float(np.sqrt(np.mean(np.sum((middles[0] - here) ** 2, axis=1))))
    moved = max(float(np.linalg.norm(middle.mean(axis=0) - here)) for middle in middles[1:])
    return here if max(spread, moved) < SHARP * length else None


def _rounds(source: Surface, target: Surface, length: float) -> Iterator[tuple[str, Array, Array]]:
    """Centers of the same round surfaces on both bones."""
    for what, hollow in (("head", False), ("socket", True)):
        count = 0
        for patch in spherical_patches(source, hollow):
            ours = _steady(patch, source)
            theirs = _steady(patch, target)
            if (
                ours is None
                or theirs is None
                or not 1.0 / RADII < theirs.radius / ours.radius < RADII
            ):
                continue
            if np.linalg.norm(theirs.center - ours.center) < ours.radius:
                count += 1
                yield f"{what} {count}", ours.center, theirs.center


def _steady(sphere_fit: SphereFit, surface: Surface) -> SphereFit | None:
    """Find the sphere again from near it; None where starts beside it lead elsewhere."""
    try:
        result = articular_sphere(surface, sphere_fit.center, sphere_fit.radius, sphere_fit.hollow)
        if warning_of(result):
            return None
        for shift in (*np.eye(3), *-np.eye(3)):
            beside = articular_sphere(
                surface,
                result.center + SHIFT * result.radius * shift,
                result.radius,
                sphere_fit.hollow,
            )
            if np.linalg.norm(beside.center - result.center) > STEADY * result.radius:
                return None
    except BadData:
        return None
    return result
