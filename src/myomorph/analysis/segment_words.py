"""Segments of the body as people call them."""

from __future__ import annotations

from myomorph.model.segments import Segment


def segment_words(segment: Segment) -> str:
    """A segment with its side: "left forearm"."""
    return f"{segment.side} {plain_words(segment.name)}".strip()


def plain_words(name: str) -> str:
    """The name of a segment in words: "forearm"."""
    return name.replace("lower_arm", "forearm").replace("_", " ")
