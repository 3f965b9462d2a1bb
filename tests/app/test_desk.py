"""From a folder to what was found, and to a request of `analyze`."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

import myomorph as mm
from myomorph.core.model.errors import BadData, MyomorphError
from myomorph.lab.study.inputs.person import RecordedPerson
from myomorph.show.app.asked import Asked, AskedPerson, AskedTrial
from myomorph.show.app.computing import request_of
from myomorph.show.app.desk import Desk
from myomorph.show.app.found import (
    found_session,
    landmark_words,
    look_into,
    needs_places,
    results_folder,
)

PATIENCE = 1500.0  # Kernels may compile, on a busy machine [s].


@pytest.fixture(scope="module")
def squat(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a folder with a squat, and with somebody who stands still before it."""
    recording = mm.demo_recording()
    folder = tmp_path_factory.mktemp("data") / "Müller 1"
    folder.mkdir()
    markers = recording.markers
    mm.write_trc(markers, folder / "squat 1.trc")
    still = np.repeat(markers.values[:1], 60, axis=0)
    mm.write_trc(mm.Markers(markers.time[:60], markers.names, still), folder / "static.trc")
    mm.write_osim(recording.model, folder / "squat.osim")
    return folder


def waited(desk: Desk) -> dict:
    """State once nothing is done any more."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        state = desk.state()
        if state["phase"] not in ("looking", "running"):
            return state
        time.sleep(0.05)
    raise TimeoutError(state)


def test_what_was_found(squat):
    heard = []
    look = look_into(squat, lambda *values: heard.append(values))
    assert heard == [(1, 2, "squat 1.trc"), (2, 2, "static.trc")]
    found = found_session(look)
    (person,) = found["people"]
    assert person["mass"] is None
    assert "give the mass" in person["of_mass"]
    assert found["trials"][person["static"]]["file"] == "static.trc"
    assert [trial["movement"] for trial in found["trials"]] == ["squatting", "standing"]
    assert list(found["models"]) == ["squat.osim"]
    assert results_folder(look) == squat / "Müller 1_results"


def test_places_of_markers_are_proposed(squat):
    """Names of the demonstration are those of no protocol."""
    look = look_into(squat, lambda *values: None)
    assert needs_places(look)
    labels = found_session(look)["labels"]
    assert labels["needed"]
    assert labels["why"]
    places = {proposal["place"] for proposal in labels["proposed"].values()}
    assert places <= {*labels["landmarks"]}


def test_results_are_no_recordings(squat, tmp_path):
    results = tmp_path / "Müller 1_results"
    results.mkdir()
    (results / "study.json").write_text("{}")
    (results / "squat 1.trc").write_bytes((squat / "squat 1.trc").read_bytes())
    with pytest.raises(BadData, match="holds recordings only in folders of results"):
        look_into(tmp_path, lambda *values: None)


def test_a_study_file_that_was_changed_is_kept(squat):
    look = look_into(squat / "squat 1.trc", lambda *values: None)
    assert results_folder(look).name == "squat 1_results"
    results = squat / "squat 1_results"
    results.mkdir()
    (results / "study.toml").write_text("changed = true")
    assert results_folder(look).name == "squat 1_results_2"


def test_landmarks_have_words():
    words = landmark_words()
    assert words["right lateral malleolus"] == "right shank.lateral_malleolus"
    assert words["xiphoid process of the sternum"] == "trunk.xiphoid"


def test_a_request_of_analyze(tmp_path):
    asked = Asked(
        out=tmp_path / "out",
        trials=(
            AskedTrial(path="/d/a.c3d", person="Anna", movement="walking", plates=False),
            AskedTrial(path="/d/b.c3d", used=False),
            AskedTrial(path="/d/s.c3d", used=False, person="Anna"),
        ),
        people={"Anna": AskedPerson(mass=61.5, age=9.0, static="/d/s.c3d")},
        labels={'odd "label"': "right lateral malleolus"},
    )
    request = request_of(asked)
    assert [path.name for path in request.recordings] == ["a.c3d", "s.c3d"]
    assert request.of_person("Anna").mass == 61.5
    assert request.of_person("Anna").static == Path("/d/s.c3d")
    assert request.of_person("Anna").inputs[RecordedPerson].age == 9.0
    assert request.of_person("Ben").mass is None
    assert request.of_person("Ben").inputs[RecordedPerson].age is None
    stated = request.statements.of(Path("/d/a.c3d"))
    assert (stated.movement, stated.plates) == ("walking", False)
    assert request.table is not None
    site = request.table.common.site('odd "label"')
    assert str(site) == "right lateral malleolus"


def test_a_place_that_nobody_knows_is_answered_with_those_alike(tmp_path):
    asked = Asked(
        out=tmp_path, trials=(AskedTrial(path="/d/a.c3d"),), labels={"M1": "right lateral maleolus"}
    )
    with pytest.raises(MyomorphError, match="the list has 'right lateral malleolus'"):
        request_of(asked)


def test_a_folder_is_looked_at_beside_the_server(squat, tmp_path):
    desk = Desk(tmp_path)
    desk.look_at(f'"{squat}"')
    with pytest.raises(BadData, match="a computation is running"):
        desk.look_at(str(squat))
    state = waited(desk)
    assert (state["phase"], state["error"]) == ("found", "")
    assert len(state["found"]["trials"]) == 2
    people = [{"name": "subject", "mass": "heavy"}]
    with pytest.raises(BadData, match="body mass of subject 'heavy': expected a number of kg"):
        desk.compute({"people": people, "trials": [{"id": 0}, {"id": 1}]})
    assert desk.state()["phase"] == "found"
    desk.start_over()
    assert desk.state()["phase"] == "start"


def test_what_goes_wrong_there_is_told_in_a_sentence(tmp_path):
    (tmp_path / "empty").mkdir()
    desk = Desk(tmp_path)
    desk.look_at(str(tmp_path / "empty"))
    state = waited(desk)
    assert state["phase"] == "start"
    assert "holds no recording of markers or inertial sensors" in state["error"]


def test_a_look_is_cancelled(squat, tmp_path):
    desk = Desk(tmp_path)
    desk.look_at(str(squat))
    desk.cancel()
    assert desk.state()["phase"] == "start"


def test_a_drop_that_is_given_up_leaves_nothing(tmp_path):
    desk = Desk(tmp_path / "home")
    folder = desk.begin_drop(["S 01/walk.c3d"], [4])
    assert folder.is_dir()
    desk.start_over()
    assert not folder.exists()


@pytest.mark.long
def test_from_a_folder_to_the_answer(squat, tmp_path):
    """Corrected, computed, and repeated by the study file."""
    desk = Desk(tmp_path)
    desk.look_at(str(squat))
    waited(desk)
    out = tmp_path / "Ergebnisse 1"
    people = [{"name": "Anna", "mass": "75,3"}]
    trials = [{"id": 0, "person": "Anna", "movement": "rising"}, {"id": 1, "person": "Anna"}]
    said = {"people": people, "trials": trials, "out": str(out), "model": "squat.osim"}
    desk.compute(said)
    state = waited(desk)
    assert (state["phase"], state["error"], state["failed"]) == ("done", "", [])
    assert state["done"]["open"] == "squat_1/report.html"
    text = (out / "study.toml").read_text(encoding="utf-8")
    assert 'movement = "rising"' in text
    assert 'name = "Anna"' in text
    assert "Rising, as stated." not in text, "it stands as a key that can be corrected"
    plan = mm.read_plan(out / "study.toml")
    again = mm.run_study(plan, out)
    assert all(not outcome.error for outcome in again)
    assert all(set(outcome.reused) == set(outcome.done) for outcome in again if outcome.trial)
