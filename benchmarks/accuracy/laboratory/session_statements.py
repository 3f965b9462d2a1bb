"""How often a session is right on person, movement, sides and static trial, over all recordings.

`known_recordings.csv` has who is in each recording of the data collection, in which folder, which
sides of the body markers are on, and whether it is a static trial, by READMEs, names and labels;
"" where nothing says it. Movements are those of `movements.csv`.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from benchmarks.accuracy.laboratory.sessions import cases
from myomorph.core.model.errors import MyomorphError
from myomorph.lab.session.evidence import Evidence
from myomorph.lab.session.people import people_of
from myomorph.lab.session.read import evidence_of, trial_of
from myomorph.lab.session.recordings import Recording, look_at
from myomorph.lab.session.session import SessionTrial

Row = dict[str, object]
TABLE = Path(__file__).with_name("known_recordings.csv")
STATEMENTS = ("person", "movement", "sides", "static trial")


@dataclass(frozen=True, kw_only=True)
class KnownRecording:
    """A recording of the data collection, and what is known of it.

    Attributes
    ----------
    file, folder : its path, and the folder that is read as one session
    person : who it is of, within the folder
    sides : "both", "right" or "left", sides of the body that markers are on
    static : "yes" for a static trial, else "no"
    """

    file: str
    folder: str
    person: str
    sides: str
    static: str


@dataclass(frozen=True, eq=False)
class Seen:
    """What a session states of a recording.

    Attributes
    ----------
    known : what is known of it
    recording, trial, evidence : as the session reads it
    """

    known: KnownRecording
    recording: Recording
    trial: SessionTrial
    evidence: Evidence


def known_recordings() -> list[KnownRecording]:
    """Those of `known_recordings.csv`."""
    with TABLE.open(encoding="utf-8", newline="") as file:
        return [
            KnownRecording(
                file=row["file"],
                folder=row["folder"],
                person=row["person"],
                sides=row["sides"],
                static=row["static"],
            )
            for row in csv.DictReader(file)
        ]


def measure(data: Path) -> Iterator[Row]:
    """Row a statement: recordings of which it is known, those found right, and all others."""
    verdicts = [_verdicts(seen, _seen(data)) for seen in _seen(data)]
    for statement in STATEMENTS:
        own = [verdict[statement] for verdict in verdicts if verdict[statement]]
        names = [
            seen.known.file.rpartition("/")[2]
            for seen, verdict in zip(_seen(data), verdicts, strict=True)
            if verdict[statement] == "wrong"
        ]
        yield {
            "statement": statement,
            "recordings": len(own),
            "right": own.count("right"),
            "said not to be known": own.count("not known"),
            "wrong": own.count("wrong"),
            "wrong ones": ", ".join(names),
        }


@cache
def _seen(data: Path) -> tuple[Seen, ...]:
    """Read the recordings of the table that can be read."""
    seen = []
    for known in known_recordings():
        try:
            recording = look_at(data / known.file)
        except MyomorphError:
            continue
        trial = trial_of(recording)
        evidence = evidence_of(recording, trial)
        seen.append(Seen(known=known, recording=recording, trial=trial, evidence=evidence))
    return tuple(seen)


def _verdicts(seen: Seen, every: Sequence[Seen]) -> dict[str, str]:
    """Right, wrong, not known, or "" where the truth is not known, by statement."""
    movements = {case.file: case.movement for case in cases() if not case.repository}
    movement = movements.get(seen.known.file, "")
    sides = "both" if len(_sides(seen)) == 2 else "".join(_sides(seen))
    static = "yes" if seen.trial.still else "no"
    return {
        "person": _of_person(seen, every),
        "movement": _verdict(movement, str(seen.trial.movement.value or "")),
        "sides": _verdict(seen.known.sides, sides),
        "static trial": _verdict(seen.known.static, static),
    }


def _verdict(truth: str, found: str) -> str:
    if not truth:
        return ""
    if not found:
        return "not known"
    return "right" if truth == found else "wrong"


def _sides(seen: Seen) -> set[str]:
    """Sides of the segments that are seen."""
    return {name.split()[0] for name in seen.trial.segments} & {"right", "left"}


def _of_person(seen: Seen, every: Sequence[Seen]) -> str:
    """Whether a recording is put together with those of the same person, and no others.

    "Not known" where it is not, and the session says so.
    """
    if not seen.known.person:
        return ""
    folder = [one for one in every if one.known.folder == seen.known.folder and one.known.person]
    groups = people_of([one.evidence for one in folder])
    number = folder.index(seen)
    group = next(group for group in groups if number in group.members)
    found = {folder[member].known.file for member in group.members}
    truth = {one.known.file for one in folder if one.known.person == seen.known.person}
    if found == truth:
        return "right"
    return "not known" if group.unresolved else "wrong"
