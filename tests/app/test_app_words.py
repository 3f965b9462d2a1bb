"""Sentences of the command line in the words of the page."""

from __future__ import annotations

import pytest

from myomorph.show.app.words import FIELDS, in_page_words


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("give the mass (--mass KG)", "give the mass (“Body mass”)"),
        ("No model was given (--model FILE): legs", "No model was given (“Model”): legs"),
        ("a table (--protocol TABLE.toml)", "a table (“Markers without a known name”)"),
        ("no side (--emg-side left or right)", "no side (--emg-side left or right)"),
        ("nothing - at -- all", "nothing - at -- all"),
    ],
)
def test_options_become_fields(text, words):
    assert in_page_words(text) == words


def test_fields_are_on_the_page():
    from myomorph.show.app.server import page_file

    script = page_file("app.js").decode()
    assert [name for name in FIELDS.values() if name not in script] == []
