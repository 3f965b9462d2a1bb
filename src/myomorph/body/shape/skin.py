"""The skin of a body as a closed surface: faults named, holes filled, points inside it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy

from myomorph.body.causes import SKIN
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData, from_extra
from myomorph.core.model.frozen_map import grouped
from myomorph.core.model.messages import Message
from myomorph.core.model.surface import (
    Surface,
    area_of,
    border_of,
    distinct_faces,
    pieces_of,
    signed_volume,
    turned_outward,
)

TALLEST = 3.0  # No body is longer than this in any direction [m]; what is longer is in other units
UNITS = (("decimeters", 10.0), ("centimeters", 100.0), ("millimeters", 1000.0))
CHUNK = 200_000
# Closed pieces of less than this share of the body's volume are no part of it; a hand is 0.005
SPECK = 0.004
COARSE = 60  # Samples along the longest side of the box in which a skin is looked at for crossings


@dataclass(frozen=True, eq=False)
class Skin:
    """A body's surface, fit to say what is inside.

    Attributes
    ----------
    surface : consistently oriented, outward, holes filled where they could be [m]
    watertight : whether every edge has a face on both sides, after repair
    crossing : whether it passes through itself, or its pieces through each other
    up : axis of the surface that points from feet to head or back, "x", "y", "z"; "" where the
        shape does not show it
    notes : what was repaired or left out, one line each
    """

    surface: Surface
    watertight: bool
    crossing: bool = False
    up: str = ""
    notes: tuple[Message, ...] = ()

    @property
    def volume(self) -> float:
        """Enclosed volume [m^3], parts that the skin encloses twice counted twice."""
        return signed_volume(self.surface.vertices, self.surface.faces)

    def moved(self, rotation: Array, translation: Array) -> Skin:
        """Move the skin to R x + t.

        Parameters
        ----------
        rotation : (3, 3) R
        translation : (3,) t [m]

        Returns
        -------
        the moved skin, whose `up` is not known
        """
        surface = Surface(
            self.surface.vertices @ np.asarray(rotation).T + translation, self.surface.faces
        )
        return replace(self, surface=surface, up="")


def check_skin(surface: Surface, height: float | None = None) -> Skin:
    """Repair a skin so that it can be filled with points, and note what had to be done.

    Faces without area go; open pieces beside the body (clothes, helper geometry) and pieces inside
    it (eyes, teeth) go; faces are turned to one side and outward; every hole is closed by a fan
    around the middle of its border. A surface that passes through itself is kept: it shows by
    winding numbers of 2 and more on a coarse grid, and `inside` counts such places once.

    Parameters
    ----------
    surface : triangles [m]
    height : of the body, if known [m]; its unit is then certain

    Returns
    -------
    the repaired skin, with notes

    Raises
    ------
    BadData : the skin has no faces, encloses no volume, or is not in meters
    """
    vertices = np.array(surface.vertices)
    faces = np.array(surface.faces)
    _check_units(vertices, faces, height)
    notes: list[Message] = []
    kept = distinct_faces(faces)
    if len(kept) < len(faces):
        notes.append(
            SKIN.message(
                f"{len(faces) - len(kept)} faces without area or given twice are left out",
                severity="good to know",
            )
        )
    faces = _one_body(vertices, kept, notes)
    vertices, faces = _closed(vertices, faces, notes)
    used, compact = np.unique(faces, return_inverse=True)
    vertices = vertices[used]
    faces = compact.reshape(-1, 3)
    if not signed_volume(vertices, faces) > 1e-9:
        raise BadData("the skin encloses no volume: expected a closed surface of a body")
    watertight = not len(border_of(faces))
    if not watertight:
        notes.append(
            SKIN.message(
                "the skin is still open: points with winding numbers above one half count as inside"
            )
        )
    up = _up(vertices)
    if up and up != "y":
        notes.append(
            SKIN.message(
                f"the body stands along {up}, not y: give landmarks, or turn the skin as the"
                " model's ground is"
            )
        )
    skin = Skin(Surface(vertices, faces), watertight, up=up)
    doubled = _doubled(skin)
    if doubled > 0.0:
        notes.append(
            SKIN.message(
                f"the skin passes through itself: {100 * doubled:.1f} % of what it encloses is"
                " enclosed more than once, which counts once"
            )
        )
    return replace(skin, crossing=doubled > 0.0, notes=tuple(notes))


def inside(skin: Skin, points: Array) -> np.ndarray:
    """Tell which points are inside a skin.

    By generalized winding numbers above one half (Barill et al. 2018, libigl), which open and
    self-crossing surfaces have too.

    Parameters
    ----------
    skin : a body's surface
    points : (points, 3) in the skin's frame [m]

    Returns
    -------
    (points,)
    """
    return winding_numbers(skin, points) > 0.5


def winding_numbers(skin: Skin, points: Array) -> Array:
    """Count how often a skin goes around each point.

    Parameters
    ----------
    skin : a body's surface
    points : (points, 3) in the skin's frame [m]

    Returns
    -------
    (points,)

    Raises
    ------
    MissingPackage : libigl is not installed
    """
    # Imported here because only bodies with a skin need it.
    igl = from_extra("morph", "igl", "libigl")

    vertices = np.array(skin.surface.vertices)
    faces = np.array(skin.surface.faces)
    x = np.ascontiguousarray(points, dtype=np.float64).reshape(-1, 3)
    if not len(x):
        return np.zeros(0)
    parts = (
        igl.fast_winding_number(vertices, faces, x[i : i + CHUNK]) for i in range(0, len(x), CHUNK)
    )
    return np.concatenate([np.atleast_1d(part) for part in parts])


def check_height(height: float) -> None:
    """Refuse a height of a person that is not in meters.

    Parameters
    ----------
    height : [m]

    Raises
    ------
    BadData : the height is not 0.3 to 2.6
    """
    if 0.3 <= height <= 2.6:
        return
    for unit, factor in UNITS:
        if 0.3 <= height / factor <= 2.6:
            raise BadData(
                f"a height of {height:g} m is implausible: expected meters; {height:g} {unit} are "
                f"{height / factor:.4g} m"
            )
    raise BadData(f"a height of {height:g} m is implausible: expected 0.3 to 2.6")


def _check_units(vertices: Array, faces: np.ndarray, height: float | None) -> None:
    """Refuse a skin that is not in meters.

    Parameters
    ----------
    vertices, faces : (vertices, 3), (faces, 3)
    height : of the body, if known [m]

    Raises
    ------
    BadData : there are no faces, no extent, or the size is of other units
    """
    if not len(faces):
        raise BadData("the skin has no faces")
    if height is not None:
        check_height(height)
    corners = vertices[faces].reshape(-1, 3)
    longest = float(np.ptp(corners, axis=0).max())
    if longest <= 0.0:
        raise BadData("the skin has no extent")
    if height is not None:
        # Arms held out make a body longer than it is tall, bent knees shorter.
        fitting = [
            unit
            for unit, factor in (("meters", 1.0), *UNITS)
            if 0.75 < longest / factor / height < 1.34
        ]
        if not fitting:
            raise BadData(
                f"the skin is {longest:.4g} long, the body {height:g} m tall: expected its skin in"
                " meters"
            )
        guess = fitting[0]
    elif longest <= TALLEST:
        guess = "meters"
    else:
        fitting = [unit for unit, factor in UNITS if 0.9 < longest / factor <= TALLEST]
        guess = fitting[0] if fitting else "other units"
    if guess != "meters":
        factor = dict(UNITS).get(guess)
        remedy = f"divide its coordinates by {factor:g}" if factor else "give it in meters"
        raise BadData(
            f"the skin is {longest:.4g} long, as a body in {guess}: expected meters; {remedy}"
        )


def _one_body(vertices: Array, faces: np.ndarray, notes: list[Message]) -> np.ndarray:
    """Choose the faces of the body alone, every piece of it oriented outward.

    Parameters
    ----------
    vertices : (vertices, 3) [m]
    faces : (faces, 3)
    notes : lines are added to it
    """
    all_pieces = pieces_of(len(vertices), faces)
    pieces = [turned_outward(vertices, piece) for piece in all_pieces]
    turned = sum(not np.array_equal(*both) for both in zip(all_pieces, pieces, strict=True))
    body, *others = sorted(pieces, key=lambda piece: -area_of(vertices, piece))
    main = Skin(Surface(vertices, body), watertight=True)
    whole = signed_volume(vertices, body)
    kept = [body]
    opened = 0
    within = 0
    specks = 0
    for piece in others:
        if len(border_of(piece)):
            opened += 1
        elif signed_volume(vertices, piece) < SPECK * whole:
            specks += 1
        elif inside(main, vertices[np.unique(piece)]).all():
            within += 1
        else:
            kept.append(piece)
    if turned:
        notes.append(
            SKIN.message(
                f"faces that pointed inward were turned outward in {turned} of {len(pieces)}"
                " pieces",
                severity="good to know",
            )
        )
    if opened or within or specks:
        notes.append(
            SKIN.message(
                f"the body is the piece with the largest surface, {len(body)} faces; left out:"
                f" {opened} open pieces beside it (clothes, helper geometry), {within} inside it,"
                f" {specks} specks",
                severity="good to know",
            )
        )
    if len(kept) > 1:
        notes.append(
            SKIN.message(
                f"{len(kept)} closed pieces together are the body", severity="good to know"
            )
        )
    return np.concatenate(kept)


def _closed(vertices: Array, faces: np.ndarray, notes: list[Message]) -> tuple[Array, np.ndarray]:
    """Close every loop of the border by a fan around its middle.

    Returns
    -------
    vertices with the middles added, and faces
    """
    border = border_of(faces)
    if not len(border):
        return vertices, faces
    following: dict[int, list[int]] = grouped(border.tolist())
    added_vertices = [vertices]
    added_faces = [faces]
    around = []
    number = len(vertices)
    while following:
        start = next(iter(following))
        loop = [start]
        while loop[-1] in following:
            ends = following[loop[-1]]
            end = ends.pop()
            if not ends:
                del following[loop[-1]]
            if end == start:
                edges = np.stack([loop, np.roll(loop, -1)], axis=1)
                added_vertices.append(vertices[loop].mean(axis=0, keepdims=True))
                added_faces.append(np.column_stack([edges[:, ::-1], np.full(len(loop), number)]))
                around.append(
                    float(
                        np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1).sum()
                    )
                )
                number += 1
                break
            loop.append(end)
    if around:
        notes.append(
            SKIN.message(
                f"{len(around)} holes were filled, the largest {1000 * max(around):.0f} mm around",
                severity="good to know",
            )
        )
    return np.concatenate(added_vertices), np.concatenate(added_faces)


def _doubled(skin: Skin) -> float:
    """Compute the share of the samples inside that the skin encloses more than once."""
    low = skin.surface.vertices.min(axis=0)
    high = skin.surface.vertices.max(axis=0)
    step = float((high - low).max()) / COARSE
    axes = [np.arange(a + step / 2.0, b, step) for a, b in zip(low, high, strict=True)]
    samples = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    number = winding_numbers(skin, samples)
    return float((number > 1.5).sum() / max((number > 0.5).sum(), 1))


def _up(vertices: Array) -> str:
    """Find the axis along which the body is longest.

    That across which it is symmetric is set aside.

    Parameters
    ----------
    vertices : (vertices, 3) [m]

    Returns
    -------
    "x", "y" or "z"; "" if there is none
    """
    middle = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    few = vertices[:: max(1, len(vertices) // 3000)] - middle
    tree = scipy.spatial.cKDTree(vertices - middle)
    extent = np.ptp(vertices, axis=0)
    asymmetry = np.array(
        [np.median(tree.query(few * np.where(np.arange(3) == i, -1.0, 1.0))[0]) for i in range(3)]
    )
    across = int(asymmetry.argmin())
    others = [index for index in range(3) if index != across]
    if asymmetry[across] > 0.5 * np.sort(asymmetry)[1]:
        return ""
    tall, deep = sorted(others, key=lambda other: -extent[other])
    return "xyz"[tall] if extent[tall] > 2.0 * extent[deep] else ""
