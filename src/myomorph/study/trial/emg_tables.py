"""Tables of EMG beside muscle tensions: how channels were calibrated, and where EMG and torques do not agree."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from myomorph.io.parsing.text import written
from myomorph.model.model import Model
from myomorph.motion.emg_delay import EmgCalibration
from myomorph.store.stored import put_conflicts
from myomorph.study.step.step import StepOutput
from myomorph.tension.emg_conflicts import conflict_line
from myomorph.tension.task import EmgTargets
from myomorph.tension.tension import Tension

EMG_TABLE, EMG_CONFLICTS = "emg_channels.csv", "emg_conflicts.csv"


def write_calibration(targets: EmgTargets, muscles: Mapping[str, Sequence[str]], path: Path) -> None:
    """Delay, gain and muscles of each channel as a table, where there are any."""
    if targets.calibration is not None:
        write_channels(targets.calibration, muscles, path)


def write_channels(emg_calibration: EmgCalibration, muscles: Mapping[str, Sequence[str]], path: Path) -> None:
    """Delay, gain and muscles of each channel as a table."""
    with written(path) as stream:
        table = csv.writer(stream, lineterminator="\n")
        table.writerow(
            ("channel", "delay_s", "gain", "gain_low", "gain_high", "gain_from", "offset", "shape", "weight")
            + ("r_held_out_without_emg", "r_held_out_with_emg", "muscles")
        )
        for index, name in enumerate(emg_calibration.channels):
            low, high = (_cell(interval) for interval in emg_calibration.intervals[index])
            source = "torques" if emg_calibration.by_torque[index] else "usual" if low else "file"
            held = (_cell(one) for one in emg_calibration.held_out[index])
            row: tuple[str, ...] = (
                name,
                f"{emg_calibration.delays[index]:.4f}",
                f"{emg_calibration.gains[index]:.6g}",
                low,
                high,
                source,
            )
            row += (
                f"{emg_calibration.offsets[index]:.6g}",
                f"{emg_calibration.shapes[index]:g}",
                f"{emg_calibration.weight:g}",
                *held,
            )
            table.writerow((*row, " ".join(muscles.get(name, ()))))


def _cell(value: float) -> str:
    """A number of a table, empty where it is not known."""
    return f"{value:.4g}" if np.isfinite(value) else ""


def write_conflicts(model: Model, tension: Tension, targets: EmgTargets, output: StepOutput) -> tuple[str, ...]:
    """Where EMG and torques contradict each other, as a table and as a line."""
    if targets.target is None:
        return ()
    found = targets.conflicts(model, tension)
    put_conflicts(output.writer, found)
    with written(output.folder / EMG_CONFLICTS) as stream:
        table = csv.writer(stream, lineterminator="\n")
        table.writerow(("muscle", "coordinate", "start_s", "stop_s", "worst_s", "emg_or_torque", "found"))
        for one in found:
            times = (f"{value:.4f}" for value in (one.start, one.stop, one.worst))
            table.writerow((one.muscle, one.coordinate, *times, f"{one.emg:.5g}", f"{one.found:.5g}"))
    return conflict_line(found, EMG_CONFLICTS)
