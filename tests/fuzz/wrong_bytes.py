"""Whole files made wrong, as a Hypothesis strategy.

Parts are taken out, doubled, moved, or replaced by something odd. A part is some bytes, a number, a
word, a line, an element of XML or all that follows; Hypothesis chooses the file, the parts and what
happens to each.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Sequence
from typing import Any

from hypothesis import strategies as st

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
    "number": re.compile(rb"[+-]?\d+\.?\d*(?:[eE][+-]?\d+)?"),
    "word": re.compile(rb"[A-Za-z_][\w./-]*"),
    "line": re.compile(rb"[^\n]+\n?"),
    "element": re.compile(rb"<(\w+)[^<>]*>"),
}
MAX_BYTES = 1 << 17


@st.composite
def wrong_files(draw: st.DrawFn, files: Sequence[bytes]) -> bytes:
    """One of some whole files, made wrong in one to eight places."""
    data = draw(st.sampled_from(files))
    for _ in range(draw(st.sampled_from((1, 1, 1, 2, 2, 3, 4, 8)))):
        start, stop = draw(_part(data))
        odd = draw(st.sampled_from(CHANGES))(draw, data, start, stop, files)
        data = (data[:start] + odd + data[stop:])[:MAX_BYTES]
    return data


@st.composite
def _part(draw: st.DrawFn, data: bytes) -> tuple[int, int]:
    """Where a part of the file begins and ends."""
    kind = draw(
        st.sampled_from(
            ("bytes", "bytes", "number", "number", "number", "element", "element", *PARTS, "rest")
        )
    )
    parts = list(PARTS[kind].finditer(data)) if kind in PARTS else []
    if not parts:
        start = draw(st.integers(0, len(data)))
        return start, len(data) if kind == "rest" else start + draw(
            st.sampled_from((0, 1, 2, 4, 16, 64, 512, 4096))
        )
    part = draw(st.sampled_from(parts))
    closing = data.find(b"</" + part.group(1) + b">", part.end()) if kind == "element" else -1
    return part.start(), part.end() if closing < 0 else data.index(b">", closing) + 1


def _odd(draw: st.DrawFn, *_: Any) -> bytes:
    return draw(st.sampled_from(NUMBERS + PIECES))


def _size(draw: st.DrawFn, *_: Any) -> bytes:
    """Draw a number of some size in either byte order: binary headers count with them."""
    form = draw(st.sampled_from(("<B", "<H", ">H", "<I", ">I", "<Q", ">Q")))
    size = draw(st.sampled_from(SIZES))
    return struct.pack(form, size % 256 ** struct.calcsize(form))


def _value(draw: st.DrawFn, *_: Any) -> bytes:
    form = draw(st.sampled_from(("<f", ">f", "<d", ">d")))
    return struct.pack(form, draw(st.sampled_from((float("nan"), float("inf"), -1.0, 0.0, 1e30))))


def _flipped(draw: st.DrawFn, data: bytes, start: int, stop: int, _: Any) -> bytes:
    bits = 1 << draw(st.integers(0, 7))
    return bytes([data[start] ^ bits]) + data[start + 1 : stop] if data[start:stop] else b""


def _nothing(*_: Any) -> bytes:
    return b""


def _again(draw: st.DrawFn, data: bytes, start: int, stop: int, _: Any) -> bytes:
    return data[start:stop] * draw(st.sampled_from((2, 2, 3, 51)))


def _before_another(draw: st.DrawFn, data: bytes, start: int, stop: int, _: Any) -> bytes:
    """Return the part, and before it another of the same file."""
    other, end = draw(_part(data))
    return data[other:end] + data[start:stop]


def _of_other(
    draw: st.DrawFn, _data: bytes, _start: int, _stop: int, files: Sequence[bytes]
) -> bytes:
    """Return a part of any of the files."""
    other = draw(st.sampled_from(files))
    start, stop = draw(_part(other))
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
