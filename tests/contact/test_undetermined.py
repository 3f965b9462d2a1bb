"""Feet whose load is not known: they stand next to the plates, or share one.

Healthy steps are left alone.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.core.contact.undetermined import UNDETERMINED, undetermined_loads
from myomorph.core.model.series import Wrenches

UP = np.array([0.0, 1.0, 0.0])
WEIGHT = 700.0
TIME = np.arange(0.0, 2.4, 0.005)


def walk(size=1.0):
    """Make time, heel and ball of two feet that stand in turn with some double support.

    A step takes 0.6 s; lengths are scaled by `size`.
    """
    places = {}
    for foot, side, begins in (("calcn_r", 0.1, 0.0), ("calcn_l", -0.1, 0.6)):
        phase = np.clip((TIME - begins) % 1.2, 0.0, 1.2)
        swing = np.clip((phase - 0.72) / 0.48, 0.0, 1.0)
        ahead = 1.2 * (
            np.floor((TIME - begins) / 1.2) + (swing - np.sin(2.0 * np.pi * swing) / (2.0 * np.pi))
        )
        heel = np.stack([ahead, 0.1 * np.sin(np.pi * swing), np.full_like(TIME, side)], axis=1)
        places[foot] = size * np.stack([heel, heel + [0.2, 0.0, 0.0]], axis=1)
    return np.sqrt(size) * TIME, places


def stance(places, foot):
    """Return the samples in which a foot does not move."""
    return np.linalg.norm(np.gradient(places[foot][:, 0], axis=0), axis=1) < 1e-12


def loads(time, places, size=1.0, feet=("calcn_r", "calcn_l")):
    """Make a plate for each foot that carries half the weight in its stance, under its middle."""
    if not feet:
        none = np.zeros((len(time), 0, 3))
        return Wrenches(time=time, names=(), bodies=(), forces=none, points=none, torques=none)
    forces = np.stack([0.5 * WEIGHT * stance(places, foot)[:, None] * UP for foot in feet], axis=1)
    points = np.stack([places[foot].mean(axis=1) for foot in feet], axis=1)
    return Wrenches(
        time=time,
        names=tuple(f"plate_{foot}" for foot in feet),
        bodies=feet,
        forces=forces,
        points=points,
        torques=np.zeros_like(forces),
    )


@pytest.mark.parametrize("size", [1.0, 0.05])
def test_steps_on_plates_of_their_own_are_left_alone(size):
    time, places = walk(size)
    assert undetermined_loads(loads(time, places), places, WEIGHT, UP) == ()


@pytest.mark.parametrize("size", [1.0, 0.05])
def test_a_foot_that_stands_beside_all_plates_is_named_while_it_stands(size):
    """The same at the size of a mouse, whose times are shorter by the root of its lengths."""
    time, places = walk(size)
    found = undetermined_loads(loads(time, places, feet=("calcn_r",)), places, WEIGHT, UP)
    assert [(finding.kind, finding.place) for finding in found] == [(UNDETERMINED, "calcn_l")]
    assert "no plate carries it" in found[0].text
    flagged = np.any([(time >= a) & (time <= b) for a, b in found[0].times], axis=0)
    stands = stance(places, "calcn_l")
    assert flagged[stands].all()
    assert flagged[~stands].mean() < 0.3


@pytest.mark.parametrize(("carried", "found"), [(0.4, ["calcn_l"]), (1.0, [])])
def test_a_foot_still_on_a_step_is_named_where_weight_is_missing(carried, found):
    """One foot stays on its plate, the other is put 0.82 m higher; held up, it carries nothing."""
    raised = np.clip((TIME - 0.4) / 0.5, 0.0, 1.0) - np.clip((TIME - 1.7) / 0.5, 0.0, 1.0)
    places = {}
    for foot, side in (("calcn_r", 0.1), ("calcn_l", -0.1)):
        high = 0.82 * raised * (foot == "calcn_l")
        heel = np.stack([0.3 * high, high, np.full_like(TIME, side)], axis=1)
        places[foot] = np.stack([heel, heel + [0.2, 0.0, 0.0]], axis=1)
    on_step = raised == 1.0
    share = np.where(raised > 0.0, 1.0, 0.5)
    force = np.where(on_step, carried, share) * WEIGHT
    ground = np.where(raised == 0.0, 0.5, 0.0) * WEIGHT
    forces = np.stack([force[:, None] * UP, ground[:, None] * UP], axis=1)
    points = np.stack([places[foot].mean(axis=1) for foot in places], axis=1)
    points[:, :, 1] = 0.0
    given = Wrenches(
        time=TIME,
        names=("one", "other"),
        bodies=tuple(places),
        forces=forces,
        points=points,
        torques=np.zeros_like(forces),
    )
    findings = undetermined_loads(given, places, WEIGHT, UP)
    assert [finding.place for finding in findings] == found
    for finding in findings:
        ((start, stop),) = finding.times
        assert start == pytest.approx(0.9, abs=0.05)
        assert stop == pytest.approx(1.7, abs=0.05)


def test_a_center_of_pressure_beside_all_feet_is_named_while_it_is_there():
    """A hand leans beside the foot from 0.2 to 0.5 s: the plate's load is not the foot's alone."""
    time, places = walk()
    given = loads(time, places)
    leaning = (time >= 0.2) & (time <= 0.5)
    points = np.array(given.points)
    points[leaning, 0, 2] += 0.2
    (finding,) = undetermined_loads(replace(given, points=points), places, WEIGHT, UP)
    assert finding.place == "calcn_r"
    assert "beside all feet" in finding.text
    ((start, stop),) = finding.times
    assert (start, stop) == pytest.approx((0.2, 0.5), abs=0.03)


def test_a_plate_under_two_feet_is_nobodys():
    """The force of both, given to one: neither has a load of its own."""
    time, places = walk()
    both = loads(time, places)
    still = stance(places, "calcn_r") & stance(places, "calcn_l")
    middle = both.points.mean(axis=1, keepdims=True)
    forces = np.where(still[:, None, None], both.forces.sum(axis=1, keepdims=True), both.forces)
    points = np.where(still[:, None, None], middle, both.points)
    forces[still, 1] = 0.0
    wrenches = Wrenches(
        time=time,
        names=both.names,
        bodies=both.bodies,
        forces=forces,
        points=points,
        torques=np.zeros_like(forces),
    )
    found = undetermined_loads(wrenches, places, WEIGHT, UP)
    assert [finding.place for finding in found] == ["calcn_r", "calcn_l"]
    right_finding, left_finding = found
    right = np.any([(time >= a) & (time <= b) for a, b in right_finding.times], axis=0)
    left = np.any([(time >= a) & (time <= b) for a, b in left_finding.times], axis=0)
    assert right[still].mean() > 0.9
    assert left[still].mean() > 0.9
    assert right[~still].mean() < 0.2


def test_another_body_beside_the_foot_that_has_the_force_is_seen():
    time, places = walk()
    wrenches = loads(time, places)
    points = wrenches.points + np.array([0.4, 0.0, 0.0])
    found = undetermined_loads(
        Wrenches(
            time=time,
            names=wrenches.names,
            bodies=wrenches.bodies,
            forces=wrenches.forces,
            points=points,
            torques=wrenches.torques,
        ),
        places,
        WEIGHT,
        UP,
    )
    assert {finding.place for finding in found} == {"calcn_r", "calcn_l"}
    assert all("not under it alone" in finding.text for finding in found)


def test_without_any_loaded_plate_nothing_is_found():
    time, places = walk()
    assert undetermined_loads(loads(time, places, feet=()), places, WEIGHT, UP) == ()
