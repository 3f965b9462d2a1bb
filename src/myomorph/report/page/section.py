"""What the page is put together from: sections of figures and tables."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Figure:
    """A drawing with its caption; `size` is "small", "medium", "wide" or "full", `folded` the words it hides behind."""

    svg: str
    size: str = "small"
    caption: str = ""
    folded: str = ""


@dataclass(frozen=True)
class Link:
    """A cell of a table that leads to another page, at a place relative to this one."""

    text: str
    place: str

    def __len__(self) -> int:
        return len(self.text)


@dataclass(frozen=True)
class Grid:
    """A table: its heading, its rows of text, and whether it is folded away at first."""

    head: tuple[str, ...]
    rows: tuple[tuple[str | Link, ...], ...]
    title: str = ""
    folded: bool = False


@dataclass(frozen=True)
class Section:
    """A part of the page.

    Attributes
    ----------
    key : anchor
    lead : a sentence or two before the figures
    legend : styles and what they stand for
    figures, grids : shown in this order
    listed : whether the contents name it
    """

    key: str
    title: str
    lead: str = ""
    legend: tuple[tuple[str, str], ...] = ()
    figures: tuple[Figure, ...] = ()
    grids: tuple[Grid, ...] = ()
    listed: bool = True


SIDES_LEGEND: tuple[tuple[str, str], ...] = (("right", "right"), ("left", "left"))
