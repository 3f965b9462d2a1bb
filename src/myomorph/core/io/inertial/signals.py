"""Signals of inertial sensors by name, as files have them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from myomorph.core.model.arrays import Array
from myomorph.core.model.inertial_sensors import InertialSensors
from myomorph.core.model.messages import Message


def sensors_of_signals(
    time: Array,
    names: tuple[str, ...],
    signals: Mapping[str, Any],
    warnings: tuple[Message, ...] = (),
    source: str = "",
) -> InertialSensors:
    """Make sensors of the signals that a file has.

    Parameters
    ----------
    time : (frames,) [s]
    names : one per sensor
    signals : (frames, sensors, 3 or 4) by fields of `InertialSensors`, in its units; what is
        missing was not recorded
    warnings : what looks wrong, one line each
    source : path of the file

    Returns
    -------
    InertialSensors
    """
    return InertialSensors(
        time=time,
        names=names,
        orientations=signals.get("orientations"),
        angular_velocities=signals.get("angular_velocities"),
        accelerations=signals.get("accelerations"),
        magnetic_fields=signals.get("magnetic_fields"),
        warnings=warnings,
        source=source,
    )
