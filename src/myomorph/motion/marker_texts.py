"""How findings about markers name labels and times."""

from __future__ import annotations

from collections.abc import Sequence

from myomorph.model.arrays import Array


def pairs_text(pairs: Sequence[tuple[str, str]], most: int = 3) -> str:
    """The first pairs of labels."""
    more = f" and {len(pairs) - most} other pairs" if len(pairs) > most else ""
    return ", ".join(f"'{first}' and '{other}'" for first, other in pairs[:most]) + more


def span_of(time: Array, start: int, stop: int) -> tuple[float, float]:
    """First and last time [s] of the frames from `start` to before `stop`."""
    return float(time[start]), float(time[stop - 1])


def times_text(spans: Sequence[tuple[float, float]], most: int = 3) -> str:
    """'at 1.20 s and from 1.50 to 1.62 s'."""
    parts = [f"at {a:.2f} s" if b - a < 0.005 else f"from {a:.2f} to {b:.2f} s" for a, b in spans[:most]]
    more = f" and in {len(spans) - most} other parts" if len(spans) > most else ""
    return ", ".join(parts) + more


def frames_text(count: int) -> str:
    """'1 frame', '5 frames'."""
    return f"{count} frame" + ("" if count == 1 else "s")
