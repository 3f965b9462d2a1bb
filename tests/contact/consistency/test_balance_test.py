"""Faults put into a real walk by other code are named with their sizes; the walk itself passes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.accuracy.faults.consistency import outcome
from benchmarks.accuracy.faults.consistency_faults import Case, heavier, turn
from benchmarks.accuracy.faults.consistency_recordings import RECORDED

import myomorph as mm
from myomorph.core.contact.consistency.balance_test import BESIDE, MeasuredPlates, verdict_of
from myomorph.core.contact.consistency.body_needs import body_needs
from myomorph.core.contact.consistency.channels import channels
from myomorph.core.contact.consistency.corrections import Plates, hypotheses, no_correction
from myomorph.core.contact.consistency.plate_signals import plate_signals
from myomorph.core.contact.consistency.scene import tilt
from myomorph.core.contact.force_checks import checked_forces

WALK = RECORDED[0]


@pytest.fixture(scope="module")
def walk(data) -> Case:
    return WALK.case(data("rajagopal-walk-emg").parent)


@pytest.fixture(scope="module")
def motion(walk) -> mm.Motion:
    return mm.inverse_kinematics(walk.model, walk.markers).motion


def findings(case: Case, motion: mm.Motion) -> list:
    """Return what the balance alone says, feet beside the plates left out."""
    up = np.asarray(case.model.up)
    signals = plate_signals(case.wrenches, case.model.weight, up)
    said = verdict_of(case.model, motion, MeasuredPlates(case.wrenches, signals)).findings
    return [item for item in said if item.kind != BESIDE]


def test_a_walk_as_it_is_passes(walk, motion):
    assert findings(walk, motion) == []


def one_plate(walk: Case, part: str, change) -> Case:
    return walk.on_plates(walk.plates[:1], part, change)


SHIFT = np.array([0.0, 0.0, 0.05])
FAULTS = {
    "points off": lambda walk: one_plate(walk, "points", lambda points: points + SHIFT),
    "crosstalk": lambda walk: one_plate(
        walk, "forces", lambda force: force + 0.06 * force[:, [1]] * np.array([1.0, 0.0, 0.0])
    ),
    "gain": lambda walk: one_plate(walk, "forces", lambda force: 0.75 * force),
    "reversed x": lambda walk: one_plate(
        walk, "forces", lambda force: force * np.array([-1.0, 1.0, 1.0])
    ),
    "exchanged axes x and z": lambda walk: one_plate(
        walk, "forces", lambda force: force[:, [2, 1, 0]]
    ),
    "clock": lambda walk: walk.with_wrenches(time=walk.wrenches.time + 0.04),
    "unit of force": lambda walk: walk.with_wrenches(
        forces=walk.wrenches.forces / 4.4482216, torques=walk.wrenches.torques / 4.4482216
    ),
    "mass or gain of all plates": lambda walk: replace(walk, model=heavier(walk.model, 1.2)),
}


@pytest.mark.parametrize("kind", FAULTS)
def test_a_fault_is_named_and_nothing_else(walk, motion, kind):
    (said,) = findings(FAULTS[kind](walk), motion)
    assert said.kind == kind
    assert not said.repaired
    assert said.repair is None


@pytest.mark.parametrize(
    ("kind", "size", "sd"),
    [("points off", 5.0, 0.6), ("clock", 40.0, 4.0), ("gain", 75.0, 1.5)],
)
def test_the_size_is_that_of_the_fault(walk, motion, kind, size, sd):
    """Within two standard deviations of what a sound laboratory has."""
    (said,) = findings(FAULTS[kind](walk), motion)
    told = [float(word) for word in str(said).replace(":", " ").split() if _is_number(word)]
    assert min(abs(abs(value) - size) for value in told) < 2.0 * sd


def gained(walk: Case, size: float) -> Case:
    return one_plate(walk, "forces", lambda force: 0.01 * size * force)


def late(walk: Case, size: float) -> Case:
    return walk.with_wrenches(time=walk.wrenches.time + 1e-3 * size)


def weighing(walk: Case, size: float) -> Case:
    """Let the model weigh so much."""
    return replace(walk, model=heavier(walk.model, size / walk.model.mass))


@pytest.mark.parametrize(
    ("kind", "change", "size"),
    [
        ("gain", gained, 75.0),
        ("gain", gained, 130.0),
        ("clock", late, 40.0),
        ("clock", late, -60.0),
        ("mass", weighing, 60.0),
        ("mass", weighing, 110.0),
    ],
)
def test_the_interval_holds_the_size(walk, motion, kind, change, size):
    """Sizes far from nothing too, where an interval of their inverse would be another one."""
    (said,) = findings(change(walk, size), motion)
    assert said.kind.startswith(kind)
    text = str(said).split("': ")[1].removeprefix("a body of ")
    value, half = text.split(" (±")
    wanted = walk.model.mass if kind == "mass" else abs(size)
    assert abs(float(value.split()[0]) - wanted) < float(half.split()[0])


@pytest.mark.parametrize("late_by", [0.03, 0.05, 0.06, 0.07, 0.08, -0.06, -0.08])
def test_forces_that_are_late_are_named_with_their_time(walk, motion, late_by):
    """Whether the balance fits or another check has to say it."""
    wrenches = replace(walk.wrenches, time=walk.wrenches.time + late_by)
    found = checked_forces(wrenches, walk.model, motion).findings
    (said,) = [item for item in found if item.kind == "clock"]
    assert said.text.size == pytest.approx(1e3 * abs(late_by), abs=8.0)
    assert ("late" if late_by > 0.0 else "early") in said.text


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


@pytest.mark.parametrize("mirror", [[1.0, 1.0, -1.0], [-1.0, 1.0, 1.0], [1.0, -1.0, -1.0]])
def test_mirrored_or_fallen_markers_leave_the_forces_alone(walk, mirror):
    """The sound side is never put right by the wrong one."""
    said = outcome(walk.with_markers(walk.markers.values * np.array(mirror))).findings
    assert "forces not judged" in {item.kind for item in said}
    assert not any(item.repaired for item in said if item.place in walk.wrenches.names)


def test_the_force_of_all_segments_accelerates_the_center_of_mass(walk, motion):
    """Newton's second law, by differences of a center that shares no acceleration with it."""
    needs = body_needs(walk.model, motion)
    velocity = np.gradient(needs.center, needs.time, axis=0)
    acceleration = np.gradient(velocity, needs.time, axis=0)
    inner = slice(10, -10)
    wanted = needs.mass * (acceleration - needs.gravity)
    error = np.abs(needs.force - wanted)[inner].max()
    assert error < 0.03 * walk.model.weight


def test_the_moment_does_not_depend_on_where_the_ground_lies(walk, motion):
    moved = motion.values.copy()
    for name, shift in (("pelvis_tx", 3.0), ("pelvis_tz", -2.0)):
        moved[:, motion.names.index(name)] += shift
    here = body_needs(walk.model, motion)
    there = body_needs(walk.model, replace(motion, values=moved))
    np.testing.assert_allclose(there.moment, here.moment, atol=1e-6)


def test_uncorrected_signals_are_those_of_the_plates(walk):
    """At the plates' own times the moment about the origin is that of force, point and torque."""
    wrenches = walk.wrenches
    usable = np.ones(len(wrenches.names), bool)
    filtered = channels(wrenches, usable, 1, walk.model.weight)
    none = no_correction(len(wrenches.names))
    time = wrenches.time[100:-100:7]
    forces = filtered.at(time, none)
    load = forces.forces[..., 1] > 0.2 * walk.model.weight
    points = np.nan_to_num(wrenches.points)[100:-100:7]
    assert np.abs(forces.points - points)[load].max() < 0.05
    lever = np.cross(forces.points, forces.forces)[load]
    torque = filtered.sampled(time, none).torques[load]
    # Products of filtered signals are not filtered products, but for the vertical row.
    np.testing.assert_allclose(
        (forces.moments[load] - torque)[:, [0, 2]], lever[:, [0, 2]], atol=12.0
    )


def test_every_hypothesis_without_a_size_changes_something():
    plates = Plates(
        names=("a", "b"), live=(0, 1), zeros=frozenset(), up=1, weight=700.0, times=np.arange(9.0)
    )
    none = no_correction(2)
    for item in hypotheses(plates):
        correction = item.make(np.full(len(item.sd), 0.1))
        same = (
            np.array_equal(correction.force, none.force)
            and np.array_equal(correction.point, none.point)
            and np.array_equal(correction.shift, none.shift)
            and np.array_equal(correction.offset, none.offset)
            and correction.keeps_clocks
            and not correction.gravity.any()
            and not correction.cameras.any()
        )
        assert not same, item.kinds
        assert item.text(np.full(len(item.sd), 0.1), np.full(len(item.sd), 0.01))


def test_a_tilt_is_a_rotation():
    matrix = tilt(np.array([0.3, -0.2]), np.eye(3)[[0, 2]])
    np.testing.assert_allclose(matrix @ matrix.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(
        tilt(np.array([np.radians(5.0), 0.0]), np.eye(3)[[0, 2]]), turn(0, 5.0), atol=1e-12
    )
