"""The session of a folder as text: people, and a table of its trials."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from myomorph.core.model.errors import counted
from myomorph.core.model.known import Known
from myomorph.core.model.messages import Message, located
from myomorph.lab.info.inspect_recording import Inspection
from myomorph.lab.session.session import Person, Session, SessionTrial

HEAD = ("trial", "person", "movement", "length", "rate", "markers", "plates", "EMG", "sensors")


def inspect_session(session: Session, reasons: bool = False) -> Inspection:
    """People, date and trials of a session.

    Parameters
    ----------
    session : of a folder
    reasons : print how each statement is known
    """
    facts = [("person" if len(session.people) == 1 else "people", _people(session))]
    facts += [("date", _said(session.date, reasons))]
    facts += [("axes", _shared([trial.up for trial in session.trials], reasons))]
    facts += [("length unit", _shared([trial.unit for trial in session.trials], reasons))]
    if reasons:
        facts += [fact for person in session.people for fact in _reasons_of_person(person)]
    rows = [HEAD, *(_row(trial) for trial in session.trials)]
    facts += [("", line) for line in _table(rows)]
    if reasons:
        facts += [(trial.name, trial.movement.explained) for trial in session.trials]
        facts += [(f"{trial.name} shows", ", ".join(trial.segments)) for trial in session.trials]
    return Inspection("session", tuple(facts), (*_warnings(session), *session.passed_over))


def _warnings(session: Session) -> list[Message]:
    """List what cannot be told of people, and what contradicts in trials."""
    unresolved = [text for person in session.people for text in person.unresolved]
    contradicts = [text for trial in session.trials for text in located(trial.name, trial.warnings)]
    return [*unresolved, *contradicts]


def _people(session: Session) -> str:
    """Names, kinds and weights, one after the other."""
    return "; ".join(_person(person, session) for person in session.people)


def _person(person: Person, session: Session) -> str:
    trials = counted(len(session.of(str(person.name))), "trial")
    parts = [str(person.name) if person.name.origin != "not known" else "name not known"]
    parts += [person.kind.value] if person.kind.value == "animal" else []
    parts += [f"{person.mass.value:g} kg"] if person.mass.value is not None else []
    return f"{', '.join(parts)} ({trials})"


def _reasons_of_person(person: Person) -> list[tuple[str, str]]:
    facts = [
        (f"name of {person.name}", person.name.explained),
        (f"kind of {person.name}", person.kind.explained),
        (f"mass of {person.name}", person.mass.explained),
    ]
    return facts + ([(f"{person.name} apart by", person.why)] if person.why else [])


def _said(known: Known, reasons: bool) -> str:
    return known.explained if reasons or not known else str(known)


def _shared(said: Sequence[Known[str]], reasons: bool) -> str:
    """Join what all trials say, each different statement once."""
    texts = dict.fromkeys(_said(known, reasons) for known in said if known)
    return ", ".join(texts) or "not known"


def _row(trial: SessionTrial) -> tuple[str, ...]:
    """Cells of a trial."""
    clock = trial.clock
    duration = "" if clock is None else f"{clock.duration:.2f} s"
    rate = "" if clock is None or not np.isfinite(clock.rate) else f"{clock.rate:.0f} Hz"
    plates = "table" if trial.plates.sentence else _count(trial.plates.value or 0)
    by_name = trial.movement.origin in ("file name", "folder")
    return (
        trial.name,
        trial.person,
        f"{trial.movement} (by name)" if by_name else str(trial.movement),
        duration,
        rate,
        _count(trial.markers),
        plates,
        _count(len(trial.emg)),
        _count(trial.sensors),
    )


def _count(number: int) -> str:
    return str(number) if number else "-"


def _table(rows: Sequence[tuple[str, ...]]) -> list[str]:
    """Lines of a table, without columns in which no trial has anything."""
    columns = [cells for cells in zip(*rows, strict=True) if any(cell != "-" for cell in cells[1:])]
    widths = [max(map(len, cells)) for cells in columns]
    return [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in zip(*columns, strict=True)
    ]
