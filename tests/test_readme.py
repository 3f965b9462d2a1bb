"""The README: its numbers are those of the tables, its pictures are small, its versions agree."""

from __future__ import annotations

import re
import tomllib

import pytest
import yaml
from benchmarks.__main__ import COMPARISONS
from benchmarks.accuracy.sections import PAGES as TABLES
from benchmarks.results import load
from docs_build.readme import MARKED, README, shown, with_addresses, with_numbers

import myomorph

ROOT = README.parent
TEXT = README.read_text(encoding="utf-8")
MEASURED = TEXT.split("## Five numbers")[1].split("\n## ")[0]
ROWS = [line for line in MEASURED.splitlines() if line.startswith("| **")]
MAX_LINES = 115
MAX_BYTES = 1_500_000


def test_numbers_are_those_of_the_tables():
    """Where they are not: `python -m docs_build.readme` puts them in."""
    assert with_numbers(TEXT) == TEXT
    assert len(MARKED.findall(TEXT)) >= 9


def test_each_of_five_numbers_has_the_command_that_measured_its_table():
    log = {row["table"]: row["command"].removesuffix(" --save") for row in load("commands")}
    assert len(ROWS) == 5
    for row in ROWS:
        (command,) = re.findall(r"\| `(python [^`]+)` \|$", row)
        words = [found["words"].removeprefix("count: ") for found in MARKED.finditer(row)]
        tables = {text.partition(" :: ")[0] for text in words}
        named = {table if "/" in table else f"validation/{table}" for table in tables}
        assert {log[table] for table in named} == {command}, row


def test_no_bold_number_stands_there_by_itself():
    """In the table of measured numbers each has its cell, but for names of programs and models."""
    for row in ROWS:
        bare = MARKED.sub("", row).rpartition("|")[0].rpartition("|")[0]
        left = re.findall(r"(?<![\w.])\d[\d.,]*", re.sub(r"OpenSim 4\.6|\d+ muscles", "", bare))
        assert left == [], row


def test_numbers_have_as_many_digits_as_readers_need():
    (knee,) = [row for row in load("validation/knee") if row["RMS of the force [BW]"] == "default"]
    assert shown("knee :: default :: total, mean") == f"{float(knee['total, mean']):.2f}"
    assert shown("count: laboratories") == str(len(load("validation/laboratories")))
    stale = "9<!-- knee :: default :: total, mean -->"
    assert with_numbers(stale).startswith(f"{float(knee['total, mean']):.2f}<!--")


def test_commands_of_the_numbers_exist():
    names = {table for tables in TABLES.values() for table in tables}
    for module, word in re.findall(r"`python -m (benchmarks[\w.]*) (\w+)`", MEASURED):
        assert word in (COMPARISONS if module == "benchmarks" else names)


def test_pictures_are_there_with_a_text_and_small():
    moving = re.findall(r"!\[(?P<text>[^\]]*)\]\((?P<name>[^)]+)\)", TEXT)
    still = re.findall(r'<img src="(?P<name>[^"]+)" width="\d+" alt="(?P<text>[^"]+)">', TEXT)
    assert (len(moving), len(still)) == (1, 1)
    for text, name in (*moving, still[0][::-1]):
        assert len(text) > 60
        assert (ROOT / name).stat().st_size <= MAX_BYTES


def test_the_first_picture_moves_and_is_white():
    image = pytest.importorskip("PIL.Image", reason="needs the extra 'view'")
    name = re.search(r"!\[[^\]]*\]\(([^)]+)\)", TEXT)
    assert name is not None
    with image.open(ROOT / name[1]) as movie:
        assert movie.n_frames > 20
        assert movie.size[0] == 760
        assert movie.convert("RGB").getpixel((movie.size[0] - 1, 0)) == (255, 255, 255)


def test_no_bar_stands_within_a_cell_of_a_table():
    for line in MEASURED.splitlines():
        assert line.count("|") in (0, 3)


def test_the_readme_is_short():
    assert len(TEXT.splitlines()) <= MAX_LINES


def test_those_who_cite_find_the_version():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert citation["version"] == myomorph.__version__
    assert f"version = {{{myomorph.__version__}}}" in TEXT
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert citation["license"] == project["license"]


def test_links_for_an_index_of_packages():
    text = '[a](docs/a.md) [b](https://c.d) ![e](docs/e.gif) <img src="docs/f.png">'
    there = "https://web/raw"
    assert with_addresses(text, f"{there}/") == (
        f"[a]({there}/docs/a.md) [b](https://c.d) ![e]({there}/docs/e.gif)"
        f' <img src="{there}/docs/f.png">'
    )
