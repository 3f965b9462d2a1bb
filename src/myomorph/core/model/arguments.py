"""Arguments of public functions: what was given in the place of what, and what to give."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from myomorph.core.model.errors import BadData

READERS = {
    "Model": "mm.read_model",
    "Markers": "mm.read_recording",
    "Motion": "mm.read_motion",
    "Wrenches": "mm.read_loads",
}
"""Functions that read a file of a kind."""


def check_argument(name: str, value: object, expected: type) -> None:
    """Refuse an argument of another class, and say what to give.

    Parameters
    ----------
    name : of the argument
    value : that was given
    expected : class that it must be of

    Raises
    ------
    BadData : it is of another one

    Examples
    --------
    >>> from myomorph.core.model.series import Markers, Trial
    >>> check_argument("markers", Trial(), Markers)
    Traceback (most recent call last):
        ...
    myomorph.core.model.errors.BadData: markers: expected Markers, but got a Trial without markers
    """
    if isinstance(value, expected):
        return
    raise BadData(
        f"{name}: expected {_with_article(expected.__name__)}, but got {_given(value, expected)}"
    )


def _given(value: object, expected: type) -> str:
    """Say what was given, and how to get from there to what is expected."""
    if value is None:
        return "None: does the recording hold any?"
    if isinstance(value, str | Path):
        reader = READERS.get(expected.__name__)
        how = f": read it first ({reader}('{value}'))" if reader else ""
        return f"the name '{value}'{how}"
    kind = _with_article(type(value).__name__)
    part = _part(value, expected)
    if part:
        return f"{kind}: give its .{part}"
    lower = expected.__name__.lower()
    return f"{kind} without {lower}" if hasattr(value, lower) else kind


def _part(value: object, expected: type) -> str:
    """Name the field of a value that holds what is expected, "" for none."""
    if not dataclasses.is_dataclass(value):
        return ""
    names = [field.name for field in dataclasses.fields(value)]
    return next((name for name in names if isinstance(getattr(value, name), expected)), "")


def _with_article(name: str) -> str:
    """Put an article before the name of a class; none before one in the plural."""
    if name.endswith("s") and not name.endswith("ss"):
        return name
    return f"an {name}" if name[0] in "AEIOU" else f"a {name}"
