"""Whole files made wrong.

Parts are taken out, doubled, moved, or replaced by something odd. A part is some bytes, a number, a
word, a line, an element of XML or all that follows. The file, the parts and what happens to each
are chosen at random, or by bytes that a fuzzer provides.
"""

from __future__ import annotations

import random
import re
import struct
import zlib
from collections.abc import Callable, Sequence
from typing import Any, Protocol, TypeVar

T = TypeVar("T")

NUMBERS = (
    b"0",
    b"-0",
    b"-1",
    b"1",
    b"2",
    b"7",
    b"nan",
    b"NaN(ind)",
    b"inf",
    b"-Infinity",
    b"1e308",
    b"-1e309",
    b"5e-324",
    b"2147483648",
    b"-9223372036854775809",
    b"99999999999999999999999",
    b"1e9",
    b"1000000",
    b"0x10",
    b"1,5",
    b"1_0",
    b"1e",
    b"--1",
    b".",
    b"",
    b"true",
    b"\xd9\xa3",
    b"1e400000",
    b"0.1d-3",
    b"[]",
    b"{}",
    b"null",
    b'"a"',
)
PIECES = (
    b"\0",
    b"\xef\xbb\xbf",
    b"\xff\xfe",
    b"\xe2\x80\xa8",
    b"\x85",
    b"\x1c",
    b"\r",
    b"\n\n",
    b"\t\t\t",
    b",,,",
    b";",
    b'"',
    b"'",
    b"<",
    b"</",
    b"/>",
    b"&",
    b"&#0;",
    b"&#x110000;",
    b"<![CDATA[",
    b"]]>",
    b"<!--",
    b"[[",
    b"]]",
    b"=",
    b"{",
    b"}",
    b"#",
    b"..",
    b"../../../../etc/passwd",
    b"/dev/null",
    b"C:\\con",
    b"%s%n",
    b"{0}",
    b"$(",
    b"*",
    b"?",
    b"\xf0\x9f\xa6\xb4",
    b"\xcc\x81",
    b"e" * 300,
    b"9" * 5000,
    b"(" * 300,
    b"[" * 2000,
    b"a: &a [*a]",
    b"!!python/x",
)
SIZES = (0, 1, 2, 127, 128, 255, 256, 32767, 32768, 65535, 2**24, 2**31 - 1, 2**31, 2**32 - 1)
PARTS = {
    "number": re.compile(rb"(?<![\d.+-])[+-]?\d+\.?\d*(?:[eE][+-]?\d+)?"),
    "word": re.compile(rb"(?<![\w./-])[A-Za-z_][\w./-]*"),
    "line": re.compile(rb"^[^\n]+\n?", re.MULTILINE),
    "element": re.compile(rb"<(\w+)[^<>]*>"),
}
KINDS = ("bytes", "bytes", "number", "number", "number", "element", "element", *PARTS, "rest")
LENGTHS = (0, 1, 2, 4, 16, 64, 512, 4096)
MAX_BYTES = 1 << 17
MAX_CHOICES = 256
"""Bytes that choose: about what eight changes take."""


class Choices(Protocol):
    """What chooses how a file is made wrong."""

    def one_of(self, values: Sequence[T]) -> T:
        """Choose one of some values."""
        ...

    def integer(self, largest: int) -> int:
        """Choose a whole number from 0 to `largest`."""
        ...


class RandomChoices:
    """Choices at random, the same ones for a seed."""

    def __init__(self, seed: int):
        self._random = random.Random(seed)

    def one_of(self, values: Sequence[T]) -> T:
        """Choose one of some values."""
        return self._random.choice(values)

    def integer(self, largest: int) -> int:
        """Choose a whole number from 0 to `largest`."""
        return self._random.randint(0, largest)


class ProvidedChoices(RandomChoices):
    """Choices that bytes of a fuzzer make; where they have run out, at random by these bytes."""

    def __init__(self, data: bytes):
        super().__init__(zlib.crc32(data))
        self._data = data
        self._used = 0

    def one_of(self, values: Sequence[T]) -> T:
        """Choose one of some values."""
        return values[self.integer(len(values) - 1)]

    def integer(self, largest: int) -> int:
        """Choose a whole number from 0 to `largest`."""
        size = (largest.bit_length() + 7) // 8
        part = self._data[self._used : self._used + size]
        self._used += size
        if len(part) < size:
            return super().integer(largest)
        return int.from_bytes(part, "little") % (largest + 1)


def wrong_file(choices: Choices, files: Sequence[bytes]) -> bytes:
    """Make one of some whole files wrong in one to eight places."""
    data = choices.one_of(files)
    for _ in range(choices.one_of((1, 1, 1, 2, 2, 3, 4, 8))):
        start, stop = _part(choices, data)
        odd = choices.one_of(CHANGES)(choices, data, start, stop, files)
        data = (data[:start] + odd + data[stop:])[:MAX_BYTES]
    return data


def _part(choices: Choices, data: bytes) -> tuple[int, int]:
    """Choose a part of a file, the first of its kind from a place on: its begin and end."""
    kind = choices.one_of(KINDS)
    start = choices.integer(len(data))
    pattern = PARTS.get(kind)
    part = pattern and (pattern.search(data, start) or pattern.search(data))
    if not part:
        return start, len(data) if kind == "rest" else start + choices.one_of(LENGTHS)
    closing = data.find(b"</" + part.group(1) + b">", part.end()) if kind == "element" else -1
    return part.start(), part.end() if closing < 0 else data.index(b">", closing) + 1


def _odd(choices: Choices, *_: Any) -> bytes:
    return choices.one_of(NUMBERS + PIECES)


def _size(choices: Choices, *_: Any) -> bytes:
    """Draw a number of some size in either byte order: binary headers count with them."""
    form = choices.one_of(("<B", "<H", ">H", "<I", ">I", "<Q", ">Q"))
    size = choices.one_of(SIZES)
    return struct.pack(form, size % 256 ** struct.calcsize(form))


def _value(choices: Choices, *_: Any) -> bytes:
    form = choices.one_of(("<f", ">f", "<d", ">d"))
    return struct.pack(form, choices.one_of((float("nan"), float("inf"), -1.0, 0.0, 1e30)))


def _flipped(choices: Choices, data: bytes, start: int, stop: int, _: Any) -> bytes:
    bits = 1 << choices.integer(7)
    return bytes([data[start] ^ bits]) + data[start + 1 : stop] if data[start:stop] else b""


def _nothing(*_: Any) -> bytes:
    return b""


def _again(choices: Choices, data: bytes, start: int, stop: int, _: Any) -> bytes:
    return data[start:stop] * choices.one_of((2, 2, 3, 51))


def _before_another(choices: Choices, data: bytes, start: int, stop: int, _: Any) -> bytes:
    """Return the part, and before it another of the same file."""
    other, end = _part(choices, data)
    return data[other:end] + data[start:stop]


def _of_other(
    choices: Choices, _data: bytes, _start: int, _stop: int, files: Sequence[bytes]
) -> bytes:
    """Return a part of any of the files."""
    other = choices.one_of(files)
    start, stop = _part(choices, other)
    return other[start:stop]


CHANGES: tuple[Callable[..., bytes], ...] = (
    _odd,
    _odd,
    _odd,
    _size,
    _value,
    _flipped,
    _nothing,
    _nothing,
    _again,
    _before_another,
    _of_other,
    _of_other,
)
