"""A quantity held against a limit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

State = Literal["ok", "over", "note"]


@dataclass(frozen=True)
class Verdict:
    """One quantity against its limit.

    Attributes
    ----------
    quantity : what was looked at
    value, unit : what was found
    limit : what it should stay under, None where there is no agreed limit
    state : "ok", "over" the limit, or "note" where it is only told
    worst : name of what was worst
    time : when it was worst [s], None where it has no time
    source : key of the reference the limit comes from
    detail : a clause that explains the value
    """

    quantity: str
    value: float
    unit: str
    limit: float | None
    state: State
    worst: str = ""
    time: float | None = None
    source: str = ""
    detail: str = ""
