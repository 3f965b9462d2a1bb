"""The tables of a study: the values of all trials in one."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from myomorph.study.jobs import Outcome
from myomorph.study.plan import Plan


def gather_study(plan: Plan, outcomes: Sequence[Outcome], out: Path) -> None:
    """Write the tables of a study from the values of its trials."""
