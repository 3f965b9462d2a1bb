"""Spheres and cylinders through points: algebraic start, robust geometric least squares.

The distance of a point from a sphere is d = |x - c| - r, from a cylinder d = |(1 - u u^T)(x - p)| -
r. Gauss-Newton on the sum of rho(d) with Tukey's rho, whose width follows the median of |d| (Beaton
and Tukey 1974). The start of a sphere is where the normals' lines meet, that of a cylinder the
linear problem |x|^2 = 2 c.x + k across an axis that is given, and where the normals' lines meet as
well: points far off pull the first one to a cylinder that is none.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from myomorph.core.model.arrays import Array, frozen_array, read_only
from myomorph.core.model.errors import BadData

# Robust standard deviations at which a point stops to count: 95 % efficient where errors are
# normal.
TUKEY = 4.685
ITERATIONS = 100
SETTLED = 1e-9  # Step, as a share of the size, that ends the iteration.
# Ratio of the eigenvalues of the normal equations below which an unknown is not determined.
FLAT = 1e-11
SAME = 1e-6  # Two starts ended at the same cylinder where its distances differ by a smaller share.
TOGETHER = 0.3
"""Errors of a surface go together over so much of the radius: one observation in covariances is a
patch as wide.
"""

# Points in each cell of directions, were they spread over all of them, by which what they cover is
# counted.
CELLS = 8


@read_only
class SphereFit:
    """A sphere through points of a surface."""

    center: Array  # (3,) [m]
    radius: float  # [m]
    rms: float  # of the distances of the points that count [m]
    coverage: float  # share of the sphere in whose directions there are points, 0 to 1
    # (3, 3) of the center, a patch `TOGETHER` of the radius wide taken as one observation [m^2]
    covariance: Array
    count: int  # of points that count
    hollow: bool  # the surface looks towards the center, as a socket's does
    # how much the normals turn where they turn least, over what they do on the sphere: 1 on a
    # sphere, 0 along a shaft
    bent: float

    @property
    def deviation(self) -> float:
        """Standard deviation of the center in its worst direction [m]."""
        return float(np.sqrt(np.linalg.eigvalsh(self.covariance)[-1]))


@read_only
class CylinderFit:
    """A cylinder through points of a surface."""

    point: Array  # (3,) of its axis, amid the points [m]
    axis: Array  # (3,) unit vector, to the side of the axis given
    radius: float  # [m]
    length: float  # along the axis, between the first and the last of the points that count [m]
    rms: float  # of the distances of the points that count [m]
    coverage: float  # share of the turn about the axis in which there are points, 0 to 1
    deviation: float  # standard deviation of the axis's place in the worst direction [m]
    count: int  # of points that count
    hollow: bool  # the surface looks towards the axis


def fit_sphere(points: ArrayLike, normals: ArrayLike, weights: ArrayLike) -> SphereFit:
    """Fit the sphere nearest to points.

    `points`: (n, 3) [m]; `normals`: (n, 3) outward: they start the center, which little of a sphere
    needs, and tell a head from a socket; `weights`: (n,) area that each point stands for [m^2].
    """
    x, share, middle, size = _scaled(points, weights, 4, "sphere")
    center, radius = _sphere_start(x, normals, share)
    counts = share
    for _ in range(ITERATIONS):
        reach, direction = _reached(x, center)
        apart = reach - radius
        counts = share * _tukey(apart, share)
        slopes = np.hstack([direction, np.ones((len(x), 1))])
        step = _within(_solved(slopes, apart, counts, "sphere"), radius)
        center = center + step[:3]
        radius = float(radius + step[3])
        if np.abs(step).max() < SETTLED:
            break
    rms = float(np.sqrt(np.average(apart**2, weights=counts)))
    coverage = float(np.sum(np.asarray(weights)[counts > 0]) / (4.0 * np.pi * (size * radius) ** 2))
    spread = _covariance(slopes, counts, rms, 4.0 * np.pi * coverage / TOGETHER**2)
    return SphereFit(
        center=frozen_array(middle + size * center),
        radius=size * radius,
        rms=size * rms,
        coverage=min(coverage, 1.0),
        covariance=frozen_array(size**2 * spread[:3, :3]),
        count=int((counts > 0).sum()),
        hollow=_looks_inward(direction, normals, counts),
        bent=_bent(x / radius, normals, counts),
    )


def _reached(x: Array, center: Array) -> tuple[Array, Array]:
    """Return distances (n,) of points (n, 3) from a center (3,), and unit vectors (n, 3) there."""
    away = x - center
    reach = np.linalg.norm(away, axis=1)
    return reach, away / np.maximum(reach, 1e-12)[:, None]


def fit_cylinder(
    points: ArrayLike, normals: ArrayLike, weights: ArrayLike, axis: ArrayLike
) -> CylinderFit:
    """Fit the cylinder nearest to points (n, 3) [m].

    `normals`: (n, 3) outward, tell a shaft from a hole; `weights`: area of each point; `axis`: (3,)
    along which its axis is, about.
    """
    x, share, middle, size = _scaled(points, weights, 6, "cylinder")
    first = np.asarray(axis, dtype=np.float64) / np.linalg.norm(axis)
    starts = (_circle_start, partial(_normals_start, np.asarray(normals, dtype=np.float64)))
    found = [fit for start in starts if (fit := _cylinder_from(x, share, first, start))]
    if not found:
        raise BadData(
            "the points do not determine a cylinder: give points over more of its circumference"
        )
    best = min(found, key=lambda fit: fit.rms)
    if found[0].rms < (1.0 + SAME) * best.rms:
        best = found[0]
    kept = best.counts > 0
    along = (x @ best.axis)[kept]
    ends = along.min(), along.max()
    coverage = _coverage_of_turn(best.direction[kept], best.axis)
    patches = (
        coverage * 2.0 * np.pi * max((ends[1] - ends[0]) / best.radius, TOGETHER) / TOGETHER**2
    )
    spread = _covariance(best.slopes, best.counts, best.rms, patches)
    point = best.point + best.axis * (0.5 * (ends[0] + ends[1]) - best.point @ best.axis)
    return CylinderFit(
        point=frozen_array(middle + size * point),
        axis=frozen_array(best.axis),
        radius=size * best.radius,
        length=size * float(ends[1] - ends[0]),
        rms=size * best.rms,
        coverage=coverage,
        deviation=size * float(np.sqrt(np.linalg.eigvalsh(spread[:2, :2])[-1])),
        count=int(kept.sum()),
        hollow=_looks_inward(best.direction, normals, best.counts),
    )


def _sphere_start(x: Array, normals: ArrayLike, share: Array) -> tuple[Array, float]:
    """Where the lines along the normals come nearest to each other."""
    looks = np.asarray(normals, dtype=np.float64)
    gaps = np.eye(3) - looks[:, :, None] * looks[:, None, :]
    center = _solved(
        gaps.reshape(-1, 3),
        np.einsum("ijk,ik->ij", gaps, x).reshape(-1),
        np.repeat(share, 3),
        "sphere",
    )
    return center, float(share @ np.linalg.norm(x - center, axis=1))


@read_only
class _Cylinder:
    """A cylinder on its way: sized to about 1, with the state of the last step."""

    point: Array
    axis: Array
    radius: float
    rms: float
    counts: Array
    direction: Array
    slopes: Array


def _circle_start(x: Array, share: Array, across: Array) -> tuple[Array, float]:
    """Fit a circle to the points seen along the axis, as squares (Kasa 1976).

    Returns its center and radius. Points far off pull it.
    """
    flat = x @ across
    slopes = np.hstack([2.0 * flat, np.ones((len(x), 1))])
    solution = _solved(slopes, np.sum(flat**2, axis=1), share, "cylinder")
    radius = float(np.sqrt(max(solution[2] + solution[:2] @ solution[:2], 1e-12)))
    return across @ solution[:2], radius


def _normals_start(normals: Array, x: Array, share: Array, across: Array) -> tuple[Array, float]:
    """Return where lines along the normals, seen along the axis, come nearest to each other.

    The second value is the mean distance from there.
    """
    flat = x @ across
    looks = normals @ across
    size = np.maximum(np.linalg.norm(looks, axis=1), 1e-12)
    turned = np.stack([-looks[:, 1], looks[:, 0]], axis=1) / size[:, None]
    center = _solved(turned, np.sum(turned * flat, axis=1), share, "cylinder")
    radius = float(share @ np.linalg.norm(flat - center, axis=1))
    return across @ center, radius


def _cylinder_from(
    x: Array, share: Array, axis: Array, start: Callable[..., tuple[Array, float]]
) -> _Cylinder | None:
    """Fit position (2), direction (2) and radius of a cylinder by Gauss-Newton.

    None where the points leave one of them open.
    """
    counts = share
    try:
        point, radius = start(x, share, _across(axis))
        for _ in range(ITERATIONS):
            across = _across(axis)
            away = x - point
            along = away @ axis
            away = away - np.outer(along, axis)
            reach = np.linalg.norm(away, axis=1)
            direction = away / np.maximum(reach, 1e-12)[:, None]
            apart = reach - radius
            counts = share * _tukey(apart, share)
            flat = direction @ across
            slopes = np.hstack([flat, along[:, None] * flat, np.ones((len(x), 1))])
            step = _within(_solved(slopes, apart, counts, "cylinder"), radius)
            point, radius = point + across @ step[:2], float(radius + step[4])
            axis = axis + across @ step[2:4]
            axis = axis / np.linalg.norm(axis)
            if np.abs(step).max() < SETTLED:
                break
    except BadData:
        return None
    rms = float(np.sqrt(np.average(apart**2, weights=counts)))
    return _Cylinder(point, axis, radius, rms, counts, direction, slopes) if radius > 0 else None


def _scaled(
    points: ArrayLike, weights: ArrayLike, least: int, what: str
) -> tuple[Array, Array, Array, float]:
    """Center points about their middle in units of their spread.

    Returns these, shares that sum to 1, the middle and the spread.
    """
    x = np.asarray(points, dtype=np.float64)
    if x.ndim != 2 or x.shape[1] != 3 or len(x) < least:
        raise BadData(f"a {what} needs {least} points (n, 3) or more, but got {x.shape}")
    share = np.asarray(weights, dtype=np.float64)
    if (
        not np.isfinite(x).all()
        or share.shape != (len(x),)
        or not share.sum() > 0
        or share.min() < 0
    ):
        raise BadData(f"a {what} needs finite points, and weights that are not negative")
    share = share / share.sum()
    middle = share @ x
    size = float(np.sqrt(share @ np.sum((x - middle) ** 2, axis=1)))
    if not size > 1e-9 * np.abs(x).max():
        raise BadData(f"a {what} needs distinct points")
    return (x - middle) / size, share, middle, size


def _tukey(apart: Array, share: Array) -> Array:
    """Weights of Tukey's biweight, its width from the median of the distances."""
    size = np.abs(apart)
    order = np.argsort(size)
    median = size[order][np.searchsorted(np.cumsum(share[order]), 0.5 * share.sum())]
    width = TUKEY * max(1.4826 * float(median), 1e-12)
    return np.maximum(0.0, 1.0 - (size / width) ** 2) ** 2


def _solved(slopes: Array, values: Array, weights: Array, what: str) -> Array:
    weighted = weights[:, None] * slopes
    d, v = np.linalg.eigh(slopes.T @ weighted)
    if not d[0] > FLAT * d[-1]:
        raise BadData(
            f"the points do not determine a {what}: they lie flat, or cover too little of it"
        )
    return v @ ((v.T @ (weighted.T @ values)) / d)


def _within(step: Array, radius: float) -> Array:
    """Limit a step to a quarter of the radius.

    Where little of the turn is seen, the first steps lead astray.
    """
    return step * min(1.0, 0.25 * radius / max(float(np.abs(step).max()), 1e-12))


def _covariance(slopes: Array, weights: Array, rms: float, observations: float) -> Array:
    """Of the unknowns, if there were so many independent observations."""
    information = (weights[:, None] * slopes).T @ slopes / weights.sum()
    return rms**2 / max(observations, 1.0) * np.linalg.inv(information)


def _looks_inward(direction: Array, normals: ArrayLike, weights: Array) -> bool:
    return bool(
        weights @ np.einsum("ij,ij->i", direction, np.asarray(normals, dtype=np.float64)) < 0
    )


def _bent(points: Array, normals: ArrayLike, weights: Array) -> float:
    """Least eigenvalue of the linear map from places, in radii, to normals."""
    share = weights / weights.sum()
    x = points - share @ points
    n = np.asarray(normals, dtype=np.float64)
    moments = (share[:, None] * x).T @ x
    slopes = np.linalg.solve(
        moments + 1e-12 * np.trace(moments) * np.eye(3), (share[:, None] * x).T @ n
    )
    turns = np.linalg.eigvalsh(0.5 * (slopes + slopes.T))
    return float(np.abs(turns).min()) if turns[0] * turns[-1] > 0.0 else 0.0


def _across(axis: Array) -> Array:
    """(3, 2) two unit vectors across an axis and each other."""
    first = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    first = first / np.linalg.norm(first)
    return np.stack([first, np.cross(axis, first)], axis=1)


def _coverage_of_turn(direction: Array, axis: Array) -> float:
    """Share of equal parts of the turn about an axis that hold a direction."""
    count = int(np.clip(len(direction) // CELLS, 8, 72))
    flat = direction @ _across(axis)
    parts = np.floor((np.arctan2(flat[:, 1], flat[:, 0]) / (2.0 * np.pi) % 1.0) * count).astype(
        np.int64
    )
    return len(np.unique(np.minimum(parts, count - 1))) / count
