"""How hard a page of the code is to read, by wing.

- lines: of code, comments and docstrings left out, and tokens a line;
- places that do not follow a rule of `tests.page.rules`, waivers included;
- without Parameters: documented functions with arguments, no section of which describes them.

`python -m benchmarks page [--before REVISION]`: the files of the checkout, compared with those that
git holds for a revision. Files that have moved since count for the wing that they are in now.
"""

from __future__ import annotations

import argparse
import ast
import io
import subprocess
import tarfile
import tokenize
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from pathlib import Path

from tests.page import rules
from tests.page.sources import FOLDERS, Source, sources

CHECKOUT = Path(__file__).parents[1]
FIGURES = {
    "tuple": "tuple assignments",
    "generator": "unpacked generators",
    "positional": "constructors by position",
    "splat": "splats into constructors",
    "conditional": "nested conditionals",
    "dense": "dense functions",
    "bare": "functions without Parameters",
}
"""Column by what is counted."""
NO_CODE = {
    tokenize.COMMENT,
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENDMARKER,
}
DOCUMENTED = (ast.Module, ast.ClassDef, *rules.FUNCTIONS)
TOGETHER = "all of src"
Row = dict[str, object]


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command line."""
    parser.add_argument(
        "--before", default="", metavar="REVISION", help="a git revision to compare with"
    )


def run(before: str = "") -> list[Row]:
    """Count the checkout's files, and those of a revision if one is named.

    Returns
    -------
    One row per wing; with a revision two, the older one first
    """
    now = figures(sources(CHECKOUT))
    if not before:
        return [{"wing": wing, **row} for wing, row in now.items()]
    then = figures(revision_sources(CHECKOUT, before))
    both = {before: then, "now": now}
    return [
        {"wing": wing, "tree": tree, **rows[wing]}
        for wing in now
        for tree, rows in both.items()
        if wing in rows
    ]


def figures(files: Iterable[Source]) -> dict[str, Row]:
    """Figures of each wing, and of all of `src`."""
    counts: defaultdict[str, Counter[str]] = defaultdict(Counter)
    for source in files:
        counted = count(source)
        counts[source.wing].update(counted)
        if source.path.startswith("src/"):
            counts[TOGETHER].update(counted)
    return {wing: _row(counts[wing]) for wing in sorted(counts, key=_place)}


def _place(wing: str) -> tuple[bool, bool, str]:
    """Wings first, then all of them together, then the folders beside `src`."""
    return wing in FOLDERS, wing == TOGETHER, wing


def _row(counts: Counter[str]) -> Row:
    tokens_per_line = counts["tokens"] / max(counts["lines"], 1)
    row: Row = {"lines of code": counts["lines"], "tokens a line": round(tokens_per_line, 2)}
    return row | {title: counts[name] for name, title in FIGURES.items()}


def count(source: Source) -> Counter[str]:
    """Count lines, tokens and places of a file."""
    tree = ast.parse(source.text)
    counts = Counter(rule for _, rule, _ in rules.places(source))
    counts["bare"] = sum(rules.is_bare(function) for function, _ in rules.functions(tree))
    documents = set(_lines_of_docstrings(tree))
    lines = set()
    for token in tokenize.generate_tokens(io.StringIO(source.text).readline):
        if token.type not in NO_CODE and token.start[0] not in documents:
            counts["tokens"] += 1
            lines.add(token.start[0])
    counts["lines"] = len(lines)
    return counts


def _lines_of_docstrings(tree: ast.Module) -> Iterator[int]:
    for node in ast.walk(tree):
        if isinstance(node, DOCUMENTED) and ast.get_docstring(node) is not None:
            document = node.body[0]
            yield from range(document.lineno, document.end_lineno + 1)


def revision_sources(root: Path, revision: str) -> Iterator[Source]:
    """Files that git holds for a revision, under the paths that they have today."""
    places = moved_to(root, revision)
    archive = _git(root, "archive", revision, *FOLDERS)
    with tarfile.open(fileobj=io.BytesIO(archive)) as files:
        for member in files:
            if member.isfile() and member.name.endswith(".py"):
                text = files.extractfile(member).read().decode("utf-8")
                yield Source(path=places.get(member.name, member.name), text=text)


def moved_to(root: Path, revision: str) -> dict[str, str]:
    """Today's paths of files of a revision that were moved since.

    Parameters
    ----------
    root : of the checkout
    revision : an ancestor of the commit that is checked out
    """
    log = _git(
        root,
        "log",
        "--reverse",
        "--name-status",
        "--find-renames",
        "--diff-filter=R",
        "--format=",
        f"{revision}..HEAD",
    )
    places: dict[str, str] = {}
    for line in log.decode("utf-8").splitlines():
        if not line:
            continue
        _, old, new = line.split("\t")
        first = next((path for path, place in places.items() if place == old), old)
        places[first] = new
    return places


def _git(root: Path, *words: str) -> bytes:
    return subprocess.run(["git", *words], cwd=root, capture_output=True, check=True).stdout
