"""Files made wrong: bytes and words changed, taken out, doubled, exchanged with another file's."""

from __future__ import annotations

import random
import re
import struct
from collections.abc import Callable, Sequence

WORD = re.compile(rb"[+-]?\d+\.?\d*(?:[eE][+-]?\d+)?|[A-Za-z_][\w./-]*")
NUMBERS = (
    b"0", b"-0", b"-1", b"1", b"2", b"7", b"nan", b"NaN(ind)", b"inf", b"-Infinity", b"1e308", b"-1e309", b"5e-324",
    b"2147483648", b"-9223372036854775809", b"99999999999999999999999", b"1e9", b"1000000", b"0x10", b"1,5", b"1_0",
    b"1e", b"--1", b".", b"", b"true", b"\xd9\xa3", b"1e400000", b"0.1d-3", b"[]", b"{}", b"null", b'"a"',
)  # fmt: skip
PIECES = (
    b"\0", b"\xef\xbb\xbf", b"\xff\xfe", b"\xe2\x80\xa8", b"\x85", b"\x1c", b"\r", b"\n\n", b"\t\t\t", b",,,", b";",
    b'"', b"'", b"<", b"</", b"/>", b"&", b"&#0;", b"&#x110000;", b"<![CDATA[", b"]]>", b"<!--", b"[[", b"]]", b"=",
    b"{", b"}", b"#", b"..", b"../../../../etc/passwd", b"/dev/null", b"C:\\con", b"%s%n", b"{0}", b"$(", b"*", b"?",
    b"\xf0\x9f\xa6\xb4", b"\xcc\x81", b"e" * 300, b"9" * 5000, b"(" * 300, b"[" * 2000, b"a: &a [*a]", b"!!python/x",
)  # fmt: skip
MOST = 1 << 17


def mutate(data: bytes, others: Sequence[bytes], chance: random.Random) -> bytes:
    """A file made wrong in one to eight places."""
    for _ in range(chance.choice((1, 1, 1, 2, 2, 3, 4, 8))):
        data = chance.choice(WAYS)(data, others, chance)[:MOST]
    return data


def _bit(data: bytes, _: Sequence[bytes], chance: random.Random) -> bytes:
    changed = bytearray(data or b"\0")
    changed[chance.randrange(len(changed))] ^= 1 << chance.randrange(8)
    return bytes(changed)


def _value(data: bytes, _: Sequence[bytes], chance: random.Random) -> bytes:
    """A number of some size in place of bytes, in either order: binary headers count with them."""
    order = chance.choice("<>")
    number = chance.choice((0, 1, 2, 127, 128, 255, 256, 32767, 32768, 65535, 2**24, 2**31 - 1, 2**31, 2**32 - 1))
    kinds = {"B": number & 0xFF, "H": number & 0xFFFF, "I": number & 0xFFFFFFFF, "Q": number << chance.choice((0, 31))}
    kind = chance.choice([*kinds, "f", "d"])
    odd = chance.choice((float("nan"), float("inf"), -1.0, 0.0, 1e30))
    put = struct.pack(order + kind, kinds.get(kind, odd))
    at = chance.randrange(len(data) + 1)
    return data[:at] + put + data[at + len(put) :]


def _number(data: bytes, _: Sequence[bytes], chance: random.Random) -> bytes:
    found = [one for one in WORD.finditer(data[:MOST]) if one.group()[:1] in b"+-0123456789"]
    return _replaced(data, found, lambda: chance.choice(NUMBERS), chance)


def _word(data: bytes, others: Sequence[bytes], chance: random.Random) -> bytes:
    words = [one.group() for one in WORD.finditer(chance.choice(others)[:MOST])] if others else []
    return _replaced(data, list(WORD.finditer(data[:MOST])), lambda: chance.choice(words or [b""]), chance)


def _replaced(data: bytes, found: list[re.Match[bytes]], make: Callable[[], bytes], chance: random.Random) -> bytes:
    if not found:
        return data
    one = chance.choice(found)
    return data[: one.start()] + make() + data[one.end() :]


def _piece(data: bytes, _: Sequence[bytes], chance: random.Random) -> bytes:
    at = chance.randrange(len(data) + 1)
    return data[:at] + chance.choice(PIECES) + data[at + chance.choice((0, 0, 1, 5)) :]


def _cut(data: bytes, _: Sequence[bytes], chance: random.Random) -> bytes:
    return data[: chance.randrange(len(data) + 1)]


def _without(data: bytes, _: Sequence[bytes], chance: random.Random) -> bytes:
    start, stop = _span(data, chance)
    return data[:start] + data[stop:]


def _again(data: bytes, _: Sequence[bytes], chance: random.Random) -> bytes:
    start, stop = _span(data, chance)
    return data[:stop] + data[start:stop] * chance.choice((1, 1, 2, 50)) + data[stop:]


def _lines(data: bytes, _: Sequence[bytes], chance: random.Random) -> bytes:
    lines = data.split(b"\n")
    at, to = chance.randrange(len(lines)), chance.randrange(len(lines))
    way = chance.randrange(3)
    if way == 0:
        del lines[at]
    elif way == 1:
        lines.insert(to, lines[at])
    else:
        lines[at], lines[to] = lines[to], lines[at]
    return b"\n".join(lines)


def _elements(data: bytes, _: Sequence[bytes], chance: random.Random) -> bytes:
    """A whole element of XML taken out, doubled, or put inside another."""
    tags = list(re.finditer(rb"<(\w+)[^<>]*>", data[:MOST]))
    if not tags:
        return data
    one = chance.choice(tags)
    end = data.find(b"</" + one.group(1) + b">", one.end())
    end = one.end() if one.group().endswith(b"/>") or end < 0 else end + len(one.group(1)) + 3
    element, rest = data[one.start() : end], data[: one.start()] + data[end:]
    way = chance.randrange(3)
    if way == 0:
        return rest
    other = chance.choice(tags).end()
    return data[:other] + element + data[other:] if way == 1 else rest[:other] + element + rest[other:]


def _other(data: bytes, others: Sequence[bytes], chance: random.Random) -> bytes:
    """The beginning of one file and the end of another."""
    other = chance.choice(others) if others else data
    return data[: chance.randrange(len(data) + 1)] + other[chance.randrange(len(other) + 1) :]


def _span(data: bytes, chance: random.Random) -> tuple[int, int]:
    start = chance.randrange(len(data) + 1)
    return start, min(start + chance.choice((1, 2, 4, 16, 64, 512, 4096)), len(data))


WAYS = (
    _bit, _value, _value, _number, _number, _number, _word, _word, _piece, _piece, _cut, _without, _again, _lines,
    _elements, _elements, _other,
)  # fmt: skip
