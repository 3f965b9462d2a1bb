"""The answer as rows of a table: sentence, verdict, reason, windows, key poses and stances."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from myomorph.core.io.parsing.text import write_csv
from myomorph.lab.movements.part import UNKNOWN
from myomorph.lab.report.trial.answer.answer import Answer
from myomorph.lab.report.trial.answer.answer_quantities import FILE, QUANTITIES
from myomorph.lab.report.trial.answer.foot_stances import foot_stances
from myomorph.lab.report.trial.answer.torque_window import torque_windows
from myomorph.lab.report.trial.prepared import Prepared


@dataclass(frozen=True, kw_only=True)
class AnswerRow:
    """One statement of an answer.

    Attributes
    ----------
    kind : what it is: "sentence", "caveat", "verdict", "reason", "movement", "torques hold",
        "key pose" or "stance"
    text : in words
    side : of a stance
    start, stop : of what has a time [s], NaN for none
    """

    kind: str
    text: str = ""
    side: str = ""
    start: float = UNKNOWN
    stop: float = UNKNOWN


def answer_rows(prepared: Prepared, answer: Answer) -> Iterator[AnswerRow]:
    """Yield what the first screen says, as values."""
    result = answer.result
    if result is not None:
        yield AnswerRow(kind="movement", text=result.movement)
        yield AnswerRow(kind="sentence", text=str(result.sentence))
        if result.caveat:
            yield AnswerRow(kind="caveat", text=result.caveat)
    yield AnswerRow(kind="verdict", text=answer.judgement.words)
    yield AnswerRow(kind="reason", text=answer.judgement.reason)
    for start, stop in torque_windows(prepared):
        yield AnswerRow(kind="torques hold", start=start, stop=stop)
    for pose in () if result is None else result.poses:
        yield AnswerRow(kind="key pose", text=pose.words, start=pose.time, stop=pose.time)
    for stance in foot_stances(prepared):
        yield AnswerRow(
            kind="stance",
            text=stance.words,
            side=stance.side,
            start=stance.start,
            stop=stance.stop,
        )


def write_answer(folder: Path, prepared: Prepared, answer: Answer) -> None:
    """Write the rows into a folder of results."""
    head = tuple(quantity.column for quantity in QUANTITIES)
    rows = (_cells(row) for row in answer_rows(prepared, answer))
    write_csv(folder / FILE, head, rows)


def _cells(row: AnswerRow) -> Sequence[str]:
    """Return the cells of a row in the order of `QUANTITIES`."""
    values = [quantity.of(row) for quantity in QUANTITIES]
    return [_cell(value) for value in values]


def _cell(value: str | float) -> str:
    """Return a text as it is, a time to a tenth of a millisecond."""
    if isinstance(value, str):
        return value.replace("\u00a0", " ")
    return f"{value:.4f}" if np.isfinite(value) else ""
