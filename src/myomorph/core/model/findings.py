"""Findings of checks of a recording, one value each, and their corrections.

A check is a function from what is checked to findings; `repaired` is the only place where a finding
changes anything.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np

from myomorph.core.model.arrays import Array, runs
from myomorph.core.model.messages import Message, Severity, as_message, summarized
from myomorph.core.model.messages import Span as Span

INSTANT = 0.005  # Longest stretch that is written as one time [s]

Checked = TypeVar("Checked")


@dataclass(frozen=True)
class Repair:
    """Correction of what a check found.

    Attributes
    ----------
    apply : from what was checked to the same corrected
    done : what was done, for the finding's text
    advice : what helps instead where it is only reported
    cures : whether what was found changes no number once it is done
    """

    apply: Callable[[Any], Any]
    done: str
    advice: str = ""
    cures: bool = True


@dataclass(frozen=True)
class Finding:
    """Something about a recording that may not be believed as it is.

    Attributes
    ----------
    kind : short name of what is wrong, such as "wrong foot", for tables and tests
    place : what it was found in: a plate, force, marker, coordinate or file
    text : one line for people: what, where, how much, and what was done or which option helps, with
        its cause
    times : (start, stop) of each stretch of time concerned [s]; empty where all of it is
    repaired : whether what follows was computed with it corrected
    size : how bad, to sort by within a kind; not stored
    repair : how it can be put right, None where nothing is safe; not stored
    """

    kind: str
    place: str
    text: Message
    times: tuple[Span, ...] = ()
    repaired: bool = False
    size: float = field(default=0.0, compare=False)
    repair: Repair | None = field(default=None, compare=False, repr=False)

    def __str__(self) -> str:
        return str(self.text)

    @property
    def message(self) -> Message:
        """Its text with its cause, place and times."""
        return as_message(self.text).changed(place=self.place, times=self.times)

    @property
    def record(self) -> dict[str, object]:
        """Fields as plain values, for files."""
        names = ("kind", "place", "text", "times", "repaired")
        values = {name: getattr(self, name) for name in names}
        return values | {"message": self.message.record}


def repaired(
    checked: Checked, findings: Iterable[Finding], apply: bool = True
) -> tuple[Checked, tuple[Finding, ...]]:
    """Apply the repairs of findings, one after the other.

    Parameters
    ----------
    checked : what the findings are about
    findings : with or without repairs
    apply : whether to apply the repairs; else nothing changes, and the findings' texts say what
        helps

    Returns
    -------
    checked : corrected
    findings : as they are reported
    """
    reported = []
    for finding in findings:
        repair = finding.repair
        if repair is not None:
            checked = repair.apply(checked) if apply else checked
            finding = replace(finding, text=_repaired_text(finding, repair, apply), repaired=apply)
        reported.append(replace(finding, repair=None))
    return checked, tuple(reported)


def _repaired_text(finding: Finding, repair: Repair, applied: bool) -> Message:
    """Say what was done or what helps; what is cured changes no number, and is good to know."""
    text = as_message(finding.text)
    helps = repair.done if applied else repair.advice
    severity: Severity = "good to know" if applied and repair.cures else text.severity
    return text.changed(f"{text}: {helps}" if helps else None, severity=severity)


def messages_of_findings(findings: Iterable[Finding]) -> tuple[Message, ...]:
    """Messages of findings, one for each kind of fault: the worst, and how many are alike."""
    return summarized(((finding.kind, finding.repaired), finding.message) for finding in findings)


def spans_of(time: Array, flags: np.ndarray) -> tuple[Span, ...]:
    """Find the times of each run of flagged frames.

    Parameters
    ----------
    time : (frames,) [s]
    flags : (frames,)

    Returns
    -------
    first and last time of each [s]
    """
    return tuple((float(time[start]), float(time[stop - 1])) for start, stop in runs(flags))


def times_text(spans: Sequence[Span], most: int = 3) -> str:
    """Write times: 'at 1.20 s, from 1.50 to 1.62 s'."""
    parts = [
        f"at {start:.2f} s" if stop - start < INSTANT else f"from {start:.2f} to {stop:.2f} s"
        for start, stop in spans[:most]
    ]
    more = f" and in {len(spans) - most} other parts" if len(spans) > most else ""
    return ", ".join(parts) + more


def pairs_text(pairs: Sequence[tuple[str, str]], most: int = 3) -> str:
    """Write the first pairs of labels."""
    more = f" and {len(pairs) - most} other pairs" if len(pairs) > most else ""
    return ", ".join(f"'{first}' and '{other}'" for first, other in pairs[:most]) + more
