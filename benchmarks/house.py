"""How large the house is: lines by room, words of documentation, names that do not say what they
hold.

- lines: of the Python files under `src` by room, under `tests` and under `benchmarks`;
- words: of Markdown, as `str.split` counts them: README, CHANGELOG, CONTRIBUTING and `docs`,
    references apart;
- vague: of 1,000 names that are bound (assigned, or parameters) in a room, how many are one of
    `VAGUE`.

`python -m benchmarks house [--before REVISION]`: the files of the checkout, beside those that git
holds for a revision.
"""

from __future__ import annotations

import argparse
import ast
import io
import subprocess
import tarfile
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path

VAGUE = {"one", "found", "given", "own", "k"}
FOLDERS = ("src", "tests", "benchmarks")
REFERENCES = "docs/references.md"
PAGES = ("README.md", "CHANGELOG.md", "CONTRIBUTING.md")
CHECKOUT = Path(__file__).parents[1]
Row = dict[str, object]


def checkout_texts(root: Path) -> Iterator[tuple[str, str]]:
    """Paths and texts of a checkout's Python and Markdown files."""
    for folder in (*FOLDERS, "docs"):
        for path in sorted((root / folder).rglob("*")):
            if path.suffix in (".py", ".md"):
                yield path.relative_to(root).as_posix(), path.read_text(encoding="utf-8")
    for page in PAGES:
        yield page, (root / page).read_text(encoding="utf-8")


def revision_texts(root: Path, revision: str) -> Iterator[tuple[str, str]]:
    """Paths and texts of the Python and Markdown files that git holds for a revision."""
    archive = subprocess.run(
        ["git", "archive", revision], cwd=root, capture_output=True, check=True
    ).stdout
    with tarfile.open(fileobj=io.BytesIO(archive)) as files:
        for member in files:
            if member.isfile() and member.name.endswith((".py", ".md")):
                yield member.name, files.extractfile(member).read().decode("utf-8")


def count(texts: Iterable[tuple[str, str]]) -> list[Row]:
    """Rows `what, where, number`: lines by room, words of Markdown, and vague names of 1,000 by
    room.
    """
    lines = Counter()
    words = Counter()
    names = Counter()
    vague = Counter()
    for path, text in texts:
        if path.endswith(".md"):
            words[_kind(path)] += len(text.split())
            continue
        folder, *inside = path.split("/")
        if folder not in FOLDERS:
            continue
        lines[folder] += text.count("\n")
        if folder == "src":
            room = inside[1] if len(inside) > 2 else "package"
            lines[f"src/{room}"] += text.count("\n")
            for name in bound_names(ast.parse(text)):
                names.update(("src", f"src/{room}"))
                vague.update(("src", f"src/{room}") if name in VAGUE else ())
    words["documentation"] = words["docs"] + words["pages at the top"]
    shares = {where: 1000 * vague[where] / names[where] for where in names}
    tables = {"lines": lines, "words": words, "vague": shares}
    return [
        {"what": what, "where": where, "number": table[where]}
        for what, table in tables.items()
        for where in sorted(table)
    ]


def _kind(path: str) -> str:
    """Which words those of a page are."""
    if path in PAGES:
        return "pages at the top"
    if path == REFERENCES:
        return "references"
    return "docs" if path.startswith("docs/") else "other Markdown"


def bound_names(tree: ast.AST) -> Iterator[str]:
    """The names that code binds: assigned ones, in whatever way, and parameters."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id
        elif isinstance(node, ast.arg):
            yield node.arg


def add_options(parser: argparse.ArgumentParser) -> None:
    """The options of the command line."""
    parser.add_argument(
        "--before", default="", metavar="REVISION", help="a git revision to compare with"
    )


def run(before: str = "") -> list[Row]:
    """The rows of the checkout, with the numbers of a revision before them."""
    rows = count(checkout_texts(CHECKOUT))
    return _beside(count(revision_texts(CHECKOUT, before)), rows) if before else rows


def _beside(before: list[Row], now: list[Row]) -> list[Row]:
    old = {(row["what"], row["where"]): row["number"] for row in before}
    new = {(row["what"], row["where"]): row["number"] for row in now}
    kinds = list(dict.fromkeys(row["what"] for row in now))
    keys = sorted(old.keys() | new.keys(), key=lambda key: (kinds.index(key[0]), key[1]))
    return [
        {
            "what": what,
            "where": where,
            "before": old.get((what, where), 0),
            "number": new.get((what, where), 0),
        }
        for what, where in keys
    ]
