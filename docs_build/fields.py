"""Docstrings of this project for the API reference.

Behind the colon of a field stands its meaning. Its type is annotated.
"""

from __future__ import annotations

import re
from typing import Any

import griffe

FIELDS = {"Parameters", "Attributes", "Other Parameters", "Raises"}
PROSE = {"Returns", "Yields"}


class FieldsThatSayWhatTheyAre(griffe.Extension):
    """Hands docstrings to the reference as its parser expects them."""

    def on_instance(self, *, obj: griffe.Object, **_: Any) -> None:
        """Rewrite the docstring of one object, where it has one."""
        if obj.docstring is not None:
            obj.docstring.value = told_below(obj.docstring.value)


def told_below(text: str) -> str:
    """Docstring whose fields have their description below their name, and whose results are prose.

        length : of the tendon [m]

    would otherwise be read as a value of the type "of the tendon [m]".
    """
    lines = text.splitlines()
    told: list[str] = []
    section = ""
    for number, line in enumerate(lines):
        following = lines[number + 1] if number + 1 < len(lines) else ""
        if section or not line.startswith("    "):
            line = without_links(line)
        if re.fullmatch(r"-{3,}", following) and line.strip():
            section = line.strip()
            told.append(f"**{section}**" if section in PROSE else line)
        elif section in PROSE and re.fullmatch(r"-{3,}", line):
            told.append("")
        elif section in FIELDS and (field := re.fullmatch(r"(\S.*?) : (.*)", line)):
            told += [field[1], f"    {field[2]}"]
        else:
            told.append(line)
    return "\n".join(told)


def without_links(line: str) -> str:
    """Brackets after brackets in a line are an index or a unit, as in `f[i](x)`, and no link."""
    return re.sub(
        r"`[^`]*`|\](?=\s?[\[(])", lambda found: r"\]" if found[0] == "]" else found[0], line
    )
