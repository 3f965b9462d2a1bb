import re

import pytest
from lxml import etree

from myomorph.core.model.contacts import Contacts, Touch
from myomorph.lab.analysis.contact_states import graph_rows
from myomorph.lab.report.charts.tracks import LEFT, RIGHT, WIDTH, Backdrop, contact_graph

TAP = Contacts(
    ("toe_l", "heel_r", "toe_r"),
    (
        Touch("heel_r", 1.0, 2.0),
        Touch("toe_r", 1.5, 2.5, confidence=0.6),
        Touch("heel_r", 4.0, 4.5),
    ),
)


def drawn(svg: str) -> etree._Element:
    return etree.fromstring(svg)


def place(time: float, span: tuple[float, float]) -> float:
    return LEFT + (time - span[0]) / (span[1] - span[0]) * (WIDTH - RIGHT - LEFT)


def test_a_line_for_every_touch_with_its_dots() -> None:
    """Figure 5.5 of [D]: lines from touch to leave.

    Rows are in the given order, right before left, unused sites too.
    """
    rows = graph_rows(TAP)
    assert [row.label for row in rows] == ["Right heel", "Right toe", "Left toe"]
    svg = drawn(contact_graph(rows, Backdrop((0.0, 5.0))))
    lines = [
        re.findall(r"[\d.]+", one) for one in svg.xpath("//g[contains(@class, 'touch')]/path/@d")
    ]
    ends = [(float(one[0]), float(one[2])) for one in lines]
    assert ends == [
        pytest.approx((place(touch.start, (0.0, 5.0)), place(touch.stop, (0.0, 5.0))), abs=0.06)
        for row in rows
        for touch in row.touches
    ]
    assert len(svg.xpath("//circle")) == 6
    assert len(svg.xpath("//circle[@class='open']")) == 3
    assert "60 %" in "".join(svg.xpath("//title/text()"))


def test_touches_that_go_on_have_no_dots_at_the_border() -> None:
    svg = drawn(contact_graph(graph_rows(TAP), Backdrop((1.2, 4.2))))
    assert len(svg.xpath("//circle")) == 4
    assert len(drawn(contact_graph(graph_rows(TAP), Backdrop((2.6, 3.9)))).xpath("//g")) == 0
    assert contact_graph((), Backdrop((0.0, 1.0))) == ""


def test_strokes_have_the_symbols_of_the_drum_score() -> None:
    """Figure 5.8 of [D]: rows are drums.

    A star is the right hand, a plus the left, a ring the right foot.
    """
    given = Contacts(
        ("stick_r", "stick_l", "pedal_r"),
        (
            Touch(site="stick_r", start=1.0, stop=1.01, surface="hi_hat", source="sound"),
            Touch(site="stick_l", start=1.5, stop=1.51, surface="snare_drum", source="sound"),
            Touch(site="stick_r", start=2.0, stop=2.01, surface="snare_drum", source="sound"),
            Touch(site="pedal_r", start=1.0, stop=1.01, surface="bass_drum", source="sound"),
        ),
    )
    rows = graph_rows(given)
    assert {row.label: len(row.touches) for row in rows} == {
        "Hi hat": 1,
        "Snare drum": 2,
        "Bass drum": 1,
    }
    svg = drawn(contact_graph(rows, Backdrop((0.0, 3.0))))
    arms = [one.count("M") for one in svg.xpath("//path[contains(@class, 'stroke')]/@d")]
    assert sorted(arms) == [2, 3, 3]
    assert svg.xpath("//circle/@class") == ["stroke right"]
