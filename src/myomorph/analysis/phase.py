"""A part of a motion that is looked at by itself."""

from __future__ import annotations

from dataclasses import dataclass

from myomorph.model.errors import BadData


@dataclass(frozen=True)
class Phase:
    """A part of a motion: its name, its start and its end [s]."""

    name: str
    start: float
    stop: float

    def __post_init__(self) -> None:
        if not self.start < self.stop:
            raise BadData(f"phase '{self.name}' lasts from {self.start:g} to {self.stop:g} s: expected a later end")
