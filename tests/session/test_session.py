"""Who was recorded, when, and which movement, as found and as the study file corrects it."""

from __future__ import annotations

from dataclasses import replace
from datetime import date
from pathlib import Path

import pytest

from made_person import LEG, made_person
from made_standing import standing
from myomorph.core.io.trc import write_trc
from myomorph.core.model.errors import BadData, BadFile
from myomorph.core.model.series import Trial
from myomorph.lab.analyze.analyze import prepare_study
from myomorph.lab.analyze.session_sentences import other_person_sentences
from myomorph.lab.info.inspect import inspect
from myomorph.lab.session.names import named_movement, stated_date, subject_code
from myomorph.lab.session.read import read_session
from myomorph.lab.session.recordings import look_at
from myomorph.lab.study.inputs.session import RecordedSession, TrialSession, recorded_movement
from myomorph.lab.study.plan.plan import read_plan
from myomorph.lab.study.trial.trial_inputs import open_trial

MOVEMENTS = ("standing", "walking", "jumping")


def folder_of(folder: Path, leg: float = LEG, prefix: str = "", width: float = 0.13) -> Path:
    """Folder with a recording of each of three movements."""
    folder.mkdir(parents=True, exist_ok=True)
    for movement in MOVEMENTS:
        write_trc(made_person(movement, leg, width), folder / f"{prefix}{movement}.trc")
    return folder


def test_one_person_is_not_split(tmp_path: Path) -> None:
    session = read_session(folder_of(tmp_path / "x"))
    assert len(session.people) == 1
    assert [str(trial.movement) for trial in session.trials] == ["jumping", "standing", "walking"]
    assert all(trial.movement.origin == "markers" for trial in session.trials)
    assert repr(session) == "Session(subject: 3 trials, 1 jumping, 1 standing, 1 walking)"


def test_two_bodies_in_one_folder_are_two_people(tmp_path: Path) -> None:
    """Without names, segment lengths tell them apart, and each has all of its recordings."""
    folder_of(tmp_path / "x", prefix="long_")
    folder_of(tmp_path / "x", leg=0.75, prefix="short_")
    session = read_session(tmp_path / "x")
    assert len(session.people) == 2
    for person in session.people:
        names = {trial.name.split("_")[0] for trial in session.of(str(person.name))}
        assert len(names) == 1
    assert "another body" in session.people[1].why


def test_codes_tell_two_people_of_like_bodies_apart(tmp_path: Path) -> None:
    """Their lengths differ by less than markers are placed to, and by more than in one session."""
    folder_of(tmp_path / "x", prefix="s01_")
    folder_of(tmp_path / "x", leg=0.88, prefix="s02_")
    session = read_session(tmp_path / "x")
    assert [str(person.name) for person in session.people] == ["s01", "s02"]
    folder_of(tmp_path / "y", prefix="a_")
    folder_of(tmp_path / "y", leg=0.88, prefix="b_")
    assert len(read_session(tmp_path / "y").people) == 1


def test_codes_on_recordings_of_one_session_split_nobody(tmp_path: Path) -> None:
    """Markers that are where they were are on one body, whatever files are called."""
    for number, movement in enumerate(MOVEMENTS):
        write_trc(made_person(movement), tmp_path / f"p{number}_{movement}.trc")
    assert len(read_session(tmp_path).people) == 1


def test_people_of_the_data_collection(data) -> None:
    session = read_session(data("c3d-gait-plugingait"))
    assert [str(person.name) for person in session.people] == ["HC002D", "HC030A"]
    assert {len(session.of(str(person.name))) for person in session.people} == {3}
    masses = [person.mass.value for person in session.people]
    assert masses[1] == pytest.approx(45.8, abs=0.3)
    for folder in ("opencap-subject4-multitask", "knee-implant-walk", "lifting-box-15kg"):
        assert len(read_session(data(folder)).people) == 1


@pytest.mark.parametrize(
    ("name", "movement"),
    [
        ("subject01_walk1", "walking"),
        ("sub-03_task-walk_run-01_motion", "walking"),
        ("DJ2", "jumping"),
        ("StairUp3", "stairs"),
        ("STS1", "rising"),
        ("trunk_flexion", None),
        ("RBDS001runT25", "running"),
    ],
)
def test_movements_of_names(name: str, movement: str | None) -> None:
    assert named_movement(Path("/x") / "y" / f"{name}.trc").value == movement


@pytest.mark.parametrize(
    ("name", "code", "sure"),
    [
        ("s01_walk", "s01", True),
        ("sub-03_task-walk_motion", "03", True),
        ("RBDS001static", "RBDS001", False),
        ("walk1", "", False),
        ("TRIAL01a", "", False),
    ],
)
def test_codes_of_names(name: str, code: str, sure: bool) -> None:
    found = subject_code(Path("/x") / "y" / f"{name}.trc")
    assert (found.text, found.sure) == (code, sure)


@pytest.mark.parametrize(
    ("name", "day"),
    [
        ("walk_2026-03-05", date(2026, 3, 5)),
        ("20260305_walk", date(2026, 3, 5)),
        ("walk_25_03_26", date(2026, 3, 25)),
        ("walk_05_03_26", None),
        ("walk_123456", None),
    ],
)
def test_dates_of_names(name: str, day: date | None) -> None:
    """Day and month that may be exchanged are not known."""
    assert stated_date(Trial(), Path("/x") / "y" / f"{name}.trc").value == day


def test_a_header_says_the_date() -> None:
    trial = Trial(facts={"date": "2021-05-21, 13:36:04"})
    found = stated_date(trial, Path("/x/y/walk_2026-03-05.trc"))
    assert (found.value, found.origin) == (date(2021, 5, 21), "file header")


def test_info_of_a_folder(tmp_path: Path) -> None:
    folder_of(tmp_path / "x", prefix="s01_")
    text = "\n".join(inspect(tmp_path / "x").lines())
    assert "s01" in text
    assert all(f"s01_{movement}" in text for movement in MOVEMENTS)
    assert "3.0" in text or "2.99 s" in text
    assert "both feet leave the ground" not in text
    reasons = "\n".join(inspect(tmp_path / "x", reasons=True).lines())
    assert "both feet leave the ground side by side" in reasons


def test_a_folder_without_recordings_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadFile, match="holds no recording"):
        read_session(tmp_path)


@pytest.fixture(scope="module")
def prepared(tmp_path_factory) -> Path:
    """Study file of one who stands and moves."""
    folder = tmp_path_factory.mktemp("analyzed")
    write_trc(standing(), folder / "static.trc")
    write_trc(standing(0.5), folder / "slide_2026-03-05.trc")
    files = [folder / "static.trc", folder / "slide_2026-03-05.trc"]
    return prepare_study(files, folder / "out", mass=70.0).study


def test_analyze_writes_what_was_found(prepared: Path) -> None:
    (trial,) = read_plan(prepared).trials
    assert trial.get(TrialSession).date == "2026-03-05"
    assert f'movement = "{trial.get(TrialSession).movement}"' in prepared.read_text("utf-8")


def test_a_correction_in_the_study_file_wins(prepared: Path) -> None:
    (trial,) = read_plan(prepared).trials
    found = open_trial(trial, {}).get(RecordedSession)
    assert found is not None
    assert found.movement.origin == "markers"
    text = prepared.read_text("utf-8").replace(
        f'movement = "{found.movement}"', 'movement = "walking"'
    )
    corrected = prepared.with_name("corrected.toml")
    corrected.write_text(text.replace('date = "2026-03-05"', "date = 2026-03-06"), "utf-8")
    (trial,) = read_plan(corrected).trials
    session = open_trial(trial, {}).get(RecordedSession)
    assert session is not None
    assert (session.movement.value, session.movement.origin) == ("walking", "user")
    assert session.date == "2026-03-06"
    assert recorded_movement(session.facts).value == "walking"


def test_movements_and_days_that_are_none_are_refused(prepared: Path) -> None:
    text = prepared.read_text("utf-8")
    wrong = prepared.with_name("wrong.toml")
    wrong.write_text(text.replace('date = "2026-03-05"', 'date = "5 March"'), "utf-8")
    with pytest.raises(BadFile, match="2026-03-05"):
        read_plan(wrong)


def test_two_people_become_two_subjects(tmp_path: Path) -> None:
    body = standing()
    for name, size in (("s01", 1.0), ("s02", 1.2)):
        for file, shift in (("static", 0.0), ("slide", 0.5)):
            markers = replace(body, values=size * standing(shift).values)
            write_trc(markers, tmp_path / f"{name}_{file}.trc")
    with pytest.raises(BadData, match="s01 and s02"):
        prepare_study([tmp_path], tmp_path / "out", mass=70.0)
    assert not (tmp_path / "out").exists()


def test_two_people_of_plates_are_written_as_two_subjects(data, tmp_path: Path) -> None:
    prepared = prepare_study([data("c3d-gait-plugingait")], tmp_path / "out")
    plan = read_plan(prepared.study)
    assert list(plan.subjects) == ["HC002D", "HC030A"]
    assert [len(subject.trials) for subject in plan.subjects.values()] == [2, 2]
    models = {subject.model for subject in plan.subjects.values()}
    assert len(models) == 2
    assert all(model.is_file() for model in models)
    assert {trial.get(TrialSession).movement for trial in plan.trials} == {"walking"}
    assert "of 2 people" in prepared.assumed[0]


def test_a_static_trial_of_another_person_is_named(tmp_path: Path) -> None:
    """Whoever stands is held against who walks, before lengths are taken from both."""
    write_trc(made_person("walking"), tmp_path / "walk.trc")
    for name, leg, width in (("own", LEG, 0.13), ("other", 0.82 * LEG, 0.1)):
        write_trc(made_person("standing", leg, width), tmp_path / f"{name}.trc")
    walk = look_at(tmp_path / "walk.trc")
    own = look_at(tmp_path / "own.trc")
    other = look_at(tmp_path / "other.trc")
    assert other_person_sentences(own, walk) == []
    (sentence,) = other_person_sentences(other, walk)
    assert sentence.startswith("WARNING: other.trc seems to be of another person than walk.trc")
