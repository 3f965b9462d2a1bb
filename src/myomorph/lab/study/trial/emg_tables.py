"""Tables of EMG beside muscle tensions.

They show how channels were calibrated, and where EMG and torques do not agree.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from myomorph.body.tension.task import EmgTargets
from myomorph.core.io.parsing.text import write_csv
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Model
from myomorph.core.motion.emg_activation import EmgCalibration
from myomorph.core.tension.emg_conflicts import conflict_line
from myomorph.core.tension.emg_quantities import CHANNELS, CONFLICTS, TABLE
from myomorph.core.tension.tension import Tension
from myomorph.lab.store.stored_tension import put_conflicts
from myomorph.lab.study.step.step import StepOutput


class ChannelRow(NamedTuple):
    """Cells of a channel in the table, as `CHANNELS` declares its columns; empty where not known.

    Attributes
    ----------
    channel : name
    delay : [s]
    gain, gain_low, gain_high : with its interval
    gain_from : torques, usual or file
    offset, shape, weight : of `EmgCalibration`
    r_held_out_without_emg, r_held_out_with_emg : correlation with its muscles when left out
    muscles : that it measures
    """

    channel: str
    delay: str
    gain: str
    gain_low: str
    gain_high: str
    gain_from: str
    offset: float
    shape: float
    weight: float
    r_held_out_without_emg: str
    r_held_out_with_emg: str
    muscles: str


def write_channels(
    emg_calibration: EmgCalibration, muscles: Mapping[str, Sequence[str]], path: Path
) -> None:
    """Delay, gain and muscles of each channel as a table.

    Parameters
    ----------
    emg_calibration : of the channels
    muscles : of each channel
    path : of the new table
    """
    rows = [
        _channel_row(emg_calibration, index, " ".join(muscles.get(name, ())))
        for index, name in enumerate(emg_calibration.channels)
    ]
    cells = ([quantity.of(row) for quantity in CHANNELS] for row in rows)
    write_csv(path, (quantity.column for quantity in CHANNELS), cells)


def _channel_row(emg_calibration: EmgCalibration, index: int, muscles: str) -> ChannelRow:
    """Write the cells of one channel, by its number."""
    low, high = emg_calibration.intervals[index]
    without, beside = emg_calibration.held_out[index]
    if emg_calibration.by_torque[index]:
        source = "torques"
    elif np.isfinite(low):
        source = "usual"
    else:
        source = "file"
    return ChannelRow(
        channel=emg_calibration.channels[index],
        delay=f"{emg_calibration.delays[index]:.4f}",
        gain=f"{emg_calibration.gains[index]:.6g}",
        gain_low=_cell(low),
        gain_high=_cell(high),
        gain_from=source,
        offset=emg_calibration.offsets[index],
        shape=emg_calibration.shapes[index],
        weight=emg_calibration.weight,
        r_held_out_without_emg=_cell(without),
        r_held_out_with_emg=_cell(beside),
        muscles=muscles,
    )


def _cell(value: float) -> str:
    """Return a number of a table, empty where it is not known."""
    return f"{value:.4g}" if np.isfinite(value) else ""


def write_conflicts(
    model: Model, tension: Tension, targets: EmgTargets, output: StepOutput
) -> tuple[Message, ...]:
    """Where EMG and torques contradict each other, as a table and as a line."""
    if targets.target is None:
        return ()
    conflicts = targets.conflicts(model, tension)
    put_conflicts(output.writer, conflicts)
    cells = ([_rounded(quantity.of(conflict)) for quantity in CONFLICTS] for conflict in conflicts)
    write_csv(output.folder / TABLE, (quantity.column for quantity in CONFLICTS), cells)
    return conflict_line(conflicts, TABLE)


def _rounded(value: str | float) -> str:
    """Return a cell of a stretch: a name as it is, a number in six digits."""
    return value if isinstance(value, str) else f"{value:.6g}"
