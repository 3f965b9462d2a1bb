"""Pictures as PNG text: colors from values, and the encoding."""

from __future__ import annotations

import base64
import struct
import zlib

import numpy as np
from numpy.typing import NDArray

from myomorph.core.model.arrays import Array

Bytes = NDArray[np.uint8]

_HEAT = (
    "#f7f5ef",
    "#fbe3b6",
    "#fdc57d",
    "#f89d5b",
    "#ea6d4e",
    "#cc4350",
    "#9c2b5e",
    "#64215f",
    "#2b1543",
)
_LEVEL = ("#b5485d", "#d98c4a", "#d9c05a", "#6fa887", "#2f6f8f")
_ACTIVATION = ("#4477b6", "#7a86b8", "#a586a8", "#c4708a", "#d64f60", "#d7262f")


def _ramp(colors: tuple[str, ...], steps: int = 256) -> Bytes:
    anchors = np.array(
        [[int(color[i : i + 2], 16) for i in (1, 3, 5)] for color in colors], dtype=np.float64
    )
    at = np.linspace(0.0, len(colors) - 1.0, steps)
    table = np.stack(
        [np.interp(at, np.arange(len(colors)), anchors[:, i]) for i in range(3)], axis=1
    )
    return table.round().astype(np.uint8)


def _distinct(table: Bytes) -> Bytes:
    """Nudge colors until no two are equal, so that a color names its value."""
    seen: set[tuple[int, int, int]] = set()
    for row in table:
        while tuple(int(value) for value in row) in seen:
            row[2] = row[2] - 1 if row[2] > 0 else 255
        seen.add((int(row[0]), int(row[1]), int(row[2])))
    return table


HEAT = _distinct(_ramp(_HEAT))  # (256, 3) colors of a heat map, light to dark.
# (256, 3) colors of a muscle from rest (blue) to full activation (red).
ACTIVATION = _ramp(_ACTIVATION)
# (256, 3) colors of how well a link is identified, from red (nothing) over yellow to blue (all).
LEVEL = _ramp(_LEVEL)


def level_color(values: Array) -> Array:
    """Color levels of identification.

    Parameters
    ----------
    values : (...) from 0 to 1, NaN where not known

    Returns
    -------
    (..., 3) red, green, blue from 0 to 1, grey where NaN
    """
    return _colors(LEVEL, values, 0.72)


def activation_color(values: Array) -> Array:
    """Color activations.

    Parameters
    ----------
    values : (...) from 0 to 1, NaN where not known

    Returns
    -------
    (..., 3) red, green, blue from 0 to 1, grey where NaN
    """
    return _colors(ACTIVATION, values, 0.6)


def _colors(table: Bytes, values: Array, unknown: float) -> Array:
    colors: Array = table[np.clip(np.nan_to_num(values) * 255.0, 0, 255).astype(np.int64)] / 255.0
    colors[np.isnan(values)] = unknown
    return colors


def png(pixels: Bytes, palette: Bytes | None = None) -> bytes:
    """Write a PNG file.

    Parameters
    ----------
    pixels : (height, width, 4) red, green, blue, opacity, or (height, width) indices of the palette
    palette : (256, 3) red, green, blue

    Returns
    -------
    The bytes of the file
    """
    height, width = pixels.shape[:2]
    kind = 3 if palette is not None else 6
    rows = pixels.reshape(height, -1)
    if palette is None:
        # Differences to the pixel on the left pack better than the colors themselves.
        moved = rows.copy()
        moved[:, 4:] -= rows[:, :-4]
        rows = moved
    lines = np.concatenate(
        [np.full((height, 1), 0 if palette is not None else 1, np.uint8), rows], axis=1
    )
    parts = [(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, kind, 0, 0, 0))]
    if palette is not None:
        parts.append((b"PLTE", palette.astype(np.uint8).tobytes()))
    parts += [(b"IDAT", zlib.compress(lines.tobytes(), 7)), (b"IEND", b"")]
    chunks = [
        struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))
        for name, body in parts
    ]
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)


def data_uri(image: bytes) -> str:
    """Write a PNG as an address that needs no file."""
    return "data:image/png;base64," + base64.b64encode(image).decode("ascii")


def base64_text(values: np.ndarray) -> str:
    """Write an array's bytes, little-endian, as base64 text.

    Parameters
    ----------
    values : array of any shape, in C order

    Returns
    -------
    The text
    """
    ordered = np.ascontiguousarray(values).astype(values.dtype.newbyteorder("<"))
    return base64.b64encode(ordered.tobytes()).decode("ascii")
