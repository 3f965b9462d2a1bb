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

from myomorph.contact import plate_pose
from myomorph.contact.plate_corners import plate_axes
from myomorph.contact.plate_placements import Placement
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


def calibrate_plate(placements: Sequence[Placement], nominal: PlateRecording | None = None) -> PlateCalibration:
    """Pose of a plate from placements of marked weights and pushes of marked rods."""
    kept, notes = plate_pose.believed(placements)
    start = None if nominal is None else (plate_axes(nominal.corners), nominal.corners.mean(axis=0))
    pose = plate_pose.best_pose(kept, start)
    left_out = [
        plate_pose.solve_pose([*kept[:index], *kept[index + 1 :]], pose.rotation, pose.center)
        for index in range(len(kept))
    ]
    apart = np.concatenate(
        [plate_pose.residuals([item], other.rotation, other.center) for item, other in zip(kept, left_out, strict=True)]
    )
    distances, angles = plate_pose.sizes(plate_pose.residuals(kept, pose.rotation, pose.center))
    out_distances, out_angles = plate_pose.sizes(apart)
    if not all(item.tared for item in kept):
        notes.append("a recording never shows the plate unloaded: what the plate reads then could not be subtracted")
    notes += plate_pose.unknown_notes(pose, kept, nominal is not None) + plate_pose.line_notes(kept)
    notes += plate_pose.outlier_notes(kept, distances, out_distances) + plate_pose.sign_notes(kept, pose)
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


def place_plate(recording: PlateRecording, calibration: PlateCalibration) -> PlateRecording:
    """The recording with its plate where the calibration says, of the size it had."""
    half = 0.5 * np.array([np.linalg.norm(recording.corners[0] - recording.corners[index]) for index in (1, 3)])
    local = np.array([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]]) * np.array([*half, 0.0])
    return replace(recording, corners=local @ calibration.rotation.T + calibration.center)
