"""What the page asks for, checked."""

from __future__ import annotations

from pathlib import Path

import pytest

from myomorph.core.model.errors import BadData, MyomorphError
from myomorph.show.app.asked import number, read_asked

FILES = {0: "/d/static.c3d", 1: "/d/walk.c3d"}


def raw(**changed):
    people = [{"name": "Anna", "mass": "72,6", "height": "", "static": "0"}]
    trials = [{"id": 0, "used": False}, {"id": 1, "movement": "walking", "person": "Anna"}]
    return {"out": "/d/out", "people": people, "trials": trials} | changed


def test_what_was_corrected_is_read():
    asked = read_asked(raw(labels={"M1": " left heel ", "M2": ""}, arms=True), FILES, {})
    assert asked.out == Path("/d/out")
    assert asked.people["Anna"].mass == 72.6
    assert asked.people["Anna"].height is None
    assert asked.people["Anna"].age is None
    assert [trial.path for trial in asked.used] == ["/d/static.c3d", "/d/walk.c3d"]
    assert asked.trials[1].movement == "walking"
    assert dict(asked.labels) == {"M1": "left heel"}
    assert asked.arms


@pytest.mark.parametrize(
    ("text", "value"),
    [("72.6", 72.6), ("72,6", 72.6), (" 72 kg", 72.0), ("", None), (None, None), (31.1, 31.1)],
)
def test_numbers_with_a_comma(text, value):
    assert number(text, "mass", "kg") == value


@pytest.mark.parametrize("text", ["seventy", "0", "-4", "1e9", "nan", "inf", "7 2"])
def test_no_mass(text):
    people = [{"name": "Anna", "mass": text}]
    with pytest.raises(BadData, match="body mass of Anna"):
        read_asked(raw(people=people), FILES, {})


def test_a_height_in_centimeters_is_said():
    people = [{"name": "Anna", "mass": "70", "height": "172"}]
    with pytest.raises(BadData, match=r"height of Anna '172': expected between 0\.3 and 2\.6 m"):
        read_asked(raw(people=people), FILES, {})


def test_two_names_that_became_one_are_one_person():
    people = [
        {"name": "Anna", "mass": "", "age": "9"},
        {"name": "Anna", "mass": "31", "static": "0"},
    ]
    anna = read_asked(raw(people=people), FILES, {}).people["Anna"]
    assert (anna.mass, anna.age, anna.static) == (31.0, 9.0, FILES[0])
    people[0]["mass"] = "32"
    with pytest.raises(BadData, match="Anna has two masses, 32 and 31 kg: give one"):
        read_asked(raw(people=people), FILES, {})


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"trials": [{"id": 7}]}, "there is no recording '7'"),
        ({"trials": [{"id": "../x"}]}, "there is no recording"),
        ({"trials": [{"id": 1, "used": False}]}, "no recording is selected"),
        ({"trials": [{"id": 1, "movement": "wlaking"}]}, "walking"),
        ({"trials": "x"}, "'trials' is not a list"),
        ({"people": [1]}, "'people' is not a list"),
        ({"labels": []}, "'labels' is not a table"),
        ({"model": "mine.osim"}, "unknown model 'mine.osim'"),
    ],
)
def test_what_the_page_cannot_mean_is_refused(changed, message):
    with pytest.raises(MyomorphError, match=message):
        read_asked(raw(**changed), FILES, {"own.osim": "/d/own.osim"})
