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
MAX_DENSITY = 3000.0
"""Density of a ball of a body's mass that turns as easily as the body [kg/m^3]: above it the
inertia was only guessed.
"""
MIN_DENSITY = 400.0
"""Density down to which a thinner ellipsoid has a wider grid, not more points [kg/m^3]."""
MIN_MASS = 1e-3  # Bodies below this mass are frames between joints and get no points [kg]
MIN_POINTS = 40
MIN_GYRATION = 0.01
"""Least radius of gyration along a principal axis of light bodies whose inertia no body can have
[m].
"""
MAX_IMPOSSIBLE = 0.01
MAX_LIFT = 0.2
"""Share of the whole mass up to which a body counts little, and of its second moments by which
points may miss those of a heavier one whose inertia no body can have.
"""


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
REPAIRED = "ellipsoids of the nearest inertia that a body can have"
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
    sqrt(5 s_k / m) along the eigenvectors of S. Its points have exactly these moments, whatever
    the density that comes of it: a torso that stands for head and arms too fills more space than
    its mass would. Only a body that turns more easily than any tissue of its mass, whose inertia
    was guessed, fills the convex hull of its meshes, and where it has none, an ellipsoid along its
    bones, each of density `TISSUE`. Points in these can be as compact as the guess says.

    An inertia that no body can have is replaced by the nearest possible one.

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
    BadData : the spacing is not above 0 or has too many points, no body has mass, or a body
        that counts has an inertia far from any that a body can have
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
    _refuse_impossible(model, moments)
    solids = [_solid(model.bodies[i], i, moments[i], links, surfaces or {}) for i in heavy]
    filled = [
        min(solid.volume, model.bodies[i].mass / MIN_DENSITY)
        for i, solid in zip(heavy, solids, strict=True)
    ]
    if sum(filled) / spacing**3 > MAX_GRID_POINTS / 4:
        raise BadData(
            f"a {1000 * spacing:g} mm grid has over {MAX_GRID_POINTS // 4:,} points: give a wider"
            " spacing"
        )
    kinds = Counter(solid.kind for solid in solids)
    points = []
    owners = []
    masses = []
    for i, solid, volume in zip(heavy, solids, filled, strict=True):
        size = spacing * (solid.volume / volume) ** (1.0 / 3.0)
        inside = _grid(solid, links.rotations[i], links.origins[i], size)
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


def _refuse_impossible(model: Model, moments: Array) -> None:
    """Refuse a model in which a body that counts has an inertia that no points come near.

    Parameters
    ----------
    moments : (bodies, 4, 4) pseudo-inertias

    Raises
    ------
    BadData : a principal second moment of mass about the mass center is far below 0
    """
    for body, own in zip(model.bodies, moments, strict=True):
        if body.mass < max(MAX_IMPOSSIBLE * model.mass, MIN_MASS):
            continue
        second = np.linalg.eigvalsh(_central(body.mass, own))
        size = float(np.abs(second).sum())
        if size >= _ball_moments(body.mass) and second[0] < -MAX_LIFT * size:
            raise BadData(
                f"'{body.name}' ({body.mass:.3g} kg) has an inertia that no body can have: its"
                f" least second moment of mass is {second[0]:.3g} kg m^2, so no mass points come"
                " near it; correct it in the file, or give the body's shape (--skin, or --height"
                " and --chest)"
            )


def _ball_moments(mass: float) -> float:
    """Sum the second moments of a ball of `MAX_DENSITY` about its center, 3/5 m r^2 [kg m^2]."""
    radius = (3.0 * mass / (4.0 * np.pi * MAX_DENSITY)) ** (1.0 / 3.0)
    return float(0.6 * mass * radius**2)


def _central(mass: float, moments: Array) -> Array:
    """Compute second moments of mass about the mass center.

    Parameters
    ----------
    mass : of the body [kg]
    moments : (4, 4) its pseudo-inertia

    Returns
    -------
    (3, 3) [kg m^2]
    """
    center = moments[:3, 3] / mass
    central: Array = moments[:3, :3] - mass * np.outer(center, center)
    return central


def _solid(
    body: Body, i: int, moments: Array, links: Links, surfaces: Mapping[str, Surface]
) -> Solid:
    """Choose the solid of a body: by its inertia, its meshes or its bones.

    Parameters
    ----------
    i : number of the body
    moments : (4, 4) its pseudo-inertia
    """
    central = _central(body.mass, moments)
    if np.trace(central) >= _ball_moments(body.mass):
        return _of_inertia(body.mass, moments[:3, 3] / body.mass, central)
    meshes = body_meshes(body, surfaces)
    hull = _of_hull(body.mass, joined_surfaces(meshes).vertices) if meshes else None
    return hull if hull is not None else _along_bones(body, i, links)


def _of_inertia(mass: float, center: Array, central: Array) -> Solid:
    """Build the ellipsoid of uniform density with a body's mass, center and inertia.

    Parameters
    ----------
    mass : of the body [kg]
    center : (3,) in the body [m]
    central : (3, 3) second moments of mass about it [kg m^2]

    Returns
    -------
    the ellipsoid; of the nearest moments that a body can have where these are impossible
    """
    spread, axes = np.linalg.eigh(central / mass)
    if spread[0] > 0.0:
        return Solid(INERTIA, center, axes * np.sqrt(5.0 * spread))
    possible = np.maximum(spread, MIN_GYRATION**2)
    return Solid(REPAIRED, center, axes * np.sqrt(5.0 * possible))


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
_OUTWARD = _CUBE[np.any(_CUBE != 0.0, axis=1)]
_DIRECTIONS = _OUTWARD / np.linalg.norm(_OUTWARD, axis=1, keepdims=True)


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

    Points of an ellipsoid have exactly its center and its second moments.

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
    # A grid of the unit ball, stretched with it: by its symmetry the mean of x is 0 and that of
    # x x^T is the same along all axes, of which a ball has 1/5.
    step = spacing / abs(np.linalg.det(solid.axes)) ** (1.0 / 3.0)
    count = int(np.ceil(1.0 / step))
    ticks = (np.arange(-count, count) + 0.5) * step
    cells = np.stack(np.meshgrid(ticks, ticks, ticks, indexing="ij"), axis=-1).reshape(-1, 3)
    unit = cells[np.square(cells).sum(axis=1) <= 1.0]
    unit = unit * np.sqrt(0.2 / np.mean(np.square(unit)))
    points: Array = rotation @ solid.center + origin + unit @ (rotation @ solid.axes).T
    return points
