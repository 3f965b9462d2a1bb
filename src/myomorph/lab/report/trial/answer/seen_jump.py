"""The jump that a recording shows: as plates measured it, else by filtered or estimated forces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.lab.movements import quantities as of
from myomorph.lab.movements.part import UNKNOWN, Part
from myomorph.lab.movements.recorded_movement import support_force
from myomorph.lab.report.trial.prepared import Prepared

HEIGHT = "Jump height from take-off velocity"
LANDING = "Peak force of landing"
STANDING = "Body weight on the plates"
FLIGHT = "Flight time"


@read_only
@dataclass(frozen=True, kw_only=True, eq=False)
class SeenJump:
    """A jump in numbers; what is not known is NaN.

    Attributes
    ----------
    height : [m]
    by_impulse : whether that follows from the impulse on the plates, and not from the flight time
    landing : largest force [body weights]
    right : share of the right leg in landing [%]
    contact : on the ground before, of a drop jump [s]
    index : reactive strength of a drop jump [m/s]
    onset, off, land : when it begins, leaves the ground and meets it again [s]
    time, force : (samples,) [s], vertical force [body weights]
    count : how many jumps were seen, of which this is the highest
    """

    height: float
    by_impulse: bool
    landing: float
    right: float
    contact: float
    index: float
    onset: float
    off: float
    land: float
    time: Array
    force: Array
    count: int

    @property
    def drops(self) -> bool:
        """Whether it follows a fall."""
        return bool(np.isfinite(self.contact))


def seen_jump(prepared: Prepared) -> SeenJump | None:
    """Return the highest jump, None where forces show none."""
    recorded = prepared.recorded_movement
    numbers = prepared.movement_numbers
    force = None if recorded is None else support_force(recorded)
    if recorded is None or recorded.movement != "jumping" or numbers is None or force is None:
        return _filtered_jump(prepared)
    part = max(numbers.parts, key=_height)
    flight = next(phase for phase in part.phases if phase.name == "flight")
    return SeenJump(
        height=_height(part),
        by_impulse=bool(np.isfinite(part.number(of.HEIGHT_BY_IMPULSE))),
        landing=part.number(of.LANDING_FORCE),
        right=part.number(of.LANDING_SHARE),
        contact=part.number(of.CONTACT_TIME),
        index=part.number(of.REACTIVE_STRENGTH),
        onset=part.start,
        off=flight.start,
        land=flight.stop,
        time=force.time,
        force=force.total / force.weight,
        count=len(numbers.parts),
    )


def _height(part: Part) -> float:
    """By impulse, else by flight time [m]."""
    by_impulse = part.number(of.HEIGHT_BY_IMPULSE)
    return by_impulse if np.isfinite(by_impulse) else part.number(of.HEIGHT_BY_FLIGHT)


def _filtered_jump(prepared: Prepared) -> SeenJump | None:
    """Return the jump that filtered or estimated forces show, as older results have them alone."""
    measures = {measure.name: measure.value for measure in prepared.ground.measures}
    times = {event.label: event.time for event in prepared.ground.events}
    if HEIGHT not in measures or not {"Take-off", "Landing"} <= set(times):
        return None
    wrenches = prepared.results.dynamics.wrenches
    weight = measures[STANDING]
    nothing = np.zeros(0)
    return SeenJump(
        height=measures[HEIGHT],
        by_impulse=True,
        landing=measures[LANDING] / weight,
        right=UNKNOWN,
        contact=UNKNOWN,
        index=UNKNOWN,
        onset=times.get("Onset", UNKNOWN),
        off=times["Take-off"],
        land=times["Landing"],
        time=nothing if wrenches is None else wrenches.time,
        force=nothing
        if wrenches is None
        else np.nan_to_num(wrenches.forces @ prepared.up).sum(axis=1) / weight,
        count=1,
    )
