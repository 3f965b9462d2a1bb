"""Who was recorded, and which movement: a session on recordings of which both are known.

`movements.csv` names them: those of the data collection, and of public repositories in the folder
that MYOMORPH_LABORATORIES names (see `laboratories.py`). "seen": it was looked at while thresholds
were set; "apart": it was not.
"""

from __future__ import annotations

import csv
import os
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import combinations
from pathlib import Path

from benchmarks.accuracy.laboratory.laboratories import FOLDER
from myomorph.core.model.errors import MyomorphError
from myomorph.core.model.known import Known
from myomorph.lab.session.evidence import Evidence
from myomorph.lab.session.names import SubjectCode
from myomorph.lab.session.people import people_of
from myomorph.lab.session.read import evidence_of, trial_of
from myomorph.lab.session.recordings import look_at

Row = dict[str, object]
TABLE = Path(__file__).with_name("movements.csv")
PERSONS = (
    "c3d-gait-plugingait/HC002D",
    "c3d-gait-plugingait/HC030A",
    "c3d-functional-joints/functional_trials",
    "c3d-opensim-walking",
    "fullbody-many-muscles",
    "hamner-run-subject04",
    "knee-implant-walk",
    "lenhart-knee-contact-walk",
    "lifting-box-15kg",
    "odd-trc-mot/markers",
    "opencap-subject4-multitask",
    "opensim-gait-subject01",
    "rajagopal-walk-emg",
    "paper_data/Expert1",
    "paper_data/Expert2",
    "data/RBDS001",
    "data/RBDS002",
    "data/RBDS010",
    "data/RBDS011",
    "data/RBDS012",
)
"""Beginnings of the files of one person each, of those in the table."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """A recording of the table.

    Attributes
    ----------
    file, repository : where it lies
    movement : which movement it is of, by README, name or folder
    thresholds : "seen" while thresholds were set, or "apart"
    """

    repository: str
    file: str
    movement: str
    thresholds: str

    def path(self, data: Path) -> Path:
        """File; it need not exist."""
        if not self.repository:
            return data / self.file
        home = Path(os.environ.get(FOLDER, ""))
        return home / self.repository.replace("/", "+") / self.file


def cases() -> list[Case]:
    """Those of `movements.csv`."""
    with TABLE.open(encoding="utf-8", newline="") as file:
        return [
            Case(
                repository=row["repository"],
                file=row["file"],
                movement=row["movement"],
                thresholds=row["thresholds"],
            )
            for row in csv.DictReader(file)
        ]


def measure(data: Path) -> Iterator[Row]:
    """Row a recording: the movement that it is of, what its markers show, and by what."""
    for case in cases():
        path = case.path(data)
        if not path.is_file():
            continue
        found = _movement(path)
        yield {
            "recording": f"{case.repository}: {case.file}" if case.repository else case.file,
            "thresholds": case.thresholds,
            "movement": case.movement,
            "found": str(found),
            "right": _verdict(case.movement, found.value),
            "by what": found.sentence,
        }


def measure_movements(data: Path) -> Iterator[Row]:
    """Row a movement: recordings, those found right, and what the others were taken for."""
    rows = list(measure(data))
    for thresholds in ("seen", "apart"):
        for movement in dict.fromkeys(row["movement"] for row in rows):
            own = [
                row
                for row in rows
                if row["movement"] == movement and row["thresholds"] == thresholds
            ]
            if not own:
                continue
            wrong = Counter(str(row["found"]) for row in own if row["right"] == "no")
            yield {
                "movement": movement,
                "thresholds": thresholds,
                "recordings": len(own),
                "right": sum(row["right"] == "yes" for row in own),
                "not known": sum(row["right"] == "not known" for row in own),
                "taken for": ", ".join(f"{count} {name}" for name, count in wrong.items()),
            }


@cache
def _movement(path: Path) -> Known:
    """Movement by markers alone; names are not looked at."""
    try:
        trial = trial_of(look_at(path))
    except MyomorphError as error:
        return Known(sentence=" ".join(str(error).split())[-80:])
    by_name = trial.movement.origin in ("file name", "folder")
    return Known(sentence="markers do not show it") if by_name else trial.movement


def _verdict(truth: str, found: str | None) -> str:
    if found is None:
        return "not known"
    return "yes" if found == truth else "no"


def measure_people(data: Path) -> Iterator[Row]:
    """Count people in folders of one and in folders mixed from two, with and without names."""
    persons = {name: _evidence(name, data) for name in PERSONS}
    persons = {name: own for name, own in persons.items() if own}
    for names in ("with names", "without names"):
        seen = {
            name: own if names == "with names" else list(map(_nameless, own))
            for name, own in persons.items()
        }
        several = {name: own for name, own in seen.items() if len(own) > 1}
        counts = [len(people_of(own)) for own in several.values()]
        yield {
            "folders": "of one person",
            "names": names,
            "cases": len(counts),
            "right": sum(count == 1 for count in counts),
            "taken for one, said so": 0,
            "taken for one": 0,
            "partly mixed": 0,
            "split falsely": sum(count > 1 for count in counts),
        }
        yield {"folders": "mixed from two", "names": names} | _mixed(list(seen.values()))


def _mixed(persons: Sequence[Sequence[Evidence]]) -> Row:
    """Pairs of persons whose recordings lie in one folder."""
    results = Counter[str]()
    for first, second in combinations(persons, 2):
        groups = people_of([*first, *second])
        truth = [set(range(len(first))), set(range(len(first), len(first) + len(second)))]
        found = [set(group.members) for group in groups]
        if len(found) == 1:
            said = any(group.unresolved for group in groups)
            results["taken for one, said so" if said else "taken for one"] += 1
        elif found == truth:
            results["right"] += 1
        elif any(members & truth[0] and members & truth[1] for members in found):
            results["partly mixed"] += 1
        else:
            results["split falsely"] += 1
    columns = ("right", "taken for one, said so", "taken for one", "partly mixed", "split falsely")
    return {"cases": results.total()} | {column: results[column] for column in columns}


def _evidence(person: str, data: Path) -> list[Evidence]:
    """Read what the recordings of a person say of who it is."""
    found = []
    for case in cases():
        path = case.path(data)
        if case.file.startswith(person) and path.is_file():
            recording = look_at(path)
            found.append(evidence_of(recording, trial_of(recording)))
    return found


def _nameless(evidence: Evidence) -> Evidence:
    """Take all names away, and put the recording into one folder."""
    path = Path("folder") / evidence.path.name
    return replace(evidence, header=Known(), code=SubjectCode(), word="", day=None, path=path)
