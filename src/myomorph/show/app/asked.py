"""What the page asks for: recordings, and what was corrected or filled in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from myomorph.core.model.errors import BadData, check_name
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.movement import MOVEMENTS

MIN_HEIGHT = 0.3
MAX_HEIGHT = 2.6
MAX_MASS = 400.0
MAX_AGE = 120.0
"""Beyond these a number is in another unit [m, kg, years]."""


@dataclass(frozen=True, kw_only=True)
class AskedTrial:
    """A recording, and what the page says of it.

    Attributes
    ----------
    path : file
    used : it is computed
    person, movement : "" as found
    plates : its force plates are used
    """

    path: str
    used: bool = True
    person: str = ""
    movement: str = ""
    plates: bool = True


@dataclass(frozen=True, kw_only=True)
class AskedPerson:
    """What the page says of a person, None and "" as found.

    Attributes
    ----------
    mass, height, age : [kg], [m], [years]
    static : file of standing still
    """

    mass: float | None = None
    height: float | None = None
    age: float | None = None
    static: str = ""


@dataclass(frozen=True, kw_only=True)
class Asked:
    """Request of the page.

    Attributes
    ----------
    out : folder of the results
    trials : all that were found
    people : by name
    labels : landmark by label of a marker, in the words of the list
    arms : the model has arms
    model : file of a model, "" for the generic one
    """

    out: Path
    trials: tuple[AskedTrial, ...]
    people: Mapping[str, AskedPerson] = field(default_factory=lambda: FrozenMap({}))
    labels: Mapping[str, str] = field(default_factory=lambda: FrozenMap({}))
    arms: bool = False
    model: str = ""

    @property
    def used(self) -> tuple[AskedTrial, ...]:
        """Recordings that are computed, and those of standing still."""
        static = {person.static for person in self.people.values()}
        return tuple(trial for trial in self.trials if trial.used or trial.path in static)


def read_asked(
    raw: Mapping[str, Any], files: Mapping[int, str], models: Mapping[str, str]
) -> Asked:
    """Check what the page sends.

    Parameters
    ----------
    raw : as sent
    files : recordings that were found, by their numbers on the page
    models : files of models that were found, by name

    Raises
    ------
    BadData : with a sentence on what is wrong
    """
    trials = tuple(_trial(entry, files) for entry in _list(raw, "trials"))
    if not any(trial.used for trial in trials):
        raise BadData("no recording is selected: tick at least one")
    people: dict[str, AskedPerson] = {}
    of_trials = {trial.person for trial in trials}
    for entry in _list(raw, "people"):
        if of_trials != {""} and _text(entry, "name") not in of_trials:
            # Nobody is left of whom this one was.
            continue
        name = _text(entry, "name")
        people[name] = _joined(name, people.get(name), _person(entry, files))
    labels = {str(label): str(place).strip() for label, place in _dict(raw, "labels").items()}
    model = _text(raw, "model")
    if model:
        check_name("model", model, models, "the folder")
    return Asked(
        out=Path(_text(raw, "out")),
        trials=trials,
        people=FrozenMap(people),
        labels=FrozenMap({label: place for label, place in labels.items() if place}),
        arms=bool(raw.get("arms")),
        model=models.get(model, ""),
    )


def _trial(entry: Mapping[str, Any], files: Mapping[int, str]) -> AskedTrial:
    movement = _text(entry, "movement")
    if movement:
        check_name("movement", movement, MOVEMENTS, "")
    return AskedTrial(
        path=_file(entry.get("id"), files),
        used=bool(entry.get("used", True)),
        person=_text(entry, "person"),
        movement=movement,
        plates=bool(entry.get("plates", True)),
    )


def _person(entry: Mapping[str, Any], files: Mapping[int, str]) -> AskedPerson:
    name = _text(entry, "name")
    static = entry.get("static")
    return AskedPerson(
        mass=number(entry.get("mass"), f"body mass of {name}", "kg", (0.0, MAX_MASS)),
        height=number(entry.get("height"), f"height of {name}", "m", (MIN_HEIGHT, MAX_HEIGHT)),
        age=number(entry.get("age"), f"age of {name}", "years", (0.0, MAX_AGE)),
        static="" if static in (None, "") else _file(static, files),
    )


def _joined(name: str, first: AskedPerson | None, second: AskedPerson) -> AskedPerson:
    """Make one person of two that the page calls alike."""
    if first is None:
        return second
    if first.mass is not None and second.mass is not None and first.mass != second.mass:
        raise BadData(f"{name} has two masses, {first.mass:g} and {second.mass:g} kg: give one")
    return AskedPerson(
        mass=second.mass if first.mass is None else first.mass,
        height=second.height if first.height is None else first.height,
        age=second.age if first.age is None else first.age,
        static=first.static or second.static,
    )


def number(
    given: object, what: str, unit: str, within: tuple[float, float] = (0.0, float("inf"))
) -> float | None:
    """Read a number that somebody typed, with a point or a comma; None for nothing.

    Parameters
    ----------
    given : as typed
    what, unit : of the number, for the error
    within : bounds, themselves not allowed

    Raises
    ------
    BadData : it is no number, or out of bounds
    """
    text = "" if given is None else str(given).strip().lower()
    text = text.removesuffix(unit).strip().replace(",", ".")
    if not text:
        return None
    low, high = within
    try:
        value = float(text)
    except ValueError:
        raise BadData(f"{what} '{given}': expected a number of {unit}, as 1.72") from None
    if not low < value < high:
        raise BadData(f"{what} '{given}': expected between {low:g} and {high:g} {unit}")
    return value


def _file(identifier: object, files: Mapping[int, str]) -> str:
    try:
        return files[int(str(identifier))]
    except (ValueError, KeyError):
        raise BadData(f"there is no recording '{identifier}': look at the folder again") from None


def _text(entry: Mapping[str, Any], key: str) -> str:
    return str(entry.get(key) or "").strip()


def _list(raw: Mapping[str, Any], key: str) -> list[Mapping[str, Any]]:
    given = raw.get(key)
    if not isinstance(given, list) or not all(isinstance(entry, dict) for entry in given):
        raise BadData(f"'{key}' is not a list: reload the page")
    return given


def _dict(raw: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    given = raw.get(key, {})
    if not isinstance(given, dict):
        raise BadData(f"'{key}' is not a table: reload the page")
    return given
