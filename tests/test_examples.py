"""What the documentation says to type runs, and prints what the pages show."""

from __future__ import annotations

import ast
import builtins
import functools
import importlib
import re
import textwrap

import pytest
from docs_build.examples import DOCS, Part, pages_that_run, parts_of, run_page, was_printed

LONG = {"whole-study.md", "shoulder.md"}
"""Those that take about 10 s on a quiet machine, what is compiled once apart."""

ELSEWHERE = {"other-bones.md"}
"""Those that `tests/demo/test_morph_demo.py` runs, which looks at what their commands find."""

STANDARD = {"replace", "Path"}
"""Of the standard library, in blocks that leave the imports out."""


def cases():
    for page in pages_that_run():
        name = page.relative_to(DOCS).as_posix()
        if page.name not in ELSEWHERE:
            yield pytest.param(page, id=name, marks=pytest.mark.long if page.name in LONG else ())


@pytest.mark.parametrize("page", list(cases()))
def test_page_runs(page, data, tmp_path, in_process):
    run_page(page, tmp_path, data)


def test_every_tutorial_runs():
    tutorials = {page for page in (DOCS / "tutorials").glob("*.md") if page.name != "index.md"}
    assert tutorials
    assert tutorials <= set(pages_that_run())


def test_parts_are_found(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(
        "# A\n\n<!-- data: walk -->\n\n<!-- file: a.toml -->\n```toml\nx = 1\n```\n",
        encoding="utf-8",
    )
    assert parts_of(page) == [
        Part(kind="data", name="walk", language="", text="", line=3),
        Part(kind="file", name="a.toml", language="toml", text="x = 1\n", line=5),
    ]


def test_marks_without_a_block_are_told(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("<!-- runs -->\n\n```sh\nmyomorph demo\n```\n", encoding="utf-8")
    with pytest.raises(ValueError, match=r"page.md, line 1"):
        parts_of(page)


def test_other_numbers_and_other_words_are_not_what_was_printed():
    printed = "136 frames, rms 1.27 cm\n"
    assert was_printed("136 frames, rms 1.28 cm", printed)
    assert not was_printed("136 frames, rms 1.47 cm", printed)
    assert not was_printed("136 frames, rms 1.27 m", printed)


def test_a_command_that_fails_is_told(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("<!-- runs -->\n```sh\nmyomorph info nothing.trc\n```\n", encoding="utf-8")
    with pytest.raises(AssertionError, match=r"page.md, line 1.*exit status 2"):
        run_page(page, tmp_path, lambda name: tmp_path)


@functools.cache
def package_names():
    """Return the argument names of public functions and classes of the package, by name.

    They are None where it takes any.
    """
    found: dict[str, list[set[str] | None]] = {}
    for file in (DOCS.parent / "src" / "myomorph").rglob("*.py"):
        for node in ast.parse(file.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.FunctionDef):
                found.setdefault(node.name, []).append(_argument_names(node))
            elif isinstance(node, ast.ClassDef):
                found.setdefault(node.name, []).append(_field_names(node))
    return found


def _argument_names(function):
    """Return the names of a function's arguments, None where it takes any."""
    given = function.args
    named = {one.arg for one in (*given.posonlyargs, *given.args, *given.kwonlyargs)}
    return None if given.kwarg else named


def _field_names(kind):
    """Return what a class takes: fields and arguments of `__init__`; None where a base decides."""
    fields = {one.target.id for one in kind.body if isinstance(one, ast.AnnAssign)}
    made = [one for one in kind.body if isinstance(one, ast.FunctionDef) and one.name == "__init__"]
    for init in made:
        fields |= {one.arg for one in (*init.args.args, *init.args.kwonlyargs)}
    return None if kind.bases and not made else fields


def python_blocks():
    for page in [DOCS.parent / "README.md", *sorted(DOCS.rglob("*.md"))]:
        text = page.read_text(encoding="utf-8")
        above = frozenset[str]()
        for block in re.finditer(r"^( *)```python\n(.*?)^\1```", text, re.MULTILINE | re.DOTALL):
            own = textwrap.dedent(block[2])
            yield pytest.param(
                own, above, id=f"{page.name}:{text.count(chr(10), 0, block.start()) + 1}"
            )
            for node in ast.parse(own).body:
                if isinstance(node, ast.FunctionDef | ast.ClassDef):
                    above |= {node.name}
                elif isinstance(node, ast.ImportFrom):
                    above |= {alias.asname or alias.name for alias in node.names}


@pytest.mark.parametrize(("text", "above"), list(python_blocks()))
def test_python_calls_what_exists(text, above):
    """Also blocks that are parts of a program.

    What they import exists, and what they call takes those arguments. Functions, classes and
    imports of blocks above on the same page (`above`) exist, too.
    """
    tree = ast.parse(text)
    known = _bound_names(tree) | above | STANDARD
    wrong = []
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("myomorph"):
            module = importlib.import_module(node.module)
            names = [one.name for one in node.names]
            wrong += [f"{node.module}.{name}" for name in names if not hasattr(module, name)]
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            name = node.func.id
            if name not in known and not hasattr(builtins, name):
                wrong += _wrong_call(node, name)
    assert wrong == []


def _bound_names(tree):
    """Return names that a block assigns, defines, or imports from elsewhere than the package."""
    bound = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            bound.add(node.id)
        elif isinstance(node, ast.FunctionDef | ast.ClassDef):
            bound.add(node.name)
        elif isinstance(node, ast.Import) or _is_foreign(node):
            bound |= {(one.asname or one.name).split(".")[0] for one in node.names}
    return bound


def _is_foreign(node):
    return isinstance(node, ast.ImportFrom) and not (node.module or "").startswith("myomorph")


def _wrong_call(node, name):
    """Return a call of the package with the arguments that nothing of this name takes."""
    given = {one.arg for one in node.keywords if one.arg}
    if any(takes is None or given <= takes for takes in package_names().get(name, [])):
        return []
    return [f"{name}({', '.join(sorted(given))})"]
