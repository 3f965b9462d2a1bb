"""Messages: texts with their cause, whatever carries them."""

from __future__ import annotations

import pickle
from dataclasses import FrozenInstanceError, replace

import pytest

from myomorph.core.model.causes import CONTACTS, FEET_BESIDE, PLATES, READING, UNITS
from myomorph.core.model.message_groups import grouped_messages, outcome_lines, warnings_of
from myomorph.core.model.messages import (
    OTHER,
    SEVERITIES,
    Message,
    located,
    messages_of,
    messages_text,
    summarized,
    together,
    unique,
)
from myomorph.lab.causes import SESSION

FOOT = FEET_BESIDE.message(
    "the load on 'calcn_l' is not determined",
    place="calcn_l",
    times=((1.0, 1.2), (1.25, 1.5), (3.0, 3.1)),
    size=40.0,
    share=0.4,
)
OTHER_FOOT = FEET_BESIDE.message("the load on 'calcn_r' is not determined", size=12.0)
AXES = READING.message("z points up in the laboratory")


def test_a_message_is_its_text() -> None:
    assert FOOT == "the load on 'calcn_l' is not determined"
    assert f"{FOOT}" == str(FOOT)
    assert FOOT in {str(FOOT)}


def test_a_message_does_not_change() -> None:
    with pytest.raises(AttributeError, match="does not change"):
        FOOT.place = "elsewhere"
    with pytest.raises(FrozenInstanceError):
        FEET_BESIDE.title = ""  # type: ignore[misc]


@pytest.mark.parametrize("message", [FOOT, OTHER_FOOT, AXES])
def test_files_and_processes_keep_all_of_it(message: Message) -> None:
    for copy in (*messages_of(messages_text([message])), pickle.loads(pickle.dumps(message))):
        assert copy == message
        assert copy.record == message.record
        assert copy.cause == message.cause


def test_texts_of_older_files_have_no_known_cause() -> None:
    (read,) = messages_of('["a thing that an older version wrote"]')
    assert read.cause == OTHER
    assert read == "a thing that an older version wrote"


def test_a_message_of_a_file_is_said_with_its_name() -> None:
    (said,) = located("walk.c3d", (AXES,))
    assert said == f"walk.c3d: {AXES}"
    assert said.cause == READING
    assert said.place == "walk.c3d"
    assert located("walk.c3d", (FOOT,))[0].place == "calcn_l"


def test_the_most_severe_come_first_and_the_largest_in_each() -> None:
    groups = grouped_messages((AXES, OTHER_FOOT, "a text", FOOT, FOOT))
    order = [SEVERITIES.index(group.severity) for group in groups]
    assert order == sorted(order)
    assert groups[0].messages == (FOOT, OTHER_FOOT)
    assert [group.cause for group in groups] == [FEET_BESIDE, OTHER, READING]
    assert sum(len(group.messages) for group in groups) == 4


def test_a_group_has_places_sizes_and_stretches_that_touch_are_one() -> None:
    (group,) = grouped_messages((OTHER_FOOT, FOOT))
    assert group.size == "in up to 40 % of the time"
    assert group.largest == 40.0
    assert group.share == 0.4
    assert group.where == "calcn_l; from 1.00 to 1.50 s, from 3.00 to 3.10 s"


def test_one_cause_of_two_severities_is_two_groups() -> None:
    less = FOOT.changed("a little", severity="good to know")
    assert [group.severity for group in grouped_messages((less, FOOT))] == [
        "changes results",
        "good to know",
    ]
    assert warnings_of((less, FOOT, AXES)) == (FOOT,)


def test_printed_lines_have_every_warning() -> None:
    many = [CONTACTS.message(f"stretch {number}", size=float(number)) for number in range(9)]
    lines = outcome_lines((AXES, *many), "report.html")
    assert lines[0] == "changes results: Contacts that cannot carry the motion: " + (
        "up to 8 N are unexplained"
    )
    assert lines[1:10] == [f"  stretch {number}" for number in range(8, -1, -1)]
    assert not any("more of this cause" in line for line in lines)
    assert lines[-1] == "good to know: How the recording was read (1): report.html"


def test_texts_are_said_once() -> None:
    assert unique((FOOT, str(FOOT), AXES)) == (FOOT, AXES)
    assert unique((FOOT, str(FOOT)))[0].cause == FEET_BESIDE


def test_a_cause_is_equal_by_its_words() -> None:
    assert replace(FEET_BESIDE, title="x") != FEET_BESIDE


def test_alike_messages_are_one_with_the_worst_and_their_number() -> None:
    left = OTHER_FOOT.changed(place="calcn_r", times=((0.0, 0.1),))
    one = together((left, FOOT))
    assert one == f"{FOOT}; and 1 more alike: calcn_r"
    assert one.size == 40.0
    assert one.place == "calcn_l, calcn_r"
    assert one.times == ((0.0, 0.1), *FOOT.times)
    assert together((FOOT,)) is FOOT


def test_kinds_and_causes_stay_apart() -> None:
    said = summarized((("load", OTHER_FOOT), ("axes", AXES), ("load", FOOT), ("load", AXES)))
    assert [message.cause for message in said] == [FEET_BESIDE, READING, READING]
    assert said[0].startswith(FOOT)


def test_of_one_severity_what_explains_others_comes_first() -> None:
    follows = CONTACTS.message("a force comes from nowhere", severity="changes results")
    plate = PLATES.message("a plate is turned", severity="changes results")
    person = SESSION.message("another person", severity="changes results")
    unit = UNITS.message("are they radians?", severity="changes results")
    light = UNITS.message("taken as mm", severity="may change results")
    groups = grouped_messages((follows, plate, light, person, unit))
    first = {group.cause.key for group in groups[:2]}
    assert first == {"session", "units"}
    assert [group.cause.key for group in groups[2:]] == ["plates", "contacts", "units"]
