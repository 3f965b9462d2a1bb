"""EMG as BIDS has it: a BDF file, its channels and what is known beside them.

Everything is one data record: its length is then free, and so is the rate, which the JSON file holds exactly.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from myomorph.io.bids.signals import (
    CHANNELS,
    RATE,
    SI,
    START,
    UNKNOWN,
    beside,
    channels_of_file,
    facts_of_file,
    number_of,
    write_json,
    write_tsv,
)
from myomorph.model.arrays import Array
from myomorph.model.errors import BadData, BadFile, from_extra
from myomorph.model.series import Analog, Series

ENDINGS = (".bdf", ".edf")
UNEVEN = 0.01
"""Share of a sample by which times may be off an even clock."""
DIGITS = 7
"""Characters that a header has for the largest value of a channel, the sign apart."""
LABEL = 16  # Characters of a channel's name in the header.
FACTS: dict[str, Any] = {
    "EMGPlacementScheme": "Other",
    "EMGPlacementSchemeDescription": "not stated by the files that the recording was read from",
    "EMGReference": UNKNOWN,
    "PowerLineFrequency": UNKNOWN,
    "RecordingType": "continuous",
    "SoftwareFilters": UNKNOWN,
}
"""What BIDS asks for and recordings do not say."""


def write_emg(stem: Path, emg: Series, units: Sequence[str], facts: Mapping[str, Any]) -> None:
    """Write STEM_emg.bdf, its channels and its facts. A value is rounded to a part in 2^23 of the largest one of its
    channel. Raises `BadData` where samples are not evenly spaced, `MissingPackage` without edfio.
    """
    edfio = from_extra("bids", "edfio")
    rate = emg.rate
    if len(emg) < 2 or np.abs(emg.time - emg.time[0] - np.arange(len(emg)) / rate).max() * rate > UNEVEN:
        raise BadData("EMG has no even sampling rate, which a BDF file needs: resample it")
    duration = float(f"{len(emg) / rate:.7g}"[:8])
    signals, rows = [], []
    for name, unit, column in zip(emg.names, units, emg.values.T, strict=True):
        lost = int((~np.isfinite(column)).sum())
        column = np.nan_to_num(column, nan=0.0, posinf=0.0, neginf=0.0)
        limit = _limit(column)
        label = name.encode("ascii", "replace").decode()[:LABEL]
        signals.append(
            edfio.BdfSignal(
                column, len(emg) / duration, label=label, physical_dimension=unit[:8], physical_range=(-limit, limit)
            )
        )
        status = ("bad", f"{lost} samples are not known and written as 0") if lost else ("good", UNKNOWN)
        rows.append((name, "EMG", unit or UNKNOWN, name, *status))
    edfio.Bdf(signals, data_record_duration=duration).write(stem.with_name(f"{stem.name}_emg.bdf"))
    columns = ("name", "type", "units", "target_muscle", "status", "status_description")
    write_tsv(stem.with_name(stem.name + CHANNELS), columns, rows)
    known = {
        RATE: rate,
        "RecordingDuration": len(emg) / rate,
        "EMGChannelCount": len(rows),
        START: float(emg.time[0]),
    }
    write_json(stem.with_name(f"{stem.name}_emg.json"), FACTS | known | dict(facts))


def _limit(column: Array) -> float:
    """The smallest number of a header's length that no value of a channel passes."""
    largest = float(np.abs(column).max(initial=0.0))
    if not largest < 10.0**DIGITS:
        raise BadData(f"EMG reaches {largest:.3g}, more than a BDF file holds: use another unit")
    decimals = DIGITS - 1 - len(str(int(largest)))
    return max(math.ceil(largest * 10.0**decimals) / 10.0**decimals, 10.0**-5)


def read_emg(path: Path) -> Analog:
    """Channels of a BDF or EDF file (samples, channels) in V where they are volts; those that a dataset calls EMG where
    it is of one, by the names and on the clock that files beside it state. Raises `BadFile`, or `MissingPackage`
    without edfio.
    """
    edfio = from_extra("bids", "edfio")
    try:
        file = (edfio.read_bdf if path.suffix.lower() == ".bdf" else edfio.read_edf)(str(path))
        signals = list(file.signals)
        columns = [signal.data for signal in signals]
    except OSError as error:
        raise BadFile(path, f"cannot be read ({error.strerror or error})") from None
    except Exception as error:
        raise BadFile(path, f"is no BDF or EDF file: {error}") from None
    if not signals:
        raise BadFile(path, "holds no channel")
    names, units = [signal.label for signal in signals], [signal.physical_dimension for signal in signals]
    kept, facts = list(range(len(signals))), facts_of_file(path)
    if beside(path, CHANNELS):
        channels = channels_of_file(path, ("name", "type", "units"))
        if len(channels) != len(signals):
            raise BadFile(path, f"holds {len(signals)} channels, but its _channels.tsv names {len(channels)}")
        kept = [column for column in kept if channels[column].kind == "EMG"]
        names, units = [each.name for each in channels], [each.unit.replace(UNKNOWN, "") for each in channels]
    sizes = {len(columns[column]) for column in kept}
    if len(sizes) != 1:
        raise BadFile(path, "holds no EMG channel" if not sizes else "holds channels of several rates", "split it")
    rate = number_of(facts, RATE) or signals[kept[0]].sampling_frequency
    if not rate > 0.0:
        raise BadFile(path, "has no sampling rate")
    time = number_of(facts, START) + np.arange(sizes.pop()) / rate
    turned = [SI.get(units[column].replace("µ", "u"), (units[column], 1.0)) for column in kept]
    values = np.column_stack([columns[column] * factor for column, (_, factor) in zip(kept, turned, strict=True)])
    return Analog(time, tuple(names[column] for column in kept), values, units=tuple(unit for unit, _ in turned))
