"""What the documentation says to type runs, and prints what the pages show."""

from __future__ import annotations

import pytest
from docs_build.examples import DOCS, Part, pages_that_run, parts_of, run_page, was_printed

# Those that take less than 10 s on a quiet machine; the others are marked long.
SHORT = {"walking.md", "opensim-setups.md", "studies.md"}


def cases():
    for page in pages_that_run():
        name = page.relative_to(DOCS).as_posix()
        yield pytest.param(page, id=name, marks=() if page.name in SHORT else pytest.mark.long)


@pytest.mark.parametrize("page", cases())
def test_page_runs(page, data, tmp_path):
    run_page(page, tmp_path, data)


def test_every_tutorial_runs():
    tutorials = {page for page in (DOCS / "tutorials").glob("*.md") if page.name != "index.md"}
    assert tutorials
    assert tutorials <= set(pages_that_run())


def test_parts_are_found(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("# A\n\n<!-- data: walk -->\n\n<!-- file: a.toml -->\n```toml\nx = 1\n```\n", encoding="utf-8")
    assert parts_of(page) == [Part("data", "walk", "", "", 3), Part("file", "a.toml", "toml", "x = 1\n", 5)]


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
