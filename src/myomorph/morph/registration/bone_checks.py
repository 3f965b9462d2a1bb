"""A target's bone before it is used: its unit, its side, its frame, its triangles, and the landmarks on it."""

from __future__ import annotations

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.errors import BadData, from_extra
from myomorph.model.surface import (
    Surface,
    area_of,
    border_of,
    distinct_faces,
    face_crosses,
    pieces_of,
    turned_outward,
    used_part,
)
from myomorph.morph.maps.fields import FeaturePoints
from myomorph.morph.maps.linear import Similarity
from myomorph.morph.registration.alignment import turned_by
from myomorph.morph.registration.landmark_checks import check_landmarks
from myomorph.morph.registration.rigid import SurfaceOptions, register_surface
from myomorph.morph.shapes.articular import mm
from myomorph.morph.shapes.surface_points import Shape

LIKE = 3.0  # A bone so many times larger or smaller than the source's is not the same bone of the same species.
LONGEST = 3.0  # No bone is longer [m]; what is longer is in other units.
UNITS = (("millimeters", 1000.0), ("centimeters", 100.0), ("inches", 1.0 / 0.0254), ("kilometers", 0.001))

SPECK = 0.002  # Pieces with less than this share of a bone's area are no part of it: a sesamoid of a foot has more.
SAME = 1e-7  # Vertices nearer than this, as a share of the bone's size, are one.
POINTS = 600  # Of the surfaces, with which they are laid on each other to see what they are.
TURNED = 30.0  # Angle from which a bone is said to lie turned in its frame [degrees].
AWAY = 0.5
"""Distance from its place in the source's frame, as a share of its length, from which it is said to lie elsewhere."""

UNLIKE = 0.06  # Residual after a similarity, as a share of the bone's length, above which it is another bone's shape.


def check_bone(
    body: str,
    target: Surface,
    source: Surface | None = None,
    landmarks: FeaturePoints | None = None,
    start: Similarity | None = None,
) -> list[str]:
    """What looks odd in a target's bone, one line each; a bone that cannot be what it is said to be is refused. The
    target is as `repaired_bone` gives it, in its file's frame; `start`: roughly, where landmarks do not show it.
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
            f"the bone of '{body}' is of another shape than the source's: {100 * residual:.0f} % of its length "
            "remain after turning, moving and sizing; is it another bone, or several?"
        )
    middle = Shape(source).samples(POINTS).points.mean(axis=0)
    away = float(np.linalg.norm(whole.apply(middle) - whole.scale * middle))
    angle = turned_by(whole)
    if angle > TURNED or away > AWAY * bone_length(target):
        notes.append(
            f"the bone of '{body}' lies turned by {angle:.0f} degrees and {away:.2g} m from where the source's lies in "
            "its body's frame, as in a scanner's: the body takes over the frame of the file"
        )
    return notes


def bone_length(surface: Surface) -> float:
    """Diagonal of the box around a surface, along its principal axes [m]."""
    middle = surface.vertices.mean(axis=0)
    _, axes = np.linalg.eigh((surface.vertices - middle).T @ (surface.vertices - middle))
    return float(np.linalg.norm(np.ptp((surface.vertices - middle) @ axes, axis=0)))


def repaired_bone(surface: Surface, what: str, notes: list[str]) -> Surface:
    """Equal vertices as one, faces without area left out, specks and inner surfaces dropped, faces turned outward."""
    before = len(notes)
    vertices, faces = _welded(surface, what, notes)
    if not len(faces) or not area_of(vertices, faces) > 0.0:
        raise BadData(f"{what} has no area: its triangles are lines or points")
    pieces = _of_the_bone(vertices, pieces_of(len(vertices), faces), what, notes)
    turned = [turned_outward(vertices, piece) for piece in pieces]
    faces = np.concatenate(turned)
    before_and_after = (face_crosses(vertices, triangles) for triangles in (np.concatenate(pieces), faces))
    count = int(np.sum(np.einsum("ij,ij->i", *before_and_after) < 0.0))
    if count:
        how = "all triangles" if count == len(faces) else f"{count} of {len(faces)} triangles"
        notes.append(f"{what}: {how} looked inward and were turned outward")
    border = border_of(faces)
    if len(border):
        around = float(np.linalg.norm(vertices[border[:, 0]] - vertices[border[:, 1]], axis=1).sum())
        notes.append(
            f"{what} is open: {len(border)} edges, {mm(around)} in all, have a triangle on one side only; "
            "points are put on what is there"
        )
    if len(notes) == before:
        return surface
    return used_part(vertices, faces)


def _welded(surface: Surface, what: str, notes: list[str]) -> tuple[Array, np.ndarray]:
    size = float(np.ptp(surface.vertices, axis=0).max())
    if not size > 0.0:
        raise BadData(f"{what} has no extent: all its vertices are in one place")
    rounded = np.round(surface.vertices / (SAME * size))
    _, first, same = np.unique(rounded, axis=0, return_index=True, return_inverse=True)
    vertices, faces = surface.vertices, surface.faces
    if len(first) < len(vertices):
        notes.append(f"{what}: {len(vertices) - len(first)} vertices that lie on others became one with them")
        order = np.argsort(first)
        vertices, faces = vertices[first[order]], np.argsort(order)[same.reshape(-1)][faces]
    kept = distinct_faces(faces)
    if len(kept) < len(faces):
        notes.append(f"{what}: {len(faces) - len(kept)} triangles without area or given twice are left out")
    return vertices, kept


def _of_the_bone(vertices: Array, pieces: list[np.ndarray], what: str, notes: list[str]) -> list[np.ndarray]:
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
        notes.append(f"{what}: {len(large) - len(kept)} surfaces inside of it, as of marrow, are left out")
    return kept


def _within(vertices: Array, piece: np.ndarray, other: np.ndarray) -> bool:
    corners = np.unique(piece)
    low, high = vertices[np.unique(other)].min(axis=0), vertices[np.unique(other)].max(axis=0)
    if not ((vertices[corners] > low) & (vertices[corners] < high)).all():
        return False
    # Imported here because few bones have pieces inside others.
    igl = from_extra("morph", "igl", "libigl")

    outward = turned_outward(vertices, other)
    number = igl.fast_winding_number(np.array(vertices), outward, np.ascontiguousarray(vertices[corners]))
    return bool(np.all(np.abs(number) > 0.5))


def _check_size(body: str, target: Surface, source: Surface | None) -> None:
    length = bone_length(target)
    if source is None:
        if length <= LONGEST:
            return
        units = " or ".join(name for name, factor in UNITS if length / factor <= LONGEST)
        raise BadData(
            f"the bone of '{body}' is {length:.4g} long, and no bone is longer than {LONGEST:g} m: give it in meters"
            + (f"; are its coordinates in {units}?" if units else "")
        )
    expected = bone_length(source)
    if 1.0 / LIKE < length / expected < LIKE:
        return
    fits = [unit for unit in UNITS if 1.0 / LIKE < length / unit[1] / expected < LIKE]
    if fits:
        unit, factor = fits[0]
        remedy = (
            f"as if in {unit}: divide its coordinates by {factor:g} to give meters, or tell the file's unit (--unit)"
        )
    else:
        remedy = "give it in meters; is it another bone, or another species?"
    raise BadData(
        f"the bone of '{body}' is {length:.4g} long, and the source's bone is {expected:.3g} m long: {remedy}"
    )


def _registered(source: Surface, target: Surface, start: Similarity | None = None) -> tuple[Similarity, float]:
    """Similarity from source to target, and the root mean square distance on the target [m]."""
    options = SurfaceOptions(points=POINTS, mirror=False)
    if Shape(target).is_open and not Shape(source).is_open:
        # A part is looked for on the whole, not the other way round.
        back = register_surface(target, source, None if start is None else start.inverse(), options)
        return back.similarity.inverse(), back.rms
    fit = register_surface(source, target, start, options)
    return fit.similarity, fit.similarity.scale * fit.rms
