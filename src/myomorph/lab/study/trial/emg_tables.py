"""Tables of EMG beside muscle tensions: how channels were calibrated, and where EMG and torques do
not agree.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from myomorph.body.tension.task import EmgTargets
from myomorph.core.io.parsing.text import write_csv
from myomorph.core.model.model import Model
from myomorph.core.motion.emg_activation import EmgCalibration
from myomorph.core.tension.emg_conflicts import conflict_line
from myomorph.core.tension.tension import Tension
from myomorph.lab.store.stored import put_conflicts
from myomorph.lab.study.step.step import StepOutput

EMG_TABLE = "emg_channels.csv"
EMG_CONFLICTS = "emg_conflicts.csv"


def write_channels(
    emg_calibration: EmgCalibration, muscles: Mapping[str, Sequence[str]], path: Path
) -> None:
    """Delay, gain and muscles of each channel as a table."""
    head = (
        "channel",
        "delay_s",
        "gain",
        "gain_low",
        "gain_high",
        "gain_from",
        "offset",
        "shape",
        "weight",
    )
    rows = []
    for index, name in enumerate(emg_calibration.channels):
        low, high = map(_cell, emg_calibration.intervals[index])
        delay = f"{emg_calibration.delays[index]:.4f}"
        gain = f"{emg_calibration.gains[index]:.6g}"
        if emg_calibration.by_torque[index]:
            source = "torques"
        elif low:
            source = "usual"
        else:
            source = "file"
        numbers = (
            emg_calibration.offsets[index],
            emg_calibration.shapes[index],
            emg_calibration.weight,
        )
        held = (_cell(correlation) for correlation in emg_calibration.held_out[index])
        rows.append(
            (name, delay, gain, low, high, source, *numbers, *held, " ".join(muscles.get(name, ())))
        )
    write_csv(path, (*head, "r_held_out_without_emg", "r_held_out_with_emg", "muscles"), rows)


def _cell(value: float) -> str:
    """A number of a table, empty where it is not known."""
    return f"{value:.4g}" if np.isfinite(value) else ""


def write_conflicts(
    model: Model, tension: Tension, targets: EmgTargets, output: StepOutput
) -> tuple[str, ...]:
    """Where EMG and torques contradict each other, as a table and as a line."""
    if targets.target is None:
        return ()
    conflicts = targets.conflicts(model, tension)
    put_conflicts(output.writer, conflicts)
    rows = []
    for conflict in conflicts:
        times = (f"{value:.4f}" for value in (conflict.start, conflict.stop, conflict.worst))
        rows.append(
            (
                conflict.muscle,
                conflict.coordinate,
                *times,
                f"{conflict.emg:.5g}",
                f"{conflict.found:.5g}",
            )
        )
    head = ("muscle", "coordinate", "start_s", "stop_s", "worst_s", "emg_or_torque", "found")
    write_csv(output.folder / EMG_CONFLICTS, head, rows)
    return conflict_line(conflicts, EMG_CONFLICTS)
