"""The main result in one sentence, whose parts know which side of the body they are about."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Side = Literal["right", "left", ""]
NO_BREAK = "\u00a0"


@dataclass(frozen=True)
class Phrase:
    """A part of a sentence; its side colors it, "" for none."""

    text: str
    side: Side = ""


@dataclass(frozen=True)
class Sentence:
    """Phrases in their order, with all spaces and points that stand between them."""

    phrases: tuple[Phrase, ...]

    @classmethod
    def of(cls, *parts: Phrase | str) -> Sentence:
        """Of phrases and of plain words, which belong to no side."""
        return cls(tuple(Phrase(part) if isinstance(part, str) else part for part in parts))

    def __str__(self) -> str:
        return "".join(phrase.text for phrase in self.phrases)


def degrees(value: float) -> str:
    """Return an angle [degrees] as whole degrees."""
    return f"{value:.0f}°".replace("-", "−")


def with_unit(value: float, unit: str, digits: int = 0) -> str:
    """Return a number that keeps its unit: no line ends between them."""
    return f"{value:.{digits}f}{NO_BREAK}{unit}".replace("-", "−")
