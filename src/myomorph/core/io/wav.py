"""WAV files (RIFF/WAVE) to sound: integers of 8 to 32 bits and floats, any number of channels."""

from __future__ import annotations

import os
import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from myomorph.core.io.parsing.door import mapped_bytes
from myomorph.core.model.causes import READING
from myomorph.core.model.errors import BadFile
from myomorph.core.model.series import Sound

LARGEST = 4 << 30  # Bytes of samples, in single precision, that are read at most.
MAX_CHANNELS = 256
MAX_CHUNKS = 1 << 16  # Before the samples: a recorder writes a handful.
RATES = (1_000, 1_000_000)
HINT = "expected a RIFF/WAVE file: export the recording as WAV, PCM or float"

# Sizes of samples that a recorder leaves which is switched off while it writes.
UNFINISHED = (0, 0xFFFFFFFF)
_INTEGER = 1
_FLOAT = 3
_EXTENSIBLE = 0xFFFE
_CODECS = {2: "ADPCM", 6: "A-law", 7: "mu-law", 17: "IMA ADPCM", 85: "MP3"}
_KINDS = {(_INTEGER, 8), (_INTEGER, 16), (_INTEGER, 24), (_INTEGER, 32), (_FLOAT, 32), (_FLOAT, 64)}


@dataclass(frozen=True)
class _Format:
    """Format of the samples, by the chunk `fmt `.

    Attributes
    ----------
    kind : code of the format, 1 for integers and 3 for reals
    channels : their count
    rate : samples per second [Hz]
    bits : of each sample
    """

    kind: int
    channels: int
    rate: int
    bits: int

    @property
    def frame(self) -> int:
        """Bytes of one sample of all channels."""
        return self.channels * self.bits // 8


def read_wav(path: str | os.PathLike[str], start: float = 0.0) -> Sound:
    """Read a WAV file; channels are named "1", "2", ... as the recorder's inputs.

    A file whose header promises more than it holds (a recording that was cut off) is read as far as
    it goes, with a warning.

    Parameters
    ----------
    path : of the file
    start : time of the first sample on the motion's clock [s]

    Returns
    -------
    samples (samples, channels) as a fraction of full scale; `warnings` say what was assumed

    Raises
    ------
    BadFile : it cannot be read, is no such file, holds samples in another format, none, or too many
    """
    path = Path(path)
    data = mapped_bytes(path, "sound")
    facts, first, promised = _chunks(data, path)
    warnings = []
    if promised in UNFINISHED:
        promised = len(data) - first
        warnings.append(
            READING.message(
                "the recorder never wrote how long the sound is; taken to the file's end"
            )
        )
    there = min(promised, len(data) - first)
    count = there // facts.frame
    if there < promised:
        warnings.append(
            READING.message(
                f"the file ends after {count / facts.rate:.3f} of"
                f" {promised / facts.frame / facts.rate:.3f} s"
            )
        )
    if count == 0:
        raise BadFile(path, "holds no samples", HINT)
    if 4 * count * facts.channels > LARGEST:
        raise BadFile(
            path,
            f"holds {count} samples of {facts.channels} channels, too many to read at once",
            "cut it",
        )
    samples = _decoded(data[first : first + count * facts.frame], facts)
    if not np.isfinite(samples).all():
        warnings.append(READING.message("some samples are not finite; taken as silence"))
        samples = np.nan_to_num(samples, nan=0.0, posinf=0.0, neginf=0.0)
    names = tuple(str(index + 1) for index in range(facts.channels))
    return Sound(
        rate=float(facts.rate),
        names=names,
        samples=samples,
        start=start,
        warnings=tuple(warnings),
        source=str(path),
    )


def _chunks(data: np.ndarray, path: Path) -> tuple[_Format, int, int]:
    """Find the format and the samples of a WAV file.

    Parameters
    ----------
    data : (bytes,) of the file
    path : of the file, for messages

    Returns
    -------
    format, index of the samples' first byte, and how many bytes of them the header promises

    Raises
    ------
    BadFile : it is no such file, lacks the chunk of the format, or that of the samples among its
        first ones
    """
    magic = bytes(data[:4])
    if magic in (b"RF64", b"RIFX", b"FORM"):
        raise BadFile(path, f"is a {magic.decode()} file, which is not read", HINT)
    if magic != b"RIFF" or bytes(data[8:12]) != b"WAVE":
        raise BadFile(path, "is empty" if not len(data) else "is no WAV file", HINT)
    facts: _Format | None = None
    at = 12
    for _ in range(MAX_CHUNKS):
        if at + 8 > len(data):
            break
        name, size = struct.unpack("<4sI", bytes(data[at : at + 8]))
        at += 8
        if name == b"fmt ":
            facts = _format(bytes(data[at : at + size]), path)
        elif name == b"data":
            if facts is None:
                raise BadFile(path, "has samples before the chunk 'fmt ' that explains them", HINT)
            return facts, at, size
        # Chunks of odd size are followed by a byte of padding.
        at += size + size % 2
    raise BadFile(path, "has no samples: its chunk 'data' is missing", HINT)


def _format(raw: bytes, path: Path) -> _Format:
    """Read the chunk `fmt `; `BadFile` where the samples have a format that is not read."""
    if len(raw) < 16:
        raise BadFile(path, f"its chunk 'fmt ' has {len(raw)} bytes instead of 16 or more", HINT)
    kind, channels, rate, _, block, bits = struct.unpack("<HHIIHH", raw[:16])
    if kind == _EXTENSIBLE and len(raw) >= 26:
        (kind,) = struct.unpack("<H", raw[24:26])
    if (kind, bits) not in _KINDS:
        what = _CODECS.get(kind, {_INTEGER: "integers", _FLOAT: "floats"}.get(kind, f"code {kind}"))
        raise BadFile(path, f"holds samples as {what} of {bits} bits", HINT)
    if not 1 <= channels <= MAX_CHANNELS or not RATES[0] <= rate <= RATES[1]:
        raise BadFile(path, f"says {channels} channels at {rate} Hz", HINT)
    if block != channels * bits // 8:
        raise BadFile(path, f"says {block} bytes for {channels} channels of {bits} bits", HINT)
    return _Format(kind, channels, rate, bits)


def _decoded(raw: np.ndarray, facts: _Format) -> np.ndarray:
    """Convert samples to fractions of full scale.

    Parameters
    ----------
    raw : (bytes,) of whole samples
    facts : their format

    Returns
    -------
    (samples, channels) in single precision, integers between -1 and 1
    """
    if facts.kind == _FLOAT:
        values = raw.view(f"<f{facts.bits // 8}").astype(np.float32)
    elif facts.bits == 8:
        values = (raw.astype(np.float32) - 128.0) / 128.0
    elif facts.bits == 24:
        wide = np.zeros((len(raw) // 3, 4), np.uint8)
        wide[:, 1:] = raw.reshape(-1, 3)
        values = wide.view("<i4")[:, 0].astype(np.float32) / np.float32(1 << 31)
    else:
        values = raw.view(f"<i{facts.bits // 8}").astype(np.float32) / np.float32(
            1 << (facts.bits - 1)
        )
    return values.reshape(-1, facts.channels)
