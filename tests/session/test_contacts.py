"""Recorded events and plates take part in finding a movement."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from made_person import made_person
from myomorph.core.model.series import Event
from myomorph.core.motion.protocols import recognize
from myomorph.lab.analysis.found_movement import found_movement
from myomorph.lab.analysis.seen_body import SeenBody
from myomorph.lab.analysis.seen_contacts import (
    SeenContacts,
    contacts_of_events,
    contacts_of_force,
)
from myomorph.lab.session.read import trial_of
from myomorph.lab.session.recorded_contacts import recorded_contacts
from myomorph.lab.session.recordings import look_at
from myomorph.lab.study.inputs.laboratory import AS_RECORDED

WEIGHT = 700.0
TIME = np.arange(3000) / 1000.0


def steps(duty: float, labels: tuple[str, str] = ("Foot Strike", "Foot Off")) -> list[Event]:
    """Events of both feet, a second a stride, each on the ground for a share of it."""
    events = []
    for stride in range(4):
        for side, shift in (("Right", 0.0), ("Left", 0.5)):
            events.append(Event(stride + shift, labels[0], side))
            events.append(Event(stride + shift + duty, labels[1], side))
    return events


def short(event: Event) -> Event:
    """Event of a file without sides, as RHS and LTO."""
    return Event(event.time, event.side[0] + ("HS" if "Strike" in event.label else "TO"), "")


@pytest.mark.parametrize("named", [lambda event: event, short])
@pytest.mark.parametrize(("duty", "flies"), [(0.62, False), (0.35, True)])
def test_lifts_onto_the_other_foot_are_a_walk(duty: float, flies: bool, named) -> None:
    contacts = contacts_of_events(list(map(named, steps(duty))))
    assert contacts is not None
    assert contacts.flies is flies
    assert contacts.steps == 7


def test_events_of_nothing_are_no_contacts() -> None:
    assert contacts_of_events([Event(0.3, "Event", "Left"), Event(0.5, "RMS", "")]) is None


def without_feet(movement: str) -> SeenBody:
    """Body of which markers show the pelvis and the trunk alone."""
    markers = made_person(movement)
    kept = [i for i, name in enumerate(markers.names) if name[1:] in ("ASI", "PSI")]
    few = markers.columns(kept)
    return SeenBody.of(few, recognize(few.names).sites, np.eye(3))


@pytest.mark.parametrize(("duty", "movement"), [(0.62, "walking"), (0.35, "running")])
def test_events_show_the_movement_where_markers_show_no_feet(duty: float, movement: str) -> None:
    body = without_feet(movement)
    assert found_movement(body).value is None
    found = found_movement(body, contacts=contacts_of_events(steps(duty)))
    assert (found.value, found.origin) == (movement, "events")


def seen(movement: str) -> SeenBody:
    """Body that markers show whole."""
    markers = made_person(movement)
    return SeenBody.of(markers, recognize(markers.names).sites, np.eye(3))


@pytest.mark.parametrize(
    ("movement", "duty", "found"),
    [("walking", 0.62, "walking"), ("running", 0.35, "running"), ("running", 0.62, "walking")],
)
def test_recorded_events_decide_on_flights(movement: str, duty: float, found: str) -> None:
    contacts = contacts_of_events(steps(duty))
    result = found_movement(seen(movement), contacts=contacts)
    assert result.value == found
    assert "by events" in result.sentence


def _between(start: float, stop: float) -> np.ndarray:
    return np.abs(TIME - (start + stop) / 2.0) < (stop - start) / 2.0


def force_of(flights: list[tuple[float, float]]) -> np.ndarray:
    """Force of plates on which the body lands as hard as it flew long.

    Parameters
    ----------
    flights : start and end of each [s]

    Returns
    -------
    (samples,) [N]
    """
    force = np.full_like(TIME, WEIGHT)
    for start, stop in flights:
        flight = _between(start, stop)
        force[flight] = 0.0
        around = _between(start - 0.2, stop + 0.2) & ~flight
        force[around] += WEIGHT * flight.sum() / around.sum()
    return force


@pytest.mark.parametrize(
    ("flights", "count"), [([], 0), ([(1.3, 1.7)], 1), ([(0.6, 0.8), (1.4, 1.6), (2.2, 2.4)], 3)]
)
def test_plates_that_carry_the_body_show_flights(flights, count: int) -> None:
    contacts = contacts_of_force(TIME, force_of(flights))
    assert contacts == SeenContacts(origin="plates", flights=count, supports=int(not count))


@pytest.mark.parametrize(
    "force",
    [
        np.where((TIME > 1.0) & (TIME < 1.7), WEIGHT, 0.0),
        np.where(TIME < 1.0, 0.0, WEIGHT),
        np.zeros_like(TIME),
        np.where(np.abs(TIME - 1.5) < 0.6, 0.0, WEIGHT),
    ],
)
def test_plates_that_miss_steps_say_nothing(force) -> None:
    assert contacts_of_force(TIME, force) is None


@pytest.mark.parametrize(("flights", "movement"), [([(1.2, 1.7)], "jumping"), ([], "other")])
def test_plates_decide_on_a_jump(flights, movement: str) -> None:
    """Toes that are raised while heels stay look like a jump to the pelvis' markers alone."""
    contacts = contacts_of_force(TIME, force_of(flights))
    found = found_movement(seen("jumping"), contacts=contacts)
    assert (found.value == "jumping") == (movement == "jumping")


@pytest.mark.parametrize(
    ("file", "origin", "flies"),
    [
        ("c3d-gait-plugingait/HC002D/Straight/HC002D06.c3d", "events", False),
        ("c3d-vendor-samples/C3DSamples/PiG/PiG_Motion3_FF.c3d", "events", False),
        ("c3d-vendor-samples/C3DSamples/c3d.org/sample02/pc_real.c3d", "events", False),
        ("hamner-run-subject04/run500/markers.trc", "plates", True),
        ("hamner-run-subject04/run200/markers.trc", "plates", True),
    ],
)
def test_contacts_of_recordings(file: str, origin: str, flies: bool, data) -> None:
    contacts = recorded_contacts(look_at(data(file)))
    assert contacts is not None
    assert (contacts.origin, contacts.flies) == (origin, flies)


def test_walking_over_plates_on_the_way_is_no_flight(data) -> None:
    """Two plates that are stepped on once each carry nobody before and after."""
    assert recorded_contacts(look_at(data("c3d-opensim-walking/walking2.c3d"))) is None


def test_a_recording_without_feet_is_known_by_its_events(data) -> None:
    recording = look_at(data("c3d-gait-plugingait/HC002D/Straight/HC002D06.c3d"))
    assert recording.trial.markers is not None
    kept = [
        index
        for index, label in enumerate(recording.trial.markers.names)
        if label in recording.found.sites
        and recording.found.sites[label].segment in ("pelvis", "trunk", "head")
    ]
    markers = recording.trial.markers.columns(kept)
    few = replace(
        recording,
        trial=replace(recording.trial, markers=markers),
        found=recognize(markers.names),
        laboratory=AS_RECORDED,
    )
    movement = trial_of(few).movement
    assert (movement.value, movement.origin) == ("walking", "events")
