"""The session of a folder of recordings: who was recorded, when, and in which movements."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Literal

from myomorph.core.model.known import Known
from myomorph.core.model.messages import Message
from myomorph.core.model.movement import Movement
from myomorph.lab.session.body_measures import BodyMeasures

Kind = Literal["person", "animal"]


@dataclass(frozen=True, kw_only=True)
class RecordedClock:
    """Frames of one kind in a recording.

    Attributes
    ----------
    count : of frames or samples
    rate : frames per second, nan with fewer than two [Hz]
    start, stop : first and last time [s]
    """

    count: int
    rate: float
    start: float
    stop: float

    @property
    def duration(self) -> float:
        """From the first to the last frame [s]."""
        return self.stop - self.start


@dataclass(frozen=True, kw_only=True, eq=False)
class SessionTrial:
    """One recording of a session.

    Attributes
    ----------
    name, path : of the recording
    person : name of who was recorded
    movement : which movement it is of
    date : day of the recording
    still : nobody moves in it, so that it may be the static trial
    markers : how many are ever seen
    segments : visible segments with their sides, "right thigh", from the head down
    clock, device_clock : of markers or sensors, and of plates and analog channels, None for none
    plates : force plates that are described, or a file of forces beside the recording
    sensors : inertial sensors
    emg : channels of muscles
    up : axis of the laboratory that points up, as "z up"
    unit : of length in the file
    measures : of the body
    warnings : what contradicts, one line each
    """

    name: str
    path: Path
    person: str
    movement: Known[Movement]
    date: Known[date]
    still: bool
    markers: int
    segments: tuple[str, ...]
    clock: RecordedClock | None
    device_clock: RecordedClock | None
    plates: Known[int]
    sensors: int
    emg: tuple[str, ...]
    up: Known[str]
    unit: Known[str]
    measures: BodyMeasures
    warnings: tuple[Message, ...] = ()

    def __repr__(self) -> str:
        return f"SessionTrial({self.name!r}, {self.movement}, {self.person})"


@dataclass(frozen=True, kw_only=True, eq=False)
class Person:
    """Somebody, or an animal, of whom there are recordings.

    Attributes
    ----------
    name : with how it is known; the value is always there, "subject" where nothing says one
    kind : a person or an animal
    mass : by plates [kg]
    why : what tells this person from the others
    unresolved : what cannot be told of who it is, one sentence each
    """

    name: Known[str]
    kind: Known[Kind]
    mass: Known[float]
    why: str = ""
    unresolved: tuple[Message, ...] = ()

    def __repr__(self) -> str:
        return f"Person({self.name})"


@dataclass(frozen=True, kw_only=True, eq=False)
class Session:
    """Who was recorded, when, and which movement each recording is of.

    Attributes
    ----------
    source : files or folders that it was found in, in words
    people : persons and animals, in the order in which they come
    trials : recordings, in the order of their files
    passed_over : files that are no recordings, and recordings that cannot be read, one line each

    Examples
    --------
    >>> import myomorph as mm
    >>> squat = mm.demo_recording()
    >>> mm.write_trc(squat.markers, "squat.trc")
    >>> [str(person.name) for person in mm.session.read_session("squat.trc").people]
    ['subject']
    """

    source: str
    people: tuple[Person, ...]
    trials: tuple[SessionTrial, ...]
    passed_over: tuple[Message, ...] = ()

    def of(self, person: str) -> tuple[SessionTrial, ...]:
        """Trials of a person, by name."""
        return tuple(trial for trial in self.trials if trial.person == person)

    def trial(self, path: Path) -> SessionTrial | None:
        """Trial of a file, None where it is none of the session."""
        return next((trial for trial in self.trials if trial.path == path), None)

    @property
    def date(self) -> Known[date]:
        """The day of all trials; not known where none says one, or they differ."""
        dates = {trial.date.value for trial in self.trials if trial.date}
        if len(dates) > 1:
            days = ", ".join(sorted(str(day) for day in dates))
            return Known(sentence=f"several: {days}")
        said = next((trial.date for trial in self.trials if trial.date), None)
        why = next((trial.date.sentence for trial in self.trials if trial.date.sentence), "")
        return Known(sentence=why) if said is None else said

    def __repr__(self) -> str:
        counts = Counter(str(trial.movement) for trial in self.trials)
        movements = ", ".join(f"{count} {name}" for name, count in counts.items())
        people = ", ".join(str(person.name) for person in self.people)
        return f"Session({people}: {len(self.trials)} trials, {movements})"
