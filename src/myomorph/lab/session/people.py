"""Recordings by person: by names, and where these do not say, by segment lengths and weight."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from myomorph.core.model.known import Known
from myomorph.lab.session.body_measures import (
    MIN_CHANCE,
    BodyMeasures,
    Comparison,
    compared,
)
from myomorph.lab.session.names import SubjectCode

OTHER_CODE = 0.05
"""Bodies whose files have codes of different subjects differ by chance with less than this."""
SAME_NAME = 1e-5  # Bodies that have one name in their headers are of two people below this chance.
ALIKE = 0.15
"""Mean squared deviation below which markers are where they were: one body in one session, whatever
programs call it.
"""
MANY_LENGTHS = 6  # Measures that must agree so.


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """What one recording says of who it is of.

    Attributes
    ----------
    path : of the recording
    header : who it is by its header
    code : of a subject, in names of files and folders
    measures : of the body
    """

    path: Path
    header: Known[str]
    code: SubjectCode
    measures: BodyMeasures

    @property
    def named(self) -> bool:
        """Whether any name says who it is."""
        return bool(self.header) or bool(self.code.text)

    def shares_name(self, other: Evidence) -> bool:
        """Whether a code, or without codes a header, names both alike."""
        if self.code.text and other.code.text:
            return self.code.text == other.code.text
        return bool(self.header) and self.header.value == other.header.value


@dataclass(frozen=True, kw_only=True)
class Group:
    """Recordings of one person, by their numbers.

    Attributes
    ----------
    members : numbers of recordings, ascending
    why : what tells them from the others before them, "" for the first
    """

    members: tuple[int, ...]
    why: str = ""


def people_of(recordings: Sequence[Evidence]) -> tuple[Group, ...]:
    """Group recordings by who they are of.

    Recordings with different names are of two people, unless markers show that they are of one body
    in one session. Without names they are of one, unless their bodies differ more than one body
    does by chance. A recording joins the group that it is nearest to.
    """
    groups: list[list[int]] = []
    reasons: list[str] = []
    recordings = _with_sure_codes(recordings)
    # Those first that say most of who they are of, so that the others join them.
    order = sorted(range(len(recordings)), key=lambda index: _says_little(recordings[index], index))
    for index in order:
        fits = [_apart(recordings, group, index) for group in groups]
        joined = [number for number, fit in enumerate(fits) if not fit.why]
        if joined:
            best = max(joined, key=lambda number: fits[number].rank)
            groups[best].append(index)
        else:
            groups.append([index])
            reasons.append(next((fit.why for fit in fits if fit.why), ""))
    together = sorted(zip(groups, reasons, strict=True), key=lambda pair: min(pair[0]))
    return tuple(
        Group(members=tuple(sorted(members)), why=reason if number else "")
        for number, (members, reason) in enumerate(together)
    )


def _says_little(recording: Evidence, index: int) -> tuple[bool, int, int]:
    return not recording.named, -len(recording.measures.lengths), index


def _with_sure_codes(recordings: Sequence[Evidence]) -> list[Evidence]:
    """Make codes sure where each of several codes is that of several recordings."""
    counts = Counter(one.code.text for one in recordings if one.code.text)
    several = len(counts) > 1 and min(counts.values()) > 1
    return [
        replace(one, code=replace(one.code, sure=one.code.sure or several)) for one in recordings
    ]


@dataclass(frozen=True, kw_only=True)
class Fit:
    """Whether a recording may belong to a group.

    Attributes
    ----------
    why : what keeps it apart, "" where nothing does
    rank : how well it fits: same name, same folder, chance
    """

    why: str
    rank: tuple[bool, bool, float]


def _apart(recordings: Sequence[Evidence], group: Sequence[int], index: int) -> Fit:
    """Whether a recording belongs to a group: by a member of its name, else by the farthest."""
    own = recordings[index]
    others = [recordings[member] for member in group]
    comparisons = [compared(other.measures, own.measures) for other in others]
    reasons = [_why(other, own, one) for other, one in zip(others, comparisons, strict=True)]
    same = [own.shares_name(other) for other in others]
    if any(alike and not why for alike, why in zip(same, reasons, strict=True)):
        reasons = []
    beside = any(other.path.parent == own.path.parent for other in others)
    chance = min(one.chance for one in comparisons)
    return Fit(why=next((why for why in reasons if why), ""), rank=(any(same), beside, chance))


def _why(first: Evidence, second: Evidence, comparison: Comparison) -> str:
    """Say what tells two recordings apart, "" where nothing does."""
    if comparison.count >= MANY_LENGTHS and comparison.squares < ALIKE * comparison.count:
        return ""
    codes = (first.code, second.code)
    other_code = all(code.text for code in codes) and codes[0].text != codes[1].text
    headers = bool(first.header) and bool(second.header)
    same_header = headers and first.header.value == second.header.value
    if headers and not same_header:
        return f"its header names {second.header}, not {first.header}"
    if other_code and all(code.sure for code in codes):
        return f"its {codes[1].origin} begins with {codes[1].text}, not {codes[0].text}"
    if other_code:
        limit = OTHER_CODE
    elif same_header:
        limit = SAME_NAME
    else:
        limit = MIN_CHANCE
    if comparison.chance >= limit:
        return ""
    return f"another body than in {first.path.name}: {comparison.farthest}"
