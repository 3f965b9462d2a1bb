"""A statement with how it is known."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, Literal, TypeVar

Value = TypeVar("Value")

Origin = Literal[
    "user",
    "file header",
    "markers",
    "sensors",
    "plates",
    "events",
    "file name",
    "folder",
    "segment lengths",
    "not known",
]
"""What a statement is known by."""


@dataclass(frozen=True, kw_only=True)
class Known(Generic[Value]):
    """A statement with how it is known; "not known" is an answer.

    Attributes
    ----------
    value : what is stated, None where it is not known
    origin : what it is known by
    sentence : why, in words; "" where the origin says it all
    """

    value: Value | None = None
    origin: Origin = "not known"
    sentence: str = ""

    def __bool__(self) -> bool:
        return self.value is not None

    def __str__(self) -> str:
        return "not known" if self.value is None else str(self.value)

    @property
    def explained(self) -> str:
        """The value, what it is known by, and why: "walking (markers: 4 steps)"."""
        if self.value is None:
            return f"not known ({self.sentence})" if self.sentence else "not known"
        why = f": {self.sentence}" if self.sentence else ""
        return f"{self.value} ({self.origin}{why})"
