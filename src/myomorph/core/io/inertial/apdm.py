"""APDM's HDF5 files: orientations and raw signals of Opal sensors, in two layouts."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from myomorph.core.io.inertial.signals import sensors_of_signals
from myomorph.core.io.parsing.guard import run_guarded, seconds_for
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
MAX_BYTES = 1 << 31
MEMORY = 4.0


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
    if not path.is_file():
        raise BadFile(path, "no such file")
    # Crafted files can make the library hang or crash: a child goes first.
    outcome = run_guarded(f"{__name__}:read_through", [path.resolve()], seconds_for(path), MEMORY)
    if outcome.status != "done":
        raise BadFile(path, f"cannot be read ({outcome.message})", HINT)
    sensors = _sensors(path)
    if not sensors:
        raise BadFile(path, "holds no sensor", HINT)
    return beside(sensors)


def read_through(path: str | os.PathLike[str]) -> None:
    """Read all that `read_apdm` reads, in a process that may be stopped.

    Parameters
    ----------
    path : of the file
    """
    _sensors(Path(path))


def _sensors(path: Path) -> list[InertialSensors]:
    # Takes a moment to import, and few trials need it.
    """Read each sensor by itself; `BadFile` where the file is no HDF5."""
    import h5py

    try:
        with h5py.File(path, "r") as file:
            return _new(file, path) if "Sensors" in file else _old(file, path)
    except OSError as error:
        raise BadFile(path, f"is no HDF5 file ({error})", HINT) from None


def _new(file: Any, path: Path) -> list[InertialSensors]:
    """Read the sensors of the newer layout: groups Sensors and Processed."""
    sensors = []
    start = _start(file["Sensors"])
    for key, group in file["Sensors"].items():
        settings = group["Configuration"].attrs if "Configuration" in group else group.attrs
        name = _text(settings.get("Label 0", key)) or key
        processed = file.get(f"Processed/{key}", {})
        sensors.append(
            _sensor(name, {**dict(group.items()), **dict(processed.items())}, start, 0.0, path)
        )
    return sensors


def _old(file: Any, path: Path) -> list[InertialSensors]:
    """Read the sensors of the older layout: one group per monitor."""
    lists = (file.attrs.get(name, ()) for name in ("CaseIdList", "MonitorLabelList"))
    labels = dict(zip(*(map(_text, texts) for texts in lists), strict=False))
    sensors = []
    start = _start(file)
    for key, group in file.items():
        if "Calibrated" in group:
            rate = float(np.ravel(group.attrs.get("SampleRate", np.nan))[0])
            name = labels.get(key, "") or key
            parts = {
                **dict(group["Calibrated"].items()),
                **({"Time": group["Time"]} if "Time" in group else {}),
            }
            sensors.append(_sensor(name, parts, start, rate, path))
    return sensors


def _start(groups: Any) -> int:
    """Return the first time of any sensor [microseconds]."""
    return min((int(group["Time"][0]) for group in groups.values() if "Time" in group), default=0)


def _sensor(
    name: str, parts: dict[str, Any], start: int, rate: float, path: Path
) -> InertialSensors:
    """Read one sensor.

    Parameters
    ----------
    name : of the sensor
    parts : data sets by title, (samples, 3 or 4) or the other way round
    start : time that counts as 0 [microseconds since 1970]
    rate : of the samples [Hz], used where there are no times
    path : of the file, for messages

    Raises
    ------
    BadFile : it has no signals, one of another shape or too large, or neither times nor a rate
    """
    signals: dict[str, Array] = {}
    for kind, titles in SIGNALS.items():
        dataset = next((parts[title] for title in titles if title in parts), None)
        width = 4 if kind == "orientations" else 3
        if dataset is None:
            continue
        if dataset.ndim != 2 or width not in dataset.shape or 8 * dataset.size > MAX_BYTES:
            text = (
                f"{dataset.name} has the shape {dataset.shape}, where (samples, {width}) is"
                " expected"
            )
            raise BadFile(path, text, HINT)
        values = np.asarray(dataset, dtype=np.float64)
        signals[kind] = (values if values.shape[1] == width else values.T)[:, None]
    if not signals:
        raise BadFile(path, f"sensor '{name}' has none of {', '.join(SIGNALS)}", HINT)
    frames = min(len(values) for values in signals.values())
    if "Time" in parts and len(parts["Time"]) >= frames:
        # Microseconds since 1970: counted from the first of all sensors, for a float's sake.
        time = np.asarray(
            1e-6 * (np.asarray(parts["Time"], dtype=np.int64)[:frames] - start), dtype=np.float64
        )
    elif rate > 0.0:
        time = np.arange(frames) / rate
    else:
        raise BadFile(path, f"sensor '{name}' has no times and no rate", HINT)
    cut = {kind: values[:frames] for kind, values in signals.items()}
    return sensors_of_signals(time, (name,), cut, source=str(path))


def _text(value: Any) -> str:
    """Return a text without blanks and null characters at its ends."""
    return (
        value.decode("utf-8", errors="replace") if isinstance(value, bytes) else str(value)
    ).strip(" \0")
