"""Plates whose corners a file counts from the wrong one: they stand turned by quarters in the laboratory.

Who mounts a plate the other way round and leaves the corners as they were gets forces of the right size whose center of
pressure runs across the walkway. The markers show it: the center of pressure lies under the body.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.series import ForcePlate, Markers

CLEARLY = 0.25
"""Another first corner is better where it brings the center of pressure to this share of its distance, or nearer, and
to twice that share of what the next best one leaves: a plate that stands as its file says is never turned for less."""

FIRM = 0.3  # Samples that carry this share of the largest force count; below, the center of pressure is noise
MIN_COUNT = 20


@dataclass(frozen=True)
class FirstCorner:
    """How far the center of pressure is from the body, for each corner of a plate counted as the first."""

    # median horizontal distance from the middle of the markers seen, corner 1 to 4 first [m]
    distances: tuple[float, float, float, float]
    best: int  # how many corners further the first one is, 0 to 3

    @property
    def clear(self) -> bool:
        """Whether another corner than the file's is clearly the first."""
        least, second = sorted(self.distances)[:2]
        return self.best != 0 and least < CLEARLY * self.distances[0] and least < 2.0 * CLEARLY * second


def counted_from(plate: ForcePlate, corner: int) -> ForcePlate:
    """The plate with its corners counted from another one (0 for the file's first), what it measured turned along."""
    axes, corners = plate_axes(plate.corners), np.roll(plate.corners, -corner, axis=0)
    turn = plate_axes(corners) @ axes.T
    center = corners.mean(axis=0)
    return replace(
        plate,
        corners=corners,
        forces=plate.forces @ turn.T,
        points=(plate.points - center) @ turn.T + center,
        torques=plate.torques @ turn.T,
    )


def plate_axes(corners: Array) -> Array:
    """Rotation (3, 3) whose columns are the x, y and z axes of a plate with these corners (4, 3) in the laboratory."""
    x = corners[0] - corners[1]
    z = np.cross(x, corners[0] - corners[3])
    axes = np.stack([values / np.linalg.norm(values) for values in (x, np.cross(z, x), z)], axis=1)
    return np.asarray(axes, np.float64)


def first_corner(plate: ForcePlate, plate_time: Array, markers: Markers) -> FirstCorner | None:
    """Which corner of a plate is probably its first; None where too little is known.
    `plate`: forces as the file's corners give them, center of pressure NaN where unloaded; `markers`: of what stands on
    it, in the same laboratory.
    """
    axes = plate_axes(plate.corners)
    normal = axes[:, 2]
    size = np.abs(plate.forces @ normal)
    middle = _middle(markers, plate_time)
    known = np.isfinite(plate.points).all(axis=1) & np.isfinite(middle).all(axis=1)
    if not known.any():
        return None
    firm = known & (size > FIRM * np.nanmax(size[known]))
    if firm.sum() < MIN_COUNT:
        return None
    center = plate.corners.mean(axis=0)
    pressed = plate.points[firm] - center
    pressed = pressed - (pressed @ normal)[:, None] * normal
    target = middle[firm] - center
    target = target - (target @ normal)[:, None] * normal
    along = pressed @ axes
    distances = []
    for corner in range(4):
        place = along @ plate_axes(np.roll(plate.corners, -corner, axis=0)).T
        distances.append(float(np.median(np.linalg.norm(place - target, axis=1))))
    return FirstCorner((distances[0], distances[1], distances[2], distances[3]), int(np.argmin(distances)))


def _middle(markers: Markers, time: Array) -> Array:
    """Mean of the markers seen (samples, 3) at other times, NaN where none was seen near."""
    seen = np.asarray(np.isfinite(markers.values).all(axis=2))
    count = seen.sum(axis=1)
    total = np.where(seen[:, :, None], markers.values, 0.0).sum(axis=1)
    known = count > 0
    result = np.full((len(time), 3), np.nan)
    if known.sum() < 2:
        return result
    mean = total[known] / count[known, None]
    clock = markers.time[known]
    at = np.clip(np.searchsorted(clock, time), 1, len(clock) - 1)
    near = np.minimum(np.abs(clock[at] - time), np.abs(clock[at - 1] - time)) < 1.5 / markers.rate
    for axis in range(3):
        result[:, axis] = np.where(near, np.interp(time, clock, mean[:, axis]), np.nan)
    return result
