"""Strides of bodies that turn, stop, or stay in place, by markers, plates, events and sensors."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import myomorph as mm
from myomorph.core.io.c3d.read import read_c3d
from myomorph.core.model.arrays import Array
from myomorph.core.model.series import Event, Series
from myomorph.lab.analysis.phases import ground_phases
from myomorph.lab.analysis.strides import Strides
from truths.made_gaits import PLANS, SIDES, WEIGHT, MadeGait, made_gait

SEEDS = (11, 12, 13, 14, 15)
UP = np.array([0.0, 0.0, 1.0])
NEAR = 0.15  # An event this near to a true one is that one [s]
TURNS: Mapping[str, str] = {
    "recorded turn, an adult": "HC002D/Turn/HC002D25.c3d",
    "recorded turn, a child": "HC030A/Turn/HC030A22.c3d",
}
LIMBS = tuple(
    mm.Limb(f"foot_{side[0]}", (f"heel_{side[0]}",), (f"toe_{side[0]}",), (f"foot_{side[0]}",))
    for side in SIDES
)

Row = dict[str, object]


@dataclass(frozen=True, kw_only=True)
class Truth:
    """True events [s] and strides of a gait.

    Attributes
    ----------
    strikes, lifts : of both sides (events,) [s]
    durations : of strides straight on, by side [s]
    speed : of these [m/s], NaN where it is not known
    """

    strikes: Mapping[str, Array]
    lifts: Mapping[str, Array]
    durations: Mapping[str, Array]
    speed: float

    @classmethod
    def of(cls, gait: MadeGait) -> Truth:
        """Return what is true of a made gait."""
        straight = {side: [one for one in gait.strides[side] if one.is_straight] for side in SIDES}
        every = [one for own in straight.values() for one in own]
        return cls(
            strikes=gait.strikes,
            lifts=gait.lifts,
            durations={
                side: np.array([one.stop - one.start for one in own])
                for side, own in straight.items()
            },
            speed=float(np.mean([one.length / (one.stop - one.start) for one in every])),
        )


def measure(folder: Path) -> Iterator[Row]:
    """Give a row for each gait and source of its strides, and one for each recorded turn."""
    for name, plan in PLANS.items():
        gaits = [made_gait(plan, seed) for seed in SEEDS]
        for source in ("markers", "plates", "events", "sensors"):
            rows = [_compared(_found(gait, source), Truth.of(gait)) for gait in gaits]
            yield {"gait": name, "strides by": source} | _mean(rows)
        yield {"gait": name, "strides by": "plates alone"} | _mean(
            [_of_phases(gait) for gait in gaits]
        )
    for name, file in TURNS.items():
        yield {"gait": name, "strides by": "markers"} | _recorded(
            folder / "c3d-gait-plugingait" / file
        )


def _mean(rows: list[Row]) -> Row:
    """Mean of each column over seeds."""
    values = np.array([list(row.values()) for row in rows], np.float64)
    return dict(zip(rows[0], values.mean(axis=0).tolist(), strict=True))


def _found(gait: MadeGait, source: str) -> Strides:
    """Find strides of a gait by one of the sources."""
    if source == "plates":
        return mm.find_strides(
            gait.points, LIMBS, ["trunk"], UP, wrenches=gait.plates(), weight=WEIGHT
        )
    if source == "events":
        return mm.find_strides(gait.points, LIMBS, ["trunk"], UP, events=gait.events)
    if source == "sensors":
        return mm.find_strides(gait.in_place, LIMBS, ["trunk"], UP, facing=gait.facing)
    return mm.find_strides(gait.points, LIMBS, ["trunk"], UP)


def _compared(found: Strides, truth: Truth) -> Row:
    """Compare strides with what is true."""
    exchanged = 0
    late: list[float] = []
    for side in SIDES:
        for time in found.strikes[f"foot_{side[0]}"]:
            strikes = truth.strikes[side]
            nearest = strikes[int(np.argmin(np.abs(strikes - time)))]
            lifted = float(np.abs(truth.lifts[side] - time).min())
            if lifted < abs(nearest - time):
                exchanged += 1
            elif abs(nearest - time) < NEAR:
                late.append(float(time - nearest))
    row: Row = {
        "true strides": sum(len(own) for own in truth.durations.values()),
        "strides": len(found.strides),
        "strikes that are lifts": exchanged,
        "strikes late, median [ms]": 1e3 * float(np.median(late)) if late else np.nan,
        "true speed [m/s]": truth.speed,
        "speed [m/s]": float(np.mean([one.speed for one in found.strides] or [np.nan])),
    }
    for side in SIDES:
        durations = [one.duration for one in found.of(f"foot_{side[0]}")]
        row |= _cadences(side, truth.durations[side], np.array(durations))
    return row


def _cadences(side: str, true: Array, found: Array) -> Row:
    """Cadences of strides (strides,) [s]."""
    return {
        f"true cadence, {side}": _cadence(true),
        f"cadence, {side}": _cadence(found),
    }


def _cadence(durations: Array) -> float:
    """Mean cadence [steps/min] of strides (strides,) [s], NaN for none."""
    return float(np.mean(120.0 / durations)) if len(durations) else float("nan")


def _of_phases(gait: MadeGait) -> Row:
    """Compare what forces alone show."""
    measures = {one.name: one.value for one in ground_phases(gait.plates(), UP, WEIGHT).measures}
    truth = Truth.of(gait)
    row: Row = {}
    for side in SIDES:
        lasting = measures.get(f"{side.capitalize()} stride time", np.nan)
        row |= _cadences(side, truth.durations[side], np.array([lasting]))
    return row


def _recorded(file: Path) -> Row:
    """Compare strides of a recorded turn with the events of its laboratory."""
    trial = read_c3d(file)
    assert trial.markers is not None
    names = ("RHEE", "RTOE", "LHEE", "LTOE", "SACR")
    points = Series(
        trial.markers.time,
        ("heel_r", "toe_r", "heel_l", "toe_l", "trunk"),
        np.stack([trial.markers[name] for name in names], axis=1),
    )
    span = float(points.time[0]), float(points.time[-1])
    strikes = {side: _times(trial.events, "Foot Strike", side, span) for side in SIDES}
    truth = Truth(
        strikes=strikes,
        lifts={side: _times(trial.events, "Foot Off", side, span) for side in SIDES},
        durations={side: np.diff(times) for side, times in strikes.items()},
        speed=float("nan"),
    )
    row = _compared(mm.find_strides(points, LIMBS, ["trunk"], UP), truth)
    # Events of a laboratory do not say in which strides somebody turns.
    return row | {"true strides": np.nan}


def _times(events: tuple[Event, ...], label: str, side: str, span: tuple[float, float]) -> Array:
    """Select times (events,) [s] of one kind within a span."""
    return np.array(
        [
            event.time
            for event in events
            if event.label == label
            and event.side.lower() == side
            and span[0] <= event.time <= span[1]
        ]
    )
