"""Strides of bodies that turn, stop, stay on a belt or drag their feet, whatever shows them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.core.model.series import Event
from myomorph.lab.analysis.foot_events import Limb
from myomorph.lab.analysis.phases import ground_phases
from myomorph.lab.analysis.strides import find_strides
from truths.made_gaits import PLANS, SIDES, WEIGHT, GaitPlan, Leg, made_gait

UP = np.array([0.0, 0.0, 1.0])
LIMBS = tuple(Limb(f"foot_{s}", (f"heel_{s}",), (f"toe_{s}",), bodies=(f"foot_{s}",)) for s in "rl")
SOURCES = ("markers", "plates", "events", "sensors")
MISSED = 4  # Strides at the ends of a recording and beside turns, which one source sees and not all


def found_by(source, gait):
    """Strides of a made gait."""
    if source == "plates":
        return find_strides(
            gait.points, LIMBS, ["trunk"], UP, wrenches=gait.plates(), weight=WEIGHT
        )
    if source == "events":
        return find_strides(gait.points, LIMBS, ["trunk"], UP, events=gait.events)
    if source == "sensors":
        return find_strides(gait.in_place, LIMBS, ["trunk"], UP, facing=gait.facing)
    return find_strides(gait.points, LIMBS, ["trunk"], UP)


@pytest.mark.parametrize("source", SOURCES)
@pytest.mark.parametrize("name", PLANS)
def test_strides_of_every_source_follow_the_local_direction_of_travel(name, source):
    gait = made_gait(PLANS[name], seed=3)
    found = found_by(source, gait)
    straight = {side: [one for one in gait.strides[side] if one.is_straight] for side in SIDES}
    count = sum(map(len, straight.values()))
    assert count - MISSED <= len(found.strides) <= count + 1
    for side in SIDES:
        limb = f"foot_{side[0]}"
        for time in found.strikes[limb]:
            own = np.abs(gait.strikes[side] - time).min()
            assert own < np.abs(gait.lifts[side] - time).min()
        cadence = np.mean([120.0 / one.duration for one in found.of(limb)])
        true = np.mean([120.0 / (one.stop - one.start) for one in straight[side]])
        assert cadence == pytest.approx(true, rel=0.02)
    if source != "sensors":  # Which show no way over the ground
        every = [one for own in straight.values() for one in own]
        true = np.mean([one.length / (one.stop - one.start) for one in every])
        assert np.mean([one.speed for one in found.strides]) == pytest.approx(true, rel=0.03)
        assert np.nanmean([one.width for one in found.strides]) == pytest.approx(0.12, abs=0.01)


@pytest.mark.parametrize("name", ["out and back", "stop", "corners"])
def test_what_is_left_out_is_named(name):
    gait = made_gait(PLANS[name], seed=4)
    found = found_by("events", gait)
    assert any(found.left_out.values())
    (note,) = [note for note in found.notes if "turns or stops" in note]
    curved = [one for side in SIDES for one in gait.strides[side] if not one.is_straight]
    for one in curved:
        middle = 0.5 * (one.start + one.stop)
        assert any(start <= middle <= stop for start, stop in note.times)


@pytest.mark.parametrize("name", ["straight", "treadmill", "circle", "child with CP"])
def test_nothing_is_left_out_of_who_goes_on(name):
    found = found_by("events", made_gait(PLANS[name], seed=5))
    assert not any(found.left_out.values())
    assert not any("turns or stops" in note for note in found.notes)


def test_strides_of_a_recording_that_only_turns_are_kept_and_said():
    plan = GaitPlan(course=(Leg(5.0, turn=2.0 * np.pi),))
    found = found_by("markers", made_gait(plan, seed=6))
    assert len(found.strides) >= 4
    assert any("turns or stops in every stride" in note for note in found.notes)


@pytest.mark.parametrize("turn", [0.0, 1.0, 3.0])
def test_a_turned_laboratory_changes_nothing(turn):
    gait = made_gait(PLANS["to and fro"], seed=7)
    matrix = np.array(
        [[np.cos(turn), np.sin(turn), 0], [-np.sin(turn), np.cos(turn), 0], [0, 0, 1]]
    )
    points = type(gait.points)(gait.points.time, gait.points.names, gait.points.values @ matrix)
    here = find_strides(gait.points, LIMBS, ["trunk"], UP)
    there = find_strides(points, LIMBS, ["trunk"], UP)
    assert [one.length for one in there.strides] == pytest.approx(
        [one.length for one in here.strides], abs=1e-9
    )


def test_flights_of_noise_do_not_make_a_walk_a_run():
    """Twice in a walk the center of mass falls so fast, by noise, that it seems to fly."""
    gait = made_gait(PLANS["child with CP"], seed=8)
    plain = found_by("markers", gait)
    between = plain.strikes["foot_r"][2:4] + 0.45
    events = [
        event
        for time in between
        for event in (Event(time, "Foot Strike", "Right"), Event(time + 0.3, "Foot Off", "Right"))
    ]
    found = find_strides(gait.points, LIMBS, ["trunk"], UP, running=events)
    for limb in found.strikes:
        np.testing.assert_array_equal(found.strikes[limb], plain.strikes[limb])


def test_an_event_far_from_those_of_the_points_is_not_a_second_strike():
    """Half a stride off, neither replaces the other: the better one counts."""
    gait = made_gait(PLANS["straight"], seed=9)
    plain = found_by("markers", gait)
    wrong = float(plain.strikes["foot_r"][3]) + 0.5 * PLANS["straight"].period
    found = find_strides(
        gait.points, LIMBS, ["trunk"], UP, events=[Event(wrong, "Foot Strike", "Right")]
    )
    assert np.diff(found.strikes["foot_r"]).min() > 0.6 * PLANS["straight"].period


def test_plates_that_somebody_comes_back_to_do_not_make_a_long_stride():
    gait = made_gait(PLANS["out and back"], seed=10)
    struck = {side: times[[0, 1, -2, -1]] for side, times in gait.strikes.items()}
    plates = replace(gait, strikes=struck).plates()
    measures = {one.name: one.value for one in ground_phases(plates, UP, WEIGHT).measures}
    for side in ("Right", "Left"):
        assert measures[f"{side} stride time"] == pytest.approx(1.1, rel=0.02)
