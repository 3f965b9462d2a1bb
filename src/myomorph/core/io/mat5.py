"""MATLAB files of version 5: structures, cells, texts and numbers, each read when it is asked for.

Nothing is allocated that the file does not hold, and what nobody asks for is passed over. Source:
MathWorks, MAT-File Format, version 5.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.frozen_map import FrozenMap

HEADER = 128  # Bytes; the last two state the byte order.
TAG = 8  # Bytes of type and size before each element.
MATRIX = 14
COMPRESSED = 15
CELL = 1
STRUCTURE = 2
TEXT = 4
FIRST_NUMBER = 6  # Classes of numbers, from double to uint64.
LAST_NUMBER = 15
MAX_PARTS = 1 << 20  # Of a file, an array or a structure.
MAX_UNPACKED = 1 << 30  # Bytes that a file may hold once it is unpacked.
STEP = 1 << 24
TYPES = FrozenMap(
    {
        1: "i1",
        2: "u1",
        3: "i2",
        4: "u2",
        5: "i4",
        6: "u4",
        7: "f4",
        9: "f8",
        12: "i8",
        13: "u8",
    }
)
"""Types of numbers, as NumPy names them."""
ENCODINGS = FrozenMap({1: "latin-1", 2: "latin-1", 4: "utf-16", 16: "utf-8", 17: "utf-16"})
"""Of characters, by the type of their codes."""


@dataclass(frozen=True)
class Element:
    """A part of a file.

    Attributes
    ----------
    kind : number of its type
    content : its bytes
    order : of bytes, "<" or ">"
    """

    kind: int
    content: memoryview
    order: str

    def parts(self) -> Iterator[Element]:
        """Yield the elements within.

        Raises
        ------
        ValueError : one is longer than what is left
        """
        yield from _elements(self.content, self.order)

    def numbers(self) -> Array:
        """Read numbers.

        Returns
        -------
        (numbers,)

        Raises
        ------
        ValueError : it has none
        """
        if self.kind not in TYPES:
            raise ValueError(f"type {self.kind} is not numeric")
        return np.frombuffer(self.content, self.order + TYPES[self.kind])


class Matrix:
    """An array of MATLAB: of numbers, characters, cells, or a structure.

    Parameters
    ----------
    element : of the type of matrices

    Raises
    ------
    ValueError : its head is damaged
    """

    def __init__(self, element: Element):
        parts = element.parts()
        flags = next(parts, None)
        shape = next(parts, None)
        name = next(parts, None)
        if element.kind != MATRIX or flags is None or shape is None or name is None:
            raise ValueError("an array has no head")
        words = flags.numbers().tolist()
        self.kind = int(words[0]) & 0xFF if words else 0
        self.shape = tuple(int(size) for size in shape.numbers().tolist())
        self.name = bytes(name.content).decode("latin-1")
        self._parts = parts
        self._order = element.order
        if any(size < 0 for size in self.shape):
            raise ValueError("an array has a negative size")

    @property
    def size(self) -> int:
        """Count of entries."""
        return math.prod(self.shape)

    @cached_property
    def _rest(self) -> tuple[Element, ...]:
        """Elements behind the head."""
        return tuple(self._parts)

    def field(self, name: str) -> Matrix | None:
        """Return a field of a structure of one entry; None where there is none, or it is empty.

        Raises
        ------
        ValueError : it is damaged
        """
        element = self._fields.get(name)
        if element is None or not len(element.content):
            return None
        value = Matrix(element)
        return value if value.size else None

    @cached_property
    def _fields(self) -> Mapping[str, Element]:
        if self.kind != STRUCTURE or self.size != 1 or len(self._rest) < 2:
            return {}
        lengths = self._rest[0].numbers()
        width = int(lengths[0]) if len(lengths) else 0
        if width <= 0:
            return {}
        text = bytes(self._rest[1].content)
        starts = range(0, len(text), width)
        names = [text[at : at + width].split(b"\0")[0].decode("latin-1") for at in starts]
        return dict(zip(names, self._rest[2:], strict=False))

    def values(self) -> Array:
        """Read numbers.

        Returns
        -------
        of the array's shape; of complex numbers the real part

        Raises
        ------
        ValueError : it holds none, or other than its shape
        """
        if not FIRST_NUMBER <= self.kind <= LAST_NUMBER or not self._rest:
            raise ValueError("holds no numbers")
        numbers = self._rest[0].numbers()
        if len(numbers) != self.size:
            raise ValueError(f"holds {len(numbers)} numbers, where {self.size} are expected")
        return numbers.reshape(self.shape, order="F")

    def text(self) -> str:
        """Read characters, "" where it holds none."""
        if self.kind != TEXT or not self._rest:
            return ""
        encoding = ENCODINGS.get(self._rest[0].kind, "latin-1")
        if encoding == "utf-16":
            encoding += "-le" if self._order == "<" else "-be"
        return bytes(self._rest[0].content).decode(encoding, "replace")

    def texts(self) -> list[str]:
        """Read the texts of cells, or the only one.

        Raises
        ------
        ValueError : a cell is damaged
        """
        if self.kind != CELL:
            return [self.text()]
        return [Matrix(element).text() for element in self._rest[: self.size]]


def arrays_of(data: np.ndarray) -> Iterator[Matrix]:
    """Yield the arrays of a file, one for each variable.

    Parameters
    ----------
    data : (bytes,) of the file

    Yields
    ------
    arrays in the file's order

    Raises
    ------
    ValueError : it is of another kind, cut off, damaged, or larger than `MAX_UNPACKED` once it is
        unpacked
    """
    mark = bytes(data[HEADER - 2 : HEADER])
    if mark not in (b"IM", b"MI"):
        raise ValueError("is not a MATLAB file of version 5")
    order = "<" if mark == b"IM" else ">"
    unpacked = 0
    # All of them first, so that a file that was cut off is never read in part.
    elements = list(_elements(data.data[HEADER:], order, is_whole=True))
    for element in elements:
        found = element
        if element.kind == COMPRESSED:
            content = _unpacked(element.content, MAX_UNPACKED - unpacked)
            unpacked += len(content)
            inner = next(_elements(memoryview(content), order), None)
            if inner is None:
                continue
            found = inner
        if found.kind == MATRIX:
            yield Matrix(found)


def _elements(content: memoryview, order: str, is_whole: bool = False) -> Iterator[Element]:
    """Yield the elements of a part one behind the other.

    Parameters
    ----------
    content : of the part
    order : of bytes, "<" or ">"
    is_whole : whether no byte may be left over

    Raises
    ------
    ValueError : an element is cut off, or there are more than `MAX_PARTS`
    """
    at = 0
    count = 0
    while at + TAG <= len(content):
        count += 1
        if count > MAX_PARTS:
            raise ValueError(f"has more than {MAX_PARTS} parts beside each other")
        kind, size = struct.unpack(f"{order}II", content[at : at + TAG])
        begin = at + TAG
        if kind >> 16:
            # Size and at most four bytes stand in the tag itself.
            size = kind >> 16
            kind &= 0xFFFF
            begin = at + TAG // 2
            end = at + TAG
        else:
            end = begin + size
            if kind != COMPRESSED:
                end += -size % TAG
        if begin + size > len(content):
            raise ValueError("ends early: it was cut off or is damaged")
        yield Element(kind, content[begin : begin + size], order)
        at = end
    if is_whole and at < len(content):
        raise ValueError("ends early: it was cut off or is damaged")


def _unpacked(content: memoryview, largest: int) -> bytes:
    """Unpack an element.

    Raises
    ------
    ValueError : it is damaged, or larger
    """
    stream = zlib.decompressobj()
    parts: list[bytes] = []
    size = 0
    rest: Any = content
    try:
        while len(rest) and not stream.eof:
            part = stream.decompress(rest, STEP)
            size += len(part)
            if size > largest:
                raise ValueError(f"holds more than {MAX_UNPACKED >> 30} GB once unpacked")
            parts.append(part)
            rest = stream.unconsumed_tail
    except zlib.error:
        raise ValueError("a part of it cannot be unpacked") from None
    return b"".join(parts)
