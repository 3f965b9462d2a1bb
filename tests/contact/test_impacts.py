"""Impacts as forces.

Pulses keep their impulse on any clock, and masses agree with Newton's law.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from sticks import SITES, TIP, rods

from myomorph.core.contact.impacts import (
    Impact,
    calibrate_impulse,
    calibration_pairs,
    effective_mass,
    impact_wrenches,
    impacts_from_sound,
    pulse,
    velocity_change,
)
from myomorph.core.contact.sound import HeardImpact, HeardImpacts, Instrument
from myomorph.core.contact.strikers import Striker, find_strikers
from myomorph.core.io.osim.read import read_osim
from myomorph.core.model.errors import BadData, UnknownName
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion, Wrenches
from myomorph.core.motion.filters import differentiate
from myomorph.core.rigid.dynamics import inverse_dynamics
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from trees import floating_tree, random_tree


@pytest.mark.parametrize("rate", [30.0, 100.0, 333.0, 20_000.0])
@pytest.mark.parametrize("duration", [0.002, 0.008, 0.05])
def test_a_pulse_keeps_impulse_and_middle_on_any_clock(rate, duration):
    rng = np.random.default_rng(1)
    time = np.cumsum(rng.uniform(0.5, 1.5, int(rate))) / rate
    force = pulse(time, 0.4321, 1.7, duration)
    assert np.trapezoid(force, time) == pytest.approx(1.7, rel=1e-12)
    assert np.trapezoid(force * time, time) / 1.7 == pytest.approx(
        0.4321 + 0.5 * duration, rel=1e-9
    )
    assert force.min() > -1e-9 * force.max()
    assert np.count_nonzero(force) <= duration / np.diff(time).min() + 3


def test_a_pulse_on_a_fast_clock_is_a_half_sine():
    time = np.arange(0.0, 0.1, 1e-5)
    since = time - 0.05
    inside = (since > 0) & (since < 0.008)
    expected = np.where(inside, 2.0 * np.pi / (2 * 0.008) * np.sin(np.pi * since / 0.008), 0.0)
    np.testing.assert_allclose(pulse(time, 0.05, 2.0, 0.008), expected, atol=2.0)
    np.testing.assert_allclose(
        pulse(time, 0.05, 2.0, 0.008)[10:5395:7], expected[10:5395:7], atol=0.01
    )


def test_what_lies_beyond_the_clock_is_lost_and_nothing_else_happens():
    time = np.arange(0.0, 1.0, 0.01)
    assert np.abs(pulse(time, 5.0, 1.0, 0.008)).max() == 0.0
    assert np.abs(pulse(time, -5.0, 1.0, 0.008)).max() == 0.0
    assert np.trapezoid(pulse(time, -0.004, 1.0, 0.008), time) == pytest.approx(0.5)
    with pytest.raises(BadData, match="two frames or more"):
        pulse(time[:1], 0.0, 1.0, 0.008)
    with pytest.raises(BadData, match="a pulse of 0 s"):
        pulse(time, 0.0, 1.0, 0.0)


def at(model: Model, *poses) -> Motion:
    return Motion(
        np.arange(len(poses), dtype=float), model.coordinate_names, np.array(poses, dtype=float)
    )


def test_a_rod_about_its_end_meets_a_blow_at_its_tip_with_a_third_of_its_mass():
    model = rods("stick")
    ways = [[1.0, 0.0, 0.0], [np.cos(0.7), np.sin(0.7), 0]]
    found = effective_mass(model, at(model, [0.0], [0.7]), "stick", TIP, ways)
    np.testing.assert_allclose(found, 0.06 / 3.0, rtol=1e-7)
    assert effective_mass(model, at(model, [0.0]), "stick", TIP, [0.0, 1.0, 0.0])[0] == np.inf


def test_a_free_body_meets_a_blow_beside_its_center_with_less_than_its_mass():
    model = floating_tree(3, bodies=1)
    body = model.bodies[0]
    motion = at(model, np.zeros(6))
    rng = np.random.default_rng(2)
    for _ in range(5):
        way, lever = rng.normal(size=(2, 3))
        way /= np.linalg.norm(way)
        # The joint's frames lie off the body's: the law holds in the ground, whatever they are.
        at_center = effective_mass(model, motion, body.name, body.mass_center, way)[0]
        assert at_center == pytest.approx(body.mass, rel=1e-8)
        assert (
            effective_mass(model, motion, body.name, body.mass_center + lever, way)[0] < body.mass
        )


def test_an_impulse_over_the_effective_mass_is_the_change_of_velocity():
    model = random_tree(4, bodies=7)
    rng = np.random.default_rng(3)
    body = model.bodies[-1].name
    point = rng.normal(size=3)
    way = np.array([0.6, 0.0, 0.8])
    motion = at(model, rng.normal(size=7))
    tree = compile_tree(model)
    b = np.array([tree.body_index[body]])
    place = forward_kinematics(tree, motion.values).points(b, point[None])[:, 0]
    load = Wrenches(
        time=np.zeros(1),
        names=("impact",),
        bodies=(body,),
        forces=way[None, None],
        points=place[:, None],
        torques=np.zeros((1, 1, 3)),
    )
    caused = _caused_accelerations(model, motion, load)
    ahead = forward_kinematics(tree, motion.values + 1e-6 * caused).points(b, point[None])[0, 0]
    mass = effective_mass(model, motion, body, point, way)[0]
    assert 1e-6 / ((ahead - place[0]) @ way) == pytest.approx(mass, rel=1e-4)


def _caused_accelerations(model, motion, load):
    """Return the accelerations (coordinates,) that a load alone causes at rest.

    The inertia is that of inverse dynamics.
    """
    count = len(motion.names)
    still = Motion(
        time=np.arange(count + 1.0),
        names=motion.names,
        values=np.tile(motion.values, (count + 1, 1)),
        velocities=np.zeros((count + 1, count)),
        accelerations=np.vstack([np.zeros_like(motion.values), np.eye(count)]),
    )
    bare = inverse_dynamics(model, still).values
    held = Motion(
        time=np.zeros(1),
        names=motion.names,
        values=motion.values,
        velocities=np.zeros_like(motion.values),
        accelerations=np.zeros_like(motion.values),
    )
    loaded = inverse_dynamics(model, held, load).values[0]
    return np.linalg.solve((bare[1:] - bare[0]).T, bare[0] - loaded)


def test_the_effective_mass_of_a_walkers_hand_is_less_than_its_arm(data):
    model = read_osim(data("rajagopal-walk-emg/subject_walk_scaled.osim"))
    motion = at(model, [one.default for one in model.coordinates])
    hand = effective_mass(model, motion, "hand_r", [0.0, -0.1, 0.0], [1.0, 0.0, 0.0])[0]
    masses = {one.name: one.mass for one in model.bodies}
    assert (
        0.2 * masses["hand_r"]
        < hand
        < sum(masses[f"{one}_r"] for one in ("humerus", "ulna", "radius", "hand"))
    )


def test_the_law_of_impulses_is_found_again():
    rng = np.random.default_rng(5)
    energy = np.exp(rng.uniform(np.log(1e-6), np.log(1e-3), 60))
    exact = calibrate_impulse(energy, 20.0 * energy**0.5)
    assert (exact.scale, exact.exponent) == pytest.approx((20.0, 0.5))
    assert exact.error < 1e-9
    scattered = calibrate_impulse(
        energy, 20.0 * energy**0.42 * np.exp(0.1 * rng.standard_normal(60))
    )
    assert scattered.exponent == pytest.approx(0.42, abs=0.02)
    assert scattered.error == pytest.approx(0.1, abs=0.03)
    assert calibrate_impulse(energy[:1], [0.3]).impulse(energy[0]) == pytest.approx(0.3)
    assert np.isnan(calibrate_impulse(energy[:1], [0.3]).error)
    same = calibrate_impulse(np.full(3, 1e-4), [0.2, 0.21, 0.19])
    assert same.exponent == pytest.approx(0.5)
    assert same.covers(1.5e-4)
    assert not same.covers(3e-4)
    with pytest.raises(BadData, match="above 0"):
        calibrate_impulse([1.0, 0.0], [1.0, 1.0])
    with pytest.raises(BadData, match="2 energies and 1 impulses"):
        calibrate_impulse([1.0, 2.0], [1.0])


DRUM = Instrument(name="drum", channel="1", distance=0.0, sites=("tip",))


def made(*strokes: tuple[float, float]) -> HeardImpacts:
    return HeardImpacts(
        (DRUM,),
        tuple(
            HeardImpact(instrument="drum", time=time, energy=energy, confidence=1.0)
            for time, energy in strokes
        ),
    )


def test_known_strokes_calibrate_the_nearest_that_were_heard():
    heard = made((1.0, 1e-4), (2.0, 4e-4), (3.0, 9e-4))
    laws = calibration_pairs(heard, {"drum": [(1.01, 0.1), (2.99, 0.3)]})
    assert laws["drum"].impulse(4e-4) == pytest.approx(0.2)
    impacts, warnings = impacts_from_sound(
        heard, laws, {0: Striker("tip", 1.0), 1: Striker("tip", 1.0)}, {"drum": [0.0, 0.0, 2.0]}
    )
    assert [one.time for one in impacts] == [1.0, 2.0]
    np.testing.assert_allclose(impacts[0].direction, [0, 0, 1])
    assert warnings == ()
    louder, warnings = impacts_from_sound(made((1.0, 1.0)), laws, {0: Striker("tip", 1.0)}, {})
    assert (
        "1 of 1 impacts are louder or softer than those calibrated on, first on 'drum' at 1.000 s"
        in warnings[0]
    )
    np.testing.assert_allclose(louder[0].direction, [0, 1, 0])
    with pytest.raises(BadData, match="none of the 1 known impacts on 'drum' was heard"):
        calibration_pairs(heard, {"drum": [(1.5, 0.1)]})
    with pytest.raises(UnknownName, match="'bell'"):
        calibration_pairs(heard, {"bell": [(1.5, 0.1)]})
    with pytest.raises(UnknownName, match="'drum'"):
        impacts_from_sound(heard, {}, {0: Striker("tip", 1.0)}, {})


def test_the_stick_that_stops_is_the_one_that_struck():
    model = rods("a", "b")
    time = np.arange(0.0, 1.0, 0.005)
    # Stick a swings on; stick b is turned round at 0.5 s.
    angles = np.column_stack([0.5 * np.sin(4.0 * time), 3.0 * np.abs(time - 0.5)])
    motion = Motion(time, ("a", "b"), angles)
    drum = Instrument(name="drum", channel="1", distance=0.0, sites=("tip_a", "tip_b"))
    heard = HeardImpacts(
        (drum,),
        (
            HeardImpact(instrument="drum", time=0.5, energy=1e-4, confidence=1.0),
            HeardImpact(instrument="drum", time=7.0, energy=1e-4, confidence=1.0),
        ),
    )
    (striker,) = find_strikers(heard, model, motion, SITES).values()
    assert striker.site == "tip_b"
    assert striker.confidence > 0.9
    change = velocity_change(model, motion, SITES[1], 0.5)
    np.testing.assert_allclose(change[0], 2.0 * 3.0 * 0.4, rtol=0.05)
    mass = effective_mass(
        model, Motion(time[100:101], ("a", "b"), angles[100:101]), "b", TIP, change
    )
    np.testing.assert_allclose(mass[0] * np.linalg.norm(change), 0.02 * 2.4, rtol=0.05)


def test_blows_are_loads_whose_torque_over_time_is_their_moment():
    model = rods("a", "b")
    time = np.arange(0.0, 1.0, 0.01)
    zeros = np.zeros((len(time), 2))
    motion = Motion(
        time=time, names=("a", "b"), values=zeros, velocities=zeros, accelerations=zeros
    )
    given = (("tip_a", 0.301, 0.5), ("tip_b", 0.5, 0.2), ("tip_a", 0.6, 0.1))
    forward = np.array([1.0, 0.0, 0.0])
    impacts = [
        Impact(site=site, time=instant, impulse=impulse, direction=forward)
        for site, instant, impulse in given
    ]
    loads = impact_wrenches(impacts, model, motion, SITES)
    assert loads.names == ("tip_a", "tip_b")
    assert loads.bodies == ("a", "b")
    without = inverse_dynamics(model, motion)
    with_ = inverse_dynamics(model, motion, loads)
    taken = np.trapezoid(without.values - with_.values, time, axis=0)
    np.testing.assert_allclose(taken, 0.4 * np.array([0.6, 0.2]), rtol=1e-9)
    with pytest.raises(UnknownName, match="'tip_c'"):
        impact_wrenches(
            [Impact(site="tip_c", time=0.3, impulse=0.5, direction=[1.0, 0, 0])],
            model,
            motion,
            SITES,
        )
    with pytest.raises(BadData, match="expected a vector with a length"):
        Impact(site="tip_a", time=0.3, impulse=0.5, direction=[0.0, 0, 0])
    with pytest.raises(BadData, match="impulse of an impact on 'tip_a' is -1"):
        Impact(site="tip_a", time=0.3, impulse=-1.0, direction=[0.0, 1.0, 0])


def test_a_filtered_motion_is_balanced_by_pulses_filtered_alike():
    model = rods("a", "b")
    time = np.arange(0.0, 2.0, 0.005)
    turned = 0.5 * 0.4 / (0.06 * 0.4**2 / 3.0)
    # Without gravity the impact of 0.5 N s alone sets stick a turning.
    model = replace(model, gravity=np.zeros(3))
    values = np.column_stack([turned * np.maximum(time - 1.004, 0.0), np.zeros(len(time))]) * 1e-3
    motion = differentiate(Motion(time, ("a", "b"), values), 6.0)
    impact = Impact(site="tip_a", time=1.0, impulse=0.5e-3, direction=np.array([1.0, 0.0, 0.0]))
    left = []
    for cutoff in (None, 6.0):
        loads = impact_wrenches([impact], model, motion, SITES, cutoff=cutoff)
        assert np.trapezoid(loads.forces[:, 0, 0], time) == pytest.approx(0.5e-3, rel=1e-6)
        left.append(np.abs(inverse_dynamics(model, motion, loads).values[20:-20, 0]).max())
    assert left[1] < 0.01 * left[0]
