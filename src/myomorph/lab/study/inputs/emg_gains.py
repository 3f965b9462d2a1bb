"""Gains of a subject's EMG channels as a file.

EMG of any recording of the subject is brought into the units that they are for.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from myomorph.core.io.parsing.door import content_of
from myomorph.core.io.parsing.text import written
from myomorph.core.model.errors import BadFile, MyomorphError
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.messages import Message
from myomorph.core.model.series import Emg
from myomorph.core.motion.emg_activation import EmgCalibration, Synergies, SynergyWeights

FORMAT = "myomorph EMG gains 1"


@dataclass(frozen=True, eq=False)
class SubjectGains:
    """Delay, gain and shape of a subject's channels.

    `scale`: what the envelopes of each channel were divided by, in the units of the recordings.
    """

    calibration: EmgCalibration
    scale: Mapping[str, float]


def common_scale(scales: list[Mapping[str, float]]) -> dict[str, float]:
    """Return the largest scale of each channel over recordings of the same electrodes."""
    names = dict.fromkeys(name for scale in scales for name in scale)
    return {name: max(scale[name] for scale in scales if name in scale) for name in names}


def rescaled(emg: Emg, own: Mapping[str, float], wanted: Mapping[str, float]) -> Emg:
    """Divide envelopes by `wanted` in the place of `own`, by which they were divided.

    Channels that are missing in one of them stay as they are. A recording alone is scaled to its
    own largest value: the same gain then means another activation in each.
    """
    factors = [
        own[name] / wanted[name] if name in own and name in wanted else 1.0 for name in emg.names
    ]
    return Emg(emg.time, emg.names, emg.values * np.array(factors))


def write_gains(gains: SubjectGains, path: Path) -> None:
    """Write gains as JSON."""
    synergies = [
        vars(part.synergies) | {"muscles": part.muscles, "weights": part.weights}
        for part in gains.calibration.synergies
    ]
    fields = dict(vars(gains.calibration))
    # What certifies gains stays with the run that found them.
    fields.pop("estimate")
    data = {
        "format": FORMAT,
        **fields,
        "synergies": synergies,
        "scale": dict(gains.scale),
    }
    with written(path) as stream:
        json.dump(data, stream, indent=1, allow_nan=False, default=_plain)


def _plain(values: np.ndarray) -> Any:
    """Numbers for JSON, which has no NaN."""
    return np.where(np.isfinite(values), values, np.array(None)).tolist()


def read_gains(path: Path) -> SubjectGains:
    """Read gains; raises `BadFile` where the file is none of `write_gains`."""
    try:
        data = json.loads(content_of(path, "settings").decode("utf-8"))
    except (ValueError, RecursionError) as error:
        raise BadFile(
            path, f"cannot be read as gains of EMG ({error})", "give gains.json of the step 'emg'"
        ) from error
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise BadFile(path, "holds no gains of EMG", "give gains.json of the step 'emg' of a study")
    try:
        return SubjectGains(
            _calibration(data), FrozenMap({name: float(one) for name, one in data["scale"].items()})
        )
    except (KeyError, TypeError, ValueError, AttributeError, MyomorphError) as error:
        raise BadFile(
            path, f"holds gains of EMG that do not fit together ({error})", "write it anew"
        ) from error


def _calibration(data: dict[str, Any]) -> EmgCalibration:
    channels = tuple(data["channels"])
    count = len(channels)

    return EmgCalibration(
        channels=channels,
        delays=np.array(data["delays"], dtype=float),
        gains=np.array(data["gains"], dtype=float),
        offsets=np.array(data["offsets"], dtype=float),
        shapes=np.array(data["shapes"], dtype=float),
        by_torque=np.array(data["by_torque"], dtype=float),
        intervals=np.array(data["intervals"], dtype=float).reshape(count, 2),
        held_out=np.array(data["held_out"], dtype=float).reshape(count, 2),
        warnings=tuple(map(Message.of_record, data["warnings"])),
        synergies=tuple(map(_synergies, data["synergies"])),
        weight=float(data["weight"]),
        others_weight=float(data["others_weight"]),
    )


def _synergies(data: dict[str, Any]) -> SynergyWeights:
    channels = tuple(data["channels"])
    muscles = tuple(data["muscles"])
    vectors = np.array(data["vectors"], dtype=float).reshape(-1, len(channels))
    synergies = Synergies(
        channels=channels,
        scale=np.array(data["scale"], dtype=float),
        vectors=vectors,
        explained=float(data["explained"]),
    )
    return SynergyWeights(
        synergies, muscles, np.array(data["weights"], dtype=float).reshape(len(muscles), -1)
    )
