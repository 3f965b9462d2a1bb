"""C3D files written with NumPy alone: points, analog channels, force plates and events.

Follows the C3D user guide (Motion Lab Systems): a header of one block, a parameter section of
linked records, frames of points and analog samples, as little-endian reals. Lengths are written in
mm and moments in N mm, which every program takes.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Sequence

import numpy as np

from myomorph.core.io.parsing.text import written
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.series import Markers, PlateRecording, Trial

BLOCK = 512
KEY = 0x50
PC = 84
MAX_COUNT = 255
# Entries of a parameter along one dimension, and the largest frame number of the header.
LAST = 65535
MILLI = 1000.0
KINDS: dict[int, tuple[Sequence[str], Sequence[str]]] = {
    1: (("Fx", "Fy", "Fz", "Px", "Py", "Mz"), ("N", "N", "N", "mm", "mm", "Nmm")),
    2: (("Fx", "Fy", "Fz", "Mx", "My", "Mz"), ("N", "N", "N", "Nmm", "Nmm", "Nmm")),
    3: (("Fx12", "Fx34", "Fy14", "Fy23", "Fz1", "Fz2", "Fz3", "Fz4"), ("N",) * 8),
}
"""Channels of plates that are written: names and units."""


@read_only
class Channel:
    """One analog channel.

    Attributes
    ----------
    name : in the file
    unit : text in the file
    values : (samples,) in that unit
    """

    name: str
    unit: str
    values: Array


def write_c3d(
    path: str | os.PathLike[str], markers: Markers, plate: PlateRecording | None = None
) -> None:
    """Write markers, and a force plate with a whole number of samples per frame, as a C3D file.

    Parameters
    ----------
    path : of the new file, replaced where it exists
    markers : (frames, markers, 3) [m], at a constant rate
    plate : channels (samples, channels) [N, N m], of which the first is at the first frame

    Raises
    ------
    BadData : there are no markers, or the plate has fewer samples than there are frames or a type
        that cannot be written
    BadFile : the file cannot be written
    """
    if plate is None:
        write_trial(path, Trial(markers=markers))
        return
    every = len(plate.channels) // len(markers)
    if every < 1:
        raise BadData(
            f"plate '{plate.name}' has {len(plate.channels)} samples for {len(markers)} frames: a"
            " sample a frame or more can be written"
        )
    step = 1.0 / (markers.rate * every)
    time = markers.time[0] + step * np.arange(len(plate.channels))
    write_trial(path, Trial(markers=markers, plate_recordings=(plate,), plate_time=time))


def write_trial(path: str | os.PathLike[str], trial: Trial) -> None:
    """Write markers, channels, force plates and events as a C3D file, whole or not at all.

    A plate of type 4 is written as type 2, its calibration applied. Analog channels of plates are
    written once, as the plates have them, a whole number of samples per frame. Positions, forces
    and moments keep the seven digits of a 32-bit real.

    Parameters
    ----------
    path : of the new file, replaced where it exists
    trial : markers (frames, markers, 3) [m] at a constant rate; what else it has is optional

    Raises
    ------
    BadData : there are no markers, channels have no whole number of samples per frame, or a plate
        has a type that cannot be written
    BadFile : the file cannot be written
    """
    markers = trial.markers
    if markers is None or not len(markers) or not markers.names:
        raise BadData(f"{path}: there are no markers to write as C3D")
    rate = round(markers.rate, 4) if len(markers) > 1 else 100.0
    channels, plates = _plate_channels(trial)
    channels += _other_channels(trial)
    every = _samples_a_frame(len(markers), [len(channel.values) for channel in channels])
    first = round(float(markers.time[0]) * rate) + 1
    groups = _groups(trial, markers, rate, every, channels, plates, first)
    section = _section(groups)
    blocks = -(-len(section) // BLOCK)
    # The parameter section holds its own length and where the data begin.
    groups["POINT"]["DATA_START"] = np.array([2 + blocks], np.int16)
    section = _section(groups)
    section = section[:2] + bytes([blocks]) + section[3:]
    frames = min(first, LAST), min(first + len(markers) - 1, LAST)
    head = (
        2,
        KEY,
        len(markers.names),
        len(channels) * every,
        *frames,
        0,
        -1.0,
        2 + blocks,
        every,
        rate,
    )
    header = struct.pack("<BBHHHHHfHHf", *head).ljust(BLOCK, b"\0")
    with written(path) as stream:
        stream.buffer.write(
            header + section.ljust(blocks * BLOCK, b"\0") + _frames(markers, channels, every)
        )


def _plate_channels(
    trial: Trial,
) -> tuple[list[Channel], list[tuple[PlateRecording, int, list[int]]]]:
    """List the channels of the plates, moments and centers of pressure in the file's mm.

    Parameters
    ----------
    trial : plates are read

    Returns
    -------
    channels, and for each plate the recording, its type in the file and the numbers (from 1) of its
    channels

    Raises
    ------
    BadData : a plate's type cannot be written
    """
    channels: list[Channel] = []
    plates = []
    for number, plate in enumerate(trial.plate_recordings, start=1):
        kind = plate.kind
        values = np.asarray(plate.channels)
        if kind == 4 and plate.calibration is not None:
            kind = 2
            values = values @ plate.calibration.T
        if kind not in KINDS:
            raise BadData(
                f"plate '{plate.name}' is of C3D type {plate.kind}: types 1 to 4 can be written"
            )
        names, units = KINDS[kind]
        start = len(channels)
        for column, (name, unit) in enumerate(zip(names, units, strict=True)):
            known = plate.channel_names[column] if column < len(plate.channel_names) else ""
            factor = MILLI if "mm" in unit else 1.0
            channels.append(Channel(known or f"{name}{number}", unit, factor * values[:, column]))
        plates.append((plate, kind, list(range(start + 1, len(channels) + 1))))
    return channels, plates


def _other_channels(trial: Trial) -> list[Channel]:
    """List the analog channels that belong to no plate."""
    if trial.analog is None:
        return []
    plates = {name for plate in trial.plate_recordings for name in plate.channel_names}
    units = trial.analog.units or ("",) * len(trial.analog.names)
    return [
        Channel(name, unit, trial.analog.values[:, index])
        for index, (name, unit) in enumerate(zip(trial.analog.names, units, strict=True))
        if name not in plates
    ]


def _samples_a_frame(frames: int, lengths: Sequence[int]) -> int:
    """Return how many analog samples each frame has.

    Parameters
    ----------
    frames : count of frames
    lengths : count of samples of each channel

    Returns
    -------
    samples per frame, 0 without channels

    Raises
    ------
    BadData : a channel has fewer samples than there are frames, or longer channels have enough for
        another sample per frame
    """
    if not lengths:
        return 0
    every = min(lengths) // frames
    if every < 1 or max(lengths) >= frames * (every + 1):
        raise BadData(
            f"analog channels have {min(lengths)} to {max(lengths)} samples for {frames} frames: a"
            " C3D file holds a whole number of samples a frame, equal for all"
        )
    return every


def _groups(
    trial: Trial,
    markers: Markers,
    rate: float,
    every: int,
    channels: list[Channel],
    plates: list[tuple[PlateRecording, int, list[int]]],
    first: int,
) -> dict[str, dict[str, object]]:
    """Collect the parameters of the file.

    Parameters
    ----------
    trial : plates and events are read
    markers : names and count of frames are read
    rate : of frames [Hz]
    every : analog samples per frame
    channels : in the file's order
    plates : recording, type and channel numbers (from 1) of each
    first : number of the first frame, from 1

    Returns
    -------
    by group and name, texts or arrays whose first index is the fastest
    """
    last = first + len(markers) - 1
    groups: dict[str, dict[str, object]] = {
        "TRIAL": {"ACTUAL_START_FIELD": _words(first), "ACTUAL_END_FIELD": _words(last)},
        "POINT": {
            "USED": np.array([len(markers.names)], np.int16),
            "SCALE": np.array([-1.0]),
            "RATE": np.array([rate]),
            "DATA_START": np.array([0], np.int16),
            "FRAMES": np.array([min(len(markers), LAST)], np.uint16).view(np.int16),
            "LABELS": markers.names,
            "UNITS": ("mm",),
        },
        "ANALOG": {
            "USED": np.array([len(channels)], np.int16),
            "GEN_SCALE": np.array([1.0]),
            "RATE": np.array([rate * every]),
            "SCALE": np.ones(len(channels)),
            "OFFSET": np.zeros(len(channels), np.int16),
            "LABELS": tuple(channel.name for channel in channels),
            "UNITS": tuple(channel.unit for channel in channels),
            "FORMAT": ("SIGNED",),
        },
        "MANUFACTURER": {"SOFTWARE": ("Myomorph",)},
    }
    if plates:
        wide = max(len(numbers) for _, _, numbers in plates)
        groups["FORCE_PLATFORM"] = {
            "USED": np.array([len(plates)], np.int16),
            "TYPE": np.array([kind for _, kind, _ in plates], np.int16),
            "ZERO": np.array([1, 0], np.int16),
            "CORNERS": MILLI * np.stack([plate.corners.T for plate, _, _ in plates], axis=2),
            "ORIGIN": MILLI * np.stack([plate.origin for plate, _, _ in plates], axis=1),
            "CHANNEL": (
                np.array(
                    [numbers + [0] * (wide - len(numbers)) for _, _, numbers in plates], np.int16
                ).T
            ),
        }
    if trial.events:
        times = np.array([[event.time // 60.0, event.time % 60.0] for event in trial.events]).T
        groups["EVENT"] = {
            "USED": np.array([len(trial.events)], np.int16),
            "LABELS": tuple(event.label for event in trial.events),
            "CONTEXTS": tuple(event.side or "General" for event in trial.events),
            "TIMES": times,
        }
    return groups


def _words(number: int) -> Array:
    """Split a whole number into two 16-bit words (2,), the lower first."""
    return np.array([number % 65536, number // 65536], np.uint16).view(np.int16)


def _section(groups: dict[str, dict[str, object]]) -> bytes:
    """Write the parameter section; the third byte, its length in blocks, is left to the caller.

    Parameters
    ----------
    groups : texts or arrays by group and name

    Returns
    -------
    bytes of the section, not filled up to a whole block
    """
    parts = [bytes([1, KEY, 0, PC])]
    for number, (group, parameters) in enumerate(groups.items(), start=1):
        name = group.encode("latin-1")
        parts.append(struct.pack("<bb", len(name), -number) + name + struct.pack("<hB", 3, 0))
        for label, value in parameters.items():
            for label_part, part in _continued(label, value):
                body = _body(part)
                title = label_part.encode("latin-1")
                parts.append(
                    struct.pack("<bb", len(title), number)
                    + title
                    + struct.pack("<h", len(body) + 3)
                )
                parts.append(body + b"\0")
    return b"".join(parts) + b"\0\0"


def _continued(label: str, value: object) -> list[tuple[str, object]]:
    """Split a parameter into parts of no more entries than one can hold: LABELS, LABELS2, ..."""
    if isinstance(value, tuple):
        parts: list[object] = [
            value[index : index + MAX_COUNT] for index in range(0, len(value), MAX_COUNT)
        ] or [()]
    else:
        assert isinstance(value, np.ndarray)
        parts = [
            value[..., index : index + MAX_COUNT] for index in range(0, value.shape[-1], MAX_COUNT)
        ] or [value]
    return [
        (label if index == 0 else f"{label}{index + 1}", part) for index, part in enumerate(parts)
    ]


def _body(value: object) -> bytes:
    """Write type, dimensions and data of a parameter: texts, integers or reals."""
    if isinstance(value, tuple):
        texts = [text.encode("latin-1", "replace")[:127] for text in value]
        width = max([len(text) for text in texts] + [1])
        data = b"".join(text.ljust(width) for text in texts)
        return struct.pack("<bBBB", -1, 2, width, len(texts)) + data
    numbers = np.asarray(value)
    whole = numbers.dtype.kind in "iu"
    data = numbers.astype("<i2" if whole else "<f4").tobytes(order="F")
    return struct.pack("<bB", 2 if whole else 4, numbers.ndim) + bytes(numbers.shape) + data


def _frames(markers: Markers, channels: list[Channel], every: int) -> bytes:
    """Write points with their residuals, then the analog samples of each frame.

    Parameters
    ----------
    markers : (frames, markers, 3) [m], NaN where hidden
    channels : of (samples,) each
    every : samples per frame

    Returns
    -------
    little-endian 32-bit reals; a hidden point is 0 with residual -1
    """
    frames, count = markers.values.shape[:2]
    seen = np.asarray(np.isfinite(markers.values).all(axis=2))
    points = np.zeros((frames, count, 4), "<f4")
    points[:, :, :3] = np.where(seen[:, :, None], MILLI * markers.values, 0.0)
    points[:, :, 3] = np.where(seen, 0.0, -1.0)
    if not channels:
        return points.tobytes()
    samples = np.stack([channel.values[: frames * every] for channel in channels], axis=1).reshape(
        frames, -1
    )
    return np.hstack([points.reshape(frames, -1), samples.astype("<f4")]).tobytes()
