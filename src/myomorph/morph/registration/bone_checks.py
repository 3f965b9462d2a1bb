"""A target's bone before it is used: its unit, its side, its frame, its triangles, and the landmarks on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.errors import BadData, from_extra
from myomorph.model.surface import Surface, area_of, border_of, distinct_faces, pieces_of, turned_outward
from myomorph.morph.maps.fields import FeaturePoints
from myomorph.morph.maps.linear import Similarity
from myomorph.morph.registration.alignment import turn_between
from myomorph.morph.registration.landmark_checks import check_landmarks
from myomorph.morph.registration.rigid import SurfaceOptions, register_surface
from myomorph.morph.shapes.surface_points import Shape

LIKE = 3.0
"""A bone so many times larger or smaller than the source's is not the same bone of the same species."""

LONGEST = 3.0
"""No bone is longer [m]; what is longer is in other units."""

UNITS = (("millimeters", 1000.0), ("centimeters", 100.0), ("inches", 1.0 / 0.0254), ("kilometers", 0.001))

SPECK = 0.002
"""Pieces with less than this share of a bone's area are no part of it: a sesamoid of a foot has more."""

SAME = 1e-7
"""Vertices nearer than this, as a share of the bone's size, are one."""

WRONG_SIDE = 0.6
"""Share of the residual that the mirrored source leaves, below which the bone is one of the other side: of femurs of
other persons it leaves 3 to 4 times as much, of a bone's own counterpart less than a third."""

DOUBTED_SIDE = 0.9
"""And below which the side is doubted."""

POINTS = 600
"""Of the surfaces, with which they are laid on each other to see what they are."""

TURNED = 30.0
"""Angle from which a bone is said to lie turned in its frame [degrees]."""

AWAY = 0.5
"""Distance from its place in the source's frame, as a share of its length, from which it is said to lie elsewhere."""

UNLIKE = 0.06
"""Residual after a similarity, as a share of the bone's length, above which it is another bone's shape."""


@dataclass(frozen=True, eq=False)
class CheckedBone:
    """A bone that can be used.

    Attributes
    ----------
    body : whose bone it is
    surface : whole triangles that look outward, in the file's frame [m]
    landmarks : those given, once checked
    whole : the source's bone laid on it, a start for closer fits; None without the source's surface and landmarks
    residual : of that, as a share of the bone's length; NaN without the source's surface
    mirrored : the source's mirrored bone fits far better, which was allowed
    notes : what was repaired or looks odd, one line each
    """

    body: str
    surface: Surface
    landmarks: FeaturePoints | None = None
    whole: Similarity | None = None
    residual: float = float("nan")
    mirrored: bool = False
    notes: tuple[str, ...] = ()


def check_bone(
    body: str,
    target: Surface,
    source: Surface | None = None,
    landmarks: FeaturePoints | None = None,
    *,
    start: Similarity | None = None,
    allow_mirror: bool = False,
    expected_scale: float = 1.0,
) -> CheckedBone:
    """A target's bone, repaired where that leaves nothing to guess, refused where it cannot be what it is said to be.

    Parameters
    ----------
    body : of the source's model, for messages
    target : in its file's frame, said to be in meters
    source : the same bone of the source, in its body's frame
    landmarks : on both
    start : from source to target, roughly, where landmarks do not tell it; whoever gives it knows the side
    allow_mirror : a bone of the other side is told in a note instead of refused
    expected_scale : of the target over the source, where the species differ in size

    Raises
    ------
    BadData : the bone is not in meters, has no area, is one of the other side; landmarks that are in another unit, lie
        off the bone, are interchanged, or belong to another bone
    """
    if not len(target.faces):
        raise BadData(f"the bone of '{body}' has no triangles")
    _check_size(body, target, source, expected_scale)
    notes: list[str] = []
    surface = repaired_bone(target, f"the bone of '{body}'", notes)
    whole: Similarity | None = None
    if landmarks is not None and len(landmarks):
        known = check_landmarks(
            body, landmarks, source, surface, allow_mirror=allow_mirror, expected_scale=expected_scale
        )
        notes += known.notes
        whole = known.whole
    residual, mirrored = float("nan"), False
    if source is not None:
        whole, rms, mirrored = _laid_on(body, source, surface, start if whole is None else whole, allow_mirror, notes)
        residual = rms / bone_length(surface)
        if residual > UNLIKE:
            notes.append(
                f"the bone of '{body}' is of another shape than the source's: {100 * residual:.0f} % of its length "
                "remain after turning, moving and sizing; is it another bone, or several?"
            )
        _note_frame(body, source, surface, whole, notes)
    return CheckedBone(body, surface, landmarks, whole, residual, mirrored, tuple(notes))


def bone_length(surface: Surface) -> float:
    """Diagonal of the box around a surface, along its principal axes [m]."""
    middle = surface.vertices.mean(axis=0)
    _, axes = np.linalg.eigh((surface.vertices - middle).T @ (surface.vertices - middle))
    return float(np.linalg.norm(np.ptp((surface.vertices - middle) @ axes, axis=0)))


def mirrored_surface(surface: Surface) -> Surface:
    """The bone of the other side: mirrored across the frame's xy plane, OpenSim's plane of symmetry, facing outward."""
    return Surface(surface.vertices * [1.0, 1.0, -1.0], surface.faces[:, ::-1])


def repaired_bone(surface: Surface, what: str, notes: list[str]) -> Surface:
    """Equal vertices as one, faces without area left out, specks and inner surfaces dropped, faces turned outward.

    Parameters
    ----------
    what : how messages call it
    notes : filled with what was done

    Raises
    ------
    BadData : nothing with an area is left
    """
    before = len(notes)
    vertices, faces = _welded(surface, what, notes)
    if not len(faces) or not area_of(vertices, faces) > 0.0:
        raise BadData(f"{what} has no area: its triangles are lines or points")
    pieces = _of_the_bone(vertices, pieces_of(len(vertices), faces), what, notes)
    turned = [turned_outward(vertices, piece) for piece in pieces]
    count = sum(_turned(vertices, *both) for both in zip(pieces, turned, strict=True))
    faces = np.concatenate(turned)
    if count:
        how = "all triangles" if count == len(faces) else f"{count} of {len(faces)} triangles"
        notes.append(f"{what}: {how} looked inward and were turned outward")
    border = border_of(faces)
    if len(border):
        around = float(np.linalg.norm(vertices[border[:, 0]] - vertices[border[:, 1]], axis=1).sum())
        notes.append(
            f"{what} is open: {len(border)} edges, {_mm(around)} in all, have a triangle on one side only; "
            "points are put on what is there"
        )
    if len(notes) == before:
        return surface
    used, compact = np.unique(faces, return_inverse=True)
    return Surface(vertices[used], compact.reshape(-1, 3))


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


def _turned(vertices: Array, before: np.ndarray, after: np.ndarray) -> int:
    def normals(faces: np.ndarray) -> Array:
        a, b, c = (vertices[faces[:, k]] for k in range(3))
        crossed: Array = np.cross(b - a, c - a)
        return crossed

    return int(np.sum(np.einsum("ij,ij->i", normals(before), normals(after)) < 0.0))


def _check_size(body: str, target: Surface, source: Surface | None, expected_scale: float) -> None:
    length = bone_length(target)
    if source is None:
        if length <= LONGEST:
            return
        units = " or ".join(name for name, factor in UNITS if length / factor <= LONGEST)
        raise BadData(
            f"the bone of '{body}' is {length:.4g} long, and no bone is longer than {LONGEST:g} m: give it in meters"
            + (f"; are its coordinates in {units}?" if units else "")
        )
    expected = expected_scale * bone_length(source)
    if 1.0 / LIKE < length / expected < LIKE:
        return
    told = f"the source's bone is {bone_length(source):.3g} m long"
    told += f", of which {expected_scale:.3g} times was expected" if expected_scale != 1.0 else ""
    fits = [one for one in UNITS if 1.0 / LIKE < length / one[1] / expected < LIKE]
    if fits:
        unit, factor = fits[0]
        remedy = (
            f"as if in {unit}: divide its coordinates by {factor:g} to give meters, or tell the file's unit (--unit)"
        )
    else:
        remedy = "give it in meters; is it another bone, or another species?"
    raise BadData(f"the bone of '{body}' is {length:.4g} long, and {told}: {remedy}")


def _laid_on(
    body: str,
    source: Surface,
    target: Surface,
    start: Similarity | None,
    allow_mirror: bool,
    notes: list[str],
) -> tuple[Similarity, float, bool]:
    """The source's bone on the target's, the distance that remains [m], and whether it had to be mirrored."""
    found, rms = _registered(source, target, start)
    if start is not None:
        return found, rms, False
    beside = _registered(mirrored_surface(source), target)[1]
    told = (
        f"the bone of '{body}' fits the mirrored bone of the source better ({_mm(beside)} against {_mm(rms)}): is it "
        "one of the other side?"
    )
    mirrored = beside < WRONG_SIDE * rms
    if mirrored and not allow_mirror:
        raise BadData(f"{told} Give the bone of this side, or say that it is to be mirrored")
    if beside < DOUBTED_SIDE * rms:
        notes.append(told)
    return found, rms, mirrored


def _registered(source: Surface, target: Surface, start: Similarity | None = None) -> tuple[Similarity, float]:
    """Similarity from source to target, and the root mean square distance on the target [m]."""
    options = SurfaceOptions(points=POINTS, mirror=False)
    if Shape(target).is_open and not Shape(source).is_open:
        # A part is looked for on the whole, not the other way round.
        back = register_surface(target, source, None if start is None else start.inverse(), options)
        return back.similarity.inverse(), back.rms
    found = register_surface(source, target, start, options)
    return found.similarity, found.similarity.scale * found.rms


def _note_frame(body: str, source: Surface, target: Surface, whole: Similarity, notes: list[str]) -> None:
    middle = Shape(source).samples(POINTS).points.mean(axis=0)
    away = float(np.linalg.norm(whole.apply(middle) - whole.scale * middle))
    angle = turn_between(whole, Similarity(np.eye(3), np.zeros(3)))
    if angle > TURNED or away > AWAY * bone_length(target):
        notes.append(
            f"the bone of '{body}' lies turned by {angle:.0f} degrees and {away:.2g} m from where the source's lies in "
            "its body's frame, as in a scanner's: the body takes over the frame of the file"
        )


def _mm(length: float) -> str:
    return f"{1e3 * length:.3g} mm"
