"""Texts that a spreadsheet would run as formulas are texts in the tables that we write."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

import myomorph
from myomorph.core.io.contact_events import read_events
from myomorph.core.io.labels import read_labels
from myomorph.core.io.parsing.cells import FORMULA, csv_records, csv_rows, spreadsheet_cell
from myomorph.core.io.parsing.text import csv_text, write_csv
from myomorph.core.model.causes import READING
from myomorph.core.model.errors import BadData, BadFile
from myomorph.lab.study.trial.message_table import read_messages, write_messages

FOREIGN = {"people.py", "names.py", "norm_file.py", "dataset.py", "signals.py"}
"""Modules that read tables of the package itself, of BIDS (which knows no apostrophes), or record
by record.
"""


@pytest.mark.parametrize("text", ["=1+1", "+cmd", "-cmd", "@SUM(A1)", "\t=1", '=HYPERLINK("x")'])
def test_a_formula_is_a_text(tmp_path, text):
    assert spreadsheet_cell(text) == f"'{text}"
    write_csv(tmp_path / "a.csv", (text, "b"), [(text, 1.0)])
    with (tmp_path / "a.csv").open(newline="", encoding="utf-8") as stream:
        head, row = csv.reader(stream)
    assert head[0] == row[0] == f"'{text}"


@pytest.mark.parametrize("cell", ["-1.5", "+2e3", "-inf", "-", "soleus_r", "", "a=b", -3.0, None])
def test_other_cells_stay(cell):
    assert spreadsheet_cell(cell) == cell


@given(st.lists(st.text(st.characters(exclude_categories=("Cs",), exclude_characters="\0\r\n"))))
@example(["'=1+1", "''=1", "'", "'-1.5", "=", "'t Hart", "@a", "-1", "\t-b"])
def test_what_is_written_is_read(row):
    """And nothing that is written begins like a formula, but numbers and single characters."""
    cells = ["first", *row]
    text = csv_text(cells, [cells])
    assert list(csv_rows(io.StringIO(text, newline=""))) == [cells, cells]
    for cell in map(spreadsheet_cell, row):
        if cell.startswith(FORMULA) and len(cell.strip()) > 1:
            float(cell)
    names = dict.fromkeys(cells)
    (record,) = csv_records(io.StringIO(csv_text(names, [names]), newline=""))
    assert record == {name: name for name in names}


def test_tables_of_ours_give_their_texts_again(tmp_path):
    messages = (READING.message("=HYPERLINK(1) was left out"), READING.message("'-a' is no name"))
    write_messages(tmp_path / "messages.csv", messages)
    assert [str(each) for each in read_messages(tmp_path / "messages.csv")] == list(
        map(str, messages)
    )
    write_csv(tmp_path / "labels.csv", ("label", "marker"), [("-LASI", "+L.ASIS")])
    assert read_labels(tmp_path / "labels.csv") == {"-LASI": "+L.ASIS"}


def test_all_other_tables_are_read_at_one_place():
    sources = Path(myomorph.__file__).parent.rglob("*.py")
    readers = ("csv.reader(", "csv.DictReader(")
    found = {
        path.name for path in sources if any(name in path.read_text("utf-8") for name in readers)
    }
    assert found == FOREIGN | {"cells.py"}


@pytest.mark.parametrize("read", [csv_rows, csv_records])
def test_a_cell_longer_than_any_text_is_an_error_of_the_package(read):
    with pytest.raises(BadData, match="cells of a table cannot be told apart"):
        list(read(["site,start,stop", f"{'x' * (csv.field_size_limit() + 1)},0,1"]))


def test_a_table_of_contacts_with_such_a_cell_is_named(tmp_path):
    path = tmp_path / "contacts.csv"
    path.write_text(f"site,start,stop\n{'x' * (csv.field_size_limit() + 1)},0,1\n")
    with pytest.raises(BadFile, match="is no table of contacts"):
        read_events(path)
