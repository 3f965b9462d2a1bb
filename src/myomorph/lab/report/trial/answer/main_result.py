"""What a movement's main result is made of."""

from __future__ import annotations

from dataclasses import dataclass

from myomorph.lab.report.trial.answer.answer_curve import AnswerCurve
from myomorph.lab.report.trial.answer.sentence import Sentence


@dataclass(frozen=True)
class KeyPose:
    """An instant at which the body is pictured.

    Attributes
    ----------
    time : [s]
    words : what the body does then, as "right foot strike"
    at : where it stands along the curves: percent of the cycle, or time [s]
    """

    time: float
    words: str
    at: float


@dataclass(frozen=True, kw_only=True)
class MainResult:
    """The answer that a movement gives.

    Attributes
    ----------
    movement : its name in print, as "Walking"
    sentence : the main result, in numbers
    caveat : how far to trust the numbers of the sentence; "" where nothing limits them
    curves : at most three; the first one is what the sentence speaks of
    poses : at most three, in order of time
    axis : unit of the curves' horizontal axis, as "% of stride" or "s"
    amount : what was recorded of the movement, as "2 right strides and 1 left"
    lift : where the foot leaves the ground along the axis, None where it has no meaning
    """

    movement: str
    sentence: Sentence
    caveat: str
    curves: tuple[AnswerCurve, ...]
    poses: tuple[KeyPose, ...]
    axis: str
    amount: str
    lift: float | None = None
