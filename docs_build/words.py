"""The words of the site by section: `python -m docs_build.words`.

A word is what stands between blanks in the source of a page and has a letter or a digit, code and
tables included. What is made when the site is built (the help of commands, tables of results, the
reference of modules) is not counted.
"""

from __future__ import annotations

import re
import sys
from dataclasses import dataclass

from docs_build.navigation import DOCS, ELSEWHERE, navigation, pages_of

CORE = ("Home", "First results", "Tasks", "Reference", "Method", "Validation")
"""Groups of the navigation that whoever uses the main job reads."""
MADE = tuple(ELSEWHERE.values())
"""Pages that lie beside docs/."""
WORD = re.compile(r"\S*\w\S*")


@dataclass(frozen=True, kw_only=True)
class Section:
    """Words of one group of the navigation.

    Attributes
    ----------
    name : of the group
    pages : how many it has
    words : of all of them
    """

    name: str
    pages: int
    words: int

    @property
    def core(self) -> bool:
        """Whether it belongs to the site's core."""
        return self.name in CORE


def words_of(page: str) -> int:
    """Return the words of a page, given by its path under docs."""
    return len(WORD.findall((DOCS / page).read_text(encoding="utf-8")))


def sections() -> list[Section]:
    """Return all groups of the navigation, in its order."""
    found = []
    for group in navigation():
        for name, entries in group.items():
            pages = [page for page in pages_of(entries) if page not in MADE]
            words = sum(words_of(page) for page in pages)
            found.append(Section(name=name, pages=len(pages), words=words))
    return found


def table(counted: list[Section]) -> str:
    """Return the sections as a table of Markdown, the core and its sum first."""
    core = [section for section in counted if section.core]
    total = Section(
        name="**Core**",
        pages=sum(section.pages for section in core),
        words=sum(section.words for section in core),
    )
    rows = [*core, total, *(section for section in counted if not section.core)]
    lines = [f"| {row.name} | {row.pages} | {row.words:,} |" for row in rows]
    return "\n".join(("| section | pages | words |", "|---|--:|--:|", *lines))


if __name__ == "__main__":
    sys.stdout.write(f"{table(sections())}\n")
