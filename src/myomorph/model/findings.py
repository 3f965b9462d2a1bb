"""What checks of a recording found: one value each, with its kind, place, times and whether it was mended."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Finding:
    """Something about a recording that may not be believed as it is.

    Attributes
    ----------
    kind : short name of what is wrong, such as "wrong foot", for tables and tests
    place : what it was found in: a plate, force, marker, coordinate or file
    text : one line for people: what, where, how much, and what was done or which option helps
    times : (start, stop) of each stretch of time concerned [s]; empty where all of it is
    mended : whether what follows was computed with it put right
    """

    kind: str
    place: str
    text: str
    times: tuple[tuple[float, float], ...] = ()
    mended: bool = False

    def __str__(self) -> str:
        return self.text
