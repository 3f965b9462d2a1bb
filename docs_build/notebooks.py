"""Tutorials as Jupyter notebooks.

They are made of the pages' own marked blocks, and run as a user would run them.

`python -m docs_build.notebooks write FOLDER` writes one `.ipynb` per tutorial. `python -m
docs_build.notebooks run FOLDER [NAME ...]` runs those that are quick, or those named, each in a
kernel and a folder of its own. It compares what the cells print with the pages, and prints which
tutorials were left out and why. `MYOMORPH_DATA` names the folder of the recordings.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import sys
import time
from pathlib import Path
from typing import Any

from docs_build.examples import DOCS, MARK, Part, commands, parts_of, was_printed

TUTORIALS = DOCS / "tutorials"

LONG = {
    "whole-study": "runs several subjects in processes of their own, over a minute",
}
"""Tutorials that `run` leaves out unless they are named, and why."""

DATA = """\
# {name} is a published recording; the page "Tutorials" says where to get it.
import os
import shutil
from pathlib import Path

if not Path("{name}").exists():
    if "MYOMORPH_DATA" not in os.environ:
        missing = "put the folder '{name}' beside this notebook, or set MYOMORPH_DATA"
        raise FileNotFoundError(missing)
    shutil.copytree(Path(os.environ["MYOMORPH_DATA"], "{name}"), "{name}")
"""

COLORS = re.compile(r"\x1b\[[0-9;]*m")
"""What a terminal is told, as which a cell appears to a command."""

STATUS = "assert _exit_code == 0, f'exit status {_exit_code}'"
"""What a run adds after each command: IPython passes over a command that fails."""


def tutorials() -> list[Path]:
    """Return the pages that become notebooks, in the order of their names."""
    return [page for page in sorted(TUTORIALS.glob("*.md")) if page.name != "index.md"]


def notebook_of(page: Path) -> dict[str, Any]:
    """Return a page as a notebook of format 4.5: its text unchanged, its marked blocks as cells.

    What a block prints on the page stands in the text, and in the metadata of the block's cell for
    `run_notebook`.
    """
    text = page.read_text(encoding="utf-8")
    cells = list[dict[str, Any]]()
    at = 0
    for mark, part in zip(MARK.finditer(text), parts_of(page), strict=True):
        _add_text(cells, text[at : mark.start()])
        # A file that is written, and commands, are shown as cells; what is printed stays text.
        if part.kind == "printed":
            _add_text(cells, f"It prints, among other things:\n\n```text\n{part.text}```\n")
            last = next(one for one in reversed(cells) if one["cell_type"] == "code")
            last["metadata"].setdefault("prints", []).extend(
                one for one in part.text.splitlines() if one.strip()
            )
        else:
            cells.append(_code(part))
        at = mark.end()
    _add_text(cells, text[at:])
    for number, cell in enumerate(cells):
        cell["id"] = f"cell-{number}"
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    return {"cells": cells, "metadata": {"kernelspec": kernel}, "nbformat": 4, "nbformat_minor": 5}


def notebook_text(page: Path) -> str:
    """Return a page as the text of a notebook file."""
    return json.dumps(notebook_of(page), indent=1, ensure_ascii=False) + "\n"


def _add_text(cells: list[dict[str, Any]], text: str) -> None:
    """Add text between cells, its links to other pages as the site has them."""
    text = re.sub(r"\]\(([\w./-]+)\.md(#[\w-]+)?\)", r"](\1.html\2)", text.strip("\n"))
    if text:
        cells.append({"cell_type": "markdown", "metadata": {}, "source": text})


def _code(part: Part) -> dict[str, Any]:
    """Return a marked block as a cell."""
    if part.kind == "data":
        source = DATA.format(name=part.name)
    elif part.kind == "file":
        source = f"%%writefile {part.name}\n{part.text}"
    elif part.language == "python":
        source = part.text
    else:
        source = "\n".join(f"!{line}" for line in commands(part.text))
    cell = {
        "cell_type": "code",
        "metadata": {},
        "source": source.rstrip("\n"),
        "outputs": [],
        "execution_count": None,
    }
    if part.kind == "data":
        cell["metadata"] = {"data": part.name}
    return cell


def run_notebook(page: Path, folder: Path, timeout: int = 600) -> None:
    """Run a page as a notebook in a kernel.

    Parameters
    ----------
    page : of the documentation
    folder : to work in
    timeout : of one cell [s]

    Raises
    ------
    AssertionError
        where a cell fails, or does not print what the page says
    """
    # Of the extra `test`: pages are written without.
    import nbformat
    from nbclient import NotebookClient
    from nbclient.exceptions import CellExecutionError

    made = notebook_of(page)
    for cell in made["cells"]:
        if cell["cell_type"] == "code" and cell["source"].startswith("!"):
            cell["source"] = "\n".join(f"{line}\n{STATUS}" for line in cell["source"].splitlines())
    notebook = nbformat.from_dict(made)
    # `!myomorph` is the program of this Python, whatever else is on the path.
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    client = NotebookClient(
        notebook, timeout=timeout, resources={"metadata": {"path": str(folder)}}
    )
    try:
        client.execute(env=os.environ | {"PATH": path, "COLUMNS": "1000"})
    except CellExecutionError as error:
        raise AssertionError(f"{page.name}: {error}") from None
    for cell in notebook.cells:
        printed = COLORS.sub("", "".join(one.get("text", "") for one in cell.get("outputs", ())))
        missing = [
            line for line in cell.metadata.get("prints", ()) if not was_printed(line, printed)
        ]
        assert not missing, f"{page.name}: not printed: {missing}; but\n{printed}"


def missing_data(page: Path) -> str:
    """Why a page cannot run here, "" where it can."""
    collection = os.environ.get("MYOMORPH_DATA", "")
    for part in parts_of(page):
        if part.kind == "data" and not (collection and Path(collection, part.name).is_dir()):
            return (
                f"needs the data set '{part.name}': set MYOMORPH_DATA to the folder that holds it"
            )
    return ""


def main(words: list[str]) -> int:
    """Write notebooks, or run them and print the outcome of each; the exit status."""
    verb = words[0]
    folder = Path(words[1])
    names = words[2:]
    failed = 0
    for page in tutorials():
        place = folder / page.stem
        if verb == "write":
            folder.mkdir(parents=True, exist_ok=True)
            place.with_suffix(".ipynb").write_text(notebook_text(page), encoding="utf-8")
            continue
        if names and page.stem not in names:
            continue
        why = missing_data(page) or ("" if names else LONG.get(page.stem, ""))
        if why:
            sys.stdout.write(f"{page.stem}: left out: {why}\n")
            continue
        shutil.rmtree(place, ignore_errors=True)
        place.mkdir(parents=True)
        begun = time.perf_counter()
        try:
            run_notebook(page, place)
            outcome = "ran"
        except AssertionError as error:
            failed += 1
            outcome = f"FAILED: {error}"
        sys.stdout.write(f"{page.stem}: {outcome} ({time.perf_counter() - begun:.0f} s)\n")
        sys.stdout.flush()
    return 1 if failed else 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
