"""Muscle paths in other bones: points, points that move with coordinates, side sites of wraps."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.functions import Function, PiecewisePolynomial, SineProduct, constant
from myomorph.model.model import Coordinate
from myomorph.model.paths import MovingPathPoint, Path, PathPoint, TendonWrap, WrapObject
from myomorph.model.scale import stretched
from myomorph.morph.carrier import Carrier, Carriers, few
from myomorph.morph.morphed import CarriedPoint
from myomorph.morph.on_surface import put_on_surface

MIDDLE_SAMPLES = 21
"""Values of its coordinate over which the middle of a moving point's way is taken."""


@dataclass(frozen=True, eq=False)
class CarriedPaths:
    """Paths in other bones.

    Attributes
    ----------
    paths : in the order given
    points : all of them, in order
    """

    paths: tuple[Path, ...]
    points: tuple[CarriedPoint, ...]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Setting:
    """What paths refer to beside bodies.

    Attributes
    ----------
    coordinates : of the source, by name
    travel : how much further a coordinate that slides goes in the target
    wraps : of the source and of the target, by name
    """

    coordinates: Mapping[str, Coordinate]
    travel: Mapping[str, float]
    wraps: Mapping[str, tuple[WrapObject, WrapObject]]


def carried_paths(
    owned: Iterable[tuple[str, Path]], carriers: Carriers, setting: Setting, within: float
) -> CarriedPaths:
    """Paths of muscles or ligaments, every point by the map of the body that it is fixed to.

    A moving point is carried by the affine map nearest around the middle of its way, which is exact where the bone's
    map is affine.

    Parameters
    ----------
    owned : names and paths
    within : distance from the surface up to which a point belongs to it, as a share of the bone's length
    """
    owned = list(owned)
    places = [place_of(point, setting.coordinates) for _, path in owned for point in path.points]
    bodies = [point.body for _, path in owned for point in path.points]
    owners = [(name, point.name) for name, path in owned for point in path.points]
    notes: list[str] = []
    carried = _carried_points(owners, bodies, np.array(places).reshape(-1, 3), carriers, within, notes)
    paths, first = [], 0
    for name, path in owned:
        here = carried[first : first + len(path.points)]
        first += len(path.points)
        points = tuple(
            _point(point, to, carriers[point.body], setting, f"muscle '{name}'", notes)
            for point, to in zip(path.points, here, strict=True)
        )
        tendon = tuple(_side(one, carriers, setting) for one in path.wraps if isinstance(one, TendonWrap))
        paths.append(replace(path, points=points, wraps=tendon or path.wraps))
    return CarriedPaths(tuple(paths), tuple(carried), tuple(dict.fromkeys(notes)))


def _carried_points(
    owners: list[tuple[str, str]],
    bodies: list[str],
    places: Array,
    carriers: Carriers,
    within: float,
    notes: list[str],
) -> list[CarriedPoint]:
    found: dict[int, CarriedPoint] = {}
    by_body: dict[str, list[int]] = {}
    for i, body in enumerate(bodies):
        by_body.setdefault(body, []).append(i)
    for body, here in by_body.items():
        put = put_on_surface(carriers[body], places[here], within)
        if put.beyond.any():
            shown = few(owners[here[k]][0] for k in np.flatnonzero(put.beyond))
            notes.append(f"the target's bone of '{body}' has no surface near where points of these belong: {shown}")
        for k, i in enumerate(here):
            depths = float(put.depth_source[k]), float(put.depth_target[k])
            found[i] = CarriedPoint(
                *owners[i], body, carriers[body].body, places[i], put.points[k], float(put.lifted[k]), *depths
            )
    return [found[i] for i in range(len(bodies))]


def place_of(point: PathPoint | MovingPathPoint, coordinates: Mapping[str, Coordinate]) -> Array:
    """Where a point is in its body, (3,), in the middle of its way if it moves [m]."""
    if isinstance(point, PathPoint):
        return point.location
    ways = [_way(f, coordinates.get(name)) for f, name in zip(point.functions, point.coordinates, strict=True)]
    return np.array([0.5 * (way.min() + way.max()) for way in ways])


def _way(function: Function, coordinate: Coordinate | None) -> Array:
    """Values of a moving point's function over its coordinate's range."""
    if coordinate is None or function.arity == 0:
        return np.atleast_1d(function(0.0))
    low, high = np.clip(coordinate.range, coordinate.default - np.pi, coordinate.default + np.pi)
    return function(np.linspace(low, high, MIDDLE_SAMPLES))


def _point(
    point: PathPoint | MovingPathPoint,
    to: CarriedPoint,
    carrier: Carrier,
    setting: Setting,
    user: str,
    notes: list[str],
) -> PathPoint | MovingPathPoint:
    if isinstance(point, PathPoint):
        low, high = (end * setting.travel.get(point.coordinate, 1.0) for end in point.range)
        return replace(point, body=carrier.body, location=to.target, range=(low, high))
    matrix = carrier.near(to.source)
    if len({name for name in point.coordinates if name}) > 1 or any(
        isinstance(f, SineProduct) for f in point.functions
    ):
        notes.append(
            f"{user}: moving point '{point.name}' follows several coordinates: its ways are stretched, but not turned"
        )
        matrix = np.diag(np.linalg.norm(matrix, axis=0))
    functions = [
        stretched(f, 1.0, setting.travel.get(name, 1.0))
        for f, name in zip(point.functions, point.coordinates, strict=True)
    ]
    x, y, z = (combined(functions, row, to.target[i] - row @ to.source) for i, row in enumerate(matrix))
    names = _names(point, matrix)
    a, b, c = (name if f.arity else "" for f, name in zip((x, y, z), names, strict=True))
    return replace(point, body=carrier.body, functions=(x, y, z), coordinates=(a, b, c))


def _names(point: MovingPathPoint, matrix: Array) -> tuple[str, str, str]:
    """The coordinate of each axis: its own where axes do not mix, else the one that they all follow."""
    if np.count_nonzero(matrix - np.diag(np.diag(matrix))) == 0:
        return point.coordinates
    one = next((name for name in point.coordinates if name), "")
    return one, one, one


def combined(functions: list[Function], factors: Array, offset: float) -> Function:
    """sum_i factors[i] functions[i](x) + offset, of functions of one coordinate.

    Raises
    ------
    TypeError : two functions have factors and one is a product of sines
    """
    used = [(f, float(a)) for f, a in zip(functions, factors, strict=True) if a != 0.0 and f.arity]
    offset += sum(float(a) * float(f(0.0)) for f, a in zip(functions, factors, strict=True) if not f.arity)
    if not used:
        return constant(offset)
    if len(used) == 1 and isinstance(used[0][0], SineProduct):
        grown = used[0][0].scaled(used[0][1])
        return replace(grown, offset=grown.offset + offset)
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
    """Breaks of all, the first twice where a function has a piece of its own to the left of them."""
    if all(np.array_equal(f.breaks, functions[0].breaks) for f in functions):
        return functions[0].breaks
    breaks = np.unique(np.concatenate([f.breaks for f in functions]))
    return np.concatenate([breaks[:1], breaks])


def _pieces_at(function: PiecewisePolynomial, breaks: Array) -> Array:
    """(breaks, degree + 1) the function's coefficients about each break, the first break's to its left."""
    if np.array_equal(function.breaks, breaks):
        return function.coefficients
    piece = np.clip(np.searchsorted(function.breaks, breaks, side="right") - 1, 0, None)
    piece[0] = max(0, int(np.searchsorted(function.breaks, breaks[0], side="left")) - 1)
    rows = []
    for at, k in zip(breaks, piece, strict=True):
        moved = np.polynomial.Polynomial(function.coefficients[k])(
            np.polynomial.Polynomial([at - function.breaks[k], 1.0])
        )
        rows.append(np.pad(moved.coef, (0, function.coefficients.shape[1] - len(moved.coef))))
    return np.array(rows)


def _side(wrap: TendonWrap, carriers: Carriers, setting: Setting) -> TendonWrap:
    """A side site keeps its place relative to the surface: inside stays inside. On another body it goes by its map."""
    if wrap.side is None:
        return wrap
    before, after = setting.wraps[wrap.wrap_object]
    body = carriers[wrap.side_body].body
    if wrap.side_body != before.body:
        return replace(wrap, side_body=body, side=carriers[wrap.side_body].points(wrap.side))
    local = before.pose.inverse().apply(wrap.side)
    growth = np.full(3, after.size[0] / before.size[0])
    return replace(wrap, side_body=body, side=after.pose.apply(local * growth))
