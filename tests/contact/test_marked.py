"""The clock of a camera, from what both clocks saw."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.contact.clocks import camera_clock, on_clock
from myomorph.core.model.contacts import Contacts, Touch
from myomorph.core.model.errors import BadData


def test_one_event_gives_the_offset():
    clock = camera_clock([2.0], [3.25])
    assert (clock.start, clock.pace) == (1.25, 1.0)
    moved = on_clock(Contacts(("heel",), (Touch("heel", 2.0, 2.5),)), clock)
    assert (moved.intervals[0].start, moved.intervals[0].stop) == (3.25, 3.75)


def test_several_events_recover_the_pace():
    """Events marked to a frame of 1/500 s tell a drift of 2e-4, and by how much they disagree."""
    rng = np.random.default_rng(3)
    seen = np.sort(rng.uniform(0.0, 60.0, 12))
    known = 0.7 + (1.0 + 2e-4) * seen + rng.uniform(-1e-3, 1e-3, 12)
    clock = camera_clock(seen, known)
    assert clock.pace - 1.0 == pytest.approx(2e-4, abs=5e-5)
    assert clock.start == pytest.approx(0.7, abs=2e-3)
    assert 0.0 < clock.error < 2.5e-3


def test_clocks_that_cannot_be_are_refused():
    with pytest.raises(BadData, match="expected as many"):
        camera_clock([1.0, 2.0], [1.0])
    with pytest.raises(BadData, match="check its rate"):
        camera_clock([0.0, 10.0], [0.0, 20.0])
