"""Misspelt options and keys are answered by the nearest name.

Keys in a wrong table are answered by where they belong.
"""

from __future__ import annotations

import pytest
from benchmarks.accuracy.laboratory.misspelt import (
    KEYS,
    OPTIONS,
    answer_to_key,
    answer_to_option,
    named,
)


@pytest.mark.parametrize("text", OPTIONS)
def test_options(text):
    assert named(text, answer_to_option(text))


@pytest.mark.parametrize("text", KEYS)
def test_keys(text, tmp_path):
    assert named(text, answer_to_key(text, tmp_path))
