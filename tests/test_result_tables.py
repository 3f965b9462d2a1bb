"""Tables of results: every one has a command that makes it and a page that shows it."""

from __future__ import annotations

import ast
from functools import cache

import pytest
from benchmarks.__main__ import COMPARISONS
from benchmarks.accuracy.claims import claim_rows
from benchmarks.accuracy.sections import PAGES
from benchmarks.results import FOLDER, LOG, cell, load, save
from docs_build.navigation import navigation, pages_of, with_listed
from docs_build.tables import DOCS, as_markdown, chosen, number, pages_of_tables, rendered

ROOT = DOCS.parent
TABLES = sorted(
    path.relative_to(FOLDER).with_suffix("").as_posix() for path in FOLDER.rglob("*.csv")
)
MEASURED = {
    f"validation/{table}": place for tables in PAGES.values() for table, place in tables.items()
}


def test_every_table_is_shown_and_logged():
    tables = set(TABLES) - {LOG}
    assert set(pages_of_tables()) == tables
    assert {row["table"] for row in load(LOG)} == tables


def test_every_table_of_accuracy_is_measured_by_a_function():
    assert {table for table in TABLES if table.startswith("validation/")} == set(MEASURED)


@pytest.mark.parametrize("place", sorted(set(MEASURED.values())))
def test_what_measures_a_table_exists(place):
    module, function = place.split(":")
    tree = ast.parse(
        (ROOT / "benchmarks" / f"{module.replace('.', '/')}.py").read_text(encoding="utf-8")
    )
    assert function in {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}


def test_commands_of_the_log_exist():
    for row in load(LOG):
        folder, _, table = row["table"].rpartition("/")
        if folder == "performance":
            words = row["command"].removeprefix("python -m benchmarks ").split()
            assert words[0] in COMPARISONS
            assert words[-1] == "--save"
            assert "-".join(word.removeprefix("--") for word in words[:-1]) == table
        else:
            name = table if folder else ""
            assert row["command"] == f"python -m benchmarks.validation {name}".strip()


def test_claims_are_those_of_the_tables():
    assert load("claims") == [
        {column: cell(value) for column, value in row.items()} for row in claim_rows()
    ]


@pytest.mark.parametrize(
    "page", sorted(DOCS.rglob("*.md")), ids=lambda page: page.relative_to(DOCS).as_posix()
)
def test_tables_and_numbers_of_a_page_exist(page):
    rendered(page.read_text(encoding="utf-8"), page.relative_to(DOCS).as_posix())


def test_a_saved_table_is_read_and_logged(tmp_path, monkeypatch):
    monkeypatch.setattr("benchmarks.results.FOLDER", tmp_path)
    save(
        "performance/a",
        [{"what": "x | y", "s": 0.012345}, {"what": "z", "MB": 1234.5}],
        "python -m benchmarks a",
    )
    assert load("performance/a") == [
        {"what": "x / y", "s": "0.0123", "MB": ""},
        {"what": "z", "s": "", "MB": "1234"},
    ]
    (row,) = load(LOG)
    assert row["command"] == "python -m benchmarks a"
    assert row["date"]
    assert "cores" in row["machine"]


def test_rows_are_chosen_and_empty_columns_left_out():
    rows = [{"a": "1", "b": "", "c": "x"}, {"a": "", "b": "2", "c": "y"}]
    assert chosen(rows, "rows with b") == [{"b": "2", "c": "y"}]
    assert chosen(rows, "rows without b") == [{"a": "1", "c": "x"}]
    assert chosen(rows, "rows with c = x") == [{"a": "1", "c": "x"}]
    with pytest.raises(ValueError, match="no rows"):
        chosen(rows, "rows with c = z")
    assert as_markdown([{"a": "1", "b": "2"}]) == "| a | b |\n| --- | --- |\n| 1 | 2 |\n"


def test_a_number_is_known_by_its_row_and_column():
    row = load("validation/kernels")[0]
    first = next(iter(row.values()))
    column = "largest difference"
    assert number(f"kernels | {first} | {column}") == row[column]
    with pytest.raises(ValueError, match="0 rows"):
        number(f"kernels | nothing | {column}")
    with pytest.raises(ValueError, match="the columns are"):
        number(f"kernels | {first} | nothing")
    with pytest.raises(FileNotFoundError):
        number("nothing | a | b")


def test_no_page_is_missing_from_navigation_and_index():
    groups = navigation()
    every = {path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md")} | {"changelog.md"}
    assert sorted(pages_of(groups)) == sorted(every)
    assert "More" not in {name for group in groups for name in group}, (
        "docs/index.md does not list these"
    )


def test_pages_of_a_folder_are_listed():
    text = with_listed("# Decisions\n\n[All](.)\n", "decisions/index.md")
    paths = {path.name for path in (DOCS / "decisions").glob("*.md")} - {"index.md"}
    assert all(f"]({name})" in text for name in paths)


@pytest.mark.parametrize(
    "path", sorted((ROOT / "benchmarks").rglob("*.py")), ids=lambda path: path.stem
)
def test_what_benchmarks_import_exists(path):
    homes = {"myomorph": ROOT / "src", "benchmarks": ROOT, "truths": ROOT / "tests"}
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and (
            home := homes.get(str(node.module).partition(".")[0])
        ):
            names = defined(home / node.module.replace(".", "/"))
            assert {alias.name for alias in node.names} <= names, f"{node.module} has no such names"


@cache
def defined(place):
    """Names that can be imported from a module or package."""
    names = {path.stem for path in place.glob("*")}
    sources = (place.with_suffix(".py"), place / "__init__.py", place / "__init__.pyi")
    for node in (
        node
        for path in sources
        if path.is_file()
        for node in ast.parse(path.read_text("utf-8")).body
    ):
        if isinstance(node, ast.Import | ast.ImportFrom):
            names |= {alias.asname or alias.name for alias in node.names}
        names.add(getattr(node, "name", ""))
        targets = getattr(node, "targets", [getattr(node, "target", None)])
        names |= {
            part.id
            for target in targets
            if target
            for part in ast.walk(target)
            if isinstance(part, ast.Name)
        }
    return names
