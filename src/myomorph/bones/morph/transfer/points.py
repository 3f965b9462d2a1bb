"""Path points in other bones: put back on the surface, moving points, side sites of wraps."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from myomorph.bones.morph.morphed import TransferredPoint
from myomorph.bones.morph.shapes.articular import mm
from myomorph.bones.morph.transfer.body_transfer import Transfer, Transfers
from myomorph.bones.morph.transfer.moving_points import piece_about
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import quoted
from myomorph.core.model.frozen_map import grouped
from myomorph.core.model.functions import Function, PiecewisePolynomial, SineProduct, constant
from myomorph.core.model.model import Coordinate
from myomorph.core.model.paths import MovingPathPoint, Path, PathPoint, TendonWrap, WrapObject
from myomorph.core.model.scale import stretched
from myomorph.core.surfaces.surface_points import Shape

DEEPER = 3.0
"""A height above the surface that the map makes so many times what the bone's size makes of it is
not kept.
"""

FARTHEST = 0.05
"""A point that would be moved further than this share of the bone's length is left where the map
puts it, or brought out of the bone the nearest way: the target's surface ends there, as where a
pelvis comes without its sacrum.
"""

# Triangles, the nearest by their middles, among which the nearest of one side is looked for.
FACES = 32


@read_only
class SurfacePoints:
    """Points and how they lie to the bones."""

    points: Array  # (n, 3) in the target body [m]
    lifted: Array  # (n,) how far each was moved [m]
    # depth_source, depth_target: (n,) signed distances from the surfaces, positive outside [m]; NaN
    # without surfaces
    depth_source: Array
    depth_target: Array
    beyond: np.ndarray  # (n,) which belong on a part of the surface that the target does not have


def put_on_surface(transfer: Transfer, points: Array, within: float) -> SurfacePoints:
    """Transfer points of a body, those near its bone's surface at their height above the target's.

    The point of the surface nearest to such a point goes where the map sends it, and from there to
    the nearest point of the target's surface that faces the same way: what the map missed the
    surface by is added to the point itself. So nothing moves where the map brings surface onto
    surface, and a point stays on its side of a thin bone.

    Parameters
    ----------
    transfer : of the body
    points : (n, 3) in the source body's frame [m]
    within : distance from the surface up to which a point is near, as a share of the bone's length

    Returns
    -------
    points in the target body's frame, and how they were moved [m]
    """
    mapped = transfer.points(points)
    shapes = transfer.shapes
    none = np.zeros(len(points))
    if shapes is None or not len(points):
        return SurfacePoints(
            points=mapped,
            lifted=none,
            depth_source=none + np.nan,
            depth_target=none + np.nan,
            beyond=none > 0.0,
        )
    source, target = shapes
    feet, faces = source.closest(points)
    depth = source.signed(points)
    # A point that was outside the bone and would be inside belongs back outside, however far it
    # was.
    near = (np.abs(depth) <= within * transfer.length) | ((depth > 0) & (target.signed(mapped) < 0))
    near &= within > 0.0
    moved = mapped.copy()
    if near.any():
        # Normals of the source as those of the mapped surface, by the bone as a whole.
        facing = source.normals[faces[near]] @ np.linalg.inv(transfer.linear)
        moved[near] = _lifted(transfer, target, mapped[near], feet[near], facing, depth[near])
    far = np.linalg.norm(moved - mapped, axis=1) > FARTHEST * transfer.length * transfer.size
    # Beside a hole or beyond a cut the target's nearest point is its border, which is not where
    # such a point belongs.
    far |= near & target.rim[target.closest(mapped)[1]]
    moved[far] = mapped[far]
    crossed = far & (depth > 0) & (target.signed(moved) < 0)
    places, faces = target.closest(moved[crossed])
    moved[crossed] = places + transfer.size * depth[crossed, None] * target.normals[faces]
    return SurfacePoints(
        points=moved,
        lifted=np.linalg.norm(moved - mapped, axis=1),
        depth_source=depth,
        depth_target=target.signed(moved),
        beyond=far,
    )


def _lifted(
    transfer: Transfer, target: Shape, mapped: Array, feet: Array, facing: Array, depth: Array
) -> Array:
    ground = transfer.points(feet)
    place, normals = nearest_facing(target, ground, facing)
    above = mapped - ground
    # The map may fold or stretch what is between foot and point; then the height is the bone's size
    # times the old one.
    kept = transfer.size * depth
    # The surface knows on which side of it a point is: at an edge the normal of either face tells
    # little.
    height = target.signed(place + above)
    slack = 1e-9 * transfer.length
    wrong = (np.sign(height) * np.sign(depth) < 0) & (np.abs(height) > slack)
    wrong |= np.linalg.norm(above, axis=1) > DEEPER * np.abs(kept) + slack
    above[wrong] = kept[wrong, None] * normals[wrong]
    return place + above


def nearest_facing(shape: Shape, points: Array, facing: Array) -> tuple[Array, Array]:
    """Find the nearest points of a surface on the side that faces a direction.

    Where no triangle near by faces that way, the nearest of all is taken.

    Parameters
    ----------
    shape : surface
    points : (n, 3) to find the nearest of [m]
    facing : (n, 3) directions

    Returns
    -------
    (n, 3) points of the surface [m], and their normals (n, 3)
    """
    places, faces = shape.closest(points)
    normals = shape.normals[faces]
    middles = shape.vertices[shape.faces].mean(axis=1)
    for i in np.flatnonzero(np.einsum("ij,ij->i", normals, facing) <= 0.0):
        turned = np.flatnonzero(shape.normals @ facing[i] > 0.0)
        if not len(turned):
            continue
        near = turned[np.argsort(np.linalg.norm(middles[turned] - points[i], axis=1))[:FACES]]
        corners = shape.vertices[shape.faces[near]]
        options = _nearest_on_triangles(points[i], corners)
        best = int(np.argmin(np.linalg.norm(options - points[i], axis=1)))
        places[i] = options[best]
        normals[i] = shape.normals[near[best]]
    return places, normals


def _nearest_on_triangles(point: Array, corners: Array) -> Array:
    """(m, 3) the nearest point of each triangle (m, 3, 3)."""
    # Brings SciPy and trimesh: loaded only where it is needed.
    from trimesh.triangles import closest_point

    return np.asarray(
        closest_point(corners, np.broadcast_to(point, (len(corners), 3))), dtype=np.float64
    )


# Values of its coordinate over which the middle of a moving point's way is taken.
MIDDLE_SAMPLES = 21


@dataclass(frozen=True, eq=False)
class Setting:
    """What paths refer to beside bodies."""

    coordinates: Mapping[str, Coordinate]  # of the source, by name
    travel: Mapping[str, float]  # how much further a coordinate that slides goes in the target
    wraps: Mapping[str, tuple[WrapObject, WrapObject]]  # of the source and of the target, by name


def transferred_paths(
    owned: Iterable[tuple[str, Path]], transfers: Transfers, setting: Setting, within: float
) -> tuple[list[Path], tuple[TransferredPoint, ...], list[str]]:
    """Transfer paths of muscles or ligaments, each point by the map of its body.

    Returns paths, all of their points, and notes. A moving point follows the affine map nearest
    around the middle of its way, which is exact where the bone's map is affine. `within`: distance
    up to which a point belongs to the surface, as a share of the bone's length.
    """
    owned = list(owned)
    places = [place_of(point, setting.coordinates) for _, path in owned for point in path.points]
    bodies = [point.body for _, path in owned for point in path.points]
    owners = [(name, point.name) for name, path in owned for point in path.points]
    notes: list[str] = []
    transferred_points = _transferred_points(
        owners, bodies, np.array(places).reshape(-1, 3), transfers, within, notes
    )
    paths = []
    first = 0
    for name, path in owned:
        here = transferred_points[first : first + len(path.points)]
        first += len(path.points)
        points = tuple(
            _point(point, to, transfers[point.body], setting, f"muscle '{name}'", notes)
            for point, to in zip(path.points, here, strict=True)
        )
        tendon = tuple(
            _side(wrap, transfers, setting) for wrap in path.wraps if isinstance(wrap, TendonWrap)
        )
        paths.append(replace(path, points=points, wraps=tendon or path.wraps))
    return paths, tuple(transferred_points), list(dict.fromkeys(notes))


def _transferred_points(
    owners: list[tuple[str, str]],
    bodies: list[str],
    places: Array,
    transfers: Transfers,
    within: float,
    notes: list[str],
) -> list[TransferredPoint]:
    transferred: dict[int, TransferredPoint] = {}
    for body, here in grouped((body, i) for i, body in enumerate(bodies)).items():
        put = put_on_surface(transfers[body], places[here], within)
        if put.beyond.any():
            shown = quoted(owners[here[row]][0] for row in np.flatnonzero(put.beyond))
            notes.append(
                f"the target's bone of '{body}' has no surface near where points of these belong:"
                f" {shown}"
            )
        sure = transfers[body].within(places[here])
        for row, i in enumerate(here):
            owner, name = owners[i]
            transferred[i] = TransferredPoint(
                owner=owner,
                name=name,
                body=body,
                target_body=transfers[body].body,
                source=places[i],
                target=put.points[row],
                lifted=float(put.lifted[row]),
                depth_source=float(put.depth_source[row]),
                depth_target=float(put.depth_target[row]),
                within=float(sure[row]),
            )
    return [transferred[i] for i in range(len(bodies))]


def place_of(point: PathPoint | MovingPathPoint, coordinates: Mapping[str, Coordinate]) -> Array:
    """Return where a point is in its body, in the middle of its way if it moves.

    Parameters
    ----------
    point : of a path
    coordinates : of the model, by name

    Returns
    -------
    (3,) position in the body's frame [m]
    """
    if isinstance(point, PathPoint):
        return point.location
    ways = [
        _way(f, coordinates.get(name))
        for f, name in zip(point.functions, point.coordinates, strict=True)
    ]
    return np.array([0.5 * (way.min() + way.max()) for way in ways])


def _way(function: Function, coordinate: Coordinate | None) -> Array:
    """Values of a moving point's function over its coordinate's range."""
    if coordinate is None or function.arity == 0:
        return np.atleast_1d(function(0.0))
    low, high = np.clip(coordinate.range, coordinate.default - np.pi, coordinate.default + np.pi)
    return function(np.linspace(low, high, MIDDLE_SAMPLES))


def _point(
    point: PathPoint | MovingPathPoint,
    to: TransferredPoint,
    transfer: Transfer,
    setting: Setting,
    user: str,
    notes: list[str],
) -> PathPoint | MovingPathPoint:
    if isinstance(point, PathPoint):
        low_end, high_end = point.range
        low = low_end * setting.travel.get(point.coordinate, 1.0)
        high = high_end * setting.travel.get(point.coordinate, 1.0)
        return replace(point, body=transfer.body, location=to.target, range=(low, high))
    matrix = transfer.near(to.source)
    if len({name for name in point.coordinates if name}) > 1 or any(
        isinstance(f, SineProduct) for f in point.functions
    ):
        notes.append(
            f"{user}: moving point '{point.name}' follows several coordinates: scaled, but not"
            " rotated"
        )
        matrix = np.diag(np.linalg.norm(matrix, axis=0))
    functions = [
        stretched(f, 1.0, setting.travel.get(name, 1.0))
        for f, name in zip(point.functions, point.coordinates, strict=True)
    ]
    offset = [to.target[i] - row @ to.source for i, row in enumerate(matrix)]
    x = combined(functions, matrix[0], offset[0])
    y = combined(functions, matrix[1], offset[1])
    z = combined(functions, matrix[2], offset[2])
    x_name, y_name, z_name = _names(point, matrix)
    # What does not move has no coordinate.
    coordinates = (
        x_name if x.arity else "",
        y_name if y.arity else "",
        z_name if z.arity else "",
    )
    return replace(point, body=transfer.body, functions=(x, y, z), coordinates=coordinates)


def _names(point: MovingPathPoint, matrix: Array) -> tuple[str, str, str]:
    """Return the coordinate of each axis.

    It is its own where axes do not mix, else the one that they all follow.
    """
    if np.count_nonzero(matrix - np.diag(np.diag(matrix))) == 0:
        return point.coordinates
    coordinate = next((name for name in point.coordinates if name), "")
    return coordinate, coordinate, coordinate


def combined(functions: list[Function], factors: Array, offset: float) -> Function:
    """Return sum_i factors[i] functions[i](x) + offset, of functions of one coordinate.

    Parameters
    ----------
    functions : of one coordinate, or constant
    factors : (functions,)
    offset : added to the sum

    Returns
    -------
    function of the coordinate

    Raises
    ------
    TypeError : a product of sines, and another function
    """
    used = [(f, float(a)) for f, a in zip(functions, factors, strict=True) if a != 0.0 and f.arity]
    offset += sum(
        float(a) * float(f(0.0)) for f, a in zip(functions, factors, strict=True) if not f.arity
    )
    if not used:
        return constant(offset)
    if len(used) == 1 and isinstance(used[0][0], SineProduct):
        return used[0][0].scaled(used[0][1]).raised(offset)
    pieces: list[tuple[PiecewisePolynomial, float]] = []
    for f, a in used:
        if isinstance(f, SineProduct):
            raise TypeError("products of sines are not mixed with others")
        pieces.append((f, a))
    breaks = _all_breaks([f for f, _ in pieces])
    degree = max(f.coefficients.shape[1] for f, _ in pieces)
    coefficients = np.zeros((len(breaks), degree))
    for f, a in pieces:
        coefficients[:, : f.coefficients.shape[1]] += a * _pieces_at(f, breaks)
    coefficients[:, 0] += offset
    return PiecewisePolynomial(breaks, coefficients)


def _all_breaks(functions: list[PiecewisePolynomial]) -> Array:
    """Return the breaks of all functions.

    The first is there twice if a function has a piece of its own to their left.
    """
    if all(np.array_equal(f.breaks, functions[0].breaks) for f in functions):
        return functions[0].breaks
    breaks = np.unique(np.concatenate([f.breaks for f in functions]))
    return np.concatenate([breaks[:1], breaks])


def _pieces_at(function: PiecewisePolynomial, breaks: Array) -> Array:
    """Expand a function about each break, (breaks, degree + 1) coefficients.

    The first break's are those to its left.
    """
    if np.array_equal(function.breaks, breaks):
        return function.coefficients
    piece = np.clip(np.searchsorted(function.breaks, breaks, side="right") - 1, 0, None)
    piece[0] = max(0, int(np.searchsorted(function.breaks, breaks[0], side="left")) - 1)
    return np.array(
        [piece_about(function, number, at) for at, number in zip(breaks, piece, strict=True)]
    )


def _side(wrap: TendonWrap, transfers: Transfers, setting: Setting) -> TendonWrap:
    """Keep a side site's position relative to the surface: inside stays inside.

    On another body it goes by its map.
    """
    if wrap.side is None:
        return wrap
    before, after = setting.wraps[wrap.wrap_object]
    body = transfers[wrap.side_body].body
    if wrap.side_body != before.body:
        return replace(wrap, side_body=body, side=transfers[wrap.side_body].points(wrap.side))
    local = before.pose.inverse().apply(wrap.side)
    growth = np.full(3, after.size[0] / before.size[0])
    return replace(wrap, side_body=body, side=after.pose.apply(local * growth))


LARGE = 0.03  # Share of the bone's length: a point that is known less surely is named.
APART = 0.2  # Share of the bone's length between places that are asked for.
ASKED = 3  # Places that are asked for, at most.


def uncertain_notes(points: Iterable[TransferredPoint], transfers: Transfers) -> list[str]:
    """Report each bone with points that may belong far from where they were put.

    A line names landmarks to add.
    """
    notes = []
    for body, here in grouped((point.body, point) for point in points).items():
        length = transfers[body].length
        unsure = sorted(
            (item for item in here if item.within > LARGE * length), key=lambda item: -item.within
        )
        if not unsure:
            continue
        asked: list[TransferredPoint] = []
        for point in unsure:
            if all(np.linalg.norm(point.source - other.source) > APART * length for other in asked):
                asked.append(point)
        places = ", ".join(f"'{item.owner}' ({item.name})" for item in asked[:ASKED])
        notes.append(
            f"{len(unsure)} of {len(here)} points on '{body}' may belong up to"
            f" {mm(unsure[0].within)} away along the bone (90 %): landmarks at these attachments"
            f" would determine them: {places}"
        )
    return notes
