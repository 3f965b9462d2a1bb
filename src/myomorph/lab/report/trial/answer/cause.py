"""Messages of a trial grouped by their cause: place, size, effect and remedy of each."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

from myomorph.core.model.findings import Span, times_text

Gravity = Literal["changes results", "may change results", "good to know"]
GRAVITIES: tuple[Gravity, ...] = get_args(Gravity)
TIMES = re.compile(r"(?:from |at |worst at )?(\d+\.\d+)(?: to (\d+\.\d+))? s\b")
APART = 0.1
"""Stretches of time closer than this are one [s]."""


@dataclass(frozen=True, kw_only=True)
class CauseKind:
    """A cause that messages are known to have.

    Attributes
    ----------
    title : what is the matter, as "Feet beside the plates"
    gravity : what it can do to the numbers of the first screen
    patterns : regular expressions, one of which each of its messages has; of the numbers that are
        `(?P<size>...)` the largest is said
    size : sentence with {size} and {count}, how much it is
    effect : on which results, and how
    remedy : a command or a better recording
    """

    title: str
    gravity: Gravity
    patterns: tuple[str, ...]
    size: str
    effect: str
    remedy: str

    def match(self, message: str) -> re.Match[str] | None:
        """Where a message is of this cause."""
        found = (re.search(pattern, message, re.IGNORECASE) for pattern in self.patterns)
        return next((each for each in found if each is not None), None)


@dataclass(frozen=True, kw_only=True)
class Cause:
    """A cause that a trial has, with all its messages as they were written.

    Attributes
    ----------
    kind : title, gravity, effect and remedy
    where : places and times, "" where the whole recording is concerned
    size : how much it is
    largest : the largest number that a message says, 0 for none
    messages : in the order of the steps
    """

    kind: CauseKind
    where: str
    size: str
    largest: float
    messages: tuple[str, ...]


OTHER = CauseKind(
    title="Other remarks",
    gravity="may change results",
    patterns=(".",),
    size="{count}",
    effect="as each says",
    remedy="read them",
)
"""Of messages that belong to no known cause: none is lost."""


def grouped(messages: Iterable[str], kinds: Sequence[CauseKind]) -> tuple[Cause, ...]:
    """Messages by their causes, the gravest first; those of no kind are `OTHER`."""
    of_kind: dict[CauseKind, list[str]] = {}
    for message in dict.fromkeys(messages):
        kind = next((kind for kind in kinds if kind.match(message)), OTHER)
        of_kind.setdefault(kind, []).append(message)
    causes = [_cause(kind, found) for kind, found in of_kind.items()]
    return tuple(sorted(causes, key=lambda cause: GRAVITIES.index(cause.kind.gravity)))


def _cause(kind: CauseKind, messages: list[str]) -> Cause:
    """One cause, with what its messages say together."""
    sizes = [float(size) for message in messages if (size := _size(kind, message))]
    count = f"{len(messages)} message{'s' if len(messages) > 1 else ''}"
    largest = max(sizes, default=0.0)
    return Cause(
        kind=kind,
        where=_where(messages),
        size=kind.size.format(size=f"{largest:.3g}", count=count),
        largest=largest,
        messages=tuple(messages),
    )


def _size(kind: CauseKind, message: str) -> str:
    """Return the number that a message says, "" for none."""
    found = kind.match(message)
    if found is None or "size" not in found.re.groupindex:
        return ""
    return str(found["size"] or "")


def _where(messages: Iterable[str]) -> str:
    """Stretches of time that messages name, joined where they are close; "" for none."""
    spans: list[Span] = []
    for message in messages:
        for found in TIMES.finditer(message):
            start = float(found[1])
            spans.append((start, float(found[2] or start)))
    joined: list[Span] = []
    for start, stop in sorted(spans):
        if joined and start <= joined[-1][1] + APART:
            joined[-1] = (joined[-1][0], max(stop, joined[-1][1]))
        else:
            joined.append((start, stop))
    return times_text(joined) if joined else ""
