"""Causes on a page: the most severe first, with their places, and none lost."""

from __future__ import annotations

from myomorph.core.model.causes import FEET_BESIDE, READING
from myomorph.lab.report.trial.answer.answer import answer_of
from myomorph.lab.report.trial.answer.first_screen import first_screen
from myomorph.lab.report.trial.answer.time_strip import time_strip
from myomorph.lab.report.trial.prepared import prepare
from myomorph.lab.report.trial.trial_page import report_page
from walker import everything, having

GRAVE = FEET_BESIDE.message(
    "the load on 'calcn_l' is not determined", place="calcn_l", times=((0.1, 0.2),), size=40.0
)
KNOWN = READING.message("z points up in the laboratory")


def test_a_page_has_every_message_and_what_to_do() -> None:
    page = report_page(having(everything(100), warnings=(KNOWN, GRAVE)))
    for text in (GRAVE, KNOWN, FEET_BESIDE.title, FEET_BESIDE.effect, "in up to 40 % of the time"):
        assert text.replace("'", "&#39;") in page
    assert page.index(FEET_BESIDE.title) < page.index(READING.title)


def test_what_is_good_to_know_is_no_warning() -> None:
    prepared = prepare(having(everything(100), warnings=(KNOWN, GRAVE)))
    screen = first_screen(prepared, answer_of(prepared))
    assert [group.cause for group in screen.warnings] == [FEET_BESIDE]
    assert screen.known == (KNOWN,)
    assert screen.causes_note == "1 cause; 1 good to know"


def test_times_are_a_strip_over_the_trial() -> None:
    strip = time_strip(((1.0, 2.0), (3.0, 3.0)), (0.0, 4.0))
    assert strip.count("<rect") == 2
    assert 'x="150.0"' in strip
    assert "from 1.00 to 2.00 s, at 3.00 s" in strip
