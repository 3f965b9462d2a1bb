"""A table of a subject in study files that a step brings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from myomorph.lab.study.inputs.keys import Place

if TYPE_CHECKING:
    from pydantic import BaseModel


@dataclass(frozen=True)
class TableOwner:
    """The subject that a table belongs to.

    Attributes
    ----------
    model : file of the model that its steps begin with
    mass : of the body [kg], None for the model's
    place : where the table stands, and who takes up what is wrong with it
    """

    model: Path
    mass: float | None
    place: Place


@dataclass(frozen=True, kw_only=True)
class OwnTable:
    """A table of a subject that only one step reads.

    Attributes
    ----------
    key : name of the table, as `bones` of `[subject.bones]`
    table : its keys
    read : from the table and its subject to the value that the step finds by its type in
        `SubjectFiles.own`; what does not exist goes to the notes of the place
    content : what the table has, in words, for a subject without one
    """

    key: str
    table: type[BaseModel]
    read: Callable[[Any, TableOwner], object]
    content: str
