"""Tutorials are notebooks too.

They are made of the pages, complete, and run in a kernel. `.ci/run` runs the quick ones.
"""

from __future__ import annotations

import ast
import os
import re

import pytest
from docs_build.examples import DOCS, commands, parts_of
from docs_build.notebooks import (
    LONG,
    main,
    missing_data,
    notebook_of,
    notebook_text,
    run_notebook,
    tutorials,
)

PAGES = [pytest.param(page, id=page.stem) for page in tutorials()]


@pytest.mark.parametrize("page", PAGES)
def test_a_notebook_holds_all_of_its_page(page):
    nbformat = pytest.importorskip("nbformat")
    notebook = nbformat.reads(notebook_text(page), as_version=4)
    nbformat.validate(notebook)
    code = [one.source for one in notebook.cells if one.cell_type == "code"]
    parts = parts_of(page)
    assert len(code) == sum(part.kind != "printed" for part in parts)
    for part in parts:
        if part.kind == "runs" and part.language == "python":
            assert part.text.rstrip() in code
        elif part.kind == "runs":
            assert "\n".join(f"!{one}" for one in commands(part.text)) in code
    for cell in code:
        if not cell.startswith(("!", "%%")):
            ast.parse(cell)
    text = "\n".join(one.source for one in notebook.cells if one.cell_type == "markdown")
    assert text.startswith("# ")
    assert "<!--" not in text
    assert ".md)" not in text


@pytest.mark.parametrize("page", PAGES)
def test_a_notebook_imports_the_public_package_alone(page):
    code = "\n".join(part.text for part in parts_of(page) if part.language == "python")
    imports = [line for line in code.splitlines() if re.match(r"\s*(from|import) myomorph", line)]
    assert set(imports) <= {"import myomorph as mm"}
    assert not re.search(r"\bmm\.[\w.]*\._", code)


def test_long_ones_are_named_with_a_reason():
    assert set(LONG) < {page.stem for page in tutorials()}
    assert all(LONG.values())


def test_a_notebook_runs_in_a_kernel(data, tmp_path, monkeypatch):
    """The page of the mouse: a command, Python cells, and what they print."""
    pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    monkeypatch.setenv("MYOMORPH_DATA", str(data("mouse-gait-c3d-force").parent))
    run_notebook(DOCS / "tutorials" / "mouse.md", tmp_path)


PAGE = """# A

<!-- runs -->
```sh
myomorph info nothing.trc
```
"""


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (PAGE, "exit status 2"),
        (PAGE.replace("```sh\nmyomorph info nothing.trc", "```python\n1 / 0"), "ZeroDivisionError"),
        (
            PAGE.replace("```sh\nmyomorph info nothing.trc", "```python\nprint('2.5 cm')")
            + "\n<!-- printed -->\n```text\n2.7 cm\n```\n",
            r"not printed: \['2.7 cm'\]",
        ),
    ],
)
def test_a_notebook_that_goes_wrong_fails(tmp_path, text, why):
    pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    page = tmp_path / "page.md"
    page.write_text(text, encoding="utf-8")
    with pytest.raises(AssertionError, match=why):
        run_notebook(page, tmp_path)


def test_without_recordings_the_reason_is_given(tmp_path, monkeypatch, capsys):
    monkeypatch.delenv("MYOMORPH_DATA", raising=False)
    assert "needs the data set 'mouse-gait-c3d-force'" in missing_data(
        DOCS / "tutorials" / "mouse.md"
    )
    assert main(["run", os.fspath(tmp_path), "mouse"]) == 0
    assert "mouse: left out: needs the data set" in capsys.readouterr().out


def test_the_collection_is_not_written_into(tmp_path):
    """Each notebook copies what it reads."""
    cells = [
        one
        for page in tutorials()
        for one in notebook_of(page)["cells"]
        if one["metadata"].get("data")
    ]
    assert cells
    assert all("shutil.copytree" in one["source"] for one in cells)
