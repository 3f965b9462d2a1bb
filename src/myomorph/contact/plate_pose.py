"""The pose of a plate that brings measured lines of action onto marked points and directions, by Gauss-Newton."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from myomorph.contact.plate_placements import Placement
from myomorph.model.errors import BadData
from myomorph.model.spatial import Array, axis_rotation

ARM = 0.2
"""Length by which a rotation counts as a displacement when it is asked what the placements show [m]."""

ITERATIONS = 50
TURNS = 12
"""Starts about the vertical."""


@dataclass(frozen=True)
class PlateFitOptions:
    """What placements are believed, and how much.

    Attributes
    ----------
    force_noise, moment_noise : standard deviation of a placement's mean wrench [N], [N m]
    point_noise : of the marked point [m]
    direction_noise : of the marked direction [rad]
    shown : a direction of the pose whose standard deviation is larger counts as not shown [m]
    most_moved : a weight that moved further while it should have rested is left out [m]
    most_unsteady : so is one whose force varied by more than this share
    most_wrong : share by which a force may differ from the weight
    spread : weights must stand at least so far apart [m]
    """

    force_noise: float = 0.5
    moment_noise: float = 0.1
    point_noise: float = 0.001
    direction_noise: float = 0.002
    shown: float = 0.02
    most_moved: float = 0.002
    most_unsteady: float = 0.01
    most_wrong: float = 0.02
    spread: float = 0.05

    def __post_init__(self) -> None:
        for name in ("force_noise", "moment_noise", "point_noise", "direction_noise", "shown"):
            if not getattr(self, name) > 0:
                raise BadData(f"{name} is {getattr(self, name):g}: expected above 0")


@dataclass(frozen=True, eq=False)
class PlatePose:
    """A pose and what is known of it.

    Attributes
    ----------
    rotation, center : (3, 3) the plate's axes as columns, (3,) of its top surface [m]
    covariance : (6, 6) of rotation vector [rad] and center [m] about the laboratory's axes, zero where not shown
    unknown : (6, k) unit directions of (0.2 m times the rotation vector, center) that no placement shows
    cost : sum of squared residuals in standard deviations
    """

    rotation: Array
    center: Array
    covariance: Array
    unknown: Array
    cost: float


def across(direction: Array) -> Array:
    """Two unit vectors (2, 3) across a direction (3,)."""
    least = np.eye(3)[int(np.argmin(np.abs(direction)))]
    first = np.cross(direction, least)
    first = first / np.linalg.norm(first)
    return np.stack([first, np.cross(direction, first)])


def residuals(placements: Sequence[Placement], rotation: Array, center: Array) -> Array:
    """Residuals (placements, 4): the angle's two parts [rad], then the distance's two [m]."""
    found = np.empty((len(placements), 4))
    for row, one in zip(found, placements, strict=True):
        nearest, force = one.line
        turned = rotation @ force
        row[:2] = across(one.direction) @ turned
        row[2:] = across(turned) @ (one.point - center - rotation @ nearest)
    return found


def sizes(found: Array) -> tuple[Array, Array]:
    """Distances [m] and angles [rad], (placements,) each, of residuals (placements, 4)."""
    return np.linalg.norm(found[:, 2:], axis=1), np.arcsin(np.minimum(np.linalg.norm(found[:, :2], axis=1), 1.0))


def solve_pose(placements: Sequence[Placement], rotation: Array, center: Array, options: PlateFitOptions) -> PlatePose:
    """Gauss-Newton from a start; what the placements do not show stays where the start has it."""
    scale = np.repeat([1.0 / ARM, 1.0], 3)
    for _ in range(ITERATIONS):
        values, slopes = _weighted(placements, rotation, center, options)
        slopes = slopes * scale
        levels, directions = np.linalg.eigh(slopes.T @ slopes)
        shown = levels > options.shown**-2
        kept = directions[:, shown]
        step = -scale * (kept @ ((kept.T @ (slopes.T @ values)) / levels[shown]))
        angle = float(np.linalg.norm(step[:3]))
        if angle > 0:
            rotation = axis_rotation(step[:3] / angle, angle) @ rotation
        center = center + step[3:]
        if np.linalg.norm(step) < 1e-10:
            break
    values, _ = _weighted(placements, rotation, center, options)
    cost = float(values @ values)
    free = max(len(values) - int(shown.sum()), 1)
    covariance = (kept * (cost / free / levels[shown])) @ kept.T
    return PlatePose(rotation, center, scale[:, None] * covariance * scale, directions[:, ~shown], cost)


def _weighted(
    placements: Sequence[Placement], rotation: Array, center: Array, options: PlateFitOptions
) -> tuple[Array, Array]:
    """Residuals (rows,) in standard deviations and their derivatives (rows, 6) by rotation vector and center."""
    values, slopes = [], []
    found = residuals(placements, rotation, center)
    for one, residual in zip(placements, found, strict=True):
        nearest, force = one.line
        turned, arm = rotation @ force, rotation @ nearest
        apart = one.point - center - arm
        bent = np.zeros((4, 6))
        bent[:2, :3] = -across(one.direction) @ _cross(turned)
        lever = _cross(arm) + (apart @ turned) * _cross(turned)
        bent[2:] = across(turned) @ np.hstack([lever, -np.eye(3)])
        angle = np.hypot(options.direction_noise, options.force_noise / one.size)
        distance = np.hypot(options.point_noise, options.moment_noise / one.size)
        noise = np.array([angle, angle, distance, distance])
        values.append(residual / noise)
        slopes.append(bent / noise[:, None])
        if one.contact is not None:
            normal = rotation[:, 2]
            away = one.contact - center
            values.append(np.array([normal @ away]) / options.point_noise)
            slopes.append(np.concatenate([np.cross(normal, away), -normal])[None] / options.point_noise)
    return np.concatenate(values), np.concatenate(slopes)


def _cross(vector: Array) -> Array:
    """Matrix (3, 3) of the cross product with a vector from the left."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def best_pose(
    placements: Sequence[Placement], start: tuple[Array, Array] | None, options: PlateFitOptions
) -> PlatePose:
    """The best of solutions from a nominal pose and from starts all around the force."""
    forces = np.array([one.line[1] for one in placements]).mean(axis=0)
    directions = np.array([one.direction for one in placements]).mean(axis=0)
    up = directions / np.linalg.norm(directions)
    level = _turning(forces / np.linalg.norm(forces), up)
    starts = [] if start is None else [start]
    points = np.array([one.point for one in placements]).mean(axis=0)
    lines = np.array([one.line[0] for one in placements]).mean(axis=0)
    for k in range(TURNS):
        rotation = axis_rotation(up, 2.0 * np.pi * k / TURNS) @ level
        starts.append((rotation, points - rotation @ lines if start is None else start[1]))
    found = [solve_pose(placements, *one, options) for one in starts]
    return min(found, key=lambda pose: pose.cost)


def _turning(source: Array, target: Array) -> Array:
    """Smallest rotation (3, 3) of one unit vector onto another."""
    axis = np.cross(source, target)
    size = float(np.linalg.norm(axis))
    if size < 1e-12:
        return np.eye(3) if source @ target > 0 else axis_rotation(across(source)[0], np.pi)
    return axis_rotation(axis / size, float(np.arctan2(size, source @ target)))


def rotation_vector(rotation: Array) -> Array:
    """Axis times angle (3,) of a rotation matrix [rad]."""
    spin = 0.5 * np.array(
        [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
    )
    sine, cosine = float(np.linalg.norm(spin)), 0.5 * (float(np.trace(rotation)) - 1.0)
    angle = float(np.arctan2(sine, cosine))
    if sine > 1e-9:
        return spin * angle / sine
    if cosine > 0:
        return spin
    values, vectors = np.linalg.eigh(rotation)
    half_turn: Array = np.pi * vectors[:, int(np.argmax(values))]
    return half_turn
