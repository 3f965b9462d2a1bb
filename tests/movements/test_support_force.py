"""Laws of the force under the feet."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.lab.movements.support_force import SupportForce, find_contacts

WEIGHT = 700.0


@pytest.mark.parametrize("offset", [-30.0, 0.0, 40.0])
def test_an_offset_is_taken_off_where_the_plate_is_left(offset: float) -> None:
    time = np.arange(0.0, 2.0, 0.001)
    stood = np.where((time > 0.5) & (time < 1.0), WEIGHT, 0.0)
    force = SupportForce.of(time, WEIGHT, stood + offset, None).zeroed()
    assert force.right is not None
    np.testing.assert_allclose(force.right, stood, atol=1e-9)
    np.testing.assert_allclose(force.total, stood, atol=1e-9)


def test_who_stands_all_the_time_shows_no_offset() -> None:
    time = np.arange(0.0, 2.0, 0.001)
    stood = np.full(len(time), 0.5 * WEIGHT)
    force = SupportForce.of(time, WEIGHT, stood, stood).zeroed()
    np.testing.assert_array_equal(force.total, 2.0 * stood)


@pytest.mark.parametrize("rate", [200.0, 1000.0])
def test_a_contact_begins_and_ends_between_samples(rate: float) -> None:
    time = np.arange(0.0, 1.0, 1.0 / rate)
    force = np.interp(time, [0.2, 0.25, 0.5, 0.55], [0.0, 1.0, 1.0, 0.0]) * WEIGHT
    (contact,) = find_contacts(time, force, WEIGHT)
    assert contact.start == pytest.approx(0.2 + 0.03 * 0.05, abs=0.5 / rate)
    assert contact.stop == pytest.approx(0.55 - 0.03 * 0.05, abs=0.5 / rate)
    assert contact.begins
    assert contact.ends


def test_a_contact_that_a_recording_cuts_is_known_to_be_cut() -> None:
    time = np.arange(0.0, 1.0, 0.001)
    (contact,) = find_contacts(time, np.where(time < 0.4, WEIGHT, 0.0), WEIGHT)
    assert not contact.begins
    assert contact.ends
