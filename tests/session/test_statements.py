"""What a user says of recordings goes before what was found."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import myomorph as mm
from myomorph.lab.session.statements import StatedTrial, Statements, corrected_session


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory):
    recording = mm.demo_recording()
    folder = tmp_path_factory.mktemp("data")
    mm.write_trc(recording.markers, folder / "one.trc")
    still = np.repeat(recording.markers.values[:1], 60, axis=0)
    markers = mm.Markers(recording.markers.time[:60], recording.markers.names, still)
    mm.write_trc(markers, folder / "two.trc")
    return mm.session.read_session(folder)


def of_people(session, *names: str) -> Statements:
    paths = [trial.path for trial in session.trials]
    said = [StatedTrial(person=name) for name in names]
    return Statements(trials=dict(zip(paths, said, strict=True)))


def test_nothing_is_said(session):
    assert corrected_session(session, Statements()) is session


def test_who_it_is(session):
    corrected = corrected_session(session, of_people(session, "Anna", "Anna"))
    (person,) = corrected.people
    assert (person.name.value, person.name.origin) == ("Anna", "user")
    assert [trial.person for trial in corrected.trials] == ["Anna", "Anna"]


def test_one_person_becomes_two(session):
    corrected = corrected_session(session, of_people(session, "Anna", "Ben"))
    assert [str(person.name) for person in corrected.people] == ["Anna", "Ben"]
    assert [trial.name for trial in corrected.of("Ben")] == ["two"]


def test_a_name_that_was_found_stays_known_as_it_was(session):
    corrected = corrected_session(session, of_people(session, "subject", "subject"))
    assert corrected.people[0].name.origin == session.people[0].name.origin


def test_which_movement(session):
    first = session.trials[0].path
    second = session.trials[1].path
    said = {first: StatedTrial(movement="rising"), second: StatedTrial(movement="standing")}
    rising, standing = corrected_session(session, Statements(trials=said)).trials
    assert (rising.movement.value, rising.movement.origin) == ("rising", "user")
    assert standing.movement.origin != "user", "it is what was found"


def test_others_stay_as_found(session):
    assert Statements().of(Path("x.c3d")) == StatedTrial()
