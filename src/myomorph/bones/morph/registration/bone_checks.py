"""Checks of a target's bone and its landmarks before they are used.

They concern unit, side, frame, triangles, positions on the bone, and order.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np
import scipy

from myomorph.bones.morph.maps.fields import FeaturePoints
from myomorph.bones.morph.registration.alignment import turned_by
from myomorph.bones.morph.shapes.articular import mm
from myomorph.core.model.arrays import Array, frozen_array
from myomorph.core.model.errors import BadData, from_extra, quoted
from myomorph.core.model.surface import (
    Surface,
    area_of,
    border_of,
    distinct_faces,
    face_crosses,
    pieces_of,
    turned_outward,
    used_part,
)
from myomorph.core.surfaces.linear_maps import Similarity, fit_points, procrustes
from myomorph.core.surfaces.rigid_registration import SurfaceOptions, register_surface
from myomorph.core.surfaces.surface_points import Shape

OFF = 0.15
"""A landmark further from a bone's surface than this share of its length is named, and where half
of them are they are not that bone's: the center of a femur's head is 0.05 deep, that of a pelvis's
hip as far outside.
"""

NOT_ALIKE = 0.25
"""Residual, as a share of the landmarks' spread, above which they are not of the same bone; points
thrown at random on two bones leave 0.3 and more.
"""

ODD = 0.12  # And from which that is questioned.
# Share of the residual that mirrored landmarks leave, below which they are those of the other side.
MIRRORED = 0.5
# Share of the residual that another order leaves, below which landmarks are said to be
# interchanged.
REORDERED = 0.5
MAX_COUNT = 80  # Landmarks among which all swaps are tried.


def check_landmarks(
    body: str,
    landmarks: FeaturePoints,
    source: Surface | None = None,
    target: Surface | None = None,
) -> tuple[Similarity | None, list[str]]:
    """Fit the similarity from source to target to landmarks, and check them.

    Returns the similarity, None where they are too few or on a line, and a line for whatever looks
    odd about them, alone and on the bones to which they are assigned.
    """
    for side, points, surface in (
        ("source", landmarks.source, source),
        ("target", landmarks.target, target),
    ):
        if surface is not None:
            _check_unit_on(body, side, points, surface)
    if len(landmarks) > 1:
        _check_spread(body, landmarks)
    notes: list[str] = []
    whole = _fitted(body, landmarks, notes) if len(landmarks) >= 3 else None
    for side, points, surface in (
        ("source", landmarks.source, source),
        ("target", landmarks.target, target),
    ):
        if surface is not None:
            notes += _off_surface(body, side, landmarks.names, points, surface)
    return whole, notes


def _fitted(body: str, landmarks: FeaturePoints, notes: list[str]) -> Similarity | None:
    """Fit the similarity between the two sides; refuse landmarks that none explains."""
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
            f"the landmarks of '{body}' fit within {mm(mirrored)} instead of {mm(points.rms)} when"
            " mirrored: are they of the other side? Give those of this side, or specify that the"
            " bone is mirrored"
        )
    left = f"{mm(points.rms)} remain of a spread of {mm(spread)}"
    if points.rms > NOT_ALIKE * spread:
        raise BadData(
            f"the landmarks of '{body}' do not fit: {left}; are they of another bone or side?"
        )
    if points.rms > ODD * spread:
        notes.append(f"the landmarks of '{body}' fit badly: {left}")
    notes += [f"landmarks of '{body}': {line}" for line in points.notes]
    return points.similarity


def _left(source: Array, target: Array) -> float:
    """Root mean square distance that a similarity leaves [m]."""
    return float(
        np.sqrt(
            np.mean(np.sum((procrustes(source, target, True).apply(source) - target) ** 2, axis=1))
        )
    )


def _check_unit_on(body: str, side: str, points: Array, surface: Surface) -> None:
    """Refuse points that are far from a bone, naming the unit in which they would be near it."""
    shape = Shape(surface)
    length = float(np.linalg.norm(np.ptp(surface.vertices, axis=0)))

    def off(factor: float) -> float:
        return float(np.median(np.abs(shape.signed(points / factor)))) / length

    if off(1.0) <= OFF:
        return
    unit, factor = min(UNITS[:2], key=lambda unit: off(unit[1]))
    if off(factor) <= OFF and (len(points) == 1 or _spread(points) > LIKE * length):
        raise BadData(
            f"the {side} landmarks of '{body}' fit its bone when divided by {factor:g}: are they in"
            f" {unit}? Give meters"
        )
    raise BadData(
        f"the {side} landmarks of '{body}' lie {off(1.0) * length:.3g} m from its bone, which is"
        f" {length:.3g} m long: are they of another bone, or in another frame than the {side}'s"
        " surface?"
    )


def _check_spread(body: str, landmarks: FeaturePoints) -> None:
    ratio = _spread(landmarks.target) / max(_spread(landmarks.source), 1e-12)
    if 1.0 / LIKE < ratio < LIKE:
        return
    like = {
        f", as if {whose}in {name}: give meters": ratio / factor**sign
        for whose, sign in (("", 1.0), ("the source's were ", -1.0))
        for name, factor in UNITS[:2]
    }
    unit = next(
        (text for text, rest in like.items() if 1 / LIKE < rest < LIKE),
        ": are both of the same bone?",
    )
    raise BadData(
        f"the target landmarks of '{body}' spread over {_spread(landmarks.target):.4g} m, those of"
        f" the source over {_spread(landmarks.source):.4g} m{unit}"
    )


def _check_order(body: str, landmarks: FeaturePoints, enough: float, rms: float) -> None:
    """Refuse landmarks that fit better than `enough` [m] in another order.

    The error names those that are interchanged.
    """
    if len(landmarks) < 4 or rms < 0.01 * _spread(landmarks.target):
        return
    best = rms
    order = np.arange(len(landmarks))
    for start in _orders(landmarks):
        other, left = _settled(landmarks, start)
        if left < best:
            best = left
            order = other
    if best < enough:
        wrong = np.flatnonzero(order != np.arange(len(order))).tolist()
        listed = ", ".join(
            f"'{landmarks.names[row]}' where '{landmarks.names[order[row]]}' is"
            for row in wrong[:4]
        )
        more = ", ..." if wrong[4:] else ""
        raise BadData(
            f"the landmarks of '{body}' are in another order on the target: with {len(wrong)} of"
            f" {len(order)} interchanged they fit within {mm(best)} instead of {mm(rms)}"
            f" ({listed}{more})"
        )


def _orders(landmarks: FeaturePoints) -> list[np.ndarray]:
    """Return orders of the target to try.

    These are the one in which distances to all others agree, and the swaps that help most.
    """
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
    return [scipy.optimize.linear_sum_assignment(cost)[1], *swaps[:2]]


def _settled(landmarks: FeaturePoints, order: np.ndarray) -> tuple[np.ndarray, float]:
    """Improve an order by laying on and pairing in turn.

    Returns the order and the root mean square distance that it leaves [m].
    """
    left = _left(landmarks.source, landmarks.target[order])
    for _ in range(20):
        laid = procrustes(landmarks.source, landmarks.target[order], True).apply(landmarks.source)
        cost = np.sum((laid[:, None] - landmarks.target[None]) ** 2, axis=2)
        other = scipy.optimize.linear_sum_assignment(cost)[1]
        remain = _left(landmarks.source, landmarks.target[other])
        if remain >= left:
            break
        order = other
        left = remain
    return order, left


def _off_surface(
    body: str, side: str, names: Sequence[str], points: Array, surface: Surface
) -> list[str]:
    length = float(np.linalg.norm(np.ptp(surface.vertices, axis=0)))
    apart = np.abs(Shape(surface).signed(points))
    wrong = np.flatnonzero(apart > OFF * length).tolist()
    if not wrong:
        return []
    named = quoted(names[index] for index in wrong)
    return [
        f"{side} landmarks of '{body}' lie up to {mm(float(apart.max()))} from the bone's surface:"
        f" {named}"
    ]


def _spread(points: Array) -> float:
    """Root mean square distance from the middle, twice [m]."""
    return 2.0 * float(
        np.sqrt(np.mean(np.sum((frozen_array(points) - points.mean(axis=0)) ** 2, axis=1)))
    )


# A bone so many times larger or smaller than the source's is not the same bone of the same species.
LIKE = 3.0
LONGEST = 3.0  # No bone is longer [m]; what is longer is in other units.
UNITS = (
    ("millimeters", 1000.0),
    ("centimeters", 100.0),
    ("inches", 1.0 / 0.0254),
    ("kilometers", 0.001),
)

# Pieces with less than this share of a bone's area are no part of it: a sesamoid of a foot has
# more.
SPECK = 0.002
SAME = 1e-7  # Vertices nearer than this, as a share of the bone's size, are one.
POINTS = 600  # Of the surfaces, with which they are laid on each other to see what they are.
TURNED = 30.0  # Angle from which a bone is said to lie turned in its frame [degrees].
AWAY = 0.5
"""Distance from its place in the source's frame, as a share of its length, from which it is said to
lie elsewhere.
"""

# Share of the distance that another bone of the source leaves, below which that is the one.
EXCHANGED = 0.7
# Residual after a similarity, as a share of the bone's length, above which it is another bone's
# shape.
UNLIKE = 0.06


def check_bone(
    body: str,
    target: Surface,
    source: Surface | None = None,
    landmarks: FeaturePoints | None = None,
    start: Similarity | None = None,
) -> list[str]:
    """Report what looks odd in a target's bone, one line each.

    A bone that cannot be what its name states is refused. The target is as `repaired_bone` gives
    it, in its file's frame; `start`: roughly, where landmarks do not show it.
    """
    _check_size(body, target, source)
    notes: list[str] = []
    if landmarks is not None and len(landmarks):
        laid, notes = check_landmarks(body, landmarks, source, target)
        start = laid or start
    if source is None:
        return notes
    whole, rms = _registered(source, target, start)
    residual = rms / bone_length(target)
    if residual > UNLIKE:
        notes.append(
            f"the bone of '{body}' is of another shape than the source's: {100 * residual:.0f} % of"
            " its length remain after rotation, translation and scaling; is it another bone, or"
            " several?"
        )
    middle = Shape(source).samples(POINTS).points.mean(axis=0)
    away = float(np.linalg.norm(whole.apply(middle) - whole.scale * middle))
    angle = turned_by(whole)
    if angle > TURNED or away > AWAY * bone_length(target):
        notes.append(
            f"the bone of '{body}' lies turned by {angle:.0f} degrees and {away:.2g} m from where"
            " the source's lies in its body's frame, as in a scanner's: the body gets the frame of"
            " the file"
        )
    return notes


def check_units(lengths: Sequence[tuple[float, float]]) -> None:
    """Refuse bones that are in other units than meters together.

    One by one, a small bone in inches looks like a larger one in centimeters. `lengths`: of each
    bone of the target and of the source's [m].
    """
    ratio = (
        float(np.exp(np.median(np.log([target / source for target, source in lengths]))))
        if lengths
        else 1.0
    )
    unit, factor = min(UNITS, key=lambda unit: abs(np.log(ratio / unit[1])))
    if not 1.0 / LIKE < ratio < LIKE and 1.0 / LIKE < ratio / factor < LIKE:
        raise BadData(
            f"the bones are {ratio:.3g} times as long as the source's (median of {len(lengths)}),"
            f" as if in {unit}: divide their coordinates by {factor:.4g} to give meters, or state"
            " the files' unit (--unit)"
        )


def check_exchange(body: str, target: Surface, bones: Mapping[str, Surface]) -> None:
    """Refuse a target's bone on which another of the source's bones lies much better.

    `bones`: of the source, by body; `body`: to which the target's bone is assigned.
    """
    length = bone_length(target)
    like = {
        name: bone for name, bone in bones.items() if 1.0 / LIKE < bone_length(bone) / length < LIKE
    }
    left = {name: _registered(bone, target)[1] for name, bone in like.items()}
    best = min(left, key=left.__getitem__, default=body)
    if left.get(best, np.inf) < EXCHANGED * left.get(body, 0.0):
        raise BadData(
            f"the bone of '{body}' looks like the source's '{best}', which leaves {mm(left[best])}"
            f" after rotation, translation and scaling, where '{body}' leaves {mm(left[body])}:"
            " were two"
            " files exchanged?"
        )


def bone_length(surface: Surface) -> float:
    """Diagonal of the box around a surface, along its principal axes [m]."""
    middle = surface.vertices.mean(axis=0)
    _, axes = np.linalg.eigh((surface.vertices - middle).T @ (surface.vertices - middle))
    return float(np.linalg.norm(np.ptp((surface.vertices - middle) @ axes, axis=0)))


def repaired_bone(surface: Surface, what: str, notes: list[str]) -> Surface:
    """Repair a surface, and note what was done.

    Equal vertices are merged, faces without area left out, specks and inner surfaces dropped, and
    faces turned outward.
    """
    before = len(notes)
    vertices, faces = _welded(surface, what, notes)
    if not len(faces) or not area_of(vertices, faces) > 0.0:
        raise BadData(f"{what} has no area: its triangles are lines or points")
    pieces = _of_the_bone(vertices, pieces_of(len(vertices), faces), what, notes)
    turned = [turned_outward(vertices, piece) for piece in pieces]
    faces = np.concatenate(turned)
    before_and_after = (
        face_crosses(vertices, triangles) for triangles in (np.concatenate(pieces), faces)
    )
    count = int(np.sum(np.einsum("ij,ij->i", *before_and_after) < 0.0))
    if count:
        how = "all triangles" if count == len(faces) else f"{count} of {len(faces)} triangles"
        notes.append(f"{what}: {how} pointed inward and were turned outward")
    border = border_of(faces)
    if len(border):
        around = float(
            np.linalg.norm(vertices[border[:, 0]] - vertices[border[:, 1]], axis=1).sum()
        )
        notes.append(
            f"{what} is open: {len(border)} edges, {mm(around)} in all, have a triangle on one side"
            " only"
        )
    if len(notes) == before:
        return surface
    return used_part(vertices, faces)


def _welded(surface: Surface, what: str, notes: list[str]) -> tuple[Array, np.ndarray]:
    size = float(np.ptp(surface.vertices, axis=0).max())
    if not size > 0.0:
        raise BadData(f"{what} has no extent: all its vertices coincide")
    rounded = np.round(surface.vertices / (SAME * size))
    _, first, same = np.unique(rounded, axis=0, return_index=True, return_inverse=True)
    vertices = surface.vertices
    faces = surface.faces
    if len(first) < len(vertices):
        notes.append(f"{what}: {len(vertices) - len(first)} duplicate vertices were merged")
        order = np.argsort(first)
        vertices = vertices[first[order]]
        faces = np.argsort(order)[same.reshape(-1)][faces]
    kept = distinct_faces(faces)
    if len(kept) < len(faces):
        notes.append(
            f"{what}: {len(faces) - len(kept)} triangles without area or given twice are left out"
        )
    return vertices, kept


def _of_the_bone(
    vertices: Array, pieces: list[np.ndarray], what: str, notes: list[str]
) -> list[np.ndarray]:
    """Pieces without specks, and without what lies inside others as marrow does."""
    pieces = sorted(pieces, key=lambda piece: -area_of(vertices, piece))
    whole = sum(area_of(vertices, piece) for piece in pieces)
    large = [piece for piece in pieces if area_of(vertices, piece) > SPECK * whole]
    kept: list[np.ndarray] = []
    for piece in large:
        if not any(_within(vertices, piece, other) for other in kept):
            kept.append(piece)
    if len(large) < len(pieces):
        notes.append(f"{what}: {len(pieces) - len(large)} loose islands of triangles are left out")
    if len(kept) < len(large):
        notes.append(
            f"{what}: {len(large) - len(kept)} surfaces inside of it, as of marrow, are left out"
        )
    return kept


def _within(vertices: Array, piece: np.ndarray, other: np.ndarray) -> bool:
    corners = np.unique(piece)
    low = vertices[np.unique(other)].min(axis=0)
    high = vertices[np.unique(other)].max(axis=0)
    if not ((vertices[corners] > low) & (vertices[corners] < high)).all():
        return False
    # Imported here because few bones have pieces inside others.
    igl = from_extra("morph", "igl", "libigl")

    outward = turned_outward(vertices, other)
    number = igl.fast_winding_number(
        np.array(vertices), outward, np.ascontiguousarray(vertices[corners])
    )
    return bool(np.all(np.abs(number) > 0.5))


def _check_size(body: str, target: Surface, source: Surface | None) -> None:
    length = bone_length(target)
    if source is None:
        if length <= LONGEST:
            return
        units = " or ".join(name for name, factor in UNITS if length / factor <= LONGEST)
        raise BadData(
            f"the bone of '{body}' is {length:.4g} long, and no bone is longer than {LONGEST:g} m:"
            " give it in meters" + (f"; are its coordinates in {units}?" if units else "")
        )
    expected = bone_length(source)
    if 1.0 / LIKE < length / expected < LIKE:
        return
    unit, factor = min(UNITS, key=lambda unit: abs(np.log(length / unit[1] / expected)))
    if 1.0 / LIKE < length / factor / expected < LIKE:
        remedy = (
            f"as if in {unit}: divide coordinates by {factor:g} to give meters, or state the unit"
            " (--unit)"
        )
    else:
        remedy = "give it in meters; is it another bone, or another species?"
    raise BadData(
        f"the bone of '{body}' is {length:.4g} long, and the source's {expected:.3g} m: {remedy}"
    )


def _registered(
    source: Surface, target: Surface, start: Similarity | None = None
) -> tuple[Similarity, float]:
    """Similarity from source to target, and the root mean square distance on the target [m]."""
    options = SurfaceOptions(points=POINTS, mirror=False)
    if Shape(target).is_open and not Shape(source).is_open:
        # A part is looked for on the whole, not the other way round.
        back = register_surface(target, source, None if start is None else start.inverse(), options)
        return back.similarity.inverse(), back.rms
    fit = register_surface(source, target, start, options)
    return fit.similarity, fit.similarity.scale * fit.rms
