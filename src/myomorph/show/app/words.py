"""Sentences of the command line in the words of the page: an option is a field there."""

from __future__ import annotations

import re

FIELDS = {
    "--mass": "Body mass",
    "--height": "Height",
    "--age": "Age",
    "--static": "Standing still",
    "--protocol": "Markers without a known name",
    "--arms": "With arms",
    "--model": "Model",
    "--out": "Results go to",
}
"""Labels of the page's fields, by the option that says the same."""
OPTION = re.compile(r"(--[a-z]+(?:-[a-z]+)*)(?: (?:FILE|KG|TABLE\.toml|\S+\.toml))?")


def in_page_words(text: str) -> str:
    """Sentence with fields in the place of options, those that are no field left as they are.

    Parameters
    ----------
    text : of the command line
    """

    def field_of(found: re.Match[str]) -> str:
        name = FIELDS.get(found[1])
        return found[0] if name is None else f"“{name}”"

    return OPTION.sub(field_of, text)
