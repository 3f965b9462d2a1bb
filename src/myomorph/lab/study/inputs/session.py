"""Which movement a trial is of, and the day of its recording."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import date, datetime
from typing import Annotated, Any, ClassVar, Literal

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.known import Known
from myomorph.core.model.movement import MOVEMENTS, Movement
from myomorph.core.motion.protocols import recognize
from myomorph.lab.analysis.arm_labels import is_arm
from myomorph.lab.analysis.found_movement import found_movement
from myomorph.lab.analysis.seen_body import SeenBody
from myomorph.lab.analysis.seen_contacts import contacts_of_events
from myomorph.lab.study.inputs.input import Input, Opened, Opening, Recorded
from myomorph.lab.study.inputs.keys import KeyKind, Place
from myomorph.lab.study.inputs.markers import Recording

NOT_KNOWN = "not known"


@dataclass(frozen=True)
class Day(KeyKind):
    """A day, as `str` of the form 2026-03-05."""

    table: ClassVar[Any] = date | str

    def located(self, key: str, given: Any, place: Place) -> str:
        """Day; one of another form is a problem of the place."""
        day = given.date() if isinstance(given, datetime) else given
        try:
            return date.fromisoformat(str(day)).isoformat() if str(day) else ""
        except ValueError:
            place.problem(key, f"'{given}' is not a date: expected year-month-day, as 2026-03-05")
            return ""


@dataclass(frozen=True)
class TrialSession:
    """Which movement a trial is of, and when it was recorded.

    Attributes
    ----------
    movement : standing, walking, running, jumping, squatting, rising (from a seat), stairs, upper
        limb or other; by default as the markers show
    date : day of the recording, as 2026-03-05
    """

    movement: Annotated[Literal[Movement, "", "not known"], KeyKind()] = ""
    date: Annotated[str, Day()] = ""


@dataclass(frozen=True, kw_only=True)
class RecordedSession(Recorded):
    """The movement of a trial with how it is known, and its day.

    Attributes
    ----------
    movement : of the trial
    date : as 2026-03-05, "" where it is not known
    """

    movement: Known[Movement]
    date: str = ""

    @property
    def facts(self) -> Mapping[str, str]:
        """Movement, how it is known, and the day."""
        return FrozenMap(
            {
                "movement": self.movement.value or "",
                "movement_origin": self.movement.origin,
                "movement_sentence": self.movement.sentence,
                "date": self.date,
            }
        )


def recorded_movement(facts: Mapping[str, str]) -> Known[Movement]:
    """Movement that facts of a result file hold; not known in those of older versions."""
    movement = next((name for name in MOVEMENTS if name == facts.get("movement", "")), None)
    if movement is None:
        return Known(sentence=facts.get("movement_sentence", ""))
    origin: Any = facts.get("movement_origin", "user")
    return Known(value=movement, origin=origin, sentence=facts.get("movement_sentence", ""))


def _open(settings: TrialSession, opening: Opening) -> Opened:
    """Movement as stated, else as the markers show; where both say the same, these are why."""
    movement = _found(opening)
    stated = next((name for name in MOVEMENTS if name == settings.movement), None)
    if stated is not None and stated != movement.value:
        movement = Known(value=stated, origin="user")
    if settings.movement == NOT_KNOWN:
        movement = Known(origin="user")
    return Opened((RecordedSession(movement=movement, date=settings.date),))


def _found(opening: Opening) -> Known[Movement]:
    """Movement that markers and events of a recording show; not known without markers."""
    trial = opening.values.or_default(Recording).trial
    markers = trial.markers
    if markers is None or not len(markers):
        return Known()
    recognized = recognize(markers.names)
    body = SeenBody.of(markers, recognized.sites, _up_to_y(opening.model.up))
    return found_movement(body, is_arm(recognized), contacts_of_events(trial.events))


def _up_to_y(up: Array) -> Array:
    """(3, 3) rotation by which the axis nearest to a vector becomes y."""
    axis = int(np.argmax(np.abs(up)))
    vertical = np.sign(up[axis]) * np.eye(3)[axis]
    forward = np.eye(3)[(axis + 1) % 3]
    return np.stack([forward, vertical, np.cross(forward, vertical)])


INPUT = Input(name="session", settings=TrialSession, open=_open)
