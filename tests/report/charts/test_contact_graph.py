import re

import numpy as np
import pytest
from lxml import etree

from myomorph.analysis.contact_states import (
    graph_rows,
    limb_of,
    limb_states,
    measured_contacts,
    row_label,
    solved_contacts,
)
from myomorph.analysis.selection import Subject
from myomorph.model.contacts import ContactForces, Contacts, Site, Touch
from myomorph.report.charts.tracks import LEFT, RIGHT, WIDTH, Backdrop, contact_graph
from walker import GRAVITY, steps

UP = np.array([0.0, 1.0, 0.0])
TAP = Contacts(
    ("toe_l", "heel_r", "toe_r"),
    (Touch("heel_r", 1.0, 2.0), Touch("toe_r", 1.5, 2.5, confidence=0.6), Touch("heel_r", 4.0, 4.5)),
)


def drawn(svg: str) -> etree._Element:
    return etree.fromstring(svg)


def place(time: float, span: tuple[float, float]) -> float:
    return LEFT + (time - span[0]) / (span[1] - span[0]) * (WIDTH - RIGHT - LEFT)


def test_a_line_for_every_touch_with_its_dots() -> None:
    """Figure 5.5 of [D]: lines from touch to leave; rows in the order given, right before left, unused sites too."""
    rows = graph_rows(TAP)
    assert [row.label for row in rows] == ["Right heel", "Right toe", "Left toe"]
    svg = drawn(contact_graph(rows, Backdrop((0.0, 5.0))))
    lines = [re.findall(r"[\d.]+", one) for one in svg.xpath("//g[contains(@class, 'touch')]/path/@d")]
    ends = [(float(one[0]), float(one[2])) for one in lines]
    assert ends == [
        pytest.approx((place(touch.start, (0.0, 5.0)), place(touch.stop, (0.0, 5.0))), abs=0.06)
        for row in rows
        for touch in row.touches
    ]
    assert len(svg.xpath("//circle")) == 6
    assert len(svg.xpath("//circle[@class='open']")) == 3
    assert "60 % sure" in "".join(svg.xpath("//title/text()"))


def test_touches_that_go_on_have_no_dots_at_the_border() -> None:
    svg = drawn(contact_graph(graph_rows(TAP), Backdrop((1.2, 4.2))))
    assert len(svg.xpath("//circle")) == 4
    assert len(drawn(contact_graph(graph_rows(TAP), Backdrop((2.6, 3.9)))).xpath("//g")) == 0
    assert contact_graph((), Backdrop((0.0, 1.0))) == ""


def test_strokes_have_the_symbols_of_the_drum_score() -> None:
    """Figure 5.8 of [D]: a star for the right hand, a plus for the left, a ring for the right foot; rows are drums."""
    given = Contacts(
        ("stick_r", "stick_l", "pedal_r"),
        (
            Touch("stick_r", 1.0, 1.01, "hi_hat", source="sound"),
            Touch("stick_l", 1.5, 1.51, "snare_drum", source="sound"),
            Touch("stick_r", 2.0, 2.01, "snare_drum", source="sound"),
            Touch("pedal_r", 1.0, 1.01, "bass_drum", source="sound"),
        ),
    )
    rows = graph_rows(given)
    assert {row.label: len(row.touches) for row in rows} == {"Hi hat": 1, "Snare drum": 2, "Bass drum": 1}
    svg = drawn(contact_graph(rows, Backdrop((0.0, 3.0))))
    arms = [one.count("M") for one in svg.xpath("//path[contains(@class, 'stroke')]/@d")]
    assert sorted(arms) == [2, 3, 3]
    assert svg.xpath("//circle/@class") == ["stroke right"]


def test_whose_limb_a_site_is_on() -> None:
    who = (Subject("tori", "tori_", (), ()), Subject("uke", "uke_", (), ()))
    assert limb_of("uke_heel_l", who).label == "uke left foot"
    assert limb_of("tori_sleeve_r", who).label == "tori right hand"
    assert limb_of("seat").label == "seat"
    assert limb_of("tori_foot_r_heel", who).label == "tori right foot"
    assert row_label("uke_foot_l_toe", who) == "Uke left foot toe"
    assert row_label("calcn_r") == "Right foot"
    assert row_label("tori_toe_medial_l", who) == "Tori left toe medial"


def test_a_limb_touches_while_any_of_its_sites_does() -> None:
    time = np.arange(0.0, 5.0, 0.1)
    limbs, touching = limb_states(TAP, time)
    assert [one.label for one in limbs] == ["left foot", "right foot"]
    expected = ((time >= 1.0) & (time <= 2.5)) | ((time >= 4.0) & (time <= 4.5))
    np.testing.assert_array_equal(touching[:, 1], expected)
    assert not touching[:, 0].any()


def test_contacts_of_plates_and_of_estimated_forces() -> None:
    time = np.arange(0.0, 2.0, 0.002)
    found = measured_contacts(steps(time, 60 * GRAVITY), UP, 60 * GRAVITY)
    assert [(one.site, one.source) for one in found.intervals] == [("tibia_r", "plates"), ("tibia_l", "plates")]
    assert found.intervals[0].start == pytest.approx(0.2, abs=0.03)
    assert found.intervals[0].stop == pytest.approx(0.9, abs=0.03)
    strength = np.zeros((50, 1))
    strength[10:20], strength[30:31] = 0.8, 0.2
    zero = np.zeros((50, 1, 3))
    forces = ContactForces(
        np.arange(50) / 10.0, (Site("hand_r", "hand_r", np.zeros((1, 3))),), strength, zero, zero, zero
    )
    runs = [(one.start, one.stop, one.confidence) for one in solved_contacts(forces).intervals]
    assert runs == [(1.0, 1.9, 0.8), (3.0, 3.0, 0.2)]
