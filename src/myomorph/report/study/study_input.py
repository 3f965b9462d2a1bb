"""What the page on a study is made of: its trials, its conditions, and what is unusual in them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from myomorph.analysis.conditions import Condition
from myomorph.analysis.groups import Comparison
from myomorph.model.frozen_map import FrozenMap

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
    """One trial, or a subject's own steps (`trial` "").

    Attributes
    ----------
    report : place of its report relative to the page, "" where there is none
    steps : that ended well
    reason : why it failed or was left out
    judged : by quantity, as in the trial's own table of quality
    warnings : what files and steps had to say
    """

    subject: str
    trial: str
    condition: str
    state: TrialState
    report: str = ""
    steps: tuple[str, ...] = ()
    frames: int = 0
    reason: str = ""
    judged: Mapping[str, Judged] = field(default_factory=lambda: FrozenMap({}))
    warnings: int = 0

    @property
    def over(self) -> int:
        """Quantities beyond their limit."""
        return sum(judged.state == "over" for judged in self.judged.values())


@dataclass(frozen=True)
class Outlier:
    """A value far from those of the other trials of its condition.

    Attributes
    ----------
    middle : median of the condition
    score : modified z-score
    """

    subject: str
    trial: str
    condition: str
    quantity: str
    value: float
    unit: str
    middle: float
    score: float


@dataclass(frozen=True)
class Described:
    """A quantity in each condition: mean, standard deviation (ddof = 1) and number of subjects (or trials)."""

    quantity: str
    unit: str
    conditions: tuple[tuple[float, float, int], ...]


@dataclass(frozen=True)
class ValueDifference:
    """A quantity in two conditions, the second less the first.

    Attributes
    ----------
    paired : whether it is of subjects (or trials of one subject) with both
    unit_of : "subjects", or "trials" of one subject
    count : of these in each condition
    low, high : interval by the spread of subjects or trials alone, NaN with fewer than two
    measured_sd : standard deviation that the draws leave of the difference, NaN where nothing was drawn
    low_all, high_all : interval with both
    """

    first: str
    second: str
    step: str
    quantity: str
    unit: str
    paired: bool
    unit_of: str
    count: tuple[int, int]
    means: tuple[float, float]
    low: float
    high: float
    measured_sd: float
    low_all: float
    high_all: float

    @property
    def difference(self) -> float:
        """Of the means, the first less the second."""
        return self.means[0] - self.means[1]


@dataclass(frozen=True, eq=False)
class StudyInput:
    """A study as its page shows it.

    Attributes
    ----------
    described : quantities in the order of the tables
    differences : of values between conditions, where errors were drawn
    changes : what made steps be computed again, each with the trials it concerns
    files : tables beside the page, place and what they hold
    """

    name: str
    date: str
    version: str
    trials: tuple[TrialLine, ...]
    conditions: tuple[Condition, ...] = ()
    comparisons: tuple[Comparison, ...] = ()
    outliers: tuple[Outlier, ...] = ()
    described: tuple[Described, ...] = ()
    differences: tuple[ValueDifference, ...] = ()
    changes: tuple[tuple[str, tuple[str, ...]], ...] = ()
    notes: tuple[str, ...] = ()
    files: tuple[tuple[str, str], ...] = ()

    def in_state(self, state: TrialState) -> tuple[TrialLine, ...]:
        """Trials that are done, failed or left out."""
        return tuple(trial for trial in self.trials if trial.state == state)
