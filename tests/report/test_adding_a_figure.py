"""A kind of chart from outside the package, and a page that shows it."""

from __future__ import annotations

import numpy as np
import pytest
from histogram_figure import histogram, page
from lxml import etree, html


def test_the_page_has_the_new_figure():
    shown = html.document_fromstring(page.encode("utf-8"), parser=html.HTMLParser(encoding="utf-8"))
    (figure,) = shown.xpath("//section[@id='speeds']//figure")
    assert figure.xpath("string(figcaption)") == "All trials of the study."
    (drawn,) = figure.xpath("svg[@aria-label='Walking speed']")
    assert len(drawn.xpath(".//rect")) == 8
    assert shown.xpath("//nav/a[@href='#speeds']/text()") == ["Walking speed"]


def test_its_bars_are_as_high_as_their_counts():
    values = np.array([0.0, 0.1, 0.2, 1.0])
    drawn = etree.fromstring(histogram("T", "m", values, 2))
    many, few = map(float, drawn.xpath("//rect/@height"))
    assert many == pytest.approx(3.0 * few, abs=0.2)
    assert drawn.xpath("string(//rect/title)") == "0 to 0.500 m: 3"
    assert drawn.xpath("count(//text[contains(@class, 'tick y')])") > 2
