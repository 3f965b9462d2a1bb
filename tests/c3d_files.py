"""C3D files made of markers and one force plate of type 2, written with ezc3d."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from myomorph.model.series import Markers, PlateRecording


def write_c3d(path: Path, markers: Markers, plate: PlateRecording | None = None) -> None:
    """Markers [mm], and a plate's force [N] and moment [N mm] about its origin, a whole number of samples a frame."""
    import ezc3d

    rate = round(1.0 / float(np.median(np.diff(markers.time))), 3)
    file = ezc3d.c3d()
    points = np.ones((4, len(markers.names), len(markers)))
    points[:3] = 1000.0 * markers.values.transpose(2, 1, 0)
    file["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    file["parameters"]["POINT"]["RATE"]["value"] = [rate]
    file["parameters"]["POINT"]["LABELS"]["value"] = list(markers.names)
    file["data"]["points"] = points
    if plate is not None:
        labels = ["Fx", "Fy", "Fz", "Mx", "My", "Mz"]
        every = len(plate.channels) // len(markers)
        file["parameters"]["ANALOG"]["RATE"]["value"] = [every * rate]
        file["parameters"]["ANALOG"]["LABELS"]["value"] = labels
        file["parameters"]["ANALOG"]["UNITS"]["value"] = ["N"] * 3 + ["Nmm"] * 3
        file["data"]["analogs"] = (plate.channels[: every * len(markers)] * ([1.0] * 3 + [1000.0] * 3)).T[None]
        file.add_parameter("FORCE_PLATFORM", "USED", [1])
        file.add_parameter("FORCE_PLATFORM", "TYPE", [2])
        file.add_parameter("FORCE_PLATFORM", "ZERO", [1, 0])
        file.add_parameter("FORCE_PLATFORM", "CORNERS", 1000.0 * plate.corners.T[:, :, None])
        file.add_parameter("FORCE_PLATFORM", "ORIGIN", 1000.0 * plate.origin[:, None])
        file.add_parameter("FORCE_PLATFORM", "CHANNEL", np.arange(1.0, 7.0)[:, None])
    file.write(str(path))
