"""Messages grouped by cause: place, size, effect and remedy of each, the most severe first."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from myomorph.core.model.errors import counted, few
from myomorph.core.model.findings import times_text
from myomorph.core.model.messages import SEVERITIES, Cause, Message, Severity, Span, unique

APART = 0.1
"""Stretches of time closer than this are one [s]."""
MAX_PLACES = 3
"""Places that are named of one cause."""
EVERYWHERE = frozenset({"contacts", "frames", "markers", "all markers"})
"""Places of findings that name no single thing."""
NOTE: Severity = "good to know"


@dataclass(frozen=True, kw_only=True)
class CauseGroup:
    """A cause with all its messages of one severity, as they were written.

    Attributes
    ----------
    cause : title, effect and remedy
    severity : of its messages
    messages : the largest first, else in the order of the steps
    """

    cause: Cause
    severity: Severity
    messages: tuple[Message, ...]

    @property
    def is_warning(self) -> bool:
        """Whether a number of the first screen may change by more than its error."""
        return self.severity != NOTE

    @property
    def spans(self) -> tuple[Span, ...]:
        """Stretches of time that its messages name, joined where they are close [s]."""
        return joined_spans(span for message in self.messages for span in message.times)

    @property
    def places(self) -> tuple[str, ...]:
        """Plates, markers, muscles or files, each once."""
        named = (place for message in self.messages for place in message.place.split(", "))
        return tuple(dict.fromkeys(name for name in named if name and name not in EVERYWHERE))

    @property
    def where(self) -> str:
        """Places and times, "" where the whole recording is concerned."""
        spans = self.spans
        times = times_text(spans) if spans else ""
        parts = (few(self.places, MAX_PLACES), times)
        return "; ".join(part for part in parts if part)

    @property
    def largest(self) -> float:
        """The largest size of its messages, 0 where none says one."""
        sizes = (abs(message.size) for message in self.messages if message.size is not None)
        return max(sizes, default=0.0)

    @property
    def share(self) -> float:
        """Share of the frames that the worst of its messages concerns, 0 where none says one."""
        return max((message.share or 0.0 for message in self.messages), default=0.0)

    @property
    def size(self) -> str:
        """How much it is, in words; "" where one message says it itself."""
        sized = next((each.size for each in self.messages if each.size is not None), None)
        if not self.cause.size or sized is None:
            return "" if len(self.messages) == 1 else counted(len(self.messages), "message")
        return self.cause.size.format(size=f"{sized:.3g}")


def grouped_messages(messages: Iterable[str]) -> tuple[CauseGroup, ...]:
    """Messages by severity and cause, the most severe first.

    Of one severity a cause that others follow from comes before them, and alike ones are in the
    order of the steps. A text that is no message is of an unknown cause.
    """
    of_group: dict[tuple[Severity, Cause], list[Message]] = {}
    for message in unique(messages):
        of_group.setdefault((message.severity, message.cause), []).append(message)
    groups = [
        CauseGroup(cause=cause, severity=severity, messages=_largest_first(found))
        for (severity, cause), found in of_group.items()
    ]
    return tuple(
        sorted(groups, key=lambda group: (SEVERITIES.index(group.severity), group.cause.order))
    )


def _largest_first(messages: Sequence[Message]) -> tuple[Message, ...]:
    """Sort messages by their size; those without one stay behind, in their order."""
    return tuple(sorted(messages, key=lambda message: -abs(message.size or 0.0)))


def outcome_lines(messages: Iterable[str], listed: str) -> list[str]:
    """Lines for people on what messages say, the most severe cause first.

    A warning's cause has its size and place, its messages, the largest first, its effect and
    remedy; what is good to know has one line in all.

    Parameters
    ----------
    messages : of all steps
    listed : where every message stands
    """
    lines: list[str] = []
    known: list[CauseGroup] = []
    for group in grouped_messages(messages):
        if not group.is_warning:
            known.append(group)
            continue
        where = f" ({group.where})" if group.where else ""
        size = f": {group.size}" if group.size else ""
        lines.append(f"{group.severity}: {group.cause.title}{where}{size}")
        lines += [f"  {' '.join(text.split())}" for text in group.messages]
        lines.append(f"  {group.cause.effect} {group.cause.remedy}".rstrip())
    if known:
        titles = ", ".join(f"{group.cause.title} ({len(group.messages)})" for group in known)
        lines.append(f"{NOTE}: {titles}: {listed}")
    return lines


def warnings_of(messages: Iterable[str]) -> tuple[Message, ...]:
    """Messages that may change a number of the first screen by more than its error."""
    groups = grouped_messages(messages)
    return tuple(message for group in groups if group.is_warning for message in group.messages)


def joined_spans(spans: Iterable[Span]) -> tuple[Span, ...]:
    """Join stretches of time that are closer than `APART`, in their order [s]."""
    joined: list[Span] = []
    for start, stop in sorted(spans):
        if joined and start <= joined[-1][1] + APART:
            joined[-1] = (joined[-1][0], max(stop, joined[-1][1]))
        else:
            joined.append((start, stop))
    return tuple(joined)
