"""What stands at the head of every page, and what it was derived from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Literal

NoteKind = Literal["real", "assumed", "simulated", "warning"]


@dataclass(frozen=True)
class Note:
    """A sentence about where something in the report comes from: measured, assumed or simulated."""

    kind: NoteKind
    text: str


@dataclass(frozen=True)
class SourceFile:
    """A file the results were made from.

    Attributes
    ----------
    role : "model", "markers", "forces", "EMG", ...
    name : without folders
    sha256 : of its content, in hexadecimal
    """

    role: str
    name: str
    sha256: str = ""


@dataclass(frozen=True)
class Step:
    """A step of the chain as it was run.

    Attributes
    ----------
    name : as users know it, e.g. "inverse kinematics"
    options : name to value as text
    seconds : it took, None if unknown [s]
    frames : it worked on
    """

    name: str
    options: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    seconds: float | None = None
    frames: int | None = None


@dataclass(frozen=True)
class PageHead:
    """What every page says of itself.

    Attributes
    ----------
    title : of the page, e.g. "s01: walk2"
    date : when it was made, as the caller wants it printed
    version : of the software
    notes : what is real, assumed or simulated, shown first
    sources : input files with their hashes
    steps : how it was made
    warnings : what the readers and steps reported, one line each
    """

    title: str
    date: str = ""
    version: str = ""
    notes: tuple[Note, ...] = ()
    sources: tuple[SourceFile, ...] = ()
    steps: tuple[Step, ...] = ()
    warnings: tuple[str, ...] = ()
