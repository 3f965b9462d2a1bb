"""Words of the site are counted by section, and every section of the core exists."""

from __future__ import annotations

import pytest
from docs_build import words
from docs_build.command_line import with_commands
from docs_build.navigation import navigation, pages_of
from docs_build.words import CORE, Section, sections, table


def entries_of(name):
    """Entries of a group of the navigation."""
    return next(group[name] for group in navigation() if name in group)


def test_a_word_has_a_letter_or_a_digit(tmp_path, monkeypatch):
    (tmp_path / "page.md").write_text("# A page\n\n| one | 2 |\n|---|---|\n", encoding="utf-8")
    monkeypatch.setattr(words, "DOCS", tmp_path)
    assert words.words_of("page.md") == 4


def test_every_page_is_counted_once():
    counted = sections()
    pages = [page for page in pages_of(navigation()) if page != "changelog.md"]
    assert sum(section.pages for section in counted) == len(pages) == len(set(pages))
    assert [section.name for section in counted if section.core] == list(CORE)


def test_the_table_sums_the_core_first():
    counted = [
        Section(name="Swings", pages=1, words=5),
        Section(name="Tasks", pages=2, words=1000),
        Section(name="Method", pages=1, words=300),
    ]
    assert table(counted).splitlines()[2:] == [
        "| Tasks | 2 | 1,000 |",
        "| Method | 1 | 300 |",
        "| **Core** | 3 | 1,300 |",
        "| Swings | 1 | 5 |",
    ]


def test_a_task_of_one_page_is_its_page():
    entries = {name: pages for task in entries_of("Tasks") for name, pages in task.items()}
    assert entries["Joint loads"] == "joint-loads.md"
    assert "studies.md" in entries["Many trials and groups"]


def test_the_help_of_every_command_takes_the_place_of_its_mark():
    page = with_commands("# Command line\n\n<!-- commands -->\n")
    assert "## tension\n\n```text\nUsage: myomorph tension" in page
    assert "--co-contraction" in page
    assert with_commands("nothing") == "nothing"


@pytest.mark.parametrize("name", CORE[1:])
def test_groups_of_the_core_have_pages(name):
    assert pages_of(entries_of(name))
