"""Texts that a spreadsheet would run as formulas are texts in the tables that we write."""

from __future__ import annotations

import csv

import pytest

from myomorph.core.io.parsing.text import spreadsheet_cell, write_csv


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
