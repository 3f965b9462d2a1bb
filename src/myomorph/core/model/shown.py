"""Values as one short line, and as a small table for notebooks."""

from __future__ import annotations

import contextlib
import dataclasses
import html
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from myomorph.core.model.errors import MyomorphError, counted
from myomorph.core.model.extension import load
from myomorph.core.model.registry import with_extensions

_Class = TypeVar("_Class", bound=type)

MAX_LINE = 240  # Characters of a value's line.
MAX_TEXT = 48  # Of a text in it.
MAX_LISTED = 4  # Values of an array, names or numbers that are written out.


def shown(cls: _Class) -> _Class:
    """Give a dataclass a short `repr`, and a table that notebooks show.

    A property `headline` of the class, where it has one, is the line after its name; else fields
    are, those left out that are as by default. The table has all fields, and above them what an
    extension or a method `drawing` draws.
    """
    kind: Any = cls
    kind.__repr__ = short_line
    kind._repr_html_ = table
    return cls


def short_line(value: Any) -> str:
    """Write a value as its class and what it holds, in one line."""
    name = type(value).__name__
    headline = getattr(value, "headline", None)
    if headline is not None:
        return f"{name}({headline})"
    line = ", ".join(f"{field}={text}" for field, text in _told(value))
    if len(line) > MAX_LINE:
        line = line[: line.rfind(", ", 0, MAX_LINE)] + ", ..."
    return f"{name}({line})"


def _told(value: Any) -> Iterator[tuple[str, str]]:
    """Yield name and text of each field that is not as by default."""
    for field in dataclasses.fields(value):
        held = getattr(value, field.name)
        if not field.repr or _is_default(held, field) or _is_empty(held):
            continue
        yield field.name, brief(held)


def _is_default(held: object, field: dataclasses.Field[Any]) -> bool:
    parts = held if isinstance(held, tuple) else (held,)
    plain = all(isinstance(part, bool | int | float | str | None) for part in parts)
    return plain and type(held) is type(field.default) and held == field.default


def _is_empty(held: object) -> bool:
    return isinstance(held, Collection) and not isinstance(held, np.ndarray) and len(held) == 0


def brief(value: object) -> str:
    """Write what a field holds in a few words: of arrays the shape, of many values their number."""
    if isinstance(value, np.ndarray):
        return _brief_array(value)
    if isinstance(value, str | Path):
        text = str(value)
        cut = f"{text[: MAX_TEXT - 3]}..."
        return repr(text if len(text) <= MAX_TEXT else cut)
    if isinstance(value, bool | np.bool_ | None):
        return str(value)
    if isinstance(value, int | float | np.number):
        return f"{value:.6g}"
    if isinstance(value, Mapping):
        return f"{{{len(value)} by name}}"
    if isinstance(value, Collection):
        return _brief_collection(value)
    if dataclasses.is_dataclass(value):
        headline = getattr(value, "headline", None)
        name = type(value).__name__
        return f"{name}(...)" if headline is None else f"{name}({headline})"
    return type(value).__name__


def _brief_array(value: np.ndarray) -> str:
    if value.size <= MAX_LISTED and value.ndim == 1 and value.dtype.kind in "fiu":
        numbers = ", ".join(map(brief, value.tolist()))
        return f"[{numbers}]"
    return f"array{value.shape}".replace(",)", ")")


def _brief_collection(value: Collection[Any]) -> str:
    items = list(value)
    plain = all(isinstance(item, str | int | float | np.number) for item in items)
    if plain and len(items) <= MAX_LISTED:
        listed = ", ".join(brief(item) for item in items)
        return f"({listed})"
    kinds = {type(item).__name__ for item in items}
    kind = kinds.pop() if len(kinds) == 1 else "value"
    noun = "name" if kind == "str" else kind
    return f"({counted(len(items), noun)})"


def picture_of(value: Any) -> str:
    """Draw a value as HTML: as an extension does, else by its method `drawing`; "" for neither.

    Where an extension cannot draw it, the method does.
    """
    places = with_extensions({}, "picture", lambda extension: extension.pictures)
    place = places.get(type(value).__name__)
    if place is not None:
        with contextlib.suppress(MyomorphError, OSError, ImportError):
            return str(load(place)(value))
    drawing = getattr(value, "drawing", None)
    return "" if drawing is None else str(drawing())


def table(value: Any) -> str:
    """Write a value as a table of HTML, one row a field, with its drawing above."""
    rows = "".join(
        f"<tr><th style='text-align:left'>{html.escape(field.name)}</th>"
        f"<td style='text-align:left'>{html.escape(brief(getattr(value, field.name)))}</td></tr>"
        for field in dataclasses.fields(value)
    )
    picture = picture_of(value)
    title = html.escape(short_line(value) if hasattr(value, "headline") else type(value).__name__)
    return f"<div><b>{title}</b><div>{picture}</div><table>{rows}</table></div>"
