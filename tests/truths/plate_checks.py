"""What placements show of a force plate's calibration.

Deviations of a pose, and how far a file's pose is off.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import fdtrc as chance_above

from myomorph.core.contact.plate_placements import Placement
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.series import PlateRecording
from myomorph.core.model.spatial import vector_from_rotation
from myomorph.swings.plate_calibration import (
    PlateCalibration,
    calibrate_plate,
    nominal_pose,
    usable_placements,
)
from myomorph.swings.plate_pose import LineResiduals, Misfits


def pose_deviations(calibration: PlateCalibration) -> Array:
    """Return standard deviations of a plate's pose.

    Parameters
    ----------
    calibration : with its covariance and the directions that are not identifiable

    Returns
    -------
    (6,) of the rotation about the laboratory's axes [rad] and of the center [m], inf along what is
    not
    identifiable
    """
    lost = np.linalg.norm(calibration.unknown, axis=1) > 0.1
    return np.where(lost, np.inf, np.sqrt(np.maximum(np.diag(calibration.covariance), 0.0)))


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
        """Whether the calibration is off by more than the placements' scatter (1 % level)."""
        return self.chance < 0.01


def check_plate(recording: PlateRecording, placements: Sequence[Placement]) -> PlateCheck:
    """Compute how far the calibration in a file is off.

    Also whether the placements are good enough to determine that.
    """
    calibration = calibrate_plate(placements, recording)
    nominal = nominal_pose(recording)
    used = usable_placements(placements).placements
    misfits = Misfits.of(LineResiduals.of(used).unweighted(nominal))
    turn = vector_from_rotation(calibration.rotation @ nominal.rotation.T)
    shift = calibration.center - nominal.center
    correction = np.concatenate([turn, shift])
    values, vectors = np.linalg.eigh(calibration.covariance)
    shown = values > 1e-12 * max(values.max(), 1e-300)
    free = 4 * len(used) - int(shown.sum())
    share = float(np.sum((vectors[:, shown].T @ correction) ** 2 / values[shown])) / max(
        int(shown.sum()), 1
    )
    chance = float(chance_above(int(shown.sum()), max(free, 1), share)) if shown.any() else 1.0
    deviations = np.sqrt(np.diag(calibration.covariance))
    return PlateCheck(
        distances=misfits.distances,
        angles=misfits.angles,
        shift=shift,
        turn=turn,
        shift_sd=deviations[3:],
        turn_sd=deviations[:3],
        chance=chance,
        calibration=calibration,
    )
