"""Messages: sentences about what may be wrong, each with its cause.

A message is made where something is found, by the cause that it has:
`FEET_BESIDE.message("the load on ...", times=spans, size=40.0)`. It is a text wherever one is
wanted, and carries its cause through results, files and pages.
"""

from __future__ import annotations

import json
import math
from collections.abc import Hashable, Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal, NamedTuple, TypeAlias, get_args

from myomorph.core.model.errors import few

Span: TypeAlias = tuple[float, float]
"""First and last time of a stretch of frames [s]."""
Severity = Literal["changes results", "may change results", "good to know"]
SEVERITIES: tuple[Severity, ...] = get_args(Severity)
"""Effects of a cause on the numbers of a page's first screen (`severity.py`), severest first."""


@dataclass(frozen=True, kw_only=True)
class Cause:
    """A cause that messages have, declared once in its wing's `causes.py`.

    Attributes
    ----------
    key : its name in files, as "feet_beside"
    title : what is the matter, as "Feet beside the plates"
    severity : the most severe that it can be; a message may say that it is less
    effect : on which results, and how
    remedy : a command or a better recording, "" where nothing needs to be done
    quantities : names of the quantities that it affects
    size : sentence with {size}, how much it is; "" where only the number of messages says it
    order : of messages of one severity: 0 where others follow from it, as from a wrong unit or
        person; 2 where it may follow from others, as a force under no foot; 1 for the rest
    """

    key: str
    title: str
    severity: Severity
    effect: str
    remedy: str = ""
    quantities: tuple[str, ...] = ()
    size: str = ""
    order: int = 1

    def message(  # page: what is known of a message, all of it optional
        self,
        text: str,
        *,
        place: str = "",
        times: Sequence[Span] = (),
        size: float | None = None,
        share: float | None = None,
        severity: Severity | None = None,
    ) -> Message:
        """Make a message of this cause; for the values see `Facts`."""
        facts = Facts(
            cause=self,
            place=place,
            times=tuple(times),
            size=size,
            share=share,
            severity=self.severity if severity is None else severity,
        )
        return Message(text, facts)


OTHER = Cause(
    key="other",
    title="Other remarks",
    severity="may change results",
    effect="As each says.",
    remedy="Read them.",
)
"""Of messages whose cause is not known, as those of files that an older version wrote."""


class Facts(NamedTuple):
    """What is known of a message beside its sentence.

    Attributes
    ----------
    cause : what it comes of
    place : a plate, force, marker, coordinate, muscle or file; "" for none
    times : (start, stop) of each stretch of time concerned [s]; empty where all of it is
    size : number of the cause's sentence of size, None where nothing is measured
    share : of the frames concerned, 0 to 1; None where it is not known
    severity : what it does to a number of the first screen
    """

    cause: Cause
    place: str
    times: tuple[Span, ...]
    size: float | None
    share: float | None
    severity: Severity


class Message(str):
    """A sentence about what may be wrong, with its cause.

    It equals its text, and does not change.

    Attributes
    ----------
    facts : what is known of it; each is an attribute of the message as well
    """

    __slots__ = ("facts",)

    facts: Facts

    def __new__(cls, text: str, facts: Facts) -> Message:
        """Make a message; its cause's own `message` is shorter."""
        made = super().__new__(cls, text)
        object.__setattr__(made, "facts", facts)
        return made

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError(f"a message does not change: make another one ({name})")

    def __reduce__(self) -> tuple[Any, ...]:
        return Message, (str(self), self.facts)

    @property
    def cause(self) -> Cause:
        """What it comes of."""
        return self.facts.cause

    @property
    def place(self) -> str:
        """A plate, force, marker, coordinate, muscle or file; "" for none."""
        return self.facts.place

    @property
    def times(self) -> tuple[Span, ...]:
        """Each stretch of time concerned (start, stop) [s]; empty where all of it is."""
        return self.facts.times

    @property
    def size(self) -> float | None:
        """Number of the cause's sentence of size, None where nothing is measured."""
        return self.facts.size

    @property
    def share(self) -> float | None:
        """Share of the frames concerned, 0 to 1; None where it is not known."""
        return self.facts.share

    @property
    def severity(self) -> Severity:
        """What it does to a number of the first screen."""
        return self.facts.severity

    @property
    def text(self) -> str:
        """The sentence alone, in one line."""
        return " ".join(self.split())

    @property
    def cause_name(self) -> str:
        """Name of its cause in files."""
        return self.cause.key

    @property
    def cause_title(self) -> str:
        """What is the matter."""
        return self.cause.title

    @property
    def effect(self) -> str:
        """On which results, and how."""
        return self.cause.effect

    @property
    def remedy(self) -> str:
        """What to do, "" where nothing needs to be done."""
        return self.cause.remedy

    @property
    def start(self) -> float:
        """First time concerned [s], NaN where all of it is."""
        return min((start for start, _ in self.times), default=math.nan)

    @property
    def stop(self) -> float:
        """Last time concerned [s], NaN where all of it is."""
        return max((stop for _, stop in self.times), default=math.nan)

    @property
    def intervals(self) -> int:
        """Number of time intervals concerned."""
        return len(self.times)

    @property
    def quantities(self) -> str:
        """Names of the quantities that its cause affects."""
        return " ".join(self.cause.quantities)

    def changed(self, text: str | None = None, **facts: Any) -> Message:
        """Return the same with another text, or other values."""
        return Message(str(self) if text is None else text, self.facts._replace(**facts))

    def within(self, place: str) -> Message:
        """Return the same, said of a file, trial or other place: 'walk.c3d: ...'."""
        return self.changed(f"{place}: {self}", place=self.place or place)

    @property
    def record(self) -> dict[str, Any]:
        """Fields as plain values, for files; a cause is there with its words."""
        return {"text": str(self), **self.facts._asdict(), "cause": asdict(self.cause)}

    @staticmethod
    def of_record(record: str | dict[str, Any]) -> Message:
        """Read what `record` wrote; of older versions a text, whose cause is not known."""
        if isinstance(record, str):
            return OTHER.message(record)
        cause = record["cause"]
        known = Cause(
            key=cause["key"],
            title=cause["title"],
            severity=_severity(cause),
            effect=cause["effect"],
            remedy=cause["remedy"],
            quantities=tuple(cause["quantities"]),
            size=cause["size"],
            # Files of versions before this one do not state it.
            order=cause.get("order", 1),
        )
        return known.message(
            record["text"],
            place=record["place"],
            times=[(start, stop) for start, stop in record["times"]],
            size=record["size"],
            share=record["share"],
            severity=_severity(record),
        )


def _severity(record: dict[str, Any]) -> Severity:
    """Return the severity of a record; files of version 0.1 call it gravity."""
    severity: Severity = record["severity"] if "severity" in record else record["gravity"]
    return severity


def as_message(text: str) -> Message:
    """Return a message itself; a text of unknown cause becomes one of `OTHER`."""
    return text if isinstance(text, Message) else OTHER.message(text)


def together(messages: Sequence[Message]) -> Message:
    """Say alike messages of one cause as one: the worst, and how many others there are where.

    Parameters
    ----------
    messages : one or more of one cause, such as of several markers
    """
    worst = max(
        messages, key=lambda each: (-SEVERITIES.index(each.severity), abs(each.size or 0.0))
    )
    others = [message for message in messages if message is not worst]
    if not others:
        return worst
    places = [message.place for message in others if message.place]
    where = f": {few(places)}" if places else ""
    shares = [message.share for message in messages if message.share is not None]
    return worst.changed(
        f"{worst}; and {len(others)} more alike{where}",
        place=few(dict.fromkeys([worst.place, *places])) if places else worst.place,
        times=tuple(sorted(span for message in messages for span in message.times)),
        share=max(shares, default=None),
    )


def summarized(messages: Iterable[tuple[Hashable, Message]]) -> tuple[Message, ...]:
    """Say messages of one kind and cause as one each, in the order of the first.

    Parameters
    ----------
    messages : with the kind of fault that each is of
    """
    alike: dict[Hashable, list[Message]] = {}
    for kind, message in messages:
        alike.setdefault((kind, message.cause.key), []).append(message)
    return tuple(map(together, alike.values()))


def located(place: str, messages: Iterable[str]) -> tuple[Message, ...]:
    """Say messages of a file, trial or other place: 'walk.c3d: ...'."""
    return tuple(as_message(text).within(place) for text in messages)


def unique(messages: Iterable[str]) -> tuple[Message, ...]:
    """Messages in their order, each text once."""
    return tuple(map(as_message, dict.fromkeys(messages)))


def messages_text(messages: Iterable[str]) -> str:
    """Write messages as JSON."""
    return json.dumps([as_message(text).record for text in messages])


def messages_of(text: str) -> tuple[Message, ...]:
    """Read what `messages_text` wrote, and lists of texts that older versions wrote."""
    return tuple(map(Message.of_record, json.loads(text)))
