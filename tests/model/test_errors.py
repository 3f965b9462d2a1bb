"""A message is one line for a terminal, whatever a file holds that it tells of."""

from __future__ import annotations

import pytest

from myomorph.model.errors import LONGEST, BadData, BadFile, BadModel, MyomorphError, UnknownName

ODD = "\x1b[31mred\x1b[0m\nnext\r\u2028line\0"


@pytest.mark.parametrize(
    "error",
    [
        MyomorphError(ODD),
        BadData(ODD),
        BadModel(ODD),
        BadFile(ODD, ODD, ODD),
        UnknownName("body", ODD, (ODD, "b")),
    ],
)
def test_control_signs_do_not_reach_the_terminal(error: MyomorphError) -> None:
    assert str(error).isprintable()
    assert "red" in str(error)


def test_a_very_long_message_keeps_its_beginning_and_its_end() -> None:
    told = str(BadFile("a.csv", "begins " + 10 * LONGEST * "x", "try this"))
    assert len(told) < 1.01 * LONGEST
    assert told.startswith("a.csv: begins xxx")
    assert told.endswith("; try this")


def test_blanks_in_a_name_stay() -> None:
    assert str(BadFile("my  data/é walk.trc", "is empty")) == "my  data/é walk.trc: is empty"
