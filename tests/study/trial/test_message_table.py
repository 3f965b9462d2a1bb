"""The table of messages: what is written is read back, the most severe first."""

from __future__ import annotations

import csv

from myomorph.core.model.causes import FEET_BESIDE, READING
from myomorph.lab.study.trial.message_table import HEAD, read_messages, write_messages

FOOT = FEET_BESIDE.message(
    "the load on\n 'calcn_l' is unknown",
    place="calcn_l",
    times=((1.0, 1.2), (3.0, 3.1)),
    size=40.0,
    share=0.4,
)
AXES = READING.message("z points up")


def test_rows_have_cause_place_size_effect_and_remedy(tmp_path) -> None:
    write_messages(tmp_path / "messages.csv", (AXES, FOOT, AXES))
    with (tmp_path / "messages.csv").open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert tuple(rows[0]) == HEAD
    assert [row["cause_name"] for row in rows] == ["feet_beside", "reading"]
    first = rows[0]
    assert first["text"] == "the load on 'calcn_l' is unknown"
    assert (first["start_s"], first["stop_s"], first["intervals"]) == ("1", "3.1", "2")
    assert (first["size"], first["share"]) == ("40", "0.4")
    assert first["effect"] == FEET_BESIDE.effect
    assert first["remedy"] == FEET_BESIDE.remedy
    assert rows[1]["start_s"] == rows[1]["size"] == ""


def test_what_is_written_is_read_back(tmp_path) -> None:
    write_messages(tmp_path / "messages.csv", (AXES, FOOT))
    foot, axes = read_messages(tmp_path / "messages.csv")
    assert (foot.text, foot.place, foot.size, foot.share) == (FOOT.text, "calcn_l", 40.0, 0.4)
    assert foot.times == ((1.0, 3.1),)
    assert axes.cause_title == READING.title
    assert axes.severity == "good to know"
    assert read_messages(tmp_path / "none.csv") == ()


def test_tables_of_the_version_before_are_read(tmp_path) -> None:
    """Its columns were `gravity`, `touches` and `stretches`."""
    path = tmp_path / "messages.csv"
    write_messages(path, (FOOT,))
    head, *rows = path.read_text(encoding="utf-8").splitlines(keepends=True)
    for new, old in (
        ("severity", "gravity"),
        ("quantities", "touches"),
        ("intervals", "stretches"),
    ):
        assert new in head
        head = head.replace(new, old)
    path.write_text("".join((head, *rows)), encoding="utf-8")
    (foot,) = read_messages(path)
    assert foot.severity == FOOT.severity
    assert foot.cause.quantities == FOOT.cause.quantities
