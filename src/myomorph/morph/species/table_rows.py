"""Rows of a species table that say where single muscles go: to a digit, or along a bone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, TypeAlias

from myomorph.model.errors import BadData

Point: TypeAlias = tuple[float, float, float]


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
    """Where muscles begin or end on a bone of a relative.

    Attributes
    ----------
    muscles : of the source; all go to the same place
    end : "first" or "last" point of their paths
    at : in the frame of the relative's bone [m]
    """

    muscles: tuple[str, ...]
    end: Literal["first", "last"]
    at: Point

    def __post_init__(self) -> None:
        if self.end not in ("first", "last"):
            raise BadData(f"attachment of {', '.join(self.muscles)}: end is '{self.end}': expected first or last")
        if len(self.at) != 3:
            raise BadData(f"attachment of {', '.join(self.muscles)}: expected three numbers at 'at'")


@dataclass(frozen=True, eq=False)
class RelativeBone:
    """Landmarks and attachments on a bone of a relative of the target.

    Attributes
    ----------
    body : of the source, whose bone corresponds
    landmarks : by the names of that bone's rules, in a frame of the relative's bone [m]
    attachments : in the same frame
    citation : whose
    """

    body: str
    landmarks: Mapping[str, Point]
    attachments: tuple[Attachment, ...]
    citation: str = ""

    def __post_init__(self) -> None:
        wrong = [name for name, at in self.landmarks.items() if len(at) != 3]
        if wrong:
            raise BadData(f"relative's '{self.body}': expected three numbers at '{wrong[0]}'")
