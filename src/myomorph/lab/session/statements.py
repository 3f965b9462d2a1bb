"""What a user says of recordings and people, in the place of what was found."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.known import Known
from myomorph.core.model.movement import Movement
from myomorph.lab.session.read import kind_of, mass_of
from myomorph.lab.session.session import Person, Session, SessionTrial


@dataclass(frozen=True, kw_only=True)
class StatedTrial:
    """What a user says of a recording.

    Attributes
    ----------
    person : name of who was recorded, "" as found
    movement : "" as found
    plates : the force plates of the file are used
    """

    person: str = ""
    movement: Movement | Literal[""] = ""
    plates: bool = True


@dataclass(frozen=True, kw_only=True)
class StatedPerson:
    """What a user says of a person, None as found.

    Attributes
    ----------
    mass, height, age : [kg], [m], [years]
    static : recording of standing still
    """

    mass: float | None = None
    height: float | None = None
    age: float | None = None
    static: Path | None = None


@dataclass(frozen=True, kw_only=True)
class Statements:
    """What a user says of a session.

    Attributes
    ----------
    trials : by file
    people : by name, as it is after what is said of trials
    """

    trials: Mapping[Path, StatedTrial] = field(default_factory=lambda: FrozenMap({}))
    people: Mapping[str, StatedPerson] = field(default_factory=lambda: FrozenMap({}))

    def of(self, path: Path) -> StatedTrial:
        """Say what is stated of a recording."""
        return self.trials.get(path, StatedTrial())


def corrected_session(session: Session, statements: Statements) -> Session:
    """Session with what a user says in the place of what was found.

    Parameters
    ----------
    session : as found
    statements : of its trials; what is said of people takes no part
    """
    if not statements.trials:
        return session
    trials = tuple(_corrected(trial, statements.of(trial.path)) for trial in session.trials)
    names = dict.fromkeys(trial.person for trial in trials)
    found = {str(person.name): person for person in session.people}
    people = tuple(
        _person(name, found.get(name), [trial for trial in trials if trial.person == name])
        for name in names
    )
    return replace(session, trials=trials, people=people)


def _corrected(trial: SessionTrial, stated: StatedTrial) -> SessionTrial:
    """Trial with what is stated of it; a movement that is stated contradicts nothing."""
    if stated.person:
        trial = replace(trial, person=stated.person)
    if stated.movement and stated.movement != trial.movement.value:
        movement: Known[Movement] = Known(value=stated.movement, origin="user")
        trial = replace(trial, movement=movement, warnings=())
    return trial


def _person(name: str, found: Person | None, trials: list[SessionTrial]) -> Person:
    """Person of trials, as found where the name is that of a person who was found."""
    if found is not None:
        return replace(found, kind=kind_of(trials), mass=mass_of(trials))
    return Person(name=Known(value=name, origin="user"), kind=kind_of(trials), mass=mass_of(trials))
