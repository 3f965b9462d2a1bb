"""Tables written as TOML are read back by Python as they were."""

from __future__ import annotations

import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from myomorph.core.io.parsing.toml import toml_text

PLAIN = st.one_of(
    st.text(st.characters(exclude_categories=("Cs",))),
    st.booleans(),
    st.integers(-(2**62), 2**62),
    st.floats(allow_nan=False),
)
KEYS = st.text(st.characters(exclude_categories=("Cs",)), max_size=6)
VALUES = st.recursive(
    PLAIN,
    lambda inner: st.one_of(st.lists(inner, max_size=4), st.dictionaries(KEYS, inner, max_size=4)),
    max_leaves=20,
)


@given(st.dictionaries(KEYS, VALUES, max_size=5))
def test_what_is_written_is_read_back(table):
    assert tomllib.loads(toml_text(table)) == table


def test_a_study_reads_as_one_would_write_it():
    study = {
        "study": {"name": "walk"},
        "options": {"id": {"cutoff": 6.0}},
        "subject": [{"name": "s01", "steps": ("ik", "id"), "trials": [{"markers": "walk.trc"}]}],
    }
    expected = """# Written by a test

[study]
name = "walk"

[options.id]
cutoff = 6.0

[[subject]]
name = "s01"
steps = ["ik", "id"]

[[subject.trials]]
markers = "walk.trc"
"""
    assert toml_text(study, ["Written by a test\n"]) == expected


def test_a_long_array_has_a_line_for_each_value():
    text = toml_text({"assumed": ["a" * 60, "b" * 60]})
    assert text == f'assumed = [\n    "{"a" * 60}",\n    "{"b" * 60}",\n]\n'


def test_what_toml_cannot_hold_is_refused():
    with pytest.raises(TypeError, match="NoneType"):
        toml_text({"mass": None})
