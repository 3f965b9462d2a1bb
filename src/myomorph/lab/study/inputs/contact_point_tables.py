"""Tables of a file of contact points."""

from __future__ import annotations

from pydantic import Field

from myomorph.lab.store.study_file import Strict

Vector = tuple[float, float, float]


class PointTable(Strict):
    """A point that carries a share of a joint's force."""

    joint: str = Field(min_length=1)
    name: str = Field(min_length=1)
    frame: str = ""
    point: Vector
    normal: Vector | None = None


class ContactPointTables(Strict):
    """The whole file."""

    point: list[PointTable] = Field(min_length=1)
