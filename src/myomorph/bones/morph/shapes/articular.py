"""Articular surfaces on bones: heads and sockets as spheres, condyles and trochleae as cylinders.

From a center (or an axis) and a radius that are nearly right, as a registration of the source's
bone gives them, the region of the surface that lies on the sphere is grown and fitted in turn until
it stays: vertices near the sphere that face along its radius, in the one patch that hangs together.
`spherical_patches` needs no start: every vertex votes for centers along its normal.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from myomorph.bones.morph.shapes.quadrics import CylinderFit, SphereFit, fit_cylinder, fit_sphere
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.surface import Surface, connected, edges_of, face_crosses, used_part

# Cosine of the angle to the radius (35 degrees) up to which a vertex may belong to a round region.
FACING = 0.82


@dataclass(frozen=True)
class RoundShell:
    """A layer about a sphere or cylinder.

    Attributes
    ----------
    radius : of the sphere or cylinder [m]
    share : of the radius that a point may be off
    hollow : whether the surface faces inward, as in a socket
    """

    radius: float
    share: float
    hollow: bool


@read_only
class Corners:
    """Vertices of a surface, equal ones as one."""

    points: Array  # (n, 3) [m]
    normals: Array  # (n, 3) outward, of the faces around, by their areas
    areas: Array  # (n,) a third of the faces around [m^2]
    edges: np.ndarray  # (m, 2) pairs of vertices that a face has

    @staticmethod
    def of(surface: Surface) -> Corners:
        """All that faces with an area have."""
        _, first, same = np.unique(
            np.round(surface.vertices, 9), axis=0, return_index=True, return_inverse=True
        )
        points = surface.vertices[first]
        faces = same.reshape(-1)[surface.faces]
        crossed = face_crosses(points, faces)
        normals = np.zeros_like(points)
        areas = np.zeros(len(points))
        for index in range(3):
            np.add.at(normals, faces[:, index], crossed)
            np.add.at(areas, faces[:, index], np.linalg.norm(crossed, axis=1) / 6.0)
        normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-30)[:, None]
        return Corners(points=points, normals=normals, areas=areas, edges=edges_of(faces))._where(
            areas > 0
        )

    def _where(self, kept: np.ndarray) -> Corners:
        number = np.cumsum(kept) - 1
        edges = number[self.edges[kept[self.edges].all(axis=1)]]
        return Corners(
            points=self.points[kept],
            normals=self.normals[kept],
            areas=self.areas[kept],
            edges=edges,
        )

    def within(self, middle: Array, reach: float) -> Corners:
        """Return the corners near a point.

        Parameters
        ----------
        middle : (3,) the point [m]
        reach : distance from it [m]

        Returns
        -------
        those corners
        """
        away = self.points - middle
        return self._where(np.einsum("ij,ij->i", away, away) < reach**2)

    def some(self, count: int) -> Corners:
        """Return so many corners or fewer, without edges.

        They are in a random order in which large areas come first.
        """
        order = np.argsort(np.random.default_rng(0).random(len(self.points)) / self.areas)[:count]
        areas = self.areas[order]
        whole = areas * (self.areas.sum() / areas.sum())
        return Corners(
            points=self.points[order],
            normals=self.normals[order],
            areas=whole,
            edges=np.zeros((0, 2), np.int64),
        )

    def around(self, away: Array, shell: RoundShell) -> np.ndarray:
        """Return which corners lie in a shell and face along its radius.

        Parameters
        ----------
        away : (n, 3) from the center or the axis [m]
        shell : about the sphere or cylinder

        Returns
        -------
        (n,) whether a corner does
        """
        reach = np.sqrt(np.einsum("ij,ij->i", away, away))
        facing = np.einsum("ij,ij->i", self.normals, away) * (-1.0 if shell.hollow else 1.0)
        near = np.abs(reach - shell.radius) <= shell.share * shell.radius
        return near & (facing >= FACING * reach)

    def patch(
        self, away: Array, shell: RoundShell, inside: np.ndarray | None = None, pieces: int = 1
    ) -> np.ndarray:
        """Return the corners around that are inside, in the largest connected piece or pieces.

        Parameters
        ----------
        away : (n, 3) from the center or the axis [m]
        shell : about the sphere or cylinder
        inside : (n,) which corners may be chosen; all by default
        pieces : number of pieces, those of largest area

        Returns
        -------
        (n,) whether a corner is chosen
        """
        chosen = self.around(away, shell)
        if inside is not None:
            chosen &= inside
        edges = self.edges[chosen[self.edges].all(axis=1)]
        label = connected(len(self.points), edges)
        sizes = np.bincount(label, weights=np.where(chosen, self.areas, 0.0))
        return chosen & np.isin(label, np.argsort(-sizes)[:pieces])


REACH = 0.35
"""Shell in which the region is looked for at first, as a share of the radius: as wrong as the start
may be.
"""

# Shell in which it is grown in the end: a fovea is deeper, the coarsest meshes' corners are not.
NARROW = 0.08
CLOSER = 0.7  # By which the shell shrinks from one to the other.
ROUNDS = 40
MIN_COUNT = 8  # Vertices of a region, at least.
# A radius that becomes so many times the one given, or one over it, is that of something else.
GROWTH = 1.6
# Root mean square distance, as a share of the radius, above which a surface is not round.
ROUGH = 0.06
COVERED = 0.12
"""Share of the sphere (a cap of 40 degrees) below which center and radius cannot be told apart on a
bone.
"""

TURNED = 0.15  # Share of a cylinder's turn (54 degrees) below which its axis cannot be determined.
# Least bend of a surface, over that of the sphere, below which it is no sphere but a shaft or an
# edge.
BENT = 0.35
# Standard deviation of a center, as a share of the radius, above which it is not one to go by.
UNSURE = 0.1
# Cosine of the angle (35 degrees) by which a cylinder's axis may lean from the one given.
LEANING = 0.82
STARTS = 0.35, 0.8
"""A cylinder is looked for from starts so many radii beside the one given, and so many times its
size: condyles are not quite round, and of the cylinders that fit parts of them that is taken on
which most of the surface lies.
"""

EXPECTED = 0.25
"""Standard deviation in that choice of how far off the start is: the logarithm of its radius, its
place in radii, its direction [rad].
"""

VOTERS = 4000
SEEDS = 300
TRIES = 10
"""Vertices that count in a vote, those that propose centers, and proposals that are fitted for
every sphere wanted.
"""

LADDER = 1.35  # Ratio of neighboring radii that vertices vote for.
_Fit = TypeVar("_Fit", SphereFit, CylinderFit)


def articular_sphere(
    surface: Surface, near: ArrayLike, radius: float, hollow: bool = False
) -> SphereFit:
    """Fit the sphere of a joint's head, or of a socket (`hollow`).

    `near`: its center within a third of the radius [m].
    """
    start = np.asarray(near, dtype=np.float64)
    return _sphere(_near(surface, start, 2.5 * radius), start, radius, hollow)


@dataclass(frozen=True, eq=False)
class ExpectedCylinder:
    """A cylinder as it is expected, roughly.

    Attributes
    ----------
    near : (3,) point amid the joint [m]
    axis : (3,) direction
    radius : of the cylinder [m]
    width : along the axis [m]; 4 radii by default
    """

    near: ArrayLike
    axis: ArrayLike
    radius: float
    width: float | None = None


def articular_cylinder(
    surface: Surface, expected: ExpectedCylinder, hollow: bool = False
) -> CylinderFit:
    """Fit the cylinder of a hinge's rollers.

    These are both condyles of a femur, or the trochlea of a talus or a humerus; `hollow`: of the
    notch that holds the roller.
    """
    start = np.asarray(expected.near, dtype=np.float64)
    line = np.asarray(expected.axis, dtype=np.float64)
    line = line / np.linalg.norm(line)
    radius = expected.radius
    half = 0.5 * (4.0 * radius if expected.width is None else expected.width)
    corners = _near(surface, start, float(np.hypot(2.5 * radius, half)))
    fits: list[tuple[float, CylinderFit]] = []
    reason = ""
    for begin, size in _cylinder_starts(start, line, radius):
        try:
            fit = _cylinder(corners, (begin, line, size), (start, half), hollow)
        except BadData as error:
            reason = reason or str(error)
            continue
        beside = fit.point - start
        apart = float(np.linalg.norm(beside - beside @ fit.axis * fit.axis))
        if apart > radius:
            reason = reason or f"its axis lies {mm(apart)} away, past its radius"
        elif abs(fit.axis @ line) < LEANING:
            angle = np.degrees(np.arccos(abs(fit.axis @ line)))
            reason = reason or f"its axis is {angle:.0f} degrees off the given"
        elif not 1.0 / GROWTH < fit.radius / radius < GROWTH:
            reason = reason or f"its radius is {mm(fit.radius)}, but {mm(radius)} was expected"
        else:
            lean = float(np.linalg.norm(np.cross(fit.axis, line)))
            off = np.array([np.log(fit.radius / radius), apart / radius, lean]) / EXPECTED
            likely = float(np.exp(-0.5 * off @ off))
            fits.append(
                (likely * _consensus(corners, fit, (start, half), NARROW * radius, hollow), fit)
            )
    if not fits:
        raise BadData(f"no cylinder was found near {_text(start)}: {reason}")
    return max(fits, key=lambda scored: scored[0])[1]


def warning_of(fit: SphereFit | CylinderFit) -> str:
    """Why a fit should not be relied on, in words; "" where it may be."""
    if fit.rms > ROUGH * fit.radius:
        return f"the surface is not round: {mm(fit.rms)} off at a radius of {mm(fit.radius)}"
    if fit.count < MIN_COUNT:
        return f"only {fit.count} vertices of the surface are on it"
    if isinstance(fit, SphereFit) and fit.bent < BENT:
        return "the surface is more curved in one direction than in the other, as a shaft is"
    if fit.coverage < (COVERED if isinstance(fit, SphereFit) else TURNED):
        return f"only {100 * fit.coverage:.0f} % of the round is there"
    if fit.deviation > UNSURE * fit.radius:
        return (
            f"its place is known within {mm(fit.deviation)} only, at a radius of {mm(fit.radius)}"
        )
    return ""


def spherical_patches(
    surface: Surface, hollow: bool = False, most: int = 8
) -> tuple[SphereFit, ...]:
    """Find where a bone is round.

    Returns spheres without `warning_of` that fit parts of its surface, those that cover most of
    their sphere first; none of them meets another's center. Each of many vertices proposes centers
    along its normal, for a ladder of radii from 1/100 to 1/4 of the bone's length; the proposals
    with most surface on their sphere are fitted as in `articular_sphere`.
    """
    corners = Corners.of(surface)
    length = float(np.ptp(corners.points, axis=0).max())
    radii = 0.01 * length * LADDER ** np.arange(np.log(25.0) / np.log(LADDER))
    asked = corners.some(VOTERS)
    voted: list[tuple[float, Array, float]] = []
    for seed in range(min(SEEDS, len(asked.points))):
        for radius in radii.tolist():
            center = asked.points[seed] + (radius if hollow else -radius) * asked.normals[seed]
            near = asked.around(asked.points - center, RoundShell(radius, NARROW, hollow))
            share = float(asked.areas[near].sum() / (4.0 * np.pi * radius**2))
            if share > COVERED and near.sum() >= MIN_COUNT:
                voted.append((min(share, 1.0), center, radius))
    voted.sort(key=lambda vote: -vote[0])
    sphere_fits: list[SphereFit] = []
    tried: list[tuple[Array, float]] = []
    for _, center, radius in voted:
        if any(np.linalg.norm(center - other) < 0.5 * max(radius, size) for other, size in tried):
            continue
        if len(tried) == TRIES * most:
            break
        tried.append((center, radius))
        try:
            fit = _sphere(corners.within(center, 2.5 * radius), center, radius, hollow)
        except BadData:
            continue
        if not warning_of(fit) and all(
            np.linalg.norm(fit.center - sphere.center) > sphere.radius for sphere in sphere_fits
        ):
            sphere_fits.append(fit)
    return tuple(sorted(sphere_fits, key=lambda sphere: -sphere.coverage)[:most])


def _cylinder_starts(start: Array, line: Array, radius: float) -> list[tuple[Array, float]]:
    across = np.cross(line, np.eye(3)[np.argmin(np.abs(line))])
    across = across / np.linalg.norm(across)
    other = np.cross(line, across)
    beside = (np.zeros(3), across, -across, other, -other)
    return [
        (start + STARTS[0] * radius * side, radius * growth)
        for growth in (1.0, STARTS[1], 1.0 / STARTS[1])
        for side in beside
    ]


def _cylinder(
    corners: Corners, begin: tuple[Array, Array, float], window: tuple[Array, float], hollow: bool
) -> CylinderFit:
    """Grow a cylinder from a point, a direction and a radius, inside a window.

    The window has its middle and half its width along the axis.
    """
    inside = np.abs((corners.points - window[0]) @ begin[1]) <= window[1]

    def region(fit: CylinderFit | None, shell: float) -> np.ndarray:
        point, direction, size = begin if fit is None else (fit.point, fit.axis, fit.radius)
        away = corners.points - point
        across = away - np.outer(away @ direction, direction)
        # Condyles are two patches, with a notch between them.
        return corners.patch(across, RoundShell(size, shell, hollow), inside, 2)

    def fitted(chosen: np.ndarray) -> CylinderFit:
        return fit_cylinder(
            corners.points[chosen], corners.normals[chosen], corners.areas[chosen], begin[1]
        )

    return _grown(region, fitted, begin[2])


def _consensus(
    corners: Corners, fit: CylinderFit, window: tuple[Array, float], width: float, hollow: bool
) -> float:
    """How much of a cylinder's turn and length the surface lies on, less where it is off."""
    inside = np.abs((corners.points - window[0]) @ fit.axis) <= window[1]
    away = corners.points - fit.point
    across = away - np.outer(away @ fit.axis, fit.axis)
    on = corners.patch(across, RoundShell(fit.radius, width / fit.radius, hollow), inside, 2)
    apart = (np.linalg.norm(across[on], axis=1) - fit.radius) / width
    return float(corners.areas[on] @ np.maximum(0.0, 1.0 - apart**2)) / fit.radius


def _sphere(corners: Corners, start: Array, radius: float, hollow: bool) -> SphereFit:
    def region(fit: SphereFit | None, shell: float) -> np.ndarray:
        center, size = (start, radius) if fit is None else (fit.center, fit.radius)
        return corners.patch(corners.points - center, RoundShell(size, shell, hollow))

    def fitted(chosen: np.ndarray) -> SphereFit:
        return fit_sphere(corners.points[chosen], corners.normals[chosen], corners.areas[chosen])

    result = _grown(region, fitted, radius)
    apart = float(np.linalg.norm(result.center - start))
    if apart > radius:
        raise BadData(
            f"the round surface near {_text(start)} has its center {mm(apart)} from there, past its"
            " radius"
        )
    return result


def _grown(
    region: Callable[[_Fit | None, float], np.ndarray],
    fitted: Callable[[np.ndarray], _Fit],
    radius: float,
) -> _Fit:
    """Region and fit in turn until the region stays."""
    fit: _Fit | None = None
    chosen = np.zeros(0, dtype=bool)
    shell = REACH
    for _ in range(ROUNDS):
        before = chosen
        chosen = region(fit, shell)
        if chosen.sum() < MIN_COUNT:
            raise BadData(
                f"only {int(chosen.sum())} vertices of the surface are round with a radius of"
                f" {mm(radius)}"
            )
        if fit is not None and shell == NARROW and np.array_equal(before, chosen):
            break
        fit = fitted(chosen)
        if not 1.0 / GROWTH < fit.radius / radius < GROWTH:
            raise BadData(
                f"the round surface there has a radius of {mm(fit.radius)}, but {mm(radius)} was"
                " expected"
            )
        shell = max(NARROW, CLOSER * shell)
    assert fit is not None
    return fit


def _near(surface: Surface, middle: Array, reach: float) -> Corners:
    close = np.linalg.norm(surface.vertices - middle, axis=1) < reach
    faces = surface.faces[close[surface.faces].all(axis=1)]
    if len(faces) < MIN_COUNT:
        raise BadData(f"no part of the surface lies within {mm(reach)} of {_text(middle)}")
    return Corners.of(used_part(surface.vertices, faces))


def mm(length: float) -> str:
    """Write a length [m] in millimeters."""
    return f"{1e3 * length:.3g} mm"


def _text(point: Array) -> str:
    return "(" + ", ".join(f"{number:.4g}" for number in point) + ")"
