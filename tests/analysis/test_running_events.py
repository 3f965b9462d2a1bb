"""Contacts of a run from the force on the center of mass.

Also events of several sources in one stride.
"""

from __future__ import annotations

import numpy as np
import pytest

from made_walker import walker
from myomorph.core.model.series import Event, Motion
from myomorph.core.rigid.tree import compile_tree
from myomorph.lab.analysis.foot_events import FootTrack, Limb, on_events
from myomorph.lab.analysis.walking import _dip, running_contacts, vertical_force

RATE = 200.0
CONTACT = 0.25
FLIGHT = 0.12


def bouncing(contact: float, flight: float) -> Motion:
    """Make the made walker fall and be thrown up again by half-sine forces.

    The legs alternate; the foot of the leg in contact is below.
    """
    model = walker()
    period = contact + flight
    time = np.arange(0.0, 8.0 * period, 1.0 / RATE)
    phase = np.mod(time, period)
    g = float(np.linalg.norm(model.gravity))
    # The mean force over a period is the weight.
    peak = g * period / contact * np.pi / 2.0
    force = np.where(
        phase < contact, peak * np.sin(np.pi * np.minimum(phase, contact) / contact), 0.0
    )
    speed = np.cumsum(force - g) / RATE
    height = np.cumsum(speed - speed.mean()) / RATE
    tree = compile_tree(model)
    values = np.tile(tree.defaults, (len(time), 1))
    names = model.coordinate_names
    values[:, names.index("pelvis_ty")] += height - np.polyval(np.polyfit(time, height, 1), time)
    lifted = np.where(np.floor((time + 0.5 * flight) / period).astype(int) % 2 == 0, 1.0, 0.0)
    values[:, names.index("knee_angle_l")] = -0.8 * lifted
    values[:, names.index("knee_angle_r")] = -0.8 * (1.0 - lifted)
    return Motion(time, names, values)


def test_a_run_shows_when_its_feet_are_on_the_ground() -> None:
    motion = bouncing(CONTACT, FLIGHT)
    found = running_contacts(walker(), motion, ("foot_r", "foot_l"))
    period = CONTACT + FLIGHT
    assert set(found) == {"foot_r", "foot_l"}
    for intervals in found.values():
        for start, stop in intervals[1:-1]:
            assert abs(start - period * round(start / period)) < 0.03
            assert stop - start == pytest.approx(CONTACT, abs=0.04)
    middle = [np.mean(one) for one in found["foot_r"]]
    np.testing.assert_allclose(np.diff(middle), 2.0 * period, atol=0.02)


@pytest.mark.parametrize(
    ("beyond", "least"), [([0.4, 0.2, 0.1], 0.1), ([0.4, 0.2, 0.6, 0.0], 0.2), ([0.4], 0.4)]
)
def test_a_flight_ends_with_the_next_contact_or_with_the_recording(beyond, least) -> None:
    assert _dip(np.array(beyond)) == least


def test_a_walk_has_no_running_contacts() -> None:
    """A body whose force stays above half the weight never flies."""
    model = walker()
    time = np.arange(0.0, 4.0, 1.0 / RATE)
    values = np.tile(compile_tree(model).defaults, (len(time), 1))
    values[:, model.coordinate_names.index("pelvis_ty")] += 0.02 * np.sin(2.0 * np.pi * 2.0 * time)
    motion = Motion(time, model.coordinate_names, values)
    assert vertical_force(model, motion)[20:-20].min() > 0.6
    assert running_contacts(model, motion, ("foot_r", "foot_l")) == {}


def test_events_of_another_kind_are_shifted_by_what_known_ones_are_off() -> None:
    """Strikes seen 50 ms early; one of them is known: the stride stays as long as it was."""
    track = FootTrack(
        place=np.zeros((2, 3)),
        strikes=np.array([1.0, 2.0, 3.0]),
        lifts=np.array([1.6, 2.6]),
        seen=np.ones(2, bool),
    )
    events = [
        Event(2.05, "Foot Strike", "Right"),
        Event(1.7, "foot off", "right"),
        Event(2.5, "Foot Strike", "Left"),
    ]
    found = on_events(track, Limb("foot_r", ("foot_r",)), events)
    np.testing.assert_allclose(found.strikes, [1.05, 2.05, 3.05])
    np.testing.assert_allclose(found.lifts, [1.7, 2.7])
    assert found.source == "events"
