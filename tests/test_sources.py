"""The table of both sources: every number is a cell of a table that a command wrote."""

from __future__ import annotations

import pytest
from benchmarks.results import LOG, cell, load
from benchmarks.sources import run, source_rows
from docs_build.tables import number

ROWS = source_rows()


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{row.source} {row.what}")
def test_numbers_of_a_row_are_cells_of_tables_with_a_command(row):
    commands = {each["table"]: each["command"] for each in load(LOG)}
    for where in row.cells:
        assert number(where)
    assert all(commands[table].startswith("python -m benchmarks") for table in row.tables)
    assert row.source.startswith(("[S]", "[D]"))


def test_rows_stand_once():
    assert len({(row.source, row.what) for row in ROWS}) == len(ROWS)


def test_the_saved_table_has_the_numbers_of_now():
    assert load("performance/sources") == [
        {column: cell(value) for column, value in row.items()} for row in run()
    ]


def test_a_cell_that_does_not_exist_is_refused(tmp_path):
    list_ = tmp_path / "sources.toml"
    list_.write_text(
        '[[row]]\nsource = "[S]"\nwhat = "a"\ntruth = "b"\ncells = ["virtual_joints | x | y"]\n'
    )
    (row,) = source_rows(list_)
    with pytest.raises(ValueError, match="0 rows"):
        number(row.cells[0])
