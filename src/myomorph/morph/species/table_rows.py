"""Rows of a species table that say where single muscles go: to a digit, or along a bone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from myomorph.model.errors import BadData


@dataclass(frozen=True)
class Ray:
    """A digit of the target, and the muscles whose tendons go to it.

    Attributes
    ----------
    toe, metatarsal : bodies of the target
    extensors, flexors : muscles of the source, dorsal and plantar of the joint between the two
    """

    toe: str
    metatarsal: str
    extensors: tuple[str, ...] = ()
    flexors: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        both = set(self.extensors) & set(self.flexors)
        if both or not (self.extensors or self.flexors):
            raise BadData(
                f"ray {self.toe}: expected extensors or flexors, none of them both: {', '.join(sorted(both))}"
            )


@dataclass(frozen=True)
class Attachment:
    """Where muscles begin or end along a bone.

    Attributes
    ----------
    muscles : of the source
    end : "first" or "last" point of their paths
    body : of the source, that the point is fixed to
    along : share of the way from the bone's proximal to its distal joint
    citation : whose
    """

    muscles: tuple[str, ...]
    end: Literal["first", "last"]
    body: str
    along: float
    citation: str = ""

    def __post_init__(self) -> None:
        if self.end not in ("first", "last"):
            raise BadData(f"attachment of {', '.join(self.muscles)}: end is '{self.end}': expected first or last")
        if not -0.5 <= self.along <= 1.5:
            raise BadData(f"attachment of {', '.join(self.muscles)}: {self.along:g} along the bone: expected 0 to 1")
