"""Statements of names: who, when and which movement, by a recording's header, file and folder."""

from __future__ import annotations

import csv
import itertools
import re
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import get_args

from myomorph.core.model.known import Known, Origin
from myomorph.core.model.movement import Movement
from myomorph.core.model.series import Trial

NO_NAMES = frozenset(("default", "subject", "new subject", "unnamed", "unknown", "person", "model"))
"""Names that programs write where nobody gave one."""
NO_CODES = frozenset(
    ("gait", "walk", "run", "trial", "take", "test", "cal", "rec", "static", "jump")
)
# `LeftKnee` is left knee; numbers end a word.
WORDS = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+")
MOVEMENT_WORDS: tuple[tuple[Movement, re.Pattern[str]], ...] = (
    (
        "standing",
        re.compile(r"static\w*|stand(ing)?|statique|neutral|calib(ration)?|anatomical|npose|tpose"),
    ),
    ("stairs", re.compile(r"stairs?(up|down)?|stairup|stairdown|steps")),
    ("walking", re.compile(r"walk\w*|gait|marche|overground|levelground|ganganalyse")),
    ("running", re.compile(r"run|running|sprint\w*|jog(ging)?")),
    ("jumping", re.compile(r"jump\w*|cmj|dj|sj|dropjump|hop(s|ping)?|landing")),
    ("squatting", re.compile(r"squats?|squatting")),
    ("rising", re.compile(r"sts\w*|sit(to|2)stand|chair(rise)?|rising")),
    (
        "upper limb",
        re.compile(
            r"reach(ing)?|abd(uction)?|flx|shrug|wheelchair|propulsion|prop|pushrim|throw(ing)?"
        ),
    ),
)
"""Words of files and folders on a movement."""
CONDITION_WORDS = frozenset(
    (
        *(
            "pre",
            "post",
            "before",
            "after",
            "baseline",
            "follow",
            "day",
            "session",
            "visit",
            "week",
        ),
        *("barefoot", "shod", "shoe", "shoes", "brace", "orthosis", "left", "right", "both"),
        *("fast", "slow", "normal", "self", "level", "trial", "take", "rec", "recording", "data"),
        *("test", "task", "markers", "marker", "motion", "capture", "mocap", "std", "raw", "file"),
    )
)
"""First words of names of files that name no person."""
BIDS_ENTITY = re.compile(r"(?P<key>sub|ses|task|run|acq|tracksys)-(?P<value>[A-Za-z0-9]+)")
CODE = re.compile(
    r"(?P<code>(sub(j|ject)?|s|p|pt|pp|pat|patient|part|participant|animal|mouse|rat|id|hc)"
    r"[-_ ]?\d+[A-Za-z]?)(?![A-Za-z0-9])",
    re.IGNORECASE,
)
# A code before words, as in `RBDS001static`.
LEADING_CODE = re.compile(r"(?P<code>(?P<letters>[A-Z]{2,6})\d{2,4})(?=[A-Za-z_])")
YEAR_FIRST = re.compile(r"(?<!\d)(20\d\d)[-_.]?([01]\d)[-_.]?([0-3]\d)(?!\d)")
YEAR_LAST = re.compile(r"(?<!\d)(\d{1,2})[-_./](\d{1,2})[-_./](20\d\d|\d\d)(?!\d)")


@dataclass(frozen=True, kw_only=True)
class SubjectCode:
    """A code of a subject in the name of a file or a folder.

    Attributes
    ----------
    text : the code, "" for none
    origin : the file's name or the folder's
    sure : it has the form of a subject's code, as `sub-03`, `s01` or `P12`; letters and numbers
        before words, as `RBDS001static`, may be something else
    """

    text: str = ""
    origin: Origin = "not known"
    sure: bool = False


def header_name(trial: Trial) -> Known[str]:
    """Who was recorded by the header, or by a prefix of the labels.

    A header that names several, as a person and an object, names nobody.
    """
    for fact, sentence in (("subjects", ""), ("label prefixes", "before the labels")):
        names = [name.strip() for name in trial.facts.get(fact, "").split(",")]
        names = [name for name in names if name and name.lower() not in NO_NAMES]
        if len(names) == 1:
            return Known(value=names[0], origin="file header", sentence=sentence)
    markers = () if trial.markers is None else trial.markers.names
    prefixes = {label.rpartition(":")[0] for label in markers}
    if len(prefixes) == 1 and "" not in prefixes:
        (prefix,) = prefixes
        return Known(value=prefix, origin="file header", sentence="before the labels")
    return Known()


def subject_code(path: Path) -> SubjectCode:
    """Code of a subject in the name of a file or of the folders it is in, the nearest first."""
    for text, origin in _named(path):
        entity = dict(BIDS_ENTITY.findall(text))
        if "sub" in entity:
            return SubjectCode(text=entity["sub"], origin=origin, sure=True)
        code = CODE.match(text)
        if code is not None:
            return SubjectCode(text=code["code"], origin=origin, sure=True)
        leading = LEADING_CODE.match(text)
        if leading is not None and leading["letters"].lower() not in NO_CODES:
            return SubjectCode(text=leading["code"], origin=origin)
    return SubjectCode()


def first_word(path: Path) -> str:
    """First word of a file's name, "" where it is one on a movement or a condition."""
    words = WORDS.findall(path.stem)
    word = words[0].lower() if words else ""
    if word in CONDITION_WORDS or word in NO_NAMES or word in NO_CODES:
        return ""
    moves = any(pattern.fullmatch(word) for _, pattern in MOVEMENT_WORDS)
    return "" if moves else word


def _named(path: Path) -> Iterator[tuple[str, Origin]]:
    """Names of a file and of the two folders that it is in."""
    yield path.stem, "file name"
    for folder in path.resolve().parents[:2]:
        yield folder.name, "folder"


def named_movement(path: Path) -> Known[Movement]:
    """Movement that the name of a file says, else that of its folder."""
    for text, origin in list(_named(path))[:2]:
        words = [word.lower() for word in WORDS.findall(BIDS_ENTITY.sub(_task, text))]
        joined = [*words, *("".join(pair) for pair in itertools.pairwise(words))]
        for movement, pattern in MOVEMENT_WORDS:
            word = next((word for word in joined if pattern.fullmatch(word)), "")
            if word:
                return Known(value=movement, origin=origin, sentence=f"'{word}' in it")
    return Known()


def _task(entity: re.Match[str]) -> str:
    """Of entities of BIDS the task alone: a run there is no running."""
    return f" {entity['value']} " if entity["key"] == "task" else " "


def stated_date(trial: Trial, path: Path) -> Known[date]:
    """Day of the recording, by the header, the scans of BIDS, or dates in names.

    Days and months that may be exchanged are not known.
    """
    for text, origin in (
        (trial.facts.get("date", ""), "file header"),
        (_scan_time(path), "file header"),
        *_named(path),
    ):
        found = _date_in(text)
        if found is not None:
            assert origin in get_args(Origin)
            return Known(value=found, origin=origin)  # type: ignore[arg-type]
    unclear = next((text for text, _ in _named(path) if YEAR_LAST.search(text)), "")
    why = f"day and month of '{unclear}' may be exchanged" if unclear else ""
    return Known(sentence=why)


def _date_in(text: str) -> date | None:
    """Date that a text holds and that can be read in one way only."""
    first = YEAR_FIRST.search(text)
    if first is not None:
        return _day(*map(int, first.groups()))
    last = YEAR_LAST.search(text)
    if last is None:
        return None
    one, other, year = map(int, last.groups())
    year += 0 if year >= 2000 else 2000
    days = {_day(year, one, other), _day(year, other, one)} - {None}
    return days.pop() if len(days) == 1 else None


def _day(year: int, month: int, day: int) -> date | None:
    try:
        return date(year, month, day)
    except ValueError:
        return None


def _scan_time(path: Path) -> str:
    """`acq_time` of a recording in the table of scans of a dataset of BIDS, "" for none."""
    for folder in path.parents[:3]:
        for table in sorted(folder.glob("sub-*_scans.tsv")):
            with table.open(encoding="utf-8", errors="replace", newline="") as stream:
                for row in csv.DictReader(stream, delimiter="\t"):
                    if Path(row.get("filename") or "").name == path.name:
                        return row.get("acq_time") or ""
    return ""
