"""Whose limb touches when: sites by their names, contacts of plates and of estimated forces."""

from dataclasses import replace

import numpy as np
import pytest

from myomorph.core.model.contacts import ContactForces, Contacts, Site, Touch
from myomorph.lab.analysis.contact_states import (
    graph_rows,
    limb_of,
    limb_states,
    measured_contacts,
    row_label,
    solved_contacts,
)
from myomorph.lab.analysis.selection import Subject
from walker import GRAVITY, steps

UP = np.array([0.0, 1.0, 0.0])
TAP = Contacts(
    ("toe_l", "heel_r", "toe_r"),
    (
        Touch("heel_r", 1.0, 2.0),
        Touch("toe_r", 1.5, 2.5, confidence=0.6),
        Touch("heel_r", 4.0, 4.5),
    ),
)


def test_whose_limb_a_site_is_on() -> None:
    who = (
        Subject(name="tori", prefix="tori_", bodies=(), muscles=()),
        Subject(name="uke", prefix="uke_", bodies=(), muscles=()),
    )
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


def test_each_touch_is_in_the_row_of_its_site() -> None:
    """Rows of feet from right to left; a site that never touches has an empty one."""
    rows = [(row.label, row.touches) for row in graph_rows(TAP)]
    heel, toe, again = TAP.intervals
    assert rows == [("Right heel", (heel, again)), ("Right toe", (toe,)), ("Left toe", ())]


def test_contacts_of_plates_and_of_estimated_forces() -> None:
    time = np.arange(0.0, 2.0, 0.002)
    found = measured_contacts(steps(time, 60 * GRAVITY), UP, 60 * GRAVITY)
    assert [(one.site, one.source) for one in found.intervals] == [
        ("tibia_r", "plates"),
        ("tibia_l", "plates"),
    ]
    assert found.intervals[0].start == pytest.approx(0.2, abs=0.03)
    assert found.intervals[0].stop == pytest.approx(0.9, abs=0.03)
    unknown = replace(steps(time, 60 * GRAVITY), bodies=("", "tibia_l"))
    plates = measured_contacts(unknown, UP, 60 * GRAVITY)
    assert plates.sites == (unknown.names[0], "tibia_l")
    assert [(one.start, one.stop) for one in plates.intervals] == [
        (one.start, one.stop) for one in found.intervals
    ]
    strength = np.zeros((50, 1))
    strength[10:20] = 0.8
    strength[30:31] = 0.2
    zero = np.zeros((50, 1, 3))
    forces = ContactForces(
        time=np.arange(50) / 10.0,
        sites=(Site("hand_r", "hand_r", np.zeros((1, 3))),),
        contact_activation=strength,
        contact_force=zero,
        contact_point=zero,
        contact_torque=zero,
    )
    runs = [(one.start, one.stop, one.confidence) for one in solved_contacts(forces).intervals]
    assert runs == [(1.0, 1.9, 0.8), (3.0, 3.0, 0.2)]
