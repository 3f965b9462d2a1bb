"""Forces of hands and seat that nobody measured, beside what was: a box, a push rim, a chair."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.errors import rms
from benchmarks.hands_lift import LIFTS, hands_measured, lifter, recorded
from benchmarks.hands_lift_forces import WAYS, found, holding, left_floor, left_open
from benchmarks.hands_lift_forces import task as lift_task
from benchmarks.hands_seat import chair, leavings, solved
from benchmarks.hands_seat import task as seat_task
from benchmarks.hands_spine import (
    carried_moment,
    of_laboratory,
    point_of_laboratory,
    regressed_point,
    spine,
)
from benchmarks.hands_wheel import at_each_time, directions, hands_off, of_each_cycle, wheels
from myomorph.core.model.arrays import Array
from myomorph.core.tension.tension import Tension

Row = dict[str, object]
LIFTING = 0.3
"""Time after the box left the floor that is called the lift-off [s]."""

EVERY = 4
SEATED = 20
"""Of the frames with hands at the box, and of those on the seat, each that far is asked what it
leaves open.
"""


def measure_lift(folder: Path) -> Iterator[Row]:
    """Compare the hands' force on the box with the measured one, by phase."""
    for lift in LIFTS:
        truth = hands_measured(folder, lift)
        during = _phases(folder, lift)
        free = during["lift-off"] | during["carried"]
        for way, words in WAYS.items():
            one = found(folder, lift, way)
            error = one.hands - truth
            yield {
                "lift": lift,
                "known": words,
                **{f"up, {phase} [N]": rms(error[then, 1]) for phase, then in during.items()},
                "forward, off the floor [N]": rms(error[free, 0]),
                "sideways [N]": rms(error[free, 2]),
                "mean up, off the floor [N]": float(one.hands[free, 1].mean()),
                "measured [N]": float(truth[free, 1].mean()),
                "feet, up [N]": rms((one.feet - recorded(folder, lift).plate)[:, 1]),
            }


def measure_lift_open(folder: Path) -> Iterator[Row]:
    """Measure what the data leave undetermined of the hands' force on the box."""
    for lift in LIFTS:
        truth = hands_measured(folder, lift)[:, 1]
        during = _phases(folder, lift)
        held = np.flatnonzero(~during["before holding"])[::EVERY].tolist()
        for way in ("body", "box", "hidden"):
            intervals = left_open(lift_task(folder, lift, way), held)
            # The sites are on the hands; the box is pushed the other way.
            _ = -intervals.forces[:, 0, 1]
            greatest = -intervals.low[:, 0, 1]
            least = -intervals.high[:, 0, 1]
            near = intervals.near_high[:, 0, 1] - intervals.near_low[:, 0, 1]
            inside = (truth[held] >= least) & (truth[held] <= greatest)
            row: Row = {"lift": lift, "known": WAYS[way]}
            for phase in ("held on the floor", "carried"):
                some = during[phase][held]
                row |= {
                    f"{phase}: minimum, mean [N]": float(least[some].mean()),
                    f"{phase}: maximum, mean [N]": float(greatest[some].mean()),
                    f"{phase}: near the optimum, width [N]": float(near[some].mean()),
                }
            yield row | {"measured inside": f"{100.0 * inside.mean():.0f} %"}


def _phases(folder: Path, lift: str) -> dict[str, NDArray[np.bool_]]:
    """Frames by what is going on."""
    time = recorded(folder, lift).markers.time
    off = left_floor(folder, lift)
    grasp = time[np.flatnonzero(holding(folder, lift)[1].any(axis=1))[0]]
    return {
        "before holding": time < grasp,
        "held on the floor": (time >= grasp) & (time < off),
        "lift-off": (time >= off) & (time < off + LIFTING),
        "carried": time >= off + LIFTING,
    }


def measure_spine(folder: Path) -> Iterator[Row]:
    """Compare the moment at L5/S1 with the laboratory's.

    Ours is computed from below and, by the estimated hands' forces, from above.
    """
    for lift in LIFTS:
        time = recorded(folder, lift).markers.time
        below, above = of_laboratory(recorded(folder, lift))
        passing = spine(folder, lift)
        off = time >= left_floor(folder, lift)
        joint = next(
            one for one in lifter(folder).model.joints if one.child == "torso"
        ).parent_frame.translation
        whole = np.ones(len(time), np.bool_)
        ours = {"ours from below": (passing.from_below, whole)}
        ours["ours from below, at the model's lumbar joint"] = (
            spine(folder, lift, joint).from_below,
            whole,
        )
        for way in ("body", "box", "hidden"):
            moment = passing.from_above + carried_moment(passing, found(folder, lift, way))
            ours[f"ours from above, hands by {WAYS[way]}"] = (moment, whole)
        ours["the laboratory's from above, box off the floor"] = (above, off)
        for words, (moment, during) in ours.items():
            error = (moment - below)[during]
            yield {
                "lift": lift,
                "moment": words,
                "bending, RMS [N m]": rms(error[:, 2]),
                "mean error": float(error[:, 2].mean()),
                "peak": float(np.abs(moment[during, 2]).max()),
                "laboratory's peak": float(np.abs(below[during, 2]).max()),
                "correlation": float(np.corrcoef(moment[during, 2], below[during, 2])[0, 1]),
                "sideways, RMS": rms(error[:, 0]),
                "twisting, RMS": rms(error[:, 1]),
            }


def measure_spine_point(folder: Path) -> Iterator[Row]:
    """Where the laboratory takes its moment: the point of our pelvis that explains it best."""
    model = lifter(folder).model
    joint = next(one for one in model.joints if one.child == "torso").parent_frame.translation
    regressed = regressed_point(model)
    for lift in LIFTS:
        best, left = point_of_laboratory(folder, lift)
        yield {
            "lift": lift,
            "best point: forward, up, right [mm]": _millimetres(best),
            "left, sideways, twisting, bending [N m]": ", ".join(
                f"{rms(one):.1f}" for one in left.T
            ),
            "regressed L5/S1 [mm]": _millimetres(regressed),
            "distance [mm]": 1e3 * float(np.linalg.norm(best - regressed)),
            "model's lumbar joint [mm]": _millimetres(joint),
        }


def measure_rim(folder: Path) -> Iterator[Row]:
    """Estimate the hand's moment about the axle from the wheel's angle alone.

    Cycles are fitted and tested in turn.
    """
    for wheel in wheels(folder):
        for words, told in (
            ("every frame", at_each_time(wheel)),
            ("mean of each cycle", of_each_cycle(wheel)),
        ):
            yield {
                "recording": wheel.name,
                "moment of": words,
                "pushes": len(wheel.pushes),
                "inertia [kg m^2]": told.inertia,
                "resistance [N m]": told.resistance,
                "RMS error [N m]": told.rms,
                "spread of the measured [N m]": float(told.measured.std()),
                "mean measured [N m]": float(told.measured.mean()),
                "correlation": told.correlation,
                "RMS predicted with hands off [N m]": hands_off(wheel, told)
                if words == "every frame"
                else "",
            }


def measure_rim_directions(folder: Path) -> Iterator[Row]:
    """How much of the rim's force a wheel could tell at best."""
    for wheel in wheels(folder):
        mean = directions(wheel)
        yield {
            "recording": wheel.name,
            **{f"{words} [N]": value for words, value in mean.items() if words != "share"},
            "determined at best": mean["share"],
        }


def measure_seat(folder: Path) -> Iterator[Row]:
    """Measure the seat's force while sitting and standing.

    It is computed by Newton's law, and estimated with the feet's forces known or hidden.
    """
    one = chair(folder)
    ways: dict[str, tuple[Array, Tension | None]] = {"Newton's law alone": (one.newton, None)}
    known = {"feet known": (True, False), "feet hidden": (False, False)}
    known["feet hidden; contacts first, muscles after"] = (False, True)
    for words, (plates, first) in known.items():
        tension = solved(folder, plates, first)
        assert tension.contacts is not None
        ways[words] = tension.contacts.contact_force[:, 0], tension
    place = np.column_stack([one.moment[:, 2], -one.moment[:, 0]]) / one.newton[:, 1:2]
    sitting = one.ready[:, 0] > 0.5
    for phase, during in {"sitting": sitting, "standing": one.ready[:, 0] == 0.0}.items():
        for words, (force, solution) in ways.items():
            error = (force - (one.newton if during is sitting else 0.0))[during]
            yield {
                "phase": phase,
                "seat by": words,
                "up, mean [N]": float(force[during, 1].mean()),
                "up, RMS error [N]": rms(error[:, 1]),
                "forward, mean [N]": float(force[during, 0].mean()),
                "forward, RMS error [N]": rms(error[:, 0]),
                "feet up by plates, mean [N]": float(
                    one.feet.forces[during, :, 1].sum(axis=1).mean()
                ),
                "weight [N]": one.weight,
                "residual forces, RMS [N]": rms(_residuals(solution)[during]) if solution else "",
                "off the middle, to the right [mm]": _millimetre(place[during, 1])
                if during is sitting
                else "",
            }


def measure_seat_open(folder: Path) -> Iterator[Row]:
    """Measure what the data leave undetermined of the seat's force while sitting."""
    one = chair(folder)
    frames = np.flatnonzero(one.ready[:, 0] > 0.5)[::SEATED].tolist()
    truth = one.newton[frames]
    for words, plates in (("feet known", True), ("feet hidden", False)):
        intervals = left_open(seat_task(folder, plates), frames)
        seat = intervals.groups.index("seat")
        forces = intervals.forces[:, seat]
        low = intervals.low[:, seat]
        high = intervals.high[:, seat]
        near = intervals.near_high[:, 0] - intervals.near_low[:, 0]
        row: Row = {"seat by": words, "frames": len(frames)}
        for k, axis in ((1, "up"), (0, "forward"), (2, "sideways")):
            row |= {
                f"{axis}: found, mean [N]": float(forces[:, k].mean()),
                f"{axis}: minimum": float(low[:, k].mean()),
                f"{axis}: maximum": float(high[:, k].mean()),
                f"{axis}: near the optimum, width": float(near[:, k].mean()),
            }
        inside = ((truth >= low - 1e-6) & (truth <= high + 1e-6)).all(axis=1)
        yield row | {"Newton's inside": f"{100.0 * inside.mean():.0f} %"}


def _residuals(tension: Tension) -> Array:
    """Return the forces that hold the body up and do not exist (frames, 3) [N]."""
    columns = [k for k, name in enumerate(tension.reserve_names) if name.startswith("residual_F")]
    return tension.actuator_force[:, columns]


def _millimetre(values: Array) -> float:
    return 1e3 * float(np.median(values))


def measure_seat_times(folder: Path) -> Iterator[Row]:
    """Compare the times at which the seat is left and reached.

    They are shown by the seat's motion, by the force, and by the plates under the feet.
    """
    found_all = leavings(chair(folder))
    for words, rising in (("standing up", True), ("sitting down", False)):
        some = [one for one in found_all if one.rising is rising]
        force = np.array([one.motion - one.force for one in some])
        plates = np.array([one.force - one.plates for one in some])
        yield {
            "event": words,
            "times": len(some),
            "motion later than force, mean [ms]": 1e3 * float(force.mean()),
            "largest": 1e3 * float(np.abs(force).max()),
            "force later than plates, mean [ms]": 1e3 * float(plates.mean()),
            "largest, plates": 1e3 * float(np.abs(plates).max()),
        }


def _millimetres(point: Array) -> str:
    return ", ".join(f"{1e3 * one:.0f}" for one in point)
