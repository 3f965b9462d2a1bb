"""The Python files that rules hold for, by wing."""

from __future__ import annotations

import io
import re
import tokenize
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("src/myomorph", "tests", "benchmarks", "docs_build")
MARK = re.compile(r"# (page|fmt):")
WAIVER = re.compile(r"# page: (?P<reason>.+)$")


@dataclass(frozen=True, kw_only=True)
class Source:
    """A Python file."""

    path: str
    """From the root of the checkout, with slashes."""
    text: str

    @property
    def wing(self) -> str:
        """The wing, or the folder beside `src`; "face" for what lies above the wings."""
        return wing_of(self.path)

    @cached_property
    def marks(self) -> dict[int, str]:
        """Comments by line, of a file that may have waivers or keep ruff from formatting."""
        if not MARK.search(self.text):
            return {}
        tokens = tokenize.generate_tokens(io.StringIO(self.text).readline)
        return {token.start[0]: token.string for token in tokens if token.type == tokenize.COMMENT}

    @cached_property
    def waivers(self) -> dict[int, str]:
        """Reasons by line number."""
        found = {line: WAIVER.search(comment) for line, comment in self.marks.items()}
        return {line: waiver["reason"] for line, waiver in found.items() if waiver is not None}


def wing_of(path: str) -> str:
    """Name the wing of a path of the checkout."""
    parts = path.split("/")
    if parts[0] != "src":
        return parts[0]
    return parts[2] if len(parts) > 3 else "face"


def sources(root: Path = ROOT) -> Iterator[Source]:
    """All files that the rules hold for."""
    for folder in FOLDERS:
        for path in sorted((root / folder).rglob("*.py")):
            name = path.relative_to(root).as_posix()
            yield Source(path=name, text=path.read_text(encoding="utf-8"))
