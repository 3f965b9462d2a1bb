"""Files of inertial sensors as their makers write them."""

from __future__ import annotations

from pathlib import Path

from myomorph.core.model.inertial_sensors import InertialSensors


def write_orientations(path: Path, sensors: InertialSensors) -> None:
    """Write a table of quaternions for OpenSim's readers."""
    lines = [
        "DataRate=100.000000",
        "DataType=Quaternion",
        "version=3",
        "OpenSimVersion=4.5",
        "endheader",
    ]
    lines.append("\t".join(("time", *sensors.names)))
    for time, row in zip(sensors.time, sensors.orientations, strict=True):
        lines.append(
            "\t".join(
                [f"{time:.6f}", *(",".join(f"{number:.15g}" for number in one) for one in row)]
            )
        )
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
