"""Parameters and samples of C3D files with NumPy alone: three byte orders, integers and reals.

Follows the C3D user guide (Motion Lab Systems): a header of one block, a parameter section of
linked records, and frames of points and analog samples. It believes the header where header and
parameters differ, stops at the first broken parameter record and keeps the ones before it, and
never reads more than the file holds.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from myomorph.core.io.parsing.door import content_of
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.causes import READING
from myomorph.core.model.errors import BadFile
from myomorph.core.model.messages import Message

Value = tuple[str, ...] | Array

BLOCK = 512
KEY = 0x50  # Bytes of a block; the second byte of every C3D file.
PC = 84
DEC = 85
SGI = 86
EVENT_KEY = 12345
MAX_EVENTS = 18
MAX_NAMED = 20
MAX_SECTION = 0xFFFF * BLOCK
"""Largest parameter section: the header states the first block behind it in 16 bits [bytes]."""
MAX_DIMENSIONS = 7

WORDS_OF_POSE = 17  # Of a segment: a matrix (4, 4) and its reliability.

# Types of parameters.
CHARACTERS = -1
BYTES = 1
INTEGERS = 2
REALS = 4
BYTES_OF_KIND = {CHARACTERS: 1, BYTES: 1, INTEGERS: 2, REALS: 4}


@read_only
class RawC3d:
    """Parameters and samples of a C3D file, scaled, in the file's units.

    Attributes
    ----------
    groups : group to parameter to value: texts, or numbers of the file's shape (first index
        fastest)
    first_frame : number of the first frame, counted from 1
    point_rate, analog_rate : samples per second [Hz]
    points : (frames, points, 3), NaN where the file calls them invalid
    residuals : (frames, points), negative where invalid
    analog : (samples, channels), offset and scale applied
    rotations : (samples, segments, 4, 4) poses of segments, positions in the file's unit of length,
        NaN where the program saw none
    rotation_rate : of these samples [Hz]
    events : (label, time [s]) of the header's own list
    remarks : what was repaired or left out, one line each
    """

    groups: Mapping[str, Mapping[str, Value]]
    first_frame: int
    point_rate: float
    analog_rate: float
    points: Array
    residuals: Array
    analog: Array
    rotations: Array = field(default_factory=lambda: np.zeros((0, 0, 4, 4)))
    rotation_rate: float = 0.0
    events: tuple[tuple[str, float], ...] = ()
    remarks: tuple[Message, ...] = ()

    def texts(self, group: str, name: str) -> tuple[str, ...]:
        """Read the texts of a parameter and its continuations (`LABELS`, `LABELS2`, ...).

        Parameters
        ----------
        group, name : of the parameter, in capital letters

        Returns
        -------
        the texts without blanks at their ends; () if the parameter is absent or holds numbers
        """
        values = self._continued(group, name)
        texts = [text for value in values if isinstance(value, tuple) for text in value]
        return tuple(text.partition("\0")[0].strip() for text in texts)

    def numbers(self, group: str, name: str) -> Array:
        """Read the numbers of a parameter and its continuations, flat in the file's order.

        Parameters
        ----------
        group, name : of the parameter, in capital letters

        Returns
        -------
        (numbers,) with the first index fastest; empty if the parameter is absent or holds texts
        """
        parts = [np.zeros(0)]
        for value in self._continued(group, name):
            if isinstance(value, tuple):
                break
            parts.append(np.asarray(value, dtype=np.float64).ravel(order="F"))
        return np.concatenate(parts)

    def _continued(self, group: str, name: str) -> Iterator[Value]:
        """Yield the values of a parameter and its continuations, up to an absent one."""
        for number in ("", *range(2, 40)):
            value = self.groups.get(group, {}).get(f"{name}{number}")
            if value is None:
                return
            yield value

    def shape(self, group: str, name: str) -> tuple[int, ...]:
        """Return the shape of a parameter's value.

        Parameters
        ----------
        group, name : of the parameter, in capital letters

        Returns
        -------
        counts along each dimension, () if the parameter is absent or holds texts
        """
        value = self.groups.get(group, {}).get(name)
        return () if value is None or isinstance(value, tuple) else np.shape(value)


def read_raw_c3d(path: str | os.PathLike[str]) -> RawC3d:
    """Read a C3D file with NumPy alone.

    Parameters
    ----------
    path : of the file

    Returns
    -------
    parameters, points (frames, points, 3) and analog samples (samples, channels) in the file's
    units; `remarks` say what was repaired or left out

    Raises
    ------
    BadFile : it cannot be read, is no C3D file, or holds no whole frame
    """
    path = Path(path)
    data = content_of(path, "C3D")
    if len(data) < BLOCK:
        what = "is empty" if not data else f"is too short for a C3D file ({len(data)} bytes)"
        raise BadFile(
            path, what, "give the recording again, as the program of the laboratory exports it"
        )
    if data[1] != KEY:
        raise BadFile(path, "is not a C3D file: its second byte is not 50 hexadecimal")
    remarks: list[Message] = []
    # A damaged file holds numbers of any size; what is not finite is dealt with where it is used.
    with np.errstate(all="ignore"):
        section, order = _section(data, remarks)
        header = _header(data, order)
        groups = _parameters(data, section, order, remarks)
        return _samples(data, header, groups, order, remarks, path)


def claimed_frames(head: bytes) -> tuple[int, float]:
    """Read how many frames a C3D file claims to hold, from its first bytes.

    Parameters
    ----------
    head : first bytes of the file: header and parameter section, or as much of it as there is

    Returns
    -------
    count of frames and their rate [Hz]; 0 for what is unknown
    """
    with np.errstate(all="ignore"):
        section, order = _section(head, [])
        header = _header(head, order)
        groups = _parameters(head, section, order, [])
        about = _without_samples(header, groups)
        return _claimed_frames(about, header, 0), _first(about, "POINT", "RATE", header.rate)


def _without_samples(header: _Header, groups: Mapping[str, Mapping[str, Value]]) -> RawC3d:
    """Make a file of no frames, whose parameters can be read."""
    return RawC3d(
        groups=groups,
        first_frame=header.first,
        point_rate=header.rate,
        analog_rate=0.0,
        points=np.zeros((0, 0, 3)),
        residuals=np.zeros((0, 0)),
        analog=np.zeros((0, 0)),
    )


@dataclass(frozen=True)
class _Order:
    """Form in which a processor writes numbers.

    Attributes
    ----------
    processor : code in the parameter section: `PC`, `DEC` or `SGI`
    """

    processor: int

    @property
    def end(self) -> str:
        """Order of bytes as NumPy calls it, ">" with the highest first."""
        return ">" if self.processor == SGI else "<"

    def ints(self, data: bytes, signed: bool = True) -> np.ndarray:
        """Read 16-bit integers, flat."""
        return np.frombuffer(data, dtype=self.end + ("i2" if signed else "u2"))

    def floats(self, data: bytes) -> Array:
        """Read 32-bit reals, flat; those of a DEC processor have the form of a VAX."""
        if self.processor == DEC:
            # A VAX real: its 16-bit halves are swapped, its exponent is two larger than IEEE's.
            halves = np.frombuffer(data, dtype="<u2").reshape(-1, 2)[:, ::-1]
            return np.ascontiguousarray(halves).view("<f4").ravel().astype(np.float64) / 4.0
        return np.frombuffer(data, dtype=self.end + "f4").astype(np.float64)


@dataclass(frozen=True)
class _Header:
    """Numbers of the first block.

    Attributes
    ----------
    points : count in each frame
    analog_per_frame : analog samples of all channels in each frame
    first, last : numbers of frames, counted from 1
    scale : of integer coordinates [file's unit of length]; negative where they are reals
    data_block : number of the samples' first block, counted from 1
    samples_per_frame : analog samples of each channel in each frame
    rate : of frames [Hz]
    events : (label, time [s])
    """

    points: int
    analog_per_frame: int
    first: int
    last: int
    scale: float
    data_block: int
    samples_per_frame: int
    rate: float
    events: tuple[tuple[str, float], ...]


def _section(data: bytes, remarks: list[Message]) -> tuple[int, _Order]:
    """Find where the parameter section begins and which byte order it names.

    Parameters
    ----------
    data : the file, or its first bytes
    remarks : gets a warning where the header is wrong or no processor is named

    Returns
    -------
    index of the section's first byte, and the byte order (a PC's where none is named)
    """
    stated = (data[0] - 1) * BLOCK
    for start in (stated, BLOCK):
        if not 0 < start <= len(data) - 4:
            continue
        processor = data[start + 3]
        if processor not in (PC, DEC, SGI):
            continue
        if start != stated:
            remarks.append(
                READING.message(
                    "the parameter section was looked for at its usual place: the header points"
                    " elsewhere"
                )
            )
        return start, _Order(processor)
    remarks.append(READING.message("the parameter section names no processor: taken as PC"))
    return stated, _Order(PC)


def _header(data: bytes, order: _Order) -> _Header:
    """Read the first block: counts, numbers of frames, scale, rate [Hz] and its list of events."""
    words = order.ints(data[:BLOCK], signed=False)
    events: list[tuple[str, float]] = []
    if words[149] == EVENT_KEY and words[150] <= MAX_EVENTS:
        count = int(words[150])
        times = order.floats(data[304 : 304 + 4 * count])
        for index in range(count):
            label = data[396 + 4 * index : 400 + 4 * index].decode("latin-1").strip(" \0")
            events.append((label, float(times[index])))
    return _Header(
        points=int(words[1]),
        analog_per_frame=int(words[2]),
        first=int(words[3]),
        last=int(words[4]),
        scale=float(order.floats(data[12:16])[0]),
        data_block=int(words[8]),
        samples_per_frame=int(words[9]),
        rate=float(order.floats(data[20:24])[0]),
        events=tuple(events),
    )


@dataclass(frozen=True, kw_only=True)
class _Record:
    """A linked record of the parameter section.

    Attributes
    ----------
    group : number of the group that it belongs to; negative where it names a group
    name : of the parameter or group, in capital letters
    value_at : index of the byte that states the type of a parameter
    """

    group: int
    name: str
    value_at: int


def _records(data: bytes, section: int, order: _Order, remarks: list[Message]) -> Iterator[_Record]:
    """Yield the records of the parameter section, up to a broken one.

    Parameters
    ----------
    data : the file, or its first bytes
    section : index of the parameter section's first byte
    order : how numbers are written
    remarks : gets a warning where a record is broken
    """
    at = section + 4
    while 0 <= at < min(len(data) - 4, section + MAX_SECTION):
        length = abs(_signed(data[at]))
        if length == 0:
            return
        group = _signed(data[at + 1])
        name_end = at + 2 + length
        name = data[at + 2 : name_end].decode("latin-1").strip(" \0").upper()
        if group == 0 or name_end + 2 > len(data) or not name.isprintable():
            remarks.append(
                READING.message(
                    "the parameter section is broken: what follows the first broken record was"
                    " left out"
                )
            )
            return
        yield _Record(group=group, name=name, value_at=name_end + 2)
        step = int(order.ints(data[name_end : name_end + 2])[0])
        if step <= 0:
            return
        at = name_end + step


def _parameters(
    data: bytes, section: int, order: _Order, remarks: list[Message]
) -> dict[str, dict[str, Value]]:
    """Read the groups of parameters; records after a broken one are lost.

    Parameters
    ----------
    data : the file, or its first bytes
    section : index of the parameter section's first byte
    order : how numbers are written
    remarks : gets a warning for what was left out

    Returns
    -------
    values by group and name, both in capital letters; of two with one name the first
    """
    group_names: dict[int, str] = {}
    parameters: list[tuple[_Record, Value]] = []
    broken: list[str] = []
    left = MAX_SECTION
    for record in _records(data, section, order, remarks):
        if record.group < 0:
            group_names[-record.group] = record.name
            continue
        value = _value(data, record.value_at, order) if left >= 0 else None
        # Records may overlap in a crafted file, so that their values are larger than it.
        left -= 0 if value is None else _bytes_of(value)
        if value is None or left < 0:
            broken.append(record.name)
            continue
        parameters.append((record, value))
    remarks += _broken_parameters(broken)
    # The record that names a group may stand behind its parameters.
    groups: dict[str, dict[str, Value]] = {}
    for record, value in parameters:
        group = group_names.get(record.group, f"GROUP {record.group}")
        groups.setdefault(group, {}).setdefault(record.name, value)
    return groups


def _broken_parameters(names: Sequence[str]) -> Iterator[Message]:
    """Yield what is said of parameters that were left out: each of a few, many together."""
    if len(names) > MAX_NAMED:
        yield READING.message(
            f"{len(names)} parameters are broken or reach past the end of the file, as"
            f" '{names[0]}': they were left out"
        )
        return
    for name in names:
        yield READING.message(
            f"parameter '{name}' is broken or reaches past the end of the file: it was left out"
        )


def _bytes_of(value: Value) -> int:
    """Return how many bytes a parameter's value takes."""
    return sum(map(len, value)) if isinstance(value, tuple) else value.nbytes


def _signed(byte: int) -> int:
    return byte - 256 if byte > 127 else byte


def _value(data: bytes, at: int, order: _Order) -> Value | None:
    """Read the value of a parameter.

    Parameters
    ----------
    data : the file
    at : index of the byte that states the parameter's type
    order : how numbers are written

    Returns
    -------
    texts, one per row of characters, or numbers of the file's shape with the first index fastest;
    None where the type is unknown or the file ends before the value
    """
    if at + 2 > len(data):
        return None
    kind = _signed(data[at])
    rank = data[at + 1]
    if rank > MAX_DIMENSIONS or kind not in BYTES_OF_KIND:
        return None
    start = at + 2 + rank
    shape = tuple(data[at + 2 : start])
    count = int(np.prod(shape, dtype=np.int64))
    size = count * BYTES_OF_KIND[kind]
    if size > MAX_SECTION:
        return None
    raw = data[start : start + size]
    if len(shape) < rank or len(raw) < size:
        return None
    if kind == CHARACTERS:
        return _rows(raw, width=shape[0] if shape else 1)
    return _numbers(raw, kind, order).reshape(shape or (1,), order="F")


def _rows(raw: bytes, width: int) -> tuple[str, ...]:
    """Cut characters into rows of a width; none where it is 0."""
    if width == 0:
        return ()
    count = len(raw) // width
    starts = range(0, count * width, width)
    return tuple(raw[start : start + width].decode("latin-1") for start in starts)


def _numbers(raw: bytes, kind: int, order: _Order) -> Array:
    """Read the numbers of a parameter, flat; of bytes, of 16-bit integers or of reals."""
    if kind == REALS:
        return order.floats(raw)
    if kind == INTEGERS:
        return order.ints(raw).astype(np.float64)
    return np.frombuffer(raw, dtype=np.int8).astype(np.float64)


@dataclass(frozen=True, kw_only=True)
class _FrameLayout:
    """Bytes of a frame: four numbers for each point, then the analog samples in order of time.

    Attributes
    ----------
    points : count
    channels : count of analog channels
    samples_per_frame : of each channel
    scale : of integer coordinates [file's unit of length]; negative where numbers are reals
    """

    points: int
    channels: int
    samples_per_frame: int
    scale: float

    @property
    def real(self) -> bool:
        """Whether numbers are 32-bit reals; a negative scale says so."""
        return self.scale < 0

    @property
    def size(self) -> int:
        """Count of bytes."""
        width = 4 if self.real else 2
        return (4 * self.points + self.channels * self.samples_per_frame) * width


def _samples(
    data: bytes,
    header: _Header,
    groups: Mapping[str, Mapping[str, Value]],
    order: _Order,
    remarks: list[Message],
    path: Path,
) -> RawC3d:
    """Read points and analog samples of every frame that the file holds.

    Parameters
    ----------
    data : the file
    header : counts, scale and position of the samples
    groups : parameters by group and name
    order : how numbers are written
    remarks : gets a warning for what was assumed, or where the file ends early
    path : of the file, for messages

    Returns
    -------
    points (frames, points, 3) in the file's unit, NaN where invalid; analog samples (samples,
    channels) with offset and scale applied

    Raises
    ------
    BadFile : the file holds no samples, or no whole frame
    """
    about = _without_samples(header, groups)
    about = _with_rotations(about, data, header, order)
    layout = _frame_layout(about, header, remarks)
    start = _data_start(about, header)
    if layout.size == 0 and about.rotations.size:
        return replace(about, events=header.events, remarks=tuple(remarks))
    if layout.size == 0 or start <= 0 or start >= len(data):
        raise BadFile(
            path, "holds neither points nor analog samples", "the recording may have been cut off"
        )
    layout = _with_used_channels(layout, about, header, len(data) - start)
    held = (len(data) - start) // layout.size
    claimed = _claimed_frames(about, header, held)
    frames = min(claimed, held)
    if frames < claimed:
        remarks.append(
            READING.message(
                f"the file ends early: it holds {frames} frames of {claimed}",
                severity="may change results",
            )
        )
    if frames <= 0:
        raise BadFile(path, "holds no whole frame", "the recording may have been cut off")

    raw = data[start : start + frames * layout.size]
    words = order.floats(raw) if layout.real else order.ints(raw).astype(np.float64)
    table = words.reshape(frames, -1)
    coordinate_words = table[:, : 4 * layout.points].reshape(frames, layout.points, 4)
    analog_words = table[:, 4 * layout.points :]
    samples = frames * layout.samples_per_frame
    points, residuals = _positions(coordinate_words, layout)
    rate = header.rate if 0 < header.rate < 1e6 else _first(about, "POINT", "RATE", 0.0)
    return RawC3d(
        groups=groups,
        first_frame=header.first,
        point_rate=rate,
        analog_rate=rate * layout.samples_per_frame,
        points=points,
        residuals=residuals,
        analog=_scaled(about, analog_words.reshape(samples, layout.channels), layout.real),
        rotations=about.rotations,
        rotation_rate=about.rotation_rate,
        events=header.events,
        remarks=tuple(remarks),
    )


def _with_rotations(about: RawC3d, data: bytes, header: _Header, order: _Order) -> RawC3d:
    """Add the poses of segments that the group ROTATION describes (Theia3D writes them).

    They stand behind points and analog samples: for each sample and segment a matrix (4, 4), column
    by column, and its reliability, below 0 where the segment was not seen; all as reals.

    Source: C3D.org, ROTATION group; ezc3d.

    Parameters
    ----------
    about : parameters of the file
    data : the file
    header : count of frames
    order : how numbers are written

    Returns
    -------
    the same with `rotations`, of as many whole samples as the file holds
    """
    count = int(_first(about, "ROTATION", "USED", 0.0))
    start = (int(_first(about, "ROTATION", "DATA_START", 0.0)) - 1) * BLOCK
    size = 4 * WORDS_OF_POSE * count
    if count <= 0 or not 0 < start < len(data):
        return about
    ratio = max(1, int(_first(about, "ROTATION", "RATIO", 1.0)))
    held = (len(data) - start) // size
    samples = min(held, ratio * max(0, _claimed_frames(about, header, held // ratio)))
    words = order.floats(data[start : start + samples * size])
    table = words.reshape(samples, count, WORDS_OF_POSE)
    poses = table[:, :, :16].reshape(samples, count, 4, 4).swapaxes(2, 3)
    finite = np.asarray(np.isfinite(poses).all(axis=(2, 3)))
    seen = finite & (table[:, :, 16] >= 0.0)
    rate = _first(about, "ROTATION", "RATE", ratio * header.rate)
    return replace(
        about, rotations=np.where(seen[:, :, None, None], poses, np.nan), rotation_rate=rate
    )


def _data_start(about: RawC3d, header: _Header) -> int:
    """Return the index of the samples' first byte, which is negative where it is not stated."""
    block = header.data_block or int(_first(about, "POINT", "DATA_START", 0))
    return (block - 1) * BLOCK


def _frame_layout(about: RawC3d, header: _Header, remarks: list[Message]) -> _FrameLayout:
    """Find how a frame is stored, by the header.

    Parameters
    ----------
    about : parameters are read
    header : counts and scale
    remarks : gets a warning where the header has no scale
    """
    per_frame = header.samples_per_frame
    scale = header.scale
    if not np.isfinite(scale) or scale == 0.0:
        scale = _first(about, "POINT", "SCALE", -1.0)
        remarks.append(
            READING.message("the header holds no point scale: the parameter POINT:SCALE was used")
        )
    return _FrameLayout(
        points=header.points,
        channels=header.analog_per_frame // per_frame if per_frame else 0,
        samples_per_frame=per_frame,
        scale=scale,
    )


def _with_used_channels(
    layout: _FrameLayout, about: RawC3d, header: _Header, held_bytes: int
) -> _FrameLayout:
    """Correct the count of channels where the header has it in the place of another number.

    Some programs write the number of channels where that of samples in a frame belongs. It is
    believed where the file then still holds all frames that it claims.

    Parameters
    ----------
    layout : by the header
    about : parameters are read
    header : count of analog samples in a frame, as written
    held_bytes : count of bytes from the first sample to the end of the file
    """
    used = int(_first(about, "ANALOG", "USED", 0.0))
    if not used == header.analog_per_frame > layout.channels:
        return layout
    larger = replace(layout, channels=used)
    claimed = _claimed_frames(about, header, held_bytes // layout.size)
    return larger if held_bytes // larger.size >= claimed else layout


def _positions(words: Array, layout: _FrameLayout) -> tuple[Array, Array]:
    """Read positions and residuals of points.

    Parameters
    ----------
    words : (frames, points, 4) as stored: x, y, z, and camera mask with residual
    layout : of the frames

    Returns
    -------
    positions (frames, points, 3) and residuals (frames, points) [file's unit of length]; NaN and
    -1 where a point is invalid
    """
    residuals = _residuals(words[:, :, 3], abs(layout.scale))
    factor = 1.0 if layout.real else layout.scale
    invalid = (residuals < 0)[:, :, None]
    return np.where(invalid, np.nan, words[:, :, :3] * factor), residuals


def _first(raw: RawC3d, group: str, name: str, default: float) -> float:
    """Return the first number of a parameter, the default where it is absent or not finite."""
    values = raw.numbers(group, name)
    return float(values[0]) if len(values) and np.isfinite(values[0]) else default


def _claimed_frames(about: RawC3d, header: _Header, held: int) -> int:
    """Return how many frames the file claims.

    The header has 16 bits for it, parameters of long files have more.

    Parameters
    ----------
    about : parameters are read
    header : numbers of the first and last frame
    held : frames that the bytes of the file would hold, where nothing else is stated
    """
    in_header = header.last - header.first + 1
    header_full = header.last == 65535
    first = about.numbers("TRIAL", "ACTUAL_START_FIELD")
    last = about.numbers("TRIAL", "ACTUAL_END_FIELD")
    if len(first) == 2 and len(last) == 2:
        count = _long_number(last) - _long_number(first) + 1
        if 0 < count < 2**31 and (header_full or count == in_header):
            return int(count)
    if header_full:
        return int(_first(about, "POINT", "LONG_FRAMES", 0.0)) or held
    return in_header


def _long_number(halves: Array) -> float:
    """Join a frame's number of two 16-bit halves, the lower one first; it may be signed."""
    low, high = halves
    return low % 65536 + 65536 * high


def _residuals(words: Array, scale: float) -> Array:
    """Read the residual of each point: the low byte of its fourth word, scaled.

    Parameters
    ----------
    words : (frames, points) fourth word of each point
    scale : of a unit of residual [file's unit of length], above 0

    Returns
    -------
    (frames, points) [file's unit of length], -1 where the point is invalid
    """
    whole = np.where(np.isfinite(words), words, -1.0)
    whole = np.clip(np.rint(whole), -1.0, 32767.0).astype(np.int64)
    return np.where(whole < 0, -1.0, (whole & 0xFF) * scale)


def _scaled(about: RawC3d, words: Array, real: bool) -> Array:
    """Apply offset and scale to analog samples.

    The value is (word - offset) * scale * general scale.

    Parameters
    ----------
    about : parameters are read
    words : (samples, channels) as stored, integers taken as signed
    real : whether samples are reals

    Returns
    -------
    (samples, channels) in the channels' units
    """
    unsigned = any(text.upper().startswith("UNSIGNED") for text in about.texts("ANALOG", "FORMAT"))
    if unsigned and not real:
        words = np.where(words < 0.0, words + 65536.0, words)
    channels = words.shape[1]
    scale = np.ones(channels)
    stated_scale = about.numbers("ANALOG", "SCALE")[:channels]
    scale[: len(stated_scale)] = stated_scale
    offset = np.zeros(channels)
    stated_offset = _offsets(about, unsigned, real)[:channels]
    offset[: len(stated_offset)] = stated_offset
    general_scale = _first(about, "ANALOG", "GEN_SCALE", 1.0)
    return (words - offset) * (scale * general_scale)


def _offsets(about: RawC3d, unsigned: bool, real: bool) -> Array:
    """Read the offsets of analog channels, which signed parameters hold; empty where none are."""
    stated = about.numbers("ANALOG", "OFFSET")
    if not len(stated):
        stated = about.numbers("ANALOG", "OFFSETS")
    if unsigned:
        return np.where(stated < 0, stated + 65536, stated)
    if real:
        # The middle of an unsigned 16-bit converter, which a signed parameter cannot hold.
        return np.where(stated == -32768, 32768, stated)
    return stated
