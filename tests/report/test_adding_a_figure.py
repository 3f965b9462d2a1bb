"""The example of docs/adding.md adds a kind of chart from outside the package, and a page shows it."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lxml import etree, html

ADDING = Path(__file__).parents[2] / "docs" / "adding.md"


@pytest.fixture(scope="module")
def example() -> dict[str, Any]:
    """Names that the example defines."""
    section = ADDING.read_text(encoding="utf-8").split("## A figure\n")[1].split("\n## ")[0]
    (code,) = re.findall(r"```python\n(.*?)```", section, re.DOTALL)
    names: dict[str, Any] = {}
    exec(compile(code, str(ADDING), "exec"), names)
    return names


def test_the_page_has_the_new_figure(example: dict[str, Any]) -> None:
    page = html.document_fromstring(example["page"].encode("utf-8"), parser=html.HTMLParser(encoding="utf-8"))
    (figure,) = page.xpath("//section[@id='speeds']//figure")
    assert figure.xpath("string(figcaption)") == "All trials of the study."
    (drawn,) = figure.xpath("svg[@aria-label='Walking speed']")
    assert len(drawn.xpath(".//rect")) == 8
    assert page.xpath("//nav/a[@href='#speeds']/text()") == ["Walking speed"]


def test_its_bars_are_as_high_as_their_counts(example: dict[str, Any]) -> None:
    values = np.array([0.0, 0.1, 0.2, 1.0])
    drawn = etree.fromstring(example["histogram"]("T", "m", values, 2))
    many, few = (float(one) for one in drawn.xpath("//rect/@height"))
    assert many == pytest.approx(3.0 * few, abs=0.2)
    assert drawn.xpath("string(//rect/title)") == "0 to 0.500 m: 3"
    assert drawn.xpath("count(//text[contains(@class, 'tick y')])") > 2
