"""When sites are in contact.

Against plates that were withheld, in flight, on a belt, for a mouse, and from several sources.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from measured_walk import measured_walk
from myomorph.core.contact.site_motion import SiteMotion, floor_under, site_motion
from myomorph.core.contact.spells import hysteresis, steady
from myomorph.core.contact.states import (
    ActivationOptions,
    ContactStateOptions,
    by_kinematics,
    contact_activations,
    fade,
    find_contacts,
    merge_contacts,
    preferred_directions,
)
from myomorph.core.model.contacts import Contacts, Site, Touch
from myomorph.core.model.errors import BadData
from myomorph.core.model.series import Motion
from myomorph.core.motion.sync import resample_wrenches


@pytest.fixture(scope="module")
def walk(data):
    one = measured_walk(data)
    return (
        one.model,
        one.motion,
        one.sites,
        resample_wrenches(one.loads, one.motion.time, 20.0),
        one.floor,
    )


def test_contacts_of_a_walk_agree_with_plates(walk):
    """Foot strike and foot off are within 30 ms of the plates, which were withheld.

    One foot is always down.
    """
    model, motion, sites, wrenches, _ = walk
    found = find_contacts(model, motion, sites)
    assert not found.warnings
    assert {one.source for one in found.intervals} == {"kinematics"}
    states = found.states(motion.time).values > 0.0
    feet = [
        states[:, [k for k, one in enumerate(sites) if one.group == group]].any(axis=1)
        for group in ("foot_r", "foot_l")
    ]
    assert (feet[0] | feet[1]).all()
    checked = 0
    for foot, state in enumerate(feet):
        load = wrenches.forces[:, foot, 1]
        on = hysteresis(load > 0.05 * model.mass * 9.81, load < 0.03 * model.mass * 9.81)
        for change in (1, -1):
            known = motion.time[1:][np.diff(on.astype(int)) == change]
            ours = motion.time[1:][np.diff(state.astype(int)) == change]
            for time in known[(known > 0.6) & (known < 1.7)]:
                assert np.abs(ours - time).min() < 0.03
                checked += 1
    assert checked >= 3


def test_order_of_sites_does_not_matter(walk):
    """Nor need the sites of a foot stand beside each other."""
    model, motion, sites, wrenches, _ = walk
    found = find_contacts(model, motion, sites, plates=wrenches)
    mixed = find_contacts(model, motion, (*sites[::2], *sites[1::2]), plates=wrenches)
    assert [one for one in found.intervals if one.source == "plates"]
    assert set(mixed.intervals) == set(found.intervals)


def test_plates_of_another_clock_are_refused(walk):
    model, motion, sites, wrenches, _ = walk
    late = replace(wrenches, time=wrenches.time + 0.5)
    with pytest.raises(BadData, match="resample them to its times first"):
        find_contacts(model, motion, sites, plates=late)


def test_plates_tell_the_foot_and_come_first(walk):
    model, motion, sites, wrenches, _ = walk
    unknown = replace(wrenches, bodies=("", ""))
    found = find_contacts(model, motion, sites, plates=unknown)
    by_plates = [one for one in found.intervals if one.source == "plates"]
    assert by_plates
    assert {one.confidence for one in by_plates} == {1.0}
    heel = next(one for one in by_plates if one.site == "heel_lateral_r")
    loaded = motion.time[wrenches.forces[:, 0, 1] > 0.05 * model.mass * 9.81]
    assert heel.start == pytest.approx(loaded[0], abs=0.03)
    for name in found.sites:
        spans = found.of(name)
        assert all(one.stop <= other.start for one, other in pairwise(spans))
    deaf = find_contacts(model, motion, sites, ContactStateOptions(loaded=3.0), unknown)
    assert {one.source for one in deaf.intervals} == {"kinematics"}


def test_a_body_that_weighs_a_thousandth_is_judged_alike(walk):
    """Thresholds of plates are shares of the weight.

    A force that is too small to detect for a human is a mouse's whole weight.
    """
    model, motion, sites, wrenches, _ = walk
    light = replace(model, bodies=tuple(replace(one, mass=1e-3 * one.mass) for one in model.bodies))
    small = replace(wrenches, forces=1e-3 * wrenches.forces, torques=1e-3 * wrenches.torques)
    assert find_contacts(light, motion, sites, plates=small) == find_contacts(
        model, motion, sites, plates=wrenches
    )


def swinging(scale: float, speed: float = 0.0, frames: int = 400) -> SiteMotion:
    """Make two feet of one site each that step in turn, each lifted half of the time.

    A belt may carry the foot that stands.
    """
    time = np.linspace(0.0, 4.0 * np.sqrt(scale), frames)
    phase = (time / np.sqrt(scale)) % 1.0
    lift = np.stack([_arc(phase, 0.0, 0.5), _arc((phase + 0.5) % 1.0, 0.0, 0.5)], axis=1)
    places = np.zeros((frames, 2, 3))
    places[:, :, 1] = 0.1 * scale * lift
    places[:, :, 0] = speed * time[:, None]
    velocities = np.gradient(places, time, axis=0)
    return SiteMotion(
        time=time,
        up=np.array([0.0, 1.0, 0.0]),
        places=places,
        lowest=places[:, :, 1],
        velocities=velocities,
        height=scale,
        carried=np.ones(frames),
    )


def _arc(phase: np.ndarray, start: float, length: float) -> np.ndarray:
    inside = (phase >= start) & (phase < start + length)
    return np.where(inside, np.sin(np.pi * (phase - start) / length) ** 2, 0.0)


TWO = tuple(
    Site(name, body, np.zeros((1, 3)), group=name) for name, body in (("right", "a"), ("left", "b"))
)


@pytest.mark.parametrize("scale", [1.0, 0.025], ids=["adult", "mouse"])
@pytest.mark.parametrize("speed", [0.0, -5.0], ids=["ground", "belt"])
def test_size_and_belt_do_not_matter(scale, speed):
    """The steps of a mouse, or of a runner on a belt, have contacts at the same phases."""
    reference = swinging(1.0)
    moving = swinging(scale, speed * np.sqrt(scale))
    floor = floor_under(moving)
    assert floor.height == pytest.approx(0.0, abs=1e-3 * scale)
    assert floor.velocity[0] == pytest.approx(speed * np.sqrt(scale), abs=1e-6)
    found = by_kinematics(moving, floor, TWO)
    wanted = by_kinematics(reference, floor_under(reference), TWO)
    assert [one.site for one in found.intervals] == [one.site for one in wanted.intervals]
    starts = np.array([one.start for one in found.intervals]) / np.sqrt(scale)
    np.testing.assert_allclose(starts, [one.start for one in wanted.intervals], atol=1e-9)
    # On while a foot stands, off while it is higher than touches end.
    states = found.states(moving.time).values > 0.0
    assert states[moving.lowest < 1e-6 * scale].all()
    assert not states[moving.lowest > 0.05 * scale].any()


def test_nothing_touches_in_flight_and_something_does_when_carried():
    moving = swinging(1.0)
    flying = replace(moving, carried=np.where((moving.time > 1.0) & (moving.time < 1.3), 0.0, 1.0))
    found = by_kinematics(flying, floor_under(flying), TWO)
    inside = (moving.time > 1.0) & (moving.time < 1.3)
    assert not found.states(moving.time).values[inside].any()
    raised = replace(moving, lowest=moving.lowest + 0.06)
    held = by_kinematics(raised, replace(floor_under(moving), height=0.0), TWO)
    assert held.states(moving.time).values.max(axis=1).min() == 0.5
    away = replace(moving, lowest=moving.lowest + 0.5)
    lost = by_kinematics(away, replace(floor_under(moving), height=0.0), TWO)
    assert not lost.intervals
    assert "is a site missing" in lost.warnings[0]


def test_unseen_frames_touch_nothing():
    moving = swinging(1.0)
    lowest = np.array(moving.lowest)
    places = np.array(moving.places)
    lowest[50:60] = places[50:60] = np.nan
    hidden = replace(moving, lowest=lowest, places=places)
    found = by_kinematics(hidden, floor_under(hidden), TWO)
    assert not found.states(moving.time).values[50:60].any()


def test_a_motion_may_be_short_or_gappy_but_not_empty(walk):
    model, motion, sites, _, _ = walk
    for frames in (1, 2, 5):
        part = Motion(motion.time[:frames], motion.names, motion.values[:frames])
        assert find_contacts(model, part, sites).sites == tuple(one.name for one in sites)
    with pytest.raises(BadData, match="without gaps"):
        find_contacts(
            model, Motion(motion.time, motion.names, np.full(motion.values.shape, np.nan)), sites
        )


def test_hysteresis_holds_between_its_thresholds():
    x = np.array([0.0, 0.5, 1.0, 0.5, 0.4, 0.1, 0.5, 0.9])
    assert hysteresis(x > 0.8, x < 0.3).tolist() == [
        False,
        False,
        True,
        True,
        True,
        False,
        False,
        True,
    ]
    time = np.arange(10) * 0.01
    blip = np.array([1, 1, 0, 1, 1, 1, 0, 0, 0, 1], bool)
    assert steady(blip, time, 0.02).tolist() == [True] * 6 + [False] * 3 + [True]


def test_sources_merge_by_trust():
    """A later source fills what earlier ones leave open; what they cover is theirs."""
    first = Contacts(("heel",), (Touch("heel", 1.0, 2.0, source="plates"),), ("one",))
    second = Contacts(
        ("heel", "toe"),
        (
            Touch("heel", 0.98, 2.05),
            Touch("heel", 1.8, 4.0),
            Touch("heel", 5.0, 6.0),
            Touch("toe", 1.0, 2.0),
        ),
        ("two",),
    )
    merged = merge_contacts((first, second))
    assert merged.sites == ("heel", "toe")
    assert merged.warnings == ("one", "two")
    assert [(one.start, one.stop) for one in merged.of("heel")] == [
        (1.0, 2.0),
        (2.0, 4.0),
        (5.0, 6.0),
    ]
    assert len(merged.of("toe")) == 1


def test_a_foot_that_goes_on_standing_while_its_plate_is_another_ones_is_kept():
    plates = Contacts(
        ("foot",),
        (Touch("foot", 0.0, 2.0, source="plates"), Touch("foot", 3.0, 9.0, source="plates")),
    )
    merged = merge_contacts((plates, Contacts(("foot",), (Touch("foot", 0.0, 9.2),))))
    assert sorted((one.start, one.stop) for one in merged.of("foot")) == [
        (0.0, 2.0),
        (2.0, 3.0),
        (3.0, 9.0),
        (9.0, 9.2),
    ]


def test_readiness_fades_smoothly():
    x = np.linspace(0.0, 1.5, 1501)
    y = fade(x, 0.8)
    assert (y[x <= 0.8] == 1.0).all()
    assert (y[x >= 1.0] == 0.0).all()
    assert (np.diff(y) <= 0.0).all()
    # Half a cosine has no corner: its slope starts and ends at nothing.
    assert np.abs(np.diff(y, 2)).max() < 2e-4
    assert np.isnan(fade(np.array([np.nan]), 0.8))[0]


def test_strengths_of_a_walk(walk):
    model, motion, sites, wrenches, floor = walk
    found = find_contacts(model, motion, sites)
    ready = contact_activations(model, motion, sites, found, ActivationOptions(floor=floor.height))
    states = found.states(motion.time).values
    assert ready.names == tuple(one.name for one in sites)
    assert (ready.values[states == 0.0] == 0.0).all()
    assert (ready.values[states > 0.0] > 0.0).all()
    assert ready.values.max() <= 1.0
    # In midstance a loaded foot is ready; what its heel does in push-off it is not.
    for foot, side in enumerate("rl"):
        load = wrenches.forces[:, foot, 1]
        assert ready[f"ball_medial_{side}"][load > 0.9 * load.max()].min() > 0.3
    with pytest.raises(BadData, match="say nothing of site"):
        contact_activations(model, motion, sites, Contacts(("heel_medial_r",), ()))


def test_forces_lean_to_a_point_above_the_center_of_mass(walk):
    """All lines through the sites along their leaning forces meet in one point."""
    model, motion, sites, _, _ = walk
    frame = 60
    across_up = preferred_directions(model, motion, sites, 0.3)
    assert np.abs(across_up[:, :, 1]).max() < 1e-12
    way = across_up[frame] + np.array([0.0, 1.0, 0.0])
    moving = site_motion(model, motion, sites)
    points = moving.places[frame]
    across = np.stack([np.eye(3) - np.outer(one, one) / (one @ one) for one in way])
    meeting = np.linalg.solve(across.sum(axis=0), np.einsum("kij,kj->i", across, points))
    distance = np.linalg.norm(np.cross(way, meeting - points), axis=1) / np.linalg.norm(way, axis=1)
    assert distance.max() < 1e-9
    assert meeting[1] > moving.height


def test_a_hand_on_an_object_is_as_ready_as_it_is_sure(walk):
    model, motion, _, _, _ = walk
    hand = Site("grip", "hand_r", np.zeros((1, 3)), against="torso")
    told = Contacts(
        ("grip",), (Touch(site="grip", start=0.6, stop=0.8, surface="torso", confidence=0.7),)
    )
    ready = contact_activations(model, motion, (hand,), told)
    assert set(np.unique(ready.values)) == {0.0, 0.7}


def test_options_scale(walk):
    """A stricter height leaves fewer touches."""
    model, motion, sites, _, _ = walk
    strict = find_contacts(model, motion, sites, ContactStateOptions(low=0.005, high=0.01))
    loose = find_contacts(model, motion, sites)
    assert strict.states(motion.time).values.sum() < loose.states(motion.time).values.sum()
