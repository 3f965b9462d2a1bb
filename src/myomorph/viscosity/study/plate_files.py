"""The place of a force plate among the markers, from C3D recordings of a marked weight that stands on it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from myomorph.contact.plate_calibration import PlateCalibration, calibrate_plate, place_plate
from myomorph.contact.plate_placements import MarkedWeight, Placement, find_placements
from myomorph.model.errors import BadData, BadFile, UnknownName
from myomorph.model.series import PlateRecording, Trial
from myomorph.study.trial.inputs import about, open_trial
from myomorph.viscosity.report.given import Residual


@dataclass(frozen=True)
class PlateFiles:
    """What a study file says of the plate.

    Attributes
    ----------
    placements : C3D recordings of the weight on the plate, one or more placements in each
    weight : what stood on it
    plate : its name in the C3D files, "" where they hold one plate only
    """

    placements: tuple[Path, ...]
    weight: MarkedWeight
    plate: str = ""


def calibrate(files: PlateFiles) -> PlateCalibration:
    """The plate's pose in the laboratory of the C3D files.

    Raises
    ------
    BadFile, BadData, UnknownName
        where a file holds no such plate or weight, or too few placements
    """
    placements: list[Placement] = []
    nominal: PlateRecording | None = None
    for path in files.placements:
        trial = open_trial(path)
        with about(path):
            if trial.markers is None:
                raise BadData("holds no markers of the weight")
            nominal = chosen(trial, files.plate)
            placements += find_placements(nominal, trial.plate_time, trial.markers, files.weight)
    return calibrate_plate(placements, nominal)


def chosen(trial: Trial, name: str) -> PlateRecording:
    """The plate of that name, or the only one."""
    plates = {one.name: one for one in trial.plate_recordings}
    if not plates:
        raise BadFile(trial.source, "holds no force plates", "plates are calibrated from C3D files")
    if name and name not in plates:
        raise UnknownName("force plate", name, tuple(plates), trial.source)
    if not name and len(plates) > 1:
        raise BadData(f"{trial.source}: holds {len(plates)} plates ({', '.join(plates)}): name one as 'plate.name'")
    return plates[name] if name else next(iter(plates.values()))


def placed(trial: Trial, files: PlateFiles, calibration: PlateCalibration) -> Trial:
    """The recording with that plate alone, where the calibration says."""
    return replace(trial, plate_recordings=(place_plate(chosen(trial, files.plate), calibration),))


def plate_residuals(found: PlateCalibration) -> tuple[Residual, ...]:
    """The calibration as lines of the report."""
    far, turned = (float(np.sqrt(np.mean(one**2))) for one in (found.left_out_distances, found.left_out_angles))
    count = f"{len(found.names)} placements"
    return (
        Residual(
            "plate: force past the marked point",
            1e3 * found.distance_rms,
            "mm",
            f"{count}; {1e3 * far:.2f} mm left out",
        ),
        Residual(
            "plate: direction of the force",
            float(np.degrees(found.angle_rms)),
            "°",
            f"{count}; {np.degrees(turned):.2f}° left out",
        ),
        Residual(
            "plate: shift of its center",
            1e3 * float(np.max(found.left_out_shifts, initial=0.0)),
            "mm",
            "the largest when one placement is left out",
        ),
    )
