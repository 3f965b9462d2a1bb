"""Tables of touches that are written are read back."""

from __future__ import annotations

import pytest

from myomorph.core.io.contact_events import read_events, write_events
from myomorph.core.model.contacts import Contacts, Touch
from myomorph.core.model.errors import BadFile


def test_touches_come_back(tmp_path):
    touches = (
        Touch("heel_r", 0.125, 0.5, confidence=0.75, source="kinematics"),
        Touch(site="grip, left", start=0.25, stop=1.5, surface="box", source="camera"),
    )
    contacts = Contacts(("heel_r", "grip, left"), touches)
    write_events(contacts, tmp_path / "contacts.csv")
    assert read_events(tmp_path / "contacts.csv") == contacts


def test_no_touch_gives_a_table_without_rows(tmp_path):
    write_events(Contacts(("heel_r",), ()), tmp_path / "contacts.csv")
    assert read_events(tmp_path / "contacts.csv").intervals == ()


def test_nothing_is_left_where_it_cannot_be_written(tmp_path):
    with pytest.raises(BadFile):
        write_events(Contacts(("a",), ()), tmp_path / "missing" / "contacts.csv")
