"""Steps, rails and seats: found where they carry, and nowhere else.

Truth are simulated persons whose forces MuJoCo gives, and poses whose balance is plain statics.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import myomorph as mm
from myomorph.core.contact.found_supports import find_supports
from myomorph.core.contact.missing_wrench import missing_wrench
from myomorph.core.contact.sites import body_sites
from myomorph.core.model.series import Wrenches
from myomorph.core.model.series_quantities import COORDINATE_VALUE
from myomorph.core.motion.sync import resample_wrenches
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from truths.stepped_performer import stepped


@pytest.fixture(scope="module")
def rested():
    """Simulate somebody who rests the left foot on a step of 0.23 m."""
    return stepped("foot on a step", 0.23, seed=31)


def on_feet(wrenches, bodies):
    """Leave the forces of some bodies out."""
    return wrenches.columns([k for k, body in enumerate(wrenches.bodies) if body not in bodies])


@pytest.mark.parametrize("plates", ["both", "right foot's", "none"])
def test_a_step_is_found_under_the_foot_that_it_carries(rested, plates):
    known = {
        "both": rested.plates,
        "right foot's": on_feet(rested.plates, {"foot_l"}),
        "none": None,
    }[plates]
    (step,) = find_supports(rested.model, rested.motion, known).all
    assert (step.contact, step.body, step.kind) == ("foot_l", "foot_l", "step")
    assert step.height == pytest.approx(0.23, abs=0.01)
    assert step.rests == pytest.approx((1.6, 3.5), abs=0.15)
    assert 0.9 < step.window[0] < 1.6
    assert 3.5 < step.window[1] < 4.2


def test_a_step_that_a_plate_measures_is_nothing_to_find(rested):
    assert not find_supports(rested.model, rested.motion, rested.wrenches)


def test_a_foot_that_is_held_up_is_on_no_step():
    """It keeps as still, but the other foot carries all."""
    held = stepped("balance", 0.23, seed=32)
    assert not find_supports(held.model, held.motion, held.plates)
    assert not find_supports(held.model, held.motion, None)


def test_the_force_of_a_step_that_stands_on_a_plate_in_part_is_not_used(rested):
    """A plate under one end of the step has half of what the foot presses, 0.2 m beside it."""
    forces = np.array(rested.wrenches.forces)
    points = np.array(rested.wrenches.points)
    high = points[:, 1, 1] > 0.02
    forces[high, 1] *= 0.5
    points[high, 1] += (0.0, 0.0, -0.2)
    points[high, 1, 1] = 0.0
    half = replace(rested.wrenches, forces=forces, points=points)
    supports = find_supports(rested.model, rested.motion, half)
    (step,) = supports.all
    assert step.unused == ("plate_l",)
    assert "'plate_l' acts on a part of a step" in supports.sentence
    left = supports.used(half).forces[:, 1]
    at = (half.time >= step.rests[0]) & (half.time <= step.rests[1])
    assert not left[at].any()
    outside = (half.time < step.window[0]) | (half.time > step.window[1])
    assert (left[outside] == half.forces[outside, 1]).all()


@pytest.mark.parametrize("without", [(), ("calcn_l",), ("calcn_r", "calcn_l")])
def test_nobody_who_walks_on_the_floor_has_steps_or_rails(without):
    sample = mm.sample("walk")
    motion = mm.differentiate(sample.truth[COORDINATE_VALUE.name], cutoff=6.0)
    wrenches = on_feet(resample_wrenches(sample.loads, motion.time, 6.0), without)
    assert not find_supports(sample.model, motion, wrenches if wrenches.names else None)


@pytest.mark.parametrize("mass", [0.8, 1.0, 1.2])
@pytest.mark.parametrize("share", [0.0, 0.25])
def test_a_rail_is_found_in_the_hand_that_takes_weight(data, share, mass):
    """A person who stands still; the feet press 50 : 50 of what the hand does not take."""
    model = mm.read_model(data("opencap-subject4-multitask/models/manually_scaled.osim"))
    hand = "hand_r"
    motion = still(model)
    during = (motion.time > 0.6) & (motion.time < 1.4)
    taken = share * during[:, None] * model.weight * np.asarray(model.up)
    needed = missing_wrench(model, motion)
    moment = needed.moment - np.cross(place_of(model, motion, hand), taken)
    feet = on_two_feet(needed.force - taken, moment, motion.time)
    supports = find_supports(model.with_mass(mass * model.mass), motion, feet)
    if share == 0.0:
        assert not supports
        return
    (rail,) = supports.all
    assert (rail.contact, rail.kind) == (hand, "rail")
    assert rail.rests == pytest.approx((0.6, 1.4), abs=0.05)


def still(model):
    """Make a motion of somebody who stands in the default pose for 2 s."""
    time = np.arange(0.0, 2.0, 0.01)
    values = np.tile(compile_tree(model).defaults, (len(time), 1))
    return mm.differentiate(mm.Motion(time, model.coordinate_names, values), cutoff=6.0)


def place_of(model, motion, hand):
    """Find the middle of a hand over time."""
    tree = compile_tree(model)
    (site,) = body_sites(model, (hand,))
    poses = forward_kinematics(tree, tree.coordinates_of(motion))
    return poses.points(np.array([tree.body_index[site.body]]), site.points)[:, 0]


def on_two_feet(force, moment, time):
    """Split a wrench evenly between plates in the floor, y = 0, 0.1 m beside its center."""
    center = np.stack([moment[:, 2], np.zeros(len(time)), -moment[:, 0]], axis=1) / force[:, 1:2]
    points = center[:, None] + np.array([[0.0, 0.0, 0.1], [0.0, 0.0, -0.1]])
    forces = np.stack([0.5 * force, 0.5 * force], axis=1)
    left = moment - np.cross(points, forces).sum(axis=1)
    return Wrenches(
        time=time,
        names=("one", "other"),
        bodies=("calcn_r", "calcn_l"),
        forces=forces,
        points=points,
        torques=np.stack([0.5 * left, 0.5 * left], axis=1),
    )


def test_the_line_of_a_missing_force_passes_by_where_it_acts(rested):
    """All but one true force known: what is left passes by its center of pressure on the mean."""
    known = on_feet(rested.wrenches, {"foot_l"})
    left = missing_wrench(rested.model, rested.motion, known)
    during = (left.time > 2.2) & (left.time < 2.9)
    mean = left.mean(during)
    center = rested.wrenches.points[during, 1].mean(axis=0)[None]
    assert np.linalg.norm(mean.offsets(center)) < 0.05
    share, distance = mean.between(center + [[0.0, 0.0, 0.3]], center - [[0.0, 0.0, 0.1]])
    assert share[0] == pytest.approx(0.75, abs=0.15)
    assert distance[0] < 0.05
