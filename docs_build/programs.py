"""Programs of the documentation, which a page shows as the files that tests run.

A line `<!-- program: NAME -->` of a page stands for the code of `docs/programs/NAME.py` when the
site is built; the block of text below it is what the program prints.
"""

from __future__ import annotations

import ast
import io
import re
import tokenize
from pathlib import Path

DOCS = Path(__file__).resolve().parents[1] / "docs"
FOLDER = DOCS / "programs"
MARK = re.compile(
    r"^<!-- program: (?P<name>\w+) -->\n\n```text\n(?P<printed>.*?)^```$", re.MULTILINE | re.DOTALL
)
LINE = re.compile(r"^<!-- program: (?P<name>\w+) -->$", re.MULTILINE)


def programs() -> list[Path]:
    """List the programs by name."""
    return sorted(FOLDER.glob("*.py"))


def shown(page: Path) -> dict[str, str]:
    """Return what a page says that each of its programs prints, by the program's name."""
    text = page.read_text(encoding="utf-8")
    return {mark["name"]: mark["printed"] for mark in MARK.finditer(text)}


def code_lines(program: Path) -> int:
    """Count lines of code: without docstring, comments and empty lines."""
    text = program.read_text(encoding="utf-8")
    document = ast.parse(text).body[0]
    blank = set(range(document.lineno, (document.end_lineno or 0) + 1))
    skipped = (tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.ENDMARKER)
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in skipped and token.string.strip():
            lines.add(token.start[0])
    return len(lines - blank)


def with_programs(markdown: str) -> str:
    """Return a page with the code of its programs in place."""
    return LINE.sub(lambda line: _block(FOLDER / f"{line['name']}.py"), markdown)


def _block(program: Path) -> str:
    """Return the code of a program as a fenced block, without its docstring."""
    text = program.read_text(encoding="utf-8")
    document = ast.parse(text).body[0]
    code = "\n".join(text.splitlines()[document.end_lineno or 0 :]).strip()
    return f"```python\n{code}\n```"
