"""Check a built site for broken links.

Every link and anchor leads somewhere in the site, and no page needs anything from elsewhere.
`python -m docs_build.links FOLDER` prints what does not, and ends with status 1 then.
"""

from __future__ import annotations

import sys
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

# What a browser gets by itself when it opens a page; where else a reader may follow a link is the
# reader's choice.
FETCHED = {
    ("link", "href"),
    ("script", "src"),
    ("img", "src"),
    ("iframe", "src"),
    ("source", "src"),
    ("video", "src"),
    ("audio", "src"),
    ("object", "data"),
}


class _Page(HTMLParser):
    """What one page links to and what in it can be linked to."""

    def __init__(self) -> None:
        super().__init__()
        self.links: list[str] = []
        self.fetched: list[str] = []
        self.anchors: set[str] = set()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note links, files and anchors of one element."""
        given = {name: value for name, value in attrs if value is not None}
        self.anchors |= {given[name] for name in ("id", "name") if name in given}
        if tag == "a" and "href" in given:
            self.links.append(given["href"])
        self.fetched += [value for name, value in given.items() if (tag, name) in FETCHED]


@cache
def page_of(file: Path) -> _Page:
    """Read a page, once."""
    page = _Page()
    page.feed(file.read_text(encoding="utf-8"))
    return page


def broken_links(site: Path) -> list[str]:
    """Links and files that lead nowhere, one line each."""
    site = site.resolve()
    found = []
    # The page for addresses that do not exist is shown at any depth, so its links count from the
    # root.
    for file in (one for one in sorted(site.rglob("*.html")) if one.name != "404.html"):
        page = page_of(file)
        for link in dict.fromkeys([*page.links, *page.fetched]):
            wrong = _wrong(link, file)
            if wrong:
                found.append(f"{file.relative_to(site).as_posix()}: {link}: {wrong}")
    return found


def _wrong(link: str, file: Path) -> str:
    parts = urlsplit(link)
    if parts.scheme or parts.netloc:
        return ""
    target = (file.parent / unquote(parts.path)).resolve() if parts.path else file
    if target.is_dir():
        target = target / "index.html"
    if not target.is_file():
        return "there is no such file"
    if (
        parts.fragment
        and target.suffix == ".html"
        and unquote(parts.fragment) not in page_of(target).anchors
    ):
        return "there is no such anchor"
    return ""


def foreign_files(site: Path) -> list[str]:
    """List what pages and style sheets would fetch from other machines, one line each."""
    found = []
    for file in sorted(site.rglob("*.html")):
        foreign = [one for one in page_of(file).fetched if urlsplit(one).netloc]
        found += [f"{file.relative_to(site).as_posix()}: {one}" for one in dict.fromkeys(foreign)]
    for file in sorted(site.rglob("*.css")):
        text = file.read_text(encoding="utf-8")
        if "url(http" in text or "url(//" in text or "@import" in text:
            found.append(
                f"{file.relative_to(site).as_posix()}: a style sheet with an address of another"
                " machine"
            )
    return found


if __name__ == "__main__":
    wrong = [*broken_links(Path(sys.argv[1])), *foreign_files(Path(sys.argv[1]))]
    sys.stdout.write("".join(f"{line}\n" for line in wrong))
    sys.exit(1 if wrong else 0)
