"""Where a force plate lies among the markers: its pose by least squares over placements of a marked
weight.

Each placement gives a line in the plate's axes, the line of action of the measured force, and in
the laboratory a point that it passes through and its direction ([S] III: "the weight with optical
markers"). With R, p the plate's axes and the center of its top surface, f the unit force, r its
line's point nearest to the center, c the point and u the direction in the laboratory, the residuals
across the line are

    angle:     the part of R f across u,    distance:     the part of c - p - R r across R f.

A weight at rest shows the tilt (u is vertical) and, by its places, the turn about the vertical and
the place in the plane; never the height. Pushes of a rod in oblique directions show the height too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from myomorph.core.contact.plate_placements import Placement
from myomorph.core.contact.plates import plate_axes
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.model import STANDARD_GRAVITY
from myomorph.core.model.series import PlateRecording
from myomorph.core.model.spatial import axis_rotation, least_rotation

# Length by which a rotation counts as a displacement when it is asked what the placements show [m]
ARM = 0.2
ITERATIONS = 50
ROUGHLY = 8  # Iterations from each start, of which the best goes on
TURNS = 6  # Starts about the vertical
SETTLED = 1e-9
FORCE_NOISE = 0.5
MOMENT_NOISE = 0.1  # Standard deviation of a placement's mean wrench [N], [N m]
POINT_NOISE = 0.001  # Of the marked point [m]
DIRECTION_NOISE = 0.002  # Of the marked direction [rad]
SHOWN = 0.02  # A direction of the pose whose standard deviation is larger counts as not shown [m]
MOST_MOVED = 0.002  # A weight that moved further while it should have rested is left out [m]
MOST_UNSTEADY = 0.01  # So is one whose force varied by more than this share
MOST_WRONG = 0.02  # Share by which a force may differ from the weight
SPREAD = 0.05  # Weights must stand at least so far apart [m]


@read_only
class PlatePose:
    """A pose and what is known of it."""

    # rotation, center: (3, 3) the plate's axes as columns, (3,) of its top surface [m]
    rotation: Array
    center: Array
    # (6, 6) of rotation vector [rad] and center [m] about the laboratory's axes, from the
    # residuals, zero where not shown
    covariance: Array
    # (6, k) unit directions of (0.2 m times the rotation vector, center) that no placement shows
    unknown: Array
    cost: float  # sum of squared residuals in standard deviations


def across(directions: Array) -> Array:
    """Two unit vectors (n, 2, 3) across each of n directions (n, 3)."""
    least = np.eye(3)[np.argmin(np.abs(directions), axis=1)]
    first = np.cross(directions, least)
    first = first / np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(directions, first)], axis=1)


class _Lines:
    """Placements as arrays: lines in the plate's axes, points and directions in the laboratory, and
    what they weigh.
    """

    def __init__(self, placements: Sequence[Placement]):
        lines = zip(*(placement.line for placement in placements), strict=True)
        self.nearest, self.forces = map(np.array, lines)
        self.points = np.array([placement.point for placement in placements])
        self.directions = np.array([placement.direction for placement in placements])
        self.beside = across(self.directions)
        sizes = np.array([placement.size for placement in placements])
        angle = np.hypot(DIRECTION_NOISE, FORCE_NOISE / sizes)
        distance = np.hypot(POINT_NOISE, MOMENT_NOISE / sizes)
        self.noise = np.stack([angle, angle, distance, distance], axis=1)
        contacts = [placement.contact for placement in placements if placement.contact is not None]
        self.contacts = np.array(contacts).reshape(-1, 3)

    def residuals(self, rotation: Array, center: Array) -> tuple[Array, Array, Array]:
        """Residuals (placements, 4) [rad], [m], rotated forces and sides (placements, 2, 3)."""
        turned = self.forces @ rotation.T
        sides = across(turned)
        away = self.points - center - self.nearest @ rotation.T
        angles = np.einsum("nij,nj->ni", self.beside, turned)
        return np.hstack([angles, np.einsum("nij,nj->ni", sides, away)]), turned, sides

    def weighted(self, rotation: Array, center: Array) -> tuple[Array, Array]:
        """Residuals (rows,) in standard deviations and their derivatives (rows, 6) by rotation
        vector and center.
        """
        result, turned, sides = self.residuals(rotation, center)
        arms = self.nearest @ rotation.T
        along = np.einsum("nj,nj->n", self.points - center - arms, turned)
        rates = np.zeros((len(result), 4, 6))
        rates[:, :2, :3] = np.cross(turned[:, None], self.beside)
        rates[:, 2:, :3] = np.cross(sides, (arms + along[:, None] * turned)[:, None])
        rates[:, 2:, 3:] = -sides
        values = (result / self.noise).reshape(-1)
        slopes: Array = (rates / self.noise[:, :, None]).reshape(-1, 6)
        if not len(self.contacts):
            return values, slopes
        normal = rotation[:, 2]
        away = self.contacts - center
        heights = np.hstack([np.cross(normal, away), np.tile(-normal, (len(away), 1))])
        return (
            np.concatenate([values, away @ normal / POINT_NOISE]),
            np.concatenate([slopes, heights / POINT_NOISE]),
        )


def residuals(placements: Sequence[Placement], rotation: Array, center: Array) -> Array:
    """Residuals (placements, 4): the angle's two parts [rad], then the distance's two [m]."""
    return _Lines(placements).residuals(rotation, center)[0]


def sizes(found: Array) -> tuple[Array, Array]:
    """Distances [m] and angles [rad], (placements,) each, of residuals (placements, 4)."""
    return np.linalg.norm(found[:, 2:], axis=1), np.arcsin(
        np.minimum(np.linalg.norm(found[:, :2], axis=1), 1.0)
    )


def solve_pose(placements: Sequence[Placement], rotation: Array, center: Array) -> PlatePose:
    """Gauss-Newton from a start; what the placements do not show stays where the start has it."""
    return _solved(_Lines(placements), rotation, center, ITERATIONS)


def _solved(lines: _Lines, rotation: Array, center: Array, iterations: int) -> PlatePose:
    scale = np.repeat([1.0 / ARM, 1.0], 3)
    for _ in range(iterations):
        values, slopes = lines.weighted(rotation, center)
        slopes = slopes * scale
        levels, directions = np.linalg.eigh(slopes.T @ slopes)
        shown = levels > SHOWN**-2
        kept = directions[:, shown]
        step = -scale * (kept @ ((kept.T @ (slopes.T @ values)) / levels[shown]))
        angle = float(np.linalg.norm(step[:3]))
        if angle > 0:
            rotation = axis_rotation(step[:3] / angle, angle) @ rotation
        center = center + step[3:]
        if np.linalg.norm(step) < SETTLED:
            break
    values, _ = lines.weighted(rotation, center)
    cost = float(values @ values)
    free = max(len(values) - int(shown.sum()), 1)
    covariance = (kept * (cost / free / levels[shown])) @ kept.T
    return PlatePose(
        rotation=rotation,
        center=center,
        covariance=scale[:, None] * covariance * scale,
        unknown=directions[:, ~shown],
        cost=cost,
    )


def best_pose(placements: Sequence[Placement], start: tuple[Array, Array] | None) -> PlatePose:
    """The best of solutions from a nominal pose and from starts all around the force."""
    lines = _Lines(placements)
    force = lines.forces.mean(axis=0)
    up = lines.directions.mean(axis=0)
    up = up / np.linalg.norm(up)
    level = least_rotation(force / np.linalg.norm(force), up)
    starts = [] if start is None else [start]
    for index in range(TURNS):
        rotation = axis_rotation(up, 2.0 * np.pi * index / TURNS) @ level
        middle = lines.points.mean(axis=0) - rotation @ lines.nearest.mean(axis=0)
        starts.append((rotation, middle if start is None else start[1]))
    result = [_solved(lines, *start, ROUGHLY) for start in starts]
    best = min(result, key=lambda pose: pose.cost)
    return _solved(lines, best.rotation, best.center, ITERATIONS)


MIN_COUNT = 3
# Share of the cost that remains when the sign of the wrench is turned, below which it was wrong
MIRRORED = 0.1


def believed(placements: Sequence[Placement]) -> tuple[list[Placement], list[str]]:
    """Placements of weights that rested and weigh what they should, and what was left out."""
    kept = []
    notes = []
    for placement in placements:
        if not placement.pushed and placement.moved > MOST_MOVED:
            notes.append(
                f"placement '{placement.name}' was left out: the weight was not at rest (moved "
                f"{1e3 * placement.moved:.1f} mm)"
            )
        elif not placement.pushed and placement.unsteady > MOST_UNSTEADY:
            notes.append(
                f"placement '{placement.name}' was left out: its force varied by "
                f"{100 * placement.unsteady:.1f} %, so the weight was not at rest or was touched"
            )
        else:
            kept.append(placement)
    for name in dict.fromkeys(item.weight for item in kept if not item.pushed):
        same = [item for item in kept if item.weight == name and not item.pushed]
        usual = float(np.median([placement.size for placement in same]))
        odd = [
            item for item in same if len(same) > 2 and abs(item.size - usual) > MOST_WRONG * usual
        ]
        for placement in odd:
            notes.append(
                f"placement '{placement.name}' was left out: it weighs"
                f" {_kilograms(placement.size)}, the other placements of '{name}'"
                f" {_kilograms(usual)}: touched, or not wholly on the plate"
            )
        kept = [item for item in kept if item not in odd]
        expected = same[0].expected
        if np.isfinite(expected) and abs(usual - expected) > MOST_WRONG * expected:
            notes.append(
                f"'{name}' was given as {_kilograms(expected)}, but the plate measures"
                f" {_kilograms(usual)} ({100 * (usual / expected - 1):+.1f} %): wrong mass, or"
                " wrong sensitivity of the plate"
            )
    if len(kept) < MIN_COUNT:
        left = "; ".join(notes)
        raise BadData(
            f"{len(kept)} placements can be used, expected at least {MIN_COUNT}, spread over the"
            " plate" + (f" ({left})" if left else "")
        )
    points = np.array([item.point for item in kept])
    spread = float(np.max(np.linalg.norm(points - points.mean(axis=0), axis=1)))
    if spread < SPREAD and not any(item.pushed for item in kept):
        raise BadData(
            f"all {len(kept)} placements lie within {1e3 * spread:.0f} mm of their middle: the"
            " plate's turn about the vertical is not shown; place the weight near every corner"
        )
    return kept, notes


def _kilograms(force: float) -> str:
    return f"{force / STANDARD_GRAVITY:.2f} kg"


def unknown_notes(pose: PlatePose, kept: Sequence[Placement], known: bool) -> list[str]:
    """What the placements do not show, and what becomes of it."""
    up = np.mean([item.direction for item in kept], axis=0)
    stays = "it stays where the file has it" if known else "it is arbitrary"
    notes = []
    for direction in pose.unknown.T:
        turn = direction[:3]
        shift = direction[3:]
        moves = np.linalg.norm(shift) > np.linalg.norm(turn)
        axis = (shift if moves else turn) / np.linalg.norm(shift if moves else turn)
        components = ", ".join(f"{x:.2f}" for x in axis)
        what = f"the place along ({components})" if moves else f"the turn about ({components})"
        if abs(axis @ up) > 0.95 * np.linalg.norm(up):
            what = "the height" if moves else "the turn about the vertical"
        hint = (
            "forces that are all vertical never show it; push with a marked rod, or give its tip"
            if moves
            else ""
        )
        notes.append(
            f"{what} of the plate is not shown by these placements: {stays}"
            + (f" ({hint})" if hint else "")
        )
    return notes


def line_notes(kept: Sequence[Placement]) -> list[str]:
    """A line if weights stand on a straight line."""
    if any(item.pushed for item in kept):
        return []
    points = np.array([item.point for item in kept])
    level = points - np.outer(points @ kept[0].direction, kept[0].direction)
    width = float(np.linalg.svd(level - level.mean(axis=0), compute_uv=False)[1]) / np.sqrt(
        len(kept)
    )
    if width > 0.2 * SPREAD:
        return []
    return [
        f"the placements lie on a line ({1e3 * width:.0f} mm across it): a wrong sign of one of the"
        " plate's axes, or a place that is off along the line, would not show; place the weight on"
        " both sides"
    ]


def outlier_notes(kept: Sequence[Placement], distances: Array, left_out: Array) -> list[str]:
    """The placement that the others contradict, if one does."""
    if len(kept) < 4:
        return []
    worst = int(np.argmax(left_out))
    usual = float(np.median(np.delete(distances, worst)))
    if left_out[worst] < max(6.0 * usual, 0.005):
        return []
    return [
        f"placement '{kept[worst].name}' lies {1e3 * left_out[worst]:.1f} mm off what the others"
        f" say (they agree within {1e3 * usual:.1f} mm): was a marker moved or mislabelled?"
    ]


def sign_notes(kept: Sequence[Placement], pose: PlatePose) -> list[str]:
    """A line if the placements say that the wrench has the other sign."""
    if float(np.max(sizes(residuals(kept, pose.rotation, pose.center))[0])) < 0.005:
        return []
    turned = [replace(item, force=-item.force, moment=-item.moment) for item in kept]
    if best_pose(turned, None).cost > MIRRORED * pose.cost:
        return []
    return [
        "the placements agree much better with force and moment reversed: the plate's recording"
        " holds the force on the plate, or an axis has the wrong sign"
    ]


@read_only
class PlateCalibration(PlatePose):
    """A plate's pose in the laboratory and how well the placements agree on it."""

    names: tuple[str, ...]  # of the placements used
    distances: Array  # (placements,) from the marked point to the measured line [m]
    angles: Array  # (placements,) between marked and measured direction [rad]
    # left_out_distances, left_out_angles: the same, each placement against the pose that the others
    # give
    left_out_distances: Array
    left_out_angles: Array
    left_out_shifts: Array  # (placements,) how far the center moves when one is left out [m]
    scale: float  # mean share of measured in expected forces, NaN where no mass is known
    notes: tuple[str, ...] = ()  # what is not shown, was left out or looks wrong, one line each

    @property
    def distance_rms(self) -> float:
        """Root mean square of the distances [m]."""
        return float(np.sqrt(np.mean(self.distances**2)))

    @property
    def angle_rms(self) -> float:
        """Root mean square of the angles [rad]."""
        return float(np.sqrt(np.mean(self.angles**2)))


def calibrate_plate(
    placements: Sequence[Placement], nominal: PlateRecording | None = None
) -> PlateCalibration:
    """Pose of a plate from placements of marked weights and pushes of marked rods."""
    kept, notes = believed(placements)
    start = None if nominal is None else (plate_axes(nominal.corners), nominal.corners.mean(axis=0))
    pose = best_pose(kept, start)
    left_out = [
        solve_pose([*kept[:index], *kept[index + 1 :]], pose.rotation, pose.center)
        for index in range(len(kept))
    ]
    apart = np.concatenate(
        [
            residuals([item], other.rotation, other.center)
            for item, other in zip(kept, left_out, strict=True)
        ]
    )
    distances, angles = sizes(residuals(kept, pose.rotation, pose.center))
    out_distances, out_angles = sizes(apart)
    if not all(item.tared for item in kept):
        notes.append(
            "a recording never shows the plate unloaded: what the plate reads then could not be"
            " subtracted"
        )
    notes += unknown_notes(pose, kept, nominal is not None) + line_notes(kept)
    notes += outlier_notes(kept, distances, out_distances) + sign_notes(kept, pose)
    shares = [item.size / item.expected for item in kept if np.isfinite(item.expected)]
    return PlateCalibration(
        rotation=pose.rotation,
        center=pose.center,
        covariance=pose.covariance,
        unknown=pose.unknown,
        cost=pose.cost,
        names=tuple(item.name for item in kept),
        distances=distances,
        angles=angles,
        left_out_distances=out_distances,
        left_out_angles=out_angles,
        left_out_shifts=np.array(
            [np.linalg.norm(other.center - pose.center) for other in left_out]
        ),
        scale=float(np.mean(shares)) if shares else float("nan"),
        notes=tuple(notes),
    )


def place_plate(recording: PlateRecording, calibration: PlateCalibration) -> PlateRecording:
    """The recording with its plate where the calibration says, of the size it had."""
    half = 0.5 * np.array(
        [np.linalg.norm(recording.corners[0] - recording.corners[index]) for index in (1, 3)]
    )
    local = np.array([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]]) * np.array([*half, 0.0])
    return replace(recording, corners=local @ calibration.rotation.T + calibration.center)
