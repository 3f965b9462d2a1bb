"""What one trial comes to in numbers: a value a row, and mean curves over the cycle."""

from __future__ import annotations

from myomorph.study.jobs import Outcome
from myomorph.study.steps import Take


def write_trial_values(take: Take, outcome: Outcome) -> None:
    """Write a trial's values beside its results, from these alone."""
