"""Mass points where there is no skin.

A solid around every body of the model, from what the model says of it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import scipy

from myomorph.body.shape.points import (
    MAX_GRID_POINTS,
    SPACING,
    Links,
    MassPoints,
    fill,
    links_of,
)
from myomorph.body.shape.skin import Skin
from myomorph.core.model.arrays import Array, frozen_array
from myomorph.core.model.errors import BadData
from myomorph.core.model.inertia import inertial_parameters, pseudo_inertias
from myomorph.core.model.model import Body, Model
from myomorph.core.model.series import Motion
from myomorph.core.model.surface import (
    Surface,
    body_meshes,
    hull_faces,
    joined_surfaces,
    signed_volume,
    used_part,
)

TISSUE = 1050.0  # Density of solids whose size the inertia does not show [kg/m^3]
PLAUSIBLE = (400.0, 3000.0)
"""Densities between which a body's inertia is believed to be that of its soft tissue [kg/m^3]."""
MIN_MASS = 1e-3  # Bodies below this mass are frames between joints and get no points [kg]
MIN_POINTS = 40


class EnvelopePoints(NamedTuple):
    """Points inside the envelopes of a model's bodies.

    Attributes
    ----------
    points : (points, 3) in ground [m]
    link : (points,) body of each, by its place in the model
    masses : (points,) so that each body weighs what the model says [kg]
    words : what the envelopes are
    """

    points: Array
    link: np.ndarray
    masses: Array
    words: str


class Solid(NamedTuple):
    """The envelope of a body in its frame: an ellipsoid, or a closed surface.

    Attributes
    ----------
    kind : in words
    center : (3,) [m]
    axes : (3, 3) columns are the half axes of an ellipsoid [m]
    surface : instead of the ellipsoid
    """

    kind: str
    center: Array
    axes: Array
    surface: Surface | None = None

    @property
    def volume(self) -> float:
        """[m^3]."""
        if self.surface is not None:
            return signed_volume(self.surface.vertices, self.surface.faces)
        return float(4.0 / 3.0 * np.pi * abs(np.linalg.det(self.axes)))


INERTIA = "ellipsoids of uniform density with the bodies' own mass, center and inertia"
HULL = "convex hulls of the bodies' meshes, grown or shrunk to their mass"
BONE = "ellipsoids along the bones with the bodies' mass"


def envelope_points(
    model: Model,
    pose: Motion,
    spacing: float = SPACING,
    surfaces: Mapping[str, Surface] | None = None,
) -> EnvelopePoints:
    """Fill a solid around every body that has mass with points of a regular grid.

    A body of mass m, mass center c and central second moments S fills the ellipsoid of half axes
    sqrt(5 s_k / m) along the eigenvectors of S, which has exactly these. Where that would be no
    soft tissue (its density is not `PLAUSIBLE`: inertias that were only guessed), it fills the
    convex hull of its meshes, and where it has none, an ellipsoid along its bones, each of density
    `TISSUE`.

    Parameters
    ----------
    model : with masses
    pose : its first frame counts
    spacing : of the grid [m]; finer in bodies with few points
    surfaces : meshes by the name the model gives them, as `read_surfaces` finds them

    Returns
    -------
    points in ground [m] with their bodies and masses [kg]

    Raises
    ------
    BadData : the spacing is not above 0 or has too many points, or no body has mass
    """
    if not spacing > 0.0:
        raise BadData(f"a spacing of {spacing:g} m: expected above 0")
    links = links_of(model, pose)
    heavy = [i for i, body in enumerate(model.bodies) if body.mass >= MIN_MASS]
    if not heavy:
        raise BadData(
            f"no body of model '{model.name}' weighs {MIN_MASS:g} kg or more: nothing to fill with"
            " points"
        )
    moments = pseudo_inertias(inertial_parameters(model))
    solids = [_solid(model.bodies[i], i, moments[i], links, surfaces or {}) for i in heavy]
    if sum(solid.volume for solid in solids) / spacing**3 > MAX_GRID_POINTS / 4:
        raise BadData(
            f"a {1000 * spacing:g} mm grid has over {MAX_GRID_POINTS // 4:,} points: give a wider"
            " spacing"
        )
    kinds = Counter(solid.kind for solid in solids)
    points = []
    owners = []
    masses = []
    for i, solid in zip(heavy, solids, strict=True):
        inside = _grid(solid, links.rotations[i], links.origins[i], spacing)
        points.append(inside)
        owners.append(np.full(len(inside), i))
        masses.append(np.full(len(inside), model.bodies[i].mass / len(inside)))
    words = "no skin: " + "; ".join(
        f"{kind} ({count} bodies)" for kind, count in kinds.most_common()
    )
    return EnvelopePoints(
        points=frozen_array(np.concatenate(points)),
        link=np.concatenate(owners),
        masses=frozen_array(np.concatenate(masses)),
        words=words,
    )


def own_points(
    model: Model,
    pose: Motion,
    mass: float,
    spacing: float = SPACING,
    surfaces: Mapping[str, Surface] | None = None,
) -> MassPoints:
    """Build mass points of `envelope_points`, each of the link it fills.

    Parameters
    ----------
    model : with masses
    pose : its first frame counts
    mass : of all points [kg]
    spacing : of the grid [m]
    surfaces : meshes by the name the model gives them

    Returns
    -------
    points, each with a share of 1 in its link

    Raises
    ------
    BadData : as in `envelope_points`
    """
    links = links_of(model, pose)
    points, owners, masses, words = envelope_points(model, pose, spacing, surfaces)
    entries = (np.ones(len(owners)), (np.arange(len(owners)), owners))
    weights = scipy.sparse.csr_array(entries, (len(owners), len(links.names)))
    return MassPoints(
        points=points,
        reference=masses * (mass / masses.sum()),
        weights=weights,
        links=links,
        spacing=spacing,
        source=words,
    )


def _solid(
    body: Body, i: int, moments: Array, links: Links, surfaces: Mapping[str, Surface]
) -> Solid:
    """Choose the solid of a body: by its inertia, its meshes or its bones.

    Parameters
    ----------
    i : number of the body
    moments : (4, 4) its pseudo-inertia
    """
    semi_axes = _of_inertia(body.mass, moments)
    if semi_axes is not None:
        return semi_axes
    meshes = body_meshes(body, surfaces)
    hull = _of_hull(body.mass, joined_surfaces(meshes).vertices) if meshes else None
    return hull if hull is not None else _along_bones(body, i, links)


def _of_inertia(mass: float, moments: Array) -> Solid | None:
    """Build the ellipsoid of uniform density with a body's mass, center and inertia.

    Parameters
    ----------
    mass : of the body [kg]
    moments : (4, 4) its pseudo-inertia

    Returns
    -------
    None where no body has these moments or the density is not `PLAUSIBLE`
    """
    center = moments[:3, 3] / mass
    spread, axes = np.linalg.eigh(moments[:3, :3] / mass - np.outer(center, center))
    if not spread[0] > 0.0:
        return None
    half = np.sqrt(5.0 * spread)
    density = mass / (4.0 / 3.0 * np.pi * half.prod())
    if not PLAUSIBLE[0] <= density <= PLAUSIBLE[1]:
        return None
    return Solid(INERTIA, center, axes * half)


def _of_hull(mass: float, corners: Array) -> Solid | None:
    """Build the convex hull of points under soft tissue of even thickness.

    Without soft tissue and smaller where it is too large.

    Parameters
    ----------
    mass : of the body [kg]
    corners : (points, 3) in the body [m]
    """
    try:
        hull = scipy.spatial.ConvexHull(corners)
        wanted = mass / TISSUE
        if hull.volume < wanted:
            thickness = _thickness(hull, wanted)
            hull = scipy.spatial.ConvexHull(
                (corners[hull.vertices][:, None] + thickness * _DIRECTIONS).reshape(-1, 3)
            )
    except scipy.spatial.QhullError:
        return None
    surface = used_part(hull.points, hull_faces(hull))
    middle = surface.vertices.mean(axis=0)
    vertices = middle + (wanted / hull.volume) ** (1.0 / 3.0) * (surface.vertices - middle)
    return Solid(
        kind=HULL, center=middle, axes=np.zeros((3, 3)), surface=Surface(vertices, surface.faces)
    )


def _thickness(hull: scipy.spatial.ConvexHull, wanted: float) -> float:
    """Compute the thickness t of soft tissue over a convex body of a wanted volume.

    The volume becomes V + A t + M t^2 + 4/3 pi t^3 (Steiner). M is pi times the mean width; the
    width is averaged over the three axes.

    Parameters
    ----------
    wanted : volume [m^3]

    Returns
    -------
    t [m]
    """
    width = float(np.ptp(hull.points, axis=0).mean())
    roots = np.roots([4.0 / 3.0 * np.pi, np.pi * width, hull.area, hull.volume - wanted])
    return float(max(roots[np.abs(roots.imag) < 1e-12].real))


_CUBE = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
_DIRECTIONS = _CUBE[np.any(_CUBE != 0.0, axis=1)]
_DIRECTIONS = _DIRECTIONS / np.linalg.norm(_DIRECTIONS, axis=1, keepdims=True)


def _along_bones(body: Body, i: int, links: Links) -> Solid:
    """Build an ellipsoid along a body's longest bone, with its mass at density `TISSUE`."""
    bones = links.bones[links.bone_links == i]
    directions = bones[:, 1] - bones[:, 0]
    along = directions[np.argmax(np.linalg.norm(directions, axis=1))]
    volume = body.mass / TISSUE
    sphere = (volume * 3.0 / (4.0 * np.pi)) ** (1.0 / 3.0)
    # No thinner than a third of its length, no flatter than a sphere.
    length = float(np.linalg.norm(along))
    half = min(max(0.5 * length, sphere), sphere * 3.0 ** (2.0 / 3.0))
    axis = links.rotations[i].T @ along / length if length > 0.0 else np.array([0.0, 1.0, 0.0])
    across = np.linalg.svd(axis[None])[2][1:].T
    thick = np.sqrt(volume * 3.0 / (4.0 * np.pi) / half)
    return Solid(BONE, body.mass_center, np.column_stack([half * axis, thick * across]))


def _grid(solid: Solid, rotation: Array, origin: Array, spacing: float) -> Array:
    """Fill a solid with grid points; the grid is finer in bodies with few points.

    Parameters
    ----------
    rotation, origin : (3, 3), (3,) of the body in ground [m]
    spacing : at most [m]

    Returns
    -------
    (points, 3) in ground [m]
    """
    spacing = min(spacing, (solid.volume / (2 * MIN_POINTS)) ** (1.0 / 3.0))
    if solid.surface is not None:
        placed = Surface(solid.surface.vertices @ rotation.T + origin, solid.surface.faces)
        return fill(Skin(placed, watertight=True), spacing)
    center = rotation @ solid.center + origin
    axes = rotation @ solid.axes
    extent = np.sqrt(np.square(axes).sum(axis=1))
    first = np.floor((center - extent) / spacing)
    last = np.ceil((center + extent) / spacing)
    spans = [np.arange(low, high + 1) for low, high in zip(first, last, strict=True)]
    cells = np.stack(np.meshgrid(*spans, indexing="ij"), axis=-1).reshape(-1, 3)
    points = (cells + 0.5) * spacing
    in_axes = (points - center) @ np.linalg.inv(axes).T
    return points[np.square(in_axes).sum(axis=1) <= 1.0]
