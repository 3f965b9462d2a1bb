"""Examples of the documentation that run.

What a page marks is run in the order of the page, in a folder of its own. Marks are comments,
which no reader sees, on the line before a fenced block:

    <!-- data: NAME -->      copies a data set of the collection into the folder
    <!-- runs -->            a `sh` block of `myomorph` commands, or a `python` block
    <!-- file: NAME -->      the block is written to the file
    <!-- printed -->         lines that the block before printed, numbers within 2 %

`python -m docs_build.examples PAGE FOLDER` shows all that is printed. `MYOMORPH_DATA` names the
folder of the data sets.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import shlex
import shutil
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

DOCS = Path(__file__).resolve().parents[1] / "docs"
MARK = re.compile(
    r"^<!-- (?P<kind>data|runs|file|printed)(?:: (?P<name>[^>]*?))?"
    r" -->\n(?:```(?P<language>\w*)\n(?P<text>.*?)^```)?",
    re.MULTILINE | re.DOTALL,
)
NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
NEAR = 0.02


@dataclass(frozen=True)
class Part:
    """One marked part of a page.

    Attributes
    ----------
    kind : data, runs, file or printed
    name : of the data set or the file
    language : of the block
    text : of the block
    line : where it begins on the page, from 1
    """

    kind: str
    name: str
    language: str
    text: str
    line: int


def parts_of(page: Path) -> list[Part]:
    """Return what a page marks, in the order of the page."""
    text = page.read_text(encoding="utf-8")
    found = []
    for mark in MARK.finditer(text):
        line = text.count("\n", 0, mark.start()) + 1
        if mark["kind"] != "data" and mark["text"] is None:
            raise ValueError(
                f"{page.name}, line {line}: no fenced block follows '{mark[0].strip()}'"
            )
        found.append(
            Part(
                kind=mark["kind"],
                name=mark["name"] or "",
                language=mark["language"] or "",
                text=mark["text"] or "",
                line=line,
            )
        )
    return found


def pages_that_run() -> list[Path]:
    """Pages with marked parts, in the order of their paths."""
    return [
        page
        for page in sorted(DOCS.rglob("*.md"))
        if any(part.kind == "runs" for part in parts_of(page))
    ]


def run_page(
    page: Path,
    folder: Path,
    data: Callable[[str], Path],
    said: Callable[[str], object] | None = None,
) -> None:
    """Do what a page says, in a folder.

    Parameters
    ----------
    page : of the documentation
    folder : to work in; data sets are copied there
    data : folder of a data set by its name
    said : takes what every block prints, as it comes; then lines that differ are told to it too,
        and the rest goes on

    Raises
    ------
    AssertionError
        where a command ends with an error, or prints other lines than the page says
    """
    names: dict[str, object] = {"__name__": page.stem}
    printed = ""
    with working_in(folder):
        for part in parts_of(page):
            where = f"{page.name}, line {part.line}"
            if part.kind == "data":
                shutil.copytree(data(part.name), folder / part.name, dirs_exist_ok=True)
            elif part.kind == "file":
                (folder / part.name).write_text(part.text, encoding="utf-8")
            elif part.kind == "printed":
                missing = [
                    line
                    for line in part.text.splitlines()
                    if line.strip() and not was_printed(line, printed)
                ]
                if said and missing:
                    said(f"NOT PRINTED, {where}: {missing}\n")
                assert said or not missing, f"{where}: not printed: {missing}; but\n{printed}"
            else:
                begun = time.perf_counter()
                printed = (
                    run_python(part.text, names, where)
                    if part.language == "python"
                    else run_all(part.text, where)
                )
                if said:
                    said(f"--- {where} ({time.perf_counter() - begun:.1f} s)\n{printed}")


def run_python(text: str, names: dict[str, object], where: str) -> str:
    """Run a block of Python with the names of those before it, and return what it prints."""
    with contextlib.redirect_stdout(io.StringIO()) as caught:
        exec(compile(text, where, "exec", dont_inherit=True), names)
    return caught.getvalue()


def run_all(text: str, where: str) -> str:
    """Run the command lines of a block, and return what they print."""
    return "".join(run_command(line, where) for line in commands(text))


def commands(text: str) -> list[str]:
    """Command lines of a block, those that end with a backslash joined to the next."""
    joined = re.sub(r"\\\n\s*", "", text)
    return [
        line for line in joined.splitlines() if line.strip() and not line.lstrip().startswith("#")
    ]


def run_command(line: str, where: str) -> str:
    """Run one `myomorph` command in this process, and return what it prints."""
    from myomorph.lab.cli import main

    words = shlex.split(line, comments=True)
    assert words[0] == "myomorph", f"{where}: only commands of this program run: {line}"
    with (
        contextlib.redirect_stdout(io.StringIO()) as out,
        contextlib.redirect_stderr(io.StringIO()) as told,
    ):
        status = main(words[1:])
    printed = out.getvalue() + told.getvalue()
    assert status == 0, f"{where}: {line}: exit status {status}: {printed}"
    return printed


def was_printed(line: str, printed: str) -> bool:
    """Whether a line is among those printed: the same words, and numbers that are near."""
    return any(_alike(line.strip(), other.strip()) for other in printed.splitlines())


def _alike(line: str, other: str) -> bool:
    if NUMBER.sub("#", line).split() != NUMBER.sub("#", other).split():
        return False
    numbers = [float(found) for found in NUMBER.findall(line)]
    others = [float(found) for found in NUMBER.findall(other)]
    return all(
        abs(a - b) <= NEAR * max(abs(a), abs(b)) for a, b in zip(numbers, others, strict=True)
    )


@contextlib.contextmanager
def working_in(folder: Path) -> Iterator[None]:
    """Change the working folder for a while."""
    before = Path.cwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)


if __name__ == "__main__":
    collection = Path(os.environ["MYOMORPH_DATA"])
    Path(sys.argv[2]).mkdir(parents=True, exist_ok=True)
    run_page(
        Path(sys.argv[1]).resolve(),
        Path(sys.argv[2]).resolve(),
        collection.joinpath,
        sys.stdout.write,
    )
