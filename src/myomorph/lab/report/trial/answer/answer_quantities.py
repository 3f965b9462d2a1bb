"""Columns of the table of an answer."""

from __future__ import annotations

from myomorph.core.model.quantity import Quantity

FILE = "answer.csv"
PER_ROW = ("answer_row",)

ANSWER_KIND = Quantity(
    name="answer_kind",
    dims=PER_ROW,
    unit="",
    meaning="what a row says: movement, sentence, verdict, torques hold, key pose, stance, ...",
    attribute="kind",
    kind="text",
    stored=False,
    file=FILE,
)
ANSWER_TEXT = Quantity(
    name="answer_text",
    dims=PER_ROW,
    unit="",
    meaning="its words",
    attribute="text",
    kind="text",
    stored=False,
    file=FILE,
)
ANSWER_SIDE = Quantity(
    name="answer_side",
    dims=PER_ROW,
    unit="",
    meaning="side of a stance",
    attribute="side",
    kind="text",
    stored=False,
    file=FILE,
)
ANSWER_START = Quantity(
    name="answer_start",
    dims=PER_ROW,
    unit="s",
    meaning="when it begins, as a stance or a window in which torques hold",
    attribute="start",
    stored=False,
    file=FILE,
)
ANSWER_STOP = Quantity(
    name="answer_stop",
    dims=PER_ROW,
    unit="s",
    meaning="when it ends",
    attribute="stop",
    stored=False,
    file=FILE,
)

QUANTITIES = (ANSWER_KIND, ANSWER_TEXT, ANSWER_SIDE, ANSWER_START, ANSWER_STOP)
