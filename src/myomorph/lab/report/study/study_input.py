"""What the page on a study is made of: its trials, its conditions, and what is unusual in them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.messages import Message
from myomorph.lab.analysis.conditions import Condition
from myomorph.lab.analysis.groups import Comparison

TrialState = Literal["done", "failed", "left out"]


@dataclass(frozen=True)
class Judged:
    """A quantity of a trial beside its limit, None where no limit is agreed."""

    value: float
    unit: str
    limit: float | None
    state: str


@dataclass(frozen=True)
class TrialLine:
    """One trial, or a subject's own steps (`trial` "")."""

    subject: str
    trial: str
    condition: str
    state: TrialState
    report: str = ""  # place of its report relative to the page, "" where there is none
    steps: tuple[str, ...] = ()  # that ended well
    frames: int = 0
    reason: str = ""  # why it failed or was left out
    # by quantity, as in the trial's own table of quality
    judged: Mapping[str, Judged] = field(default_factory=lambda: FrozenMap({}))
    warnings: int = 0  # what files and steps had to say

    @property
    def over(self) -> int:
        """Quantities beyond their limit."""
        return sum(judged.state == "over" for judged in self.judged.values())


@dataclass(frozen=True)
class Outlier:
    """A value far from those of the other trials of its condition."""

    subject: str
    trial: str
    condition: str
    quantity: str
    value: float
    unit: str
    middle: float  # median of the condition
    score: float  # modified z-score


@dataclass(frozen=True)
class Described:
    """A quantity in each condition: mean, standard deviation, count.

    The standard deviation has ddof = 1. The count is that of subjects (or trials).
    """

    quantity: str
    unit: str
    conditions: tuple[tuple[float, float, int], ...]


@dataclass(frozen=True)
class ValueDifference:
    """A quantity in two conditions, the second less the first."""

    first: str
    second: str
    step: str
    quantity: str
    unit: str
    paired: bool  # whether it is of subjects (or trials of one subject) with both
    unit_of: str  # "subjects", or "trials" of one subject
    count: tuple[int, int]  # of these in each condition
    means: tuple[float, float]
    # low, high: interval by the spread of subjects or trials alone, NaN with fewer than two
    low: float
    high: float
    # standard deviation that the draws leave of the difference, NaN where nothing was drawn
    measured_sd: float
    # low_all, high_all: interval with both
    low_all: float
    high_all: float

    @property
    def difference(self) -> float:
        """Of the means, the first less the second."""
        return self.means[0] - self.means[1]


@dataclass(frozen=True, eq=False)
class StudyInput:
    """A study as its page shows it."""

    name: str
    date: str
    version: str
    trials: tuple[TrialLine, ...]
    conditions: tuple[Condition, ...] = ()
    comparisons: tuple[Comparison, ...] = ()
    outliers: tuple[Outlier, ...] = ()
    described: tuple[Described, ...] = ()  # quantities in the order of the tables
    # of values between conditions, where errors were drawn
    differences: tuple[ValueDifference, ...] = ()
    # what made steps be computed again, each with the trials it concerns
    changes: tuple[tuple[str, tuple[str, ...]], ...] = ()
    # of each trial, by subject and trial
    messages: tuple[tuple[str, tuple[Message, ...]], ...] = ()
    notes: tuple[str, ...] = ()
    files: tuple[tuple[str, str], ...] = ()  # tables beside the page, place and what they hold

    def in_state(self, state: TrialState) -> tuple[TrialLine, ...]:
        """Trials that are done, failed or left out."""
        return tuple(trial for trial in self.trials if trial.state == state)
