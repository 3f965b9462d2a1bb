"""Where a force plate lies among the markers: its pose by least squares over placements of a marked weight.

Each placement gives a line in the plate's axes, the line of action of the measured force, and in the laboratory a
point that it passes through and its direction ([S] III: "the weight with optical markers"). With R, p the plate's axes
and the center of its top surface, f the unit force, r its line's point nearest to the center, c the point and u
the direction in the laboratory, the residuals across the line are

    angle:     the part of R f across u,    distance:     the part of c - p - R r across R f.

A weight at rest shows the tilt (u is vertical) and, by its places, the turn about the vertical and the place in the
plane; never the height. Pushes of a rod in oblique directions show the height too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import fdtrc as chance_above

from myomorph.contact.plate_corners import plate_axes
from myomorph.contact.plate_placements import Placement
from myomorph.contact.plate_pose import (
    believed,
    best_pose,
    line_notes,
    outlier_notes,
    residuals,
    rotation_vector,
    sign_notes,
    sizes,
    solve_pose,
    unknown_notes,
)
from myomorph.model.arrays import Array, frozen_array, read_only
from myomorph.model.series import PlateRecording


@read_only
class PlateCalibration:
    """A plate's pose in the laboratory and how well the placements agree on it."""

    rotation: Array  # (3, 3) the plate's axes as columns
    center: Array  # (3,) of the top surface [m]
    # (6, 6) of a rotation vector about the laboratory's axes [rad] and the center [m], from the residuals; zero in
    # directions that are not shown
    covariance: Array
    unknown: Array  # (6, k) unit directions of rotation (times 0.2 m) and center that no placement shows
    names: tuple[str, ...]  # of the placements used
    distances: Array  # (placements,) from the marked point to the measured line [m]
    angles: Array  # (placements,) between marked and measured direction [rad]
    # left_out_distances, left_out_angles: the same, each placement against the pose that the others give
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

    @property
    def center_sd(self) -> Array:
        """(3,) standard deviation of the center; inf along directions that are not shown [m]."""
        return _deviations(self.covariance, self.unknown)[3:]

    @property
    def rotation_sd(self) -> Array:
        """(3,) standard deviation of the rotation about the laboratory's axes; inf where not shown [rad]."""
        return _deviations(self.covariance, self.unknown)[:3]


@read_only
class PlateCheck:
    """An existing calibration against placements."""

    distances: Array  # (placements,) residuals with the pose as it is [m]
    angles: Array  # (placements,) residuals with the pose as it is [rad]
    shift: Array  # (3,) that the center should move by [m]
    turn: Array  # (3,) rotation vector that the axes should turn by [rad]
    shift_sd: Array  # (3,) standard deviations [m]
    turn_sd: Array  # (3,) standard deviations [rad]
    chance: float  # probability of so large a correction if the calibration were right
    calibration: PlateCalibration  # the pose that the placements give

    @property
    def significant(self) -> bool:
        """Whether the calibration is off by more than its placements' scatter explains (1 % level)."""
        return self.chance < 0.01

    @property
    def summary(self) -> str:
        """The check in a sentence."""
        off = f"{1e3 * np.linalg.norm(self.shift):.1f} mm and {np.degrees(np.linalg.norm(self.turn)):.2f}°"
        sd = f"{1e3 * np.linalg.norm(self.shift_sd):.1f} mm and {np.degrees(np.linalg.norm(self.turn_sd)):.2f}°"
        word = "significant" if self.significant else "not significant"
        lost = self.calibration.unknown.shape[1]
        return f"the plate's calibration is off by {off} (standard deviations {sd}): {word} (p = {self.chance:.2g})" + (
            f"; {lost} of 6 directions are not shown" if lost else ""
        )


def calibrate_plate(placements: Sequence[Placement], nominal: PlateRecording | None = None) -> PlateCalibration:
    """Pose of a plate from placements of marked weights and pushes of marked rods."""
    kept, notes = believed(placements)
    start = None if nominal is None else (plate_axes(nominal.corners), nominal.corners.mean(axis=0))
    pose = best_pose(kept, start)
    left_out = [
        solve_pose([*kept[:index], *kept[index + 1 :]], pose.rotation, pose.center) for index in range(len(kept))
    ]
    apart = np.concatenate(
        [residuals([item], other.rotation, other.center) for item, other in zip(kept, left_out, strict=True)]
    )
    distances, angles = sizes(residuals(kept, pose.rotation, pose.center))
    out_distances, out_angles = sizes(apart)
    if not all(item.tared for item in kept):
        notes.append("a recording never shows the plate unloaded: what the plate reads then could not be subtracted")
    notes += unknown_notes(pose, kept, nominal is not None) + line_notes(kept)
    notes += outlier_notes(kept, distances, out_distances) + sign_notes(kept, pose)
    shares = [item.size / item.expected for item in kept if np.isfinite(item.expected)]
    return PlateCalibration(
        rotation=frozen_array(pose.rotation),
        center=frozen_array(pose.center),
        covariance=frozen_array(pose.covariance),
        unknown=frozen_array(pose.unknown),
        names=tuple(item.name for item in kept),
        distances=frozen_array(distances),
        angles=frozen_array(angles),
        left_out_distances=frozen_array(out_distances),
        left_out_angles=frozen_array(out_angles),
        left_out_shifts=frozen_array([np.linalg.norm(other.center - pose.center) for other in left_out]),
        scale=float(np.mean(shares)) if shares else float("nan"),
        notes=tuple(notes),
    )


def check_plate(recording: PlateRecording, placements: Sequence[Placement]) -> PlateCheck:
    """How far the calibration in a file is off, and whether the placements are good enough to say so."""
    calibration = calibrate_plate(placements, recording)
    axes, center = plate_axes(recording.corners), recording.corners.mean(axis=0)
    used, _ = believed(placements)
    distances, angles = sizes(residuals(used, axes, center))
    turn = rotation_vector(calibration.rotation @ axes.T)
    shift = calibration.center - center
    correction = np.concatenate([turn, shift])
    values, vectors = np.linalg.eigh(calibration.covariance)
    shown = values > 1e-12 * max(values.max(), 1e-300)
    free = 4 * len(used) - int(shown.sum())
    share = float(np.sum((vectors[:, shown].T @ correction) ** 2 / values[shown])) / max(int(shown.sum()), 1)
    chance = float(chance_above(int(shown.sum()), max(free, 1), share)) if shown.any() else 1.0
    deviations = np.sqrt(np.diag(calibration.covariance))
    return PlateCheck(distances, angles, shift, turn, deviations[3:], deviations[:3], chance, calibration)


def place_plate(recording: PlateRecording, calibration: PlateCalibration) -> PlateRecording:
    """The recording with its plate where the calibration says, of the size it had."""
    half = 0.5 * np.array([np.linalg.norm(recording.corners[0] - recording.corners[index]) for index in (1, 3)])
    local = np.array([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]]) * np.array([*half, 0.0])
    return replace(recording, corners=local @ calibration.rotation.T + calibration.center)


def _deviations(covariance: Array, unknown: Array) -> Array:
    """Standard deviations (6,) of rotation and center, inf along what is not shown."""
    lost = np.linalg.norm(unknown, axis=1) > 0.1
    return np.where(lost, np.inf, np.sqrt(np.maximum(np.diag(covariance), 0.0)))
