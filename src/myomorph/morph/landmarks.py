"""Landmarks found by the same rule on two bones: where they end in given directions, and centers of round surfaces.

The target is laid on the source by a similarity first, so that a direction means the same on both. A landmark is kept
only where the rule tells one place on both bones, and about the same place.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.errors import BadData
from myomorph.model.surface import Surface
from myomorph.morph.alignment import align_bones
from myomorph.morph.articular import SphereFit, articular_sphere, doubt, spherical_patches
from myomorph.morph.fields import FeaturePoints
from myomorph.morph.procrustes import Similarity
from myomorph.morph.surface_points import Shape

POINTS = 20000
"""Spread over each surface, among which its ends are looked for."""

DEPTH = 0.004
"""The end of a bone in a direction is what lies within this share of its length of the utmost point."""

SHARP = 0.02
"""An end spread wider than this share of the length, or that moves so far when the direction turns by `TILT`, is flat:
no landmark."""

TILT = np.radians(5.0)

NEAR = 0.05
"""A landmark further from its counterpart, after the similarity, than this share of the length is another place."""

APART = 0.03
"""Landmarks nearer to each other than this share of the length are one."""

RADII = 1.35
"""A round surface of the target has a radius up to so many times that of the source, apart from the whole's size."""

SHIFT, STEADY = 0.2, 0.1
"""A sphere found from starts beside it by so much of its radius must stay in place within so much of it."""


def automatic_landmarks(
    source: Surface, target: Surface, start: Similarity | None = None, rounds: bool = True
) -> FeaturePoints:
    """Landmarks of two bones of one kind, found without a hand.

    Parameters
    ----------
    source : in its body's frame, facing outward
    target : facing outward
    start : from source to target, roughly; found from the surfaces where it is not given, if they tell it
    rounds : look for heads and sockets too

    Returns
    -------
    in the bones' frames: ends along the source's principal axes ("axis 1 +") and its body's ("+x"), centers of heads
    ("head 1") and sockets ("socket 1"); none twice. May be few

    Raises
    ------
    BadData : a surface without area, or without a start, one that could lie in two ways
    """
    if start is None:
        aligned = align_bones(source, target)
        if aligned.doubts():
            raise BadData(f"landmarks cannot be found by rules: {aligned.doubts()[0]}")
        start = aligned.similarity
    laid = Surface(start.inverse().apply(target.vertices), target.faces)
    length = float(np.linalg.norm(np.ptp(source.vertices, axis=0)))
    found: list[tuple[str, Array, Array]] = []
    proposed = list(_ends(source, laid, length)) + (list(_rounds(source, laid, length)) if rounds else [])
    for name, ours, theirs in proposed:
        if np.linalg.norm(ours - theirs) > NEAR * length:
            continue
        if any(np.linalg.norm(ours - other) < APART * length for _, other, _ in found):
            continue
        found.append((name, ours, theirs))
    return FeaturePoints(
        tuple(name for name, _, _ in found),
        np.array([ours for _, ours, _ in found]).reshape(-1, 3),
        start.apply(np.array([theirs for _, _, theirs in found]).reshape(-1, 3)),
    )


def _ends(source: Surface, target: Surface, length: float) -> Iterator[tuple[str, Array, Array]]:
    """Ends of both bones along the source's axes."""
    ours, theirs = (Shape(one).samples(POINTS).points for one in (source, target))
    _, _, rows = np.linalg.svd(ours - ours.mean(axis=0), full_matrices=False)
    named = [(f"axis {k + 1}", rows[k]) for k in range(3)]
    for axis, direction in named:
        for sign in (1.0, -1.0):
            yield from _end(f"{axis} {'+' if sign > 0 else '-'}", ours, theirs, sign * direction, length)
    for k, letter in enumerate("xyz"):
        for sign in (1.0, -1.0):
            yield from _end(f"{'+' if sign > 0 else '-'}{letter}", ours, theirs, sign * np.eye(3)[k], length)


def _end(name: str, ours: Array, theirs: Array, direction: Array, length: float) -> Iterator[tuple[str, Array, Array]]:
    places = [_utmost(points, direction, length) for points in (ours, theirs)]
    if places[0] is not None and places[1] is not None:
        yield name, places[0], places[1]


def _utmost(points: Array, direction: Array, length: float) -> Array | None:
    """Middle of what lies furthest in a direction; None where that is a flat stretch rather than a point."""
    across = np.linalg.svd(direction[None])[2][1:]
    middles = []
    for tilt in ((0.0, 0.0), (1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)):
        along = points @ (direction + np.tan(TILT) * (tilt[0] * across[0] + tilt[1] * across[1]))
        middles.append(points[along > along.max() - DEPTH * length])
    here = middles[0].mean(axis=0)
    spread = float(np.sqrt(np.mean(np.sum((middles[0] - here) ** 2, axis=1))))
    moved = max(float(np.linalg.norm(one.mean(axis=0) - here)) for one in middles[1:])
    return here if max(spread, moved) < SHARP * length else None


def _rounds(source: Surface, target: Surface, length: float) -> Iterator[tuple[str, Array, Array]]:
    """Centers of the same round surfaces on both bones."""
    for what, hollow in (("head", False), ("socket", True)):
        count = 0
        for one in spherical_patches(source, hollow):
            ours, theirs = (_steady(one, surface) for surface in (source, target))
            if ours is None or theirs is None or not 1.0 / RADII < theirs.radius / ours.radius < RADII:
                continue
            if np.linalg.norm(theirs.center - ours.center) < ours.radius:
                count += 1
                yield f"{what} {count}", ours.center, theirs.center


def _steady(one: SphereFit, surface: Surface) -> SphereFit | None:
    """The sphere found from near another one; None where starts beside it lead elsewhere."""
    try:
        found = articular_sphere(surface, one.center, one.radius, one.hollow)
        if doubt(found):
            return None
        for shift in (*np.eye(3), *-np.eye(3)):
            beside = articular_sphere(surface, found.center + SHIFT * found.radius * shift, found.radius, one.hollow)
            if np.linalg.norm(beside.center - found.center) > STEADY * found.radius:
                return None
    except BadData:
        return None
    return found
