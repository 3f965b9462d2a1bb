"""A message is one line for a terminal, whatever a file holds that it tells of."""

from __future__ import annotations

import pytest

from myomorph.core.model.errors import (
    MAX_CHARACTERS,
    MAX_NAMES,
    BadData,
    BadFile,
    BadModel,
    MyomorphError,
    UnknownName,
    listing,
    nearest,
    quoted,
    unknown,
)

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
def test_control_characters_do_not_reach_the_terminal(error: MyomorphError) -> None:
    assert str(error).isprintable()
    assert "red" in str(error)


def test_a_very_long_message_keeps_its_beginning_and_its_end() -> None:
    text = str(BadFile("a.csv", "begins " + 10 * MAX_CHARACTERS * "x", "try this"))
    assert len(text) < 1.01 * MAX_CHARACTERS
    assert text.startswith("a.csv: begins xxx")
    assert text.endswith("; try this")


def test_blanks_in_a_name_stay() -> None:
    assert str(BadFile("my  data/é walk.trc", "is empty")) == "my  data/é walk.trc: is empty"


MUSCLES = (
    "recfem_r",
    "semimem_r",
    "vasmed_l",
    "glmax1_r",
    "addbrev_r",
    "tfl_r",
    "psoas_r",
    "iliacus_r",
)
KEYS = (
    "contact_points",
    "joint_points",
    "reactions",
    "emg_side",
    "emg_muscles",
    "mass",
    "height",
    "body_mass_index",
)


@pytest.mark.parametrize(
    ("name", "existing", "expected"),
    [
        ("rectfem_r", MUSCLES, "recfem_r"),
        ("TFL-R", MUSCLES, "tfl_r"),
        ("contact-points", KEYS, "contact_points"),
        ("emgside", KEYS, "emg_side"),
        ("emg_muscels", KEYS, "emg_muscles"),
        ("maas", KEYS, "mass"),
        ("reaction", KEYS, "reactions"),
        ("LASIS", ("R.ASIS", "L.ASIS", "V.Sacral"), "L.ASIS"),
        ("knee", ("hip_flexion_r", "knee_angle_r"), "knee_angle_r"),
    ],
)
def test_the_nearest_name_comes_first(name: str, existing: tuple[str, ...], expected: str) -> None:
    assert nearest(name, existing)[0] == expected


def test_names_without_likeness_are_not_near() -> None:
    assert nearest("zygomatic", KEYS) == ()
    assert nearest("", KEYS) == ()


def test_an_unknown_name_is_answered_with_five_at_most_and_the_number_of_all() -> None:
    names = [f"marker{index}" for index in range(40)]
    text = str(UnknownName("marker", "markr", existing=names, where="the recording"))
    assert text.count("'marker") == MAX_NAMES
    assert "'markr': the recording has" in text
    assert "40 in all" in text
    assert listing("zygomatic", KEYS) == f"{quoted(KEYS[:MAX_NAMES])}, ... ({len(KEYS)} in all)"
    assert listing("maas", KEYS) == f"'mass', ... ({len(KEYS)} in all)"


def test_few_names_are_all_listed_nearest_first() -> None:
    assert listing("angel", ("motor", "angle")) == "'angle', 'motor'"
    assert listing("angle", ()) == "none"
    assert (
        unknown("key", "angel", ("motor", "angle"))
        == "unknown key 'angel': there are 'angle', 'motor'"
    )


def test_names_in_quotes_are_cut_with_their_number() -> None:
    assert quoted("ab") == "'a', 'b'"
    assert quoted("abcdefg", 2) == "'a', 'b', ... (7 in all)"
