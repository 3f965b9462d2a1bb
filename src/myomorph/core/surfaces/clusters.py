"""Clusters of spherical markers: found in the surface of a CT, named, and put on a model's bones.

[S] figure 3.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import permutations

import numpy as np
import scipy

from myomorph.core.model.arrays import Array, frozen_array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.model import Body, Marker, Model
from myomorph.core.model.scale import scale
from myomorph.core.model.spatial import spread_directions
from myomorph.core.model.surface import (
    Surface,
    body_meshes,
    connected,
    edges_of,
    face_crosses,
    joined_surfaces,
    used_part,
)
from myomorph.core.surfaces.linear_maps import fit_points
from myomorph.core.surfaces.rigid_registration import SurfaceFit, SurfaceOptions, register_surface

ROBUST = 1.345  # Huber's tuning constant: residuals beyond so many standard deviations weigh less.
AGREE = 0.15  # Share of the radius within which normals of a ball meet in its center.
PATCH = 0.35  # Share of the radius over which the direction of a surface is averaged.
VOTERS = 6000
SAME_WAY = 0.25  # Share of a patch's area that must look the same way for it to vote.
TOLERANCE = 0.15  # Share by which the radius of a ball may differ from its marker's.
MIN_COUNT = 12  # Points or votes that make a ball.
ROUND = 0.08  # Share of the radius that the median distance from a sphere may be.
COVERED = 0.25  # Share of a ball's surface that must be seen.
LIKE = 3e-4
"""A second order of the markers whose misfit is nearer than that to the best one's makes the order
doubtful [m].
"""

OTHER = 2e-3  # Misfit above which the scan's cluster is not the recording's [m].


@read_only
class Ball:
    """A sphere fitted to part of a surface.

    Attributes
    ----------
    center : (3,) [m]
    radius : as fitted [m]
    residual : median of the absolute distances from the sphere [m]
    covered : share of the sphere's area that the surface shows [-]
    """

    center: Array
    radius: float
    residual: float
    covered: float


def surface_parts(surface: Surface) -> list[Surface]:
    """Separate the connected parts of a surface.

    Vertices that lie on each other, to 1e-7 m, count as one.

    Parameters
    ----------
    surface : of any parts

    Returns
    -------
    the parts, that of most faces first
    """
    _, same = np.unique(np.round(surface.vertices, 7), axis=0, return_inverse=True)
    faces = same.reshape(-1)[surface.faces]
    label = connected(int(same.max()) + 1, edges_of(faces))[faces[:, 0]]
    return [
        used_part(surface.vertices, surface.faces[label == part])
        for part in np.argsort(-np.bincount(label))
    ]


def fit_ball(points: Array, radius: float | None = None) -> Ball:
    """Fit a sphere through points with least squares that outliers do not pull.

        min sum_i w_i (|x_i - c| - r)^2,   w = min(1, 1.345 s / |left|)

    with s the standard deviation by the median of what is left (Huber's weights, Gauss-Newton).

    Source: Huber 1964.

    Parameters
    ----------
    points : (n, 3) [m]
    radius : expected [m], where to start if the algebraic fit is three times off; None without one

    Returns
    -------
    the sphere

    Raises
    ------
    BadData : fewer than four points
    """
    if len(points) < 4:
        raise BadData(f"a sphere needs four points, but got {len(points)}")
    middle = points.mean(axis=0)
    x = points - middle
    linear = np.linalg.lstsq(
        np.column_stack((2 * x, np.ones(len(x)))), np.sum(x**2, axis=1), rcond=None
    )[0]
    center = linear[:3]
    size = float(np.sqrt(max(linear[3] + linear[:3] @ linear[:3], 0.0)))
    if radius is not None and not 0.3 * radius < size < 3.0 * radius:
        center = np.zeros(3)
        size = radius
    for _ in range(50):
        away = x - center
        distance = np.linalg.norm(away, axis=1)
        left = distance - size
        scale = 1.4826 * float(np.median(np.abs(left))) + 1e-12
        weights = np.minimum(1.0, ROBUST * scale / np.maximum(np.abs(left), 1e-15))
        slopes = np.column_stack((-away / np.maximum(distance, 1e-12)[:, None], -np.ones(len(x))))
        step = np.linalg.lstsq(
            slopes * np.sqrt(weights)[:, None], -left * np.sqrt(weights), rcond=None
        )[0]
        center = center + step[:3]
        size = size + float(step[3])
        if np.linalg.norm(step) < 1e-9:
            break
    away = x - center
    left = np.abs(np.linalg.norm(away, axis=1) - size)
    return Ball(
        center=frozen_array(center + middle),
        radius=size,
        residual=float(np.median(left)),
        covered=_covered(away, left, size),
    )


def _covered(away: Array, left: Array, radius: float) -> float:
    """Compute the share of directions near which a point lies on the sphere.

    Parameters
    ----------
    away : (n, 3) points less the center [m]
    left : (n,) distance from the sphere [m]
    radius : of the sphere [m]

    Returns
    -------
    [-], of 200 directions
    """
    on = away[left < 0.2 * radius]
    if not len(on):
        return 0.0
    nearest = scipy.spatial.cKDTree(on / np.linalg.norm(on, axis=1)[:, None]).query(
        spread_directions(200)
    )[0]
    return float(np.mean(nearest < 0.3))


def find_balls(surface: Surface, diameter: float = 0.009) -> tuple[Ball, ...]:
    """Find the balls of a diameter in a surface, apart or grown together with what holds them.

    A part that is one ball is taken whole. Elsewhere points on the faces vote for the center that
    their normal leads to at one radius; where votes meet a ball is fitted to the points around.

    Parameters
    ----------
    surface : of a CT
    diameter : of the markers [m]

    Returns
    -------
    the balls, that seen best first
    """
    radius = 0.5 * diameter
    balls: list[Ball] = []
    for part in surface_parts(surface):
        if len(part.vertices) < MIN_COUNT:
            continue
        whole = fit_ball(part.vertices, radius)
        if _is_ball(whole, radius):
            balls.append(whole)
        elif np.ptp(part.vertices, axis=0).max() > 0.8 * diameter:
            balls += _voted(part, radius)
    balls.sort(key=lambda ball: ball.residual)
    apart: list[Ball] = []
    for ball in balls:
        if all(np.linalg.norm(ball.center - other.center) > 0.9 * diameter for other in apart):
            apart.append(ball)
    return tuple(sorted(apart, key=lambda ball: -ball.covered))


def _is_ball(ball: Ball, radius: float) -> bool:
    """Return whether a sphere is a marker of this radius [m]: in size, round, seen enough."""
    sized = abs(ball.radius - radius) <= TOLERANCE * radius
    return sized and ball.covered >= COVERED and ball.residual < ROUND * radius


def _voted(part: Surface, radius: float) -> list[Ball]:
    """Find balls grown together with other things, by votes of the normals.

    The normal at a face is the sum of the area vectors of the patch around, so that a scan's noise
    hardly turns it. It votes for the center one radius inward.

    Parameters
    ----------
    part : of a surface
    radius : of the markers [m]

    Returns
    -------
    balls in the order of their votes
    """
    corners = part.vertices[part.faces]
    crossed = 0.5 * face_crosses(part.vertices, part.faces)
    middle = part.vertices.mean(axis=0)
    crossed = crossed * (np.sign(np.einsum("ij,ij->", corners[:, 0] - middle, crossed)) or 1.0)
    places = corners.mean(axis=1)
    every = max(1, len(places) // VOTERS)
    voters = places[::every]
    # The sum of the area vectors of a patch depends on its rim only, so a scan's noise hardly turns
    # it.
    patches = scipy.spatial.cKDTree(places).query_ball_point(voters, PATCH * radius)
    normals = np.array([crossed[patch].sum(axis=0) for patch in patches])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    sizes = np.linalg.norm(crossed, axis=1)
    whole = np.array([sizes[patch].sum() for patch in patches])[:, None]
    # Around a thin pin or plate the area vectors cancel: what is left of them points nowhere.
    votes = np.where(
        lengths > SAME_WAY * whole,
        voters - radius * normals / np.where(lengths > 0, lengths, 1.0),
        np.inf,
    )
    voting = np.isfinite(votes[:, 0])
    if np.count_nonzero(voting) < MIN_COUNT:
        return []
    votes = votes[voting]
    share = sizes.sum() / len(voters)
    tree = scipy.spatial.cKDTree(votes)
    counts = tree.query_ball_point(votes, AGREE * radius, return_length=True)
    weight = np.where(counts >= MIN_COUNT, share * counts, 0.0)
    balls: list[Ball] = []
    free = np.ones(len(votes), dtype=bool)
    needed = COVERED * 4.0 * np.pi * radius**2
    for index in np.argsort(-weight):
        if weight[index] < 0.5 * needed:
            break
        if not free[index]:
            continue
        center = votes[tree.query_ball_point(votes[index], AGREE * radius)].mean(axis=0)
        for _ in range(3):
            near = np.abs(np.linalg.norm(places - center, axis=1) - radius) < 0.25 * radius
            if near.sum() < MIN_COUNT:
                break
            ball = fit_ball(places[near], radius)
            center = ball.center
        if near.sum() >= MIN_COUNT and _is_ball(ball, radius):
            balls.append(ball)
            free &= np.linalg.norm(votes - center, axis=1) > radius
        free &= np.linalg.norm(votes - votes[index], axis=1) > 0.3 * radius
    return balls


@read_only
class NamedCluster:
    """The balls of a cluster with the names of its markers.

    Attributes
    ----------
    centers : (3,) by marker [m]
    misfit : root mean square difference of the distances between markers [m]; NaN without distances
        to compare with
    notes : what looks wrong, one line each
    """

    centers: Mapping[str, Array]
    misfit: float
    notes: tuple[str, ...] = ()


def name_cluster(
    balls: Sequence[Ball],
    names: Sequence[str],
    distances: Array | None = None,
    picked: Mapping[str, Array] | None = None,
) -> NamedCluster:
    """Find which ball is which marker.

    By points picked near them, or by the distances between the recorded markers.

    Parameters
    ----------
    balls : found in the CT
    names : of the markers
    distances : (markers, markers) between the recorded markers [m], NaN where unknown
    picked : (3,) by name, points near some of the balls [m]

    Returns
    -------
    the balls by name, with what looks wrong

    Raises
    ------
    BadData : too few balls, neither distances nor picks, or distances that leave the order open
    """
    if len(balls) < len(names):
        raise BadData(
            f"{len(balls)} markers were found in the cluster's surface, expected {len(names)}"
            f" ({', '.join(names)}): is the diameter right, and are the markers part of the"
            " surface?"
        )
    centers = np.array([ball.center for ball in balls])
    orders = list(permutations(range(len(balls)), len(names)))
    if len(orders) > 5040:
        orders = list(permutations(range(len(names))))
    known = [name for name in names if picked and name in picked]
    if not known and distances is None:
        raise BadData(
            f"nothing tells the markers {', '.join(names)} apart: pick points near them, or give a"
            " recording"
        )
    near = {index: (picked or {})[name] for index, name in enumerate(names) if name in known}
    by_pick = np.array(
        [
            sum(
                float(np.sum((centers[order[index]] - place) ** 2)) for index, place in near.items()
            )
            for order in orders
        ]
    )
    by_size = np.array([_size_cost(centers[list(order)], distances) for order in orders])
    notes = []
    if known:
        best = int(np.argmin(by_pick))
        if distances is not None and by_size[best] > by_size.min() + 1e-3:
            other = dict(zip(names, orders[int(np.argmin(by_size))], strict=True))
            swapped = [
                name for name, ball in zip(names, orders[best], strict=True) if other[name] != ball
            ]
            notes.append(
                f"markers {', '.join(swapped)} look swapped: as picked their distances differ by"
                f" {1e3 * by_size[best]:.1f} mm from the recording's, in another order by"
                f" {1e3 * by_size.min():.1f} mm"
            )
    else:
        best = int(np.argmin(by_size))
        rest = np.delete(by_size, best)
        if len(rest) and by_size[best] < OTHER and rest.min() - by_size[best] < LIKE:
            raise BadData(
                f"the markers {', '.join(names)} form a triangle of equal sides within"
                f" {1e3 * rest.min():.1f} mm: their distances do not tell which is which; pick a"
                " point near one of them"
            )
    if distances is not None and by_size[best] > OTHER:
        notes.append(
            f"the distances between {', '.join(names)} differ by {1e3 * by_size[best]:.1f} mm (root"
            " mean square) between CT and recording: another cluster, a bent one, or a wrong unit?"
        )
    chosen = {
        name: frozen_array(centers[ball]) for name, ball in zip(names, orders[best], strict=True)
    }
    return NamedCluster(
        chosen, float(by_size[best]) if distances is not None else float("nan"), tuple(notes)
    )


def _size_cost(centers: Array, distances: Array | None) -> float:
    """Compute the root mean square difference of distances.

    Parameters
    ----------
    centers : (markers, 3) in one order [m]
    distances : (markers, markers) [m], NaN where unknown

    Returns
    -------
    [m]; 0 without distances
    """
    if distances is None:
        return 0.0
    apart = np.linalg.norm(centers[:, None] - centers[None], axis=2) - distances
    upper = apart[np.triu_indices(len(centers), 1)]
    upper = upper[np.isfinite(upper)]
    return float(np.sqrt(np.mean(upper**2))) if len(upper) else 0.0


GOOD = 5e-4
"""Surfaces that come so near [m] need no other starts beside the picked points: bones turned end
over end may differ by little more than a millimetre.
"""

FAR = 0.25  # A marker further from its bone than that is named [m].


@read_only
class Picks:
    """Points picked on a CT and the same points on the model's bone.

    Attributes
    ----------
    names : of the points
    scanned : (points, 3) in the CT's frame [m]
    modelled : (points, 3) in the body's frame [m]
    """

    names: tuple[str, ...]
    scanned: Array
    modelled: Array


@read_only
class ScannedBone:
    """A CT bone laid on a model's bone, and where its markers come to lie.

    Attributes
    ----------
    body : of the model
    fit : of the surfaces, from the CT's frame to the body's
    markers : (3,) by name in the CT's frame [m]
    notes : what looks wrong, one line each
    """

    body: str
    fit: SurfaceFit
    markers: Mapping[str, Array]
    notes: tuple[str, ...] = ()

    @property
    def scale(self) -> float:
        """Size of the model's bone in terms of the scanned one."""
        return self.fit.similarity.scale


def bone_surface(body: Body, surfaces: Mapping[str, Surface]) -> Surface:
    """Join the meshes of a body into one surface in the body's frame.

    Parameters
    ----------
    body : of a model
    surfaces : by `Mesh.file`

    Returns
    -------
    one surface [m]

    Raises
    ------
    BadData : the body has no mesh that can be read
    """
    parts = body_meshes(body, surfaces)
    if not parts:
        named = ", ".join(mesh.file for mesh in body.meshes if mesh.file) or "none"
        raise BadData(
            f"body '{body.name}' has no bone mesh that can be read (the model names {named})"
        )
    return joined_surfaces(parts)


def place_scanned_bone(
    body: str,
    scanned: Surface,
    modelled: Surface,
    markers: Mapping[str, Array],
    picks: Picks | None = None,
    options: SurfaceOptions | None = None,
) -> ScannedBone:
    """Lay the surface of a bone in a CT, or of a part of it, on the bone of a model.

    Picked points give the start. Where other starts come clearly nearer, they are taken.

    Parameters
    ----------
    body : of the model
    scanned : the bone in the CT's frame [m]
    modelled : the bone in the body's frame (`bone_surface`) [m]
    markers : (3,) by name in the CT's frame [m]
    picks : the same points on both; None tries many starts
    options : of the registration

    Returns
    -------
    the fit, and the markers with what looks wrong

    Raises
    ------
    BadData : the surfaces or picked points allow no fit
    """
    options = options or SurfaceOptions()
    start = None
    notes = []
    if picks is not None:
        fitted = fit_points(
            picks.names, picks.scanned, picks.modelled, options.scale and len(picks.names) > 3
        )
        notes = [f"{body}: {line}" for line in fitted.notes]
        # A wrong pick would only lead the surfaces astray; without picks they find each other from
        # many starts.
        start = None if fitted.notes else fitted.similarity
    fit = register_surface(scanned, modelled, start, options)
    if start is not None and fit.rms > GOOD:
        other = register_surface(scanned, modelled, None, options)
        if other.rms < 0.7 * fit.rms:
            notes.append(
                f"{body}: from the picked points the surfaces come to {1e3 * fit.rms:.1f} mm, from"
                f" other starts to {1e3 * other.rms:.1f} mm, which was taken: were the points"
                " picked on this bone?"
            )
            fit = other
    notes += [f"{body}: {line}" for line in fit.notes]
    notes += _warnings(body, fit, scanned, markers)
    frozen = {name: frozen_array(place, (3,)) for name, place in markers.items()}
    return ScannedBone(body=body, fit=fit, markers=frozen, notes=tuple(notes))


def _warnings(
    body: str, fit: SurfaceFit, scanned: Surface, markers: Mapping[str, Array]
) -> list[str]:
    """Name a size, a misfit or a marker's distance from its bone that looks wrong."""
    notes = []
    size = fit.similarity.scale
    if not 0.8 < size < 1.25:
        notes.append(
            f"{body}: the model's bone is {size:.2f} times the scanned one: another bone, or a"
            " wrong unit?"
        )
    if fit.rms > 0.005:
        notes.append(
            f"{body}: the surfaces differ by {1e3 * fit.rms:.1f} mm (root mean square): is it this"
            " bone?"
        )
    for name, place in markers.items():
        apart = float(np.min(np.linalg.norm(scanned.vertices - place, axis=1)))
        if apart > FAR:
            notes.append(
                f"{body}: marker '{name}' lies {1e3 * apart:.0f} mm from the bone: another scan, or"
                " unit?"
            )
    return notes


def place_cluster_markers(
    model: Model, bones: Sequence[ScannedBone], path_lengths: Callable[[Model], Array] | None = None
) -> Model:
    """Fix the markers of CT clusters to a model's bones.

    Every body gets the size of its scanned bone (see `scale`), so that the markers keep their
    position on it exactly.

    Parameters
    ----------
    model : with the bones
    bones : laid on the model's bones
    path_lengths : see `scale`

    Returns
    -------
    the scaled model with the markers, in place of those of the same names

    Raises
    ------
    BadData : two bones for one body, or two clusters with a marker of one name
    UnknownName : the model has no such body
    """
    names = [bone.body for bone in bones]
    if len(set(names)) != len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise BadData(f"two scanned bones are for body '{twice}'")
    for name in names:
        model.body(name)
    factors = {bone.body: np.full(3, 1.0 / bone.scale) for bone in bones}
    model = scale(model, factors, path_lengths=path_lengths)
    placed = [
        Marker(name, bone.body, bone.fit.similarity.rigid.apply(place))
        for bone in bones
        for name, place in bone.markers.items()
    ]
    new = {marker.name for marker in placed}
    if len(new) != len(placed):
        raise BadData(
            "two clusters hold a marker of one name: marker names are unique over all bones"
        )
    kept = tuple(marker for marker in model.markers if marker.name not in new)
    return replace(model, markers=(*kept, *placed))
