"""Pages for people who read with a program, or without a mouse: what axe-core found once."""

from __future__ import annotations

import re

import pytest

from myomorph.lab.report.trial.trial_page import report_page
from walker import everything


@pytest.fixture(scope="module")
def page() -> str:
    return report_page(everything(100))


def test_every_heading_of_a_column_says_something(page):
    assert "<th" in page
    assert not re.findall(r"<th[^>]*>\s*</th>", page)


def test_every_drawing_has_a_name(page):
    labels = re.findall(r'<svg[^>]*role="img"[^>]*aria-label="([^"]*)"', page)
    assert labels
    assert all(label.strip() for label in labels)


def test_what_scrolls_sidewards_is_reached_by_the_keyboard(page):
    places = re.findall(r'<div class="scroll"[^>]*>', page)
    assert places
    assert all('tabindex="0"' in place for place in places)
