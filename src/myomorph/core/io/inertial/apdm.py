"""APDM's HDF5 files: orientations and raw signals of Opal sensors, in two layouts."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from myomorph.core.io.inertial.signals import sensors_of_signals
from myomorph.core.io.parsing.hdf5 import ERRORS, open_hdf5
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadFile
from myomorph.core.model.inertial_sensors import InertialSensors, beside

HINT = (
    "expected an HDF5 file of APDM's Motion Studio or Mobility Lab: groups Sensors and Processed,"
    " or one per monitor"
)
SIGNALS = {
    "accelerations": ("Accelerometer", "Accelerometers"),
    "angular_velocities": ("Gyroscope", "Gyroscopes"),
    "magnetic_fields": ("Magnetometer", "Magnetometers"),
    "orientations": ("Orientation",),
}
"""Data sets by the names of either layout; in m/s^2, rad/s, microtesla, and quaternions w, x, y, z.
"""
MAX_BYTES = 1 << 31  # Of a signal.


def read_apdm(path: Path) -> InertialSensors:
    """Read the sensors of an APDM file, named by their labels.

    Source: APDM, Opal how-to: HDF5 file structure.

    Parameters
    ----------
    path : of the file

    Returns
    -------
    orientations (frames, sensors, 4) as w, x, y, z, angular velocities [rad/s], accelerations
    [m/s^2] and magnetic fields [microtesla] (frames, sensors, 3) over times [s] from the first
    sensor's first

    Raises
    ------
    BadFile : it cannot be read, has no sensor, or one without signals, times or the usual shapes
    """
    sensors = _sensors(path)
    if not sensors:
        raise BadFile(path, "holds no sensor", HINT)
    return beside(sensors)


def _sensors(path: Path) -> list[InertialSensors]:
    """Read each sensor by itself; `BadFile` where the file is no HDF5 or damaged."""
    try:
        with open_hdf5(path, HINT) as file:
            if "Sensors" in file:
                return _sensors_of_newer_layout(file, path)
            return _sensors_of_older_layout(file, path)
    except ERRORS as error:
        raise BadFile(path, f"is no HDF5 file of sensors ({error})", HINT) from None


def _sensors_of_newer_layout(file: Any, path: Path) -> list[InertialSensors]:
    """Read the sensors of the layout with groups Sensors and Processed."""
    sensors = []
    start = _start(file["Sensors"])
    for key, group in file["Sensors"].items():
        settings = group["Configuration"].attrs if "Configuration" in group else group.attrs
        name = _text(settings.get("Label 0", key)) or key
        processed = file.get(f"Processed/{key}", {})
        datasets = {**dict(group.items()), **dict(processed.items())}
        sensors.append(_sensor(name, datasets, start, 0.0, path))
    return sensors


def _sensors_of_older_layout(file: Any, path: Path) -> list[InertialSensors]:
    """Read the sensors of the layout with one group per monitor."""
    cases = map(_text, file.attrs.get("CaseIdList", ()))
    labels = map(_text, file.attrs.get("MonitorLabelList", ()))
    label_of_case = dict(zip(cases, labels, strict=False))
    sensors = []
    start = _start(file)
    for key, group in file.items():
        if "Calibrated" not in group:
            continue
        rate = float(np.ravel(group.attrs.get("SampleRate", np.nan))[0])
        name = label_of_case.get(key, "") or key
        datasets = dict(group["Calibrated"].items())
        if "Time" in group:
            datasets["Time"] = group["Time"]
        sensors.append(_sensor(name, datasets, start, rate, path))
    return sensors


def _start(groups: Any) -> int:
    """Return the first time of any sensor [microseconds]."""
    first_times = [int(group["Time"][0]) for group in groups.values() if "Time" in group]
    return min(first_times, default=0)


def _sensor(
    name: str, datasets: Mapping[str, Any], start: int, rate: float, path: Path
) -> InertialSensors:
    """Read one sensor.

    Parameters
    ----------
    name : of the sensor
    datasets : by title, (samples, 3 or 4) or the other way round
    start : time that counts as 0 [microseconds since 1970]
    rate : of the samples [Hz], used where there are no times
    path : of the file, for messages

    Raises
    ------
    BadFile : it has no signals, one of another shape or too large, or neither times nor a rate
    """
    signals: dict[str, Array] = {}
    for kind, titles in SIGNALS.items():
        dataset = next((datasets[title] for title in titles if title in datasets), None)
        if dataset is not None:
            width = 4 if kind == "orientations" else 3
            signals[kind] = _signal(dataset, width, path)[:, None]
    if not signals:
        raise BadFile(path, f"sensor '{name}' has none of {', '.join(SIGNALS)}", HINT)
    frames = min(len(values) for values in signals.values())
    if "Time" in datasets and len(datasets["Time"]) >= frames:
        # Microseconds since 1970: counted from the first of all sensors, for a float's sake.
        microseconds = np.asarray(datasets["Time"], dtype=np.int64)[:frames] - start
        time = np.asarray(1e-6 * microseconds, dtype=np.float64)
    elif rate > 0.0:
        time = np.arange(frames) / rate
    else:
        raise BadFile(path, f"sensor '{name}' has no times and no rate", HINT)
    cut = {kind: values[:frames] for kind, values in signals.items()}
    return sensors_of_signals(time, (name,), cut, source=str(path))


def _signal(dataset: Any, width: int, path: Path) -> Array:
    """Read a signal, which may be stored either way round.

    Parameters
    ----------
    dataset : (samples, width) or (width, samples)
    width : numbers per sample
    path : of the file, for messages

    Returns
    -------
    (samples, width)

    Raises
    ------
    BadFile : it has another shape or is too large
    """
    if dataset.ndim != 2 or width not in dataset.shape or 8 * dataset.size > MAX_BYTES:
        raise BadFile(
            path,
            f"{dataset.name} has the shape {dataset.shape}, where (samples, {width}) is expected",
            HINT,
        )
    values = np.asarray(dataset, dtype=np.float64)
    return values if values.shape[1] == width else values.T


def _text(value: Any) -> str:
    """Return a text without blanks and null characters at its ends."""
    text = value.decode("utf-8", errors="replace") if isinstance(value, bytes) else str(value)
    return text.strip(" \0")
