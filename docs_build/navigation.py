"""The navigation of the site, as docs/index.md lists pages: its headings are the groups, its links
their pages.

Of a folder the index page is linked there and lists the others in its turn. A page that no index
lists comes last: in the group of its folder, or as "More" where it has none.
"""

from __future__ import annotations

import re
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
    """Groups and their pages, in the form of mkdocs' `nav`."""
    groups: Navigation = [{"Home": ["index.md"]}]
    text = (DOCS / "index.md").read_text(encoding="utf-8")
    for part in re.split(r"^## ", text, flags=re.MULTILINE)[1:]:
        heading, _, listed = part.partition("\n")
        pages: list = []
        for link in LINK.findall(listed):
            inside = _inside(link) if link.endswith("/index.md") else [ELSEWHERE.get(link, link)]
            # A folder that is a group's first page fills the group; another is a part of it.
            pages += (
                inside
                if len(inside) == 1 or not pages
                else [{PurePosixPath(link).parent.name.title(): inside}]
            )
        groups.append({heading.strip(): pages})
    every = {path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md")}
    left = sorted(every - set(pages_of(groups)))
    return [*groups, {"More": left}] if left else groups


def pages_of(entries: list) -> list[str]:
    """All pages of a navigation or of a part of it."""
    found: list[str] = []
    for entry in entries:
        found += (
            [entry]
            if isinstance(entry, str)
            else [page for part in entry.values() for page in pages_of(part)]
        )
    return found


def with_listed(markdown: str, page: str) -> str:
    """A page, given by its path under docs, in which the other pages of its folder are listed by
    their headings.
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


def _inside(index: str) -> list[str]:
    """The pages of a folder: its index, those that the index lists, then the others by name."""
    folder = PurePosixPath(index).parent
    listed = [
        f"{folder}/{link}" for link in LINK.findall((DOCS / index).read_text(encoding="utf-8"))
    ]
    every = [path.relative_to(DOCS).as_posix() for path in sorted((DOCS / folder).glob("*.md"))]
    return [
        index,
        *(page for page in listed if page in every),
        *(page for page in every if page not in (index, *listed)),
    ]
