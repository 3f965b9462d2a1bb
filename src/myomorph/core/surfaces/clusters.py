"""Clusters of spherical markers: found in the surface of a CT, named, and put on a model's bones.

[S] figure 3.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np
import scipy

from myomorph.core.model.arrays import Array, frozen_array, read_only
from myomorph.core.model.causes import BONES
from myomorph.core.model.errors import BadData
from myomorph.core.model.messages import Message, located
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

HUBER = 1.345  # Tuning constant: residuals beyond so many standard deviations weigh less.
MEETING = 0.15  # Share of the radius within which normals of a ball meet in its center.
PATCH = 0.35  # Share of the radius over which the direction of a surface is averaged.
MAX_VOTERS = 6000
MIN_ALIGNED = 0.25  # Share of a patch's area that must look the same way for it to vote.
MAX_RADIUS_ERROR = 0.15  # Share by which the radius of a ball may differ from its marker's.
MIN_COUNT = 12  # Points or votes that make a ball.
MAX_RESIDUAL = 0.08  # Share of the radius that the median distance from a sphere may be.
MIN_COVERED = 0.25  # Share of a ball's surface that must be seen.
MAX_ORDERS = 5040  # Assignments of balls to markers that are tried.
MIN_DIFFERENCE = 3e-4
"""A second order of the markers whose misfit is nearer than that to the best one's makes the order
doubtful [m].
"""

MAX_MISFIT = 2e-3  # Above it the scan's cluster is not the recording's [m].
MAX_PICKED_MISFIT = 1e-3  # Beyond the best order's, above which picks look swapped [m].
GOOD_RMS = 5e-4
"""Surfaces that come so near [m] need no other starts beside the picked points: bones turned end
over end may differ by little more than a millimetre.
"""

MAX_MARKER_DISTANCE = 0.25  # A marker further from its bone than that is named [m].


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

        min sum_i w_i (|x_i - c| - r)^2,   w = min(1, 1.345 s / |e|),   e_i = |x_i - c| - r

    with s the standard deviation by the median of the errors e (Huber's weights, Gauss-Newton).

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
    c, r = _algebraic_sphere(x)
    if radius is not None and not 0.3 * radius < r < 3.0 * radius:
        c = np.zeros(3)
        r = radius
    for _ in range(50):
        from_center = x - c
        distance = np.linalg.norm(from_center, axis=1)
        e = distance - r
        s = 1.4826 * float(np.median(np.abs(e))) + 1e-12
        w = np.minimum(1.0, HUBER * s / np.maximum(np.abs(e), 1e-15))
        directions = from_center / np.maximum(distance, 1e-12)[:, None]
        slopes = np.column_stack((-directions, -np.ones(len(x))))
        step = np.linalg.lstsq(slopes * np.sqrt(w)[:, None], -e * np.sqrt(w), rcond=None)[0]
        c = c + step[:3]
        r = r + float(step[3])
        if np.linalg.norm(step) < 1e-9:
            break
    from_center = x - c
    errors = np.abs(np.linalg.norm(from_center, axis=1) - r)
    return Ball(
        center=frozen_array(c + middle),
        radius=r,
        residual=float(np.median(errors)),
        covered=_covered(from_center, errors, r),
    )


def _algebraic_sphere(x: Array) -> tuple[Array, float]:
    """Fit a sphere by the equations 2 c . x + (r^2 - c . c) = x . x, which are linear.

    Parameters
    ----------
    x : (n, 3) points [m]

    Returns
    -------
    center (3,) and radius [m]
    """
    matrix = np.column_stack((2 * x, np.ones(len(x))))
    solution = np.linalg.lstsq(matrix, np.sum(x**2, axis=1), rcond=None)[0]
    center = solution[:3]
    return center, float(np.sqrt(max(solution[3] + center @ center, 0.0)))


def _covered(from_center: Array, errors: Array, radius: float) -> float:
    """Compute the share of directions near which a point lies on the sphere.

    Parameters
    ----------
    from_center : (n, 3) points less the center [m]
    errors : (n,) distance from the sphere [m]
    radius : of the sphere [m]

    Returns
    -------
    [-], of 200 directions
    """
    on_sphere = from_center[errors < 0.2 * radius]
    if not len(on_sphere):
        return 0.0
    directions = on_sphere / np.linalg.norm(on_sphere, axis=1)[:, None]
    distances, _ = scipy.spatial.cKDTree(directions).query(spread_directions(200))
    return float(np.mean(distances < 0.3))


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
    separate: list[Ball] = []
    for ball in balls:
        distances = [np.linalg.norm(ball.center - other.center) for other in separate]
        if all(distance > 0.9 * diameter for distance in distances):
            separate.append(ball)
    return tuple(sorted(separate, key=lambda ball: -ball.covered))


def _is_ball(ball: Ball, radius: float) -> bool:
    """Return whether a sphere is a marker of this radius [m]: in size, round, seen enough."""
    if abs(ball.radius - radius) > MAX_RADIUS_ERROR * radius:
        return False
    return ball.covered >= MIN_COVERED and ball.residual < MAX_RESIDUAL * radius


@read_only
class _Votes:
    """Votes of the faces of a surface for the centers of balls.

    Attributes
    ----------
    faces : (faces, 3) centers of the faces [m]
    centers : (votes, 3) where the balls' centers would be [m]
    area : of the surface that each vote stands for [m^2]
    """

    faces: Array
    centers: Array
    area: float


def _voted(part: Surface, radius: float) -> list[Ball]:
    """Find balls grown together with other things, by votes of the normals.

    Parameters
    ----------
    part : of a surface
    radius : of the markers [m]

    Returns
    -------
    balls in the order of their votes
    """
    votes = _votes(part, radius)
    if len(votes.centers) < MIN_COUNT:
        return []
    tree = scipy.spatial.cKDTree(votes.centers)
    counts = tree.query_ball_point(votes.centers, MEETING * radius, return_length=True)
    areas = np.where(counts >= MIN_COUNT, votes.area * counts, 0.0)
    min_area = 0.5 * MIN_COVERED * 4.0 * np.pi * radius**2
    balls: list[Ball] = []
    free = np.ones(len(votes.centers), dtype=bool)
    for index in np.argsort(-areas):
        if areas[index] < min_area:
            break
        if not free[index]:
            continue
        vote = votes.centers[index]
        together = tree.query_ball_point(vote, MEETING * radius)
        ball = _ball_around(votes.centers[together].mean(axis=0), votes.faces, radius)
        if ball is not None and _is_ball(ball, radius):
            balls.append(ball)
            free &= np.linalg.norm(votes.centers - ball.center, axis=1) > radius
        free &= np.linalg.norm(votes.centers - vote, axis=1) > 0.3 * radius
    return balls


def _votes(part: Surface, radius: float) -> _Votes:
    """Collect votes: each face's for the center that is one radius inward along its normal.

    The normal at a face is the sum of the area vectors of the patch around. It depends on the
    patch's rim only, so that a scan's noise hardly turns it.

    Parameters
    ----------
    part : of a surface
    radius : of the markers [m]
    """
    corners = part.vertices[part.faces]
    area_vectors = 0.5 * face_crosses(part.vertices, part.faces)
    middle = part.vertices.mean(axis=0)
    volume = np.einsum("ij,ij->", corners[:, 0] - middle, area_vectors)
    area_vectors = area_vectors * (np.sign(volume) or 1.0)
    faces = corners.mean(axis=1)
    voters = faces[:: max(1, len(faces) // MAX_VOTERS)]
    patches = scipy.spatial.cKDTree(faces).query_ball_point(voters, PATCH * radius)
    sums = np.array([area_vectors[patch].sum(axis=0) for patch in patches])
    norms = np.linalg.norm(sums, axis=1, keepdims=True)
    areas = np.linalg.norm(area_vectors, axis=1)
    patch_areas = np.array([areas[patch].sum() for patch in patches])[:, None]
    # Around a thin pin or plate the area vectors cancel: what is left of them points nowhere.
    aligned = norms > MIN_ALIGNED * patch_areas
    inward = radius * sums / np.where(norms > 0, norms, 1.0)
    centers = np.where(aligned, voters - inward, np.inf)
    finite = np.isfinite(centers[:, 0])
    return _Votes(faces=faces, centers=centers[finite], area=areas.sum() / len(voters))


def _ball_around(center: Array, points: Array, radius: float) -> Ball | None:
    """Fit a ball to the points near a sphere, three times as its center moves.

    Parameters
    ----------
    center : (3,) where to start [m]
    points : (points, 3) of the surface [m]
    radius : of the marker [m]

    Returns
    -------
    the ball; None where too few points are near
    """
    ball = None
    for _ in range(3):
        distances = np.linalg.norm(points - center, axis=1)
        near = np.abs(distances - radius) < 0.25 * radius
        if near.sum() < MIN_COUNT:
            return None
        ball = fit_ball(points[near], radius)
        center = ball.center
    return ball


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
    notes: tuple[Message, ...] = ()


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
    listed = ", ".join(names)
    if len(balls) < len(names):
        raise BadData(
            f"{len(balls)} markers were found in the cluster's surface, expected {len(names)}"
            f" ({listed}): is the diameter right, and are the markers part of the surface?"
        )
    near = {index: picked[name] for index, name in enumerate(names) if picked and name in picked}
    if not near and distances is None:
        raise BadData(
            f"nothing distinguishes the markers {listed}: pick points near them, or give a"
            " recording"
        )
    centers = np.array([ball.center for ball in balls])
    orders = _orders(len(balls), len(names))
    misfits = np.array([_misfit(centers[list(order)], distances) for order in orders])
    notes = []
    if near:
        best = int(np.argmin([_pick_cost(centers[list(order)], near) for order in orders]))
        if distances is not None:
            notes += _swapped_picks(names, orders, misfits, best)
    else:
        best = int(np.argmin(misfits))
        _check_order(names, misfits, best)
    misfit = float(misfits[best])
    if distances is not None:
        notes += _large_misfit(names, misfit)
    chosen = dict(zip(names, orders[best], strict=True))
    return NamedCluster(
        centers={name: frozen_array(centers[ball]) for name, ball in chosen.items()},
        misfit=float("nan") if distances is None else misfit,
        notes=tuple(notes),
    )


def _large_misfit(names: Sequence[str], misfit: float) -> list[Message]:
    """Warn of a misfit [m] by which a cluster is not the recording's."""
    if misfit <= MAX_MISFIT:
        return []
    return [
        BONES.message(
            f"the distances between {', '.join(names)} differ by {1e3 * misfit:.1f} mm (root mean"
            " square) between CT and recording: another cluster, a bent one, or a wrong unit?"
        )
    ]


def _orders(balls: int, markers: int) -> list[tuple[int, ...]]:
    """List which ball may be which marker; of very many balls the first ones alone are tried."""
    orders = list(permutations(range(balls), markers))
    return orders if len(orders) <= MAX_ORDERS else list(permutations(range(markers)))


def _pick_cost(centers: Array, picked: Mapping[int, Array]) -> float:
    """Sum the squared distances [m^2] of markers from the points picked near them.

    Parameters
    ----------
    centers : (markers, 3) in one order [m]
    picked : (3,) by index of the marker [m]
    """
    squares = [float(np.sum((centers[index] - point) ** 2)) for index, point in picked.items()]
    return sum(squares)


def _swapped_picks(
    names: Sequence[str], orders: Sequence[tuple[int, ...]], misfits: Array, picked: int
) -> list[Message]:
    """Warn of picked points that look swapped, by the distances between markers.

    Parameters
    ----------
    names : of the markers
    orders : balls of the markers
    misfits : (orders,) [m]
    picked : index of the order by the picked points
    """
    if misfits[picked] <= misfits.min() + MAX_PICKED_MISFIT:
        return []
    balls = zip(names, orders[picked], orders[int(np.argmin(misfits))], strict=True)
    swapped = [name for name, ball, other in balls if ball != other]
    return [
        BONES.message(
            f"markers {', '.join(swapped)} seem exchanged: as picked their distances differ by"
            f" {1e3 * misfits[picked]:.1f} mm from the recording's, in another order by"
            f" {1e3 * misfits.min():.1f} mm"
        )
    ]


def _check_order(names: Sequence[str], misfits: Array, best: int) -> None:
    """Check that distances leave one order of the markers.

    Parameters
    ----------
    names : of the markers
    misfits : (orders,) [m]
    best : index of the smallest

    Raises
    ------
    BadData : another order fits as well
    """
    others = np.delete(misfits, best)
    if not len(others) or misfits[best] >= MAX_MISFIT:
        return
    if others.min() - misfits[best] < MIN_DIFFERENCE:
        raise BadData(
            f"the markers {', '.join(names)} form a triangle of equal sides within"
            f" {1e3 * others.min():.1f} mm: their distances do not show which is which; pick a"
            " point near one of them"
        )


def _misfit(centers: Array, distances: Array | None) -> float:
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
    differences = np.linalg.norm(centers[:, None] - centers[None], axis=2) - distances
    pairs = differences[np.triu_indices(len(centers), 1)]
    pairs = pairs[np.isfinite(pairs)]
    return float(np.sqrt(np.mean(pairs**2))) if len(pairs) else 0.0


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
    notes: tuple[Message, ...] = ()

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


@read_only
@dataclass(frozen=True, eq=False, kw_only=True)
class BoneScan:
    """A bone in a CT, or a part of it, with markers on it.

    Attributes
    ----------
    surface : in the CT's frame [m]
    markers : (3,) by name in the CT's frame [m]
    """

    surface: Surface
    markers: Mapping[str, Array]


def place_scanned_bone(
    body: str,
    scan: BoneScan,
    modelled: Surface,
    picks: Picks | None = None,
    options: SurfaceOptions | None = None,
) -> ScannedBone:
    """Lay the surface of a bone in a CT, or of a part of it, on the bone of a model.

    Picked points give the start. Where other starts come clearly nearer, they are taken.

    Parameters
    ----------
    body : of the model
    scan : the bone and its markers in the CT
    modelled : the bone in the body's frame (`bone_surface`) [m]
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
        with_scale = options.scale and len(picks.names) > 3
        fitted = fit_points(picks.names, picks.scanned, picks.modelled, with_scale)
        notes = [*located(body, fitted.notes)]
        # A wrong pick would only lead the surfaces astray; without picks they find each other from
        # many starts.
        start = None if fitted.notes else fitted.similarity
    fit = register_surface(scan.surface, modelled, start, options)
    if start is not None and fit.rms > GOOD_RMS:
        other = register_surface(scan.surface, modelled, None, options)
        if other.rms < 0.7 * fit.rms:
            notes.append(
                BONES.message(
                    f"{body}: from the picked points the surfaces come to {1e3 * fit.rms:.1f} mm,"
                    f" from other starts to {1e3 * other.rms:.1f} mm, which was taken: were the"
                    " points picked on this bone?"
                )
            )
            fit = other
    notes += located(body, fit.notes)
    notes += _warnings(body, fit, scan)
    markers = {name: frozen_array(position, (3,)) for name, position in scan.markers.items()}
    return ScannedBone(body=body, fit=fit, markers=markers, notes=tuple(notes))


def _warnings(body: str, fit: SurfaceFit, scan: BoneScan) -> list[Message]:
    """Name a size, a misfit or a marker's distance from its bone that looks wrong."""
    notes = []
    size = fit.similarity.scale
    if not 0.8 < size < 1.25:
        notes.append(
            BONES.message(
                f"{body}: the model's bone is {size:.2f} times the scanned one: another bone, or a"
                " wrong unit?"
            )
        )
    if fit.rms > 0.005:
        notes.append(
            BONES.message(
                f"{body}: the surfaces differ by {1e3 * fit.rms:.1f} mm (root mean square): is it"
                " this bone?"
            )
        )
    for name, position in scan.markers.items():
        distance = float(np.min(np.linalg.norm(scan.surface.vertices - position, axis=1)))
        if distance > MAX_MARKER_DISTANCE:
            notes.append(
                BONES.message(
                    f"{body}: marker '{name}' lies {1e3 * distance:.0f} mm from the bone: another"
                    " scan, or unit?"
                )
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
