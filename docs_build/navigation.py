"""Navigation of the site, as docs/index.md lists pages.

Its headings are the groups, headings below them parts of a group, its links their pages.

Of a folder the index page is linked there and lists the others in its turn, without those that
docs/index.md puts into another group. A page that no index lists comes last: in the group of its
folder, or as "More" where it has none.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

DOCS = Path(__file__).resolve().parents[1] / "docs"
LISTED = re.compile(r"^\[[^\]]+\]\(\.\)$", re.MULTILINE)
"""A line that stands for a list of the folder's pages; where pages are read as they are, it leads
to the folder.
"""
LINK = re.compile(r"^(?:- |\| )\[[^\]]+\]\(([^)#]+\.md)\)", re.MULTILINE)
ELSEWHERE = {"../CHANGELOG.md": "changelog.md"}
"""Pages that are made of files beside docs/."""

Navigation = list[dict[str, list]]


def navigation() -> Navigation:
    """Return the groups and their pages, in the form of mkdocs' `nav`."""
    groups: Navigation = [{"Home": ["index.md"]}]
    text = (DOCS / "index.md").read_text(encoding="utf-8")
    listed = frozenset(LINK.findall(text))
    for part in _parts(text, "##"):
        pages = _pages(part.text.partition("\n### ")[0], listed)
        pages += [_task(task, listed) for task in _parts(part.text, "###")]
        groups.append({part.heading: pages})
    every = {path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md")}
    left = sorted(every - set(pages_of(groups)))
    return [*groups, {"More": left}] if left else groups


@dataclass(frozen=True, kw_only=True)
class Part:
    """What stands under a heading."""

    heading: str
    text: str


def _parts(text: str, marks: str) -> list[Part]:
    pieces = re.split(rf"^{marks} ", text, flags=re.MULTILINE)[1:]
    split = [piece.partition("\n") for piece in pieces]
    return [Part(heading=heading.strip(), text=rest) for heading, _, rest in split]


def _task(part: Part, listed: frozenset[str]) -> dict[str, list | str]:
    """Return a part of a group, or its page where it has only one."""
    pages = _pages(part.text, listed)
    return {part.heading: pages[0] if len(pages) == 1 else pages}


def _pages(text: str, listed: frozenset[str]) -> list:
    """Pages that a part of the index links; `listed` are those that any part links."""
    pages: list = []
    for link in LINK.findall(text):
        inside = (
            _inside(link, listed) if link.endswith("/index.md") else [ELSEWHERE.get(link, link)]
        )
        # A folder that is a group's first page fills the group; another is a part of it.
        pages += (
            inside
            if len(inside) == 1 or not pages
            else [{PurePosixPath(link).parent.name.title(): inside}]
        )
    return pages


def pages_of(entries: list) -> list[str]:
    """All pages of a navigation or of a part of it."""
    found: list[str] = []
    for entry in entries:
        if isinstance(entry, str):
            found.append(entry)
            continue
        for part in entry.values():
            found += [part] if isinstance(part, str) else pages_of(part)
    return found


def with_listed(markdown: str, page: str) -> str:
    """List in a page the other pages of its folder, by their headings.

    The page is specified by its path under docs.
    """

    def lines(_: re.Match[str]) -> str:
        paths = [
            path
            for path in sorted((DOCS / page).parent.glob("*.md"))
            if path.name != PurePosixPath(page).name
        ]
        heads = [
            path.read_text(encoding="utf-8").partition("\n")[0].removeprefix("# ") for path in paths
        ]
        return "\n".join(
            f"- [{head}]({path.name})" for head, path in zip(heads, paths, strict=True)
        )

    return LISTED.sub(lines, markdown)


def _inside(index: str, listed: frozenset[str]) -> list[str]:
    """Return the pages of a folder, without those that the index of the site lists.

    First comes the index of the folder, then the pages that it lists, then the others by name.
    """
    folder = PurePosixPath(index).parent
    own = [f"{folder}/{link}" for link in LINK.findall((DOCS / index).read_text(encoding="utf-8"))]
    every = [path.relative_to(DOCS).as_posix() for path in sorted((DOCS / folder).glob("*.md"))]
    rest = [page for page in every if page != index and page not in listed]
    return [
        index,
        *(page for page in own if page in rest),
        *(page for page in rest if page not in own),
    ]
