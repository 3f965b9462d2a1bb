"""Recordings by person: by names, and where these do not say, by segment lengths and weight."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from myomorph.core.model.messages import Message
from myomorph.lab.causes import SESSION
from myomorph.lab.session.evidence import Evidence
from myomorph.lab.session.placements import Placement, placements_of

DECISIVE = 2.0
"""Decadic logarithm of the odds from which on recordings are of two people: 100 to 1."""
MIN_ROBUST = 1.0  # The same, without the bone that says most.
# What speaks for two people before bodies are compared, as decadic logarithms of odds.
SAME_NAME = -4.0  # Headers have one name.
SAME_CODE = -2.0  # Names of files or folders have one code.
OTHER_CODE = 1.0  # They have different ones that may be codes of subjects.
OTHER_WORD = 0.5  # Names of files begin with different words, as `anna_walk` and `ben_walk`.
SAME_DAY = 0.5  # Markers are seldom placed twice on one day.
OTHER_DAY = -0.5  # Whoever is recorded on another day is marked anew.
# What speaks for one person where several may be it.
ONE_NAME = -10.0
ONE_MARKER_SET = -1.0
ONE_FOLDER = -0.3
CLEAR = 0.7  # Odds by which one person is better than another: 5 to 1.
MAX_UNRESOLVED = 3  # Placements that a person's sentences name.


@dataclass(frozen=True, kw_only=True)
class Group:
    """Recordings of one person, by their numbers.

    Attributes
    ----------
    members : numbers of recordings, ascending
    why : what tells them from the others before them, "" for the first
    unresolved : what cannot be told, one sentence each
    """

    members: tuple[int, ...]
    why: str = ""
    unresolved: tuple[Message, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """Whether a placement of markers is of another person.

    Attributes
    ----------
    why : what tells them apart, "" where nothing does
    rank : decadic logarithm of the odds for another person, with what speaks for this one
    """

    why: str
    rank: float


def people_of(recordings: Sequence[Evidence]) -> tuple[Group, ...]:
    """Group recordings by who they are of.

    Recordings whose markers are where they were are of one body, whatever they are called. Others
    are of two people where their names say so, or where odds are decisive: those of the bodies, by
    lengths and weight, times those that names and days speak for. What is not decisive is taken as
    one person, and said to be unresolved unless a name ties it.
    """
    people: list[list[Placement]] = []
    reasons: list[str] = []
    doubtful: list[list[str]] = []
    for placement in placements_of(_with_sure_codes(recordings)):
        verdicts = [_verdict_of(group, placement) for group in people]
        joined = sorted(
            (number for number, verdict in enumerate(verdicts) if not verdict.why),
            key=lambda number: verdicts[number].rank,
        )
        if not joined:
            people.append([placement])
            doubtful.append([])
            reasons.append(next((verdict.why for verdict in verdicts), ""))
            continue
        best, *others = joined
        if others and verdicts[others[0]].rank - verdicts[best].rank < CLEAR:
            doubtful[best].append(placement.names)
        people[best].append(placement)
    groups = [
        _group(person, why, names)
        for person, why, names in zip(people, reasons, doubtful, strict=True)
    ]
    return _in_order(groups)


def _with_sure_codes(recordings: Sequence[Evidence]) -> list[Evidence]:
    """Make codes sure where each of several codes is that of several recordings."""
    counts = Counter(one.code.text for one in recordings if one.code.text)
    several = len(counts) > 1 and min(counts.values()) > 1
    return [
        replace(one, code=replace(one.code, sure=one.code.sure or several)) for one in recordings
    ]


def _verdict_of(person: Sequence[Placement], placement: Placement) -> Verdict:
    """Whether a placement is of another person: by one of its name, else by the farthest."""
    verdicts = [_verdict(other, placement) for other in person]
    tied = any(
        other.shares_name(placement) and not verdict.why
        for other, verdict in zip(person, verdicts, strict=True)
    )
    why = next((verdict.why for verdict in verdicts if verdict.why), "")
    return Verdict(why="" if tied else why, rank=max(verdict.rank for verdict in verdicts))


def _verdict(first: Placement, second: Placement) -> Verdict:
    """Whether two placements are of two people, by names, and by names and bodies."""
    odds = first.odds(second)
    one, other, before = _names_odds(first, second)
    rank = odds.evidence + before + ONE_MARKER_SET * first.shared_labels(second)
    rank += ONE_NAME * first.shares_name(second) + ONE_FOLDER * first.is_beside(second)
    why = one.named_apart(other)
    apart = odds.evidence + before >= DECISIVE and odds.robust + before >= MIN_ROBUST
    if not why and apart:
        why = f"another body than in {one.path.name}: {odds.farthest}"
    return Verdict(why=why, rank=rank)


def _names_odds(first: Placement, second: Placement) -> tuple[Evidence, Evidence, float]:
    """Find the recordings of two placements whose names say most, and the odds for two people."""
    pairs = [
        (_odds_of_names(one, other, first.same_markers(second)), one, other)
        for one in first.recordings.values()
        for other in second.recordings.values()
    ]
    odds, one, other = max(pairs, key=lambda pair: abs(pair[0]))
    return one, other, odds


def _odds_of_names(one: Evidence, other: Evidence, same_markers: bool) -> float:
    """Decadic logarithm of the odds for two people, before their bodies are compared."""
    if one.header and other.header:
        return SAME_NAME if one.header.value == other.header.value else -SAME_NAME
    if one.code.text and other.code.text:
        return SAME_CODE if one.code.text == other.code.text else OTHER_CODE
    odds = 0.0
    if one.word and other.word:
        odds += OTHER_WORD if one.word != other.word else -OTHER_WORD
    if one.day is not None and other.day is not None:
        if one.day != other.day:
            odds += OTHER_DAY
        elif same_markers:
            odds += SAME_DAY
    return odds


def _group(person: Sequence[Placement], why: str, doubtful: Sequence[str]) -> Group:
    """Group of a person's placements.

    Parameters
    ----------
    doubtful : names of recordings that may as well be of another person
    """
    numbers = [number for placement in person for number in placement.recordings]
    texts = [*_unresolved(person)][:MAX_UNRESOLVED]
    texts += [
        SESSION.message(f"{names}: of this person or another one of these, unknown")
        for names in doubtful
    ]
    return Group(members=tuple(sorted(numbers)), why=why, unresolved=tuple(texts))


def _unresolved(person: Sequence[Placement]) -> Iterator[Message]:
    """Placements of a person that no name ties to those before, and that may be of another one."""
    for number, placement in enumerate(person):
        others = person[:number]
        odds = [other.odds(placement) for other in others]
        tied = any(other.shares_name(placement) for other in others)
        if tied or not any(one.count for one in odds):
            continue
        nearest = min(range(number), key=lambda index: odds[index].mean_square)
        difference = odds[nearest].farthest
        how = f" ({difference})" if difference else ""
        yield (
            SESSION.message(
                f"markers lie elsewhere in {placement.names} than in {others[nearest].names}{how}:"
                " one person who was marked twice and two people of like build cannot be"
                " distinguished, assumed to be one"
            )
        )


def _in_order(groups: Sequence[Group]) -> tuple[Group, ...]:
    """Sort groups by their recordings; all but the first say what tells them apart."""
    first, *others = sorted(groups, key=lambda group: group.members[0])
    # Where another group was found first, its reason holds for both.
    return (replace(first, why=""), *(replace(one, why=one.why or first.why) for one in others))
