"""Rows of a species table that say where single muscles go: to a digit, or along a bone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from typing import Literal, TypeAlias

import numpy as np

from myomorph.model.errors import BadData, UnknownName, check_name
from myomorph.model.model import GROUND, Marker, Model

Point: TypeAlias = tuple[float, float, float]


@dataclass(frozen=True)
class Ray:
    """A digit of the target, and the muscles whose tendons go to it."""

    # toe, metatarsal: bodies of the target
    toe: str
    metatarsal: str
    # extensors, flexors: muscles of the source, dorsal and plantar of the joint between the two
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
    """Where muscles begin or end on a bone of a relative."""

    muscles: tuple[str, ...]  # of the source; all go to the same place
    end: Literal["first", "last"]  # "first" or "last" point of their paths
    at: Point  # in the frame of the relative's bone [m]

    def __post_init__(self) -> None:
        if self.end not in ("first", "last"):
            raise BadData(f"attachment of {', '.join(self.muscles)}: end is '{self.end}': expected first or last")
        if len(self.at) != 3:
            raise BadData(f"attachment of {', '.join(self.muscles)}: expected three numbers at 'at'")


@dataclass(frozen=True, eq=False)
class RelativeBone:
    """Landmarks and attachments on a bone of a relative of the target."""

    body: str  # of the source, whose bone corresponds
    landmarks: Mapping[str, Point]  # by the names of that bone's rules, in a frame of the relative's bone [m]
    attachments: tuple[Attachment, ...]  # in the same frame
    citation: str = ""  # whose

    def __post_init__(self) -> None:
        wrong = [name for name, at in self.landmarks.items() if len(at) != 3]
        if wrong:
            raise BadData(f"relative's '{self.body}': expected three numbers at '{wrong[0]}'")


@dataclass(frozen=True, eq=False)
class MarkerTable:
    """Markers of one protocol."""

    # name, citation: of the protocol, and whose recordings these are
    name: str
    citation: str
    # by label the body of the target and the place in its frame [m]
    places: Mapping[str, tuple[str, tuple[float, float, float]]]
    # coordinates that the protocol shows, as patterns with *; all others are locked where the recording is followed
    # (the joint to ground always moves)
    moving: tuple[str, ...] = ("*",)
    start: Mapping[str, float] | None = None  # values of coordinates with which a search for the first pose begins


def with_markers_of(model: Model, tables: tuple[MarkerTable, ...], name: str) -> tuple[Model, tuple[str, ...]]:
    """The model with the markers of one protocol instead of its own, and locked what they do not show. Returns the
    model, and what was locked, one line each.
    """
    table = next((candidate for candidate in tables if candidate.name == name), None)
    if table is None:
        raise UnknownName("marker table", name, tuple(candidate.name for candidate in tables))
    for body, _ in table.places.values():
        check_name("body", body, model.body_names)
    for pattern in table.moving:
        if not any(fnmatchcase(coordinate_name, pattern) for coordinate_name in model.coordinate_names):
            raise BadData(f"marker table '{name}': no coordinate fits '{pattern}'")
    for angle in table.start or ():
        check_name("coordinate", angle, model.coordinate_names)
    markers = tuple(Marker(label, body, np.array(place)) for label, (body, place) in table.places.items())
    root = {name for joint in model.joints if joint.parent == GROUND for name in joint.coordinates}
    coordinates = []
    locked = 0
    for coordinate in model.coordinates:
        still = coordinate.name not in root and not any(
            fnmatchcase(coordinate.name, pattern) for pattern in table.moving
        )
        locked += still and not coordinate.locked
        default = (table.start or {}).get(coordinate.name, coordinate.default)
        coordinates.append(replace(coordinate, locked=coordinate.locked or still, default=default))
    made = replace(model.with_markers(markers), coordinates=tuple(coordinates))
    notes = [f"markers of '{name}' ({table.citation}): {len(markers)}, placed on bones, to be calibrated to an animal"]
    if locked:
        notes.append(f"{locked} of {len(coordinates)} coordinates are locked, as these markers do not show them")
    return made, tuple(notes)
