"""Landmarks of two bones before they are used: their unit, their place on the bones, their order, their side."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from scipy.optimize import linear_sum_assignment

from myomorph.model.arrays import Array, frozen_array
from myomorph.model.errors import BadData, quoted
from myomorph.model.surface import Surface
from myomorph.morph.maps.fields import FeaturePoints
from myomorph.morph.maps.linear import Similarity, fit_points, procrustes
from myomorph.morph.shapes.articular import mm
from myomorph.morph.shapes.surface_points import Shape

LIKE = 3.0  # Landmarks spread so many times wider or narrower than expected are in another unit, or of another bone.
UNITS = (("millimeters", 1000.0), ("centimeters", 100.0))

OFF = 0.15
"""A landmark further from a bone's surface than this share of its length is named, and where half of them are they are
not that bone's: the center of a femur's head is 0.05 deep, that of a pelvis's hip as far outside."""

UNLIKE = 0.25
"""Residual, as a share of the landmarks' spread, above which they are not of the same bone; points thrown at random on
two bones leave 0.3 and more."""

ODD = 0.12  # And from which that is doubted.
MIRRORED = 0.5  # Share of the residual that mirrored landmarks leave, below which they are those of the other side.
REORDERED = 0.5  # Share of the residual that another order leaves, below which landmarks are said to be interchanged.
MAX_COUNT = 80  # Landmarks among which all swaps are tried.


def check_landmarks(
    body: str, landmarks: FeaturePoints, source: Surface | None = None, target: Surface | None = None
) -> tuple[Similarity | None, list[str]]:
    """The similarity from source to target that fits landmarks, None where they are too few or on a line, and what
    looks odd about them, alone and on the bones that they are said to be of.
    """
    for side, points, surface in (("source", landmarks.source, source), ("target", landmarks.target, target)):
        if surface is not None:
            _check_unit_on(body, side, points, surface)
    if len(landmarks) > 1:
        _check_spread(body, landmarks)
    notes: list[str] = []
    whole = _fitted(body, landmarks, notes) if len(landmarks) >= 3 else None
    for side, points, surface in (("source", landmarks.source, source), ("target", landmarks.target, target)):
        if surface is not None:
            notes += _off_surface(body, side, landmarks.names, points, surface)
    return whole, notes


def _fitted(body: str, landmarks: FeaturePoints, notes: list[str]) -> Similarity | None:
    """The similarity between the two sides; refuses what none explains."""
    try:
        points = fit_points(landmarks.names, landmarks.source, landmarks.target, True)
    except BadData as error:
        notes.append(f"landmarks of '{body}': {error}")
        return None
    spread = _spread(landmarks.target)
    mirrored = _left(landmarks.source * [1.0, 1.0, -1.0], landmarks.target)
    _check_order(body, landmarks, min(REORDERED * points.rms, mirrored), points.rms)
    if len(landmarks) > 3 and points.rms > 0.01 * spread and mirrored < MIRRORED * points.rms:
        raise BadData(
            f"the landmarks of '{body}' fit within {mm(mirrored)} instead of {mm(points.rms)} when "
            "mirrored: are they of the other side? Give those of this side, or say that the bone is to be mirrored"
        )
    left = f"{mm(points.rms)} remain of a spread of {mm(spread)}"
    if points.rms > UNLIKE * spread:
        raise BadData(
            f"the landmarks of '{body}' do not fit: {left}; are they of another bone, or is one side's table another's?"
        )
    if points.rms > ODD * spread:
        notes.append(f"the landmarks of '{body}' fit badly: {left}")
    notes += [f"landmarks of '{body}': {line}" for line in points.notes]
    return points.similarity


def _left(source: Array, target: Array) -> float:
    """Root mean square distance that a similarity leaves [m]."""
    return float(np.sqrt(np.mean(np.sum((procrustes(source, target, True).apply(source) - target) ** 2, axis=1))))


def _check_unit_on(body: str, side: str, points: Array, surface: Surface) -> None:
    """Refuse points that are far from a bone, naming the unit in which they would be near it."""
    shape, length = Shape(surface), float(np.linalg.norm(np.ptp(surface.vertices, axis=0)))

    def off(factor: float) -> float:
        return float(np.median(np.abs(shape.signed(points / factor)))) / length

    if off(1.0) <= OFF:
        return
    unit, factor = min(UNITS, key=lambda unit: off(unit[1]))
    if off(factor) <= OFF and (len(points) == 1 or _spread(points) > LIKE * length):
        raise BadData(
            f"the {side} landmarks of '{body}' lie {off(1.0) * length:.3g} m from its bone, and on it when divided by "
            f"{factor:g}: are they in {unit}? Give meters"
        )
    raise BadData(
        f"the {side} landmarks of '{body}' lie {off(1.0) * length:.3g} m from its bone, which is {length:.3g} m long: "
        f"are they of another bone, or in another frame than the {side}'s surface?"
    )


def _check_spread(body: str, landmarks: FeaturePoints) -> None:
    ratio = _spread(landmarks.target) / max(_spread(landmarks.source), 1e-12)
    if 1.0 / LIKE < ratio < LIKE:
        return
    like = {
        f", as if {whose}in {name}: give meters": ratio / factor**sign
        for whose, sign in (("", 1.0), ("the source's were ", -1.0))
        for name, factor in UNITS
    }
    unit = next((text for text, rest in like.items() if 1 / LIKE < rest < LIKE), ": are both of the same bone?")
    raise BadData(
        f"the target landmarks of '{body}' spread over {_spread(landmarks.target):.4g} m, those of the source over "
        f"{_spread(landmarks.source):.4g} m{unit}"
    )


def _check_order(body: str, landmarks: FeaturePoints, enough: float, rms: float) -> None:
    """Refuse landmarks that fit better than `enough` [m] in another order, naming those that are interchanged."""
    if len(landmarks) < 4 or rms < 0.01 * _spread(landmarks.target):
        return
    best, order = rms, np.arange(len(landmarks))
    for start in _orders(landmarks):
        other, left = _settled(landmarks, start)
        if left < best:
            best, order = left, other
    if best < enough:
        wrong = np.flatnonzero(order != np.arange(len(order))).tolist()
        listed = ", ".join(
            f"'{landmarks.names[index]}' where '{landmarks.names[order[index]]}' is" for index in wrong[:4]
        )
        raise BadData(
            f"the landmarks of '{body}' are in another order on the target: with {len(wrong)} of {len(order)} "
            f"interchanged they fit within {mm(best)} instead of {mm(rms)} ({listed}{', ...' if wrong[4:] else ''})"
        )


def _orders(landmarks: FeaturePoints) -> list[np.ndarray]:
    """Orders of the target to try: the one in which distances to all others agree, and the swaps that help most."""
    count = len(landmarks)
    profiles = []
    for points in (landmarks.source, landmarks.target):
        apart = np.linalg.norm(points[:, None] - points[None], axis=2)
        profiles.append(np.sort(apart, axis=1) / np.mean(apart))
    cost = np.linalg.norm(profiles[0][:, None] - profiles[1][None], axis=2)
    swaps = []
    for a, b in combinations(range(count), 2) if count <= MAX_COUNT else ():
        order = np.arange(count)
        order[[a, b]] = b, a
        swaps.append(order)
    swaps.sort(key=lambda order: _left(landmarks.source, landmarks.target[order]))
    return [linear_sum_assignment(cost)[1], *swaps[:2]]


def _settled(landmarks: FeaturePoints, order: np.ndarray) -> tuple[np.ndarray, float]:
    """An order improved by laying on and pairing in turn, and the root mean square distance it leaves [m]."""
    left = _left(landmarks.source, landmarks.target[order])
    for _ in range(20):
        laid = procrustes(landmarks.source, landmarks.target[order], True).apply(landmarks.source)
        cost = np.sum((laid[:, None] - landmarks.target[None]) ** 2, axis=2)
        other = linear_sum_assignment(cost)[1]
        remain = _left(landmarks.source, landmarks.target[other])
        if remain >= left:
            break
        order, left = other, remain
    return order, left


def _off_surface(body: str, side: str, names: Sequence[str], points: Array, surface: Surface) -> list[str]:
    length = float(np.linalg.norm(np.ptp(surface.vertices, axis=0)))
    apart = np.abs(Shape(surface).signed(points))
    wrong = np.flatnonzero(apart > OFF * length).tolist()
    if not wrong:
        return []
    named = quoted(names[index] for index in wrong)
    return [f"{side} landmarks of '{body}' lie up to {mm(float(apart.max()))} from the bone's surface: {named}"]


def _spread(points: Array) -> float:
    """Root mean square distance from the middle, twice [m]."""
    return 2.0 * float(np.sqrt(np.mean(np.sum((frozen_array(points) - points.mean(axis=0)) ** 2, axis=1))))
